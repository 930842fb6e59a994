"""Singular values of many small matrices, as accurate as a full decomposition.

J^T is brought to bidiagonal form B by Householder reflections (Golub & Kahan, SIAM J. Numer. Anal.
2, 205-224, 1965), which change singular values by rounding only. With q_j and e_j the squared
entries of B on and right of the diagonal, T = B^T B is then shifted by its least eigenvalue: by the
differential qd transform of Fernando & Parlett (Numer. Math. 67, 191-229, 1994,
DOI 10.1007/s002110050024), with Laguerre's bounds as shifts, as in von Matt (SIAM J. Sci. Comput.
18, 1163-1186, 1997). No J J^T is formed, so that small singular values keep the digits J has for
them: errors stay at a few units of rounding of the largest singular value, as in LAPACK.

`np.linalg.svd` gives the same numbers, one LAPACK call for each matrix.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from spacearm.kernels.lanes import Lanes, Record, record, step

MOST_SHIFTS = 60
"""Bound of the loop; convergence is cubic."""
ROUNDING = 2.0**-52


def bidiagonal(lanes: int) -> np.dtype[np.void]:
    """Return the type of the work data of J^T, for up to 6 rows of J."""
    return record(
        ("q", np.float64, (6, lanes)),  # diagonal of B, later squared
        ("e", np.float64, (6, lanes)),  # entries right of it, later squared; the last is zero
        ("sign", np.float64, lanes),  # determinant of all reflections: det J = sign * prod q
        ("flipped_q", np.float64, (6, lanes)),  # the same of top - T
        ("flipped_e", np.float64, (6, lanes)),
        ("top", np.float64, lanes),
        ("least", np.float64, lanes),  # least eigenvalue of T
        ("flipped_least", np.float64, lanes),  # that of top - T
        ("g", np.float64, (6, lanes)),  # diagonal of T^-1
        ("r", np.float64, (6, lanes)),  # e_j / q_j
        ("s", np.float64, lanes),  # shift
        ("t", np.float64, (3, lanes)),  # scratch
    )


Bidiagonal: TypeAlias = Record
"""A record `bidiagonal`."""


@step
def bidiagonalise(A: Lanes, k: int, t: Lanes, b: Bidiagonal) -> None:
    """Compute q, e and sign of A = J^T (n, 6, lanes), n >= k, of which k columns count.

    A is overwritten; t (2, lanes) is scratch.
    """
    n, lanes = A.shape[0], A.shape[2]
    for l in range(lanes):
        b.sign[l] = 1.0
        b.e[k - 1, l] = 0.0
    for i in range(k):
        below = A[i:, i]
        reflector(below, b.q[i], b.sign, t[0])
        for j in range(i + 1, k):
            reflect(below, A[i:, j], t[0], t[1])
        if i < k - 2:
            right = A[i, i + 1 : k]
            reflector(right, b.e[i], b.sign, t[0])
            for j in range(i + 1, n):
                reflect(right, A[j, i + 1 : k], t[0], t[1])
        elif i == k - 2:
            for l in range(lanes):
                b.e[i, l] = A[i, k - 1, l]


@step
def reflector(x: Lanes, beta: Lanes, sign: Lanes, t: Lanes) -> None:
    """Turn x into v of the reflection 1 - v v^T / g that takes x to (beta, 0, ..., 0); t = 1/g.

    Where x is zero, t is zero and nothing is reflected.
    """
    for l in range(t.shape[0]):
        t[l] = x[0, l] * x[0, l]
    for j in range(1, x.shape[0]):
        for l in range(t.shape[0]):
            t[l] += x[j, l] * x[j, l]
    for l in range(t.shape[0]):
        norm = math.sqrt(t[l])
        beta[l] = -norm if x[0, l] > 0.0 else norm
        g = t[l] - x[0, l] * beta[l]
        x[0, l] -= beta[l]
        sign[l] = -sign[l] if norm > 0.0 else sign[l]
        t[l] = 1.0 / g if norm > 0.0 else 0.0


@step
def reflect(v: Lanes, x: Lanes, t: Lanes, dot: Lanes) -> None:
    """Apply x -= v (v . x) / g with t = 1 / g; `dot` is scratch."""
    for l in range(dot.shape[0]):
        dot[l] = v[0, l] * x[0, l]
    for j in range(1, x.shape[0]):
        for l in range(dot.shape[0]):
            dot[l] += v[j, l] * x[j, l]
    for l in range(dot.shape[0]):
        dot[l] *= t[l]
    for j in range(x.shape[0]):
        for l in range(dot.shape[0]):
            x[j, l] -= dot[l] * v[j, l]


@step
def least_eigenvalue(k: int, b: Bidiagonal, q: Lanes, e: Lanes, eigenvalue: Lanes) -> None:
    """Compute the least eigenvalue of T from its qd form (k, lanes), which is overwritten."""
    for l in range(b.s.shape[0]):
        eigenvalue[l] = 0.0 * q[0, l]  # NaN stays NaN
    for _ in range(MOST_SHIFTS):
        laguerre(k, b, q, e)
        waiting = 0
        for l in range(b.s.shape[0]):
            b.s[l] = b.s[l] if b.s[l] > ROUNDING * eigenvalue[l] else 0.0
            eigenvalue[l] += b.s[l]
            waiting += 1 if b.s[l] > 0.0 else 0
        if waiting == 0:
            return
        shift(k, b, q, e)


@step
def laguerre(k: int, b: Bidiagonal, q: Lanes, e: Lanes) -> None:
    """Compute s, Laguerre's lower bound of the least eigenvalue of T.

    The diagonal g of T^-1 follows from the bottom up, tr T^-1 = sum g and
    tr T^-2 = sum g^2 (1 + 2 h) with h from the top down: nothing is subtracted.
    """
    lanes = q.shape[1]
    trace, trace_2, h = b.t[0], b.t[1], b.t[2]
    for l in range(lanes):
        b.r[k - 1, l] = 0.0
        b.g[k - 1, l] = 1.0 / q[k - 1, l]
    for j in range(k - 2, -1, -1):
        for l in range(lanes):
            inverse = 1.0 / q[j, l]
            b.r[j, l] = e[j, l] * inverse
            b.g[j, l] = inverse + b.r[j, l] * b.g[j + 1, l]
    for l in range(lanes):
        trace[l], trace_2[l], h[l] = 0.0, 0.0, 0.0
    for j in range(k):
        for l in range(lanes):
            g = b.g[j, l]
            trace[l] += g
            trace_2[l] += g * g * (1.0 + 2.0 * h[l])
            h[l] = (1.0 + h[l]) * b.r[j, l]
    for l in range(lanes):
        spread = k * trace_2[l] - trace[l] * trace[l]
        b.s[l] = k / (trace[l] + math.sqrt((k - 1) * (spread if spread > 0.0 else 0.0)))


@step
def shift(k: int, b: Bidiagonal, q: Lanes, e: Lanes) -> None:
    """Apply T -= s, by the differential qd transform; if s is the eigenvalue, q ends in zero."""
    lanes = q.shape[1]
    d = b.t[0]
    for l in range(lanes):
        first = q[0, l] - b.s[l]
        d[l] = first if first > 0.0 else 0.0
    for j in range(k - 1):
        for l in range(lanes):
            p = d[l] + e[j, l]
            ratio = q[j + 1, l] / p
            following = d[l] * ratio - b.s[l]
            q[j, l], e[j, l] = p, e[j, l] * ratio
            d[l] = following if following > 0.0 else 0.0
    for l in range(lanes):
        q[k - 1, l] = d[l]


@step
def flip(k: int, b: Bidiagonal) -> None:
    """Compute the qd form of top - T, top = 2 tr T; its least eigenvalue gives the largest of T."""
    q, e, top = b.flipped_q, b.flipped_e, b.top
    lanes = top.shape[0]
    for l in range(lanes):
        top[l] = 0.0
    for j in range(k):
        for l in range(lanes):
            top[l] += 2.0 * (b.q[j, l] + b.e[j, l])
    for l in range(lanes):
        q[0, l] = top[l] - b.q[0, l]
        e[k - 1, l] = 0.0
    for j in range(k - 1):
        for l in range(lanes):
            e[j, l] = b.q[j, l] * b.e[j, l] / q[j, l]
            q[j + 1, l] = top[l] - (b.q[j + 1, l] + b.e[j, l]) - e[j, l]
