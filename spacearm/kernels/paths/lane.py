"""Lanes of motions along paths: what a lane holds, and what is noted of each state it reaches."""

from __future__ import annotations

import math
from typing import NamedTuple

from spacearm.kernels.floating import Indices, Numbers
from spacearm.kernels.lanes import Lanes, step
from spacearm.kernels.paths.table import Table
from spacearm.kernels.paths.tangent import Problem

ARRIVED, SINGULAR, LIMIT, TILTED, MARGIN, STUCK = range(6)
"""How a motion ends."""

WAITING, FRESH, AT_CORNER = range(3)
"""What a lane's state is; see `Lane`."""

COMPONENTS = 7
"""Numbers a motion has: how it ended, the length behind it, the least distance to the singular set
and where along the path it was, the least distance to a joint limit, the largest turn of the
spacecraft, steps."""
FIRST_STEP = 0.02
LEAST_STEP = 1e-11
"""Shorter steps are not made: where no longer one is accurate, the arm is at a singularity."""
LANDED = 1e-12
"""The end of a piece is met to this share of its path, and to `LEAST_STEP`."""
ALONG = 10.0
"""Rate, by the share of the path, at which the tip returns to it from rounding errors."""


class Lane(NamedTuple):
    """State of the lanes.

    Attributes:
        item: (lanes,) motion in each lane, -1 if none.
        piece: (lanes,) piece of path.
        last: (lanes,) last piece of the path.
        state: (lanes,) FRESH if the state has just been reached; AT_CORNER if, besides, a piece of
            path ends there, so that its tangent is that of the piece before; else WAITING.
        y: (n + 5, lanes) states (q, quaternion xyzw, s).
        home: (4, lanes) the attitude from which the turn of the spacecraft counts.
        h: (lanes,) next step.
        gain: (lanes,) see `tangent`.
        sense: (lanes,) see `tangent`.
        arc: (lanes,) length of the curve of states so far.
        past: (3, 5, lanes) that length, s, distance to the singular set, turn of the spacecraft and
            distance to the joint limits, in this and the last two states.
        values: (COMPONENTS, lanes) what is known of the motion.
    """

    item: Indices
    piece: Indices
    last: Indices
    state: Indices
    y: Lanes
    home: Lanes
    h: Lanes
    gain: Lanes
    sense: Lanes
    arc: Lanes
    past: Lanes
    values: Lanes


@step
def take(
    table: Table, path: int, y0: Numbers, home: Numbers, item: int, n: int, a: Lane, l: int
) -> None:
    """Put a motion into a lane."""
    a.item[l], a.state[l], a.h[l], a.arc[l] = item, FRESH, FIRST_STEP, 0.0
    a.piece[l], a.last[l] = table.first[path], table.first[path + 1] - 1
    a.gain[l] = ALONG / table.end[a.last[l]]
    a.sense[l] = math.nan
    for i in range(n + 4):
        a.y[i, l] = y0[i, item]
    for i in range(4):
        a.home[i, l] = home[i, item]
    a.y[n + 4, l] = table.begin[a.piece[l]]
    for i in range(3):
        for j in range(5):
            a.past[i, j, l] = math.inf
    a.values[0, l], a.values[1, l], a.values[3, l] = STUCK, 0.0, 0.0
    a.values[2, l], a.values[4, l] = math.inf, math.inf
    a.values[5, l], a.values[6, l] = 0.0, 0.0


@step
def judge(
    p: Problem,
    table: Table,
    n: int,
    d: float,
    sign: float,
    a: Lane,
    ends: Numbers,
    values: Numbers,
    l: int,
) -> None:
    """Take note of a state just reached, and end the motion if it ends there.

    Beyond a singularity of a square task, where det J* has changed its sign, the distance d counts
    as negative.
    """
    square, v = n == len(p.rows), a.values[:, l]
    if math.isnan(a.sense[l]):
        a.sense[l] = sign if square else 0.0
    elif square and sign * a.sense[l] < 0.0:
        d = -d
    remember(a, l, a.y[n + 4, l], d, turned(n, a, l), slack(p, n, a, l))
    now, before = a.past[0], a.past[1]
    s = now[1, l]
    lowest(a, l, v)
    v[4] = min(v[4], now[4, l])
    v[5] = max(v[5], now[3, l])
    ended, share = -1, 1.0
    if v[2] <= 0.0 or math.isnan(d):
        ended, v[2] = SINGULAR, 0.0
    elif d <= p.margin:
        ended, share = MARGIN, crossing(before[2, l] - p.margin, d - p.margin)
    elif now[4, l] < 0.0:
        ended, share = LIMIT, crossing(before[4, l], now[4, l])
    elif now[3, l] > p.most_tilt:
        ended, share = TILTED, crossing(p.most_tilt - before[3, l], p.most_tilt - now[3, l])
    elif s >= table.end[a.piece[l]] - LANDED * table.end[a.last[l]] - LEAST_STEP:
        if a.piece[l] == a.last[l]:
            ended = ARRIVED
        else:
            a.piece[l] += 1
            a.state[l] = AT_CORNER
    if share < 1.0:
        s = before[1, l] + share * (s - before[1, l]) if before[1, l] < math.inf else 0.0
    v[1] = max(v[1], s)
    if ended >= 0:
        finish(n, ended, a, ends, values, l)


@step
def remember(a: Lane, l: int, s: float, d: float, tilt: float, room: float) -> None:
    """Put the numbers of a state before those of the last two."""
    for j in range(5):
        a.past[2, j, l] = a.past[1, j, l]
        a.past[1, j, l] = a.past[0, j, l]
    a.past[0, 0, l], a.past[0, 1, l], a.past[0, 2, l] = a.arc[l], s, d
    a.past[0, 3, l], a.past[0, 4, l] = tilt, room


@step
def lowest(a: Lane, l: int, v: Numbers) -> None:
    """Lower the least distance to that of the last state, or of a parabola through three."""
    now, middle, first = a.past[0], a.past[1], a.past[2]
    if now[2, l] < v[2]:
        v[2], v[3] = now[2, l], now[1, l]
    if not (first[2, l] < math.inf and middle[2, l] < first[2, l] and middle[2, l] <= now[2, l]):
        return
    x_0, x_2 = first[0, l] - middle[0, l], now[0, l] - middle[0, l]
    f_0, f_2 = first[2, l] - middle[2, l], now[2, l] - middle[2, l]
    curve = (f_2 / x_2 - f_0 / x_0) / (x_2 - x_0)
    slope = f_2 / x_2 - curve * x_2
    least = middle[2, l] - 0.25 * slope * slope / curve
    if least < v[2]:
        v[2], v[3] = least, middle[1, l]


@step
def turned(n: int, a: Lane, l: int) -> float:
    """Return the angle by which the spacecraft has turned [rad]."""
    cosine, apart = 0.0, 0.0
    for i in range(4):
        cosine += a.home[i, l] * a.y[n + i, l]
    for i in range(4):
        off = a.y[n + i, l] - math.copysign(1.0, cosine) * a.home[i, l]
        apart += off * off
    return 4.0 * math.asin(min(1.0, 0.5 * math.sqrt(apart)))


@step
def slack(p: Problem, n: int, a: Lane, l: int) -> float:
    """Return the least distance of a joint to its limits, negative beyond them."""
    least = math.inf
    for j in range(n):
        least = min(least, min(a.y[j, l] - p.lower[j], p.upper[j] - a.y[j, l]))
    return least


@step
def crossing(before: float, now: float) -> float:
    """Return the share of a step at which a function that falls linearly is zero."""
    return before / (before - now) if 0.0 < before < math.inf else 0.0


@step
def finish(n: int, ended: int, a: Lane, ends: Numbers, values: Numbers, l: int) -> None:
    """Write the numbers of a motion and empty its lane."""
    item = a.item[l]
    for i in range(n + 4):
        ends[i, item] = a.y[i, l]
    for i in range(COMPONENTS):
        values[i, item] = a.values[i, l]
    values[0, item] = ended
    a.item[l] = -1
