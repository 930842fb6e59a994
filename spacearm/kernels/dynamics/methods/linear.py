"""The linear systems of implicit steps: the Jacobian of the rate, shifted, factors, solutions."""

from __future__ import annotations

import numpy as np

from spacearm.kernels.dynamics.calls import rate_at
from spacearm.kernels.dynamics.context import WORKS, Context, mat, vec
from spacearm.kernels.floating import Numbers
from spacearm.kernels.lanes import part

ROUNDING = 2.0**-52


@part
def differentiate(x: Context, t: float) -> int:
    """Compute the Jacobian of the rate at y by differences; the work changes no rate."""
    N, y, f, mid = x.states, vec(x._y, x.states), vec(x._f_y, x.states), vec(x._mid, x.states)
    J, there, status, work = mat(x._jacobian, N, N), vec(x._G, N), 0, 2 * x.n + 13
    for o in range(N):
        mid[o] = y[o]
    for j in range(x.coupled):
        if work <= j < work + WORKS:
            continue
        mid[j] = y[j] + np.sqrt(ROUNDING) * max(abs(y[j]), 1e-3)
        h = mid[j] - y[j]
        status |= rate_at(x, t, mid, there)
        x.rates += 1
        mid[j] = y[j]
        for o in range(N):
            J[o, j] = (there[o] - f[o]) / h
    x.known, x.factored = 2, 0
    return int(status)


@part
def factorise(x: Context, shift: float, A: Numbers, order: Numbers) -> None:
    """Compute factors L U of shift 1 - J without the rows of q, whose rate is dq, with pivots.

    The unknowns z of q follow from those of dq: shift z_q = b_q + z_dq.
    """
    J, n, M = mat(x._jacobian, x.states, x.states), x.n, x.coupled - x.n
    for i in range(M):
        for j in range(M):
            A[i, j] = -J[n + i, n + j]
        for j in range(n):
            A[i, j] -= J[n + i, j] / shift
        A[i, i] += shift
    for i in range(M):
        top = i
        for j in range(i + 1, M):
            if square(A[j, i]) > square(A[top, i]):
                top = j
        order[i] = top
        if top != i:
            for o in range(M):
                A[i, o], A[top, o] = A[top, o], A[i, o]
        A[i, i] = 1.0 / A[i, i]
        for j in range(i + 1, M):
            A[j, i] *= A[i, i]
            for o in range(i + 1, M):
                A[j, o] -= A[j, i] * A[i, o]


@part
def square(z: complex) -> float:
    """Return |z|^2."""
    return z.real**2 + z.imag**2


@part
def solve(x: Context, shift: float, A: Numbers, order: Numbers, b: Numbers) -> None:
    """Solve (shift 1 - J) z = b with these factors; b becomes z.

    The rows after the coupled ones follow from these; those of CM and momentum have no J there.
    """
    J, n, M = mat(x._jacobian, x.states, x.states), x.n, x.coupled - x.n
    share = 1.0 / shift
    for i in range(M):
        total = 0.0 * shift
        for j in range(n):
            total += J[n + i, j] * b[j]
        b[n + i] += share * total
    for i in range(M):
        top = n + order[i]
        if top != n + i:
            b[n + i], b[top] = b[top], b[n + i]
    for i in range(M):
        total = 0.0 * shift
        for j in range(i):
            total += A[i, j] * b[n + j]
        b[n + i] -= total
    for i in range(M - 1, -1, -1):
        total = 0.0 * shift
        for j in range(i + 1, M):
            total += A[i, j] * b[n + j]
        b[n + i] = (b[n + i] - total) * A[i, i]
    for j in range(n):
        b[j] = share * (b[j] + b[n + j])
    for i in range(x.coupled, x.states):
        total = 0.0 * shift
        if not 2 * n + 4 <= i < 2 * n + 13:
            for j in range(x.coupled):
                total += J[i, j] * b[j]
        b[i] = share * (b[i] + total)
