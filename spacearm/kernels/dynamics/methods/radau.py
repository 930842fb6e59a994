"""Steps of Radau IIA of order 5, for stiff equations.

Hairer & Wanner, Solving Ordinary Differential Equations II (1996), section IV.8, with its control
of Newton's iteration and of the step; constants as in scipy, dense output of order 3.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate._ivp import radau as constants

from spacearm.kernels.dynamics.calls import Entry, rate_at
from spacearm.kernels.dynamics.context import (
    Context,
    carray,
    context_at,
    mat,
    pointer,
    vec,
    whole_numbers,
)
from spacearm.kernels.dynamics.methods.linear import ROUNDING, differentiate, factorise, solve
from spacearm.kernels.dynamics.methods.runge_kutta import COLLAPSED, DONE, FAILED
from spacearm.kernels.floating import Numbers
from spacearm.kernels.lanes import part

C = np.ascontiguousarray(constants.C)
E = np.ascontiguousarray(constants.E)
T = np.ascontiguousarray(constants.T)
TI = np.ascontiguousarray(constants.TI)
P = np.ascontiguousarray(constants.P)
REAL = float(constants.MU_REAL)
COMPLEX = complex(constants.MU_COMPLEX)
ITERATIONS = 6
"""Most steps of Newton's iteration."""
SLOW = 1e-3
"""Ratio of the steps of Newton's iteration above which the Jacobian is computed anew."""
LEAST, MOST = 0.2, 10.0


@part
def factors(x: Context, h: float) -> None:
    """Factorise the two matrices of Newton's iteration for a step h."""
    M, order = x.coupled - x.n, whole_numbers(x._order, 2, x.states)
    complex_one = carray(pointer(x._complex), (M, M), np.complex128)
    factorise(x, REAL / h, mat(x._real, M, M), order[0])
    factorise(x, COMPLEX / h, complex_one, order[1])
    x.factored = 1


@part
def size(x: Context, error: Numbers) -> float:
    """Return the weighted norm of an error."""
    y, before, total = vec(x._y, x.states), vec(x._before, x.states), 0.0
    for o in range(x.states):
        scale = x.atol + x.rtol * max(abs(before[o]), abs(y[o]))
        total += (error[o] / scale) ** 2
    return float(np.sqrt(total / x.counted))


@part
def stages(x: Context, h: float) -> tuple[int, float]:
    """Solve for the stages Z by Newton's iteration; return its steps, 0 if it fails, and speed."""
    N, M, before, mid = x.states, x.coupled - x.n, vec(x._before, x.states), vec(x._mid, x.states)
    Z, W, G = mat(x._Z, 3, N), mat(x._W, 3, N), mat(x._G, 3, N)
    order, real = whole_numbers(x._order, 2, N), mat(x._real, M, M)
    complex_one = carray(pointer(x._complex), (M, M), np.complex128)
    solution = carray(pointer(x._solution), (N,), np.complex128)
    tolerance = max(10.0 * ROUNDING / x.rtol, min(0.03, np.sqrt(x.rtol)))
    last, speed = 0.0, 0.0
    for k in range(ITERATIONS):
        for i in range(3):
            for o in range(N):
                mid[o] = before[o] + Z[i, o]
            if rate_at(x, x.began + h * C[i], mid, G[i]):
                return 0, 0.0
        x.rates += 3
        for o in range(N):
            mid[o] = -REAL / h * W[0, o]
            solution[o] = -COMPLEX / h * (W[1, o] + 1j * W[2, o])
            for i in range(3):
                mid[o] += TI[0, i] * G[i, o]
                solution[o] += (TI[1, i] + 1j * TI[2, i]) * G[i, o]
        solve(x, REAL / h, real, order[0], mid)
        solve(x, COMPLEX / h, complex_one, order[1], solution)
        total = 0.0
        for o in range(N):
            scale, z = x.atol + x.rtol * abs(before[o]), solution[o]
            total += (mid[o] ** 2 + z.real**2 + z.imag**2) / scale**2
        norm = np.sqrt(total / (3.0 * x.counted))
        if not norm < np.inf:
            return 0, 0.0
        if k > 0:
            speed = norm / last
            if speed >= 1.0 or speed ** (ITERATIONS - k) / (1.0 - speed) * norm > tolerance:
                return 0, speed
        for o in range(N):
            W[0, o] += mid[o]
            W[1, o] += solution[o].real
            W[2, o] += solution[o].imag
            for i in range(3):
                Z[i, o] = T[i, 0] * W[0, o] + T[i, 1] * W[1, o] + T[i, 2] * W[2, o]
        if norm == 0.0 or (k > 0 and speed / (1.0 - speed) * norm < tolerance):
            return k + 1, speed
        last = norm
    return 0, speed


@part
def guess(x: Context, h: float, origin: Numbers, knows: bool) -> None:
    """Take the polynomial of the last step, which began at `origin`, as the first guess."""
    N, before, F = x.states, vec(x._before, x.states), mat(x._F, 7, x.states)
    Z, W = mat(x._Z, 3, N), mat(x._W, 3, N)
    for i in range(3):
        for o in range(N):
            Z[i, o] = 0.0
        if knows:
            z = 1.0 + C[i] * h / x.last_step
            for o in range(N):
                Z[i, o] = origin[o] + z * (F[0, o] + z * (F[1, o] + z * F[2, o])) - before[o]
    for i in range(3):
        for o in range(N):
            W[i, o] = TI[i, 0] * Z[0, o] + TI[i, 1] * Z[1, o] + TI[i, 2] * Z[2, o]


@Entry
def implicit_step(at: int, _: float, __: int, ___: int) -> int:
    """Take a step from y to y, its length by the error control; return DONE or why not."""
    x = context_at(at)
    N, y, f, mid = x.states, vec(x._y, x.states), vec(x._f_y, x.states), vec(x._mid, x.states)
    before, origin, Z = vec(x._before, N), mat(x._K, 16, N)[1], mat(x._Z, 3, N)
    F, G, real = mat(x._F, 7, N), mat(x._G, 3, N), mat(x._real, x.coupled - x.n, x.coupled - x.n)
    order = whole_numbers(x._order, 2, N)[0]
    least = 10.0 * (np.nextafter(x.t, np.inf) - x.t)
    knows = x.cubic == 1 and x.last_step > 0.0
    for o in range(N):
        origin[o] = before[o]
        before[o] = y[o]
    x.began = x.t
    if x.known == 0 and differentiate(x, x.t):
        return FAILED
    refused, error, newton, speed, safety, h = False, 0.0, 0, 0.0, 1.0, x.step
    while True:
        if not x.step >= least:
            return COLLAPSED
        h = x.step
        if h > x.end - x.began:
            h, x.factored = x.end - x.began, 0
        while True:
            if x.factored == 0:
                factors(x, h)
            guess(x, h, origin, knows)
            newton, speed = stages(x, h)
            if newton > 0 or x.known == 2:
                break
            if differentiate(x, x.began):
                return FAILED
        if newton == 0:
            x.step, x.factored = 0.5 * h, 0
            continue
        for o in range(N):
            y[o] = before[o] + Z[2, o]
            G[0, o] = (E[0] * Z[0, o] + E[1] * Z[1, o] + E[2] * Z[2, o]) / h
            mid[o] = f[o] + G[0, o]
        solve(x, REAL / h, real, order, mid)
        error = size(x, mid)
        if refused and error > 1.0:
            for o in range(N):
                G[1, o] = before[o] + mid[o]
            if rate_at(x, x.began, G[1], mid) == 0:
                for o in range(N):
                    mid[o] += G[0, o]
                solve(x, REAL / h, real, order, mid)
                error = size(x, mid)
        safety = 0.9 * (2 * ITERATIONS + 1) / (2 * ITERATIONS + newton)
        if error <= 1.0:
            break
        x.step = h * max(LEAST, safety * predicted(x, h, error)) if error < np.inf else 0.1 * h
        x.factored, refused = 0, True
        for o in range(N):
            y[o] = before[o]
    again = newton > 2 and speed > SLOW
    factor = min(MOST, safety * predicted(x, h, error))
    if not again and factor < 1.2:
        factor = 1.0
    else:
        x.factored = 0
    for o in range(N):
        for i in range(3):
            F[i, o] = 0.0
            for k in range(3):
                F[i, o] += Z[k, o] * P[k, i]
    x.t = x.began + h if h < x.end - x.began else x.end
    x.rates += 1
    x.known = 1
    if rate_at(x, x.t, y, f):
        return FAILED
    if again and differentiate(x, x.t):
        return FAILED
    x.last_step, x.last_error, x.step, x.dense, x.cubic = h, error, h * factor, 1, 1
    return DONE


@part
def predicted(x: Context, h: float, error: float) -> float:
    """Return the factor of the next step, by the errors of this step and the last."""
    if error == 0.0:
        return MOST
    trend = 1.0
    if x.last_step > 0.0 and x.last_error > 0.0:
        trend = min(1.0, h / x.last_step * (x.last_error / error) ** 0.25)
    return float(trend * error**-0.25)


@Entry
def implicit_state(at: int, t: float, _: int, __: int) -> int:
    """Compute the state at a time within the last step, a cubic of `F`, in `mid`."""
    x = context_at(at)
    F, before, y = mat(x._F, 7, x.states), vec(x._before, x.states), vec(x._mid, x.states)
    z = (t - x.began) / (x.t - x.began)
    for o in range(x.states):
        y[o] = before[o] + z * (F[0, o] + z * (F[1, o] + z * F[2, o]))
    return 0
