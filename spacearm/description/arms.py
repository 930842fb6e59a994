"""Arms without a spacecraft that `mount` knows by name."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from spacearm.arrays import plain
from spacearm.errors import ModelError, unknown
from spacearm.files import models_folder

Entry = TypeVar("Entry")


class ArmInfo(NamedTuple):
    """One arm without a spacecraft.

    Attributes:
        name: Name that `mount` takes.
        summary: What it is.
        source: Where its numbers were published.
        tip: Tip link.
        locked: Joints that are frozen where nothing else is said, such as fingers, and where
            [rad] or [m].
        path: Its URDF.
    """

    name: str
    summary: str
    source: str
    tip: str
    locked: dict[str, float]
    path: Path

    def to_dict(self) -> dict[str, Any]:
        """All fields as plain data."""
        return {name: plain(value) for name, value in self._asdict().items()}


def arms() -> tuple[ArmInfo, ...]:
    """The arms that `mount` knows by name."""
    return tuple(arms_by_name().values())


@cache
def arms_by_name() -> dict[str, ArmInfo]:
    """The arms that `mount` knows, by their names."""
    entries = json.loads((models_folder() / "arms.json").read_text(encoding="utf-8"))
    return {name: _info(name, entry) for name, entry in entries.items()}


def find_arm(arm: str | os.PathLike[str]) -> ArmInfo | None:
    """The entry for a name, or None if `arm` is the path of a file.

    Raises:
        ModelError: `arm` is neither, or its data is not installed.
    """
    info = named("arm", arm, arms_by_name())
    if info and not info.path.is_file():
        raise ModelError(
            f"{info.name}: {info.path} is missing; pip install 'example-robot-data>=6,<7'"
        )
    return info


def named(kind: str, model: str | os.PathLike[str], known: Mapping[str, Entry]) -> Entry | None:
    """What has this name, or None if it is the path of a file.

    Raises:
        ModelError: It is neither.
    """
    if isinstance(model, os.PathLike):
        if str(model) in known and not Path(model).exists():
            raise ModelError(
                f"{model}: no such file; the {kind} of that name is {str(model)!r}, as text"
            )
        return None
    if isinstance(model, str) and model in known:
        return known[model]
    try:
        path = Path(model)
        if path.is_file() or (path.suffix and path.stem not in known) or len(path.parts) > 1:
            return None
    except (TypeError, ValueError, OSError):
        pass  # no path at all
    raise ModelError(f"{unknown(kind, model, known)}; or give the path of a .urdf file")


def _info(name: str, entry: dict[str, Any]) -> ArmInfo:
    file = entry.pop("file", None)
    path = models_folder() / file if file else _robots() / entry.pop("robot")
    return ArmInfo(name=name, path=path, **{"locked": {}, **entry})


def _robots() -> Path:
    """Where the package example-robot-data keeps its robots."""
    try:
        files = distribution("example-robot-data")
    except PackageNotFoundError:
        return Path("example-robot-data")  # where there is none
    return Path(str(files.locate_file("cmeel.prefix/share/example-robot-data/robots")))
