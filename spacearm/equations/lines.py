"""Motions that lead the tip along paths, each with steps of its own, until they arrive or end.

The joints move as J* dq = x' - [w_h x r; w_h], equation (1), where x' is the direction of the path
and w_h = D^-1 h the turn of the spacecraft that momentum brings. The curve of states
(q, attitude, s) is taken over its own length in (q, s), so that it stays smooth where s turns back
at a singularity. It is integrated by the embedded Runge-Kutta pair 5(4) of Cash & Karp (ACM Trans.
Math. Softw. 16, 201-222, 1990, DOI 10.1145/79505.79507).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from spacearm.equations.integration import weighted_sum
from spacearm.equations.kinematics import Parameters, Structure, jacobian_at, posture, response
from spacearm.equations.laws import attitude, quaternion_rate
from spacearm.equations.linear_algebra import Reflection, reflector, solve, unreflected
from spacearm.equations.measures import distance
from spacearm.equations.turns import right_jacobian, rotation

#: How a motion ends.
ARRIVED, SINGULAR, LIMIT, TILTED, MARGIN = range(5)
#: It has not ended.
RUNNING = -1
#: Columns of the tables of `at_length`.
PIECE, INTERVAL = 4, 30
#: As in `mechanics.distance`.
FADING = 0.3
#: Shorter steps are not made: where no longer one is accurate, the arm is at a singularity.
LEAST_STEP = 1e-11
#: The end of a piece is met to this share of its path, and to `LEAST_STEP`.
LANDED = 1e-12
#: Rate, by the share of the path, at which the tip returns to it from rounding errors.
ALONG = 10.0
STAGES = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (3 / 10, -9 / 10, 6 / 5),
    (-11 / 54, 5 / 2, -70 / 27, 35 / 27),
    (1631 / 55296, 175 / 512, 575 / 13824, 44275 / 110592, 253 / 4096),
)
FIFTH = (37 / 378, 0.0, 250 / 621, 125 / 594, 0.0, 512 / 1771)
FOURTH = (2825 / 27648, 0.0, 18575 / 48384, 13525 / 55296, 277 / 14336, 1 / 4)


class How(NamedTuple):
    """What ends motions, and how they are integrated.

    Attributes:
        h: (3,) angular momentum about the system CM, inertial axes, per unit of ds/dt.
        radians: (n,) what counts as a radian of each joint.
        lower: (n,) lower joint limits.
        upper: (n,) upper joint limits.
        most_tilt: Turn of the spacecraft from `home` that ends the motion [rad].
        margin: Distance to the singular set that ends the motion [rad].
        tolerance: Error of a step in each component of the state.
        stride: Longest step, along the curve in (q, s).
        least_stride: The first step. Others reach half as far as joint limits or the largest
            turn, or as the distance is from `care`, but need not be shorter than this.
        care: Distance to the singular set whose crossing matters [rad].
        spacing: States are met at multiples of this length, too; inf if they need not be.
    """

    h: Any
    radians: Any
    lower: Any
    upper: Any
    most_tilt: Any
    margin: Any
    tolerance: Any
    stride: Any
    least_stride: Any
    care: Any
    spacing: Any


class Seen(NamedTuple):
    """What is noted of a motion.

    Attributes:
        ended: How it ended, or RUNNING.
        s: Length of path behind the tip.
        distance: Least distance to the singular set so far [rad].
        where: Length of path at which it was least.
        slack: Least distance of a joint to its limits.
        tilt: Largest turn of the spacecraft [rad].
        last: (3, 5) length of the curve of states, s, distance, tilt and slack, in the last state
            and the two before it; inf where there was none.
    """

    ended: Any
    s: Any
    distance: Any
    where: Any
    slack: Any
    tilt: Any
    last: Any


def lead(
    xp: Any, tree: Structure, p: Parameters, q: Any, attitude: Any, home: Any, path: Any,
    pieces: Any, intervals: Any, most: int, keep: bool = False, **how: Any,
) -> tuple[Any, ...]:  # fmt: skip
    """Lead the tip of a floating arm along a path until it arrives or cannot go on.

    Args:
        xp: The array library.
        tree: The structure of the arm, of whose tips the first is led.
        p: Its numbers.
        q: (n,) joint positions at the start.
        attitude: (4,) attitude of the spacecraft then, quaternion xyzw.
        home: (4,) that from which its turn counts.
        path: (3,) numbers of its first and last piece, and its length.
        pieces: Table of pieces; see `at_length`.
        intervals: Table of intervals.
        most: Most steps.
        keep: Whether a row is kept of each step: (n + 1,) whether a multiple of the spacing was
            met, and q.
        how: The fields of `How`.

    Returns:
        (n,) q and (4,) attitude at the end, and (7,) how it ended, the first fields of `Seen` and
        the number of steps; with `keep` the rows.
    """
    c, n, (first, last, total) = How(**how), tree.n, path
    square = n == len(tree.rows)
    gain, near = ALONG / total, LANDED * total

    def slope(y: Any, piece: Any, sense: Any) -> tuple[Any, Any]:
        return tangent(xp, tree, p, y, at_length(xp, pieces, intervals, piece, y[n + 4]), gain,
                       sense, c.h)  # fmt: skip

    slope = xp.procedure(slope)
    to_set = xp.procedure(lambda q: distance(xp, tree, p, q, FADING, c.radians)[0])

    def judged(seen: Seen, y: Any, arc: Any, d: Any, arrived: Any) -> Seen:
        room = reduce(xp.minimum, xp.minimum(y[:n] - c.lower, c.upper - y[:n]))
        return judge(xp, seen, (arc, y[n + 4], d, _turned(xp, home, y[n : n + 4]), room),
                     arrived, c)  # fmt: skip

    zero = 0.0 * total
    y = xp.concatenate([q, attitude, xp.row(pieces, first)[:1]])
    k, sense = slope(y, first, zero)
    sense = sense if square else zero
    d = to_set(q)
    never = np.inf + zero
    seen = judged(
        Seen(zero + RUNNING, zero, never, zero, never, zero, xp.stack([never] * 15).reshape(3, 5)),
        y, zero, d, zero > 1.0,
    )  # fmt: skip

    def step(
        y: Any, k: Any, piece: Any, h: Any, arc: Any, stop: Any, turns: Any, *noted: Any
    ) -> Any:
        seen = Seen(*noted)
        change, error = _step(xp, lambda y: slope(y, piece, sense)[0], y, k, h)
        error = error / c.tolerance
        ahead = xp.minimum(xp.row(pieces, piece)[1], stop) - y[n + 4]
        good = error <= 1.0
        beyond = change[n + 4] > ahead + near
        made = good & ~beyond & (seen.ended < 0.0)
        y = xp.where(made, _unit_attitude(xp, y + change, n), y)
        arc = xp.where(made, arc + h, arc)
        at_end = y[n + 4] >= xp.row(pieces, piece)[1] - near - LEAST_STEP
        arrived, met = at_end & (piece >= last), y[n + 4] >= stop - near - LEAST_STEP
        piece = xp.where(at_end & (piece < last), piece + 1.0, piece)
        stop = xp.where(met, stop + c.spacing, stop)
        k, sign = slope(y, piece, sense)
        d = to_set(y[:n])
        signed = xp.where(sign * sense < 0.0, -d, d) if square else d
        after = judged(seen, y, arc, signed, arrived)
        some = xp.where(error > 1e-12, error, 1e-12)
        *_, tilt, slack = after.last[0]
        room = xp.minimum(xp.absolute(d - c.care), xp.absolute(slack))
        room = xp.minimum(room, xp.absolute(c.most_tilt - tilt))
        longer = xp.minimum(h * xp.minimum(5.0, 0.9 * some**-0.2), c.stride)
        longer = xp.minimum(longer, xp.maximum(c.least_stride, 0.5 * room))
        shorter = h * xp.where(error < np.inf, xp.maximum(0.2, 0.9 / xp.sqrt(xp.sqrt(some))), 0.2)
        h = xp.where(made, longer, xp.where(good, h * ahead / change[n + 4], shorter))
        now = [xp.where(made, a, b) for a, b in zip(after, seen, strict=True)]
        stuck = (h < LEAST_STEP) & (now[0] < 0.0)
        now[0] = xp.where(stuck, float(SINGULAR), now[0])
        found = (y, k, piece, h, arc, stop, turns + 1.0, *now, now[0] < 0.0)
        if not keep:
            return found
        met = xp.where(made & met, 1.0, 0.0)
        return *found, xp.concatenate([xp.stack([met]), y[:n]])

    start = (y, k, first + zero, c.least_stride + zero, zero, c.spacing + zero, zero)
    found = [*xp.while_any(step, *start, *seen, most=most, keep=keep)]
    rows = [found.pop()] if keep else []
    y, turns, noted = found[0], found[6], found[7:]
    return y[:n], y[n : n + 4], xp.stack([*noted[:-1], turns]), *rows


def tangent(
    xp: Any, tree: Structure, p: Parameters, y: Any, path: Any, gain: Any, sense: Any, h: Any
) -> tuple[Any, Any]:
    """Compute the direction of the curve of states.

    Args:
        xp: The array library.
        tree: The structure of the arm.
        p: Its numbers.
        y: (n + 5,) state: q, attitude as a quaternion xyzw, s.
        path: What `at_length` gives at s.
        gain: Rate by s at which the tip returns to its path from rounding errors.
        sense: Sign of det J* at the start; zero for redundant arms.
        h: (3,) angular momentum, inertial axes.

    Returns:
        (n + 5,) the direction; the sign of det J* of a square task.
    """
    n = tree.n
    q, e = y[:n], y[n : n + 4]
    place, goal, velocity, turn = path
    at = posture(xp, tree, p, q)
    T, r, rows = attitude(xp, e), at.tip_positions[0], np.array(tree.rows)
    R = T @ at.tip_rotations[0]
    off = 0.5 * xp.cross(R.T, goal.T).sum(axis=0)
    w_h = solve(xp, at.D, (h @ T)[:, None])[:, 0]
    linear = (velocity + gain * (place - T @ r)) @ T - xp.cross(w_h, r)
    angular = (turn + gain * off) @ T - w_h
    wanted = xp.concatenate([linear, angular])[rows]
    dq, sign = least_solution(xp, jacobian_at(xp, tree, at)[rows], wanted)
    share = 1.0 / xp.sqrt(1.0 + dq @ dq)
    share = xp.where(sense * sign < 0.0, -share, share)
    w = w_h + response(xp, tree, at)[3:] @ (tree.gains @ dq)
    return share * xp.concatenate([dq, quaternion_rate(xp, e, w), xp.stack([1.0])]), sign


def least_solution(xp: Any, J: Any, x: Any) -> tuple[Any, Any]:
    """Compute the least dq (n,) with J dq = x, J (k, n), by Householder's factors J^T = Q R.

    Returns:
        dq; the sign of det J if J is square.
    """
    (k, n), A, sign = J.shape, J.T, 1.0
    z: list[Any] = []
    reflections: list[Reflection] = []
    for i in range(k):  # half the work of the bidiagonal form
        diagonal, reflection, turn = reflector(xp, A[i:, i])
        reflections.append(reflection)
        sign = sign * xp.where(diagonal < 0.0, -turn, turn)
        z.append((x[i] - sum(A[j, i] * z[j] for j in range(i))) / diagonal)
        A = reflection.of(xp, A)
    return unreflected(xp, reflections, xp.concatenate([xp.stack(z), np.zeros(n - k)])), sign


def at_length(
    xp: Any, pieces: Any, intervals: Any, piece: Any, s: Any
) -> tuple[Any, Any, Any, Any]:
    """Evaluate a path: pieces in equal intervals that are cubic in position and turn.

    Args:
        xp: The array library.
        pieces: Table of lengths at which pieces begin and end, of the number of their first
            interval and of how many there are.
        intervals: Table of (4, 3) position at both ends and its derivatives there, by the share of
            the interval [m]. (3, 3) attitude at the start. (3, 3) turn to the end as a rotation
            vector in inertial axes [rad], and the derivatives of the rotation vector at both ends.
        piece: Number of the piece.
        s: Length along the path.

    Returns:
        (3,) position, (3, 3) attitude, (3,) velocity and (3,) angular velocity, by length.
    """
    begin, end, first, count = xp.row(pieces, piece)
    rate = count / (end - begin)
    share = (s - begin) * rate
    i = xp.minimum(xp.maximum(xp.floor(share), 0.0), count - 1.0)
    u, row = share - i, xp.row(intervals, first + i)
    x, R, f = row[:12].reshape(4, 3), row[12:21].reshape(3, 3), row[21:].reshape(3, 3)
    h01, h10, h11 = u * u * (3.0 - 2.0 * u), u * (1.0 - u) * (1.0 - u), u * u * (u - 1.0)
    d01, d10, d11 = 6.0 * u * (1.0 - u), (1.0 - u) * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)
    place = x[0] + h01 * (x[1] - x[0]) + h10 * x[2] + h11 * x[3]
    velocity = rate * (d01 * (x[1] - x[0]) + d10 * x[2] + d11 * x[3])
    turn = h01 * f[0] + h10 * f[1] + h11 * f[2]
    turning = rate * (d01 * f[0] + d10 * f[1] + d11 * f[2])
    return place, rotation(xp, turn) @ R, velocity, right_jacobian(xp, -turn) @ turning


def judge(xp: Any, seen: Seen, now: tuple[Any, Any, Any, Any, Any], arrived: Any, c: How) -> Seen:
    """Record a state just reached, and end the motion if it ends there.

    Beyond a singularity of a square task, where det J* has changed its sign, the distance counts as
    negative.

    Args:
        xp: The array library.
        seen: What was noted before.
        now: A row of `Seen.last`.
        arrived: Whether the path ends there.
        c: What ends motions.
    """
    _, s, d, tilt, room = now
    before = seen.last[0]
    last = xp.concatenate([xp.stack(now)[None], seen.last[:2]])
    lower = d < seen.distance
    least, where = xp.where(lower, d, seen.distance), xp.where(lower, s, seen.where)
    least, where = _bottom(xp, last, least, where)
    lost = (least <= 0.0) | ~xp.less_equal(d, d)
    ended = xp.where(arrived, float(ARRIVED), float(RUNNING))
    share: Any = 1.0
    for number, slack in (
        (TILTED, c.most_tilt - last[:, 3]),
        (LIMIT, last[:, 4]),
        (MARGIN, last[:, 2] - c.margin),
    ):
        there = slack[0] <= 0.0 if number == MARGIN else slack[0] < 0.0
        ended = xp.where(there, float(number), ended)
        share = xp.where(there, _crossing(xp, last[:, 1], slack), share)
    ended, share = xp.where(lost, float(SINGULAR), ended), xp.where(lost, 1.0, share)
    on_way = xp.where(before[1] < np.inf, before[1] + share * (s - before[1]), 0.0)
    s = xp.where(share < 1.0, on_way, s)
    return Seen(
        ended, xp.maximum(seen.s, s), xp.where(lost, 0.0, least), where,
        xp.minimum(seen.slack, room), xp.maximum(seen.tilt, tilt), last,
    )  # fmt: skip


def _crossing(xp: Any, s: Any, slack: Any) -> Any:
    """Return the share of the last step at which a slack falls to zero.

    By the line through the last two states, or earlier by the inverse parabola through three.

    Args:
        xp: The array library.
        s: (3,) lengths of path, the last one first.
        slack: (3,) slack there.
    """
    now, before, first = slack
    line = xp.where((before > 0.0) & (before < np.inf), before / (before - now), 0.0)
    back = (s[2] - s[1]) / (s[0] - s[1]) * now / ((first - now) * (first - before))
    curved = before * (back + first / ((before - now) * (first - now)))
    known = (before > 0.0) & (first > before) & (first < np.inf) & (curved > 0.0)
    return xp.where(known & (curved < line), curved, line)


def _bottom(xp: Any, last: Any, least: Any, where: Any) -> tuple[Any, Any]:
    """Return the least distance and its place, lowered to the parabola through three states."""
    now, middle, first = last
    x_0, x_2 = first[0] - middle[0], now[0] - middle[0]
    f_0, f_2 = first[2] - middle[2], now[2] - middle[2]
    curve = (f_2 / x_2 - f_0 / x_0) / (x_2 - x_0)
    slope = f_2 / x_2 - curve * x_2
    bottom = middle[2] - 0.25 * slope * slope / curve
    lower = (first[2] < np.inf) & (f_0 > 0.0) & (f_2 >= 0.0) & (bottom < least)
    return xp.where(lower, bottom, least), xp.where(lower, middle[1], where)


def _step(xp: Any, slope: Callable[[Any], Any], y: Any, k: Any, h: Any) -> tuple[Any, Any]:
    """Return the change of the state in a step from a state with slope k, and its error."""
    K = [k]
    for weights in STAGES:
        K.append(slope(y + h * weighted_sum(weights, K)))
    off = [a - b for a, b in zip(FIFTH, FOURTH, strict=True)]
    return h * weighted_sum(FIFTH, K), reduce(xp.maximum, xp.absolute(h * weighted_sum(off, K)))


def _unit_attitude(xp: Any, y: Any, n: int) -> Any:
    """Return a state whose quaternion has length 1."""
    e = y[n : n + 4]
    return xp.concatenate([y[:n], e / xp.sqrt(e @ e), y[n + 4 :]])


def _turned(xp: Any, home: Any, e: Any) -> Any:
    """Compute the angle between two attitudes, quaternions of length 1 [rad]."""
    apart = e - xp.where(home @ e < 0.0, -1.0, 1.0) * home
    return 4.0 * xp.arcsin(xp.minimum(1.0, 0.5 * xp.sqrt(apart @ apart)))
