"""Following a path from many attitudes, each from its best posture. Imports the compiler."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, Progress
from spacearm.mission.starts import MORE_STEPS, STEPS, all_branches, branch, onward
from spacearm.model.arm import SpaceArm
from spacearm.motion.runs.leading import Settings, Table, lead_all

Flags = npt.NDArray[np.bool_]
Integers = npt.NDArray[np.signedinteger[Any]]

NO_START = 6
"""Number of the end of attitudes at which no posture has the tip at the beginning of the path."""
TRIES = 12
"""Random postures tried at each attitude where none is given."""


class Outcome(NamedTuple):
    """What came of following a path from m attitudes.

    Attributes:
        attitude: (m, 4) attitudes of the spacecraft at the start, quaternions xyzw.
        q: (m, n) postures at the start, NaN where there is none.
        ended: (m,) how it ended.
        s: (m,) length of path behind the tip.
        distance: (m,) least distance to the singular set [rad]; pi where it is more, to first
            order.
        slack: (m,) least distance of a joint to its limits [rad] or [m].
        tilt: (m,) largest turn of the spacecraft on the way [rad].
    """

    attitude: Array
    q: Array
    ended: Integers
    s: Array
    distance: Array
    slack: Array
    tilt: Array

    def take(self, which: Integers | Flags) -> Outcome:
        """Return some of them."""
        return Outcome._make(column[which] for column in self)

    def feasible(self, margin: float) -> Flags:
        """Return (m,) whether the tip arrived and kept the margin."""
        return np.asarray((self.ended == 0) & (self.distance >= margin))


def joined(outcomes: Sequence[Outcome]) -> Outcome:
    """Return all outcomes as one."""
    return Outcome._make(np.concatenate(column) for column in zip(*outcomes, strict=True))


@dataclass(frozen=True)
class Survey:
    """A path, and how it is to be followed.

    Attributes:
        arm: The arm.
        start: Pose of the tip at the beginning of the path, from the system CM.
        paths: The path.
        settings: What ends the motion.
        q0: (n,) the posture whose branch is followed; None for all that are found.
        first: (4,) the attitude at which it is near the start.
        seed: Of the random postures.
    """

    arm: SpaceArm
    start: pin.SE3
    paths: Table
    settings: Settings
    q0: Array | None
    first: Array
    seed: int

    def closely(self) -> Survey:
        """Return the same with the settings of a survey of one angle."""
        return replace(self, settings=self.settings._replace(tolerance=1e-9, stride=0.05))

    def finely(self) -> Survey:
        """Return the same with small steps, for the ends of intervals."""
        return replace(
            self, settings=self.settings._replace(tolerance=1e-10, stride=0.05, least_stride=0.002)
        )

    def at(self, attitude: Array, reach: float, progress: Progress | None = None) -> Outcome:
        """Follow the path from all attitudes (m, 4), neighbours up to `reach` [rad] apart."""
        if self.q0 is None:
            rng = np.random.default_rng(self.seed)
            q = all_branches(self.arm, self.start, attitude, TRIES, rng)
        else:
            q = branch(self.arm, self.start, attitude, self.q0, self.first, reach)[:, None]
        return self.follow(attitude, q, progress)

    def near(self, attitude: Array, seed: Array, near: bool = False) -> Outcome:
        """Follow the path from attitudes (m, 4), postures on the branches of others (m, n) nearby.

        Args:
            attitude: (m, 4) attitudes.
            seed: (m, n) postures.
            near: Whether they may be near the border of what can be reached.
        """
        steps = MORE_STEPS if near else STEPS
        q = onward(self.arm, self.start, attitude, seed, steps)
        if self.q0 is None and not near:
            rng = np.random.default_rng(self.seed)
            more = all_branches(self.arm, self.start, attitude, TRIES, rng)
            return self.follow(attitude, np.concatenate((q[:, None], more), axis=1))
        return self.follow(attitude, q[:, None])

    def follow(self, attitude: Array, q: Array, progress: Progress | None = None) -> Outcome:
        """Follow the path from attitudes (m, 4) and postures (m, c, n); return the best of each."""
        m, c, n = q.shape
        there = np.isfinite(q).all(axis=2).ravel()
        each, flat = np.repeat(attitude, c, axis=0), q.reshape(-1, n)
        columns = [np.full(m * c, x) for x in (NO_START, 0.0, 0.0, -np.inf, 0.0)]
        if there.any():
            led = lead_all(
                self.arm, flat[there], each[there], self.paths, None, self.settings, progress
            )
            found = (led.ended, led.s, np.minimum(led.distance, np.pi), led.slack, led.tilt)
            for column, values in zip(columns, found, strict=True):
                column[there] = values
        ended, s, distance, *_ = columns
        rank = np.where(ended == 0, 1e9 + distance, s) - np.where(ended == NO_START, 1.0, 0.0)
        best = np.arange(m) * c + rank.reshape(m, c).argmax(axis=1)
        return Outcome(attitude, flat[best], *(column[best] for column in columns))
