"""SDF reader: a model, or the model of a world that has joints, from SDFormat 1.5 on.

Links, inertials, joints, frames and nested models are read; sensors, plugins and physics are not
there for a free-floating arm.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from itertools import combinations_with_replacement

import numpy as np
import pinocchio as pin
from lxml import etree

from spacearm.arrays import LARGEST, LEAST_MASS, Array
from spacearm.description.bodies import Inertial, Joint, Mimic
from spacearm.description.grippers import PARALLEL
from spacearm.description.readers.forest import Forest, turns, unprefixed
from spacearm.description.readers.masses import solid_inertia
from spacearm.description.readers.sdf_frames import WORLD, Contents, Scope, pose, relative_to, words
from spacearm.description.readers.source import Source, describe, evaluate
from spacearm.description.shapes import Shape, primitive
from spacearm.description.tree import Tree

#: Limits beyond it are SDFormat's way to say that there is none (±1e16).
UNLIMITED = 1e15


NO_LIMIT = ("", "inf", "+inf", "-inf", "infinity", "-infinity")
#: Axes of each type of joint.
AXES = {
    "fixed": (),
    "revolute": ("axis",),
    "continuous": ("axis",),
    "prismatic": ("axis",),
    "universal": ("axis", "axis2"),
    "revolute2": ("axis", "axis2"),
    "screw": ("axis",),
    "ball": (),
    "planar": (),
}
#: Joints that only bodies have that float beside each other, by which no force passes.
FREE = ("floating", "quaternion_floating", "rpy_floating")
#: A joint that couples the hinges of two links.
GEARBOX = "gearbox"
#: SDFormat's default of the density of collision shapes [kg/m^3].
DENSITY = "1000"
#: SDFormat's defaults; the radius of a capsule is 0.5.
LENGTHS = {"size": "1 1 1", "radii": "1 1 1", "radius": "1", "length": "1"}
#: Before this version all axes are in the axes of the model.
MODEL_AXES = (1, 5)


def read(source: Source, root: etree._Element) -> Tree:
    """Read an SDF.

    The root link is the one without a joint to a parent; a joint to the world that is fixed makes
    no difference.

    Args:
        source: The file, which takes the notes.
        root: Its root element.

    Raises:
        ModelError: The file has a fault, or holds no robot.
    """
    return _Reader(source, root).tree()


class _Reader:
    """One file on its way to a tree."""

    def __init__(self, source: Source, root: etree._Element) -> None:
        self._source = source
        try:
            self._version = tuple(map(int, root.get("version", "1.5").split(".")))
        except ValueError:
            source.fail(f"has version={root.get('version')!r}", "give one such as version='1.9'")
        self._contents = Contents(source, root, self._version)

    def tree(self) -> Tree:
        """Return the tree of the robot."""
        forest, source = Forest(), self._source
        for name, scope, link in self._contents.links:
            shapes = source.shapes(link, partial(self._shapes, name, scope))
            forest.add(name, self._inertial(name, scope, link), shapes)
        for prefix, robot in self._contents.robots:
            forest.graft(robot.renamed(prefix.__add__))
        forest.add(WORLD)
        for name, scope, element in self._contents.joints:
            self._join(forest, name, scope, element)
        for name, scope, element in self._contents.joints:
            if element.get("type") == GEARBOX:
                self._couple(forest, name, scope, element)
        source.warn_of_missing_meshes()
        for name, mark in self._contents.marks:
            carrier = self._contents.frames.link_of(name, mark)
            forest.mark(name, carrier, self._contents.frames.pose(name, carrier, mark))
        forest.cut()
        forest.check(source)
        anchored = forest.anchored(WORLD)
        held = [joint for joint in forest.joints.values() if joint.parent == WORLD]
        if not any(joint.movable for joint in held):
            for joint in held:
                del forest.joints[joint.name]
            del forest.links[WORLD]
            massive = [j.child for j in held if (part := forest.links[j.child]) and part.mass]
            if any(forest.tree("", base).freedoms for base in massive):
                bases = ", ".join(map(repr, massive))
                source.note(
                    f"{bases} is fixed to the world: it is taken as the spacecraft, which floats "
                    "(sa.mount bolts the arm to another)"
                )
        tree = forest.robot(source, self._contents.name, forest.roots())
        tree = forest.closed(source, tree, anchored)
        return unprefixed(tree, self._source.reading.tips)

    def _shapes(self, link: str, scope: Scope, parent: etree._Element) -> tuple[Shape, ...]:
        """Read a <visual> or <collision> of a link."""
        source, rgba = self._source, None
        at = pose(source, parent)
        if frame := scope.name(relative_to(parent)):
            at = self._contents.frames.pose(frame, link, parent) * at
        material, element = parent.find("material"), parent.find("geometry/*")
        if material is not None and material.find("diffuse") is not None:
            rgba = tuple(vector(source, material, "diffuse", "1 1 1 1").tolist())
        if element is None or element.tag in ("empty", "plane"):
            return ()
        if element.tag == "mesh":
            name, scale = words(element, "uri"), vector(source, element, "scale", "1 1 1")
            return (Shape(at, source.mesh(element, name, scale), rgba),)
        if element.tag in ("box", "sphere", "cylinder", "capsule", "ellipsoid"):
            lengths = LENGTHS | ({"radius": "0.5"} if element.tag == "capsule" else {})

            def numbers(name: str, _: int) -> Array:
                return vector(source, element, name, lengths[name])

            return primitive(element.tag, numbers, at, rgba)
        source.fail_without_geometry(parent, "box, sphere, cylinder, capsule, ellipsoid or mesh")

    def _join(self, forest: Forest, name: str, scope: Scope, joint: etree._Element) -> None:
        """Join the child of a <joint> to its parent."""
        source, frames, kind = self._source, self._contents.frames, joint.get("type", "")
        if kind == GEARBOX:
            return
        if kind not in (*AXES, *FREE):
            source.fail(f"{describe(joint)} has type {kind!r}", f"use one of {', '.join(AXES)}")
        parent, child = (
            frames.link_of(self._contents.end(joint, end, scope), joint)
            for end in ("parent", "child")
        )
        if child == WORLD or parent == child or not {parent, child} <= forest.links.keys():
            source.fail(
                f"{describe(joint)} leads from {parent!r} to {child!r}", "exchange or rename them"
            )
        if kind in FREE or (kind == "planar" and parent == WORLD):
            source.warn(f"joint {name!r} of type {kind!r} is left out: {child!r} floats by itself")
            return
        if kind == "fixed":
            forest.fix(parent, child, frames.pose(child, parent, joint), name)
            return
        origin, last = frames.pose(name, parent, joint), frames.pose(child, name, joint)
        if kind == "ball":
            source.balls.append(name)
            row = turns(name, "xyz", origin)
        elif kind == "planar":
            row = turns(name, "xyz", origin, slides="xy")
        else:
            row = [self._axis(name, scope, joint, tag) for tag in AXES[kind]]
            row[0] = replace(row[0], origin=origin)
            if kind == "screw":
                row.append(self._advance(row[0], joint))
        forest.join(parent, child, row, last)

    def _couple(self, forest: Forest, name: str, scope: Scope, gearbox: etree._Element) -> None:
        """Couple the hinges on which two links turn beside the reference body of a gearbox.

        The turn of its child about <axis2> is -ratio times that of its parent about <axis>. The
        hinge that carries less mass follows.
        """
        source, frames, contents = self._source, self._contents.frames, self._contents
        base, *turning = (
            frames.link_of(contents.end(gearbox, end, scope), gearbox)
            for end in ("gearbox_reference_body", "parent", "child")
        )
        found, gain = list[tuple[bool, float, Joint]](), -1.0
        for link, tag in zip(turning, ("axis", "axis2"), strict=True):
            if not (hinge := self._hinge(base, link)):
                source.fail(
                    f"{describe(gearbox)} couples the turns of {turning[0]!r} and {turning[1]!r} "
                    f"beside {base!r}, which no hinge joins",
                    "join each to it by one revolute joint, or leave the gearbox out",
                )
            joint, (direction, _) = forest.joints[hinge], self._direction(name, scope, gearbox, tag)
            along = joint.axis @ frames.pose(name, hinge, gearbox).rotation @ direction
            if abs(along) < 1.0 - PARALLEL:
                source.fail(
                    f"{describe(gearbox)} has an <{tag}> along which {hinge!r} does not turn",
                    "give it that of the hinge",
                )
            gain *= float(np.sign(along)) * (1.0 if joint.parent == base else -1.0)
            mass = sum(p.mass for other in forest.behind(link) if (p := forest.links[other]))
            found.append((joint.mimic is not None, mass, joint))
        ratio = vector(source, gearbox, "gearbox_ratio", "1").item()
        leads = found[0][:2] >= found[1][:2]
        leader, follower = (joint for *_, joint in (found if leads else found[::-1]))
        if follower.mimic or not ratio:
            source.fail(
                f"{describe(gearbox)} couples {leader.name!r} and {follower.name!r}, "
                + ("which mimic others" if ratio else "by a ratio of 0"),
                "remove one <mimic>" if ratio else "give the ratio of their turns",
            )
        gain *= ratio if leads else 1.0 / ratio
        forest.joints[follower.name] = replace(follower, mimic=Mimic(leader.name, gain, 0.0))

    def _hinge(self, link: str, other: str) -> str | None:
        """Return the hinge that joins two links, if there is one."""
        for name, scope, joint in self._contents.joints:
            if joint.get("type") in ("revolute", "continuous"):
                ends = (self._contents.end(joint, end, scope) for end in ("parent", "child"))
                if {self._contents.frames.link_of(end, joint) for end in ends} == {link, other}:
                    return name
        return None

    def _direction(
        self, name: str, scope: Scope, joint: etree._Element, tag: str
    ) -> tuple[Array, etree._Element]:
        """Read the unit vector of an <axis> or <axis2>, in the frame of the joint."""
        source, axis = self._source, self._source.child(joint, tag)
        if axis is None:
            source.fail(f"{describe(joint)} has no <{tag}>", f"add <{tag}><xyz>0 0 1</xyz></{tag}>")
        direction = vector(source, axis, "xyz", "0 0 1")
        zero = f"{describe(joint)} has a zero axis"
        direction = source.unit(direction, zero, "give the direction it moves along")
        xyz = source.child(axis, "xyz")
        frame = scope.name("" if xyz is None else xyz.get("expressed_in", ""))
        of_model = words(axis, "use_parent_model_frame") in ("true", "1")
        if not frame and (of_model or self._version < MODEL_AXES):
            frame = scope.own
        if frame:
            direction = self._contents.frames.pose(frame, name, joint).rotation @ direction
        return direction, axis

    def _axis(self, name: str, scope: Scope, joint: etree._Element, tag: str) -> Joint:
        """Read an <axis> or <axis2> with its limits, in the frame of the joint."""
        source, kind = self._source, joint.get("type", "")
        full = name if len(AXES[kind]) == 1 else f"{name}_{tag}"
        direction, axis = self._direction(name, scope, joint, tag)
        limits = source.child(axis, "limit")
        lower = limit(source, limits, "lower", -math.inf)
        upper = limit(source, limits, "upper", math.inf)
        if lower > upper:
            source.fail(
                f"<limit> of joint {name!r} is reversed (lower {lower:g}, upper {upper:g})",
                "exchange the two",
            )
        if kind == "continuous":
            lower, upper = -math.inf, math.inf
        if kind != "prismatic":
            kind = "continuous" if math.isinf(lower) and math.isinf(upper) else "revolute"
        velocity, effort = (
            source.largest(_largest(limit(source, limits, end, math.inf)), what, full)
            for end, what in (("velocity", "rate"), ("effort", "effort"))
        )
        ends = (lower, upper, velocity, effort)
        mimic = self._mimic(scope, joint, axis)
        return Joint(full, kind, "", "", pin.SE3.Identity(), direction, *ends, mimic)

    def _advance(self, turn: Joint, joint: etree._Element) -> Joint:
        """Return the slide that the turn of a screw leads, by its pitch [m] a turn."""
        pitch = vector(self._source, joint, "screw_thread_pitch", "1").item()
        old = self._source.child(joint, "thread_pitch")
        if old is not None and joint.find("screw_thread_pitch") is None:
            ratio = vector(self._source, joint, "thread_pitch", "1").item()
            pitch = -2.0 * math.pi / ratio if ratio else 0.0
        mimic, here = Mimic(turn.name, pitch / (2.0 * math.pi), 0.0), pin.SE3.Identity()
        return Joint(f"{turn.name}_slide", "prismatic", "", "", here, turn.axis, mimic=mimic)

    def _inertial(self, name: str, scope: Scope, link: etree._Element) -> Inertial | None:
        """Read the <inertial> of a link, or compute it from its collision shapes if it says so."""
        source, element = self._source, self._source.child(link, "inertial")
        if element is None or element.get("auto") not in ("true", "1"):
            return inertial(source, link)
        common, parts = words(element, "density") or DENSITY, list[pin.Inertia]()
        for collision in link.findall("collision"):
            density = vector(source, collision, "density", common).item()
            shapes = source.safely(partial(self._shapes, name, scope), collision)
            if source.reading.up_axes:
                shapes = tuple(shape.upright() for shape in shapes)
            if (solid := solid_inertia(shapes)) is not None:
                parts.append(Inertial.of_spatial(solid).with_mass(density * solid.mass).spatial())
        if not parts:
            source.warn(
                f"link {name!r} has <inertial auto='true'> and no collision shape that can be "
                "used: it has no mass; give it <mass> and <inertia>"
            )
            return None
        whole = Inertial.of_spatial(sum(parts[1:], start=parts[0]))
        if element.find("mass") is not None:
            whole = whole.with_mass(vector(source, element, "mass", "1").item())
        source.note(
            f"link {name!r} has {whole.mass:.4g} kg by its collision shapes, as its "
            "<inertial auto='true'> says"
        )
        return whole

    def _mimic(self, scope: Scope, joint: etree._Element, axis: etree._Element) -> Mimic | None:
        """Read <mimic>: the joint is at multiplier * (its leader - reference) + offset.

        Drake's has no reference, and is written as in a URDF.
        """
        source, mimic = self._source, self._source.child(axis, "mimic")
        if mimic is None:
            if (mimic := source.child(joint, "mimic")) is None:
                return None
            gain, offset = (
                source.number(mimic, "multiplier", "1"),
                source.number(mimic, "offset", "0"),
            )
            return Mimic(scope.name(mimic.get("joint", "")), gain, offset)
        leader = scope.name(mimic.get("joint", ""))
        two = [joint for name, _, joint in self._contents.joints if name == leader]
        if two and len(AXES.get(two[0].get("type", ""), ())) == 2:
            leader = f"{leader}_{mimic.get('axis', 'axis')}"
        gain, offset, reference = (
            float(vector(source, mimic, tag, default)[0])
            for tag, default in (("multiplier", "1"), ("offset", "0"), ("reference", "0"))
        )
        return Mimic(leader, gain, offset - gain * reference)


def vector(source: Source, parent: etree._Element, tag: str, default: str) -> Array:
    """Read the finite numbers in a child element, as many as the default has."""
    element = source.child(parent, tag)
    if element is None:
        return np.array([float(word) for word in default.split()])
    return source.values(element, f"<{tag}>", element.text or "", len(default.split()))


def limit(source: Source, parent: etree._Element | None, tag: str, none: float) -> float:
    """Read a limit, which may be infinite; `none` where there is none."""
    element = None if parent is None else source.child(parent, tag)
    if element is None or (text := (element.text or "").strip().lower()) in NO_LIMIT:
        return none
    value = evaluate(text)
    if value is None:
        source.fail(f"{describe(element)} is {text[:60]!r}", "give a number, or inf for no limit")
    return none if abs(value) > UNLIMITED else value


def _largest(value: float) -> float:
    """Return a limit of effort or velocity: SDFormat writes a negative one where there is none."""
    return math.inf if value < 0.0 or value > LARGEST else value


def inertial(source: Source, link: etree._Element) -> Inertial | None:
    """Read the <inertial> of a link, with SDFormat's defaults of 1 kg and 1 kg m^2."""
    name = link.get("name")
    element = source.child(link, "inertial")
    if element is None:
        source.warn(f"link {name!r} has no <inertial>: 1 kg and 1 kg m^2, SDFormat's default")
        return Inertial(1.0, pin.SE3.Identity(), np.eye(3))
    mass = vector(source, element, "mass", "1").item()
    if mass < 0.0:
        source.fail(f"the <mass> of link {name!r} is {mass:g} kg", "give a positive mass")
    if 0.0 < mass < LEAST_MASS:
        source.warn(f"the <mass> of link {name!r} is {mass:g} kg: taken as massless")
        return None
    given = source.child(element, "inertia")
    I = np.eye(3)
    if given is not None:
        for i, j in combinations_with_replacement(range(3), 2):
            name_ij = f"i{'xyz'[i]}{'xyz'[j]}"
            I[i, j] = I[j, i] = vector(source, given, name_ij, f"{i == j:d}").item()
    elif mass:
        source.warn(f"link {name!r} has no <inertia>: 1 kg m^2, SDFormat's default")
    else:
        I = np.zeros((3, 3))
    return Inertial(mass, pose(source, element), I)
