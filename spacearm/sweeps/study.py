"""Design studies: arms, designs, quantities, seeds and chunks, read from a TOML file."""

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

from spacearm.arrays import Array, plain, whole
from spacearm.description.model_catalogue import catalogue
from spacearm.description.readers.source import Check
from spacearm.description.tips import Counting
from spacearm.description.urdf_writer import document
from spacearm.errors import UNPRINTABLE, ConfigurationError
from spacearm.model.arm import SpaceArm
from spacearm.model.loading import load
from spacearm.model.task import Task
from spacearm.signatures import checked
from spacearm.sweeps import quantities
from spacearm.sweeps.quantities import Box, Quantity, Shape, box_of, counts
from spacearm.sweeps.toml import Table, parse, text_of
from spacearm.workspaces.design import unit_of, vary

#: Configurations in a chunk, if the study does not say.
CHUNK = 2**22
#: Designs that a process keeps in memory.
KEPT = 16
#: Chunks of a study: each is one file or more.
MOST_CHUNKS = 10**8
#: Keys of an arm that say how its file is read, as in `load`.
READING = ("packages", "xacro_args", "density", "up_axes")
#: Pattern of the names that an array of a store may have.
NAME = re.compile(r"[^./][^/]{0,99}")


class Chunk(NamedTuple):
    """One chunk of one quantity.

    Attributes:
        quantity: Name of the quantity.
        number: Number of the chunk, from 0 on.
    """

    quantity: str
    number: int


class Recipe(NamedTuple):
    """What a worker process needs to make the study again.

    Attributes:
        text: The study, TOML.
        folder: Folder that paths of robot files start from.
        models: SHA-256 of each arm's links and joints, as text.
    """

    text: str
    folder: str
    models: str


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Study:
    """A design study: made by `Study.read` or `Study.parse`, run by `sweep`.

    A study is a TOML file:

        arms = ["planar2", {source = "mine.urdf", name = "mine", task = "x y"}]
        seed = 0                        # of all samples
        chunk = 4_194_304               # configurations a chunk

        [parameters]                    # designs: every combination; names as in `design.vary`
        base_inertia = [1, 2, 5]
        mount_x = {from = 0.0, to = 0.8, points = 9}

        [shells]                        # as `workspace`: mode, limits, effort
        mode = "free-floating"

        [risk]                          # as `risk_profile`: near is a distance up to this [rad]
        distance = 0.05                 # or sigma_min up to a bound
        bins = {from = 0.0, to = 2.4, points = 25}    # edges of the distance classes [m]
        samples = 10_000_000            # for each design
        limits = false

        [simulation]                    # as `simulate_many`: runs from dispersed starts
        controller = {law = "TransposedJacobian", target = [1.5, 1.5], kp = 5, kd = 15}
        start.q = [-1.0, 1.05]          # joint positions [rad] or [m], their standard deviation
        start.spread = 0.02             # (one number or n), and the attitude of the spacecraft as
        start.attitude = [0, 0, 0.37]   # roll, pitch, yaw [rad]; also attitude_spread, rate_spread
        duration = 60.0
        runs = 1000                     # for each design; also mode, and the fields of
        plant = {limits = true}         # `sa.Plant`, `sa.Sampling` and `sa.Integration`
        integration = {rtol = 1e-6}

        [distance]                      # a map over joints, as q1, ... or by name; sigma_min too
        joints.q2 = {from = -3.1, to = 3.1, points = 63}  # [rad] or [m]
        held.q1 = 0.3                   # where others stand; at 0 if not named
        single = false                  # single precision halves the store

    Arms are catalogue names, paths of URDF files (from the study's folder) or tables with source,
    name, tip, task, length, locked and check, as `load` takes them.

    Attributes:
        text: The text of the file.
        folder: Folder that paths of robot files start from.
        seed: Seed of all samples.
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
        """Read a study from its file.

        Raises:
            ConfigurationError: The file cannot be read.
            SpaceArmError: As `parse` does.
        """
        text = text_of(path, "study")
        parse(text, f"the study {path}")
        return cls.parse(text, Path(path).resolve().parent)

    @classmethod
    def parse(cls, text: str, folder: str | os.PathLike[str] = ".") -> Study:
        """Read a study from its text.

        Args:
            text: TOML, as in the docstring of the class.
            folder: Folder that paths of robot files start from.

        Raises:
            ConfigurationError: A value in it is not valid.
            ModelError: An arm or a design is unsound.
            UnsupportedError: An arm has several tips or a joint that slides without limits where
                shells or risk are asked for; or Python is older than 3.11.
        """
        table = parse(text)
        table.knows("arms", "seed", "chunk", "parameters", *quantities.QUANTITIES)
        seed = whole(table.take("seed", int, 0), "seed", 0, math.inf)
        chunk = table.positive("chunk", int, CHUNK)
        folder = Path(folder).resolve()
        arms = read_arms(table, folder)
        parameters = table.inner("parameters")
        axes = {name: parameters.axis(name) for name in parameters.values}
        for arm in arms.values():  # names and bounds are wrong now or never
            for end in (0, -1):
                vary(arm, {name: float(values[end]) for name, values in axes.items()})
        asked = quantities.read(table, tuple(arms.values()), seed, chunk)
        models = "\n".join(f"{name} sha256:{fingerprint(arm)}" for name, arm in arms.items())
        _check_names([*axes], asked.values())
        study = cls(text, folder, seed, arms, axes, asked, models)
        if study.total > MOST_CHUNKS:
            raise ConfigurationError(
                f"the study has {study.total:,} chunks, and a store has room for {MOST_CHUNKS:,}; "
                "give a larger chunk = ..., fewer designs or fewer samples"
            )
        return study

    @property
    def recipe(self) -> Recipe:
        """The recipe that makes the same study in another process."""
        return Recipe(self.text, str(self.folder), self.models)

    @property
    def attributes(self) -> dict[str, Any]:
        """The origin of the numbers, as attributes of a store."""
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
    def labels(self) -> dict[str, tuple[Array, Mapping[str, Any]]]:
        """Labels of these axes and of those of the quantities, with their attributes."""
        labels: dict[str, tuple[Array, Mapping[str, Any]]] = {}
        labels["arm"] = np.array(list(self.arms), dtype=object), {}
        for name, values in self.axes.items():
            labels[name] = values, {"units": unit_of(name)}
        for quantity in self.quantities.values():
            labels |= quantity.coords
        return labels

    def count(self, quantity: str) -> int:
        """Return the number of chunks of a quantity."""
        asked = self.quantities[quantity]
        return math.prod(self.shape) * math.prod(counts(asked.shape, asked.tile))

    @property
    def total(self) -> int:
        """Number of all chunks."""
        return sum(map(self.count, self.quantities))

    def chunks(self) -> Iterator[Chunk]:
        """Iterate over all chunks."""
        return (Chunk(name, i) for name in self.quantities for i in range(self.count(name)))

    def box(self, chunk: Chunk) -> Box:
        """Return the box of the store that a chunk fills, along designs and the grid."""
        design, box = self._where(chunk)
        at = np.unravel_index(design, self.shape)
        return (*(slice(int(i), int(i) + 1) for i in at), *box)

    def compute(self, chunk: Chunk) -> dict[str, Array]:
        """Compute a chunk: numbers by variable, shaped as its box and the variable's axes."""
        design, box = self._where(chunk)
        asked = self.quantities[chunk.quantity]
        found = asked.compute(_design(self, design), box, (self.seed, design))
        one = (1,) * len(self.shape)
        return {
            name: np.asarray(found[name], variable.dtype).reshape(one + np.shape(found[name]))
            for name, variable in asked.variables.items()
        }

    def _where(self, chunk: Chunk) -> tuple[int, Box]:
        """Return the number of the design and the box of the grid."""
        asked = self.quantities[chunk.quantity]
        boxes = math.prod(counts(asked.shape, asked.tile))
        design, box = divmod(chunk.number, boxes)
        return design, box_of(asked.shape, asked.tile, box)

    def to_dict(self) -> dict[str, Any]:
        """Return the study as plain data: its text, arms, axes, and the chunks of each quantity."""
        return {
            "text": self.text,
            "folder": str(self.folder),
            "seed": self.seed,
            "arms": list(self.arms),
            "axes": {name: plain(values) for name, values in self.axes.items()},
            "chunks": {name: self.count(name) for name in self.quantities},
            "models": self.models,
        }

    def __reduce__(self) -> tuple[Callable[[Recipe], Study], tuple[Recipe]]:
        return remade, (self.recipe,)

    def __repr__(self) -> str:
        counts = {name: self.count(name) for name in self.quantities}
        chunks = ", ".join(f"{name} in {k:,} chunk{'s' * (k != 1)}" for name, k in counts.items())
        designs = f"{(k := math.prod(self.shape)):,} design{'s' * (k != 1)}"
        return f"Study({designs} of {', '.join(self.arms)}: {chunks})"


@lru_cache(maxsize=4)
def remade(recipe: Recipe) -> Study:
    """Make the study in another process.

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


def _check_names(axes: list[str], asked: Iterable[Quantity]) -> None:
    """Refuse axes that would have the name of something else in the store."""
    names = ["arm", "block", "run", "shell", "chunks", *axes]
    for quantity in asked:
        names += [*quantity.coords, *quantity.variables]
    for name in names:
        fit = NAME.fullmatch(name) and not UNPRINTABLE.search(name)
        if names.count(name) > 1 or not fit:
            raise ConfigurationError(
                f"an axis cannot be named {name!r}: the store has that name already, or "
                "no file can have it; name joints q1, q2, ..."
            )


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
        own = Table("arms", {"source": entry} if isinstance(entry, str) else entry)
        own.knows("source", "name", "tip", "task", "length", "joints", "locked", "check", *READING)
        source = own.take("source", str)
        name = own.take("name", str, Path(source).stem)
        if name in arms:
            raise ConfigurationError(f"arms: two are named {name!r}; give one another name = ...")
        arms[name] = _arm(own, source, folder)
    if not arms:
        raise table.fail("arms", "name one or more")
    return arms


def _arm(own: Table, source: str, folder: Path) -> SpaceArm:
    known = source in (info.name for info in catalogue())
    given = {key: own.take(key, str) for key in ("tip", "task", "check") if key in own.values}
    held, joints = own.inner("locked"), own.values.get("joints", "tip")
    counting = own.texts("joints") if isinstance(joints, list) else own.take("joints", str, "tip")
    arm = load(
        source if known else folder / source,
        tip=given.get("tip"),
        task=given.get("task"),
        joints=cast("Counting", counting),
        locked={joint: held.take(joint, float) for joint in held.values},
        check=cast("Check | None", given.get("check")),
        packages=[folder / name for name in own.texts("packages")],
        xacro_args=own.take("xacro_args", dict, {}),
        density=own.positive("density", float) if "density" in own.values else None,
        up_axes=own.take("up_axes", bool, False),
    )
    if "length" not in own.values:
        return arm
    return arm.replace(task=Task(arm.task.names, own.positive("length", float)))


def fingerprint(arm: SpaceArm) -> str:
    """Return the SHA-256 of links and joints as URDF, without their visuals."""
    return hashlib.sha256(document(replace(arm.tree, visuals={}), arm.tips)).hexdigest()
