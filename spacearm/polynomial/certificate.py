"""Certificate that trigonometric polynomials have no common root on a path of straight segments.

Along a segment of a path let |g''| <= B, the bound of the curvature in its direction. On an
interval of width w at whose ends g has the same sign, |g| is at least the smaller of its values
there less B w^2 / 8. An interval is free as soon as this is more than rounding for one of the
polynomials; others are halved. With one polynomial a change of sign proves a root.

Along a segment a polynomial of angles is an entire function of the place x on it, from -1 to 1. Its
Chebyshev series ends where rounding begins, so that it is evaluated in a few dozen operations
instead of thousands (`Restriction`).

Rounding is counted: a value less than `TrigPolynomial.noise`, which bounds the errors of the fit
and of the evaluation, has no sign.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, named
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


PIECES = 8
"""Intervals that a segment is first divided into."""
NARROW = 1e-12
"""Width below which an interval is not halved [rad]."""
MOST = 50_000
"""Largest number of intervals at a time: of paths that go along the set for long."""

REFINEMENTS, CLOSE = 20, 1e-6
"""Steps to the best place where several polynomials are rounding; the longest, as a share of the
segment."""

WHOLE = 1000
"""Parts of a path in which progress is told."""

Verdict = Literal["free", "singular", "undecided"]


class Certificate(NamedTuple):
    """Proof that a path of straight segments in joint space is free of singularities, or a root.

    Attributes:
        free: Whether no singular configuration lies on it: proven, rounding included.
        at: (n,) the first configuration on it that is not free; None if the path is free.
        segment: Number of the segment that holds it; None if the path is free.
        margin: Least |S| met on the path, over the scale of S; of several minors the largest.
        verdict: "free"; "singular": S changes sign at `at`, which is proven; "undecided": at `at`
            S, or every minor, is less than its rounding, or more than 50,000 pieces of the path
            were still open, on paths of some 10,000 rad.
        noise: Bound of the rounding of S that the proof counts with, over the scale of S.
    """

    free: bool
    at: Array | None
    segment: int | None
    margin: float
    verdict: Verdict
    noise: float

    def __bool__(self) -> bool:
        return self.free

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data."""
        return named(self)


def certify(
    polynomials: Sequence[Jets],
    path: Array,
    singular: Callable[[Array], bool] | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Certificate:
    """Follow a path until the first point that is not proven to be free of common roots.

    Args:
        polynomials: One, or several whose common roots count.
        path: (m, n) configurations, joined by straight segments.
        singular: Decides whether a point (n,) at which several polynomials are rounding is a common
            root; undecided if None.
        progress: Called as progress(done, 1000), in thousandths of the path.
    """
    return _Path(list(polynomials), path, singular).certificate(progress)


class _Path:
    """A path and the polynomials along it; position s = i + t is at t on segment i."""

    def __init__(
        self, polynomials: list[Jets], path: Array, singular: Callable[[Array], bool] | None
    ) -> None:
        self.path = path if len(path) > 1 else path.repeat(2, axis=0)
        self.step = np.diff(self.path, axis=0)
        self.polynomials, self.singular = polynomials, singular
        self.scale = np.array([S.scale or 1.0 for S in polynomials])
        largest = float(np.abs(path).max(initial=0.0))
        self.noise = np.array([S.noise(largest) for S in polynomials])
        self.curvature = np.array([curvature(S, self.path[:-1], self.step) for S in polynomials])
        self.lines: list[Restriction] = []
        self.row = np.zeros(len(self.step), dtype=np.intp)
        self.margin = np.inf

    def certificate(self, progress: Callable[[int, int], object] | None = None) -> Certificate:
        """Halve intervals until all are free or the first one that is not has been found."""
        m = len(self.step)
        values = self.values(np.arange(m + 1.0))
        low, high = np.arange(m + 0.0), np.arange(m + 0.0) + 1.0
        left, right = values[:, :-1], values[:, 1:]
        open_ = ~self.is_free(low, high, left, right)
        if open_.any():
            self.restrict(np.flatnonzero(open_))
            parts = np.linspace(0.0, 1.0, PIECES + 1)
            low = (low[open_, None] + parts[:-1]).ravel()
            high = np.concatenate((low[1:], [0.0]))
            high[PIECES - 1 :: PIECES] = np.arange(m + 0.0)[open_] + 1.0
            left = self.values(low)
            right = np.concatenate((left[:, 1:], np.zeros((len(left), 1))), axis=1)
            right[:, PIECES - 1 :: PIECES] = values[:, 1:][:, open_]
        else:
            low = low[:0]
        blocked = self.blocked(values, np.arange(m + 1.0))
        while len(low):
            open_ = ~self.is_free(low, high, left, right) & (low <= blocked)
            low, high, left, right = low[open_], high[open_], left[:, open_], right[:, open_]
            if progress:
                progress(int(WHOLE * (1.0 - float((high - low).sum()) / m)), WHOLE)
            if not len(low):
                break
            if len(self.polynomials) == 1:  # nothing after a proven root matters
                crossing = self.signs(left)[0] * self.signs(right)[0] < 0
                if crossing.any():
                    first = int(np.argmax(crossing))
                    low, high = low[: first + 1], high[: first + 1]
                    left, right = left[:, : first + 1], right[:, : first + 1]
                    if first == 0 and self.is_monotone(low[0], high[0]):
                        return self.refusal(self.root(low[0], high[0]), "singular")
            middle = 0.5 * (low + high)
            narrow = (high - low) * self.length(low) <= NARROW
            narrow |= (middle == low) | (middle == high)  # no number lies between
            if narrow[0] or len(low) > MOST:
                return self.refusal(middle[0], self.verdict(low[0], high[0]))
            values = self.values(middle)
            blocked = min(blocked, self.blocked(values, middle))
            order = np.argsort(np.concatenate((low, middle)), kind="stable")
            low, high = np.concatenate((low, middle))[order], np.concatenate((middle, high))[order]
            left = np.concatenate((left, values), axis=1)[:, order]
            right = np.concatenate((values, right), axis=1)[:, order]
        if np.isfinite(blocked):
            return self.refusal(blocked, self.verdict(blocked, blocked))
        noise = float((self.noise / self.scale).max())
        return Certificate(True, None, None, float(self.margin), "free", noise)

    def point(self, s: Array) -> Array:
        """Return the configurations (m, n) at positions (m,)."""
        i = np.minimum(s.astype(np.int_), len(self.step) - 1)
        return self.path[i] + (s - i)[:, None] * self.step[i]

    def length(self, s: Array) -> Array:
        """Return the largest joint motion along the segments at positions (m,) [rad]."""
        return np.abs(self.step).max(axis=1)[np.minimum(s.astype(np.int_), len(self.step) - 1)]

    def restrict(self, segments: npt.NDArray[np.intp]) -> None:
        """Evaluate by series from now on, along these segments, where they are short enough."""
        start, step = self.path[segments], self.step[segments]
        lines = [Restriction.of(S, start, step) for S in self.polynomials]
        if any(line is None for line in lines):
            return
        self.row[segments] = np.arange(len(segments))
        self.lines = [line for line in lines if line is not None]
        self.noise = np.maximum(self.noise, [line.noise for line in self.lines])

    def values(self, s: Array) -> Array:
        """Evaluate the polynomials (p, m) at positions (m,)."""
        if self.lines:
            i = s.astype(np.intp)
            values = np.array([line(self.row[i], 2.0 * (s - i) - 1.0) for line in self.lines])
        else:
            Q = self.point(s)
            values = np.array([S(Q).value for S in self.polynomials])
        largest = (np.abs(values) / self.scale[:, None]).max(axis=0)
        self.margin = min(self.margin, float(largest.min()))
        return values

    def signs(self, values: Array) -> Array:
        """Return signs (p, m) of values; 0 where they may be rounding."""
        return np.where(np.abs(values) > self.noise[:, None], np.sign(values), 0.0)

    def is_free(self, low: Array, high: Array, left: Array, right: Array) -> Any:
        """Check which intervals (m,) hold no common root, from the values (p, m) at their ends."""
        i = low.astype(np.int_)
        sag = self.curvature[:, i] * ((high - low) ** 2 / 8.0)
        least = np.minimum(np.abs(left), np.abs(right)) - sag * (1.0 + 1e-12)
        return ((left * right > 0.0) & (least > self.noise[:, None])).any(axis=0)

    def blocked(self, values: Array, s: Array) -> float:
        """Return the first of the positions at which all values are rounding, or infinity."""
        nothing = (self.signs(values) == 0.0).all(axis=0)
        return float(s[nothing].min(initial=np.inf))

    def is_monotone(self, low: float, high: float) -> bool:
        """Check whether the one polynomial is proven to be monotone on an interval."""
        i = int(low)
        (S,), middle = self.polynomials, self.point(np.array([0.5 * (low + high)]))
        slope = float(S(middle, 1).gradient[0] @ self.step[i])
        return abs(slope) > self.curvature[0, i] * (high - low) + self.noise[0]

    def root(self, low: float, high: float) -> float:
        """Find the one root between positions where the one polynomial has different signs."""
        from scipy.optimize import brentq  # slow to import

        (S,), i = self.polynomials, int(low)

        def g(t: float) -> float:
            return float(S((self.path[i] + t * self.step[i])[None]).value[0])

        return i + float(brentq(g, low - i, high - i, xtol=1e-15, rtol=1e-15))

    def best(self, s: float) -> float:
        """Return the position near s at which the polynomials are least, by Gauss-Newton steps."""
        i = min(int(s), len(self.step) - 1)

        def at(t: float) -> tuple[Array, Array]:
            jets = [S((self.path[i] + t * self.step[i])[None], 1) for S in self.polynomials]
            g = np.array([jet.value[0] for jet in jets]) / self.scale
            return g, np.array([jet.gradient[0] @ self.step[i] for jet in jets]) / self.scale

        t = s - i
        g, slope = at(t)
        for _ in range(REFINEMENTS):
            change = float(g @ slope) / max(float(slope @ slope), 1e-300)
            better = float(np.clip(t - np.clip(change, -CLOSE, CLOSE), 0.0, 1.0))
            new, new_slope = at(better)
            if new @ new >= g @ g:
                break
            t, g, slope = better, new, new_slope
        return i + t

    def verdict(self, low: float, high: float) -> Verdict:
        """Say whether a root is proven about an interval that is not free."""
        if len(self.polynomials) > 1:
            at = self.point(np.array([self.best(0.5 * (low + high))]))[0]
            return "singular" if self.singular is not None and self.singular(at) else "undecided"
        i = min(int(low), len(self.step) - 1)
        for away in np.geomspace(1e-12, 1e-4, 9) / max(
            float(self.length(np.array([low]))[0]), 1e-4
        ):
            ends = np.clip((low - away, high + away), i, i + 1.0)
            signs = self.signs(np.array([self.polynomials[0](self.point(ends)).value]))[0]
            if signs[0] * signs[1] < 0:
                return "singular"
        return "undecided"

    def refusal(self, s: float, verdict: Verdict) -> Certificate:
        """Return the certificate of a path that is not free from position s on."""
        segment = min(int(s), len(self.step) - 1)
        at = self.point(np.array([s]))[0]
        noise = float((self.noise / self.scale).max())
        return Certificate(False, at, segment, 0.0, verdict, noise)
