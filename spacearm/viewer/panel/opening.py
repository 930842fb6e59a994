"""Opening: the posture that an arm is shown in when none is asked for."""

from __future__ import annotations

import math

import numpy as np

from spacearm.arrays import Array
from spacearm.model.arm import SpaceArm
from spacearm.singularities.report import singularity

REGULAR = math.radians(10.0)
"""Distance to the singular set from which on a posture is good to begin with [rad]."""
TRIES = 40
BENT = 1.0
"""Largest joint positions tried, from zero or the limit nearest to it [rad] or [m]."""


def opening_posture(arm: SpaceArm) -> Array:
    """Return joint positions (n,) well away from singularities, the same at every call.

    Zeros, or the limits nearest to them, where they are; else a posture bent by at most a radian,
    the first of `TRIES` that is far enough from the singular set, or the farthest of them.
    Joints at a limit are bent away from it, so that the tip can be pulled all around.

    Args:
        arm: The arm.
    """
    home = np.clip(np.zeros(arm.n), arm.lower, arm.upper)
    rng = np.random.default_rng(0)
    bends = np.where(arm.slides, 0.2, 1.0) * rng.uniform(-BENT, BENT, (TRIES, arm.n)).round(2)
    best, farthest = home, _distance(arm, home)
    for bend in bends:
        if farthest >= REGULAR:
            break
        there = home + bend
        inside = (arm.lower <= there) & (there <= arm.upper)  # else bent the other way
        q = np.clip(np.where(inside, there, home - bend), arm.lower, arm.upper)
        distance = _distance(arm, q)
        if distance > farthest:
            best, farthest = q, distance
    return best


def _distance(arm: SpaceArm, q: Array) -> float:
    """Return the distance to the singular set, 0 where it is singular by rounding alone."""
    report = singularity(arm.at(q))
    return report.distance if report.kind == "regular" else 0.0
