"""Smooth joint paths through the rows of a motion, and rows that end where the motion ends."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline

from spacearm.arrays import Array
from spacearm.mechanics.floating import attitudes
from spacearm.motion.motion import Motion
from spacearm.planning.timing import corners

SHAPES = 3
"""Number of waves 1 - cos(2 pi k u) by which rows are bent."""
BENT = 1e-5
"""Height of a wave by which the turn of the spacecraft is differentiated [rad]."""
TURNED = 1e-10
"""Error of the last attitude that is left [rad]."""
STEPS = 8
"""Newton steps until then."""


def smooth_pieces(q: Array, divided: int) -> list[CubicSpline]:
    """Return twice differentiable curves (n,) through joint positions, from corner to corner.

    The parameter of each begins at 0 and grows with the length of the straight lines between its
    knots.

    Args:
        q: (m, n) joint positions.
        divided: Knots in each straight line between rows: the more, the nearer the curves are to
            these lines, and the sharper they bend.
    """
    rows = q[np.append(True, np.abs(np.diff(q, axis=0)).max(axis=1) > 0.0)]
    share = np.arange(divided * (len(rows) - 1) + 1) / divided
    knots = np.column_stack([np.interp(share, np.arange(len(rows)), x) for x in rows.T])
    pieces = pairwise(corners(np.diff(knots, axis=0)))
    return [_curve(knots[first : last + 1]) for first, last in pieces]


def _curve(knots: Array) -> CubicSpline:
    """Return a cubic spline through knots (m, n)."""
    length = np.linalg.norm(np.diff(knots, axis=0), axis=1)
    return CubicSpline(np.append(0.0, np.cumsum(length)), knots)


def bent(motion: Motion, q: Array) -> Array:
    """Return rows bent a little so that a floating spacecraft ends with the attitude it had.

    A curve through the rows of a motion turns the spacecraft by a little more or less than the
    straight lines between them. Smooth waves, zero at both ends, make up for it, so that the
    tip, too, ends where it did.

    Args:
        motion: The motion, at zero momentum.
        q: (m, n) rows along a path near its own, with the same ends.
    """
    u = np.linspace(0.0, 2.0 * np.pi, len(q))[:, None, None]
    waves = (1.0 - np.cos(u * np.arange(1, SHAPES + 1))) * np.ones((motion.arm.n, 1))
    height = np.zeros((motion.arm.n, SHAPES))
    last = pin.Quaternion(np.array(motion.base[-1, 3:])).normalized().matrix()

    def rows(height: Array) -> Array:
        return q + (waves * height).sum(axis=2)

    def left(height: Array) -> Array:
        return pin.log3(attitudes(motion[0], rows(height))[-1].T @ last)

    miss = left(height)
    if np.linalg.norm(miss) > TURNED:
        each = BENT * np.eye(height.size).reshape(-1, *height.shape)
        slope = np.column_stack([(left(height + one) - miss) / BENT for one in each])
        for _ in range(STEPS):
            height = height - np.linalg.lstsq(slope, miss)[0].reshape(height.shape)
            miss = left(height)
            if np.linalg.norm(miss) <= TURNED:
                break
    return rows(height)
