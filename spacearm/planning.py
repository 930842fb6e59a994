"""Planning: joint motions that arrive although the straight way is singular.

Papadopoulos & Dubowsky (1993) end on an open problem, "the efficient construction of paths to reach
points in the path dependent workspace". Here are four answers, from cheap to thorough; a motion
counts only if it arrives when its rows are replayed, with the clearance asked for.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm import plan_methods
from spacearm.arm import SpaceArm
from spacearm.arrays import Array
from spacearm.barycentric import barycentric
from spacearm.collisions import Collisions, collision_geometry
from spacearm.configuration import Configuration, joint_vector, sound_pose
from spacearm.defaults import the_one
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError, unknown
from spacearm.goal import Goal, goal_pose
from spacearm.joint_space import Task
from spacearm.plan import Attempt, Joints, Plan
from spacearm.plan_methods import Motion, Problem
from spacearm.singularity import singular_values, singularity

METHODS: dict[str, Callable[[Problem], Motion]] = {
    "straight": plan_methods.straight,
    "joint space": plan_methods.joint_space,
    "cycles": plan_methods.cycles,
    "attitude first": plan_methods.attitude_first,
}
"""In the order in which "auto" tries them."""
SHARE = 0.002
"""The clearance where none is asked for, as a share of the median sigma_min in joint space; no more
than half of what the start has."""
AMPLE = 0.2
"""The clearance that is aimed at first, likewise."""
PROBES = 200
SINGULAR = 1e-9
"""Share of the largest singular value below which a start is singular."""


def plan(
    arm: SpaceArm,
    start: npt.ArrayLike,
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
        start: (n,) joint positions at the start [rad] or [m].
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
        NoSolutionError: No motion was found; carries the best attempt, if there is one, and says
            why every method failed.
    """
    if method != "auto" and method not in METHODS:
        raise ConfigurationError(unknown("method", method, ("auto", *METHODS)))
    if not timeout > 0.0:
        raise ConfigurationError(f"timeout is {timeout}; give a positive time [s]")
    the_one(arm.tips, arm.name)  # which the plan leads
    cfg = arm.at(start, base)
    lower, upper = _bounds(cfg, limits)
    least, ample = _clearance(cfg, clearance, seed)
    task = Task(
        tip=None if isinstance(goal, Joints) else _reachable(cfg, goal_pose(cfg, goal)),
        q=joint_vector(arm, goal.q, "goal") if isinstance(goal, Joints) else None,
        attitude=None if final_attitude is None else _attitude(arm, final_attitude),
        clearance=least,
        lower=lower,
        upper=upper,
    )
    bodies = collision_geometry(arm) if collisions else None
    if bodies and (contact := bodies.contact(cfg.q[None])) is not None:
        raise NoSolutionError(f"the start is in collision: {contact}; collisions=False ignores it")
    if task.q is not None:
        _check_goal(cfg, task.q, bodies)
    problem = Problem(cfg, task, ample, seed, time.monotonic() + timeout, bodies)
    tried: list[Attempt] = []
    for name in METHODS if method == "auto" else (method,):
        try:
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
    left = problem.best and Plan.of("best attempt", problem.best, task.clearance, tried, None)
    raise NoSolutionError(f"{arm.name}: no plan found: {stories}", left)


def _bounds(cfg: Configuration, limits: bool) -> tuple[Array, Array]:
    """(n,) each: where the joints may be.

    Raises:
        NoSolutionError: The start is beyond them.
    """
    arm, free = cfg.arm, np.full(cfg.arm.n, np.inf)
    if not limits:
        return -free, free
    beyond = (cfg.q < arm.lower) | (cfg.q > arm.upper)
    if beyond.any():
        j = int(np.flatnonzero(beyond)[0])
        raise NoSolutionError(
            f"start of joint {arm.joint_names[j]!r} is {cfg.q[j]:.6g}, beyond its limits "
            f"{arm.lower[j]:.6g} and {arm.upper[j]:.6g}; limits=False ignores them"
        )
    return arm.lower, arm.upper


def _reachable(cfg: Configuration, goal: pin.SE3) -> pin.SE3:
    """The goal, unless it is farther from the system CM than the stretched virtual manipulator.

    Raises:
        NoSolutionError: It is.
    """
    try:
        links = barycentric(cfg).virtual_manipulator.links
    except UnsupportedError:  # sliding joints
        return goal
    reach = float(np.linalg.norm(links, axis=1).sum())
    distance = float(np.linalg.norm(goal.translation - cfg.com))
    if min(cfg.arm.task.indices) < 3 and distance > reach * (1.0 + 1e-9):
        raise NoSolutionError(
            f"the goal is {distance:.6g} m from the system CM, the tip of {cfg.arm.name} comes no "
            f"farther than {reach:.6g} m; sa.workspace shows where it can be"
        )
    return goal


def _check_goal(cfg: Configuration, q: Array, bodies: Collisions | None) -> None:
    """Raises NoSolutionError where no motion can lead to joint positions q (n,)."""
    if bodies and (contact := bodies.contact(q[None])) is not None:
        raise NoSolutionError(f"the goal is in collision: {contact}; collisions=False ignores it")
    here, there = (singularity(cfg.arm.at(x)).determinant for x in (cfg.q, q))
    if here is not None and there is not None and here * there <= 0.0:
        raise NoSolutionError(
            f"det J* is {here:.3g} at the start and {there:.3g} at the goal: every way between "
            "them meets a singularity; lead the tip there and leave the joints open"
        )


def _attitude(arm: SpaceArm, attitude: npt.ArrayLike | pin.SE3) -> Array:
    """(3, 3) the attitude asked for."""
    normal = arm.tree.plane_normal()
    given = attitude.rotation if isinstance(attitude, pin.SE3) else attitude
    values = np.asarray(given, dtype=np.float64)
    if values.shape == () and normal is not None and np.isfinite(values):
        turn: Array = pin.exp3(float(values) * np.eye(3)[normal])
        return turn
    if values.shape != (3, 3):
        raise ConfigurationError(
            f"final_attitude is {attitude!r}; give a (3, 3) rotation matrix, a pin.SE3"
            + (", or an angle [rad]" if normal is not None else "")
        )
    rotation: Array = sound_pose(pin.SE3(values, np.zeros(3)), "final_attitude").rotation
    return rotation


def _clearance(cfg: Configuration, clearance: float | None, seed: int) -> tuple[float, float]:
    """The least sigma_min on the way, and an ample one.

    Raises:
        NoSolutionError: The start has less.
    """
    sigma = singular_values(cfg)
    if sigma[-1] <= SINGULAR * sigma[0]:
        raise NoSolutionError(
            f"the start is singular (sigma_min {sigma[-1]:.1e} of {sigma[0]:.1e}); leave it first "
            "along sa.singularity(cfg).gradient"
        )
    rng = np.random.default_rng(seed)
    Q = rng.uniform(-np.pi, np.pi, (PROBES, cfg.arm.n))
    median = float(np.median([singular_values(cfg.arm.at(q))[-1] for q in Q]))
    most = 0.5 * float(sigma[-1])
    if clearance is None:
        return min(SHARE * median, most), min(AMPLE * median, most)
    if not (np.isfinite(clearance) and clearance >= 0.0):
        raise ConfigurationError(f"clearance is {clearance}; give a number from 0 on")
    if sigma[-1] < clearance:
        raise NoSolutionError(
            f"the start has sigma_min {sigma[-1]:.3g}, below the clearance of {clearance:.3g}"
        )
    return clearance, min(AMPLE * median, most)
