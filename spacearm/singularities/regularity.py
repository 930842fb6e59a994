"""Proof that no arm is singular along a path: one, or all whose numbers lie in intervals.

With the tip as root body the matrix M = [B_f P] of momenta (`equations.measures`) is linear in the
spatial inertias of the bodies, and an arm is singular where M loses rank. So M is that of the arm
in the middle of a box of parameters, and of each link a polynomial of its own parameters besides,
which lies between its Bernstein coefficients. Those of different links only add up, so that the
number of parameters does not matter.

Along a chord of the path the elements of M are trigonometric polynomials of degree up to 3 in each
joint. So they are of exponential type tau = 3 sum |dq| on [-1, 1], dq half of the chord. By
Bernstein's inequality interpolation at d Chebyshev nodes is off by at most tau^d / (2^(d-1) d!) of
their bound. Where the path leaves its chord by e, they change by at most 3 sum |e| of it.

With X the inverse (of redundant arms the pseudoinverse) of M in the middle, M X = 1 + E. Where
|E| <= R element by element, and R v < v for some v > 0, no such M is singular: M is strongly
regular, Neumaier, Interval Methods for Systems of Equations (1990), section 4.1. Else the path or
the box is halved, by what makes most of R. Two arms between which det(M) changes its sign have a
singular one between them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import comb, factorial
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
import scipy

from spacearm.arrays import Array, Booleans, Integers, Progress
from spacearm.equations.measures import columns
from spacearm.errors import UnsupportedError
from spacearm.mechanics.arm_kernels import evaluated, parameters_of, structure_of
from spacearm.mechanics.batch import tips_from_centre
from spacearm.model.arguments import FLOATING, BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.polynomial.certificate import BLOCK, WHOLE, Certificate, Verdict, of_block

#: Chebyshev nodes of a chord; an odd number, so that one is in the middle.
NODES = 7
#: Largest degree of an element of M in a joint.
DEGREE = 3
#: Largest tau of the first chords.
LONGEST = 2.0
#: Share of the bound of M that covers the rounding of its elements and of what follows.
ROUNDING = 1e-12
#: Determinants of rows of length 1 above which their sign is sure.
SURE = 1e-10
#: Arms that a singular one is looked for by at first.
DESCENT = 8
#: Steps towards Perron's vector of R, and what its elements are at least, of the largest.
PERRON, LEAST = 12, 1e-3
#: Pieces that are looked at together, and in all; the same, times the arms that it takes.
BATCH, MOST, MOST_ARMS = 32, 50_000, 2_000_000
BISECTIONS = 60
#: Pieces with no longer side are not halved: what is not proven there is as good as singular.
NARROW = 1e-4
#: Share of the largest moments below which others are combinations of those chosen.
DEPENDENT = 1e-10

#: Where on the path, and the parameters (p,) of an arm.
Place: TypeAlias = tuple[float, Array]


class Family(Protocol):
    """Arms that differ in numbers of their links, as `sa.UncertainArm`."""

    @property
    def arm(self) -> SpaceArm:
        """The arm as described."""

    @property
    def parameters(self) -> Sequence[Any]:
        """The numbers, each with its `link` and `kind`."""

    def realise(self, shares: Array) -> SpaceArm:
        """Return the arm whose numbers are at shares of their intervals."""


class OneArm(NamedTuple):
    """The family of one arm."""

    arm: SpaceArm
    parameters: tuple[Any, ...] = ()

    def realise(self, _: Array) -> SpaceArm:
        """Return the arm."""
        return self.arm


class Finding(NamedTuple):
    """What is known of a path.

    Attributes:
        free: Whether no arm is singular on it: proven, rounding included.
        shares: (p,) the parameters of an arm that is singular on it; None if none was found.
        at: (n,) where it is, likewise.
        pieces: How many pieces of path and parameters were looked at.
        margin: Least singular value of M over the largest, in the middles of the pieces.
        open: Where on the path the proof ended, counted in pieces of the path; None if it is free.
    """

    free: bool
    shares: Array | None
    at: Array | None
    pieces: int
    margin: float = np.inf
    open: float | None = None


class Pieces(NamedTuple):
    """Pieces of a path and of the box of parameters, k of them.

    Attributes:
        begin: (k,) where on the path each begins, counted in pieces of the path.
        end: (k,) where it ends, in the same piece.
        low: (k, p) least shares of the parameters.
        high: (k, p) largest shares.
    """

    begin: Array
    end: Array
    low: Array
    high: Array

    @property
    def widest(self) -> Array:
        """(k,) the longest side of each, as a share."""
        sides = np.column_stack((self.end - self.begin, self.high - self.low))
        return np.asarray(sides.max(axis=1))

    def some(self, which: Booleans | Integers | slice) -> Pieces:
        """Return some of them."""
        return Pieces(*(part[which] for part in self))

    def and_(self, other: Pieces) -> Pieces:
        """Return these and others; of one arm alone those at the start of the path last."""
        both = Pieces(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))
        if self.low.shape[1]:
            return both
        return both.some(np.argsort(-both.begin, kind="stable"))

    @property
    def volume(self) -> float:
        """The size of all together, of path times parameters."""
        return float(((self.end - self.begin) * (self.high - self.low).prod(axis=1)).sum())

    def halves(self, by: Integers) -> Pieces:
        """Return the halves of each along a parameter (k,), or along the path for -1."""
        middle, along = 0.5 * (self.begin + self.end), by < 0
        half = (by[:, None] == np.arange(self.low.shape[1])) * 0.5 * (self.high - self.low)
        first = Pieces(self.begin, np.where(along, middle, self.end), self.low, self.high - half)
        last = Pieces(np.where(along, middle, self.begin), self.end, self.low + half, self.high)
        return first.and_(last)


class Enclosure(NamedTuple):
    """M X - 1 in k pieces, and the middle of M.

    Attributes:
        parts: (1 + links, k, r, r) bounds of its elements: what they change along the path, with
            rounding, and what each link adds.
        middle: (k, r, c) M in the middle of path and box.
        worst: (k, r, c) M there at the corner of the box that is nearest to singular, to first
            order.
        corner: (k, p) that corner.
    """

    parts: Array
    middle: Array
    worst: Array
    corner: Array

    @property
    def regular(self) -> Booleans:
        """(k,) whether no M is singular."""
        return strongly_regular(self.parts.sum(axis=0))[0]


def strongly_regular(R: Array) -> tuple[Booleans, Array]:
    """Tell where all matrices 1 + E with |E| <= R (k, r, r) are regular: R v < v for some v > 0.

    Returns:
        (k,) whether they are, and v (k, r, 1).
    """
    v = np.ones((*R.shape[:2], 1))
    for _ in range(PERRON):
        v = R @ v
        v = v / v.max(axis=1, keepdims=True) + LEAST
    return np.asarray((R @ v < (1.0 - 1e-9) * v).all(axis=(1, 2))), v


@dataclass(frozen=True, eq=False)
class Momenta:
    """The matrices M of all arms of an uncertain one, along a path.

    Attributes:
        uncertain: The arm.
        way: (m, d, n) control points of the pieces of the path.
    """

    uncertain: Family
    way: Array

    @cached_property
    def links(self) -> list[list[int]]:
        """The numbers of the parameters of each link."""
        names = [parameter.link for parameter in self.uncertain.parameters]
        return [
            [j for j, name in enumerate(names) if name == link] for link in dict.fromkeys(names)
        ]

    @cached_property
    def degrees(self) -> list[int]:
        """The degree of M in each parameter: moments of inertia are of second degree in a shift."""
        return [1 + parameter.kind.startswith("com") for parameter in self.uncertain.parameters]

    @cached_property
    def middle(self) -> SpaceArm:
        """The arm in the middle of the intervals."""
        return self.uncertain.realise(np.full(len(self.degrees), 0.5))

    @cached_property
    def arms(self) -> list[list[SpaceArm]]:
        """For each link the arms at all nodes of its parameters, the others in the middle."""
        return [[self._with(link, x) for x in self._grid(link)] for link in self.links]

    @cached_property
    def independent(self) -> list[tuple[list[SpaceArm], Array]]:
        """For each link at most ten of these arms, and factors (nodes, arms) that give all others.

        M is linear in the ten moments of a body.
        """
        return [_independent(arms, self.middle) for arms in self.arms]

    def _grid(self, link: list[int]) -> list[tuple[float, ...]]:
        return [*product(*(np.linspace(0.0, 1.0, 1 + self.degrees[j]) for j in link))]

    def _with(self, link: list[int], values: tuple[float, ...]) -> SpaceArm:
        shares = np.full(len(self.degrees), 0.5)
        shares[link] = values
        return self.uncertain.realise(shares)

    @cached_property
    def _chosen(self) -> list[int]:
        """The columns of M: all directions that the task leaves free, and all joints."""
        arm = self.uncertain.arm
        return [*{*range(6)} - {*map(int, arm.task.indices)}, *range(6, 6 + arm.n)]

    def matrices(self, arm: SpaceArm, Q: Array) -> Array:
        """Compute M (m, r, c) of one of the arms at Q (m, n), about the CM of the middle one."""
        found: Array = evaluated(arm, FLOATING, columns, {"q": Q})
        apart = tips_from_centre(self.middle, Q, FLOATING) - tips_from_centre(arm, Q, FLOATING)
        found[:, 3:] += np.cross(apart[:, :, None], found[:, :3], axis=1)
        return np.asarray(found[:, :, self._chosen])

    @cached_property
    def bound(self) -> Array:
        """(r, c) bounds of the elements of M, of all arms at all positions."""
        known = [self.middle, *(arm for arms in self.arms for arm in arms)]
        every = [parameters_of(arm) for arm in known]
        mass = float(np.max([p.masses for p in every], axis=0).sum())
        inertia = np.max([np.abs(p.inertias).sum(axis=(1, 2)) for p in every], axis=0).sum()
        lever = max(float(np.linalg.norm(p.centres, axis=1).max()) for p in every)
        steps = np.concatenate((every[0].joint_positions, every[0].tip_positions))
        slides = self.middle.slides
        out = np.abs(self.way).max(axis=(0, 1)) * slides * self._gains.sum(axis=0)
        size = float(np.linalg.norm(steps, axis=1).sum() + out.sum()) + 2.0 * lever
        whole = np.full((6, 6 + self.middle.n), mass * size**2 + float(inertia))
        whole[:3], whole[3:, :3], whole[:3, :3] = mass * size, mass * size, mass
        whole[:, 6:][:, slides] = np.repeat([[mass], [mass * size]], 3, axis=0)
        whole[:, 6:] *= self._gains.sum(axis=0)
        return np.asarray(whole[:, self._chosen])

    @cached_property
    def _gains(self) -> Array:
        return np.abs(structure_of(self.middle).gains)

    def first(self) -> Pieces:
        """Return the pieces to begin with."""
        tau = self._turns(0.5 * np.abs(np.diff(self.way, axis=1)).sum(axis=1))
        counts = np.maximum(np.ceil(tau / LONGEST), 1.0).astype(int)
        edges = [i + np.linspace(0.0, 1.0, count + 1) for i, count in enumerate(counts)]
        begin, end = (np.concatenate([x[part] for x in edges]) for part in (np.s_[:-1], np.s_[1:]))
        box = np.ones((len(begin), len(self.degrees)))
        return Pieces(begin, end, 0.0 * box, box)

    def _turns(self, dq: Array) -> Array:
        """Return how much joint motions (k, n) change M at most, as a share of its bound, (k,)."""
        return np.asarray(DEGREE * (np.abs(dq) @ self._gains.T).sum(axis=1))

    def position(self, t: Array | float) -> Array:
        """Return the places (k, n) on the path at t (k,), or the one (n,) at t."""
        each = np.atleast_1d(t)
        return self._control_points(each, each)[:, 0].reshape(*np.shape(t), -1)

    def _control_points(self, begin: Array, end: Array) -> Array:
        """Return the control points (k, d, n) of parts of the path."""
        d = self.way.shape[1] - 1
        which = np.minimum(0.5 * (begin + end), len(self.way) - 0.5).astype(int)
        x, low = np.linspace(0.0, 1.0, d + 1) if d else np.zeros(1), begin - which
        inner = _bernstein(low[:, None] + x * (end - begin)[:, None], d)
        return np.asarray(np.linalg.inv(_bernstein(x, d)) @ inner @ self.way[which])

    def enclosure(self, pieces: Pieces) -> Enclosure:
        """Enclose M X - 1 in each of k pieces."""
        k, angles = len(pieces.begin), np.pi * (np.arange(NODES) + 0.5) / NODES
        points = self._control_points(pieces.begin, pieces.end)
        first, step = points[:, :1], points[:, -1:] - points[:, :1]
        Q = (first + (0.5 + 0.5 * np.cos(angles))[:, None] * step).reshape(-1, points.shape[2])
        evenly = np.linspace(0.0, 1.0, points.shape[1])[:, None]
        leaves = np.abs(points - first - evenly * step).max(axis=1)
        whole = self.matrices(self.middle, Q)
        shape = (NODES, *whole.shape[1:])
        M, spread = whole.reshape(k, *shape), []
        for link, (arms, factors) in zip(self.links, self.independent, strict=True):
            F = np.stack([(self.matrices(arm, Q) - whole).reshape(k, -1) for arm in arms], 1)
            F = (factors @ F).reshape(k, len(factors), *shape)
            coefficients, centre = self.restricted(link, F, pieces.low, pieces.high)
            M = M + centre
            spread.append(coefficients - centre[:, None])
        m = M[:, NODES // 2]
        X = np.linalg.pinv(m)
        waves = np.cos(np.arange(NODES)[:, None] * angles) * 2.0 / NODES
        waves[0] /= 2.0

        def size(part: Array) -> Array:  # of interpolants (..., NODES, r, r)
            return np.asarray(np.abs(np.einsum("ls,...sij->...lij", waves, part)).sum(axis=-3))

        along = size(M @ X[:, None] - np.eye(X.shape[2]))
        tau = self._turns(0.5 * step[:, 0])
        off = tau**NODES / (2.0 ** (NODES - 1) * factorial(NODES)) + self._turns(leaves) + ROUNDING
        parts = [along + off[:, None, None] * (self.bound @ np.abs(X))]
        worst, corner = m.copy(), 0.5 * (pieces.low + pieces.high)
        for link, part in zip(self.links, spread, strict=True):
            parts.append(size(part @ X[:, None, None]).max(axis=1))
            ends = [i for i, x in enumerate(self._grid(link)) if not {*x} - {0.0, 1.0}]
            there = part[:, ends, NODES // 2]
            least = np.einsum("kerc,kcr->ke", there, X).argmin(axis=1)
            worst += there[np.arange(k), least]
            up = np.array(self._grid(link))[ends][least] > 0.5
            corner[:, link] = np.where(up, pieces.high[:, link], pieces.low[:, link])
        return Enclosure(np.array(parts), m, worst, corner)

    def restricted(self, link: list[int], F: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Return Bernstein coefficients and middles of values F (k, nodes, ...) over some boxes.

        Args:
            link: The numbers of its parameters.
            F: Values at all nodes of its parameters.
            low: (k, p) least shares of the parameters.
            high: (k, p) largest shares.
        """
        k, nodes, *rest = F.shape
        degrees = [self.degrees[j] for j in link]
        middle = F.reshape(k, *(d + 1 for d in degrees), -1)
        whole = middle
        for axis, (j, d) in enumerate(zip(link, degrees, strict=True), 1):
            x, least, largest = np.linspace(0.0, 1.0, d + 1), low[:, j], high[:, j]
            inverse = np.linalg.inv(_bernstein(x, d))
            inner = _bernstein(least[:, None] + x * (largest - least)[:, None], d)
            first = np.moveaxis(whole, axis, 1)
            turned = (inverse @ inner @ inverse) @ first.reshape(k, d + 1, -1)
            whole = np.moveaxis(turned.reshape(first.shape), 1, axis)
            at = _bernstein(0.5 * (least + largest), d) @ inverse
            middle = np.einsum("ka,ka...->k...", at, middle)
        return whole.reshape(k, nodes, *rest), middle.reshape(k, *rest)


def _independent(arms: list[SpaceArm], middle: SpaceArm) -> tuple[list[SpaceArm], Array]:
    """Return arms with independent moments, and the factors (m, k) that combine them to all."""
    moments = np.array([_moments(arm) for arm in arms]) - _moments(middle)
    moments /= np.abs(moments).max(axis=0) + np.finfo(np.float64).tiny
    _, R, order = scipy.linalg.qr(moments.T, pivoting=True, mode="economic")
    size = np.abs(np.diag(R))
    chosen = order[: int(np.count_nonzero(size > DEPENDENT * size[0]))]
    return [arms[i] for i in chosen], moments @ np.linalg.pinv(moments[chosen])


def _moments(arm: SpaceArm) -> Array:
    """Return mass, first and second moments of all bodies, in their frames."""
    p = parameters_of(arm)
    m, c = p.masses.reshape(-1, 1), p.centres
    about = p.inertias + m[:, :, None] * (
        (c**2).sum(axis=1)[:, None, None] * np.eye(3) - c[:, :, None] * c[:, None]
    )
    return np.concatenate((m.ravel(), (m * c).ravel(), about.ravel()))


def look(uncertain: Family, way: Array, progress: Progress | None = None) -> Finding:
    """Prove that no arm is singular on a path, or find one that is.

    Args:
        uncertain: The arm, with one tip.
        way: (m, d, n) control points of its pieces; see `polynomial.tubes`.
        progress: Called as progress(done, 1000), in thousandths of path and parameters.

    Raises:
        UnsupportedError: The arm has several tips, or a sliding joint moves.
    """
    arm = uncertain.arm
    arm.require_one_tip()
    if np.ptp(way[..., arm.slides], axis=(0, 1)).any():
        raise UnsupportedError(
            f"{arm.name}: this proof takes no sliding joints that move; lock them, or let them stay"
        )
    momenta = Momenta(uncertain, way)
    most = min(MOST, MOST_ARMS // (1 + sum(map(len, momenta.arms))))
    nothing, known = momenta.first().some(np.s_[:0]), dict[bool, Place]()
    open_, looked, margin, ended = momenta.first().and_(nothing), 0, np.inf, None
    whole = open_.volume
    for sign, place in _descent(momenta, open_):
        known.setdefault(sign, place)
    while len(known) < 2 and len(open_.begin) and looked < most:
        now, open_ = open_.some(np.s_[-BATCH:]), open_.some(np.s_[:-BATCH])
        looked += len(now.begin)
        seen = momenta.enclosure(now)
        regular, t = seen.regular, 0.5 * (now.begin + now.end)
        centre = 0.5 * (now.low + now.high)
        for M, shares in ((seen.middle, centre), (seen.worst, seen.corner)):
            for i, value in enumerate(determinants(M)):
                if abs(value) > SURE:
                    known.setdefault(value > 0.0, (float(t[i]), shares[i]))
        sizes = np.linalg.svd(seen.middle, compute_uv=False)
        margin = min(margin, float((sizes[:, -1] / sizes[:, 0]).min()))
        open_ = open_.and_(now.some(~regular).halves(_by(momenta, seen, now)[~regular]))
        if progress and whole:
            progress(int(WHOLE * (1.0 - open_.volume / whole)), WHOLE)
        if (now.some(~regular).widest < NARROW).any():
            break
    if len(known) == 2:
        values, where, q = _between(momenta, known[False], known[True])
        return Finding(False, values, q, looked, 0.0, where)
    if len(open_.begin):
        ended = float(open_.begin.min())
    return Finding(ended is None, None, None, looked, margin, ended)


def has_momenta(arm: SpaceArm, mode: BaseMode) -> bool:
    """Tell whether `prove_by_momenta` takes an arm: it floats, has one tip and no sliding joint."""
    return mode == FLOATING and len(arm.tips) == 1 and not arm.slides.any()


def prove_by_momenta(arm: SpaceArm, way: Array, progress: Progress | None = None) -> Certificate:
    """Prove that a path meets no singularity without minors of J*; joints may mimic others.

    Args:
        arm: An arm that `has_momenta`.
        way: As for `look`.
        progress: As for `look`.
    """
    margin = np.inf
    for begin in range(0, len(way), BLOCK):
        part = way[begin : begin + BLOCK]
        found = look(OneArm(arm), part, of_block(progress, begin, len(part), len(way)))
        margin = min(margin, found.margin)
        if found.open is not None:
            at = (
                found.at
                if found.at is not None
                else Momenta(OneArm(arm), part).position(found.open)
            )
            segment = begin + min(int(found.open), len(part) - 1)
            verdict: Verdict = "undecided" if found.at is None else "singular"
            return Certificate(False, at, segment, found.margin, verdict, ROUNDING)
    return Certificate(True, None, None, margin, "free", ROUNDING)


def _descent(momenta: Momenta, pieces: Pieces) -> Iterator[tuple[bool, Place]]:
    """Yield signs of det(M), and where, of arms that come nearer and nearer to a singular one.

    Each has every parameter at that end of its interval which brought the last one nearer.
    """
    t = np.unique(np.linspace(pieces.begin, pieces.end, NODES))
    Q = momenta.position(t)
    realise, p = momenta.uncertain.realise, len(momenta.degrees)
    shares = np.full(p, 0.5)
    for _ in range(DESCENT):
        values = determinants(momenta.matrices(realise(shares), Q))
        i = int(np.abs(values).argmin())
        for k in {i, int(values.argmin()), int(values.argmax())}:
            if abs(values[k]) > SURE:
                yield bool(values[k] > 0.0), (float(t[k]), shares)
        ends = np.array(
            [np.where(np.arange(p) == j, x, shares) for j in range(p) for x in (0.0, 1.0)]
        )
        found = [determinants(momenta.matrices(realise(x), Q[i : i + 1]))[0] for x in ends]
        lower = (np.sign(values[i]) * np.array(found)).reshape(p, 2).argmin(axis=1)
        if (lower == shares).all():
            return
        shares = lower.astype(np.float64)


def _by(momenta: Momenta, seen: Enclosure, pieces: Pieces) -> Integers:
    """Return along what to halve each piece (k,): a parameter, or -1 for the path."""
    size, wide = np.abs(seen.middle).sum(axis=2), pieces.high - pieces.low
    shares = ((seen.parts @ size[:, :, None])[..., 0] / size).max(axis=2)
    widest = [np.array(link)[wide[:, link].argmax(axis=1)] for link in momenta.links]
    choices = np.array([np.full(len(wide), -1), *widest])
    return np.asarray(choices[shares.argmax(axis=0), np.arange(len(wide))])


def determinants(M: Array) -> Array:
    """Return the determinants of M (k, r, c) with rows of length 1; zeros if it is not square."""
    if M.shape[1] != M.shape[2]:
        return np.zeros(len(M))
    return np.asarray(np.linalg.det(M / np.linalg.norm(M, axis=2, keepdims=True)))


def _between(momenta: Momenta, low: Place, high: Place) -> tuple[Array, float, Array]:
    """Return parameters, place and position of a singular arm between two, by bisection."""
    for _ in range(BISECTIONS):
        t, shares = 0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])
        q = momenta.position(t)
        arm = momenta.uncertain.realise(shares)
        negative = np.linalg.det(momenta.matrices(arm, q[None]))[0] < 0.0
        low, high = ((t, shares), high) if negative else (low, (t, shares))
    return shares, t, q


def _bernstein(t: Array, degree: int) -> Array:
    """Return the Bernstein polynomials (..., degree + 1) of a degree at t."""
    k = np.arange(degree + 1)
    binomial = np.array([comb(degree, int(i)) for i in k])
    return np.asarray(binomial * t[..., None] ** k * (1.0 - t[..., None]) ** (degree - k))
