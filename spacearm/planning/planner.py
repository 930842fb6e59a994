"""Planning: joint motions that arrive although the straight way is singular.

Papadopoulos & Dubowsky (1993) end on an open problem, "the efficient construction of paths to reach
points in the path dependent workspace". Here are four answers, from cheap to thorough; a motion
counts only if it arrives when its rows are replayed, with the clearance asked for.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from numbers import Real

import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import whole
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError, unknown
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.motion.goal import Goal
from spacearm.planning import methods as plan_methods
from spacearm.planning.problem import Motion, Problem, bodies_apart, what_it_takes
from spacearm.planning.result import Attempt, Joints, Plan

METHODS: dict[str, Callable[[Problem], Motion]] = {
    "straight": plan_methods.straight,
    "joint space": plan_methods.joint_space,
    "cycles": plan_methods.cycles,
    "attitude first": plan_methods.attitude_first,
}
"""In the order in which "auto" tries them."""


def plan(
    arm: SpaceArm,
    q0: npt.ArrayLike,
    goal: Goal | Joints,
    *,
    base: pin.SE3 | None = None,
    clearance: float | None = None,
    final_attitude: npt.ArrayLike | pin.SE3 | float | None = None,
    limits: bool = True,
    collisions: bool = True,
    method: str = "auto",
    seed: int = 0,
    timeout: float = 60.0,
) -> Plan:
    """Finds a joint motion that leads the tip of a floating arm to a goal, from rest to rest.

    The spacecraft carries no momentum. With a constant momentum it drifts while the arm moves, and
    these plans miss: detumble first, or replan at the end.

    Methods: "straight", a line of the tip by J*; "attitude first", a joint motion that turns the
    spacecraft to an attitude from which the line is free (Nanos & Papadopoulos, 2015); "cycles", a
    closed loop in joint space that turns it, run through as often as it takes, then a curve to the
    goal; "joint space", the shortest joint curve that arrives. "auto" tries straight, joint space,
    cycles and attitude first, in this order.

    Args:
        arm: The arm.
        q0: (n,) joint positions at the start [rad] or [m].
        goal: A point in the task's linear rows [m], a pose, or `Joints`.
        base: Pose of the spacecraft at the start; the identity if None.
        clearance: Least sigma_min of the task Jacobian on the way; if None, 0.002 of the median
            over joint space, but no more than half of what the start has.
        final_attitude: (3, 3) attitude that the spacecraft shall have at the end, or a pose with
            it, or for planar arms an angle [rad].
        limits: Whether the joint limits count.
        collisions: Whether the spacecraft and the links must not meet where the URDF has collision
            geometry; bodies on both sides of one joint may touch, meshes count as convex hulls.
        method: "auto", or one of the four.
        seed: Of the first guesses; the same seed gives the same plan.
        timeout: Time after which the search is given up [s].

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The arm has several tips, or fewer joints than its task has rows.
        NoSolutionError: No motion was found; says why, of every method that was tried, and carries
            the best attempt (the start alone, where there is no better).
    """
    if method not in ("auto", *METHODS):
        raise ConfigurationError(unknown("method", method, ("auto", *METHODS)))
    if not isinstance(timeout, Real) or not timeout > 0.0:
        raise ConfigurationError(f"timeout is {timeout!r}; give a positive time [s]")
    seed = whole(seed, "seed", 0)
    arm.require_one_tip()  # whose path the plan holds
    if arm.n < arm.task.k:
        raise UnsupportedError(
            f"{arm.name} has {arm.n} joints for {arm.task.k} task rows ({arm.task.names}) and can "
            f"never do this task; take one with {arm.n} rows"
        )
    cfg, ends = arm.at(q0, base=base), time.monotonic() + float(timeout)
    try:
        task, ample = what_it_takes(cfg, goal, clearance, final_attitude, limits, seed)
        bodies = bodies_apart(cfg, task) if collisions else None
    except NoSolutionError as error:
        raise NoSolutionError(str(error), _best(cfg, error.best, ())) from None
    problem = Problem(cfg, task, ample, seed, ends, bodies)
    tried: list[Attempt] = []
    for name in METHODS if method == "auto" else (method,):
        try:
            problem.in_time()
            motion = METHODS[name](problem)
        except NoSolutionError as error:
            tried.append(Attempt(name, False, str(error)))
            problem.best = error.best if isinstance(error.best, list) else problem.best
            continue
        found = Plan.of(name, motion, task.clearance, tried, True if bodies else None)
        story = f"joint travel {found.length:.4g}, sigma_min at least {found.sigma_min.min():.3g}"
        tried.append(Attempt(name, True, "; ".join(filter(None, (story, problem.note)))))
        return replace(found, tried=tuple(tried))
    stories = "; ".join(f"{name}: {story}" for name, _, story in tried)
    best = _best(cfg, problem.best, tried)
    raise NoSolutionError(f"{arm.name}: no plan found: {stories}", best)


def _best(cfg: Configuration, motion: object, tried: Sequence[Attempt]) -> Plan:
    """The best attempt: a motion that does not do what was asked for, or the start alone."""
    return Plan.of("best attempt", motion if isinstance(motion, list) else [cfg], 0.0, tried, None)
