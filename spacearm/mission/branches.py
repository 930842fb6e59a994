"""Starts of a path: postures with which the tip is at its beginning, by attitude of the spacecraft.

With the attitude held, the tip is at a pose for isolated postures of an arm without redundancy;
each is the posture of a branch, which goes on as the attitude changes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.mechanics.floating import reactions
from spacearm.mission.rotations import angle_between, nearest_of
from spacearm.model.arm import SpaceArm
from spacearm.planning.many_curves import held_jacobian, inverse_kinematics
from spacearm.singularities.risk import uniform

#: Steps of Newton's method: usually, and near the border of what can be reached.
STEPS, MORE_STEPS = 14, 60
#: What the tip may miss [m], [rad].
REACHED = 1e-9
#: Largest change of a joint from one attitude to the next on a branch [rad] or [m].
FARTHEST = 1.5
#: Postures are the same up to this difference [rad] or [m].
SAME = 1e-6


class HeldTip(NamedTuple):
    """An arm whose tip is held at a pose while the spacecraft turns.

    Attributes:
        arm: The arm.
        tip: The pose, from the system CM.
    """

    arm: SpaceArm
    tip: pin.SE3

    def postures(self, attitude: Array, seed: Array, steps: int = STEPS) -> Array:
        """Return postures (m, n), NaN where there is none near the seed.

        Args:
            attitude: (m, 4) attitudes of the spacecraft, quaternions xyzw.
            seed: (m, n) postures to start from.
            steps: Number of steps of Newton's method.
        """
        found = np.full(seed.shape, np.nan)
        known = np.flatnonzero(np.isfinite(seed).all(axis=1))
        if len(known):
            R = Rotation.from_quat(attitude[known]).as_matrix()
            q, _, miss = inverse_kinematics(self.arm, seed[known], self.tip, R, np.eye(3), steps)
            q = within_limits(self.arm, q)
            found[known] = np.where((miss <= REACHED)[:, None], q, np.nan)
        return found

    def onward(self, attitude: Array, seed: Array, steps: int = STEPS) -> Array:
        """Return postures (m, n) on the branches of others at attitudes nearby, NaN where none is.

        Arguments as in `postures`.
        """
        found = self.postures(attitude, seed, steps)
        near = np.abs(unturned(self.arm, found - seed)) <= FARTHEST  # NaN is not
        same = np.asarray(near.all(axis=1))
        same[same] = self._side(found[same]) == self._side(seed[same])
        return np.where(same[:, None], found, np.nan)

    def branch(self, attitude: Array, q0: Array, first: Array, reach: float) -> Array:
        """Follow one posture over the attitudes of the spacecraft.

        Args:
            attitude: (m, 4) attitudes, quaternions xyzw.
            q0: (n,) a posture near the one at the first attitude.
            first: (4,) the attitude from which to go.
            reach: Angle up to which an attitude is the neighbour of another [rad].

        Returns:
            (m, n) postures, NaN where the branch does not reach.

        Raises:
            NoSolutionError: No attitude has a posture near q0.
        """
        known, q = self._first(attitude, q0, first)
        found = np.full((len(attitude), self.arm.n), np.nan)
        tried = np.full(len(attitude), -1)
        while True:
            waiting = np.flatnonzero(np.isnan(found[:, 0]))
            if not len(waiting):
                return found
            nearest, apart = nearest_of(known, attitude[waiting])
            new = (nearest != tried[waiting]) & (apart <= max(reach, 1.01 * float(apart.min())))
            if not new.any():
                return found
            now, seed = waiting[new], q[nearest[new]]
            tried[now] = nearest[new]
            found[now] = self.onward(attitude[now], seed)
            new = now[np.isfinite(found[now, 0])]
            known, q = np.vstack((known, attitude[new])), np.vstack((q, found[new]))

    def all_branches(self, attitude: Array, tries: int, rng: np.random.Generator) -> Array:
        """Return postures (m, tries, n) from random ones, NaN where a try found none or a known.

        Args:
            attitude: (m, 4) attitudes, quaternions xyzw.
            tries: Number of random postures to start from.
            rng: Random numbers.
        """
        seeds = uniform(self.arm, True, tries, rng)
        each = [self.postures(attitude, np.tile(seed, (len(attitude), 1))) for seed in seeds]
        found = np.stack(each, axis=1)
        for i in range(1, tries):
            apart = np.abs(unturned(self.arm, found[:, i, None] - found[:, :i])).max(axis=2)
            found[(apart < SAME).any(axis=1), i] = np.nan
        return found

    def _first(self, attitude: Array, q0: Array, first: Array) -> tuple[Array, Array]:
        """Return the attitude (1, 4) at which a branch begins, and its posture (1, n).

        It is the given one, or of those where a posture near q0 is found the nearest to it.
        """
        q = self.postures(first[None], q0[None], MORE_STEPS)
        if np.isfinite(q).all():
            return first[None], q
        q = self.postures(attitude, np.tile(q0, (len(attitude), 1)), MORE_STEPS)
        solved = np.flatnonzero(np.isfinite(q).all(axis=1))
        if not len(solved):
            raise NoSolutionError(
                f"{self.arm.name}: from the start's q no posture was found with the tip at the "
                "beginning of the path, at any attitude; give another, or all_branches=True to try "
                "many"
            )
        nearest = solved[np.argmin(angle_between(attitude[solved], first))]
        return attitude[None, nearest], q[None, nearest]

    def _side(self, q: Array) -> Array:
        """Return the sign (m,) of the determinant of J with the attitude held; 1 if not square.

        A branch ends where it vanishes.
        """
        if self.arm.task.k != self.arm.n or not len(q):
            return np.ones(len(q))
        J = held_jacobian(reactions(self.arm, q))[:, self.arm.task.indices]
        return np.sign(np.linalg.det(J))


def within_limits(arm: SpaceArm, q: Array) -> Array:
    """Move angles by whole turns between their limits, where one can be there."""
    turn = 2.0 * np.pi
    free = ~arm.slides if arm.coupling is None else np.zeros(arm.n, dtype=bool)
    bounded = free & np.isfinite(arm.lower) & np.isfinite(arm.upper)
    middle = np.where(bounded, 0.5 * (arm.lower + arm.upper), 0.0)
    folded = q - turn * np.round((q - middle) / turn)
    outside = (q < arm.lower) | (q > arm.upper)
    return np.where(bounded & outside, folded, q)


def unturned(arm: SpaceArm, dq: Array) -> Array:
    """Return differences (..., n) of joint positions without the whole turns in them."""
    turns = np.zeros(arm.n) if arm.coupling is not None else np.where(arm.slides, 0.0, 2.0 * np.pi)
    return dq - turns * np.round(dq / (2.0 * np.pi))
