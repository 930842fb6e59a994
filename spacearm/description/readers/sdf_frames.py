"""SDF frames: the links, joints and frames of a file, those of nested models and includes too.

Every frame has a pose relative to another one, as SDFormat's "Pose frame semantics" says; names of
what is inside a nested model start with the model's name and "::".
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from lxml import etree

from spacearm.description.readers import urdf
from spacearm.description.readers.forest import warn_of_balls
from spacearm.description.readers.packages import MODEL_FOLDERS
from spacearm.description.readers.source import WRITTEN, Source, describe, in_xacro, line_of
from spacearm.description.tree import Tree, free_name
from spacearm.errors import listed, unknown
from spacearm.files import is_there, named_files, normalised


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
        robots: URDFs that are included, with what comes before their names.
    """

    def __init__(self, source: Source, root: etree._Element, version: tuple[int, ...]) -> None:
        self._source, self._renames = source, version < ONE_NAME
        worlds, models = root.findall("world"), root.findall("model")
        if len(worlds) + len(models) != 1:
            what = f"{len(worlds)} <world> and {len(models)} <model>"
            more = "keep one of them in a file" if worlds or models else "it needs one"
            source.fail(f"has {what} below <sdf>", more)
        self.name = source.path.stem
        self.frames = Frames(source)
        self.frames.add(WORLD, Frame(root, None, pin.SE3.Identity(), WORLD))
        self.links: list[tuple[str, Scope, etree._Element]] = []
        self.joints: list[tuple[str, Scope, etree._Element]] = []
        self.marks: list[tuple[str, etree._Element]] = []
        self.robots: list[tuple[str, Tree]] = []
        top = Scope("", WORLD)
        for world in worlds:
            self._contents(world, top)
        for model in models:
            self.name = model.get("name") or self.name
            self._model(model, top, Scope("", MODEL))
        if not (self.links or self.robots):
            source.fail("has no links", "describe the spacecraft and its arm by <link> and <joint>")

    def _model(self, model: etree._Element, outer: Scope, scope: Scope) -> None:
        """Read a model: its own frame, then what is in it.

        Args:
            model: The model.
            outer: Where it is.
            scope: What is in it.
        """
        at, to = outer.name(relative_to(model)) or outer.own, _canonical(model, scope)
        placed_by = scope.name(model.get("placement_frame", ""))
        self.frames.add(scope.own, Frame(model, at, pose(self._source, model), to, placed_by))
        self._contents(model, scope)

    def _contents(self, parent: etree._Element, scope: Scope) -> None:
        """Read what is in a model or a world."""
        source = self._source
        for link in source.named(parent, "link").values():
            self.links.append((self._placed(link, scope, scope.own), scope, link))
        for joint in source.named(parent, "joint").values():
            child = self.end(joint, "child", scope)
            self.joints.append((self._placed(joint, scope, child, child), scope, joint))
        for frame in source.named(parent, "frame").values():
            to = scope.name(frame.get("attached_to", "")) or scope.own
            self.marks.append((self._placed(frame, scope, to, to), frame))
        for model in parent.findall("model"):
            self._nested(model, scope)
        for include in parent.findall("include"):
            needed = parent.tag == "model"
            taken, robot = included(source, include, needed=needed)
            if taken is None:
                continue
            if include.get("merge") in ("true", "1"):
                if robot:
                    source.fail(f"{_said(include)} merges a URDF", "leave out merge='true'")
                own = scope.name(f"__merged_{taken.get('name')}__")
                self._model(taken, scope, Scope(scope.prefix, own))
            else:
                self._nested(taken, scope, robot)

    def _placed(self, element: etree._Element, scope: Scope, at: str, to: str = "") -> str:
        """Add the frame of a link, a joint or a <frame>, and return its name from the top.

        Args:
            element: The element.
            scope: Where it is.
            at: The frame that its pose is given in, unless it names another.
            to: The frame that it moves with; itself if empty.
        """
        name = scope.name(element.get("name", ""))
        if name in self.frames.frames and self._renames and element.tag != "link":
            name = free_name(f"{name}_{element.tag!s}", self.frames.frames.__contains__)
        at = scope.name(relative_to(element)) or at
        self.frames.add(name, Frame(element, at, pose(self._source, element), to or name))
        return name

    def _nested(self, model: etree._Element, scope: Scope, robot: Tree | None = None) -> None:
        """Read a nested model, in whose names its own comes first; a URDF brings its links."""
        name = scope.name(model.get("name", ""))
        self._model(model, scope, Scope(f"{name}::", f"{name}::{MODEL}"))
        own = f"{name}::{MODEL}"
        self.frames.add(name, Frame(model, own, pin.SE3.Identity(), own))
        if robot:
            self.robots.append((f"{name}::", robot))
            for link, at in robot.frames.items():
                self.frames.add(f"{name}::{link}", Frame(model, own, at, f"{name}::{link}"))

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


WORLD, MODEL = "world", "__model__"
#: From this version on no joint or frame has the name of a link; before, it gets another one.
ONE_NAME = (1, 7)

#: Largest number of frames that lead one by one from a frame to the world, or to its link.
MOST_STEPS = 1000


@dataclass
class Frame:
    """A frame.

    Attributes:
        element: The element that defines it.
        relative_to: Name of the frame that its pose is given in; None for the world.
        pose: The pose.
        attached_to: Name of the frame that it moves with; itself for a link.
        placed_by: Name of the frame inside a model that the model's pose places, in place of the
            model's own; see `placement_frame`. Empty if there is none.
    """

    element: etree._Element
    relative_to: str | None
    pose: pin.SE3
    attached_to: str
    placed_by: str = ""


@dataclass
class Frames:
    """All frames of a file, by their names from the top.

    Attributes:
        source: The file.
        frames: The frames.
    """

    source: Source
    frames: dict[str, Frame] = field(default_factory=dict)

    def add(self, name: str, frame: Frame) -> None:
        """Add a frame; no two have one name."""
        if other := self.frames.get(name):
            given = name.removesuffix(f"::{MODEL}")
            lines = f"lines {other.element.sourceline} and {frame.element.sourceline}"
            self.source.fail(
                f"two frames, links, joints or models are named {given!r} ({lines})", "rename one"
            )
        self.frames[name] = frame

    def link_of(self, name: str, user: etree._Element) -> str:
        """Return the link that a frame moves with, or "world"."""
        *_, (link, _) = self._along(name, user, "attached_to")
        return link

    def pose(self, name: str, of: str, user: etree._Element) -> pin.SE3:
        """Return the pose of a frame in another one, from their last common frame on."""
        ours, theirs = self._way(name, user), self._way(of, user)
        while len(ours) > 1 and len(theirs) > 1 and ours[-2][0] == theirs[-2][0]:
            ours.pop()
            theirs.pop()
        up, down = (
            reduce(lambda pose, step: step[1] * pose, way[:-1], pin.SE3.Identity())
            for way in (ours, theirs)
        )
        return down.inverse() * up

    def _way(self, name: str, user: etree._Element) -> list[tuple[str, pin.SE3]]:
        """Return the frames from one up to the world, each with its pose in the next."""
        return [
            (at, frame.pose * self._inside(frame.placed_by or at, at, user).inverse())
            for at, frame in self._along(name, user)
        ]

    def _along(
        self, name: str, user: etree._Element, onward: str = "relative_to"
    ) -> Iterator[tuple[str, Frame]]:
        """Yield a frame and those that lead on from it, by `relative_to` or `attached_to`.

        Args:
            name: The first frame.
            user: What uses it.
            onward: The attribute that leads on.
        """
        seen: dict[str, None] = {}
        while True:
            frame = self._frame(name, user)
            if name in seen:
                placed = "is attached to" if onward == "attached_to" else "has a pose relative to"
                way = f"{placed} itself, by way of {listed(seen)}"
                self.source.fail(f"{describe(frame.element)} {way}", "cut that loop")
            if len(seen) >= MOST_STEPS:
                self.source.fail(
                    f"{describe(user)} is placed by way of more than {MOST_STEPS:,} frames",
                    "give the pose relative to the model",
                )
            seen[name] = None
            yield name, frame
            following = getattr(frame, onward)
            if following in (None, name):
                return
            name = following

    def _inside(self, name: str, model: str, user: etree._Element) -> pin.SE3:
        """Return the pose of a frame of a model in the model's own frame."""
        pose, at = pin.SE3.Identity(), name
        for at, frame in self._along(name, user):
            if at == model:
                return pose
            pose = frame.pose * pose
        self.source.fail(
            f"{describe(user)} is placed by {at!r}, which is not inside it", "name a frame of it"
        )

    def _frame(self, name: str, user: etree._Element) -> Frame:
        if name not in self.frames:
            self.source.fail(f"{describe(user)}: {unknown('frame', name, self.frames)}", "name one")
        return self.frames[name]


#: Most includes in one another; more are a loop.
DEEPEST = 20


def included(
    source: Source, include: etree._Element, *, needed: bool
) -> tuple[etree._Element | None, Tree | None]:
    """Return the <model> that an <include> means, under its own name and at its own pose.

    If it means a URDF, the <model> is empty and the robot comes with it.

    Args:
        source: The file.
        include: The element.
        needed: Whether a model that is not found is a fault; else it is left out with a warning.

    Raises:
        ModelError: The file is not found, or holds no model.
    """
    uri, said = words(include, "uri"), _said(include)
    refused: list[str] = []
    path = next(_candidates(source, uri, refused), None)
    if path is None:
        problem = f"{said} means {refused[0]}" if refused else f"{said} is not found"
        if not needed:
            source.warn(f"{problem}: left out")
            return None, None
        source.fail(
            problem,
            "name the folder that holds it with packages=[FOLDER], or write the file out whole: "
            "gz sdf -p FILE",
        )
    if sum(1 for _ in include.iterancestors("include")) > DEEPEST:
        source.fail(f"{said} is more than {DEEPEST} deep", "cut the loop")
    inner = Source(path, replace(source.reading, rigid=True, tips=()))
    root = inner.root()
    if in_xacro(path, root):
        source.fail(f"{said} means {path}, a xacro source", "expand it first: xacro FILE > FILE")
    if root.tag == "robot":
        robot = urdf.read(inner, root)
        warn_of_balls(inner, robot)
        source.notes += inner.notes
        model = etree.Element("model", name=robot.name, canonical_link=robot.root)
        return _placed(model, include), robot
    models = root.findall("model")
    if root.tag != "sdf" or len(models) != 1:
        source.fail(f"{said} means {path}, which has no one <model>", "name another")
    for element in models[0].iter(etree.Element):
        element.set(WRITTEN, f"line {element.sourceline} of {uri}")
        named = (element.text or "").strip() if element.tag == "uri" else ""
        if named:
            element.text = _from_top(inner, named)
    return _placed(models[0], include), None


def _said(include: etree._Element) -> str:
    return f"<include> of {words(include, 'uri')!r} ({line_of(include)})"


def _placed(model: etree._Element, include: etree._Element) -> etree._Element:
    """Return a copy of a model with the name and the pose that its <include> gives it.

    The copy hangs below the include, so that includes inside it know how deep they are.
    """
    copy = deepcopy(model)
    for tag in ("name", "placement_frame"):
        if given := words(include, tag):
            copy.set(tag, given)
    if (at := include.find("pose")) is not None:
        for old in copy.findall("pose"):
            copy.remove(old)
        copy.append(deepcopy(at))
    include.append(copy)
    return copy


def _from_top(inner: Source, uri: str) -> str:
    """Return what a URI of an included file is called in the file that includes it.

    A path relative to the included file becomes that of the file or folder, if it may be read.
    """
    path = normalised(inner.path.parent / uri)
    return str(path) if is_there(path) and inner.packages.holds(path) else uri


def _candidates(source: Source, uri: str, refused: list[str]) -> Iterator[Path]:
    """Yield the files that a URI may mean, the most likely one first.

    Args:
        source: The file that names it.
        uri: The URI.
        refused: Gets what exists and is not read: its path and the reason.
    """
    scheme, _, rest = uri.strip().replace("\\", "/").rpartition("://")
    places: list[tuple[Path, str]] = []
    if scheme in ("", "file") and rest:
        places = [(source.path.resolve().parent, rest)]
    if scheme in ("", "model", "package"):
        relative = rest.lstrip("/")
        for place in chain(*(os.environ.get(name, "").split(os.pathsep) for name in MODEL_FOLDERS)):
            if place:
                places.append((Path(place), relative))
        package, _, inner = relative.partition("/")
        if package and (found := source.packages.find(package)):
            places.append((found, inner.lstrip("/")))
    for folder, name in places:
        yield from _model_files(source, folder, name, refused)


def _version(element: etree._Element) -> list[int]:
    """Return the version of SDFormat that an element of a model.config states; [] for none."""
    try:
        return [int(number) for number in element.get("version", "0").split(".")]
    except ValueError:
        return []


def _model_files(source: Source, folder: Path, name: str, refused: list[str]) -> Iterator[Path]:
    """Yield a file, or the files of a model's folder: those of its model.config, newest first."""

    def named(*parts: str) -> list[Path]:
        files = named_files(str(Path(name, *parts)), [folder], source.packages.holds)
        refused.extend(files.refused)
        return files.found

    yield from named()
    for config in named("model.config"):
        sdfs = Source(config).root().findall("sdf")
        newest = sorted(sdfs, key=_version)
        for element in reversed(newest):
            yield from named((element.text or "").strip())
    yield from named("model.sdf")


def pose(source: Source, parent: etree._Element) -> pin.SE3:
    """Read the <pose> of an element: position and roll, pitch, yaw, or a quaternion xyzw."""
    element = source.child(parent, "pose")
    if element is None or not (element.text or "").strip():
        return pin.SE3.Identity()
    quaternion = element.get("rotation_format") == "quat_xyzw"
    values = source.values(element, "<pose>", element.text or "", 7 if quaternion else 6)
    if quaternion:
        zero = f"{describe(element)} has a zero quaternion"
        unit = source.unit(values[3:], zero, "give one of length 1")
        return pin.SE3(pin.Quaternion(unit).matrix(), values[:3])
    if element.get("degrees") in ("true", "1"):
        values[3:] = np.radians(values[3:])
    return pin.SE3(pin.rpy.rpyToMatrix(values[3:]), values[:3])


def relative_to(parent: etree._Element) -> str:
    """Return the frame that the <pose> of an element names; an empty text for the default."""
    element = parent.find("pose")
    return "" if element is None else element.get("relative_to", "")


def words(element: etree._Element, tag: str) -> str:
    """Return the text of a child element, without blanks around it."""
    return (element.findtext(tag) or "").strip()
