"""Timing: when a motion from rest to rest passes its rows, within the velocity limits."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, BSpline, PPoly, make_interp_spline
from scipy.special import betaincinv

from spacearm.arrays import SMALLEST, Array, ArrayLike, Integers, finite
from spacearm.errors import ConfigurationError
from spacearm.model.arm import SpaceArm
from spacearm.signatures import shown

#: Rate of joints whose URDF gives no velocity limit [rad/s] or [m/s].
UNLIMITED = 0.5
#: Largest rate of a motion from rest to rest along 10 u^3 - 15 u^4 + 6 u^5, over its mean.
PEAK = 1.875
#: Parts of each piece of a spline on which its rates are bounded.
RATE_PARTS = 4
#: Rows between which the direction changes by more than this are a corner [rad].
CORNER = 0.3


def rest_to_rest_times(q: Array, rates: Array) -> Array:
    """Return the times (m,) at which a motion from rest to rest passes its rows (m, n) [s].

    The joint that is slowest for its velocity limit sets the pace of every segment. The joints come
    to rest at corners too. The times are stretched until the spline through the rows, which is what
    is followed, keeps the rates everywhere.

    Args:
        q: (m, n) joint positions, the rows.
        rates: (n,) largest joint rates [rad/s] or [m/s].
    """
    step = np.diff(q, axis=0)
    pace = np.maximum((np.abs(step) / rates).max(axis=1), 1e-12)
    along = np.append(0.0, np.cumsum(pace))
    t = np.zeros(len(q))
    for first, last in pairwise(corners(step)):
        piece = along[first : last + 1] - along[first]
        u = betaincinv(3.0, 3.0, piece / max(piece[-1], 1e-12))  # the inverse of `eased`
        t[first : last + 1] = t[first] + PEAK * piece[-1] * u
    if t[-1] == 0.0:
        return t
    still = np.zeros(q.shape[1])
    return t * max(1.0, (rate_bounds(flown_spline(t, q, still)) / rates).max())


def rate_bounds(spline: PPoly) -> Array:
    """Return upper bounds (n,) of the rates along a spline [rad/s] or [m/s].

    They are the largest Bernstein coefficients of the derivative on parts of its pieces, in whose
    convex hull it lies.
    """
    ends = spline.x
    parts = np.arange(RATE_PARTS) / RATE_PARTS
    knots = np.append((ends[:-1, None] + np.diff(ends)[:, None] * parts).ravel(), ends[-1])
    degree = len(spline.c) - 1
    slopes = [spline(knots[:-1], i + 1) / math.factorial(i) for i in reversed(range(degree))]
    rates = BPoly.from_power_basis(PPoly(np.array(slopes), knots)).c
    return np.asarray(np.abs(rates).max(axis=(0, 1)))


def flown_spline(t: Array, q: Array, final_rates: Array, rests: Integers | None = None) -> PPoly:
    """Return joint positions (n,) over time: quintic splines through rows, at rest at corners.

    Their rates and accelerations vanish at corners and at both ends, as those of the motions do
    whose rows have these times; but for the rates at the end.

    Args:
        t: (m,) times of the rows [s].
        q: (m, ..., n) joint positions, of one motion or of several with the same corners.
        final_rates: (n,) rates at the end [rad/s] or [m/s].
        rests: The corners; those of q if None.
    """
    pieces = []
    for first, last in pairwise(corners(np.diff(q, axis=0)) if rests is None else rests):
        rows, ends = slice(first, last + 1), last == len(q) - 1
        spline = smooth(t[rows], q[rows], final_rates if ends else 0.0 * final_rates)
        pieces.append(_polynomials(spline, t[rows]))
    return PPoly(np.concatenate(pieces, axis=1), t)


def smooth(t: Array, values: Array, last: Array | float = 0.0) -> BSpline:
    """Return the quintic spline through values (m, ...) from rest to a rate at the end."""
    still = np.zeros(values.shape[1:])
    ends: Any = ([(1, still), (2, still)], [(1, still + last), (2, still)])  # stubs know no vectors
    return make_interp_spline(t, values, k=5, bc_type=ends)


def _polynomials(spline: BSpline, t: Array) -> Array:
    """Return the coefficients (6, m - 1, ...) of a quintic spline between its knots t (m,)."""
    slopes = [spline(t[:-1], order) / math.factorial(order) for order in range(5, -1, -1)]
    return np.array(slopes)


def largest_rates(arm: SpaceArm) -> Array:
    """Return the largest rates (n,) of the joints and of those that follow them by mimic."""
    joints = [arm.tree.joints[name] for name in list(arm.model.names)[2:]]
    velocity = np.array([joint.velocity for joint in joints])
    velocity = np.where(np.isfinite(velocity) & (velocity > 0.0), velocity, UNLIMITED)
    coupling = np.eye(arm.n) if arm.coupling is None else np.abs(arm.coupling)
    with np.errstate(divide="ignore"):
        return (velocity[:, None] / coupling).min(axis=0)


def for_each_joint(arm: SpaceArm, given: ArrayLike | None, name: str, default: Array) -> Array:
    """Return a limit for each joint (n,), the default where none is given.

    Raises:
        ConfigurationError: It is not a positive number, nor one per joint.
    """
    if given is None:
        return default
    shape = (arm.n,) if np.iterable(given) else ()
    bounds = finite(given, shape, name, "(the largest one, for all joints or for each)")
    if not (bounds >= SMALLEST).all():
        raise ConfigurationError(f"{name} is {shown(given)}; give numbers from {SMALLEST:g} on")
    return np.broadcast_to(bounds, arm.n)


def corners(step: Array) -> Integers:
    """Return the rows at which a motion turns sharply, the first and the last one too.

    Args:
        step: (m - 1, n) joint motion from row to row.
    """
    way = step / np.maximum(np.linalg.norm(step, axis=1), 1e-300)[:, None]
    corner = np.linalg.norm(np.diff(way, axis=0), axis=1) > CORNER
    return np.array([0, *(np.flatnonzero(corner) + 1), len(step)])


def eased(u: Array) -> Array:
    """Return the shares (m,) of a way from rest to rest behind at shares of its time."""
    return u**3 * (10.0 - 15.0 * u + 6.0 * u * u)


def swing(u: Array) -> Array:
    """Return a way (m,) there and back that ends with the rate 1, at shares of its time.

    It begins at rest, goes back by 0.19, and ends without acceleration.
    """
    return u**3 * (-4.0 + 7.0 * u - 3.0 * u * u)
