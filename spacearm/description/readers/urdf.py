"""URDF reader: a URDF read and checked, so that Pinocchio gets a sound model.

Links with their inertials, joints and visuals are read, extensions are ignored. Nothing is repaired
in silence: a fault raises a `ModelError` that names file, element, value and remedy; an oddity
gives a `ModelWarning`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from lxml import etree

from spacearm.arrays import LARGEST, LEAST_MASS
from spacearm.description.bodies import Inertial, Joint, Mimic
from spacearm.description.readers.forest import Forest, check_mimics, turns
from spacearm.description.readers.source import Source, describe, evaluate
from spacearm.description.shapes import Shape, primitive
from spacearm.description.tree import Tree
from spacearm.errors import listed, unknown

KINDS = ("revolute", "continuous", "prismatic", "fixed")
#: Types of a ball joint in PyBullet and MuJoCo, and in Drake.
BALLS = ("spherical", "ball")
#: Joints that only a spacecraft has; those above it are left out, for it floats by itself.
FLOATING = ("floating", "planar")
#: Name of a link that need not be declared.
WORLD = "world"
INFINITE = ("", "inf", "infinity", ".inf")
#: Angle [rad] beyond which a limit looks like one in degrees.
MANY_TURNS = 30.0


def read(source: Source, robot: etree._Element) -> Tree:
    """Read a URDF.

    Args:
        source: The file, which takes the notes.
        robot: Its root element, xacro expanded.

    Raises:
        ModelError: The file has a fault; the message names file, element, value and remedy.

    Warns:
        ModelWarning: Something was assumed; each warning is a note too.
    """
    forest = Forest()
    materials = {m.get("name"): m for m in robot.findall("material")}
    for name, link in source.named(robot, "link").items():
        shapes = source.shapes(link, partial(_shapes, source, materials))
        forest.add(name, _inertial(source, link), shapes)
    if not forest.links:
        source.fail("has no links", "describe the spacecraft and its arm by <link> and <joint>")
    if any(parent.get("link") == WORLD for parent in robot.findall("joint/parent")):
        forest.links.setdefault(WORLD)  # which Drake knows without a <link>
    for name, joint in source.named(robot, "joint").items():
        found = _joint(source, joint, forest.links)
        if found.kind in BALLS:
            source.balls.append(name)
            forest.join(found.parent, found.child, turns(name, "xyz", found.origin))
        else:
            forest.joints[name] = found
    tips = tuple(_named_link(source, tip, forest.links) for tip in robot.findall("tip"))
    floats = _cut_free(source, forest)
    check_mimics(source, forest.joints)  # first: a joint that mimics a fixed one has no limits
    _warn_of_limits(source, robot, forest.joints)
    forest.check(source)
    roots = forest.roots()
    if len(roots) > 1 and not floats:
        source.fail(
            f"has {len(roots)} root links ({listed(roots)})",
            "join them to one spacecraft by fixed joints",
        )
    source.warn_of_missing_meshes()
    name = robot.get("name") or source.path.name.partition(".")[0]
    tree = forest.robot(source, name, roots) if floats else forest.tree(name, roots[0])
    return replace(tree, tips=tips)


def _cut_free(source: Source, forest: Forest) -> bool:
    """Leave out the joints that links float by, through which no force passes.

    Links without mass that the spacecraft floats in are left out with its joint, which may be
    planar.

    Returns:
        Whether other floating joints were cut, so that the file holds several bodies in space.
    """
    cut = False
    free = [joint for joint in forest.joints.values() if joint.kind in FLOATING]
    for joint in free:
        del forest.joints[joint.name]
    for joint in free:
        above = forest.behind(*(r for r in forest.roots() if joint.parent in forest.behind(r)))
        fixed = [other for other in forest.joints.values() if other.parent in above]
        shared = len([other for other in free if other.parent in above]) > 1
        massive = any(part.mass for link in above if (part := forest.links[link]))
        if above and not (shared or massive or any(other.kind != "fixed" for other in fixed)):
            frames = listed([repr(link) for link in sorted(above)])
            source.warn(
                f"joint {joint.name!r} of type {joint.kind!r} and {frames} are left out: the "
                f"spacecraft {joint.child!r} floats by itself"
            )
            for other in fixed:
                del forest.joints[other.name]
            for link in above:
                del forest.links[link]
        elif joint.kind == "planar":
            source.fail(
                f"joint {joint.name!r} is of type 'planar', a freedom that only the spacecraft has",
                "leave it out above the spacecraft, whose root link floats by itself; elsewhere "
                "replace it by two prismatic joints and a revolute one",
            )
        else:
            cut = True
    return cut


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
    if m < 0.0:
        source.fail(f"{describe(mass)} is {m:g} kg", "give a positive mass")
    if 0.0 < m < LEAST_MASS:
        source.warn(f"{describe(mass)} is {m:g} kg: taken as massless")
        return None
    products = ("ixy", "ixz", "iyz")
    none = "0" if not any(name in inertia.attrib for name in products) else None
    xy, xz, yz = (source.number(inertia, name, none) for name in products)
    xx, yy, zz = (source.number(inertia, name) for name in ("ixx", "iyy", "izz"))
    return Inertial(m, source.pose(element), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def _joint(source: Source, element: etree._Element, links: Collection[str]) -> Joint:
    name, kind = element.get("name", ""), element.get("type", "").strip().lower()
    if kind not in (*KINDS, *FLOATING, *BALLS):
        given = element.get("type", "")
        source.fail(f"{describe(element)} has type {given!r}", f"use one of {', '.join(KINDS)}")
    parent, child = (_end(source, element, end, links) for end in ("parent", "child"))
    if source.child(element, "wheel") is not None:
        if kind not in ("revolute", "continuous"):
            source.fail(f"joint {name!r} of type {kind!r} is a <wheel>", "make it continuous")
        kind = "wheel"
    axis = source.child(element, "axis")
    direction = np.array([1.0, 0.0, 0.0]) if axis is None else source.numbers(axis, "xyz", 3)
    if kind in (*FLOATING, *BALLS):
        direction = np.array([1.0, 0.0, 0.0])
    elif kind != "fixed":
        zero = f"joint {name!r} has a zero axis"
        direction = source.unit(direction, zero, "give the direction it moves along")
    limits, mimic = _limits(source, element, kind), _mimic(source, element, kind)
    joint = Joint(name, kind, parent, child, source.pose(element), direction, *limits, mimic)
    if not joint.movable:
        return joint
    damping, friction = (_resistance(source, element, name) for name in ("damping", "friction"))
    home = source.child(element, "home")
    at = 0.0 if home is None else source.number(home, "value")
    return replace(joint, damping=damping, friction=friction, home=at)


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
        part = ", or load the file that includes this one" * (
            source.path.suffix.lower() == ".xacro"
        )
        source.fail(f"{element.tag!s}{owner}: {unknown('link', link, links)}", f"name one{part}")
    return link


def _mimic(source: Source, joint: etree._Element, kind: str) -> Mimic | None:
    mimic = source.child(joint, "mimic")
    if mimic is None or kind == "fixed":
        return None
    gain, offset = source.number(mimic, "multiplier", "1"), source.number(mimic, "offset", "0")
    return Mimic(mimic.get("joint", ""), gain, offset)


# --- limits, whose writers mean different things by infinite and by zero -----------------------


def _limits(source: Source, joint: etree._Element, kind: str) -> tuple[float, float, float, float]:
    """Read lower and upper limit, largest rate and effort; infinite where there is none.

    URDF takes a missing lower or upper one as 0. A range from 0 to 0 and a rate or an effort of 0
    are what exporters write where they know nothing: no limits.
    """
    limit = source.child(joint, "limit")
    lower, upper = -math.inf, math.inf
    if limit is None or kind not in ("revolute", "continuous", "prismatic", "wheel"):
        return lower, upper, math.inf, math.inf
    velocity, effort = (_bound(source, limit, name) or math.inf for name in ("velocity", "effort"))
    if min(velocity, effort) < 0.0:
        source.fail(
            f"{describe(limit)} has velocity {velocity:g} and effort {effort:g}",
            "give positive numbers",
        )
    if kind in ("revolute", "prismatic") and (limit.get("lower") or limit.get("upper")):
        ends = (("lower", -1.0), ("upper", 1.0))
        lower, upper = (_bound(source, limit, name, "0", sign) for name, sign in ends)
    if lower > upper:
        source.fail(
            f"{describe(limit)} is reversed (lower {lower:g}, upper {upper:g})",
            "exchange the two (a missing one counts as 0)",
        )
    if lower == upper == 0.0:
        lower, upper = -math.inf, math.inf
    return lower, upper, velocity, effort


def _bound(
    source: Source, limit: etree._Element, name: str, default: str = "inf", sign: float = 1.0
) -> float:
    """Read one number of a <limit>; one too large to be meant is infinite."""
    text = limit.get(name, default).strip().lower()
    if text.lstrip("+-") in INFINITE:
        return -math.inf if text.startswith("-") else sign * math.inf
    value = evaluate(text)
    if value is not None and abs(value) > LARGEST:
        return math.copysign(math.inf, value)
    return source.number(limit, name, default)


def _resistance(source: Source, joint: etree._Element, name: str) -> float:
    """Read the damping or dry friction of a joint; what is not a number from 0 on counts as 0."""
    dynamics = joint.find("dynamics")
    text = "" if dynamics is None else dynamics.get(name, "").strip()
    value = evaluate(text or "0")
    if value is not None and 0.0 <= value <= LARGEST:
        return value
    source.warn(f"{name}={text[:60]!r} of joint {joint.get('name')!r} is taken as 0")
    return 0.0


def _warn_of_limits(source: Source, robot: etree._Element, joints: Mapping[str, Joint]) -> None:
    """Warn of limits that are missing, that are not used or that look like degrees."""
    written = {e.get("name", ""): e.find("limit") for e in robot.findall("joint")}

    def given(joint: Joint, end: str) -> str:
        limit = written.get(joint.name)
        return "" if limit is None else limit.get(end, "").strip().lower()

    def unread(joint: Joint, end: str) -> bool:
        none = joint.movable and math.isinf(getattr(joint, end))
        return none and given(joint, end).lstrip("+-") not in INFINITE

    doubts: tuple[tuple[Callable[[str], None], str, Callable[[Joint], object]], ...] = (
        (source.warn, "no limits on {}: taken as unlimited",
         lambda j: j.kind in ("revolute", "prismatic") and -j.lower == j.upper == math.inf),
        (source.note, "limits of {} are ignored, as for all continuous joints",
         lambda j: (given(j, "lower") or given(j, "upper"))
         and j.kind == "continuous" and not j.mimic),
        (source.note, "rate limit of {} is zero or infinite: taken as none",
         lambda j: unread(j, "velocity")),
        (source.note, "effort limit of {} is zero or infinite: taken as none",
         lambda j: unread(j, "effort")),
        (source.warn, "limits of {} look like degrees, and are taken as radians",
         lambda j: j.kind == "revolute" and any(MANY_TURNS < abs(x) < math.inf
                                                for x in (j.lower, j.upper))),
    )  # fmt: skip
    for say, text, doubtful in doubts:
        if names := [joint.name for joint in joints.values() if doubtful(joint)]:
            say(text.format(listed(names)))


# --- shapes ---------------------------------------------------------------------------------


def _shapes(
    source: Source, materials: Mapping[str | None, etree._Element], parent: etree._Element
) -> tuple[Shape, ...]:
    """Read a <visual> or <collision>; its colour is its own, or of the material that it names."""
    material = parent.find("material")
    if material is not None and len(material) == 0:
        material = materials.get(material.get("name"))
    color = None if material is None else material.find("color")
    rgba = None if color is None else tuple(source.numbers(color, "rgba", 4).tolist())
    pose, element = source.pose(parent), parent.find("geometry/*")
    if element is not None and element.tag == "mesh":
        name, scale = element.get("filename", ""), source.numbers(element, "scale", 3, "1 1 1")
        return (Shape(pose, source.mesh(element, name, scale), rgba),)
    if element is not None and element.tag in ("box", "sphere", "cylinder", "capsule"):
        # a collision body without extension would be far from everything
        positive = parent.tag == "collision" or element.tag == "capsule"
        numbers = source.lengths if positive else source.numbers
        return primitive(element.tag, partial(numbers, element), pose, rgba)
    source.fail_without_geometry(parent, "box, sphere, cylinder, capsule or mesh")
