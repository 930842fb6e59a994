"""Shapes: the bodies of an arm as meshcat draws them, faint arms, held bodies and thick lines."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import meshcat
import meshcat.geometry as g
import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, Integers
from spacearm.description.bus import stand_in
from spacearm.description.shapes import (
    Box,
    Cylinder,
    Mesh,
    Shape,
    Sphere,
    Unusable,
    coarsened,
    read_mesh,
)
from spacearm.errors import ModelError, listed, warn
from spacearm.model.arm import Configuration, SpaceArm

#: Size of detail that is still drawn, as a share of the arm: about a pixel of a page.
FINEST = 0.002
GHOST, STEEL, VIOLET = 0x7D8794, 0x3A7CA5, 0x6A3D9A
GREY = (0.75, 0.78, 0.82, 1.0)
#: Vermilion, yellow, blue: told apart by colour-blind eyes too; the page has the same.
SCALE = np.array([[0xD5, 0x5E, 0x00], [0xF0, 0xE4, 0x42], [0x00, 0x72, 0xB2]]) / 255.0
SIDES = 6
Y_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])


class DrawnShape(NamedTuple):
    """A geometry of meshcat, fixed to a link.

    Attributes:
        link: Name of the link.
        pose: (4, 4) pose of the geometry in the link frame, scale included.
        geometry: The meshcat geometry.
        color: Red, green, blue, opacity, from 0 to 1.
    """

    link: str
    pose: Array
    geometry: Any
    color: tuple[float, ...]


def shapes(arm: SpaceArm) -> list[DrawnShape]:
    """Return the visuals of an arm, else what collides, and plain bodies for those without.

    Warns:
        ModelWarning: A shape cannot be drawn, or bodies have none.
    """
    visuals = {link: own.drawn for link, own in arm.tree.visuals.items()}
    drawn = [
        shape
        for link, parts in visuals.items()
        for part in parts
        if (shape := _drawn(arm, link, part)) is not None
    ]
    seen = {shape.link for shape in drawn}
    bare = {leader: lump for leader, lump in arm.tree.lumps.items() if not seen & set(lump)}
    for leader, lump in bare.items():
        drawn += _plain_body(arm, leader, lump)
    if without := [leader for leader, lump in bare.items() if not any(map(visuals.get, lump))]:
        warn(f"{arm.path}: no visuals for {listed(without)}: drawn as plain bodies")
    return drawn


def _drawn(arm: SpaceArm, link: str, shape: Shape) -> DrawnShape | None:
    """Make a shape one of meshcat; None, and as a rule a warning, if it cannot be drawn."""
    pose, color = shape.pose.homogeneous, shape.rgba or GREY
    match shape.geometry:
        case Box(size):
            return DrawnShape(link, pose, g.Box(list(size)), color)
        case Sphere(radius):
            return DrawnShape(link, pose, g.Sphere(radius), color)
        case Cylinder(radius, length):
            return DrawnShape(link, pose @ Y_TO_Z, g.Cylinder(length, radius), color)
        case Mesh(_, Path() as file, scale):
            try:
                mesh = read_mesh(file)
            except ModelError as error:
                warn(f"{arm.path}: {error}: not drawn")
                return None
            mesh = coarsened(mesh, FINEST * _size(arm) / max(float(np.abs(scale).max()), 1e-9))
            triangles = g.TriangularMeshGeometry(mesh.vertices, mesh.faces)
            return DrawnShape(link, pose * np.append(scale, 1.0), triangles, color)
        case Mesh():
            return None  # missing: the reader has warned
        case Unusable(problem):
            warn(f"{problem}; not drawn until then")
            return None


def _plain_body(arm: SpaceArm, leader: str, lump: list[str]) -> list[DrawnShape]:
    """Draw the box that has the spacecraft's inertia, or bars from joint to joint of a link."""
    frame = arm.model.frames[arm.model.getFrameId(leader, pin.BODY)]
    inertia = arm.model.inertias[frame.parentJoint]
    if leader == arm.tree.root:
        box = _drawn(arm, leader, stand_in(inertia))
        return [] if box is None else [box]
    size = _size(arm)
    poses = {
        link: arm.model.frames[arm.model.getFrameId(link, pin.BODY)].placement for link in lump
    }
    ends = [
        poses[leader].actInv(poses[joint.parent]) * joint.origin
        for joint in arm.tree.joints.values()
        if joint.parent in lump and (joint.movable or joint.child in arm.tips)
    ]
    bars = [
        DrawnShape(leader, bar(np.zeros(3), end.translation), g.Cylinder(1.0, 0.02 * size), GREY)
        for end in ends
        if np.linalg.norm(end.translation) > 1e-6 * size
    ]
    ball = DrawnShape(leader, np.eye(4), g.Sphere(0.03 * size), GREY)
    return [*bars, ball]


def _size(arm: SpaceArm) -> float:
    """Return the larger of the arm's length and the spacecraft's radius of gyration [m]."""
    base = arm.model.inertias[1]
    gyration = math.sqrt(float(np.trace(base.inertia)) / (2.0 * base.mass)) if base.mass else 0.0
    chains = [arm.tree.chain(tip)[1:] for tip in arm.tips]
    links = [sum(float(np.linalg.norm(j.origin.translation)) for j in chain) for chain in chains]
    return max(*links, gyration, 1e-3)


class Bodies:
    """The bodies of an arm, each under a node of its link.

    Attributes:
        shapes: What is drawn of each link.

    Args:
        node: The node to draw under.
        arm: The arm.
        faint: One colour and opacity for all of them; None for their own.
    """

    def __init__(
        self, node: meshcat.Visualizer, arm: SpaceArm, faint: tuple[int, float] | None = None
    ) -> None:
        self.shapes = shapes(arm)
        self._arm, self._links = arm, {}
        for i, shape in enumerate(self.shapes):
            link = self._links[shape.link] = node[shape.link.replace("/", "\u2215")]
            *rgb, opacity = shape.color
            color = int.from_bytes(bytes(int(255 * x) for x in rgb), "big")
            own = g.MeshLambertMaterial(color=color, opacity=opacity)
            link[str(i)].set_object(shape.geometry, glass(*faint) if faint else own)
            link[str(i)].set_transform(shape.pose)

    def place(self, cfg: Configuration) -> None:
        """Move them to a configuration; what its arm may hold besides is left out."""
        at = link_poses(self._arm, cfg)
        for name, node in self._links.items():
            node.set_transform(at(name).homogeneous)


class Ghost(Bodies):
    """An arm drawn faintly in one colour, with the axes of its tip.

    Args:
        node: The node to draw under; what is there is replaced.
        arm: The arm.
        size: Radius of the system [m].
        color: The colour.
        opacity: From 0 to 1.
    """

    def __init__(
        self, node: meshcat.Visualizer, arm: SpaceArm, size: float, color: int, opacity: float
    ) -> None:
        node.delete()
        super().__init__(node["bodies"], arm, (color, opacity))
        self._tip = node["tip"]
        draw_axes(self._tip, size, color)

    def place(self, cfg: Configuration) -> None:
        """Move it to a configuration; what its arm may hold besides is left out."""
        super().place(cfg)
        if len(cfg.arm.tips) == 1:
            self._tip.set_transform(cfg.tip.homogeneous)


def link_poses(arm: SpaceArm, cfg: Configuration) -> Callable[[str], pin.SE3]:
    """Return the poses of the links of an arm in a configuration, by name."""
    data = pin.Data(arm.model)
    pin.framesForwardKinematics(arm.model, data, cfg.full)
    return lambda link: data.oMf[arm.model.getFrameId(link, pin.BODY)]


# --- materials, places and lines ----------------------------------------------------------------


def glass(color: int, opacity: float) -> g.MeshLambertMaterial:
    """Make a material that hides nothing behind it, nor what lies in its surface."""
    behind = {"polygonOffset": True, "polygonOffsetFactor": 1, "polygonOffsetUnits": 1}
    return g.MeshLambertMaterial(
        color=color, opacity=opacity, transparent=True, depthWrite=False, **behind
    )


def film(opacity: float, color: int | None = None) -> g.MeshBasicMaterial:
    """Make a material without shading that hides nothing; its colour is the vertices' if None."""
    own = {"vertexColors": True} if color is None else {"color": color}
    return g.MeshBasicMaterial(**own, transparent=True, opacity=opacity, depthWrite=False)


def overlay(color: int) -> g.MeshLambertMaterial:
    """Make a material that is seen through the bodies in front of it."""
    return g.MeshLambertMaterial(color=color, transparent=True, depthTest=False, depthWrite=False)


def at(position: Array) -> Array:
    """Return the pose (4, 4) at a position (3,), unrotated."""
    return pin.SE3(np.eye(3), position).homogeneous


def along(start: Array, end: Array) -> Array:
    """Return the pose (4, 4) halfway from start to end (3,), its y axis along the way."""
    y = end - start
    length = float(np.linalg.norm(y))
    pose = np.eye(4)
    pose[:3, 3] = (start + end) / 2.0
    if length > 0.0:
        y = y / length
        x = np.cross(y, np.eye(3)[np.argmin(np.abs(y))])
        x /= np.linalg.norm(x)
        pose[:3, :3] = np.column_stack((x, y, np.cross(x, y)))
    return pose


def bar(start: Array, end: Array) -> Array:
    """Return the matrix (4, 4) that fits a cylinder of height 1 between two points (3,)."""
    return along(start, end) @ np.diag([1.0, max(float(np.linalg.norm(end - start)), 1e-9), 1, 1])


def draw_axes(node: meshcat.Visualizer, size: float, color: int) -> None:
    """Draw the axes of a frame, each 0.2 of a size [m] long, seen through everything."""
    solid = g.MeshBasicMaterial(color=color, transparent=True, depthTest=False, opacity=0.8)
    for axis in range(3):
        arrow = node[str(axis)]
        arrow.set_object(g.Cylinder(0.2 * size, 0.004 * size), solid)
        arrow.set_transform(along(np.zeros(3), 0.2 * size * np.eye(3)[axis]))


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
    return g.TriangularMeshGeometry(
        vertices, strips(len(points), SIDES), np.repeat(colors, SIDES, axis=0)
    )


def strips(rows: int, count: int, closed: bool = True) -> Integers:
    """Return the faces (m, 3) between successive rows of as many points, closed to rings or not."""
    grid = np.arange(rows * count).reshape(rows, count)
    if closed:
        grid = np.column_stack((grid, grid[:, 0]))
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    return np.concatenate([np.stack(f, axis=-1).reshape(-1, 3) for f in ((a, b, c), (a, c, d))])
