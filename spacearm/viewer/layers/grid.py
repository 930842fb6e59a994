"""Grid: squares of a round length in the inertial frame, to judge lengths by."""

from __future__ import annotations

import meshcat
import meshcat.geometry as g
import numpy as np

from spacearm.arrays import Array

PALE = 0x8B949E
SQUARES = 20
"""Number of squares along each side."""


def step_of(size: float) -> float:
    """Return the side of a square [m]: 1, 2 or 5 times a power of ten, at most half of a size."""
    most = 0.5 * size
    power = 10.0 ** np.floor(np.log10(most))
    return float(power * max(factor for factor in (1, 2, 5) if factor * power <= most))


def draw_grid(node: meshcat.Visualizer, normal: int, height: float, step: float) -> None:
    """Draw a grid about the axis `normal` of the inertial frame.

    Args:
        node: The node to draw.
        normal: The axis, 0 to 2.
        height: Its place along that axis [m].
        step: Side of a square [m].
    """
    lines = grid_lines(normal, height, step)
    material = g.LineBasicMaterial(color=PALE, transparent=True, opacity=0.45, depthWrite=False)
    node.set_object(g.LineSegments(g.PointsGeometry(lines.T.astype(np.float32)), material))


def grid_lines(normal: int, height: float, step: float) -> Array:
    """Return the ends (m, 3) of the lines, two by two; arguments as for `draw_grid`."""
    places = step * (np.arange(SQUARES + 1) - SQUARES / 2)
    end = places[-1]
    ends = [[[x, -end], [x, end]] for x in places] + [[[-end, y], [end, y]] for y in places]
    return np.insert(np.array(ends).reshape(-1, 2), normal, height, axis=1)
