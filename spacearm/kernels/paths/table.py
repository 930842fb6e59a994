"""Paths of the tip as tables of cubic pieces, and the pose and twist at a length along them."""

from __future__ import annotations

import math
from typing import NamedTuple

from spacearm.kernels.floating import Indices, Numbers
from spacearm.kernels.lanes import Vector, cross, dot, step

Rows = tuple[Vector, Vector, Vector]
"""A rotation matrix by rows."""


class Table(NamedTuple):
    """Paths in smooth pieces, each in equal intervals that are cubic in position and turn.

    Attributes:
        first: (paths + 1,) number of the first piece of each path, and of all pieces.
        begin: (pieces,) length along the path at which a piece begins.
        end: (pieces,) that at which it ends.
        interval: (pieces + 1,) number of the first interval of each piece, and of all intervals.
        p: (intervals, 4, 3) position at the ends and its derivatives there, by the share of the
            interval [m].
        R: (intervals, 3, 3) attitude at the start.
        f: (intervals, 3, 3) turn to the end as a rotation vector in inertial axes [rad], and the
            derivatives of the rotation vector at both ends.
    """

    first: Indices
    begin: Numbers
    end: Numbers
    interval: Indices
    p: Numbers
    R: Numbers
    f: Numbers


@step
def at_length(t: Table, piece: int, s: float) -> tuple[Vector, Rows, Vector, Vector]:
    """Return position, attitude, velocity and angular velocity (by length) on a piece."""
    span = t.end[piece] - t.begin[piece]
    count = t.interval[piece + 1] - t.interval[piece]
    share = (s - t.begin[piece]) / span * count
    i = min(max(math.floor(share), 0), count - 1)
    u, rate, k = share - i, count / span, t.interval[piece] + i
    h00, h01 = (1.0 + 2.0 * u) * (1.0 - u) * (1.0 - u), u * u * (3.0 - 2.0 * u)
    h10, h11 = u * (1.0 - u) * (1.0 - u), u * u * (u - 1.0)
    d01 = 6.0 * u * (1.0 - u)
    d10, d11 = (1.0 - u) * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)
    p, f = t.p[k], t.f[k]
    place = (
        h00 * p[0, 0] + h01 * p[1, 0] + h10 * p[2, 0] + h11 * p[3, 0],
        h00 * p[0, 1] + h01 * p[1, 1] + h10 * p[2, 1] + h11 * p[3, 1],
        h00 * p[0, 2] + h01 * p[1, 2] + h10 * p[2, 2] + h11 * p[3, 2],
    )
    v = (
        rate * (d01 * (p[1, 0] - p[0, 0]) + d10 * p[2, 0] + d11 * p[3, 0]),
        rate * (d01 * (p[1, 1] - p[0, 1]) + d10 * p[2, 1] + d11 * p[3, 1]),
        rate * (d01 * (p[1, 2] - p[0, 2]) + d10 * p[2, 2] + d11 * p[3, 2]),
    )
    turn = (
        h01 * f[0, 0] + h10 * f[1, 0] + h11 * f[2, 0],
        h01 * f[0, 1] + h10 * f[1, 1] + h11 * f[2, 1],
        h01 * f[0, 2] + h10 * f[1, 2] + h11 * f[2, 2],
    )
    dturn = (
        rate * (d01 * f[0, 0] + d10 * f[1, 0] + d11 * f[2, 0]),
        rate * (d01 * f[0, 1] + d10 * f[1, 1] + d11 * f[2, 1]),
        rate * (d01 * f[0, 2] + d10 * f[1, 2] + d11 * f[2, 2]),
    )
    angle_2 = dot(turn, turn)
    a, b, c = shares(angle_2)
    R = t.R[k]
    x = rotated(turn, a, b, (R[0, 0], R[1, 0], R[2, 0]))
    y = rotated(turn, a, b, (R[0, 1], R[1, 1], R[2, 1]))
    z = rotated(turn, a, b, (R[0, 2], R[1, 2], R[2, 2]))
    w = rotated(turn, b, c, dturn)
    return place, ((x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])), v, w


@step
def shares(angle_2: float) -> Vector:
    """Return sin x / x, (1 - cos x) / x^2 and (x - sin x) / x^3 of the angle x, from x^2."""
    if angle_2 < 1e-4:
        return (
            1.0 - angle_2 / 6.0 * (1.0 - angle_2 / 20.0),
            0.5 - angle_2 / 24.0 * (1.0 - angle_2 / 30.0),
            1.0 / 6.0 - angle_2 / 120.0 * (1.0 - angle_2 / 42.0),
        )
    angle = math.sqrt(angle_2)
    sine, cosine = math.sin(angle), math.cos(angle)
    return (sine / angle, (1.0 - cosine) / angle_2, (angle - sine) / (angle_2 * angle))


@step
def rotated(turn: Vector, a: float, b: float, x: Vector) -> Vector:
    """Return x + a turn x x + b turn x (turn x x)."""
    once = cross(turn, x)
    twice = cross(turn, once)
    return (
        x[0] + a * once[0] + b * twice[0],
        x[1] + a * once[1] + b * twice[1],
        x[2] + a * once[2] + b * twice[2],
    )
