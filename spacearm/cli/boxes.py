"""`spacearm box`: joint ranges in which no posture is singular."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from spacearm.cli.options import (
    AsJson,
    JointValues,
    NoLimits,
    Spacecraft,
    SpacecraftMode,
    configuration,
    on_a_model,
    radians,
    to_write,
)
from spacearm.cli.output import out, print_result, working
from spacearm.errors import ConfigurationError
from spacearm.model.arm import SpaceArm
from spacearm.motion.motion import Motion
from spacearm.singularities.joint_boxes import free_box


@on_a_model
def find_box(
    arm: SpaceArm,
    q: JointValues = None,
    motion: Annotated[
        Path | None,
        typer.Option(help="A saved motion that the ranges hold, in place of a posture."),
    ] = None,
    widest: Annotated[
        list[str] | None,
        typer.Option(help="Joint whose range grows first; may be repeated.", metavar="JOINT"),
    ] = None,
    at_least: Annotated[
        float | None,
        typer.Option(help="Width that all ranges must have [rad], with --deg in degrees."),
    ] = None,
    clearance: Annotated[
        float,
        typer.Option(
            help="How far singular postures are from all in the ranges [rad], with --deg in "
            "degrees."
        ),
    ] = 0.0,
    no_limits: NoLimits = False,
    mode: SpacecraftMode = Spacecraft.FREE,
    save: Annotated[
        Path | None,
        typer.Option(help="Write the ranges to a TOML file.", metavar="TOML", callback=to_write),
    ] = None,
    urdf: Annotated[
        Path | None,
        typer.Option(help="Write the robot with the ranges as its limits.", callback=to_write),
    ] = None,
    deg: bool = False,
    as_json: AsJson = False,
) -> None:
    """Find joint ranges about a posture or a motion in which no posture is singular, proven."""
    if motion is not None and q:
        raise ConfigurationError("joint values and --motion are both given; give one of them")
    about = configuration(arm, q, None, deg) if motion is None else Motion.load(motion, arm)
    everywhere = np.full(arm.n, -np.inf), np.full(arm.n, np.inf)
    with working("proving") as progress:
        box = free_box(
            about,
            joints=widest or (),
            at_least=radians(at_least, deg),
            within=everywhere if no_limits else None,
            clearance=radians(clearance, deg) or 0.0,
            mode=mode.value,
            progress=progress,
        )
    print_result(box, deg=deg, as_json=as_json)
    for path in (save and box.save(save), urdf and arm.limited(box.ranges).to_urdf(urdf)):
        if path and not as_json:
            out.print(f"wrote {path}")
