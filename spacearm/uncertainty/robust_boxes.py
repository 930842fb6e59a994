"""Free boxes for all arms whose numbers lie in intervals.

The momenta M of `singularities.regularity` about a point of the spacecraft, in its axes, are
trigonometric polynomials of the joint positions of degree one or two. They have few coefficients,
as the column of a joint depends on the joints before it alone. In a box of joints and parameters
with centre c and half widths h

    M X - 1,   X the (pseudo)inverse of M at the centre,

is bounded element by element by the first and second derivatives at c and a bound of the third
ones everywhere, and by what each link adds between its Bernstein coefficients. Where it is strongly
regular none of these arms is singular. The parameters are further coordinates of the box that grows
(`singularities.joint_boxes`), so that cells are halved in them as in the joints.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array, ArrayLike, Booleans, Integers, Progress, positive
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.mechanics.batch import tips_from_centre
from spacearm.model.arguments import FLOATING, require_possible
from spacearm.model.arm import SpaceArm
from spacearm.polynomial.free_regions import Effort, Trial
from spacearm.polynomial.jets import Jets, stacked
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.polynomial.tubes import Form
from spacearm.polynomial.univariate import Complex
from spacearm.signatures import checked
from spacearm.singularities.joint_boxes import FreeBox, Postures, grown
from spacearm.singularities.polynomials import chart_of, fitting
from spacearm.singularities.regularity import SURE, Momenta, determinants, strongly_regular
from spacearm.uncertainty.intervals import UncertainArm

#: Random configurations that tell the size of the rows of M.
PROBES = 256
#: Cells take more of these arms than of one.
EFFORT = Effort(0.05, 60_000, 1_000)


class Series(NamedTuple):
    """M of some arms at the centres of m boxes, in shares of the half widths.

    Attributes:
        value: (m, a, r, c) values.
        slope: (m, a, n, r, c) first derivatives.
        bend: (m, a, n, n, r, c) second derivatives.
    """

    value: Array
    slope: Array
    bend: Array


@dataclass(frozen=True, eq=False)
class Matrices:
    """M of some arms as polynomials of the joint positions.

    Attributes:
        momenta: The matrices of the uncertain arm.
        arms: The middle one, and those whose differences from it are added to its M.
    """

    momenta: Momenta
    arms: Sequence[SpaceArm]

    def sampled(self, Q: Array) -> Array:
        """Compute M (m, a, r, c) about a point of the spacecraft at Q (m, n)."""
        middle = self.momenta.middle
        apart = tips_from_centre(middle, Q, FLOATING) - tips_from_centre(middle, Q, "fixed")
        found = np.stack([self.momenta.matrices(arm, Q) for arm in self.arms], axis=1)
        found[:, :, 3:] -= np.cross(apart[:, None, :, None], found[:, :, :3], axis=2)
        found[:, 1:] -= found[:, :1]
        return found

    @cached_property
    def _elements(self) -> list[Jets]:
        """The elements one after the other.

        They are fitted beside the size of their rows, on which their rounding depends.
        """
        chart = chart_of(self.momenta.middle)
        seen = np.abs(self.sampled(chart.draw(np.random.default_rng(0), PROBES)))
        beside = np.broadcast_to(seen.max(axis=(0, 1, 3))[:, None], seen.shape[1:])
        with fitting(self.momenta.middle, "the momenta of joints"):
            fitted = TrigPolynomial.fit_each(
                lambda angles: (self.sampled(chart.positions(angles)) + beside).reshape(
                    len(angles), -1
                ),
                chart.slides.size,
            )
        return [
            Jets(TrigPolynomial(_less(f.coefficients, size), f.error), chart)
            for f, size in zip(fitted, beside.ravel(), strict=True)
        ]

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Number of arms, rows and columns."""
        return self.sampled(np.zeros((1, self.momenta.middle.n))).shape[1:]

    @cached_property
    def relevant(self) -> Booleans:
        """(n,) which positions they depend on."""
        return np.any([f.polynomial.degrees for f in self._elements], axis=0)

    def noise(self, largest: float) -> Array:
        """Bound the rounding (a, r, c) of the elements at positions up to so much."""
        return np.reshape([f.noise(largest) for f in self._elements], self.shape)

    def third(self, Q: Array) -> Array:
        """Bound the third derivatives, (a, r c, n, n n), between positions Q (2, n)."""
        found = np.array([f.derivative_bounds(3, Q) for f in self._elements])
        return found.reshape(self.shape[0], -1, *found.shape[1:])

    def __call__(self, Q: Array, width: Array, order: int = 2) -> Series:
        """Expand them at Q (m, n) in shares of half widths (m, n)."""
        jet = stacked(self._elements, Q, order)

        def whole(part: Array) -> Array:
            found = np.moveaxis(part, 1, -1).reshape(*part.shape[:1], *part.shape[2:], *self.shape)
            return np.moveaxis(found, -3, 1)

        first, second = (slice(len(part)) for part in (jet.gradient, jet.hessian))
        pairs = width[:, :, None] * width[:, None]
        return Series(
            whole(jet.value),
            whole(jet.gradient * width[first, None]),
            whole(jet.hessian * pairs[second, None]),
        )


def _less(coefficients: Complex, size: float) -> Complex:
    """Return the coefficients of a polynomial less a number."""
    found = coefficients.copy()
    found[tuple(d // 2 for d in found.shape)] -= size
    return found


class Enclosure(NamedTuple):
    """Bounds of the elements of M X - 1 in m boxes.

    Attributes:
        X: (m, c, r) the (pseudo)inverse of M at their centres.
        bound: (m, r, r) bounds, rounding included.
        joints: (m, n, r, r) what the width of each joint takes of them.
        links: For each link (m, r, r) what its parameters take.
    """

    X: Array
    bound: Array
    joints: Array
    links: list[Array]


@dataclass(frozen=True, eq=False)
class Family:
    """All arms of an uncertain one, as functions of x = (q - origin) / unit and shares -1 to 1.

    Attributes:
        momenta: Their matrices.
        origin: (n,) where x is zero.
        unit: (n,) what a unit of x is.
        low: (n,) least x of the boxes.
        high: (n,) largest x.
    """

    momenta: Momenta
    origin: Array
    unit: Array
    low: Array
    high: Array

    @cached_property
    def _matrices(self) -> Matrices:
        others = [arm for arms, _ in self.momenta.independent for arm in arms]
        return Matrices(self.momenta, [self.momenta.middle, *others])

    @cached_property
    def relevant(self) -> Booleans:
        """(n + p,) which positions M depends on; on all parameters."""
        return np.append(self._matrices.relevant, np.ones(len(self.momenta.degrees), dtype=bool))

    @property
    def alone(self) -> bool:
        """Whether M is square, so that its determinant changes its sign."""
        arm = self.momenta.uncertain.arm
        return arm.n == arm.task.k

    @cached_property
    def _ends(self) -> Array:
        return self.origin + self.unit * np.array((self.low, self.high))

    @cached_property
    def _noise(self) -> Array:
        return self._matrices.noise(float(np.abs(self._ends).max()))

    @cached_property
    def _third(self) -> Array:
        """(a, r c, n, n n) bounds of the third derivatives with respect to x."""
        unit = np.einsum("i,j,k->ijk", self.unit, self.unit, self.unit)
        found = self._matrices.third(self._ends) * unit
        return found.reshape(*found.shape[:3], -1)

    def _weights(self, low: Array, high: Array) -> tuple[Array, list[Array]]:
        """Return what each arm counts in the middle of boxes (k, p) of parameters, and beside it.

        Returns:
            (k, a) factors of all, and for each link (k, nodes, arms) of its Bernstein coefficients.
        """
        middles: list[Array] = [np.ones((len(low), 1))]
        beside: list[Array] = []
        for link, (_, factors) in zip(self.momenta.links, self.momenta.independent, strict=True):
            F = np.broadcast_to(factors, (len(low), *factors.shape))
            coefficients, centre = self.momenta.restricted(link, F, low, high)
            middles.append(centre)
            beside.append(coefficients - centre[:, None])
        return np.concatenate(middles, axis=1), beside

    def matrix(self, X: Array) -> Array:
        """Compute M (m, r, c) at x (m, n + p)."""
        n, shares = len(self.unit), 0.5 + 0.5 * X[:, len(self.unit) :]
        at = self._matrices(self.origin + self.unit * X[:, :n], X[:, :n], order=0)
        weights, _ = self._weights(shares, shares)
        return np.asarray(np.einsum("ma,marc->mrc", weights, at.value))

    def values(self, X: Array) -> Array:
        """Compute det(M), (m,) at x (m, n + p), with rows of length 1; zero where it is unsure."""
        value = determinants(self.matrix(X))
        return np.where(np.abs(value) > SURE, value, 0.0)

    def tried(self, centre: Array, half: Array, _: Integers, __: Form | None = None) -> Trial:
        """Tell in which boxes no arm is singular, rounding included.

        Args:
            centre: (m, n + p) centres, in x and the shares.
            half: (m, n + p) half widths.
        """
        seen, n = self.enclosure(centre, half), len(self.unit)
        proven, v = strongly_regular(seen.bound)
        taken = np.zeros_like(half)
        taken[:, :n] = ((seen.joints @ v[:, None]) / v[:, None]).max(axis=(2, 3))
        for link, part in zip(self.momenta.links, seen.links, strict=True):
            columns = n + np.array(link)
            widest = columns[half[:, columns].argmax(axis=1)]
            taken[np.arange(len(half)), widest] = ((part @ v) / v).max(axis=(1, 2))
        proven &= np.isfinite(seen.bound).all(axis=(1, 2))
        value = self.values(centre) if self.alone else np.zeros(len(half))
        return Trial(proven, taken, len(half), value, np.zeros(half.shape))

    def enclosure(self, centre: Array, half: Array) -> Enclosure:
        """Bound M X - 1 in boxes; arguments as those of `tried`."""
        m, n = len(centre), len(self.unit)
        width = self.unit * half[:, :n]
        low, high = (0.5 + 0.5 * (centre + s * half)[:, n:] for s in (-1.0, 1.0))
        weights, beside = self._weights(low, high)
        at = self._matrices(self.origin + self.unit * centre[:, :n], width)
        middle = np.einsum("ma,marc->mrc", weights, at.value)
        X = np.linalg.pinv(middle)
        size = np.abs(weights)  # of what every arm adds anywhere in the box
        apart = [np.zeros((m, 1)), *(np.abs(part).max(axis=1) for part in beside)]
        spread = np.concatenate(apart, axis=1)

        slope = np.abs(np.einsum("ma,majrc->mjrc", weights, at.slope) @ X[:, None])
        bend = np.abs(np.einsum("ma,majkrc->mjkrc", weights, at.bend) @ X[:, None, None])
        turns = slope + 0.5 * bend.sum(axis=2)
        for a in np.flatnonzero(spread.any(axis=0)):
            own = np.abs(at.slope[:, a] @ X[:, None])
            own += 0.5 * np.abs(at.bend[:, a] @ X[:, None, None]).sum(axis=2)
            turns += spread[:, a, None, None, None] * own
        h = half[:, :n]
        pairs = (h[:, :, None] * h[:, None]).reshape(m, -1)
        third = np.einsum("ma,aejp,mp->mje", size + spread, self._third, pairs, optimize=True)
        third = third.reshape(m, n, *middle.shape[1:]) * h[:, :, None, None] / 6.0
        turns += third @ np.abs(X)[:, None]
        noise = np.einsum("ma,arc->mrc", size + spread, self._noise) @ np.abs(X)
        noise += np.abs(middle @ X - np.eye(X.shape[2]))
        links, first = [], 1
        for part in beside:
            some = at.value[:, first : first + part.shape[2]]
            first += part.shape[2]
            each = np.einsum("mba,marc->mbrc", part, some) @ X[:, None]
            links.append(np.abs(each).max(axis=1))
        return Enclosure(X, noise + turns.sum(axis=1) + sum(links), turns, links)


@checked
def free_box_for_all(
    uncertain: UncertainArm,
    about: Postures,
    *,
    joints: Sequence[str] = (),
    at_least: float | None = None,
    within: tuple[ArrayLike, ArrayLike] | None = None,
    clearance: float = 0.0,
    timeout: float | None = None,
    progress: Progress | None = None,
) -> FreeBox:
    """Find joint ranges in which nothing is singular for all values in the intervals, proven.

    The box grows as that of `free_box`; where a side is stopped by a singular posture its `Stop`
    has the values with which the arm is singular there. Numbers of the last link and of what it
    holds are left out where the task is the full pose: the box holds for any of their values.

    Args:
        uncertain: The arm, with one tip; see `uncertain`.
        about: A configuration of `uncertain.arm`, or a motion of it.
        joints: As for `free_box`, like the arguments below.
        at_least: Width that every range must have [rad].
        within: (n,) least and (n,) largest positions allowed; the joint limits if None.
        clearance: How far every singular configuration of every arm must be from the box [rad].
        timeout: Time after which sides that are not settled are "undecided" [s]. Without one only
            the number of cells is limited, and the box is the same on every machine.
        progress: Called now and then as progress(done, most); it may end before.

    Returns:
        The box; `uncertain` has the intervals by name.

    Raises:
        ConfigurationError: `about` is of another arm, or an argument makes no sense.
        UnsupportedError: The arm has several tips or joints that mimic others.
        NoSolutionError: The ranges of `about` are not proven free, or are not as wide as asked for.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> about = sa.uncertain(arm, {"link_1": {"mass": 0.1}})
        >>> box = sa.free_box_for_all(about, arm.at([0.3, 1.2]))
        >>> (box.upper < sa.free_box(arm.at([0.3, 1.2])).upper).any()
        np.True_
    """
    effort = EFFORT
    if timeout is not None:
        ends = time.monotonic() + positive(timeout, "timeout", "time [s]")
        effort = effort._replace(ends=ends)
    arm = uncertain.arm
    if about.arm is not arm:
        raise ConfigurationError("about is of another arm; give a configuration of uncertain.arm")
    require_possible(arm, FLOATING)
    arm.require_one_tip()
    if arm.coupling is not None:
        raise UnsupportedError(f"{arm.name}: this proof takes no joints that mimic others")
    relevant = uncertain.relevant()
    momenta = Momenta(relevant, np.zeros((1, 1, arm.n)))

    def region(*where: Array) -> Family:
        return Family(momenta, *where)

    growth = grown(about, region, FLOATING, joints, at_least, within, clearance, progress, effort)
    box, n = growth.box(), arm.n
    stops = []
    for stop in box.stops:
        side = arm.joint_names.index(stop.joint), int(stop.side == "upper")
        x = growth.stopped.get(side, (None, None))[1]
        if stop.at is not None and x is not None and relevant.parameters:
            stop = stop._replace(values=relevant.named(0.5 + 0.5 * x[n:]))
        stops.append(stop)
    intervals = {p.name: (float(p.low), float(p.high)) for p in uncertain.parameters}
    return replace(box, stops=tuple(stops), uncertain=intervals)
