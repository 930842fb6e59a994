"""URDF reader: a URDF read and checked, so that Pinocchio gets a sound model.

Links with their inertials, joints and visuals are read, extensions are ignored. Nothing is repaired
in silence: a fault raises a `ModelError` that names file, element, value and remedy; an oddity
gives a `ModelWarning`.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from lxml import etree

from spacearm.arrays import LEAST_MASS
from spacearm.description.bodies import Inertial, Joint, Mimic
from spacearm.description.readers.limits import read_dynamics, read_limits, warn_of_limits
from spacearm.description.readers.masses import checked
from spacearm.description.readers.mimics import check_mimics
from spacearm.description.readers.reading import Reading
from spacearm.description.readers.urdf_visuals import read_visuals
from spacearm.description.readers.xml import Source, describe
from spacearm.description.tree import Tree
from spacearm.errors import listed, unknown

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
        from spacearm.description.readers.xacro.robot import expanded  # slow to import

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
