"""`spacearm plan`: a joint motion to a goal."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from spacearm.cli.options import (
    AsJson,
    Attitude,
    From,
    Picture,
    PointsFrom,
    Spacecraft,
    SpacecraftMode,
    goal_from,
    joint_values,
    mark_of,
    numbers,
    on_a_model,
    spacecraft_pose,
)
from spacearm.cli.output import (
    check_picture,
    err,
    out,
    picture_path,
    print_result,
    working,
    write_picture,
)
from spacearm.cli.plans.parsing import goals, obstacle_of
from spacearm.cli.wording import INTERRUPTED, in_own_words
from spacearm.errors import ConfigurationError, NoSolutionError, StoppedError, UnsupportedError
from spacearm.model.arm import SpaceArm
from spacearm.motion.motion_file import check_suffix
from spacearm.motion.plant import WheelHold
from spacearm.planning.planner import detumble as find_detumbling
from spacearm.planning.planner import plan
from spacearm.planning.request import Constraints, Search
from spacearm.planning.result import Plan
from spacearm.workspaces.path_dependent import Workspace, workspace


@on_a_model
def plan_motion(
    arm: SpaceArm,
    q0: Annotated[
        str, typer.Option("--q0", help="Joint values at the start.", metavar="Q1 Q2 ...")
    ],
    goal: Annotated[
        list[str],
        typer.Option(
            help="Task rows of the tip [m], turns as roll pitch yaw; see --origin. With several "
            "tips NAME=X1,X2,... for each.",
            metavar="X1 X2 ...",
        ),
    ],
    via: Annotated[
        list[str] | None,
        typer.Option(
            help="A goal on the way, written like --goal; may be repeated, in order.",
            metavar="X1 X2 ...",
        ),
    ] = None,
    origin: PointsFrom = From.SPACECRAFT,
    attitude: Attitude = (0.0, 0.0, 0.0),
    final_attitude: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="Roll, pitch, yaw of the spacecraft at the end.", metavar="R P Y"),
    ] = None,
    clearance: Annotated[
        float | None,
        typer.Option(
            help="Least distance to the singular set on the way [rad], with --deg in degrees.",
            min=0.0,
        ),
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            help="auto, straight, tree, joint space, cycles, attitude first; auto tries all."
        ),
    ] = "auto",
    no_limits: Annotated[bool, typer.Option("--no-limits", help="Ignore joint limits.")] = False,
    no_collisions: Annotated[
        bool, typer.Option("--no-collisions", help="Ignore collisions.")
    ] = False,
    obstacle: Annotated[
        list[str] | None,
        typer.Option(
            help="box:X,Y,Z:SIZE (or LX,LY,LZ), sphere:X,Y,Z:RADIUS, "
            "cylinder:X,Y,Z:RADIUS,LENGTH, mesh:X,Y,Z:FILE or robot:X,Y,Z:MODEL, [m], see "
            "--origin; then :R,P,Y and @MARGIN; may be repeated.",
            metavar="KIND:PLACE:WHAT",
        ),
    ] = None,
    momentum: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option(
            help="Constant momentum on board: linear [kg m/s], angular about the CM [N m s].",
            metavar="P P P H H H",
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="When the motion ends [s]; else as soon as it can.")
    ] = None,
    keep_attitude: Annotated[
        float | None,
        typer.Option(
            help="Largest turn of the spacecraft on the way [rad], with --deg in degrees."
        ),
    ] = None,
    detumble: Annotated[
        bool,
        typer.Option(
            "--detumble", help="Wheels take up the momentum; the spacecraft ends at rest."
        ),
    ] = False,
    mode: SpacecraftMode = Spacecraft.FREE,
    wheel_limits: Annotated[
        tuple[float, float] | None,
        typer.Option(
            help="Largest torque [N m] and momentum [N m s] of each wheel that holds the attitude "
            "or detumbles; else those of the description.",
            metavar="T H",
        ),
    ] = None,
    wheels0: Annotated[
        str | None,
        typer.Option("--wheels0", help="What the wheels hold at the start.", metavar="H1 ..."),
    ] = None,
    fastest: Annotated[
        bool,
        typer.Option(
            "--fastest", help="Time it as fast as effort and velocity limits allow; needs toppra."
        ),
    ] = False,
    seed: Annotated[int, typer.Option(help="Seed of the first guesses.")] = 0,
    timeout: Annotated[float, typer.Option(help="Give up after this time [s].")] = 60.0,
    output: Picture = None,
    save: Annotated[
        Path | None,
        typer.Option(help="Write the plan; where none is found, the best attempt.", metavar="NPZ"),
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Play it in the browser.")] = False,
    deg: bool = False,
    as_json: AsJson = False,
) -> int:
    """Plan a motion of the arm that leads the tip to a goal; Ctrl-C keeps the best attempt."""
    check_picture(output)
    if save:
        check_suffix(save)
    q = joint_values(arm, q0.split(), deg)
    target = goals(arm, goal, deg)
    way = [goal_from(arm, "--via", text, deg) for text in via or []]
    around = [obstacle_of(text, deg) for text in obstacle or []]
    try:
        with working(f"planning, at most {timeout:g} s") as tell:
            start = arm.at(
                q,
                base=spacecraft_pose(attitude, deg),
                wheels=None if wheels0 is None else numbers("--wheels0", wheels0),
                momentum=momentum,
            )
            asked: dict[str, Any] = {
                "final_attitude": final_attitude and spacecraft_pose(final_attitude, deg),
                "duration": duration,
                "origin": origin.value,
                "constraints": Constraints(
                    limits=not no_limits,
                    collisions=not no_collisions,
                    obstacles=around,
                    clearance=_angle(clearance, deg),
                    keep_attitude=_angle(keep_attitude, deg),
                    wheels=wheel_limits and _limits(*wheel_limits),
                ),
                "search": Search(seed=seed, timeout=timeout, method=method, progress=tell),
            }
            if detumble and (way or mode is Spacecraft.CONTROLLED):
                raise ConfigurationError(
                    "--detumble leads to one goal, and the spacecraft turns; leave out --via and "
                    "--mode"
                )
            if detumble:
                found = find_detumbling(start, target, **asked)
            else:
                found = plan(start, target, via=way, mode=mode.value, **asked)
        if fastest:
            from spacearm.planning.retiming import time_optimal

            wheels = wheel_limits and mode is Spacecraft.CONTROLLED and _limits(*wheel_limits)
            found = time_optimal(found, wheels=wheels or None)
    except (NoSolutionError, StoppedError) as error:
        if save and isinstance(error.best, Plan):
            error.best.save(save)
            err.print(f"spacearm: wrote {save}: the best attempt, which does not arrive")
        if isinstance(error, NoSolutionError):
            raise
        err.print(f"spacearm: stopped: {in_own_words(str(error))}")
        return INTERRUPTED
    if save:
        found.save(save)
    print_result(found, deg=deg, as_json=as_json)
    if save and not as_json:
        out.print(f"wrote {save}")
    if output or not (as_json or view):
        from spacearm.plots.motions import draw_motion  # imports matplotlib

        where = picture_path(output, arm.name, "plan")
        mark = None if isinstance(target, dict) else mark_of(found[-1], target)
        write_picture(where, draw_motion(found, mark, _shells(arm)))
        if not as_json:
            out.print(f"wrote {where}")
    if view:
        from spacearm.cli.views import serve_until_interrupted
        from spacearm.viewer.show import view as show

        serve_until_interrupted(show(found, open=False))
    return 0


def _angle(value: float | None, deg: bool) -> float | None:
    """Return an angle in radians."""
    return float(np.radians(value)) if value and deg else value


def _limits(torque: float, capacity: float) -> WheelHold:
    """Return wheels with these limits; their gains do not matter to a plan."""
    return WheelHold(stiffness=0.0, damping=0.0, torque=torque, capacity=capacity)


def _shells(arm: SpaceArm) -> Workspace | None:
    """Compute the workspace of a planar arm, if it has shells."""
    if arm.tree.plane_normal() is None:
        return None
    try:
        return workspace(arm)
    except UnsupportedError:
        return None
