"""`spacearm simulate`: the motion of an arm under a controller."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spacearm.cli.motions.flights import fly
from spacearm.cli.motions.laws import Law, gain_of, law_of
from spacearm.cli.options import (
    AsJson,
    Attitude,
    From,
    Picture,
    PointsFrom,
    Spacecraft,
    SpacecraftMode,
    joint_values,
    mark_of,
    numbers,
    on_a_model,
    spacecraft_pose,
    start_of,
)
from spacearm.cli.output import (
    check_picture,
    out,
    picture_path,
    print_result,
    say_stopped,
    working,
)
from spacearm.cli.output import write_picture as write
from spacearm.cli.wording import INTERRUPTED
from spacearm.errors import ConfigurationError
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.motion.events import EVENTS
from spacearm.motion.motion_file import check_suffix
from spacearm.motion.plant import Integration, PassiveJoint, Plant, WheelHold
from spacearm.motion.simulation import simulate
from spacearm.sweeps.motion_tables import read_phases

MOST = 10
"""Number of events that are printed."""

HOLD = ("stiffness", "damping", "torque", "capacity")
"""What `--hold` gives, in this order."""


@on_a_model
def simulate_motion(
    arm: SpaceArm,
    q0: Annotated[
        str, typer.Option("--q0", help="Joint values at the start.", metavar="Q1 Q2 ...")
    ],
    target: Annotated[
        str | None,
        typer.Option(
            help="Task rows of the tip [m], turns as roll pitch yaw, see --origin; joint values "
            "for joints.",
            metavar="X1 X2 ...",
        ),
    ] = None,
    phases: Annotated[
        Path | None,
        typer.Option(help="Phases with grasps and releases, in place of --target.", metavar="TOML"),
    ] = None,
    dq0: Annotated[
        str | None, typer.Option("--dq0", help="Joint rates at the start.", metavar="R1 R2 ...")
    ] = None,
    wheels0: Annotated[
        str | None,
        typer.Option("--wheels0", help="What the wheels hold at the start.", metavar="H1 ..."),
    ] = None,
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
    origin: PointsFrom = From.SPACECRAFT,
    attitude: Attitude = (0.0, 0.0, 0.0),
    stop: Annotated[
        list[str] | None,
        typer.Option(help="End at this event; may be repeated.", metavar="EVENT"),
    ] = None,
    event: Annotated[
        list[str] | None,
        typer.Option(help="Note this event only; may be repeated.", metavar="EVENT"),
    ] = None,
    reach: Annotated[float, typer.Option(help="Error at which the target is reached.")] = 1e-3,
    dt: Annotated[float | None, typer.Option("--dt", help="Spacing of the output [s].")] = None,
    rtol: Annotated[float, typer.Option(help="Relative tolerance of a step.")] = 1e-8,
    atol: Annotated[float, typer.Option(help="Absolute tolerance of a step.")] = 1e-10,
    method: Annotated[str, typer.Option(help="auto, DOP853 or Rodas5P.")] = "auto",
    momentum: Annotated[
        tuple[float, float, float, float, float, float],
        typer.Option(help="Momentum at the start, linear and angular about the CM.", metavar="H"),
    ] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    limits: Annotated[
        bool,
        typer.Option("--limits", help="Let effort and velocity limits cut the torques."),
    ] = False,
    passive: Annotated[
        list[str] | None,
        typer.Option(
            help="A spring with damping and dry friction at a joint; may be repeated.",
            metavar="JOINT=STIFFNESS,REST,DAMPING,FRICTION",
        ),
    ] = None,
    described: Annotated[
        bool,
        typer.Option("--described-friction", help="Damping and dry friction as in the file."),
    ] = False,
    wrench: Annotated[
        list[str] | None,
        typer.Option(
            help="A constant wrench on a link, inertial axes; may be repeated.",
            metavar="LINK=FX,FY,FZ,MX,MY,MZ",
        ),
    ] = None,
    thruster: Annotated[
        list[str] | None,
        typer.Option(help="The same along the axes of the link.", metavar="LINK=..."),
    ] = None,
    hold: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(
            help="Wheels hold the attitude: stiffness, damping, largest torque and momentum.",
            metavar="K C T H",
        ),
    ] = None,
    period: Annotated[
        float | None, typer.Option(help="Period of a controller of fixed rate [s].")
    ] = None,
    delay: Annotated[float, typer.Option(help="Delay of its torques [s].")] = 0.0,
    output: Picture = None,
    save: Annotated[Path | None, typer.Option(help="Write the trajectory.", metavar="NPZ")] = None,
    view: Annotated[bool, typer.Option("--view", help="Play it in the browser.")] = False,
    deg: bool = False,
    as_json: AsJson = False,
) -> int:
    """Simulate an arm under a controller; draw tip path, attitude, joints and sigma_min.

    Events: singularity, "joint limit", target, "wheel full". Ctrl-C
    ends the run and keeps what there is. A file of phases has tables [[phase]] whose keys are those
    of sa.Phase: controller, duration, then, plant, stop, period, delay, integration.
    """
    check_picture(output)
    if save:
        check_suffix(save)
    if described and passive:
        raise ConfigurationError("--described-friction and --passive are given; give one of them")
    start = start_of(
        arm,
        joint_values(arm, q0.split(), deg),
        spacecraft_pose(attitude, deg),
        None if wheels0 is None else numbers("--wheels0", wheels0),
        momentum,
    )
    believed: BaseMode = "fixed" if earthbound else mode.value
    moving = None if dq0 is None else joint_values(arm, dq0.split(), deg)
    if phases:
        own = {
            "--target": target, "--stop": stop, "--event": event, "--limits": limits, "--dt": dt,
            "--passive": passive, "--described-friction": described, "--wrench": wrench,
            "--thruster": thruster, "--hold": hold, "--period": period, "--wheels0": wheels0,
            "--mode": mode is not Spacecraft.FREE,
        }  # fmt: skip
        if given := [option for option, value in own.items() if value]:
            raise ConfigurationError(f"--phases and {given[0]} are given; say it in the file")
        return fly(start, read_phases(phases, arm), moving, save, output, view, as_json)
    if target is None:
        raise ConfigurationError("neither --target nor --phases is given; give one of them")
    parameters = {"kp": gain_of("--kp", kp), "kd": gain_of("--kd", kd), "gain": gain}
    law, goal = law_of(arm, controller, target, parameters, believed, deg)
    springs = {name: PassiveJoint(*v) for name, v in _vectors("--passive", passive).items()}
    plant = Plant(
        wheels=hold and WheelHold(**dict(zip(HOLD, hold, strict=True))),
        wrenches=_vectors("--wrench", wrench),
        thrusters=_vectors("--thruster", thruster),
        passive="described" if described else springs,
        limits=limits,
    )
    integration = Integration(
        rtol=rtol, atol=atol, dt=dt, events=event or EVENTS, reach=reach, method=method
    )
    with working("simulating") as progress:
        run = simulate(
            start, law, duration, dq=moving, mode=mode.value, origin=origin.value, plant=plant,
            stop=stop or (), period=period, delay=delay, integration=integration,
            progress=progress,
        )  # fmt: skip
    if save:
        run.save(save)
    print_result(run, deg=deg, as_json=as_json)
    if save and not as_json:
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
    if run.ended == "interrupted":
        say_stopped(f"{run.t[-1]:.4g} of {duration:g} s simulated")
        return INTERRUPTED
    return 0


def _vectors(option: str, texts: list[str] | None) -> dict[str, tuple[float, ...]]:
    """Parse NAME=X,Y,..., as often as given."""
    pairs = [text.partition("=") for text in texts or []]
    return {name: tuple(numbers(f"{option} {name}", values)) for name, _, values in pairs}
