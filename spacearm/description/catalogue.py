"""The models that travel with the package."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import pinocchio as pin

from spacearm.arrays import plain
from spacearm.description.arms import arms_by_name, named
from spacearm.description.assembly import bolted
from spacearm.description.bus import Bus
from spacearm.description.readers import urdf
from spacearm.description.tree import Tree
from spacearm.errors import ModelError
from spacearm.files import models_folder

CATALOGUE = "catalogue.json"


class ModelInfo(NamedTuple):
    """One model of the catalogue.

    Attributes:
        name: Name that `load` takes.
        summary: What it is.
        source: Where its numbers were published.
        n: Number of movable joints.
        tip: Tip link.
        task: Default task.
        path: Its URDF; for a model that is put together the catalogue's file, with its recipe.
        check: How `load` treats its inertias: "error", or "accept" where the published data has
            faults, which the URDF names.
        recipe: The bus and the arms that a model is put together from, as `Bus` and `mount` take
            them; None for a URDF.
    """

    name: str
    summary: str
    source: str
    n: int
    tip: str
    task: str
    path: Path
    check: urdf.Check
    recipe: dict[str, Any] | None

    def to_dict(self) -> dict[str, Any]:
        """All fields as plain data."""
        return {name: plain(value) for name, value in self._asdict().items()}


def catalogue() -> tuple[ModelInfo, ...]:
    """The models that `load` knows by name."""
    return tuple(_read().values())


def find(model: str | os.PathLike[str]) -> ModelInfo | None:
    """The catalogue's entry for a name, or None if `model` is the path of a file.

    Raises:
        ModelError: `model` is neither.
    """
    if isinstance(model, str) and model in arms_by_name():
        raise ModelError(
            f"{model} is an arm without a spacecraft; mount it on one: "
            f"sa.mount({model!r}, sa.Bus(mass=..., size=...))"
        )
    return named("model", model, _read())


def read(info: ModelInfo, check: urdf.Check | None = None) -> Tree:
    """The links and joints of a model, read or put together."""
    if info.recipe is None:
        return urdf.read(info.path, check or info.check)
    tree = Bus(**info.recipe["bus"]).tree()
    for arm in info.recipe["arms"]:
        at = pin.SE3(np.eye(3), np.array(arm["xyz"]))
        tree = bolted(tree, arm["arm"], at, name=arm["name"], check=check or info.check)
    return replace(tree, name=info.name, tips=(info.tip,))


@cache
def _read() -> dict[str, ModelInfo]:
    entries = json.loads((models_folder() / CATALOGUE).read_text(encoding="utf-8"))
    return {name: _info(name, entry) for name, entry in entries.items()}


def _info(name: str, entry: dict[str, Any]) -> ModelInfo:
    return ModelInfo(
        name=name,
        summary=str(entry["summary"]),
        source=str(entry["source"]),
        n=int(entry["n"]),
        tip=str(entry["tip"]),
        task=str(entry["task"]),
        path=models_folder() / str(entry.get("file", CATALOGUE)),
        check=cast("urdf.Check", entry.get("check", "error")),
        recipe=entry.get("recipe"),
    )
