"""The masses of the equations of motion: M_qq, P and D_q by composite rigid bodies.

All vectors are in spacecraft axes. What a joint carries is taken about this joint, so that a light
wrist far from the system CM keeps its digits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.kernels.floating import Bodies, Numbers
from spacearm.kernels.lanes import (
    Six,
    Vector,
    add,
    cross,
    dot,
    minus,
    put,
    read,
    read_rows,
    read_six,
    record,
    sine_cosine,
    step,
    symmetric,
    times,
    turn,
)

SWUNG = record(
    ("R", np.float64, (3, 3)),  # attitude
    ("a", np.float64, 3),  # the joint, from the spacecraft frame [m]
    ("e", np.float64, 3),  # the same from the parent's joint
    ("r", np.float64, 3),  # the CM, from the joint
    ("J", np.float64, 6),  # inertia about the CM xx, xy, xz, yy, yz, zz [kg m^2]
    ("s", np.float64, 3),  # sum of mass times position of all that the joint carries,
    ("I", np.float64, 6),  # and its inertia, both about the joint
    ("u", np.float64, 3),  # angular velocity per rate of the column,
    ("v", np.float64, 3),  # and velocity of the body's point at the system CM
    ("w", np.float64, 3),  # angular velocity [rad/s]
    ("alpha", np.float64, 3),  # angular acceleration while ddq = 0, alpha_0 = 0
    ("acc", np.float64, 3),  # acceleration of the joint, likewise [m/s^2]
    ("f", np.float64, 3),  # force on the body and all that its joint carries,
    ("n", np.float64, 3),  # and moment about the joint
    ("turn", np.float64, 3),  # moment of external wrenches and wheels about its joint,
    ("push", np.float64, 3),  # and external force
    ("held", np.float64, 3),  # angular momentum that its wheels hold [N m s]
)
"""The work data of a body, vectors in spacecraft axes."""

WHOLE = record(
    ("r_cm", np.float64, 3),  # system CM, from the spacecraft frame [m]
    ("D", np.float64, 6),  # inertia about it
    ("L", np.float64, 6),  # factors of D: l_10, l_20, l_21 and the inverse diagonal
    ("least", np.float64),  # least pivot of H*, positive if H* is positive definite
)
"""The work data of the whole system."""


class Moving(NamedTuple):
    """All work arrays of the equations of motion.

    Attributes:
        body: (N + 1,) records `SWUNG`.
        whole: (1,) record `WHOLE`.
        angle: (3, N) joint positions, their sines and cosines.
        H: (n, n) M_qq, then H*, then its factors.
        D_q: (n, 3) angular momentum about the system CM per joint rate.
        P: (n, 3) linear momentum per joint rate.
        X: (n, 3) D^-1 D_q.
        c: (n,) bias forces c*.
        tau: (n,) generalized forces of the joints.
        ddq: (n,) joint accelerations.
    """

    body: npt.NDArray[np.void]
    whole: npt.NDArray[np.void]
    angle: Numbers
    H: Numbers
    D_q: Numbers
    P: Numbers
    X: Numbers
    c: Numbers
    tau: Numbers
    ddq: Numbers


@step
def configuration(b: Bodies, m: Moving) -> None:
    """Place the bodies from the joint positions and compute M_qq, P, D_q and the factors of D."""
    N = len(b) - 1
    sine_cosine(m.angle[0], m.angle[1], m.angle[2])
    center = (0.0, 0.0, 0.0)
    for i in range(N + 1):
        place(b, m, i)
        center = add(
            center, times(b[i].m / b[0].carried, add(read(m.body[i].a), read(m.body[i].r)))
        )
    put(m.whole[0].r_cm, center)
    D = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for i in range(N + 1):
        k, mass = m.body[i], b[i].m
        r, J = read(k.r), read_six(k.J)
        put(k.I, plus(J, steiner(mass, r)))
        put(k.s, times(mass, r))
        D = plus(D, plus(J, steiner(mass, minus(add(read(k.a), r), center))))
    put(m.whole[0].D, D)
    put(m.whole[0].L, factors(D))
    for i in range(N, 0, -1):
        carry(b, m, i)
    for j in range(m.H.shape[0]):
        put(m.D_q[j], (0.0, 0.0, 0.0))
        put(m.P[j], (0.0, 0.0, 0.0))
        for k in range(m.H.shape[0]):
            m.H[j, k] = 0.0
    for i in range(1, N + 1):
        column(b, m, i)


@step
def place(b: Bodies, m: Moving, i: int) -> None:
    """Compute attitude, joint, CM and inertia of body i; z is the axis of joint i."""
    own, k = b[i], m.body[i]
    X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    a, e = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if i > 0:
        inner = m.body[own.parent]
        R, E = read_rows(inner.R), read_rows(own.E)
        sin, cos, slide = m.angle[1, i - 1], m.angle[2, i - 1], 0.0
        if own.slides:
            sin, cos, slide = 0.0, 1.0, m.angle[0, i - 1]
        E_x, E_y, E_z = (
            (
                E[0][0] * cos + E[0][1] * sin,
                E[1][0] * cos + E[1][1] * sin,
                E[2][0] * cos + E[2][1] * sin,
            ),
            (
                E[0][1] * cos - E[0][0] * sin,
                E[1][1] * cos - E[1][0] * sin,
                E[2][1] * cos - E[2][0] * sin,
            ),
            (E[0][2], E[1][2], E[2][2]),
        )
        x, y, z = turn(R, E_x), turn(R, E_y), turn(R, E_z)
        X, Y, Z = (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])
        e = add(turn(R, read(own.t)), times(slide, z))
        a = add(read(inner.a), e)
    put(k.R[0], X)
    put(k.R[1], Y)
    put(k.R[2], Z)
    put(k.a, a)
    put(k.e, e)
    put(k.r, turn((X, Y, Z), read(own.c)))
    I = read_rows(own.I)
    IX, IY, IZ = turn(I, X), turn(I, Y), turn(I, Z)
    put(k.J, (dot(IX, X), dot(IX, Y), dot(IX, Z), dot(IY, Y), dot(IY, Z), dot(IZ, Z)))


@step
def plus(a: Six, b: Six) -> Six:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5])


@step
def steiner(m: float, r: Vector) -> Six:
    """Return the inertia of a point of mass m at r, as xx, xy, xz, yy, yz, zz."""
    x, y, z = r
    return (
        m * (y * y + z * z),
        -m * x * y,
        -m * x * z,
        m * (x * x + z * z),
        -m * y * z,
        m * (x * x + y * y),
    )


@step
def shifted(m: float, s: Vector, e: Vector) -> Six:
    """Return what the inertia of a mass m with first moment s gains with its origin at -e."""
    x, y, z = 2.0 * e[0] * s[0], 2.0 * e[1] * s[1], 2.0 * e[2] * s[2]
    mixed = (
        y + z,
        -e[0] * s[1] - e[1] * s[0],
        -e[0] * s[2] - e[2] * s[0],
        x + z,
        -e[1] * s[2] - e[2] * s[1],
        x + y,
    )
    return plus(steiner(m, e), mixed)


@step
def carry(b: Bodies, m: Moving, i: int) -> None:
    """Add what joint i carries to what its parent's joint carries."""
    inner, outer, mass = m.body[b[i].parent], m.body[i], b[i].carried
    e, s = read(outer.e), read(outer.s)
    moved = shifted(mass, s, e)
    put(inner.I, plus(read_six(inner.I), plus(read_six(outer.I), moved)))
    put(inner.s, add(read(inner.s), add(s, times(mass, e))))


@step
def factors(D: Six) -> Six:
    """Return the factors L diag(d) L^T of D."""
    d_0 = 1.0 / D[0]
    l_10, l_20 = D[1] * d_0, D[2] * d_0
    d_1 = 1.0 / (D[3] - l_10 * D[1])
    D_21 = D[4] - l_20 * D[1]
    l_21 = D_21 * d_1
    return (l_10, l_20, l_21, d_0, d_1, 1.0 / (D[5] - l_20 * D[2] - l_21 * D_21))


@step
def definite(L: Six) -> bool:
    """Return whether D is positive definite, from its factors."""
    return L[3] > 0.0 and L[4] > 0.0 and L[5] > 0.0


@step
def solve(L: Six, h: Vector) -> Vector:
    """Compute D^-1 h."""
    x = h[0]
    y = h[1] - L[0] * x
    z = (h[2] - L[1] * x - L[2] * y) * L[5]
    y = y * L[4] - L[2] * z
    x = x * L[3] - L[0] * y - L[1] * z
    return (x, y, z)


@step
def column(b: Bodies, m: Moving, i: int) -> None:
    """Add joint i to its column of P, D_q and M_qq: the momentum of what it carries."""
    own, d = b[i], m.body[i]
    mass, j = own.carried, own.column
    u = times(own.gain, (d.R[0, 2], d.R[1, 2], d.R[2, 2]))
    s, a = read(d.s), minus(read(d.a), read(m.whole[0].r_cm))
    if own.slides:
        p, h, v, turns = times(mass, u), cross(s, u), u, 0.0
        along = dot(u, p)
    else:
        p, h, v, turns = cross(u, s), symmetric(read_six(d.I), u), cross(a, u), 1.0
        along = dot(u, h)
    m.H[j, j] += along
    put(d.u, times(turns, u))
    put(d.v, v)
    put(m.P[j], add(read(m.P[j]), p))
    put(m.D_q[j], add(read(m.D_q[j]), add(h, cross(a, p))))
    o, e = own.parent, read(d.e)
    while o > 0:
        inner, c = m.body[o], b[o].column
        h = add(h, cross(e, p))  # the moment, from joint to joint
        along = dot(read(inner.v), p) if b[o].slides else dot(read(inner.u), h)
        m.H[j, c] += along
        m.H[c, j] += along
        o, e = b[o].parent, read(inner.e)
