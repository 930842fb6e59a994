"""Common roots as lines or triangles: of one polynomial of 2 or 3 angles, of two of 3 angles.

On the 2-torus contourpy finds lines on a grid, and their pieces are joined across the seams. On
the 3-torus a surface comes from the tetrahedra of a grid without seams. The curves where a second
polynomial vanishes on it come from the edges of its triangles along which that polynomial changes
its sign. Every point is then moved onto the exact set by Newton's method.

A grid is fine enough when no cell with equal signs at its corners holds a sign change inside: each
such cell is either certified free of roots by the bounds of the polynomial, or searched inside.
Where the signs at the corners of a square alternate, two lines pass through it: the sign at the
saddle point between them says which corners they part, however near to each other they come. Loops
of a curve of two polynomials that are smaller than a triangle may be missed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations, permutations, product
from typing import NamedTuple, cast

import numpy as np
import scipy

from spacearm.arrays import Array, Booleans, Integers
from spacearm.polynomial.newton import iterate, onto, polish
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.polynomial.univariate import wrap

FIRST_GRID = {2: 192, 3: 48}
LAST_GRID = {2: 3072, 3: 192}
#: How often an undecided cell is halved in the search for a missed piece. Pieces of the set smaller
#: than 2 pi / (grid 2^depth) may be missed: 0.03 degrees for lines, 2 degrees for surfaces.
SEARCH_DEPTH = {2: 6, 3: 2}
#: Where the grid begins in each angle [rad]: roots often lie at round angles.
OFFSET = 0.0123456789
#: Ends nearer than this on the torus are one point [rad]: both come from the same grid values.
SEWN = 1e-6


class Mesh(NamedTuple):
    """A triangle mesh on the torus.

    Attributes:
        vertices: (m, 3) angles in (-pi, pi].
        triangles: (t, 3) numbers of vertices; neighbours across the seam share them.
    """

    vertices: Array
    triangles: Integers


def lines(S: TrigPolynomial, resolution: float = 0.0) -> list[Array]:
    """Trace the zero set on the 2-torus, on grids that need not be finer than `resolution` [rad].

    Returns:
        Closed polylines (m, 2), angles continuous along each: the last point is the first one, up
        to whole turns.
    """
    import contourpy

    values, step = _grid(S, resolution)
    values = _parted(S.shifted(np.full(2, OFFSET)), values, step)
    contour = contourpy.contour_generator(z=np.pad(values, (0, 1), mode="wrap").T)
    pieces = cast("list[Array]", contour.lines(0.0))
    return [polish(S, chain) for chain in _sew([OFFSET + piece * step for piece in pieces])]


def surface(S: TrigPolynomial, resolution: float = 0.0) -> Mesh:
    """Triangulate the zero set on the 3-torus, on grids no finer than `resolution` [rad]."""
    found, triangles = rough_surface(S, resolution)
    return Mesh(wrap(polish(S, found)), triangles)


def rough_surface(S: TrigPolynomial, resolution: float = 0.0) -> Mesh:
    """Triangulate the zero set on the 3-torus as `surface`, without the last step.

    The vertices are found by linear interpolation between grid points: they are near the set, not
    on it.
    """
    values, step = _grid(S, resolution)
    found, triangles = _isosurface(values)
    return Mesh(wrap(OFFSET + found * step), triangles)


def connected(points: Array, edges: Integers) -> list[Array]:
    """Return the connected pieces of points (m, n), of which pairs (e, 2) are neighbours."""
    m, ends = len(points), (edges[:, 0], edges[:, 1])
    graph = scipy.sparse.csr_array((np.ones(len(edges)), ends), shape=(m, m))
    _, labels = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return [points[labels == label] for label in np.unique(labels)]


def _isosurface(values: Array) -> tuple[Array, Integers]:
    """Triangulate where a function on a grid without ends is zero.

    Each cell is divided into six tetrahedra about one diagonal, and the function taken as linear in
    each (Doi & Koide 1991, "marching tetrahedra"): the surface is closed and meets itself nowhere.

    Args:
        values: (N, N, N) the function.

    Returns:
        Points (m, 3) in steps of the grid, and triangles (t, 3) of their numbers.
    """
    above = values > 0.0
    ends = [np.roll(above, -along, axis=(0, 1, 2)) for along in EDGES]
    crossed = [np.flatnonzero(above != end) for end in ends]
    points: list[Array] = []
    for along, start in zip(EDGES, crossed, strict=True):
        first = np.stack(np.unravel_index(start, values.shape), axis=1)
        last = (first + along) % len(values)
        value, end = values.flat[start], values[tuple(last.T)]
        points.append(first + (value / (value - end))[:, None] * along)

    signs = above.astype(np.uint8)  # of the corners of a cell, one bit each
    for bit, end in enumerate(ends, start=1):
        signs |= end.astype(np.uint8) << np.uint8(bit)
    cells = np.flatnonzero((signs != 0) & (signs != 255))
    corner = np.stack(np.unravel_index(cells, values.shape), axis=1)
    bits = (signs.flat[cells][:, None] >> np.arange(8, dtype=np.uint8)) & 1
    counts = np.cumsum([0, *map(len, points)])
    numbers: dict[tuple[int, int], Integers] = {}  # of the points on the edges of each cell
    triangles: list[Integers] = []
    for corners in TETRAHEDRA:
        places = corners @ (4, 2, 1)
        for i, j in combinations(range(4), 2):
            edge = int(places[i]), int(places[j])
            if edge not in numbers:
                along = int(places[j] - places[i]) - 1
                first = (corner + corners[i]) % len(values)
                start = np.ravel_multi_index(tuple(first.T), values.shape)
                numbers[edge] = counts[along] + np.searchsorted(crossed[along], start)
        inside_of = bits[:, places] @ np.array((1, 2, 4, 8), dtype=np.uint8)
        for inside, faces in _CASES:
            there = np.flatnonzero(inside_of == sum(1 << i for i in inside))
            for face in faces:
                cut = [numbers[int(places[i]), int(places[j])][there] for i, j in face]
                triangles.append(np.stack(cut, axis=1))
    return np.concatenate(points), np.concatenate(triangles)


#: The edges of the tetrahedra that leave a grid point.
EDGES = np.array([along for along in product((0, 1), repeat=3) if any(along)])
#: Corners (4, 3) of the tetrahedra of a cell.
TETRAHEDRA = [
    np.array([np.isin(range(3), order[:i]) for i in range(4)], dtype=int)
    for order in permutations(range(3))
]


def _cases() -> Iterator[tuple[set[int], list[tuple[tuple[int, int], ...]]]]:
    """Yield the corners that may be above zero and the triangles, by the edges that they cut."""
    for count in (1, 2, 3):
        for inside in combinations(range(4), count):
            outside = [i for i in range(4) if i not in inside]
            cut = [(min(i, j), max(i, j)) for i in inside for j in outside]
            if count != 2:
                yield set(inside), [tuple(cut)]
            else:  # a quadrangle, its corners ik, il, jl, jk
                yield set(inside), [(cut[0], cut[1], cut[3]), (cut[0], cut[3], cut[2])]


_CASES = tuple(_cases())


def _grid(S: TrigPolynomial, resolution: float) -> tuple[Array, float]:
    """Sample S on a grid that shows every piece of the zero set; return the values and its step."""
    N = FIRST_GRID[S.n]
    S = S.shifted(np.full(S.n, OFFSET))
    while True:
        values, step = S.grid((N,) * S.n), 2.0 * np.pi / N
        if LAST_GRID[S.n] <= N or step <= resolution or not _hides_something(S, values, step):
            return values, step
        N *= 2


def _hides_something(S: TrigPolynomial, values: Array, step: float) -> bool:
    """Check whether a cell with equal signs at its corners holds a point of the other sign."""
    above = values > 0.0
    axes = tuple(range(S.n))
    corners = [np.roll(above, shift, axis=axes) for shift in product((0, -1), repeat=S.n)]
    every, none = np.logical_and.reduce(corners), ~np.logical_or.reduce(corners)
    half = np.full(S.n, step / 2.0)
    at_centres = S.shifted(half)
    slopes = [derivative.grid(values.shape) for derivative in at_centres.derivatives]
    middle = at_centres.grid(values.shape)
    first = sum(np.abs(slope) for slope in slopes) * (step / 2.0)
    change = np.minimum(first + 0.5 * half @ S.curvature @ half, S.lipschitz @ half)
    undecided = (every | none) & (np.abs(middle) <= change + at_centres.noise())
    if ((middle > 0.0) & none & undecided).any() or ((middle < 0.0) & every & undecided).any():
        return True
    centres = (np.argwhere(undecided) + 0.5) * step
    sign = np.where(every[undecided], 1.0, -1.0)
    offsets = np.array(list(product((-0.5, 0.5), repeat=S.n)))
    for depth in range(2, SEARCH_DEPTH[S.n] + 1):
        centres = (centres[:, None] + half * offsets).reshape(-1, S.n)
        sign = sign.repeat(len(offsets))
        half = half / 2.0
        if (S(centres) * sign < 0.0).any():
            return True
        if depth < SEARCH_DEPTH[S.n]:
            undecided = S.sign(centres, np.broadcast_to(half, centres.shape)) == 0
            centres, sign = centres[undecided], sign[undecided]
    return False


def _parted(S: TrigPolynomial, values: Array, step: float) -> Array:
    """Return values (N, N) whose mean in a square has the sign of the saddle there.

    By that mean contourpy decides how lines pass through a square whose corners alternate in sign.
    """
    signs = np.sign(values)
    right, up = np.roll(signs, -1, axis=0), np.roll(signs, -1, axis=1)
    across = np.roll(right, -1, axis=1)
    cells = np.argwhere((signs * across > 0.0) & (right * up > 0.0) & (signs * right < 0.0))
    values = values.copy()
    for cell in cells:
        middle = (cell + 0.5) * step
        saddle = iterate(lambda q: (S.gradient(q), S.hessian(q)), middle, 2, step)
        inside = bool(np.abs(saddle - middle).max() <= step)
        sign = np.sign(S(saddle if inside else middle))
        corners = [tuple((cell + corner) % len(values)) for corner in product((0, 1), repeat=2)]
        mine = [at for at in corners if values[at] * sign > 0.0]
        others = sum(abs(values[at]) for at in corners if at not in mine)
        if sum(abs(values[at]) for at in mine) <= others:
            for at in mine:
                values[at] = sign * others
    return values


def _sew(pieces: list[Array]) -> list[Array]:
    """Join pieces that end on a seam of the torus where another begins."""
    whole = [piece for piece in pieces if np.allclose(piece[0], piece[-1], atol=1e-9)]
    loose = [piece for piece in pieces if not np.allclose(piece[0], piece[-1], atol=1e-9)]
    while loose:
        chain = loose.pop()
        while loose and _gap(chain[-1], chain[0]) > SEWN:
            ends = [(i, flip) for i in range(len(loose)) for flip in (False, True)]
            gaps = [_gap(chain[-1], loose[i][-1 if flip else 0]) for i, flip in ends]
            i, flip = ends[int(np.argmin(gaps))]
            if min(gaps) > SEWN:
                break
            piece = loose.pop(i)[:: -1 if flip else 1]
            turn = chain[-1] - piece[0]
            chain = np.vstack((chain, piece[1:] + 2.0 * np.pi * np.round(turn / (2.0 * np.pi))))
        whole.append(chain)
    return whole


def _gap(a: Array, b: Array) -> float:
    return float(np.abs(wrap(a - b)).max())


def curves(
    polynomials: Sequence[TrigPolynomial],
    counts: Callable[[Array], Booleans],
    resolution: float = 0.0,
) -> list[Array]:
    """Trace the common roots.

    Args:
        polynomials: One or two.
        counts: Says which of the common roots (m, 3) of two polynomials count, (m,).
        resolution: Grids need not be finer than this [rad].

    Returns:
        Polylines (m, 2) or (m, 3), angles continuous along each.
    """
    if len(polynomials) == 1:
        return lines(polynomials[0], resolution)
    f, g = polynomials
    mesh = surface(f, resolution)
    if not len(mesh.triangles):
        return []
    positive = g(mesh.vertices) > 0.0
    edges = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    crossed = positive[edges[..., 0]] != positive[edges[..., 1]]
    cut = crossed.any(axis=1)  # two edges of each such triangle are crossed
    pairs = edges[cut][crossed[cut]]
    unique, number = np.unique(pairs, axis=0, return_inverse=True)
    ends = mesh.vertices[unique]
    middle = ends[:, 0] + 0.5 * wrap(ends[:, 1] - ends[:, 0])
    points = onto(polynomials, middle)
    links = number.reshape(-1, 2)
    links = links[counts(points)[links].all(axis=1)]
    return [np.unwrap(points[chain], axis=0) for chain in _chains(links)]


def _chains(links: Integers) -> list[list[int]]:
    """Join pairs of numbers to chains; a closed one ends where it begins."""
    neighbours: dict[int, list[int]] = {}
    for a, b in links.tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    chains = []
    ends_first = sorted(neighbours, key=lambda i: len(neighbours[i]))
    for start in ends_first:
        chain = [start]
        while neighbours[chain[-1]]:
            here = chain[-1]
            after = neighbours[here].pop()
            neighbours[after].remove(here)
            chain.append(after)
        if len(chain) > 1:
            chains.append(chain)
    return chains
