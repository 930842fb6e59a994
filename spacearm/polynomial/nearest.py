"""Proof that no root of a polynomial is nearer to the origin than one that is known."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from spacearm.arrays import Array
from spacearm.polynomial.trig import TrigPolynomial

GAP = 1e-4
"""It is proven that no root is nearer than the one found by more than this [rad]; the one found is
exact to rounding."""
STARTS, MANY = 4, 256
"""Boxes from whose centres nearer roots are sought, where there are many boxes or no root."""


def branch_and_bound(
    S: TrigPolynomial, best: Array | None, improve: Callable[[Array], Array | None]
) -> Array | None:
    """Find the root nearest to the origin by halving the boxes that may hold a nearer one.

    Args:
        S: The polynomial of up to three angles.
        best: (n,) the best root known, or None.
        improve: Returns a root (n,) found from starts (m, n), or None.
    """
    corners = np.array(list(product((-1.0, 1.0), repeat=S.n)))
    centres, half = np.zeros((1, S.n)), np.pi
    while len(centres) and half > GAP / 2.0:
        half /= 2.0
        centres = (centres[:, None] + half * corners).reshape(-1, S.n)
        bound = np.inf if best is None else float(np.linalg.norm(best))
        distance = np.linalg.norm(np.maximum(np.abs(centres) - half, 0.0), axis=1)
        centres = centres[distance < bound - GAP]
        centres = centres[S.sign(centres, np.full_like(centres, half)) == 0]
        if not len(centres):
            break
        if best is not None and len(centres) < MANY and half > GAP / 2.0:
            continue
        found = improve(centres[np.argsort(np.linalg.norm(centres, axis=1))[:STARTS]])
        if found is not None and np.linalg.norm(found) < bound:
            best = found
    return best
