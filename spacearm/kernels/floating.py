"""The generalized Jacobian of a floating arm, in one pass over its bodies and back.

The equations are those of Papadopoulos & Dubowsky (1993), DOI 10.1115/1.2897406, section III,
written for trees. All quantities are relative to the system CM and in spacecraft axes: the linear
momentum is then zero, and conservation of angular momentum is D w_0 + D_q dq = 0, (33c).
`mechanics.jacobian` and `mechanics.barycentric_formulation` compute the same J* independently; the
tests compare all three.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.kernels.lanes import Lanes, Vector, cross, dot, record, sine_cosine, step, vector

Numbers = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


BODY = record(
    ("parent", np.int64),  # body that the joint starts from; parents come first
    ("column", np.int64),  # column of the Jacobian, 0 to n - 1, that the joint belongs to
    ("slides", np.bool_),  # whether the joint is prismatic
    ("on_chain", np.bool_),  # whether it lies between the spacecraft and the tip
    ("gain", np.float64),  # its rate per rate of the column; not 1 for joints that mimic
    ("E", np.float64, (3, 3)),  # attitude of the frame at q = 0, in that of the parent
    ("t", np.float64, 3),  # position of the joint in the frame of the parent [m]
    ("m", np.float64),  # mass [kg]
    ("c", np.float64, 3),  # CM in the frame of the body [m]
    ("I", np.float64, (3, 3)),  # inertia about that CM [kg m^2]
    ("carried", np.float64),  # mass of the body and of all that its outer joints carry [kg]
)
"""The constants of a body: body 0 is the spacecraft, joint i >= 1 carries body i, whose frame
stands in the joint with its z axis along the joint's."""

Bodies = npt.NDArray[np.void]
"""(N + 1,) records BODY."""


def moving(lanes: int) -> np.dtype[np.void]:
    """Return the type of the work data of a body: lanes of vectors in spacecraft axes."""
    return record(
        ("q", np.float64, lanes),  # joint position [rad] or [m]
        ("R", np.float64, (3, 3, lanes)),  # attitude
        ("a", np.float64, (3, lanes)),  # the joint, from the spacecraft frame [m]
        ("rho", np.float64, (3, lanes)),  # the CM, likewise
        ("s", np.float64, (3, lanes)),  # sum of m rho over all that the joint carries [kg m],
        ("D", np.float64, (6, lanes)),  # and its inertia, both about the system CM [kg m^2]
    )


class Work(NamedTuple):
    """Work arrays, by lanes.

    Attributes:
        body: (N + 1,) records `moving`; the D of body 0 is D of (33c), as xx, xy, xz, yy, yz, zz.
        sin: (lanes,) sine of the joint that is being placed; cos likewise.
        r_cm: (3, lanes) system CM, from the spacecraft frame [m].
        r_E: (3, lanes) the tip, from the system CM [m].
        L: (6, lanes) factors of D: l_10, l_20, l_21 of L and the inverse diagonal.
        J: (n, 6, lanes) columns of J*.
    """

    body: npt.NDArray[np.void]
    sin: Lanes
    cos: Lanes
    r_cm: Lanes
    r_E: Lanes
    L: Lanes
    J: Lanes


@step
def generalized_jacobian(b: Bodies, tip: int, E: Numbers, w: Work) -> None:
    """Compute J*, equation (35), the tip r_E and the system CM r_cm from the joint positions q."""
    N = len(b) - 1
    start(b, w)
    for i in range(1, N + 1):
        joint(b, w, i)
        place(b, w, i)
    place_tip(tip, E, w)
    for i in range(N + 1):
        inertia(b, w, i)
    for i in range(N, 0, -1):
        carry(b, w, i)
    factorise(w)
    for i in range(1, N + 1):
        column(b, w, i)


@step
def start(b: Bodies, w: Work) -> None:
    """Place the spacecraft in its own frame and set the sums to zero."""
    k = w.body[0]
    for l in range(w.sin.shape[0]):
        for x in range(3):
            for y in range(3):
                k.R[x, y, l] = 1.0 if x == y else 0.0
            k.a[x, l] = 0.0
            k.rho[x, l] = b[0].c[x]
            w.r_cm[x, l] = b[0].m / b[0].carried * b[0].c[x]
    for j in range(w.J.shape[0]):
        for x in range(6):
            for l in range(w.sin.shape[0]):
                w.J[j, x, l] = 0.0


@step
def joint(b: Bodies, w: Work, i: int) -> None:
    """Compute sine and cosine of joint i in w.sin and w.cos; 0 and 1 for a prismatic joint."""
    q = w.body[i].q
    if b[i].slides:
        for l in range(w.sin.shape[0]):
            w.sin[l], w.cos[l] = 0.0, 1.0
    else:
        sine_cosine(q, w.sin, w.cos)
        for l in range(w.sin.shape[0]):
            q[l] = 0.0


@step
def place(b: Bodies, w: Work, i: int) -> None:
    """Compute attitude, joint and CM of body i; z is the axis of joint i."""
    p, mu = b[i].parent, b[i].m / b[0].carried
    parent, k = w.body[p], w.body[i]
    E_x = (b[i].E[0, 0], b[i].E[1, 0], b[i].E[2, 0])
    E_y = (b[i].E[0, 1], b[i].E[1, 1], b[i].E[2, 1])
    E_z = (b[i].E[0, 2], b[i].E[1, 2], b[i].E[2, 2])
    t = (b[i].t[0], b[i].t[1], b[i].t[2])
    c = (b[i].c[0], b[i].c[1], b[i].c[2])
    for l in range(w.sin.shape[0]):
        sin, cos, slide = w.sin[l], w.cos[l], k.q[l]
        for x in range(3):
            R = vector(parent.R[x], l)
            R_x, R_y, R_z = dot(R, E_x), dot(R, E_y), dot(R, E_z)
            a = parent.a[x, l] + dot(R, t) + R_z * slide
            R = (R_x * cos + R_y * sin, R_y * cos - R_x * sin, R_z)
            rho = a + dot(R, c)
            k.R[x, 0, l], k.R[x, 1, l], k.R[x, 2, l] = R
            k.a[x, l] = a
            k.rho[x, l] = rho
            w.r_cm[x, l] += mu * rho


@step
def place_tip(tip: int, E: Numbers, w: Work) -> None:
    """Compute the tip relative to the system CM from E, the tip in the frame of body `tip`."""
    k = w.body[tip]
    point = (E[0], E[1], E[2])
    for l in range(w.sin.shape[0]):
        for x in range(3):
            w.r_E[x, l] = k.a[x, l] + dot(vector(k.R[x], l), point) - w.r_cm[x, l]


@step
def inertia(b: Bodies, w: Work, i: int) -> None:
    """Compute inertia and first moment of body i about the system CM."""
    m, k = b[i].m, w.body[i]
    I = b[i].I
    I_x, I_y, I_z = (
        (I[0, 0], I[0, 1], I[0, 2]),
        (I[1, 0], I[1, 1], I[1, 2]),
        (I[2, 0], I[2, 1], I[2, 2]),
    )
    for l in range(w.sin.shape[0]):
        X, Y, Z = vector(k.R[0], l), vector(k.R[1], l), vector(k.R[2], l)
        IX = (dot(X, I_x), dot(X, I_y), dot(X, I_z))
        IY = (dot(Y, I_x), dot(Y, I_y), dot(Y, I_z))
        IZ = (dot(Z, I_x), dot(Z, I_y), dot(Z, I_z))
        x = k.rho[0, l] - w.r_cm[0, l]
        y = k.rho[1, l] - w.r_cm[1, l]
        z = k.rho[2, l] - w.r_cm[2, l]
        k.s[0, l], k.s[1, l], k.s[2, l] = m * x, m * y, m * z
        k.D[0, l] = dot(IX, X) + m * (y * y + z * z)
        k.D[1, l] = dot(IX, Y) - m * x * y
        k.D[2, l] = dot(IX, Z) - m * x * z
        k.D[3, l] = dot(IY, Y) + m * (x * x + z * z)
        k.D[4, l] = dot(IY, Z) - m * y * z
        k.D[5, l] = dot(IZ, Z) + m * (x * x + y * y)


@step
def carry(b: Bodies, w: Work, i: int) -> None:
    """Add what joint i carries to what its parent's joint carries."""
    inner, outer = w.body[b[i].parent], w.body[i]
    for l in range(w.sin.shape[0]):
        for x in range(3):
            inner.s[x, l] += outer.s[x, l]
        for x in range(6):
            inner.D[x, l] += outer.D[x, l]


@step
def factorise(w: Work) -> None:
    """Factorise D = L diag(d) L^T."""
    D = w.body[0].D
    for l in range(w.sin.shape[0]):
        d_0 = 1.0 / D[0, l]
        l_10, l_20 = D[1, l] * d_0, D[2, l] * d_0
        d_1 = 1.0 / (D[3, l] - l_10 * D[1, l])
        D_21 = D[4, l] - l_20 * D[1, l]
        l_21 = D_21 * d_1
        d_2 = 1.0 / (D[5, l] - l_20 * D[2, l] - l_21 * D_21)
        w.L[0, l], w.L[1, l], w.L[2, l] = l_10, l_20, l_21
        w.L[3, l], w.L[4, l], w.L[5, l] = d_0, d_1, d_2


@step
def solve(L: Lanes, l: int, h: Vector) -> Vector:
    """Compute D^-1 h."""
    x = h[0]
    y = h[1] - L[0, l] * x
    z = (h[2] - L[1, l] * x - L[2, l] * y) * L[5, l]
    y = y * L[4, l] - L[2, l] * z
    x = x * L[3, l] - L[0, l] * y - L[1, l] * z
    return (x, y, z)


@step
def column(b: Bodies, w: Work, i: int) -> None:
    """Add the contribution of joint i to its column of J*.

    J* = [-J11 D^-1 D_q + J12; -D^-1 D_q + J22], where J11 w = w x r_E.
    """
    m, g, per_M = b[i].carried, b[i].gain, 1.0 / b[0].carried
    reaches = 1.0 if b[i].on_chain else 0.0
    J, k = w.J[b[i].column], w.body[i]
    for l in range(w.sin.shape[0]):
        u = (g * k.R[0, 2, l], g * k.R[1, 2, l], g * k.R[2, 2, l])
        s, D = vector(k.s, l), k.D
        r_E = vector(w.r_E, l)
        if b[i].slides:
            p = (m * u[0], m * u[1], m * u[2])  # linear momentum of what the joint carries
            D_q = cross(s, u)
            r = u
            J22 = (0.0, 0.0, 0.0)
        else:
            a = (
                k.a[0, l] - w.r_cm[0, l],
                k.a[1, l] - w.r_cm[1, l],
                k.a[2, l] - w.r_cm[2, l],
            )
            p = cross(u, (s[0] - m * a[0], s[1] - m * a[1], s[2] - m * a[2]))
            h = cross(s, cross(u, a))
            D_q = (
                D[0, l] * u[0] + D[1, l] * u[1] + D[2, l] * u[2] - h[0],
                D[1, l] * u[0] + D[3, l] * u[1] + D[4, l] * u[2] - h[1],
                D[2, l] * u[0] + D[4, l] * u[1] + D[5, l] * u[2] - h[2],
            )
            r = cross(u, (r_E[0] - a[0], r_E[1] - a[1], r_E[2] - a[2]))
            J22 = (reaches * u[0], reaches * u[1], reaches * u[2])
        J12 = (
            reaches * r[0] - per_M * p[0],
            reaches * r[1] - per_M * p[1],
            reaches * r[2] - per_M * p[2],
        )
        X = solve(w.L, l, D_q)
        J11_X = cross(X, r_E)
        for x in range(3):
            J[x, l] += J12[x] - J11_X[x]
            J[3 + x, l] += J22[x] - X[x]
