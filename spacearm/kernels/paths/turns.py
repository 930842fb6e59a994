"""The turn of a floating spacecraft along joint curves, and its derivative by the curve.

Without momentum the attitude follows T' = T [A(q) q']x with the connection A = -D^-1 D_q of (33c),
in spacecraft axes. `planning.curve` says what the curves are; the steps are those of the
fourth-order Magnus method, as in `mechanics.floating`.
"""

from __future__ import annotations

import math

import numpy as np

from spacearm.kernels.cpu import TURNING, fill, kernel, take_connections, take_jacobians, work
from spacearm.kernels.floating import Bodies, Numbers, generalized_jacobian
from spacearm.kernels.lanes import LANES, Vector, cross, read, step
from spacearm.kernels.slopes import Slopes, joint_axes, slopes, wrench

COMMUTATOR = math.sqrt(3.0) / 12.0
"""Weight of w1 x w2, as in `mechanics.floating`."""
SMALL = 1e-2
"""Angle below which series stand for the quotients of `quotients` [rad]."""
TURN = np.array([3, 4, 5])
"""Rows of the angular velocity."""


@kernel
def connections(
    b: Bodies,
    free: Bodies,
    tip: int,
    E: Numbers,
    q: Numbers,
    dq: Numbers,
    J: Numbers,
    A: Numbers,
    r: Numbers,
    R: Numbers,
    G: Numbers,
) -> None:
    """Compute `cpu.reactions` and the derivatives of A dq, dq held, at m configurations.

    A dq is J* dq of a tip on the spacecraft, of which `slopes` has the derivatives.

    Args:
        b: The arm.
        free: The same bodies, none of them on the chain to the tip.
        tip: Body that the tip is fixed to.
        E: (3,) the tip in the frame of that body [m].
        q: (N, m) joint positions [rad] or [m].
        dq: (m, n) joint rates.
        J: (m, 6, n) receives J*.
        A: (m, 3, n) receives the connection.
        r: (m, 3) receives the tip from the system CM [m].
        R: (m, 3, 3) receives the attitude of body `tip`.
        G: (m, 3, n) receives the derivatives of A dq by each joint.
    """
    m, _, n = J.shape
    w = work(q.shape[0], n)
    d = Slopes(
        body=np.empty(len(b), TURNING),
        F=np.empty((6, LANES)),
        mu=np.empty((6, LANES)),
        h=np.empty((6, LANES)),
        I_mu=np.empty((6, LANES)),
    )
    u, v, L = np.empty((3, LANES)), np.zeros((n, LANES)), np.empty((n, LANES))
    scale = np.ones(3)
    for first in range(0, m, LANES):
        there = min(LANES, m - first)
        fill(w, q, first)
        generalized_jacobian(b, tip, E, w)
        take_jacobians(w, first, J)
        take_connections(b, tip, w, first, A, r, R)
        for j in range(n):
            for l in range(there):
                v[j, l] = dq[first + l, j]
        joint_axes(free, w, d)
        for x in range(3):
            for y in range(3):
                for l in range(LANES):
                    u[y, l] = 1.0 if x == y else 0.0
            wrench(TURN, scale, u, free[0].carried, w, d)
            slopes(free, 0, w, d, v, L)
            for l in range(there):
                for j in range(n):
                    G[first + l, x, j] = L[j, l]


@kernel
def whole_turns(A: Numbers, dq: Numbers, h: float, T: Numbers) -> None:
    """Compute the turns of the spacecraft along K curves.

    Args:
        A: (K m, 3, n) the connection at the m Gauss points of each.
        dq: (K, m, n) derivatives of the joint positions by the curve's parameter there.
        h: Length of each of the m / 2 intervals.
        T: (K, 3, 3) receives the rotations from the axes at the end to those at the start.
    """
    K, m, _ = dq.shape
    for k in range(K):
        one, row = T[k], k * m
        one[:] = 0.0
        for x in range(3):
            one[x, x] = 1.0
        for i in range(0, m, 2):
            w1, w2 = rate(A[row + i], dq[k, i]), rate(A[row + i + 1], dq[k, i + 1])
            turned(one, magnus(w1, w2, h))


@kernel
def turn_and_slope(
    A: Numbers,
    G: Numbers,
    dq: Numbers,
    basis: Numbers,
    slope: Numbers,
    h: float,
    T: Numbers,
    dphi: Numbers,
) -> None:
    """Compute the turn of the spacecraft along one curve, and its derivative by the curve.

    Args:
        A: (m, 3, n) the connection at the Gauss points.
        G: (m, 3, n) derivatives of A dq, dq held.
        dq: (m, n) derivatives of the joint positions by the curve's parameter.
        basis: (m, a) functions of which the curve is the sum.
        slope: (m, a) their derivatives.
        h: Length of an interval.
        T: (3, 3) receives the rotation from the axes at the end to those at the start.
        dphi: (3, a, n) receives the change of the attitude by the curve, in axes at the end.
    """
    m, _, n = A.shape
    waves = basis.shape[1]
    T[:] = 0.0
    dphi[:] = 0.0
    for x in range(3):
        T[x, x] = 1.0
    S = np.empty((3, 3))
    for i in range(0, m, 2):
        w1, w2 = rate(A[i], dq[i]), rate(A[i + 1], dq[i + 1])
        phi = magnus(w1, w2, h)
        turned(T, phi)
        S[:] = 0.0
        for x in range(3):
            S[x, x] = 1.0
        turned(S, phi)
        _, b, c = quotients(phi)
        for a in range(waves):
            for j in range(n):
                v1, v2 = (
                    change(A, G, basis, slope, i, a, j),
                    change(A, G, basis, slope, i + 1, a, j),
                )
                x, y = cross(w1, v2), cross(w2, v1)
                d = (
                    0.5 * h * (v1[0] + v2[0]) + COMMUTATOR * h * h * (x[0] - y[0]),
                    0.5 * h * (v1[1] + v2[1]) + COMMUTATOR * h * h * (x[1] - y[1]),
                    0.5 * h * (v1[2] + v2[2]) + COMMUTATOR * h * h * (x[2] - y[2]),
                )
                once = cross(phi, d)  # the right Jacobian 1 - b [phi]x + c [phi]x^2
                twice = cross(phi, once)
                before = (dphi[0, a, j], dphi[1, a, j], dphi[2, a, j])
                for y_ in range(3):
                    dphi[y_, a, j] = (
                        S[0, y_] * before[0]
                        + S[1, y_] * before[1]
                        + S[2, y_] * before[2]
                        + d[y_]
                        - b * once[y_]
                        + c * twice[y_]
                    )


@step
def change(
    A: Numbers, G: Numbers, basis: Numbers, slope: Numbers, i: int, a: int, j: int
) -> Vector:
    """Return the change of the angular velocity at point i by function a of joint j."""
    f, g = basis[i, a], slope[i, a]
    return (
        f * G[i, 0, j] + g * A[i, 0, j],
        f * G[i, 1, j] + g * A[i, 1, j],
        f * G[i, 2, j] + g * A[i, 2, j],
    )


@step
def rate(A: Numbers, dq: Numbers) -> Vector:
    """Return the angular velocity A dq."""
    x, y, z = 0.0, 0.0, 0.0
    for j in range(len(dq)):
        x += A[0, j] * dq[j]
        y += A[1, j] * dq[j]
        z += A[2, j] * dq[j]
    return (x, y, z)


@step
def magnus(w1: Vector, w2: Vector, h: float) -> Vector:
    """Return the rotation vector of a step of T' = T [w]x."""
    c = cross(w1, w2)
    return (
        0.5 * h * (w1[0] + w2[0]) + COMMUTATOR * h * h * c[0],
        0.5 * h * (w1[1] + w2[1]) + COMMUTATOR * h * h * c[1],
        0.5 * h * (w1[2] + w2[2]) + COMMUTATOR * h * h * c[2],
    )


@step
def quotients(phi: Vector) -> Vector:
    """Return sin(t)/t, (1 - cos t)/t^2 and (t - sin t)/t^3 of the angle t of a rotation vector."""
    z = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    t = math.sqrt(z)
    if t < SMALL:
        return (
            1.0 - z / 6.0 * (1.0 - z / 20.0),
            0.5 - z / 24.0 * (1.0 - z / 30.0),
            (1.0 - z / 20.0 * (1.0 - z / 42.0)) / 6.0,
        )
    return (math.sin(t) / t, (1.0 - math.cos(t)) / z, (t - math.sin(t)) / (t * z))


@step
def turned(T: Numbers, phi: Vector) -> None:
    """Replace T by T exp([phi]x)."""
    a, b, _ = quotients(phi)
    for x in range(3):
        row = read(T[x])  # (T v)^T = v x row for the transposed product: row [phi]x = row x phi
        once = cross(row, phi)
        twice = cross(once, phi)
        for y in range(3):
            T[x, y] = row[y] + a * once[y] + b * twice[y]
