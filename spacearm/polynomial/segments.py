"""Proof that polynomials have no common root on straight segments.

Along q0 + t (q1 - q0) each polynomial is an entire function g(t), known to rounding by a Chebyshev
series (`Restriction`), and |g''| <= B, the bound of its curvature in that direction. On an interval
of half width h about t it has no root if |g(t)| > |g'(t)| h + B h^2 / 2, rounding included. An
interval is free of common roots as soon as one of the polynomials has none. Other intervals are
halved until they are, or until all polynomials are rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.polynomial.certificate import Certificate
from spacearm.polynomial.jets import Jets

PIECES = 16
"""Intervals that a short path is first divided into."""
SHORTEST = 1e-15
"""Half length below which an interval is not halved [rad, m]."""
MOST_INTERVALS = 200_000
"""Largest number of intervals at a time; a path that needs more is undecided."""
REFINEMENTS = 20
"""Steps to the best place where all polynomials are rounding."""
CLOSE = 1e-6
"""Longest of these steps, as a share of the segment."""
ELLIPSES = np.array([2.0, 4.0, 8.0, 16.0, 32.0, 128.0, 1024.0])
"""Sums of half axes of Bernstein ellipses, of which the best bounds the error of a series."""
INTERPOLATED = 1e-15
"""Error of a series, as a share of the scale."""


class Restriction(NamedTuple):
    """A polynomial along S straight segments, x from -1 at the start of each to 1 at its end.

    Attributes:
        series: (S, N) Chebyshev coefficients.
        curvature: (S,) bounds of the second derivatives with respect to x.
        noise: Values below this are rounding.
        scale: Bound of all values.
    """

    series: Array
    curvature: Array
    noise: float
    scale: float

    @classmethod
    def of(cls, f: Jets, start: Array, step: Array) -> Restriction:
        """Restrict a polynomial to the segments from `start` by `step`, (S, n) each."""
        size = np.abs(step) / 2.0
        reach = np.abs(np.stack((start, start + step)) - f.chart.centre).max(axis=(0, 1))
        B = np.einsum("mi,ij,mj->m", size, f.curvature(reach / f.chart.half), size)
        N = _length(f, reach, size.max(axis=0))
        theta = np.pi * (np.arange(N) + 0.5) / N
        X = start[:, None] + 0.5 * (1.0 + np.cos(theta))[:, None] * step[:, None]
        values = f(X.reshape(-1, start.shape[1])).value.reshape(len(start), N)
        series = values @ np.cos(np.outer(theta, np.arange(N))) * (2.0 / N)
        series[:, 0] /= 2.0
        largest = float(np.abs(np.stack((start, start + step))).max())
        noise = f.noise(largest) + 2.0 * INTERPOLATED * f.scale
        return cls(series, B, noise, f.scale)

    def __call__(self, number: npt.NDArray[np.intp], x: Array) -> tuple[Array, Array]:
        """Compute values and slopes at x (m,) on the segments of these numbers, (m,) each."""
        c = self.series[number].T
        b1, b2, d1, d2 = np.zeros((4, len(x)))
        for k in range(len(c) - 1, 0, -1):  # Clenshaw's recurrence and its derivative
            d1, d2 = 2.0 * (b1 + x * d1) - d2, d1
            b1, b2 = 2.0 * x * b1 - b2 + c[k], b1
        return x * b1 - b2 + c[0], b1 + x * d1 - d2


def _length(f: Jets, reach: Array, half_step: Array) -> int:
    """Return how many Chebyshev coefficients give a polynomial along a segment to rounding.

    On the Bernstein ellipse rho, |g| <= M, and the error of N coefficients is at most
    4 M rho^(1 - N) / (rho - 1): Trefethen, Approximation Theory and Approximation Practice (2013),
    theorem 8.2.
    """
    bounds = [f.bound(reach, half_step, rho) for rho in ELLIPSES]
    wanted = INTERPOLATED * f.scale * (ELLIPSES - 1.0) / 4.0
    N = 2.0 + np.log(np.maximum(np.array(bounds) / wanted, 1.0)) / np.log(ELLIPSES)
    return int(np.ceil(N.min()))


def certify(
    polynomials: Sequence[Jets], path: Array, singular: Callable[[Array], bool] | None = None
) -> Certificate:
    """Follow the segments between the rows of `path` (m, n) until one meets a common root.

    Args:
        polynomials: The polynomials.
        path: Positions; a single row is a segment of no length.
        singular: Decides whether a point at which all polynomials are rounding is a root; True for
            all if None. Where it says no, the certificate is undecided.
    """
    start, step = (path[:-1], np.diff(path, axis=0)) if len(path) > 1 else (path, 0.0 * path)
    lines = [Restriction.of(f, start, step) for f in polynomials]
    pieces = max(1, PIECES // len(start))
    number = np.repeat(np.arange(len(start)), pieces)
    x = np.tile((2.0 * np.arange(pieces) + 1.0) / pieces - 1.0, len(start))
    h, margin = 1.0 / pieces, np.inf
    length = np.abs(step).max(axis=1) / 2.0
    first: tuple[int, float] | None = None
    noise = max(line.noise / line.scale for line in lines)
    while len(x):
        free, zero, largest = _look(lines, number, x, h)
        margin = min(margin, float(largest[free].min(initial=np.inf)))
        shortest = h * length[number] < SHORTEST
        waiting = np.flatnonzero(~free)
        if (found := np.flatnonzero(zero | (shortest & ~free))).size:
            first = int(number[found[0]]), float(x[found[0]])
            waiting = waiting[waiting <= found[0]]
        if len(waiting) > MOST_INTERVALS:
            i, x0 = int(number[waiting[0]]), float(x[waiting[0]])
            at = start[i] + 0.5 * (1.0 + x0) * step[i]
            return Certificate(False, at, i, 0.0, "undecided", noise)
        waiting = waiting[~shortest[waiting]]
        number, x, h = number[waiting].repeat(2), x[waiting].repeat(2), h / 2.0
        x = x + np.tile([-h, h], len(waiting))
        if first is not None:  # what comes after the first root does not matter
            before = (number < first[0]) | ((number == first[0]) & (x < first[1]))
            number, x = number[before], x[before]
    if first is None:
        return Certificate(True, None, None, margin, "free", noise)
    i, x0 = first
    at = start[i] + 0.5 * (1.0 + _refined(lines, i, x0)) * step[i]
    sure = singular is None or singular(at)
    return Certificate(False, at, i, 0.0, "singular" if sure else "undecided", noise)


def _look(
    lines: Sequence[Restriction], number: npt.NDArray[np.intp], x: Array, h: float
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_], Array]:
    """Look at intervals (m,) of half width h about x: which are free, and at which x all is zero.

    Returns:
        Free of common roots (m,); all polynomials rounding at x (m,); the largest |g| over its
        scale (m,).
    """
    free, zero = np.zeros(len(x), dtype=bool), np.ones(len(x), dtype=bool)
    largest = np.zeros(len(x))
    for line in lines:
        rows = np.flatnonzero(~free)
        value, slope = line(number[rows], x[rows])
        size, B = np.abs(value), line.curvature[number[rows]]
        free[rows] = size > np.abs(slope) * h + 0.5 * B * h * h + line.noise
        zero[rows] &= size <= line.noise
        largest[rows] = np.maximum(largest[rows], size / line.scale)
    return free, zero & ~free, largest


def _refined(lines: Sequence[Restriction], i: int, x: float) -> float:
    """Return the x in [-1, 1] near x at which the polynomials are least on segment i."""

    def values(x: float) -> tuple[Array, Array]:
        found = [line(np.array([i]), np.array([x])) for line in lines]
        g, slope = (np.array([part[0] for part in parts]) for parts in zip(*found, strict=True))
        scale = np.array([line.scale for line in lines])
        return g / scale, slope / scale

    g, slope = values(x)
    for _ in range(REFINEMENTS):
        change = float(g @ slope) / max(float(slope @ slope), 1e-300)
        better = min(max(x - min(max(change, -CLOSE), CLOSE), -1.0), 1.0)
        new, new_slope = values(better)
        if new @ new >= g @ g:
            break
        x, g, slope = better, new, new_slope
    return x
