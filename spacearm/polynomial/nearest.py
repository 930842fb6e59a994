"""The root of a trigonometric polynomial that is nearest to a point of the torus.

The polynomial is shifted so that the point is the origin.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.polynomial.newton import HalfSquare, stationary
from spacearm.polynomial.trig import NOISE, TrigPolynomial
from spacearm.polynomial.univariate import wrap

GAP = 1e-4
"""Branch and bound proves that no root is nearer than the one found by more than this [rad]; the
one found is exact to rounding."""
GLOBAL_DIMENSION = 3
"""Up to this many joints the nearest root is proven."""
STARTS = 256
"""Configurations about the point from which roots are sought."""
STRIDE = 0.5
"""Longest step of Newton's method [rad]."""


def nearest_root(S: TrigPolynomial, q: Array, relevant: tuple[int, ...]) -> tuple[Array, float]:
    """Find the root nearest to q (n,) and its distance [rad]; see `SingularSet.nearest`.

    Raises:
        NoSolutionError: S has no root at all (proven for up to three relevant joints).
    """
    others = {j: q[j] for j in range(S.n) if j not in relevant}
    reduced = S.fix(others) if others else S
    centred = reduced.shifted(q[list(relevant)])
    best = _search(centred)
    if len(relevant) <= GLOBAL_DIMENSION:
        best = _branch_and_bound(centred, best)
    if best is None:
        raise NoSolutionError("no singular configuration was found")
    nearest = q.copy()
    nearest[list(relevant)] += best
    return nearest, float(np.linalg.norm(best))


def _search(S: TrigPolynomial) -> Array | None:
    """Find the best root of a search: roots along every joint, then stationary points."""
    rng = np.random.default_rng(0)
    spread = np.geomspace(0.01, np.pi, STARTS)[:, None]
    Q = spread * rng.uniform(-1.0, 1.0, (STARTS, S.n))
    Q[0] = 0.0
    roots = []
    for j in range(S.n):
        along = S.roots_along(Q, j)
        row, column = np.nonzero(~np.isnan(along))
        points = Q[row]
        points[:, j] = along[row, column]
        roots.append(wrap(points))
    found = np.concatenate(roots)
    if not len(found):
        return None
    found = found[np.argsort(np.linalg.norm(found, axis=1))[:16]]
    polished = [_polished(S, root) for root in found]
    sound = [p for p in [*polished, found[0]] if p is not None]
    return min(sound, key=lambda p: float(np.linalg.norm(p)))


def _polished(S: TrigPolynomial, start: Array) -> Array | None:
    """Find a root of S near `start` whose distance from the origin is stationary, or None."""
    root = stationary(HalfSquare(), S, start, STRIDE)
    return root if abs(S(root)) <= NOISE * S.scale else None


def _branch_and_bound(S: TrigPolynomial, best: Array | None) -> Array | None:
    """Halve the boxes that may hold a root nearer to the origin until none is left."""
    corners = np.array(list(product((-1.0, 1.0), repeat=S.n)))
    centres, half = np.zeros((1, S.n)), np.pi
    while len(centres) and half > GAP / 2.0:
        half /= 2.0
        centres = (centres[:, None] + half * corners).reshape(-1, S.n)
        bound = np.inf if best is None else float(np.linalg.norm(best))
        distance = np.linalg.norm(np.maximum(np.abs(centres) - half, 0.0), axis=1)
        centres = centres[distance < bound - GAP]
        centres = centres[S.sign(centres, np.full_like(centres, half)) == 0]
        nearest = centres[np.argsort(np.linalg.norm(centres, axis=1))[:4]]
        for point in (_polished(S, start) for start in nearest):
            if point is not None and np.linalg.norm(point) < bound:
                best, bound = point, float(np.linalg.norm(point))
    return best
