"""Paths of the tip: polylines and functions of path length, in smooth pieces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from numbers import Real
from typing import NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, positive
from spacearm.errors import ConfigurationError
from spacearm.model.arm import Configuration
from spacearm.motion.goal import Goal, goal_pose, goal_rows, twist_between

Path: TypeAlias = Sequence[Goal] | Array | Callable[[float], Goal]
"""The corners of a polyline, or a function of path length [m]."""

DIFFERENCE = 1e-6
"""Half the length over which the direction of a path is taken [m]."""


class Segment(NamedTuple):
    """A smooth piece of path.

    Attributes:
        length: Its length [m].
        pose: The tip pose at a length along it; what the task leaves open does not matter.
        twist: (6,) the derivative of the pose with respect to that length.
        straight: Whether that derivative is constant.
    """

    length: float
    pose: Callable[[float], pin.SE3]
    twist: Callable[[float], Array]
    straight: bool


def path_start(cfg: Configuration, path: Path) -> pin.SE3:
    """Return the pose with which a path begins.

    Raises:
        ConfigurationError: The path has no beginning.
    """
    if callable(path):
        return goal_pose(cfg, path(0.0))
    try:
        return goal_pose(cfg, next(iter(path)))
    except (TypeError, StopIteration):
        raise _no_path(path) from None


def segments(
    cfg: Configuration, path: Path, length: float | None, start: pin.SE3 | None = None
) -> list[Segment]:
    """Return the path in smooth pieces, from where the tip is.

    Args:
        cfg: The configuration at the start.
        path: The path.
        length: Length of a path given as a function [m]; None for a polyline.
        start: A pose from which to go to the path instead.

    Raises:
        ConfigurationError: The path or its length does not make sense.
    """
    if callable(path):
        length = positive(length, "length", "length [m] of the path, which is a function")
        first = _line(cfg, cfg.tip if start is None else start, goal_pose(cfg, path(0.0)))
        return [*first, _curve(cfg, path, length)]
    if length is not None:
        raise ConfigurationError(f"length is {length}; a polyline has its own, leave it out")
    try:
        whole = list(path)
    except TypeError:
        whole = []
    if not whole or any(isinstance(corner, Real) for corner in whole):  # one point, perhaps
        raise _no_path(path)
    corners = [goal_pose(cfg, corner) for corner in whole]
    poses = [cfg.tip if start is None else start, *corners]
    pieces = [_line(cfg, *pair) for pair in pairwise(poses)]
    found = [segment for piece in pieces for segment in piece]
    if not found:
        raise ConfigurationError("path ends where the tip is; there is nothing to follow")
    return found


def _no_path(path: object) -> ConfigurationError:
    return ConfigurationError(
        f"path is {path!r}; give corners (one: [goal]), or a function of path length"
    )


def _line(cfg: Configuration, start: pin.SE3, end: pin.SE3) -> list[Segment]:
    """Return a straight line with a constant angular velocity, nothing if it has no length.

    Turns count by the task's length [m/rad], 1 m/rad where it has none.
    """
    task = cfg.arm.task
    whole = twist_between(start, end)
    rows = goal_rows(cfg, whole)
    linear = np.array(task.indices) < 3
    length = float(np.linalg.norm(np.where(linear, rows, rows * (task.length or 1.0))))
    if length < 1e-12:
        return []
    twist = whole / length

    def pose(s: float) -> pin.SE3:
        turned = pin.exp3(s * twist[3:]) @ start.rotation
        return pin.SE3(turned, start.translation + s * twist[:3])

    return [Segment(length, pose, lambda _: twist, True)]


def _curve(cfg: Configuration, path: Callable[[float], Goal], length: float) -> Segment:
    """Return a path given as a function of its length, its direction by differences."""

    def pose(s: float) -> pin.SE3:
        return goal_pose(cfg, path(s))

    def twist(s: float) -> Array:
        low, high = max(s - DIFFERENCE, 0.0), min(s + DIFFERENCE, length)
        return twist_between(pose(low), pose(high)) / (high - low)

    return Segment(length, pose, twist, False)
