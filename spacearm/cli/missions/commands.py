"""`spacearm attitudes`, `reaction`, `wheels`, `report`: what a mission designer asks of an arm."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from spacearm.arrays import Array
from spacearm.cli.options import (
    AsJson,
    Attitude,
    Picture,
    goal_from,
    joint_values,
    numbers,
    on_a_model,
    spacecraft_pose,
)
from spacearm.cli.output import (
    check_picture,
    joint_value,
    out,
    picture_path,
    print_json,
    print_result,
    table,
    vector,
    working,
    write_picture,
)
from spacearm.cli.wording import join_numbers
from spacearm.errors import ConfigurationError
from spacearm.mission.attitude_search import ENDS
from spacearm.mission.attitudes import MARGIN, FeasibleAttitudes, feasible_attitudes
from spacearm.mission.reactions import Reaction, reaction, size_wheels
from spacearm.model.arm import SpaceArm
from spacearm.motion.motion import Motion
from spacearm.singularities.risk import NEAR

AXES = ("about x", "about y", "about z", "about any axis")


@on_a_model
def find_attitudes(
    arm: SpaceArm,
    corner: Annotated[
        list[str],
        typer.Option(
            help="A corner of the path, the first is its start: task rows of the tip, from the "
            "system CM [m], turns as roll pitch yaw. Give two or more.",
            metavar="X1 X2 ...",
        ),
    ],
    q0: Annotated[
        str | None,
        typer.Option(
            "--q0", help="A posture near the start of the path; else all.", metavar="Q1 Q2 ..."
        ),
    ] = None,
    attitude: Attitude = (0.0, 0.0, 0.0),
    margin: Annotated[
        float | None,
        typer.Option(help="Least distance to the singular set [rad]; 1 degree by default.", min=0),
    ] = None,
    speed: Annotated[
        float, typer.Option(help="Speed of the tip [m/s]; counts with momentum.")
    ] = 0.1,
    momentum: Annotated[
        str | None,
        typer.Option(help="Angular momentum on board [N m s], inertial axes.", metavar="X,Y,Z"),
    ] = None,
    samples: Annotated[int | None, typer.Option(help="Number of attitudes tried at first.")] = None,
    no_limits: Annotated[bool, typer.Option("--no-limits", help="Ignore joint limits.")] = False,
    output: Picture = None,
    view: Annotated[bool, typer.Option("--view", help="Play the best in the browser.")] = False,
    deg: bool = False,
    as_json: AsJson = False,
) -> None:
    """Find the attitudes of the spacecraft from which the tip can follow a path."""
    check_picture(output)
    given = MARGIN if margin is None else float(np.radians(margin)) if deg else margin
    corners = [goal_from(arm, "--corner", text, deg) for text in corner]
    h = None if momentum is None else np.append(np.zeros(3), _three("--momentum", momentum))
    q = np.zeros(arm.n) if q0 is None else joint_values(arm, q0.split(), deg)
    start = arm.at(q, base=spacecraft_pose(attitude, deg), momentum=h)
    with working("trying attitudes") as progress:
        found = feasible_attitudes(
            start,
            corners,
            all_branches=q0 is None,
            margin=given,
            speed=speed,
            limits=not no_limits,
            samples=samples,
            progress=progress,
        )
    if as_json:
        print_json(found.to_dict())
    else:
        _print_attitudes(found, deg)
    _draw(found, output, arm.name, "attitudes", quiet=as_json or view, silent=as_json)
    if view:
        from spacearm.cli.views import serve_until_interrupted
        from spacearm.viewer.show import view as show

        serve_until_interrupted(show(found, open=False))


@on_a_model
def report_reaction(
    arm: SpaceArm,
    motion: Annotated[
        Path, typer.Option(help="A motion written by --save of plan or simulate.", metavar="NPZ")
    ],
    camera: Annotated[
        str | None,
        typer.Option(help="Line of sight of a camera, spacecraft axes.", metavar="X,Y,Z"),
    ] = None,
    output: Picture = None,
    as_json: AsJson = False,
) -> None:
    """Report what a motion does to the spacecraft, and what holding the attitude takes."""
    check_picture(output)
    sight = None if camera is None else _three("--camera", camera)
    with working("computing reactions") as progress:
        found = reaction(Motion.load(motion, arm), camera=sight, progress=progress)
    if as_json:
        print_json(found.to_dict())
    else:
        _print_reaction(found)
    _draw(found, output, arm.name, "reaction", quiet=as_json, silent=as_json)


@on_a_model
def size_wheels_of(
    arm: SpaceArm,
    tip_speed: Annotated[
        float | None, typer.Option(help="Speed of the tip [m/s] in any direction, any posture.")
    ] = None,
    motion: Annotated[
        list[Path] | None,
        typer.Option(help="A motion to cover instead; may be repeated.", metavar="NPZ"),
    ] = None,
    samples: Annotated[int, typer.Option(help="Number of postures.", min=1)] = 2000,
    near: Annotated[
        float | None,
        typer.Option(help="Postures nearer to a singularity are left out; 5 degrees by default."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the postures.")] = 0,
    output: Picture = None,
    deg: bool = False,
    as_json: AsJson = False,
) -> None:
    """Compute the momentum that wheels need to hold the attitude while the arm moves."""
    check_picture(output)
    apart = NEAR if near is None else float(np.radians(near)) if deg else near
    runs = None if not motion else [Motion.load(path, arm) for path in motion]
    with working("sizing wheels") as progress:
        found = size_wheels(
            arm,
            runs,
            tip_speed=tip_speed,
            samples=samples,
            near=apart,
            seed=seed,
            progress=progress,
        )
    print_result(found, deg=deg, as_json=as_json)
    _draw(found, output, arm.name, "wheels", quiet=as_json, silent=as_json)


@on_a_model
def write_report(
    arm: SpaceArm,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="The page to write.", metavar="HTML")
    ],
    q0: Annotated[
        str | None,
        typer.Option(
            "--q0", help="The working posture; else one far from singularities.", metavar="Q1 ..."
        ),
    ] = None,
    deg: bool = False,
) -> None:
    """Write a design report: one page with arm, singular sets, workspaces and reactions."""
    from spacearm.reports.sections import design_report  # imports matplotlib

    start = None if q0 is None else joint_values(arm, q0.split(), deg)
    with working("writing the report") as progress:
        path = design_report(
            arm, output, q0=start, words=_describing(sys.argv[2:]), progress=progress
        )
    out.print(f"wrote {path}")


def _describing(words: Sequence[str]) -> list[str]:
    """Return the words of a command line that describe the arm."""
    kept: list[str] = []
    skipping = False
    for word in join_numbers(words):
        if not skipping and word not in ("-o", "--output", "--q0"):
            kept.append(word)
        skipping = word in ("-o", "--output", "--q0")
    return [word for word in kept if not word.startswith(("--output=", "--q0="))]


def _draw(
    found: Any, output: Path | None, name: str, kind: str, *, quiet: bool, silent: bool
) -> None:
    """Write the picture that is asked for, or the usual one."""
    if output or not quiet:
        from spacearm.plots.show import plot  # imports matplotlib

        where = picture_path(output, name, kind)
        write_picture(where, plot(found))
        if not silent:
            out.print(f"wrote {where}")


def _print_attitudes(found: FeasibleAttitudes, deg: bool) -> None:
    unit = "m" if min(found.arm.task.indices) < 3 else "rad"
    out.print(
        f"{found.arm.name}: the path of {found.length:.4g} {unit} can be followed from "
        f"{found.share:.2%} of the attitudes, {np.degrees(found.margin):.3g}° from singularities"
        + ("" if found.limits else ", limits ignored")
        + ("" if found.intervals is not None else f" (standard error {found.error:.2%})")
    )
    rows = table("ended", "attitudes tried")
    for kind, count in zip(*np.unique(found.ended, return_counts=True), strict=True):
        rows.add_row(ENDS[int(kind)], f"{count:,}")
    out.print(rows)
    for low, high in [] if found.intervals is None else np.degrees(found.intervals):
        out.print(f"feasible      {low:.5f}° to {high:.5f}°")
    if found.ball is None:
        return
    best = found.start()
    kinds = [best.arm.tree.joints[name].kind for name in best.arm.joint_names]
    q = ", ".join(joint_value(x, kind, deg) for x, kind in zip(best.q, kinds, strict=True))
    out.print(
        f"best          keeps {np.degrees(found.distance[found.best]):.4g}°, attitude (xyzw) "
        f"{vector(found.attitude[found.best])}, q ({q})"
    )
    out.print(
        f"largest ball  {np.degrees(found.ball.radius):.4g}° about the attitude (xyzw) "
        f"{vector(found.ball.centre)}"
    )
    out.print("not checked: collisions; whether the arm comes to the start's posture")


def _print_reaction(found: Reaction) -> None:
    out.print(repr(found))
    rows = table("largest", "about x", "about y", "about z")
    for name, values, unit in (
        ("turn, floating", np.degrees(np.abs(found.excursion).max(axis=0)), "°"),
        ("wheels, held", np.abs(found.wheels).max(axis=0), " N m s"),
        ("torque, held", np.abs(found.torque).max(axis=0), " N m"),
        ("thrusters, held", found.impulse, " N m s in all"),
    ):
        rows.add_row(name, *(f"{value:.5g}{unit}" for value in values))
    out.print(rows)
    what = "any line of sight" if found.camera is None else "the line of sight"
    out.print(
        f"floating, {what} turns by up to {np.degrees(found.pointing.max()):.4g}°, at up to "
        f"{np.degrees(found.smear.max()):.4g}°/s"
    )


def _three(option: str, text: str) -> Array:
    """Parse three numbers."""
    values = numbers(option, text)
    if len(values) != 3:
        raise ConfigurationError(f"{option} is {text!r}; give three numbers, as in 0,0,1")
    return values
