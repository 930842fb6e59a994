"""Quantities: what a study asks of every design, computed a chunk at a time.

A chunk is one design, at one box of the quantity's own grid (blocks of samples, joint angles). Its
numbers depend on the study and on nothing else, so that any process may compute it at any time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, get_args

import numpy as np

from spacearm.arrays import LARGEST, Array
from spacearm.errors import UnsupportedError, unknown
from spacearm.mechanics.batch import evaluate
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_name
from spacearm.model.mode import BaseMode
from spacearm.singularities.risk import check_slides, risk_profile
from spacearm.sweeps.tiles import Region, Shape, regions, tile
from spacearm.sweeps.toml import Table
from spacearm.workspaces.design import shell_measures
from spacearm.workspaces.path_dependent import EFFORT, check_shells

PART = 2**16
"""Configurations in memory at a time, however large the chunk."""
MOST_SHELLS = 16
"""Shells that there is room for in each design."""

Compute = Callable[[SpaceArm, Region, Sequence[int]], Mapping[str, Any]]
"""compute(arm, box, seed): the numbers of one chunk by variable, for one design, at one box of the
grid, with the seed of study and design."""


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


class Quantity(NamedTuple):
    """One quantity of a study.

    Attributes:
        name: Its table in the study.
        variables: The arrays that it fills.
        compute: What fills them.
        coords: Labels of its axes, with their attributes.
        dims: Its own axes, which chunks divide.
        shape: Their lengths.
        tile: Shape of a chunk along them.
    """

    name: str
    variables: Mapping[str, Variable]
    compute: Compute
    coords: Mapping[str, tuple[Array, Mapping[str, Any]]]
    dims: tuple[str, ...] = ()
    shape: Shape = ()
    tile: Shape = ()


def shells(table: Table, seed: int, arms: Sequence[SpaceArm]) -> Quantity:
    """Path dependent shells and path independent share, as `workspace` finds them."""
    for arm in arms:
        check_shells(arm)
    table.knows("mode", "limits", "effort")
    modes: dict[str, BaseMode] = {mode: mode for mode in get_args(BaseMode)}
    if (wanted := table.take("mode", str, "free-floating")) not in modes:
        raise table.fail("mode", unknown("mode", wanted, modes))
    mode, limits = modes[wanted], table.take("limits", bool, False)
    effort = table.positive("effort", int, EFFORT)

    def compute(arm: SpaceArm, _: Region, __: Sequence[int]) -> Mapping[str, Any]:
        found = shell_measures(arm, mode=mode, limits=limits, effort=effort, seed=seed)
        pdw = np.full((MOST_SHELLS, 2), np.nan)
        if len(found["pdw"]) > MOST_SHELLS:
            raise UnsupportedError(
                f"{arm.name} has {len(found['pdw'])} shells; a store has room for {MOST_SHELLS}"
            )
        pdw[: len(found["pdw"])] = found["pdw"]
        return {**found, "pdw": pdw}

    volume = {"unit": "m^3; m^2 for planar arms"}
    variables = {
        "piw": Variable({**volume, "about": "path independent workspace"}),
        "reachable": Variable({**volume, "about": "reachable workspace"}),
        "fraction": Variable({"unit": "1", "about": "path independent share"}),
        "pdw": Variable(
            {"unit": "m", "about": "path dependent shells"}, ("shell", "bound"), (MOST_SHELLS, 2)
        ),
    }
    bounds = np.array(["least", "largest"], dtype=object)
    return Quantity("shells", variables, compute, {"bound": (bounds, {})})


def risk(table: Table, chunk: int, arms: Sequence[SpaceArm]) -> Quantity:
    """Configurations in classes of the tip's distance from the CM, and how many are near singular.

    Counts of `risk_profile` for blocks of samples: their sums over `block` are those of all.
    """
    for arm in arms:
        check_slides(arm)
    table.knows("sigma_min", "radius", "samples", "limits")
    bound = table.positive("sigma_min", float)
    edges, samples = table.axis("radius"), table.positive("samples", int)
    if len(edges) < 2 or edges[0] < 0.0 or (np.diff(edges) <= 0.0).any():
        raise table.fail("radius", "give two or more growing edges of distance classes [m]")
    limits, bins = table.take("limits", bool, False), len(edges) - 1

    def compute(arm: SpaceArm, box: Region, seed: Sequence[int]) -> Mapping[str, Any]:
        block = box[0].start
        left = min(chunk, samples - block * chunk)
        count, near = np.zeros(bins), np.zeros(bins)
        for part, (drawn,) in enumerate(regions((left,), PART)):
            profile = risk_profile(
                arm,
                limits=limits,
                sigma_min=bound,
                bins=edges,
                samples=drawn.stop - drawn.start,
                seed=(*seed, block, part),
                threads=1,
            )
            count += profile.count
            near += np.rint(np.nan_to_num(profile.share) * profile.count)
        return {"configurations": count[None], "near": near[None]}

    attrs = {"unit": "1", "sigma_min": f"{bound}"}
    variables = {
        "configurations": Variable({**attrs, "about": "drawn"}, ("radius",), (bins,)),
        "near": Variable({**attrs, "about": "with sigma_min up to this"}, ("radius",), (bins,)),
    }
    middle = {"radius": (0.5 * (edges[:-1] + edges[1:]), {"unit": "m", "edges": edges.tolist()})}
    blocks = -(-samples // chunk)
    return Quantity("risk", variables, compute, middle, ("block",), (blocks,), (1,))


def sigma_min(table: Table, chunk: int, arms: Sequence[SpaceArm]) -> Quantity:
    """A map of the least singular value over a grid of joint positions."""
    table.knows("joints", "held", "single")
    joints = Table(f"{table.where}: joints", table.values.get("joints"))
    held = Table(f"{table.where}: held", table.values.get("held", {}))
    names = {arm: {text: joint_name(arm, text) for text in joints.values} for arm in arms}
    if not joints.values or any(len(set(own.values())) < len(own) for own in names.values()):
        raise table.fail("joints", "name one or more, none twice")
    axes = {text: joints.axis(text) for text in joints.values}
    at = {text: held.take(text, float) for text in held.values}
    for arm, own in names.items():
        for text, value in at.items():
            if joint_name(arm, text) in own.values() or abs(value) > LARGEST:
                raise held.fail(text, f"give finite positions [rad], of joints not in {[*axes]}")
    shape = tuple(map(len, axes.values()))
    dtype = "float32" if table.take("single", bool, False) else "float64"

    def compute(arm: SpaceArm, box: Region, _: Sequence[int]) -> Mapping[str, Any]:
        column = {text: arm.joint_names.index(joint_name(arm, text)) for text in (*axes, *at)}
        grid = [values[part] for values, part in zip(axes.values(), box, strict=True)]
        sigma = np.empty(tuple(map(len, grid)), dtype)
        for part in regions(sigma.shape, PART):
            q = np.zeros((*(s.stop - s.start for s in part), arm.n))
            for text, value in at.items():
                q[..., column[text]] = value
            cut = (values[s] for values, s in zip(grid, part, strict=True))
            for text, values in zip(
                axes, np.meshgrid(*cut, indexing="ij", copy=False), strict=True
            ):
                q[..., column[text]] = values
            found = evaluate(arm, q.reshape(-1, arm.n), ["sigma_min"], threads=1)["sigma_min"]
            sigma[part] = found.reshape(q.shape[:-1])
        return {"sigma_min": sigma}

    units = "; ".join(dict.fromkeys(arm.sigma_unit for arm in arms))
    about = {"unit": units, "about": "least singular value of the task Jacobian"}
    coords = {text: (values, {"unit": "rad or m"}) for text, values in axes.items()}
    return Quantity(
        "sigma_min",
        {"sigma_min": Variable(about, dtype=dtype)},
        compute,
        coords,
        tuple(axes),
        shape,
        tile(shape, chunk),
    )


QUANTITIES = ("shells", "risk", "sigma_min")
"""What a study can ask for."""


def read(table: Table, seed: int, chunk: int, arms: Sequence[SpaceArm]) -> dict[str, Quantity]:
    """The quantities that the tables of a study ask for, by name."""
    asked = {name: Table(name, table.values[name]) for name in QUANTITIES if name in table.values}
    if not asked:
        raise table.fail("quantities", f"add one or more of the tables {', '.join(QUANTITIES)}")
    makers: dict[str, Callable[[Table], Quantity]] = {
        "shells": lambda own: shells(own, seed, arms),
        "risk": lambda own: risk(own, chunk, arms),
        "sigma_min": lambda own: sigma_min(own, chunk, arms),
    }
    return {name: makers[name](own) for name, own in asked.items()}


def nbytes(quantity: Quantity, designs: int) -> int:
    """Bytes of all its numbers, uncompressed."""
    points = designs * math.prod(quantity.shape)
    return sum(
        points * math.prod(v.shape) * np.dtype(v.dtype).itemsize
        for v in quantity.variables.values()
    )
