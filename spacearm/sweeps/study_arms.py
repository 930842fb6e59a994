"""The arms that a study names, and the fingerprints that tell whether they have changed."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import cast

from spacearm.description.model_catalogue import catalogue
from spacearm.description.readers.source import Check
from spacearm.description.tips import Counting
from spacearm.description.urdf_writer import document
from spacearm.errors import ConfigurationError
from spacearm.model.arm import SpaceArm
from spacearm.model.loading import load
from spacearm.model.task import Task
from spacearm.sweeps.toml import Table

READING = ("packages", "xacro_args", "density")
"""Keys of an arm that say how its file is read, as in `load`."""


def read_arms(table: Table, folder: Path) -> dict[str, SpaceArm]:
    """Read the arms of a study, by their names in it.

    Args:
        table: The study.
        folder: Folder that paths of robot files start from.

    Raises:
        ConfigurationError: No arm is named, or two have one name.
        ModelError: An arm is unsound.
    """
    listed = table.take("arms", list)
    arms: dict[str, SpaceArm] = {}
    for entry in listed:
        own = Table("arms", {"model": entry} if isinstance(entry, str) else entry)
        own.knows("model", "name", "tip", "task", "length", "joints", "locked", "check", *READING)
        model = own.take("model", str)
        name = own.take("name", str, Path(model).stem)
        if name in arms:
            raise ConfigurationError(f"arms: two are named {name!r}; give one another name = ...")
        arms[name] = _arm(own, model, folder)
    if not arms:
        raise table.fail("arms", "name one or more")
    return arms


def _arm(own: Table, model: str, folder: Path) -> SpaceArm:
    known = model in (info.name for info in catalogue())
    given = {key: own.take(key, str) for key in ("tip", "task", "check") if key in own.values}
    held = Table("arms: locked", own.values.get("locked", {}))
    arm = load(
        model if known else folder / model,
        tip=given.get("tip"),
        task=given.get("task"),
        joints=_counting(own),
        locked={joint: held.take(joint, float) for joint in held.values},
        check=cast("Check | None", given.get("check")),
        packages=[folder / name for name in _texts(own, "packages")],
        xacro_args=own.take("xacro_args", dict, {}),
        density=own.positive("density", float) if "density" in own.values else None,
    )
    if "length" not in own.values:
        return arm
    return arm.replace(task=Task(arm.task.names, own.positive("length", float)))


def _texts(own: Table, key: str) -> list[str]:
    listed = own.take(key, list, [])
    if not all(isinstance(text, str) for text in listed):
        raise own.fail(key, "give a list of texts")
    return listed


def fingerprint(arm: SpaceArm) -> str:
    """Return the SHA-256 of links and joints as URDF, without their visuals."""
    return hashlib.sha256(document(replace(arm.tree, visuals={}), arm.tips)).hexdigest()


def _counting(own: Table) -> Counting:
    """Read which joints count: "tip", "all" or a list of names."""
    if isinstance(own.values.get("joints"), list):
        return _texts(own, "joints")
    return cast("Counting", own.take("joints", str, "tip"))
