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
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy

from spacearm.arrays import Array, Integers
from spacearm.polynomial.jets import Jets, stacked
from spacearm.polynomial.trig import EPS
from spacearm.results import Cell, Description, Measure, Result, Table

#: Sums of half axes of Bernstein ellipses, of which the best bounds the error of a series.
ELLIPSES = np.array([1.1, 1.4, 2.0, 4.0, 8.0, 16.0, 32.0, 128.0, 1024.0])
#: Error of a series, as a share of the scale.
INTERPOLATED = 1e-15
#: Longest series; segments of some thousand radians would need longer ones.
MOST_TERMS = 4096


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
        terms = _length(f, start, step)
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

    def __call__(self, number: Integers, x: Array) -> Array:
        """Compute values at x (m,) on the segments of these numbers, (m,), by Clenshaw's rule."""
        c = self.series[number].T
        b1, b2 = np.zeros((2, len(x)))
        for k in range(len(c) - 1, 0, -1):
            b1, b2 = 2.0 * x * b1 - b2 + c[k], b1
        return np.asarray(x * b1 - b2 + c[0])


def curvature(f: Jets, start: Array, step: Array) -> Array:
    """Bound |g''| along segments from `start` by `step` (S, n), with respect to t from 0 to 1."""
    B, size = f.curvature(_reach(f, start, step) / f.chart.half), np.abs(step)
    return np.asarray(np.einsum("mi,ij,mj->m", size, B, size))


def _reach(f: Jets, start: Array, step: Array) -> Array:
    """Return the largest distance (n,) of segments from the middle of each joint's range."""
    return np.asarray(np.abs(np.stack((start, start + step)) - f.chart.centre).max(axis=(0, 1)))


def _length(f: Jets, start: Array, step: Array) -> float:
    """Return how many Chebyshev coefficients give a polynomial along segments to rounding.

    On the Bernstein ellipse rho, |g| <= M, and the error of N coefficients is at most
    4 M rho^(1 - N) / (rho - 1): Trefethen, Approximation Theory and Approximation Practice (2013),
    theorem 8.2.
    """
    if not f.scale:
        return 1.0
    reach, half_step = _reach(f, start, step), np.abs(step).max(axis=0) / 2.0
    bounds = np.log([f.bound(reach, half_step, rho) for rho in ELLIPSES])
    wanted = np.log(INTERPOLATED * f.scale * (ELLIPSES - 1.0) / 4.0)
    N = 2.0 + np.maximum(bounds - wanted, 0.0) / np.log(ELLIPSES)
    return float(N.min())


#: Intervals that a segment is first divided into.
PIECES = 8
#: Width below which an interval is not halved [rad].
NARROW = 1e-12
#: Largest number of intervals at a time: of a segment that goes along the set for long.
MOST = 50_000

#: Segments that are followed at a time. Time and memory for a segment do not grow with the path.
BLOCK = 1024

#: Steps to the best place where several polynomials are rounding; the longest, as a share of the
#: segment.
REFINEMENTS, CLOSE = 20, 1e-6

#: Parts of a path in which progress is reported.
WHOLE = 1000

Verdict = Literal["free", "singular", "near", "undecided"]
#: What the verdicts mean.
WORDS: dict[Verdict, str] = {
    "free": "meets no singularity: proven",
    "singular": "meets a singularity",
    "near": "a singular posture is nearer than the clearance asked for",
    "undecided": "comes too near to a singularity for a proof",
}


class Certificate(Result):
    """Proof that a path of straight segments in joint space is free of singularities, or a root.

    Attributes:
        free: Whether no singular configuration lies on it: proven, rounding included.
        at: (n,) the first configuration on it that is not free, or the singular one beside it of
            "near"; None if the path is free.
        segment: Number of the segment that holds it; None if the path is free.
        margin: Least |S| met on the path, over the scale of S; with several minors the largest of
            these.
        verdict: "free"; "singular": S changes sign at `at`, proven; "near": the path is free, but
            `at` beside it is singular and nearer than the clearance asked for; "undecided": at
            `at` S, or every minor, is less than its rounding error. On paths of some 10,000 rad it
            is also "undecided" if more than 50,000 pieces were still open.
        noise: Bound of the rounding of S that the proof counts with, over the scale of S.
        clearance: No singular configuration is nearer to the path than this [rad], proven; 0 where
            no clearance was asked for. Where less is proven than was asked for, `free` is False
            and `verdict` "near"; or it is "undecided", and `at` a configuration within the
            clearance asked for about which nothing is proven.
    """

    free: bool
    at: Array | None
    segment: int | None
    margin: float
    verdict: Verdict
    noise: float
    clearance: float = 0.0

    def __bool__(self) -> bool:
        return self.free

    not_checked = "collisions, rates, the way of the tip"

    def describe(self) -> Description:
        """Describe what is proven, and where the proof ends if it does."""
        facts: dict[str, Cell] = {}
        if self.clearance:
            facts["no singular configuration nearer than"] = Measure(self.clearance, "rad")
        if self.at is not None:
            facts["number of the segment"], facts["at [rad] or [m]"] = self.segment, self.at
        facts["least |S|, over the scale of S"] = Measure(self.margin, "", ".3g")
        facts["rounding that the proof counts with"] = Measure(self.noise, "", ".3g")
        return Description(
            title="path in joint space",
            verdict=WORDS[self.verdict],
            tone="good" if self.free else "bad",
            tables=[Table.facts(facts)],
        )


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
    count = max(len(path) - 1, 1)
    margin, noise = np.inf, 0.0
    for begin in range(0, count, BLOCK):
        part = path[begin : begin + BLOCK + 1]
        told = of_block(progress, begin, len(part) - 1, count)
        proof = _Path(list(polynomials), part, singular).certificate(told)
        if proof.segment is not None:
            return replace(proof, segment=begin + proof.segment)
        margin = min(margin, proof.margin)
        noise = max(noise, proof.noise)
    return Certificate(True, None, None, margin, "free", noise)


def of_block(
    progress: Callable[[int, int], object] | None, begin: int, size: int, count: int
) -> Callable[[int, int], object] | None:
    """Return the callback of progress for a block of the segments of a path.

    Args:
        progress: That of the whole path.
        begin: Number of the first segment of the block.
        size: Number of its segments.
        count: Number of segments of the path.
    """
    if progress is None:
        return None
    return lambda done, total: progress((begin * total + size * done) // count, total)


class _Intervals(NamedTuple):
    """Parts of a path: (m,) positions of their ends, (p, m) values of the polynomials there."""

    low: Array
    high: Array
    left: Array
    right: Array

    def where(self, chosen: Any) -> _Intervals:
        """Return some of them."""
        return _Intervals(*(numbers[..., chosen] for numbers in self))

    def halved(self, middle: Array, values: Array) -> _Intervals:
        """Return the halves, in the order of the path."""
        lower = self._replace(high=middle, right=values)
        upper = self._replace(low=middle, left=values)
        both = (np.concatenate(pair, axis=-1) for pair in zip(lower, upper, strict=True))
        halves = _Intervals(*both)
        return halves.where(np.argsort(halves.low, kind="stable"))


class _Path:
    """A path and the polynomials along it; position s = i + t is at t on segment i."""

    def __init__(
        self, polynomials: list[Jets], path: Array, singular: Callable[[Array], bool] | None
    ) -> None:
        self.path = path if len(path) > 1 else path.repeat(2, axis=0)
        self.step = np.diff(self.path, axis=0)
        self.longest = np.abs(self.step).max(axis=1)
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
        m, ends = len(self.step), np.arange(len(self.step) + 1.0)
        values = self.values(ends)
        segments = _Intervals(ends[:-1], ends[1:], values[:, :-1], values[:, 1:])
        open_ = self.open_of(segments.where(~self.is_free(segments)))
        blocked = self.blocked(values, ends)
        while True:
            open_ = open_.where(~self.is_free(open_) & (open_.low <= blocked))
            if progress:
                progress(int(WHOLE * (1.0 - float((open_.high - open_.low).sum()) / m)), WHOLE)
            if not open_.low.size:
                break
            if len(self.polynomials) == 1:  # nothing after a proven root matters
                crossing = (self.signs(open_.left) * self.signs(open_.right))[0] < 0
                if crossing.any():
                    open_ = open_.where(slice(int(np.argmax(crossing)) + 1))
                    if crossing[0] and self.is_monotone(open_.low[0], open_.high[0]):
                        return self.result("singular", self.root(open_.low[0], open_.high[0]))
            low, high = open_.low, open_.high
            middle = 0.5 * (low + high)
            narrow = (high - low) * self.longest[self.segment(low)] <= NARROW
            narrow |= (middle == low) | (middle == high)  # no number lies between
            if narrow[0] or len(low) > MOST:
                return self.result(self.verdict(low[0], high[0]), middle[0])
            values = self.values(middle)
            blocked = min(blocked, self.blocked(values, middle))
            open_ = open_.halved(middle, values)
        if np.isfinite(blocked):
            return self.result(self.verdict(blocked, blocked), blocked)
        return self.result("free")

    def open_of(self, segments: _Intervals) -> _Intervals:
        """Divide segments into intervals, on which the polynomials are evaluated by series."""
        if not segments.low.size:
            return segments
        self.restrict(segments.low.astype(np.intp))
        s = segments.low[:, None] + np.linspace(0.0, 1.0, PIECES + 1)
        low, high = s[:, :-1].ravel(), s[:, 1:].ravel()
        left = self.values(low)
        within = left.reshape(len(left), -1, PIECES)[:, :, 1:]
        right = np.concatenate((within, segments.right[:, :, None]), axis=2)
        return _Intervals(low, high, left, right.reshape(len(left), -1))

    def segment(self, s: Any) -> Integers:
        """Return the numbers of the segments that hold positions (m,)."""
        return np.minimum(np.asarray(s).astype(np.intp), len(self.step) - 1)

    def point(self, s: Any) -> Array:
        """Return the configurations (m, n) at positions (m,), or the one (n,) at a position."""
        i = self.segment(s)
        return np.asarray(self.path[i] + np.asarray(s - i)[..., None] * self.step[i])

    def restrict(self, segments: Integers) -> None:
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
            values = stacked(self.polynomials, Q).value.T
        largest = (np.abs(values) / self.scale[:, None]).max(axis=0)
        self.margin = min(self.margin, float(largest.min()))
        return values

    def signs(self, values: Array) -> Array:
        """Return signs (p, m) of values; 0 where they may be rounding."""
        return np.where(np.abs(values) > self.noise[:, None], np.sign(values), 0.0)

    def is_free(self, parts: _Intervals) -> Any:
        """Check which intervals (m,) hold no common root, from the values at their ends."""
        low, high, left, right = parts
        sag = self.curvature[:, low.astype(np.intp)] * ((high - low) ** 2 / 8.0)
        least = np.minimum(np.abs(left), np.abs(right)) - sag * (1.0 + 1e-12)
        return ((left * right > 0.0) & (least > self.noise[:, None])).any(axis=0)

    def blocked(self, values: Array, s: Array) -> float:
        """Return the first of the positions at which all values are rounding, or infinity."""
        nothing = (self.signs(values) == 0.0).all(axis=0)
        return float(s[nothing].min(initial=np.inf))

    def along(self, i: int, t: float, order: int = 0) -> tuple[Array, Array]:
        """Compute values (p,) and, of order 1, slopes (p,) at a place on segment i."""
        jets = [S((self.path[i] + t * self.step[i])[None], order) for S in self.polynomials]
        slopes = [jet.gradient[0] @ self.step[i] for jet in jets] if order else []
        return np.array([jet.value[0] for jet in jets]), np.array(slopes)

    def is_monotone(self, low: float, high: float) -> bool:
        """Check whether the one polynomial is proven to be monotone on an interval."""
        i = int(low)
        slope = abs(float(self.along(i, 0.5 * (low + high) - i, 1)[1][0]))
        return bool(slope > self.curvature[0, i] * (high - low) + self.noise[0])

    def root(self, low: float, high: float) -> float:
        """Find the one root between positions where the one polynomial has different signs."""
        i = int(low)
        ends = low - i, high - i
        return i + float(
            scipy.optimize.brentq(lambda t: self.along(i, t)[0][0], *ends, xtol=1e-15, rtol=1e-15)
        )

    def best(self, s: float) -> float:
        """Return the position near s at which the polynomials are least, by Gauss-Newton steps."""
        i = int(self.segment(s))
        t, (g, slope) = s - i, self.along(i, s - i, 1) / self.scale
        for _ in range(REFINEMENTS):
            change = float(g @ slope) / max(float(slope @ slope), 1e-300)
            better = float(np.clip(t - np.clip(change, -CLOSE, CLOSE), 0.0, 1.0))
            new, new_slope = self.along(i, better, 1) / self.scale
            if new @ new >= g @ g:
                break
            t, g, slope = better, new, new_slope
        return i + t

    def verdict(self, low: float, high: float) -> Verdict:
        """Say whether a root is proven about an interval that is not free."""
        if len(self.polynomials) > 1:
            at = self.point(self.best(0.5 * (low + high)))
            return "singular" if self.singular is not None and self.singular(at) else "undecided"
        i = int(self.segment(low))
        for away in np.geomspace(1e-12, 1e-4, 9) / max(float(self.longest[i]), 1e-4):
            ends = np.clip((low - away, high + away), i, i + 1.0)
            signs = self.signs(np.array([self.polynomials[0](self.point(ends)).value]))[0]
            if signs[0] * signs[1] < 0:
                return "singular"
        return "undecided"

    def result(self, verdict: Verdict, s: float | None = None) -> Certificate:
        """Return the certificate of a path that is free, or not free from position s on."""
        noise = float((self.noise / self.scale).max())
        if s is None:
            return Certificate(True, None, None, float(self.margin), verdict, noise)
        return Certificate(False, self.point(s), int(self.segment(s)), 0.0, verdict, noise)
