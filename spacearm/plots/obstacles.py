"""Plots of obstacles, and of the distances that bodies keep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy.spatial import ConvexHull

from spacearm.arrays import Array
from spacearm.collisions.obstacles import Obstacle
from spacearm.collisions.separation import CollisionReport
from spacearm.collisions.solids import corners
from spacearm.plots.style import BLUE, GREY, RED, axes_for, style

OPACITY = 0.35


def draw_obstacles(
    axes: Any,
    obstacles: Sequence[Obstacle],
    along: Array,
    times: Sequence[float],
    normal: int | None,
) -> None:
    """Draw obstacles at some times, faint before the last one.

    Args:
        axes: Matplotlib axes.
        obstacles: The obstacles.
        along: (3, 3) the axes of the picture, columns in inertial axes.
        times: The times [s]; of obstacles at rest the last one only.
        normal: Which of these axes is left out in a flat picture; None for one in space.
    """
    for obstacle in obstacles:
        label: str | None = obstacle.name
        for t in times if obstacle.moves else times[-1:]:
            opacity = OPACITY if t == times[-1] else 0.3 * OPACITY
            for part, pose in zip(obstacle.parts, obstacle.poses(float(t)), strict=True):
                points = _placed(corners(part.solid), pose) @ along
                _draw_hull(axes, points, normal, opacity, label if t == times[-1] else None)
                label = None if t == times[-1] else label


def _placed(points: Array, pose: pin.SE3) -> Array:
    """Return points (k, 3) of a frame in the inertial frame."""
    return points @ pose.rotation.T + pose.translation


def _draw_hull(
    axes: Any, points: Array, normal: int | None, opacity: float, label: str | None
) -> None:
    """Draw the convex hull of points (k, 3), or its shadow in the plane."""
    if normal is None:
        faces = points[ConvexHull(points).simplices]
        axes.add_collection3d(Poly3DCollection(faces, facecolor=GREY, alpha=opacity, label=label))
        axes.auto_scale_xyz(*points.T)
        return
    flat = np.delete(points, normal, axis=1)
    edge = flat[ConvexHull(flat).vertices]
    axes.add_patch(Polygon(edge, facecolor=GREY, edgecolor=GREY, alpha=opacity, label=label))


def draw_collision_report(result: CollisionReport, *, ax: Any = None) -> Figure:
    """Draw the least distance between bodies, less the margins of obstacles: over time, if any.

    Args:
        result: The report.
        ax: Matplotlib axes to draw into; None for a new figure.
    """
    axes = axes_for(ax, 7.0, 4.0)
    label = "least distance, less margins [m]"
    with style():
        if len(result.t) == 1:
            axes.barh([0], result.distance, height=0.5, color=BLUE)
            axes.bar_label(axes.containers[0], fmt="{:.3g} m", padding=4)
            axes.axvline(0.0, color=RED, lw=1.2)
            axes.set(xlabel=label, yticks=[0], yticklabels=["posture"], ylim=(-1.0, 1.0))
            axes.margins(x=0.15)
        else:
            axes.plot(result.t, result.distance, color=BLUE, lw=1.8)
            axes.axhline(0.0, color=RED, lw=1.2)
            axes.set(xlabel="time [s]", ylabel=label)
        a, b = result.nearest
        axes.set_title(f"{'apart, proven' if result.apart else 'bodies meet'}; nearest:\n{a}, {b}")
    return axes.figure
