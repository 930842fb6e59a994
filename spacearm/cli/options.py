"""Options that the commands share, and the arm that they describe."""

from __future__ import annotations

import inspect
import re
import warnings
from collections.abc import Callable, Sequence
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast

import numpy as np
import pinocchio as pin
import typer

from spacearm.arrays import Array
from spacearm.description.assembly import assembled
from spacearm.description.bodies import Joint
from spacearm.description.model_catalogue import find_model
from spacearm.description.readers.urdf import Check
from spacearm.description.readers.urdf import read as read_urdf
from spacearm.errors import ConfigurationError, listed
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.model.loading import load
from spacearm.model.task import Task
from spacearm.motion.goal import Goal, goal_pose

T = TypeVar("T")
ModelName = Annotated[
    str, typer.Argument(metavar="MODEL", help="Catalogue name (spacearm models) or URDF file.")
]
Tip = Annotated[str | None, typer.Option(help="Link whose frame is the tip.", metavar="LINK")]
TaskRows = Annotated[
    str | None,
    typer.Option("--task", help='Rows: "x y rz", pose, position, orientation.', metavar="ROWS"),
]
Length = Annotated[
    float | None,
    typer.Option(help="Length [m] that the linear rows of a mixed task are divided by."),
]
Lock = Annotated[
    list[str] | None,
    typer.Option(help="Lock a joint; may be repeated.", metavar="JOINT=VALUE"),
]
Checked = Annotated[
    str | None,
    typer.Option(
        "--check",
        help="What to do with physically impossible inertias.",
        metavar="error|warn|accept",
    ),
]
Degrees = Annotated[bool, typer.Option("--deg", help="Angles are in degrees.")]
Attitude = Annotated[
    tuple[float, float, float],
    typer.Option(help="Spacecraft roll, pitch, yaw.", metavar="R P Y"),
]


class Spacecraft(str, Enum):
    """Modes of the spacecraft."""

    FREE = "free-floating"
    CONTROLLED = "attitude-controlled"
    FIXED = "fixed"


SpacecraftMode = Annotated[Spacecraft, typer.Option("--mode", help="What the spacecraft does.")]
Picture = Annotated[
    Path | None, typer.Option("--output", help="Picture: PNG, SVG or PDF by its suffix.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON: SI units, radians.")]


def arm_from(
    model: ModelName,
    tip: Tip = None,
    task: TaskRows = None,
    length: Length = None,
    lock: Lock = None,
    check: Checked = None,
    deg: Degrees = False,
) -> SpaceArm:
    """Load the arm that the shared options describe; this signature states them once."""
    locked = assignments("--lock", lock)
    if deg and locked:
        info = find_model(model)
        with warnings.catch_warnings():  # they come when the arm is loaded
            warnings.simplefilter("ignore")
            joints = (assembled(info) if info else read_urdf(model, "accept")).joints
        locked = {name: _si(joints.get(name), value, deg) for name, value in locked.items()}
    wanted = None if task is None else Task(task, length)
    arm = load(model, tip=tip, task=wanted, locked=locked, check=cast("Check | None", check))
    return arm if wanted or length is None else arm.replace(task=Task(arm.task.names, length))


def on_a_model(command: Callable[..., T]) -> Callable[..., T]:
    """Give a command the argument MODEL and the options of `arm_from` in place of `arm`.

    MODEL comes first and the options last, before --json. A command with a parameter `deg` is told
    whether angles are in degrees.
    """
    own = dict(inspect.signature(command, eval_str=True).parameters)
    shared = dict(inspect.signature(arm_from, eval_str=True).parameters)
    told_deg = own.pop("deg", None) is not None
    last = {name: own.pop(name) for name in ("as_json",) if name in own}
    del own["arm"]
    first = {"model": shared["model"]}
    parameters = first | own | shared | last

    def run(**given: Any) -> T:
        deg = {"deg": given["deg"]} if told_deg else {}
        arm = arm_from(**{name: given.pop(name) for name in shared})
        return command(arm=arm, **given, **deg)

    run.__doc__, run.__module__, run.__name__ = command.__doc__, __name__, command.__name__
    run.__annotations__ = {name: p.annotation for name, p in parameters.items()}
    keyword = inspect.Parameter.KEYWORD_ONLY
    signature = inspect.Signature([p.replace(kind=keyword) for p in parameters.values()])
    run.__dict__["__signature__"] = signature
    return run


def assignments(option: str, texts: list[str] | None) -> dict[str, float]:
    """Parse JOINT=VALUE, as often as given."""
    pairs = [text.rpartition("=") for text in texts or []]
    for (name, _, _), text in zip(pairs, texts or [], strict=True):
        if not name:
            raise ConfigurationError(f"{option} {text!r}: give JOINT=VALUE")
    return {name: _number(value) for name, _, value in pairs}


def joint_values(arm: SpaceArm, words: Sequence[str | float], deg: bool) -> Array:
    """Parse joint values; return them in radians and metres."""
    values = [_number(word) for word in words]
    if len(values) != arm.n:
        raise ConfigurationError(
            f"{len(values)} joint values given; {arm.name} needs {arm.n}: {listed(arm.joint_names)}"
        )
    joints = [arm.tree.joints[name] for name in arm.joint_names]
    return np.array([_si(joint, q, deg) for joint, q in zip(joints, values, strict=True)])


def spacecraft_pose(attitude: tuple[float, float, float], deg: bool) -> pin.SE3:
    """Return the pose at the origin with this roll, pitch and yaw."""
    rpy = np.radians(attitude) if deg else np.array(attitude)
    if not np.isfinite(rpy).all():
        raise ConfigurationError(f"--attitude is {attitude}; give three finite angles")
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), np.zeros(3))


def spacecraft_about_cm(
    arm: SpaceArm, q: Array, attitude: tuple[float, float, float], deg: bool
) -> pin.SE3:
    """Return the spacecraft pose with this attitude and the system CM at the origin."""
    return arm.at(q, base=spacecraft_pose(attitude, deg)).centred(np.zeros(3)).base


def goal_from(arm: SpaceArm, option: str, text: str, deg: bool) -> Array | pin.SE3:
    """Parse the task's rows: a point, or a pose whose turns are roll, pitch and yaw."""
    values, rows = numbers(option, text), arm.task.indices
    if len(values) != len(rows):
        raise ConfigurationError(
            f"{option} has {len(values)} numbers; the task of {arm.name} takes {len(rows)}: "
            f"{' '.join(arm.task.rows)}"
        )
    if max(rows) < 3:
        return values
    full = np.zeros(6)
    full[rows] = values
    rpy = np.radians(full[3:]) if deg else full[3:]
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), full[:3])


def mark_of(end: Configuration, goal: Goal) -> Array | None:
    """Return the (3,) goal point to mark, or None if the task has no linear rows.

    Rows that the task leaves open are those of the tip at the end.
    """
    rows = [i for i in end.arm.task.indices if i < 3]
    mark = end.tip.translation
    mark[rows] = goal_pose(end, goal).translation[rows]
    return mark if rows else None


def numbers(option: str, text: str) -> Array:
    """Parse finite numbers with spaces or commas between them."""
    values = [_number(word) for word in text.replace(",", " ").split()]
    if not values or not np.isfinite(values).all():
        raise ConfigurationError(f"{option} is {text!r}; give finite numbers")
    return np.array(values)


def join_numbers(words: Sequence[str]) -> list[str]:
    """Join the numbers after each option of `VECTORS` to one word."""
    joined: list[str] = []
    vector = False
    for word in words:
        if vector and NUMBER.fullmatch(word):
            if joined[-1] in VECTORS:
                joined.append(word)
            else:
                joined[-1] += f" {word}"
        else:
            joined.append(word)
            vector = word in VECTORS
    return joined


VECTORS = ("--q0", "--target", "--goal", "--kp", "--kd")
"""Options that take as many numbers as the arm needs."""
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def _si(joint: Joint | None, value: float, deg: bool) -> float:
    """Return the value in radians, or in metres for prismatic joints."""
    return float(np.radians(value)) if deg and joint and joint.kind != "prismatic" else value


def _number(word: str | float) -> float:
    try:
        return float(word)
    except ValueError:
        kind = "option" if str(word).startswith("--") else "number"
        raise ConfigurationError(f"{word!r} is no {kind} of this command; see --help") from None
