"""SDF reader: a model, or the model of a world that has joints, from SDFormat 1.5 on.

Links, inertials, joints, frames and nested models are read; sensors, plugins and physics are not
there for a free-floating arm.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from lxml import etree

from spacearm.description.bodies import Joint, Mimic
from spacearm.description.readers.forest import SPLIT_BALL, Forest, freedoms, turns
from spacearm.description.readers.sdf.frames import MODEL, WORLD, Frame, Frames
from spacearm.description.readers.sdf.includes import included
from spacearm.description.readers.sdf.shapes import Shapes
from spacearm.description.readers.sdf.values import (
    inertial,
    largest,
    limit,
    pose,
    relative_to,
    vector,
    words,
)
from spacearm.description.readers.xml import Source
from spacearm.description.tree import Tree

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
MODEL_AXES = 1.5
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


class Scope(NamedTuple):
    """A model or a world, inside which names are short.

    Attributes:
        prefix: What comes before its names, seen from the top.
        own: Name of its own frame.
    """

    prefix: str
    own: str

    def name(self, short: str) -> str:
        """Return a name from the top; an empty text stays empty."""
        if short in ("", WORLD):
            return short
        return self.own if short == MODEL else self.prefix + short


class _Reader:
    """One file on its way to a tree."""

    def __init__(self, source: Source, root: etree._Element) -> None:
        self._source = source
        try:
            self._version = float(root.get("version", "1.5"))
        except ValueError:
            source.fail(f"has version={root.get('version')!r}", "give one such as version='1.9'")
        worlds, models = root.findall("world"), root.findall("model")
        if len(worlds) + len(models) != 1:
            what = f"{len(worlds)} <world> and {len(models)} <model>"
            source.fail(f"has {what} below <sdf>", "keep one of them in a file")
        self._frames = Frames(source)
        self._frames.add(WORLD, Frame(root, None, pin.SE3.Identity(), WORLD))
        self._links: list[tuple[str, Scope, etree._Element]] = []
        self._joints: list[tuple[str, Scope, etree._Element]] = []
        self._marks: list[tuple[str, etree._Element]] = []
        self._name = source.path.stem
        top = Scope("", WORLD)
        for world in worlds:
            self._contents(world, top)
        for model in models:
            self._name = model.get("name") or self._name
            self._model(model, top, Scope("", MODEL))

    # --- what is there --------------------------------------------------------------------------

    def _model(self, model: etree._Element, outer: Scope, scope: Scope) -> None:
        """Read a model: its own frame, then what is in it.

        Args:
            model: The model.
            outer: Where it is.
            scope: What is in it.
        """
        placed = model.get("placement_frame")
        self._frames.add(
            scope.own,
            Frame(
                model,
                outer.name(relative_to(model)) or outer.own,
                pose(self._source, model),
                _canonical(model, scope),
                scope.name(placed) if placed else None,
            ),
        )
        self._contents(model, scope)

    def _contents(self, parent: etree._Element, scope: Scope) -> None:
        """Read what is in a model or a world."""
        source = self._source
        for name, link in source.named(parent, "link").items():
            at, full = scope.name(relative_to(link)) or scope.own, scope.name(name)
            self._frames.add(full, Frame(link, at, pose(source, link), full))
            self._links.append((full, scope, link))
        for name, joint in source.named(parent, "joint").items():
            child, full = self._end(joint, "child", scope), scope.name(name)
            at = scope.name(relative_to(joint)) or child
            self._frames.add(full, Frame(joint, at, pose(source, joint), child))
            self._joints.append((full, scope, joint))
        for name, frame in source.named(parent, "frame").items():
            to, full = scope.name(frame.get("attached_to", "")) or scope.own, scope.name(name)
            at = scope.name(relative_to(frame)) or to
            self._frames.add(full, Frame(frame, at, pose(source, frame), to))
            self._marks.append((full, frame))
        for model in parent.findall("model"):
            self._nested(model, scope)
        for include in parent.findall("include"):
            needed = parent.tag == "model"
            if (taken := included(source, include, needed=needed)) is None:
                continue
            if include.get("merge") in ("true", "1"):
                own = scope.name(f"__merged_{taken.get('name')}__")
                self._model(taken, scope, Scope(scope.prefix, own))
            else:
                self._nested(taken, scope)

    def _nested(self, model: etree._Element, scope: Scope) -> None:
        """Read a nested model, in whose names its own comes first."""
        name = scope.name(model.get("name", ""))
        self._model(model, scope, Scope(f"{name}::", f"{name}::{MODEL}"))
        own = f"{name}::{MODEL}"
        self._frames.add(name, Frame(model, own, pin.SE3.Identity(), own))

    def _end(self, joint: etree._Element, end: str, scope: Scope) -> str:
        """Return the frame that a joint names as its <parent> or <child>."""
        if not (name := words(joint, end)):
            what = f"joint {joint.get('name')!r} has no <{end}>"
            self._source.fail(what, f"add <{end}>LINK</{end}>")
        return scope.name(name)

    # --- the tree -------------------------------------------------------------------------------

    def tree(self) -> Tree:
        """Return the tree of the robot."""
        forest, source = Forest(), self._source
        if not self._links:
            source.fail("has no links", "describe the spacecraft and its arm by <link> and <joint>")
        shapes = Shapes(source)
        for name, scope, link in self._links:

            def placed(
                element: etree._Element, name: str = name, scope: Scope = scope
            ) -> pin.SE3 | None:
                frame = scope.name(relative_to(element))
                return self._frames.pose(frame, name, element) if frame else None

            forest.add(name, inertial(source, link), shapes.of(link, placed))
        forest.add(WORLD)
        for name, scope, element in self._joints:
            self._join(forest, name, scope, element)
        source.warn_of_missing_meshes(shapes.missing)
        for name, mark in self._marks:
            carrier = self._frames.link_of(name, mark)
            forest.mark(name, carrier, self._frames.pose(name, carrier, mark))
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
        tree = forest.robot(source, self._name, forest.roots())
        return _unprefixed(tree)

    def _join(self, forest: Forest, name: str, scope: Scope, joint: etree._Element) -> None:
        """Join the child of a <joint> to its parent."""
        source, frames, kind = self._source, self._frames, joint.get("type", "")
        if kind not in AXES:
            source.fail(
                f"joint {name!r} has type {kind!r}",
                f"use one of {', '.join(AXES)}",
            )
        parent, child = (
            frames.link_of(self._end(joint, end, scope), joint) for end in ("parent", "child")
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
            direction = self._frames.pose(frame, name, joint).rotation @ direction
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
        two = [joint for name, _, joint in self._joints if name == leader]
        if two and len(AXES.get(two[0].get("type", ""), ())) == 2:
            leader = f"{leader}_{mimic.get('axis', 'axis')}"
        gain, offset, reference = (
            float(vector(source, mimic, tag, default)[0])
            for tag, default in (("multiplier", "1"), ("offset", "0"), ("reference", "0"))
        )
        return Mimic(leader, gain, offset - gain * reference)


def _canonical(model: etree._Element, scope: Scope) -> str:
    """Return the frame that the frame of a model moves with: its canonical link, or the first."""
    if name := model.get("canonical_link"):
        return scope.name(name)
    for child in (*model.findall("link"), *model.findall("model"), *model.findall("include/model")):
        return scope.name(child.get("name", ""))
    return WORLD


def _unprefixed(tree: Tree) -> Tree:
    """Return the tree without the name of a model that all its names start with."""
    prefix = tree.root.partition("::")[0] + "::"
    names = [*tree.links, *tree.joints]
    if not all(name.startswith(prefix) for name in names):
        return tree
    cut = len(prefix)
    return replace(
        tree,
        name=prefix[:-2],
        root=tree.root[cut:],
        links={name[cut:]: part for name, part in tree.links.items()},
        joints={name[cut:]: _cut(joint, cut) for name, joint in tree.joints.items()},
        visuals={name[cut:]: shapes for name, shapes in tree.visuals.items()},
        marks=tuple(mark[cut:] for mark in tree.marks),
    )


def _cut(joint: Joint, cut: int) -> Joint:
    mimic = joint.mimic and joint.mimic._replace(leader=joint.mimic.leader[cut:])
    name, parent, child = joint.name[cut:], joint.parent[cut:], joint.child[cut:]
    return replace(joint, name=name, parent=parent, child=child, mimic=mimic)
