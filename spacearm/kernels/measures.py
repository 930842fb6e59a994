"""Measures of a configuration: sigma_min, manipulability, condition, determinant and radius."""

from __future__ import annotations

import math

from spacearm.kernels.floating import Indices, Numbers, Work
from spacearm.kernels.lanes import Lanes, dot, step, vector
from spacearm.kernels.singular_values import (
    Bidiagonal,
    bidiagonalise,
    flip,
    least_eigenvalue,
)


@step
def measure(
    w: Work, rows: Indices, scale: Numbers, condition: bool, A: Lanes, b: Bidiagonal, values: Lanes
) -> None:
    """Compute the `QUANTITIES` of the task's rows of J; the condition number only if asked for.

    Args:
        w: Work arrays that hold J and r_E.
        rows: (k,) task rows of the twist.
        scale: (k,) their factors.
        condition: Whether to compute the condition number, which needs the largest singular value.
        A: (n, 6, lanes) scratch.
        b: Scratch.
        values: (5, lanes) receives the measures.
    """
    sigma_min, manipulability, condition_number = values[0], values[1], values[2]
    det, radius = values[3], values[4]
    lanes = radius.shape[0]
    for l in range(lanes):
        r_E = vector(w.r_E, l)
        radius[l] = math.sqrt(dot(r_E, r_E))
    n, k = w.J.shape[0], len(rows)
    if n < k:
        for l in range(lanes):
            zero = 0.0 * w.J[0, 0, l]  # NaN stays NaN
            sigma_min[l], manipulability[l] = zero, zero
            condition_number[l], det[l] = math.inf + zero, math.nan
        return
    for j in range(n):
        for i in range(k):
            for l in range(lanes):
                A[j, i, l] = scale[i] * w.J[j, rows[i], l]
    bidiagonalise(A, k, values[:2], b)
    for l in range(lanes):
        det[l] = b.sign[l]
    for i in range(k):
        for l in range(lanes):
            det[l] *= b.q[i, l]
            b.q[i, l] *= b.q[i, l]
            b.e[i, l] *= b.e[i, l]
    if condition:
        flip(k, b)
        least_eigenvalue(k, b, b.flipped_q, b.flipped_e, b.flipped_least)
    least_eigenvalue(k, b, b.q, b.e, b.least)
    for l in range(lanes):
        sigma_min[l] = math.sqrt(b.least[l])
        manipulability[l] = abs(det[l])
        if condition:
            condition_number[l] = math.sqrt((b.top[l] - b.flipped_least[l]) / b.least[l])
        if n > k:
            det[l] = math.nan
