"""Quantities that a study asks of every design, computed a chunk at a time.

A chunk is one design, at one box of the quantity's own grid (blocks of samples, joint angles). Its
numbers depend on the study and on nothing else, so that any process may compute it at any time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, get_args

import numpy as np

from spacearm.arrays import LARGEST
from spacearm.errors import UnsupportedError, unknown
from spacearm.mechanics.batch import evaluate
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_name
from spacearm.singularities.risk import check_slides, risk_profile
from spacearm.sweeps.quantity import Quantity, Variable
from spacearm.sweeps.simulations import Simulations
from spacearm.sweeps.tiles import Box, boxes, tile
from spacearm.sweeps.toml import Table
from spacearm.workspaces.design import shell_measures
from spacearm.workspaces.path_dependent import EFFORT
from spacearm.workspaces.shells import check_shells

PART = 2**16
"""Configurations in memory at a time, however large the chunk."""
MOST_SHELLS = 16
"""Shells that there is room for in each design."""


class Shells(Quantity):
    """Path dependent shells and the path independent share, as `workspace` finds them."""

    def __init__(self, table: Table, seed: int, arms: Sequence[SpaceArm]) -> None:
        for arm in arms:
            check_shells(arm)
        table.knows("mode", "limits", "effort")
        modes: dict[str, BaseMode] = {mode: mode for mode in get_args(BaseMode)}
        if (wanted := table.take("mode", str, "free-floating")) not in modes:
            raise table.fail("mode", unknown("mode", wanted, modes))
        self.mode, self.limits = modes[wanted], table.take("limits", bool, False)
        self.effort, self.seed = table.positive("effort", int, EFFORT), seed
        volume = {"units": "m^3; m^2 for planar arms"}
        shell = ("shell", "bound"), (MOST_SHELLS, 2)
        self.variables = {
            "piw": Variable({**volume, "about": "path independent workspace"}),
            "reachable": Variable({**volume, "about": "reachable workspace"}),
            "fraction": Variable({"units": "1", "about": "path independent share"}),
            "pdw": Variable({"units": "m", "about": "path dependent shells"}, *shell),
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
        return {**found, "pdw": pdw}


class Risk(Quantity):
    """Configurations near a singularity, counted by the tip's distance from the CM.

    Counts of `risk_profile` for blocks of samples: their sums over `block` are those of all.
    """

    def __init__(self, table: Table, chunk: int, arms: Sequence[SpaceArm]) -> None:
        for arm in arms:
            check_slides(arm)
        table.knows("distance", "sigma_min", "radius", "samples", "limits")
        self.measure = "distance" if "distance" in table.values else "sigma_min"
        if {"distance", "sigma_min"} <= table.values.keys():
            raise table.fail("sigma_min", "give it or the distance [rad], not both")
        self.bound = table.positive(self.measure, float)
        self.edges, self.samples = table.axis("radius"), table.positive("samples", int)
        if len(self.edges) < 2 or self.edges[0] < 0.0 or (np.diff(self.edges) <= 0.0).any():
            raise table.fail("radius", "give two or more growing edges of distance classes [m]")
        self.limits, self.chunk = table.take("limits", bool, False), chunk
        classes = ("radius",), (len(self.edges) - 1,)
        attrs = {"units": "1", self.measure: f"{self.bound}"}
        self.variables = {
            "configurations": Variable({**attrs, "about": "drawn"}, *classes),
            "near": Variable({**attrs, "about": f"with {self.measure} up to this"}, *classes),
        }
        middles = 0.5 * (self.edges[:-1] + self.edges[1:])
        self.coords = {"radius": (middles, {"units": "m", "edges": self.edges.tolist()})}
        self.dims, self.shape, self.tile = ("block",), (-(-self.samples // chunk),), (1,)

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

    def __init__(self, name: str, table: Table, chunk: int, arms: Sequence[SpaceArm]) -> None:
        table.knows("joints", "held", "single")
        joints = Table(f"{table.where}: joints", table.values.get("joints"))
        held = Table(f"{table.where}: held", table.values.get("held", {}))
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
        self.name, units = name, "; ".join(dict.fromkeys(arm.sigma_unit for arm in arms))
        about = {
            "sigma_min": {"units": units, "about": "least singular value of the task Jacobian"},
            "distance": {"units": "rad", "about": "distance to the singular set, to first order"},
        }[name]
        self.dtype = "float32" if table.take("single", bool, False) else "float64"
        self.variables = {name: Variable(about, dtype=self.dtype)}
        self.coords = {text: (values, {"units": "rad or m"}) for text, values in self.axes.items()}
        self.dims, self.shape = tuple(self.axes), tuple(map(len, self.axes.values()))
        self.tile = tile(self.shape, chunk)

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


MAPS = ("distance", "sigma_min")
"""Tables of a study that ask for a map over joints."""
QUANTITIES = ("shells", "risk", "simulation", *MAPS)
"""Tables of a study that ask for a quantity."""


def read(table: Table, seed: int, chunk: int, arms: Sequence[SpaceArm]) -> dict[str, Quantity]:
    """Read the quantities that the tables of a study ask for, by name.

    Raises:
        ConfigurationError: No quantity is asked for, or a table makes no sense.
        UnsupportedError: An arm cannot have the quantity.
    """
    own = {name: Table(name, table.values[name]) for name in QUANTITIES if name in table.values}
    if not own:
        raise table.fail("quantities", f"add one or more of the tables {', '.join(QUANTITIES)}")
    found: dict[str, Quantity] = {}
    if "shells" in own:
        found["shells"] = Shells(own["shells"], seed, arms)
    if "risk" in own:
        found["risk"] = Risk(own["risk"], chunk, arms)
    if "simulation" in own:
        found["simulation"] = Simulations(own["simulation"], chunk, arms)
    maps = (name for name in MAPS if name in own)
    return found | {name: JointMap(name, own[name], chunk, arms) for name in maps}


def nbytes(quantity: Quantity, designs: int) -> int:
    """Return the size of all numbers of a quantity [bytes], uncompressed."""
    points = designs * math.prod(quantity.shape)
    return sum(
        points * math.prod(v.shape) * np.dtype(v.dtype).itemsize
        for v in quantity.variables.values()
    )
