"""Quantities that a study asks of every design, computed a chunk at a time.

A chunk is one design, at one box of the quantity's own grid (blocks of samples, joint angles,
runs). Its numbers depend on the study and on nothing else, so that any process may compute it at
any time.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import LARGEST, Array
from spacearm.errors import UnsupportedError
from spacearm.mechanics.batch import evaluate
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_name
from spacearm.motion.simulation import COARSE, FAILURES, simulate_many
from spacearm.singularities.risk import check_slides, risk_profile
from spacearm.sweeps import motion_tables as tables
from spacearm.sweeps.toml import MOST, Table
from spacearm.workspaces.design import shell_measures

#: Configurations in memory at a time, however large the chunk.
PART = 2**16
#: Shells that there is room for in each design.
MOST_SHELLS = 64
#: Runs of a chunk at most: some seconds of work.
RUNS = 256

Shape = tuple[int, ...]
#: A part of a grid: one slice along each axis.
Box = tuple[slice, ...]


def tile(shape: Sequence[int], most: int) -> Shape:
    """Return the shape of boxes of at most `most` points: whole along the last axes that fit."""
    sizes: list[int] = []
    for length in reversed(shape):
        sizes.append(max(1, min(length, most)))
        most //= sizes[-1]
    return tuple(reversed(sizes))


def counts(shape: Sequence[int], size: Sequence[int]) -> Shape:
    """Return the number of boxes along each axis; the last boxes may be smaller."""
    return tuple(-(-length // step) for length, step in zip(shape, size, strict=True))


def box_of(shape: Sequence[int], size: Sequence[int], number: int) -> Box:
    """Return box `number` of the grid."""
    at = np.unravel_index(number, counts(shape, size)) if shape else ()
    return tuple(
        slice(int(i) * step, min((int(i) + 1) * step, length))
        for i, step, length in zip(at, size, shape, strict=True)
    )


def boxes(shape: Sequence[int], most: int) -> Iterator[Box]:
    """Iterate over all boxes of at most `most` points."""
    size = tile(shape, most)
    return (box_of(shape, size, i) for i in range(math.prod(counts(shape, size))))


def _each(units: Iterable[str]) -> str:
    """Return the unit that the arms of a study have, or those that they have, in their order."""
    return "; ".join(dict.fromkeys(units))


def _unit_of_joint(arm: SpaceArm, text: str) -> str:
    """Return the unit of a joint position."""
    return arm.joint_units[arm.joint_names.index(joint_name(arm, text))]


class Variable(NamedTuple):
    """One array of the result.

    Attributes:
        attrs: What is known of it, its unit first of all.
        dims: Its axes after those of the designs and of the quantity's grid.
        shape: Their lengths.
        dtype: Of its numbers.
    """

    attrs: Mapping[str, str]
    dims: tuple[str, ...] = ()
    shape: Shape = ()
    dtype: str = "float64"


class Quantity(ABC):
    """One quantity of a study, read from its table; `QUANTITIES` lists the kinds.

    Attributes:
        variables: The arrays that it fills, by name.
        coords: Labels of its axes, with their attributes.
        dims: Its own axes, which chunks divide.
        shape: Their lengths.
        tile: Shape of a chunk along them.
    """

    variables: Mapping[str, Variable]
    coords: Mapping[str, tuple[Array, Mapping[str, Any]]] = {}
    dims: tuple[str, ...] = ()
    shape: Shape = ()
    tile: Shape = ()

    def __init__(self, table: Table, arms: Sequence[SpaceArm], seed: int, chunk: int) -> None:
        """Read the quantity.

        Args:
            table: Its table in the study.
            arms: The arms of the study.
            seed: Of all samples of the study.
            chunk: Largest number of configurations in a chunk.

        Raises:
            ConfigurationError: The table makes no sense.
            UnsupportedError: An arm cannot have the quantity.
        """
        self.seed, self.chunk = seed, chunk
        self.read(table, arms)

    @abstractmethod
    def read(self, table: Table, arms: Sequence[SpaceArm]) -> None:
        """Read the table, and set the attributes."""

    @abstractmethod
    def compute(self, arm: SpaceArm, box: Box, seed: Sequence[int]) -> Mapping[str, Any]:
        """Compute the numbers of one chunk, by variable.

        Args:
            arm: The design.
            box: The part of the quantity's grid.
            seed: Seed of the study and number of the design.
        """

    def nbytes(self, designs: int) -> int:
        """Return the size of all numbers [bytes], uncompressed."""
        points = designs * math.prod(self.shape)
        return sum(
            points * math.prod(v.shape) * np.dtype(v.dtype).itemsize
            for v in self.variables.values()
        )


class Shells(Quantity):
    """Path dependent shells and the path independent share, as `workspace` finds them."""

    def read(self, table: Table, arms: Sequence[SpaceArm]) -> None:
        """Read the table."""
        for arm in arms:
            arm.require_one_tip()
            check_slides(arm)
        table.knows("mode", "limits", "effort")
        self.mode = table.choice("mode", tables.MODES, "free-floating")
        self.limits = table.take("limits", bool, False)
        given = "effort" in table.values
        self.effort = table.positive("effort", int) if given else None
        planar = (arm.tree.plane_normal() is not None for arm in arms)
        volume = {"units": _each("m^2" if flat else "m^3" for flat in planar)}
        shell = ("shell", "bound"), (MOST_SHELLS, 2)
        self.variables = {
            "piw": Variable({**volume, "about": "path independent workspace"}),
            "reachable": Variable({**volume, "about": "reachable workspace"}),
            "fraction": Variable({"units": "1", "about": "path independent share"}),
            "pdw": Variable({"units": "m", "about": "path dependent shells"}, *shell),
            "gap": Variable({"units": "m", "about": "by how much the shells may be off"}),
            "sampled": Variable({"units": "1", "about": "whether nothing is certified"}),
            "resolution": Variable({"units": "m", "about": "of sampled shells"}),
        }
        self.coords = {"bound": (np.array(["least", "largest"], dtype=object), {})}

    def compute(self, arm: SpaceArm, _box: Box, _seed: Sequence[int]) -> Mapping[str, Any]:
        """Find the shells of a design."""
        found = shell_measures(
            arm, mode=self.mode, limits=self.limits, effort=self.effort, seed=self.seed
        )
        pdw = np.full((MOST_SHELLS, 2), np.nan)
        if len(found["pdw"]) > MOST_SHELLS:
            raise UnsupportedError(
                f"{arm.name} has {len(found['pdw'])} shells; a store has room for {MOST_SHELLS}"
            )
        pdw[: len(found["pdw"])] = found["pdw"]
        return {**found, "pdw": pdw, "sampled": float(found.pop("bounds") == "sampled")}


class Risk(Quantity):
    """Configurations near a singularity, counted by the tip's distance from the CM.

    Counts of `risk_profile` for blocks of samples: their sums over `block` are those of all.
    """

    def read(self, table: Table, arms: Sequence[SpaceArm]) -> None:
        """Read the table."""
        for arm in arms:
            check_slides(arm)
        table.knows("distance", "sigma_min", "bins", "samples", "limits")
        self.measure = "distance" if "distance" in table.values else "sigma_min"
        if {"distance", "sigma_min"} <= table.values.keys():
            raise table.fail("sigma_min", "give it or the distance [rad], not both")
        self.bound = table.positive(self.measure, float)
        self.edges, self.samples = table.axis("bins"), table.positive("samples", int, most=MOST)
        if len(self.edges) < 2 or self.edges[0] < 0.0 or (np.diff(self.edges) <= 0.0).any():
            raise table.fail("bins", "give two or more increasing edges of distance classes [m]")
        self.limits = table.take("limits", bool, False)
        classes = ("radius",), (len(self.edges) - 1,)
        attrs = {"units": "1", self.measure: f"{self.bound}"}
        self.variables = {
            "configurations": Variable({**attrs, "about": "drawn"}, *classes),
            "near": Variable({**attrs, "about": f"with {self.measure} up to this"}, *classes),
        }
        middles = 0.5 * (self.edges[:-1] + self.edges[1:])
        self.coords = {"radius": (middles, {"units": "m", "edges": self.edges.tolist()})}
        self.dims, self.shape, self.tile = ("block",), (-(-self.samples // self.chunk),), (1,)

    def compute(self, arm: SpaceArm, box: Box, seed: Sequence[int]) -> Mapping[str, Any]:
        """Count a block of samples."""
        block = box[0].start
        left = min(self.chunk, self.samples - block * self.chunk)
        count, near = np.zeros(len(self.edges) - 1), np.zeros(len(self.edges) - 1)
        for part, (drawn,) in enumerate(boxes((left,), PART)):
            bound: dict[str, Any] = {self.measure: self.bound}
            profile = risk_profile(
                arm,
                **bound,
                limits=self.limits,
                bins=self.edges,
                samples=drawn.stop - drawn.start,
                seed=(*seed, block, part),
                threads=1,
            )
            count += profile.count
            near += np.rint(np.nan_to_num(profile.share) * profile.count)
        return {"configurations": count[None], "near": near[None]}


class JointMap(Quantity):
    """A map of the distance to the singular set or of sigma_min over a grid of joint positions."""

    def read(self, table: Table, arms: Sequence[SpaceArm]) -> None:
        """Read the table."""
        table.knows("joints", "held", "single")
        joints, held = table.inner("joints"), table.inner("held")
        names = {arm: {text: joint_name(arm, text) for text in joints.values} for arm in arms}
        if not joints.values or any(len(set(own.values())) < len(own) for own in names.values()):
            raise table.fail("joints", "name one or more, none twice")
        self.axes = {text: joints.axis(text) for text in joints.values}
        self.held = {text: held.take(text, float) for text in held.values}
        for arm, own in names.items():
            for text, value in self.held.items():
                if joint_name(arm, text) in own.values() or abs(value) > LARGEST:
                    listed = [*self.axes]
                    raise held.fail(text, f"give finite positions [rad], of joints not in {listed}")
        self.name, units = table.where, _each(arm.sigma_unit for arm in arms)
        about = {
            "sigma_min": {"units": units, "about": "least singular value of the task Jacobian"},
            "distance": {
                "units": _each(arm.travel_unit for arm in arms),
                "about": "distance to the singular set, to first order",
            },
        }[self.name]
        self.dtype = "float32" if table.take("single", bool, False) else "float64"
        self.variables = {self.name: Variable(about, dtype=self.dtype)}
        self.coords = {
            text: (values, {"units": _each(_unit_of_joint(arm, text) for arm in arms)})
            for text, values in self.axes.items()
        }
        self.dims, self.shape = tuple(self.axes), tuple(map(len, self.axes.values()))
        self.tile = tile(self.shape, self.chunk)

    def compute(self, arm: SpaceArm, box: Box, _seed: Sequence[int]) -> Mapping[str, Any]:
        """Evaluate a box of the grid."""
        column = {
            text: arm.joint_names.index(joint_name(arm, text)) for text in (*self.axes, *self.held)
        }
        grid = [values[part] for values, part in zip(self.axes.values(), box, strict=True)]
        result = np.empty(tuple(map(len, grid)), self.dtype)
        for part in boxes(result.shape, PART):
            q = np.zeros((*(s.stop - s.start for s in part), arm.n))
            for text, value in self.held.items():
                q[..., column[text]] = value
            cut = (values[s] for values, s in zip(grid, part, strict=True))
            mesh = np.meshgrid(*cut, indexing="ij", copy=False)
            for text, values in zip(self.axes, mesh, strict=True):
                q[..., column[text]] = values
            found = evaluate(arm, q.reshape(-1, arm.n), [self.name], threads=1)[self.name]
            result[part] = found.reshape(q.shape[:-1])
        return {self.name: result}


VARIABLES = {
    "success": Variable({"units": "1", "about": "whether the target was reached"}),
    "time_to_target": Variable({"units": "s", "about": "NaN if it was not reached"}),
    "first_singularity": Variable({"units": "s", "about": "NaN if none was met"}),
    "least_distance": Variable(
        {"units": "rad", "about": "least distance to the singular set, to first order"}
    ),
    "turn": Variable({"units": "rad", "about": "largest turn of the spacecraft from its start"}),
    "failed": Variable({"units": "1", "about": "whether the law or the integrator failed"}),
}


#: Standard deviations of the starts: joint positions, joint rates, a turn about each axis.
SPREADS = ("spread", "rate_spread", "attitude_spread")


class Simulations(Quantity):
    """Runs of `simulate_many` from starts that are normally distributed about one."""

    variables = VARIABLES
    dims = ("run",)

    def read(self, table: Table, arms: Sequence[SpaceArm]) -> None:
        """Read the table."""
        distance = VARIABLES["least_distance"]
        units = {"units": _each(arm.travel_unit for arm in arms)}
        own = distance._replace(attrs={**distance.attrs, **units})
        self.variables = VARIABLES | {"least_distance": own}
        table.knows(
            "controller", "start", "duration", "runs", "mode", "plant", "sampling", "integration"
        )
        self.controller = table.inner("controller")
        self.mode = table.choice("mode", tables.MODES, "free-floating")
        self.plant = tables.read_plant(table.inner("plant"))
        self.integration = tables.read_integration(table.inner("integration"), COARSE)
        start = table.inner("start")
        start.knows("q", "attitude", *SPREADS)
        self.q, self.sampling = start.numbers("q"), tables.read_sampling(table)
        self.spread, self.rates, self.turns = (start.numbers(name, [0.0]) for name in SPREADS)
        self.attitude = start.numbers("attitude", [0.0, 0.0, 0.0])
        if len(self.attitude) != 3:
            raise start.fail("attitude", "give roll, pitch and yaw [rad]")
        for name in SPREADS:
            if (start.numbers(name, [0.0]) < 0.0).any():
                raise start.fail(name, "give standard deviations from 0 on")
        if len(self.turns) not in (1, 3):
            raise start.fail("attitude_spread", "give one number, or 3")
        self.duration = table.positive("duration", float)
        for arm in arms:
            if len(self.q) != arm.n:
                raise start.fail("q", f"give {arm.n} joint positions of {arm.name}")
            for name in SPREADS[:2]:
                if len(start.numbers(name, [0.0])) not in (1, arm.n):
                    raise start.fail(name, f"give one number, or {arm.n} for {arm.name}")
            if self.sampling is not None:
                self.sampling.noise(arm.n)  # raises for one that makes no sense
            arm.require_one_tip()
            tables.read_law(self.controller, arm)
        self.shape = (table.positive("runs", int, 1, MOST),)
        self.tile = (min(RUNS, self.chunk, *self.shape),)

    def compute(self, arm: SpaceArm, box: Box, seed: Sequence[int]) -> Mapping[str, Any]:
        """Simulate the runs of a box; in each the system CM is the origin at the start."""
        first, last = box[0].start, box[0].stop
        rng, m, R = np.random.default_rng((*seed, first)), last - first, self.attitude
        Q0 = self.q + self.spread * rng.normal(size=(m, arm.n))
        rates = self.rates * rng.normal(size=(m, arm.n))
        turns = self.turns * rng.normal(size=(m, 3))
        bases = [pin.SE3(pin.rpy.rpyToMatrix(R) @ pin.exp3(turn), np.zeros(3)) for turn in turns]
        placed = zip(Q0, bases, strict=True)
        starts = [arm.at(q, base=base).centred(np.zeros(3)) for q, base in placed]
        noisy = self.sampling and replace(self.sampling, seed=self.sampling.seed + first)
        found = simulate_many(
            starts, tables.read_law(self.controller, arm), self.duration, dq=rates, mode=self.mode,
            plant=self.plant, sampling=noisy, distance=True, integration=self.integration,
            threads=1,
        )  # fmt: skip
        failed = np.isin(found["ended"], FAILURES)
        kept = {name: found[name].values for name in VARIABLES if name in found}
        return kept | {"least_distance": found["distance"].values, "failed": failed}


#: The quantities by the names of their tables in a study.
QUANTITIES: dict[str, type[Quantity]] = {
    "shells": Shells,
    "risk": Risk,
    "simulation": Simulations,
    "distance": JointMap,
    "sigma_min": JointMap,
}


def read(table: Table, arms: Sequence[SpaceArm], seed: int, chunk: int) -> dict[str, Quantity]:
    """Read the quantities that the tables of a study ask for, by name.

    Raises:
        ConfigurationError: No quantity is asked for, or a table makes no sense.
        UnsupportedError: An arm cannot have the quantity.
    """
    found = {
        name: kind(Table(name, table.values[name]), arms, seed, chunk)
        for name, kind in QUANTITIES.items()
        if name in table.values
    }
    if not found:
        raise table.fail("quantities", f"add one or more of the tables {', '.join(QUANTITIES)}")
    return found
