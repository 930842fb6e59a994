"""Feasible attitudes in the scene: where an axis of the spacecraft may point, about its body."""

from __future__ import annotations

import meshcat
import meshcat.geometry as g
import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.mission.attitude_search import ENDS
from spacearm.mission.attitudes import FeasibleAttitudes
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.viewer.layers.paths import distance_colors
from spacearm.viewer.layers.shapes import along
from spacearm.viewer.layers.workspaces import BLUE, VERMILION, Key

NEEDLE = 0x7F7F7F
INNER, OUTER = 0.42, 0.5
"""Radii of the ring, and of the sphere, as shares of the size of the system."""
AROUND = 2.2
"""Least radius of the sphere, and of the ring, in radii of gyration of the spacecraft.

The corners of a cube are at 2.1 of them.
"""
CORNERS = 10
"""Corners of a patch of the sphere."""
FINEST = np.radians(2.0)
"""Largest angle of a piece of the ring [rad]."""
LEAST = 1e-9
"""Angle from which on a part of the ring is drawn [rad]."""


class AttitudeLayer:
    """The attitudes from which a path of the tip can be followed, and the attitude on show.

    Around the spacecraft of a spatial arm stands a sphere of the directions of its z axis, coloured
    by the share of feasible rolls; around that of a planar arm a ring of the directions of the
    first axis in its plane. A needle shows where that axis points now.

    Args:
        node: The node to draw under.
        size: Radius of the system [m].
    """

    def __init__(self, node: meshcat.Visualizer, size: float) -> None:
        self._node, self._arm_size, self._size = node, size, size
        self._axis: int | None = None

    def show(self, found: FeasibleAttitudes) -> list[Key]:
        """Draw the attitudes in place of others.

        Returns:
            The legend.
        """
        self._node.delete()
        self._axis = 2 if found.axis is None else (found.axis + 1) % 3
        self._size = max(self._arm_size, _around(found.arm) / OUTER)
        shaft = g.Cylinder(1.0, 0.006 * self._size)
        solid = g.MeshLambertMaterial(color=NEEDLE)
        self._node["now"]["shaft"].set_object(shaft, solid)
        self._node["now"]["end"].set_object(g.Sphere(0.02 * self._size), solid)
        name = "xyz"[self._axis]
        now = Key("attitudes", (f"#{NEEDLE:06x}",), f"needle: the spacecraft's {name} axis now")
        if found.intervals is None:
            return [self._sphere(found), now]
        return [*self._ring(found, found.intervals), now]

    def draw(self, cfg: Configuration) -> None:
        """Follow the spacecraft."""
        if self._axis is None:
            return
        pose = np.eye(4)
        pose[:3, 3] = cfg.base.act(cfg.arm.model.inertias[1].lever)
        self._node.set_transform(pose)
        end = OUTER * self._size * cfg.base.rotation[:, self._axis]
        needle = self._node["now"]
        stretch = np.diag([1.0, OUTER * self._size, 1.0, 1.0])
        needle["shaft"].set_transform(along(np.zeros(3), end) @ stretch)
        tip = np.eye(4)
        tip[:3, 3] = end
        needle["end"].set_transform(tip)

    def _sphere(self, found: FeasibleAttitudes) -> Key:
        directions, shares = found.by_direction
        vertices, faces = patches(directions, 0.65 * 2.0 / np.sqrt(len(directions)))
        painted = np.repeat(distance_colors(shares), CORNERS + 1, axis=0)
        mesh = g.TriangularMeshGeometry(OUTER * self._size * vertices, faces, painted)
        material = g.MeshBasicMaterial(
            vertexColors=True, transparent=True, opacity=0.9, depthWrite=False
        )
        self._node["sphere"].set_object(mesh, material)
        scale = distance_colors(np.array([0.0, 0.5, 1.0]))
        named = tuple("#" + "".join(f"{round(255 * x):02x}" for x in color) for color in scale)
        words = "spacecraft's z axis: 0 to 100 % of the rolls about it feasible"
        return Key("attitudes", named, f"{words}; {_summary(found)}")

    def _ring(self, found: FeasibleAttitudes, intervals: Array) -> list[Key]:
        normal = int(found.axis or 0)
        axes = np.eye(3)[[(normal + 1) % 3, (normal + 2) % 3]]
        ends = intervals.ravel()
        rest = np.array([[-np.pi, np.pi]])
        if len(ends):
            rest = np.column_stack((ends[1::2], [*ends[2::2], ends[0] + 2.0 * np.pi]))
        for name, color, ranges in (("feasible", BLUE, intervals), ("not", VERMILION, rest)):
            for i, (low, high) in enumerate(ranges):
                if high - low < LEAST:
                    continue
                vertices, faces = sector(low, high, axes)
                material = g.MeshBasicMaterial(
                    color=color, transparent=True, opacity=0.75, depthWrite=False
                )
                mesh = g.TriangularMeshGeometry(self._size * vertices, faces)
                self._node[name][str(i)].set_object(mesh, material)
        words = ", ".join(f"{a:.2f}° to {b:.2f}°" for a, b in np.degrees(intervals))
        keys = [Key("attitudes", (f"#{VERMILION:06x}",), "spacecraft attitudes not feasible")]
        feasible = f"feasible: {words or 'none'}; {_summary(found)}"
        return [Key("attitudes", (f"#{BLUE:06x}",), feasible), *keys]


def _around(arm: SpaceArm) -> float:
    """Return a radius about the spacecraft's centre of mass that its body hardly exceeds [m]."""
    body = arm.model.inertias[1]
    most = float(np.linalg.eigvalsh(body.inertia)[-1])
    return AROUND * float(np.sqrt(most / body.mass)) if body.mass else 0.0


def patches(directions: Array, radius: float) -> tuple[Array, npt.NDArray[np.int64]]:
    """Return vertices and faces of small discs on the unit sphere.

    Args:
        directions: (m, 3) their middles.
        radius: Their radius.

    Returns:
        (m (CORNERS + 1), 3) vertices, the middle of each disc first; (m CORNERS, 3) faces.
    """
    least = np.eye(3)[np.abs(directions).argmin(axis=1)]
    across = np.cross(directions, least)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(directions, across)
    turn = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    edge = np.cos(turn)[:, None] * across[:, None] + np.sin(turn)[:, None] * other[:, None]
    rim = directions[:, None] + radius * edge
    vertices = np.concatenate((directions[:, None], rim), axis=1).reshape(-1, 3)
    corner = np.arange(CORNERS)
    one = np.stack((np.zeros(CORNERS, dtype=np.int64), corner + 1, (corner + 1) % CORNERS + 1), 1)
    first = (CORNERS + 1) * np.arange(len(directions))
    return vertices, (first[:, None, None] + one).reshape(-1, 3)


def sector(low: float, high: float, axes: Array) -> tuple[Array, npt.NDArray[np.int64]]:
    """Return vertices (m, 3) and faces of the ring from one angle to another in a plane.

    Args:
        low: First angle from the first axis to the second [rad].
        high: Last angle [rad].
        axes: (2, 3) axes of the plane.
    """
    angle = np.linspace(low, high, max(int(np.ceil((high - low) / FINEST)), 1) + 1)
    line = np.column_stack((np.cos(angle), np.sin(angle))) @ axes
    m = len(angle)
    i = np.arange(m - 1)
    one, two = np.stack((i, i + m, i + m + 1), axis=1), np.stack((i, i + m + 1, i + 1), axis=1)
    return np.concatenate((INNER * line, OUTER * line)), np.concatenate((one, two))


def _summary(found: FeasibleAttitudes) -> str:
    """Say how many attitudes are feasible, or why none is."""
    unit = "m" if min(found.arm.task.indices) < 3 else "rad"
    margin = f"{np.degrees(found.margin):.3g}°"
    momentum = "with momentum" if found.momentum.any() else "at zero momentum"
    path = f"the path of {found.length:.3g} {unit} {momentum}, {margin} or more from singular"
    if found.ball is None:
        kinds, counts = np.unique(found.ended, return_counts=True)
        ends = ", ".join(f"{ENDS[k]} {c}" for k, c in zip(kinds, counts, strict=True))
        return f"no start follows {path} postures ({ends})"
    ball = "" if found.intervals is not None else (
        f"; largest ball ±{np.degrees(found.ball.radius):.3g}°"
    )  # fmt: skip
    return f"{100.0 * found.share:.3g} % of all starts follow {path} postures{ball}"
