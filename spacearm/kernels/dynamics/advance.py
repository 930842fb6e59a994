"""Runs stepped to their end in compiled code, by DOP853 or, where that is stiff, Radau."""

from __future__ import annotations

import numpy as np

from spacearm.kernels.dynamics.calls import SAID, jump, rate_at
from spacearm.kernels.dynamics.context import PACE, ROOM, WORKS, Context, found_of, mat, vec
from spacearm.kernels.dynamics.events import state_at
from spacearm.kernels.dynamics.runge_kutta import COLLAPSED, STABLE, STIFF
from spacearm.kernels.lanes import SETTINGS, compiler, part

FINISHED, STOPPED, FULL, GOES_ON, NO_RATE, NO_STEP, STIFF_NOW = range(7)
"""Why `advance` returns: the end, an event that ends the run, events to be taken, enough steps, a
rate that failed, a step that collapsed, Radau wanted, which is compiled only then."""
SLOW = 1e-5
"""The step has collapsed when `PACE` of them are shorter than this in the mean [s]."""
WORTH = 6.0 * STABLE
"""A step of Radau costs some six of DOP853; it must be longer than so many stable ones."""
TRIAL, PATIENCE = 20, 500
"""Steps of Radau that must fall short of that; steps of DOP853 until stiffness counts again."""

kernel = compiler(**SETTINGS, cache=True, said=SAID)
"""A function that is called from Python, compiled once and kept on disk."""


@kernel
def initiate(x: Context) -> int:
    """Begin a run: the first rate, the events and output of the start, the first step."""
    N, y, f, mid = x.states, vec(x._y, x.states), vec(x._f_y, x.states), vec(x._mid, x.states)
    other, pace, d0, d1, d2 = mat(x._K, 16, N)[1], vec(x._pace, PACE), 0.0, 0.0, 0.0
    if rate_at(x, x.t, y, f):
        return NO_RATE
    for o in range(PACE):
        pace[o] = -np.inf
    jump(x.look, x.here, 0.0, 0, 0)
    for o in range(N):
        scale = x.atol + x.rtol * abs(y[o])
        d0 += (y[o] / scale) ** 2
        d1 += (f[o] / scale) ** 2
    d0, d1 = np.sqrt(d0 / x.counted), np.sqrt(d1 / x.counted)
    h = min(1e-6 if d0 < 1e-5 or d1 < 1e-5 else 0.01 * d0 / d1, x.end - x.t)
    for o in range(N):
        mid[o] = y[o] + h * f[o]
    if rate_at(x, x.t + h, mid, other) == 0:
        for o in range(N):
            d2 += ((other[o] - f[o]) / (x.atol + x.rtol * abs(y[o]))) ** 2
        d2 = np.sqrt(d2 / x.counted) / h
    most = max(d1, d2)
    x.step = min(100.0 * h, max(1e-6, 1e-3 * h) if most <= 1e-15 else (0.01 / most) ** 0.125)
    return GOES_ON


@kernel
def sample(x: Context) -> int:
    """Compute the torques at the end of the last step in `tau`; return their status."""
    jump(x.settle, x.here, x.t, x._y, 0)
    return int(jump(x.torques, x.here, x.t, x._y, 0))


@kernel
def resume(x: Context) -> int:
    """Go on after a jump of the torques."""
    x.known, x.stiff, x.last_step = 0, 0, 0.0
    return NO_RATE if rate_at(x, x.t, vec(x._y, x.states), vec(x._f_y, x.states)) else GOES_ON


@kernel
def advance(x: Context, most: int) -> int:
    """Take up to so many steps; return why it stopped."""
    y, before, work = vec(x._y, x.states), vec(x._before, x.states), 2 * x.n + 13
    pace, mid = vec(x._pace, PACE), vec(x._mid, x.states)
    for _ in range(most):
        if x.stopped >= 0:
            return STOPPED
        if x.t >= x.end:
            return FINISHED
        if x.implicit and x.implicit_step == 0:
            return STIFF_NOW
        failed: int = jump(x.implicit_step if x.implicit else x.explicit, x.here, 0.0, 0, 0)
        if failed:
            for o in range(x.states):
                y[o] = before[o]
            x.t = x.began
            return NO_STEP if failed == COLLAPSED else NO_RATE
        x.steps += 1
        jump(x.look, x.here, 0.0, 1, 0)
        end = found_of(x, x.stopped).t if x.stopped >= 0 else x.t
        if end < x.t:
            state_at(x, end)
            x.t = end
            for o in range(x.states):
                y[o] = mid[o]
        for o in range(work, work + WORKS):
            x.exchanged += abs(y[o] - before[o])
        if x.t - pace[x.steps % PACE] < PACE * SLOW:
            return NO_STEP
        pace[x.steps % PACE] = x.t
        if x.switches:
            choose(x)
        if x.happened >= ROOM // 2 and x.stopped < 0:
            return FULL
    return GOES_ON


@part
def choose(x: Context) -> None:
    """Go over to Radau where the equations look stiff, and back where it does not pay."""
    if x.implicit:
        x.stiff = x.stiff + 1 if x.step * x.eigenvalue < WORTH else 0
        if x.stiff < TRIAL:
            return
        x.implicit, x.calm = 0, x.patience
        x.patience = min(2 * x.patience, 100 * PATIENCE)
        x.step = min(x.step, STABLE / x.eigenvalue)
    elif x.calm > 0:
        x.calm -= 1
    elif x.stiff >= STIFF:
        x.implicit = 1
        x.patience = max(x.patience, PATIENCE)
    else:
        return
    if x.calm == 0 or not x.implicit:
        x.stiff, x.known, x.factored, x.last_step = 0, 0, 0, 0.0
