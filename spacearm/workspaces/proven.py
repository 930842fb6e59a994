"""Proof that something is singular at every distance of a shell.

On a curve in the singular set the distance R of the tip from the system CM changes continuously, so
that every distance between the least and the largest one on it is met. Walks along the set, down
from its largest distance and up from its least one, give chains of points; `tubes` proves that
curves pass along them. Where these leave distances out, walks from a sample go on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array
from spacearm.polynomial.extremes import enclose
from spacearm.polynomial.jets import Chart, Jets
from spacearm.singularities.exact_set import ExactSet
from spacearm.singularities.minors import minors_of
from spacearm.singularities.polynomial import distances, radius_squared
from spacearm.singularities.rank_loss import is_singular
from spacearm.workspaces.box import Box
from spacearm.workspaces.extent import least_distance
from spacearm.workspaces.searched_shells import members
from spacearm.workspaces.shells import Shell, merged
from spacearm.workspaces.tubes import Booleans, Equations, tubes

TOLERANCE, NARROW = 1e-9, 2e-7
"""Width of distances that is not worth a walk [m]; of sets of more than two dimensions as
a share of the largest distance."""
SAMPLE = 4000
"""Size of the sample from which walks begin."""
STRIDE, LEAST_STRIDE = 0.05, 1e-4
"""Length of the first step of a walk, and below which it ends [rad]."""
MOST_STEPS = 1000
"""Largest number of steps of a walk."""
ON_SET = 1e-11
"""Values of polynomials of scale 1 at a point of their roots."""
LEVEL = 1e-7
"""Share of the steepest slope of R^2 below which a walk begins in any direction."""
ON_LIMIT = 1e-9
"""Distance from a limit below which a joint stands on it [rad]."""
BESIDE, DIRECTIONS = (0.1, 0.03, 0.01, 0.003), 64
"""How far from an end walks begin instead [rad], and in how many directions that is tried."""
COARSER = 20.0
"""How much more may be missing before walks begin from a sample."""
ENOUGH, IN_VAIN = 0.9, 3
"""A walk is in vain if more than this share of what was missing still is; how often it may be."""


class Proven(NamedTuple):
    """Curves in the singular set, and the distances that they prove.

    Attributes:
        curves: Points (m, n) along each.
        radii: (k, 2) distances [m]: at each of them something is singular.
    """

    curves: tuple[Array, ...]
    radii: Array

    def missing(self, wanted: Array) -> Array:
        """Return the distances of `wanted` (k, 2) that are not proven, (m, 2)."""
        parts = []
        for low, high in wanted:
            inner = self.radii[(self.radii[:, 1] > low) & (self.radii[:, 0] < high)]
            edges = np.concatenate(([low], inner.ravel(), [high])).reshape(-1, 2)
            parts.append(edges[edges[:, 1] > edges[:, 0]])
        return np.concatenate([np.empty((0, 2)), *parts])


def prove_shells(found: ExactSet, box: Box, shells: Sequence[Shell], farthest: float) -> Proven:
    """Prove that something is singular at every distance of shells.

    A root of the minors of a redundant arm is singular where the columns that they share are
    independent. If they are at one point of a proven curve all of it is singular: an analytic
    function that vanishes on a piece of a connected manifold vanishes on all of it.

    Args:
        found: The singular set, of revolute joints.
        box: Range of the joints.
        shells: The shells.
        farthest: A distance that the tip never exceeds [m].
    """
    arm, mode = found.arm, found.mode
    if not shells:
        return Proven((), np.empty((0, 2)))
    chart = Chart.turning(arm.n)
    shared = shared_columns(found) if found.codimension > 1 else ()
    R2 = radius_squared(arm, mode=mode)
    prover = Prover(
        Equations([Jets.of(f, chart) for f in found.triangle.equations], box),
        Jets.of(R2, chart),
        lambda Q: distances(arm, Q, mode),
        arm.n * float(np.sqrt(R2.scale)),  # |p(q) - p(q + pi)| = 2 |dp/dq| <= 2 max |p|
        lambda q: not is_singular(arm, q, mode, shared),
    )
    sample = members(found, box, SAMPLE, np.random.default_rng(0))
    wanted = merged([shell.radius for shell in shells])
    ends = np.concatenate([np.empty((0, arm.n)), *(shell.at for shell in shells)])
    tolerance = max(TOLERANCE, NARROW * farthest) if found.dimension > 2 else TOLERANCE
    known = found.pieces if found.dimension == 1 and not box.limited else []
    return prover.prove(wanted, known, ends, sample, tolerance)


def left_out(found: ExactSet, box: Box, pdw: Array, farthest: float) -> float:
    """Bound by how much the distance of a singular configuration may lie outside of ranges (k, 2).

    Above and below them the largest and the least distance of the tip are the bounds; between
    branch and bound, as far as it comes [m].
    """
    if not len(pdw):
        return farthest
    nearest, above = float(pdw[0, 0]), farthest - float(pdw[-1, 1])
    if nearest > above:
        known = np.array([nearest, farthest])
        nearest -= min(nearest, least_distance(found.arm, found.mode, box, known))
    between = float((0.5 * (pdw[1:, 0] - pdw[:-1, 1])).max(initial=0.0))
    if max(nearest, between) <= above or len(pdw) == 1:
        return max(nearest, above)
    R2 = radius_squared(found.arm, mode=found.mode)
    S = found.S if found.codimension == 1 else None
    squares = pdw**2
    squares[-1, 1] = np.inf
    least = float(pdw[pdw > 0.0].min())
    proof = enclose(R2, S, squares, box.low, box.high, 2.0 * least * max(above, TOLERANCE))
    return max(above, min(max(nearest, between), proof.gap / least))


def shared_columns(found: ExactSet) -> tuple[int, ...]:
    """Return the numbers of the columns that the minors of a redundant arm's set share."""
    minors = minors_of(found.arm, found.mode)
    own = [set(C) for C in minors.degrees if minors[C].polynomial in found.triangle.equations]
    return tuple(sorted(set.intersection(*own)))


class Prover:
    """Looks for curves that prove the distances of shells.

    Args:
        f: Equations of the singular set.
        R2: The squared distance, in some unit.
        distances: Computes R (m,) at configurations (m, n) [m].
        slope: By how much R changes at most if no joint moves by more than 1 rad [m].
        counts: Says whether the curve through a point (n,) is singular: of redundant arms.
    """

    def __init__(
        self,
        f: Equations,
        R2: Jets,
        distances: Callable[[Array], Array],
        slope: float,
        counts: Callable[[Array], bool],
    ) -> None:
        self.f, self.R2, self.distances, self.counts = f, R2, distances, counts
        self.level = LEVEL * float(R2.polynomial.lipschitz.max())
        self.slope = slope
        self.rng = np.random.default_rng(0)

    def prove(
        self, wanted: Array, known: list[Array], ends: Array, sample: Array, tolerance: float
    ) -> Proven:
        """Prove the distances `wanted` (k, 2), but for parts up to `tolerance` wide [m].

        Args:
            wanted: Distances.
            known: Chains of points on the set (m, n).
            ends: (e, n) singular configurations at their ends.
            sample: (m, n) others, from which to walk where walks from the ends do not suffice.
            tolerance: In metres.
        """
        proven, vain = Proven((), np.empty((0, 2))), 0
        ends = ends[np.argsort(-self.distances(ends))]
        for chain in known:
            proven = self._with(proven, chain)
        for end in ends:
            proven = self._from(end, proven, wanted, tolerance)
        for end in ends:  # where the derivatives of the equations vanish no curve begins
            R = float(self.distances(end[None])[0])
            for away in BESIDE:
                missing = self._open(proven, wanted, tolerance)
                beside = self._beside(end, away)
                if len(beside) and np.abs(missing - R).min(initial=np.inf) <= TOLERANCE:
                    proven = self._from(beside[0], proven, wanted, tolerance)
        R_of_sample = self.distances(sample)
        tolerance *= COARSER
        while len(sample) and len(missing := self._open(proven, wanted, tolerance)):
            low, high = missing[np.argmax(missing[:, 1] - missing[:, 0])]
            near = np.abs(R_of_sample - self.rng.uniform(low, high)).argmin()
            proven = self._from(sample[near], proven, wanted, tolerance)
            left = self._open(proven, wanted, tolerance)
            vain += bool(np.diff(left).sum() > ENOUGH * np.diff(missing).sum())
            if vain == IN_VAIN:
                break
        return proven

    def _from(self, start: Array, proven: Proven, wanted: Array, tolerance: float) -> Proven:
        """Walk from a start (n,) while wanted distances are missing; add what it proves."""
        missing = self._open(proven, wanted, tolerance)
        if not len(missing):
            return proven
        R = float(self.distances(start[None])[0])
        low, high = missing[np.argmin(np.abs(missing - R).min(axis=1))]
        down, up = self.walk(start, -1.0, low), self.walk(start, 1.0, high)
        return self._with(proven, np.concatenate((down[::-1], up[1:])))

    @staticmethod
    def _open(proven: Proven, wanted: Array, tolerance: float) -> Array:
        """Return the wanted distances that are not proven yet, (k, 2)."""
        missing = proven.missing(wanted)
        return missing[missing[:, 1] - missing[:, 0] > tolerance]

    def _beside(self, end: Array, away: float) -> Array:
        """Return points on the set (m, n) some way from an end [rad], regular ones first."""
        turn = self.rng.normal(size=(DIRECTIONS, len(end)))
        turn *= away / np.linalg.norm(turn, axis=1, keepdims=True)
        tried = self.f.onto(np.clip(end + turn, self.f.low, self.f.high))
        near = np.linalg.norm(tried - end, axis=1) < 2.0 * away
        found = tried[near & (np.abs(self.f.values(tried)).max(axis=1) < ON_SET)]
        sigma = np.linalg.svd(self.f(found)[1], compute_uv=False)[:, -1]
        return np.asarray(found[np.argsort(-sigma)])

    def _with(self, proven: Proven, chain: Array) -> Proven:
        """Add what a chain of points proves."""
        for points, error in tubes(self.f, chain) if len(chain) > 1 else ():
            R, off = self.distances(points), error * self.slope
            low, high = R.min() + off, R.max() - off
            more = merged([*proven.radii, np.array([low, high])])
            if (
                low < high
                and np.diff(more).sum() > np.diff(proven.radii).sum() + TOLERANCE
                and any(self.counts(points[i]) for i in (0, len(points) // 2, -1))
            ):
                proven = Proven((*proven.curves, points), more)
        return proven

    def walk(self, start: Array, sign: float, stop: float) -> Array:
        """Walk along the set to where R is larger (sign 1) or smaller (-1), points (m, n).

        It ends at `stop` [m], or where no step leads on.
        """
        q, R, stride = start, float(self.distances(start[None])[0]), STRIDE
        points = [q]
        while len(points) < MOST_STEPS and stride > LEAST_STRIDE and sign * (stop - R) > 0.0:
            tried = self.f.onto((q + stride * self._direction(q, sign))[None])
            there = float(self.distances(tried)[0])
            on_set = np.abs(self.f.values(tried)).max() < ON_SET
            near = np.linalg.norm(tried[0] - q) < 2.0 * stride
            if on_set and near and sign * (there - R) > 0.0:
                q, R, stride = tried[0], there, min(1.5 * stride, STRIDE)
                points.append(q)
            else:
                stride *= 0.5
        return np.array(points)

    def _direction(self, q: Array, sign: float) -> Array:
        """Return the direction (n,) along the set, within the box, in which R changes most."""
        g = sign * self.R2(q[None], 1).gradient[0]
        _, slopes = self.f(q[None])
        free = np.ones(len(q), dtype=bool)
        for _ in range(len(q)):
            d = _along(slopes[0], g, free)
            if np.linalg.norm(d) < self.level:
                d = _along(slopes[0], self.rng.normal(size=len(q)), free)
            out = self._leaves(q, d)
            if not out.any():
                break
            free &= ~out
        return np.asarray(d / max(float(np.linalg.norm(d)), 1e-300))

    def _leaves(self, q: Array, d: Array) -> Booleans:
        """Return which joints stand on a limit and would go beyond, (n,) booleans."""
        low, high = q <= self.f.low + ON_LIMIT, q >= self.f.high - ON_LIMIT
        return np.asarray((low & (d < 0.0)) | (high & (d > 0.0)))


def _along(slopes: Array, g: Array, free: Array) -> Array:
    """Project a direction (n,) of the free joints to one normal to slopes (c, n)."""
    J, d = slopes * free, g * free
    return np.asarray(d - np.linalg.pinv(J, rcond=1e-9) @ (J @ d))
