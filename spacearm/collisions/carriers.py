"""Carriers: what moves the frames of obstacles, and how far it can move a point at most.

Each gives the poses of its frames at a time, and a bound on the way that a point goes between two
times; the point is within `far` of frame 0, and `reach` says how far a radian of each joint moves
it in that frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.collisions.speeds import helix
from spacearm.model.arm import Configuration
from spacearm.motion.motion import Motion


class Carrier(Protocol):
    """What moves the frames of an obstacle."""

    def frames(self, t: float, /) -> Sequence[pin.SE3]:
        """Return the poses of the frames at a time [s]."""

    def moved(
        self, frame: int, reach: Mapping[int, float], far: float, t0: float, t1: float, /
    ) -> float:
        """Return how far a point in a frame moves between two times at most [m]."""


class Still(NamedTuple):
    """Frames at rest.

    Attributes:
        at: Their poses.
    """

    at: tuple[pin.SE3, ...]

    @classmethod
    def of(cls, cfg: Configuration) -> Still:
        """Return the joint frames of a robot in a configuration."""
        return cls(tuple(joint_frames(cfg)))

    def frames(self, _t: float, /) -> Sequence[pin.SE3]:
        """Return the poses."""
        return self.at

    def moved(
        self, _frame: int, _reach: Mapping[int, float], _far: float, _t0: float, _t1: float, /
    ) -> float:
        """Return 0."""
        return 0.0


class Drifting(NamedTuple):
    """A frame with a steady twist.

    Attributes:
        pose: Its pose at time 0.
        twist: (6,) velocity of its origin [m/s] and angular velocity [rad/s], inertial axes.
    """

    pose: pin.SE3
    twist: Array

    def frames(self, t: float) -> Sequence[pin.SE3]:
        """Return the pose at a time."""
        v, w = self.twist[:3], self.twist[3:]
        return (pin.SE3(pin.exp3(t * w) @ self.pose.rotation, self.pose.translation + t * v),)

    def moved(
        self, _frame: int, _reach: Mapping[int, float], far: float, t0: float, t1: float, /
    ) -> float:
        """Return the way of the origin and of the turn about it."""
        v, w = self.twist[:3], self.twist[3:]
        return float(np.linalg.norm(v) + far * np.linalg.norm(w)) * abs(t1 - t0)


@dataclass(frozen=True)
class Moving:
    """The joint frames of a robot on a motion; frame 1 is its spacecraft. At its ends it rests.

    Attributes:
        motion: The motion.
    """

    motion: Motion

    def frames(self, t: float) -> Sequence[pin.SE3]:
        """Return the poses of the joint frames at a time."""
        return joint_frames(self.motion.at(t))

    def moved(
        self, _frame: int, reach: Mapping[int, float], far: float, t0: float, t1: float, /
    ) -> float:
        """Return the way by the spacecraft's motion and by that of the joints."""
        origin, turn, joints = self._travel
        way = origin + far * turn
        for joint, length in reach.items():
            way = way + length * joints[:, joint - 2]
        ends = np.interp((t0, t1), self.motion.t, way)
        return float(abs(ends[1] - ends[0]))

    @cached_property
    def _travel(self) -> tuple[Array, Array, Array]:
        """The ways up to each sample: of the spacecraft's origin (m,), turn (m,), joints (m, N)."""
        poses = [cfg.base for cfg in self.motion]
        steps = np.array([helix(a, b) for a, b in pairwise(poses)]).reshape(-1, 2)
        full = np.array([self.motion.arm.all_joints(q) for q in self.motion.q])
        origin, turn = np.vstack((np.zeros(2), steps.cumsum(axis=0))).T
        rates = np.abs(np.diff(full, axis=0)).cumsum(axis=0)
        return origin, turn, np.vstack((np.zeros(full.shape[1]), rates))


def joint_frames(cfg: Configuration) -> list[pin.SE3]:
    """Return the poses of the joints of a robot, the spacecraft's frame at 1."""
    data = cfg.arm.borrow()
    pin.forwardKinematics(cfg.arm.model, data, cfg.full)
    frames = [pose.copy() for pose in data.oMi]
    cfg.arm.give_back(data)
    return frames
