"""Proof that singular configurations at two distances are joined by singular configurations.

The singular set is explicit where equations m_1 = ... = m_L = 0 form a triangle: each has degree one
in a joint e_i of its own, which the equations before it do not contain. The other joints p are
free, and each e_i follows with a choice of two roots. A path of p along which no two roots meet is
a curve in the set. Its proof needs no exact roots: about points of the curve lie boxes, of half
widths delta in the joints e, joined to a tube. If along the tube each m_i has opposite signs on the
two faces e_i +- delta_i, then (Poincare-Miranda) a connected set of common roots passes through
the tube from its first end to its last, and the distance R of the tip from the system CM takes
every value between those at the ends on it.

Between two boxes the values are at least those at the corners, less an eighth of the second
derivatives along the edges, which the coefficients bound; rounding is counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.polynomial.univariate import wrap

NODES = 240
"""Random configurations of the set through which a path may go, for each choice of roots."""
NEIGHBOURS = 12
"""Nearest nodes that each is joined to."""
STEPS = 24
"""Points at which a straight way between nodes is looked at before it is proven."""
MOST_POINTS = 40_000
"""Largest number of boxes of a tube."""
HALVINGS = 40
"""How often the distance between boxes is halved."""
ABOVE_NOISE = 100.0
"""How much larger than rounding values on the smallest boxes are."""
TRIES = 8
"""Paths that are tried."""

Branch = tuple[int, ...]


@dataclass(frozen=True)
class Triangle:
    """Equations of which each gives one joint.

    Attributes:
        equations: (m_i, e_i) the polynomials and the joints that they give, of degree 1 in them.
    """

    equations: tuple[tuple[TrigPolynomial, int], ...]

    @cached_property
    def given(self) -> list[int]:
        """The joints that the equations give."""
        return [joint for _, joint in self.equations]

    @cached_property
    def free(self) -> list[int]:
        """The other joints that the equations contain."""
        return [
            j
            for j in range(self.equations[0][0].n)
            if j not in self.given and any(S.degrees[j] for S, _ in self.equations)
        ]

    def solve(self, Q: Array, branch: Branch) -> Array:
        """Return configurations (m, n) with the given joints replaced; NaN where no root is."""
        Q = Q.copy()
        for (S, joint), root in zip(self.equations, branch, strict=True):
            known = ~np.isnan(Q).any(axis=1)
            Q[~known] = np.nan
            if known.any():
                Q[known, joint] = S.roots_along(Q[known], joint)[:, root]
        return Q

    def branches(self) -> list[Branch]:
        """Return all choices of roots."""
        return list(product((0, 1), repeat=len(self.equations)))

    def slopes(self, Q: Array) -> Array:
        """Return dm_i/de_i over the scale of m_i at configurations (m, n), as (m, L)."""
        return np.stack(
            [S.derivatives[j](Q) / S.scale for S, j in self.equations], axis=1
        )  # fmt: skip


@dataclass(frozen=True)
class Tube:
    """Boxes about a curve in the singular set that prove that it exists.

    Attributes:
        points: (m, n) the curve, angles continuous along it.
        half: (m, L) half widths of the boxes in the joints that the equations give [rad].
    """

    points: Array
    half: Array


def join(
    triangle: Triangle, start: Array, end: Array, branch: Branch, rng: np.random.Generator
) -> Tube | None:
    """Find and prove a curve in the set between two of its configurations, or return None.

    Args:
        triangle: The equations.
        start: (n,) configuration of the set.
        end: (n,) another.
        branch: The roots that both have.
        rng: Random numbers for the nodes.
    """
    from scipy.sparse import csr_array  # slow to import
    from scipy.sparse.csgraph import dijkstra

    nodes = np.vstack((start, end, _nodes(triangle, branch, rng, len(start))))
    pairs = _neighbours(nodes[:, triangle.free])
    clear = _clearance(triangle, branch, nodes, pairs)
    possible = clear > 0.0
    pairs, clear = pairs[possible], clear[possible]
    length = np.linalg.norm(_offset(nodes, pairs)[:, triangle.free], axis=1)
    cost = length * (1.0 + 0.01 / np.maximum(clear, 1e-6))
    for _ in range(TRIES):
        m = len(nodes)
        graph = csr_array((cost, (pairs[:, 0], pairs[:, 1])), shape=(m, m))
        _, before = dijkstra(graph, directed=False, indices=0, return_predecessors=True)
        way = [1]
        while way[-1] != 0:
            if before[way[-1]] < 0:
                return None
            way.append(int(before[way[-1]]))
        steps = np.array(list(zip(way[:0:-1], way[-2::-1], strict=True)))
        corners = nodes[0] + np.vstack((np.zeros(nodes.shape[1]), np.cumsum(_offset(nodes, steps), 0)))
        tube, failed = _tube(triangle, branch, corners)
        if tube is not None:
            return tube
        bad = set(map(int, steps[failed])) if failed is not None else set()
        keep = np.array([set(map(int, pair)) != bad for pair in pairs])
        pairs, cost = pairs[keep], cost[keep]
    return None


def _nodes(triangle: Triangle, branch: Branch, rng: np.random.Generator, n: int) -> Array:
    """Draw configurations of the set, joints that do not matter at zero."""
    Q = np.zeros((8 * NODES, n))
    Q[:, triangle.free] = rng.uniform(-np.pi, np.pi, (len(Q), len(triangle.free)))
    Q = triangle.solve(Q, branch)
    return Q[~np.isnan(Q).any(axis=1)][:NODES]


def _neighbours(p: Array) -> npt.NDArray[np.int_]:
    """Return pairs (e, 2) of near points on the torus; the first two are joined to more."""
    pairs = set()
    distance = np.linalg.norm(wrap(p[:, None] - p), axis=2)
    for i, near in enumerate(np.argsort(distance, axis=1)):
        for j in near[1 : 1 + (NEIGHBOURS if i > 1 else 8 * NEIGHBOURS)]:
            pairs.add((min(i, int(j)), max(i, int(j))))
    return np.array(sorted(pairs))


def _offset(nodes: Array, pairs: npt.NDArray[np.int_]) -> Array:
    """Return the shortest motions (e, n) between nodes; given joints turn as the roots do."""
    return wrap(nodes[pairs[:, 1]] - nodes[pairs[:, 0]])


def _clearance(
    triangle: Triangle, branch: Branch, nodes: Array, pairs: npt.NDArray[np.int_]
) -> Array:
    """Return the least slope, of all equations, on straight ways of the free joints (e,).

    Zero where a root is lost on the way. The slopes at the ends, which may be singular points of
    the set itself, do not count.
    """
    t = np.linspace(0.0, 1.0, STEPS + 1)[:-1] + 0.5 / STEPS
    offset = _offset(nodes, pairs)
    Q = nodes[pairs[:, 0]][:, None] + t[:, None] * offset[:, None]
    Q = triangle.solve(Q.reshape(-1, nodes.shape[1]), branch)
    lost = np.isnan(Q).any(axis=1)
    slopes = np.abs(triangle.slopes(np.where(lost[:, None], 0.0, Q))).min(axis=1)
    return np.where(lost, 0.0, slopes).reshape(len(pairs), STEPS).min(axis=1)


def _tube(triangle: Triangle, branch: Branch, corners: Array) -> tuple[Tube | None, int | None]:
    """Put boxes along straight ways of the free joints until all are joined.

    Returns:
        The tube, or None and the number of the way on which it fails.
    """
    s = np.arange(len(corners), dtype=np.float64)
    s = np.unique(np.concatenate([s[:-1, None] + np.linspace(0, 1, STEPS + 1), s[1:, None]], 1))
    points, half, values = _boxes(triangle, branch, corners, s)
    for _ in range(HALVINGS):
        lost = np.isnan(points).any(axis=1)
        if lost.any():
            return None, int(min(s[lost][0], len(corners) - 2))
        points = np.unwrap(points, axis=0)
        open_ = ~_joined(triangle, points, half, values)
        if not open_.any():
            return Tube(points, half), None
        worst = int(s[:-1][open_][0])
        if len(s) + open_.sum() > MOST_POINTS or np.diff(s)[open_].min() < 1e-9:
            return None, worst
        new = 0.5 * (s[:-1] + s[1:])[open_]
        order = np.argsort(np.concatenate((s, new)))
        more = _boxes(triangle, branch, corners, new)
        s = np.concatenate((s, new))[order]
        points, half, values = (
            np.concatenate(both)[order]
            for both in zip((points, half, values), more, strict=True)
        )
    return None, worst


def _boxes(
    triangle: Triangle, branch: Branch, corners: Array, s: Array
) -> tuple[Array, Array, Array]:
    """Choose boxes about the curve at positions s (m,).

    Returns:
        (m, n) their centres, (m, L) half widths, and (m, L) the least value on the faces over the
        scale, negative where a sign is not what it must be.
    """
    i = np.minimum(s.astype(np.int_), len(corners) - 2)
    Q = corners[i] + (s - i)[:, None] * (corners[i + 1] - corners[i])
    centre = triangle.solve(Q, branch)
    sound = np.where(np.isnan(centre), 0.0, centre)
    to_end = np.minimum(s, len(corners) - 1 - s)
    slopes = triangle.slopes(sound)
    signs, slopes = np.sign(slopes), np.abs(slopes)
    noise = max(S.noise(2.0 * np.pi) / S.scale for S, _ in triangle.equations)
    least = ABOVE_NOISE * noise / np.maximum(slopes.min(axis=1), ABOVE_NOISE * noise)
    widest = np.clip(0.25 * to_end, least, 0.1)
    half = np.empty_like(slopes)
    best = np.full(slopes.shape, -np.inf)
    for width in np.geomspace(1.0, 1e-4, 7):
        tried = _widths(triangle, sound, slopes, width * widest)
        values = _faces(triangle, sound, tried, signs)
        better = (values > best).all(axis=1) | ((best <= 0.0).any(axis=1) & (values > 0).all(axis=1))
        half[better], best[better] = tried[better], values[better]
    return centre, half, best


def _widths(triangle: Triangle, Q: Array, slopes: Array, last: Array) -> Array:
    """Return half widths (m, L) that shrink from the last equation to the first."""
    half = np.empty_like(slopes)
    half[:, -1] = last
    for i in range(len(triangle.equations) - 1, 0, -1):
        S, _ = triangle.equations[i]
        across = np.abs(S.derivatives[triangle.equations[i - 1][1]](Q)) / S.scale
        half[:, i - 1] = half[:, i] * np.minimum(1.0, 0.3 * slopes[:, i] / np.maximum(across, 1e-300))
    return half


def _faces(triangle: Triangle, Q: Array, half: Array, sign: Array) -> Array:
    """Return the least values (m, L) of each equation at the corners of its faces, over scale."""
    least = np.full(half.shape, np.inf)
    for i, (S, _) in enumerate(triangle.equations):
        for side in product((-1.0, 1.0), repeat=i + 1):
            corner = Q.copy()
            for j, s in enumerate(side):
                corner[:, triangle.given[j]] += s * half[:, j]
            value = side[-1] * sign[:, i] * S(corner) / S.scale
            least[:, i] = np.minimum(least[:, i], value)
    return least


def _joined(triangle: Triangle, points: Array, half: Array, values: Array) -> npt.NDArray[np.bool_]:
    """Check which neighbouring boxes are joined: signs hold on the faces between them (m - 1,)."""
    step = np.abs(np.diff(points, axis=0))
    wide = np.maximum(half[:-1], half[1:])
    step[:, triangle.given] += np.abs(np.diff(half, axis=0))
    largest = float(np.abs(points).max() + half.max())
    joined = np.ones(len(step), dtype=bool)
    for i, (S, _) in enumerate(triangle.equations):
        B = S.curvature / S.scale
        sag = np.einsum("mi,ij,mj->m", step, B, step)
        for j in range(i):
            sag = sag + B[triangle.given[j], triangle.given[j]] * (2.0 * wide[:, j]) ** 2
        least = np.minimum(values[:-1, i], values[1:, i])
        joined &= least > sag / 8.0 * (1.0 + 1e-9) + S.noise(largest) / S.scale
    return joined
