"""Zero set of a trigonometric polynomial on the 2- or 3-torus, as lines or triangles.

contourpy and scikit-image find it on a grid. The pieces are then joined across the seams of the
torus and every point is moved onto the exact set by Newton's method. A grid is fine enough when no
cell with equal signs at its corners holds a sign change inside: each such cell is either certified
free of roots by the bounds of the polynomial, or searched inside.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple, cast

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.polynomial.newton import polish
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.polynomial.univariate import wrap

FIRST_GRID = {2: 192, 3: 48}
LAST_GRID = {2: 3072, 3: 192}
SEARCH_DEPTH = {2: 6, 3: 2}
"""How often an undecided cell is halved in the search for a missed piece. Pieces of the set smaller
than 2 pi / (grid 2^depth) may be missed: 0.03 degrees for lines, 2 degrees for surfaces."""
OFFSET = 0.0123456789
"""Where the grid begins in each angle [rad]: roots often lie at round angles."""
SEWN = 1e-6
"""Ends nearer than this on the torus are one point [rad]: both come from the same grid values."""


class Mesh(NamedTuple):
    """A triangle mesh on the torus.

    Attributes:
        vertices: (m, 3) angles in (-pi, pi].
        triangles: (t, 3) numbers of vertices; neighbours across the seam share them.
    """

    vertices: Array
    triangles: npt.NDArray[np.int_]


def lines(S: TrigPolynomial) -> list[Array]:
    """Trace the zero set on the 2-torus.

    Returns:
        Closed polylines (m, 2), angles continuous along each: the last point is the first one, up
        to whole turns.
    """
    import contourpy

    values, step = _grid(S)
    contour = contourpy.contour_generator(z=_periodic(values).T)
    pieces = cast("list[Array]", contour.lines(0.0))
    return [polish(S, chain) for chain in _sew([OFFSET + piece * step for piece in pieces])]


def surface(S: TrigPolynomial) -> Mesh:
    """Triangulate the zero set on the 3-torus."""
    from skimage.measure import marching_cubes  # slow to import

    values, step = _grid(S)
    if (values > 0.0).all() or (values < 0.0).all():
        return Mesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int_))
    found, triangles, *_ = marching_cubes(_periodic(values), 0.0)
    on_seam = np.round(found * step / (2.0 * np.pi), 6) % 1.0  # both sides of the seam are one
    _, first, same = np.unique(on_seam, axis=0, return_index=True, return_inverse=True)
    merged = same.reshape(-1)[triangles]
    proper = (merged != np.roll(merged, 1, axis=1)).all(axis=1)
    return Mesh(wrap(polish(S, OFFSET + found[first] * step)), merged[proper])


def _grid(S: TrigPolynomial) -> tuple[Array, float]:
    """Sample S on a grid that shows every piece of the zero set; return the values and its step."""
    N = FIRST_GRID[S.n]
    S = S.shifted(np.full(S.n, OFFSET))
    while True:
        values, step = S.grid((N,) * S.n), 2.0 * np.pi / N
        if LAST_GRID[S.n] <= N or not _hides_something(S, values, step):
            return values, step
        N *= 2


def _hides_something(S: TrigPolynomial, values: Array, step: float) -> bool:
    """Check whether a cell with equal signs at its corners holds a point of the other sign."""
    signs = np.sign(values)
    corners = [
        np.roll(signs, shift, axis=tuple(range(S.n))) for shift in product((0, -1), repeat=S.n)
    ]
    equal = np.abs(sum(corners)) == len(corners)
    centres = (np.argwhere(equal) + 0.5) * step
    sign = signs[equal]
    half = step / 2.0
    offsets = np.array(list(product((-0.5, 0.5), repeat=S.n)))
    for _ in range(SEARCH_DEPTH[S.n]):
        undecided = S.sign(centres, np.full_like(centres, half)) == 0
        centres, sign = centres[undecided], sign[undecided]
        if (S(centres) * sign < 0.0).any():
            return True
        centres = (centres[:, None] + half * offsets).reshape(-1, S.n)
        sign = sign.repeat(len(offsets))
        half /= 2.0
    return False


def _periodic(values: Array) -> Array:
    """Return the grid with its first layers repeated at the end."""
    return np.pad(values, [(0, 1)] * values.ndim, mode="wrap")


def _sew(pieces: list[Array]) -> list[Array]:
    """Join pieces that end on a seam of the torus where another begins."""
    whole = [piece for piece in pieces if np.allclose(piece[0], piece[-1], atol=1e-9)]
    loose = [piece for piece in pieces if not np.allclose(piece[0], piece[-1], atol=1e-9)]
    while loose:
        chain = loose.pop()
        while loose and not _meet(chain[-1], chain[0]):
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


def _meet(a: Array, b: Array) -> bool:
    return _gap(a, b) <= SEWN
