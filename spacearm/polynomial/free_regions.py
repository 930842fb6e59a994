"""Proof that polynomials have no common root in a region: a box, or near a point, a curve or a box.

Let m_i be the polynomials and u(x) <= 0 in the region, for a ball u = |x|^2 - r^2. Where all m_i
vanish in it

    F(x) = sum_i a_i m_i(x) + b u(x) <= 0,   b >= 0.

So a box holds no common root in the region if F > 0 on it, for some a and b of its own. With its
centre c and half widths h

    F(x) >= F(c) - |grad F(c)| h - rest,

the rest from the derivatives up to some degree at c and a bound of the next ones everywhere.
Where F bends upwards along a joint, that makes up for some of the slope.
Given F(c) = 1, the a that make the squares of all these terms least solve a small linear system,
and so do the a and b for which those of the slopes, or of these and the rest, are least. At the
common root nearest to the centre of a ball some sum of the gradients is along x, which b takes
away. Boxes there are wide beside the gap between ball and root, and few suffice. What is not proven
is halved, nearest to the middle first, so that what is proven when a budget ends is a region of the
same kind. Without u a box is proven as such.

In a region with u the smallest polynomials are tried first; in boxes as such, where no u takes the
slope away, one of them and the largest. All are tried where these do not do.

Rounding is counted as in `certificate`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement
from typing import NamedTuple, Protocol

import numpy as np

from spacearm.arrays import Array, Booleans, Integers
from spacearm.polynomial.jets import Jets, derivatives
from spacearm.polynomial.tubes import EPS, ROUNDING, Form, Tubes

#: Boxes that are tried at a time at most and at least, and in how many times a budget is spent: the
#: fewer at a time, the more of those that are nearest.
BATCH, LEAST, SPLIT = 512, 16, 50
#: Half width of boxes that are not halved: a common root is as good as found.
NARROW = 1e-7
#: Share of all coefficients that the polynomials tried first have at most, and how often a box is
#: halved with these alone before all are tried.
SMALL, PATIENCE = 0.31, 5
#: How many of the largest polynomials are tried first where a box counts as a whole, and how often
#: it is halved with these and the smallest one before all are tried.
LARGEST, LATER = 3, 15
#: Share of an end of a region within which a box reaches it.
AT_THE_END = 1e-12
#: What a single polynomial has to say on where a box is halved, beside the best of their sums.
VOTE = 0.1
#: Share of the squared slopes that is added to the small systems, which may be singular.
RIDGE = 1e-14
#: Degree of the Taylor polynomial of one polynomial, and of several, where it takes fewer boxes.
DEGREE, OF_SEVERAL = 3, 4
#: The same where all boxes are so small that no wave turns by more than this in them [rad].
OF_SMALL, SMALL_TURN = 2, 0.5
#: Boxes that a proof may take, and how many coefficients are summed up in them.
MOST_BOXES, MOST_TERMS = 20_000, 1.2e9


class Monomials(NamedTuple):
    """The t monomials of some degrees of the coordinates that matter, the lowest degree first.

    Attributes:
        indices: The coordinates of each, as often as it has them.
        linear: How many have degree 1.
        factor: (t,) what a Taylor coefficient is of the derivative.
        even: (t,) which are squares, never negative, in the order of those of degree 1.
        powers: (t, n) how often each has each coordinate.
        share: (t, n) what each coordinate takes of them.
    """

    indices: tuple[tuple[int, ...], ...]
    linear: int
    factor: Array
    even: Booleans
    powers: Array
    share: Array

    @classmethod
    def of(cls, relevant: Booleans, degrees: Iterable[int]) -> Monomials:
        """Return those of the relevant (n,) coordinates."""
        own = [combinations_with_replacement(np.flatnonzero(relevant), d) for d in degrees]
        indices = tuple(tuple(map(int, index)) for some in own for index in some)
        powers = np.array([[index.count(j) for j in range(len(relevant))] for index in indices])
        powers = powers.reshape(-1, len(relevant))
        size = powers.sum(axis=1)
        factor = 1.0 / np.array([math.prod(map(math.factorial, row)) for row in powers.tolist()])
        return cls(
            indices,
            int((size == 1).sum()),
            factor,
            (size == 2) & (powers.max(axis=1, initial=0) == 2),
            powers.astype(float),
            powers / size[:, None],
        )

    @property
    def degree(self) -> int:
        """The largest degree."""
        return len(self.indices[-1]) if self.indices else 0

    def at(self, half: Array) -> Array:
        """Return the monomials (m, t) at half widths (m, n)."""
        of_one = half[:, [index[0] for index in self.indices]]
        for i in range(1, self.degree):
            more = [t for t, index in enumerate(self.indices) if len(index) > i]
            of_one[:, more] *= half[:, [self.indices[t][i] for t in more]]
        return of_one

    def quadratic(self, slope: Array, bend: Array) -> Array:
        """Return the Taylor coefficients (m, t) of gradients (m, n) and second derivatives."""
        found = np.zeros((len(slope), len(self.indices)))
        for t, (i, *others) in enumerate(self.indices):
            if len(others) < 2:
                found[:, t] = bend[:, i, others[0]] if others else slope[:, i]
        return found * self.factor


class Expansion(NamedTuple):
    """Functions expanded at the centres of m boxes, in shares of the half widths.

    Attributes:
        monomials: The monomials.
        value: (m, p) values.
        terms: (m, p, t) Taylor coefficients of the monomials.
        beyond: (m, p, n) bounds of what the derivatives beyond these add, by the joint.
        noise: (m, p) bounds of the rounding.
    """

    monomials: Monomials
    value: Array
    terms: Array
    beyond: Array
    noise: Array

    @property
    def slope(self) -> Array:
        """(m, p, r) first derivatives in the r coordinates that matter."""
        return self.terms[:, :, : self.monomials.linear]

    @property
    def rest(self) -> Array:
        """(m, p) bounds of what all but the first derivatives add."""
        later = np.abs(self.terms[:, :, self.monomials.linear :]).sum(axis=2)
        return np.asarray(later + self.beyond.sum(axis=2))

    def with_(self, form: Form, half: Array) -> Expansion:
        """Return these functions and a quadratic one in the same boxes, of half widths (m, n)."""
        own = self.monomials
        terms = own.quadratic(form.slope, form.bend) * own.at(half)
        return Expansion(
            own,
            np.concatenate((self.value, form.value[:, None]), axis=1),
            np.concatenate((self.terms, terms[:, None]), axis=1),
            np.pad(self.beyond, ((0, 0), (0, 1), (0, 0))),
            np.concatenate((self.noise, form.noise[:, None]), axis=1),
        )

    def factors(self, rest: Array, terms: int | None = None) -> Array:
        """Return (m, p) factors with value 1 that make the squares of the first terms least.

        The squares of the rest (m, p) of each function count too.
        """
        T = self.terms[:, :, :terms]
        M = T @ T.swapaxes(1, 2)
        size = np.einsum("mii->m", M)[:, None] + np.finfo(np.float64).tiny
        M = M + (rest**2 + RIDGE * size)[:, :, None] * np.eye(M.shape[1])
        a = np.linalg.solve(M, self.value[:, :, None])[:, :, 0]
        return self.normalised(a)

    def normalised(self, a: Array) -> Array:
        """Return factors (m, p) with which the value is 1; zeros where it is zero."""
        total = (a * self.value).sum(axis=1)
        return a / np.where(total == 0.0, np.inf, total)[:, None]

    @property
    def steady(self) -> Array:
        """(m, p, n) signs of the first derivatives that have one everywhere in the box; else zeros.

        h_j times the derivative in x_j of a monomial is at most the monomial itself, as often as it
        has x_j; of what is beyond, once more than their degree.
        """
        first, later = np.split(self.monomials.powers, [self.monomials.linear])
        slope = self.slope @ first
        less = np.abs(self.terms[:, :, len(first) :]) @ later
        degree = self.monomials.degree
        less += (degree + 1.0) * self.beyond + degree * self.noise[:, :, None]
        return np.where(np.abs(slope) > less * (1.0 + ROUNDING), np.sign(slope), 0.0)

    def least(self, a: Array) -> tuple[Array, Array]:
        """Bound the sums with factors (m, p) from below, (m,), and say what each joint takes.

        A square s t^2 of positive s makes up for some of a slope b: where |t| <= 1, b t + s t^2 is
        s - |b| at least, or -b^2 / 4 s.
        """
        size, own = np.abs(a), self.monomials
        terms = (a[:, None] @ self.terms)[:, 0]
        amount, bow = np.abs(terms), np.maximum(terms[:, own.even], 0.0)
        amount[:, own.even] -= bow
        slope = amount[:, : own.linear]
        inner = slope < 2.0 * bow
        lowest = slope**2 / np.where(inner, 4.0 * bow, 1.0)
        amount[:, : own.linear] = np.where(inner, lowest, slope - bow)
        taken = amount @ own.share + (size[:, None] @ self.beyond)[:, 0]
        return (a * self.value - size * self.noise).sum(axis=1) - taken.sum(axis=1), taken


class Effort(NamedTuple):
    """How a region grows, and how long.

    Attributes:
        step: By how much a side moves at first, in units of `joint_scales`.
        cells: Cells that the proofs of a region may take.
        slab: Cells that the proof of one slab may take.
        ends: Time of the monotonic clock after which nothing more is tried [s].
    """

    step: float
    cells: int
    slab: int
    ends: float = math.inf

    def spent(self, cells: int) -> bool:
        """Return whether so many cells are all that may be looked at, or the time is up."""
        return cells >= self.cells or time.monotonic() >= self.ends


class Trial(NamedTuple):
    """What came of a trial of m boxes.

    Attributes:
        free: (m,) whether it is proven that they hold no common root.
        taken: (m, n) what the width of each coordinate takes, as a share of the value.
        work: How many boxes were tried, in shares of all coefficients.
        value: (m,) values in the middle of what changes its sign at roots; zeros if nothing does.
        steady: (m, n) signs of its derivatives that keep them everywhere in the box; else zeros.
    """

    free: Booleans
    taken: Array
    work: int
    value: Array
    steady: Array


class Region(Protocol):
    """What proves boxes of joint positions free, in x = (q - origin) / unit.

    Coordinates of x after those of the joints are from -1 to 1.
    """

    @property
    def relevant(self) -> Booleans:
        """Which coordinates matter."""

    @property
    def alone(self) -> bool:
        """Whether `values` change their sign at singular configurations."""

    def values(self, X: Array) -> Array:
        """Compute what changes its sign, (m,) at x (m, n)."""

    def tried(self, centre: Array, half: Array, age: Integers, inside: Form | None = None) -> Trial:
        """Tell which boxes (m, n) are free where `inside` is not positive.

        What is kept of a box while it is halved is its age (m,), zero at first.
        """


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

    @cached_property
    def varied(self) -> Roots:
        """The smallest polynomial and the largest ones alone: their sums prove whole boxes free."""
        if len(self.polynomials) <= 1 + LARGEST:
            return self
        by_size = sorted(self.polynomials, key=lambda f: f.polynomial.coefficients.size)
        return replace(self, polynomials=[by_size[0], *by_size[-LARGEST:]])

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
    def _taylor(self) -> dict[int, tuple[Monomials, Monomials, Array]]:
        """What `_taylor_of` has returned."""
        return {}

    def _taylor_of(self, degree: int) -> tuple[Monomials, Monomials, Array]:
        """Return the monomials up to a degree, those of the next, and (p, t) bounds of these."""
        if degree not in self._taylor:
            ends = self.origin + self.unit * np.array((self.low, self.high))
            own = Monomials.of(self.relevant, range(1, degree + 1))
            last = Monomials.of(self.relevant, [degree + 1])
            found = [f.bounds_of_derivatives(degree + 1, ends) for f in self.polynomials]
            bounds = np.array([[some.get(index, 0.0) for index in last.indices] for some in found])
            self._taylor[degree] = own, last, bounds * last.factor * last.at(self.unit[None])
        return self._taylor[degree]

    def expanded(self, centre: Array, half: Array) -> Expansion:
        """Expand the polynomials in boxes (m, n)."""
        turn = half @ self._turns.T
        small = turn.max(initial=0.0) <= SMALL_TURN
        degree = OF_SMALL if small else DEGREE if self.alone else OF_SEVERAL
        own, last, bounds = self._taylor_of(degree)
        at = self.origin + self.unit * centre
        found = derivatives(self.polynomials, at, [(), *own.indices])
        return Expansion(
            own,
            found[:, :, 0],
            found[:, :, 1:] * (own.factor * own.at(self.unit * half))[:, None],
            (last.at(half)[:, None] * bounds) @ last.share,
            self._noise * sum(turn**d / math.factorial(d) for d in range(own.degree + 1)),
        )

    def tried(self, centre: Array, half: Array, age: Integers, inside: Form | None = None) -> Trial:
        """Tell which boxes are free, of young ones by some polynomials alone.

        Args:
            centre: As of `free`.
            half: As of `free`.
            age: (m,) how often boxes were halved since all polynomials were tried; written to.
            inside: As of `free`; boxes in which it is constant count as a whole.
        """
        whole = inside is None or bool(2 * inside.bend.any(axis=(1, 2)).sum() < len(age))  # most do
        small = self.varied if whole else self.small
        own = small.expanded(centre, half)
        free, taken = small.judged(own, half, inside)
        age += 1
        if self.alone:
            return Trial(free, taken, len(age), own.value[:, 0], own.steady[:, 0])
        nothing = np.zeros(len(age)), np.zeros(half.shape)
        if small is self:
            return Trial(free, taken, len(age), *nothing)
        again = np.flatnonzero(~free & (age > (LATER if whole else PATIENCE)))
        if len(again):
            part = None if inside is None else Form(*(numbers[again] for numbers in inside))
            free[again], taken[again] = self.free(centre[again], half[again], part)
            age[again] = 0
        work = math.ceil(small.size / self.size * len(age)) + len(again)
        return Trial(free, taken, work, *nothing)

    def free(
        self, centre: Array, half: Array, inside: Form | None = None
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
        return self.judged(self.expanded(centre, half), half, inside)

    def judged(self, own: Expansion, half: Array, inside: Form | None) -> tuple[Booleans, Array]:
        """Tell as `free` which boxes hold no common root, from the expansions in them."""
        value, by_joint = np.abs(own.value), np.abs(own.terms) @ own.monomials.share + own.beyond
        total = by_joint.sum(axis=2)
        proven = (value - own.noise > total * (1.0 + ROUNDING)).any(axis=1)
        size = np.maximum(np.maximum(total, value), EPS)[:, :, None]
        taken = VOTE * (by_joint / size).sum(axis=1)
        trials = [(own, own.factors(own.beyond.sum(axis=2) + own.noise))]
        least = np.full(len(half), np.inf)
        if inside is not None:
            both, linear = own.with_(inside, half), own.monomials.linear
            for rest in (0.0 * both.rest, np.pad(own.rest, ((0, 0), (0, 1)))):
                a = both.factors(rest, linear)
                a[:, -1] = np.maximum(a[:, -1], 0.0)
                trials.append((both, a))
        for functions, a in trials:
            bound, joints = functions.least(a)
            proven |= bound > 0.0
            total = joints.sum(axis=1)
            least = np.minimum(least, total)
            taken += joints / np.maximum(total, 1.0)[:, None]
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


def most_boxes(functions: Sequence[Jets]) -> int:
    """Return how many boxes a proof with some functions may take, in a second or two."""
    terms = sum(f.polynomial.coefficients.size for f in functions)
    return int(min(MOST_BOXES, MOST_TERMS / terms)) if terms else 0


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
        if tried >= most or (tried and half[now[0]].max() < NARROW):
            open_ = np.where(roots.relevant, centre[order], whole.start[of[order]])
            return Proof(min(max(float(away[now[0]]), 0.0), tubes.radius), open_, tried)
        inside = tubes.form(centre[now], half[now], of[now])
        older = age[now]
        free, taken, work, *_ = roots.tried(centre[now], half[now], older, inside)
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


def halved(centre: Array, half: Array, taken: Array) -> tuple[Array, Array]:
    """Return the halves of boxes (m, n), each divided along the joint that takes most."""
    widest = np.arange(half.shape[1]) == taken.argmax(axis=1)[:, None]
    h, step = np.where(widest, half / 2.0, half), np.where(widest, half / 2.0, 0.0)
    return np.concatenate((centre - step, centre + step)), np.concatenate((h, h))


def shrunk(
    centre: Array, half: Array, rising: Array, low: Array, high: Array
) -> tuple[Booleans, Array, Array]:
    """Find the parts of boxes in which a function may be least of all in a region.

    Where its derivative in x_j keeps its sign in a box, the least is not in that box, or on the
    face of the box that is an end of the region: others go, and those at the end shrink to it.

    Args:
        centre: (m, n) centres.
        half: (m, n) half widths.
        rising: (m, n) signs of the derivatives, where they keep them in the box; else zeros.
        low: (n,) lower corner of the region.
        high: (n,) upper corner.

    Returns:
        (m,) which boxes, and (m, n) centres and half widths of all parts.
    """
    near = AT_THE_END * (1.0 + np.maximum(np.abs(low), np.abs(high)))
    down, up = rising > 0.0, rising < 0.0
    inner = (down & (centre - half > low + near)) | (up & (centre + half < high - near))
    centre = np.where(down, low, np.where(up, high, centre))
    return np.asarray(~inner.any(axis=1)), centre, np.where(down | up, 0.0, half)
