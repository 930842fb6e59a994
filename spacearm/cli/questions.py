"""Questions: what a command is asked beyond its options, in the names of Python, from TOML."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import typer

from spacearm.arrays import Array
from spacearm.cli.options import Three, numbers, spacecraft_pose
from spacearm.collisions.obstacles import Obstacle
from spacearm.errors import ConfigurationError, unknown
from spacearm.files import read
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.frames import pose
from spacearm.model.joints import warn_outside
from spacearm.model.loading import load
from spacearm.motion.controllers import (
    Controller,
    DampedLeastSquares,
    JointPD,
    Reactionless,
    ResolvedRate,
    TransposedJacobian,
)
from spacearm.motion.flights import Grasp, Phase, Release
from spacearm.motion.goal import Goal, goal_of
from spacearm.motion.plant import PassiveJoint, Plant, WheelHold, Wrench
from spacearm.motion.simulation import Integration
from spacearm.planning.request import Constraints, Search
from spacearm.planning.result import Joints
from spacearm.sweeps.toml import Table, parse

T = TypeVar("T")

With = Annotated[
    list[str] | None,
    typer.Option(
        "--with",
        help="More of the question, by its names in Python, SI units and radians: a TOML file, or "
        "one value, as in integration.rtol=1e-6; may be repeated, the last counts.",
        metavar="FILE.toml|KEY=VALUE",
    ),
]
LAWS: dict[str, Callable[..., Controller]] = {
    law.__name__: law
    for law in (TransposedJacobian, ResolvedRate, DampedLeastSquares, Reactionless, JointPD)
}
"""Controllers by their names."""
GAINS = {"kp": 5.0, "kd": 15.0, "gain": 1.0}
"""Gains of the controllers that take them, where none are given."""
SHAPES = ("box", "sphere", "cylinder", "mesh", "robot")


def question(given: Sequence[str] | None, *names: str) -> Table:
    """Return one table of what `--with` gives.

    Args:
        given: Paths of TOML files, and texts "KEY=VALUE" with dots in the key; later ones win.
        *names: The keys that it may have.

    Raises:
        ConfigurationError: A file cannot be read, or a key does not exist.
    """
    whole: dict[str, Any] = {}
    for text in given or ():
        key, sign, value = text.partition("=")
        if sign:
            _merge(whole, _nested(key.strip().split("."), _value(value.strip())))
            continue
        try:
            content = read(Path(text)).decode()
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"--with {text} cannot be read: {error}") from None
        _merge(whole, parse(content, text).values)
    table = Table("--with", whole)
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
    except ValueError:
        return text


def built(kind: Callable[..., T], given: Table, **made: Callable[[Any], Any]) -> T:
    """Make an object from a table of the names of its fields.

    Args:
        kind: Its class, which checks the values.
        given: The table.
        **made: What makes the value of a field of what the table says.

    Raises:
        ConfigurationError: A key is not among the fields, a field without a default is missing, or
            a value makes no sense.
    """
    fields = inspect.signature(kind).parameters
    given.knows(*fields)
    for name, field in fields.items():
        if field.default is inspect.Parameter.empty and name not in given.values:
            raise given.fail(name, f"a {kind.__name__} needs it")
    values = {k: made[k](v) if k in made else v for k, v in given.values.items()}
    try:
        return kind(**values)
    except TypeError as error:
        raise ConfigurationError(f"{given.where}: {error}") from None


def inner(given: Table, key: str) -> Table:
    """Return the table of a key; an empty one if there is none."""
    return Table(f"{given.where}: {key}", given.values.get(key, {}))


def start_of(
    arm: SpaceArm, given: Table, q: Array | None, attitude: Three | None, deg: bool
) -> Configuration:
    """Return the configuration in which a motion starts.

    Args:
        arm: The arm.
        given: The question; its table `start` has the arguments of `SpaceArm.at`, `base` with
            `xyz` and `rpy`.
        q: (n,) joint positions of the command's arguments; None if there are none.
        attitude: Roll, pitch and yaw of the option; None if it is not given.
        deg: Whether these are in degrees.

    Raises:
        ConfigurationError: There are no joint positions, or a value makes no sense.

    Warns:
        ModelWarning: Joints are outside their limits, or look like degrees.
    """
    start = inner(given, "start")
    start.knows("q", "base", "wheels", "momentum")
    values = dict(start.values)
    if q is not None:
        values["q"] = q
    if "q" not in values:
        raise ConfigurationError(
            f"there is no start; give {arm.n} joint values after the name of the model: "
            f"{', '.join(arm.joint_names)}"
        )
    place = inner(start, "base")
    place.knows("xyz", "rpy")
    values["base"] = pose(**place.values)
    if attitude is not None:
        values["base"].rotation = spacecraft_pose(attitude, deg).rotation
    cfg = arm.at(values.pop("q"), **values)
    warn_outside(arm, cfg.q)
    return cfg


def goal_in(arm: SpaceArm, value: Any, where: str) -> Goal | Joints | dict[str, Goal]:
    """Return the goal that a value of a table means.

    It is a list of the task's rows [m], turns as roll, pitch and yaw [rad]; {joints = [...]}; or
    a table of goals by tips.
    """
    if isinstance(value, Mapping):
        if "joints" in value:
            return built(Joints, Table(where, value))
        return {tip: goal_of(arm, _numbers(one, f"{where} of {tip}"), tip)
                for tip, one in value.items()}  # fmt: skip
    return goal_of(arm, _numbers(value, where), where)


def controller_of(arm: SpaceArm, given: Table) -> Controller | dict[str, Controller]:
    """Return the control law that a table describes, or one for each tip.

    `law` is its name in Python, the other keys are its fields; `target` as goals are given.
    """
    tips = [key for key, value in given.values.items() if isinstance(value, Mapping)]
    if tips and "law" not in given.values:
        return {tip: _law(arm, inner(given, tip)) for tip in given.values}
    return _law(arm, given)


def _law(arm: SpaceArm, given: Table) -> Controller:
    name = given.take("law", str, "TransposedJacobian")
    if name not in LAWS:
        raise given.fail("law", unknown("law", name, tuple(LAWS)))
    fields = {key: value for key, value in given.values.items() if key != "law"}
    needed = inspect.signature(LAWS[name]).parameters
    fields = {key: value for key, value in GAINS.items() if key in needed} | fields
    rest = Table(given.where, fields)
    made = {} if name == "JointPD" else {"target": lambda v: goal_of(arm, np.array(v), "target")}
    return built(LAWS[name], rest, **made)


def plant_of(given: Table) -> Plant:
    """Return what acts on the arm, of a table with the fields of `Plant`."""
    return built(
        Plant,
        given,
        wheels=lambda _: built(WheelHold, inner(given, "wheels")),
        passive=lambda value: value if isinstance(value, str) else _each(given, "passive", _joint),
        wrenches=lambda _: _each(given, "wrenches", _wrench),
        thrusters=lambda _: _each(given, "thrusters", _wrench),
    )


def _each(given: Table, key: str, make: Callable[[Table, str], T]) -> dict[str, T]:
    own = inner(given, key)
    return {name: make(own, name) for name in own.values}


def _joint(given: Table, name: str) -> PassiveJoint:
    return built(PassiveJoint, inner(given, name))


def _wrench(given: Table, link: str) -> Wrench:
    """Return a wrench (6,), or one that changes at given times: {times = [...], values = [...]}."""
    if not isinstance(given.values[link], Mapping):
        return _numbers(given.values[link], f"{given.where}: {link}")
    pieces = inner(given, link)
    pieces.knows("times", "values")
    times = _numbers(pieces.values.get("times"), f"{pieces.where}: times")
    rows = [_numbers(row, f"{pieces.where}: values") for row in pieces.take("values", list)]
    if len(rows) != len(times) or (np.diff(times) <= 0.0).any() or any(len(r) != 6 for r in rows):
        raise pieces.fail("values", "give a wrench of 6 numbers for each of the growing times")

    def wrench(t: float) -> Array:
        now = int(np.searchsorted(times, t, side="right")) - 1
        return rows[now] if now >= 0 else np.zeros(6)

    return wrench


def phases_of(arm: SpaceArm, given: Sequence[Any]) -> list[Phase]:
    """Return the phases of a flight: tables [[phases]] with the fields of `Phase`.

    `then` is "release", or a table with the fields of `Grasp`.
    """
    return [_phase(arm, Table(f"phase {i}", values)) for i, values in enumerate(given)]


def _phase(arm: SpaceArm, given: Table) -> Phase:
    return built(
        Phase,
        given,
        controller=lambda _: controller_of(arm, inner(given, "controller")),
        then=lambda value: _then(value, given),
        plant=lambda _: plant_of(inner(given, "plant")),
        integration=lambda _: built(Integration, inner(given, "integration")),
    )


def _then(value: Any, given: Table) -> Grasp | Release:
    if value == "release":
        return Release()
    if not isinstance(value, Mapping):
        raise given.fail("then", 'give "release", or a table of what is grasped, as {mass = 3.0}')
    return built(Grasp, inner(given, "then"))


def constraints_of(given: Table) -> Constraints:
    """Return what must hold, of a table with the fields of `Constraints`.

    Obstacles are tables: {sphere = 0.2, xyz = [...], rpy = [...], margin = 0.05}, or box, cylinder
    = [radius, length], mesh = "FILE", robot = "MODEL" with q; or texts as of --obstacle.
    """
    return built(
        Constraints,
        given,
        wheels=lambda value: built(
            WheelHold, Table(f"{given.where}: wheels", {"stiffness": 0, "damping": 0} | value)
        ),
        obstacles=lambda value: tuple(_obstacle(one, given) for one in value),
    )


def obstacle_of(text: str, deg: bool) -> Obstacle:
    """Parse an obstacle, such as "box:1.2,0,0.5:0.3,0.3,0.6:0,0,45@0.05"."""
    option = f"--obstacle {text!r}:"
    body, _, margin = text.partition("@")
    kind, *parts = body.split(":")
    if kind not in SHAPES:
        raise ConfigurationError(f"{option} {unknown('kind', kind, SHAPES)}")
    if not 2 <= len(parts) <= 3:
        raise ConfigurationError(f"{option} give KIND:X,Y,Z:WHAT[:R,P,Y][@MARGIN]")
    what: Any = parts[1]
    if kind not in ("mesh", "robot"):
        count = {"sphere": 1, "cylinder": 2, "box": 3 if "," in what else 1}[kind]
        size = numbers(option, what, count).tolist()
        what = size[0] if count == 1 else size
    turn = numbers(option, parts[2], 3) if len(parts) == 3 else np.zeros(3)
    given = {kind: what, "xyz": numbers(option, parts[0], 3)}
    given["rpy"] = np.radians(turn) if deg else turn
    if margin:
        given["margin"] = float(numbers(option, margin, 1)[0])
    return _obstacle(given, Table(option, {}))


def _obstacle(value: Any, given: Table) -> Obstacle:
    if isinstance(value, str):
        return obstacle_of(value, deg=False)
    own = Table(f"{given.where}: obstacles", value)
    kinds = [kind for kind in SHAPES if kind in own.values]
    if len(kinds) != 1:
        raise own.fail("obstacles", f"give one of {', '.join(SHAPES)} for each")
    rest = dict(own.values)
    kind, shape = kinds[0], rest.pop(kinds[0])
    at = pose(**{key: rest.pop(key) for key in ("xyz", "rpy") if key in rest})
    if kind == "robot":
        robot = load(shape)
        q = rest.pop("q", np.clip(0.0, robot.lower, robot.upper))
        return Obstacle.robot(robot.at(q, base=at), **rest)
    size = shape if kind == "cylinder" else (Path(shape),) if kind == "mesh" else (shape,)
    return getattr(Obstacle, kind)(*size, at, **rest)


def search_of(given: Table, progress: Callable[[float, float], object]) -> Search:
    """Return how to look, of a table with the fields of `Search`."""
    return built(Search, Table(given.where, given.values | {"progress": progress}))


def _numbers(value: object, name: str) -> Array:
    """Return a number or a list of them, as an array (m,)."""
    listed = value if isinstance(value, list) else [value]
    if not listed or any(type(number) not in (int, float) for number in listed):
        raise ConfigurationError(f"{name} is {value!r}; give a number, or a list of numbers")
    return np.array(listed, dtype=np.float64)
