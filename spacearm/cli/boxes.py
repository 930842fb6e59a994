"""`spacearm box` and `spacearm boxes`: joint ranges in which no posture is singular."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import spacearm as sa
from spacearm.arrays import Array
from spacearm.cli import options as opt
from spacearm.cli.output import Answer, kept, working
from spacearm.files import write
from spacearm.model.arguments import FLOATING
from spacearm.results import Description, Table, joint_measures
from spacearm.singularities.box_graph import MOST, SHARE


@opt.answering()
def find_box(
    arm: sa.SpaceArm,
    q: opt.JointValues = None,
    motion: Path | None = None,
    widest: list[str] | None = None,
    uncertain: list[str] | None = None,
    at_least: float | None = None,
    clearance: float = 0.0,
    no_limits: opt.NoLimits = False,
    mode: opt.Mode = "free-floating",
    save: opt.Written = None,
    urdf: opt.Written = None,
    deg: bool = False,
) -> Answer:
    """Prove joint ranges about a posture free of singular ones.

    With --motion, the ranges contain a motion in place of a posture.

    Options:
        motion: A saved motion.
        widest (JOINT): Joint whose range grows first; may be repeated.
        uncertain (LINK[:KIND]=SPREAD): Prove for all masses of a link: a share up or down, or two
            bounds [kg]. LINK:inertia likewise, with factors as bounds; LINK:com up or down each
            axis [m]. May be repeated.
        at_least: Width that all ranges must have [rad], with --deg in degrees.
        clearance: Least distance from any posture in the ranges to a singular one [rad], with --deg
            in degrees.
        save (TOML): Write the ranges to a TOML file.
        urdf (URDF): Write the robot with the ranges as its limits.
    """
    if motion is not None and q:
        raise sa.ConfigurationError("joint values and --motion are both given; give one of them")
    about = opt.configuration(arm, q, None, deg) if motion is None else sa.Motion.load(motion, arm)
    find: Callable[..., sa.FreeBox] = partial(sa.free_box, about, mode=mode)
    if uncertain:
        if mode != FLOATING:
            raise sa.ConfigurationError("--uncertain is for a floating arm; leave out --mode")
        find = partial(sa.free_box_for_all, _uncertain(arm, uncertain), about)
    with working("proving") as progress:
        box = find(
            joints=widest or (),
            at_least=opt.radians(at_least, deg, None),
            within=_everywhere(arm) if no_limits else None,
            clearance=opt.radians(clearance, deg, 0.0),
            progress=progress,
        )
    written = [box.save(save)] if save else []
    written += [arm.replace(lower=box.lower, upper=box.upper).to_urdf(urdf)] if urdf else []
    return Answer(box, written=written)


@opt.answering("boxes")
def cover_by_boxes(
    arm: sa.SpaceArm,
    q: opt.JointValues = None,
    to: str | None = None,
    way: opt.Written = None,
    share: float = SHARE,
    most: int = MOST,
    keep: opt.Written = None,
    no_limits: opt.NoLimits = False,
    mode: opt.Mode = "free-floating",
    deg: bool = False,
) -> Answer:
    """Cover joint space by ranges free of singular postures.

    With --to, it also finds a path from one posture to another. Everything is proven, rounding
    included. Ctrl-C keeps the ranges found so far.

    Options:
        to (Q1,Q2,...): Find a path through the ranges to these joint values.
        way (CSV): Write this path to a CSV file [rad], [m]; `spacearm path` takes it.
        share: Share of the joint range to cover, up to 1.
        most: Largest number of cells to look at, including those that are halved.
        keep (NPZ): Write the ranges to this file; if it exists, resume from its contents.
            spacearm plan --with search.boxes=FILE goes through them.
    """
    start = [opt.joint_values(arm, q, deg)] if q else []
    if (to is None) != (not q) or (way and to is None):
        raise sa.ConfigurationError("give joint values and --to for a way, --way to write it")
    ends = []
    if to:
        ends = [*start, opt.joint_values(arm, opt.numbers("--to", to).tolist(), deg)]
    so_far = sa.FreeBoxes.load(keep, arm, mode) if keep and keep.exists() else None
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
