"""Sums of real waves 1, cos q, ..., cos d q, sin q, ..., sin d q of several angles, in lanes.

They need neither the interpreter's lock nor a linear algebra library, whose threads get into each
other's way where matrices are small and processors busy.
"""

from __future__ import annotations

import numpy as np

from spacearm.kernels.cpu import kernel
from spacearm.kernels.floating import Indices
from spacearm.kernels.lanes import LANES, Lanes, sine_cosine, step

MORE = 4
"""Terms of a sum that are added at once."""


@kernel
def fill_waves(q: Lanes, rows: Lanes) -> None:
    """Write the waves at angles (m,) to rows (2 d + 1, m)."""
    d = rows.shape[0] // 2
    rows[0] = 1.0
    if d == 0:
        return
    c, s = rows[1], rows[d + 1]
    sine_cosine(q, s, c)
    for k in range(1, d):
        for i in range(q.shape[0]):
            rows[k + 1, i] = c[i] * rows[k, i] - s[i] * rows[d + k, i]
            rows[d + k + 1, i] = s[i] * rows[k, i] + c[i] * rows[d + k, i]


@step
def products(w: Lanes, axes: Indices, sizes: Indices, rows: Lanes, out: Lanes) -> None:
    """Multiply out the waves of several axes, the last one running fastest.

    Args:
        w: (n, lanes) angles.
        axes: Those whose waves are multiplied.
        sizes: (n,) number of waves of each axis.
        rows: (largest size, lanes) scratch.
        out: (product of the sizes, lanes) receives the products.
    """
    out[0] = 1.0
    count = 1
    for j in axes:
        size = sizes[j]
        fill_waves(w[j], rows[:size])
        for p in range(count - 1, -1, -1):  # from the end: in place
            for k in range(size - 1, -1, -1):
                for l in range(LANES):
                    out[p * size + k, l] = out[p, l] * rows[k, l]
        count *= size


@kernel
def sums(
    matrix: Lanes, Q: Lanes, first: Indices, later: Indices, sizes: Indices, out: Lanes
) -> None:
    """Compute out[k, i] = sum_lf matrix[k, l, f] B_l(Q_i) A_f(Q_i).

    Args:
        matrix: (K, L, F) factors.
        Q: (m, n) angles.
        first: Axes whose waves, multiplied out, are A.
        later: Axes whose waves, multiplied out, are B.
        sizes: (n,) number of waves of each axis.
        out: (K, m) receives the sums.
    """
    K, L, F = matrix.shape
    m, n = Q.shape
    w = np.empty((n, LANES))
    rows = np.empty((sizes.max(), LANES))
    A, B = np.empty((F, LANES)), np.empty((L, LANES))
    total, inner = np.empty(LANES), np.empty(LANES)
    whole = F - F % MORE
    for start in range(0, m, LANES):
        there = min(LANES, m - start)
        for j in range(n):
            for i in range(LANES):
                w[j, i] = Q[start + min(i, there - 1), j]
        products(w, first, sizes, rows, A)
        products(w, later, sizes, rows, B)
        for k in range(K):
            total[:] = 0.0
            for l in range(L):
                row = matrix[k, l]
                inner[:] = 0.0
                for f in range(0, whole, MORE):
                    a, b, c, d = row[f], row[f + 1], row[f + 2], row[f + 3]
                    for i in range(LANES):
                        inner[i] += (a * A[f, i] + b * A[f + 1, i]) + (
                            c * A[f + 2, i] + d * A[f + 3, i]
                        )
                for f in range(whole, F):
                    a = row[f]
                    for i in range(LANES):
                        inner[i] += a * A[f, i]
                for i in range(LANES):
                    total[i] += B[l, i] * inner[i]
            for i in range(there):
                out[k, start + i] = total[i]
