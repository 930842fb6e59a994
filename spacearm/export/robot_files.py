"""An arm as the files of simulators: MJCF for MuJoCo, SDF for Gazebo, Drake and others."""

from __future__ import annotations

import os
from collections.abc import Iterable
from math import isfinite
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from lxml import etree
from lxml.builder import E

from spacearm.description.bodies import Joint, Mimic
from spacearm.description.loops import warn_of_lost_loops
from spacearm.description.readers.mjcf import VELOCITY_LIMIT
from spacearm.description.shapes import TURNED, Box, Cylinder, Mesh, Shape, Sphere
from spacearm.description.urdf_writer import digits
from spacearm.files import write
from spacearm.model.arm import SpaceArm
from spacearm.signatures import checked

DRAWN = {"group": "2", "contype": "0", "conaffinity": "0"}
COLLIDES = {"group": "3"}
#: Elements of an inertia in MJCF's order, by their names in SDF.
PAIRS = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}


@checked
def to_mjcf(arm: SpaceArm, path: str | os.PathLike[str]) -> Path:
    """Write spacecraft and arm as an MJCF file, which MuJoCo simulates and `load` reads.

    The spacecraft has a free joint, there is no gravity, and every joint has a motor of its name,
    limited to the joint's effort. MJCF has no limits of joint rates: they are written as custom
    numbers "velocity_limit/JOINT", which `load` reads and MuJoCo does not enforce. Links that are
    fixed to others are sites of their body. Joints
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

    Warns:
        ModelWarning: Loops of a closed chain are not written.

    Example:
        >>> import spacearm as sa
        >>> path = sa.to_mjcf(sa.load("planar2"), "planar2.xml")
        >>> sa.load(path, tip="tip", task="x y")
        SpaceArm(planar2: 2 joints, 47 kg, tip 'tip', task 'x y')
    """
    bodies = _bodies(arm)
    warn_of_lost_loops(arm.whole, path)
    elements: list[etree._Element] = []
    for body in bodies:
        element = _mjcf_body(body)
        if body.parent is not None:
            elements[body.parent].append(element)
        elements.append(element)
    joints = [body.joint for body in bodies if body.joint]
    document = E.mujoco(
        E.compiler(angle="radian", autolimits="true", inertiafromgeom="false"),
        E.option(gravity="0 0 0"),
        E.worldbody(elements[0]),
        E.equality(*(_mjcf_tie(joint.name, joint.mimic) for joint in joints if joint.mimic)),
        E.actuator(*(_mjcf_motor(joint) for joint in joints if not joint.mimic)),
        E.custom(*(_mjcf_rate(joint) for joint in joints if isfinite(joint.velocity))),
        model=arm.name,
    )
    etree.indent(document)
    return write(Path(path), etree.tostring(document, encoding="utf-8") + b"\n")


@checked
def to_sdf(arm: SpaceArm, path: str | os.PathLike[str]) -> Path:
    """Write spacecraft and arm as an SDF file, which `load` reads.

    Its version is 1.7; with mimic joints it is 1.11, the first that has them. Gravity does not act
    on the links. Links that are fixed to others are frames of their body. Joints that `arm` holds
    or has locked, and wheels, are fixed. Meshes have absolute paths.

    Args:
        arm: The arm.
        path: The file to write.

    Returns:
        The path.

    Raises:
        SpaceArmError: The file cannot be written.

    Warns:
        ModelWarning: Loops of a closed chain are not written.

    Example:
        >>> import spacearm as sa
        >>> path = sa.to_sdf(sa.load("planar2"), "planar2.sdf")
        >>> sa.load(path, tip="tip", task="x y")
        SpaceArm(planar2: 2 joints, 47 kg, tip 'tip', task 'x y')
    """
    bodies = _bodies(arm)
    warn_of_lost_loops(arm.whole, path)
    parts: list[etree._Element] = []
    for body in bodies:
        before = bodies[body.parent].name if body.parent is not None else ""
        parts.append(_sdf_link(body, before))
        parts += [E.frame(_sdf_pose(at), name=link, attached_to=body.name)
                  for link, at in body.frames.items()]  # fmt: skip
        if body.joint:
            parts.append(_sdf_joint(body.joint, before, body.name))
    version = "1.11" if any(body.joint and body.joint.mimic for body in bodies) else "1.7"
    document = E.sdf(E.model(*parts, name=arm.name), version=version)
    etree.indent(document)
    text = etree.tostring(document, xml_declaration=True, encoding="utf-8")
    return write(Path(path), text + b"\n")


class _Body(NamedTuple):
    """A link, and all that is fixed to it.

    Attributes:
        name: The link whose frame it has.
        parent: Number of the body that its joint starts from; None for the spacecraft.
        joint: Its joint; None for the spacecraft.
        pose: Pose of its frame in that of the parent at zero.
        inertia: Its mass, CM and inertia about it.
        frames: Poses of the other links that belong to it, by name.
        visual: What is drawn of all these links, in its frame.
        collision: What collides, likewise.
    """

    name: str
    parent: int | None
    joint: Joint | None
    pose: pin.SE3
    inertia: pin.Inertia
    frames: dict[str, pin.SE3]
    visual: list[Shape]
    collision: list[Shape]


def _bodies(arm: SpaceArm) -> list[_Body]:
    """Return the rigid bodies of an arm, parents first; held and locked joints are fixed."""
    model, tree, found = arm.model, arm.tree, []
    for i in range(1, model.njoints):
        joint = tree.joints[model.names[i]] if i > 1 else None
        links = {
            frame.name: frame.placement
            for frame in model.frames
            if frame.type == pin.BODY and frame.parentJoint == i
        }
        visual, collision = (
            [
                shape._replace(pose=at * shape.pose)
                for link, at in links.items() if link in tree.visuals
                for shape in tree.visuals[link][:2][kind]
            ]
            for kind in range(2)
        )  # fmt: skip
        lead = joint.child if joint else tree.root
        links.pop(lead)
        parent = int(model.parents[i]) - 1 if joint else None
        pose, inertia = model.jointPlacements[i], model.inertias[i]
        found.append(_Body(lead, parent, joint, pose, inertia, links, visual, collision))
    return found


def _mjcf_body(body: _Body) -> etree._Element:
    """Write <body> without its children."""
    element = E.body(**_mjcf_pose(body.pose), name=body.name)
    element.append(E.freejoint() if body.joint is None else _mjcf_joint(body.joint))
    if body.inertia.mass > 0.0:
        six = digits(body.inertia.inertia[pair] for pair in PAIRS.values())
        centre, mass = digits(body.inertia.lever), digits((body.inertia.mass,))
        element.append(E.inertial(pos=centre, mass=mass, fullinertia=six))
    element.extend(E.site(**_mjcf_pose(at), name=link) for link, at in body.frames.items())
    for shapes, options in ((body.visual, DRAWN), (body.collision, COLLIDES)):
        element.extend(
            E.geom(
                **kind, **_mjcf_pose(shape.pose),
                **({"rgba": digits(shape.rgba)} if shape.rgba else {}), **options,
            )
            for shape in shapes
            if (kind := _mjcf_geometry(shape))
        )  # fmt: skip
    return element


def _mjcf_joint(joint: Joint) -> etree._Element:
    """Write <joint>."""
    words = {"type": "slide" if joint.kind == "prismatic" else "hinge", "axis": digits(joint.axis)}
    if isfinite(joint.lower) and isfinite(joint.upper):
        words["range"] = digits((joint.lower, joint.upper))
    words |= _mjcf_effort("actuatorfrcrange", joint)
    for word, value in (("damping", joint.damping), ("frictionloss", joint.friction)):
        words |= {word: digits((value,))} if value else {}
    return E.joint(**words, name=joint.name)


def _mjcf_tie(name: str, mimic: Mimic) -> etree._Element:
    """Write the constraint of a joint that mimics another."""
    polynomial = digits((mimic.offset, mimic.multiplier, 0.0, 0.0, 0.0))
    return E.joint(joint1=name, joint2=mimic.leader, polycoef=polynomial)


def _mjcf_motor(joint: Joint) -> etree._Element:
    """Write the motor of a joint."""
    return E.motor(name=joint.name, joint=joint.name, **_mjcf_effort("ctrlrange", joint))


def _mjcf_rate(joint: Joint) -> etree._Element:
    """Write the limit of the rate of a joint."""
    return E.numeric(name=f"{VELOCITY_LIMIT}{joint.name}", data=digits((joint.velocity,)))


def _mjcf_effort(word: str, joint: Joint) -> dict[str, str]:
    """Return the range of the torques of a joint, if they are limited."""
    return {word: digits((-joint.effort, joint.effort))} if isfinite(joint.effort) else {}


def _mjcf_geometry(shape: Shape) -> dict[str, str] | None:
    """Return type and size of a shape; None for one that is left out."""
    match shape.geometry:
        case Box(size):
            return {"type": "box", "size": digits(0.5 * edge for edge in size)}
        case Sphere(radius):
            return {"type": "sphere", "size": digits((radius,))}
        case Cylinder(radius, length):
            return {"type": "cylinder", "size": digits((radius, 0.5 * length))}
    return None


def _mjcf_pose(pose: pin.SE3) -> dict[str, str]:
    x, y, z, w = pin.Quaternion(pose.rotation).coeffs()
    return {"pos": digits(pose.translation), "quat": digits((w, x, y, z))}


def _sdf_link(body: _Body, before: str) -> etree._Element:
    """Write <link>."""
    link = E.link(_sdf_pose(body.pose, before), E.gravity("false"), name=body.name)
    inertia = body.inertia  # written of massless bodies too: SDF's default is 1 kg
    centre = _sdf_pose(pin.SE3(np.eye(3), inertia.lever))
    entries = (_number(name, inertia.inertia[PAIRS[name]]) for name in sorted(PAIRS))
    link.append(E.inertial(centre, _number("mass", inertia.mass), E.inertia(*entries)))
    for kind, shapes in (("visual", body.visual), ("collision", body.collision)):
        for i, shape in enumerate(shapes):
            link.extend(_sdf_shape(kind, shape, f"{kind}_{i}"))  # a name of its own in the link
    return link


def _sdf_joint(joint: Joint, parent: str, child: str) -> etree._Element:
    """Write <joint>."""
    names = ("lower", "upper", "effort", "velocity")
    limits = ((name, getattr(joint, name)) for name in names)
    limit = E.limit(*(_number(name, x) for name, x in limits if isfinite(x)))
    resists = (("damping", joint.damping), ("friction", joint.friction))
    dynamics = E.dynamics(*(_number(name, x) for name, x in resists if x))
    axis = E.axis(E.xyz(digits(joint.axis)), *(part for part in (limit, dynamics) if len(part)))
    if joint.mimic:
        leader, multiplier, offset = joint.mimic
        numbers = _number("multiplier", multiplier), _number("offset", offset)
        axis.append(E.mimic(*numbers, E.reference("0"), joint=leader))
    kind = "prismatic" if joint.kind == "prismatic" else "revolute"
    return E.joint(E.parent(parent), E.child(child), axis, name=joint.name, type=kind)


def _sdf_shape(kind: str, shape: Shape, name: str) -> Iterable[etree._Element]:
    """Write <visual> or <collision>; nothing for a shape that cannot be used."""
    match shape.geometry:
        case Box(size):
            geometry = E.box(E.size(digits(size)))
        case Sphere(radius):
            geometry = E.sphere(_number("radius", radius))
        case Cylinder(radius, length):
            geometry = E.cylinder(_number("radius", radius), _number("length", length))
        case Mesh(_, Path() as file, scale, turned):
            mark = {TURNED: "true"} if turned else {}
            geometry = E.mesh(E.uri(file.as_uri()), E.scale(digits(scale)), **mark)
        case _:
            return
    made = E(kind, _sdf_pose(shape.pose), E.geometry(geometry), name=name)
    if shape.rgba and kind == "visual":
        made.append(E.material(E.ambient(digits(shape.rgba)), E.diffuse(digits(shape.rgba))))
    yield made


def _sdf_pose(pose: pin.SE3, relative_to: str = "") -> etree._Element:
    words = {"relative_to": relative_to} if relative_to else {}
    return E.pose(digits((*pose.translation, *pin.rpy.matrixToRpy(pose.rotation))), **words)


def _number(name: str, value: float) -> etree._Element:
    """Write an element that holds a number."""
    return E(name, digits((value,)))
