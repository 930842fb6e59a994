"""`spacearm design`: the workspace over masses, inertias and mounting points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
import typer

from spacearm.arrays import Array
from spacearm.cli.options import (
    AsJson,
    Picture,
    Spacecraft,
    SpacecraftMode,
    on_a_model,
)
from spacearm.cli.output import (
    check_picture,
    out,
    picture_path,
    print_description,
    print_json,
    say_stopped,
    working,
    write_picture,
)
from spacearm.cli.wording import INTERRUPTED
from spacearm.cli.workspaces import EFFORT_HELP
from spacearm.errors import ConfigurationError
from spacearm.model.arm import SpaceArm
from spacearm.results import Cell, Column, Description, Table
from spacearm.workspaces.design import workspaces

Range = Annotated[str | None, typer.Option(metavar="A:B[:COUNT]", help="A value or a range.")]
COUNT = 9
UNITS = {"base_inertia": "times", **dict.fromkeys(("mount_x", "mount_y", "mount_z"), "m")}
"""Units of the parameters; the others are masses."""


@on_a_model
def sweep_designs(
    arm: SpaceArm,
    base_mass: Range = None,
    base_inertia: Range = None,
    mount_x: Range = None,
    mount_y: Range = None,
    mount_z: Range = None,
    payload: Range = None,
    link_mass: Annotated[
        list[str] | None,
        typer.Option(metavar="LINK=A:B[:COUNT]", help="Mass of a link [kg]; may be repeated."),
    ] = None,
    mode: SpacecraftMode = Spacecraft.FREE,
    limits: Annotated[bool, typer.Option("--limits", help="Count joint limits.")] = False,
    effort: Annotated[
        int | None,
        typer.Option(help=EFFORT_HELP, min=1),
    ] = None,
    output: Picture = None,
    as_json: AsJson = False,
) -> int:
    """Draw the path independent share over design parameters; Ctrl-C keeps what is done.

    base-inertia is a factor at constant mass, mount-* are in m, masses in kg.
    """
    check_picture(output)
    named = {
        "base_mass": base_mass, "base_inertia": base_inertia, "mount_x": mount_x,
        "mount_y": mount_y, "mount_z": mount_z, "payload": payload,
    }  # fmt: skip
    for text in link_mass or []:
        link, _, values = text.partition("=")
        named[f"mass:{link}"] = values
    grid = {name: _values(name, text) for name, text in named.items() if text is not None}
    if not grid:
        raise ConfigurationError("nothing to vary; give --base-inertia 1:20, --mount-x 0:0.8, ...")
    with working("designs") as progress:
        result = workspaces(
            arm,
            grid,
            mode=mode.value,
            limits=limits,
            effort=effort,
            progress=progress,
        )
    if as_json:
        print_json(_told(result, grid))
    else:
        print_description(_described(result, grid))
    stopped = not bool(result["done"].all())
    if stopped:
        say_stopped(f"{int(result['done'].sum())} of {result['done'].size} designs done")
    if output or not as_json:
        from spacearm.plots.workspaces import draw_design  # imports matplotlib

        where = picture_path(output, arm.name, "design")
        write_picture(where, draw_design(result))
        if not as_json:
            out.print(f"wrote {where}")
    return INTERRUPTED if stopped else 0


def _told(result: Any, grid: Mapping[str, Array]) -> dict[str, Any]:
    """Return the designs as plain data, with the fields that `spacearm workspace --json` has."""
    sizes = "areas" if result["piw"].attrs["units"] == "m^2" else "volumes"
    designs = []
    for at in np.ndindex(result["done"].shape):
        here = {name: float(values[i]) for (name, values), i in zip(grid.items(), at, strict=True)}
        told = {"parameters": here, "done": bool(result["done"].values[at])}
        if told["done"]:
            told[sizes] = {name: float(result[name].values[at]) for name in ("reachable", "piw")}
            told["fraction"] = float(result["fraction"].values[at])
            pdw = result["pdw"].values[at]
            told["pdw"] = pdw[np.isfinite(pdw).all(axis=1)].tolist()
        designs.append(told)
    facts = {"arm": result.attrs["arm"], "mode": result.attrs["base_mode"]}
    return {**facts, "limits": bool(result.attrs["limits"]), "designs": designs}


def _described(result: Any, grid: Mapping[str, Array]) -> Description:
    """Describe the designs that are done."""
    columns = [Column(name, UNITS.get(name, "kg"), ".6g") for name in grid]
    columns += [Column("path independent", "", ".2%"), Column("path dependent", "m")]
    rows: list[list[Cell]] = []
    for at in np.ndindex(result["done"].shape):
        if result["done"].values[at]:
            pdw = [radii for radii in result["pdw"].values[at] if np.isfinite(radii).all()]
            ranges = "  ".join(f"{low:.4f}..{high:.4f}" for low, high in pdw) or "none"
            here = [values[i] for values, i in zip(grid.values(), at, strict=True)]
            rows.append([*here, float(result["fraction"].values[at]), ranges])
    return Description(
        title=f"{result.attrs['arm']}, {result.attrs['base_mode']}",
        verdict=f"{len(rows)} designs",
        tables=[Table(columns, rows)],
    )


def _values(name: str, text: str) -> Array:
    low, high, count = (*text.split(":"), "", "")[:3]
    try:
        ends = float(low), float(high or low)
        number = int(count or (COUNT if high else 1))
    except ValueError:
        number = 0
    if number < 1 or text.count(":") > 2:
        raise ConfigurationError(
            f"{name} is {text!r}; give a number, LOW:HIGH or LOW:HIGH:COUNT, as in 1:20 or 1:20:5"
        )
    return np.linspace(*ends, number)
