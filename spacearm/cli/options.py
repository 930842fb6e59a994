"""Options that the commands share, and the arm that they describe."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import pinocchio as pin
import typer

from spacearm.arrays import Array
from spacearm.cli.mounting import (
    Arguments,
    BusMass,
    BusSize,
    Density,
    PackageFolders,
    described_arm,
    described_bus,
    joints_of,
)
from spacearm.description.bodies import Joint
from spacearm.description.model_catalogue import arms, catalogue
from spacearm.errors import ConfigurationError, listed
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.frames import pose
from spacearm.model.joints import warn_outside
from spacearm.model.task import Task
from spacearm.motion.goal import Goal, goal_of, goal_pose

T = TypeVar("T")


def complete_model(incomplete: str) -> list[tuple[str, str]]:
    """Return the catalogue's names that begin so, with what they are, for the shell's completion.

    Arms without a spacecraft are among them: --bus-mass mounts them.
    """
    known = [(info.name, info.summary) for info in catalogue()]
    known += [(info.name, info.summary) for info in arms()]
    return [(name, summary) for name, summary in known if name.startswith(incomplete)]


ModelName = Annotated[
    str,
    typer.Argument(
        metavar="MODEL",
        help="Catalogue name (spacearm models) or robot file.",
        autocompletion=complete_model,
    ),
]
Tip = Annotated[
    str | None, typer.Option(help="Link whose frame is the tip, or several.", metavar="LINK,LINK")
]
TaskRows = Annotated[
    str | None,
    typer.Option("--task", help='Rows: "x y rz", pose, position, orientation.', metavar="ROWS"),
]
Length = Annotated[
    float | None,
    typer.Option(help="Length [m] that the linear rows of a mixed task are divided by."),
]
Joints = Annotated[
    str,
    typer.Option(
        help="Joints that count besides those on the way to the tip; the others are held.",
        metavar="tip|all|NAME,NAME",
    ),
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
Degrees = Annotated[
    bool, typer.Option("--deg", help="Angles are in degrees, given and printed (not --json).")
]
Attitude = Annotated[
    tuple[float, float, float],
    typer.Option(help="Spacecraft roll, pitch, yaw.", metavar="R P Y"),
]


class Spacecraft(str, Enum):
    """Modes of the spacecraft."""

    FREE = "free-floating"
    CONTROLLED = "attitude-controlled"
    FIXED = "fixed"


class From(str, Enum):
    """Where points are given from; see `motion.goal.started`."""

    SPACECRAFT = "spacecraft"
    CM = "cm"

    @property
    def words(self) -> str:
        """In words, for help and answers."""
        return "the system CM" if self is From.CM else "the spacecraft's frame"


PointsFrom = Annotated[
    From,
    typer.Option(
        "--origin",
        help="Where points are given from: the spacecraft's frame or the system CM, at the start.",
    ),
]
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
    joints: Joints = "tip",
    lock: Lock = None,
    check: Checked = None,
    bus_mass: BusMass = None,
    bus_size: BusSize = None,
    arg: Arguments = None,
    package: PackageFolders = None,
    density: Density = None,
    deg: Degrees = False,
) -> SpaceArm:
    """Load the arm that the shared options describe; this signature states them once."""
    bus, locked = described_bus(bus_mass, bus_size), assignments("--lock", lock)
    options = {
        "check": check,
        "packages": package or (),
        "xacro_args": _arguments(arg),
        "density": density,
    }
    if deg and locked:
        known = joints_of(model, bus, options).joints
        locked = {name: _si(known.get(name), value, deg) for name, value in locked.items()}
    counting = joints if joints in ("tip", "all") else joints.split(",")
    tips = tip.split(",") if tip and "," in tip else tip
    arm = described_arm(model, bus, tip=tips, joints=counting, locked=locked, options=options)
    if task is None and length is None:
        return arm
    return arm.replace(task=Task(arm.task.names if task is None else task, length))


def _arguments(texts: list[str] | None) -> dict[str, str]:
    """Parse NAME:=VALUE, as often as given."""
    pairs = [text.partition(":=") for text in texts or []]
    for name, sign, _ in pairs:
        if not name or not sign:
            raise ConfigurationError(f"--arg {name!r}: give NAME:=VALUE")
    return {name: value for name, _, value in pairs}


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
    return pose(rpy=rpy)


def start_of(
    arm: SpaceArm,
    q: Array,
    base: pin.SE3,
    wheels: Array | None = None,
    momentum: Sequence[float] | None = None,
) -> Configuration:
    """Return the start of a motion.

    Warns:
        ModelWarning: Joints are outside their limits, or look like degrees.
    """
    warn_outside(arm, q, "--q0")
    return arm.at(q, base=base, wheels=wheels, momentum=momentum)


def goal_from(arm: SpaceArm, option: str, text: str, deg: bool) -> Array | pin.SE3:
    """Parse the task's rows: a point, or a pose whose turns are roll, pitch and yaw."""
    values = numbers(option, text)
    turns = np.array(arm.task.indices) > 2
    if deg and len(values) == len(turns):
        values[turns] = np.radians(values[turns])
    return goal_of(arm, values, option)


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


def _si(joint: Joint | None, value: float, deg: bool) -> float:
    """Return the value in radians, or in metres for prismatic joints."""
    return float(np.radians(value)) if deg and joint and joint.kind != "prismatic" else value


def _number(word: str | float) -> float:
    try:
        return float(word)
    except ValueError:
        kind = "option" if str(word).startswith("--") else "number"
        raise ConfigurationError(f"{word!r} is no {kind} of this command; see --help") from None
