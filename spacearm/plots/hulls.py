"""Bodies in plots: the convex hulls of their visuals at their size, in space or in a plane."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from matplotlib.colors import to_rgb
from matplotlib.patches import Polygon
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy.spatial import ConvexHull

from spacearm.arrays import Array
from spacearm.description.bus import solid_box
from spacearm.description.shapes import Box, Shape, faces
from spacearm.errors import ModelError, warn
from spacearm.mechanics.target import Target
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.frames import evenly_spread
from spacearm.plots.style import GREEN, PURPLE

GOLD = "#d9b25f"
"""Colour of the spacecraft."""
TINT = 0.55
"""Share of white in the colour of a body."""
MOST_CORNERS = 200
"""Corners that are drawn of a body: the outermost ones in as many directions."""
FINEST = 1.0 / 12.0
"""Longest edge of a drawn triangle, as a share of all: smaller ones are sorted by depth rightly."""


class Solid(NamedTuple):
    """A convex body that is drawn of a link.

    Attributes:
        link: Name of the link.
        corners: (m, 3) points whose convex hull it is, in the link frame [m].
        color: Its colour; None for that of the arm.
    """

    link: str
    corners: Array
    color: str | None


@lru_cache(maxsize=8)
def solids(arm: SpaceArm) -> tuple[Solid, ...]:
    """Return what is drawn of an arm: the hulls of its visuals.

    A spacecraft without visuals is drawn as the box that has its inertia; links without, not.

    Warns:
        ModelWarning: A mesh cannot be read.
    """
    spacecraft = arm.tree.lumps[arm.tree.root]
    found = [
        Solid(link, corners, GOLD if link in spacecraft else GREEN if drawn.stands_in else None)
        for link, drawn in arm.tree.visuals.items()
        for shape in drawn.visual
        if len(corners := _outermost(_points(shape)))
    ]
    if not any(solid.link in spacecraft for solid in found):
        inertia = arm.model.inertias[1]
        axes, edges = solid_box(inertia.mass, inertia.inertia)
        box = Shape(pin.SE3(axes, inertia.lever), Box(tuple(edges.tolist())))
        found.insert(0, Solid(arm.tree.root, box.points(), GOLD))
    return tuple(found)


def bare(arm: SpaceArm) -> list[str]:
    """Return the first links of the bodies that have no visuals of their own to draw."""
    seen = {
        solid.link for solid in solids(arm)
        if solid.link in arm.tree.visuals and not arm.tree.visuals[solid.link].stands_in
    }  # fmt: skip
    return [first for first, lump in arm.tree.lumps.items() if not seen & set(lump)]


def stand_ins(arm: SpaceArm) -> str:
    """Say as what bodies without visuals are drawn, in a line of a title; empty without any."""
    boxed = any(drawn.stands_in for drawn in arm.tree.visuals.values())
    missing = bare(arm)
    root = arm.tree.root in missing
    count, of = len(missing) - root, len(arm.tree.lumps) - 1
    said = (
        "the box of its inertia" * (root or boxed), f"lines ({count} of {of} links)" * bool(count)
    )  # fmt: skip
    shown = " and ".join(filter(None, said))
    return f"\nwithout visuals, drawn as {shown}" if shown else ""


def draw_bodies(
    axes: Any, cfg: Configuration, rows: tuple[int, ...], color: str, alpha: float = 1.0
) -> None:
    """Draw the bodies of an arm in a configuration.

    Args:
        axes: Matplotlib axes.
        cfg: The configuration.
        rows: Which of x, y, z are drawn.
        color: Colour of the arm.
        alpha: Opacity.
    """
    model, data = cfg.arm.model, pin.Data(cfg.arm.model)
    pin.framesForwardKinematics(model, data, cfg.full)
    parts = []
    for solid in solids(cfg.arm):
        pose = data.oMf[model.getFrameId(solid.link, pin.BODY)]
        parts.append((placed(solid.corners, pose), tinted(solid.color or color)))
    draw_hulls(axes, parts, rows, alpha)


def draw_target(axes: Any, target: Target, rows: tuple[int, ...]) -> None:
    """Draw the hulls of a target where it is at time 0; without visuals the box of its inertia.

    Args:
        axes: Matplotlib axes.
        target: The target.
        rows: Which of x, y, z are drawn.
    """
    tree, parts = target.tree, list[Array]()
    for link, drawn in tree.visuals.items():
        for shape in drawn.visual:
            if len(corners := _outermost(_points(shape))):
                parts.append(placed(corners, tree.frames[link]))
    if not parts:
        turned, edges = solid_box(target.mass, target.inertia)
        parts = [Shape(pin.SE3(turned, target.com), Box(tuple(edges.tolist()))).points()]
    draw_hulls(axes, [(placed(part, target.pose), tinted(PURPLE)) for part in parts], rows, 1.0)


def draw_hulls(
    axes: Any,
    parts: Sequence[tuple[Array, Any]],
    rows: tuple[int, ...],
    alpha: float,
    label: str | None = None,
) -> None:
    """Draw convex hulls of points, in space or as their shadows in a plane.

    Args:
        axes: Matplotlib axes.
        parts: Points (m, 3) in the axes of the picture [m], and a colour, of each hull.
        rows: Which of these axes are drawn.
        alpha: Opacity.
        label: Their name in the legend.
    """
    if len(rows) == 2:
        away = next(i for i in range(3) if i not in rows)
        for points, color in sorted(parts, key=lambda part: float(part[0][:, away].mean())):
            flat = points[:, rows]
            edge = flat[ConvexHull(flat, qhull_options="QJ").vertices]
            axes.add_patch(Polygon(edge, fc=color, ec="black", lw=0.6, alpha=alpha, label=label))
            label = None
        return
    if not parts:
        return
    everything = np.vstack([points for points, _ in parts])
    solid = alpha == 1.0  # edges close the gaps between triangles, and would be seen through others
    longest = FINEST * float(np.ptp(everything, axis=0).max()) if solid else np.inf
    triangles = [_divided(faces(points), longest) for points, _ in parts]
    colors = np.repeat([to_rgb(color) for _, color in parts], list(map(len, triangles)), axis=0)
    axes.auto_scale_xyz(*everything.T, had_data=axes.has_data())
    axes.add_collection3d(
        Poly3DCollection(
            np.concatenate(triangles),
            facecolors=colors,
            edgecolors=colors if solid else None,
            linewidths=0.4 if solid else 0.0,
            antialiaseds=solid,
            shade=True,
            alpha=alpha,
            rasterized=True,
            label=label,
        )
    )


def placed(points: Array, pose: pin.SE3) -> Array:
    """Return points (m, 3) of a frame in the frame of its pose."""
    return points @ pose.rotation.T + pose.translation


def tinted(color: str) -> tuple[float, ...]:
    """Return a colour mixed with white."""
    return tuple(TINT + (1.0 - TINT) * x for x in to_rgb(color))


def _divided(triangles: Array, longest: float) -> Array:
    """Return triangles (m, 3, 3) halved across their longest edges until these are short."""
    done = []
    while len(triangles):
        edges = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        first = edges.argmax(axis=1)
        short = edges.max(axis=1) <= longest
        done.append(triangles[short])
        order = (first[~short, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(triangles[~short], order[:, :, None], axis=1).swapaxes(0, 1)
        middle = 0.5 * (a + b)
        triangles = np.concatenate((np.stack((a, middle, c), 1), np.stack((middle, b, c), 1)))
    return np.concatenate(done)


def _outermost(points: Array) -> Array:
    """Return the corners (m, 3) of points that stand out in any of many directions."""
    if len(points) <= MOST_CORNERS:
        return np.resize(points, (max(len(points), 4), 3)) if len(points) else points
    directions = np.vstack((evenly_spread(MOST_CORNERS - 6), np.eye(3), -np.eye(3)))
    return points[np.unique(np.argmax(points @ directions.T, axis=0))]


def _points(shape: Shape) -> Array:
    """Return the points of a shape; none, and a warning, where its mesh cannot be read."""
    try:
        return shape.points()
    except ModelError as error:
        warn(f"{error}: not drawn")
        return np.zeros((0, 3))
