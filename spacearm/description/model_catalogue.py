"""Catalogue: the models and arms that come with the package, and models assembled from them."""

from __future__ import annotations

import difflib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pinocchio as pin

from spacearm.arrays import named
from spacearm.description.bodies import Inertial
from spacearm.description.bus import STEEL, Bus, body
from spacearm.description.readers import formats
from spacearm.description.readers.formats import RobotSource
from spacearm.description.readers.pinocchio_model import PINOCCHIO_MODELS
from spacearm.description.readers.source import Check, Reading
from spacearm.description.tips import choose_tips, only_tip
from spacearm.description.tree import Tree, free_name
from spacearm.errors import ModelError, unknown
from spacearm.signatures import checked

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
    check: Check = "error"
    recipe: dict[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain data."""
        return named(self)


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
        return named(self)


def source_of(name: str, path: Path) -> str:
    """Return what `load` is given for a robot: its catalogue name, or its file's path."""
    known = models_by_name().get(name)
    return name if known and known.path == path else str(path)


@checked
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


@checked
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
        ModelError: It is neither, or the name of a model with a spacecraft, or the data of the arm
            is not installed.
    """
    if isinstance(arm, str) and arm not in arms_by_name() and arm in models_by_name():
        raise ModelError(f"{arm} has a spacecraft; sa.load({arm!r}) loads it, with its arm")
    info = _named("arm", arm, arms_by_name())
    if info and not info.path.is_file():
        raise ModelError(f"no {info.path} of {info.name}; pip install 'example-robot-data>=6,<7'")
    return info


def models_folder() -> Path:
    """Return the folder of the models: in the installed package, or beside it in a source tree."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "models"
    return installed if installed.is_dir() else package.parent / "models"


@cache
def models_by_name() -> dict[str, ModelInfo]:
    """Return the models by their names."""
    folder = models_folder()
    return {
        name: ModelInfo(name=name, path=folder / entry.pop("file", MODELS), **entry)
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
    if isinstance(model, os.PathLike):
        if str(model) in known and not Path(model).exists():
            raise ModelError(
                f"{model}: no such file; the {kind} of that name is {str(model)!r}, as text"
            )
        return None
    if model in known:
        return known[model]
    if model.lstrip().startswith("<") or "://" in model:
        return None  # no path: the reader says what it is
    with suppress(ValueError, OSError):  # of what can be no path
        path = Path(model)
        if path.exists() or (path.suffix and path.stem not in known) or len(path.parts) > 1:
            return None
    message = f"{unknown(kind, model, known)}; or give the path of a robot file"
    near = difflib.get_close_matches(model, [] if kind == "arm" else arms_by_name(), n=1)
    also = f"; {near[0]!r} is an arm without a spacecraft, for sa.mount" if near else ""
    raise ModelError(message + also)


def assembled(info: ModelInfo, reading: Reading | None = None) -> Tree:
    """Return the tree of a catalogue model, read from its URDF or put together from its recipe.

    Args:
        info: The model.
        reading: How its files are read; as the catalogue says if None.
    """
    reading = reading or Reading(check=info.check)
    if info.recipe is None:
        return formats.read(info.path, reading)
    tree = Bus(**info.recipe["bus"]).tree()
    for arm in info.recipe["arms"]:
        at = pin.SE3(np.eye(3), np.array(arm["xyz"]))
        tree = bolted(tree, arm["arm"], at, name=arm.get("name"), reading=reading)
    return replace(tree, name=info.name, tips=(info.tip,))


def bolted(
    bus: Tree,
    arm: RobotSource,
    at: pin.SE3,
    *,
    name: str | None = None,
    tip: str | None = None,
    locked: Mapping[str, float] | None = None,
    reading: Reading | None = None,
) -> Tree:
    """Return a bus with one arm more; arguments, and the names that it gets, as in `loading.mount`.

    Raises:
        ModelError: The name is not a text, or taken.
    """
    known = find_arm(arm)
    path = known.path if known else formats.path_of(arm)
    tips = (tip,) if tip else ()
    alone = replace(
        reading or Reading(), spacecraft=False, locked=locked or {}, tips=tips, known=bool(known)
    )
    tree = formats.read(known.path if known else arm, alone)
    tree = replace(tree, name=known.name if known else tree.name)
    asked = tip or (known.tip if known else None)
    chosen = choose_tips(tree, path, asked)
    tip = only_tip(chosen.links, tree.name)
    tree = _named_on(bus, replace(tree, tips=(tip,)), name)
    name = tree.name
    whole = bus.joined(tree, name, bus.root, at)
    frame = Tree(name, name, {name: None}, {})
    whole = whole.joined(frame, f"{name}.tip", tree.tips[0], pin.SE3.Identity())
    found = () if asked else (f"the tip of {name} is {tip!r}: {chosen.reason}",)
    return replace(whole, name=f"{bus.name}_{name}", tips=tree.tips, notes=(*whole.notes, *found))


def _named_on(bus: Tree, arm: Tree, name: str | None) -> Tree:
    """Return an arm with the name, and the names of links and joints, that it gets on a bus.

    Raises:
        ModelError: The name is not a text, or taken.
    """
    base = {*arm.lumps[arm.root]}
    base |= {joint.name for joint in arm.joints.values() if joint.child in base}
    moving = {*arm.links, *arm.joints} - base
    if name is not None:
        if not isinstance(name, str) or not name:
            raise ModelError(f"name of the arm is {name!r}; give it as text")
        if bus.has(name):
            raise ModelError(f"{bus.name} has names that start with {name!r} already; take another")
        return replace(arm.renamed(lambda part: f"{name}_{part}"), name=name)

    def unfit(name: str) -> bool:
        return bus.has(name) or not moving.isdisjoint({name, *(f"{name}_{part}" for part in base)})

    name = free_name(arm.name, unfit)
    notes, changed = arm.notes, base
    if taken := sorted(moving & {*bus.links, *bus.joints}):
        notes += (
            f"all names of {name} start with '{name}_': {bus.name} has a {taken[0]!r} already",
        )
        changed = base | moving
    renamed = arm.renamed(lambda part: f"{name}_{part}" if part in changed else part)
    return replace(renamed, name=name, notes=notes)


def holding(tree: Tree, link: str, rigid: Inertial) -> Tree:
    """Return the tree with a body fixed to a link, as a link "payload" of its own."""
    name = free_name("payload", tree.has)
    return tree.joined(body(name, rigid, None, STEEL), name, link, pin.SE3.Identity())
