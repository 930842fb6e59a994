"""Proof that polynomials have no common root in a region: a box, a ball, or a ball along a segment.

Let m_i be the polynomials and u(x) <= 0 in the region, for a ball u = |x|^2 - r^2. Where all m_i
vanish in it

    F(x) = sum_i a_i m_i(x) + b u(x) <= 0,   b >= 0.

So a box holds no common root in the region if F > 0 on it, for some a and b of its own. With its
centre c and half widths h

    F(x) >= F(c) - |grad F(c)| h - rest,

the rest from the second derivatives at c and a bound of the third ones everywhere. Given F(c) = 1,
the a and b that make |grad F(c)| h least, or this and the rest, solve a small linear system. At the
common root nearest to the centre of a ball some sum of the gradients is along x, which b takes
away: boxes there are wide beside the gap between ball and root, and few do. What is not proven is
halved, nearest to the middle first, so that what is proven when a budget ends is a region of the
same kind. Without u a box is proven as such.

Rounding is counted as in `certificate`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.polynomial.jets import Jets

BATCH = 512
"""Boxes that are tried at a time."""
NARROW = 1e-7
"""Half width of boxes that are not halved: a common root is as good as found."""
RIDGE = 1e-14
"""Share of the squared slopes that is added to the small systems, which may be singular."""
EPS = float(np.finfo(np.float64).eps)
ROUNDING = 1e-9
"""Share of a distance that bounds its rounding, and to which the nearest place is found."""

Booleans = npt.NDArray[np.bool_]


class Expansion(NamedTuple):
    """Functions expanded at the centres of m boxes, in shares of the half widths.

    Attributes:
        value: (m, p) values.
        slope: (m, p, n) first derivatives.
        bend: (m, p, n, n) second derivatives.
        third: (m, p, n) bounds of what the third derivatives add, by the joint.
        noise: (m, p) bounds of the rounding.
    """

    value: Array
    slope: Array
    bend: Array
    third: Array
    noise: Array

    @property
    def rest(self) -> Array:
        """(m, p) bounds of what all but the first derivatives add."""
        return 0.5 * np.abs(self.bend).sum(axis=(2, 3)) + self.third.sum(axis=2)

    def with_(self, other: Expansion) -> Expansion:
        """Return these functions and others in the same boxes."""
        return Expansion(*(np.concatenate(pair, axis=1) for pair in zip(self, other, strict=True)))

    def factors(self, rest: Array) -> Array:
        """Return (m, p) factors with value 1 that make the squares of slope and rest least."""
        M = self.slope @ self.slope.swapaxes(1, 2)
        size = np.einsum("mii->m", M)[:, None] + np.finfo(np.float64).tiny
        M = M + (rest**2 + RIDGE * size)[:, :, None] * np.eye(M.shape[1])
        a = np.linalg.solve(M, self.value[:, :, None])[:, :, 0]
        return self.normalised(a)

    def normalised(self, a: Array) -> Array:
        """Return factors (m, p) with which the value is 1; zeros where it is zero."""
        total = (a * self.value).sum(axis=1)
        return a / np.where(total == 0.0, np.inf, total)[:, None]

    def least(self, a: Array) -> tuple[Array, Array]:
        """Bound the sums with factors (m, p) from below, (m,), and say what each joint takes."""
        m, n = len(a), self.slope.shape[2]
        size = np.abs(a)
        slope = np.abs((a[:, None] @ self.slope)[:, 0])
        bend = (a[:, None] @ self.bend.reshape(m, -1, n * n)).reshape(m, n, n)
        diagonal = np.einsum("mjj->mj", bend)
        across = np.abs(bend).sum(axis=2) - np.abs(diagonal)
        taken = (
            slope + 0.5 * (across - np.minimum(diagonal, 0.0)) + (size[:, None] @ self.third)[:, 0]
        )
        return (a * self.value - size * self.noise).sum(axis=1) - taken.sum(axis=1), taken


@dataclass(frozen=True, eq=False)
class Tube:
    """All points no farther than a radius from the straight segment between 0 and `step`.

    Attributes:
        step: (n,) the end of the segment; zeros for a ball.
        radius: The radius.
    """

    step: Array
    radius: float

    def distances(self, centre: Array, half: Array) -> Array:
        """Return how far boxes (m, n) are from the segment, rounded down."""
        long = float(np.linalg.norm(self.step))

        def at(t: Array) -> Array:
            beyond = np.maximum(np.abs(centre - t[:, None] * self.step) - half, 0.0)
            return np.asarray(np.linalg.norm(beyond, axis=1))

        low, high = np.zeros(len(centre)), np.full(len(centre), 1.0 if long else 0.0)
        while long and (high - low).max(initial=0.0) > ROUNDING:  # convex in t
            one, two = low + (high - low) / 3.0, high - (high - low) / 3.0
            falls = at(one) > at(two)
            low, high = np.where(falls, one, low), np.where(falls, high, two)
        return np.maximum(at(low) * (1.0 - ROUNDING) - long * (high - low), 0.0)

    def expanded(self, centre: Array, half: Array) -> Expansion:
        """Expand u in boxes (m, n): of the ball about an end beyond it, else of the cylinder."""
        (m, n), length = centre.shape, float(self.step @ self.step)
        along, wide = centre @ self.step, half @ np.abs(self.step)
        ended = (along - wide >= length) & (length > 0.0)
        ball = ended | (along + wide <= 0.0) | (length == 0.0)
        x = centre - ended[:, None] * self.step
        form = np.eye(n) - (~ball / (length or 1.0))[:, None, None] * np.outer(self.step, self.step)
        turned = (form @ x[:, :, None])[:, :, 0]
        value = (x * turned).sum(axis=1) - self.radius**2
        bend = 2.0 * form * half[:, :, None] * half[:, None, :]
        noise = 16.0 * n * EPS * ((x**2).sum(axis=1) + self.radius**2 + (wide + length))
        return Expansion(
            value[:, None],
            (2.0 * turned * half)[:, None],
            bend[:, None],
            np.zeros((m, 1, n)),
            noise[:, None],
        )


@dataclass(frozen=True, eq=False)
class Roots:
    """Polynomials whose common roots count, as functions of x = (q - origin) / unit.

    Attributes:
        polynomials: The polynomials, of scale 1.
        origin: (n,) where x is zero.
        unit: (n,) what a unit of x is.
        low: (n,) least x of the boxes.
        high: (n,) largest x.
    """

    polynomials: Sequence[Jets]
    origin: Array
    unit: Array
    low: Array
    high: Array

    @cached_property
    def relevant(self) -> Booleans:
        """(n,) which positions the polynomials depend on."""
        return np.any([f.polynomial.degrees for f in self.polynomials], axis=0)

    @cached_property
    def _noise(self) -> Array:
        far = np.abs(self.origin) + self.unit * np.maximum(np.abs(self.low), np.abs(self.high))
        return np.array([f.noise(float(far.max())) for f in self.polynomials])

    @cached_property
    def _turns(self) -> Array:
        """(p, n) bounds of the first derivatives of what has size 1."""
        return self.unit * [f.polynomial.degrees for f in self.polynomials]

    @cached_property
    def _third(self) -> Array:
        """(p, n, n n) bounds of the third derivatives with respect to x."""
        ends = self.origin + self.unit * np.array((self.low, self.high))
        unit = np.einsum("i,j,k->ijk", self.unit, self.unit, self.unit)
        bounds = np.array([f.derivative_bounds(3, ends) * unit for f in self.polynomials])
        return bounds.reshape(*bounds.shape[:2], -1)

    def expanded(self, centre: Array, half: Array) -> Expansion:
        """Expand the polynomials in boxes (m, n)."""
        jets = [f(self.origin + self.unit * centre, 2) for f in self.polynomials]
        value, slope, bend = (np.stack(part, axis=1) for part in zip(*jets, strict=True))
        width = self.unit * half
        pairs = (half[:, :, None] * half[:, None]).reshape(len(half), -1)
        third = np.moveaxis(self._third @ pairs.T, -1, 0) * half[:, None] / 6.0
        turn = half @ self._turns.T
        return Expansion(
            value,
            slope * width[:, None],
            bend * (width[:, :, None] * width[:, None])[:, None],
            third,
            self._noise * (1.0 + turn + 0.5 * turn**2),
        )

    def free(self, centre: Array, half: Array, tube: Tube | None = None) -> tuple[Booleans, Array]:
        """Tell which boxes hold no common root, rounding included.

        Args:
            centre: (m, n) centres, in x.
            half: (m, n) half widths.
            tube: What of each box counts; all of it if None.

        Returns:
            (m,) whether it is proven, and (m, n) what the width of each joint takes.
        """
        own, p = self.expanded(centre, half), len(self.polynomials)
        trials = [(own, own.normalised(np.eye(p)[[i]])) for i in range(p)]
        if p > 1:
            trials += [(own, own.factors(rest)) for rest in (0.0 * own.rest, own.rest)]
        if tube is not None:
            both = own.with_(tube.expanded(centre, half))
            for rest in (0.0 * both.rest, np.pad(own.rest, ((0, 0), (0, 1)))):
                a = both.factors(rest)
                a[:, p] = np.maximum(a[:, p], 0.0)
                trials.append((both, a))
        proven, taken = np.zeros(len(centre), dtype=bool), np.zeros_like(half)
        for functions, a in trials:
            bound, by_joint = functions.least(a)
            proven |= bound > 0.0
            taken += by_joint / np.maximum(by_joint.sum(axis=1), 1.0)[:, None]
        return proven, taken


class Proof(NamedTuple):
    """What is proven of a tube.

    Attributes:
        radius: The tube of this radius holds no common root, proven.
        open: (k, n) centres of the boxes that are not proven, nearest to the segment first, in x.
        tried: How many boxes were tried.
    """

    radius: float
    open: Array
    tried: int


def prove(
    roots: Roots, tube: Tube, most: int, progress: Callable[[int], object] | None = None
) -> Proof:
    """Prove that a tube holds no common root, as far as a budget of boxes goes.

    Args:
        roots: The polynomials; only what lies between `low` and `high` counts.
        tube: The tube.
        most: Largest number of boxes that are tried.
        progress: Called now and then with the number tried since.
    """
    tube = replace(tube, step=np.where(roots.relevant, tube.step, 0.0))  # as the roots see it
    ends = np.array((np.minimum(0.0, tube.step), np.maximum(0.0, tube.step)))
    low = np.where(roots.relevant, np.maximum(roots.low, ends[0] - tube.radius), 0.0)
    high = np.where(roots.relevant, np.minimum(roots.high, ends[1] + tube.radius), 0.0)
    if (low > high).any():
        return Proof(tube.radius, np.empty((0, len(low))), 0)
    centre, half = 0.5 * (low + high)[None], 0.5 * (high - low)[None] * (1.0 + ROUNDING)
    away = tube.distances(centre, half)
    tried = 0
    while len(centre):
        order = np.argsort(away, kind="stable")
        now, later = order[:BATCH], order[BATCH:]
        if tried >= most or half[now[0]].max() < NARROW:
            return Proof(min(float(away[now[0]]), tube.radius), centre[order], tried)
        tried += len(now)
        if progress:
            progress(len(now))
        free, taken = roots.free(centre[now], half[now], tube)
        c, h = halved(centre[now][~free], half[now][~free], taken[~free])
        near = (d := tube.distances(c, h)) < tube.radius
        centre, half = (
            np.concatenate((centre[later], c[near])),
            np.concatenate((half[later], h[near])),
        )
        away = np.concatenate((away[later], d[near]))
    return Proof(tube.radius, centre, tried)


def halved(centre: Array, half: Array, taken: Array) -> tuple[Array, Array]:
    """Return the halves of boxes (m, n), each divided along the joint that takes most."""
    widest = np.arange(half.shape[1]) == taken.argmax(axis=1)[:, None]
    h, step = np.where(widest, half / 2.0, half), np.where(widest, half / 2.0, 0.0)
    return np.concatenate((centre - step, centre + step)), np.concatenate((h, h))
