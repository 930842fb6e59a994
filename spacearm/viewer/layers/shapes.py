"""Shapes: the visuals of each link for meshcat, and plain bodies where there are none."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import meshcat.geometry as g
import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.description.bus import solid_box
from spacearm.description.shapes import Box, Cylinder, Mesh, Shape, Sphere, Unusable, read_mesh
from spacearm.errors import ModelError, listed, warn
from spacearm.model.arm import SpaceArm

if TYPE_CHECKING:
    import trimesh

FINEST = 0.002
"""Size of detail that is still drawn, as a share of the arm: about a pixel of a page."""
FEWEST = 100
"""Number of triangles that a mesh keeps at least, if it has them."""
GREY = (0.75, 0.78, 0.82, 1.0)
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
    """Return the visuals of an arm, and plain bodies for the rigid bodies that have none.

    Warns:
        ModelWarning: A visual cannot be drawn, or bodies have none.
    """
    visuals = {link: drawn.visual for link, drawn in arm.tree.visuals.items()}
    drawn = [
        shape
        for link, parts in visuals.items()
        for part in parts
        if (shape := _drawn(arm, link, part)) is not None
    ]
    seen = {shape.link for shape in drawn}
    bare = {leader: lump for leader, lump in arm.tree.lumps().items() if not seen & set(lump)}
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


def coarsened(mesh: trimesh.Trimesh, cell: float) -> trimesh.Trimesh:
    """Return a mesh without detail below the size of a cell, in the unit of its vertices.

    Vertices of one cell become one; so do triangles that then have the same corners. A mesh that
    little would be left of stays as it is.
    """
    coarse: trimesh.Trimesh = mesh.copy()
    coarse.vertices = coarse.vertices / cell
    coarse.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=0)
    coarse.update_faces(coarse.nondegenerate_faces() & coarse.unique_faces())
    coarse.remove_unreferenced_vertices()
    if len(coarse.faces) < FEWEST:
        return mesh
    coarse.vertices = coarse.vertices * cell
    return coarse


def _plain_body(arm: SpaceArm, leader: str, lump: list[str]) -> list[DrawnShape]:
    """Draw the box that has the spacecraft's inertia, or bars from joint to joint of a link."""
    frame = arm.model.frames[arm.model.getFrameId(leader, pin.BODY)]
    inertia = arm.model.inertias[frame.parentJoint]
    if leader == arm.tree.root:
        axes, edges = solid_box(inertia.mass, inertia.inertia)
        pose = pin.SE3(axes, inertia.lever).homogeneous
        return [DrawnShape(leader, pose, g.Box(list(edges)), GREY)]
    size = _size(arm)
    ends = [
        _within(arm, leader, joint.parent) * joint.origin
        for joint in arm.tree.joints.values()
        if joint.parent in lump and (joint.movable or joint.child == arm.tip)
    ]
    bars = [
        DrawnShape(leader, _bar(end.translation), g.Cylinder(1.0, 0.02 * size), GREY)
        for end in ends
        if np.linalg.norm(end.translation) > 1e-6 * size
    ]
    ball = DrawnShape(leader, np.eye(4), g.Sphere(0.03 * size), GREY)
    return [*bars, ball]


def _within(arm: SpaceArm, leader: str, link: str) -> pin.SE3:
    """Return the pose of a link in the frame of the leader of its body."""
    frames = arm.model.frames
    a, b = (frames[arm.model.getFrameId(name, pin.BODY)].placement for name in (leader, link))
    return a.inverse() * b


def _bar(end: Array) -> Array:
    """Return the matrix (4, 4) that fits a cylinder of height 1 between the origin and `end`."""
    return along(np.zeros(3), end) @ np.diag([1.0, np.linalg.norm(end), 1.0, 1.0])


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


def _size(arm: SpaceArm) -> float:
    """Return the larger of the arm's length and the spacecraft's radius of gyration [m]."""
    base = arm.model.inertias[1]
    gyration = math.sqrt(float(np.trace(base.inertia)) / (2.0 * base.mass)) if base.mass else 0.0
    links = sum(float(np.linalg.norm(j.origin.translation)) for j in arm.tree.chain(arm.tip)[1:])
    return max(links, gyration, 1e-3)
