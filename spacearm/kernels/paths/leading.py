"""Many arms led along paths at once, each lane with steps of its own.

The embedded Runge-Kutta pair 5(4) of Cash & Karp (ACM Trans. Math. Softw. 16, 201-222, 1990,
DOI 10.1145/79505.79507). A lane that has come to its end takes the next item.
"""

from __future__ import annotations

import math

import numpy as np

from spacearm.kernels.cpu import BIDIAGONAL, kernel, nearness, work
from spacearm.kernels.floating import Bodies, Indices, Numbers
from spacearm.kernels.lanes import LANES, Lanes, step
from spacearm.kernels.nearness import FADING, distance
from spacearm.kernels.paths.lane import (
    AT_CORNER,
    COMPONENTS,
    FRESH,
    LANDED,
    LEAST_STEP,
    SINGULAR,
    STUCK,
    WAITING,
    Lane,
    finish,
    judge,
    take,
)
from spacearm.kernels.paths.table import Table
from spacearm.kernels.paths.tangent import Problem, Scratch, tangent

STAGES = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [1 / 5, 0.0, 0.0, 0.0, 0.0],
    [3 / 40, 9 / 40, 0.0, 0.0, 0.0],
    [3 / 10, -9 / 10, 6 / 5, 0.0, 0.0],
    [-11 / 54, 5 / 2, -70 / 27, 35 / 27, 0.0],
    [1631 / 55296, 175 / 512, 575 / 13824, 44275 / 110592, 253 / 4096],
])  # fmt: skip
FIFTH = np.array([37 / 378, 0.0, 250 / 621, 125 / 594, 0.0, 512 / 1771])
ERROR = FIFTH - np.array([2825 / 27648, 0.0, 18575 / 48384, 13525 / 55296, 277 / 14336, 1 / 4])

MOST_STEPS = 200_000


@kernel
def lead(
    b: Bodies,
    tip: int,
    E: Numbers,
    p: Problem,
    table: Table,
    path: Indices,
    y0: Numbers,
    home: Numbers,
    ends: Numbers,
    values: Numbers,
) -> None:
    """Lead the tips of m arms along their paths, until they arrive or cannot go on.

    Args:
        b: The arm.
        tip: Body that the tip is fixed to.
        E: (3,) the tip in the frame of that body [m].
        p: What all have in common.
        table: The paths.
        path: (m,) the path of each.
        y0: (n + 4, m) starts: q, and the spacecraft's attitude as a quaternion xyzw.
        home: (4, m) the attitudes from which the turn of the spacecraft counts.
        ends: (n + 4, m) receives the ends.
        values: (COMPONENTS, m) receives the numbers of each motion.
    """
    n, m = len(p.radian), y0.shape[1]
    w = work(len(b) - 1, n)
    A, x, near = np.empty((n, 6, LANES)), np.empty(1, BIDIAGONAL), np.empty((1 + n, LANES))
    d = nearness(len(b), n, n)
    c = Scratch(
        A=np.empty((n, 6, LANES)),
        beta=np.empty((6, LANES)),
        tau=np.empty((6, LANES)),
        x=np.empty((6, LANES)),
        dq=np.empty((n, LANES)),
        w=np.empty((3, LANES)),
        sign=np.empty(LANES),
        t=np.empty((2, LANES)),
    )
    a = Lane(
        item=np.full(LANES, -1),
        piece=np.zeros(LANES, np.int64),
        last=np.zeros(LANES, np.int64),
        state=np.zeros(LANES, np.int64),
        y=np.zeros((n + 5, LANES)),
        home=np.zeros((4, LANES)),
        h=np.zeros(LANES),
        gain=np.zeros(LANES),
        sense=np.zeros(LANES),
        arc=np.zeros(LANES),
        past=np.zeros((3, 5, LANES)),
        values=np.zeros((COMPONENTS, LANES)),
    )
    z, k = np.empty((n + 5, LANES)), np.empty((6, n + 5, LANES))
    begun = 0
    while True:
        busy = 0
        for l in range(LANES):
            if a.item[l] < 0 and begun < m:
                take(table, path[begun], y0, home, begun, n, a, l)
                begun += 1
            busy += 1 if a.item[l] >= 0 else 0
        if busy == 0:
            return
        for stage in range(6):
            for i in range(n + 5):
                for l in range(LANES):
                    z[i, l] = a.y[i, l]
            for j in range(stage):
                for i in range(n + 5):
                    for l in range(LANES):
                        z[i, l] += a.h[l] * STAGES[stage, j] * k[j, i, l]
            tangent(b, tip, E, p, table, a.piece, a.gain, a.sense, z, w, c, k[stage])
            if stage == 0:
                distance(b, tip, p.rows, p.scale, p.radian, FADING, w, A, x[0], d, near)
                for l in range(LANES):
                    if a.item[l] >= 0 and a.state[l] == FRESH:
                        judge(p, table, n, near[0, l], c.sign[l], a, ends, values, l)
        for l in range(LANES):
            if a.item[l] >= 0:
                advance(p, table, n, near[0, l], k, a, ends, values, l)


@step
def advance(
    p: Problem,
    table: Table,
    n: int,
    d: float,
    k: Lanes,
    a: Lane,
    ends: Numbers,
    values: Numbers,
    l: int,
) -> None:
    """Make the step of a lane if it is accurate enough and not too long; choose the next."""
    if a.state[l] == AT_CORNER:
        a.state[l] = WAITING
        return
    h, s = a.h[l], a.y[n + 4, l]
    error, ds = 0.0, 0.0
    for i in range(n + 5):
        off = 0.0
        for stage in range(6):
            off += ERROR[stage] * k[stage, i, l]
        error = max(error, abs(h * off)) if off == off else math.inf
    for stage in range(6):
        ds += h * FIFTH[stage] * k[stage, n + 4, l]
    error /= p.tolerance
    end, a.state[l] = table.end[a.piece[l]], WAITING
    a.values[6, l] += 1.0
    if not error <= 1.0:
        a.h[l] = h * (max(0.2, 0.9 * error**-0.25) if error < math.inf else 0.2)
    elif s + ds > end + LANDED * table.end[a.last[l]]:
        a.h[l] = h * (end - s) / ds
    else:
        for i in range(n + 5):
            for stage in range(6):
                a.y[i, l] += h * FIFTH[stage] * k[stage, i, l]
        length = 0.0
        for i in range(n, n + 4):
            length += a.y[i, l] * a.y[i, l]
        for i in range(n, n + 4):
            a.y[i, l] /= math.sqrt(length)
        a.arc[l] += h
        a.state[l] = FRESH
        growth = min(5.0, 0.9 * error**-0.2) if error > 0.0 else 5.0
        room = min(abs(d - p.care), abs(a.past[0, 4, l]))
        a.h[l] = min(h * growth, p.stride, max(p.least_stride, 0.5 * room))
    if a.h[l] < LEAST_STEP or a.values[6, l] >= MOST_STEPS:
        ended = SINGULAR if a.h[l] < LEAST_STEP else STUCK
        finish(n, ended, a, ends, values, l)
