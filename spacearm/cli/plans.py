"""`spacearm plan`: a joint motion to a goal, and the methods that were tried."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import pinocchio as pin
import typer

from spacearm.cli.options import (
    AsJson,
    Attitude,
    Picture,
    goal_from,
    joint_values,
    mark_of,
    on_a_model,
    spacecraft_about_cm,
    spacecraft_pose,
)
from spacearm.cli.output import (
    check_picture,
    out,
    picture_path,
    print_json,
    table,
    vector,
    write_picture,
)
from spacearm.errors import UnsupportedError
from spacearm.model.arm import SpaceArm
from spacearm.motion.motion_file import check_suffix
from spacearm.planning.planner import plan
from spacearm.planning.result import Plan
from spacearm.singularities.report import angle
from spacearm.workspaces.path_dependent import Workspace, workspace


@on_a_model
def plan_motion(
    arm: SpaceArm,
    q0: Annotated[
        str, typer.Option("--q0", help="Joint values at the start.", metavar="Q1 Q2 ...")
    ],
    goal: Annotated[
        str,
        typer.Option(
            help="Task rows of the tip, from the system CM [m], turns as roll pitch yaw.",
            metavar="X1 X2 ...",
        ),
    ],
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
        typer.Option(help="auto, straight, joint space, cycles or attitude first; auto tries all."),
    ] = "auto",
    no_limits: Annotated[bool, typer.Option("--no-limits", help="Ignore joint limits.")] = False,
    no_collisions: Annotated[
        bool, typer.Option("--no-collisions", help="Ignore collisions.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Seed of the first guesses.")] = 0,
    timeout: Annotated[float, typer.Option(help="Give up after this time [s].")] = 60.0,
    output: Picture = None,
    save: Annotated[Path | None, typer.Option(help="Write the plan.", metavar="NPZ")] = None,
    view: Annotated[bool, typer.Option("--view", help="Play it in the browser.")] = False,
    deg: bool = False,
    as_json: AsJson = False,
) -> None:
    """Plan a motion of the arm that leads the tip to a goal; the system CM is the origin."""
    check_picture(output)
    if save:
        check_suffix(save)
    start = joint_values(arm, q0.split(), deg)
    target = goal_from(arm, "--goal", goal, deg)
    found = plan(
        arm, start, target, base=spacecraft_about_cm(arm, start, attitude, deg),
        clearance=float(np.radians(clearance)) if clearance and deg else clearance,
        final_attitude=None if final_attitude is None else spacecraft_pose(final_attitude, deg),
        limits=not no_limits, collisions=not no_collisions, method=method, seed=seed,
        timeout=timeout,
    )  # fmt: skip
    if save:
        found.save(save)
    if as_json:
        print_json(found.to_dict())
    else:
        _print(found, deg)
        if save:
            out.print(f"wrote {save}")
    if output or not (as_json or view):
        from spacearm.plots.motions import draw_motion  # imports matplotlib

        where = picture_path(output, arm.name, "plan")
        write_picture(where, draw_motion(found, mark_of(found[-1], target), _shells(arm)))
        if not as_json:
            out.print(f"wrote {where}")
    if view:
        from spacearm.cli.views import serve_until_interrupted
        from spacearm.viewer.show import view as show

        serve_until_interrupted(show(found, open=False))


def _shells(arm: SpaceArm) -> Workspace | None:
    """Compute the workspace of a planar arm, if it has shells."""
    if arm.tree.plane_normal() is None:
        return None
    try:
        return workspace(arm)
    except UnsupportedError:
        return None


def _print(found: Plan, deg: bool) -> None:
    out.print(f"{found.arm.name}: planned by {found.method}; {found.checked}")
    rows = table("method", "", "")
    for method, arrived, story in found.tried:
        rows.add_row(method, "arrives" if arrived else "fails", story)
    out.print(rows)
    end = found[-1]
    out.print(f"tip at the end      {vector(end.tip.translation)} m")
    turn = pin.log3(end.base.rotation)
    what = np.degrees(turn) if deg else turn
    out.print(f"attitude            {vector(what)} {'deg' if deg else 'rad'}, rotation vector")
    out.print(f"time                {found.t[-1]:.4g} s within the velocity limits")
    out.print(f"clear by            {found.nearest}; asked for {angle(found.clearance)}")
    if found.certificate is not None:
        out.print(f"no singularity is met: {'proven' if found.certificate else 'NOT proven'}")
    if found.apart:
        out.print("no bodies meet: proven")
