"""An arm as an MJCF file, for MuJoCo."""

from __future__ import annotations

import os
from collections.abc import Iterable
from math import isfinite
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree
from lxml.builder import E

from spacearm.description.bodies import Joint, Mimic
from spacearm.description.visuals import Box, Cylinder, Shape, Sphere
from spacearm.export.rigid_bodies import RigidBody, rigid_bodies
from spacearm.files import write
from spacearm.model.arguments import of_arm
from spacearm.model.arm import SpaceArm

DRAWN = {"group": "2", "contype": "0", "conaffinity": "0"}
COLLIDES = {"group": "3"}


@of_arm
def to_mjcf(arm: SpaceArm, path: str | os.PathLike[str]) -> Path:
    """Write spacecraft and arm as an MJCF file, which MuJoCo simulates and `load` reads.

    The spacecraft has a free joint, there is no gravity, and every joint has a motor of its name,
    limited to the joint's effort. Links that are fixed to others are sites of their body. Joints
    that `arm` holds or has locked, and wheels, are fixed. Joints that mimic others are tied to them
    by an equality constraint, which MuJoCo keeps approximately. Meshes are left out, boxes,
    cylinders and spheres written. MuJoCo refuses moving bodies without mass, and inertias that no
    rigid body can have.

    Args:
        arm: The arm.
        path: The file to write.

    Returns:
        The path.

    Raises:
        SpaceArmError: The file cannot be written.

    Example:
        >>> import spacearm as sa
        >>> path = sa.to_mjcf(sa.load("planar2"), "planar2.xml")
        >>> sa.load(path, tip="tip", task="x y")
        SpaceArm(planar2: 2 joints, 47 kg, tip 'tip', task 'x y')
    """
    bodies = rigid_bodies(arm)
    elements: list[etree._Element] = []
    for body in bodies:
        element = _body(body)
        if body.parent is not None:
            elements[body.parent].append(element)
        elements.append(element)
    joints = [body.joint for body in bodies if body.joint]
    document = E.mujoco(
        E.compiler(angle="radian", autolimits="true", inertiafromgeom="false"),
        E.option(gravity="0 0 0"),
        E.worldbody(elements[0]),
        E.equality(*(_tie(joint.name, joint.mimic) for joint in joints if joint.mimic)),
        E.actuator(*(_motor(joint) for joint in joints if not joint.mimic)),
        model=arm.name,
    )
    etree.indent(document)
    return write(Path(path), etree.tostring(document, encoding="utf-8") + b"\n")


def _body(body: RigidBody) -> etree._Element:
    """Write <body> without its children."""
    element = E.body(**_pose(body.pose), name=body.name)
    element.append(E.freejoint() if body.joint is None else _joint(body.joint))
    if body.inertia.mass > 0.0:
        I = body.inertia.inertia
        six = (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
        centre = _text(body.inertia.lever)
        mass = repr(float(body.inertia.mass))
        element.append(E.inertial(pos=centre, mass=mass, fullinertia=_text(six)))
    element.extend(E.site(**_pose(at), name=link) for link, at in body.frames.items())
    for shapes, options in ((body.visual, DRAWN), (body.collision, COLLIDES)):
        element.extend(
            E.geom(**kind, **_pose(shape.pose), **_colour(shape), **options)
            for shape in shapes
            if (kind := _geometry(shape))
        )
    return element


def _joint(joint: Joint) -> etree._Element:
    """Write <joint>."""
    words = {"type": "slide" if joint.kind == "prismatic" else "hinge", "axis": _text(joint.axis)}
    if isfinite(joint.lower) and isfinite(joint.upper):
        words["range"] = _text((joint.lower, joint.upper))
    if isfinite(joint.effort):
        words["actuatorfrcrange"] = _text((-joint.effort, joint.effort))
    if joint.damping:
        words["damping"] = repr(float(joint.damping))
    if joint.friction:
        words["frictionloss"] = repr(float(joint.friction))
    return E.joint(**words, name=joint.name)


def _tie(name: str, mimic: Mimic) -> etree._Element:
    """Write the constraint of a joint that mimics another."""
    polynomial = _text((mimic.offset, mimic.multiplier, 0.0, 0.0, 0.0))
    return E.joint(joint1=name, joint2=mimic.leader, polycoef=polynomial)


def _motor(joint: Joint) -> etree._Element:
    """Write the motor of a joint."""
    limited = isfinite(joint.effort)
    limits = {"ctrlrange": _text((-joint.effort, joint.effort))} if limited else {}
    return E.motor(name=joint.name, joint=joint.name, **limits)


def _geometry(shape: Shape) -> dict[str, str] | None:
    """Return type and size of a shape; None for one that is left out."""
    match shape.geometry:
        case Box(size):
            return {"type": "box", "size": _text(0.5 * edge for edge in size)}
        case Sphere(radius):
            return {"type": "sphere", "size": repr(float(radius))}
        case Cylinder(radius, length):
            return {"type": "cylinder", "size": _text((radius, 0.5 * length))}
    return None


def _colour(shape: Shape) -> dict[str, str]:
    return {"rgba": _text(shape.rgba)} if shape.rgba else {}


def _pose(pose: pin.SE3) -> dict[str, str]:
    x, y, z, w = pin.Quaternion(pose.rotation).coeffs()
    return {"pos": _text(pose.translation), "quat": _text((w, x, y, z))}


def _text(values: Iterable[float] | np.ndarray) -> str:
    """Write numbers with all their digits."""
    return " ".join(repr(float(value)) for value in values)
