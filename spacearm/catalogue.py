"""The models that travel with the package."""

from __future__ import annotations

import json
import os
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, cast

from spacearm import urdf
from spacearm.arrays import plain
from spacearm.errors import ModelError, unknown


class ModelInfo(NamedTuple):
    """One model of the catalogue.

    Attributes:
        name: Name that `load` takes.
        summary: What it is.
        source: Where its numbers were published.
        n: Number of movable joints.
        tip: Tip link.
        task: Default task.
        path: Its URDF.
        check: How `load` treats its inertias: "error", or "accept" where the published data has
            faults, which the URDF names.
    """

    name: str
    summary: str
    source: str
    n: int
    tip: str
    task: str
    path: Path
    check: urdf.Check

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
    models = _read()
    if isinstance(model, str) and model in models:
        return models[model]
    try:
        path = Path(model)
        if path.is_file() or (path.suffix and path.stem not in models) or len(path.parts) > 1:
            return None
    except (TypeError, ValueError, OSError):
        pass  # no path at all
    raise ModelError(f"{unknown('model', model, models)}; or give the path of a .urdf file")


def folder() -> Path:
    """Where the models are: in the installed package, or beside it in a source tree."""
    package = Path(__file__).resolve().parent
    installed = package / "models"
    return installed if installed.is_dir() else package.parent / "models"


@cache
def _read() -> dict[str, ModelInfo]:
    entries = json.loads((folder() / "catalogue.json").read_text(encoding="utf-8"))
    return {name: _info(name, entry) for name, entry in entries.items()}


def _info(name: str, entry: dict[str, str | int]) -> ModelInfo:
    return ModelInfo(
        name=name,
        summary=str(entry["summary"]),
        source=str(entry["source"]),
        n=int(entry["n"]),
        tip=str(entry["tip"]),
        task=str(entry["task"]),
        path=folder() / str(entry["file"]),
        check=cast("urdf.Check", entry.get("check", "error")),
    )
