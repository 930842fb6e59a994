"""Target: what a plan must achieve, checked before the search."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, finite
from spacearm.errors import NoSolutionError
from spacearm.mechanics.distance import distance_at
from spacearm.mechanics.jacobian import singular_values
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.frames import sound_pose
from spacearm.model.joints import joint_vector
from spacearm.motion.following import follow
from spacearm.motion.goal import Goal, as_goal, goal_pose, out_of_reach
from spacearm.planning.many_curves import turning_axes
from spacearm.planning.optimiser import ARRIVED, Target
from spacearm.planning.result import Joints
from spacearm.singularities.report import NO_INVERSE, TOLERANCE, angle, singularity

LEAST = float(np.radians(0.1))
"""The clearance where none is asked for, but no more than half of what the start has [rad]."""
AMPLE = float(np.radians(6.0))
"""The clearance that is aimed at first, likewise."""


def make_target(
    cfg: Configuration,
    goal: Goal | Joints,
    clearance: float | None,
    final_attitude: npt.ArrayLike | pin.SE3 | float | None,
    limits: bool,
) -> tuple[Target, float]:
    """Return the target of a plan, and the clearance to aim at first; arguments as in `plan`.

    Raises:
        ConfigurationError: An argument does not make sense.
        NoSolutionError: No motion can achieve the target.
    """
    lower, upper = bounds_of(cfg, limits)
    least, ample = clearance_of(cfg, clearance)
    target = Target(
        tip=None if isinstance(goal, Joints) else _reachable(cfg, goal_pose(cfg, goal), limits),
        q=joint_vector(cfg.arm, goal.q, "goal") if isinstance(goal, Joints) else None,
        attitude=None if final_attitude is None else _attitude(cfg, final_attitude),
        clearance=least,
        lower=lower,
        upper=upper,
    )
    if target.q is not None:
        _check_joints(cfg, target.q, target)
    return target, ample


def bounds_of(cfg: Configuration, limits: bool) -> tuple[Array, Array]:
    """Return the least and the largest joint positions (n,).

    Raises:
        NoSolutionError: The start is beyond the limits.
    """
    arm, free = cfg.arm, np.full(cfg.arm.n, np.inf)
    if not limits:
        return -free, free
    _check_within(arm, "start", cfg.q, arm.lower, arm.upper)
    return arm.lower, arm.upper


def _check_within(arm: SpaceArm, what: str, q: Array, lower: Array, upper: Array) -> None:
    """Raise a NoSolutionError if joint positions (n,) are beyond their limits."""
    beyond = (q < lower) | (q > upper)
    if beyond.any():
        j = int(np.flatnonzero(beyond)[0])
        raise NoSolutionError(
            f"{what} of joint {arm.joint_names[j]!r} is {q[j]:.6g}, beyond its limits "
            f"{lower[j]:.6g} and {upper[j]:.6g}; limits=False ignores them"
        )


def _reachable(cfg: Configuration, goal: pin.SE3, limits: bool) -> pin.SE3:
    """Return the goal if the stretched virtual manipulator is long enough for it.

    Raises:
        NoSolutionError: It is not; carries the motion towards the goal as far as J* leads.
    """
    if far := out_of_reach(cfg, goal):
        line = follow(cfg, [as_goal(cfg, goal)], limits=limits)
        raise NoSolutionError(far, list(line))
    return goal


def _check_joints(cfg: Configuration, q: Array, target: Target) -> None:
    """Raise a NoSolutionError if no motion can lead to joint positions q (n,)."""
    _check_within(cfg.arm, "goal", q, target.lower, target.upper)
    here, there = (singularity(cfg.arm.at(x)).determinant for x in (cfg.q, q))
    if here is not None and there is not None and here * there <= 0.0:
        raise NoSolutionError(
            f"det J* is {here:.3g} at the start and {there:.3g} at the goal: every way between "
            "them meets a singularity; lead the tip there and leave the joints open"
        )
    if (distance := distance_at(cfg.arm.at(q), "free-floating")) < target.clearance:
        raise NoSolutionError(
            f"the goal has a distance of {angle(distance)} to the singular set, below the "
            f"clearance of {angle(target.clearance)}"
        )


def _attitude(cfg: Configuration, attitude: npt.ArrayLike | pin.SE3) -> Array:
    """Return the attitude (3, 3) asked for.

    Raises:
        NoSolutionError: A planar arm cannot turn its spacecraft there.
    """
    rotation = _rotation(cfg.arm, attitude)
    axes = turning_axes(cfg.arm)
    turn = pin.log3(cfg.base.rotation.T @ rotation)
    if len(axes) == 1 and np.linalg.norm(np.delete(turn, axes[0])) > ARRIVED:
        raise NoSolutionError(
            f"final_attitude is no turn about {'xyz'[axes[0]]} of the spacecraft from its start, "
            f"and {cfg.arm.name} turns it about nothing else"
        )
    return rotation


def _rotation(arm: SpaceArm, attitude: npt.ArrayLike | pin.SE3) -> Array:
    """Return the rotation (3, 3) that final_attitude stands for."""
    normal = arm.tree.plane_normal()
    given = attitude.rotation if isinstance(attitude, pin.SE3) else attitude
    meaning = "(a rotation matrix), a pin.SE3"
    if normal is not None:
        if not np.iterable(given):
            angle = finite(given, (), "final_attitude", "[rad], a (3, 3) rotation or a pin.SE3")
            return pin.exp3(float(angle) * np.eye(3)[normal])
        meaning += ", or an angle [rad]"
    R = finite(given, (3, 3), "final_attitude", meaning)
    return sound_pose(pin.SE3(R, np.zeros(3)), "final_attitude").rotation


def clearance_of(cfg: Configuration, clearance: float | None) -> tuple[float, float]:
    """Return the least distance to the singular set on the way [rad], and the one to aim at first.

    Raises:
        NoSolutionError: The start has less.
    """
    sigma = singular_values(cfg)
    distance = distance_at(cfg, "free-floating")
    if sigma[-1] <= NO_INVERSE * sigma[0]:
        values = f"sigma_min {sigma[-1]:.1e} of {sigma[0]:.1e}"
        if distance > TOLERANCE:
            raise NoSolutionError(
                f"J* has no inverse at the start ({values}) nor around it: {cfg.arm.name} has no "
                "joint that moves the tip in some direction; take a task with fewer rows"
            )
        raise NoSolutionError(
            f"the start is singular ({values}); leave it first along sa.singularity(cfg).gradient"
        )
    ample = min(AMPLE, 0.5 * distance)
    if clearance is None:
        return min(LEAST, 0.5 * distance), ample
    if distance < clearance:
        raise NoSolutionError(
            f"the start has a distance of {angle(distance)} to the singular set, below the "
            f"clearance of {angle(float(clearance))}"
        )
    return float(clearance), ample
