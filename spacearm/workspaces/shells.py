"""Shells: ranges of the tip's distance from the system CM at singular configurations.

R^2 is a trigonometric polynomial like S, so that each shell, equations (44), (46) and (47), is the
range of one polynomial on the roots of another, over the torus or within the joint limits. Shells
of larger arms come from a sample of singular configurations, each bound then optimised.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from spacearm.arrays import Array, named
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.polynomial.branch_and_bound import enclose
from spacearm.polynomial.level_set import connected
from spacearm.polynomial.newton import bounded_extreme, onto, polish
from spacearm.polynomial.trig import NOISE, TrigPolynomial
from spacearm.singularities.exact_set import ExactSet, extremes
from spacearm.singularities.polynomials import distances, radius_squared
from spacearm.singularities.sets import singular_set
from spacearm.workspaces.extent import Box

#: Number of best configurations of a sample from which each bound is searched.
STARTS = 12
#: Distance from the end of the range of R below which a bound is that end [m].
AT_AN_END = 1e-9
#: Accuracy of proven bounds [m].
TOLERANCE = 1e-9
#: Largest number of missing shells that a proof may find.
MOST_ADDED = 20
#: Values of the joints that S does not depend on, tried with an isolated root.
SPREAD = 400

#: Share of the range of R, empty of a large sample, that separates two shells.
GAP_SHARE = 1 / 300
#: Share of the scale of S below which an end of the reachable workspace is singular.
SINGULAR_END = 1e-7
#: Lines that are drawn at a time.
BATCH = 4096
#: Distance by which a piece may stand out of a shell that counts as holding it [m].
NEGLIGIBLE = 1e-9


class Shell(NamedTuple):
    """Range of the tip's distance from the system CM on one piece of the singular set.

    Attributes:
        radius: (2,) least and largest distance [m].
        at: (2, n) configurations at which they are attained.
        component: Number of the piece: without joint limits, for arms with up to three relevant
            joints, that of the connected component. Components that come within 4 degrees of each
            other may count as one.
    """

    radius: Array
    at: Array
    component: int

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data."""
        return named(self)


def exact_set(arm: SpaceArm, mode: BaseMode) -> ExactSet | None:
    """Return the singular set of revolute joints if polynomials give it joint by joint, or None.

    Raises:
        UnsupportedError: The arm can never do its task.
    """
    if arm.slides.any() or arm.coupling is not None:
        return None
    found = singular_set(arm, mode=mode)
    return found if isinstance(found, ExactSet) else None


class ShellSearch:
    """A search for the shells of an arm within a box of its joints.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        box: Range of the joints.
        progress: Called as progress(share, 1) before each search for a bound, two times `STARTS`
            a shell, as many as are known.
    """

    def __init__(
        self,
        arm: SpaceArm,
        mode: BaseMode,
        box: Box,
        progress: Callable[[float, float], object] | None = None,
    ) -> None:
        self.arm, self.mode, self.box = arm, mode, box
        self.R2 = radius_squared(arm, mode=mode)
        self._progress, self._done, self._total, self._share = progress, 0, 4 * STARTS, 0.0

    def about(
        self,
        equations: Sequence[TrigPolynomial],
        points: Array,
        number: int = 0,
        within: tuple[float, float] = (-np.inf, np.inf),
        counts: Callable[[Array], bool] = lambda _: True,
    ) -> Shell:
        """Compute the shell of a piece of the set with points (m, n) on it.

        Args:
            equations: Whose common roots the set is; of the whole box if there are none.
            points: On the piece.
            number: Of the piece.
            within: R is always within this range [m]: where a search reaches its end, the others
                are left out.
            counts: Says which roots (n,) are singular.
        """
        order = np.argsort(self.R2(points))
        limits = (self.box.low, self.box.high) if self.box.limited else None
        ends = []
        for sign, best in ((1.0, order[:STARTS]), (-1.0, order[: -STARTS - 1 : -1])):
            found, R = [], list[float]()
            for i in best:
                if self._progress:
                    self._share = max(self._share, min(self._done / self._total, 1.0))
                    self._progress(self._share, 1.0)
                self._done += 1
                q = bounded_extreme(self.R2, equations, points[i], sign, limits)
                found.append(q if counts(q) else points[i])
                R.append(float(distances(self.arm, found[-1][None], self.mode)[0]))
                if (R[-1] - within[0] if sign > 0.0 else within[1] - R[-1]) < AT_AN_END:
                    break
            ends.append(found[int(np.argmin(sign * np.array(R)))])
        at = np.array(ends)
        return Shell(distances(self.arm, at, self.mode), at, number)

    def proven(
        self,
        equations: Sequence[TrigPolynomial],
        shells: list[Shell],
        counts: Callable[[Array], bool] = lambda _: True,
    ) -> tuple[list[Shell], float]:
        """Add shells until all common roots are proven to be in one.

        Args:
            equations: Whose common roots the set is; the whole box if there are none.
            shells: The shells that are known.
            counts: Says which roots (n,) are singular.

        Returns:
            The shells, and the largest distance by which R may be outside of all of them [m].
        """
        for _ in range(MOST_ADDED):
            intervals = merged([shell.radius for shell in shells])
            ends = intervals[intervals > TOLERANCE]
            to_R = 2.0 * float(ends.min()) if len(ends) else 1.0
            squares = np.where(intervals <= TOLERANCE, -1.0, intervals**2)
            accuracy = to_R * TOLERANCE
            proof = enclose(self.R2, equations, squares, self.box.low, self.box.high, accuracy)
            if proof.outside is None:
                return shells, TOLERANCE
            root = self.box.fold(_moved_onto(equations, proof.outside))
            R = float(distances(self.arm, root[None], self.mode)[0])
            known = any(low - TOLERANCE <= R <= high + TOLERANCE for low, high in intervals)
            is_root = all(abs(S(root)) <= NOISE * S.scale for S in equations)
            if known or not self.box.holds(root) or not is_root or not counts(root):
                break
            shells = [*shells, self.about(equations, root[None], len(shells), counts=counts)]
        return shells, proof.gap / to_R

    def exact(self, found: ExactSet, resolution: float = 0.0) -> list[Shell]:
        """Compute a shell for each connected piece of a set of one or two dimensions.

        Grids for surfaces need not be finer than `resolution` [rad].
        """
        if not found.relevant:
            return []  # S is a constant: nothing is singular
        if not self.box.limited:
            pieces = found.rough_pieces(resolution)
            ends = [extremes(self.arm, self.mode, found.S, points) for points in pieces]
            return [Shell(distances(self.arm, at, self.mode), at, i) for i, at in enumerate(ends)]
        pieces = [*_clipped(found, self.box, resolution), *_ends_on_faces(found, self.box)]
        return [self.about((found.S,), piece, i) for i, piece in enumerate(pieces)]

    def sampled(
        self,
        found: ExactSet,
        effort: int,
        rng: np.random.Generator,
        ends: Array,
        keep: Callable[[list[Shell]], object],
    ) -> list[Shell]:
        """Find shells from a sample of `effort` singular configurations, each bound then optimised.

        Where R is stationary the tip has lost the direction of R: the `ends` (2, n) of the
        reachable workspace are singular, unless limits or R = 0 make them regular, and belong to
        the first and the last piece of the sample. A sample that is sparse falls into more pieces
        than there are shells: those that lie within the shell of a larger one are not searched.

        `keep` is given the shells as they are known so far, at first those of the sample.
        """
        R2, equations = self.R2, found.triangle.equations
        low, high = distances(self.arm, ends, self.mode)
        values = [np.abs(f(ends)) / f.scale for f in equations]
        stationary = ends[np.max(values, axis=0) <= SINGULAR_END]
        Q = members(found, self.box, effort, rng)
        if not len(Q):
            return []
        Q = Q[np.argsort(R2(Q))]
        R = np.sqrt(np.maximum(R2(Q), 0.0))
        parted = np.flatnonzero(np.diff(R) > GAP_SHARE * (R[-1] - R[0]) + 1e-9) + 1
        pieces = np.split(Q, parted)
        for end in stationary:
            i = 0 if R2(end[None])[0] < R2(Q[:1])[0] else -1
            pieces[i] = np.vstack((pieces[i], end))

        def singular(q: Array) -> bool:
            return bool(found.are_singular(q[None])[0])

        shells, left = list[Shell](), list[Shell]()
        for i in sorted(range(len(pieces)), key=lambda i: -len(pieces[i])):
            squares = R2(pieces[i])
            at = [int(squares.argmin()), int(squares.argmax())]
            left.append(Shell(np.sqrt(np.maximum(squares[at], 0.0)), pieces[i][at], i))
        while left:
            keep([*shells, *left])
            self._total = self._done + 2 * STARTS * len(left)
            i = left[0].component
            within = float(low), float(high)
            shells.append(self.about(equations, pieces[i], i, within, singular))
            least, most = shells[-1].radius + np.array((-NEGLIGIBLE, NEGLIGIBLE))
            left = [part for part in left[1:] if part.radius[0] < least or part.radius[1] > most]
        return shells


def _moved_onto(equations: Sequence[TrigPolynomial], point: Array) -> Array:
    """Move a point (n,) onto the common roots of equations, if there are any."""
    if len(equations) > 1:
        return onto(equations, point[None])[0]
    return polish(equations[0], point[None])[0] if equations else point


def merged(ranges: list[Array]) -> Array:
    """Return the union (k, 2) of ranges, sorted and disjoint."""
    union: list[list[float]] = []
    for low, high in sorted(map(tuple, ranges)):
        if union and low <= union[-1][1]:
            union[-1][1] = max(union[-1][1], high)
        else:
            union.append([low, high])
    return np.array(union, dtype=np.float64).reshape(-1, 2)


def without(ranges: Array, parts: Array, tolerance: float = 0.0) -> Array:
    """Return what sorted, disjoint parts (m, 2) leave of such ranges (k, 2), wider than so much."""
    left: list[Array] = [np.empty((0, 2))]
    for low, high in ranges:
        inner = parts[(parts[:, 1] > low) & (parts[:, 0] < high)]
        edges = np.concatenate(([low], inner.ravel(), [high])).reshape(-1, 2)
        left.append(edges[edges[:, 1] - edges[:, 0] > tolerance])
    return np.concatenate(left)


def _clipped(found: ExactSet, box: Box, resolution: float) -> list[Array]:
    """Return points (m, n) on each connected piece of a curve or surface within the box.

    Joints that S does not depend on are uniform in the box.
    """
    if found.dimension == 2:
        mesh = found.surface(resolution=resolution)
        edges = np.concatenate([mesh.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
        points: Array = np.zeros((len(mesh.vertices), found.arm.n))
        points[:, list(found.relevant)] = mesh.vertices
        pieces = [(points, edges)]
    else:
        pieces = []
        for piece in found.pieces:
            points = piece.repeat(SPREAD if len(piece) == 1 else 1, axis=0)
            number = np.arange(len(points))
            pieces.append((points, np.stack((number[:-1], number[1:]), axis=1)))
    rng, clipped = np.random.default_rng(0), list[Array]()
    for points, edges in pieces:
        for j in set(range(found.arm.n)) - set(found.relevant):
            points[:, j] = rng.uniform(box.low[j], box.high[j], len(points))
        Q = box.fold(points)
        inside = box.holds(Q)
        number = np.cumsum(inside) - 1
        clipped += connected(Q[inside], number[edges[inside[edges].all(axis=1)]])
    return clipped


def _ends_on_faces(found: ExactSet, box: Box) -> list[Array]:
    """Return where curves meet the faces of the box: short pieces lie between points of a curve."""
    if found.dimension != 1:
        return []
    middle = 0.5 * (box.low + box.high)
    ends: list[Array] = []
    for j, other in (found.relevant, found.relevant[::-1]):
        for limit in (box.low[j], box.high[j]):
            q = middle.copy()
            q[j] = limit
            for angle in found.roots(q, other).angles:
                end = q.copy()
                end[other] = angle
                end[other] = box.fold(end)[other]
                if box.holds(end):
                    ends.append(end[None])
    return ends


def members(found: ExactSet, box: Box, m: int, rng: np.random.Generator) -> Array:
    """Return some of the singular configurations in the box, (r, n): of m in all, or on m lines.

    Within limits the joints that do not follow from others are drawn there: of the whole torus a
    box of six joints may be a millionth.
    """
    kept, lines, met = [np.empty((0, found.arm.n))], 0, 0
    while lines < m and met < m:
        drawn = rng.uniform(box.low, box.high, (min(BATCH, m - lines), found.arm.n))
        Q = box.fold(found.having(drawn))
        kept.append(Q[box.holds(Q)])
        lines, met = lines + len(drawn), met + len(Q)
    return np.concatenate(kept)
