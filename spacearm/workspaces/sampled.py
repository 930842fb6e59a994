"""Distances of the tip at singular configurations of any arm, by search.

Arms whose singular set no polynomials give joint by joint (redundant arms with position tasks,
sliding and mimic joints) have no shells in closed form. Here Newton's method leads uniform
configurations to the singular set, and walks along the set go on from them towards distances of
the tip from the system CM that none of them has: from p to the point of the set next to
p + s P grad R, P the projection on the tangent space of the set.

Each distance that is kept belongs to a singular configuration that was found. Where the next one is
less than a resolution away, the range between them counts as path dependent. That nothing else is
singular is not proven.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array, Booleans
from spacearm.mechanics.batch import tips_from_centre
from spacearm.mechanics.distance import LOST, linearise
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_scales
from spacearm.singularities.exact_set import ExactSet
from spacearm.singularities.risk import ranges_of
from spacearm.singularities.sets import singular_set
from spacearm.workspaces.extent import Box, largest_distance, largest_distance_within
from spacearm.workspaces.shells import Shell, merged

#: Default number of uniform configurations from which singular ones are searched.
STARTS = 40_000
#: Share of the largest distance: singular configurations whose distances differ by less than this
#: belong to one range.
RESOLUTION = 1 / 300
#: Newton steps to the set at most, and the longest one [rad].
STEPS, STRIDE = 60, 0.3
#: Newton steps after a step of a walk.
FEW_STEPS = 20
#: First and least stride of a walk [rad], and its number of steps at most.
WALK, LEAST_WALK, WALK_STEPS = 0.1, 1e-6, 200
#: Configurations on each side of a gap from which walks begin, and rounds of walks at most.
WALKERS, ROUNDS = 8, 6
#: Configurations from which each end of the reachable distances is searched, and the sample that
#: they are the best of.
EXTREMES, SAMPLE = 12, 4096
#: Configurations whose largest sigma_min is what singular ones are compared with.
PROBES = 64
#: Step of difference quotients of R [rad].
DIFFERENCE = 1e-6
#: Largest number of sliding joints whose limits are combined for an upper bound of the reach.
MOST_SLIDES = 6
#: Number of singular configurations that a result keeps.
KEPT = 2000


class Sampled(NamedTuple):
    """Distances at which singular configurations were found.

    Attributes:
        shells: Ranges of distances, each with configurations at its ends.
        reachable: (2,) least and largest distance found [m].
        reachable_at: (2, n) configurations there.
        configurations: (m, n) singular configurations, by distance.
        found: Number of singular configurations found.
        resolution: Largest difference of neighbouring distances in one shell [m].
        farthest: A distance that the tip never exceeds [m]; inf where none is known.
    """

    shells: list[Shell]
    reachable: Array
    reachable_at: Array
    configurations: Array
    found: int
    resolution: float
    farthest: float

    @property
    def gap(self) -> float:
        """By how much R may lie outside, or what range inside has nothing singular [m]."""
        radii = merged([shell.radius for shell in self.shells])
        outer = self.farthest - self.reachable[1]
        if not len(radii):
            return self.farthest
        between = 0.5 * (radii[1:, 0] - radii[:-1, 1])
        sides = (radii[0, 0], self.farthest - radii[-1, 1], outer, self.resolution)
        return float(max(*sides, between.max(initial=0.0)))


class SingularSampler:
    """A search for singular configurations, and for distances of the tip at them.

    Args:
        arm: Any arm with one tip; sliding joints have limits.
        mode: What the spacecraft does.
        limits: Whether joint limits count; those of sliding joints always do.
        rng: Source of the uniform configurations.
        progress: Called as progress(share).
    """

    def __init__(
        self,
        arm: SpaceArm,
        mode: BaseMode,
        limits: bool,
        rng: np.random.Generator,
        progress: Callable[[float], object],
    ) -> None:
        self.arm, self.mode, self.limits = arm, mode, limits
        self.low, self.high = ranges_of(arm, limits)
        #: A joint that others mimic is not where it was after a whole turn: they are elsewhere.
        self.periodic = ~arm.slides & (arm.coupling is None)
        self.turns = self.periodic & (self.high - self.low >= 2.0 * np.pi)
        self.scales = joint_scales(arm)
        self.rng, self.progress = rng, progress
        self.expected = STARTS * STEPS
        self.points: Array = np.empty((0, arm.n))
        self.radii: Array = np.empty(0)
        self.reach: tuple[Array, Array] = (np.full(2, np.nan), np.zeros((2, arm.n)))
        sigma = linearise(arm, self.uniform(PROBES), mode, expected=self.expected).sigma
        self.lost = LOST * float(sigma.max())

    def uniform(self, m: int) -> Array:
        """Draw configurations (m, n)."""
        return self.rng.uniform(self.low, self.high, (m, self.arm.n))

    def distances(self, Q: Array) -> Array:
        """Compute R (m,) at configurations (m, n) [m]."""
        return np.asarray(np.linalg.norm(tips_from_centre(self.arm, Q, self.mode), axis=1))

    def slopes(self, Q: Array) -> Array:
        """Compute the gradient of R at configurations (m, n), per radian [m]."""
        step = DIFFERENCE * np.diag(self.scales)
        around = np.concatenate((Q[:, None] + step, Q[:, None] - step), axis=1)
        R = self.distances(around.reshape(-1, self.arm.n)).reshape(len(Q), 2, self.arm.n)
        return np.asarray((R[:, 0] - R[:, 1]) / (2.0 * DIFFERENCE))

    def fold(self, Q: Array) -> Array:
        """Move angles (m, n) by whole turns to where their range begins."""
        folded = self.low + (Q - self.low) % (2.0 * np.pi)
        return np.where(self.periodic, folded, Q)

    def holds(self, Q: Array) -> Booleans:
        """Check which folded configurations (m, n) are in range, (m,)."""
        inside = (self.low - 1e-12 <= Q) & (self.high + 1e-12 >= Q)
        return np.asarray((inside | self.turns).all(axis=1))

    def onto(self, Q: Array, steps: int = STEPS) -> tuple[Array, Booleans]:
        """Move configurations (m, n) to the singular set, and say which are in range on it."""
        Q = Q.copy()
        going = np.arange(len(Q))
        done = np.zeros(len(Q), dtype=bool)
        for _ in range(steps):
            if not len(going):
                break
            seen = linearise(self.arm, Q[going], self.mode, expected=self.expected)
            done[going] = seen.sigma <= self.lost
            left = ~done[going] & np.isfinite(seen.distance)
            step = np.minimum(seen.distance[left], STRIDE)[:, None] * seen.rows[left, 0]
            going = going[left]
            Q[going] -= step * self.scales
        Q = self.fold(Q)
        return Q, done & self.holds(Q)

    def add(self, Q: Array) -> None:
        """Add singular configurations (m, n) to those found."""
        self.points = np.concatenate((self.points, Q))
        self.radii = np.concatenate((self.radii, self.distances(Q)))

    def search(self, starts: int) -> None:
        """Find singular configurations from uniform ones, by polynomials where these exist."""
        found = singular_set(self.arm, mode=self.mode)
        if isinstance(found, ExactSet):
            Q = self.fold(found.sample(starts, self.rng))
            self.add(Q[self.holds(Q)])
            return
        block = max(1, starts // 8)
        for begin in range(0, starts, block):
            Q, kept = self.onto(self.uniform(min(block, starts - begin)))
            self.add(Q[kept])
            self.progress(0.5 * min(begin + block, starts) / starts)

    def walk_into_gaps(self) -> None:
        """Walk along the set towards distances at which nothing was found yet."""
        Q, kept = self.onto(self.reach[1])
        self.add(Q[kept])
        tried: set[tuple[float, float]] = set()
        for number in range(ROUNDS):
            gaps = [gap for gap in self._gaps() if gap not in tried]
            if not gaps or not len(self.radii):
                break
            tried |= set(gaps)
            starts, signs, stops = self._starts(gaps)
            self._walk(starts, signs, stops)
            self.progress(0.5 + 0.5 * (number + 1) / ROUNDS)

    def _gaps(self) -> list[tuple[float, float]]:
        """Return the ranges of reachable distances wider than the resolution without a find."""
        reachable = self.reach[0]
        ends = np.concatenate((reachable[:1], np.sort(self.radii), reachable[1:]))
        wide = np.flatnonzero(np.diff(ends) > 0.5 * RESOLUTION * reachable[1])
        return [(float(ends[i]), float(ends[i + 1])) for i in wide]

    def _starts(self, gaps: list[tuple[float, float]]) -> tuple[Array, Array, Array]:
        """Return configurations beside gaps, whether R grows (1) or falls (-1), and where to."""
        order = np.argsort(self.radii)
        R = self.radii[order]
        chosen, signs, stops = list[int](), list[float](), list[float]()
        for low, high in gaps:
            below = order[: np.searchsorted(R, low, side="right")][-WALKERS:]
            above = order[np.searchsorted(R, high) :][:WALKERS]
            chosen += [*below, *above]
            signs += [1.0] * len(below) + [-1.0] * len(above)
            stops += [high] * len(below) + [low] * len(above)
        return self.points[chosen], np.array(signs), np.array(stops)

    def _walk(self, Q: Array, signs: Array, stops: Array) -> None:
        """Walk from singular configurations (m, n) while R moves towards its stop (m,)."""
        R = self.distances(Q)
        stride = np.full(len(Q), WALK)
        for _ in range(WALK_STEPS):
            if not len(Q):
                break
            rows = linearise(self.arm, Q, self.mode, expected=self.expected).rows
            slope = signs[:, None] * self.slopes(Q)
            along = slope - ((rows @ slope[:, :, None]).swapaxes(1, 2) @ rows)[:, 0]
            length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
            tried = Q + stride[:, None] * along / length * self.scales
            tried, on_set = self.onto(tried, FEW_STEPS)
            there = self.distances(tried)
            better = on_set & (signs * (there - R) > 0.0)
            self.add(tried[better])
            Q = np.where(better[:, None], tried, Q)
            R = np.where(better, there, R)
            stride = np.where(better, np.minimum(1.5 * stride, WALK), 0.5 * stride)
            going = (stride > LEAST_WALK) & (signs * (stops - R) > 0.0)
            Q, R, stride = Q[going], R[going], stride[going]
            signs, stops = signs[going], stops[going]

    def find_reach(self) -> None:
        """Find the least and the largest distance: what `search` and `result` need."""
        from scipy.optimize import minimize  # slow to import

        drawn = self.uniform(SAMPLE)
        order = np.argsort(self.distances(drawn))
        bounds = [
            (None, None) if turns else (low, high)
            for turns, low, high in zip(self.turns, self.low, self.high, strict=True)
        ]
        ends = []
        for sign, best in ((1.0, order[:EXTREMES]), (-1.0, order[: -EXTREMES - 1 : -1])):

            def half_square(q: Array, sign: float = sign) -> tuple[float, Array]:
                R = float(self.distances(q[None])[0])
                slope = self.slopes(q[None])[0] / self.scales
                return 0.5 * sign * R**2, sign * R * slope

            tried = [
                minimize(half_square, drawn[i], jac=True, bounds=bounds, method="L-BFGS-B",
                         options={"ftol": 1e-15, "gtol": 1e-10}).x
                for i in best
            ]  # fmt: skip
            Q = np.array([*tried, *drawn[best]])
            ends.append(Q[np.argmin(sign * self.distances(Q))])
        at = np.array(ends)
        self.reach = self.distances(at), at

    def result(self) -> Sampled:
        """Return what was found so far."""
        reachable, at = (ends.copy() for ends in self.reach)
        if len(self.radii):
            least, largest = int(self.radii.argmin()), int(self.radii.argmax())
            if self.radii[least] < reachable[0]:
                reachable[0], at[0] = self.radii[least], self.points[least]
            if self.radii[largest] > reachable[1]:
                reachable[1], at[1] = self.radii[largest], self.points[largest]
        order = np.argsort(self.radii)
        R, Q = self.radii[order], self.points[order]
        jumps = np.diff(R)
        cuts = np.flatnonzero(jumps > RESOLUTION * reachable[1]) + 1
        shells = []
        for i, part in enumerate(np.split(np.arange(len(R)), cuts) if len(R) else []):
            outer = part[[0, -1]]
            shells.append(Shell(R[outer], Q[outer], i))
        inside = np.delete(jumps, cuts - 1)
        share = np.unique(np.linspace(0, max(len(R) - 1, 0), min(KEPT, len(R))).astype(int))
        return Sampled(
            shells=shells,
            reachable=reachable,
            reachable_at=at,
            configurations=Q[share],
            found=len(R),
            resolution=float(inside.max(initial=0.0)),
            farthest=max(self._farthest(reachable), float(reachable[1])),
        )

    def _farthest(self, known: Array) -> float:
        """Bound the distance of the tip from above [m]; inf for more sliding joints than that."""
        arm = self.arm
        if arm.slides.sum() > MOST_SLIDES:
            return float("inf")
        if arm.slides.any() or arm.coupling is not None:
            return largest_distance(arm, self.mode, (self.low, self.high))
        box = Box.of(arm.lower, arm.upper, self.limits)
        return largest_distance_within(arm, self.mode, box, known)


def singular_near(
    arm: SpaceArm, mode: BaseMode, limits: bool, R: float, starts: Array
) -> Array | None:
    """Find a singular configuration (n,) whose tip is R from the system CM [m], or None.

    Newton's method from singular configurations (m, n), those with the nearest distance first.
    """
    sampler = SingularSampler(arm, mode, limits, np.random.default_rng(0), lambda _: None)
    near = starts[np.argsort(np.abs(sampler.distances(starts) - R))[:WALKERS]]
    for q in near:
        for _ in range(STEPS):
            seen = linearise(arm, q[None], mode)
            off = R - float(sampler.distances(q[None])[0])
            distance = float(seen.distance[0])
            if seen.sigma[0] <= sampler.lost and abs(off) <= 1e-9 * max(R, 1.0):
                folded = sampler.fold(q[None])
                if sampler.holds(folded)[0]:
                    return np.asarray(folded[0])
                break
            if not np.isfinite(distance):
                break
            rows = np.concatenate((seen.rows[0], sampler.slopes(q[None])))
            wanted = np.zeros(len(rows))
            wanted[0], wanted[-1] = -distance, off
            step = np.linalg.pinv(rows, rcond=1e-9) @ wanted
            step *= min(1.0, STRIDE / max(float(np.linalg.norm(step)), 1e-300))
            q = q + step * sampler.scales
    return None
