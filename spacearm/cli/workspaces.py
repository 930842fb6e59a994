"""`spacearm workspace`: the path dependent and path independent workspaces."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

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
from spacearm.cli.output import check_picture, out, picture_path, print_json, table, write_picture
from spacearm.errors import ConfigurationError
from spacearm.files import read
from spacearm.model.arm import SpaceArm
from spacearm.workspaces.path_dependent import EFFORT, Workspace, workspace


@on_a_model
def compute_workspace(
    arm: SpaceArm,
    mode: SpacecraftMode = Spacecraft.FREE,
    limits: Annotated[bool, typer.Option("--limits", help="Count joint limits.")] = False,
    effort: Annotated[
        int,
        typer.Option(help="Number of singular configurations to search from (larger arms).", min=1),
    ] = EFFORT,
    seed: Annotated[int, typer.Option(help="Seed of that search.")] = 0,
    output: Picture = None,
    path: Annotated[
        Path | None,
        typer.Option(
            help="Tip path to draw: a text file with one point per line, from the CM [m]."
        ),
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Show the shells in the browser.")] = False,
    as_json: AsJson = False,
) -> None:
    """Compute and draw the path dependent and path independent workspaces."""
    check_picture(output)
    points = None if path is None else _points(path)
    result = workspace(arm, mode=mode.value, limits=limits, effort=effort, seed=seed)
    if as_json:
        print_json(result.to_dict())
    else:
        _print(result)
    if output or not (as_json or view):
        from spacearm.plots.workspaces import draw_workspace  # imports matplotlib

        profile = None if result.planar or mode != "free-floating" else result.profile()
        where = picture_path(output, arm.name, "workspace")
        write_picture(where, draw_workspace(result, points, profile))
        if not as_json:
            out.print(f"wrote {where}")
    if view:
        from spacearm.cli.views import serve_until_interrupted
        from spacearm.viewer.show import view as show

        serve_until_interrupted(show(result, open=False))


def _print(result: Workspace) -> None:
    unit = "m^2" if result.planar else "m^3"
    how = "proven" if result.kind == "certified" else f"found, effort {result.effort:,}"
    out.print(f"{result.arm.name}, {result.mode}: distances of the tip from the system CM ({how})")
    rows = table("workspace", "from [m]", "to [m]", f"volume [{unit}]")
    volumes = result.volumes
    for label, name in (
        ("reachable", "reachable"), ("path dependent", "pdw"),
        ("path independent", "piw"), ("free", "free"),
    ):  # fmt: skip
        radii: Array = getattr(result, name)
        for i, (low, high) in enumerate(radii):
            volume = f"{volumes[name]:.7g}" if i == 0 and name in volumes else ""
            rows.add_row(label if i == 0 else "", f"{low:.7f}", f"{high:.7f}", volume)
        if not len(radii):
            rows.add_row(label, "none", "", "")
    out.print(rows)
    out.print(f"path independent share of the reachable workspace: {result.fraction:.2%}")


def _points(path: Path) -> Array:
    try:
        points = np.loadtxt(read(path).decode().splitlines(), ndmin=2)
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"--path {path}: {error}") from None
    if points.shape[1] not in (2, 3) or not np.isfinite(points).all():
        raise ConfigurationError(f"--path {path}: give 2 or 3 finite numbers a line [m]")
    return points
