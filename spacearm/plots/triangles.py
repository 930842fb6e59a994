"""Bodies in plots: their visuals at their size, as triangles in space, as shadows in a plane."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from spacearm.arrays import Array
from spacearm.description.bus import stand_in
from spacearm.mechanics.target import Target
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.plots.style import GREEN, PURPLE

#: Colour of the spacecraft.
GOLD = "#d9b25f"
#: Share of white in the colour of a body.
TINT = 0.55
#: Sine of the angle up to which a triangle is seen from its edge.
EDGE_ON = 1e-6
#: Longest edge of a drawn triangle, as a share of all: smaller ones are sorted by depth rightly.
FINEST = 1.0 / 12.0


class Solid(NamedTuple):
    """A body that is drawn of a link.

    Attributes:
        link: Name of the link.
        triangles: (m, 3, 3) corners of its triangles, counterclockwise from outside, link frame
            [m].
        color: Its colour; None for that of the arm.
    """

    link: str
    triangles: Array
    color: str | None


@lru_cache(maxsize=8)
def solids(arm: SpaceArm) -> tuple[Solid, ...]:
    """Return what is drawn of an arm: its visuals, else what is checked for collisions.

    A spacecraft without shapes is drawn as the box that has its inertia; links without, not.

    Warns:
        ModelWarning: A mesh cannot be read.
    """
    spacecraft = arm.tree.lumps[arm.tree.root]
    found = [
        Solid(link, triangles, GOLD if link in spacecraft else GREEN if drawn.stands_in else None)
        for link, drawn in arm.tree.visuals.items()
        for shape in drawn.drawn
        if len(triangles := shape.triangles())
    ]
    if not any(solid.link in spacecraft for solid in found):
        box = stand_in(arm.model.inertias[1])
        found.insert(0, Solid(arm.tree.root, box.triangles(), GOLD))
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
        parts.append((placed(solid.triangles, pose), tinted(solid.color or color)))
    draw_solids(axes, parts, rows, alpha)


def draw_target(axes: Any, target: Target, rows: tuple[int, ...]) -> None:
    """Draw the visuals of a target where it is at time 0; without any the box of its inertia.

    Args:
        axes: Matplotlib axes.
        target: The target.
        rows: Which of x, y, z are drawn.
    """
    parts = [(placed(part, target.pose), tinted(PURPLE)) for part in target.drawn]
    draw_solids(axes, parts, rows, 1.0)


def draw_solids(
    axes: Any,
    parts: Sequence[tuple[Array, Any]],
    rows: tuple[int, ...],
    alpha: float,
    label: str | None = None,
) -> None:
    """Draw triangles, in space or as their shadows in a plane.

    Args:
        axes: Matplotlib axes.
        parts: Triangles (m, 3, 3) in the axes of the picture [m], and a colour, of each body.
        rows: Which of these axes are drawn.
        alpha: Opacity.
        label: Their name in the legend.
    """
    if len(rows) == 2:
        away = next(i for i in range(3) if i not in rows)
        for triangles, color in sorted(parts, key=lambda part: float(part[0][..., away].mean())):
            _draw_shadow(axes, triangles, rows, color, alpha, label)
            label = None
        return
    if not parts:
        return
    everything = np.concatenate([triangles for triangles, _ in parts]).reshape(-1, 3)
    solid = alpha == 1.0  # edges close the gaps between triangles, and would be seen through others
    longest = FINEST * float(np.ptp(everything, axis=0).max()) if solid else np.inf
    fine = [_divided(triangles, longest) for triangles, _ in parts]
    colors = np.repeat([to_rgb(color) for _, color in parts], list(map(len, fine)), axis=0)
    axes.auto_scale_xyz(*everything.T, had_data=axes.has_data())
    axes.add_collection3d(
        Poly3DCollection(
            np.concatenate(fine),
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


def _draw_shadow(
    axes: Any, triangles: Array, rows: tuple[int, ...], color: Any, alpha: float, label: str | None
) -> None:
    """Draw the shadow of triangles (m, 3, 3), and the edges between what is lit and what is not.

    A path whose parts all turn one way is filled as one, without seams.
    """
    flat = triangles[..., rows]
    over, across = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = over[:, 0] * across[:, 1] - over[:, 1] * across[:, 0]
    seen = area > EDGE_ON * np.abs(area).max()
    turned = np.where((area < 0.0)[:, None, None], flat[:, ::-1], flat)
    closed = np.concatenate((turned, turned[:, :1]), axis=1).reshape(-1, 2)
    codes = np.tile([Outline.MOVETO, Outline.LINETO, Outline.LINETO, Outline.CLOSEPOLY], len(flat))
    axes.add_patch(PathPatch(Outline(closed, codes), fc=color, lw=0.0, alpha=alpha, label=label))
    segments = flat[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2, 2)
    _, corners = np.unique(triangles.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    ends = np.sort(corners.reshape(-1, 3)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, first, edge = np.unique(ends, axis=0, return_index=True, return_inverse=True)
    sides = np.zeros((len(first), 2))
    np.add.at(sides, (edge.ravel(), np.repeat(seen, 3).astype(int)), 1.0)
    outer = (sides.min(axis=1) > 0.0) | (sides.sum(axis=1) == 1.0)
    lines = LineCollection(segments[first[outer]], colors="black", linewidths=0.6, alpha=alpha)
    axes.add_collection(lines)


def placed(points: Array, pose: pin.SE3) -> Array:
    """Return points (..., 3) of a frame in the frame of its pose."""
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
