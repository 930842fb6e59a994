"""Timing: when a motion from rest to rest passes its rows, within the velocity limits."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from spacearm.arrays import Array
from spacearm.model.arm import SpaceArm

UNLIMITED = 0.5
"""Rate of joints whose URDF gives no velocity limit [rad/s] or [m/s]."""
PEAK = 1.875
"""Largest rate of a motion from rest to rest along 10 u^3 - 15 u^4 + 6 u^5, over its mean."""
CORNER = 0.3
"""Rows between which the direction changes by more than this are a corner [rad]."""


def rest_to_rest_times(arm: SpaceArm, q: Array) -> Array:
    """Return the times (m,) at which a motion from rest to rest passes its rows (m, n) [s].

    The joint that is slowest for its velocity limit sets the pace of every segment. The joints come
    to rest at corners too.
    """
    along, pieces = _pieces(arm, q)
    t = np.zeros(len(q))
    for first, last in pieces:
        piece = along[first : last + 1] - along[first]
        t[first : last + 1] = t[first] + PEAK * piece[-1] * _eased(piece / max(piece[-1], 1e-12))
    return t


def rest_to_rest_rates(arm: SpaceArm, q: Array) -> tuple[Array, Array]:
    """Return the joint rates and accelerations (m, n) at these times, zero at rest."""
    along, pieces = _pieces(arm, q)
    dq, ddq = np.zeros_like(q), np.zeros_like(q)
    for first, last in pieces:
        rows, piece = slice(first, last + 1), along[first : last + 1] - along[first]
        u = _eased(piece / max(piece[-1], 1e-12))[:, None]
        speed = 30.0 * (u * (1.0 - u)) ** 2 / PEAK
        gain = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / (PEAK**2 * max(piece[-1], 1e-12))
        slope = np.gradient(q[rows], piece, axis=0)
        bend = np.gradient(slope, piece, axis=0)
        dq[rows], ddq[rows] = slope * speed, slope * gain + bend * speed**2
    return dq, ddq


def _pieces(arm: SpaceArm, q: Array) -> tuple[Array, list[tuple[int, int]]]:
    """Return the times (m,) at the largest rates [s], and first and last rows between corners."""
    joints = [arm.tree.joints[name] for name in list(arm.model.names)[2:]]  # those that mimic too
    velocity = np.array([joint.velocity for joint in joints])
    velocity = np.where(np.isfinite(velocity) & (velocity > 0.0), velocity, UNLIMITED)
    step = np.diff([arm.all_joints(row) for row in q], axis=0)
    pace = np.maximum((np.abs(step) / velocity).max(axis=1), 1e-12)
    along = np.append(0.0, np.cumsum(pace))
    way = step / np.maximum(np.linalg.norm(step, axis=1), 1e-300)[:, None]
    corner = np.linalg.norm(np.diff(way, axis=0), axis=1) > CORNER
    return along, list(pairwise((0, *(np.flatnonzero(corner) + 1), len(q) - 1)))


def _eased(share: Array) -> Array:
    """Return the times (m,), from 0 to 1, at which a motion from rest to rest has gone shares."""
    u = np.linspace(0.0, 1.0, 2001)
    return np.interp(share, u**3 * (10.0 - 15.0 * u + 6.0 * u * u), u)
