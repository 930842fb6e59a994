"""Descents to the singular set: stationary points of the distance from a configuration."""

from __future__ import annotations

import numpy as np

from spacearm.arrays import Array
from spacearm.mechanics.jacobian import task_jacobian, task_jacobian_derivative
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.model.scale import radians

STARTS = 24
"""Starts of descents: a configuration itself and points about it."""
SPREADS = (0.1, 2.0)
"""Their least and largest distance from it [rad]."""
STEPS = 50
STRIDE = 0.3
"""Longest step [rad]."""
STILL = 1e-9
"""The iteration has come to rest when a step is shorter than this [rad]."""
LOST = 1e-9
"""A configuration is singular if its least singular value is below this share of the largest one
met on the way."""


def descents(arm: SpaceArm, q: Array, mode: BaseMode) -> list[Array]:
    """Find singular configurations near q (n,): where descents from it and about it end."""
    rng, spread = np.random.default_rng(0), np.append(0.0, np.geomspace(*SPREADS, STARTS - 1))
    ways = spread[:, None] * rng.normal(size=(STARTS, arm.n)) / np.sqrt(arm.n)
    starts = [q + radians(arm) * way for way in ways]
    return [end for start in starts if (end := descend(arm, q, start, mode)) is not None]


def descend(arm: SpaceArm, q: Array, start: Array, mode: BaseMode) -> Array | None:
    """Find a singular configuration whose distance from q (n,) is stationary, or None.

    Each step goes to the point nearest to q of the set as it looks from here, to first order:
    x = A^+ (A x - b), the iteration of the first-order reliability method (Hasofer & Lind, 1974;
    Rackwitz & Fiessler, Comput. Struct. 9, 489-494, 1978), with A and b of `mechanics.nearness`.

    Args:
        arm: The arm.
        q: Where from the distance counts.
        start: (n,) where the iteration starts.
        mode: What the spacecraft does.
    """
    unit = radians(arm)
    x, most = (start - q) / unit, 0.0
    for _ in range(STEPS):
        here = arm.at(q + unit * x)
        U, sigma, VT = np.linalg.svd(task_jacobian(here, mode=mode) * unit)
        k, most = len(U), max(most, float(sigma[0]))
        dJ = task_jacobian_derivative(here, mode=mode) * unit
        A = np.einsum("a,jan,rn->rj", U[:, k - 1], dJ, VT[k - 1 :]) * unit
        b = np.zeros(len(A))
        b[0] = sigma[-1]
        step = np.linalg.lstsq(A, A @ x - b, rcond=1e-9)[0] - x
        length = float(np.linalg.norm(step))
        if length <= STILL and sigma[-1] <= LOST * most:
            return here.q.copy()
        x = x + step * min(1.0, STRIDE / max(length, STRIDE))
    return None
