"""`spacearm simulate`, `watch`: motions under a controller, and joint states from elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pinocchio as pin
import typer

import spacearm as sa
from spacearm.cli import options as opt
from spacearm.cli.output import Answer, out, print_json, save_phases, say_stopped, working
from spacearm.cli.questions import With, controller_of, question
from spacearm.cli.wording import INTERRUPTED
from spacearm.motion.controllers import LAWS, Controller, TipLaw
from spacearm.servo.servo import LONGEST, SLOW, STOP
from spacearm.servo.watching import recorded
from spacearm.sweeps.motion_tables import read_integration, read_phases, read_plant, read_sampling
from spacearm.sweeps.toml import Table

KNOWN_LAWS = ", ".join((*LAWS, "Tracking (with --motion)"))
#: Arguments of `simulate` that are taken from a table as they are.
PLAIN = ("mode", "origin", "stop", "dq")
OBJECTS = ("start", "controller", "duration", "plant", "sampling", "integration")


@opt.answering("simulation", "save", "view")
def simulate_motion(
    arm: sa.SpaceArm,
    q: opt.JointValues = None,
    target: Annotated[
        str | None,
        typer.Option(
            metavar="X1 X2 ...",
            help="Task components of the tip [m], rotations as roll pitch yaw; joint values "
            "for JointPD.",
        ),
    ] = None,
    controller: Annotated[
        str | None,
        typer.Option(
            metavar="LAW",
            help=f"Control law: {KNOWN_LAWS}. Give its gains by --with controller.kp=... .",
        ),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(help="Duration [s]. Default: 60, or that of --motion."),
    ] = None,
    motion: Annotated[
        Path | None,
        typer.Option(
            metavar="NPZ",
            help="Motion to track with the law Tracking (computed torque), written by --save of "
            "plan, follow or simulate. Other laws take its last posture as their target. The "
            "simulation starts where it does.",
        ),
    ] = None,
    attitude: opt.Attitude = None,
    mode: opt.MaybeMode = None,
    more: With = None,
    save: opt.Save = None,
    deg: bool = False,
) -> Answer:
    """Simulate an arm under a control law."""
    tracked = None if motion is None else sa.Motion.load(motion, arm)
    if tracked is not None and mode is None:
        mode = tracked.mode
    asked = question(more, *OBJECTS, *PLAIN, "phases", mode=mode)
    if tracked is None or q or attitude is not None or "start" in asked.values:
        start = opt.configuration(arm, q, attitude, deg, asked.inner("start"))
    else:
        start = tracked[0]
    if "phases" in asked.values:
        given = {
            "--target": target,
            "--controller": controller,
            "--duration": duration,
            "--motion": motion,
            "--mode": mode,
        }
        if both := [option for option, value in given.items() if value is not None]:
            raise sa.ConfigurationError(f"phases and {both[0]} are given; say it in the phases")
        return _fly(start, asked, save)
    law = asked.inner("controller")
    if controller is not None:
        law.values["law"] = controller
    if target is not None and tracked is not None:
        raise sa.ConfigurationError("--target and --motion are given; leave one of them out")
    if target is not None:
        law.values["target"] = _target(arm, law, target, deg)
    plant = read_plant(asked.inner("plant"))
    laws: Controller | dict[str, Controller]
    if tracked is not None and law.values.get("law", "Tracking") == "Tracking":
        laws = tracking = _tracking(tracked, law)
        if plant.wheels is None and tracked.wheel_spline is not None:
            plant = replace(plant, wheels=tracking.wheel_torques)
    else:
        if tracked is not None:
            law.values["target"] = _end_of(tracked, law)
        if not law.values.keys() - {"law"}:
            raise sa.ConfigurationError(
                "there is no target; give --target, --motion, or phases by --with FILE.toml"
            )
        laws = controller_of(arm, law)
    default = 60.0 if tracked is None else float(tracked.t[-1] - tracked.t[0])
    seconds = asked.take("duration", float, default) if duration is None else duration
    options = asked.some(*PLAIN)
    if isinstance(asked.values.get("stop"), str):
        asked.values["stop"] = [asked.values["stop"]]
    options["stop"] = asked.texts("stop")
    with working("simulating") as progress:
        run = sa.simulate(
            start,
            laws,
            seconds,
            plant=plant,
            sampling=read_sampling(asked),
            integration=read_integration(asked.inner("integration"), sa.Integration()),
            progress=progress,
            **options,
        )

    def drawn() -> dict[str, Any]:
        return {"target": opt.mark_of(run[-1], laws.goal(0.0))} if isinstance(laws, TipLaw) else {}

    code = _ended(run, f"{run.t[-1]:.4g} of {seconds:g} s simulated")
    return Answer(run, code, drawn)


def _fly(start: sa.Configuration, asked: Table, save: Path | None) -> Answer:
    """Simulate the phases of a flight; files get the number of their phase."""
    phases = read_phases(asked, start.arm)
    with working("simulating") as progress:
        flight = sa.simulate_phases(start, phases, dq=asked.values.get("dq"), progress=progress)
    code = _ended(flight, f"{len(flight.phases)} of {len(phases)} phases simulated")
    return Answer(flight, code, written=save_phases(flight, save))


def _tracking(motion: sa.Motion, law: Table) -> sa.Tracking:
    """Return the law that tracks a motion, with the parameters of a table."""
    law.knows("law", "rate")
    options = {"rate": law.take("rate", float)} if "rate" in law.values else {}
    return sa.Tracking(motion, **options)


def _end_of(motion: sa.Motion, law: Table) -> list[float]:
    """Return the end of a motion as a law takes its target: joint positions, or task components."""
    arm = motion.arm
    if law.values.get("law") == "JointPD":
        return motion.q[-1].tolist()
    rows: list[float] = []
    for tip in motion[-1].tips:
        pose = np.concatenate((tip.translation, pin.rpy.matrixToRpy(tip.rotation)))
        rows.extend(pose[list(arm.task.indices[: len(arm.task.rows)])].tolist())
    return rows


def _target(arm: sa.SpaceArm, law: Table, text: str, deg: bool) -> list[float]:
    """Return the numbers of --target in SI units: joint positions, or the task's rows."""
    if law.values.get("law") == "JointPD":
        values = opt.joint_values(arm, text.split(), deg)
    else:
        values = opt.task_rows(arm, "--target", text, deg)
    return [float(value) for value in values]


def _ended(run: sa.Trajectory | sa.Flight, done: str) -> int:
    """Return the exit code of a run, or of a flight."""
    if run.ended == "interrupted":
        say_stopped(done)
        return INTERRUPTED
    return 0


#: Topic that is read of an .mcap file.
TOPIC = "/joint_states"
#: Exit code where a state was nearer than --stop, or made no sense.
TOO_NEAR = 3
#: The distances of --stop and --slow where they are not given [deg].
STOP_AT, SLOW_FROM = np.degrees((STOP, SLOW))


@opt.on_a_model
def watch_states(
    arm: sa.SpaceArm,
    file: Annotated[
        str,
        typer.Argument(
            metavar="[FILE]",
            help="Joint states: lines of JSON with t and q, or with name and position, or an "
            ".mcap file; - is the standard input.",
        ),
    ] = "-",
    mode: opt.Mode = "free-floating",
    stop: Annotated[
        float | None,
        typer.Option(
            help="Distance to the singular set below which a state is too near [rad], with "
            f"--deg in degrees. Default: {STOP_AT:g}°."
        ),
    ] = None,
    slow: Annotated[
        float | None,
        typer.Option(help=f"Distance beyond which there is no warning. Default: {SLOW_FROM:g}°."),
    ] = None,
    ahead: Annotated[
        float, typer.Option(help="How long before the singular posture to warn [s].")
    ] = 5.0,
    topic: Annotated[
        str | None, typer.Option(help=f"Topic of an .mcap file. Default: {TOPIC}.")
    ] = None,
    deg: bool = False,
    as_json: opt.AsJson = False,
) -> int:
    """Warn when joint states come near a singular posture."""
    if Path(file).suffix.lower() != ".mcap":
        opt.refuse_unused({"--topic": topic}, "with an .mcap file")
    near, far = opt.radians(stop, deg, STOP), opt.radians(slow, deg, SLOW)
    servo = sa.Servo(arm, mode=mode, stop=near, slow=far)
    messages: Iterable[Any] = sys.stdin if file == "-" else recorded(Path(file), topic or TOPIC)
    level, worst, count, late = "", 0, 0, 0
    for state in servo.watch(messages, ahead=ahead):
        count += 1
        if state.level in ("stop", "fault"):
            worst = TOO_NEAR
        if as_json:
            print_json(state.to_dict(), indent=None)
        elif state.level != level or (state.pause and not late):
            out.print(f"{state.t:10.3f} s  {state.verdict}", soft_wrap=True)
        level, late = state.level, late + (state.pause > 0.0)
    if not as_json:
        out.print(f"{count} joint states watched")
        if late:
            out.print(f"{late} came more than {LONGEST:g} s after the one before: searched anew")
    return worst
