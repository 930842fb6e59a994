"""Writer: a tree of links and joints as URDF, the inverse of `urdf.read`."""

from __future__ import annotations

import math

from lxml import etree
from lxml.builder import E

from spacearm.description.bodies import Inertial, Joint
from spacearm.description.tree import Tree
from spacearm.description.visuals import origin, text


def document(tree: Tree, tips: tuple[str, ...]) -> bytes:
    """The URDF of a tree, numbers with all their digits.

    What URDF has no word for is in elements that other readers ignore: <tip link> names the tips,
    <wheel> in a joint says that it is none of the arm's.
    """
    links = [_link(tree, name) for name in tree.links]
    joints = [_joint(joint) for joint in tree.joints.values()]
    robot = E.robot(*(E.tip(link=tip) for tip in tips), *links, *joints, name=tree.name)
    etree.indent(robot)
    return etree.tostring(robot, xml_declaration=True, encoding="utf-8") + b"\n"


def _link(tree: Tree, name: str) -> etree._Element:
    link = etree.fromstring(tree.looks[name]) if name in tree.looks else E.link(name=name)
    if inertial := tree.links[name]:
        link.insert(0, _inertial(inertial))
    return link


def _inertial(inertial: Inertial) -> etree._Element:
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    entries = {f"i{'xyz'[i]}{'xyz'[j]}": repr(float(inertial.inertia[i, j])) for i, j in pairs}
    mass = E.mass(value=repr(float(inertial.mass)))
    return E.inertial(origin(inertial.origin), mass, E.inertia(**entries))


def _joint(joint: Joint) -> etree._Element:
    """<joint>; a turning one without limits is a continuous one."""
    unlimited = math.isinf(joint.lower) and joint.kind in ("revolute", "wheel")
    element = E.joint(
        E.parent(link=joint.parent),
        E.child(link=joint.child),
        origin(joint.origin),
        name=joint.name,
        type="continuous" if unlimited else joint.kind,
    )
    if joint.kind == "wheel":
        element.append(E.wheel())
    if joint.kind != "fixed":
        element.append(E.axis(xyz=text(joint.axis)))
        names = ("lower", "upper", "effort", "velocity")
        limits = {name: getattr(joint, name) for name in names}
        finite = {name: repr(float(x)) for name, x in limits.items() if math.isfinite(x)}
        if finite:
            element.append(E.limit(**finite))
    if mimic := joint.mimic:
        numbers = {"multiplier": repr(mimic.multiplier), "offset": repr(mimic.offset)}
        element.append(E.mimic(joint=mimic.leader, **numbers))
    return element
