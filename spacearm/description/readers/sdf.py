"""SDF reader: a model, or the model of a world that has joints, from SDFormat 1.5 on.

Links, inertials, joints, frames and nested models are read; sensors, plugins and physics are not
there for a free-floating arm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pinocchio as pin
from lxml import etree

from spacearm.description.bodies import Joint, Mimic
from spacearm.description.readers.forest import SPLIT_BALL, Forest, freedoms, turns, unprefixed
from spacearm.description.readers.sdf_contents import (
    WORLD,
    Contents,
    Scope,
    inertial,
    largest,
    limit,
    number,
    pose,
    relative_to,
    vector,
    words,
)
from spacearm.description.readers.source import Source
from spacearm.description.shapes import (
    Box,
    Cylinder,
    Mesh,
    Shape,
    Sphere,
    Unusable,
    Visuals,
    capsule,
)
from spacearm.description.tree import Tree
from spacearm.errors import ModelError

AXES = {
    "fixed": (),
    "revolute": ("axis",),
    "continuous": ("axis",),
    "prismatic": ("axis",),
    "universal": ("axis", "axis2"),
    "revolute2": ("axis", "axis2"),
    "ball": (),
}
"""Axes of each type of joint."""
MODEL_AXES = (1, 5)
"""Before this version all axes are in the axes of the model."""


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
        self._contents = Contents(source, root)

    def tree(self) -> Tree:
        """Return the tree of the robot."""
        forest, source = Forest(), self._source
        shapes = Shapes(source)
        for name, scope, link in self._contents.links:

            def placed(
                element: etree._Element, name: str = name, scope: Scope = scope
            ) -> pin.SE3 | None:
                frame = scope.name(relative_to(element))
                return self._contents.frames.pose(frame, name, element) if frame else None

            forest.add(name, inertial(source, link), shapes.of(link, placed))
        forest.add(WORLD)
        for name, scope, element in self._contents.joints:
            self._join(forest, name, scope, element)
        source.warn_of_missing_meshes()
        for name, mark in self._contents.marks:
            carrier = self._contents.frames.link_of(name, mark)
            forest.mark(name, carrier, self._contents.frames.pose(name, carrier, mark))
        forest.check(source)
        held = [joint for joint in forest.joints.values() if joint.parent == WORLD]
        if not any(joint.movable for joint in held):
            for joint in held:
                del forest.joints[joint.name]
            del forest.links[WORLD]
            if any(freedoms(forest.tree("", joint.child)) for joint in held):
                bases = ", ".join(repr(joint.child) for joint in held)
                source.note(
                    f"{bases} is fixed to the world: it is taken as the spacecraft, which floats "
                    "(sa.mount bolts the arm to another)"
                )
        tree = forest.robot(source, self._contents.name, forest.roots())
        return unprefixed(tree)

    def _join(self, forest: Forest, name: str, scope: Scope, joint: etree._Element) -> None:
        """Join the child of a <joint> to its parent."""
        source, frames, kind = self._source, self._contents.frames, joint.get("type", "")
        if kind not in AXES:
            source.fail(
                f"joint {name!r} has type {kind!r}",
                f"use one of {', '.join(AXES)}",
            )
        parent, child = (
            frames.link_of(self._contents.end(joint, end, scope), joint)
            for end in ("parent", "child")
        )
        if child == WORLD or parent == child:
            source.fail(f"joint {name!r} leads from {parent!r} to {child!r}", "exchange or rename")
        if kind == "fixed":
            forest.fix(parent, child, frames.pose(child, parent, joint), name)
            return
        origin, last = frames.pose(name, parent, joint), frames.pose(child, name, joint)
        if kind == "ball":
            source.warn(SPLIT_BALL.format(name=name))
            row = turns(name, "xyz", origin)
        else:
            row = [self._axis(name, scope, joint, tag) for tag in AXES[kind]]
            row[0] = replace(row[0], origin=origin)
        forest.join(parent, child, row, last)

    def _axis(self, name: str, scope: Scope, joint: etree._Element, tag: str) -> Joint:
        """Read an <axis> or <axis2> with its limits, in the frame of the joint."""
        source, kind = self._source, joint.get("type", "")
        axis = source.child(joint, tag)
        if axis is None:
            source.fail(f"joint {name!r} has no <{tag}>", f"add <{tag}><xyz>0 0 1</xyz></{tag}>")
        direction = vector(source, axis, "xyz", "0 0 1")
        length = float(np.linalg.norm(direction))
        if length < 1e-12:
            source.fail(f"joint {name!r} has a zero axis", "give the direction it moves along")
        xyz = source.child(axis, "xyz")
        given = "" if xyz is None else xyz.get("expressed_in", "")
        of_model = words(axis, "use_parent_model_frame") in ("true", "1")
        frame = scope.name(given)
        if not frame and (of_model or self._version < MODEL_AXES):
            frame = scope.own
        if frame:
            direction = self._contents.frames.pose(frame, name, joint).rotation @ direction
        limits = source.child(axis, "limit")
        lower = limit(source, limits, "lower", -math.inf)
        upper = limit(source, limits, "upper", math.inf)
        if lower > upper:
            source.fail(
                f"<limit> of joint {name!r} is reversed (lower {lower:g}, upper {upper:g})",
                "exchange the two",
            )
        unlimited = kind == "continuous" or (math.isinf(lower) and math.isinf(upper))
        turning = "continuous" if unlimited else "revolute"
        return Joint(
            name if len(AXES[kind]) == 1 else f"{name}_{tag}",
            "prismatic" if kind == "prismatic" else turning,
            "",
            "",
            pin.SE3.Identity(),
            direction / length,
            -math.inf if kind == "continuous" else lower,
            math.inf if kind == "continuous" else upper,
            largest(limit(source, limits, "velocity", math.inf)),
            largest(limit(source, limits, "effort", math.inf)),
            self._mimic(scope, axis),
        )

    def _mimic(self, scope: Scope, axis: etree._Element) -> Mimic | None:
        """Read <mimic>: the joint is at multiplier * (its leader - reference) + offset."""
        source, mimic = self._source, self._source.child(axis, "mimic")
        if mimic is None:
            return None
        leader = scope.name(mimic.get("joint", ""))
        two = [joint for name, _, joint in self._contents.joints if name == leader]
        if two and len(AXES.get(two[0].get("type", ""), ())) == 2:
            leader = f"{leader}_{mimic.get('axis', 'axis')}"
        gain, offset, reference = (
            float(vector(source, mimic, tag, default)[0])
            for tag, default in (("multiplier", "1"), ("offset", "0"), ("reference", "0"))
        )
        return Mimic(leader, gain, offset - gain * reference)


class Shapes:
    """The shapes of the links of a file."""

    def __init__(self, source: Source) -> None:
        self._source = source

    def of(
        self, link: etree._Element, placed: Callable[[etree._Element], pin.SE3 | None]
    ) -> Visuals:
        """Return the shapes of a <link>.

        Args:
            link: The link.
            placed: Returns the pose of the frame that the <pose> of an element names, in the
                frame of the link; None if it names none.
        """
        visual, collision = (
            tuple(s for e in link.findall(tag) for s in self._shapes(e, placed))
            for tag in ("visual", "collision")
        )
        return Visuals(visual, collision)

    def _shapes(
        self, element: etree._Element, placed: Callable[[etree._Element], pin.SE3 | None]
    ) -> Iterable[Shape]:
        """Read a <visual> or <collision>; an ellipsoid counts as its box."""
        try:
            at = (placed(element) or pin.SE3.Identity()) * pose(self._source, element)
            return self._geometry(element, at, self._rgba(element))
        except ModelError as error:
            return (Shape(pin.SE3.Identity(), Unusable(str(error))),)

    def _geometry(
        self, parent: etree._Element, at: pin.SE3, rgba: tuple[float, ...] | None
    ) -> Iterable[Shape]:
        source, element = self._source, parent.find("geometry/*")
        kind = "" if element is None else str(element.tag)
        if element is None or kind in ("empty", "plane"):
            return ()
        if kind == "box":
            return (Shape(at, Box(tuple(vector(source, element, "size", "1 1 1"))), rgba),)
        if kind == "sphere":
            return (Shape(at, Sphere(number(source, element, "radius", 1.0)), rgba),)
        if kind in ("cylinder", "capsule"):
            radius = number(source, element, "radius", 1.0 if kind == "cylinder" else 0.5)
            length = number(source, element, "length", 1.0)
            if kind == "capsule":
                return capsule(at, radius, length, rgba)
            return (Shape(at, Cylinder(radius, length), rgba),)
        if kind == "ellipsoid":
            radii = vector(source, element, "radii", "1 1 1")
            return (Shape(at, Box(tuple(2.0 * radii)), rgba),)
        if kind == "mesh":
            name = words(element, "uri")
            scale = vector(source, element, "scale", "1 1 1")
            return (Shape(at, Mesh(name, source.mesh(name), tuple(scale.tolist())), rgba),)
        link = parent.getparent()
        owner = "" if link is None else link.get("name", "")
        source.fail(
            f"link {owner!r} has a {parent.tag!s} of the geometry <{kind}>",
            "give it a box, sphere, cylinder, capsule, ellipsoid or mesh",
        )

    def _rgba(self, parent: etree._Element) -> tuple[float, ...] | None:
        """Read the colour of a <visual>."""
        material = parent.find("material")
        if material is None or material.find("diffuse") is None:
            return None
        return tuple(np.clip(vector(self._source, material, "diffuse", "1 1 1 1"), 0, 1).tolist())
