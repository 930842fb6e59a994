"""What the commands have in common: their options, and the arm that the options name."""

from __future__ import annotations

from typing import Annotated, cast

import numpy as np
import typer

from spacearm.arm import SpaceArm, load
from spacearm.arrays import Array
from spacearm.errors import ConfigurationError
from spacearm.task import Task
from spacearm.urdf import Check

ModelName = Annotated[
    str, typer.Argument(metavar="MODEL", help="Catalogue name (spacearm models) or URDF file.")
]
Tip = Annotated[str | None, typer.Option(help="Link whose frame is the tip.", metavar="LINK")]
TaskRows = Annotated[
    str | None,
    typer.Option("--task", help='Rows: "x y rz", pose, position, orientation.', metavar="ROWS"),
]
Length = Annotated[
    float | None, typer.Option(help="Length [m] that divides the linear rows of a mixed task.")
]
Lock = Annotated[
    list[str] | None,
    typer.Option(help="Freeze a joint; may be repeated.", metavar="JOINT=VALUE"),
]
Checked = Annotated[
    str | None,
    typer.Option(
        "--check", help="What to do with impossible inertias.", metavar="error|warn|accept"
    ),
]
Degrees = Annotated[bool, typer.Option("--deg", help="Angles are in degrees.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON: SI units, radians.")]


def arm_from(
    model: str,
    tip: str | None,
    task: str | None,
    length: float | None,
    lock: list[str] | None,
    check: str | None,
    deg: bool,
) -> SpaceArm:
    """The arm that the shared options describe."""
    checked = cast("Check | None", check)
    arm = load(model, tip=tip, task=task, check=checked)
    if lock:
        locked = {name: _si(arm, name, value, deg) for name, value in map(_locked, lock)}
        arm = load(model, tip=tip, task=task, locked=locked, check=checked)
    if length is not None:
        arm = arm.replace(task=Task(arm.task.names, length))
    return arm


def joint_values(arm: SpaceArm, words: list[str], deg: bool) -> Array:
    """Joint values from the command line, in radians and metres."""
    values = [_number(word) for word in words]
    if len(values) != arm.n:
        raise ConfigurationError(
            f"{len(values)} joint values given; {arm.name} needs {arm.n}: "
            f"{', '.join(arm.joint_names)}"
        )
    return np.array([_si(arm, *pair, deg) for pair in zip(arm.joint_names, values, strict=True)])


def _si(arm: SpaceArm, joint: str, value: float, deg: bool) -> float:
    """The value in radians, or in metres for joints that slide; unknown joints pass."""
    known = arm.tree.joints.get(joint)
    return float(np.radians(value)) if deg and known and known.kind != "prismatic" else value


def _locked(text: str) -> tuple[str, float]:
    name, separator, value = text.rpartition("=")
    if not separator:
        raise ConfigurationError(f"--lock {text!r}: give JOINT=VALUE")
    return name, _number(value)


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        kind = "option" if word.startswith("--") else "number"
        raise ConfigurationError(f"{word!r} is no {kind} of this command; see --help") from None
