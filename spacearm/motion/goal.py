"""Goals for the tip: a point in the task's linear rows or a pose; how far the tip is from it."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, ArrayLike, finite, shape_of
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.mechanics.barycentric_formulation import barycentric
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.frames import sound_pose

#: A point in the task's linear rows [m], along the goal axes, or a pose.
Goal: TypeAlias = ArrayLike | pin.SE3

#: Distance up to which something is at the origin [m].
AT_ORIGIN = 1e-9
#: Where the inertial frame has its origin; see `started`.
Origin = Literal["spacecraft", "cm"]


def started(cfg: Configuration, origin: Origin) -> Configuration:
    """Return the start of a motion in the inertial frame in which its points and poses are given.

    Args:
        cfg: The start, as `SpaceArm.at` makes it.
        origin: "spacecraft": the frame of `base`, which is the identity where none is given, so
            that the spacecraft starts at the origin and the poses of `SpaceArm.at` are goals as
            they are. "cm": the frame whose origin is the system CM at the start, as for points of
            a `Workspace`; `base` then gives the attitude.

    Raises:
        ConfigurationError: The origin is "cm", and the base has a position that does not put the
            system CM there.
    """
    if origin == "spacecraft":
        return cfg
    centred = np.linalg.norm(cfg.com) <= AT_ORIGIN
    if cfg.base.translation.any() and not centred:
        raise ConfigurationError(
            f"base has the position {cfg.base.translation.tolist()}, which puts the system CM "
            f"{np.linalg.norm(cfg.com):.3g} m from the origin, where origin='cm' has it; give a "
            "base that only turns, start.centred([0, 0, 0]), or origin='spacecraft'"
        )
    return cfg.centred(np.zeros(3))


def origin_of(cfg: Configuration) -> str:
    """Return what is at the origin of the inertial frame at the start of a motion, in words."""
    there = {"spacecraft": cfg.base.translation, "system CM": cfg.com}
    names = [name for name, place in there.items() if np.linalg.norm(place) <= AT_ORIGIN]
    return f"{' and '.join(names)} at the start" if names else "as base was given"


def goal_axes(cfg: Configuration) -> Array:
    """Return the axes (3, 3) along which goals are given, columns in inertial axes.

    They are the task axes (see `Task.axes`): the inertial ones for most tasks, tilted with the
    plane of a planar arm. If these turn while the joints move, they are the inertial axes.
    """
    return cfg.arm.task.axes(cfg.base.rotation) if steady(cfg.arm) else np.eye(3)


def goal_normal(arm: SpaceArm) -> int | None:
    """Return the normal (0, 1, 2) that the goal axes tilt with; None if they are inertial."""
    return next(iter(arm.task.singled_out), None) if steady(arm) else None


@lru_cache(maxsize=64)
def steady(arm: SpaceArm) -> bool:
    """Tell whether the task singles out no direction but, if any, the normal of the arm's plane."""
    return arm.task.singled_out <= {arm.tree.plane_normal()}


def goal_pose(cfg: Configuration, goal: Goal, what: str = "target") -> pin.SE3:
    """Return the pose that a goal stands for; what a point leaves open is as the tip has it now.

    Messages name it by `what`.

    Raises:
        ConfigurationError: The goal is neither a pose nor a point in the task's rows.
    """
    if isinstance(goal, pin.SE3) or shape_of(goal) == (4, 4):
        return sound_pose(goal, what)
    rows, names = cfg.arm.task.indices, cfg.arm.task.names
    if max(rows) > 2:
        raise ConfigurationError(
            f"{what} is {goal!r}; the task {names!r} takes a pose, as pin.SE3 or as a (4, 4) "
            "matrix: sa.pose(xyz, rpy) makes one, and task='position' of sa.load takes points"
        )
    meaning = f"[m], one for each row of the task {names!r}, or a pin.SE3"
    pose, axes = cfg.tip, goal_axes(cfg)
    place = axes.T @ pose.translation
    place[rows] = finite(goal, (len(rows),), what, meaning)
    pose.translation = axes @ place
    return pose


def as_goal(cfg: Configuration, pose: pin.SE3) -> Goal:
    """Return a pose as a goal of the task: the point in its rows, if they are all linear."""
    rows = cfg.arm.task.indices
    return pose if max(rows) > 2 else (goal_axes(cfg).T @ pose.translation)[rows]


def twist_between(start: pin.SE3, end: pin.SE3) -> Array:
    """Return the constant twist (6,) that leads from one pose to the other in unit time."""
    turn = pin.log3(end.rotation @ start.rotation.T)
    return np.concatenate((end.translation - start.translation, turn))


def miss(cfg: Configuration, goal: Goal) -> Array:
    """Return goal minus tip (k,) in the task's rows [m], [rad], along the goal axes."""
    return goal_rows(cfg, twist_between(cfg.tip, goal_pose(cfg, goal)))


def largest(off: Array, rows: list[int]) -> str:
    """Return the largest of deviations (k,), with the unit of its row of a twist."""
    i = int(np.argmax(np.abs(off)))
    return f"{abs(off[i]):.3g} {'m' if rows[i] % 6 < 3 else 'rad'}"


def row_of(pose: pin.SE3) -> str:
    """Return a pose as the numbers that a file would give it by."""
    numbers = (*pose.translation, *pin.rpy.matrixToRpy(pose.rotation))
    return "x y z roll pitch yaw " + " ".join(f"{x:.7g}" for x in numbers) + " [m, rad]"


def goal_rows(cfg: Configuration, twist: Array) -> Array:
    """Return the task's rows along the goal axes, unscaled, in [m] and [rad].

    `Task.jacobian` takes the same rows along the task axes, which may turn with the spacecraft,
    and divides the linear rows of a mixed task by its length.

    Args:
        cfg: The configuration.
        twist: (6,) twist or (6, n) Jacobian, inertial axes.

    Returns:
        (k,) or (k, n) rows.
    """
    columns = twist.reshape(len(twist), -1)
    return cfg.arm.task.components(columns, goal_axes(cfg)).reshape(-1, *twist.shape[1:])


def out_of_reach(cfg: Configuration, goal: pin.SE3) -> str:
    """Return a message if a goal is farther from the system CM than the arm can reach, else "".

    The reach is the length of the stretched virtual manipulator.
    """
    rows = [i for i in cfg.arm.task.indices if i < 3]
    try:
        links = barycentric(cfg).virtual_manipulator.links
    except UnsupportedError:  # sliding joints
        return ""
    reach = float(np.linalg.norm(links, axis=1).sum())
    distance = float(np.linalg.norm((goal_axes(cfg).T @ (goal.translation - cfg.com))[rows]))
    if distance <= reach * (1.0 + 1e-9):
        return ""
    return (
        f"the goal is {distance:.6g} m from the system CM, the tip of {cfg.arm.name} comes no "
        f"farther than {reach:.6g} m; sa.workspace shows where it can be"
    )


def goal_of(arm: SpaceArm, values: Array, name: str) -> Goal:
    """Return the goal that numbers for the task's rows mean.

    Args:
        arm: The arm; of one with several tips the rows of each.
        values: (k,) positions [m] and turns [rad] as roll, pitch, yaw.
        name: What they are called in an error.

    Returns:
        A point for tasks of linear rows only, else a pose.

    Raises:
        ConfigurationError: Their number is another one.
    """
    rows = arm.task.indices[: len(arm.task.rows)]
    if len(values) != len(rows):
        raise ConfigurationError(
            f"{name} has {len(values)} number{'s' * (len(values) != 1)}; the task of {arm.name} "
            f"takes {len(rows)}: {' '.join(arm.task.rows)}"
        )
    if max(rows) < 3:
        return values
    full = np.zeros(6)
    full[rows] = values
    return pin.SE3(pin.rpy.rpyToMatrix(full[3:]), full[:3])
