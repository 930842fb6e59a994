"""How far in joint space the nearest singular configuration is, to first order.

J = U diag(sigma) V^T (k, n) has r ranks less where U_r^T J(q + dq) V_r = 0, with U_r and V_r the
columns of U and V from the r-th last singular value on: those of the r least singular values, and
of the null space. To first order this is a linear system for dq,

    U_r^T dJ[dq] V_r = -[diag(sigma_r) 0],

r equations for every column of V_r, and the least solution leads to the nearest configuration.

For r = 1 and a square J the equation is g . dq = -sigma_min, with g = u^T dJ v the gradient of
sigma_min, hence the distance is sigma_min / |g|. A redundant arm must also keep u^T dJ[dq] v_0 = 0
for every v_0 of the null space, because its singular set has codimension n - k + 1: sigma_min grows
about it like a cone, and only the part of g that these equations leave counts. The distance is
sigma_min / |P g|, P the projection on their solutions; sigma_min / |g| would be too short.

This is one step of Newton's method; compare the first-order reliability method (Hasofer & Lind,
J. Eng. Mech. 100, 111-121, 1974), which measures the distance to a failure set alike.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array
from spacearm.mechanics.jacobian import task_jacobian, task_jacobian_derivative
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.model.mode import BaseMode
from spacearm.model.scale import radians

ZERO = 2.0**-48
"""Least singular values up to this share of the norm of J are zero, as in `kernels.nearness`."""
NOTHING = 1e-12
"""Slopes below this share of the norm of J are rounding."""
EXPLAINED = 0.1
"""More equations than joints have a solution if the residual is this share of the right side."""


class Nearness(NamedTuple):
    """Distances to first order.

    Attributes:
        distances: (k,) entry j is the distance at which the singular values from j on vanish
            together; growing from the last to the first. inf where no motion of the joints makes
            them vanish to first order; zero for those that a J with k > n never has.
        away: (n,) unit vector that leads away from the nearest singular configuration on the
            shortest way; zeros where there is none.
    """

    distances: Array
    away: Array


def nearness(J: Array, dJ: Array, floor: float = 0.0) -> Nearness:
    """Compute how far the configurations are at which J loses one rank or several.

    Args:
        J: (k, n) the task Jacobian, per unit of distance of each joint.
        dJ: (n, k, n) its derivative, likewise per unit of each joint.
        floor: Singular values up to this are zero.
    """
    U, sigma, VT = np.linalg.svd(J)
    (k, n), p = J.shape, len(sigma)
    sigma = np.where(sigma > floor, sigma, 0.0)
    least = NOTHING * float(np.linalg.norm(J))
    slopes = np.einsum("ai,jan,rn->jir", U, dJ, VT)
    distances: Array = np.zeros(k)
    away: Array = np.zeros(n)
    for r in range(1, p + 1):
        A = slopes[:, p - r :, p - r :].reshape(n, -1).T
        if r == 1 and k <= n:
            distances[-1], away = _one(A, float(sigma[-1]), least)
        elif sigma[p - r] > 0.0:
            b = np.zeros((k - p + r, n - p + r))
            b[:r, :r] = np.diag(sigma[p - r :])
            distances[p - r] = _several(A, b.ravel(), least)
    return Nearness(np.maximum.accumulate(distances[::-1])[::-1], away)


def nearness_of(arm: SpaceArm, J: Array, dJ: Array, error: float | None = None) -> Nearness:
    """Compute `nearness` of an arm in radians, as `radians` counts its joints.

    Args:
        arm: The arm.
        J: (k, n) its task Jacobian.
        dJ: (n, k, n) the derivative of it with respect to each joint.
        error: Singular values of J up to this are zero; up to rounding if None.

    Returns:
        The distances [rad]; `away` (n,) in [rad] or [m] per radian of distance.
    """
    unit = radians(arm)
    J = J * unit
    floor = ZERO * float(np.linalg.norm(J)) if error is None else error * float(unit.max())
    found = nearness(J, dJ * unit * unit[:, None, None], floor)
    return found._replace(away=unit * found.away)


def distance_at(cfg: Configuration, mode: BaseMode, axes: Array | None = None) -> float:
    """Compute the distance to the singular set to first order [rad].

    Args:
        cfg: The configuration.
        mode: What the spacecraft does.
        axes: As in `task_jacobian`.
    """
    J = task_jacobian(cfg, mode=mode, axes=axes)
    dJ = task_jacobian_derivative(cfg, mode=mode, axes=axes)
    return float(nearness_of(cfg.arm, J, dJ).distances[-1])


def _one(A: Array, sigma: float, least: float) -> tuple[float, Array]:
    """Return the distance at which sigma vanishes, and the unit direction in which it grows.

    Args:
        A: (1 + n - k, n) slopes: the gradient first, then those that a solution must not change.
        sigma: The singular value.
        least: Slopes up to this are rounding.
    """
    _, size, kept = np.linalg.svd(A[1:], full_matrices=False)
    kept = kept[size > least]
    g = A[0] - kept.T @ (kept @ A[0])
    slope = float(np.linalg.norm(g))
    if slope <= least:
        return (np.inf if sigma > 0.0 else 0.0), np.zeros(A.shape[1])
    return sigma / slope, g / slope


def _several(A: Array, b: Array, least: float) -> float:
    """Return the length of the least solution of A dq = b, inf if there is none."""
    U, size, VT = np.linalg.svd(A, full_matrices=False)
    U, size, VT = U[:, size > least], size[size > least], VT[size > least]
    if np.linalg.norm(b - U @ (U.T @ b)) > EXPLAINED * np.linalg.norm(b):
        return np.inf
    return float(np.linalg.norm((U.T @ b) / size))
