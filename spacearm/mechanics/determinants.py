"""Determinants whose common roots are the singular configurations, at many configurations."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.equations import measures
from spacearm.equations.measures import moved
from spacearm.mechanics.many import evaluated, parameters_of, structure_of
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode

Indices = npt.NDArray[np.int_]


def minors(arm: SpaceArm, Q: Array, mode: BaseMode, rows: Indices, columns: Indices) -> Array:
    """Compute determinants (m, c) at Q (m, n), up to one positive factor.

    Args:
        arm: The arm, with one tip.
        Q: (m, n) joint positions.
        mode: What the spacecraft does.
        rows: (k,) rows of momentum, or of the twist of the tip if the spacecraft is held.
        columns: (c, k) columns of each minor: 0 to 5 the tip's twist, 6 + j joint j.
    """
    row, column = _units(arm, mode == "free-floating")
    options = (
        ("rows", tuple(int(i) for i in rows)),
        ("chosen", tuple(tuple(int(i) for i in each) for each in columns)),
    )
    units = {"row_unit": row, "column_unit": column}
    found: Array = evaluated(arm, mode, measures.determinants, {"q": Q}, units, options=options)
    return found


def columns_seen(arm: SpaceArm, Q: Array, mode: BaseMode) -> Array:
    """Compute the columns (m, 6, 6 + n) of which `minors` takes determinants, for a check."""
    row, column = _units(arm, mode == "free-floating")
    found: Array = evaluated(arm, mode, measures.columns, {"q": Q}, once=True)
    return row[:, None] * found * column


def unit_of_minors(arm: SpaceArm, mode: BaseMode, rows: Indices, columns: Indices) -> Array:
    """Return the positive factors (c,) by which `minors` of an arm are scaled."""
    row, column = _units(arm, mode == "free-floating")
    return np.asarray(row[rows].prod() * column[columns].prod(axis=1))


def tips_from_centre(arm: SpaceArm, Q: Array, mode: BaseMode) -> Array:
    """Compute the tip (m, 3) from the system CM, or a fixed spacecraft's own, at Q (m, n) [m]."""
    found: Array = evaluated(arm, mode, measures.tip_from_centre, {"q": Q})
    return found


@lru_cache(maxsize=64)
def _units(arm: SpaceArm, floating: bool) -> tuple[Array, Array]:
    """Return factors of rows (6,) and columns (6 + n,) that make them of order one.

    They are made of the arm's size and of the mass that each joint moves, so that neither tiny nor
    huge arms, nor very light spacecraft, leave the range of floating-point numbers.
    """
    tree, p = structure_of(arm), parameters_of(arm)
    M = float(p.masses.sum())
    reach = np.linalg.norm(p.joint_positions, axis=1).sum() + np.linalg.norm(p.tip_positions[0])
    gyration = float(np.sqrt(np.trace(p.inertias, axis1=1, axis2=2).sum() / M))
    L = float(reach + np.linalg.norm(p.centres, axis=1).max() + gyration) or 1.0
    row = np.repeat((1.0 / M, 1.0 / (M * L)) if floating else (1.0, L), 3)
    column = np.ones(6 + arm.n)
    column[3:6] = 1.0 / L
    share = moved(tree) @ p.masses / M
    for i, j in zip(*np.nonzero(tree.gains), strict=True):
        column[6 + j] = 1.0 if tree.slides[i + 1] else 1.0 / L
        if floating and share[i] > 0.0:
            column[6 + j] /= share[i]
    return row, column
