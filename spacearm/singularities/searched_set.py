"""Found set: singular configurations of arms that have no singularity polynomial.

A redundant arm loses rank where n - k + 1 equations hold, u^T J*(q) V = 0, with u the left and V
the n - k + 1 right singular vectors of the least singular value. They are solved by the
Gauss-Newton method from many starts: what it returns was found, nothing says that it is complete.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, whole
from spacearm.errors import NoSolutionError
from spacearm.mechanics.jacobian import generalized_jacobian, generalized_jacobian_derivative
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_vector
from spacearm.model.mode import BaseMode
from spacearm.polynomial.univariate import wrap

LOST = 1e-10
"""A configuration is singular if its least singular value is below this share of the largest that
was met on the way to it."""
STEPS = 60
STARTS = 24
"""Starts about a configuration from which the nearest singular one is sought."""


@dataclass(frozen=True, eq=False)
class FoundSet:
    """Singular configurations, as far as found, of an arm without a singularity polynomial.

    Such arms are redundant or have sliding or mimic joints.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
        complete: False: other singular configurations may exist beside those found.
    """

    arm: SpaceArm
    mode: BaseMode = "free-floating"
    complete: bool = False

    def sample(self, m: int, rng: np.random.Generator | None = None) -> Array:
        """m singular configurations, (m, n), from uniform starts; no measure is promised.

        Raises:
            ConfigurationError: m is no whole number from 0 on.
            NoSolutionError: Of 20 m + 100 starts too few lead to a singular configuration; carries
                those that did.
        """
        m, rng = whole(m, "m", 0), rng or np.random.default_rng()
        found: list[Array] = []
        for _ in range(20 * m + 100):
            if len(found) == m:
                break
            q = lose_rank(self.arm, self._random(rng), self.mode)
            if q is not None:
                found.append(q)
        if len(found) < m:
            raise NoSolutionError(
                f"{self.arm.name}: {len(found)} of {m} singular configurations found", found
            )
        return np.array(found).reshape(m, self.arm.n)

    def nearest(self, q: npt.ArrayLike) -> tuple[Array, float]:
        """The nearest of the singular configurations found from starts about q.

        Returns:
            (n,) configuration and its distance in joint space [rad, m].

        Raises:
            NoSolutionError: None was found.
        """
        centre = joint_vector(self.arm, q, "q")
        rng = np.random.default_rng(0)
        spread = np.append(0.0, np.geomspace(0.05, np.pi, STARTS - 1))[:, None]
        starts = centre + spread * rng.uniform(-1.0, 1.0, (STARTS, self.arm.n))
        ends = [
            end for start in starts if (end := lose_rank(self.arm, start, self.mode)) is not None
        ]
        if not ends:
            raise NoSolutionError(f"{self.arm.name}: no singular configuration found")
        offsets = np.array([self._offset(end - centre) for end in ends])
        best = offsets[np.argmin(np.linalg.norm(offsets, axis=1))]
        return centre + best, float(np.linalg.norm(best))

    def _offset(self, offset: Array) -> Array:
        """Without whole turns, which for joints that mimic others may be none."""
        whole = ~self.arm.slides & (self.arm.coupling is None)
        return np.where(whole, wrap(offset), offset)

    def _random(self, rng: np.random.Generator) -> Array:
        """Turning joints anywhere, sliding ones within their limits or a metre."""
        low = np.where(~self.arm.slides, -np.pi, np.clip(self.arm.lower, -1.0, None))
        high = np.where(~self.arm.slides, np.pi, np.clip(self.arm.upper, None, 1.0))
        return rng.uniform(low, np.maximum(low, high))


def lose_rank(arm: SpaceArm, q: Array, mode: BaseMode) -> Array | None:
    """A singular configuration near q (n,) by the Gauss-Newton method, or None."""
    most = 0.0
    for _ in range(STEPS):
        cfg = arm.at(q)
        R = cfg.base.rotation
        U, sigma, VT = np.linalg.svd(arm.task.jacobian(generalized_jacobian(cfg, mode=mode), R))
        k = len(U)
        most = max(most, sigma[0])
        if sigma[-1] <= LOST * most:
            return q
        u, V = U[:, -1], VT[k - 1 :].T
        residual = np.zeros(V.shape[1])
        residual[0] = sigma[-1]
        dJ = arm.task.jacobian(generalized_jacobian_derivative(cfg, mode=mode), R)
        slope = np.einsum("a,jan,nr->rj", u, dJ, V)
        step = -np.linalg.lstsq(slope, residual, rcond=1e-9)[0]
        q = q + step * min(1.0, 0.3 / max(float(np.linalg.norm(step)), 1e-300))
    return None
