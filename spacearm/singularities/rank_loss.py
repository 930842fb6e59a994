"""Loss of rank found by the Gauss-Newton method.

A matrix of k rows and n columns loses rank where |n - k| + 1 equations hold, U^T J(q) V = 0, with
u, v the singular vectors of the least singular value and those of the null space beside them. They
are solved from one start; a search over many starts may miss singular configurations.
"""

from __future__ import annotations

import numpy as np

from spacearm.arrays import Array
from spacearm.mechanics.jacobian import task_jacobian, task_jacobian_derivative
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.polynomial.newton import shortened

LOST = 1e-10
"""A matrix has lost rank if its least singular value is below this share of the largest one met
during the iteration."""
AT_A_ROOT = 1e-8
"""sigma_min over sigma_max below which a root of the minors is a singular configuration."""
STEPS = 60
"""Largest number of Gauss-Newton steps."""
STRIDE = 0.3
"""Longest step [rad, m]."""


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
    for _ in range(STEPS):
        cfg = arm.at(q)
        U, sigma, VT = np.linalg.svd(task_jacobian(cfg, mode=mode)[:, chosen])
        r = len(sigma)
        most = max(most, sigma[0])
        if found:  # a step further, to all digits
            return q if sigma[-1] <= LOST * most else before
        found, before = bool(sigma[-1] <= LOST * most), q
        left, right = U[:, r - 1 :], VT[r - 1 :].T
        slopes = task_jacobian_derivative(cfg, mode=mode)[:, :, chosen]
        slope = np.einsum("al,jan,nr->lrj", left, slopes, right).reshape(-1, arm.n)
        residual = np.zeros(len(slope))
        residual[0] = sigma[-1]
        q = q + shortened(-np.linalg.lstsq(slope, residual, rcond=1e-9)[0], STRIDE)
    return None


def is_singular(
    arm: SpaceArm,
    q: Array,
    mode: BaseMode,
    columns: tuple[int, ...] | None = None,
    *,
    tolerance: float = AT_A_ROOT,
) -> bool:
    """Check whether J*, or some of its columns, have lost rank at a root of the minors q (n,).

    Args:
        arm: The arm.
        q: (n,) a root of minors, accurate to some ten digits as a rule.
        mode: What the spacecraft does.
        columns: The columns of J* that count; all if None.
        tolerance: Share of the largest singular value below which the least one counts as zero.
    """
    if columns == ():  # of a task of one row: no columns are never dependent
        return False
    J = task_jacobian(arm.at(q), mode=mode)
    sigma = np.linalg.svd(J if columns is None else J[:, list(columns)], compute_uv=False)
    return bool(sigma[-1] <= tolerance * sigma[0])


def independent_columns(arm: SpaceArm, q: Array, mode: BaseMode) -> tuple[int, ...]:
    """Return k - 1 columns of J* (k rows) that are as independent as can be at q (n,)."""
    from scipy.linalg import qr  # slow to import

    J = task_jacobian(arm.at(q), mode=mode)
    pivots = qr(J, mode="r", pivoting=True)[1]
    return tuple(sorted(int(j) for j in pivots[: len(J) - 1]))
