"""Catalogue: the models and the arms that travel with the package, by name."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from spacearm.arrays import plain
from spacearm.description.readers.formats import RobotSource
from spacearm.description.readers.pinocchio_model import PINOCCHIO_MODELS
from spacearm.description.readers.source import Check
from spacearm.errors import ModelError, listed, unknown

MODELS, ARMS = "catalogue.json", "arms.json"

Entry = TypeVar("Entry")


class ModelInfo(NamedTuple):
    """A model of the catalogue: a spacecraft with its arms.

    Attributes:
        name: Name that `load` takes.
        summary: Short description.
        source: Publication of its numbers.
        n: Number of movable joints.
        tip: Tip link.
        task: Default task.
        path: Its URDF; the catalogue's file, with its recipe, for a model that is put together.
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
    check: Check
    recipe: dict[str, Any] | None

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain data."""
        return {name: plain(value) for name, value in self._asdict().items()}


class ArmInfo(NamedTuple):
    """An arm without a spacecraft.

    Attributes:
        name: Name that `mount` takes.
        summary: Short description.
        source: Publication of its numbers.
        tip: Tip link.
        path: Its URDF.
    """

    name: str
    summary: str
    source: str
    tip: str
    path: Path

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain data."""
        return {name: plain(value) for name, value in self._asdict().items()}


def catalogue() -> tuple[ModelInfo, ...]:
    """Return the models that `load` knows by name.

    Returns:
        The models, in the order of `spacearm models`.

    Example:
        >>> import spacearm as sa
        >>> [model.name for model in sa.catalogue()][:3]
        ['planar2', 'planar3', 'mda6']
    """
    return tuple(models_by_name().values())


def arms() -> tuple[ArmInfo, ...]:
    """Return the arms that `mount` knows by name.

    Returns:
        The arms; `path` may lead into the package example-robot-data.

    Example:
        >>> import spacearm as sa
        >>> [arm.name for arm in sa.arms()]
        ['vispa', 'ur5', 'ur10', 'panda', 'kinova', 'xarm7', 'z1']
    """
    return tuple(arms_by_name().values())


def find_model(model: RobotSource) -> ModelInfo | None:
    """Return the model of a name, or None for the path of a file or a model of Pinocchio.

    Raises:
        ModelError: It is neither, or the name of an arm.
    """
    known = models_by_name()
    if isinstance(model, str) and model not in known and model in arms_by_name():
        raise ModelError(
            f"{model} is an arm without a spacecraft; mount it on one: "
            f"sa.mount({model!r}, sa.Bus(mass=..., size=...))"
        )
    return _named("model", model, known)


def find_arm(arm: RobotSource) -> ArmInfo | None:
    """Return the arm of a name, or None for the path of a file or a model of Pinocchio.

    Raises:
        ModelError: It is neither, or the data of the arm is not installed.
    """
    info = _named("arm", arm, arms_by_name())
    if info and not info.path.is_file():
        raise ModelError(
            f"{info.name}: {info.path} is missing; pip install 'example-robot-data>=6,<7'"
        )
    return info


def models_folder() -> Path:
    """Return the folder of the models: in the installed package, or beside it in a source tree."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "models"
    return installed if installed.is_dir() else package.parent / "models"


@cache
def models_by_name() -> dict[str, ModelInfo]:
    """Return the models by their names."""
    optional = {"check": "error", "recipe": None}
    return {
        name: ModelInfo(
            name=name,
            path=models_folder() / entry.pop("file", MODELS),
            **{**optional, **entry},
        )
        for name, entry in _entries(MODELS)
    }


@cache
def arms_by_name() -> dict[str, ArmInfo]:
    """Return the arms by their names."""
    return {
        name: ArmInfo(name=name, path=_path_of_arm(entry), **entry)
        for name, entry in _entries(ARMS)
    }


def _entries(file: str) -> list[tuple[str, dict[str, Any]]]:
    """Read names and fields out of a JSON file of the models' folder."""
    return list(json.loads((models_folder() / file).read_text(encoding="utf-8")).items())


def _path_of_arm(entry: dict[str, Any]) -> Path:
    """Take the path out of the fields of an arm: "file" of ours or "robot" of the robots."""
    if "file" in entry:
        return models_folder() / entry.pop("file")
    return _robots_folder() / entry.pop("robot")


def _robots_folder() -> Path:
    """Return the folder where the package example-robot-data keeps its robots."""
    from importlib.metadata import PackageNotFoundError, distribution  # slow to import

    try:
        files = distribution("example-robot-data")
    except PackageNotFoundError:
        return Path("example-robot-data")  # where there is none
    return Path(str(files.locate_file("cmeel.prefix/share/example-robot-data/robots")))


def _named(kind: str, model: RobotSource, known: Mapping[str, Entry]) -> Entry | None:
    """Return the entry of a name, or None for the path of a file or a model of Pinocchio.

    Raises:
        ModelError: It is none of them.
    """
    if isinstance(model, PINOCCHIO_MODELS):
        return None
    if not isinstance(model, (str, os.PathLike)):
        raise ModelError(
            f"a {type(model).__name__} is no robot; give the path of a URDF, xacro, MJCF or SDF, a "
            f"pin.Model, or one of the names: {listed(known)}"
        )
    if isinstance(model, os.PathLike):
        if str(model) in known and not Path(model).exists():
            raise ModelError(
                f"{model}: no such file; the {kind} of that name is {str(model)!r}, as text"
            )
        return None
    if isinstance(model, str) and model in known:
        return known[model]
    if isinstance(model, str) and (model.lstrip().startswith("<") or "://" in model):
        return None  # no path: the reader says what it is
    try:
        path = Path(model)
        if path.exists() or (path.suffix and path.stem not in known) or len(path.parts) > 1:
            return None
    except (TypeError, ValueError, OSError):
        pass  # no path at all
    raise ModelError(f"{unknown(kind, model, known)}; or give the path of a robot file")
