"""URDF writer: a tree of links and joints as URDF, the inverse of `urdf.read`."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable

import pinocchio as pin
from lxml import etree
from lxml.builder import E

from spacearm.description import shapes
from spacearm.description.bodies import Inertial, Joint
from spacearm.description.tree import Tree

#: Written for no limit on one side: URDF takes a missing one as 0, and readers know no infinity.
NO_LIMIT = sys.float_info.max


def document(tree: Tree, tips: tuple[str, ...]) -> bytes:
    """Write a tree as URDF, numbers with all their digits.

    Other readers ignore these extensions: <tip link> names a tip; <wheel> in a joint makes it the
    axle of a momentum wheel, <home> gives its home; turned="true" marks a mesh as `shapes.TURNED`.

    Args:
        tree: The tree.
        tips: Names of its tips.
    """
    links = [_link(tree, name) for name in tree.links]
    joints = [_joint(joint) for joint in tree.joints.values()]
    robot = E.robot(*(E.tip(link=tip) for tip in tips), *links, *joints, name=tree.name)
    etree.indent(robot)
    return etree.tostring(robot, xml_declaration=True, encoding="utf-8") + b"\n"


def _link(tree: Tree, name: str) -> etree._Element:
    given = tree.visuals.get(name, shapes.Visuals())
    inertial = tree.links[name]
    return E.link(
        *([_inertial(inertial)] if inertial else []),
        *(_shape(E.visual, shape) for shape in given.visual),
        *(_shape(E.collision, shape) for shape in given.collision),
        name=name,
    )


def _shape(element: Callable[..., etree._Element], shape: shapes.Shape) -> etree._Element:
    """Write <visual> or <collision>; a material is named after its colour."""
    parts = [_origin(shape.pose), _geometry(shape.geometry)]
    if shape.rgba:
        rgba = digits(shape.rgba)
        parts.append(E.material(E.color(rgba=rgba), name=rgba))
    return element(*parts)


def _geometry(geometry: shapes.Geometry) -> etree._Element:
    """Write <geometry>; an empty one, which cannot be used either, for an unusable one."""
    match geometry:
        case shapes.Box(size):
            return E.geometry(E.box(size=digits(size)))
        case shapes.Sphere(radius):
            return E.geometry(E.sphere(radius=repr(radius)))
        case shapes.Cylinder(radius, length):
            return E.geometry(E.cylinder(radius=repr(radius), length=repr(length)))
        case shapes.Mesh(name, file, scale, turned):
            mark = {shapes.TURNED: "true"} if turned else {}
            return E.geometry(E.mesh(filename=str(file or name), scale=digits(scale), **mark))
        case shapes.Unusable():
            return E.geometry()


def _inertial(inertial: Inertial) -> etree._Element:
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    entries = {f"i{'xyz'[i]}{'xyz'[j]}": repr(float(inertial.inertia[i, j])) for i, j in pairs}
    mass = E.mass(value=repr(float(inertial.mass)))
    return E.inertial(_origin(inertial.origin), mass, E.inertia(**entries))


def _joint(joint: Joint) -> etree._Element:
    """Write <joint>; a turning one without limits as "continuous"."""
    limited = joint.kind != "wheel" and min(-joint.lower, joint.upper) < math.inf
    turns = joint.kind in ("revolute", "wheel")
    element = E.joint(
        E.parent(link=joint.parent),
        E.child(link=joint.child),
        _origin(joint.origin),
        name=joint.name,
        type="continuous" if turns and not limited else joint.kind,
    )
    if joint.kind == "wheel":
        element.append(E.wheel())
    if joint.home:
        element.append(E.home(value=repr(float(joint.home))))
    if joint.kind != "fixed":
        element.append(E.axis(xyz=digits(joint.axis)))
        ends = (max(joint.lower, -NO_LIMIT), min(joint.upper, NO_LIMIT)) if limited else ()
        limits = dict(zip(("lower", "upper"), ends, strict=False))
        most = {"effort": joint.effort, "velocity": joint.velocity}
        limits |= {name: x for name, x in most.items() if math.isfinite(x)}
        if limits:
            element.append(E.limit(**{name: repr(float(x)) for name, x in limits.items()}))
        resists = {name: repr(float(getattr(joint, name))) for name in ("damping", "friction")}
        if joint.damping or joint.friction:
            element.append(E.dynamics(**resists))
    if mimic := joint.mimic:
        numbers = {"multiplier": repr(mimic.multiplier), "offset": repr(mimic.offset)}
        element.append(E.mimic(joint=mimic.leader, **numbers))
    return element


def _origin(pose: pin.SE3) -> etree._Element:
    return E.origin(xyz=digits(pose.translation), rpy=digits(pin.rpy.matrixToRpy(pose.rotation)))


def digits(values: Iterable[float]) -> str:
    """Write numbers with all their digits."""
    return " ".join(repr(float(value)) for value in values)
