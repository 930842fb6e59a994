"""Choices: what the page asks for, checked: numbers, and an arm with its tip, task and joints."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pinocchio as pin

from spacearm.arrays import LARGEST, Array
from spacearm.description.model_catalogue import catalogue, source_of
from spacearm.description.readers.source import ROBOTS
from spacearm.errors import ConfigurationError, ModelError, SpaceArmError, require_known
from spacearm.files import write
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.loading import load

T = TypeVar("T", str, list[str], dict[str, object])

#: How much the length of a quaternion may be off.
ROUNDED = 1e-6


def number(value: object, what: str) -> float:
    """Return a number out of a message.

    Raises:
        ConfigurationError: It is not a finite number; names it by `what`.
    """
    if isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= LARGEST:
        return float(value)
    raise ConfigurationError(f"{what} is {str(value)[:40]!r}; give a finite number")


def numbers(value: object, count: int, what: str) -> Array:
    """Return so many numbers out of a message.

    Raises:
        ConfigurationError: It is not a list of as many finite numbers; names it by `what`.
    """
    if not isinstance(value, list) or len(value) != count:
        raise ConfigurationError(f"{what} is {str(value)[:40]!r}; give {count} numbers")
    return np.array([number(x, what) for x in value])


def placement(value: object, what: str) -> pin.SE3:
    """Return a pose out of a message: position [m] and quaternion xyzw, of length 1.

    Raises:
        ConfigurationError: It is not a pose; names it by `what`.
    """
    pose = numbers(value, 7, what)
    if abs(float(np.linalg.norm(pose[3:])) - 1.0) > ROUNDED:
        raise ConfigurationError(f"{what}: the quaternion {pose[3:].tolist()} has no length 1")
    return pin.XYZQUATToSE3(pose)


#: Characters of a file's name that are kept.
LONGEST_NAME = 60
MOST_WARNINGS = 5


class Origin(NamedTuple):
    """Where the arm on show comes from.

    Attributes:
        source: What `load` is given for it.
        arm: The arm before joints were locked in the page.
        locked: Those joints, with their values [rad] or [m].
        made: How the source comes about, where it is a file that is not there.
        changed: Whether the arm is another one than that of the source, as one with joints locked.
    """

    source: str
    arm: SpaceArm
    locked: Mapping[str, float]
    made: str = "by arm.to_urdf"
    changed: bool = False

    @classmethod
    def of(cls, arm: SpaceArm) -> Origin:
        """Return the origin of an arm that was made in Python."""
        source = source_of(arm.name, arm.path)
        return cls(source, arm, {}, changed=_is_changed(arm, source))


def _is_changed(arm: SpaceArm, source: str) -> bool:
    """Tell whether `load` gives another arm than this; where it gives none, `made` says so."""
    tip = arm.tips[0] if len(arm.tips) == 1 else arm.tips
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            wheels = [wheel.name for wheel in arm.wheels]
            again = load(source, tip=tip, task=arm.task.names, joints=arm.joints, wheels=wheels)
    except SpaceArmError:
        return False
    if (again.joint_names, again.task) != (arm.joint_names, arm.task):
        return True
    one, other = again.model, arm.model
    bodies = zip(one.inertias, other.inertias, strict=False)  # as many, if the names are the same
    return list(one.names) != list(other.names) or not all(a.isApprox(b) for a, b in bodies)


def offered(arm: SpaceArm, origin: Origin) -> dict[str, Any]:
    """Return the catalogue's names, which of them an arm is, and its tips and joints."""
    tree = origin.arm.whole
    moved = {joint.child for joint in tree.joints.values()}
    robots = [info.name for info in catalogue()]
    return {
        "robots": robots,
        "suffixes": ROBOTS,
        "robot": origin.source if origin.source in robots else None,
        "links": [link for link in tree.links if link in moved],
        "joints": list(dict.fromkeys((*arm.joint_names, *origin.locked, *arm.held))),
        "counted": list(arm.joint_names),
        "locked": dict(origin.locked),
        "task": " ".join(arm.task.rows),
    }


def chosen(
    cfg: Configuration, origin: Origin, message: dict[str, Any], folder: Path
) -> tuple[SpaceArm, Origin, str]:
    """Return the arm that a message asks for.

    Args:
        cfg: The configuration on show; joints that are locked stay where they are in it.
        origin: Where its arm comes from.
        message: `robot`, a name of the catalogue, or `file` with `name` and `text`, or neither for
            the present arm. `tip`, `task` and `joints`, the names of all that count, if they are
            not those that `load` finds, or those of the present arm. `locked`, values of those
            that do not count, if they are not to stay [rad] or [m].
        folder: Where a file may be written.

    Returns:
        The arm, where it comes from, and the warnings of its reading.

    Raises:
        ConfigurationError: The message makes no sense.
        SpaceArmError: The robot cannot be loaded.
    """
    texts = {name: _given(message, name, str, "a text") for name in ("tip", "task")}
    options: dict[str, Any] = {name: text for name, text in texts.items() if text is not None}
    joints = _given(message, "joints", list, "a list of names")
    values = _given(message, "locked", dict, "values by joint") or {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        source, arm, kept, made, changed = origin
        locked = dict(kept)
        if (file := message.get("file")) is not None:
            source, path = _written(file, folder)
            arm, locked, made = _read(path, source), {}, "the file dropped on the page"
            changed = False
        elif (robot := message.get("robot")) is not None:
            names = [info.name for info in catalogue()]
            require_known("robot", str(robot)[:LONGEST_NAME], names)
            arm, source, locked, changed = load(str(robot)), str(robot), {}, False
        whole = arm.replace(**options) if options else arm
        if joints is not None:
            place = {**whole.held, **dict(zip(cfg.arm.joint_names, cfg.q.tolist(), strict=True))}
            locked |= {str(name): number(x, "locked joint") for name, x in values.items()}
            there = {name: locked.get(name, place.get(name, 0.0)) for name in whole.joint_names}
            locked = {name: value for name, value in there.items() if name not in joints}
            besides = [name for name in joints if name not in there]
            whole = whole.replace(joints=besides) if besides else whole
        locked = {name: value for name, value in locked.items() if name in whole.joint_names}
        found = whole.replace(locked=locked) if locked else whole
    said = dict.fromkeys(_told(str(warning.message), folder) for warning in caught)
    origin = Origin(source, whole, locked, made, changed)
    return found, origin, "; ".join(list(said)[:MOST_WARNINGS])


def _given(message: dict[str, Any], name: str, kind: type[T], words: str) -> T | None:
    """Return what a message has of a kind under a name; None if it has nothing."""
    value = message.get(name)
    if value is None or (isinstance(value, kind) and all(isinstance(key, str) for key in value)):
        return value
    raise ConfigurationError(f"{name} is {str(value)[:40]!r}; give {words}")


def _read(path: Path, name: str) -> SpaceArm:
    """Load a file that came with a message; errors have the name that it came with."""
    try:
        return load(path)
    except ModelError as error:
        raise ModelError(_told(str(error).replace(str(path), name), path.parent)) from error


def _told(words: str, folder: Path) -> str:
    """Return words without the folder in which files of the page stand for a moment."""
    return words.replace(f"{folder}{os.sep}", "")


def _written(file: object, folder: Path) -> tuple[str, Path]:
    """Write a file that came with a message, under a name without anything but letters.

    Returns:
        The name that it came with, and where it is.
    """
    if not isinstance(file, dict) or not isinstance(text := file.get("text"), str):
        raise ConfigurationError("file: give its name and its text")
    name = Path(str(file.get("name"))).name
    kind = Path(name).suffix.lower()
    if kind not in ROBOTS:
        raise ConfigurationError(f"file {name[:LONGEST_NAME]!r} is none of {', '.join(ROBOTS)}")
    stem = re.sub(r"[^A-Za-z0-9_-]+", "_", Path(name).stem)[:LONGEST_NAME] or "robot"
    return name, write(folder / f"{stem}{kind}", text.encode("utf-8", "replace"))
