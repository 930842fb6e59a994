"""Singular configurations near a given one: the nearest, and one by the Gauss-Newton method.

Offsets x from the configuration count in radians of each joint (`joint_scales`), so that |x| is the
distance. Each step of a descent goes to the point T(x) nearest to the configuration on the singular
set linearised at x (`mechanics.distance.project`). Nearest points are fixed points of T. The best
ends are then moved onto the set and along it, by Newton's method on T(x) = x, its derivatives taken
as differences, or by shorter steps towards T(x) where that is no nearer.

Arms that are not compiled get fewer starts and steps, and none of Newton's method (`effort_of`).

Where singular values of J* differ by orders of magnitude everywhere, the others reach zero in
valleys of sigma_min that are too narrow to be found. Such arms are searched once more with J*
scaled, which widens the valleys (`mechanics.distance.scaling_of`).

Starts are random offsets, the configuration itself, the end of a descent along the gradient from it
and, where J* has one minor S, the roots of S along lines through it. So what is found is never
farther than that descent reaches.

J* itself and its derivative are all that the descents take, so they work for every arm, and nothing
is found that is not singular: an end counts if it is on the set linearised there, or if its
sigma_min is zero within its rounding error bound. Where sigma_min is tiny everywhere, the second is
what decides. That nothing nearer is missed is proven by the minors of J*, where it has any
(`polynomial.free_regions`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import scipy

from spacearm.arrays import Array, Booleans, Progress, uniform_in_ball
from spacearm.errors import NoSolutionError
from spacearm.mechanics.arm_kernels import KEPT_ARMS
from spacearm.mechanics.distance import (
    Linearisation,
    Scaling,
    linearise,
    project,
    scaling_of,
    seconds_of_linearising,
)
from spacearm.mechanics.jacobian import task_jacobian
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_scales
from spacearm.polynomial.certificate import WHOLE
from spacearm.polynomial.free_regions import Roots, most_boxes, prove
from spacearm.polynomial.jets import Jets
from spacearm.polynomial.newton import shortened
from spacearm.polynomial.tubes import ROUNDING, Tubes, deviations, foot
from spacearm.results import Cell, Description, Result, Table, joint_measures
from spacearm.singularities.immaterial_masses import payload_note
from spacearm.singularities.polynomials import roots_on_lines
from spacearm.singularities.rounding import error_bars

#: Share of the distance found up to which it is proven that none is nearer, by one minor and by
#: several or along a way; in up to three joints that matter all but so much [rad].
SHARE, SHARE_OF_SEVERAL, GAP = 0.99, 0.9, 1e-4
#: How far a chord that stands for several pieces of a way may be from it: share of the distance
#: that need not be proven.
CHORD = 0.2
#: Between places on a way at which it is estimated how near the set is [rad], and their largest
#: number; the largest number from which the nearest configuration is looked for, and how far apart
#: they are [rad].
ABREAST, LOOKED_AT, LOOKED_FROM, ALONG = 0.1, 400, 6, 0.3
#: CPU time that a search may take where the equations of the arm are not compiled, about [s].
PATIENCE = 15.0
#: Share of a distance by which another one is nearer.
NEARER = 1e-6
#: Starts within reach of the configuration, and within that of the best found so far.
STARTS = 128, 96
#: That reach [rad]; the share of the best distance in which others are looked for.
REACH, BEYOND = 2.0, 1.2
#: Steps of each descent.
STEPS = 8
#: What a radian from the set counts. Less leads into valleys of sigma_min that seem to reach it.
WEIGHT = 20.0
#: Steps onto the set from the ends, after each move along it, and along the gradient from the
#: configuration itself.
LANDING, BACK, DESCENT = 10, 4, 25
#: Ends that are moved along the set, as long as they lie apart.
ENDS = 12
#: Ends nearer to each other than this are one [rad].
APART = 0.05
#: Steps along the set; after how many only the nearest are moved further, and how many.
SETTLING, PRUNED_AFTER, PRUNED = 20, 3, 5
#: Shares of the way to T(x) that are tried where Newton's method comes no nearer.
SHARES = np.array([1.0, 0.3, 0.1, 0.03, 0.01, 0.003])
#: Longest step, and that of the differences [rad].
STRIDE, NUDGE = 0.5, 1e-5
#: So near to T(x) Newton's method is tried alone first [rad].
NEARBY = 0.02
#: Steps onto the set that are no longer end the way there: the next would be of the order of their
#: square [rad].
LANDED = 1e-9
#: Way between the rows of a motion that are searched [rad], most of them, and how often the points
#: that are found from one row are tried from the others.
SPACING, MOST_SEARCHED, PASSES = float(np.radians(10.0)), 64, 6
#: Most rows of a motion from which its distances are searched, and configurations that the set is
#: linearised at until an offset has settled, about.
MOST_SETTLED, LINEARISED = 2000, 100
#: Distance of the set from singular configurations, and where it is nowhere in sight [rad].
THERE, FAR = 1e-8, 10.0
#: Farther from the set than this no end is singular, whatever rounding does to sigma_min [rad].
NEARLY = 1e-3
#: Radius of the ball in which it is proven that none is, where the search finds none [rad].
WITHOUT = 1.0
#: Offsets that come nearer by less than this are at rest [rad].
RESTING = 1e-13


class NearestSingular(Result):
    """The nearest singular configuration that was found, and how near none is.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
        start: (n,) where it was looked from; of a way the configuration on it that is nearest.
        limits: Whether only configurations within the joint limits count.
        q: (n,) the configuration, no whole turns away.
        distance: How far it is [rad]: the root of the sum of the squares of the joints' ways,
            sliding ones as in `SingularityReport.radian`. The nearest one of all is no farther.
        distance_proven: No singular configuration is nearer than this [rad], anywhere on a way:
            proven, rounding included. Zero where nothing is proven.
    """

    arm: SpaceArm
    mode: BaseMode
    start: Array
    limits: bool
    q: Array
    distance: float
    distance_proven: float

    JSON: ClassVar[Mapping[str, str]] = {"q": "nearest", "start": "q"}

    not_checked = "collisions"

    def describe(self) -> Description:
        """Describe the configuration, and what is proven of the distance."""
        slides = self.arm.slides
        values = {"q": self.start, "nearest singular": self.q, "turn": self.q - self.start}
        columns: dict[str, Sequence[Cell]] = {"joint": self.arm.joint_names}
        columns |= {name: joint_measures(q, slides) for name, q in values.items()}
        return Description(
            title=f"{self.arm.name}, {self.mode}",
            verdict=nearness(self.distance, self.distance_proven),
            notes=[
                f"Joint limits {'count' if self.limits else 'do not count'}.",
                payload_note(self.arm, self.mode),
            ],
            tables=[Table.by_columns(columns)],
        )


def nearness(found: float, proven: float) -> str:
    """Say how far the nearest singular posture is [rad]: found at most, proven at least."""
    if not found:
        return "the posture itself is singular"
    least = (
        f"none within {angle(proven, down=True)}, proven" if proven else "a nearer one may exist"
    )
    return f"a singular posture found {angle(found)} away; {least}"


def angle(value: float, down: bool = False) -> str:
    """Return an angle [rad] in degrees, in words for people, to three digits."""
    degrees = float(np.degrees(value))
    if down and degrees:
        unit = 10.0 ** (np.floor(np.log10(degrees)) - 2)
        degrees = float(np.floor(degrees / unit * (1.0 + ROUNDING)) * unit)
    return f"{degrees:.3g}°"


def nearest_singular(
    arm: SpaceArm,
    mode: BaseMode,
    way: Array,
    limits: bool = False,
    minors: Sequence[Jets] = (),
    progress: Progress | None = None,
) -> NearestSingular:
    """Find the singular configuration nearest to a configuration, or to a way in joint space.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        way: (m, d, n) control points of its pieces, see `polynomial.tubes`; of a configuration
            (1, 1, n).
        limits: Whether only configurations within the joint limits count.
        minors: Functions of the joint positions that vanish together on the whole set, to prove
            that none is nearer; a proof that stops at a place leads to nearer ones there.
        progress: Called as progress(done, most), in steps of the search and of the proof.

    Raises:
        NoSolutionError: None was found; says how far none is, where that is proven.
    """
    near, proven = search_and_proof(arm, mode, way, limits, minors, progress)
    if near is None:
        within = "one may be missed"
        if proven:
            within = f"none is within {angle(proven, down=True)}: proven"
        raise NoSolutionError(f"{arm.name}: the search found no singular configuration; {within}")
    return near


def search_and_proof(
    arm: SpaceArm,
    mode: BaseMode,
    way: Array,
    limits: bool = False,
    minors: Sequence[Jets] = (),
    progress: Progress | None = None,
) -> tuple[NearestSingular | None, float]:
    """Find what `nearest_singular` returns, None if nothing, and how far none is [rad].

    Where the search finds none, the proof is that none is within `WITHOUT`; where it stops, another
    search begins.

    Args:
        arm: The arm.
        mode: As of `nearest_singular`.
        way: As of `nearest_singular`.
        limits: As of `nearest_singular`.
        minors: As of `nearest_singular`.
        progress: As of `nearest_singular`.
    """
    unit, done = joint_scales(arm), 0
    points = way / unit
    places = _lookouts(arm, mode, points)
    boxes = most_boxes(minors)
    effort = effort_of(arm, mode, LINEARISED, len(places))
    most = effort.linearised(arm.n) * len(places) + boxes

    def worked(m: int) -> None:
        nonlocal done
        done = min(done + m, most)
        if progress:
            progress(done, most)

    def about(x: Array) -> NearestSearch:
        low, high = ((arm.lower, arm.upper) / unit - x) if limits else (-np.inf, np.inf)
        return NearestSearch(
            arm, mode, (unit * x)[None], low, high, linearised=worked, searches=len(places)
        )

    best, start, distance, proven = None, points[0, 0], np.inf, 0.0

    def is_nearer(x: Array, offset: Array | None) -> bool:
        nonlocal best, start, distance
        there = x if offset is None else x + offset
        beside = foot(points, there)[0]
        away = float(np.linalg.norm(there - beside))
        if offset is None or not away < distance * (1.0 - NEARER):
            return False
        best, start, distance = there, beside, away
        return True

    for x in places:
        while is_nearer(x, about(x).nearest(roots_on_lines(arm, mode, minors, unit * x))):
            if np.array_equal(x, start):
                break
            x = start
    share = SHARE if len(minors) == 1 and len(way) == 1 else SHARE_OF_SEVERAL
    while boxes > 0:
        reach = WITHOUT if best is None else distance
        ends = points.min(axis=(0, 1)) - reach, points.max(axis=(0, 1)) + reach
        if limits:
            ends = np.maximum(ends[0], arm.lower / unit), np.minimum(ends[1], arm.upper / unit)
        roots = Roots(minors, np.zeros(arm.n), unit, *ends)
        wanted = reach * share
        if roots.relevant.sum() <= 3:
            wanted = max(wanted, reach - GAP)
        proof = prove(roots, Tubes.about(points, wanted, CHORD * (reach - wanted)), boxes, worked)
        proven, boxes = max(proven, proof.radius), boxes - proof.tried
        if not len(proof.open):
            break
        x = foot(points, proof.open[0])[0]
        search = about(x)
        if not is_nearer(
            x, search.settled(search.descended(proof.open[: effort.starts[1]] - x)[0])
        ):
            break
    if best is None:
        return None, proven
    distance += float(deviations(points).max())  # the way itself may be farther than its chords
    proven = min(proven, distance)
    found = NearestSingular(arm, mode, unit * start, limits, unit * best, distance, proven)
    return found, proven


def _lookouts(arm: SpaceArm, mode: BaseMode, points: Array) -> list[Array]:
    """Return places (n,) on a way from which its nearest singular configuration is looked for."""
    rows = np.vstack((points[:, 0], points[-1:, -1]))
    along = _lengths(rows)
    m = min(1 + int(np.ceil(along[-1] / ABREAST)), LOOKED_AT)
    if m == 1:
        return [rows[0]]
    s = np.linspace(0.0, along[-1], m)
    places = np.column_stack([np.interp(s, along, x) for x in rows.T])
    distance = linearise(arm, joint_scales(arm) * places, mode).distance
    chosen: list[int] = []
    for i in np.argsort(distance):
        if len(chosen) < LOOKED_FROM and all(abs(s[i] - s[j]) > ALONG for j in chosen):
            chosen.append(int(i))
    return [places[i] for i in chosen]


def nearest_locally(arm: SpaceArm, mode: BaseMode, q: Array) -> tuple[Array, float] | None:
    """Return the nearest singular configuration (n,) about q (n,), and its distance; or None.

    Where the set is near, the projection of q on it to first order lies by its nearest point. Then
    the last part of `NearestSearch` is enough, which moves one point along the set until it rests.
    The distance is in radians, sliding joints in units of `joint_scales`.
    """
    (offset,) = local_offsets(arm, mode, q[None])
    if np.isnan(offset).any():
        return None
    return q + joint_scales(arm) * offset, float(np.linalg.norm(offset))


def local_offsets(arm: SpaceArm, mode: BaseMode, Q: Array) -> Array:
    """Return the offsets (m, n) of the set that are reached along it from Q (m, n); NaN if none is.

    What `NearestSearch.settled` does from one configuration, of many side by side.
    """
    X = np.zeros(Q.shape)
    if not len(Q):
        return X
    search = NearestSearch(arm, mode, Q, expected=LINEARISED * len(Q))
    return search.rested(search.onto(X, LANDING))


def distances_found(
    arm: SpaceArm, mode: BaseMode, Q: Array, progress: Progress | None = None
) -> Array:
    """Return how far the nearest singular configurations found from some rows are, (m,) [rad].

    At most `most_settled` rows are searched, evenly spaced along the way. The distance of a row
    between two of them is that to the nearer one of the two configurations found from these. Where
    it may be the least of all, it is searched, too, for as many rows again. Each distance is an
    upper bound: a singular configuration at that distance exists. It is inf where none was found.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        Q: (m, n) joint positions, in the order of a motion.
        progress: Called as progress(done, 1000), in thousandths of the work.
    """
    if arm.n < arm.task.k:
        return np.zeros(len(Q))
    at = Q / joint_scales(arm)
    way = _lengths(at)
    rows, most = np.arange(len(Q)), most_settled(arm, mode)
    if len(Q) > most:
        evenly = np.linspace(0.0, way[-1], max(most - 2, 0))
        rows = np.unique([0, len(Q) - 1, *np.searchsorted(way, evenly).tolist()])
    best, points = _searched(arm, mode, Q[rows], progress)
    if len(rows) == len(Q):
        return best
    after = np.searchsorted(rows, np.arange(len(Q)))
    distance, least = np.full(len(Q), np.inf), np.zeros(len(Q))
    for number in (np.maximum(after - 1, 0), after):
        found = np.linalg.norm(at - points[number], axis=1)
        gap = np.linalg.norm(at - at[rows[number]], axis=1)
        distance = np.fmin(distance, found)
        least = np.maximum(least, best[number] - gap)  # no distance changes faster than the row
    distance[rows] = best
    near = np.flatnonzero(least < distance.min())
    near = near[np.argsort(distance[near])][:most]
    settled = np.linalg.norm(local_offsets(arm, mode, Q[near]), axis=1)
    distance[near] = np.fmin(distance[near], settled)
    return distance


def most_settled(arm: SpaceArm, mode: BaseMode) -> int:
    """Return from how many rows of a motion its distances are searched at most."""
    seconds = LINEARISED * seconds_of_linearising(arm, mode, LINEARISED)
    return int(min(MOST_SETTLED, max(2.0, PATIENCE / seconds))) if seconds else MOST_SETTLED


def _searched(
    arm: SpaceArm, mode: BaseMode, Q: Array, progress: Progress | None
) -> tuple[Array, Array]:
    """Find the nearest singular configurations from all rows of a motion.

    Rows `SPACING` apart on the way, the first and the last one are searched as by
    `nearest_singular`, which has the same numbers there. From what is found, and from the points
    nearest to first order, the nearest points of the other rows are reached along the set.

    Returns:
        The distances (m,), inf where none was found; the configurations (m, n) in units of
        `joint_scales`, NaN there.
    """
    at = Q / joint_scales(arm)
    way = _lengths(at)
    spots = np.arange(0.0, way[-1], max(SPACING, way[-1] / MOST_SEARCHED))
    starts = sorted({0, len(Q) - 1, *np.searchsorted(way, spots).tolist()})
    steps = 1 + len(starts) + PASSES

    def told(done: int) -> None:
        if progress:
            progress(WHOLE * done // steps, WHOLE)

    points = at + local_offsets(arm, mode, Q)
    for done, i in enumerate(starts, 1):
        told(done)
        end = NearestSearch(arm, mode, Q[i : i + 1], searches=len(starts)).nearest()
        if end is not None:
            points = np.vstack((points, at[i] + end))
    best, found = np.full(len(Q), np.inf), np.full(Q.shape, np.nan)
    for passed in range(PASSES + 1):
        told(1 + len(starts) + passed)
        points = points[~np.isnan(points[:, 0])]
        if not len(points):
            break
        distance, nearest = scipy.spatial.KDTree(points).query(at)
        nearer = np.flatnonzero(distance < best * (1.0 - NEARER))
        closer = np.flatnonzero(distance < best)
        found[closer] = points[np.asarray(nearest)[closer]]
        best = np.minimum(best, distance)
        if passed == PASSES or not nearer.size:
            break
        search = NearestSearch(arm, mode, Q[nearer], expected=LINEARISED * len(nearer))
        points = np.vstack((points, at[nearer] + search.rested((points[nearest] - at)[nearer])))
    told(steps)
    return best, found


def _lengths(X: Array) -> Array:
    """Return the length (m,) of the way behind each row of X (m, n)."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(X, axis=0), axis=1)))


@dataclass(frozen=True)
class SearchEffort:
    """How much a search does.

    Attributes:
        starts: Starts within reach of the configuration, and within that of the best found so far.
        ends: Ends that are moved along the set.
        settling: Steps along the set.
        newton: Whether Newton's method is used, which linearises the set 2 n times for each step.
        scaled: Whether all is done once more with J* scaled.
    """

    starts: tuple[int, int] = STARTS
    ends: int = ENDS
    settling: int = SETTLING
    newton: bool = True
    scaled: bool = False

    def linearised(self, n: int) -> int:
        """Return how often a search linearises the set of n joints if no end rests early."""
        after = max(self.settling - PRUNED_AFTER - 1, 0)
        moves = (self.settling - after) * self.ends + after * min(PRUNED, self.ends)
        each = 2 * n * self.newton + 1 + (BACK + 1) * (1 + len(SHARES))
        once = (STEPS + LANDING + 2) * sum(self.starts) + moves * each + 3 * self.ends
        return (1 + self.scaled) * once


@lru_cache(maxsize=KEPT_ARMS)
def effort_of(arm: SpaceArm, mode: BaseMode, expected: int, searches: int) -> SearchEffort:
    """Return the effort of each of some searches: all, or what takes `PATIENCE` uncompiled."""
    seconds = searches * seconds_of_linearising(arm, mode, expected)
    if not seconds:
        return SearchEffort(scaled=scaling_of(arm, mode) is not None)
    share = min(1.0, PATIENCE / seconds / SearchEffort(newton=False).linearised(arm.n))
    first, second = (max(2, round(share * m)) for m in STARTS)
    ends, settling = max(1, round(share * ENDS)), max(3, round(share**0.5 * SETTLING))
    return SearchEffort((first, second), ends, settling, newton=False)


@dataclass(frozen=True)
class NearestSearch:
    """A search for the offsets nearest to the origin at which J* loses rank.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
        Q: (1, n) the configuration that offsets count from, or (m, n) one for each of m offsets.
        low: Least offsets, (n,) or of all joints.
        high: Largest offsets, likewise.
        expected: How many configurations the set is linearised at in all, about.
        linearised: Told at how many it has just been.
        searches: As of `effort_of`.
        scaling: What J* is multiplied by; nothing if None.
    """

    arm: SpaceArm
    mode: BaseMode
    Q: Array
    low: Array | float = -np.inf
    high: Array | float = np.inf
    expected: int = LINEARISED
    linearised: Callable[[int], object] = bool
    searches: int = 1
    scaling: Scaling | None = None

    @property
    def effort(self) -> SearchEffort:
        """How much it does."""
        return effort_of(self.arm, self.mode, self.expected, self.searches)

    def linearise(self, X: Array) -> Linearisation:
        """Linearise the set at offsets (m, n), or at m k of them, k in a row from each of Q."""
        start = self.Q if len(self.Q) == 1 else self.Q.repeat(len(X) // len(self.Q), axis=0)
        Q = start + joint_scales(self.arm) * X
        found = linearise(self.arm, Q, self.mode, expected=self.expected, scaling=self.scaling)
        self.linearised(len(X))
        return found

    def nearest(self, beside: Array | None = None) -> Array | None:
        """Return the best offset (n,) of descents from starts about the origin, or None.

        Args:
            beside: As of `ends`.
        """
        return next(iter(self.ends(beside)), None)

    def ends(self, beside: Array | None = None) -> Array:
        """Return the offsets (m, n) that descents about the origin reach, the nearest first.

        Args:
            beside: (m, n) starts besides random ones and the descent along the gradient.
        """
        found = self._ends(beside)
        if self.effort.scaled:
            scaled = replace(self, scaling=scaling_of(self.arm, self.mode))
            found = np.concatenate((found, scaled._ends(beside)))
            found = found[np.argsort(np.linalg.norm(found, axis=1))]
        return found

    def _ends(self, beside: Array | None) -> Array:
        """Return the offsets (m, n) of `ends`, from one scaling of J*."""
        rng, reach, n = np.random.default_rng(0), REACH, self.arm.n
        ends = [self.onto(np.zeros((1, n)), DESCENT)]
        for m in self.effort.starts:
            starts = uniform_in_ball(rng, m, n, reach)
            if beside is not None and len(ends) == 1:
                starts = np.concatenate((starts, beside))
            X, merit = self.descended(self.within(starts))
            ends.append(X)
            reach = min(reach, BEYOND * float(merit.min()))
        return self.reached(np.concatenate(ends))

    def within(self, X: Array) -> Array:
        """Move offsets (m, n) into the limits."""
        return np.clip(X, self.low, self.high)

    def project(self, X: Array) -> tuple[Array, Array]:
        """Compute T(x) (m, n) and the merit (m,) of X (m, n) itself.

        The merit is the distance from the origin and `WEIGHT` times that from the set.
        """
        set_ = self.linearise(X)
        distance = np.where(np.isfinite(set_.distance), set_.distance, FAR)
        bounded = np.isfinite(self.low).any() or np.isfinite(self.high).any()
        rows = set_.rows
        target = self._project_within(rows, distance, X) if bounded else project(set_, X)
        return target, np.linalg.norm(X, axis=1) + WEIGHT * distance

    def _project_within(self, rows: Array, distance: Array, X: Array) -> Array:
        """Compute the points nearest to the origin on the set linearised at X, in the limits."""
        wanted = (rows @ X[:, :, None])[..., 0]
        wanted[:, 0] -= distance
        free, offset = np.ones_like(X), np.zeros_like(X)
        for _ in range(self.arm.n):
            rest = wanted - (rows @ (offset * (1.0 - free))[:, :, None])[..., 0]
            least = (np.linalg.pinv(rows * free[:, None], rcond=1e-9) @ rest[:, :, None])[..., 0]
            offset = np.where(free > 0.0, least, offset)
            over = ((offset < self.low) | (offset > self.high)) & (free > 0.0)
            offset = self.within(offset)
            if not over.any():
                break
            free[over] = 0.0
        return offset

    def onto(self, X: Array, steps: int) -> Array:
        """Move offsets (m, n) onto the set, by the Gauss-Newton method."""
        for _ in range(steps):
            distance, _, rows = self.linearise(X)
            stride = np.where(np.isfinite(distance), np.minimum(distance, STRIDE), 0.0)
            X = self.within(X - stride[:, None] * rows[:, 0])
            if (stride <= LANDED).all():
                break
        return X

    def descended(self, X: Array) -> tuple[Array, Array]:
        """Descend from X (m, n), by steps that are shortened where the merit does not fall.

        Returns:
            The ends (m, n), and their merits.
        """
        target, merit = self.project(X)
        share = np.ones(len(X))
        for _ in range(STEPS):
            tried = self.within(X + share[:, None] * shortened(target - X, STRIDE))
            new_target, new_merit = self.project(tried)
            better = new_merit < merit
            X = np.where(better[:, None], tried, X)
            target = np.where(better[:, None], new_target, target)
            merit = np.where(better, new_merit, merit)
            share = np.where(better, np.minimum(2.0 * share, 1.0), share / 4.0)
        return X, merit

    def settled(self, X: Array) -> Array | None:
        """Return the nearest offset (n,) of the set that is reached along it from X, or None."""
        return next(iter(self.reached(X)), None)

    def reached(self, X: Array) -> Array:
        """Return the offsets (m, n) of the set that are reached along it from X, nearest first."""
        X = self.onto(X, LANDING)
        _, merit = self.project(X)
        most = self.effort.ends
        ends = _apart(X, merit, most)
        landed = X[self.on_set(X)]
        nearest = landed[np.argsort(np.linalg.norm(landed, axis=1))[:1]]
        ends = np.concatenate((nearest, self.rested(np.concatenate((nearest, ends)))))
        ends = ends[~np.isnan(ends[:, 0])]
        return _apart(ends, np.linalg.norm(ends, axis=1), most)

    def on_set(self, X: Array) -> Booleans:
        """Tell which offsets (m, n) are singular, those included that are within rounding."""
        distance = self.linearise(X).distance
        there = distance <= THERE
        unit = joint_scales(self.arm)
        start = np.broadcast_to(self.Q, (len(X), self.arm.n))
        for i in np.flatnonzero(~there & (distance <= NEARLY)):
            cfg = self.arm.at(start[i] + unit * X[i])
            J = task_jacobian(cfg, mode=self.mode)
            sigma = np.linalg.svd(J * unit, compute_uv=False)[-1]
            there[i] = sigma <= error_bars(cfg, mode=self.mode).sigma * unit.max()
        return there

    def rested(self, X: Array) -> Array:
        """Move offsets (m, n) along the set until they rest; NaN where there is none.

        Those from one configuration are rivals: after some steps only the nearest are moved on.
        """
        merit, moving = np.full(len(X), np.inf), np.arange(len(X))
        rivals = len(self.Q) == 1
        for i in range(self.effort.settling):
            part = self if rivals else replace(self, Q=self.Q[moving])
            X[moving], merit[moving], rests = part._moved(X[moving])
            moving = moving[~rests]
            if rivals and i == PRUNED_AFTER:
                moving = moving[merit[moving] <= np.sort(merit)[:PRUNED][-1]]
            if not moving.size:
                break
        X = self.onto(X, 2)
        X[~self.on_set(X)] = np.nan
        return X

    def _moved(self, X: Array) -> tuple[Array, Array, Booleans]:
        """Move offsets (m, n) along the set; returns their merits and which are at rest, too."""
        (m, n), newton = X.shape, self.effort.newton
        nudges = np.zeros((1, n))
        if newton:
            nudges = NUDGE * np.concatenate((nudges, np.eye(n), -np.eye(n)))
        target, merit = self.project((X[:, None] + nudges).reshape(-1, n))
        target, merit = target.reshape(m, -1, n), merit.reshape(m, -1)[:, 0]
        way = target[:, 0] - X
        size = np.linalg.norm(way, axis=1)
        steps = SHARES[:, None] * shortened(way, STRIDE)[:, None]
        if newton:
            slopes = (target[:, 1 : n + 1] - target[:, n + 1 :]).swapaxes(1, 2) / (2.0 * NUDGE)
            step = (np.linalg.pinv(np.eye(n) - slopes) @ way[:, :, None])[..., 0]
            steps = np.concatenate((shortened(step, STRIDE)[:, None], steps), axis=1)
        moved = np.zeros(m, dtype=bool)
        goes = size**2 > RESTING * np.linalg.norm(X, axis=1)  # else the merit cannot fall by more
        alone = not newton or (size[goes] < NEARBY).all()
        for count in (1, steps.shape[1]) if alone else (steps.shape[1],):
            if not goes.any():
                break
            tried = self.onto((X[:, None] + steps[:, :count]).reshape(-1, n), BACK)
            merits = self.project(tried)[1].reshape(m, -1)
            best = np.arange(m), merits.argmin(axis=1)
            better = goes & (merits[best] < merit - RESTING)
            X = np.where(better[:, None], tried.reshape(m, -1, n)[best], X)
            merit = np.where(better, merits[best], merit)
            moved |= better
            goes &= ~better
        return X, merit, ~moved


def _apart(X: Array, merit: Array, most: int) -> Array:
    """Return the best of offsets (m, n) that lie apart."""
    chosen: list[Array] = []
    for x in X[np.argsort(merit)]:
        if all(np.abs(x - other).max() > APART for other in chosen):
            chosen.append(x)
        if len(chosen) == most:
            break
    return np.array(chosen).reshape(-1, X.shape[1])
