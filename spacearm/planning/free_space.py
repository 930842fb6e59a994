"""The free space of a motion: within joint limits and clear of singularities, many curves at once.

A square task changes the sign of det J* at a singularity, and no motion may cross one: free is
only what has the sign of the start.
"""

from __future__ import annotations

import numpy as np

from spacearm.arrays import Array
from spacearm.mechanics.batch import evaluate
from spacearm.model.arm import SpaceArm


class FreeSpace:
    """Where the joints may be.

    Args:
        arm: The arm.
        q: (n,) where the motion begins.
        lower: (n,) least joint positions, -inf for joints without limits.
        upper: (n,) largest.
    """

    def __init__(self, arm: SpaceArm, q: Array, lower: Array, upper: Array) -> None:
        self.arm, self.q, self.lower, self.upper = arm, q, lower, upper
        self._det = evaluate(arm, q[None], ("determinant",))["determinant"][0]
        self._turns = ~arm.slides & (arm.coupling is None)

    def draw(self, m: int, rng: np.random.Generator) -> Array:
        """(m, n) positions anywhere within the limits, at most half a turn from q where none are.

        Args:
            m: How many.
            rng: Their source.
        """
        low = np.where(np.isfinite(self.lower), self.lower, self.q - np.pi)
        high = np.where(np.isfinite(self.upper), self.upper, self.q + np.pi)
        return rng.uniform(low, high, (m, self.arm.n))

    def wrapped(self, Q: Array) -> Array:
        """(m, n) the same postures by whole turns, within the limits if may be, nearest to q."""
        turned = self.q + np.mod(Q - self.q + np.pi, 2.0 * np.pi) - np.pi
        turned += 2.0 * np.pi * ((turned < self.lower) * 1.0 - (turned > self.upper))
        return np.where(self._turns, turned, Q)

    def windings(self, width: float, m: int, rng: np.random.Generator) -> Array:
        """(m, n) whole turns of the joints that have no limits, the more the larger the width."""
        endless = self._turns & np.isinf(self.lower) & np.isinf(self.upper)
        turns: Array = 2.0 * np.pi * np.rint(0.5 * width * rng.normal(size=(m, self.arm.n)))
        return turns * endless

    def room(self, curves: Array) -> Array:
        """(K,) least sigma_min on curves, (K, m, n) points on each; negative if they leave it."""
        inside = ((curves >= self.lower) & (curves <= self.upper)).all(axis=(1, 2))
        few = curves[inside]
        names = ("sigma_min",) if np.isnan(self._det) else ("sigma_min", "determinant")
        at = evaluate(self.arm, few.reshape(-1, self.arm.n), names)
        sigma = at["sigma_min"]
        if "determinant" in at:
            sigma[at["determinant"] * self._det <= 0.0] = -1.0
        least = np.full(len(curves), -1.0)
        least[inside] = sigma.reshape(len(few), curves.shape[1]).min(axis=1)
        return least
