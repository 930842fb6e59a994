"""`--with`: what a command takes beyond its options, by its names in Python, from TOML files."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import spacearm as sa
from spacearm.cli import options as opt
from spacearm.errors import require_known
from spacearm.model.arguments import FLOATING
from spacearm.motion.controllers import LAWS, Controller
from spacearm.motion.goal import Goal, goal_of
from spacearm.sweeps.motion_tables import built, read_laws
from spacearm.sweeps.toml import Table, parse, text_of

With = Annotated[
    list[str] | None,
    typer.Option(
        "--with",
        help="Further arguments by their names in Python, in SI units and radians: a TOML file, or "
        "one value in JSON, as in integration.rtol=1e-6, constraints.limits=false or "
        "start.wheels=[0,1]; may be repeated, the last counts.",
        metavar="FILE.toml|KEY=VALUE",
    ),
]
#: Gains of the controllers that take them, where none are given.
GAINS = {"kp": 5.0, "kd": 15.0, "gain": 1.0}
#: Kinds of obstacles.
SHAPES = ("box", "sphere", "cylinder", "mesh", "robot")


def question(given: Sequence[str] | None, *names: str, **options: Any) -> Table:
    """Return one table of what `--with` gives.

    Args:
        given: Paths of TOML files, and texts "KEY=VALUE" with dots in the key; later ones win.
        *names: The keys that it may have.
        **options: Values of keys from options of their own, which win; None if not given.

    Raises:
        ConfigurationError: A file cannot be read, or a key does not exist.
    """
    whole: dict[str, Any] = {}
    for text in given or ():
        key, sign, value = text.partition("=")
        if sign:
            _merge(whole, _nested(key.strip().split("."), _value(value.strip())))
            continue
        _merge(whole, parse(text_of(text, "--with"), text).values)
    table = Table("--with", whole | {name: x for name, x in options.items() if x is not None})
    table.knows(*names)
    return table


def _merge(into: dict[str, Any], more: Mapping[str, Any]) -> None:
    for key, value in more.items():
        if isinstance(value, Mapping) and isinstance(into.get(key), dict):
            _merge(into[key], value)
        else:
            into[key] = dict(value) if isinstance(value, Mapping) else value


def _nested(keys: Sequence[str], value: Any) -> dict[str, Any]:
    return {keys[0]: value if len(keys) == 1 else _nested(keys[1:], value)}


def _value(text: str) -> Any:
    """Return what a text means as JSON: a number, true, false, a list, a table; else itself."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


def goal_in(arm: sa.SpaceArm, given: Table, key: str) -> Goal | sa.Joints | dict[str, Goal]:
    """Return the goal that a key of a table means.

    It is a list of the task's rows [m], turns as roll, pitch and yaw [rad]; {q = [...]}, joint
    positions; or a table of goals by tips.
    """
    if not isinstance(given.values[key], Mapping):
        return goal_of(arm, given.numbers(key), key)
    own = given.inner(key)
    if "q" in own.values:
        return built(sa.Joints, own)
    return {tip: goal_of(arm, own.numbers(tip), tip) for tip in own.values}


def controller_of(arm: sa.SpaceArm, given: Table) -> Controller | dict[str, Controller]:
    """Return the control law that a table describes, or one for each tip; see `read_laws`.

    The law is the transposed Jacobian's, and gains are `GAINS`, where none are given.
    """
    if any(isinstance(value, Mapping) for value in given.values.values()):
        return read_laws(given, arm)
    law = given.choice("law", tuple(LAWS), "TransposedJacobian")
    taken = inspect.signature(LAWS[law]).parameters
    gains = {name: gain for name, gain in GAINS.items() if name in taken}
    return read_laws(Table(given.where, gains | given.values | {"law": law}), arm)


def constraints_of(given: Table) -> sa.Constraints:
    """Return what must hold, of a table with the fields of `Constraints`.

    Obstacles are tables: {sphere = 0.2, xyz = [...], rpy = [...], margin = 0.05}, or box, cylinder
    = [radius, length], mesh = "FILE", robot = "MODEL" with q; or texts as of --obstacle. Meshes and
    robots take up_axes.
    """
    wheels = {"stiffness": 0.0, "damping": 0.0} | given.inner("wheels").values
    return built(
        sa.Constraints,
        given,
        wheels=lambda _: built(sa.WheelHold, Table(f"{given.where}: wheels", wheels)),
        obstacles=lambda value: tuple(
            _obstacle(one, given) for one in (value if isinstance(value, list) else [value])
        ),
    )


def obstacle_of(text: str, deg: bool) -> sa.Obstacle:
    """Parse an obstacle, such as "box:1.2,0,0.5:0.3,0.3,0.6:0,0,45@0.05"."""
    option = f"--obstacle {text!r}: a part"
    body, _, margin = text.partition("@")
    kind, *parts = body.split(":")
    require_known("kind", kind, SHAPES, f"--obstacle {text!r}: ")
    if not 2 <= len(parts) <= 3:
        raise sa.ConfigurationError(f"--obstacle {text!r}: give KIND:X,Y,Z:WHAT[:R,P,Y][@MARGIN]")
    what: Any = parts[1]
    if kind not in ("mesh", "robot"):
        count = {"sphere": 1, "cylinder": 2, "box": 3 if "," in what else 1}[kind]
        size = opt.numbers(option, what, count).tolist()
        what = size[0] if count == 1 else size
    turn = opt.numbers(option, parts[2], 3) if len(parts) == 3 else np.zeros(3)
    given = {kind: what, "xyz": opt.numbers(option, parts[0], 3)}
    given["rpy"] = np.radians(turn) if deg else turn
    if margin:
        given["margin"] = float(opt.numbers(option, margin, 1)[0])
    return _obstacle(given, Table(f"--obstacle {text!r}", {}))


def _obstacle(value: Any, given: Table) -> sa.Obstacle:
    if isinstance(value, str):
        return obstacle_of(value, deg=False)
    own = Table(f"{given.where}: obstacles", value)
    kinds = [kind for kind in SHAPES if kind in own.values]
    if len(kinds) != 1:
        raise own.fail("obstacles", f"give one of {', '.join(SHAPES)} for each")
    rest = dict(own.values)
    kind, shape = kinds[0], rest.pop(kinds[0])
    if kind in ("mesh", "robot"):
        shape = own.take(kind, str)
    elif kind == "cylinder" and len(own.numbers(kind)) != 2:
        raise own.fail(kind, "give [radius, length]")
    at = sa.pose(**{key: rest.pop(key) for key in ("xyz", "rpy") if key in rest})
    if kind == "robot":
        robot = sa.load(shape, up_axes=rest.pop("up_axes", False))
        q = rest.pop("q", np.clip(0.0, robot.lower, robot.upper))
        return sa.Obstacle.robot(robot.at(q, base=at), **rest)
    size = shape if kind == "cylinder" else (Path(shape),) if kind == "mesh" else (shape,)
    return getattr(sa.Obstacle, kind)(*size, at, **rest)


def target_of(path: Path) -> sa.Target:
    """Return the target that a TOML file describes, by the names of `Target`.

    `body` is the path of a robot file, from the folder of the TOML file on, or a table of `Bus`;
    `pose` and each of `grapples` are {xyz = [...], rpy = [...]}.
    """
    given = parse(text_of(path, "--target"), str(path))

    def body(value: Any) -> sa.Bus | Path:
        if isinstance(value, str):
            return path.parent / value
        return built(sa.Bus, given.inner("body"))

    def grapples(_: Any) -> dict[str, Any]:
        frames = given.inner("grapples")
        return {name: opt.place_in(frames, name) for name in frames.values}

    return built(
        sa.Target, given, body=body, pose=lambda _: opt.place_in(given, "pose"), grapples=grapples
    )


def search_of(
    arm: sa.SpaceArm, given: Table, progress: Callable[[float, float], object]
) -> sa.Search:
    """Return how to look, of a table with the fields of `Search`; `boxes` is the path of a file."""
    return built(
        sa.Search,
        Table(given.where, given.values | {"progress": progress}),
        boxes=lambda _: sa.FreeBoxes.load(given.take("boxes", str), arm, FLOATING),
    )
