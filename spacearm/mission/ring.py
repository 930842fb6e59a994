"""The attitudes of a planar arm that let a path be followed: intervals of one angle."""

from __future__ import annotations

import numpy as np

from spacearm.arrays import Array, Progress
from spacearm.mission.survey import Outcome, Survey, joined

PARTS = 33
"""Each round looks at so many parts of the gap between an attitude inside and one outside."""
SHARP = 5e-7
"""Width of that gap at which its middle is an end [rad]."""
WAVE = 0.2
"""Angle over which postures are followed from one attitude to the next [rad]."""
EACH = 32
"""Attitudes that are added about a least or largest distance that seems to cross the margin."""


def turns(axis: int, angle: Array) -> Array:
    """Return the attitudes (m, 4) turned about an axis by angles (m,), quaternions xyzw."""
    quaternion = np.zeros((len(angle), 4))
    quaternion[:, axis], quaternion[:, 3] = np.sin(0.5 * angle), np.cos(0.5 * angle)
    return quaternion


def survey_ring(
    survey: Survey, axis: int, margin: float, samples: int, progress: Progress | None
) -> tuple[Outcome, Array, Array]:
    """Follow the path from attitudes all around, and find the ends of the feasible intervals.

    Args:
        survey: The path.
        axis: The normal of the arm's plane.
        margin: Least distance to the singular set [rad].
        samples: Number of attitudes, evenly spread.
        progress: Called as progress(done, samples).

    Returns:
        The outcomes by growing angle; the angles (m,) from -pi to pi; the intervals (k, 2).
    """
    gap = 2.0 * np.pi / samples
    angle = -np.pi + gap * (np.arange(samples) + 0.5)
    found = survey.at(turns(axis, angle), max(1.5 * gap, WAVE), progress)
    more = _suspects(found, margin, angle, gap)
    if len(more):
        nearest = np.round((more + np.pi) / gap - 0.5).astype(int) % samples
        found = joined((found, survey.near(turns(axis, more), found.q[nearest])))
        angle = np.concatenate((angle, more))
        order = np.argsort(angle)
        angle, found = angle[order], found.take(order)
    inside = found.feasible(margin)
    if inside.all() or not inside.any():
        whole = np.array([[-np.pi, np.pi]]) if inside.all() else np.zeros((0, 2))
        return found, angle, whole
    last = np.flatnonzero(inside & ~np.roll(inside, -1))  # intervals end behind these,
    first = np.flatnonzero(inside & ~np.roll(inside, 1))  # and begin before those
    within, into = (
        np.append(last, first),
        np.append(np.roll(angle, -1)[last], np.roll(angle, 1)[first]),
    )
    sense = np.repeat((1.0, -1.0), (len(last), len(first)))
    start = angle[within]
    width = sense * (into - start) % (2.0 * np.pi)
    ends = _ends(survey.finely(), axis, margin, start, sense * width, found.q[within])
    low, high = np.sort(_wrapped(ends[len(last) :])), ends[: len(last)]
    intervals = [(a, a + ((high - a) % (2.0 * np.pi)).min()) for a in low]
    return found, angle, np.array(intervals)


def _ends(survey: Survey, axis: int, margin: float, start: Array, width: Array, q: Array) -> Array:
    """Return the angles (e,) at which feasible attitudes end, between `start` and start + width."""
    shares = np.arange(-1, PARTS + 2) / PARTS  # one more at each side: the survey was coarser
    while len(width) and np.abs(width).max() > SHARP:
        at = start[:, None] + width[:, None] * shares
        seed = np.repeat(q, len(shares), axis=0)
        found = survey.near(turns(axis, at.ravel()), seed, near=True)
        ok = found.feasible(margin).reshape(at.shape)
        falls = ok[:, :-1] & ~ok[:, 1:]
        k = np.where(
            falls.any(axis=1), falls.argmax(axis=1), np.where(ok.all(axis=1), PARTS + 1, 0)
        )
        each = np.arange(len(start))
        start, width = at[each, k], width / PARTS
        q_new = found.q.reshape(*at.shape, -1)[each, k]
        q = np.where(np.isfinite(q_new), q_new, q)
    return start + 0.5 * width


def _suspects(found: Outcome, margin: float, angle: Array, gap: float) -> Array:
    """Return angles to be added where a parabola through three distances crosses the margin."""
    d = np.where(found.ended == 0, found.distance, np.nan)
    before, after = np.roll(d, 1), np.roll(d, -1)
    same = (before >= margin) == (d >= margin)
    same &= (after >= margin) == (d >= margin)
    curve, slope = before + after - 2.0 * d, 0.5 * (after - before)
    with np.errstate(invalid="ignore", divide="ignore"):
        vertex = d - 0.5 * slope * slope / curve
        crosses = same & (np.abs(slope) <= np.abs(curve)) & ((vertex >= margin) != (d >= margin))
    shares = (np.arange(EACH) + 0.5) / EACH * 2.0 - 1.0
    return _wrapped((angle[crosses][:, None] + gap * shares).ravel())


def _wrapped(angle: Array) -> Array:
    """Return angles between -pi and pi."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
