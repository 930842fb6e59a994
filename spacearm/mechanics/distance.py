"""How far in joint space the nearest singular configuration is, to first order.

J = U diag(sigma) V^T (k, n) has r ranks less where U_r^T J(q + dq) V_r = 0, with U_r and V_r the
columns of U and V from the r-th last singular value on. These are those of the r least singular
values, and of the null space. To first order this is a linear system for dq,

    U_r^T dJ[dq] V_r = -[diag(sigma_r) 0],

r equations for every column of V_r, and the least solution leads to the nearest configuration.

For r = 1 and a square J the equation is g . dq = -sigma_min, with g = u^T dJ v the gradient of
sigma_min, hence the distance is sigma_min / |g|. A redundant arm must also keep u^T dJ[dq] v_0 = 0
for every v_0 of the null space, because its singular set has codimension n - k + 1. About the set
sigma_min grows like a cone, and only the part of g that these equations leave counts. The distance
is sigma_min / |P g|, P the projection on their solutions; sigma_min / |g| would be too short.

Some arms lose rank where fewer equations hold: of one with spherical shoulder and wrist a straight
elbow suffices. There the slopes u^T dJ v_0 vanish as sigma_min does, and what is left of them is no
equation. So the projection is that of ridge regression: it leaves what slopes up to lambda, the
share `FADING` of sigma_min per radian, say.

This is one step of Newton's method. Where it is short, the set may be bent too much for it. So a
second step follows, from where the first has led to the point nearest to q on the set linearised
there (`project`). That is the iteration of the first-order reliability method, which measures the
distance to a failure set alike: Hasofer & Lind, J. Eng. Mech. 100, 111-121 (1974); Rackwitz &
Fiessler, Comput. Struct. 9, 489-494 (1978).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array, Integers
from spacearm.compiler import numbers
from spacearm.compiler.expressions import LongTapeError
from spacearm.equations.measures import NOTHING, ZERO, distance, way_out
from spacearm.mechanics.arm_kernels import KEPT_ARMS, WIDE, ArmKernel, worth_compiling
from spacearm.mechanics.jacobian import task_jacobian, task_jacobian_derivative
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.joints import joint_scales

#: More equations than joints have a solution if the residual is this share of the right side.
EXPLAINED = 0.1
#: Slopes that are less than this times sigma_min vanish with it, as a rule [1/rad].
FADING = 0.3
#: Distances below this take the second step: from half of this down all of it [rad].
NEAR = np.radians(4.0)
#: Distances up to this take none: there is nothing left to correct [rad].
FINE = 1e-5
#: Time that the derivative of J* takes without compiled code, for one configuration [s].
SINGLY = 1e-3
#: By how many joints of an arm that is not compiled this time is doubled; it grows as their square.
DOUBLED = 25.0
#: Postures whose J* are scaled to singular values of like size, and rounds of the scaling.
SAMPLES, ALTERNATIONS = 64, 6
#: Squared share of the norm of J* that is rounding.
ROUNDED = 1e-30
#: Condition of the scaling up to which J* is as good without it.
WELL_SCALED = 100.0
#: The second step counts only if the first one came this much nearer, less and less up to that.
CONTRACTING = 0.5


class Linearisation(NamedTuple):
    """The singular set linearised at m configurations, lengths in radians.

    Attributes:
        distance: (m,) how far it is; inf where it is nowhere.
        sigma: (m,) sigma_min of J per radian of each joint.
        rows: (m, r, n) rows that span its normal space, orthonormal but for those that fade where
            it has fewer dimensions; the first leads away from the set.
    """

    distance: Array
    sigma: Array
    rows: Array


class Scaling(NamedTuple):
    """Matrices that J* is multiplied by: L J* R loses rank where J* does.

    Attributes:
        left: (k, k) L.
        right: (n, n) R.
    """

    left: Array
    right: Array


#: Linearises the singular set at configurations (p, n), with some fading.
Lineariser = Callable[[Array, float], Linearisation]


class RankDistances(NamedTuple):
    """Distances to first order.

    Attributes:
        distances: (k,) entry j is the distance at which the singular values from j on vanish
            together. It grows from the last to the first. inf where no motion of the joints makes
            them vanish to first order; zero for those that a J with k > n never has.
        sigma: The least singular value.
        rows: (1 + |n - k|, n) rows as in `Linearisation`.
    """

    distances: Array
    sigma: float
    rows: Array


def rank_distances(
    J: Array, dJ: Array, floor: float = 0.0, fading: float = FADING, ranks: int | None = None
) -> RankDistances:
    """Compute how far the configurations are at which J loses one rank or several.

    Args:
        J: (k, n) the task Jacobian, per unit of distance of each joint.
        dJ: (n, k, n) its derivative, likewise per unit of each joint.
        floor: Singular values up to this are zero.
        fading: Slopes below this times sigma_min are not equations [1/rad].
        ranks: At most so many ranks that are lost together count; all of them if None. The
            distances of more are zero.
    """
    U, sigma, VT = np.linalg.svd(J)
    (k, n), p = J.shape, len(sigma)
    sigma = np.where(sigma > floor, sigma, 0.0)
    norm = float(np.linalg.norm(J))
    slopes = U.T @ dJ @ VT.T
    distances: Array = np.zeros(k)
    rows: Array = np.zeros((1 + abs(n - k), len(dJ)))
    for r in range(1, 1 + (p if ranks is None else min(ranks, p))):
        A = slopes[:, p - r :, p - r :].reshape(len(dJ), -1).T
        if r == 1 and k <= n:
            distances[-1], _, rows = way_out(numbers, [*A], norm, sigma[-1], fading)
        elif sigma[p - r] > 0.0:
            b = np.zeros((k - p + r, n - p + r))
            b[:r, :r] = np.diag(sigma[p - r :])
            distances[p - r] = _several(A, b.ravel(), NOTHING * norm)
    distances = np.maximum.accumulate(distances[::-1])[::-1]
    return RankDistances(distances, float(sigma[-1]), rows)


def rank_distances_of(
    arm: SpaceArm,
    J: Array,
    dJ: Array,
    error: float | None = None,
    fading: float = FADING,
    ranks: int | None = None,
) -> RankDistances:
    """Compute `rank_distances` of an arm in radians, as `joint_scales` counts its joints.

    Args:
        arm: The arm.
        J: (k, n) its task Jacobian.
        dJ: (n, k, n) the derivative of it with respect to each joint.
        error: Singular values of J up to this are zero; up to rounding if None.
        fading: As of `rank_distances`.
        ranks: As of `rank_distances`.

    Returns:
        The distances [rad], and `rows` per radian.
    """
    unit = joint_scales(arm)
    J = J * unit
    floor = ZERO * float(np.linalg.norm(J)) if error is None else error * float(unit.max())
    return rank_distances(J, dJ * unit * unit[:, None, None], floor, fading, ranks)


def project(seen: Linearisation, offset: Array) -> Array:
    """Project the origin on the set that is linearised at `offset` (m, n)."""
    along = (seen.rows @ offset[:, :, None])[..., 0]
    distance = np.where(np.isfinite(seen.distance), seen.distance, 0.0)  # inf has rows of zeros
    along[:, 0] -= distance
    return np.asarray((along[:, None] @ seen.rows)[:, 0])


def refined(
    arm: SpaceArm, q: Array, seen: Linearisation, linearise_at: Lineariser
) -> tuple[Array, Array]:
    """Take the second step where the first is short.

    Where it does not come nearer, slopes that seemed to vanish with sigma_min are equations.

    Args:
        arm: The arm.
        q: (m, n) configurations.
        seen: The set linearised there.
        linearise_at: Linearises it at other configurations (p, n), with some fading.

    Returns:
        (m,) distances [rad] and (m, n) ways out [rad] or [m] per radian of distance.
    """
    distance, away, stuck = _second(arm, q, seen, linearise_at, FADING)
    if stuck.size and arm.n > arm.task.k:
        again = linearise_at(q[stuck], 0.0)
        distance[stuck], away[stuck], _ = _second(arm, q[stuck], again, linearise_at, 0.0)
    return distance, joint_scales(arm) * away


def _second(
    arm: SpaceArm, q: Array, seen: Linearisation, linearise_at: Lineariser, fading: float
) -> tuple[Array, Array, Integers]:
    """Take the second step; also return the numbers of those that it does not bring nearer."""
    distance, away, unit = seen.distance.copy(), seen.rows[:, 0].copy(), joint_scales(arm)
    near = np.flatnonzero((distance > FINE) & (distance < NEAR))
    if not near.size:
        return distance, away, near
    first, way = distance[near, None], away[near]
    there = linearise_at(q[near] - unit * first * way, fading)
    offset = project(there, -first * way)
    second = np.linalg.norm(offset, axis=1, keepdims=True)
    nearer = _fading(there.distance[:, None] / first / CONTRACTING)
    share = _fading(first / NEAR) * nearer
    share, offset = np.where(second > 0.0, share, 0.0), np.where(second > 0.0, offset, 0.0)
    second = np.where(second > 0.0, second, first)
    mixed = (1.0 - share) * way - share * offset / second
    away[near] = mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
    distance[near] = (first + share * (second - first))[:, 0]
    return distance, away, near[nearer[:, 0] == 0.0]


def distance_at(cfg: Configuration, mode: BaseMode, axes: Array | None = None) -> float:
    """Compute the distance to the singular set, as `singularity` does [rad].

    Args:
        cfg: The configuration.
        mode: What the spacecraft does.
        axes: As in `task_jacobian`.
    """
    return refined_at(cfg, _near(cfg, mode, axes), mode, axes)[0]


def refined_at(
    cfg: Configuration, found: RankDistances, mode: BaseMode, axes: Array | None = None
) -> tuple[float, Array]:
    """Take the second step from one configuration: distance [rad] and way out (n,)."""

    def linearise_at(Q: Array, fading: float) -> Linearisation:
        return _stacked([_near(cfg.arm.at(q, base=cfg.base), mode, axes, fading) for q in Q])

    distance, away = refined(cfg.arm, cfg.q[None], _stacked([found]), linearise_at)
    return float(distance[0]), away[0]


def linearise_singly(
    arm: SpaceArm,
    Q: Array,
    mode: BaseMode,
    fading: float = FADING,
    scaling: Scaling | None = None,
) -> Linearisation:
    """Linearise the singular set at configurations Q (m, n), one by one."""
    return _stacked([_near(arm.at(q), mode, None, fading, scaling) for q in Q])


def _near(
    cfg: Configuration,
    mode: BaseMode,
    axes: Array | None,
    fading: float = FADING,
    scaling: Scaling | None = None,
) -> RankDistances:
    """Compute the rank_distances of one configuration."""
    J = task_jacobian(cfg, mode=mode, axes=axes)
    dJ = task_jacobian_derivative(cfg, mode=mode, axes=axes)
    if scaling is None:
        return rank_distances_of(cfg.arm, J, dJ, fading=fading, ranks=1)
    unit, (left, right) = joint_scales(cfg.arm), scaling
    J, dJ = left @ (J * unit) @ right, left @ (dJ * unit * unit[:, None, None]) @ right
    return rank_distances(J, dJ, ZERO * float(np.linalg.norm(J)), fading, 1)


def _stacked(found: list[RankDistances]) -> Linearisation:
    """Return the set linearised at several configurations."""
    return Linearisation(
        np.array([near.distances[-1] for near in found]),
        np.array([near.sigma for near in found]),
        np.array([near.rows for near in found]),
    )


def _fading(x: Array) -> Array:
    """Return 1 up to x = 1/2, 0 from x = 1 on, and a smooth step between."""
    t = np.clip(2.0 - 2.0 * x, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def _several(A: Array, b: Array, least: float) -> float:
    """Return the length of the least solution of A dq = b, inf if there is none."""
    U, size, VT = np.linalg.svd(A, full_matrices=False)
    U, size, VT = U[:, size > least], size[size > least], VT[size > least]
    if np.linalg.norm(b - U @ (U.T @ b)) > EXPLAINED * np.linalg.norm(b):
        return np.inf
    return float(np.linalg.norm((U.T @ b) / size))


def linearise(
    arm: SpaceArm,
    Q: Array,
    mode: BaseMode = "free-floating",
    fading: float = FADING,
    *,
    expected: int = 0,
    scaling: Scaling | None = None,
) -> Linearisation:
    """Linearise the singular set at configurations Q (m, n).

    Args:
        arm: The arm.
        Q: Joint positions.
        mode: What the spacecraft does.
        fading: As in `rank_distances`.
        expected: How many configurations it is computed for in all, if that is more.
        scaling: What J* is multiplied by; nothing if None. The set stays the same; the distance to
            it, to first order, changes.
    """
    many = max(len(Q), expected)
    if arm.n >= arm.task.k and worth_compiling(many, SINGLY):
        with suppress(LongTapeError):
            return _linearise_compiled(arm, Q, mode, fading, many, scaling)
    return linearise_singly(arm, Q, mode, fading, scaling)


def _linearise_compiled(
    arm: SpaceArm,
    Q: Array,
    mode: BaseMode,
    fading: float,
    many: int,
    scaling: Scaling | None = None,
) -> Linearisation:
    """Linearise the singular set by machine code.

    Raises:
        LongTapeError: The arm has so many joints that its equations are not compiled.
    """
    kernel = ArmKernel([arm], mode, distance, lanes=WIDE, rows=many)
    shared = {"fading": fading, "radians": joint_scales(arm)}
    if scaling is not None:
        shared |= {"left": scaling.left, "right": scaling.right}
    far, sigma, rows = kernel({"q": Q}, shared)
    on_it = far == 0.0
    if on_it.any():  # singular all around, it has no normal
        rows[on_it] = np.where(np.isnan(rows[on_it]), 0.0, rows[on_it])
    return Linearisation(far, sigma, rows)


@lru_cache(maxsize=KEPT_ARMS)
def scaling_of(arm: SpaceArm, mode: BaseMode) -> Scaling | None:
    """Return the scaling under which J* has singular values of like size, None if it is not needed.

    It is needed for arms with as many joints as task rows whose singular values of J* differ by
    orders of magnitude at all postures, as where several axes are parallel and the spacecraft is
    heavy. Where one of the larger ones vanishes, sigma_min, which is smaller on both sides, falls
    to zero only in a narrow valley.

    With X = L J* R, the means of X X^T and of X^T X over random postures become the identity:
    operator scaling by alternating normalisation, Gurvits, J. Comput. Syst. Sci. 69, 448-484
    (2004), DOI 10.1016/j.jcss.2004.06.003.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
    """
    k, n = arm.task.k, arm.n
    if k != n:
        return None
    unit, rng = joint_scales(arm), np.random.default_rng(0)
    Q = unit * rng.uniform(-np.pi, np.pi, (SAMPLES, n))
    J = np.array([task_jacobian(arm.at(q), mode=mode) for q in Q]) * unit
    rounding = ROUNDED * float((J * J).mean())
    if not rounding:
        return None
    left, right = np.eye(k), np.eye(n)
    for _ in range(ALTERNATIONS):
        X = left @ J @ right
        noise = rounding * (right * right).sum() * left @ left.T
        left = _inverse_root((X @ X.swapaxes(1, 2)).mean(axis=0) + noise) @ left
        X = left @ J @ right
        noise = rounding * (left * left).sum() * right.T @ right
        right = right @ _inverse_root((X.swapaxes(1, 2) @ X).mean(axis=0) + noise)
    spread = np.linalg.cond(left) * np.linalg.cond(right)
    return Scaling(left, right) if spread > WELL_SCALED else None


def _inverse_root(A: Array) -> Array:
    """Return A^(-1/2) of a symmetric positive definite matrix."""
    values, vectors = np.linalg.eigh(A)
    values = np.maximum(values, np.finfo(float).eps * values[-1])
    return np.asarray(vectors / np.sqrt(values) @ vectors.T)


def seconds_of_linearising(arm: SpaceArm, mode: BaseMode, many: int) -> float:
    """Return the CPU time of linearising the singular set once, about; zero if compiled [s].

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        many: As `expected` of `linearise`.
    """
    if arm.n >= arm.task.k:
        with suppress(LongTapeError):
            _linearise_compiled(arm, np.zeros((1, arm.n)), mode, FADING, many)
            return 0.0
    return SINGLY * (1.0 + (arm.n / DOUBLED) ** 2)


def distances(
    arm: SpaceArm, Q: Array, mode: BaseMode = "free-floating", many: int = 0
) -> tuple[Array, Array]:
    """Compute the distances (m,) from Q (m, n), and the ways out (m, n), with the second step.

    Args:
        arm: The arm.
        Q: Joint positions.
        mode: What the spacecraft does.
        many: How many there are, if Q is one block of them.
    """
    if arm.n < arm.task.k:  # singular everywhere
        return np.zeros(len(Q)), np.zeros(Q.shape)

    def linearise_at(there: Array, fading: float) -> Linearisation:
        return linearise(arm, there, mode, fading, expected=many or len(Q))

    return refined(arm, Q, linearise_at(Q, FADING), linearise_at)


#: A matrix has lost rank if its least singular value is below this share of the largest norm of it
#: met during the iteration.
LOST = 1e-10
#: sigma_min over sigma_max below which a root of the minors is a singular configuration.
AT_A_ROOT = 1e-8
#: Largest number of Gauss-Newton steps.
RANK_STEPS = 60
#: Longest step [rad, m].
RANK_STRIDE = 0.3
#: Distance to a singular configuration, to first order, from which each is searched alone [rad].
NEAR_ENOUGH = 1e-6


def lose_rank(
    arm: SpaceArm, q: Array, mode: BaseMode, columns: tuple[int, ...] | None = None
) -> Array | None:
    """Find a configuration near q (n,) at which J* loses rank, or None.

    Args:
        arm: The arm.
        q: (n,) start.
        mode: What the spacecraft does.
        columns: The columns of J* that count; all if None.
    """
    if columns == ():
        return None
    chosen = slice(None) if columns is None else list(columns)
    most, found, before = 0.0, False, q
    for _ in range(RANK_STEPS):
        cfg = arm.at(q)
        J = task_jacobian(cfg, mode=mode)[:, chosen]
        dJ = task_jacobian_derivative(cfg, mode=mode)[:, :, chosen]
        wide = J.shape[1] >= len(J)
        near = rank_distances(J, dJ) if wide else rank_distances(J.T, dJ.swapaxes(1, 2))
        most = max(most, float(np.linalg.norm(J)))
        if found:  # a step further, to all digits
            return q if near.sigma <= LOST * most else before
        if np.isinf(near.distances[-1]):
            return None
        found, before = near.sigma <= LOST * most, q
        q = q - min(float(near.distances[-1]), RANK_STRIDE) * near.rows[0]
    return None


def led_near(arm: SpaceArm, Q: Array, mode: BaseMode, expected: int) -> Array:
    """Lead configurations Q (m, n) near to singular ones, many at a time, where that is faster.

    Args:
        arm: The arm.
        Q: Starts.
        mode: What the spacecraft does.
        expected: How many starts are led in all.
    """
    steps = expected * RANK_STEPS
    if arm.n < arm.task.k or not worth_compiling(steps, SINGLY):
        return Q
    Q, going = Q.copy(), np.arange(len(Q))
    for _ in range(RANK_STEPS):
        seen = linearise(arm, Q[going], mode, expected=steps)
        far = np.isfinite(seen.distance) & (seen.distance > NEAR_ENOUGH)
        going = going[far]
        if not len(going):
            break
        stride = np.minimum(seen.distance[far], RANK_STRIDE)[:, None]
        Q[going] -= stride * seen.rows[far, 0] * joint_scales(arm)
    return Q


def is_singular(
    arm: SpaceArm, q: Array, mode: BaseMode, columns: tuple[int, ...] | None = None
) -> bool:
    """Check whether J*, or some of its columns, have lost rank at a root of the minors q (n,).

    Args:
        arm: The arm.
        q: (n,) a root of minors, accurate to some ten digits as a rule.
        mode: What the spacecraft does.
        columns: The columns of J* that count; all if None.
    """
    if columns == ():  # of a task of one row: no columns are never dependent
        return False
    J = task_jacobian(arm.at(q), mode=mode)
    sigma = np.linalg.svd(J if columns is None else J[:, list(columns)], compute_uv=False)
    return bool(sigma[-1] <= AT_A_ROOT * sigma[0])
