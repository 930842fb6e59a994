"""Polynomials along straight segments: functions of one variable, known by few numbers.

Along a segment a polynomial of angles is an entire function of the place x on it, from -1 to 1. Its
Chebyshev series ends where rounding begins, so that it is evaluated at a place in a few dozen
operations instead of thousands.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.polynomial.jets import Jets
from spacearm.polynomial.trig import EPS

ELLIPSES = np.array([1.1, 1.4, 2.0, 4.0, 8.0, 16.0, 32.0, 128.0, 1024.0])
"""Sums of half axes of Bernstein ellipses, of which the best bounds the error of a series."""
INTERPOLATED = 1e-15
"""Error of a series, as a share of the scale."""
MOST_TERMS = 4096
"""Longest series; segments of some thousand radians would need longer ones."""


class Restriction(NamedTuple):
    """A polynomial along S straight segments, x from -1 at the start of each to 1 at its end.

    Attributes:
        series: (S, N) Chebyshev coefficients.
        noise: Bound of the errors of values.
    """

    series: Array
    noise: float

    @classmethod
    def of(cls, f: Jets, start: Array, step: Array) -> Restriction | None:
        """Restrict a polynomial to the segments from `start` by `step`, (S, n) each.

        None if that takes more than `MOST_TERMS` coefficients.
        """
        reach = np.abs(np.stack((start, start + step)) - f.chart.centre).max(axis=(0, 1))
        terms = _length(f, reach, np.abs(step).max(axis=0) / 2.0)
        if terms > MOST_TERMS:
            return None
        N = int(np.ceil(terms))
        theta = np.pi * (np.arange(N) + 0.5) / N
        X = start[:, None] + 0.5 * (1.0 + np.cos(theta))[:, None] * step[:, None]
        values = f(X.reshape(-1, start.shape[1])).value.reshape(len(start), N)
        series = values @ np.cos(np.outer(theta, np.arange(N))) * (2.0 / N)
        series[:, 0] /= 2.0
        largest = float(np.abs(np.stack((start, start + step))).max())
        lebesgue = 1.0 + 2.0 / np.pi * np.log(N)
        noise = lebesgue * f.noise(largest) + (INTERPOLATED + 4.0 * N * EPS) * f.scale
        return cls(series, noise)

    def __call__(self, number: npt.NDArray[np.intp], x: Array) -> Array:
        """Compute values at x (m,) on the segments of these numbers, (m,), by Clenshaw's rule."""
        c = self.series[number].T
        b1, b2 = np.zeros((2, len(x)))
        for k in range(len(c) - 1, 0, -1):
            b1, b2 = 2.0 * x * b1 - b2 + c[k], b1
        return np.asarray(x * b1 - b2 + c[0])


def curvature(f: Jets, start: Array, step: Array) -> Array:
    """Bound |g''| along segments from `start` by `step` (S, n), with respect to t from 0 to 1."""
    reach = np.abs(np.stack((start, start + step)) - f.chart.centre).max(axis=(0, 1))
    B, size = f.curvature(reach / f.chart.half), np.abs(step)
    return np.asarray(np.einsum("mi,ij,mj->m", size, B, size))


def _length(f: Jets, reach: Array, half_step: Array) -> float:
    """Return how many Chebyshev coefficients give a polynomial along a segment to rounding.

    On the Bernstein ellipse rho, |g| <= M, and the error of N coefficients is at most
    4 M rho^(1 - N) / (rho - 1): Trefethen, Approximation Theory and Approximation Practice (2013),
    theorem 8.2.
    """
    if not f.scale:
        return 1.0
    bounds = np.log([f.bound(reach, half_step, rho) for rho in ELLIPSES])
    wanted = np.log(INTERPOLATED * f.scale * (ELLIPSES - 1.0) / 4.0)
    N = 2.0 + np.maximum(bounds - wanted, 0.0) / np.log(ELLIPSES)
    return float(N.min())
