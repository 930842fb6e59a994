"""Runs stepped to their end in compiled code, by DOP853 or, where that is stiff, RKC or Radau."""

from __future__ import annotations

import numpy as np

from spacearm.kernels.dynamics.calls import SAID, jump, rate_at
from spacearm.kernels.dynamics.context import (
    PACE,
    ROOM,
    WORKS,
    Context,
    context_at,
    found_of,
    mat,
    vec,
)
from spacearm.kernels.dynamics.events import state_at
from spacearm.kernels.dynamics.methods.runge_kutta import COLLAPSED, STABLE, STIFF
from spacearm.kernels.lanes import SETTINGS, compiler, part

FINISHED, STOPPED, FULL, GOES_ON, NO_RATE, NO_STEP, STIFF_NOW = range(7)
"""Why `advance` returns: the end, an event that ends the run, events to be taken, enough steps, a
rate that failed, a step that collapsed, RKC or Radau wanted, which are compiled only then."""
SLOW = 1e-5
"""The step has collapsed when `PACE` of them are shorter than this in the mean [s]."""
TRIAL, PATIENCE = 20, 500
"""Steps of Radau that must be too short; steps of DOP853 until stiffness counts again."""
FEW, MANY, TOO_MANY = 2, 16, 10
"""Stages of RKC that are few and many; steps in a row with many until Radau takes over."""

kernel = compiler(**SETTINGS, cache=True, said=SAID)
"""A function that is called from Python, compiled once and kept on disk."""


@kernel
def initiate(at: int) -> int:
    """Begin a run: the first rate, the events and output of the start, the first step."""
    x = context_at(at)
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
def sample(at: int) -> int:
    """Compute the torques at the end of the last step in `tau`; return their status."""
    x = context_at(at)
    jump(x.settle, x.here, x.t, x._y, 0)
    return int(jump(x.torques, x.here, x.t, x._y, 0))


@kernel
def resume(at: int) -> int:
    """Go on after a jump of the torques."""
    x = context_at(at)
    x.known, x.stiff, x.last_step = 0, 0, 0.0
    return NO_RATE if rate_at(x, x.t, vec(x._y, x.states), vec(x._f_y, x.states)) else GOES_ON


@kernel
def advance(at: int, most: int) -> int:
    """Take up to so many steps; return why it stopped."""
    x = context_at(at)
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
    """Go over to another method where the equations look stiff, and back where that pays not."""
    if x.implicit and x.mild:
        if x.stages > MANY:
            x.stiff = max(x.stiff, 0) + 1
        else:
            x.stiff = min(x.stiff, 0) - 1 if x.stages <= FEW else 0
        if x.stiff >= TOO_MANY:
            x.mild, x.implicit_step = 0, 0
        elif x.stiff <= -TRIAL:
            calm_down(x)
        else:
            return
    elif x.implicit:
        x.stiff = x.stiff + 1 if x.step * x.eigenvalue < worth(x) * STABLE else 0
        if x.stiff < TRIAL:
            return
        calm_down(x)
    elif x.calm > 0:
        x.calm -= 1
    elif x.stiff >= STIFF:
        x.implicit = 1
        x.patience = max(x.patience, PATIENCE)
    else:
        return
    if x.calm == 0 or not x.implicit:
        x.stiff, x.known, x.factored, x.last_step = 0, 0, 0, 0.0


@part
def worth(x: Context) -> float:
    """Return how many steps of DOP853 cost as much as one of Radau, with its Jacobian."""
    return float((x.coupled + 20) / 9)


@part
def calm_down(x: Context) -> None:
    """Go back to DOP853, each time for longer."""
    x.implicit, x.calm = 0, x.patience
    x.patience = min(2 * x.patience, 100 * PATIENCE)
    if x.eigenvalue > 0.0:
        x.step = min(x.step, STABLE / x.eigenvalue)
