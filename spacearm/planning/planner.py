"""Planner: tries the methods of planning from cheap to thorough, and keeps an account of them.

Papadopoulos & Dubowsky (1993) end on an open problem, "the efficient construction of paths to reach
points in the path dependent workspace". A motion counts as a solution only if it arrives when its
rows are replayed, with the clearance asked for.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from numbers import Real

import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import whole
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError, unknown
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.motion.goal import Goal
from spacearm.planning.result import Attempt, Joints, Plan

IGNORED = "collisions NOT checked (collisions=False)"
FAILED = "collisions NOT checked of this attempt"


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
    """Find a joint motion that leads the tip of a floating arm to a goal, from rest to rest.

    The momentum is zero. With another momentum the spacecraft drifts while the arm moves, and the
    tip misses the goal: detumble first, or plan again at the end.

    Methods, in the order in which "auto" tries them: "straight", a line of the tip by J*; "joint
    space", the shortest joint curve that arrives; "cycles", a closed loop in joint space that turns
    the spacecraft, run through as often as it takes, then a curve to the goal; "attitude first", a
    joint motion that turns the spacecraft to an attitude from which the line is free (Nanos &
    Papadopoulos, 2015).

    Args:
        arm: The arm.
        q0: (n,) joint positions at the start [rad] or [m].
        goal: A point in the task's linear rows [m], a pose, or `Joints`.
        base: Pose of the spacecraft at the start; the identity if None.
        clearance: How far from the singular set the motion stays at least [rad], to first order as
            in `singularity`, from 0 to 1; if None, 0.1 degrees, but no more than half of what the
            start has.
        final_attitude: (3, 3) attitude that the spacecraft shall have at the end, or a pose with
            it, or for planar arms an angle [rad].
        limits: Whether the joint limits hold.
        collisions: Whether the spacecraft and the links must not meet. Links count with their
            collision geometry, or their visuals where they have none; meshes as convex hulls.
            Bodies on both sides of one joint may touch. `Plan.checked` says what was checked.
        method: "auto", or one of the four.
        seed: Seed of the random first guesses; the same seed gives the same plan.
        timeout: Time after which the search is given up [s].

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The arm has several tips, or fewer joints than its task has rows.
        NoSolutionError: No motion was found; says why, of every method that was tried, and carries
            the best attempt (the start alone, where there is no better).
    """
    from spacearm.planning.methods import METHODS  # slow to import, as is all behind it
    from spacearm.planning.problem import Problem, bodies_apart, make_target

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
        target, ample = make_target(cfg, goal, clearance, final_attitude, limits)
        bodies = bodies_apart(cfg, target) if collisions else None
    except NoSolutionError as error:
        raise NoSolutionError(str(error), _best(cfg, error.best, ())) from None
    problem = Problem(cfg, target, ample, seed, ends, bodies)
    tried: list[Attempt] = []
    for name in METHODS if method == "auto" else (method,):
        try:
            problem.check_time()
            rows = METHODS[name](problem)
        except NoSolutionError as error:
            tried.append(Attempt(name, False, str(error)))
            problem.best = error.best if isinstance(error.best, list) else problem.best
            continue
        checked = IGNORED if bodies is None else bodies.account
        apart = True if bodies is not None and bodies.bodies else None
        found = Plan.of_rows(name, rows, target.clearance, tried, checked, apart)
        story = f"joint travel {found.length:.4g}, {found.nearest}"
        tried.append(Attempt(name, True, "; ".join(filter(None, (story, problem.note)))))
        return replace(found, tried=tuple(tried))
    stories = "; ".join(f"{name}: {story}" for name, _, story in tried)
    best = _best(cfg, problem.best, tried)
    raise NoSolutionError(f"{arm.name}: no plan found: {stories}", best)


def _best(cfg: Configuration, rows: object, tried: Sequence[Attempt]) -> Plan:
    """Return the best attempt: rows that do not solve the problem, or the start alone."""
    best = rows if isinstance(rows, list) else [cfg]
    return Plan.of_rows("best attempt", best, 0.0, tried, FAILED, None)
