"""How singular a configuration is: S, measures of J*, determinants seen from the tip, the distance.

Seen from the tip, a free-floating arm is a chain from the tip to the spacecraft. Let B act on the
twist of the tip, and column P_j on the rate of joint j alone, the tip held still. P_j is the
momentum of all that joint j then moves, which is everything on the spacecraft's side of it. The
whole momentum is B xi + P dq, and det [A_b A_q; J_b J_q] (task rows) = +- det [B_f P], where f are
the directions of xi outside the task. No inertia is inverted, and a light spacecraft gives a small
column instead of a small difference of large numbers.

How far the nearest singular configuration is, and the way there, follow to first order from the
gradient g = u^T dJ* v of the least singular value. Of a redundant arm u^T dJ* v_0 must also stay
zero for all v_0 of the null space. `mechanics.distance` has the theory, and the same from the
derivatives of the matrices.
"""

from __future__ import annotations

from math import comb
from typing import Any

import numpy as np

from spacearm.equations import kinematics, linear_algebra
from spacearm.equations.kinematics import COLUMNS, ROWS, SYMMETRIC, Parameters, Structure

#: Maximal minors of a task Jacobian that S is made of; more would make endless code.
MOST_MINORS = 250


def singularity(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute S, which is zero exactly where the task Jacobian is singular.

    S = det(D) det(J*) if there are as many joints as task rows: equation (41) of a planar arm, of
    which only the inertia about the normal of its plane counts. Of a redundant arm S is
    det(D)^2 det(J* J*^T), the sum of the squares of all maximal minors; zero if the joints are
    fewer than the rows. Spacecraft that do not float have S without D. Arms with more than
    `MOST_MINORS` of them have the determinant itself, which rounding spares less near the set.
    """
    k, n = len(tree.rows), tree.n
    if k > n:
        return 0.0 * q[0]
    at = kinematics.posture(xp, tree, p, q)
    J = kinematics.task_jacobian_at(xp, tree, at)
    D = 1.0
    if tree.mode == "free-floating":
        i = tree.normal
        D = linear_algebra.minors(at.D)[0] if i is None else at.D[i, i]
    if k == n:
        return D * linear_algebra.determinant(xp, J)
    if comb(n, k) > MOST_MINORS:
        return D * D * linear_algebra.determinant(xp, J @ J.T)
    found = linear_algebra.minors(J)
    return D * D * (found * found).sum()


def measures(
    xp: Any, tree: Structure, p: Parameters, q: Any, names: tuple[str, ...]
) -> tuple[Any, ...]:
    """Compute measures of singularity of an arm with one tip.

    Args:
        xp: The array library.
        tree: The structure of the arm.
        p: Its numbers.
        q: (n,) joint positions.
        names: Of "sigma_min", "manipulability", "condition", "determinant" and "radius", as
            `spacearm.evaluate` has them.
    """
    k, n = len(tree.rows), tree.n
    at = kinematics.posture(xp, tree, p, q)
    r = at.tip_positions[0]
    known = {"radius": xp.sqrt((r * r).sum())}
    if k > n:
        known |= {"sigma_min": 0.0, "manipulability": 0.0, "condition": np.inf}
        return tuple(known.get(name, np.nan) for name in names)
    form = linear_algebra.bidiagonal(xp, kinematics.task_jacobian_at(xp, tree, at))
    least = form.least(xp)
    product = form.sign
    for entry in form.q:
        product = product * entry
    known["sigma_min"] = xp.sqrt(least)
    known["manipulability"] = xp.absolute(product)
    known["determinant"] = product if k == n else np.nan
    if "condition" in names:
        condition = xp.sqrt(form.largest(xp) / least)
        known["condition"] = xp.where(least > 0.0, condition, np.inf)
    return tuple(known[name] for name in names)


Columns = tuple[tuple[int, ...], ...]


def columns(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute [B P] (6, 6 + n) of an arm with one tip, about the system CM.

    Of a spacecraft that does not float B is zero and P its Jacobian.
    """
    if tree.mode != "free-floating":
        J = kinematics.jacobian(xp, tree, p, q)
        return xp.concatenate([np.zeros((6, 6)), J], axis=1)
    at = kinematics.posture(xp, tree, p, q)
    moves, sign = moved(tree), np.where(tree.reaches[0], -1.0, 1.0)[:, None]
    moments = at.masses * at.centres
    inertias = moves @ (at.inertias[:, ROWS, COLUMNS] + kinematics.about(at.centres, moments))
    P = sign * kinematics.momenta(
        xp, moves @ at.masses, moves @ moments, inertias[:, SYMMETRIC], at.s
    )
    M, r = at.M[0], at.tip_positions[0]
    turned = xp.cross(M * r, np.eye(3)).T
    linear = xp.concatenate([M * np.eye(3), turned], axis=1)
    B = xp.concatenate([linear, xp.concatenate([np.zeros((3, 3)), at.D], axis=1)], axis=0)
    return xp.concatenate([B, P.T @ tree.gains], axis=1)


def moved(tree: Structure) -> Any:
    """Return 1 (N, N + 1) where a joint moves a body while the tip stands still, else 0."""
    carries = tree.carries[1:]
    return np.where(tree.reaches[0][:, None] > 0.0, 1.0 - carries, carries)


def determinants(
    xp: Any, tree: Structure, p: Parameters, q: Any, row_unit: Any, column_unit: Any,
    rows: tuple[int, ...], chosen: Columns,
) -> Any:  # fmt: skip
    """Compute determinants (c,) of `columns`.

    Args:
        xp: The array library.
        tree: The structure of the arm.
        p: Its numbers.
        q: (n,) joint positions.
        row_unit: (6,) factors of the rows.
        column_unit: (6 + n,) factors of the columns.
        rows: The rows that count.
        chosen: The columns of each, as many: 0 to 5 directions of the tip's twist, 6 + j joint j.
    """
    scaled = row_unit[:, None] * columns(xp, tree, p, q) * column_unit
    return linear_algebra.minors(scaled[np.array(rows)], chosen)


def tip_from_centre(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute the tip (3,) from the system CM, of a fixed spacecraft from its own [m]."""
    at = kinematics.posture(xp, tree, p, q)
    own = at.r_cm - p.centres[0] if tree.mode == "fixed" else np.zeros(3)
    return at.tip_positions[0] + own


#: Least singular values up to this share of the norm of J are zero.
ZERO = 2.0**-48
#: Slopes below this share of the norm of J are rounding.
NOTHING = 1e-12
#: Share of the norm of J below which slopes are not equations either: null vectors of a tiny
#: sigma_min mix.
ROUNDED = 1e-9


#: More rows than this are taken together by NumPy.
AT_ONCE = 8


def distance(
    xp: Any, tree: Structure, p: Parameters, q: Any, fading: Any, radians: Any, left: Any = None,
    right: Any = None,
) -> tuple[Any, Any, Any]:  # fmt: skip
    """Compute the distance to the singular set and its normal space.

    Args:
        xp: The array library.
        tree: The structure of an arm with at least as many joints as the task has rows.
        p: Its numbers.
        q: (n,) joint positions.
        fading: Slopes below this times sigma_min are not equations [1/rad].
        radians: (n,) what counts as a radian of each joint.
        left: (k, k) what J* is multiplied by from the left; by nothing if None.
        right: (n, n) the same from the right.

    Returns:
        The distance [rad], inf where nothing leads to the set; sigma_min of J* per radian; (r, n)
        rows that span the normal space of the set, per radian, of which the first leads away.
    """
    at = kinematics.posture(xp, tree, p, q)
    J = kinematics.task_jacobian_at(xp, tree, at) * radians
    if left is not None:
        J = left @ J @ right
    norm = xp.sqrt((J * J).sum())
    least = linear_algebra.least_with_vectors(xp, J)
    u, ways = least.u, [least.v, *least.null]
    if left is not None:
        u, ways = u @ left, [right @ way for way in ways]
    force = u * tree.scale[:, 0] @ np.eye(6 * len(tree.tips))[list(tree.rows)]
    ways = [way * radians for way in ways]
    slopes = [slope * radians for slope in kinematics.slopes(xp, tree, at, force, ways)]
    return way_out(xp, slopes, norm, least.sigma, fading)


def nearest(
    xp: Any, tree: Structure, p: Parameters, *, q: Any, fading: Any, radians: Any, between: Any,
    rest: Any, most: int, begin: Any = None,
) -> Any:  # fmt: skip
    """Compute the distance to the singular set to first order, and the point nearest on it.

    That is the point nearest on the set linearised at itself, T(X) = X: a fixed point by
    secants, Anderson, J. ACM 12, 547 (1965), DOI 10.1145/321296.321305, of depth one.

    Args:
        xp: The array library.
        tree: As of `distance`.
        p: Its numbers.
        q: (n,) joint positions.
        fading: As of `distance`.
        radians: (n,) what counts as a radian of each joint.
        between: (2,) distances to first order between which the point is wanted [rad].
        rest: It is found where the last step is no longer than this [rad].
        most: Most steps.
        begin: (n,) offset in radians at which the steps begin; at q itself if None.

    Returns:
        (2 + n,) the distance, the length of the last step, and the offset X of the point from q in
        radians. Where the point is not wanted, the distance is that to first order, the length 0,
        and X that after one step.
    """

    def step(X: Any, before: Any, last: Any, turns: Any, far: Any, _: Any) -> Any:
        seen, _, rows = distance(xp, tree, p, q + radians * X, fading, radians)
        along = rows @ X - xp.where(seen < np.inf, seen, 0.0) * np.eye(len(rows))[0]
        there = along @ rows
        way = there - X
        turn = way - last
        square = (turn * turn).sum()
        known = xp.logical_and(turns > 0.0, square > 0.0)
        share = xp.where(known, (turn * way).sum() / xp.where(known, square, 1.0), 0.0)
        far = xp.where(turns > 0.0, far, seen)
        wanted = xp.logical_and(far > between[0], far < between[1])
        moved = xp.where(wanted, xp.sqrt((way * way).sum()), 0.0)
        goes = xp.logical_not(moved <= rest)
        return there - share * (there - before), there, way, turns + 1.0, far, moved, goes

    zero = 0.0 * q
    begun = (zero if begin is None else begin, zero, zero, zero[0], zero[0], zero[0])
    X, _, _, _, far, moved = xp.while_any(step, *begun, most=most)
    wanted = xp.logical_and(far > between[0], far < between[1])
    far = xp.where(wanted, xp.sqrt((X * X).sum()), far)
    return xp.concatenate([xp.stack([far, moved]), X])


def way_out(xp: Any, slopes: list[Any], norm: Any, sigma: Any, fading: Any) -> tuple[Any, Any, Any]:
    """Compute what `distance` returns, by Gram and Schmidt's method.

    Slopes of the null space are padded, so that those that the pads outweigh count less: the
    projection is that of ridge regression.

    Args:
        xp: The array library.
        slopes: (n,) each: the gradient of sigma, then those that a solution must not change.
        norm: Norm of J.
        sigma: Its least singular value.
        fading: As of `distance`.
    """
    others, n = len(slopes) - 1, len(slopes[0])
    size = norm * norm  # of a task of one row J vanishes on the set, its slopes do not
    for slope in slopes:
        size = size + (slope * slope).sum()
    pad = ROUNDED * xp.sqrt(size) + fading * sigma
    kept: list[Any] = []
    for r, slope in enumerate(slopes[1:]):
        row = _across(kept, xp.concatenate([slope, pad * np.eye(others)[r]]))
        kept.append(row * linear_algebra.reciprocal(xp, xp.sqrt((row * row).sum())))
    g = _across(kept, xp.concatenate([slopes[0], np.zeros(others)]) if others else slopes[0])
    full, way = xp.sqrt((g * g).sum()), xp.sqrt((g[:n] * g[:n]).sum())
    sound = full > NOTHING * norm
    away = g[:n] * xp.where(sound, 1.0 / xp.where(sound, way, 1.0), 0.0)
    far = xp.where(sound, sigma * way / xp.where(sound, full * full, 1.0), np.inf)
    far = xp.where(sigma > ZERO * norm, far, 0.0 * sigma)
    found = [away, *(_across([away], row[:n], 1) for row in kept)]
    return far, sigma, xp.stack(found)


def _across(rows: list[Any], x: Any, times: int = 2) -> Any:
    """Return the part of x normal to orthonormal rows; twice is enough.

    Of numbers, the parts along many rows are taken away at once.
    """
    at_once = len(rows) > AT_ONCE and isinstance(x, np.ndarray) and x.dtype == np.float64
    parts = [np.array(rows)] if at_once else rows
    for _ in range(times if rows else 0):
        for part in parts:
            x = x - (part @ x) @ part if at_once else x - (part @ x) * part
    return x
