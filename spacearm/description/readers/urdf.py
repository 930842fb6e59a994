"""URDF reader: a URDF read and checked, so that Pinocchio gets a sound model.

Links with their inertials, joints and visuals are read, extensions are ignored. Nothing is repaired
in silence: a fault raises a `ModelError` that names file, element, value and remedy; an oddity
gives a `ModelWarning`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from lxml import etree

from spacearm.arrays import LEAST_MASS
from spacearm.description.bodies import Inertial, Joint, Mimic
from spacearm.description.readers.urdf_visuals import read_visuals
from spacearm.description.readers.xml import Source, describe
from spacearm.description.tree import ROOT_JOINT, Tree
from spacearm.errors import ModelError, listed, unknown

Check = Literal["error", "warn", "accept"]
CHECKS = ("error", "warn", "accept")

UNLIMITED = (None, "", "inf", "Inf", "INF", "infinity")
KINDS = ("revolute", "continuous", "prismatic", "fixed")


def read(path: str | os.PathLike[str], check: Check = "error", *, spacecraft: bool = True) -> Tree:
    """Read and check a URDF.

    Args:
        path: The file.
        check: What to do with inertias that no rigid body can have: "error", or "warn" or "accept"
            to load published data that has this fault.
        spacecraft: Whether the root link is a spacecraft, which has mass; the root of an arm alone
            may be a frame without mass.

    Raises:
        ModelError: The file has a fault; the message names file, element, value and remedy.

    Warns:
        ModelWarning: A joint has no limits, a mesh is missing, or (with check="warn") an inertia
            is impossible.
    """
    if check not in CHECKS:
        raise ModelError(unknown("check", check, CHECKS))
    source = Source(Path(path))
    robot = source.robot()
    links = {name: _inertial(source, e) for name, e in source.named(robot, "link").items()}
    if not links:
        source.fail("has no links", "describe the spacecraft and its arm by <link> and <joint>")
    joints = {name: _joint(source, e, links) for name, e in source.named(robot, "joint").items()}
    _check_mimics(source, joints)
    tree = Tree(
        name=robot.get("name") or source.path.stem,
        root=_root(source, links, joints),
        links=links,
        joints=joints,
        visuals=read_visuals(source, robot),
        tips=tuple(_named_link(source, tip, links) for tip in robot.findall("tip")),
    )
    _check_masses(source, tree, check, spacecraft)
    _warn_of_missing_limits(source, joints)
    return tree


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
    xx, xy, xz, yy, yz, zz = (
        source.number(inertia, name) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    return Inertial(m, source.pose(element), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def _joint(source: Source, element: etree._Element, links: Collection[str]) -> Joint:
    name, kind = element.get("name", ""), element.get("type", "")
    if kind in ("floating", "planar"):
        source.fail(
            f"joint {name!r} is of type {kind!r}, a freedom that only the spacecraft has",
            "leave it out above the spacecraft, whose root link floats by itself; elsewhere "
            "replace it by revolute and prismatic joints",
        )
    if kind not in KINDS:
        source.fail(f"joint {name!r} has type {kind!r}", f"use one of {', '.join(KINDS)}")
    parent, child = (_end(source, element, end, links) for end in ("parent", "child"))
    if source.child(element, "wheel") is not None:
        if kind not in ("revolute", "continuous"):
            source.fail(f"joint {name!r} of type {kind!r} is a <wheel>", "make it continuous")
        kind = "wheel"
    axis = source.child(element, "axis")
    direction = np.array([1.0, 0.0, 0.0]) if axis is None else source.numbers(axis, "xyz", 3)
    length = float(np.linalg.norm(direction))
    if kind != "fixed":
        if length < 1e-12:
            source.fail(f"joint {name!r} has a zero axis", "give the direction it moves along")
        direction = direction / length
    limits = _limits(source, element)
    return Joint(
        name, kind, parent, child, source.pose(element), direction, *limits, _mimic(source, element)
    )


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


def _limits(source: Source, joint: etree._Element) -> tuple[float, float, float, float]:
    """Read lower, upper, velocity and effort; URDF takes a missing lower or upper as 0."""
    limit = source.child(joint, "limit")
    if limit is None or joint.get("type") == "fixed":
        return -math.inf, math.inf, math.inf, math.inf
    velocity, effort = (
        source.number(limit, name) if limit.get(name) not in UNLIMITED else math.inf
        for name in ("velocity", "effort")
    )
    if min(velocity, effort) < 0.0:
        source.fail(
            f"{describe(limit)} has velocity {velocity:g} and effort {effort:g}",
            "give positive numbers",
        )
    turns = joint.get("type") == "continuous" or joint.find("wheel") is not None
    if turns or not (limit.get("lower") or limit.get("upper")):
        return -math.inf, math.inf, velocity, effort
    lower, upper = source.number(limit, "lower", "0"), source.number(limit, "upper", "0")
    if lower > upper:
        source.fail(
            f"{describe(limit)} is reversed (lower {lower:g}, upper {upper:g})",
            "exchange the two (a missing one counts as 0)",
        )
    return lower, upper, velocity, effort


def _mimic(source: Source, joint: etree._Element) -> Mimic | None:
    mimic = source.child(joint, "mimic")
    if mimic is None or joint.get("type") == "fixed":
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


def _check_mimics(source: Source, joints: Mapping[str, Joint]) -> None:
    if ROOT_JOINT in joints:
        source.fail(f"joint {ROOT_JOINT!r} has the name of the free root joint", "rename it")
    movable = {joint.name: joint for joint in joints.values() if joint.movable}
    sound: set[str] = set()
    for joint in joints.values():
        seen, mimic = {joint.name}, joint.mimic
        while mimic and mimic.leader not in sound:
            if mimic.leader not in movable:
                what = unknown("movable joint", mimic.leader, movable)
                source.fail(f"<mimic> of joint {joint.name!r}: {what}", "name one")
            if mimic.leader in seen:
                source.fail(f"joint {joint.name!r} mimics itself", "remove that <mimic>")
            seen.add(mimic.leader)
            mimic = joints[mimic.leader].mimic
        sound |= seen & movable.keys()


def _check_masses(source: Source, tree: Tree, check: Check, spacecraft: bool) -> None:
    """Check that every body has mass, and an inertia that a rigid body can have."""
    held: set[str] = set()  # point masses fixed to bodies, which need no inertia
    for leader, lump in tree.lumps().items():
        parts = {link: part for link in lump if (part := tree.links[link]) and part.mass}
        points = {link for link, part in parts.items() if part.point}
        held |= points if len(points) < len(parts) else set()
        if not parts and (spacecraft or leader != tree.root):
            what = "the spacecraft" if leader == tree.root else "movable link"
            source.fail(
                f"{what} {leader!r} has no mass (its <inertial> is zero or missing)",
                "give it a mass and an inertia, or join it to its parent by a fixed joint",
            )
    for link, inertial in tree.links.items():
        fault = inertial.fault() if inertial and link not in held else None
        if fault and check == "error":
            source.fail(
                f"link {link!r} {fault}", 'correct it, or load with check="warn" to accept it'
            )
        if fault and check == "warn":
            source.warn(f"link {link!r} {fault}")


def _warn_of_missing_limits(source: Source, joints: Mapping[str, Joint]) -> None:
    kinds = ("revolute", "prismatic")
    free = [j.name for j in joints.values() if j.kind in kinds and math.isinf(j.lower)]
    if free:
        source.warn(f"no limits on {listed(free)}: taken as unlimited")
