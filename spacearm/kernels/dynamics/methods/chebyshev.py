"""Steps of RKC, the stabilised explicit method of order 2, for loose tolerances.

Sommeijer, Shampine & Verwer, J. Comput. Appl. Math. 88, 315-326 (1997): with s stages it is stable
up to 0.65 s^2 over the spectral radius of the Jacobian, which a power iteration estimates, so that
dampers cost rates by the square root of their stiffness. No Jacobian and no linear systems; the
state within a step is Hermite's cubic.
"""

from __future__ import annotations

import math

import numpy as np

from spacearm.kernels.dynamics.calls import Entry, rate_at
from spacearm.kernels.dynamics.context import Context, context_at, mat, vec
from spacearm.kernels.dynamics.methods.runge_kutta import COLLAPSED, DONE, FAILED, LEAST, RETREAT
from spacearm.kernels.lanes import part

DAMPED = 2.0 / 13.0
"""Damping within the interval of stability."""
STRETCH = 1.54
"""Number of stages squared per step times spectral radius."""
MOST_STAGES = 60
SAFETY, MOST = 0.8, 5.0
STRICT = 0.1
"""Share of the tolerances that it keeps: errors of low order add up, those of the others cancel."""
MARGIN, AGREES, ITERATIONS = 1.2, 0.05, 30
"""Of the power iteration: its result is enlarged by the first, and ends when it changes by less
than the second."""
AFRESH = 5
"""Steps between two estimates of the spectral radius."""
ROUNDING = 2.0**-26


@part
def spectral_radius(x: Context) -> int:
    """Estimate the spectral radius of the Jacobian at y as `eigenvalue`, from the last way."""
    N, y, f, there = x.states, vec(x._y, x.states), vec(x._f_y, x.states), vec(x._mid, x.states)
    K, way, size, length, last = mat(x._K, 16, N), mat(x._G, 3, N)[2], 0.0, 0.0, 0.0
    for o in range(N):
        size += y[o] ** 2
        length += way[o] ** 2
    if length == 0.0:
        for o in range(N):
            way[o] = f[o]
            length += f[o] ** 2
    if length == 0.0:
        x.eigenvalue = 0.0
        return 0
    distance = ROUNDING * max(math.sqrt(size), 1e-3)
    for i in range(ITERATIONS):
        share, length = distance / math.sqrt(length), 0.0
        for o in range(N):
            there[o] = y[o] + share * way[o]
        x.rates += 1
        if rate_at(x, x.t, there, K[1]):
            return FAILED
        for o in range(N):
            way[o] = K[1, o] - f[o]
            length += way[o] ** 2
        radius = math.sqrt(length) / distance
        x.eigenvalue = MARGIN * radius
        if length == 0.0 or (i > 0 and abs(radius - last) <= AGREES * radius):
            return 0
        last = radius
    return 0


@part
def stages(x: Context, s: int, h: float) -> int:
    """Compute the state after a step h by s stages in y."""
    N, y, f = x.states, vec(x._y, x.states), vec(x._f_y, x.states)
    before, K = vec(x._before, N), mat(x._K, 16, N)
    one, two, there = K[1], K[2], K[3]
    w_0 = 1.0 + DAMPED / s**2
    root = math.sqrt(w_0**2 - 1.0)
    turn = s * math.log(w_0 + root)
    w_1 = math.sinh(turn) * root / (math.cosh(turn) * s - w_0 * math.sinh(turn) / root)
    b_1 = b_2 = 1.0 / (2.0 * w_0) ** 2
    z_1, z_2, dz_1, dz_2, ddz_1, ddz_2 = w_0, 1.0, 1.0, 0.0, 0.0, 0.0
    share = w_1 * b_1
    c_1, c_2 = share, 0.0
    for o in range(N):
        two[o] = before[o]
        one[o] = before[o] + h * share * f[o]
    for _ in range(2, s + 1):
        z = 2.0 * w_0 * z_1 - z_2
        dz = 2.0 * w_0 * dz_1 - dz_2 + 2.0 * z_1
        ddz = 2.0 * w_0 * ddz_1 - ddz_2 + 4.0 * dz_1
        b, a = ddz / dz**2, 1.0 - z_1 * b_1
        mu, nu = 2.0 * w_0 * b / b_1, -b / b_2
        share = mu * w_1 / w_0
        if rate_at(x, x.began + h * c_1, one, there):
            return FAILED
        for o in range(N):
            step = h * share * (there[o] - a * f[o])
            new = mu * one[o] + nu * two[o] + (1.0 - mu - nu) * before[o] + step
            two[o] = one[o]
            one[o] = new
        c_1, c_2 = mu * c_1 + nu * c_2 + share * (1.0 - a), c_1
        b_1, b_2, z_1, z_2, dz_1, dz_2, ddz_1, ddz_2 = b, b_1, z, z_1, dz, dz_1, ddz, ddz_1
    x.rates += s - 1
    for o in range(N):
        y[o] = one[o]
    return 0


@Entry
def stabilised_step(at: int, _: float, __: int, ___: int) -> int:
    """Take a step from y to y, its length by the error control; return DONE or why not."""
    x = context_at(at)
    N, y, f = x.states, vec(x._y, x.states), vec(x._f_y, x.states)
    before, K, F = vec(x._before, N), mat(x._K, 16, N), mat(x._F, 7, N)
    least = 10.0 * (np.nextafter(x.t, np.inf) - x.t)
    for o in range(N):
        before[o] = y[o]
    x.began, most, refused = x.t, MOST, x.known == 0
    while True:
        if not x.step >= least:
            return COLLAPSED
        if refused or x.steps % AFRESH == 0:
            for o in range(N):
                y[o] = before[o]
            if spectral_radius(x):
                return FAILED
        x.known = 1
        longest = (MOST_STAGES**2 - 1.0) / STRETCH / max(x.eigenvalue, 1e-9)
        h = min(x.step, x.end - x.began, longest)
        s = max(2, 1 + int(math.sqrt(STRETCH * h * x.eigenvalue + 1.0)))
        x.stages, failed = s, stages(x, s, h)
        error = np.inf
        if failed == 0:
            x.t = x.began + h if h < x.end - x.began else x.end
            x.rates += 1
            failed = rate_at(x, x.t, y, K[0])
            error = error_of(x, h) if failed == 0 else np.inf
        if error < 1.0:
            break
        x.t, refused, most = x.began, True, 1.0
        if failed and h < least * RETREAT:
            return FAILED
        x.step = h * (max(LEAST, SAFETY * error ** (-1.0 / 3.0)) if error < np.inf else LEAST)
    factor = most if error == 0.0 else min(most, SAFETY * error ** (-1.0 / 3.0))
    for o in range(N):  # Hermite's cubic
        rise = y[o] - before[o]
        F[0, o] = h * f[o]
        F[1, o] = 3.0 * rise - h * (2.0 * f[o] + K[0, o])
        F[2, o] = h * (f[o] + K[0, o]) - 2.0 * rise
        f[o] = K[0, o]
    x.step, x.dense, x.cubic = max(h * factor, x.step if x.t == x.end else 0.0), 1, 1
    return DONE


@part
def error_of(x: Context, h: float) -> float:
    """Return the error of a step as a share of what is allowed."""
    y, before, f, K = vec(x._y, x.states), vec(x._before, x.states), vec(x._f_y, x.states), x._K
    there, total = vec(K, x.states), 0.0
    for o in range(x.states):
        scale = STRICT * (x.atol + x.rtol * max(abs(before[o]), abs(y[o])))
        off = 0.8 * (before[o] - y[o]) + 0.4 * h * (f[o] + there[o])
        total += (off / scale) ** 2
    norm = math.sqrt(total / x.counted)
    return float(norm) if norm == norm else np.inf
