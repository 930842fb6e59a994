"""The derivative of u^T J* v by the joints, u and v held, in one pass over the bodies and back.

It needs no derivatives of matrices. With joint rates v and without momentum the bodies move with
twists nu_i; F is the wrench u at the tip, and mu = A_b^-T J_b^T u. A small turn about joint i
carries all outer bodies along, with momentum h_i and composite inertia I_i, and changes nothing
else:

    d/dq_i = (s_i x mu) . h_i + (I_i mu) . (s_i x nu_i)
             + F . (s_i x (nu_E - nu_i)) + F . (w_E x dr_E/dq_i)      (the last two on the chain)

with s_i the axis of joint i as a twist, all about the system CM of this configuration.
`mechanics.jacobian` has the same from the derivatives of the matrices.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.kernels.floating import Bodies, Indices, Numbers, Work, solve
from spacearm.kernels.lanes import Lanes, Record, Vector, cross, dot, record, step, vector


def turning(lanes: int) -> np.dtype[np.void]:
    """Return the type of the work data of a body; twists and momenta [linear; angular]."""
    return record(
        ("s", np.float64, (6, lanes)),  # the axis of its joint, per unit rate
        ("P", np.float64, (6, lanes)),  # momentum of all that the joint carries, per unit rate
        ("nu", np.float64, (6, lanes)),  # twist of the body
        ("G", np.float64, (6, lanes)),  # momentum of what outer joints add to that twist
    )


class Slopes(NamedTuple):
    """Work arrays, by lanes.

    Attributes:
        body: (N + 1,) records `turning`.
        F: (6, lanes) the wrench u, moment about the system CM.
        mu: (6, lanes) A_b^-T J_b^T u.
        h: (6, lanes) momentum of what a joint carries.
        I_mu: (6, lanes) composite inertia times mu.
    """

    body: npt.NDArray[np.void]
    F: Lanes
    mu: Lanes
    h: Lanes
    I_mu: Lanes


@step
def wrench(rows: Indices, scale: Numbers, u: Lanes, M: float, w: Work, d: Slopes) -> None:
    """Compute the wrench u (k, lanes) about the system CM, and mu."""
    for x in range(6):
        for l in range(d.F.shape[1]):
            d.F[x, l] = 0.0
    for i in range(len(rows)):
        for l in range(d.F.shape[1]):
            d.F[rows[i], l] = scale[i] * u[i, l]
    for l in range(d.F.shape[1]):
        force = vector(d.F[:3], l)
        moment = cross(vector(w.r_E, l), force)
        for x in range(3):
            d.F[3 + x, l] += moment[x]
        turn = solve(w.L, l, vector(d.F[3:], l))
        for x in range(3):
            d.mu[x, l] = force[x] / M
            d.mu[3 + x, l] = turn[x]


@step
def joint_axes(b: Bodies, w: Work, d: Slopes) -> None:
    """Compute the axes s of all joints, and the momenta P = I s."""
    for i in range(1, len(b)):
        k, o = w.body[i], d.body[i]
        for l in range(d.F.shape[1]):
            u = (k.R[0, 2, l], k.R[1, 2, l], k.R[2, 2, l])
            if b[i].slides:
                linear, angular = u, (0.0, 0.0, 0.0)
            else:
                a = (
                    k.a[0, l] - w.r_cm[0, l],
                    k.a[1, l] - w.r_cm[1, l],
                    k.a[2, l] - w.r_cm[2, l],
                )
                linear, angular = cross(a, u), u
            for x in range(3):
                o.s[x, l] = linear[x]
                o.s[3 + x, l] = angular[x]
        carried_momentum(b[i].carried, k, o.s, o.P)


@step
def carried_momentum(m: float, k: Record, nu: Lanes, h: Lanes) -> None:
    """Compute h = I nu with the composite inertia of all that a joint carries."""
    for l in range(nu.shape[1]):
        v, turn, s = vector(nu[:3], l), vector(nu[3:], l), vector(k.s, l)
        linear, angular = cross(turn, s), cross(s, v)
        for x in range(3):
            h[x, l] = m * v[x] + linear[x]
        h[3, l] = angular[0] + k.D[0, l] * turn[0] + k.D[1, l] * turn[1] + k.D[2, l] * turn[2]
        h[4, l] = angular[1] + k.D[1, l] * turn[0] + k.D[3, l] * turn[1] + k.D[4, l] * turn[2]
        h[5, l] = angular[2] + k.D[2, l] * turn[0] + k.D[4, l] * turn[1] + k.D[5, l] * turn[2]


@step
def slopes(b: Bodies, tip: int, w: Work, d: Slopes, v: Lanes, L: Lanes) -> None:
    """Compute L (n, lanes), the derivatives of u^T J* v by the joints, at joint rates v."""
    lanes, root = L.shape[1], d.body[0]
    for x in range(6):
        for l in range(lanes):
            root.nu[x, l] = 0.0
    for i in range(1, len(b)):  # first the momentum with the spacecraft at rest
        for x in range(6):
            for l in range(lanes):
                root.nu[x, l] -= d.body[i].P[x, l] * b[i].gain * v[b[i].column, l]
    for l in range(lanes):
        turn = solve(w.L, l, vector(root.nu[3:], l))
        for x in range(3):
            root.nu[x, l] /= b[0].carried
            root.nu[3 + x, l] = turn[x]
    for i in range(1, len(b)):
        o, inner = d.body[i], d.body[b[i].parent]
        for x in range(6):
            for l in range(lanes):
                o.nu[x, l] = inner.nu[x, l] + o.s[x, l] * b[i].gain * v[b[i].column, l]
                o.G[x, l] = 0.0
    for j in range(L.shape[0]):
        for l in range(lanes):
            L[j, l] = 0.0
    for i in range(len(b) - 1, 0, -1):
        o, inner = d.body[i], d.body[b[i].parent]
        slope(b, tip, w, d, i, L[b[i].column])
        if b[i].parent > 0:
            for x in range(6):
                for l in range(lanes):
                    inner.G[x, l] += o.G[x, l] + o.P[x, l] * b[i].gain * v[b[i].column, l]


@step
def slope(b: Bodies, tip: int, w: Work, d: Slopes, i: int, L: Lanes) -> None:
    """Add the derivative by joint i to that by its column."""
    o, end, k, gain = d.body[i], d.body[tip], w.body[i], b[i].gain
    carried_momentum(b[i].carried, k, o.nu, d.h)
    carried_momentum(b[i].carried, k, d.mu, d.I_mu)
    for l in range(L.shape[0]):
        s_v, s_w = vector(o.s[:3], l), vector(o.s[3:], l)
        nu_v, nu_w = vector(o.nu[:3], l), vector(o.nu[3:], l)
        mu_v, mu_w = vector(d.mu[:3], l), vector(d.mu[3:], l)
        a_v, a_w = crossed(s_v, s_w, mu_v, mu_w)
        c_v, c_w = crossed(s_v, s_w, nu_v, nu_w)
        total = dot(vector(d.I_mu[:3], l), c_v) + dot(vector(d.I_mu[3:], l), c_w)
        for x in range(3):
            total += a_v[x] * (d.h[x, l] + o.G[x, l]) + a_w[x] * (d.h[3 + x, l] + o.G[3 + x, l])
        if b[i].on_chain:
            e_v, e_w = vector(end.nu[:3], l), vector(end.nu[3:], l)
            f_v, f_w = vector(d.F[:3], l), vector(d.F[3:], l)
            b_v, b_w = crossed(
                s_v,
                s_w,
                (e_v[0] - nu_v[0], e_v[1] - nu_v[1], e_v[2] - nu_v[2]),
                (e_w[0] - nu_w[0], e_w[1] - nu_w[1], e_w[2] - nu_w[2]),
            )
            r = cross(s_w, vector(w.r_E, l))
            moved = cross(e_w, (s_v[0] + r[0], s_v[1] + r[1], s_v[2] + r[2]))
            total += dot(f_v, b_v) + dot(f_w, b_w) + dot(f_v, moved)
        L[l] += gain * total


@step
def crossed(s_v: Vector, s_w: Vector, m_v: Vector, m_w: Vector) -> tuple[Vector, Vector]:
    """Return the twist s x m."""
    a, b = cross(s_w, m_v), cross(s_v, m_w)
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2]), cross(s_w, m_w)
