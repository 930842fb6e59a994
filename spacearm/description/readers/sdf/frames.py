"""SDF frames: the frames that links, joints, models and <frame>s of a file define, and their poses.

Every frame has a pose relative to another one, as SDFormat's "Pose frame semantics" says; names of
what is inside a nested model start with the model's name and "::".
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import reduce

import pinocchio as pin
from lxml import etree

from spacearm.description.readers.xml import Source, describe
from spacearm.errors import listed, unknown

WORLD, MODEL = "world", "__model__"

MOST_STEPS = 1000
"""Largest number of frames that lead one by one from a frame to the world, or to its link."""


@dataclass
class Frame:
    """A frame.

    Attributes:
        element: The element that defines it.
        relative_to: Name of the frame that its pose is given in; None for the world.
        pose: The pose.
        attached_to: Name of the frame that it moves with; itself for a link.
        placed_by: Name of the frame inside a model that the model's pose places, in place of the
            model's own; see `placement_frame`.
    """

    element: etree._Element
    relative_to: str | None
    pose: pin.SE3
    attached_to: str
    placed_by: str | None = None


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
            lines = f"lines {other.element.sourceline} and {frame.element.sourceline}"
            self.source.fail(
                f"two frames, links, joints or models are named {name!r} ({lines})", "rename one"
            )
        self.frames[name] = frame

    def link_of(self, name: str, user: etree._Element) -> str:
        """Return the link that a frame moves with, or "world"."""
        seen: set[str] = set()
        while (frame := self._frame(name, user)).attached_to != name:
            if name in seen:
                self.source.fail(
                    f"{describe(user)}: {name!r} is attached to itself", "cut that loop"
                )
            seen.add(name)
            self._not_too_long(len(seen), user)
            name = frame.attached_to
        return name

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
        way: dict[str, pin.SE3] = {}
        while True:
            frame = self._frame(name, user)
            if name in way:
                self.source.fail(
                    f"{describe(frame.element)} has a pose relative to itself, by way of "
                    f"{listed([*way])}",
                    "cut that loop",
                )
            pose = frame.pose
            if frame.placed_by:
                pose = pose * self._inside(frame.placed_by, name, user).inverse()
            way[name] = pose
            self._not_too_long(len(way), user)
            if frame.relative_to is None:
                return [*way.items()]
            name = frame.relative_to

    def _not_too_long(self, steps: int, user: etree._Element) -> None:
        """Refuse long ways, of which a file may have as many as frames."""
        if steps > MOST_STEPS:
            self.source.fail(
                f"{describe(user)} is placed by way of more than {MOST_STEPS:,} frames",
                "give the pose relative to the model",
            )

    def _inside(self, name: str, model: str, user: etree._Element) -> pin.SE3:
        """Return the pose of a frame of a model in the model's own frame."""
        pose = pin.SE3.Identity()
        for _ in self.frames:
            if name == model:
                return pose
            frame = self._frame(name, user)
            if frame.relative_to is None:
                break
            pose, name = frame.pose * pose, frame.relative_to
        self.source.fail(
            f"{describe(user)} is placed by {name!r}, which is not inside it", "name a frame of it"
        )

    def _frame(self, name: str, user: etree._Element) -> Frame:
        if name not in self.frames:
            self.source.fail(f"{describe(user)}: {unknown('frame', name, self.frames)}", "name one")
        return self.frames[name]
