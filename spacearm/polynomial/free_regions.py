"""Proof that polynomials have no common root in a region: a box, a ball, or a ball along a curve.

Let m_i be the polynomials and u(x) <= 0 in the region, for a ball u = |x|^2 - r^2. Where all m_i
vanish in it

    F(x) = sum_i a_i m_i(x) + b u(x) <= 0,   b >= 0.

So a box holds no common root in the region if F > 0 on it, for some a and b of its own. With its
centre c and half widths h

    F(x) >= F(c) - |grad F(c)| h - rest,

the rest from the second and third derivatives at c and a bound of the fourth ones everywhere. Given
F(c) = 1, the a and b that make |grad F(c)| h least, or this and the rest, solve a small linear
system. At the common root nearest to the centre of a ball some sum of the gradients is along x,
which b takes away: boxes there are wide beside the gap between ball and root, and few do. What is
not proven is halved, nearest to the middle first, so that what is proven when a budget ends is a
region of the same kind. Without u a box is proven as such.

The smallest polynomials are tried first, all of them where these do not do.

Rounding is counted as in `certificate`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array, Booleans, Integers
from spacearm.polynomial.jets import Jets, stacked
from spacearm.polynomial.tubes import EPS, ROUNDING, Tubes

#: Boxes that are tried at a time at most and at least, and in how many times a budget is spent: the
#: fewer at a time, the more of those that are nearest.
BATCH, LEAST, SPLIT = 512, 16, 50
#: Half width of boxes that are not halved: a common root is as good as found.
NARROW = 1e-7
#: Share of all coefficients that the polynomials tried first have at most, and how often a box is
#: halved with these alone before all are tried.
SMALL, PATIENCE = 0.31, 2
#: Share of the squared slopes that is added to the small systems, which may be singular.
RIDGE = 1e-14


class Expansion(NamedTuple):
    """Functions expanded at the centres of m boxes, in shares of the half widths.

    Attributes:
        value: (m, p) values.
        slope: (m, p, n) first derivatives.
        bend: (m, p, n, n) second derivatives.
        third: (m, p, n, n, n) third derivatives.
        fourth: (m, p, n) bounds of what the fourth derivatives add, by the joint.
        noise: (m, p) bounds of the rounding.
    """

    value: Array
    slope: Array
    bend: Array
    third: Array
    fourth: Array
    noise: Array

    @property
    def rest(self) -> Array:
        """(m, p) bounds of what all but the first derivatives add."""
        third = np.abs(self.third).sum(axis=(2, 3, 4)) / 6.0
        return 0.5 * np.abs(self.bend).sum(axis=(2, 3)) + third + self.fourth.sum(axis=2)

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
        third = (a[:, None] @ self.third.reshape(m, -1, n**3)).reshape(m, n, -1)
        diagonal = np.einsum("mjj->mj", bend)
        across = np.abs(bend).sum(axis=2) - np.abs(diagonal)
        taken = slope + 0.5 * (across - np.minimum(diagonal, 0.0))
        taken += np.abs(third).sum(axis=2) / 6.0 + (size[:, None] @ self.fourth)[:, 0]
        return (a * self.value - size * self.noise).sum(axis=1) - taken.sum(axis=1), taken


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
    def small(self) -> Roots:
        """The roots of the smallest polynomials alone, which cost little; all if one is as good."""
        by_size = sorted(self.polynomials, key=lambda f: f.polynomial.coefficients.size)
        sizes = np.cumsum([f.polynomial.coefficients.size for f in by_size])
        few = int((sizes <= SMALL * sizes[-1]).sum())
        return replace(self, polynomials=by_size[:few]) if few > 1 else self

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return sum(f.polynomial.coefficients.size for f in self.polynomials)

    @cached_property
    def relevant(self) -> Booleans:
        """(n,) which positions the polynomials depend on."""
        return np.any([f.polynomial.degrees for f in self.polynomials], axis=0)

    @property
    def alone(self) -> bool:
        """Whether there is one polynomial, which changes its sign at its roots."""
        return len(self.polynomials) == 1

    def values(self, X: Array) -> Array:
        """Return the first polynomial (m,) at x (m, n)."""
        return self.polynomials[0](self.origin + self.unit * X).value

    @cached_property
    def _noise(self) -> Array:
        far = np.abs(self.origin) + self.unit * np.maximum(np.abs(self.low), np.abs(self.high))
        return np.array([f.noise(float(far.max())) for f in self.polynomials])

    @cached_property
    def _turns(self) -> Array:
        """(p, n) bounds of the first derivatives of what has size 1."""
        return self.unit * [f.polynomial.degrees for f in self.polynomials]

    @cached_property
    def _fourth(self) -> Array:
        """(p, n, n n n) bounds of the fourth derivatives with respect to x."""
        ends = self.origin + self.unit * np.array((self.low, self.high))
        unit = np.einsum("i,j,k,l->ijkl", self.unit, self.unit, self.unit, self.unit)
        bounds = np.array([f.derivative_bounds(4, ends) * unit for f in self.polynomials])
        return bounds.reshape(*bounds.shape[:2], -1)

    def expanded(self, centre: Array, half: Array) -> Expansion:
        """Expand the polynomials in boxes (m, n)."""
        jet = stacked(self.polynomials, self.origin + self.unit * centre, 3)
        width = self.unit * half
        pairs = width[:, :, None] * width[:, None]
        triples = np.einsum("mi,mj,mk->mijk", half, half, half).reshape(len(half), -1)
        fourth = np.moveaxis(self._fourth @ triples.T, -1, 0) * half[:, None] / 24.0
        turn = half @ self._turns.T
        return Expansion(
            jet.value,
            jet.gradient * width[:, None],
            jet.hessian * pairs[:, None],
            jet.third * (pairs[:, :, :, None] * width[:, None, None])[:, None],
            fourth,
            self._noise * (1.0 + turn + turn**2 / 2.0 + turn**3 / 6.0),
        )

    def tried(
        self, centre: Array, half: Array, age: Integers, inside: Expansion | None = None
    ) -> tuple[Booleans, Array, int]:
        """Tell which boxes are free, of young ones by the smallest polynomials alone.

        Args:
            centre: As of `free`.
            half: As of `free`.
            age: (m,) how often boxes were halved since all polynomials were tried; written to.
            inside: As of `free`.

        Returns:
            (m,) whether it is proven, (m, n) as of `free`, and the number of boxes that were tried,
            in shares of all coefficients.
        """
        small = self.small
        free, taken = small.free(centre, half, inside)
        age += 1
        if small is self:
            return free, taken, len(age)
        again = np.flatnonzero(~free & (age > PATIENCE))
        if len(again):
            part = None if inside is None else Expansion(*(numbers[again] for numbers in inside))
            free[again], taken[again] = self.free(centre[again], half[again], part)
            age[again] = 0
        return free, taken, math.ceil(small.size / self.size * len(age)) + len(again)

    def free(
        self, centre: Array, half: Array, inside: Expansion | None = None
    ) -> tuple[Booleans, Array]:
        """Tell which boxes hold no common root, rounding included.

        Args:
            centre: (m, n) centres, in x.
            half: (m, n) half widths.
            inside: u in the boxes, which is not positive where a box counts; all of it if None.

        Returns:
            (m,) whether it is proven, and (m, n) what the width of each joint takes, in all as much
            as in the best trial, as a share of the value.
        """
        own, p = self.expanded(centre, half), len(self.polynomials)
        trials = [(own, own.normalised(np.eye(p)[[i]])) for i in range(p)]
        if p > 1:
            trials += [(own, own.factors(rest)) for rest in (0.0 * own.rest, own.rest)]
        if inside is not None:
            both = own.with_(inside)
            for rest in (0.0 * both.rest, np.pad(own.rest, ((0, 0), (0, 1)))):
                a = both.factors(rest)
                a[:, p] = np.maximum(a[:, p], 0.0)
                trials.append((both, a))
        proven, taken = np.zeros(len(centre), dtype=bool), np.zeros_like(half)
        least = np.full(len(centre), np.inf)
        for functions, a in trials:
            bound, by_joint = functions.least(a)
            proven |= bound > 0.0
            total = by_joint.sum(axis=1)
            least = np.minimum(least, total)
            taken += by_joint / np.maximum(total, 1.0)[:, None]
        return proven, taken * (least / np.maximum(taken.sum(axis=1), EPS))[:, None]


class Proof(NamedTuple):
    """What is proven of tubes.

    Attributes:
        radius: No common root is nearer to the curve than this, proven.
        open: (k, n) centres of the boxes that are not proven, nearest to the curve first, in x.
        tried: How many boxes were tried, in shares of all coefficients.
    """

    radius: float
    open: Array
    tried: int


def prove(
    roots: Roots, tubes: Tubes, most: int, progress: Callable[[int], object] | None = None
) -> Proof:
    """Prove that tubes hold no common root, as far as a budget of boxes goes.

    Args:
        roots: The polynomials; only what lies between `low` and `high` counts.
        tubes: The tubes.
        most: Largest number of boxes that are tried, in shares of all coefficients.
        progress: Called now and then with the number tried since.
    """
    whole, tubes = tubes, tubes.within(roots.relevant)  # as the roots see them
    low, high = tubes.boxes()
    low = np.where(roots.relevant, np.maximum(roots.low, low), 0.0)
    high = np.where(roots.relevant, np.minimum(roots.high, high), 0.0)
    of = np.flatnonzero((low <= high).all(axis=1))
    centre, half = 0.5 * (low + high)[of], 0.5 * (high - low)[of] * (1.0 + ROUNDING)
    away = tubes.distances(centre, half, of) - tubes.slack[of]
    age, tried = np.zeros(len(of), dtype=int), 0
    batch = min(BATCH, max(most // SPLIT, LEAST))
    while len(centre):
        order = np.argsort(away, kind="stable")
        now, later = order[:batch], order[batch:]
        if tried >= most or half[now[0]].max() < NARROW:
            open_ = np.where(roots.relevant, centre[order], whole.start[of[order]])
            return Proof(min(max(float(away[now[0]]), 0.0), tubes.radius), open_, tried)
        inside = _inside(tubes, centre[now], half[now], of[now])
        older = age[now]
        free, taken, work = roots.tried(centre[now], half[now], older, inside)
        tried += work
        if progress:
            progress(work)
        left = now[~free]
        c, h = halved(centre[left], half[left], taken[~free])
        which = np.tile(of[left], 2)
        d = tubes.distances(c, h, which) - tubes.slack[which]
        near = d < tubes.radius
        centre = np.concatenate((centre[later], c[near]))
        half = np.concatenate((half[later], h[near]))
        away, of = np.append(away[later], d[near]), np.append(of[later], which[near])
        age = np.append(age[later], np.tile(older[~free], 2)[near])
    return Proof(tubes.radius, centre, tried)


def _inside(tubes: Tubes, centre: Array, half: Array, of: Integers) -> Expansion:
    """Expand u in boxes (m, n)."""
    value, slope, bend, noise = tubes.form(centre, half, of)
    return Expansion(
        value[:, None],
        (slope * half)[:, None],
        (bend * half[:, :, None] * half[:, None])[:, None],
        np.zeros((len(centre), 1, *(centre.shape[1],) * 3)),
        np.zeros((len(centre), 1, centre.shape[1])),
        noise[:, None],
    )


def halved(centre: Array, half: Array, taken: Array) -> tuple[Array, Array]:
    """Return the halves of boxes (m, n), each divided along the joint that takes most."""
    widest = np.arange(half.shape[1]) == taken.argmax(axis=1)[:, None]
    h, step = np.where(widest, half / 2.0, half), np.where(widest, half / 2.0, 0.0)
    return np.concatenate((centre - step, centre + step)), np.concatenate((h, h))
