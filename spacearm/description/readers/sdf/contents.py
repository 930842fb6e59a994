"""SDF contents: the links, joints and frames of a file, those of nested models and includes too."""

from __future__ import annotations

from typing import NamedTuple

import pinocchio as pin
from lxml import etree

from spacearm.description.readers.sdf.frames import MODEL, WORLD, Frame, Frames
from spacearm.description.readers.sdf.includes import included
from spacearm.description.readers.sdf.values import pose, relative_to, words
from spacearm.description.readers.xml import Source


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


class Contents:
    """What is in a file, by full names.

    Attributes:
        name: Name of the robot.
        frames: Every frame.
        links: Names, scopes and elements of the links.
        joints: Names, scopes and elements of the joints.
        marks: Names and elements of the <frame>s.
    """

    def __init__(self, source: Source, root: etree._Element) -> None:
        self._source = source
        worlds, models = root.findall("world"), root.findall("model")
        if len(worlds) + len(models) != 1:
            what = f"{len(worlds)} <world> and {len(models)} <model>"
            source.fail(f"has {what} below <sdf>", "keep one of them in a file")
        self.name = source.path.stem
        self.frames = Frames(source)
        self.frames.add(WORLD, Frame(root, None, pin.SE3.Identity(), WORLD))
        self.links: list[tuple[str, Scope, etree._Element]] = []
        self.joints: list[tuple[str, Scope, etree._Element]] = []
        self.marks: list[tuple[str, etree._Element]] = []
        top = Scope("", WORLD)
        for world in worlds:
            self._contents(world, top)
        for model in models:
            self.name = model.get("name") or self.name
            self._model(model, top, Scope("", MODEL))
        if not self.links:
            source.fail("has no links", "describe the spacecraft and its arm by <link> and <joint>")

    def _model(self, model: etree._Element, outer: Scope, scope: Scope) -> None:
        """Read a model: its own frame, then what is in it.

        Args:
            model: The model.
            outer: Where it is.
            scope: What is in it.
        """
        placed = model.get("placement_frame")
        self.frames.add(
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
            self.frames.add(full, Frame(link, at, pose(source, link), full))
            self.links.append((full, scope, link))
        for name, joint in source.named(parent, "joint").items():
            child, full = self.end(joint, "child", scope), scope.name(name)
            at = scope.name(relative_to(joint)) or child
            self.frames.add(full, Frame(joint, at, pose(source, joint), child))
            self.joints.append((full, scope, joint))
        for name, frame in source.named(parent, "frame").items():
            to, full = scope.name(frame.get("attached_to", "")) or scope.own, scope.name(name)
            at = scope.name(relative_to(frame)) or to
            self.frames.add(full, Frame(frame, at, pose(source, frame), to))
            self.marks.append((full, frame))
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
        self.frames.add(name, Frame(model, own, pin.SE3.Identity(), own))

    def end(self, joint: etree._Element, end: str, scope: Scope) -> str:
        """Return the frame that a joint names as its <parent> or <child>."""
        if not (name := words(joint, end)):
            what = f"joint {joint.get('name')!r} has no <{end}>"
            self._source.fail(what, f"add <{end}>LINK</{end}>")
        return scope.name(name)


def _canonical(model: etree._Element, scope: Scope) -> str:
    """Return the frame that the frame of a model moves with: its canonical link, or the first."""
    if name := model.get("canonical_link"):
        return scope.name(name)
    for child in (*model.findall("link"), *model.findall("model"), *model.findall("include/model")):
        return scope.name(child.get("name", ""))
    return WORLD
