"""Singular value decompositions of small matrices: Jacobi's one-sided method on rows.

Rotations make the rows of A orthogonal, A = U diag(sigma) V^T with W = diag(sigma) V^T, so that
small singular values keep their digits (Demmel & Veselic, SIAM J. Matrix Anal. Appl. 13(4),
1204-1245, 1992, DOI 10.1137/0613074).
"""

from __future__ import annotations

import math

from spacearm.kernels.floating import Numbers
from spacearm.kernels.lanes import part

SWEEPS = 30
"""Bound of the loop; convergence is quadratic."""
ROUNDING = 2.0**-52
NOTHING = 1e-60
"""Share of the sum of squares below which those of a row are zero."""


@part
def decompose(W: Numbers, U: Numbers, sigma: Numbers) -> None:
    """Compute U and sigma, largest first, of W (k, m); W becomes diag(sigma) V^T.

    Args:
        W: (k, m) the matrix.
        U: (k, k) or larger, receives U.
        sigma: (k,) or longer, receives the singular values; k - m of them are zero where k > m.
    """
    k, m = W.shape
    for i in range(k):
        for j in range(k):
            U[i, j] = 1.0 if i == j else 0.0
    total = 0.0
    for i in range(k):
        for x in range(m):
            total += W[i, x] * W[i, x]
    for _ in range(SWEEPS):
        turned = False
        for i in range(k - 1):
            for j in range(i + 1, k):
                a, b, c = 0.0, 0.0, 0.0
                for x in range(m):
                    a += W[i, x] * W[i, x]
                    b += W[j, x] * W[j, x]
                    c += W[i, x] * W[j, x]
                if not abs(c) > ROUNDING * math.sqrt(a * b) or min(a, b) <= NOTHING * total:
                    continue
                turned = True
                z = (b - a) / (2.0 * c)
                t = math.copysign(1.0, z) / (abs(z) + math.hypot(1.0, z))
                cos = 1.0 / math.hypot(1.0, t)
                sin = cos * t
                for x in range(m):
                    p, q = W[i, x], W[j, x]
                    W[i, x], W[j, x] = cos * p - sin * q, sin * p + cos * q
                for x in range(k):
                    p, q = U[x, i], U[x, j]
                    U[x, i], U[x, j] = cos * p - sin * q, sin * p + cos * q
        if not turned:
            break
    for i in range(k):
        s = 0.0
        for x in range(m):
            s += W[i, x] * W[i, x]
        sigma[i] = math.sqrt(s)
    for i in range(k - 1):
        top = i
        for j in range(i + 1, k):
            if sigma[j] > sigma[top]:
                top = j
        if top != i:
            sigma[i], sigma[top] = sigma[top], sigma[i]
            for x in range(m):
                W[i, x], W[top, x] = W[top, x], W[i, x]
            for x in range(k):
                U[x, i], U[x, top] = U[x, top], U[x, i]


@part
def null_space(V: Numbers, k: int) -> None:
    """Complete k orthonormal rows of V (n, n) to a basis, by Gram and Schmidt's method.

    Each row is the unit vector that those before it leave most of, made orthogonal to them.
    """
    n = V.shape[0]
    for row in range(k, n):
        best, most = 0, -1.0
        for j in range(n):
            left = 1.0
            for i in range(row):
                left -= V[i, j] ** 2
            if left > most:
                best, most = j, left
        for j in range(n):
            V[row, j] = 1.0 if j == best else 0.0
        for _ in range(2):  # twice is enough
            for i in range(row):
                take_out(V[i], V[row])
        normalise(V[row])


@part
def free_slope(L: Numbers, rows: int, pad: float) -> float:
    """Return the slope along what row 0 leaves of its part in the span of the other rows.

    These are padded, so that those which `pad` outweighs span nothing: see `mechanics.nearness`.

    Args:
        L: (rows, 2 n) rows of n numbers, and as much room; they change.
        rows: Number of rows.
        pad: The padding, positive.
    """
    n = L.shape[1] // 2
    for i in range(1, rows + 1):
        row = i % rows  # row 0 comes last
        for j in range(n, 2 * n):
            L[row, j] = pad if row > 0 and j == n + row else 0.0
        for _ in range(2):  # twice is enough
            for o in range(1, i):
                take_out(L[o], L[row])
        if row > 0:
            normalise(L[row])
    full, way = length(L[0]), length(L[0, :n])
    return full * full / way if way > 0.0 else 0.0


@part
def length(x: Numbers) -> float:
    """Return |x|."""
    total = 0.0
    for j in range(len(x)):
        total += x[j] ** 2
    return math.sqrt(total)


@part
def normalise(x: Numbers) -> None:
    """Give x length 1."""
    size = length(x)
    for j in range(len(x)):
        x[j] /= size


@part
def take_out(along: Numbers, x: Numbers) -> None:
    """Take the component along a unit vector out of x."""
    seen = 0.0
    for j in range(len(x)):
        seen += along[j] * x[j]
    for j in range(len(x)):
        x[j] -= seen * along[j]


@part
def determinant(A: Numbers) -> float:
    """Compute the determinant of A (k, k), its rows scaled to length 1; A is overwritten."""
    k = A.shape[0]
    det = 1.0
    for i in range(k):
        s = 0.0
        for x in range(k):
            s += A[i, x] * A[i, x]
        if s == 0.0:
            return 0.0
        for x in range(k):
            A[i, x] /= math.sqrt(s)
    for i in range(k):
        top = i
        for j in range(i + 1, k):
            if abs(A[j, i]) > abs(A[top, i]):
                top = j
        if A[top, i] == 0.0:
            return 0.0
        if top != i:
            det = -det
            for x in range(k):
                A[i, x], A[top, x] = A[top, x], A[i, x]
        det *= A[i, i]
        for j in range(i + 1, k):
            g = A[j, i] / A[i, i]
            for x in range(i + 1, k):
                A[j, x] -= g * A[i, x]
    return det
