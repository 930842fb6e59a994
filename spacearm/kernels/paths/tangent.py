"""The motion that leads the tip along its path: the tangent of the curve of states.

The joints move as J* dq = x' - [w_h x r_E; w_h], equation (1), where x' is the direction of the
path and w_h = D^-1 h the turn of the spacecraft that momentum brings. The curve of states
(q, attitude, s) is taken over its own length in (q, s), as in `spacearm.motion.following`, so that
it stays smooth where s turns back at a singularity.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from spacearm.kernels.floating import Bodies, Indices, Numbers, Work, generalized_jacobian, solve
from spacearm.kernels.lanes import Lanes, Vector, dot, step, vector
from spacearm.kernels.paths.table import Table, at_length
from spacearm.kernels.singular_values import reflect, reflector


class Problem(NamedTuple):
    """What all lanes have in common.

    Attributes:
        offset: (N + 1,) position of each body's joint at q = 0.
        rows: (k,) task rows of the twist.
        scale: (k,) their factors.
        radian: (n,) what counts as a radian of each joint.
        h: (3,) angular momentum about the system CM, inertial axes, per unit of ds/dt.
        lower: (n,) lower joint limits.
        upper: (n,) upper joint limits.
        most_tilt: Turn of the spacecraft from its start that ends the motion [rad].
        margin: Distance to the singular set that ends the motion [rad].
        tolerance: Error of a step in each component of the state.
        stride: Longest step, along the curve in (q, s).
        least_stride: Steps reach half as far as the limits, or as the distance is from `care`, but
            need not be shorter than this.
        care: Distance to the singular set whose crossing matters [rad].
    """

    offset: Numbers
    rows: Indices
    scale: Numbers
    radian: Numbers
    h: Numbers
    lower: Numbers
    upper: Numbers
    most_tilt: float
    margin: float
    tolerance: float
    stride: float
    least_stride: float
    care: float


class Scratch(NamedTuple):
    """Work arrays, by lanes.

    Attributes:
        A: (n, 6, lanes) rows of J*, transposed, and then its factors Q R.
        beta: (6, lanes) diagonal of R.
        tau: (6, lanes) factors of the reflections.
        x: (6, lanes) what the tip is to do, in spacecraft axes.
        dq: (n, lanes) joint rates by s.
        w: (3, lanes) w_h, then the turn of the spacecraft by s.
        sign: (lanes,) sign of det J* of a square task.
        t: (2, lanes) scratch.
    """

    A: Lanes
    beta: Lanes
    tau: Lanes
    x: Lanes
    dq: Lanes
    w: Lanes
    sign: Lanes
    t: Lanes


@step
def tangent(
    b: Bodies,
    tip: int,
    E: Numbers,
    p: Problem,
    table: Table,
    piece: Indices,
    gain: Lanes,
    sense: Lanes,
    y: Lanes,
    w: Work,
    c: Scratch,
    k: Lanes,
) -> None:
    """Compute the tangent k (n + 5, lanes) in the states y = (q, quaternion xyzw, s).

    Args:
        b: The arm.
        tip: Body that the tip is fixed to.
        E: (3,) the tip in the frame of that body [m].
        p: What all lanes have in common.
        table: The paths.
        piece: (lanes,) piece of path of each lane.
        gain: (lanes,) rate by s at which the tip returns to its path from rounding errors.
        sense: (lanes,) sign of det J* at the start; zero for redundant arms.
        y: (n + 5, lanes) states.
        w: Receives J* and the bodies.
        c: Scratch.
        k: (n + 5, lanes) receives the tangent.
    """
    n, rows, lanes = len(p.radian), len(p.rows), y.shape[1]
    for i in range(1, len(b)):
        for l in range(lanes):
            w.body[i].q[l] = b[i].gain * y[b[i].column, l] + p.offset[i]
    generalized_jacobian(b, tip, E, w)
    for l in range(lanes):
        wanted(tip, p, table, piece[l], gain[l], y, w, c, l)
    for j in range(n):
        for i in range(rows):
            for l in range(lanes):
                c.A[j, i, l] = w.J[j, p.rows[i], l]
    least_solution(rows, c)
    for l in range(lanes):
        length = 1.0
        for j in range(n):
            length += c.dq[j, l] * c.dq[j, l]
        share = 1.0 / math.sqrt(length)
        if sense[l] * c.sign[l] < 0.0:
            share = -share
        for j in range(n):
            k[j, l] = share * c.dq[j, l]
            for x in range(3):
                c.w[x, l] += w.J[j, 3 + x, l] * c.dq[j, l]
        k[n + 4, l] = share
    for i in range(1, len(b)):
        if b[i].on_chain and not b[i].slides:
            for l in range(lanes):
                rate = b[i].gain * c.dq[b[i].column, l]
                for x in range(3):
                    c.w[x, l] -= rate * w.body[i].R[x, 2, l]
    for l in range(lanes):
        half = 0.5 * k[n + 4, l]
        a_x, a_y, a_z, a_w = y[n, l], y[n + 1, l], y[n + 2, l], y[n + 3, l]
        w_x, w_y, w_z = half * c.w[0, l], half * c.w[1, l], half * c.w[2, l]
        k[n, l] = a_w * w_x + a_y * w_z - a_z * w_y
        k[n + 1, l] = a_w * w_y + a_z * w_x - a_x * w_z
        k[n + 2, l] = a_w * w_z + a_x * w_y - a_y * w_x
        k[n + 3, l] = -a_x * w_x - a_y * w_y - a_z * w_z


@step
def wanted(
    tip: int,
    p: Problem,
    table: Table,
    piece: int,
    gain: float,
    y: Lanes,
    w: Work,
    c: Scratch,
    l: int,
) -> None:
    """Compute what the joints are to do to the tip by s, c.x, and w_h, in spacecraft axes."""
    n = len(p.radian)
    X, Y, Z = attitude(y[n, l], y[n + 1, l], y[n + 2, l], y[n + 3, l])  # rows of T
    place, R, v, turn = at_length(table, piece, y[n + 4, l])
    r, k = vector(w.r_E, l), w.body[tip].R
    off = (place[0] - dot(X, r), place[1] - dot(Y, r), place[2] - dot(Z, r))
    v = (v[0] + gain * off[0], v[1] + gain * off[1], v[2] + gain * off[2])
    v = back(X, Y, Z, v)
    # R T^T in spacecraft axes: columns of T^T R beside those of the tip, half their cross products
    angle = (0.0, 0.0, 0.0)
    for j in range(3):
        goal = back(X, Y, Z, (R[0][j], R[1][j], R[2][j]))
        a = (k[0, j, l], k[1, j, l], k[2, j, l])
        angle = (
            angle[0] + 0.5 * (a[1] * goal[2] - a[2] * goal[1]),
            angle[1] + 0.5 * (a[2] * goal[0] - a[0] * goal[2]),
            angle[2] + 0.5 * (a[0] * goal[1] - a[1] * goal[0]),
        )
    turn = back(X, Y, Z, turn)
    w_h = solve(w.L, l, back(X, Y, Z, (p.h[0], p.h[1], p.h[2])))
    whole = (
        v[0] - (w_h[1] * r[2] - w_h[2] * r[1]),
        v[1] - (w_h[2] * r[0] - w_h[0] * r[2]),
        v[2] - (w_h[0] * r[1] - w_h[1] * r[0]),
        turn[0] + gain * angle[0] - w_h[0],
        turn[1] + gain * angle[1] - w_h[1],
        turn[2] + gain * angle[2] - w_h[2],
    )
    for i in range(len(p.rows)):
        c.x[i, l] = whole[p.rows[i]]
    c.w[0, l], c.w[1, l], c.w[2, l] = w_h


@step
def attitude(x: float, y: float, z: float, w: float) -> tuple[Vector, Vector, Vector]:
    """Return the rows of the rotation matrix of a unit quaternion, equation (27)."""
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


@step
def back(X: Vector, Y: Vector, Z: Vector, v: Vector) -> Vector:
    """Return v in spacecraft axes, T^T v, from the rows of T."""
    return (
        X[0] * v[0] + Y[0] * v[1] + Z[0] * v[2],
        X[1] * v[0] + Y[1] * v[1] + Z[1] * v[2],
        X[2] * v[0] + Y[2] * v[1] + Z[2] * v[2],
    )


@step
def least_solution(k: int, c: Scratch) -> None:
    """Compute dq, the least solution of A^T dq = x, by Householder's factors A = Q R."""
    n, lanes = c.A.shape[0], c.A.shape[2]
    for l in range(lanes):
        c.sign[l] = 1.0
    for i in range(k):
        below = c.A[i:, i]
        reflector(below, c.beta[i], c.sign, c.tau[i])
        for j in range(i + 1, k):
            reflect(below, c.A[i:, j], c.tau[i], c.t[0])
    for j in range(k, n):
        for l in range(lanes):
            c.dq[j, l] = 0.0
    for i in range(k):
        for l in range(lanes):
            c.dq[i, l] = c.x[i, l]
        for j in range(i):
            for l in range(lanes):
                c.dq[i, l] -= c.A[j, i, l] * c.dq[j, l]
        for l in range(lanes):
            c.dq[i, l] /= c.beta[i, l]
            c.sign[l] = -c.sign[l] if c.beta[i, l] < 0.0 else c.sign[l]
    for i in range(k - 1, -1, -1):
        reflect(c.A[i:, i], c.dq[i:], c.tau[i], c.t[0])
