"""`spacearm workspace`, `risk`, `design`: where singularities are, from the system CM."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import spacearm as sa
from spacearm.arrays import Array, plain, whole
from spacearm.cli import options as opt
from spacearm.cli.output import Answer, err, kept, say_stopped, working
from spacearm.cli.wording import INTERRUPTED
from spacearm.results import Column, Described, Description, Table
from spacearm.singularities.risk import SEARCHED
from spacearm.workspaces.design import GOES_WITH, unit_of, workspaces
from spacearm.workspaces.path_dependent import EFFORT
from spacearm.workspaces.sampled import STARTS

#: Values of a range whose number is not given.
COUNT = 9

Effort = Annotated[
    int | None,
    typer.Option(
        help=f"Number of singular configurations that the search starts from, {EFFORT:,} by "
        f"default; only for arms of more than 3 joints. Of uniform configurations, {STARTS:,} by "
        "default, for arms whose workspace is sampled.",
        min=1,
        show_default=False,
    ),
]


@opt.answering("workspace", "view")
def compute_workspace(
    arm: sa.SpaceArm,
    mode: opt.Mode = "free-floating",
    limits: opt.Limits = False,
    effort: Effort = None,
    seed: Annotated[int, typer.Option(help="Seed of that search.")] = 0,
    free: Annotated[
        bool,
        typer.Option(
            "--free",
            help="Also compute the attitude-independent workspace (Vafa & Dubowsky: free "
            "workspace). It takes as long as the rest.",
        ),
    ] = False,
    path: Annotated[
        Path | None,
        typer.Option(
            help="Tip path to draw: a text file with one point in each line, relative to the "
            "system CM [m]. Only planar arms."
        ),
    ] = None,
    output: opt.Picture = None,
    view: opt.View = False,
    as_json: opt.AsJson = False,
) -> Answer:
    """Compute the workspaces."""
    if arm.tree.plane_normal() is None:
        opt.refuse_unused({"--path": path}, "with planar arms, of which a plane is drawn")
    if (as_json or view) and output is None:
        opt.refuse_unused(
            {"--path": path}, "with a picture: --output, or neither --json nor --view"
        )
    points = None if path is None else _points(path)
    result, code = kept(
        "computing the workspace",
        lambda progress: sa.workspace(
            arm, mode=mode, limits=limits, effort=effort, seed=seed, progress=progress
        ),
    )
    if effort is not None and result.effort == 0:
        err.print("spacearm: note: --effort has no effect: the bounds of this arm are proven")
    told = {}
    if free and not code:
        with working("the free workspace"):
            told = {"free": plain(result.free)}

    def drawn() -> dict[str, Any]:
        floats = not result.planar and mode == "free-floating" and not code
        with working("drawing") as progress:
            return {
                "path": points,
                "profile": result.profile(progress=progress) if floats else None,
            }

    return Answer(result, code, drawn, told)


@opt.answering("risk")
def compute_risk(
    arm: sa.SpaceArm,
    mode: opt.Mode = "free-floating",
    limits: opt.Limits = False,
    near: Annotated[
        float | None,
        typer.Option(
            help="Distance to the singular set up to which a posture is near [rad], with --deg "
            "in degrees. Default: 5 degrees.",
            min=0.0,
        ),
    ] = None,
    bins: Annotated[int, typer.Option(help="Number of distance classes.", min=1)] = 20,
    samples: Annotated[int, typer.Option(help="Number of postures.", min=1)] = 200_000,
    seed: Annotated[int, typer.Option(help="Seed of the sample.")] = 0,
    deg: bool = False,
) -> Answer:
    """Estimate the share of postures for which a search finds a singular posture nearby."""
    profile, code = kept(
        "sampling",
        lambda progress: sa.risk_profile(
            arm, mode=mode, limits=limits, distance=opt.radians(near, deg, None), bins=bins,
            samples=samples, seed=seed, progress=progress,
        ),
    )  # fmt: skip
    return Answer(profile, code)


@opt.answering("design")
def sweep_designs(
    arm: sa.SpaceArm,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="NAME=A[:B[:COUNT]]",
            help="A parameter and its values; A,B,C is possible too: base_mass (the inertia "
            "grows with it), payload, mass:LINK [kg], length:LINK [m], base_inertia (a "
            "factor), mount_x, mount_y, mount_z [m]; may be repeated.",
        ),
    ],
    mode: opt.Mode = "free-floating",
    limits: opt.Limits = False,
    effort: Effort = None,
) -> Answer:
    """Compare designs."""
    pairs = [text.partition("=") for text in vary]
    grid = {name: _values(name, values) for name, _, values in pairs}
    with working("designs") as progress:
        result = workspaces(
            arm, grid, mode=mode, limits=limits, effort=effort,
            risk_bins=1, progress=progress,
        )  # fmt: skip
    done, of = int(result["done"].sum()), result["done"].size
    if done < of:
        say_stopped(f"{done} of {of} designs done")
    return Answer(Designs(result, grid), INTERRUPTED if done < of else 0, thing=result)


class Designs(Described):
    """The dataset of `design.workspaces` as an answer.

    Args:
        found: The dataset.
        grid: The values of each parameter, by name.
    """

    def __init__(self, found: Any, grid: Mapping[str, Array]) -> None:
        self.found, self.grid = found, grid

    def describe(self) -> Description:
        """Return a table of the designs that are done."""
        found, rows = self.found, []
        near = [
            ("near_share", "within 5° of a singular posture"),
            ("near_error", "standard error"),
        ] * ("near_share" in found)
        shares = [("fraction", "path independent"), *near]
        for at in np.ndindex(found["done"].shape):
            if found["done"].values[at]:
                pdw = [r for r in found["pdw"].values[at] if np.isfinite(r).all()]
                values = (values[i] for values, i in zip(self.grid.values(), at, strict=True))
                shells = "  ".join(f"{low:.4f}..{high:.4f}" for low, high in pdw) or "none"
                told = (f"{found[name].values[at]:.2%}" for name, _ in shares)
                bounds = str(found["bounds"].values[at])
                if bounds == "sampled":
                    bounds += f", resolution {found['resolution'].values[at]:.2g} m"
                rows.append((*values, *told, shells, bounds))
        heads = [Column(name, unit_of(name).split()[0], ".6g") for name in self.grid]
        names = [head for _, head in shares]
        notes = [
            f"{name}: {GOES_WITH[name.partition(':')[0]]}"
            for name in self.grid
            if name.partition(":")[0] in GOES_WITH
        ]
        if near:
            notes.append(f"within 5° of a singular posture: {SEARCHED}")
        if (found["bounds"].values == "sampled").any():
            notes.append(
                "sampled distances are not certified: what the search misses makes the path "
                "dependent ones too few and the path independent share too large"
            )
        return Description(
            title=f"{found.attrs['arm']}, {found.attrs['base_mode']}",
            verdict=f"{len(rows)} of {found['done'].size} designs",
            notes=notes,
            tables=[Table((*heads, *names, "path dependent [m]", "distances are"), rows)],
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the designs as plain data, with the fields of `spacearm workspace --json`."""
        found = self.found
        sizes = "areas" if found["piw"].attrs["units"] == "m^2" else "volumes"
        designs = []
        for at in np.ndindex(found["done"].shape):
            here = zip(self.grid.items(), at, strict=True)
            told: dict[str, Any] = {"parameters": {name: float(v[i]) for (name, v), i in here}}
            told["done"] = bool(found["done"].values[at])
            if told["done"]:
                told[sizes] = {n: float(found[n].values[at]) for n in ("reachable", "piw")}
                for name in {"fraction", "near_share", "near_error"} & set(found):
                    told[name] = float(found[name].values[at])
                told["bounds"] = str(found["bounds"].values[at])
                for name in ("gap", "resolution"):
                    told[name] = plain(float(found[name].values[at]))
                pdw = found["pdw"].values[at]
                told["pdw"] = pdw[np.isfinite(pdw).all(axis=1)].tolist()
            designs.append(told)
        facts = {"arm": found.attrs["arm"], "mode": found.attrs["base_mode"]}
        return {**facts, "limits": bool(found.attrs["limits"]), "designs": designs}


def _values(name: str, text: str) -> Array:
    low, high, count = (*text.split(":"), "", "")[:3]
    try:
        if "," in text:
            return np.array([float(value) for value in text.split(",")])
        ends = float(low), float(high or low)
        number = int(count or (COUNT if high else 1))
    except ValueError:
        number = 0
    if number == 0 or text.count(":") > 2:
        raise sa.ConfigurationError(
            f"--vary {name}={text}: give numbers A,B,C, LOW:HIGH or LOW:HIGH:COUNT, as in "
            "base_inertia=1,5,20 or mount_x=0:0.8:5"
        )
    return np.linspace(*ends, whole(number, f"the number of values of --vary {name}", 1))


def _points(path: Path) -> Array:
    _, points = opt.table_of(path, f"--path {path}")
    if points.shape[1] not in (2, 3):
        raise sa.ConfigurationError(f"--path {path}: give 2 or 3 numbers a line [m]")
    return points
