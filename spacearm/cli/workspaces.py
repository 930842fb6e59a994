"""`spacearm workspace` and `spacearm risk`: where singularities are, from the system CM."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from spacearm.arrays import Array, plain
from spacearm.cli.options import (
    AsJson,
    Picture,
    Spacecraft,
    SpacecraftMode,
    on_a_model,
)
from spacearm.cli.output import (
    check_picture,
    err,
    kept,
    out,
    picture_path,
    print_description,
    print_json,
    table,
    working,
    write_picture,
)
from spacearm.errors import ConfigurationError
from spacearm.files import read
from spacearm.model.arm import SpaceArm
from spacearm.singularities.report import angle
from spacearm.singularities.risk import risk_profile
from spacearm.workspaces.path_dependent import EFFORT, workspace

EFFORT_HELP = (
    f"Number of singular configurations that the search starts from, {EFFORT:,} if not given; only "
    "for arms of more than 3 joints."
)


@on_a_model
def compute_workspace(
    arm: SpaceArm,
    mode: SpacecraftMode = Spacecraft.FREE,
    limits: Annotated[bool, typer.Option("--limits", help="Count joint limits.")] = False,
    effort: Annotated[
        int | None,
        typer.Option(help=EFFORT_HELP, min=1, show_default=False),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of that search.")] = 0,
    free: Annotated[
        bool,
        typer.Option(
            "--free", help="The free workspace too (Vafa & Dubowsky); takes as long as the rest."
        ),
    ] = False,
    output: Picture = None,
    path: Annotated[
        Path | None,
        typer.Option(
            help="Tip path to draw: a text file with one point per line, from the CM [m]."
        ),
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Show the shells in the browser.")] = False,
    as_json: AsJson = False,
) -> int:
    """Compute and draw the path dependent and path independent workspaces.

    Ctrl-C keeps what there is.
    """
    check_picture(output)
    points = None if path is None else _points(path)
    tries = EFFORT if effort is None else effort
    result, code = kept(
        "computing the workspace",
        lambda progress: workspace(
            arm, mode=mode.value, limits=limits, effort=tries, seed=seed, progress=progress
        ),
    )
    if effort is not None and result.effort == 0:
        err.print("spacearm: note: --effort does not count: the bounds of this arm are proven")
    more = {}
    if free and not code:
        with working("the free workspace"):
            more = {"free": plain(result.free)}
    if as_json:
        print_json(result.to_dict() | more)
    else:
        print_description(result.describe())
    if output or not (as_json or view):
        from spacearm.plots.workspaces import draw_workspace  # imports matplotlib

        floats = not result.planar and mode == "free-floating" and not code
        with working("drawing") as progress:
            profile = result.profile(progress=progress) if floats else None
        where = picture_path(output, arm.name, "workspace")
        write_picture(where, draw_workspace(result, points, profile))
        if not as_json:
            out.print(f"wrote {where}")
    if view:
        from spacearm.cli.views import serve_until_interrupted
        from spacearm.viewer.show import view as show

        serve_until_interrupted(show(result, open=False))
    return code


@on_a_model
def compute_risk(
    arm: SpaceArm,
    limits: Annotated[bool, typer.Option("--limits", help="Count joint limits.")] = False,
    near: Annotated[
        float | None,
        typer.Option(
            help="Distance to the singular set up to which a posture is near [rad], with --deg in "
            "degrees; 5 degrees if not given.",
            min=0.0,
        ),
    ] = None,
    bins: Annotated[int, typer.Option(help="Number of distance classes.", min=1)] = 20,
    samples: Annotated[int, typer.Option(help="Number of postures.", min=1)] = 200_000,
    seed: Annotated[int, typer.Option(help="Seed of the sample.")] = 0,
    output: Picture = None,
    deg: bool = False,
    as_json: AsJson = False,
) -> int:
    """Estimate how many postures are near a singularity, by the tip's distance from the CM.

    Ctrl-C keeps what there is.
    """
    check_picture(output)
    bound = None if near is None else float(np.radians(near) if deg else near)
    profile, code = kept(
        "sampling",
        lambda progress: risk_profile(
            arm, limits=limits, distance=bound, bins=bins, samples=samples, seed=seed,
            progress=progress,
        ),
    )  # fmt: skip
    if as_json:
        print_json(profile.to_dict())
    else:
        near_by = f"within {angle(profile.bound)} of a singular posture, to first order"
        out.print(
            f"{arm.name}, free-floating: share of {profile.count.sum():,.0f} postures {near_by}"
        )
        rows = table("R from [m]", "to [m]", "share", "standard error", "postures")
        edges = zip(profile.edges[:-1], profile.edges[1:], strict=True)
        for (low, high), share, error, count in zip(
            edges, profile.share, profile.error, profile.count, strict=True
        ):
            known = (f"{share:.1%}", f"{error:.1%}") if count else ("none", "")
            rows.add_row(f"{low:.4f}", f"{high:.4f}", *known, f"{count:,.0f}")
        out.print(rows)
        out.print("R: distance of the tip from the system CM; joint limits ", end="")
        out.print("count" if limits else "do not count")
    if output or not as_json:
        from spacearm.plots.show import plot  # imports matplotlib

        where = picture_path(output, arm.name, "risk")
        write_picture(where, plot(profile))
        if not as_json:
            out.print(f"wrote {where}")
    return code


def _points(path: Path) -> Array:
    try:
        points = np.loadtxt(read(path).decode().splitlines(), ndmin=2)
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"--path {path}: {error}") from None
    if points.shape[1] not in (2, 3) or not np.isfinite(points).all():
        raise ConfigurationError(f"--path {path}: give 2 or 3 finite numbers a line [m]")
    return points
