"""Shells of spatial arms, proven by a curve in the singular set.

At a stationary point of the tip's distance R from the system CM the linear rows of J* lose rank, so
that the outermost reachable distance, and an innermost one that is not zero, are singular. A tube
(see `connected`) about a curve in the singular set from a configuration with the least R to one
with the largest proves that every distance between is met by a singular configuration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import UnsupportedError
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.singularities.polynomial import minor_polynomials, radius_squared
from spacearm.workspaces.connected import Branch, Triangle, Tube, join

SAMPLE = 2048
"""Configurations of the set from which its ends are sought, for each choice of roots."""
BEST = 16
"""Number of them that are moved towards an end."""
ROUNDS = 100
"""Rounds of that search."""
TRIED = 12
"""Motions tried of each in a round."""
REGULAR = (0.3, 0.1, 0.03, 0.0)
"""Shares of the sample whose slopes an end of the curve may not be below, from the best on."""
CLOSE = 1e-4
"""Share of the arm's size within which an end of the curve may be from the extreme."""


class Passage(NamedTuple):
    """A connected piece of the singular set on which R takes all values of an interval.

    Attributes:
        curve: (m, n) singular configurations along it, to rounding.
        radius: (2,) the interval, proven [m].
    """

    curve: Array
    radius: Array


def triangle_of(arm: SpaceArm, mode: BaseMode) -> Triangle | None:
    """Return the equations of the singular set that give one joint each, or None.

    They are the minors with the columns 1 ... k - 1 and j of J*, j = k ... n: for the full pose of
    n >= 6 revolute joints minor j gives joint j - 1. A common root of theirs could be regular only
    where the first k - 1 columns are dependent; there the first minor is zero for all values of
    its joint, which no tube allows.
    """
    k, n = arm.task.k, arm.n
    first = tuple(range(k - 1))
    try:
        minors = minor_polynomials(arm, [(*first, j) for j in range(k - 1, n)], mode=mode)
    except UnsupportedError:
        return None
    given = list(range(k - 2, n - 1))
    for i, S in enumerate(minors):
        later = [S.degrees[j] for j in given[i + 1 :]]
        if not given or S.degrees[given[i]] != 1 or any(later):
            return None
    return Triangle(tuple(zip(minors, given, strict=True)))


def passage(
    arm: SpaceArm, mode: BaseMode, triangle: Triangle, rng: np.random.Generator
) -> Passage | None:
    """Find and prove the longest passage among the choices of roots, or return None."""
    R2 = radius_squared(arm, mode=mode)
    best: Passage | None = None
    ends = {branch: _ends(R2, triangle, branch, rng) for branch in triangle.branches()}
    widest = sorted(ends, key=lambda b: ends[b][2] - ends[b][3])
    for branch in widest:
        start, end, low, high = ends[branch]
        if not np.isfinite(low) or (best is not None and _covers(best.radius, low, high)):
            continue
        tube = join(triangle, start, end, branch, rng)
        if tube is None:
            continue
        radius = _proven(R2, triangle, tube)
        if best is None or np.ptp(radius) > np.ptp(best.radius):
            best = Passage(tube.points, radius)
    return best


def _covers(radius: Array, low: float, high: float) -> bool:
    """Check whether another passage can add little to a proven one."""
    slack = 1e-3 * high
    return bool(radius[0] <= low + slack and radius[1] >= high - slack)


def _ends(
    R2: TrigPolynomial, triangle: Triangle, branch: Branch, rng: np.random.Generator
) -> tuple[Array, Array, float, float]:
    """Find configurations of the set with the least and the largest R, regular ones if possible."""
    Q = np.zeros((SAMPLE, R2.n))
    matter = [j for j in range(R2.n) if j in triangle.free or R2.degrees[j]]
    Q[:, matter] = rng.uniform(-np.pi, np.pi, (SAMPLE, len(matter)))
    Q = triangle.solve(Q, branch)
    Q = Q[~np.isnan(Q).any(axis=1)]
    if len(Q) < 2:
        return np.zeros(R2.n), np.zeros(R2.n), np.inf, -np.inf
    moves = [j for j in matter if j not in triangle.given]
    floors = np.quantile(np.abs(triangle.slopes(Q)).min(axis=1), REGULAR)
    ends = []
    for sign in (1.0, -1.0):
        found = [_moved(R2, triangle, branch, Q, sign, moves, floor, rng) for floor in floors]
        values = np.array([sign * _distance(R2, q) for q in found])
        close = values <= values.min() + CLOSE * np.sqrt(R2.scale)
        ends.append(found[int(np.argmax(close))])
    low, high = ends
    return low, high, _distance(R2, low), _distance(R2, high)


def _moved(
    R2: TrigPolynomial,
    triangle: Triangle,
    branch: Branch,
    Q: Array,
    sign: float,
    moves: list[int],
    floor: float,
    rng: np.random.Generator,
) -> Array:
    """Move the best configurations towards less sign * R, where no slope is below the floor."""
    Q = Q[np.abs(triangle.slopes(Q)).min(axis=1) >= floor]
    Q = Q[np.argsort(sign * R2(Q))[:BEST]]
    value, width, rows = sign * R2(Q), np.full(len(Q), 0.3), np.arange(len(Q))
    for _ in range(ROUNDS):
        tried = Q.repeat(TRIED, axis=0)
        motion = rng.normal(size=(len(tried), len(moves)))
        tried[:, moves] += width.repeat(TRIED)[:, None] * motion
        tried = triangle.solve(tried, branch)
        there = np.flatnonzero(~np.isnan(tried).any(axis=1))
        there = there[np.abs(triangle.slopes(tried[there])).min(axis=1) >= floor]
        new = np.full(len(tried), np.inf)
        new[there] = sign * R2(tried[there])
        best = np.argmin(new.reshape(-1, TRIED), axis=1)
        new = new.reshape(-1, TRIED)[rows, best]
        better = new < value
        Q[better] = tried.reshape(len(Q), TRIED, -1)[better, best[better]]
        value = np.where(better, new, value)
        width = np.where(better, 1.5 * width, 0.85 * width)
    return Q[np.argmin(value)]


def _distance(R2: TrigPolynomial, q: Array) -> float:
    return float(np.sqrt(max(R2(q), 0.0)))


def _proven(R2: TrigPolynomial, triangle: Triangle, tube: Tube) -> Array:
    """Return the least and the largest R that singular configurations in the tube's ends prove."""
    low, high = (
        (float(R2(q)), _change(R2, triangle, q, half))
        for q, half in ((tube.points[0], tube.half[0]), (tube.points[-1], tube.half[-1]))
    )
    squares = np.array([low[0] + low[1], high[0] - high[1]])
    return np.sqrt(np.maximum(squares, 0.0))


def _change(R2: TrigPolynomial, triangle: Triangle, q: Array, half: Array) -> float:
    """Bound the change of R^2 from q within the box of these half widths about it."""
    gradient = np.abs(R2.gradient(q))[triangle.given]
    B = R2.curvature[np.ix_(triangle.given, triangle.given)]
    return float(gradient @ half + 0.5 * half @ B @ half + R2.noise(np.abs(q).max()))
