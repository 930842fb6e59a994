"""Singular configurations found by a search, for arms that have no singularity polynomial.

A redundant arm loses rank where n - k + 1 equations hold, u^T J*(q) V = 0, with u the left and V
the n - k + 1 right singular vectors of the least singular value. They are solved by the
Gauss-Newton method from many starts. The search may miss singular configurations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, whole
from spacearm.errors import NoSolutionError, UnsupportedError
from spacearm.mechanics.jacobian import task_jacobian, task_jacobian_derivative
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_vector
from spacearm.model.mode import BaseMode
from spacearm.polynomial.newton import shortened
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.polynomial.univariate import wrap
from spacearm.singularities.abstract_set import SingularSet
from spacearm.singularities.polynomial import check_square

LOST = 1e-10
"""A configuration is singular if its least singular value is below this share of the largest one
met during the iteration."""
STEPS = 60
"""Largest number of Gauss-Newton steps."""
STRIDE = 0.3
"""Longest step [rad, m]."""
STARTS = 24
"""Starts about a configuration from which the nearest singular one is searched."""


@dataclass(frozen=True, eq=False, repr=False)
class FoundSet(SingularSet):
    """Singular configurations found by a search, of an arm without a singularity polynomial.

    Such arms are redundant or have prismatic or mimic joints. `sample` and `nearest` return what
    the search finds; all other methods raise `UnsupportedError`.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
    """

    @property
    def complete(self) -> bool:
        """False: other singular configurations may exist beside those found."""
        return False

    def _unsupported(self, *_: object, **__: object) -> NoReturn:
        """Raise UnsupportedError: the arm has no singularity polynomial, and why."""
        check_square(self.arm, "a FoundSet has only .sample and .nearest")
        raise UnsupportedError(f"{self.arm.name} has an exact set; take it from sa.singular_set")

    roots = is_free = clearance = curves = surface = components = _unsupported

    @property
    def S(self) -> TrigPolynomial:
        """Unsupported: there is no singularity polynomial."""
        self._unsupported()

    @property
    def relevant(self) -> tuple[int, ...]:
        """Unsupported: there is no singularity polynomial."""
        self._unsupported()

    @property
    def dimension(self) -> int:
        """Unsupported: there is no singularity polynomial."""
        self._unsupported()

    def __repr__(self) -> str:
        return f"FoundSet({self.arm.name}, {self.mode}: by search, may miss configurations)"

    def sample(self, m: int, rng: np.random.Generator | None = None) -> Array:
        """Search m singular configurations, (m, n), from uniform starts; no measure is promised.

        Raises:
            ConfigurationError: m is no whole number from 0 on.
            NoSolutionError: Too few of 20 m + 100 starts lead to a singular configuration; carries
                those found.
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
        """Find the nearest of the singular configurations found from starts about q.

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
        """Remove whole turns from an offset, unless mimic joints make them matter."""
        whole = ~self.arm.slides & (self.arm.coupling is None)
        return np.where(whole, wrap(offset), offset)

    def _random(self, rng: np.random.Generator) -> Array:
        """Draw a start: revolute joints anywhere, prismatic ones within their limits or 1 m."""
        low = np.where(~self.arm.slides, -np.pi, np.clip(self.arm.lower, -1.0, None))
        high = np.where(~self.arm.slides, np.pi, np.clip(self.arm.upper, None, 1.0))
        return rng.uniform(low, np.maximum(low, high))


def lose_rank(arm: SpaceArm, q: Array, mode: BaseMode) -> Array | None:
    """Find a singular configuration near q (n,) by the Gauss-Newton method, or None."""
    most = 0.0
    for _ in range(STEPS):
        cfg = arm.at(q)
        U, sigma, VT = np.linalg.svd(task_jacobian(cfg, mode=mode))
        k = len(U)
        most = max(most, sigma[0])
        if sigma[-1] <= LOST * most:
            return q
        u, V = U[:, -1], VT[k - 1 :].T
        residual = np.zeros(V.shape[1])
        residual[0] = sigma[-1]
        slope = np.einsum("a,jan,nr->rj", u, task_jacobian_derivative(cfg, mode=mode), V)
        q = q + shortened(-np.linalg.lstsq(slope, residual, rcond=1e-9)[0], STRIDE)
    return None
