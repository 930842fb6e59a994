"""Shapes: what a URDF draws for each link, and clean bodies where it draws nothing."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import meshcat.geometry as g
import numpy as np
import pinocchio as pin
from lxml import etree

from spacearm.arrays import Array
from spacearm.description.bodies import solid_box
from spacearm.description.meshes import find_mesh, read_mesh
from spacearm.description.readers.xml import Source
from spacearm.errors import ModelError
from spacearm.model.arm import SpaceArm

GREY = (0.75, 0.78, 0.82, 1.0)
Y_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])


class Shape(NamedTuple):
    """A geometry fixed to a link.

    Attributes:
        link: Name of the link.
        pose: (4, 4) of the geometry in the link frame, scale included.
        geometry: The meshcat geometry.
        color: Red, green, blue, opacity, from 0 to 1.
    """

    link: str
    pose: Array
    geometry: Any
    color: tuple[float, ...]


def shapes(arm: SpaceArm) -> list[Shape]:
    """The visuals of the arm's URDF, and a drawn body for each rigid body that has none."""
    source = Source(arm.path)
    looks = {name: etree.fromstring(look) for name, look in arm.tree.looks.items()}
    visuals = {name: look.findall("visual") for name, look in looks.items()}
    drawn: list[Shape] = []
    for link, elements in visuals.items():
        for visual in elements:
            drawn += _visual(source, link, visual)
    seen = {shape.link for shape in drawn}
    bare = {leader: lump for leader, lump in arm.tree.lumps().items() if not seen & set(lump)}
    for leader, lump in bare.items():
        drawn += _plain_body(arm, leader, lump)
    if without := [leader for leader, lump in bare.items() if not any(map(visuals.get, lump))]:
        source.warn(f"no visuals for {', '.join(without)}: drawn as plain bodies")
    return drawn


def _visual(source: Source, link: str, visual: etree._Element) -> list[Shape]:
    pose = source.pose(visual).homogeneous
    material = visual.find("material")
    color = GREY if material is None else _color(source, material)
    element = visual.find("geometry/*")
    kind = "" if element is None else element.tag
    if element is not None and kind == "box":
        return [Shape(link, pose, g.Box(list(source.numbers(element, "size", 3))), color)]
    if element is not None and kind == "sphere":
        return [Shape(link, pose, g.Sphere(source.number(element, "radius")), color)]
    if element is not None and kind == "cylinder":
        radius, length = source.number(element, "radius"), source.number(element, "length")
        return [Shape(link, pose @ Y_TO_Z, g.Cylinder(length, radius), color)]
    if element is not None and kind == "mesh":
        scale = np.append(source.numbers(element, "scale", 3, "1 1 1"), 1.0)
        if (geometry := _mesh(source, element.get("filename", ""))) is not None:
            return [Shape(link, pose * scale, geometry, color)]
    else:
        source.warn(f"link {link!r} has a visual without a known geometry")
    return []


def _mesh(source: Source, filename: str) -> Any:
    """Triangles of a mesh file, or None with one warning if it cannot be had."""
    path = find_mesh(filename, source.path)
    if path is None:
        return None  # `load` has warned
    try:
        mesh = read_mesh(path)
    except ModelError as error:
        source.warn(f"{error}: not drawn")
        return None
    return g.TriangularMeshGeometry(mesh.vertices, mesh.faces)


def _color(source: Source, material: etree._Element) -> tuple[float, ...]:
    color = material.find("color")
    return GREY if color is None else tuple(float(x) for x in source.numbers(color, "rgba", 4))


def _plain_body(arm: SpaceArm, leader: str, lump: list[str]) -> list[Shape]:
    """A box of the body's inertia for the spacecraft, bars from joint to joint for a link."""
    frame = arm.model.frames[arm.model.getFrameId(leader, pin.BODY)]
    inertia = arm.model.inertias[frame.parentJoint]
    if leader == arm.tree.root:
        axes, edges = solid_box(inertia.mass, inertia.inertia)
        pose = pin.SE3(axes, inertia.lever).homogeneous
        return [Shape(leader, pose, g.Box(list(edges)), GREY)]
    size = _size(arm)
    ends = [
        _within(arm, leader, joint.parent) * joint.origin
        for joint in arm.tree.joints.values()
        if joint.parent in lump and (joint.movable or joint.child == arm.tip)
    ]
    bars = [
        Shape(leader, _bar(end.translation), g.Cylinder(1.0, 0.02 * size), GREY)
        for end in ends
        if np.linalg.norm(end.translation) > 1e-6 * size
    ]
    ball = Shape(leader, np.eye(4), g.Sphere(0.03 * size), GREY)
    return [*bars, ball]


def _within(arm: SpaceArm, leader: str, link: str) -> pin.SE3:
    frames = arm.model.frames
    a, b = (frames[arm.model.getFrameId(name, pin.BODY)].placement for name in (leader, link))
    return a.inverse() * b


def _bar(end: Array) -> Array:
    """(4, 4) that puts a cylinder of height 1 (along y) between the origin and `end`."""
    return along(np.zeros(3), end) @ np.diag([1.0, np.linalg.norm(end), 1.0, 1.0])


def along(start: Array, end: Array) -> Array:
    """(4, 4) pose halfway from start to end with its y axis that way."""
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
    """Length of the arm's chain and the spacecraft's radius of gyration [m]."""
    base = arm.model.inertias[1]
    gyration = math.sqrt(float(np.trace(base.inertia)) / (2.0 * base.mass)) if base.mass else 0.0
    links = sum(float(np.linalg.norm(j.origin.translation)) for j in arm.tree.chain(arm.tip)[1:])
    return max(links, gyration, 1e-3)
