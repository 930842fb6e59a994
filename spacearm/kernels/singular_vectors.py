"""The singular vectors of the least singular value of many small matrices.

J^T = Q B P^T is the bidiagonal form of `singular_values`. z is the eigenvector of B^T B by twisted
factorisation (Dhillon & Parlett, Linear Algebra Appl. 387, 1-28, 2004,
DOI 10.1016/j.laa.2003.12.028), accurate also where sigma_min is far below the others; y solves
B^T y = z. Then J = U diag(sigma) V^T has u = P z and v = Q y, and the last n - k columns of Q span
the null space of J.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from spacearm.kernels.lanes import Lanes, step
from spacearm.kernels.singular_values import Bidiagonal, least_eigenvalue, reflect

TINY = 1e-290


class Vectors(NamedTuple):
    """Work arrays, by lanes.

    Attributes:
        z: (6, lanes) right singular vector of B, then u.
        y: (n, lanes) left one, then v or a vector of the null space.
        plus: (6, lanes) factors; minus and along likewise.
        minus: (6, lanes) factors.
        along: (6, lanes) factors.
        t: (2, lanes) scratch.
    """

    z: Lanes
    y: Lanes
    plus: Lanes
    minus: Lanes
    along: Lanes
    t: Lanes


@step
def singular_vectors(k: int, x: Bidiagonal, d: Vectors) -> None:
    """Compute sigma_min^2 and the singular vectors z and y of B, B z = sigma_min y."""
    for i in range(k):
        for l in range(d.z.shape[1]):
            x.flipped_q[i, l] = x.q[i, l] * x.q[i, l]
            x.flipped_e[i, l] = x.e[i, l] * x.e[i, l]
    least_eigenvalue(k, x, x.flipped_q, x.flipped_e, x.least)
    for l in range(d.z.shape[1]):
        twisted(k, l, x, d)


@step
def nonzero(a: float, least: float) -> float:
    """Return a, or something small in its place where it vanishes."""
    return least if abs(a) < least else a


@step
def twisted(k: int, l: int, x: Bidiagonal, d: Vectors) -> None:
    """Compute z and y in lane l."""
    value, size = x.least[l], TINY
    for i in range(k):
        size += abs(x.q[i, l]) + abs(x.e[i, l])
    least = 1e-17 * size
    s = -value
    for i in range(k - 1):
        d.along[i, l] = s
        pivot = nonzero(x.q[i, l] ** 2 + s, least * least)
        d.plus[i, l] = x.q[i, l] * x.e[i, l] / pivot
        s = s * x.e[i, l] ** 2 / pivot - value
    d.along[k - 1, l] = s
    p = x.q[k - 1, l] ** 2 - value
    twist, best = k - 1, abs(s + p + value)
    for i in range(k - 2, -1, -1):
        pivot = nonzero(x.e[i, l] ** 2 + p, least * least)
        d.minus[i, l] = x.q[i, l] * x.e[i, l] / pivot
        p = p * x.q[i, l] ** 2 / pivot - value
        rest = abs(d.along[i, l] + p + value)
        if rest < best:
            twist, best = i, rest
    d.z[twist, l] = 1.0
    for i in range(twist - 1, -1, -1):
        d.z[i, l] = -d.plus[i, l] * d.z[i + 1, l]
    for i in range(twist, k - 1):
        d.z[i + 1, l] = -d.minus[i, l] * d.z[i, l]
    square = 0.0
    for i in range(k):
        square += d.z[i, l] * d.z[i, l]
    for i in range(k):
        d.z[i, l] /= math.sqrt(square)
    d.y[0, l] = d.z[0, l] / nonzero(x.q[0, l], least)
    square = d.y[0, l] * d.y[0, l]
    for i in range(1, k):
        d.y[i, l] = (d.z[i, l] - x.e[i - 1, l] * d.y[i - 1, l]) / nonzero(x.q[i, l], least)
        square += d.y[i, l] * d.y[i, l]
    for i in range(d.y.shape[0]):
        d.y[i, l] = d.y[i, l] / math.sqrt(square) if i < k else 0.0


@step
def back_from_right(A: Lanes, k: int, d: Vectors) -> None:
    """Turn z into u: apply the reflections from the right that A holds."""
    for i in range(k - 3, -1, -1):
        reflection(A[i, i + 1 : k], d.z[i + 1 : k], d.t)


@step
def back_from_left(A: Lanes, k: int, d: Vectors) -> None:
    """Turn y into v: apply the reflections from the left that A holds."""
    for i in range(k - 1, -1, -1):
        reflection(A[i:, i], d.y[i:], d.t)


@step
def reflection(v: Lanes, x: Lanes, t: Lanes) -> None:
    """Apply 1 - 2 v v^T / v^T v, or nothing where v is zero."""
    for l in range(t.shape[1]):
        t[0, l] = 0.0
    for j in range(v.shape[0]):
        for l in range(t.shape[1]):
            t[0, l] += v[j, l] * v[j, l]
    for l in range(t.shape[1]):
        t[0, l] = 2.0 / t[0, l] if t[0, l] > 0.0 else 0.0
    reflect(v, x, t[0], t[1])
