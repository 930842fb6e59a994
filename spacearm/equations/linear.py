"""Linear algebra without branches, for small matrices of numbers or symbols."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np


def solve(xp: Any, A: Any, B: Any) -> Any:
    """Compute A^-1 B of a positive definite A (n, n), B (n, m), by elimination without pivots."""
    inverse = 1.0 / A[:1, :1]
    if A.shape[0] == 1:
        return B * inverse
    rest = solve(xp, eliminated(A), B[1:] - A[1:, :1] * inverse * B[:1])
    return xp.concatenate([(B[:1] - A[:1, 1:] @ rest) * inverse, rest], axis=0)


def eliminated(A: Any) -> Any:
    """Return A (n, n), symmetric, without its first row and column, which are eliminated."""
    i, j = np.tril_indices(len(A) - 1)
    place = np.zeros((len(A) - 1, len(A) - 1), dtype=int)
    place[i, j] = place[j, i] = np.arange(len(i))
    share = A[1:, 0] * (1.0 / A[:1, 0])  # arrays, which the symbols of CasADi stay in
    return (A[1 + i, 1 + j] - share[i] * A[1:, 0][j])[place]


def pivots(A: Any) -> list[Any]:
    """Compute the pivots of A (n, n) as `solve` does; A is positive definite if they all are."""
    if A.shape[0] == 1:
        return [A[0, 0]]
    return [A[0, 0], *pivots(eliminated(A))]


def reciprocal(xp: Any, a: Any) -> Any:
    """Return 1 / a where a is positive, zero elsewhere."""
    there = a > 0.0
    return xp.where(there, 1.0 / xp.where(there, a, 1.0), 0.0)


def minors(A: Any, chosen: Sequence[tuple[int, ...]] | None = None) -> Any:
    """Compute maximal minors of A (k, n), k <= n, by expansion row by row, without division.

    Args:
        A: The matrix.
        chosen: Columns of each minor, k of them; all sets of columns, in the order of
            `itertools.combinations`, if None.

    Returns:
        (c,) determinants.
    """
    k, n = A.shape
    wanted = [[*combinations(range(n), k)] if chosen is None else [*chosen]]
    for _ in range(k - 1):
        wanted.insert(0, [*dict.fromkeys(c for of in wanted[0] for c in _one_less(of))])
    found = A[0][np.array(wanted[0])[:, 0]]
    for r in range(1, k):
        number = {columns: i for i, columns in enumerate(wanted[r - 1])}
        without = np.array([[number[c] for c in _one_less(of)] for of in wanted[r]])
        sign = np.array([(-1.0) ** (r + j) for j in range(r + 1)])
        found = (A[r][np.array(wanted[r])] * found[without] * sign).sum(axis=1)
    return found


def _one_less(columns: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Return columns without each of them in turn."""
    return [columns[:j] + columns[j + 1 :] for j in range(len(columns))]


class Factors(NamedTuple):
    """Factors L U of a matrix whose rows were exchanged.

    Attributes:
        LU: Rows of factors, the diagonal inverted.
        swaps: (i, j, mask) exchanges of rows, in order.
    """

    LU: list[list[Any]]
    swaps: list[tuple[int, int, Any]]


def factors(xp: Any, A: Any) -> Factors:
    """Compute factors L U of a matrix A (n, n), with pivots by rows."""
    n = len(A)
    rows, swaps = [[A[i, j] for j in range(n)] for i in range(n)], []
    for i in range(n):
        for j in range(i + 1, n):
            mask = xp.absolute(rows[i][i]) < xp.absolute(rows[j][i])
            pairs = list(zip(rows[i], rows[j], strict=True))
            rows[i] = [xp.where(mask, b, a) for a, b in pairs]
            rows[j] = [xp.where(mask, a, b) for a, b in pairs]
            swaps.append((i, j, mask))
        rows[i][i] = 1.0 / rows[i][i]
        for j in range(i + 1, n):
            rows[j][i] = rows[j][i] * rows[i][i]
            for k in range(i + 1, n):
                rows[j][k] = rows[j][k] - rows[j][i] * rows[i][k]
    return Factors(rows, swaps)


def substitute(xp: Any, known: Factors, b: Any) -> Any:
    """Solve A x = b (n,) with the factors of A."""
    x, n = [b[i] for i in range(len(known.LU))], len(known.LU)
    for i, j, mask in known.swaps:
        x[i], x[j] = xp.where(mask, x[j], x[i]), xp.where(mask, x[i], x[j])
    for i in range(n):
        for j in range(i):
            x[i] = x[i] - known.LU[i][j] * x[j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[i] = x[i] - known.LU[i][j] * x[j]
        x[i] = x[i] * known.LU[i][i]
    return xp.stack(x)
