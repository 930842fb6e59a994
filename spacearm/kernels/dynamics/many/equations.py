"""The equations of motion of many states: the steps of `dynamics.equations`, over the lanes."""

from __future__ import annotations

import numpy as np

from spacearm.kernels.dynamics.many.loads import Loads, apply, store_momentum
from spacearm.kernels.dynamics.many.masses import carry, column, inertia, place
from spacearm.kernels.dynamics.many.work import Swinging, six, store, swinging
from spacearm.kernels.dynamics.masses import definite, solve
from spacearm.kernels.floating import Bodies, Numbers
from spacearm.kernels.lanes import (
    LANES,
    SETTINGS,
    add,
    compiler,
    cross,
    dot,
    merged,
    minus,
    sine_cosine,
    symmetric,
    times,
    vector,
)

kernel = compiler(**SETTINGS, cache=True)
"""A function that is called from Python, compiled once and kept on disk."""


@merged
def swing(b: Bodies, m: Swinging, i: int) -> None:
    """Compute bias motion of body i, and the force and moment about its joint that it takes."""
    own, d, inner = b[i], m.body[i], m.body[b[i].parent]
    rate = m.dq[own.column] if i > 0 else m.least
    for l in range(LANES):
        w, alpha, acc = vector(d.w, l), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if i > 0:
            e = vector(d.e, l)
            u = times(own.gain * rate[l], (d.R[0, 2, l], d.R[1, 2, l], d.R[2, 2, l]))
            w, alpha = vector(inner.w, l), vector(inner.alpha, l)
            acc = add(vector(inner.acc, l), add(cross(alpha, e), cross(w, cross(w, e))))
            if own.slides:
                acc = add(acc, times(2.0, cross(w, u)))
            else:
                w, alpha = add(w, u), add(alpha, cross(w, u))
        store(d.w, l, w)
        store(d.alpha, l, alpha)
        store(d.acc, l, acc)
        r, J = vector(d.r, l), six(d.J, l)
        f = times(own.m, add(acc, add(cross(alpha, r), cross(w, cross(w, r)))))
        n = add(symmetric(J, alpha), add(cross(w, symmetric(J, w)), cross(r, f)))
        store(d.f, l, f)
        store(d.n, l, n)


@merged
def gather(b: Bodies, m: Swinging, i: int) -> None:
    """Add the force and moment at joint i to those of its parent; take its bias force off x."""
    inner, d, own = m.body[b[i].parent], m.body[i], b[i]
    for l in range(LANES):
        f, n = vector(d.f, l), vector(d.n, l)
        store(inner.f, l, add(vector(inner.f, l), f))
        store(inner.n, l, add(vector(inner.n, l), add(n, cross(vector(d.e, l), f))))
        m.x[own.column, l] -= dot(vector(d.v, l), f) if own.slides else dot(vector(d.u, l), n)


@merged
def react(M: float, f: int, m: Swinging) -> None:
    """Add to x what the motion of the spacecraft takes of the bias; turn M_qq into H*."""
    root, n = m.body[0], m.H.shape[0]
    moves, turns = 1.0 / M if f > 0 else 0.0, 1.0 if f == 6 else 0.0
    for l in range(LANES):
        force = vector(root.f, l)
        about_cm = minus(vector(root.n, l), cross(vector(m.center, l), force))
        store(root.f, l, times(moves, force))
        store(root.n, l, times(turns, solve(six(m.D, l), about_cm)))
    for j in range(n):
        for l in range(LANES):
            P, D_q = vector(m.P[j], l), vector(m.D_q[j], l)
            m.x[j, l] += dot(P, vector(root.f, l)) + dot(D_q, vector(root.n, l))
            store(m.X[j], l, times(turns, solve(six(m.D, l), D_q)))
        for k in range(j + 1):
            for l in range(LANES):
                P, D_q = times(moves, vector(m.P[j], l)), vector(m.D_q[j], l)
                m.H[j, k, l] -= dot(P, vector(m.P[k], l)) + dot(D_q, vector(m.X[k], l))


@merged
def accelerate(m: Swinging) -> None:
    """Turn x into H*^-1 x by factors L diag(d) L^T; the diagonal keeps 1 / d."""
    H, x, n = m.H, m.x, m.H.shape[0]
    m.least[:] = np.inf
    for j in range(n):
        for k in range(j):  # row j of L: H[j, k] = L[j, k] d[k] until it is divided
            for o in range(k):
                for l in range(LANES):
                    H[j, k, l] -= H[j, o, l] * H[k, o, l]
        for k in range(j):
            for l in range(LANES):
                L = H[j, k, l] * H[k, k, l]
                H[j, j, l] -= L * H[j, k, l]
                x[j, l] -= L * x[k, l]
                H[j, k, l] = L
        for l in range(LANES):
            m.least[l] = min(m.least[l], H[j, j, l])
            H[j, j, l] = 1.0 / H[j, j, l]
    for j in range(n - 1, -1, -1):
        for l in range(LANES):
            x[j, l] *= H[j, j, l]
    for j in range(n - 1, -1, -1):
        for k in range(j):
            for l in range(LANES):
                x[k, l] -= H[j, k, l] * x[j, l]


@kernel
def accelerations(
    b: Bodies, f: int, q: Numbers, dq: Numbers, tau: Numbers, h: Numbers, x: Loads, ddq: Numbers
) -> None:
    """Compute the joint accelerations of m states.

    Args:
        b: The arm.
        f: Number of free components of the spacecraft's twist: 0, 3 or 6.
        q: (N, m) positions of all joints.
        dq: (n, m) rates of those that count.
        tau: (n, m) their torques.
        h: (3, m) angular momentum about the system CM, that of wheels included, spacecraft axes.
        x: Wheels and external wrenches.
        ddq: (n, m) receives the accelerations; NaN where H* or D is not positive definite.
    """
    N, (n, total) = len(b) - 1, dq.shape
    m = swinging(N, n)
    for first in range(0, total, LANES):
        there = min(LANES, total - first)
        for l in range(LANES):
            at = first + min(l, there - 1)
            for i in range(N):
                m.angle[0, i, l] = q[i, at]
            for j in range(n):
                m.dq[j, l], m.x[j, l] = dq[j, at], tau[j, at]
            store(m.h, l, (h[0, at], h[1, at], h[2, at]))
        m.center[:], m.H[:], m.P[:], m.D_q[:] = 0.0, 0.0, 0.0, 0.0
        for i in range(N):
            sine_cosine(m.angle[0, i], m.angle[1, i], m.angle[2, i])
        for i in range(N + 1):
            place(b, m, i)
        inertia(b, m)
        for i in range(N, 0, -1):
            carry(b, m, i)
        for i in range(1, N + 1):
            column(b, m, i)
        for j in range(n):
            for l in range(LANES):
                store(m.h, l, minus(vector(m.h, l), times(m.dq[j, l], vector(m.D_q[j], l))))
        store_momentum(m, x, first, there)
        for l in range(LANES):
            turns = 1.0 if f == 6 else 0.0
            store(m.body[0].w, l, times(turns, solve(six(m.D, l), vector(m.h, l))))
        for i in range(N + 1):
            swing(b, m, i)
        apply(m, x, first, there)
        for i in range(N, 0, -1):
            gather(b, m, i)
        react(b[0].carried, f, m)
        accelerate(m)
        for l in range(there):
            sound = m.least[l] > 0.0 and (f < 6 or definite(six(m.D, l)))
            for j in range(n):
                ddq[j, first + l] = m.x[j, l] if sound else np.nan
