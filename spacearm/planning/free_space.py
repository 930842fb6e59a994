"""Free space: within joint limits and clear of singularities, for many curves at once.

det J* of a square task changes its sign at a singularity, and no motion may cross one: only
configurations with the sign of the start are free.
"""

from __future__ import annotations

import numpy as np

from spacearm.arrays import Array
from spacearm.mechanics.batch import evaluate
from spacearm.model.arm import SpaceArm

FAR = 1.0
"""Distances to the singular set beyond this are not told apart [rad]: they are too rough."""


class FreeSpace:
    """The joint positions that a motion may pass.

    Args:
        arm: The arm.
        q: (n,) joint positions at the start.
        lower: (n,) least joint positions, -inf for joints without limits.
        upper: (n,) largest.
    """

    def __init__(self, arm: SpaceArm, q: Array, lower: Array, upper: Array) -> None:
        self.arm, self.q, self.lower, self.upper = arm, q, lower, upper
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

        To first order, no more than `FAR`; -1 if they leave the free space.
        """
        inside = ((curves >= self.lower) & (curves <= self.upper)).all(axis=(1, 2))
        few = curves[inside]
        names = ("distance",) if np.isnan(self._det) else ("distance", "determinant")
        at = evaluate(self.arm, few.reshape(-1, self.arm.n), names)
        distance = np.minimum(at["distance"], FAR)
        if "determinant" in at:
            distance[at["determinant"] * self._det <= 0.0] = -1.0
        least = np.full(len(curves), -1.0)
        least[inside] = distance.reshape(len(few), curves.shape[1]).min(axis=1)
        return least
