"""The equations of motion of a floating tree in the reduced form H* ddq + c* = tau.

All vectors are in spacecraft axes. The mass matrix is that of composite rigid bodies, in `masses`;
the bias forces come from Newton's and Euler's equations, body by body and back (Featherstone, Rigid
Body Dynamics Algorithms, 2008, chapters 5, 6). Both are about the joint that they belong to. With M
the total mass, P and D_q the linear and the angular momentum per joint rate, F and N the bias force
and moment about the system CM, and c the bias forces of the joints,

    H* = M_qq - P^T P / M - D_q^T D^-1 D_q,    c* = c - P^T F / M - D_q^T D^-1 N:

Papadopoulos & Dubowsky, IEEE Trans. Robot. Autom. 7(6), 750-758 (1991), DOI 10.1109/70.105384.
`mechanics.dynamics` computes the same by Pinocchio; the tests compare both.
"""

from __future__ import annotations

import numpy as np

from spacearm.kernels.dynamics.masses import Moving, solve
from spacearm.kernels.floating import Bodies, Numbers
from spacearm.kernels.lanes import (
    Vector,
    add,
    cross,
    dot,
    minus,
    put,
    read,
    read_six,
    step,
    symmetric,
    times,
)


@step
def angular_velocity(m: Moving, dq: Numbers, h: Vector) -> None:
    """Compute w_0 = D^-1 (h - D_q dq), equation (33c) with momentum h of the bodies."""
    for j in range(len(dq)):
        h = minus(h, times(dq[j], read(m.D_q[j])))
    put(m.body[0].w, solve(read_six(m.whole[0].L), h))


@step
def bias(b: Bodies, f: int, m: Moving, dq: Numbers) -> None:
    """Compute c* from w_0 in body 0, external wrenches and wheels.

    f counts the free components of the spacecraft's twist, dq (n,) are the joint rates.
    """
    N, root = len(b) - 1, m.body[0]
    put(root.alpha, (0.0, 0.0, 0.0))
    put(root.acc, (0.0, 0.0, 0.0))
    for i in range(N + 1):
        swing(b, m, i, dq)
    for j in range(len(dq)):
        m.c[j] = 0.0
    for i in range(N, 0, -1):
        inner, d, own = m.body[b[i].parent], m.body[i], b[i]
        f_i, n_i = read(d.f), read(d.n)
        put(inner.f, add(read(inner.f), f_i))
        put(inner.n, add(read(inner.n), add(n_i, cross(read(d.e), f_i))))
        m.c[own.column] += dot(read(d.v), f_i) if own.slides else dot(read(d.u), n_i)
    force, mean, x_0 = read(root.f), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if f > 0:
        mean = times(1.0 / b[0].carried, force)
    if f == 6:
        about_cm = minus(read(root.n), cross(read(m.whole[0].r_cm), force))
        x_0 = solve(read_six(m.whole[0].L), about_cm)
    for j in range(len(dq)):
        m.c[j] -= dot(read(m.P[j]), mean) + dot(read(m.D_q[j]), x_0)


@step
def swing(b: Bodies, m: Moving, i: int, dq: Numbers) -> None:
    """Compute bias motion of body i, and the force and moment about its joint that it takes."""
    d, own = m.body[i], b[i]
    w, alpha, acc = read(d.w), read(d.alpha), read(d.acc)
    if i > 0:
        inner, e = m.body[own.parent], read(d.e)
        u = times(own.gain * dq[own.column], (d.R[0, 2], d.R[1, 2], d.R[2, 2]))
        w, alpha = read(inner.w), read(inner.alpha)
        acc = add(read(inner.acc), add(cross(alpha, e), cross(w, cross(w, e))))
        if own.slides:
            acc = add(acc, times(2.0, cross(w, u)))
        else:
            w, alpha = add(w, u), add(alpha, cross(w, u))
        put(d.w, w)
        put(d.alpha, alpha)
        put(d.acc, acc)
    r, J = read(d.r), read_six(d.J)
    f = times(own.m, add(acc, add(cross(alpha, r), cross(w, cross(w, r)))))
    gyration = cross(w, add(symmetric(J, w), read(d.held)))
    n = add(symmetric(J, alpha), add(gyration, cross(r, f)))
    put(d.f, minus(f, read(d.push)))
    put(d.n, minus(n, read(d.turn)))


@step
def connect(m: Moving) -> None:
    """Compute X = D^-1 D_q; -X is the connection of equation (33c)."""
    L = read_six(m.whole[0].L)
    for j in range(m.H.shape[0]):
        put(m.X[j], solve(L, read(m.D_q[j])))


@step
def eliminate(M: float, f: int, m: Moving) -> None:
    """Turn M_qq into H*; M is the total mass."""
    H, turns, moves = m.H, 1.0 if f == 6 else 0.0, 1.0 / M if f > 0 else 0.0
    for j in range(H.shape[0]):
        P, D_q = times(moves, read(m.P[j])), times(turns, read(m.D_q[j]))
        for k in range(j + 1):
            H[j, k] -= dot(P, read(m.P[k])) + dot(D_q, read(m.X[k]))
            H[k, j] = H[j, k]


@step
def accelerate(m: Moving) -> None:
    """Compute ddq = H*^-1 (tau - c*) by factors L diag(d) L^T."""
    H, x, n, least = m.H, m.ddq, m.H.shape[0], np.inf
    for j in range(n):
        total = m.tau[j] - m.c[j]
        for k in range(j):  # row j of L: H[j, k] = L[j, k] d[k] until it is divided
            entry = H[j, k]
            for o in range(k):
                entry -= H[j, o] * H[k, o]
            H[j, k] = entry
        pivot = H[j, j]
        for k in range(j):
            L = H[j, k] * H[k, k]
            pivot -= L * H[j, k]
            total -= L * x[k]
            H[j, k] = L
        least = min(least, pivot)
        H[j, j] = 1.0 / pivot
        x[j] = total
    m.whole[0].least = least
    for j in range(n):
        x[j] *= H[j, j]
    for j in range(n - 1, -1, -1):
        for k in range(j):
            x[k] -= H[j, k] * x[j]


@step
def still(b: Bodies, m: Moving) -> None:
    """Set external wrenches and what wheels hold to zero."""
    for i in range(len(b)):
        put(m.body[i].turn, (0.0, 0.0, 0.0))
        put(m.body[i].push, (0.0, 0.0, 0.0))
        put(m.body[i].held, (0.0, 0.0, 0.0))
