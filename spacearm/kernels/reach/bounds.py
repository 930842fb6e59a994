"""Bounds of the distance |p| of the tip over a box of joint positions q + d, |d_j| <= h_j.

Second order, from the derivatives g and H of p at the centre: with any unit vector u

    |p| >= u . p >= u . (p + g d + d H d / 2) - rest.

Each joint's own share of this is minimised exactly, products of two are bounded by their size. The
u that is best to first order is taken: the nearest point of p + g d to zero shows where it points.
From above |p| <= u . p + v^2 / (2 u . p), with u = p / |p| at the centre and v what of p is normal
to it.
"""

from __future__ import annotations

import math

from spacearm.kernels.floating import Numbers
from spacearm.kernels.lanes import part
from spacearm.kernels.reach.chain import Chain, Placed

SWEEPS = 4
"""How often each joint is moved in the search for the nearest point."""
NOTHING = 1e-3
"""Share of |p| at which that point is as good as zero."""


@part
def bound(chain: Chain, half: Numbers, nearest: bool, w: Placed) -> float:
    """Bound |p| over a box from below, or -|p| if not `nearest`; w holds the chain at its centre.

    w.errors receives how much each joint adds to the width of the bound.
    """
    n, p, u = len(half), w.p, w.u
    size = math.sqrt(p[0] ** 2 + p[1] ** 2 + p[2] ** 2)
    for j in range(n):
        w.errors[j] = 0.5 * chain.rho[j] * half[j] ** 2
    if nearest:
        towards_the_nearest(half, size, w)
        along = u[0] * p[0] + u[1] * p[1] + u[2] * p[2]
        return along + below(chain, half, 1.0, 0.0, w)
    most = size + w.rest[0]
    if size > 0.0:
        for x in range(3):
            u[x] = p[x] / size
    least, normal = size - w.rest[0], w.rest[0]
    for j in range(n):
        g = w.g[j]
        slope = u[0] * g[0] + u[1] * g[1] + u[2] * g[2]
        whole = g[0] ** 2 + g[1] ** 2 + g[2] ** 2
        most += math.sqrt(whole) * half[j]
        least -= abs(slope) * half[j]
        normal += math.sqrt(max(whole - slope**2, 0.0)) * half[j]
    if least <= 0.0:
        below(chain, half, -1.0, 0.0, w)
        return -most
    bent = (2.0 * normal * w.rest[0]) / (2.0 * least)  # (v + rest)^2 <= v^2 + 2 (v + rest) rest
    return max(-most, below(chain, half, -1.0, 1.0 / least, w) - size - bent)


@part
def towards_the_nearest(half: Numbers, size: float, w: Placed) -> None:
    """Set u to the direction of the point of p + g d that is nearest to zero, found by descent."""
    y0, y1, y2 = w.p[0], w.p[1], w.p[2]
    for j in range(len(half)):
        w.d[j] = 0.0
    for _ in range(SWEEPS):
        for j in range(len(half)):
            g = w.g[j]
            square = g[0] ** 2 + g[1] ** 2 + g[2] ** 2
            if square > 1e-300:
                to = w.d[j] - (y0 * g[0] + y1 * g[1] + y2 * g[2]) / square
                to = min(max(to, -half[j]), half[j])
                step = to - w.d[j]
                w.d[j] = to
                y0 += step * g[0]
                y1 += step * g[1]
                y2 += step * g[2]
    length = math.sqrt(y0**2 + y1**2 + y2**2)
    if length <= NOTHING * size:
        y0, y1, y2, length = w.p[0], w.p[1], w.p[2], size
    if length == 0.0:
        y0 = length = 1.0
    w.u[0], w.u[1], w.u[2] = y0 / length, y1 / length, y2 / length


@part
def below(chain: Chain, half: Numbers, sign: float, share: float, w: Placed) -> float:
    """Bound sign u . (p - centre) - share v^2 / 2 from below, v the part of g d normal to u."""
    n, m, u = len(half), chain.middle, w.u
    first, second = -w.rest[0], -w.rest[1]
    for j in range(n):
        g = w.g[j]
        z = w.R[j + 1]
        x0 = u[1] * z[2, 2] - u[2] * z[1, 2]
        x1 = u[2] * z[0, 2] - u[0] * z[2, 2]
        x2 = u[0] * z[1, 2] - u[1] * z[0, 2]
        slope = u[0] * g[0] + u[1] * g[1] + u[2] * g[2]
        for i in range(j, n):
            o = w.g[i]
            bend = 0.0
            if j >= m:
                bend = sign * (x0 * o[0] + x1 * o[1] + x2 * o[2])
            elif i < m:
                bend = sign * inner(u, w.R[i + 1], g)
            other = u[0] * o[0] + u[1] * o[1] + u[2] * o[2]
            bend -= share * (g[0] * o[0] + g[1] * o[1] + g[2] * o[2] - slope * other)
            if i > j:
                low = -abs(bend) * half[i] * half[j]
                w.errors[i] -= 0.5 * low
                w.errors[j] -= 0.5 * low
            else:
                steep = abs(slope)
                if steep < bend * half[j]:
                    low = -0.5 * steep**2 / bend
                else:
                    low = -steep * half[j] + 0.5 * bend * half[j] ** 2
                first -= steep * half[j]
                w.errors[j] -= low
            second += low
    return second if share > 0.0 else max(first, second)


@part
def inner(u: Numbers, z: Numbers, g: Numbers) -> float:
    """Return the second derivative along u by a joint of the inner part and one before it, of g."""
    return -(
        u[0] * (z[1, 2] * g[2] - z[2, 2] * g[1])
        + u[1] * (z[2, 2] * g[0] - z[0, 2] * g[2])
        + u[2] * (z[0, 2] * g[1] - z[1, 2] * g[0])
    )
