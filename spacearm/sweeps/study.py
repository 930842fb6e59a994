"""Study: what a sweep computes, read from a TOML file: arms, designs, quantities, seeds, chunks."""

from __future__ import annotations

import hashlib
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from spacearm.arrays import Array
from spacearm.description.catalogue import catalogue
from spacearm.description.readers.urdf import Check
from spacearm.description.urdf_writer import document
from spacearm.errors import ConfigurationError
from spacearm.files import read
from spacearm.model.arm import SpaceArm
from spacearm.model.loading import load
from spacearm.model.task import Task
from spacearm.sweeps import quantities, tiles
from spacearm.sweeps.quantities import Quantity
from spacearm.sweeps.tiles import Region, Shape
from spacearm.sweeps.toml import Table, parse
from spacearm.workspaces.design import PARAMETERS, vary

CHUNK = 2**22
"""Configurations of a chunk, if the study does not say."""
KEPT = 16
"""Designs that a process keeps at hand."""
NAME = re.compile(r"[^./][^/]*")
"""What an array of a store may be named."""


class Chunk(NamedTuple):
    """One piece of work.

    Attributes:
        quantity: Name of the quantity.
        number: Which of its chunks.
    """

    quantity: str
    number: int


class Recipe(NamedTuple):
    """What a worker process makes the study from.

    Attributes:
        text: The study, TOML.
        folder: Where its URDF files are.
        models: SHA-256 of each arm's links and joints, as text.
    """

    text: str
    folder: str
    models: str


@dataclass(frozen=True, eq=False, repr=False)
class Study:
    """A design study: made by `Study.read` or `Study.parse`, run by `sweep`.

    A study is a TOML file:

        arms = ["planar2", {model = "mine.urdf", name = "mine", task = "x y"}]
        seed = 0                        # of all samples
        chunk = 4_194_304               # configurations a chunk

        [parameters]                    # designs: every combination; names as in `design.vary`
        base_inertia = [1, 2, 5]
        mount_x = {from = 0.0, to = 0.8, points = 9}

        [shells]                        # as `workspace`: mode, limits, effort
        mode = "free-floating"

        [risk]                          # as `risk_profile`: near is sigma_min up to this
        sigma_min = 0.05
        radius = {from = 0.0, to = 2.4, points = 25}  # edges of the distance classes [m]
        samples = 10_000_000            # for each design
        limits = false

        [sigma_min]                     # a map over joints, by name or as q1, q2, ...
        joints.q2 = {from = -3.1, to = 3.1, points = 63}  # [rad] or [m]
        held.q1 = 0.3                   # where others stand; at 0 if not named
        single = false                  # single precision halves the store

    Arms are catalogue names, paths of URDF files (from the study's folder) or tables with model,
    name, tip, task, length, locked and check, as `load` takes them.

    Attributes:
        text: The file's text.
        folder: What paths of URDF files start from.
        seed: Of all samples.
        arms: The arms by name.
        axes: Values of the parameters by name.
        quantities: What is computed, by name.
        models: SHA-256 of each arm's links and joints, as text.
    """

    text: str
    folder: Path
    seed: int
    arms: Mapping[str, SpaceArm]
    axes: Mapping[str, Array]
    quantities: Mapping[str, Quantity]
    models: str

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Study:
        """Reads a study file.

        Raises:
            ConfigurationError: It cannot be read.
            SpaceArmError: As `parse` does.
        """
        try:
            text = read(Path(path)).decode()
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"study {path} cannot be read: {error}") from None
        return cls.parse(text, Path(path).resolve().parent)

    @classmethod
    def parse(cls, text: str, folder: str | os.PathLike[str] = ".") -> Study:
        """A study from its text.

        Args:
            text: TOML, as above.
            folder: What paths of URDF files start from.

        Raises:
            ConfigurationError: Something in it makes no sense.
            ModelError: An arm or a design is unsound.
            UnsupportedError: An arm has no shells, or a joint that slides without limits where
                risk is asked for; or Python is older than 3.11.
        """
        table = parse(text)
        table.knows("arms", "seed", "chunk", "parameters", *quantities.QUANTITIES)
        seed, chunk = table.take("seed", int, 0), table.positive("chunk", int, CHUNK)
        if seed < 0:
            raise table.fail("seed", "give a whole number from 0 on")
        folder = Path(folder).resolve()
        arms = _arms(table, folder)
        parameters = Table("parameters", table.values.get("parameters", {}))
        axes = {name: parameters.axis(name) for name in parameters.values}
        for arm in arms.values():  # names and bounds are wrong now or never
            for end in (0, -1):
                vary(arm, {name: float(values[end]) for name, values in axes.items()})
        asked = quantities.read(table, seed, chunk, tuple(arms.values()))
        models = "\n".join(f"{name} sha256:{_fingerprint(arm)}" for name, arm in arms.items())
        _check_names([*axes], asked.values())
        return cls(text, folder, seed, arms, axes, asked, models)

    @property
    def recipe(self) -> Recipe:
        """What makes the same study in another process."""
        return Recipe(self.text, str(self.folder), self.models)

    @property
    def attributes(self) -> dict[str, Any]:
        """What a store says of where its numbers come from."""
        return {
            "spacearm_version": version("spacearm"),
            "models": self.models,
            "study": self.text,
            "seed": self.seed,
        }

    @property
    def shape(self) -> Shape:
        """Lengths of the axes of the designs: arms, then parameters."""
        return (len(self.arms), *map(len, self.axes.values()))

    @property
    def coords(self) -> dict[str, tuple[Array, dict[str, Any]]]:
        """Labels of these axes, with their attributes."""
        names = np.array(list(self.arms), dtype=object)
        units = {name: {"unit": PARAMETERS.get(name, "kg")} for name in self.axes}
        return {"arm": (names, {})} | {name: (v, units[name]) for name, v in self.axes.items()}

    def count(self, quantity: str) -> int:
        """How many chunks a quantity has."""
        asked = self.quantities[quantity]
        return math.prod(self.shape) * math.prod(tiles.counts(asked.shape, asked.tile))

    def chunks(self) -> Iterator[Chunk]:
        """All chunks."""
        return (Chunk(name, i) for name in self.quantities for i in range(self.count(name)))

    def region(self, chunk: Chunk) -> Region:
        """Where the numbers of a chunk go, along the axes of designs and of the quantity's grid."""
        design, box = self._where(chunk)
        at = np.unravel_index(design, self.shape)
        return (*(slice(int(i), int(i) + 1) for i in at), *box)

    def compute(self, chunk: Chunk) -> dict[str, Array]:
        """The numbers of a chunk by variable, shaped as its region and the variable's own axes."""
        design, box = self._where(chunk)
        asked = self.quantities[chunk.quantity]
        found = asked.compute(_design(self, design), box, (self.seed, design))
        one = (1,) * len(self.shape)
        return {
            name: np.asarray(found[name], variable.dtype).reshape(one + np.shape(found[name]))
            for name, variable in asked.variables.items()
        }

    def _where(self, chunk: Chunk) -> tuple[int, Region]:
        """Number of the design, and the box of the grid."""
        asked = self.quantities[chunk.quantity]
        boxes = math.prod(tiles.counts(asked.shape, asked.tile))
        design, box = divmod(chunk.number, boxes)
        return design, tiles.region(asked.shape, asked.tile, box)

    def __reduce__(self) -> tuple[Callable[[Recipe], Study], tuple[Recipe]]:
        return remade, (self.recipe,)

    def __repr__(self) -> str:
        chunks = ", ".join(f"{name} in {self.count(name):,} chunks" for name in self.quantities)
        return f"Study({math.prod(self.shape):,} designs of {', '.join(self.arms)}: {chunks})"


@lru_cache(maxsize=4)
def remade(recipe: Recipe) -> Study:
    """The study in another process.

    Raises:
        ConfigurationError: The URDF files are not the same here.
    """
    study = Study.parse(recipe.text, recipe.folder)
    if study.models != recipe.models:
        raise ConfigurationError(
            f"the arms in {recipe.folder} are not those that the sweep began with"
        )
    return study


@lru_cache(maxsize=KEPT)
def _design(study: Study, number: int) -> SpaceArm:
    arm, *at = (int(i) for i in np.unravel_index(number, study.shape))
    values = {name: float(v[i]) for (name, v), i in zip(study.axes.items(), at, strict=True)}
    return vary(list(study.arms.values())[arm], values)


def _fingerprint(arm: SpaceArm) -> str:
    """SHA-256 of what physics needs of an arm, as URDF; not of what it looks like."""
    return hashlib.sha256(document(replace(arm.tree, visuals={}), arm.tips)).hexdigest()


def _check_names(axes: list[str], asked: Iterable[Quantity]) -> None:
    """Refuses axes that would have the name of something else in the store."""
    names = ["arm", "block", "shell", "chunks", *axes]
    for quantity in asked:
        names += [*quantity.coords, *quantity.variables]
    for name in names:
        if names.count(name) > 1 or not NAME.fullmatch(name):
            raise ConfigurationError(
                f"an axis cannot be named {name!r}, which is the name of something else in the "
                "store or none that files can have; name joints q1, q2, ..."
            )


def _arms(table: Table, folder: Path) -> dict[str, SpaceArm]:
    """The arms by their names in the study."""
    listed = table.take("arms", list)
    arms: dict[str, SpaceArm] = {}
    for entry in listed:
        own = Table("arms", {"model": entry} if isinstance(entry, str) else entry)
        own.knows("model", "name", "tip", "task", "length", "locked", "check")
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
        locked={joint: held.take(joint, float) for joint in held.values},
        check=cast("Check | None", given.get("check")),
    )
    if "length" not in own.values:
        return arm
    return arm.replace(task=Task(arm.task.names, own.positive("length", float)))
