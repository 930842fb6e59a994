"""Courses: a motion as a check of collisions sees it, at any point between its rows.

Joint positions are linear between the rows of all courses. What the spacecraft does between them
is what tells one kind from the other.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.collisions.bodies import Body
from spacearm.collisions.speeds import helix, inertial_speeds
from spacearm.mechanics.floating import move
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.motion import Motion


class Course(ABC):
    """A motion of an arm.

    Attributes:
        arm: The arm.
        path: (m, n) its rows.
        t: (m,) its times [s].
    """

    def __init__(self, arm: SpaceArm, path: Array, t: Array) -> None:
        self.arm, self.path, self.t = arm, path, t

    def __len__(self) -> int:
        return len(self.path)

    def joints(self, u: float) -> Array:
        """Return the joint positions (n,) at row u, between rows where it is no whole number."""
        return interpolated(self.path, u)

    def time(self, u: float) -> float:
        """Return the time at row u [s]."""
        return float(interpolated(self.t, u))

    def full(self, u: float) -> Array:
        """Return the configuration (nq,) of the Pinocchio model at row u."""
        base = pin.SE3ToXYZQUAT(self.base(u))
        return np.concatenate((base, self.arm.all_joints(self.joints(u))))

    @property
    def out(self) -> Array:
        """(N,) largest displacements of the model's joints [rad] or [m]."""
        return np.abs([self.arm.all_joints(q) for q in self.path]).max(axis=0)

    @abstractmethod
    def base(self, u: float, /) -> pin.SE3:
        """Return the pose of the spacecraft at row u."""

    @abstractmethod
    def swept(self, bodies: Sequence[Body]) -> Array:
        """Return how far bodies move between rows at most (bodies, m - 1) [m], inertial axes."""


class InJointSpace(Course):
    """A joint motion alone: it says nothing about the spacecraft, which only obstacles ask for."""

    def __init__(self, arm: SpaceArm, path: Array) -> None:
        super().__init__(arm, path, np.full(len(path), np.nan))

    def base(self, _u: float, /) -> pin.SE3:
        """Return the identity."""
        return pin.SE3.Identity()

    def swept(self, bodies: Sequence[Body]) -> Array:
        """Return zeros."""
        return np.zeros((len(bodies), len(self) - 1))


class Floating(Course):
    """A motion at zero momentum: between its rows the spacecraft reacts as it does in truth.

    Args:
        rows: Its configurations.
        t: (m,) its times [s].
    """

    def __init__(self, rows: Sequence[Configuration], t: Array) -> None:
        super().__init__(rows[0].arm, np.array([cfg.q for cfg in rows]), t)
        self.rows = rows

    def base(self, u: float) -> pin.SE3:
        """Return the pose of the spacecraft, by `move` from the row before."""
        i = min(int(u), len(self) - 1)
        return self.rows[i].base if u == i else move(self.rows[i], self.joints(u)).base

    def swept(self, bodies: Sequence[Body]) -> Array:
        """Return the ways by `inertial_speeds`."""
        steps = np.abs(np.diff(self.path, axis=0))
        return inertial_speeds(self.arm, bodies, self.out) @ steps.T


class Recorded(Course):
    """A motion as it stands: between its rows the spacecraft goes as `Motion.at` has it."""

    def __init__(self, motion: Motion) -> None:
        super().__init__(motion.arm, motion.q, motion.t)
        self.motion = motion

    def base(self, u: float) -> pin.SE3:
        """Return the pose of the spacecraft."""
        return self.motion.at(self.time(u)).base

    def swept(self, bodies: Sequence[Body]) -> Array:
        """Return the ways of the spacecraft's frame, of its turn and of the joints, in sum."""
        arm, out = self.arm, self.out
        poses = [cfg.base for cfg in self.motion]
        origin, turn = np.array([helix(a, b) for a, b in pairwise(poses)]).reshape(-1, 2).T
        full = np.array([arm.all_joints(q) for q in self.path])
        steps = np.abs(np.diff(full, axis=0))
        ways = []
        for body in bodies:
            slides = {j for one in body.slides.values() for j in one}
            slides |= {j - 2 for j, r in body.reach.items() if _slides(arm, j)}
            way = origin + (body.far + sum(out[j] for j in slides)) * turn
            for joint, reach in body.reach.items():
                way = way + (reach + out[body.slides[joint]].sum()) * steps[:, joint - 2]
            ways.append(way)
        return np.array(ways).reshape(len(bodies), len(self) - 1)


def interpolated(rows: Array, u: float) -> Array:
    """Return the value at row u, linear between whole numbers."""
    i = min(int(u), max(len(rows) - 2, 0))
    return rows[i] + (u - i) * (rows[min(i + 1, len(rows) - 1)] - rows[i])


def _slides(arm: SpaceArm, joint: int) -> bool:
    return bool(arm.tree.joints[arm.model.names[joint]].kind == "prismatic")
