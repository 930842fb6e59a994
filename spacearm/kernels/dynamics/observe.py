"""What is reported of the states that a run has written, in compiled code."""

from __future__ import annotations

import math

from spacearm.kernels.dynamics import equations
from spacearm.kernels.dynamics.calls import SAID, jump
from spacearm.kernels.dynamics.context import bodies_of, context_at, mat, moving_of, vec
from spacearm.kernels.dynamics.decomposition import decompose
from spacearm.kernels.dynamics.rate import limit, spacecraft_rate
from spacearm.kernels.dynamics.tips import arm_task
from spacearm.kernels.floating import Numbers
from spacearm.kernels.lanes import (
    SETTINGS,
    add,
    compiler,
    dot,
    minus,
    put,
    read,
    read_rows,
    read_six,
    symmetric,
    times,
    turn,
)

kernel = compiler(**SETTINGS, cache=True, said=SAID)
"""A function that is called from Python, compiled once and kept on disk."""

BASE, MOMENTUM, BROUGHT, ENERGY = 0, 7, 13, 19
"""Columns after the n torques: pose of the spacecraft, momentum [linear; angular about the system
CM], the same of the joints alone, kinetic energy, status of the laws."""


@kernel
def observe(at: int) -> None:
    """Compute torques, poses, momenta and energies at all outputs written."""
    x = context_at(at)
    n, Y, t = x.n, mat(x._y_out, x.outputs, x.states), vec(x._t_out, x.outputs)
    seen, tau = mat(x._observed, x.outputs, n + 21), vec(x._tau, n)
    m, b, dq = moving_of(x), bodies_of(x), vec(x._dq, n)
    M = b[0].carried
    for i in range(x.written):
        y, out = Y[i], seen[i]
        jump(x.settle, x.here, t[i], y.ctypes.data, 0)
        out[n + 20] = jump(x.torques, x.here, t[i], y.ctypes.data, 0)
        limit(x)
        for j in range(n):
            out[j] = tau[j]
        equations.still(b, m)
        spacecraft_rate(x, y)
        a, energy = 2 * n, 0.0
        length = (y[a] ** 2 + y[a + 1] ** 2 + y[a + 2] ** 2 + y[a + 3] ** 2) ** 0.5
        for o in range(4):
            out[n + 3 + o] = y[a + o] / length
        p, h = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for j in range(n):
            p, h = add(p, times(dq[j], read(m.P[j]))), add(h, times(dq[j], read(m.D_q[j])))
            for k in range(n):
                energy += 0.5 * dq[j] * m.H[j, k] * dq[k]
        w, R = read(m.body[0].w), read_rows(x.R)
        turned, base = symmetric(read_six(m.whole[0].D), w), read(x.base)
        energy += dot(w, h) + 0.5 * dot(w, turned)
        linear, spun = turn(R, p), add(h, turned)
        put(out[n + BROUGHT :], linear)
        put(out[n + BROUGHT + 3 :], turn(R, h))
        if x.f > 0:
            linear = read(y[a + 7 :])
            energy += 0.5 * (dot(linear, linear) - dot(p, p)) / M
            base = minus(read(y[a + 4 :]), turn(R, read(m.whole[0].r_cm)))
        for body in range(x.N + 1):
            spun = add(spun, read(m.body[body].held))
        put(out[n + BASE :], base)
        put(out[n + MOMENTUM :], linear)
        put(out[n + MOMENTUM + 3 :], turn(R, spun))
        out[n + ENERGY] = energy


@kernel
def survey(at: int, result: Numbers) -> None:
    """Compute the extremes of the outputs: result (2,) receives both.

    They are the least sigma_min of the task and the largest turn of the spacecraft from the first
    output [rad].
    """
    x = context_at(at)
    n, Y, t = x.n, mat(x._y_out, x.outputs, x.states), vec(x._t_out, x.outputs)
    W, U, sigma = mat(x._look, x.k, n), mat(x._look_U, x.k, x.k), vec(x._look_sigma, x.k)
    result[0], result[1] = math.inf, 0.0
    for i in range(x.written):
        jump(x.settle, x.here, t[i], Y[i].ctypes.data, 0)
        arm_task(x, W)
        decompose(W, U, sigma)
        result[0] = min(result[0], sigma[min(x.k, n) - 1] if x.k <= n else 0.0)
        cosine, first, now = 0.0, 0.0, 0.0
        for o in range(2 * n, 2 * n + 4):
            cosine += Y[0, o] * Y[i, o]
            first += Y[0, o] ** 2
            now += Y[i, o] ** 2
        cosine = min(abs(cosine) / math.sqrt(first * now), 1.0)
        result[1] = max(result[1], 2.0 * math.acos(cosine))
