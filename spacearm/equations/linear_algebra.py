"""Linear algebra of small matrices of numbers or symbols, without branches.

Singular values and vectors are as accurate as by a full decomposition. J^T is brought to
bidiagonal form B by Householder reflections (Golub & Kahan, SIAM J. Numer. Anal. 2, 205-224, 1965),
which change singular values by rounding only. With q_j and e_j the squared
entries of B on and right of the diagonal, T = B^T B is then shifted by its least eigenvalue: by the
differential qd transform of Fernando & Parlett (Numer. Math. 67, 191-229, 1994,
DOI 10.1007/s002110050024), with Laguerre's bounds as shifts, as in von Matt (SIAM J. Sci. Comput.
18, 1163-1186, 1997). No J J^T is formed, so that small singular values keep the digits J has for
them: errors stay at a few units of rounding of the largest singular value, as in LAPACK.

The vectors of the least singular value are those of T by twisted factorisation (Dhillon & Parlett,
Linear Algebra Appl. 387, 1-28, 2004, DOI 10.1016/j.laa.2003.12.028), accurate also where it is far
below the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import sqrt
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


#: Rows of the largest determinant that is expanded: each one more doubles the work.
EXPANDED = 6
#: As good as zero, and its inverse is a number.
TINY = 1e-290
#: L U, the diagonal inverted, of a matrix whose rows were exchanged: (i, j, mask) in order.
Factors = tuple[list[list[Any]], list[tuple[int, int, Any]]]


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
        rows[i][i] = 1.0 / xp.where(rows[i][i] == 0.0, TINY, rows[i][i])
        for j in range(i + 1, n):
            rows[j][i] = rows[j][i] * rows[i][i]
            for k in range(i + 1, n):
                rows[j][k] = rows[j][k] - rows[j][i] * rows[i][k]
    return rows, swaps


def substitute(xp: Any, known: Factors, b: Any) -> Any:
    """Solve A x = b (n,) with the factors of A."""
    (LU, swaps), n = known, len(b)
    x = [b[i] for i in range(n)]
    for i, j, mask in swaps:
        x[i], x[j] = xp.where(mask, x[j], x[i]), xp.where(mask, x[i], x[j])
    for i in range(n):
        for j in range(i):
            x[i] = x[i] - LU[i][j] * x[j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[i] = x[i] - LU[i][j] * x[j]
        x[i] = x[i] * LU[i][i]
    return xp.stack(x)


def determinant(xp: Any, A: Any) -> Any:
    """Compute the determinant of A (n, n): by expansion, of a large one from its factors."""
    if len(A) <= EXPANDED:
        return minors(A)[0]
    LU, swaps = factors(xp, A)
    found = 1.0 / LU[0][0]
    for i in range(1, len(A)):
        found = found / LU[i][i]
    for _, _, mask in swaps:
        found = xp.where(mask, -found, found)
    return found


#: Bound of the loop; convergence is cubic.
MOST_SHIFTS = 60
ROUNDING = 2.0**-52


class Reflection(NamedTuple):
    """The reflection 1 - v v^T / g of the last components of vectors.

    Attributes:
        v: (m,) its vector.
        inverse: 1 / g; zero where nothing is reflected.
    """

    v: Any
    inverse: Any

    def of(self, xp: Any, x: Any) -> Any:
        """Return the reflection of x (l,) or (l, c), l >= m."""
        before = len(x) - len(self.v)
        last, v = x[before:], self.v if x.ndim == 1 else self.v[:, None]
        found = last - v * ((self.v @ last) * self.inverse)
        return xp.concatenate([x[:before], found]) if before else found


def reflected(xp: Any, reflections: list[Reflection], x: Any) -> Any:
    """Return L^T x, L the product of reflections."""
    for reflection in reflections:
        x = reflection.of(xp, x)
    return x


def unreflected(xp: Any, reflections: list[Reflection], x: Any) -> Any:
    """Return L x, L the product of reflections."""
    return reflected(xp, reflections[::-1], x)


class Bidiagonal(NamedTuple):
    """The bidiagonal form J^T = L B R^T of J (k, n), k <= n.

    Attributes:
        q: (k,) diagonal of B.
        e: (k - 1,) entries right of it.
        sign: Determinant of L and R; det J = sign * prod q.
        left: The reflections whose product is L.
        right: Those of R.
    """

    q: Any
    e: Any
    sign: Any
    left: list[Reflection]
    right: list[Reflection]

    def least(self, xp: Any) -> Any:
        """Compute the square of the least singular value."""
        return least_eigenvalue(xp, self.q * self.q, self.e * self.e)

    def largest(self, xp: Any) -> Any:
        """Compute the square of the largest singular value."""
        return largest_eigenvalue(xp, self.q * self.q, self.e * self.e)

    def solution(self, xp: Any, x: Any, within: Any) -> Any:
        """Compute the dq (n,) with J dq = x whose part in the null space is `within` (n - k,)."""
        asked = reflected(xp, self.right, x)
        y = [asked[0] / self.q[0]]
        for i in range(1, len(asked)):
            y.append((asked[i] - self.e[i - 1] * y[i - 1]) / self.q[i])
        return unreflected(xp, self.left, xp.concatenate([xp.stack(y), within]))


class Least(NamedTuple):
    """The least singular value of J (k, n), k <= n, and what belongs to it.

    Attributes:
        sigma: It.
        u: (k,) left singular vector.
        v: (n,) right one.
        null: n - k orthonormal rows (n,) that J takes to zero.
    """

    sigma: Any
    u: Any
    v: Any
    null: list[Any]


def bidiagonal(xp: Any, J: Any) -> Bidiagonal:
    """Bring J^T to bidiagonal form, J (k, n), k <= n."""
    A, q, e, left, right, sign = J.T, [], [], [], [], 1.0
    k = A.shape[1]
    for i in range(k):
        diagonal, reflection, turn = reflector(xp, A[:, 0])
        q.append(diagonal)
        left.append(reflection)
        sign = sign * turn
        if i == k - 1:
            break
        A = reflection.of(xp, A[:, 1:])
        if i == k - 2:
            e.append(A[0, 0])
        else:
            beside, reflection, turn = reflector(xp, A[0])
            e.append(beside)
            right.append(reflection)
            sign = sign * turn
            A = reflection.of(xp, A.T).T
        A = A[1:]
    return Bidiagonal(xp.stack(q), xp.stack(e) if e else np.zeros(0), sign, left, right)


def reflector(xp: Any, x: Any) -> tuple[Any, Reflection, Any]:
    """Return beta, the reflection that takes x to (beta, 0, ..., 0), and its determinant."""
    square = (x * x).sum()
    norm = xp.sqrt(square)
    there = norm > 0.0
    beta = xp.where(x[0] > 0.0, -norm, norm)
    g = xp.where(there, square - x[0] * beta, 1.0)
    v = xp.concatenate([xp.stack([x[0] - beta]), x[1:]])
    return beta, Reflection(v, xp.where(there, 1.0 / g, 0.0)), xp.where(there, -1.0, 1.0)


def least_eigenvalue(xp: Any, q: Any, e: Any) -> Any:
    """Compute the least eigenvalue of T from its qd form q (k,), e (k - 1,), all >= 0."""

    def shifted(q: Any, e: Any, found: Any) -> tuple[Any, ...]:
        s = _laguerre(xp, q, e)
        goes_on = s > ROUNDING * found
        s = xp.where(goes_on, s, 0.0)
        return *_shifted(xp, q, e, s), found + s, goes_on

    if len(q) == 1:
        return q[0]
    found, trace = xp.while_any(shifted, q, e, 0.0, most=MOST_SHIFTS)[2], q.sum()
    return xp.where(trace >= 0.0, found, trace)  # NaN stays NaN


def _laguerre(xp: Any, q: Any, e: Any) -> Any:
    """Compute Laguerre's lower bound of the least eigenvalue of T.

    The diagonal g of T^-1 follows from the bottom up, and from the top down h, so that the squares
    beside it sum up to g^2 h. No squares of eigenvalues are subtracted for their spread.
    """
    k = len(q)
    inverse = 1.0 / q
    r = e * inverse[:-1]
    g = [inverse[k - 1]]
    for j in range(k - 2, -1, -1):
        g = [inverse[j] + r[j] * g[0], *g]
    trace = sum(g[1:], g[0])
    mean, h = trace / k, r[0]
    spread = (g[0] - mean) ** 2
    for j in range(1, k):
        spread = spread + (g[j] - mean) ** 2 + 2.0 * h * (g[j] * g[j])
        h = (1.0 + h) * r[j] if j < k - 1 else h
    return k / (trace + sqrt(k * (k - 1.0)) * xp.sqrt(spread))


def _shifted(xp: Any, q: Any, e: Any, s: Any) -> tuple[Any, Any]:
    """Return the qd form of T - s, by the differential qd transform."""
    k = len(q)
    d, Q, E = _positive(xp, q[0] - s), [], []
    for j in range(k - 1):
        p = d + e[j]
        ratio = q[j + 1] / p
        Q.append(p)
        E.append(e[j] * ratio)
        d = _positive(xp, d * ratio - s)
    return xp.stack([*Q, d]), xp.stack(E)


def _positive(xp: Any, x: Any) -> Any:
    return xp.where(x > 0.0, x, 0.0)


def largest_eigenvalue(xp: Any, q: Any, e: Any) -> Any:
    """Compute the largest eigenvalue of T from its qd form, as top less the least of top - T."""
    k = len(q)
    top = 2.0 * (q.sum() + e.sum())
    Q, E = [top - q[0]], []
    for j in range(k - 1):
        E.append(q[j] * e[j] / Q[j])
        Q.append(top - (q[j + 1] + e[j]) - E[j])
    if k == 1:
        return q[0]
    return top - least_eigenvalue(xp, xp.stack(Q), xp.stack(E))


def least_with_vectors(xp: Any, J: Any) -> Least:
    """Compute the least singular value of J (k, n), k <= n, its vectors, and the null space."""
    k, n = J.shape
    form = bidiagonal(xp, J)
    value = form.least(xp)
    z, y = _twisted(xp, form.q, form.e, value)
    rows = [xp.concatenate([y, np.zeros(n - k)]) if n > k else y, *np.eye(n)[k:]]
    v, *null = (unreflected(xp, form.left, row) for row in rows)
    return Least(xp.sqrt(value), unreflected(xp, form.right, z), v, null)


def _twisted(xp: Any, q: Any, e: Any, value: Any) -> tuple[Any, Any]:
    """Compute the eigenvector z (k,) of T of an eigenvalue, and y (k,) with B^T y along z."""
    k = len(q)
    least = 1e-17 * (TINY + xp.absolute(q).sum() + xp.absolute(e).sum())
    square = least * least
    along, plus = [-value], []
    for i in range(k - 1):
        pivot = _nonzero(xp, q[i] * q[i] + along[i], square)
        plus.append(q[i] * e[i] / pivot)
        along.append(along[i] * (e[i] * e[i]) / pivot - value)
    minus: list[Any] = []
    p = q[k - 1] * q[k - 1] - value
    best, twist = xp.absolute(along[k - 1] + p + value), k - 1.0
    for i in range(k - 2, -1, -1):
        pivot = _nonzero(xp, e[i] * e[i] + p, square)
        minus = [q[i] * e[i] / pivot, *minus]
        p = p * (q[i] * q[i]) / pivot - value
        rest = xp.absolute(along[i] + p + value)
        best, twist = xp.where(rest < best, rest, best), xp.where(rest < best, 1.0 * i, twist)
    z = [1.0 + 0.0 * value]
    for i in range(k - 2, -1, -1):
        z = [xp.where(twist > i + 0.5, -plus[i] * z[0], 1.0), *z]
    for i in range(k - 1):
        z[i + 1] = xp.where(twist > i + 0.5, z[i + 1], -minus[i] * z[i])
    y = [z[0] / _nonzero(xp, q[0], least)]
    for i in range(1, k):
        y.append((z[i] - e[i - 1] * y[i - 1]) / _nonzero(xp, q[i], least))
    return unit(xp, xp.stack(z)), unit(xp, xp.stack(y))


def _nonzero(xp: Any, a: Any, least: Any) -> Any:
    """Return a, or something small in its place where it vanishes."""
    return xp.where(xp.absolute(a) < least, least, a)


def unit(xp: Any, x: Any) -> Any:
    """Return x over its length."""
    return x / xp.sqrt((x * x).sum())
