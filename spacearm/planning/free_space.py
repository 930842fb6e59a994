"""Free space: within joint limits and clear of singularities, for many curves at once.

det J* of a square task changes its sign at a singularity, and no motion may cross one: only
configurations with the sign of the start are free.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from spacearm.arrays import Array
from spacearm.mechanics.batch import evaluate
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_scales

FAR = 1.0
"""Distances to the singular set beyond this are not told apart [rad]: they are too rough."""
BEYOND, ACROSS = -2.0, -1.0
"""In place of the distance, for curves beyond the limits or on the other side of a singularity."""
NEARBY, TURNS_ROUND = 0.5, -0.8
"""Up to which distance [rad] the way out tells sides apart; cosine of the angle between two."""
BLOCK = 8_000
"""Configurations that are evaluated between two looks at the clock."""


class FreeSpace:
    """The joint positions that a motion may pass.

    Args:
        arm: The arm.
        q: (n,) joint positions at the start.
        lower: (n,) least joint positions, -inf for joints without limits.
        upper: (n,) largest.
        check_time: Called now and then; it may raise an error to end the search.
    """

    def __init__(
        self,
        arm: SpaceArm,
        q: Array,
        lower: Array,
        upper: Array,
        check_time: Callable[[], None] = lambda: None,
    ) -> None:
        self.arm, self.q, self.lower, self.upper = arm, q, lower, upper
        self._check_time = check_time
        self._det = evaluate(arm, q[None], ("determinant",))["determinant"][0]
        self._turns = ~arm.slides & (arm.coupling is None)

    def draw(self, m: int, rng: np.random.Generator) -> Array:
        """Draw joint positions (m, n) within the limits, at most half a turn from q without limits.

        Args:
            m: Number of rows.
            rng: Source of random numbers.
        """
        low = np.where(np.isfinite(self.lower), self.lower, self.q - np.pi)
        high = np.where(np.isfinite(self.upper), self.upper, self.q + np.pi)
        return rng.uniform(low, high, (m, self.arm.n))

    def wrapped(self, Q: Array) -> Array:
        """Return the same postures (m, n) by whole turns, near q and within the limits."""
        turned = self.q + np.mod(Q - self.q + np.pi, 2.0 * np.pi) - np.pi
        turned += 2.0 * np.pi * ((turned < self.lower) * 1.0 - (turned > self.upper))
        return np.where(self._turns, turned, Q)

    def windings(self, width: float, m: int, rng: np.random.Generator) -> Array:
        """Draw whole turns (m, n) of the joints without limits, more of them for a larger width."""
        endless = self._turns & np.isinf(self.lower) & np.isinf(self.upper)
        turns = 2.0 * np.pi * np.rint(0.5 * width * rng.normal(size=(m, self.arm.n)))
        return turns * endless

    def least_distance(self, curves: Array) -> Array:
        """Return how near to the singular set curves (K, m, n) come (K,) [rad].

        To first order, no more than `FAR`; `BEYOND` or `ACROSS` if they leave the free space.
        """
        inside = ((curves >= self.lower) & (curves <= self.upper)).all(axis=(1, 2))
        few = curves[inside]
        least, size = np.full(len(curves), BEYOND), max(1, BLOCK // curves.shape[1])
        blocks = [self._least(few[i : i + size]) for i in range(0, len(few), size)]
        least[inside] = np.concatenate(blocks) if blocks else 0.0
        return least

    def _least(self, curves: Array) -> Array:
        """Return the same of a few curves within the limits."""
        self._check_time()
        square = self.arm.n == self.arm.task.k
        names = ("distance", "determinant" if square else "away")
        at = evaluate(self.arm, curves.reshape(-1, self.arm.n), names)
        distance = np.minimum(at["distance"], FAR).reshape(curves.shape[:2])
        if square:
            across = (at["determinant"] * self._det <= 0.0).reshape(distance.shape)
        else:
            away = at["away"].reshape(curves.shape) / joint_scales(self.arm)
            across = sides(away, distance) < 0.0
        return np.asarray(np.where(across.any(axis=1), ACROSS, distance.min(axis=1)))


def sides(away: Array, distance: Array) -> Array:
    """Tell on which side of the singular set of a redundant arm points on curves are (..., m).

    The set has as a rule two dimensions less than joint space, and thus no sides. But where two
    joints turn the tip in almost the same way, it is all but singular on what divides joint space.
    Then the direction away from the set turns round from one point to the next.

    Args:
        away: (..., m, n) unit vectors away from the set.
        distance: (..., m) distances to it [rad].

    Returns:
        1 for the side of the first point, -1 for the other.
    """
    near = np.maximum(distance[..., 1:], distance[..., :-1]) < NEARBY
    flips = near & ((away[..., 1:, :] * away[..., :-1, :]).sum(axis=-1) < TURNS_ROUND)
    ones = np.ones((*distance.shape[:-1], 1))
    return np.cumprod(np.concatenate((ones, np.where(flips, -1.0, 1.0)), axis=-1), axis=-1)
