"""Workspaces in the scene: cut open through their centre, the regions on the face of the cut."""

from __future__ import annotations

from typing import NamedTuple

import meshcat
import meshcat.geometry as g
import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.singularities.risk import RiskProfile
from spacearm.viewer.layers.paths import distance_colors
from spacearm.workspaces.path_dependent import Workspace

VERMILION, BLUE = 0xD55E00, 0x0072B2
AROUND, DOWN = 96, 20
"""Points around a circle, and from the pole of half a sphere to its edge."""
LEAST = 1e-6
"""Radius from which on a sphere is drawn, as a share of the largest."""


class Key(NamedTuple):
    """A line of the legend.

    Attributes:
        layer: The layer that it belongs to.
        colors: Its colours, from left to right.
        words: What they mean.
    """

    layer: str
    colors: tuple[str, ...]
    words: str


def draw_workspace(node: meshcat.Visualizer, space: Workspace, view: Array) -> list[Key]:
    """Draw the half of a workspace behind a cut, and its regions on the cut; rings in a plane.

    Args:
        node: The node to draw under, its origin at the centre.
        space: The workspace.
        view: (3,) direction from which the cut is seen.

    Returns:
        The legend.
    """
    node.delete()
    regions = {"path dependent": (VERMILION, space.pdw), "path independent": (BLUE, space.piw)}
    far, legend = float(space.reachable[0, 1]), []
    for name, (color, ranges) in regions.items():
        for i, (low, high) in enumerate(ranges):
            ring = g.TriangularMeshGeometry(*annulus(low, high, view))
            node[name][f"ring_{i}"].set_object(ring, _clear(color, 0.4 if space.planar else 0.25))
            for radius in () if space.planar else (low, high):
                if radius > LEAST * far:
                    lit = g.MeshPhongMaterial(
                        color=color, opacity=0.25, transparent=True, depthWrite=False
                    )
                    node[name][f"{i}_{radius:.9g}"].set_object(half_sphere(radius, view), lit)
        if len(ranges):
            words = ", ".join(f"{low:.3f} to {high:.3f}" for low, high in ranges)
            key = Key("shells", (f"#{color:06x}",), f"{name}: {words} m from the CM")
            legend.append(key)
    proof = "proven" if space.kind == "certified" else f"found, proven up to {space.gap:.2g} m"
    proof += "" if space.mode == "free-floating" else f"; spacecraft {space.mode}"
    return [key._replace(words=f"{key.words} ({proof})") for key in legend]


def draw_risk(node: meshcat.Visualizer, risk: RiskProfile, view: Array) -> list[Key]:
    """Draw a disc coloured by the share of postures near a singular one; see `draw_workspace`."""
    node.delete()
    most = float(np.nanmax(risk.share, initial=0.0))
    shares = np.nan_to_num(risk.share)
    colors = distance_colors(1.0 - shares / most if most > 0.0 else np.ones(len(shares)))
    rings = [
        (annulus(low, high, view), color)
        for low, high, color, count in zip(
            risk.edges[:-1], risk.edges[1:], colors, risk.count, strict=True
        )
        if count
    ]
    vertices = np.concatenate([points for (points, _), _ in rings])
    numbers = np.concatenate([
        faces + i * 2 * AROUND for i, ((_, faces), _) in enumerate(rings)
    ])  # fmt: skip
    painted = np.repeat([color for _, color in rings], 2 * AROUND, axis=0)
    material = g.MeshBasicMaterial(
        vertexColors=True, transparent=True, opacity=0.7, depthWrite=False
    )
    node["disc"].set_object(g.TriangularMeshGeometry(vertices, numbers, painted), material)
    scale = distance_colors(np.array([1.0, 0.5, 0.0]))
    named = tuple("#" + "".join(f"{round(255 * x):02x}" for x in color) for color in scale)
    words = f"postures within 5° of a singular one: 0 to {100 * most:.3g} %, by the tip's R"
    return [Key("risk", named, words)]


def half_sphere(radius: float, view: Array) -> g.TriangularMeshGeometry:
    """Return the half of a sphere that is away from the viewer."""
    x, y, z = _axes(view)
    angle = np.linspace(0.0, np.pi / 2.0, DOWN + 1)
    turn = 2.0 * np.pi * np.arange(AROUND) / AROUND
    across = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
    points = np.sin(angle)[:, None, None] * across - np.cos(angle)[:, None, None] * z
    first = AROUND * np.arange(DOWN)[:, None] + np.arange(AROUND)
    return g.TriangularMeshGeometry(radius * points.reshape(-1, 3), _strip(first))


def annulus(low: float, high: float, view: Array) -> tuple[Array, npt.NDArray[np.int64]]:
    """Return the vertices (m, 3) and faces of a flat ring, facing the viewer."""
    x, y, _ = _axes(view)
    turn = 2.0 * np.pi * np.arange(AROUND) / AROUND
    across = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
    return np.concatenate((low * across, high * across)), _strip(np.arange(AROUND)[None])


def _clear(color: int, opacity: float) -> g.MeshBasicMaterial:
    return g.MeshBasicMaterial(color=color, opacity=opacity, transparent=True, depthWrite=False)


def _strip(first: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return the faces between rows of points numbered (k, AROUND) and the rows after them."""
    second = np.roll(first, -1, axis=1)
    one = np.stack((first, second, second + AROUND), axis=-1)
    two = np.stack((first, second + AROUND, first + AROUND), axis=-1)
    return np.concatenate((one.reshape(-1, 3), two.reshape(-1, 3)))


def _axes(view: Array) -> tuple[Array, Array, Array]:
    """Return axes of which the last points to the viewer."""
    z = view / np.linalg.norm(view)
    x = np.cross(np.eye(3)[int(np.abs(z).argmin())], z)
    x /= np.linalg.norm(x)
    return x, np.cross(z, x), z
