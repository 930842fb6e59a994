"""The tip of a chain from the system CM, and bounds of its distance over a box of joint positions.

The tip is p = sum_k T_k b_k, with b_k constant in body k and T_k its attitude. In the axes of a
body m in the middle, joints 1 to m turn the bodies before them, the others the bodies beyond them.
So p is one function of the joints up to m plus one of those after it, and second derivatives that
mix the two vanish.

Over the box q + d, |d_j| <= h_j, with the derivatives g and H of p at q and any unit vector u,

    |p| >= u . p >= u . (p + g d + d H d / 2) - rest.

Each joint's own share of this is minimised exactly, products of two are bounded by their size. The
u that is best to first order is taken: the nearest point of p + g d to zero shows where it points.
From above |p| <= u . p + v^2 / (2 u . p), with u = p / |p| at q and v what of p is normal to it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from spacearm.equations.kinematics import Array, Parameters, Structure

#: How often each joint is moved in the search for the nearest point.
SWEEPS = 4
#: Share of |p| at which that point is as good as zero.
NOTHING = 1e-3


def attitudes_at_zero(tree: Structure, p: Parameters) -> Array:
    """Return the attitude (N + 1, 3, 3) of each body at q = 0 in that of the one before.

    The frames have z along the axis of their joint; the spacecraft has its own.
    """
    inner = tree.turns[list(tree.parents)]
    E: Array = inner[1:].swapaxes(1, 2) @ p.joint_rotations @ tree.turns[1:]
    return np.concatenate((np.eye(3)[None], E))


def constant_vectors(tree: Structure, p: Parameters) -> Array:
    """Return b_k (N + 1, 3), the share of each body in the tip from the CM, in its frame [m].

    From a spacecraft that is fixed, from its own CM.
    """
    weights = np.eye(len(p.masses))[0] if tree.mode == "fixed" else p.masses / p.masses.sum()
    own = tree.turns.swapaxes(1, 2)
    share: Array = -weights[:, None] * (own @ p.centres[..., None])[..., 0]
    outer = tree.reaches[0] - tree.carries[1:] @ weights
    for k, inner in enumerate(tree.parents[1:]):
        share[inner] += outer[k] * (own[inner] @ p.joint_positions[k])
    share[tree.tips[0]] += own[tree.tips[0]] @ p.tip_positions[0]
    return share


class Placed(NamedTuple):
    """A chain at the centre of a box, and how far the tip may be from its expansion there.

    Attributes:
        p: (3,) the tip [m].
        z: (n, 3) axes of the joints, in the axes of the body in the middle.
        g: (n, 3) derivatives of the tip by the joints [m].
        rest: Largest distances from its expansion to first and to second order [m].
    """

    p: Any
    z: Any
    g: Any
    rest: tuple[Any, Any]


def place(xp: Any, middle: int, E: Any, b: Any, rho: Any, q: Any, half: Any) -> Placed:
    """Place a chain of n revolute joints, of which joint k carries body k.

    Args:
        xp: The array library.
        middle: Number of the body in the middle.
        E: (n + 1, 3, 3) attitude of each body at q = 0 in that of the one before.
        b: (n + 1, 3) its share in the tip from the system CM [m].
        rho: (n,) largest distance from the axis of a joint of what it turns [m].
        q: (n,) the centre of the box [rad].
        half: (n,) its half widths [rad].
    """
    n, m = len(q), middle
    Rz = [_about_z(xp, xp.sin(angle), xp.cos(angle)) for angle in q]
    R: list[Any] = [np.eye(3)] * (n + 1)
    for k in range(m + 1, n + 1):
        R[k] = R[k - 1] @ E[k] @ Rz[k - 1]
    for k in range(m, 0, -1):
        R[k - 1] = R[k] @ Rz[k - 1].T @ E[k].T
    z = xp.stack([R[k][:, 2] for k in range(1, n + 1)])
    g: list[Any] = [None] * n
    beyond, before = np.zeros(3), np.zeros(3)
    for k in range(n, m, -1):
        beyond = beyond + R[k] @ b[k]
        g[k - 1] = xp.cross(z[k - 1], beyond)
    for k in range(m):
        before = before + R[k] @ b[k]
        g[k] = -xp.cross(z[k], before)
    second = third = 0.0
    for group in (range(m, n), range(m - 1, -1, -1)):
        inner = 0.0
        for j in group:  # the derivative by joints up to j is at most rho_j
            up_to = inner + half[j]
            second = second + rho[j] * (up_to**2 - inner**2)
            third = third + rho[j] * (up_to**3 - inner**3)
            inner = up_to
    return Placed(beyond + before + b[m], z, xp.stack(g), (second / 2.0, third / 6.0))


def _about_z(xp: Any, sin: Any, cos: Any) -> Any:
    """Return the rotation (3, 3) about z."""
    o = 0.0 * sin
    rows = (cos, -sin, o), (sin, cos, o), (o, o, o + 1.0)
    return xp.stack([xp.stack(row) for row in rows])


def bound(
    xp: Any, middle: int, nearest: bool, E: Any, b: Any, rho: Any, q: Any, half: Any
) -> tuple[Any, Any, Any]:
    """Bound |p| over a box from below, or -|p| if not `nearest`; arguments as of `place`.

    Returns:
        The bound, |p| at the centre [m], and (n,) how much each joint adds to the width.
    """
    at = place(xp, middle, E, b, rho, q, half)
    size = xp.sqrt((at.p * at.p).sum())
    errors = 0.5 * rho * half**2
    if nearest:
        u = _towards_the_nearest(xp, at, half, size)
        first, second, more = _below(xp, middle, at, half, u, 1.0, 0.0)
        return u @ at.p + xp.maximum(first, second), size, errors + more
    u = xp.where(size > 0.0, at.p / size, np.eye(3)[0])
    slopes, whole = at.g @ u, (at.g * at.g).sum(axis=1)
    most = size + at.rest[0] + (xp.sqrt(whole) * half).sum()
    least = size - at.rest[0] - (xp.absolute(slopes) * half).sum()
    normal = at.rest[0] + (xp.sqrt(xp.maximum(whole - slopes**2, 0.0)) * half).sum()
    share = xp.where(least > 0.0, 1.0 / least, 0.0)
    _, second, more = _below(xp, middle, at, half, u, -1.0, share)
    bent = normal * at.rest[0] / least  # (v + rest)^2 <= v^2 + 2 (v + rest) rest
    bounded = xp.maximum(-most, second - size - bent)
    return xp.where(least > 0.0, bounded, -most), size, errors + more


def _towards_the_nearest(xp: Any, at: Placed, half: Any, size: Any) -> Any:
    """Return the direction of the point of p + g d that is nearest to zero, found by descent."""
    squares = (at.g * at.g).sum(axis=1)

    def sweep(_: Any, y: Any, d: Any) -> tuple[Any, Any]:
        moved = []
        for j in range(len(half)):
            turns = squares[j] > 1e-300
            to = d[j] - (y @ at.g[j]) / xp.where(turns, squares[j], 1.0)
            to = xp.where(turns, xp.minimum(xp.maximum(to, -half[j]), half[j]), d[j])
            y = y + (to - d[j]) * at.g[j]
            moved.append(to)
        return y, xp.stack(moved)

    y, _ = xp.repeat(SWEEPS, sweep, at.p, 0.0 * half)
    length = xp.sqrt((y * y).sum())
    none = length <= NOTHING * size
    y, length = xp.where(none, at.p, y), xp.where(none, size, length)
    return xp.where(length > 0.0, y / xp.where(length > 0.0, length, 1.0), np.eye(3)[0])


def _below(
    xp: Any, middle: int, at: Placed, half: Any, u: Any, sign: float, share: Any
) -> tuple[Any, Any, Any]:
    """Bound sign u . (p - centre) - share v^2 / 2 from below, v the part of g d normal to u.

    Returns:
        The bound to first order, which holds without share, the one to second order, and (n,) how
        much each joint adds to the width of the latter.
    """
    slopes = at.g @ u
    bends = xp.stack([xp.cross(u, z) for z in at.z]) @ at.g.T
    flat = at.g @ at.g.T - slopes[:, None] * slopes
    steep, n = xp.absolute(slopes), len(half)
    lows: list[list[Any]] = [[0.0] * n for _ in range(n)]
    for j in range(n):
        for i in range(j, n):
            bend = bends[j, i] if j >= middle else -bends[i, j] if i < middle else 0.0
            bend = sign * bend - share * flat[j, i]
            if i > j:
                lows[j][i] = lows[i][j] = -0.5 * xp.absolute(bend) * half[i] * half[j]
            else:
                inside = steep[j] < bend * half[j]
                lowest = -0.5 * steep[j] ** 2 / xp.where(inside, bend, 1.0)
                ends = -steep[j] * half[j] + 0.5 * bend * half[j] ** 2
                lows[j][j] = xp.where(inside, lowest, ends)
    each = xp.stack([sum(row[1:], row[0]) for row in lows])
    return -at.rest[0] - (steep * half).sum(), -at.rest[1] + each.sum(), -each
