"""Options that the commands share, and the arm that they describe."""

from __future__ import annotations

import inspect
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar

import numpy as np
import pinocchio as pin
import typer

import spacearm as sa
from spacearm.arrays import LARGEST, Array, finite
from spacearm.cli.output import Answer, answer
from spacearm.cli.wording import NUMBER
from spacearm.description.bodies import Joint
from spacearm.description.model_catalogue import assembled, find_arm, find_model, models_by_name
from spacearm.description.readers import formats
from spacearm.description.readers.source import Reading
from spacearm.description.tree import Tree, Wheels
from spacearm.errors import listed, require_known, warn
from spacearm.files import decoded, read, writable
from spacearm.model.arguments import BaseMode
from spacearm.model.joints import joint_vector, warn_outside
from spacearm.motion.goal import Goal, goal_of, goal_pose
from spacearm.motion.motion_file import check_suffix
from spacearm.sweeps.toml import Table, parse, text_of

T = TypeVar("T")
U = TypeVar("U", float, None)
Three: TypeAlias = tuple[float, float, float]

#: What stands for the home positions of the joints in place of their values.
HOME = "home"
#: Density [kg/m^3] of a bus whose size is not given: that of small spacecraft.
BUS_DENSITY = 200.0


def complete_model(incomplete: str) -> list[tuple[str, str]]:
    """Return the catalogue's names that begin so, with what they are, for the shell's completion.

    Arms without a spacecraft are among them: --bus mounts them.
    """
    known = [(info.name, info.summary) for info in sa.catalogue()]
    known += [(info.name, info.summary) for info in sa.arms()]
    return [(name, summary) for name, summary in known if name.startswith(incomplete)]


JointValues = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="Q1 Q2 ...",
        help="Joint values [rad], with --deg in degrees; of sliding joints [m]. Or home, the home "
        "positions of the joints. Or a TOML file with a table [start], as hold --save writes it.",
    ),
]
Attitude = Annotated[
    Three | None,
    typer.Option(help="Roll, pitch, yaw of the spacecraft. Default: zeros.", metavar="R P Y"),
]

Mode = Annotated[BaseMode, typer.Option(help="How the spacecraft moves.")]
MaybeMode = Annotated[
    BaseMode | None,
    typer.Option("--mode", help="How the spacecraft moves. Default: free-floating."),
]


def to_write(param: typer.CallbackParam, path: Path | None) -> Path | None:
    """Refuse a file that cannot be written, or not of a kind of its metavar: before the work."""
    if path is not None:
        kinds = [f".{kind.lower()}" for kind in (param.metavar or "").split("|")]
        require_known("suffix", path.suffix.lower(), kinds, f"{param.opts[0]} {path}: ")
        if path.suffix.lower() != ".zarr" or not path.is_dir():  # a folder may replace its kind
            writable(path)
    return path


def each_to_write(param: typer.CallbackParam, paths: list[Path] | None) -> list[Path] | None:
    """Refuse each of some files as `to_write` does."""
    for path in paths or ():
        to_write(param, path)
    return paths


def motion_to_write(param: typer.CallbackParam, path: Path | None) -> Path | None:
    """Refuse the file of a motion that cannot be written."""
    if path is not None:
        check_suffix(path)
    return to_write(param, path)


Picture = Annotated[
    Path | None,
    typer.Option("--output", help="Picture to write.", metavar="PNG|SVG|PDF", callback=to_write),
]
Save = Annotated[
    Path | None, typer.Option(help="Write the motion.", metavar="NPZ", callback=motion_to_write)
]
View = Annotated[bool, typer.Option("--view", help="Show the result in the viewer.")]
Limits = Annotated[bool, typer.Option("--limits", help="Enforce joint limits.")]
NoLimits = Annotated[bool, typer.Option("--no-limits", help="Ignore joint limits.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON: SI units, radians.")]
Degrees = Annotated[
    bool,
    typer.Option("--deg", help="Angles are given and printed in degrees. JSON has radians."),
]


#: The options for printing and writing an answer, as parameters of a command.
ANSWERS = {
    name: inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
    for name, kind, default in (
        ("output", Picture, None),
        ("save", Save, None),
        ("view", View, False),
        ("deg", Degrees, False),
        ("as_json", AsJson, False),
    )
}


def _parameters(command: Callable[..., object]) -> dict[str, inspect.Parameter]:
    """Return the parameters of a command by their names, their annotations evaluated."""
    return dict(inspect.signature(command, eval_str=True).parameters)


def _taking(run: Callable[..., T], parameters: Mapping[str, inspect.Parameter]) -> Callable[..., T]:
    """Have Typer see these parameters of a function."""
    run.__annotations__ = {name: p.annotation for name, p in parameters.items()}
    run.__dict__["__signature__"] = inspect.Signature([*parameters.values()])
    return run


def read_by(
    check: Annotated[
        str | None,
        typer.Option(
            help="What to do about physically impossible inertias.", metavar="error|warn|accept"
        ),
    ] = None,
    arg: Annotated[
        list[str] | None,
        typer.Option(help="Argument of a xacro file; may be repeated.", metavar="NAME:=VALUE"),
    ] = None,
    density: Annotated[
        float | None,
        typer.Option(help="Density [kg/m^3] of links without inertial data.", metavar="RHO"),
    ] = None,
    up_axes: Annotated[
        bool,
        typer.Option(
            "--up-axes",
            help="Rotate meshes so that the up axis stated in their COLLADA file becomes z. RViz "
            "and Gazebo do not do this. The written file does not need this option.",
        ),
    ] = False,
) -> dict[str, Any]:
    """Return how the shared options say that a file is read, as arguments of `sa.load`."""
    given = pairs("--arg", arg, "NAME:=VALUE", ":=")
    return {"check": check, "xacro_args": given, "density": density, "up_axes": up_axes}


def arm_from(
    model: Annotated[
        str,
        typer.Argument(
            autocompletion=complete_model,
            metavar="MODEL",
            help="Catalogue name (see spacearm models) or robot file.",
        ),
    ],
    tip: Annotated[
        str | None,
        typer.Option(
            metavar="LINK,LINK|LINK=LINK",
            help="Link whose frame is the tip (end-effector frame), or several links. LINK=LINK "
            "closes a chain: the two links grasp each other.",
        ),
    ] = None,
    task: Annotated[
        str | None,
        typer.Option(
            metavar="COMPONENTS[/LENGTH]",
            help='Task components: "x y rz", pose, position or orientation. The linear components '
            "of a mixed task are divided by LENGTH [m].",
        ),
    ] = None,
    joints: Annotated[
        str,
        typer.Option(
            metavar="tip|all|NAME,NAME",
            help="Active joints besides those between spacecraft and tip. All other joints are "
            "locked.",
        ),
    ] = "tip",
    lock: Annotated[
        list[str] | None,
        typer.Option(metavar="JOINT=VALUE", help="Lock a joint at a value; may be repeated."),
    ] = None,
    wheel: Annotated[
        list[str] | None,
        typer.Option(
            metavar="JOINT[=TORQUE,MOMENTUM]",
            help="Treat a joint as a momentum wheel, with these limits [N m], [N m s] or those of "
            "the file; may be repeated.",
        ),
    ] = None,
    bus: Annotated[
        str | None,
        typer.Option(
            "--bus",
            "--bus-mass",
            metavar="KG|KG:X,Y,Z|FILE[@X,Y,Z[,R,P,Y]]",
            help="Mount MODEL, an arm without a spacecraft, on a bus. The bus is a solid box of "
            "this mass [kg] with these edges [m], a robot file or a catalogue name. After @ stand "
            "the position [m] and the roll, pitch, yaw of the arm's base on the bus. Default: on "
            "top of the box.",
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(
            help="Name of the arm that --bus mounts. It becomes the prefix of all joints and links "
            "of the arm."
        ),
    ] = None,
    deg: Degrees = False,
    **options: Any,
) -> sa.SpaceArm:
    """Load the arm that the shared options describe; this signature declares them once.

    Those of `read_by` say how the file is read.

    With a bus, MODEL is an arm alone, which is mounted on top of it.
    """
    wheels, locked = _wheels(wheel), assignments("--lock", lock)
    carrier, at = (None, None) if bus is None else _described_bus(bus, deg)
    if deg and locked:
        known = _tree_of(model, bus is not None, options).joints
        locked = {name: si(known.get(name), value, deg) for name, value in locked.items()}
    counting: Any = joints if joints in ("tip", "all") else joints.split(",")
    rows, sign, length = (task or "").partition("/")
    scale = _number(length) if sign else None
    if rows:
        options["task"] = sa.Task(rows, scale)
    tips: Any = tip.split(",") if tip and "," in tip else tip
    if tip and "=" in tip:
        tips = pairs("--tip", tip.split(","), "LINK=LINK, once for each pair")
    if carrier is None and name is not None:
        raise sa.ConfigurationError(
            f"--name {name}: give the bus that the arm is mounted on: --bus KG"
        )
    if carrier is None:
        arm = sa.load(model, tip=tips, locked=locked, wheels=wheels, joints=counting, **options)
    elif model in models_by_name():
        raise sa.ConfigurationError(
            f"--bus mounts an arm alone, and {model} has a spacecraft; leave it out"
        )
    elif isinstance(tips, list | dict):
        raise sa.ConfigurationError("--tip names several links; an arm on a new bus has one tip")
    else:
        arm = sa.mount(model, carrier, at, name=name, tip=tips, locked=locked, **options)
        arm = arm.replace(joints=counting, wheels=wheels)
    return arm.replace(task=sa.Task(arm.task.names, scale)) if sign and not rows else arm


def _described_bus(text: str, deg: bool) -> tuple[sa.Bus | str, pin.SE3 | None]:
    """Return the box that the option describes, or the file or name of a spacecraft, and the place.

    Raises:
        ConfigurationError: The edges are not three numbers, or the place not three or six.
        ModelError: No bus can have this mass and these edges.

    Warns:
        ModelWarning: The size was assumed.
    """
    what, at, place = text.rpartition("@")
    where = None
    if at and "/" not in place:
        xyz, rpy = place.split(",")[:3], place.split(",")[3:] or ["0"] * 3
        given = numbers("--bus ...@X,Y,Z,R,P,Y", ",".join(xyz + rpy), 6)
        where = sa.pose(given[:3], np.radians(given[3:]) if deg else given[3:])
    else:
        what = text
    number, _, edges = what.partition(":")
    try:
        mass = float(number)
    except ValueError:
        return what, where
    if edges:
        return sa.Bus(mass=mass, size=numbers("--bus KG:X,Y,Z", edges, 3)), where
    edge = round(float(np.cbrt(max(mass, 0.0) / BUS_DENSITY)), 3) or 0.001
    warn(
        f"the bus of {mass:g} kg is taken as a solid cube of {edge:g} m, at {BUS_DENSITY:g} "
        f"kg/m^3, with the arm on its +z face; --bus {number}:X,Y,Z gives another"
    )
    return sa.Bus(mass=mass, size=(edge, edge, edge)), where


def _wheels(texts: list[str] | None) -> Wheels:
    """Parse JOINT or JOINT=TORQUE,MOMENTUM, as often as given."""
    pairs = [text.partition("=") for text in texts or []]
    limits = {name: numbers(f"--wheel {name}", both, 2) for name, _, both in pairs if both}
    return {**dict.fromkeys((name for name, _, _ in pairs), ()), **limits}


def _tree_of(model: str, alone: bool, options: dict[str, Any]) -> Tree:
    """Read the tree of a model, without warnings: they come when it is loaded."""
    reading = replace(Reading.of(**{**options, "check": "accept"}), spacecraft=False)
    info, known = (None, find_arm(model)) if alone else (find_model(model), None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return assembled(info) if info else formats.read(known.path if known else model, reading)


def on_a_model(command: Callable[..., T], *, named: bool = False) -> Callable[..., T]:
    """Give a command the argument MODEL and the options of `arm_from`, `read_by` instead of `arm`.

    MODEL comes first and the options last, before --json. A command with a parameter `deg` gets
    whether angles are in degrees; one that is `named` takes a name of the arm, and up axes.
    """
    own, reading = _parameters(command), _parameters(read_by)
    shared = _parameters(arm_from) | reading
    shared["deg"] = shared.pop("deg")
    told_deg = own.pop("deg", None) is not None
    for name in ("options", *(("name", "up_axes") * (not named))):
        del shared[name]
    last = {name: own.pop(name) for name in ("as_json",) if name in own}
    del own["arm"]
    first = {"model": shared["model"]}
    parameters = first | own | shared | last

    def run(**given: Any) -> T:
        if given.get("output", "") is None and not any(map(given.get, ("as_json", "view", "npz"))):
            try:
                writable(Path("picture.png"))
            except sa.SpaceArmError as error:
                raise sa.ConfigurationError(
                    f"{error}; name another place for the picture by --output, or give --json"
                ) from None
        deg = {"deg": given["deg"]} if told_deg else {}
        options = read_by(**{name: given.pop(name) for name in shared if name in reading})
        arm = arm_from(**{name: given.pop(name) for name in shared if name in given}, **options)
        return command(arm=arm, **given, **deg)

    keyword = inspect.Parameter.KEYWORD_ONLY
    return _taking(run, {name: p.replace(kind=keyword) for name, p in parameters.items()})


def answering(
    kind: str = "", *options: str, without: Sequence[str] = ()
) -> Callable[[Callable[..., Any]], Callable[..., int]]:
    """Give a command that returns its result, or an `Answer`, the options of `answer`.

    Of these it receives those that it declares itself.

    Args:
        kind: As in `answer`; if empty there is no --output.
        *options: Which there are besides --deg and --json: "save", "view".
        without: Parameters of the function that are not options.
    """
    names = [*["output"] * bool(kind), *options, "deg", "as_json"]

    def decorate(command: Callable[..., Any]) -> Callable[..., int]:
        own = {name: p for name, p in _parameters(command).items() if name not in without}

        def run(arm: sa.SpaceArm, **given: Any) -> int:
            found = command(arm, **{name: x for name, x in given.items() if name in own})
            found = found if isinstance(found, Answer) else Answer(found)
            answer(arm, found, kind, **{name: given[name] for name in names})
            return found.code

        added = {name: ANSWERS[name] for name in names if name not in own}
        return on_a_model(_taking(run, own | added))

    return decorate


def pairs(option: str, texts: list[str] | None, form: str, sign: str = "=") -> dict[str, str]:
    """Part names and values, as often as given, of a form such as JOINT=VALUE."""
    found: dict[str, str] = {}
    for text in texts or []:
        name, _, value = text.rpartition(sign)
        if not name or name in found:
            twice = f"{name} is given twice; " if name else ""
            raise sa.ConfigurationError(f"{option} {text!r}: {twice}give {form}")
        found[name] = value
    return found


def refuse_unused(given: Mapping[str, object], needed: str) -> None:
    """Refuse options that have no effect in this combination.

    Args:
        given: The value of each option, None or False where it was not given.
        needed: What they have an effect with.

    Raises:
        ConfigurationError: One was given.
    """
    for option, value in given.items():
        if value is not None and value is not False:
            raise sa.ConfigurationError(
                f"{option} is given and has no effect here: it works {needed}; leave it out"
            )


def assignments(option: str, texts: list[str] | None) -> dict[str, float]:
    """Parse JOINT=VALUE, as often as given."""
    given = pairs(option, texts, "JOINT=VALUE, once for each joint")
    return {name: _number(value) for name, value in given.items()}


def joint_values(arm: sa.SpaceArm, words: Sequence[str | float], deg: bool) -> Array:
    """Return joint values that are given, at home or saved, in radians and metres."""
    if list(words) == [HOME]:
        return arm.home
    if "q" in (saved := saved_start(words).values):
        return joint_vector(arm, saved["q"], f"q in {words[0]}")
    values = [_number(word) for word in words]
    if len(values) != arm.n:
        raise sa.ConfigurationError(
            f"{len(values)} joint value{'s' * (len(values) != 1)} given; {arm.name} needs {arm.n}: "
            f"{listed(arm.joint_names)}; give them after MODEL, angles in radians or by --deg in "
            "degrees"
        )
    joints = [arm.tree.joints[name] for name in arm.joint_names]
    return np.array([si(joint, q, deg) for joint, q in zip(joints, values, strict=True)])


def configuration(
    arm: sa.SpaceArm,
    words: Sequence[str | float] | None,
    attitude: Three | None,
    deg: bool,
    start: Table | None = None,
) -> sa.Configuration:
    """Return the configuration that joint values and the spacecraft's attitude mean.

    Args:
        arm: The arm.
        words: Joint positions, the command's arguments, or the file of a saved posture.
        attitude: Roll, pitch and yaw of the option; None if it is not given.
        deg: Whether these are in degrees.
        start: The table `start` of a question, with the arguments of `SpaceArm.at`; its `base` has
            `xyz` and `rpy`. Joint positions of the command count before its own.

    Raises:
        ConfigurationError: There are no joint positions, or a value makes no sense.

    Warns:
        ModelWarning: Joints are outside their limits, or look like degrees.
    """
    saved = saved_start(words)
    given = Table("start", {}) if start is None else start
    given.knows(*START)
    values = saved.values | given.values
    if words or "q" not in values:
        values["q"] = joint_values(arm, words or [], deg)
    values["base"] = place_in(given if "base" in given.values else saved)
    if attitude is not None:
        values["base"].rotation = spacecraft_pose(attitude, deg).rotation
    cfg = arm.at(**values)
    warn_outside(arm, cfg.q)
    return cfg


#: Arguments of `SpaceArm.at` that a table `start` has.
START = ("q", "base", "wheels", "momentum")


def saved_start(words: Sequence[str | float] | None) -> Table:
    """Return the table `start` of the TOML file that is given in place of joint values, if any."""
    path = str(words[0]) if words and len(words) == 1 else ""
    text = text_of(path, "the posture") if path.endswith(".toml") else ""
    start = parse(text, path).inner("start") if text else Table(path, {})
    start.knows(*START)
    return start


def place_in(given: Table, key: str = "base") -> pin.SE3:
    """Return the pose that a key of a table gives, {xyz, rpy}; the identity without the key."""
    like = "{xyz = [...], rpy = [...]}"
    place = Table(f"{given.where}: {key}", given.values.get(key, {}), like)
    place.knows("xyz", "rpy")
    return sa.pose(**place.values)


def spacecraft_pose(attitude: Three | None, deg: bool) -> pin.SE3:
    """Return the pose at the origin with this roll, pitch and yaw; the identity if None."""
    rpy = finite(attitude or (0.0, 0.0, 0.0), (3,), "--attitude", "(angles)")
    return sa.pose(rpy=np.radians(rpy) if deg else rpy)


def radians(angle: float | None, deg: bool, default: U) -> float | U:
    """Return an angle of an option in radians; the default if it is not given."""
    return default if angle is None else float(np.radians(angle)) if deg else angle


def task_rows(arm: sa.SpaceArm, option: str, text: str, deg: bool) -> Array:
    """Parse the task's rows [m], [rad]; turns are roll, pitch, yaw."""
    values = numbers(option, text)
    turns = np.array(arm.task.indices) > 2
    if deg and len(values) == len(turns):
        values[turns] = np.radians(values[turns])
    return values


def goal_from(arm: sa.SpaceArm, option: str, text: str, deg: bool) -> Goal:
    """Parse a goal: a point in the task's rows, or a pose whose turns are roll, pitch, yaw."""
    return goal_of(arm, task_rows(arm, option, text, deg), option)


def mark_of(end: sa.Configuration, goal: Goal) -> Array | None:
    """Return the (3,) goal point to mark, or None if the task has no linear rows.

    Rows that the task leaves open are those of the tip at the end.
    """
    rows = [i for i in end.arm.task.indices if i < 3]
    mark = end.tip.translation
    mark[rows] = goal_pose(end, goal).translation[rows]
    return mark if rows else None


def numbers(option: str, text: str, count: int | None = None) -> Array:
    """Parse finite numbers with spaces or commas between them, so many if it is said."""
    values = [_number(word) for word in text.replace(",", " ").split()]
    if not values or not np.isfinite(values).all() or count not in (None, len(values)):
        how = "finite numbers" if count is None else f"{count} finite numbers, as in 0,0,1"
        raise sa.ConfigurationError(f"{option} is {text!r}; give {how}")
    return np.array(values)


def table_of(path: Path, what: str) -> tuple[list[str], Array]:
    """Read a table with spaces or commas between numbers: its names, if any, and its rows (m, k).

    Empty lines and what follows # do not count.

    Args:
        path: The file.
        what: What it is called in an error.

    Raises:
        ConfigurationError: It cannot be read, holds something else, numbers beyond `LARGEST`, or
            rows of several lengths.
    """
    try:
        text = decoded(read(path))
    except (OSError, ValueError) as error:
        raise sa.ConfigurationError(f"{what} cannot be read: {error}") from None
    split = [line.partition("#")[0].replace(",", " ").split() for line in text.splitlines()]
    lines = [(i, words) for i, words in enumerate(split, 1) if words]
    named = bool(lines) and any(word.isidentifier() for word in lines[0][1])
    names = lines.pop(0)[1] if named else []
    for i, words in lines:
        for word in words:
            if not NUMBER.fullmatch(word):
                fault = f"{what}, line {i}: {word!r} is not a finite number"
                raise sa.ConfigurationError(fault + "; separate by commas" * (";" in word))
            if abs(float(word)) > LARGEST:
                raise sa.ConfigurationError(
                    f"{what}, line {i}: {word} is too large; give numbers up to {LARGEST:g}"
                )
    widths = sorted({len(words) for _, words in lines})
    if not widths:
        raise sa.ConfigurationError(f"{what} has no rows of numbers; give at least one")
    if len(widths) > 1:
        counts = listed([str(width) for width in widths])
        raise sa.ConfigurationError(f"{what} has {counts} numbers in a row; give as many in each")
    return names, np.array([words for _, words in lines], dtype=np.float64)


def si(joint: Joint | None, value: float, deg: bool) -> float:
    """Return the value in radians, or in metres for prismatic joints."""
    return float(np.radians(value)) if deg and joint and joint.kind != "prismatic" else value


def _number(word: str | float) -> float:
    try:
        return float(word)
    except ValueError:
        fault = "an option here" if re.match(r"--?[A-Za-z]", str(word)) else "a number"
        remedy = "a picture is --output FILE where --help has it" if word == "-o" else "see --help"
        raise sa.ConfigurationError(f"{word!r} is not {fault}; {remedy}") from None
