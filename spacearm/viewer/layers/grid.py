"""Grid: squares of a round length in the inertial frame, to judge lengths by."""

from __future__ import annotations

from typing import NamedTuple

import meshcat
import meshcat.geometry as g
import numpy as np

from spacearm.arrays import Array

PALE = 0x8B949E
SQUARES = 20
"""Number of squares along each side."""


class Grid(NamedTuple):
    """A grid about an axis of the inertial frame.

    Attributes:
        step: Side of a square [m].
        normal: The axis, 0 to 2.
        height: Its place along that axis [m].
        half: Half of its width [m].
    """

    step: float
    normal: int
    height: float
    half: float

    @classmethod
    def of(cls, size: float, normal: int, height: float) -> Grid:
        """Return the grid for a system of a radius [m]."""
        step = step_of(size)
        return cls(step, normal, height, step * SQUARES / 2)


def step_of(size: float) -> float:
    """Return the side of a square [m]: 1, 2 or 5 times a power of ten, at most half of a size."""
    most = 0.5 * size
    power = 10.0 ** np.floor(np.log10(most))
    return float(power * max(factor for factor in (1, 2, 5) if factor * power <= most))


def draw_grid(node: meshcat.Visualizer, grid: Grid) -> None:
    """Draw a grid.

    Args:
        node: The node to draw.
        grid: The grid.
    """
    lines = grid_lines(grid)
    material = g.LineBasicMaterial(color=PALE, transparent=True, opacity=0.45, depthWrite=False)
    node.set_object(g.LineSegments(g.PointsGeometry(lines.T.astype(np.float32)), material))


def grid_lines(grid: Grid) -> Array:
    """Return the ends (m, 3) of the lines, two by two."""
    places = grid.step * (np.arange(SQUARES + 1) - SQUARES / 2)
    end = grid.half
    ends = [[[x, -end], [x, end]] for x in places] + [[[-end, y], [end, y]] for y in places]
    return np.insert(np.array(ends).reshape(-1, 2), grid.normal, grid.height, axis=1)
