"""Nearest: the root of a trigonometric polynomial that is nearest to a point of the torus."""

from __future__ import annotations

from itertools import product

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.polynomial.univariate import wrap

GAP = 1e-4
"""Branch and bound proves that no root is nearer than the one found by more than this [rad]; the
one found is exact to rounding."""
GLOBAL_DIMENSION = 3
"""Up to this many joints the nearest root is proven."""
STARTS = 256
"""Configurations about the point from which roots are sought for arms with more joints."""


def nearest_root(S: TrigPolynomial, q: Array, relevant: tuple[int, ...]) -> tuple[Array, float]:
    """The root nearest to q (n,) and its distance [rad]; see `SingularSet.nearest`.

    Raises:
        NoSolutionError: S has no root at all (proven for up to three relevant joints).
    """
    others = {j: q[j] for j in range(S.n) if j not in relevant}
    reduced = S.fix(others) if others else S
    x = q[list(relevant)]
    best = _best(reduced, x)
    if len(relevant) <= GLOBAL_DIMENSION:
        best = _branch_and_bound(reduced, x, best)
    if best is None:
        raise NoSolutionError("no singular configuration was found")
    nearest = q.copy()
    nearest[list(relevant)] = x + best
    return nearest, float(np.linalg.norm(best))


def _best(S: TrigPolynomial, x: Array) -> Array | None:
    """Offset to the best root of a search: roots along every joint, then stationary points."""
    rng = np.random.default_rng(0)
    spread = np.geomspace(0.01, np.pi, STARTS)[:, None]
    Q = x + spread * rng.uniform(-1.0, 1.0, (STARTS, S.n))
    Q[0] = x
    offsets = []
    for j in range(S.n):
        roots = S.roots_along(Q, j)
        row, column = np.nonzero(~np.isnan(roots))
        points = Q[row]
        points[:, j] = roots[row, column]
        offsets.append(wrap(points - x))
    found = np.concatenate(offsets)
    if not len(found):
        return None
    found = found[np.argsort(np.linalg.norm(found, axis=1))[:16]]
    polished = [stationary(S, x, offset) for offset in found]
    sound = [p for p in [*polished, found[0]] if p is not None]
    return min(sound, key=lambda p: float(np.linalg.norm(p)))


def stationary(S: TrigPolynomial, x: Array, offset: Array) -> Array | None:
    """Newton's method for: offset + lambda grad S = 0, S = 0."""
    n = S.n
    g = S.gradient(x + offset)
    multiplier = -float(offset @ g) / max(float(g @ g), 1e-300)
    for _ in range(30):
        g, H = S.gradient(x + offset), S.hessian(x + offset)
        residual = np.append(offset + multiplier * g, S(x + offset))
        matrix = np.block([[np.eye(n) + multiplier * H, g[:, None]], [g[None], np.zeros((1, 1))]])
        step = np.linalg.lstsq(matrix, -residual, rcond=None)[0]
        size = float(np.linalg.norm(step[:n]))
        offset = offset + step[:n] * min(1.0, 0.5 / max(size, 1e-300))
        multiplier += float(step[n])
        if size < 1e-14:
            break
    return offset if abs(S(x + offset)) <= 1e-12 * S.scale else None


def _branch_and_bound(S: TrigPolynomial, x: Array, best: Array | None) -> Array | None:
    """Halves the boxes of offsets about x that may hold a nearer root, until none is left."""
    corners = np.array(list(product((-1.0, 1.0), repeat=S.n)))
    centres, half = np.zeros((1, S.n)), np.pi
    while len(centres) and half > GAP / 2.0:
        half /= 2.0
        centres = (centres[:, None] + half * corners).reshape(-1, S.n)
        bound = np.inf if best is None else float(np.linalg.norm(best))
        distance = np.linalg.norm(np.maximum(np.abs(centres) - half, 0.0), axis=1)
        centres = centres[distance < bound - GAP]
        centres = centres[S.sign(x + centres, np.full_like(centres, half)) == 0]
        nearest = centres[np.argsort(np.linalg.norm(centres, axis=1))[:4]]
        for point in (stationary(S, x, start) for start in nearest):
            if point is not None and np.linalg.norm(point) < bound:
                best, bound = point, float(np.linalg.norm(point))
    return best
