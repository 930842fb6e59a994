"""Paths: lines thick enough to be seen, coloured by the distance to the singular set."""

from __future__ import annotations

import meshcat.geometry as g
import numpy as np

from spacearm.arrays import Array

SCALE = np.array([[0xD5, 0x5E, 0x00], [0xF0, 0xE4, 0x42], [0x00, 0x72, 0xB2]]) / 255.0
"""Vermilion, yellow, blue: told apart by colour-blind eyes too; the page has the same."""
SIDES = 6


def distance_colors(values: Array) -> Array:
    """Return colours (m, 3) of values (m,): vermilion from 0 down, yellow at 1/2, blue from 1."""
    x = np.clip(values, 0.0, 1.0)
    knots = np.linspace(0.0, 1.0, len(SCALE))
    return np.column_stack([np.interp(x, knots, channel) for channel in SCALE.T])


def tube(points: Array, colors: Array, radius: float) -> g.TriangularMeshGeometry:
    """Return a tube along points (m, 3) [m], with colours (m, 3) and a radius [m]."""
    if len(points) == 1:
        points, colors = np.repeat(points, 2, axis=0), np.repeat(colors, 2, axis=0)
    tangent = np.gradient(points, axis=0)
    length = np.linalg.norm(tangent, axis=1)
    tangent[length == 0.0] = np.eye(3)[0]
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    across = np.cross(tangent, np.eye(3)[np.abs(tangent).sum(axis=0).argmin()])
    flat = np.linalg.norm(across, axis=1) < 1e-6
    across[flat] = np.cross(tangent[flat], np.eye(3)[np.abs(tangent).sum(axis=0).argmax()])
    across /= np.linalg.norm(across, axis=1)[:, None]
    around = np.cross(tangent, across)
    turn = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring = across[:, None] * np.cos(turn)[:, None] + around[:, None] * np.sin(turn)[:, None]
    vertices = (points[:, None] + radius * ring).reshape(-1, 3)
    first = SIDES * np.arange(len(points) - 1)[:, None] + np.arange(SIDES)
    second = SIDES * np.arange(len(points) - 1)[:, None] + (np.arange(SIDES) + 1) % SIDES
    faces = np.concatenate((
        np.stack((first, second, second + SIDES), axis=-1).reshape(-1, 3),
        np.stack((first, second + SIDES, first + SIDES), axis=-1).reshape(-1, 3),
    ))  # fmt: skip
    return g.TriangularMeshGeometry(vertices, faces, np.repeat(colors, SIDES, axis=0))
