"""Certificate that a trigonometric polynomial keeps its sign along a straight segment.

Along q0 + t (q1 - q0) the function g(t) has |g''| <= B, the bound of the curvature in that
direction, everywhere. An interval of half width h about t is free of roots if
|g(t)| > |g'(t)| h + B h^2 / 2; other intervals are halved until they are, or until the sign changes
between two points (a root lies between, found by bisection), or until |g| is rounding.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from spacearm.arrays import Array, named
from spacearm.polynomial.trig import NOISE, TrigPolynomial

PIECES = 32
"""Intervals that a segment is first divided into."""
NARROW = 1e-3
"""Width down to which intervals with a sign change are halved to find the first root."""


class Certificate(NamedTuple):
    """Proof that a path of straight segments in joint space is free of singularities, or a root.

    Attributes:
        free: Whether no singular configuration lies on it: proven, up to rounding.
        at: (n,) the first singular configuration on it; None if it is free.
        segment: Number of the segment that holds it; None if the path is free.
        margin: Least |S| met on the path, over the scale of S.
    """

    free: bool
    at: Array | None
    segment: int | None
    margin: float

    def __bool__(self) -> bool:
        return self.free

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data."""
        return named(self)


def certify(S: TrigPolynomial, path: Array) -> Certificate:
    """Follow the segments between the rows of `path` (m, n) until one meets a root of S."""
    values, step = np.asarray(S(path)), np.abs(np.diff(path, axis=0))
    least = np.minimum(values[:-1] * np.sign(values[1:]), values[1:] * np.sign(values[:-1]))
    safe = least - np.einsum("mi,ij,mj->m", step, S.curvature, step) / 8.0  # off the chord
    margin = float(np.append(safe[safe > NOISE * S.scale], np.inf).min()) / S.scale
    for number, (start, end) in enumerate(pairwise(path)):
        if safe[number] > NOISE * S.scale:
            continue
        root, least = _first_root(S, start, end)
        margin = min(margin, least)
        if root is not None:
            return Certificate(False, start + root * (end - start), number, 0.0)
    if len(path) == 1:
        root, margin = _first_root(S, path[0], path[0])
        if root is not None:
            return Certificate(False, path[0], 0, 0.0)
    return Certificate(True, None, None, float(margin))


def _first_root(S: TrigPolynomial, start: Array, end: Array) -> tuple[float | None, float]:
    """Find the first t in [0, 1] at which S vanishes, or None, and the least |S| / scale met."""
    from scipy.optimize import brentq  # slow to import

    step = end - start
    B = float(np.abs(step) @ S.curvature @ np.abs(step))
    zero = NOISE * S.scale

    def g(t: float) -> float:
        return float(S(start + t * step))

    edges = np.linspace(0.0, 1.0, PIECES + 1) if step.any() else np.array([0.0, 0.0])
    at_edges = S(start + edges[:, None] * step)
    margin = float(np.abs(at_edges).min()) / S.scale
    waiting = [
        (edges[i], edges[i + 1], at_edges[i], at_edges[i + 1]) for i in range(len(edges) - 1)
    ][::-1]
    while waiting:
        low, high, left, right = waiting.pop()
        if abs(left) <= zero:
            return float(low), margin
        if left * right < 0.0 and high - low < NARROW:
            return float(brentq(g, low, high, xtol=1e-15, rtol=1e-15)), margin
        t, h = (low + high) / 2.0, (high - low) / 2.0
        point = start + t * step
        value, slope = float(S(point)), float(S.gradient(point) @ step)
        margin = min(margin, abs(value) / S.scale)
        if abs(value) <= zero:
            return float(t), margin
        if abs(value) <= abs(slope) * h + 0.5 * B * h * h + zero / 2.0:
            waiting += [(t, high, value, right), (low, t, left, value)]
    if abs(at_edges[-1]) <= zero:
        return 1.0, margin
    return None, margin
