"""Loads: the angular momentum of an arm that moves under a held attitude, at every instant.

The joints move along quintic splines through the rows of a plan. Momentum and torque are computed
at the rows and at times between; between two times h apart a quantity differs from the straight
line through its values by at most h^2 / 8 times the bound on its second derivative.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.interpolate import PPoly

from spacearm.arrays import Array
from spacearm.model.arm import SpaceArm
from spacearm.planning.reactions.majorants import momentum_bounds
from spacearm.planning.timing import course

DERIVATIVES = 4
"""Of the joint positions that the bounds take."""
DIVIDED = (1, 2, 4, 8, 16)
"""Parts of the time between two rows, tried in order."""
MARGIN = 0.01
"""Share of the largest momentum and torque up to which they may be larger between the times."""


class Load(NamedTuple):
    """Momentum of the arm about the system CM and its derivative, spacecraft axes.

    Attributes:
        t: (p,) times [s].
        momentum: (p, 3) D_q dq [N m s].
        torque: (p, 3) its derivative [N m].
        beyond: (2,) how far momentum [N m s] and torque [N m] may be from the straight line between
            two times, as lengths.
    """

    t: Array
    momentum: Array
    torque: Array
    beyond: Array


def load_of(arm: SpaceArm, t: Array, q: Array) -> Load:
    """Return the load of a motion from rest to rest, at as many times as `MARGIN` takes.

    Args:
        arm: The arm.
        t: (m,) times of the rows [s].
        q: (m, n) joint positions.
    """
    way = course(t, q)
    largest = [np.linalg.norm(x, axis=1).max() for x in _loads_at(arm, way, t)]
    for parts in DIVIDED:
        at, beyond = _divided(arm, way, t, parts)
        if (beyond <= MARGIN * np.array(largest)).all():
            break
    return Load(at, *_loads_at(arm, way, at), beyond)


def momentum_and_torque(arm: SpaceArm, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array]:
    """Return D_q dq (p, 3) and its derivative, the attitude held, spacecraft axes.

    Args:
        arm: The arm.
        q: (p, n) joint positions [rad] or [m].
        dq: (p, n) rates.
        ddq: (p, n) accelerations.
    """
    model, data, full = arm.model, arm.borrow(), pin.neutral(arm.model)
    C = np.eye(arm.n) if arm.coupling is None else arm.coupling
    v, a = np.zeros((2, len(q), model.nv))
    v[:, 6:], a[:, 6:] = dq @ C.T, ddq @ C.T
    momentum, torque = np.empty((2, len(q), 3))
    for i, row in enumerate(q):
        full[7:] = arm.all_joints(row)
        pin.computeCentroidalMomentumTimeVariation(model, data, full, v[i], a[i])
        momentum[i], torque[i] = data.hg.angular, data.dhg.angular
    arm.give_back(data)
    return momentum, torque


def _loads_at(arm: SpaceArm, way: PPoly, t: Array) -> tuple[Array, Array]:
    """Return momentum and torque (p, 3) at times t (p,) of a motion."""
    return momentum_and_torque(arm, way(t), way(t, 1), way(t, 2))


def _divided(arm: SpaceArm, way: PPoly, t: Array, parts: int) -> tuple[Array, Array]:
    """Divide the times between the rows' times t (m,); return all, and `Load.beyond` for them."""
    width = np.diff(t) / parts
    begin = (t[:-1, None] + np.arange(parts) * width[:, None]).ravel()
    h = np.repeat(width, parts)
    derivatives = [np.abs(way(begin, order)) for order in range(6)]
    joints = [
        sum(derivatives[k + i] * h[:, None] ** i / math.factorial(i) for i in range(6 - k))
        for k in range(DERIVATIVES + 1)
    ]
    bounds = momentum_bounds(arm, np.swapaxes(np.array(joints), 1, 2))
    return np.append(begin, t[-1]), (h**2 / 8.0 * bounds[2:]).max(axis=1)
