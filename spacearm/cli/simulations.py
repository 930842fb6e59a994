"""`spacearm simulate`: the motion of an arm under a controller."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import numpy as np
import pinocchio as pin
import typer
from rich.progress import Progress

from spacearm.cli.options import (
    AsJson,
    Attitude,
    Picture,
    Spacecraft,
    SpacecraftMode,
    goal_from,
    joint_values,
    mark_of,
    numbers,
    on_a_model,
    spacecraft_about_cm,
)
from spacearm.cli.output import (
    check_picture,
    err,
    joint_value,
    out,
    picture_path,
    print_json,
    table,
    vector,
)
from spacearm.cli.output import write_picture as write
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.motion.controllers import (
    Controller,
    DampedLeastSquares,
    JointPD,
    Reactionless,
    ResolvedRate,
    TransposedJacobian,
)
from spacearm.motion.goal import Goal
from spacearm.motion.motion_file import check_suffix
from spacearm.motion.simulation import simulate
from spacearm.motion.trajectory import Trajectory


class Law(str, Enum):
    """Names of the controllers."""

    TRANSPOSED = "transposed"
    RESOLVED = "resolved"
    DAMPED = "damped"
    REACTIONLESS = "reactionless"
    JOINTS = "joints"


MOST = 10
"""Number of events that are printed."""


@on_a_model
def simulate_motion(
    arm: SpaceArm,
    q0: Annotated[
        str, typer.Option("--q0", help="Joint values at the start.", metavar="Q1 Q2 ...")
    ],
    target: Annotated[
        str,
        typer.Option(
            help="Task rows of the tip, from the system CM [m], turns as roll pitch yaw; joint "
            "values for joints.",
            metavar="X1 X2 ...",
        ),
    ],
    controller: Annotated[Law, typer.Option(help="Control law.")] = Law.TRANSPOSED,
    duration: Annotated[float, typer.Option(help="Duration [s].")] = 60.0,
    kp: Annotated[
        str,
        typer.Option(
            help="Stiffness (transposed, joints): one number, or one per row.", metavar="K ..."
        ),
    ] = "5",
    kd: Annotated[
        str,
        typer.Option(
            help="Damping (transposed, joints): one number, or one per row.", metavar="K ..."
        ),
    ] = "15",
    gain: Annotated[
        float, typer.Option(help="Gain of resolved, damped, reactionless [1/s].")
    ] = 1.0,
    earthbound: Annotated[
        bool,
        typer.Option(
            "--earthbound", help="Let the control law assume a spacecraft that does not move."
        ),
    ] = False,
    mode: SpacecraftMode = Spacecraft.FREE,
    attitude: Attitude = (0.0, 0.0, 0.0),
    stop: Annotated[
        list[str] | None,
        typer.Option(help="End at this event; may be repeated.", metavar="EVENT"),
    ] = None,
    rtol: Annotated[float, typer.Option(help="Relative tolerance of a step.")] = 1e-8,
    output: Picture = None,
    save: Annotated[Path | None, typer.Option(help="Write the trajectory.", metavar="NPZ")] = None,
    view: Annotated[bool, typer.Option("--view", help="Play it in the browser.")] = False,
    deg: bool = False,
    as_json: AsJson = False,
) -> None:
    """Simulate an arm under a controller; draw tip path, attitude, joints and sigma_min.

    The system CM is the origin. Events: singularity, "joint limit", target.
    """
    check_picture(output)
    if save:
        check_suffix(save)
    start = joint_values(arm, q0.split(), deg)
    believed: BaseMode = "fixed" if earthbound else mode.value
    law, goal = _law(arm, controller, target, kp, kd, gain, believed, deg)
    with Progress(console=err, transient=True, disable=not err.is_terminal) as bar:
        task_id = bar.add_task("simulated", total=duration)
        run = simulate(
            arm, start, law, duration, base=spacecraft_about_cm(arm, start, attitude, deg),
            mode=mode.value, stop=stop or [], rtol=rtol,
            progress=lambda t, _: bar.update(task_id, completed=t),
        )  # fmt: skip
    if save:
        run.save(save)
    if as_json:
        print_json(run.to_dict())
    else:
        _print(run, deg)
        if save:
            out.print(f"wrote {save}")
    if output or not (as_json or view):
        from spacearm.plots.motions import draw_motion

        where = picture_path(output, arm.name, "simulation")
        write(where, draw_motion(run, None if goal is None else mark_of(run[-1], goal)))
        if not as_json:
            out.print(f"wrote {where}")
    if view:
        from spacearm.cli.views import serve_until_interrupted
        from spacearm.viewer.show import view as show

        serve_until_interrupted(show(run, open=False))


def _law(
    arm: SpaceArm,
    law: Law,
    target: str,
    kp: str,
    kd: str,
    gain: float,
    mode: BaseMode,
    deg: bool,
) -> tuple[Controller, Goal | None]:
    """Return the controller, and the goal of the tip if it has one."""
    K_p, K_d = (np.squeeze(numbers(option, text)) for option, text in (("--kp", kp), ("--kd", kd)))
    if law is Law.JOINTS:
        return JointPD(joint_values(arm, target.split(), deg), K_p, K_d), None
    goal = goal_from(arm, "--target", target, deg)
    if law is Law.TRANSPOSED:
        return TransposedJacobian(target=goal, kp=K_p, kd=K_d, mode=mode), goal
    kinds = {
        Law.RESOLVED: ResolvedRate, Law.DAMPED: DampedLeastSquares, Law.REACTIONLESS: Reactionless
    }  # fmt: skip
    return kinds[law](target=goal, gain=gain, mode=mode), goal


def _print(run: Trajectory, deg: bool) -> None:
    out.print(f"{run.arm.name}, {run.mode}: {run.t[-1]:.6g} s, ended by {run.ended}")
    rows = table("event", "time [s]", *run.arm.joint_names, "")
    kinds = [run.arm.tree.joints[name].kind for name in run.arm.joint_names]
    for event in run.events[:MOST]:
        q = (joint_value(x, kind, deg) for x, kind in zip(event.q, kinds, strict=True))
        rows.add_row(event.kind, f"{event.t:.4f}", *q, event.detail)
    if run.events:
        out.print(rows)
    if len(run.events) > MOST:
        out.print(f"and {len(run.events) - MOST} more events")
    end = run[-1]
    out.print(f"tip at the end  {vector(end.tip.translation)} m, sigma_min {run.sigma_min[-1]:.4g}")
    turn = pin.log3(end.base.rotation)
    what = np.degrees(turn) if deg else turn
    out.print(f"attitude        {vector(what)} {'deg' if deg else 'rad'}, rotation vector")
    out.print(f"balance         energy {run.imbalance:.1e}, momentum {run.drift:.1e}")
