"""Proof that something is singular at every distance of a shell.

On a curve in the singular set the distance R of the tip from the system CM changes continuously, so
that every distance between the least and the largest one on it is met. Walks along the set, down
from its largest distance and up from its least one, give chains of points; `tubes` proves that
curves pass along them. Where these leave distances out, walks from a sample go on.

Between two points of a chain some joints y, as many as there are polynomials f, follow from the
others z, which move straight. Let m be the middle of the segment and A the inverse of df/dy there.
Wherever z is on the segment, the map y -> y - A f(z, y) takes a box about the straight line into
itself if

    |A f| + |1 - A df/dy| rho < rho

there, rho the half width of the box, and contracts it: the box holds one root, which moves
continuously with z. The second derivatives at m, and bounds of the third everywhere, give both
terms. At the ends of the segment the root is within |A f| / (1 - |1 - A df/dy|) of the chain. The
bounds hold with z off by more than that, so that the curves of neighbours that solve for different
joints are connected.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array, Booleans, Integers
from spacearm.mechanics.distance import is_singular
from spacearm.polynomial.branch_and_bound import enclose
from spacearm.polynomial.jets import Jet, Jets, stacked
from spacearm.polynomial.trig import EPS
from spacearm.singularities.exact_set import ExactSet
from spacearm.singularities.polynomials import distances, minors_of, radius_squared
from spacearm.workspaces.extent import Box, least_distance
from spacearm.workspaces.shells import Shell, members, merged, without

#: Condition of df/dy above which no proof is tried.
ILL = 1e10
#: Largest |1 - A df/dy|; rho is at least twice |A f|.
CONTRACTS = 0.49
#: Distance from a limit below which a joint is not solved for [rad].
AT_LIMIT = 1e-7
#: Segments shorter than this are not halved [rad].
SHORTEST = 1e-5
#: Largest number of segments of a chain.
MOST = 20_000
#: Newton steps by which the middle of a segment is moved to a root.
POLISH = 20

#: Values below which they end: less than rounding.
CONVERGED = 1e-14


class Equations:
    """Polynomials of scale 1 whose common roots count, within a box.

    Args:
        polynomials: The polynomials.
        box: Range of the joints.
    """

    def __init__(self, polynomials: Sequence[Jets], box: Box) -> None:
        whole = box.high - box.low >= 2.0 * np.pi
        self.low = np.where(whole, -np.inf, box.low)
        self.high = np.where(whole, np.inf, box.high)
        self.polynomials = polynomials
        self.third = np.array([f.polynomial.derivative_bounds(3) for f in polynomials])
        self.degrees = np.array([max((1, *f.polynomial.degrees)) for f in polynomials])

    def __call__(self, Q: Array, order: int = 0) -> Jet:
        """Compute values (m, c) and derivatives up to an order, (m, c, n), at Q (m, n)."""
        return stacked(self.polynomials, Q, order)

    def noise(self, largest: float) -> Array:
        """Bound the errors of values (c,) at angles up to `largest` [rad]."""
        return np.array([f.noise(largest) for f in self.polynomials])

    def free(self, Q: Array, margin: float = 1e-9) -> Booleans:
        """Return which joints are within the limits, not on them, (m, n)."""
        return np.asarray((self.low + margin < Q) & (self.high - margin > Q))

    def onto(self, Q: Array) -> Array:
        """Move points (m, n) into the box, then along their free joints onto the roots.

        By Newton's method.
        """
        Q = np.clip(Q, self.low, self.high)
        for _ in range(POLISH):
            values, slopes = self(Q, 1)[:2]
            if np.abs(values).max(initial=0.0) < CONVERGED:
                break
            slopes = slopes * self.free(Q)[:, None]
            step = (_inverse(slopes) @ values[:, :, None])[..., 0]
            Q = np.clip(Q - step, self.low, self.high)
        return Q


def _inverse(slopes: Array) -> Array:
    """Compute pseudoinverses (..., n, c) of derivatives (..., c, n)."""
    if slopes.shape[-2] > 1:
        return np.asarray(np.linalg.pinv(slopes, rcond=1e-9))
    square = (slopes * slopes).sum(axis=-1, keepdims=True)
    return np.asarray((slopes / np.where(square > 0.0, square, 1.0)).swapaxes(-1, -2))


class Tube(NamedTuple):
    """A curve in the common roots, proven: it passes by the points of a chain, in their order.

    Attributes:
        points: (m, n) the chain.
        error: Distance in each joint up to which the curve passes by each point [rad].
    """

    points: Array
    error: float


def tubes(f: Equations, chain: Array) -> list[Tube]:
    """Prove that a curve in the roots passes along a chain of points, (m, n), within the box.

    Segments are halved until each is proven. Where one cannot be the curve is cut in two.
    """
    points = np.clip(chain, f.low, f.high)  # joints that nothing depends on move straight
    proven = np.zeros(len(points) - 1, dtype=bool)
    error = np.zeros(len(points) - 1)
    hopeless = np.zeros(len(points) - 1, dtype=bool)
    while (open_ := np.flatnonzero(~proven & ~hopeless)).size and len(points) < MOST:
        proven[open_], error[open_] = _hold(f, points[open_], points[open_ + 1])
        open_ = open_[~proven[open_]]
        length = np.linalg.norm(points[open_ + 1] - points[open_], axis=1)
        straight = 0.5 * (points[open_] + points[open_ + 1])
        middle = f.onto(straight)
        bad = (length < SHORTEST) | (np.linalg.norm(middle - straight, axis=1) > 0.5 * length)
        hopeless[open_[bad]] = True
        open_, middle = open_[~bad], middle[~bad]
        points = np.insert(points, open_ + 1, middle, axis=0)
        proven, error, hopeless = (np.insert(a, open_ + 1, 0) for a in (proven, error, hopeless))
    cuts = np.flatnonzero(~proven)
    ends = np.concatenate(([-1], cuts, [len(proven)]))
    return [
        Tube(points[a + 1 : b + 1], float(error[a + 1 : b].max()))
        for a, b in itertools.pairwise(ends)
        if b - a > 1
    ]


def _hold(f: Equations, start: Array, end: Array) -> tuple[Booleans, Array]:
    """Check which segments (m, n) hold a curve, and how far its ends may be from theirs (m,)."""
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    _, slopes, second, _ = f(middle, 2)
    low, high = np.minimum(start, end), np.maximum(start, end)
    noise = f.noise(float(np.abs((low, high)).max()) + 1.0)
    sizes = np.maximum(np.abs(f(start).value), np.abs(f(end).value)) + noise
    margin = np.minimum(low - f.low, f.high - high)
    y = _pivots(np.where(margin[:, None] > AT_LIMIT, slopes, 0.0))
    own = np.take_along_axis(slopes, y[:, None], axis=2)
    condition = np.linalg.cond(own)
    sound = condition < ILL
    A = np.abs(np.linalg.inv(np.where(sound[:, None, None], own, np.eye(len(noise)))))
    error = 2.0 * (A @ sizes[:, :, None]).max(axis=(1, 2))
    slack = 2.0 * error
    noise_of_second = noise * f.degrees**2

    size = np.abs(half)
    bend = np.abs(np.einsum("ml,mcln,mn->mc", half, second, half))
    twist = np.einsum("cijk,mi,mj,mk->mc", f.third, size, size, size, optimize=True)
    sag = 0.5 * (bend + twist + noise_of_second * (size.sum(axis=1) ** 2)[:, None])
    reach = size + slack[:, None]
    around = np.abs(slopes) + _change(f, second, noise_of_second, reach)
    drift = slack[:, None] * around.sum(axis=2)
    Y = (A @ (sizes + sag + drift)[:, :, None]).max(axis=(1, 2))
    rho = np.maximum(2.0 * Y, slack)
    np.put_along_axis(reach, y, np.take_along_axis(reach, y, axis=1) + rho[:, None], axis=1)
    change = np.take_along_axis(_change(f, second, noise_of_second, reach), y[:, None], axis=2)
    change = change + (noise * f.degrees)[:, None]
    Z = (A @ change).sum(axis=2).max(axis=1) + EPS * condition
    inside = np.take_along_axis(margin, y, axis=1).min(axis=1) > rho
    return sound & (Z < CONTRACTS) & inside, error


def _change(f: Equations, second: Array, noise: Array, reach: Array) -> Array:
    """Bound the change of the first derivatives (m, c, n) up to `reach` (m, n) from the middle."""
    curvature = np.abs(second) + noise[:, None, None]
    curvature += 0.5 * np.einsum("cijk,mk->mcij", f.third, reach, optimize=True)
    return np.asarray(np.einsum("mcij,mj->mci", curvature, reach))


def _pivots(slopes: Array) -> Integers:
    """Choose the joints (m, c) to solve for: columns (m, c, n), each far from those before."""
    left, chosen = slopes.copy(), []
    for _ in range(slopes.shape[1]):
        j = np.linalg.norm(left, axis=1).argmax(axis=1)
        column = np.take_along_axis(left, j[:, None, None], axis=2)
        unit = column / np.maximum(np.linalg.norm(column, axis=1, keepdims=True), 1e-300)
        left = left - unit @ (unit.swapaxes(1, 2) @ left)
        chosen.append(j)
    return np.stack(chosen, axis=1)


#: Width of distances that is not worth a walk [m]; of sets of more than two dimensions as
#: a share of the largest distance.
TOLERANCE, NARROW = 1e-9, 2e-7
#: Size of the sample from which walks begin.
SAMPLE = 4000
#: Length of the first step of a walk, and below which it ends [rad].
STRIDE, LEAST_STRIDE = 0.05, 1e-4
#: Largest number of steps of a walk.
MOST_STEPS = 1000
#: Values of polynomials of scale 1 at a point of their roots.
ON_SET = 1e-11
#: Share of the steepest slope of R^2 below which a walk begins in any direction.
LEVEL = 1e-7
#: Share of the scale of R^2 below which its polynomial does not give all digits of R.
NEAR_CENTRE = 1e-3
#: Distance from a limit below which a joint stands on it [rad].
ON_LIMIT = 1e-9
#: How far from an end walks begin instead [rad], and in how many directions that is tried.
BESIDE, DIRECTIONS = (0.1, 0.03, 0.01, 0.003), 64
#: How much more may be missing before walks begin from a sample.
COARSER = 20.0
#: A walk is in vain if more than this share of what was missing still is; how often it may be.
ENOUGH, IN_VAIN = 0.9, 3


class Proven(NamedTuple):
    """Curves in the singular set, and the distances that they prove.

    Attributes:
        curves: Points (m, n) along each.
        radii: (k, 2) distances [m]: at each of them something is singular.
    """

    curves: tuple[Array, ...]
    radii: Array


def prove_shells(
    found: ExactSet,
    box: Box,
    shells: Sequence[Shell],
    farthest: float,
    progress: Callable[[float], object] | None = None,
) -> Proven:
    """Prove that something is singular at every distance of shells.

    A root of the minors of a redundant arm is singular where the columns that they share are
    independent. If they are at one point of a proven curve all of it is singular: an analytic
    function that vanishes on a piece of a connected manifold vanishes on all of it.

    Args:
        found: The singular set, of revolute joints.
        box: Range of the joints.
        shells: The shells.
        farthest: A distance that the tip never exceeds [m].
        progress: Called now and then with the share of the distances that is proven.
    """
    prover = Prover(found, box, progress)
    if not shells:
        return prover.proven
    prover.wanted = merged([shell.radius for shell in shells])
    prover.tolerance = max(TOLERANCE, NARROW * farthest) if found.dimension > 2 else TOLERANCE
    if found.dimension == 1 and not box.limited:
        for chain in found.pieces:
            prover.add(chain)
    prover.walk_from_ends(np.concatenate([shell.at for shell in shells]))
    prover.walk_from_sample(members(found, box, SAMPLE, np.random.default_rng(0)))
    return prover.proven


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
    equations = (found.S,) if found.codimension == 1 else ()
    squares = pdw**2
    squares[-1, 1] = np.inf
    least = float(pdw[pdw > 0.0].min())
    accuracy = 2.0 * least * max(above, TOLERANCE)
    proof = enclose(R2, equations, squares, box.low, box.high, accuracy)
    return max(above, min(max(nearest, between), proof.gap / least))


def shared_columns(found: ExactSet) -> tuple[int, ...]:
    """Return the numbers of the columns that the minors of a redundant arm's set share."""
    minors = minors_of(found.arm, found.mode)
    own = [set(C) for C in minors.degrees if minors[C].polynomial in found.triangle.equations]
    return tuple(sorted(set.intersection(*own)))


class Prover:
    """Looks for curves that prove the distances of shells.

    Attributes:
        proven: What is proven so far.
        wanted: (k, 2) distances to prove [m].
        tolerance: Width of parts that may be left [m].

    Args:
        found: The singular set, of revolute joints.
        box: Range of the joints.
        progress: As of `prove_shells`.
    """

    def __init__(
        self, found: ExactSet, box: Box, progress: Callable[[float], object] | None = None
    ) -> None:
        self._progress = progress
        self.arm, self.mode = found.arm, found.mode
        self.f = Equations([Jets.of(f) for f in found.triangle.equations], box)
        self.shared = shared_columns(found) if found.codimension > 1 else ()
        R2 = radius_squared(self.arm, mode=self.mode)
        self.R2, self.size = Jets.of(R2), R2.scale or 1.0
        self.level = LEVEL * float(self.R2.polynomial.lipschitz.max())
        # by so much R changes at most if no joint moves by more than 1 rad [m]:
        self.slope = self.arm.n * float(np.sqrt(R2.scale))  # |p(q) - p(q + pi)| = 2 |dp/dq|
        self.rng = np.random.default_rng(0)
        nothing: Array = np.empty((0, 2))
        self.proven, self.wanted, self.tolerance = Proven((), nothing), nothing, 0.0

    def distances(self, Q: Array) -> Array:
        """Compute R (m,) at configurations (m, n) [m]."""
        return distances(self.arm, Q, self.mode)

    def distance(self, q: Array) -> float:
        """Compute R at one configuration (n,), by its polynomial where that has all digits [m]."""
        square = float(self.R2(q[None]).value[0])
        if square > NEAR_CENTRE:
            return float(np.sqrt(square * self.size))
        return float(self.distances(q[None])[0])

    def walk_from_ends(self, ends: Array) -> None:
        """Walk from singular configurations (e, n) at the ends of the wanted distances."""
        ends = ends[np.argsort(-self.distances(ends))]
        for end in ends:
            self.walk_both_ways(end)
        for end in ends:  # where the derivatives of the equations vanish no curve begins
            R = float(self.distances(end[None])[0])
            for away in BESIDE:
                missing = self.missing()
                beside = self._beside(end, away)
                if len(beside) and np.abs(missing - R).min(initial=np.inf) <= TOLERANCE:
                    self.walk_both_ways(beside[0])

    def walk_from_sample(self, sample: Array) -> None:
        """Walk from others (m, n), where walks from the ends do not suffice."""
        R, vain = self.distances(sample), 0
        self.tolerance *= COARSER
        while len(sample) and vain < IN_VAIN and len(missing := self.missing()):
            low, high = missing[np.argmax(missing[:, 1] - missing[:, 0])]
            self.walk_both_ways(sample[np.abs(R - self.rng.uniform(low, high)).argmin()])
            vain += bool(np.diff(self.missing()).sum() > ENOUGH * np.diff(missing).sum())

    def walk_both_ways(self, start: Array) -> None:
        """Walk from a start (n,) while wanted distances are missing; add what it proves."""
        missing = self.missing()
        if len(missing):
            R = float(self.distances(start[None])[0])
            low, high = missing[np.argmin(np.abs(missing - R).min(axis=1))]
            down, up = self.walk(start, -1.0, low), self.walk(start, 1.0, high)
            self.add(np.concatenate((down[::-1], up[1:])))
            if self._progress:
                left = np.diff(self.missing()).sum() / np.diff(self.wanted).sum()
                self._progress(1.0 - float(left))

    def missing(self) -> Array:
        """Return the wanted distances that are not proven yet, (k, 2)."""
        return without(self.wanted, self.proven.radii, self.tolerance)

    def _beside(self, end: Array, away: float) -> Array:
        """Return points on the set (m, n) some way from an end [rad], regular ones first."""
        turn = self.rng.normal(size=(DIRECTIONS, len(end)))
        turn *= away / np.linalg.norm(turn, axis=1, keepdims=True)
        tried = self.f.onto(np.clip(end + turn, self.f.low, self.f.high))
        near = np.linalg.norm(tried - end, axis=1) < 2.0 * away
        found = tried[near & (np.abs(self.f(tried).value).max(axis=1) < ON_SET)]
        sigma = np.linalg.svd(self.f(found, 1).gradient, compute_uv=False)[:, -1]
        return np.asarray(found[np.argsort(-sigma)])

    def add(self, chain: Array) -> None:
        """Add what a chain of points (m, n) on the set proves."""
        for points, error in tubes(self.f, chain) if len(chain) > 1 else ():
            R, off = self.distances(points), error * self.slope
            low, high = R.min() + off, R.max() - off
            more = merged([*self.proven.radii, np.array([low, high])])
            if (
                low < high
                and np.diff(more).sum() > np.diff(self.proven.radii).sum() + TOLERANCE
                and any(self._counts(points[i]) for i in (0, len(points) // 2, -1))
            ):
                self.proven = Proven((*self.proven.curves, points), more)

    def _counts(self, q: Array) -> bool:
        """Check whether the columns that the minors share are independent at q (n,)."""
        return not is_singular(self.arm, q, self.mode, self.shared)

    def walk(self, start: Array, sign: float, stop: float) -> Array:
        """Walk along the set to where R is larger (sign 1) or smaller (-1), points (m, n).

        It ends at `stop` [m], or where no step leads on.
        """
        q, R, stride = start, self.distance(start), STRIDE
        points = [q]
        while len(points) < MOST_STEPS and stride > LEAST_STRIDE and sign * (stop - R) > 0.0:
            tried = self.f.onto((q + stride * self._direction(q, sign))[None])
            there = self.distance(tried[0])
            on_set = np.abs(self.f(tried).value).max() < ON_SET
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
        slopes = self.f(q[None], 1).gradient
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
    return np.asarray(d - _inverse(J) @ (J @ d))
