"""URDF reader: a URDF read and checked, so that Pinocchio gets a sound model.

Links with their inertials, joints and visuals are read, extensions are ignored. Nothing is repaired
in silence: a fault raises a `ModelError` that names file, element, value and remedy; an oddity
gives a `ModelWarning`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from lxml import etree

from spacearm.arrays import LARGEST, LEAST_MASS
from spacearm.description.bodies import Inertial, Joint, Mimic
from spacearm.description.readers.forest import check_mimics
from spacearm.description.readers.masses import checked
from spacearm.description.readers.source import Reading, Source, describe, evaluate
from spacearm.description.shapes import (
    Box,
    Cylinder,
    Geometry,
    Mesh,
    Shape,
    Sphere,
    Unusable,
    Visuals,
    capsule,
)
from spacearm.description.tree import Tree
from spacearm.errors import ModelError, listed, unknown

KINDS = ("revolute", "continuous", "prismatic", "fixed")
FLOATING = ("floating", "planar")
"""Joints that only a spacecraft has; those above it are left out, for it floats by itself."""


def read(path: str | os.PathLike[str], reading: Reading | None = None) -> Tree:
    """Read and check a URDF.

    Args:
        path: The file.
        reading: How it is read.

    Returns:
        The tree; its notes say what was assumed.

    Raises:
        ModelError: The file has a fault; the message names file, element, value and remedy.

    Warns:
        ModelWarning: Something was assumed; each warning is a note too.
    """
    reading = reading or Reading()
    source = Source(Path(path), reading)
    robot = _robot(source)
    links = {name: _inertial(source, e) for name, e in source.named(robot, "link").items()}
    if not links:
        source.fail("has no links", "describe the spacecraft and its arm by <link> and <joint>")
    joints = {name: _joint(source, e, links) for name, e in source.named(robot, "joint").items()}
    links, joints = _without_world(source, links, joints)
    check_mimics(source, joints)
    warn_of_limits(source, robot, joints)
    tree = Tree(
        name=robot.get("name") or source.path.name.partition(".")[0],
        root=_root(source, links, joints),
        links=links,
        joints=joints,
        visuals=read_visuals(source, robot),
        tips=tuple(_named_link(source, tip, links) for tip in robot.findall("tip")),
    )
    tree = checked(source, tree)
    return replace(tree, notes=tuple(source.notes))


def _robot(source: Source) -> etree._Element:
    """Return the root element of a URDF; a xacro source is expanded."""
    robot = source.root()
    if source.path.suffix == ".xacro" or _in_xacro(robot):
        from spacearm.description.readers.xacro import expanded  # slow to import

        robot = expanded(source, robot)
    if robot.tag != "robot":
        source.fail(
            f"is not a URDF: its root element is <{robot.tag!s}>",
            "a URDF starts with <robot name='...'>, and only URDF may be in xacro here",
        )
    return robot


def _in_xacro(root: etree._Element) -> bool:
    """Whether a document has elements for xacro, whose namespace has had several addresses."""
    return any(
        element.prefix == "xacro" or "/xacro" in (etree.QName(element).namespace or "")
        for element in root.iter(etree.Element)
    )


# --- links and joints -----------------------------------------------------------------------


def _inertial(source: Source, link: etree._Element) -> Inertial | None:
    element = source.child(link, "inertial")
    if element is None:
        return None
    mass, inertia = source.child(element, "mass"), source.child(element, "inertia")
    if mass is None or inertia is None:
        missing = "mass" if mass is None else "inertia"
        source.fail(f"{describe(element)} has no <{missing}>", f"add <{missing} .../>")
    m = source.number(mass, "value")
    if m < 0.0 or 0.0 < m < LEAST_MASS:
        source.fail(f"{describe(mass)} is {m:g} kg", f"give a mass of at least {LEAST_MASS:g} kg")
    products = ("ixy", "ixz", "iyz")
    none = "0" if not any(name in inertia.attrib for name in products) else None
    xy, xz, yz = (source.number(inertia, name, none) for name in products)
    xx, yy, zz = (source.number(inertia, name) for name in ("ixx", "iyy", "izz"))
    return Inertial(m, source.pose(element), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def _joint(source: Source, element: etree._Element, links: Collection[str]) -> Joint:
    name, kind = element.get("name", ""), element.get("type", "").strip().lower()
    if kind not in (*KINDS, *FLOATING):
        given = element.get("type", "")
        source.fail(f"joint {name!r} has type {given!r}", f"use one of {', '.join(KINDS)}")
    parent, child = (_end(source, element, end, links) for end in ("parent", "child"))
    if source.child(element, "wheel") is not None:
        if kind not in ("revolute", "continuous"):
            source.fail(f"joint {name!r} of type {kind!r} is a <wheel>", "make it continuous")
        kind = "wheel"
    axis = source.child(element, "axis")
    direction = np.array([1.0, 0.0, 0.0]) if axis is None else source.numbers(axis, "xyz", 3)
    length = float(np.linalg.norm(direction))
    if kind in FLOATING:
        direction = np.array([1.0, 0.0, 0.0])
    elif kind != "fixed":
        if length < 1e-12:
            source.fail(f"joint {name!r} has a zero axis", "give the direction it moves along")
        direction = direction / length
    limits, mimic = read_limits(source, element, kind), _mimic(source, element, kind)
    joint = Joint(name, kind, parent, child, source.pose(element), direction, *limits, mimic)
    if not joint.movable:
        return joint
    damping, friction = read_dynamics(source, element)
    return replace(joint, damping=damping, friction=friction)


def _end(source: Source, joint: etree._Element, end: str, links: Collection[str]) -> str:
    element = source.child(joint, end)
    if element is None:
        source.fail(f"joint {joint.get('name')!r} has no <{end}>", f"add <{end} link='...'/>")
    return _named_link(source, element, links)


def _named_link(source: Source, element: etree._Element, links: Collection[str]) -> str:
    link = element.get("link", "")
    if link not in links:
        joint = element.getparent()
        owner = "" if joint is None or joint.tag != "joint" else f" of joint {joint.get('name')!r}"
        source.fail(f"{element.tag!s}{owner}: {unknown('link', link, links)}", "name one")
    return link


def _mimic(source: Source, joint: etree._Element, kind: str) -> Mimic | None:
    mimic = source.child(joint, "mimic")
    if mimic is None or kind == "fixed":
        return None
    multiplier, offset = (
        source.number(mimic, "multiplier", "1"),
        source.number(mimic, "offset", "0"),
    )
    return Mimic(mimic.get("joint", ""), multiplier, offset)


# --- the whole ------------------------------------------------------------------------------


def _root(source: Source, links: Collection[str], joints: Mapping[str, Joint]) -> str:
    """Find the one link without a parent, and check that every other is reached in one way."""
    into: dict[str, Joint] = {}
    for joint in joints.values():
        if other := into.get(joint.child):
            source.fail(
                f"link {joint.child!r} closes a loop: joints {other.name!r} and {joint.name!r} "
                "both lead to it",
                "cut the loop at one of them",
            )
        into[joint.child] = joint
    roots = [link for link in links if link not in into]
    if len(roots) > 1:
        source.fail(
            f"has {len(roots)} root links ({listed(roots)})",
            "join them to one spacecraft by fixed joints",
        )
    children: dict[str, list[str]] = {link: [] for link in links}
    for joint in joints.values():
        children[joint.parent].append(joint.child)
    reached, waiting = set(roots), list(roots)
    while waiting:
        waiting += (more := children[waiting.pop()])
        reached.update(more)
    if stray := [link for link in links if link not in reached]:
        source.fail(f"links {listed(stray)} form a loop", "cut it at one joint")
    return roots[0]


def _without_world(
    source: Source, links: dict[str, Inertial | None], joints: dict[str, Joint]
) -> tuple[dict[str, Inertial | None], dict[str, Joint]]:
    """Leave out a frame that the spacecraft floats in, and the joint that it floats by."""
    floating = [joint for joint in joints.values() if joint.kind in FLOATING]
    for joint in floating:
        beside = [j for j in joints.values() if joint.parent in (j.parent, j.child)]
        if links[joint.parent] is not None or beside != [joint]:
            source.fail(
                f"joint {joint.name!r} is of type {joint.kind!r}, a freedom that only the "
                "spacecraft has",
                "leave it out above the spacecraft, whose root link floats by itself; elsewhere "
                "replace it by revolute and prismatic joints",
            )
        source.warn(
            f"joint {joint.name!r} of type {joint.kind!r} and the link {joint.parent!r} are left "
            f"out: the spacecraft {joint.child!r} floats by itself"
        )
        links = {name: part for name, part in links.items() if name != joint.parent}
        joints = {name: j for name, j in joints.items() if j is not joint}
    return links, joints


def read_visuals(source: Source, robot: etree._Element) -> dict[str, Visuals]:
    """Return the shapes of every link that has any.

    Args:
        source: The file.
        robot: Its root element.

    Warns:
        ModelWarning: Mesh files are missing; one warning for all.
    """
    reader = _Reader(source, robot)
    shapes = {link.get("name", ""): reader.visuals(link) for link in robot.findall("link")}
    source.warn_of_missing_meshes()
    return {link: found for link, found in shapes.items() if any(found)}


class _Reader:
    """The shapes of one robot, and the mesh files that they name."""

    def __init__(self, source: Source, robot: etree._Element) -> None:
        self._source = source
        self._materials = {m.get("name"): m for m in robot.findall("material")}

    def visuals(self, link: etree._Element) -> Visuals:
        """Return the shapes of a <link>."""
        visual, collision = (
            tuple(shape for element in link.findall(tag) for shape in self._shapes(element))
            for tag in ("visual", "collision")
        )
        return Visuals(visual, collision)

    def _shapes(self, element: etree._Element) -> tuple[Shape, ...]:
        """Read a <visual> or <collision>."""
        try:
            pose, rgba = self._source.pose(element), self._rgba(element)
            if (round_ended := element.find("geometry/capsule")) is not None:
                lengths = (self._source.lengths(round_ended, n, 1) for n in ("radius", "length"))
                radius, length = (value.item() for value in lengths)
                return capsule(pose, radius, length, rgba)
            return (Shape(pose, self._geometry(element), rgba),)
        except ModelError as error:
            return (Shape(pin.SE3.Identity(), Unusable(str(error))),)

    def _geometry(self, parent: etree._Element) -> Geometry:
        source, element = self._source, parent.find("geometry/*")
        # a collision body without extension would be far from everything
        lengths = source.lengths if parent.tag == "collision" else source.numbers
        kind = "" if element is None else element.tag
        if element is not None and kind == "box":
            return Box(tuple(lengths(element, "size", 3).tolist()))
        if element is not None and kind == "sphere":
            return Sphere(lengths(element, "radius", 1).item())
        if element is not None and kind == "cylinder":
            radius, length = (lengths(element, name, 1).item() for name in ("radius", "length"))
            return Cylinder(radius, length)
        if element is not None and kind == "mesh":
            name = element.get("filename", "")
            scale = source.numbers(element, "scale", 3, "1 1 1")
            return Mesh(name, source.mesh(name), tuple(scale.tolist()))
        link = parent.getparent()
        owner = "" if link is None else link.get("name", "")
        source.fail(
            f"link {owner!r} has a {parent.tag!s} without a known geometry",
            "give it a box, sphere, cylinder, capsule or mesh",
        )

    def _rgba(self, parent: etree._Element) -> tuple[float, ...] | None:
        """Read the colour of a <visual>: its own, or that of the robot's material it names."""
        material = parent.find("material")
        if material is not None and len(material) == 0:
            material = self._materials.get(material.get("name"))
        color = None if material is None else material.find("color")
        return None if color is None else tuple(self._source.numbers(color, "rgba", 4).tolist())


INFINITE = ("", "inf", "infinity", ".inf")
MANY_TURNS = 30.0
"""Angle [rad] beyond which a limit looks like one in degrees."""


class Limits(NamedTuple):
    """Limits of a joint, infinite where there is none.

    Attributes:
        lower: Least angle [rad] or displacement [m].
        upper: Largest angle [rad] or displacement [m].
        velocity: Largest rate [rad/s] or [m/s].
        effort: Largest torque [N m] or force [N].
    """

    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf


def read_limits(source: Source, joint: etree._Element, kind: str) -> Limits:
    """Read the limits of a joint; URDF takes a missing lower or upper one as 0.

    A range from 0 to 0 and a rate or an effort of 0 are what exporters write where they know
    nothing: no limits. See `warn_of_limits`.

    Args:
        source: The file.
        joint: Its <joint>.
        kind: As in `Joint`.

    Raises:
        ModelError: They are not numbers, negative or reversed.
    """
    limit = source.child(joint, "limit")
    if limit is None or kind not in ("revolute", "continuous", "prismatic", "wheel"):
        return Limits()
    velocity, effort = (_bound(source, limit, name) or math.inf for name in ("velocity", "effort"))
    if min(velocity, effort) < 0.0:
        source.fail(
            f"{describe(limit)} has velocity {velocity:g} and effort {effort:g}",
            "give positive numbers",
        )
    unlimited = Limits(velocity=velocity, effort=effort)
    if kind in ("continuous", "wheel") or not (limit.get("lower") or limit.get("upper")):
        return unlimited
    lower, upper = (_bound(source, limit, name, "0", sign) for name, sign in ENDS)
    if lower > upper:
        source.fail(
            f"{describe(limit)} is reversed (lower {lower:g}, upper {upper:g})",
            "exchange the two (a missing one counts as 0)",
        )
    return unlimited if lower == upper == 0.0 else unlimited._replace(lower=lower, upper=upper)


ENDS = (("lower", -1.0), ("upper", 1.0))


def _bound(
    source: Source, limit: etree._Element, name: str, default: str = "inf", sign: float = 1.0
) -> float:
    """Read one number of a <limit>; one too large to be meant is infinite."""
    text = limit.get(name, default).strip().lower()
    if text.lstrip("+-") in INFINITE:
        return -math.inf if text.startswith("-") else sign * math.inf
    try:
        huge = abs(float(text)) > LARGEST
    except ValueError:
        huge = False
    return math.copysign(math.inf, float(text)) if huge else source.number(limit, name, default)


def read_dynamics(source: Source, joint: etree._Element) -> tuple[float, float]:
    """Read the damping and the dry friction of a joint; what is not a number from 0 on is not one.

    Args:
        source: The file, which is warned.
        joint: Its <joint>.
    """
    dynamics, found = joint.find("dynamics"), [0.0, 0.0]
    for i, name in enumerate(("damping", "friction")):
        text = "" if dynamics is None else dynamics.get(name, "").strip()
        if not text:
            continue
        value = evaluate(text)
        if value is not None and 0.0 <= value <= LARGEST:
            found[i] = value
        else:
            source.warn(f"{name}={text[:60]!r} of joint {joint.get('name')!r} is taken as none")
    return found[0], found[1]


def warn_of_limits(source: Source, robot: etree._Element, joints: Mapping[str, Joint]) -> None:
    """Warn of limits that are missing, that are not used or that look like degrees.

    Args:
        source: The file.
        robot: Its root element.
        joints: Its joints, read.
    """
    given = {e.get("name", ""): e.find("limit") for e in robot.findall("joint")}
    kinds = ("revolute", "prismatic")
    free = [j.name for j in joints.values() if j.kind in kinds and _endless(j)]
    if free:
        source.warn(f"no limits on {listed(free)}: taken as unlimited")
    turning = [
        name
        for name, limit in given.items()
        if limit is not None and (limit.get("lower") or limit.get("upper"))
        if name in joints and joints[name].kind == "continuous" and joints[name].mimic is None
    ]
    if turning:
        source.note(f"limits of {listed(turning)} do not count, as for all continuous joints")
    for end, what in (("velocity", "rate"), ("effort", "effort")):
        zero = [
            name
            for name, limit in given.items()
            if limit is not None and name in joints and joints[name].movable
            if limit.get(end) and math.isinf(getattr(joints[name], end))
            if limit.get(end, "").strip().lower().lstrip("+-") not in INFINITE
        ]
        if zero:
            source.note(f"{what} limit of {listed(zero)} is zero or endless: taken as none")
    far = [
        j.name
        for j in joints.values()
        if j.kind == "revolute" and any(MANY_TURNS < abs(x) < math.inf for x in (j.lower, j.upper))
    ]
    if far:
        source.warn(f"limits of {listed(far)} look like degrees, and are taken as radians")


def _endless(joint: Joint) -> bool:
    return math.isinf(joint.lower) and math.isinf(joint.upper)
