"""Loss of rank found by the Gauss-Newton method, with the steps of `mechanics.nearness`.

From one start; a search over many starts may miss singular configurations. `closest` has that for
the nearest one.
"""

from __future__ import annotations

import numpy as np

from spacearm.arrays import Array
from spacearm.mechanics.jacobian import task_jacobian, task_jacobian_derivative
from spacearm.mechanics.nearness import nearness
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_scales
from spacearm.singularities.closest import Search, looking

LOST = 1e-10
"""A matrix has lost rank if its least singular value is below this share of the largest norm of it
met during the iteration."""
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
        J = task_jacobian(cfg, mode=mode)[:, chosen]
        dJ = task_jacobian_derivative(cfg, mode=mode)[:, :, chosen]
        wide = J.shape[1] >= len(J)
        near = nearness(J, dJ) if wide else nearness(J.T, dJ.swapaxes(1, 2))
        most = max(most, float(np.linalg.norm(J)))
        if found:  # a step further, to all digits
            return q if near.sigma <= LOST * most else before
        if np.isinf(near.distances[-1]):
            return None
        found, before = near.sigma <= LOST * most, q
        q = q - min(float(near.distances[-1]), STRIDE) * near.away
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


def nearest_about(arm: SpaceArm, mode: BaseMode, q: Array) -> tuple[Array, float] | None:
    """Return the singular configuration (n,) nearest to q (n,) that lies about, and its distance.

    Where the set is near, its foot to first order lies by its nearest point. Then the last part of
    `closest.Search` is enough, which moves one point along the set until it rests. The distance is
    in radians, sliding joints in units of `joint_scales`; None if none lies about.
    """
    search = Search(looking(arm, mode, q), np.full(arm.n, -np.inf), np.full(arm.n, np.inf))
    offset = search.settled(np.zeros((1, arm.n)))
    if offset is None:
        return None
    return q + joint_scales(arm) * offset, float(np.linalg.norm(offset))
