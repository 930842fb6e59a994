"""An arm as an SDF file, for Gazebo, Drake and others."""

from __future__ import annotations

import os
from collections.abc import Iterable
from math import isfinite
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree
from lxml.builder import E

from spacearm.description.bodies import Joint
from spacearm.description.visuals import Box, Cylinder, Mesh, Shape, Sphere
from spacearm.export.rigid_bodies import RigidBody, rigid_bodies
from spacearm.files import write
from spacearm.model.arguments import of_arm
from spacearm.model.arm import SpaceArm


@of_arm
def to_sdf(arm: SpaceArm, path: str | os.PathLike[str]) -> Path:
    """Write spacecraft and arm as an SDF file, which `load` reads.

    Its version is 1.7, or 1.11, the first with mimic joints, if there are any.
    Gravity does not act on the links. Links that are fixed to others are frames of their body.
    Joints that `arm` holds or has locked, and wheels, are fixed. Meshes have absolute paths.

    Args:
        arm: The arm.
        path: The file to write.

    Returns:
        The path.

    Raises:
        SpaceArmError: The file cannot be written.

    Example:
        >>> import spacearm as sa
        >>> path = sa.to_sdf(sa.load("planar2"), "planar2.sdf")
        >>> sa.load(path, tip="tip", task="x y")
        SpaceArm(planar2: 2 joints, 47 kg, tip 'tip', task 'x y')
    """
    bodies = rigid_bodies(arm)
    parts: list[etree._Element] = []
    for body in bodies:
        before = bodies[body.parent].name if body.parent is not None else ""
        parts += [_link(body, before), *_frames(body)]
        if body.joint:
            parts.append(_joint(body.joint, before, body.name))
    version = "1.11" if any(body.joint and body.joint.mimic for body in bodies) else "1.7"
    document = E.sdf(E.model(*parts, name=arm.name), version=version)
    etree.indent(document)
    return write(
        Path(path), etree.tostring(document, xml_declaration=True, encoding="utf-8") + b"\n"
    )


def _link(body: RigidBody, before: str) -> etree._Element:
    """Write <link>."""
    link = E.link(_pose(body.pose, before), E.gravity("false"), name=body.name)
    I = body.inertia.inertia  # written of massless bodies too: SDF's default is 1 kg
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    entries = (E(f"i{'xyz'[i]}{'xyz'[j]}", repr(float(I[i, j]))) for i, j in pairs)
    centre = _pose(pin.SE3(np.eye(3), body.inertia.lever))
    mass = E.mass(repr(float(body.inertia.mass)))
    link.append(E.inertial(centre, mass, E.inertia(*entries)))
    for kind, shapes in (("visual", body.visual), ("collision", body.collision)):
        for i, shape in enumerate(shapes):
            link.extend(_shape(kind, shape, f"{kind}_{i}"))  # a name of its own in the link
    return link


def _frames(body: RigidBody) -> list[etree._Element]:
    """Write the frames of the other links of a body."""
    frames = body.frames.items()
    return [E.frame(_pose(at), name=link, attached_to=body.name) for link, at in frames]


def _joint(joint: Joint, parent: str, child: str) -> etree._Element:
    """Write <joint>."""
    limits = (("lower", joint.lower), ("upper", joint.upper), ("effort", joint.effort),
              ("velocity", joint.velocity))  # fmt: skip
    limit = E.limit(*(E(name, repr(float(x))) for name, x in limits if isfinite(x)))
    resists = (("damping", joint.damping), ("friction", joint.friction))
    dynamics = E.dynamics(*(E(name, repr(float(x))) for name, x in resists if x))
    axis = E.axis(E.xyz(_text(joint.axis)), *(part for part in (limit, dynamics) if len(part)))
    if joint.mimic:
        multiplier = E.multiplier(repr(joint.mimic.multiplier))
        offset, reference = E.offset(repr(joint.mimic.offset)), E.reference("0")
        axis.append(E.mimic(multiplier, offset, reference, joint=joint.mimic.leader))
    kind = "prismatic" if joint.kind == "prismatic" else "revolute"
    return E.joint(E.parent(parent), E.child(child), axis, name=joint.name, type=kind)


def _shape(kind: str, shape: Shape, name: str) -> Iterable[etree._Element]:
    """Write <visual> or <collision>; nothing for a shape that cannot be used."""
    match shape.geometry:
        case Box(size):
            geometry = E.box(E.size(_text(size)))
        case Sphere(radius):
            geometry = E.sphere(E.radius(repr(float(radius))))
        case Cylinder(radius, length):
            geometry = E.cylinder(E.radius(repr(float(radius))), E.length(repr(float(length))))
        case Mesh(_, Path() as file, scale):
            geometry = E.mesh(E.uri(file.as_uri()), E.scale(_text(scale)))
        case _:
            return
    made = E(kind, _pose(shape.pose), E.geometry(geometry), name=name)
    if shape.rgba and kind == "visual":
        made.append(E.material(E.ambient(_text(shape.rgba)), E.diffuse(_text(shape.rgba))))
    yield made


def _pose(pose: pin.SE3, relative_to: str = "") -> etree._Element:
    words = {"relative_to": relative_to} if relative_to else {}
    return E.pose(_text((*pose.translation, *pin.rpy.matrixToRpy(pose.rotation))), **words)


def _text(values: Iterable[float]) -> str:
    """Write numbers with all their digits."""
    return " ".join(repr(float(value)) for value in values)
