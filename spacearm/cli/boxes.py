"""`spacearm box` and `spacearm boxes`: joint ranges in which no posture is singular."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import spacearm as sa
from spacearm.arrays import Array
from spacearm.cli import options as opt
from spacearm.cli.output import STEP_LIMIT, Answer, kept, working
from spacearm.files import is_there, write
from spacearm.model.arguments import FLOATING
from spacearm.results import Description, Table, joint_measures
from spacearm.singularities.box_graph import MOST, SHARE


@opt.answering()
def find_box(
    arm: sa.SpaceArm,
    q: opt.JointValues = None,
    motion: Annotated[Path | None, typer.Option(help="A saved motion.")] = None,
    widest: Annotated[
        list[str] | None,
        typer.Option(metavar="JOINT", help="Joint whose range grows first; may be repeated."),
    ] = None,
    uncertain: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LINK[:KIND]=SPREAD",
            help="Certify the ranges for all masses of a link: a fraction up and down, or two "
            "bounds [kg]. LINK:inertia does the same with the inertia, with factors as "
            "bounds; LINK:com moves the CM up and down each axis [m]. May be repeated.",
        ),
    ] = None,
    at_least: Annotated[
        float | None,
        typer.Option(help="Width that every range must have [rad], with --deg in degrees."),
    ] = None,
    clearance: Annotated[
        float,
        typer.Option(
            help="Least distance between the postures in the ranges and the singular set "
            "[rad], with --deg in degrees."
        ),
    ] = 0.0,
    effort: Annotated[
        float,
        typer.Option(
            help="Factor on the number of cells that the proof may take; sides where the proof "
            "ended may move on with more."
        ),
    ] = 1.0,
    no_limits: opt.NoLimits = False,
    mode: opt.Mode = "free-floating",
    save: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="TOML|URDF",
            help="Write the ranges to a TOML file, or the robot with the ranges as its joint "
            "limits to a URDF; may be repeated.",
            callback=opt.each_to_write,
        ),
    ] = None,
    deg: bool = False,
) -> Answer:
    """Find a singularity-free box."""
    if motion is not None and q:
        raise sa.ConfigurationError("joint values and --motion are both given; give one of them")
    about = opt.configuration(arm, q, None, deg) if motion is None else sa.Motion.load(motion, arm)
    find: Callable[..., sa.FreeBox] = partial(sa.free_box, about, mode=mode, effort=effort)
    if uncertain:
        if mode != FLOATING:
            raise sa.ConfigurationError("--uncertain is for a floating arm; leave out --mode")
        if effort != 1.0:
            raise sa.ConfigurationError("--effort is not for --uncertain; leave one of them out")
        find = partial(sa.free_box_for_all, _uncertain(arm, uncertain), about)
    with working("proving", form=STEP_LIMIT) as progress:
        box = find(
            joints=widest or (),
            at_least=opt.radians(at_least, deg, None),
            within=_everywhere(arm) if no_limits else None,
            clearance=opt.radians(clearance, deg, 0.0),
            progress=progress,
        )
    written: list[Path] = []
    for path in save or ():
        if path.suffix.lower() == ".urdf":
            written.append(arm.replace(lower=box.lower, upper=box.upper).to_urdf(path))
        else:
            written.append(box.save(path))
    return Answer(box, written=written)


@opt.answering("boxes")
def cover_by_boxes(
    arm: sa.SpaceArm,
    q: opt.JointValues = None,
    to: Annotated[
        str | None,
        typer.Option(
            metavar="Q1,Q2,...", help="Find a path through the boxes to these joint values."
        ),
    ] = None,
    way: Annotated[
        Path | None,
        typer.Option(
            metavar="CSV",
            help="Write this path to a CSV file [rad], [m]; spacearm path reads it.",
            callback=opt.to_write,
        ),
    ] = None,
    share: Annotated[
        float, typer.Option(help="Fraction of the joint space to cover, at most 1.")
    ] = SHARE,
    most: Annotated[
        int,
        typer.Option(help="Maximum number of cells to examine, including those that are halved."),
    ] = MOST,
    keep: Annotated[
        Path | None,
        typer.Option(
            metavar="NPZ",
            help="Write the boxes to this file. If the file exists, resume from its boxes. "
            "spacearm plan --with search.boxes=FILE plans through them.",
            callback=opt.to_write,
        ),
    ] = None,
    no_limits: opt.NoLimits = False,
    mode: opt.Mode = "free-floating",
    deg: bool = False,
) -> Answer:
    """Cover the joint space by singularity-free boxes."""
    start = [opt.joint_values(arm, q, deg)] if q else []
    if (to is None) != (not q) or (way and to is None):
        raise sa.ConfigurationError("give joint values and --to for a way, --way to write it")
    ends = []
    if to:
        ends = [*start, opt.joint_values(arm, opt.numbers("--to", to).tolist(), deg)]
    so_far = sa.FreeBoxes.load(keep, arm, mode) if keep and is_there(keep) else None
    within = _everywhere(arm) if no_limits else None
    found, code = kept(
        "covering",
        lambda progress: sa.free_boxes(
            arm,
            within=within,
            share=share,
            most=most,
            so_far=so_far,
            mode=mode,
            progress=progress,
        ),
        STEP_LIMIT,
    )
    written = [found.save(keep)] if keep else []
    rows = found.path(*ends) if ends else None
    if rows is None:
        return Answer(found, code, written=written)
    postures = {f"posture {i}": joint_measures(x, arm.slides) for i, x in enumerate(rows, 1)}
    table = Table.by_columns({"joint": arm.joint_names, **postures})
    said = Description(title="Way through the boxes, proven", tables=[table])
    if way:
        head = f"# joint positions [rad], [m]: {' '.join(arm.joint_names)}"
        lines = [",".join(map(repr, row)) for row in rows.tolist()]
        written.append(write(way, "\n".join([head, *lines, ""]).encode()))
    return Answer(found, code, told={"way": rows.tolist()}, written=written, more=[said])


def _uncertain(arm: sa.SpaceArm, texts: list[str]) -> sa.UncertainArm:
    """Return the arm whose links have the spreads LINK[:KIND]=SPREAD."""
    spread: dict[str, dict[str, Any]] = {}
    for what, value in opt.pairs("--uncertain", texts, "LINK[:KIND]=SPREAD").items():
        link, _, kind = what.partition(":")
        bounds = opt.numbers(f"--uncertain {what}=SPREAD: SPREAD", value).tolist()
        spread.setdefault(link, {})[kind or "mass"] = bounds if len(bounds) > 1 else bounds[0]
    return sa.uncertain(arm, spread)


def _everywhere(arm: sa.SpaceArm) -> tuple[Array, Array]:
    """Return the range without joint limits."""
    return np.full(arm.n, -np.inf), np.full(arm.n, np.inf)
