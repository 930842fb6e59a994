"""Steps of DOP853, the embedded Runge-Kutta pair of order 8 of Dormand & Prince.

Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I (1993), section II.10, with its
dense output of order 7 and its test for stiffness; coefficients as in scipy.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate._ivp import dop853_coefficients as tableau

from spacearm.kernels.dynamics.calls import Entry, rate_at
from spacearm.kernels.dynamics.context import Context, context_at, mat, vec
from spacearm.kernels.floating import Numbers
from spacearm.kernels.lanes import part

A = np.ascontiguousarray(tableau.A)
B = np.ascontiguousarray(tableau.B)
C = np.ascontiguousarray(tableau.C)
D = np.ascontiguousarray(tableau.D)
E3 = np.ascontiguousarray(tableau.E3)
E5 = np.ascontiguousarray(tableau.E5)
STAGES = 12
MOST_STAGES = 16
SAFETY, LEAST, MOST = 0.9, 0.2, 10.0
"""The next step is this share of the one that would just do, between these times the last."""
STABLE = 6.1
"""Step times eigenvalue beyond which the method is unstable; steps near it look stiff."""
STIFF = 15
"""Steps in a row, nearly, that look stiff until the equations are."""

RETREAT = 1e3
"""A rate that fails even in steps of so many times the least one has failed."""
DONE, FAILED, COLLAPSED = range(3)


@part
def sum_of_stages(x: Context, a: Numbers, stages: int, h: float, y: Numbers) -> None:
    """Compute y = before + h sum a_i K_i."""
    K, before = mat(x._K, MOST_STAGES, x.states), vec(x._before, x.states)
    for o in range(x.states):
        y[o] = 0.0
    for i in range(stages):
        if a[i] != 0.0:
            for o in range(x.states):
                y[o] += a[i] * K[i, o]
    for o in range(x.states):
        y[o] = before[o] + h * y[o]


@Entry
def explicit_step(at: int, _: float, __: int, ___: int) -> int:
    """Take a step from y to y, its length by the error control; return DONE or why not."""
    x = context_at(at)
    N, y, f = x.states, vec(x._y, x.states), vec(x._f_y, x.states)
    K, before, mid = mat(x._K, MOST_STAGES, N), vec(x._before, N), vec(x._mid, N)
    least = 10.0 * (np.nextafter(x.t, np.inf) - x.t)
    for o in range(N):
        before[o] = y[o]
        K[0, o] = f[o]
    x.began, most = x.t, MOST
    while True:
        if not x.step >= least:
            return COLLAPSED
        h = min(x.step, x.end - x.began)
        end = x.began + h if h < x.end - x.began else x.end
        failed = 0
        for i in range(1, STAGES):
            if failed == 0:
                sum_of_stages(x, A[i], i, h, y)
                failed = rate_at(x, x.began + C[i] * h, y, K[i])
        for o in range(N):
            mid[o] = y[o]  # the last stage
        if failed == 0:
            sum_of_stages(x, B, STAGES, h, y)
            failed = rate_at(x, end, y, K[STAGES])
        x.rates += STAGES
        error = error_of(x, h) if failed == 0 else np.inf
        if error < 1.0:
            break
        if failed and h < least * RETREAT:
            return FAILED
        x.step = h * (max(LEAST, SAFETY * error**-0.125) if error < np.inf else LEAST)
        most = 1.0
    factor = most if error == 0.0 else min(most, SAFETY * error**-0.125)
    x.t, x.step, x.dense, x.cubic = end, max(h * factor, x.step if end == x.end else 0.0), 0, 0
    for o in range(N):
        f[o] = K[STAGES, o]
    count_stiff(x, h)
    return DONE


@part
def error_of(x: Context, h: float) -> float:
    """Return the error of a step as a share of what is allowed."""
    K, y, before = mat(x._K, MOST_STAGES, x.states), vec(x._y, x.states), vec(x._before, x.states)
    fifth, third = 0.0, 0.0
    for o in range(x.states):
        e5, e3 = 0.0, 0.0
        for i in range(STAGES + 1):
            e5 += E5[i] * K[i, o]
            e3 += E3[i] * K[i, o]
        scale = x.atol + x.rtol * max(abs(before[o]), abs(y[o]))
        fifth += (e5 / scale) ** 2
        third += (e3 / scale) ** 2
    both = fifth + 0.01 * third
    error = h * fifth / np.sqrt(both * x.counted) if both > 0.0 else 0.0
    return float(error) if error == error else np.inf


@part
def count_stiff(x: Context, h: float) -> None:
    """Count steps that stability limits, not accuracy; remember the eigenvalue that does it."""
    N, y, mid = x.states, vec(x._y, x.states), vec(x._mid, x.states)
    K, changed, apart = mat(x._K, MOST_STAGES, N), 0.0, 0.0
    for o in range(N):
        changed += (K[STAGES, o] - K[STAGES - 1, o]) ** 2
        apart += (y[o] - mid[o]) ** 2
    if apart > 0.0 and changed > 0.0:
        eigenvalue = np.sqrt(changed / apart)
        if h * eigenvalue > STABLE:
            x.stiff += 1
            x.eigenvalue = eigenvalue
        elif x.stiff > 0 and x.steps % 6 == 0:
            x.stiff = 0


@Entry
def explicit_polynomial(at: int, _: float, __: int, ___: int) -> int:
    """Compute the polynomial of the last step."""
    x = context_at(at)
    N, y, f, mid = x.states, vec(x._y, x.states), vec(x._f_y, x.states), vec(x._mid, x.states)
    K, F, before, h = mat(x._K, MOST_STAGES, N), mat(x._F, 7, N), vec(x._before, N), x.t - x.began
    status = 0
    for i in range(STAGES + 1, MOST_STAGES):
        sum_of_stages(x, A[i], i, h, mid)
        status |= rate_at(x, x.began + C[i] * h, mid, K[i])
    x.rates += MOST_STAGES - STAGES - 1
    for o in range(N):
        delta = y[o] - before[o]
        F[0, o] = delta
        F[1, o] = h * K[0, o] - delta
        F[2, o] = 2.0 * delta - h * (f[o] + K[0, o])
    for k in range(4):
        for o in range(N):
            F[3 + k, o] = 0.0
        for i in range(MOST_STAGES):
            if D[k, i] != 0.0:
                for o in range(N):
                    F[3 + k, o] += h * D[k, i] * K[i, o]
    x.dense = 1
    return int(status)


@part
def explicit_state(x: Context, t: float, y: Numbers) -> None:
    """Compute the state at a time within the last step."""
    F, before = mat(x._F, 7, x.states), vec(x._before, x.states)
    z = (t - x.began) / (x.t - x.began)
    for o in range(x.states):
        total = 0.0
        for i in range(7):
            total += F[6 - i, o]
            total *= z if i % 2 == 0 else 1.0 - z
        y[o] = before[o] + total
