"""Goals for the tip: a point in the task's linear rows or a pose; how far the tip is from it."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arm import SpaceArm
from spacearm.arrays import Array
from spacearm.configuration import Configuration, sound_pose
from spacearm.errors import ConfigurationError

Goal: TypeAlias = npt.ArrayLike | pin.SE3
"""A point in the task's linear rows [m], or a pose."""


def goal_pose(cfg: Configuration, goal: Goal) -> pin.SE3:
    """The pose that a goal stands for; what a point leaves open is as the tip has it now."""
    if isinstance(goal, pin.SE3):
        return sound_pose(goal, "target")
    rows, names = cfg.arm.task.indices, cfg.arm.task.names
    try:
        point = np.asarray(goal, dtype=np.float64)
    except (TypeError, ValueError):
        point = np.empty(0)
    if max(rows) > 2 or point.shape != (len(rows),) or not np.isfinite(point).all():
        raise ConfigurationError(
            f"target is {goal!r}; the task {names!r} takes "
            + ("a pin.SE3" if max(rows) > 2 else f"{len(rows)} finite numbers or a pin.SE3")
        )
    pose = cfg.tip
    pose.translation[rows] = point
    return pose


def as_goal(arm: SpaceArm, pose: pin.SE3) -> Goal:
    """A pose as the task of an arm takes it: the point in its rows, if they are all linear."""
    rows = arm.task.indices
    return pose if max(rows) > 2 else pose.translation[rows]


def twist_between(start: pin.SE3, end: pin.SE3) -> Array:
    """(6,) the constant twist that leads from one pose to the other in unit time."""
    turn = pin.log3(end.rotation @ start.rotation.T)
    return np.concatenate((end.translation - start.translation, turn))


def miss(cfg: Configuration, goal: Goal) -> Array:
    """(k,) goal minus tip in the task's rows [m], [rad], inertial axes."""
    error: Array = twist_between(cfg.tip, goal_pose(cfg, goal))[cfg.arm.task.indices]
    return error
