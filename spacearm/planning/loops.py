"""Loops: closed joint curves that turn the spacecraft, and how many of them make a turn."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array

Indices: TypeAlias = npt.NDArray[np.int64]

LOOPS = (1, 2, 3, 4, 6, 8, 12)
"""Numbers of times that a loop is run through."""
WORDS = 8
"""Numbers of turns by loops that are considered for each end, nearest to the one needed."""
NEAR = 0.4
"""Largest angle between the turn by loops and the turn that is needed [rad]."""


class Loops(NamedTuple):
    """Closed loops, free of singularities.

    Attributes:
        C: (K, waves, n) coefficients of their sines.
        room: (K,) least distance to the singular set on each [rad].
        turn: (K, 3) rotation vectors by which each turns the spacecraft [rad].
    """

    C: Array
    room: Array
    turn: Array

    def broadest(self, m: int) -> Array:
        """Return the sines (<= m, waves, n) of those that turn the spacecraft most."""
        return self.C[np.argsort(-np.linalg.norm(self.turn, axis=1))[:m]]


def matches(loops: Loops, needed: Rotation) -> tuple[Indices, Indices, Indices]:
    """Match loops with the turns that are needed.

    The distance between the unit quaternions of two attitudes is 2 sin(angle / 4).

    Returns:
        The numbers of turns that are needed, the numbers of loops that nearly make them, and how
        many times these have to be run through.
    """
    wound = Rotation.concatenate([Rotation.from_rotvec(k * loops.turn) for k in LOOPS])
    tree = cKDTree(np.concatenate((wound.as_quat(), -wound.as_quat())))
    some = np.arange(1, min(WORDS, len(wound)) + 1)
    chord, word = (np.asarray(x) for x in tree.query(needed.as_quat(), k=some))
    which, rank = np.nonzero(chord < 2.0 * np.sin(NEAR / 4.0))
    times, loop = np.divmod(word[which, rank] % len(wound), len(loops.C))
    return which, loop, np.array(LOOPS)[times]


def angles(R: Array) -> Array:
    """Return the angles (K,) of rotations (K, 3, 3) [rad]."""
    return np.asarray(Rotation.from_matrix(R).magnitude())


def closed(C: Array) -> Array:
    """Return the closed curves (K, waves + 1, n) of sines C (K, waves, n)."""
    return np.concatenate((np.zeros_like(C[:, :1]), C), axis=1)


def lengths(points: Array) -> Array:
    """Return the joint travel (K,) along points (K, m, n), the sum over all joints."""
    return np.abs(np.diff(points, axis=1)).sum(axis=(1, 2))
