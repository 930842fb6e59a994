"""SDF includes: models that a file takes from other files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path

from lxml import etree

from spacearm.description.readers.sdf.values import words
from spacearm.description.readers.xml import Source

FOLDERS = ("GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH", "GAZEBO_MODEL_PATH")
"""Environment variables that name folders of models."""
DEEPEST = 20
"""Most includes in one another; more are a loop."""


def included(source: Source, include: etree._Element, *, needed: bool) -> etree._Element | None:
    """Return the <model> that an <include> means, under its own name and at its own pose.

    Args:
        source: The file.
        include: The element.
        needed: Whether a model that is not found is a fault; else it is left out with a warning.

    Raises:
        ModelError: The file is not found, or holds no model.
    """
    uri = words(include, "uri")
    path = next((p for p in _candidates(source, uri) if p.is_file()), None)
    if path is None:
        problem = f"<include> of {uri!r} (line {include.sourceline}) is not found"
        if not needed:
            source.warn(f"{problem}: left out")
            return None
        source.fail(
            problem,
            "name the folder that holds it with packages=, or write the file out whole: "
            "gz sdf -p FILE",
        )
    if sum(1 for _ in include.iterancestors("include")) > DEEPEST:
        source.fail(f"<include> of {uri!r} is more than {DEEPEST} deep", "cut the loop")
    root = Source(path).root()
    models = root.findall("model")
    if root.tag != "sdf" or len(models) != 1:
        source.fail(f"<include> of {uri!r} means {path}, which has no one <model>", "name another")
    return _placed(models[0], include)


def _placed(model: etree._Element, include: etree._Element) -> etree._Element:
    """Return a copy of a model with the name and the pose that its <include> gives it.

    The copy hangs below the include, so that includes inside it know how deep they are.
    """
    copy = deepcopy(model)
    if name := words(include, "name"):
        copy.set("name", name)
    for key in ("pose", "placement_frame"):
        given = include.find(key)
        if given is None:
            continue
        if key == "placement_frame":
            copy.set(key, words(include, key))
            continue
        for old in copy.findall(key):
            copy.remove(old)
        copy.append(deepcopy(given))
    include.append(copy)
    return copy


def _candidates(source: Source, uri: str) -> Iterator[Path]:
    """Yield the files that a URI may mean."""
    scheme, _, rest = uri.rpartition("://")
    if scheme == "file":
        yield from _model_files(Path(rest))
    elif scheme == "" and rest:
        yield from _model_files(source.path.resolve().parent / rest)
    elif scheme in ("model", "package"):
        for place in _environment():
            yield from _model_files(Path(place) / rest)
        if found := source.packages.resolve(f"package://{rest}"):
            yield from _model_files(found)


def _environment() -> Iterator[str]:
    for variable in FOLDERS:
        yield from filter(None, os.environ.get(variable, "").split(os.pathsep))


def _model_files(path: Path) -> Iterator[Path]:
    """Yield a file, or the files of a model's folder: those of its model.config, newest first."""
    yield path
    config = path / "model.config"
    if config.is_file():
        sdfs = Source(config).root().findall("sdf")
        newest = sorted(sdfs, key=lambda e: [int(x) for x in e.get("version", "0").split(".")])
        for element in reversed(newest):
            yield path / (element.text or "").strip()
    yield path / "model.sdf"
