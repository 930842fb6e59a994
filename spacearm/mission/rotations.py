"""Attitudes sampled evenly: a ring of angles, or cells of equal volume of all rotations.

The cells are those of Yershova, Jain, LaValle & Mitchell, Int. J. Robot. Res. 29, 801-812 (2010),
DOI 10.1177/0278364909352700: the direction of the spacecraft's z axis on the HEALPix grid (Gorski
et al., Astrophys. J. 622, 759-771, 2005, DOI 10.1086/427976), times its roll about that axis.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array, Integers

Cells = Integers

FACE_RING = np.array([2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4])
FACE_TURN = np.array([1, 3, 5, 7, 0, 2, 4, 6, 1, 3, 5, 7])


def count(level: int) -> tuple[int, int]:
    """Return the numbers of directions and of rolls of a level."""
    return 12 * 4**level, 6 * 2**level


def cells(level: int) -> Cells:
    """Return all cells of a level, (m, 2): direction, roll."""
    return np.indices(count(level)).reshape(2, -1).T


def children(of: Cells) -> Cells:
    """Return the eight cells of the next level in each cell, (8 m, 2)."""
    shift = np.array([[i, j] for i in range(4) for j in range(2)])
    return (of[:, None] * [4, 2] + shift).reshape(-1, 2)


def attitudes(of: Cells, level: int) -> Array:
    """Return the middles of cells as quaternions xyzw (m, 4)."""
    z, around = directions(of[:, 0], level)
    roll = (of[:, 1] + 0.5) * (2.0 * np.pi / count(level)[1])
    angles = np.stack((around, np.arccos(z), roll - around), axis=1)
    return Rotation.from_euler("ZYZ", angles).as_quat()


def directions(pixel: Cells, level: int) -> tuple[Array, Array]:
    """Return the heights z and the longitudes [rad] of HEALPix pixels in nested order."""
    side = 2**level
    face, rest = np.divmod(pixel, side * side)
    x, y = np.zeros_like(rest), np.zeros_like(rest)
    for bit in range(level):
        x |= (rest >> (2 * bit) & 1) << bit
        y |= (rest >> (2 * bit + 1) & 1) << bit
    ring = FACE_RING[face] * side - x - y - 1
    north, south = ring < side, ring > 3 * side
    length = np.where(north, ring, np.where(south, 4 * side - ring, side))
    cap = length * length / (3.0 * side * side)
    z = np.where(north, 1.0 - cap, np.where(south, cap - 1.0, (2 * side - ring) * 2.0 / 3.0 / side))
    shift = np.where(north | south, 0, (ring - side) & 1)
    place = (FACE_TURN[face] * length + x - y + 1 + shift) // 2
    return z, (place - 0.5 * (shift + 1)) * (0.5 * np.pi / length)


def spacing(number: int) -> float:
    """Return the angle [rad] between neighbours of that many attitudes, evenly spread."""
    return float(2.0 * (np.pi**2 / number) ** (1 / 3))


def nearest_of(given: Array, to: Array) -> tuple[Any, Any]:
    """Return which of given attitudes (m, 4) are nearest to others (k, 4), and how far [rad]."""
    chord, found = KDTree(np.vstack((given, -given))).query(to)
    return found % len(given), angle(chord)


def angle(chord: Any) -> Any:
    """Return the angle of rotation between unit quaternions that are a chord apart [rad]."""
    return 4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))


def angle_between(a: Array, b: Array) -> Any:
    """Return the angle of rotation (...) between attitudes (..., 4) [rad]."""
    apart = np.minimum(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
    return angle(apart)
