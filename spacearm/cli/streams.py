"""`spacearm watch`: streams of joint states, with warnings ahead of time."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from spacearm.cli.options import AsJson, Spacecraft, SpacecraftMode, on_a_model, radians
from spacearm.cli.output import out, print_json
from spacearm.model.arm import SpaceArm
from spacearm.servo.servo import SLOW, STOP, Servo
from spacearm.servo.watching import recorded

TOO_NEAR = 3
"""Exit code where a state was nearer than --stop, or made no sense."""


@on_a_model
def watch_states(
    arm: SpaceArm,
    file: Annotated[
        str,
        typer.Argument(
            metavar="[FILE]",
            help="Joint states: lines of JSON with t and q, or name and position, or an .mcap "
            "file; - is the standard input.",
        ),
    ] = "-",
    mode: SpacecraftMode = Spacecraft.FREE,
    stop: Annotated[
        float | None,
        typer.Option(
            help="Distance to the singular set that is too near [rad], with --deg in degrees; "
            f"{np.degrees(STOP):g}° if not given.",
            show_default=False,
        ),
    ] = None,
    slow: Annotated[
        float | None,
        typer.Option(
            help=f"Distance from which on nothing is said; {np.degrees(SLOW):g}° if not given.",
            show_default=False,
        ),
    ] = None,
    ahead: Annotated[float, typer.Option(help="Time ahead that is warned of [s].")] = 5.0,
    topic: Annotated[str, typer.Option(help="Topic of an .mcap file.")] = "/joint_states",
    deg: bool = False,
    as_json: AsJson = False,
) -> int:
    """Watch a stream of joint states, and warn before it comes near a singular posture."""
    near, far = radians(stop, deg), radians(slow, deg)
    servo = Servo(
        arm, mode=mode.value, stop=STOP if near is None else near, slow=SLOW if far is None else far
    )
    messages: Iterable[Any] = sys.stdin if file == "-" else recorded(Path(file), topic)
    level, worst, count = "", 0, 0
    for state in servo.watch(messages, ahead=ahead):
        count += 1
        if state.level in ("stop", "fault"):
            worst = TOO_NEAR
        if as_json:
            print_json(state.to_dict(), indent=None)
        elif state.level != level:
            out.print(f"{state.t:10.3f} s  {state.verdict}", soft_wrap=True)
        level = state.level
    if not as_json:
        out.print(f"{count} joint states watched")
    return worst
