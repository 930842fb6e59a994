"""Determinants whose common roots are the singular configurations, for many configurations at once.

Seen from the tip, a free-floating arm is a chain from the tip to the spacecraft. Let B act on the
twist of the tip and column P_j on the rate of joint j alone, the tip held still: the momentum of
all that joint j then moves, which is everything on the spacecraft's side of it. The whole momentum
is B xi + P dq, and det [A_b A_q; J_b J_q] (task rows) = +- det [B_f P], where f are the directions
of xi outside the task. No inertia is inverted, and a light spacecraft gives a small column instead
of a small difference of large numbers.
"""

from __future__ import annotations

import math

import numpy as np

from spacearm.kernels.cpu import fill, kernel, work
from spacearm.kernels.floating import (
    Bodies,
    Indices,
    Numbers,
    Work,
    carry,
    inertia,
    joint,
    place,
    place_tip,
    start,
)
from spacearm.kernels.lanes import LANES, Lanes, Record, cross, step, vector

FLOATING, CONTROLLED, FIXED = 0, 1, 2
"""What the spacecraft does."""


@kernel
def minors(
    b: Bodies,
    tip: int,
    E: Numbers,
    n: int,
    mode: int,
    rows: Indices,
    columns: Indices,
    row_unit: Numbers,
    column_unit: Numbers,
    q: Numbers,
    values: Numbers,
    sizes: Numbers,
) -> None:
    """Compute minors of [B P] of a floating arm, or of the Jacobian of one held by its spacecraft.

    Args:
        b: The arm.
        tip: Body that the tip is fixed to.
        E: (3,) the tip in the frame of that body [m].
        n: Number of columns of its Jacobian.
        mode: FLOATING, CONTROLLED or FIXED.
        rows: (k,) rows that count: of momentum [linear; angular about the system CM] for a
            floating spacecraft, else of the twist of the tip.
        columns: (c, k) columns of each minor: 0 to 5 directions of the twist of the tip, 6 + j
            joint j.
        row_unit: (6,) factors of the rows.
        column_unit: (6 + n,) factors of the columns.
        q: (N, m) joint positions [rad] or [m].
        values: (m, c) receives the determinants.
        sizes: (m, c) receives the products of the lengths of their columns, or is empty.
    """
    m, k = q.shape[1], len(rows)
    w = work(q.shape[0], n)
    C, A = np.empty((6 + n, 6, LANES)), np.empty((k, k))
    for first in range(0, m, LANES):
        fill(w, q, first)
        positions(b, tip, E, w)
        for c in range(6 + n):
            for x in range(6):
                for l in range(LANES):
                    C[c, x, l] = 0.0
        if mode == FLOATING:
            momenta(b, tip, w, C)
        else:
            held_columns(b, w, mode == CONTROLLED, C)
        for l in range(min(LANES, m - first)):
            for i in range(len(columns)):
                for y in range(k):
                    c = columns[i, y]
                    for x in range(k):
                        A[y, x] = row_unit[rows[x]] * column_unit[c] * C[c, rows[x], l]
                if len(sizes) > 0:
                    sizes[first + l, i] = math.sqrt(np.prod(np.sum(A * A, axis=1)))
                values[first + l, i] = determinant(A)


@kernel
def tips(b: Bodies, tip: int, E: Numbers, fixed: bool, q: Numbers, r: Numbers) -> None:
    """Compute the tip r (m, 3) relative to the system CM, or to the spacecraft's own if fixed."""
    m = len(r)
    w = work(q.shape[0], 0)
    for first in range(0, m, LANES):
        fill(w, q, first)
        start(b, w)
        for i in range(1, len(b)):
            joint(b, w, i)
            place(b, w, i)
        place_tip(tip, E, w)
        for l in range(min(LANES, m - first)):
            for x in range(3):
                own = w.r_cm[x, l] - b[0].c[x] if fixed else 0.0
                r[first + l, x] = w.r_E[x, l] + own


@step
def positions(b: Bodies, tip: int, E: Numbers, w: Work) -> None:
    """Place all bodies and compute their first moments and inertias about the system CM."""
    start(b, w)
    for i in range(1, len(b)):
        joint(b, w, i)
        place(b, w, i)
    place_tip(tip, E, w)
    for i in range(len(b)):
        inertia(b, w, i)


@step
def momenta(b: Bodies, tip: int, w: Work, C: Lanes) -> None:
    """Compute the columns B of the tip's twist and P of the joints, C (6 + n, 6, lanes)."""
    mass = np.empty(len(b))
    for i in range(len(b)):
        mass[i] = b[i].m
    for i in range(len(b) - 1, 0, -1):  # branches move with the body that they start from
        if not b[i].on_chain:
            moved(b[i], w, w.body[i], mass[i], 1.0, i, C)
            carry(b, w, i)
            mass[b[i].parent] += mass[i]
    for i in range(1, len(b)):
        if b[i].on_chain:  # what moves is all that the spacecraft's side of the joint carries
            inner, outer = w.body[b[i].parent], w.body[i]
            moved(b[i], w, inner, mass[b[i].parent], -1.0, i, C)
            for l in range(w.sin.shape[0]):
                for x in range(3):
                    outer.s[x, l] += inner.s[x, l]
                for x in range(6):
                    outer.D[x, l] += inner.D[x, l]
            mass[i] += mass[b[i].parent]
    D = w.body[tip].D
    for l in range(w.sin.shape[0]):
        M, r = mass[tip], vector(w.r_E, l)
        for x in range(3):
            C[x, x, l] = M
        C[3, 1, l], C[3, 2, l] = M * r[2], -M * r[1]
        C[4, 0, l], C[4, 2, l] = -M * r[2], M * r[0]
        C[5, 0, l], C[5, 1, l] = M * r[1], -M * r[0]
        C[3, 3, l], C[3, 4, l], C[3, 5, l] = D[0, l], D[1, l], D[2, l]
        C[4, 3, l], C[4, 4, l], C[4, 5, l] = D[1, l], D[3, l], D[4, l]
        C[5, 3, l], C[5, 4, l], C[5, 5, l] = D[2, l], D[4, l], D[5, l]


@step
def moved(b_i: Record, w: Work, k: Record, m: float, sign: float, i: int, C: Lanes) -> None:
    """Add the momentum of the mass m with moments s, D of k, moved by joint i with rate `sign`."""
    P, body, g = C[6 + b_i.column], w.body[i], sign * b_i.gain
    for l in range(w.sin.shape[0]):
        u = (g * body.R[0, 2, l], g * body.R[1, 2, l], g * body.R[2, 2, l])
        s, D = vector(k.s, l), k.D
        if b_i.slides:
            p = (m * u[0], m * u[1], m * u[2])
            h = cross(s, u)
        else:
            a = from_centre(w, i, l)
            p = cross(u, (s[0] - m * a[0], s[1] - m * a[1], s[2] - m * a[2]))
            o = cross(s, cross(u, a))
            h = (
                D[0, l] * u[0] + D[1, l] * u[1] + D[2, l] * u[2] - o[0],
                D[1, l] * u[0] + D[3, l] * u[1] + D[4, l] * u[2] - o[1],
                D[2, l] * u[0] + D[4, l] * u[1] + D[5, l] * u[2] - o[2],
            )
        for x in range(3):
            P[x, l] += p[x]
            P[3 + x, l] += h[x]


@step
def held_columns(b: Bodies, w: Work, follows: bool, C: Lanes) -> None:
    """Compute [J12; J22] of (34a), the Jacobian with w_0 = 0, or J if no body `follows`."""
    per_M = 1.0 / b[0].carried if follows else 0.0
    for i in range(len(b) - 1, 0, -1):
        carry(b, w, i)
    for i in range(1, len(b)):
        reaches = 1.0 if b[i].on_chain else 0.0
        J, k, m, g = C[6 + b[i].column], w.body[i], b[i].carried, b[i].gain
        for l in range(w.sin.shape[0]):
            u = (g * k.R[0, 2, l], g * k.R[1, 2, l], g * k.R[2, 2, l])
            if b[i].slides:
                p, r, turns = (m * u[0], m * u[1], m * u[2]), u, 0.0
            else:
                s, a, r_E = vector(k.s, l), from_centre(w, i, l), vector(w.r_E, l)
                p = cross(u, (s[0] - m * a[0], s[1] - m * a[1], s[2] - m * a[2]))
                r = cross(u, (r_E[0] - a[0], r_E[1] - a[1], r_E[2] - a[2]))
                turns = reaches
            for x in range(3):
                J[x, l] += reaches * r[x] - per_M * p[x]
                J[3 + x, l] += turns * u[x]


@step
def from_centre(w: Work, i: int, l: int) -> tuple[float, float, float]:
    """Return joint i relative to the system CM."""
    a = w.body[i].a
    return (a[0, l] - w.r_cm[0, l], a[1, l] - w.r_cm[1, l], a[2, l] - w.r_cm[2, l])


@step
def determinant(A: Numbers) -> float:
    """Compute det A by elimination with the largest pivots; A is overwritten."""
    k, det = len(A), 1.0
    for i in range(k):
        best = i
        for y in range(i + 1, k):
            if abs(A[y, i]) > abs(A[best, i]):
                best = y
        if best != i:
            det = -det
            for x in range(i, k):
                A[i, x], A[best, x] = A[best, x], A[i, x]
        det *= A[i, i]
        if A[i, i] == 0.0 or math.isnan(A[i, i]):
            return det
        for y in range(i + 1, k):
            factor = A[y, i] / A[i, i]
            for x in range(i + 1, k):
                A[y, x] -= factor * A[i, x]
    return det
