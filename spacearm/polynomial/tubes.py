"""Tubes about a curve: straight chords, each with a radius that holds all that is near the curve.

Pieces of a curve are given by control points, in whose convex hull they lie: two of a straight
piece, d + 1 of a polynomial of degree d (Bernstein). The distance from a chord is convex, so that
no point of the curve is farther from it than the farthest control point. One chord may do for many
pieces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from math import factorial
from typing import NamedTuple

import numpy as np
import scipy

from spacearm.arrays import Array, Booleans, Integers

#: Share of a distance that bounds its rounding.
ROUNDING = 1e-9
#: Steps towards the point of a chord that is nearest to a box.
BISECTIONS = 20
EPS = float(np.finfo(np.float64).eps)
#: Parts that a piece of a spline is divided into at most.
MOST_PARTS = 64


def straight(rows: Array) -> Array:
    """Return the control points (m - 1, 2, n) of straight pieces from row to row (m, n)."""
    return np.stack((rows[:-1], rows[1:]), axis=1) if len(rows) > 1 else rows[:, None]


def of_spline(spline: scipy.interpolate.PPoly, off: float) -> Array:
    """Return control points (m, d + 1, n) of a piecewise polynomial, close to their chords.

    Args:
        spline: The polynomials; knots in order.
        off: How far control points may be from the chords of their pieces, if 64 parts of each
            polynomial do for that.
    """
    points = _bernstein(spline)
    parts = np.ceil(np.sqrt(deviations(points) / off)).clip(1, MOST_PARTS).astype(int)
    if parts.max() == 1:
        return points
    t, which = spline.x, np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(which)) - np.repeat(np.cumsum(parts) - parts, parts)
    knots = np.append(t[which] + np.diff(t)[which] * number / parts[which], t[-1])
    slopes = [spline(knots[:-1], i) / factorial(i) for i in reversed(range(len(spline.c)))]
    return _bernstein(type(spline)(np.array(slopes), knots))


def _bernstein(spline: scipy.interpolate.PPoly) -> Array:
    """Return the Bernstein coefficients (m, d + 1, n) of a piecewise polynomial."""
    return np.moveaxis(scipy.interpolate.BPoly.from_power_basis(spline).c, 0, 1)


def to_chord(points: Array, start: Array, end: Array) -> Array:
    """Return how far points (..., n) are from the straight segments from start to end."""
    step = end - start
    length = np.maximum((step**2).sum(axis=-1), np.finfo(np.float64).tiny)
    t = np.clip(((points - start) * step).sum(axis=-1) / length, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - t[..., None] * step, axis=-1))


def deviations(points: Array) -> Array:
    """Return how far pieces (m, d, n) are from their own chords at most, (m,)."""
    return to_chord(points, points[:, :1], points[:, -1:]).max(axis=1)


def foot(points: Array, x: Array) -> tuple[Array, int]:
    """Return the point (n,) of the chords of pieces (m, d, n) nearest to x (n,), and its piece."""
    start, step = points[:, 0], points[:, -1] - points[:, 0]
    length = np.maximum((step**2).sum(axis=1), np.finfo(np.float64).tiny)
    t = np.clip(((x - start) * step).sum(axis=1) / length, 0.0, 1.0)
    feet = start + t[:, None] * step
    i = int(np.linalg.norm(feet - x, axis=1).argmin())
    return feet[i], i


class Form(NamedTuple):
    """A quadratic function expanded at m points.

    Attributes:
        value: (m,) values.
        slope: (m, n) gradients.
        bend: (m, n, n) second derivatives.
        noise: (m,) bounds of the rounding.
    """

    value: Array
    slope: Array
    bend: Array
    noise: Array


def about_box(centre: Array, half: Array, low: Array, high: Array, radius: float) -> Form:
    """Expand what is not positive within a radius of the box from low to high, at m centres.

    The square of the distance, of the coordinates in which all of a small box is beyond the other,
    less that of the radius.

    Args:
        centre: (m, n) centres of the small boxes.
        half: (m, n) their half widths.
        low: (n,) lower corner.
        high: (n,) upper corner.
        radius: The radius.
    """
    below, above = centre + half <= low, centre - half >= high
    beyond, n = (below | above) & (half > 0.0), centre.shape[1]
    edge = np.where(below, low, high)
    x = np.where(beyond, centre - edge, 0.0)
    square = (x**2).sum(axis=1)
    noise = 32.0 * n * EPS * (square + radius**2 + (centre**2 + edge**2).sum(axis=1))
    return Form(square - radius**2, 2.0 * x, 2.0 * beyond[:, :, None] * np.eye(n), noise)


@dataclass(frozen=True, eq=False)
class Tubes:
    """All points no farther than a radius from a curve.

    Attributes:
        start: (k, n) where chords begin.
        step: (k, n) from there to where they end; zeros for a ball.
        slack: (k,) how far the curve is from its chord at most.
        radius: The radius about the curve; that about a chord is larger by its slack.
    """

    start: Array
    step: Array
    slack: Array
    radius: float

    @classmethod
    def about(cls, points: Array, radius: float, slack: float = 0.0) -> Tubes:
        """Return tubes about a curve.

        Args:
            points: (m, d, n) control points of its pieces.
            radius: The radius.
            slack: How far from the curve a chord of several pieces may be.
        """
        ends, first = [0], 0
        pairs = np.concatenate((points[:-1], points[1:]), axis=1)
        joined = np.append(deviations(pairs) <= slack, False)
        while first < len(points):
            last, stride = first + 1, int(joined[first])
            while stride:  # as many pieces as one chord does for, by doubling and halving
                tried = min(last + stride, len(points))
                held = points[first:tried]
                if tried > last and to_chord(held, held[0, 0], held[-1, -1]).max() <= slack:
                    last, stride = tried, 2 * stride
                else:
                    stride //= 2
            ends.append(last)
            first = last
        start = points[ends[:-1], 0]
        step = points[[end - 1 for end in ends[1:]], -1] - start
        off = deviations(points)[ends[:-1]]
        for i, (a, b) in enumerate(pairwise(ends)):
            if b > a + 1:
                off[i] = to_chord(points[a:b], points[a, 0], points[b - 1, -1]).max()
        off = np.where(off > 0.0, off * (1.0 + ROUNDING) + 8.0 * EPS * np.abs(points).max(), 0.0)
        return cls(start, step, off, radius)

    def within(self, relevant: Booleans) -> Tubes:
        """Return the tubes in the coordinates that matter, zeros in the others."""
        return replace(
            self,
            start=np.where(relevant, self.start, 0.0),
            step=np.where(relevant, self.step, 0.0),
        )

    def boxes(self) -> tuple[Array, Array]:
        """Return the least and largest coordinates (k, n) of each tube."""
        end, wide = self.start + self.step, (self.radius + self.slack)[:, None]
        return np.minimum(self.start, end) - wide, np.maximum(self.start, end) + wide

    def distances(self, centre: Array, half: Array, of: Integers) -> Array:
        """Return how far boxes (m, n) are from the chords of tubes `of` (m,), rounded down."""
        step, off = self.step[of], centre - self.start[of]

        def at(t: Array) -> tuple[Array, Array]:
            away = off - t[:, None] * step
            beyond = np.sign(away) * np.maximum(np.abs(away) - half, 0.0)
            return (beyond**2).sum(axis=1), -2.0 * (beyond * step).sum(axis=1)

        low, high = np.zeros(len(centre)), np.ones(len(centre))
        for _ in range(BISECTIONS if step.any() else 0):
            middle = 0.5 * (low + high)
            rises = at(middle)[1] > 0.0
            low, high = np.where(rises, low, middle), np.where(rises, middle, high)
        (first, down), (last, up), span = at(low), at(high), high - low
        least = np.maximum(  # the square is convex: not below its tangents
            first + np.minimum(down, 0.0) * span, last - np.maximum(up, 0.0) * span
        )
        return np.sqrt(np.maximum(least, 0.0)) * (1.0 - ROUNDING)

    def form(self, centre: Array, half: Array, of: Integers) -> Form:
        """Expand u, which is not positive in a tube, at the centres of boxes (m, n).

        u is the square of the distance less that of the radius: from the nearer end where the box
        is beyond it, else from the straight line through both.
        """
        step, x, n = self.step[of], centre - self.start[of], centre.shape[1]
        length, radius = (step**2).sum(axis=1), self.radius + self.slack[of]
        along, wide = (x * step).sum(axis=1), (half * np.abs(step)).sum(axis=1)
        ended = (along - wide >= length) & (length > 0.0)
        line = ~ended & (along + wide > 0.0) & (length > 0.0)
        x = x - ended[:, None] * step
        share = line / np.where(length > 0.0, length, 1.0)
        form = np.eye(n) - share[:, None, None] * step[:, :, None] * step[:, None]
        turned = (form @ x[:, :, None])[:, :, 0]
        size = np.abs(self.start[of]).sum(axis=1) ** 2 + (centre**2).sum(axis=1)
        noise = 32.0 * n * EPS * ((x**2).sum(axis=1) + radius**2 + wide + length + size)
        return Form((x * turned).sum(axis=1) - radius**2, 2.0 * turned, 2.0 * form, noise)
