"""The attitudes of a spatial arm that let a path be followed: a set of rotations, in cells."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array, Progress
from spacearm.mission.rotations import (
    Cells,
    Neighbours,
    attitudes,
    cells,
    children,
    spacing,
    sphere,
)
from spacearm.mission.survey import Flags, Outcome, Survey, joined

REACH = 1.5
"""Cells are neighbours up to so many spacings apart."""
AXES, ROUNDS, PARTS = 400, 4, 8
"""Axes about which the largest ball is probed, and how often each, in so many parts."""


def survey_sphere(
    survey: Survey, margin: float, level: int, refine: int, progress: Progress | None
) -> tuple[Outcome, Cells, Cells]:
    """Follow the path from attitudes all over the rotations, more of them at the border.

    Args:
        survey: The path.
        margin: Least distance to the singular set [rad].
        level: Of the cells, 12 4^level directions times 6 2^level rolls.
        refine: How many times cells at the border are divided into eight.
        progress: Called as progress(done, attitudes).

    Returns:
        The outcomes in the middles of all cells; the cells (m, 2); their levels (m,).
    """
    of = cells(level)
    found = survey.at(attitudes(of, level), REACH * spacing(len(of)), progress)
    levels = np.full(len(of), level)
    for finer in range(level + 1, level + refine + 1):
        border = (levels == finer - 1) & at_border(found, levels, margin)
        if not border.any():
            break
        inner = children(of[border])
        middles = attitudes(inner, finer)
        known = np.flatnonzero(np.isfinite(found.q[:, 0]))
        nearest, _ = Neighbours(found.attitude[known]).nearest(middles)
        more = survey.near(middles, found.q[known[nearest]])
        found = joined((found.take(~border), more))
        of = np.concatenate((of[~border], inner))
        levels = np.concatenate((levels[~border], np.full(len(inner), finer)))
    return found, of, levels


def volume(levels: Cells) -> Array:
    """Return the share (m,) of all rotations in each cell."""
    return 1.0 / (72.0 * 8.0**levels)


def at_border(found: Outcome, levels: Cells, margin: float) -> Flags:
    """Return (m,) which cells have a neighbour that is feasible where they are not, or is not."""
    inside = found.feasible(margin)
    border = np.zeros(len(inside), dtype=bool)
    if inside.all() or not inside.any():
        return border
    reach = REACH * spacing(int(72 * 8 ** levels.max()))
    wide = REACH * spacing(int(72 * 8 ** levels.min()))
    for of, to in ((inside, ~inside), (~inside, inside)):
        _, apart = Neighbours(found.attitude[to]).nearest(found.attitude[of])
        border[of] = apart <= np.where(levels[of] == levels.max(), reach, wide)
    return border


def largest_ball(survey: Survey, found: Outcome, margin: float) -> tuple[Array, float]:
    """Return the feasible attitude (4,) farthest from those that are not, and how far [rad].

    From the middle found in the sample the attitudes on turns about `AXES` axes are followed, to
    find how far each turn may go.
    """
    inside = found.feasible(margin)
    if inside.all():
        return found.attitude[np.argmax(found.distance)], np.pi
    to = Neighbours(found.attitude[~inside])
    _, room = to.nearest(found.attitude[inside])
    i = np.flatnonzero(inside)[np.argmax(room)]
    radius, centre = min(1.3 * float(room.max()), np.pi), found.attitude[i]
    low, high = 0.0, radius
    axes = sphere(AXES)
    for _ in range(ROUNDS):
        shells = low + (high - low) * (np.arange(PARTS) + 1.0) / PARTS
        turns = (shells[:, None, None] * axes).reshape(-1, 3)
        around = (Rotation.from_rotvec(turns) * Rotation.from_quat(centre)).as_quat()
        known = np.flatnonzero(np.isfinite(found.q[:, 0]))
        nearest, _ = Neighbours(found.attitude[known]).nearest(around)
        ok = survey.near(around, found.q[known[nearest]]).feasible(margin)
        whole = ok.reshape(PARTS, AXES).all(axis=1)
        first = PARTS if whole.all() else int(whole.argmin())
        if first == PARTS:
            return centre, high
        low, high = (shells[first - 1] if first else low), float(shells[first])
    return centre, float(low)
