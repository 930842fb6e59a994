"""The tip of a chain from the system CM, and its derivatives, in the axes of a body in the middle.

The tip is p = sum_k T_k b_k, b_k constant in body k, T_k its attitude. In the axes of body m joints
1 to m turn the bodies before them, the others the bodies beyond them. So p is one function of the
joints up to m plus one of those after it, and second derivatives that mix the two vanish.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from spacearm.kernels.floating import Numbers
from spacearm.kernels.lanes import part


class Chain(NamedTuple):
    """A chain of n revolute joints; joint k carries body k.

    Attributes:
        E: (n + 1, 3, 3) attitude of each body at q = 0 in that of the one before.
        b: (n + 1, 3) its share in the tip from the system CM [m].
        rho: (n,) largest distance from the axis of a joint of what it turns [m].
        middle: Number of the body in the middle.
    """

    E: Numbers
    b: Numbers
    rho: Numbers
    middle: int


class Placed(NamedTuple):
    """The chain at the centre of a box, and how far the tip may be from its expansion there.

    Attributes:
        R: (n + 1, 3, 3) attitudes in the axes of the middle body; column 2 is the joint's axis.
        p: (3,) the tip [m].
        g: (n, 3) its derivatives by the joints [m].
        rest: (2,) largest distance from its expansion to first and to second order [m].
        u: (3,) a unit vector.
        d: (n,) scratch.
        errors: (n,) how much each joint adds to the width of the bound [m].
    """

    R: Numbers
    p: Numbers
    g: Numbers
    rest: Numbers
    u: Numbers
    d: Numbers
    errors: Numbers


@part
def places(n: int) -> Placed:
    """Allocate the work arrays of a chain of n joints."""
    return Placed(
        np.empty((n + 1, 3, 3)),
        np.empty(3),
        np.empty((n, 3)),
        np.empty(2),
        np.empty(3),
        np.empty(n),
        np.empty(n),
    )


@part
def place(chain: Chain, q: Numbers, half: Numbers, w: Placed) -> None:
    """Compute R, p, g and rest for the box with centre q (n,) and half widths (n,)."""
    turn(chain, q, w.R)
    n, m = len(q), chain.middle
    for x in range(3):
        w.p[x] = 0.0
    for first, last, way, sign in ((n, m, -1, 1.0), (0, m, 1, -1.0)):
        s0 = s1 = s2 = 0.0
        for k in range(first, last, way):
            b, R = chain.b[k], w.R[k]
            s0 += R[0, 0] * b[0] + R[0, 1] * b[1] + R[0, 2] * b[2]
            s1 += R[1, 0] * b[0] + R[1, 1] * b[1] + R[1, 2] * b[2]
            s2 += R[2, 0] * b[0] + R[2, 1] * b[1] + R[2, 2] * b[2]
            j = k if way < 0 else k + 1
            z = w.R[j]
            w.g[j - 1, 0] = sign * (z[1, 2] * s2 - z[2, 2] * s1)
            w.g[j - 1, 1] = sign * (z[2, 2] * s0 - z[0, 2] * s2)
            w.g[j - 1, 2] = sign * (z[0, 2] * s1 - z[1, 2] * s0)
        w.p[0] += s0
        w.p[1] += s1
        w.p[2] += s2
    second = third = 0.0
    for first, last, way in ((m, n, 1), (m - 1, -1, -1)):
        before = 0.0
        for j in range(first, last, way):  # the derivative by joints up to j is at most rho_j
            up_to = before + half[j]
            second += chain.rho[j] * (up_to**2 - before**2)
            third += chain.rho[j] * (up_to**3 - before**3)
            before = up_to
    for x in range(3):
        w.p[x] += chain.b[m, x]
    w.rest[0], w.rest[1] = second / 2.0, third / 6.0


@part
def turn(chain: Chain, q: Numbers, R: Numbers) -> None:
    """Compute the attitudes R (n + 1, 3, 3) in the axes of the middle body."""
    n, m = len(q), chain.middle
    for x in range(3):
        for y in range(3):
            R[m, x, y] = 1.0 if x == y else 0.0
    for k in range(m + 1, n + 1):
        c, s, E = math.cos(q[k - 1]), math.sin(q[k - 1]), chain.E[k]
        for x in range(3):
            i, j, l = R[k - 1, x, 0], R[k - 1, x, 1], R[k - 1, x, 2]
            a = i * E[0, 0] + j * E[1, 0] + l * E[2, 0]
            b = i * E[0, 1] + j * E[1, 1] + l * E[2, 1]
            R[k, x, 0] = a * c + b * s
            R[k, x, 1] = b * c - a * s
            R[k, x, 2] = i * E[0, 2] + j * E[1, 2] + l * E[2, 2]
    for k in range(m, 0, -1):
        c, s, E = math.cos(q[k - 1]), math.sin(q[k - 1]), chain.E[k]
        for x in range(3):
            a = R[k, x, 0] * c - R[k, x, 1] * s
            b = R[k, x, 0] * s + R[k, x, 1] * c
            for y in range(3):
                R[k - 1, x, y] = a * E[y, 0] + b * E[y, 1] + R[k, x, 2] * E[y, 2]
