"""The turn of a floating spacecraft without momentum, and how it depends on the joint path.

The attitude follows T' = T [A(q) q']x with the connection A = -D^-1 D_q of (33c), in spacecraft
axes. It is integrated by the fourth-order Magnus method with two Gauss points an interval
(Iserles & Norsett, Phil. Trans. R. Soc. A 357, 983-1019 (1999), DOI 10.1098/rsta.1999.0362).
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from spacearm.equations.kinematics import Parameters, Structure, connection_at, jacobian_at, posture
from spacearm.equations.linear_algebra import solve

#: Gauss-Legendre nodes of an interval, as shares of it.
GAUSS = (0.5 - math.sqrt(3.0) / 6.0, 0.5 + math.sqrt(3.0) / 6.0)
#: Weight of w_1 x w_2 in the Magnus method with these nodes.
COMMUTATOR = math.sqrt(3.0) / 12.0
#: Square of the angle below which series stand for the quotients of `shares` [rad^2].
SMALL = 1e-4


def reactions(xp: Any, tree: Structure, p: Parameters, q: Any) -> tuple[Any, Any, Any, Any]:
    """Compute J* (6 tips, n), the connection (3, n), and position and attitude of the first tip."""
    at = posture(xp, tree, p, q)
    J = jacobian_at(xp, tree, at)
    return J, connection_at(xp, tree, at), at.tip_positions[0], at.tip_rotations[0]


def momenta(xp: Any, tree: Structure, p: Parameters, q: Any) -> tuple[Any, Any]:
    """Compute D (3, 3) and D_q (3, n) of the angular momentum D w_0 + D_q dq about the CM."""
    at = posture(xp, tree, p, q)
    return at.D, xp.stack([at.P[:, 3 + axis] @ tree.gains for axis in range(3)])


def turn(xp: Any, tree: Structure, p: Parameters, q: Any, dq: Any, h: Any) -> Any:
    """Compute the turn (3, 3) of the spacecraft in an interval.

    Args:
        xp: The array library.
        tree: The structure of the arm.
        p: The parameters of the arm.
        q: (2, n) joint positions at the Gauss points.
        dq: (2, n) derivatives by the parameter of the curve there.
        h: Length of the interval.

    Returns:
        The rotation from the axes at the end to those at the start.
    """
    rate = xp.procedure(lambda q, dq: connection_at(xp, tree, posture(xp, tree, p, q)) @ dq)
    return rotation(xp, magnus(xp, rate(q[0], dq[0]), rate(q[1], dq[1]), h))


def turn_and_effects(
    xp: Any, tree: Structure, p: Parameters, q: Any, dq: Any, h: Any
) -> tuple[Any, ...]:
    """Compute the turn of the spacecraft in an interval, and how it depends on the curve.

    Args:
        xp: The array library.
        tree: The structure of the arm.
        p: The parameters of the arm.
        q: (2, n) joint positions at the Gauss points.
        dq: (2, n) derivatives by the parameter of the curve there.
        h: Length of the interval.

    Returns:
        (3, 3) the turn. (2, 2, 3, n) how the axes at the end turn with q and with dq at each of
        the points. (2, 6 tips, n) J* at these. At the second point, `reactions` but for J*.
    """
    point = xp.procedure(lambda q, dq: _point(xp, tree, p, q, dq))
    J1, A1, _, _, w1, G1 = point(q[0], dq[0])
    J2, A2, r, R, w2, G2 = point(q[1], dq[1])
    phi = magnus(xp, w1, w2, h)
    bend, half = COMMUTATOR * h * h, 0.5 * h * np.eye(3)
    right = right_jacobian(xp, phi)
    first = right @ (half - bend * cross_matrix(xp, w2))
    second = right @ (half + bend * cross_matrix(xp, w1))
    effects = xp.stack([xp.stack([first @ G1, first @ A1]), xp.stack([second @ G2, second @ A2])])
    return rotation(xp, phi), effects, xp.stack([J1, J2]), A2, r, R


def _point(xp: Any, tree: Structure, p: Parameters, q: Any, dq: Any) -> tuple[Any, ...]:
    """Compute `reactions`, w = A dq and its derivatives (3, n) by q, dq held.

    The angular momentum D w + D_q dq is zero; its derivative with w held gives that of w.
    """
    at = posture(xp, tree, p, q)
    A = connection_at(xp, tree, at)
    w = A @ dq
    held = xp.hold(w)

    def momentum(q: Any, axis: int) -> Any:
        at = posture(xp, tree, p, q)
        return at.D[axis] @ held + at.P[:, 3 + axis] @ (tree.gains @ dq)

    slopes = xp.stack([xp.gradient(partial(momentum, axis=axis), q) for axis in range(3)])
    return *reactions(xp, tree, p, q), w, -solve(xp, at.D, slopes)


def magnus(xp: Any, w1: Any, w2: Any, h: Any) -> Any:
    """Compute the rotation vector (3,) of an interval, T -> T exp([phi]x).

    Args:
        xp: The array library.
        w1: (..., 3) angular velocity at the first of the `GAUSS` points, body axes.
        w2: (..., 3) that at the second.
        h: Length of the interval.
    """
    return 0.5 * h * (w1 + w2) + COMMUTATOR * h * h * xp.cross(w1, w2)


def shares(xp: Any, square: Any) -> tuple[Any, Any, Any]:
    """Compute sin x / x, (1 - cos x) / x^2 and (x - sin x) / x^3 of an angle x, given x^2."""
    small, z = square < SMALL, xp.where(square < SMALL, 1.0, square)
    x = xp.sqrt(z)
    sin, cos = xp.sin(x), xp.cos(x)
    return (
        xp.where(small, 1.0 - square / 6.0 * (1.0 - square / 20.0), sin / x),
        xp.where(small, 0.5 - square / 24.0 * (1.0 - square / 30.0), (1.0 - cos) / z),
        xp.where(small, (1.0 - square / 20.0 * (1.0 - square / 42.0)) / 6.0, (x - sin) / (x * z)),
    )


def cross_matrix(xp: Any, v: Any) -> Any:
    """Return the matrix [v]x (3, 3) of the cross product with v (3,)."""
    o = 0.0 * v[0]
    return xp.stack([xp.stack([o, -v[2], v[1]]), xp.stack([v[2], o, -v[0]]),
                     xp.stack([-v[1], v[0], o])])  # fmt: skip


def rotation(xp: Any, phi: Any) -> Any:
    """Compute exp([phi]x) (3, 3) of a rotation vector phi (3,)."""
    a, b, _ = shares(xp, phi @ phi)
    X = cross_matrix(xp, phi)
    return np.eye(3) + a * X + b * (X @ X)


def right_jacobian(xp: Any, phi: Any) -> Any:
    """Compute the matrix (3, 3) that takes a change of phi to a turn of the axes of exp([phi]x)."""
    _, b, c = shares(xp, phi @ phi)
    X = cross_matrix(xp, phi)
    return np.eye(3) - b * X + c * (X @ X)
