"""Mimics: joints that follow others, checked; the same for every format."""

from __future__ import annotations

from spacearm.description.bodies import Joint
from spacearm.description.readers.xml import Source
from spacearm.description.tree import ROOT_JOINT
from spacearm.errors import unknown


def check_mimics(source: Source, joints: dict[str, Joint]) -> None:
    """Check that mimic joints lead to others; those of fixed joints are fixed too."""
    if ROOT_JOINT in joints:
        source.fail(f"joint {ROOT_JOINT!r} has the name of the free root joint", "rename it")
    for joint in list(joints.values()):
        if joint.mimic and (leader := joints.get(joint.mimic.leader)) and leader.kind == "fixed":
            joints[joint.name] = joint.frozen(joint.mimic.offset)
            source.warn(f"joint {joint.name!r} mimics {leader.name!r}, which is fixed, and is too")
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
