"""Motions in TOML files: control laws, what acts, how to integrate, phases of a flight.

The keys are the names in Python: a table has the fields of the class that it stands for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from inspect import signature
from typing import Any, TypeVar, get_args

import numpy as np

from spacearm.arrays import ArrayLike
from spacearm.errors import ConfigurationError
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.motion.controllers import LAWS, Controller, TipLaw
from spacearm.motion.flights import Grasp, Phase, Release
from spacearm.motion.goal import goal_of
from spacearm.motion.plant import (
    Integration,
    PassiveJoint,
    Plant,
    Sampling,
    WheelFriction,
    WheelHold,
    Wrench,
)
from spacearm.sweeps.toml import Table

T = TypeVar("T")
MODES: tuple[BaseMode, ...] = get_args(BaseMode)


def read_law(table: Table, arm: SpaceArm) -> Controller:
    """Return a control law.

    Args:
        table: The law and its parameters, such as law = "JointPD", target = [0.5, 0.6], kp = 4,
            kd = 8. Targets of the tip are numbers for the task's rows, turns as roll, pitch, yaw.
        arm: The arm.

    Raises:
        ConfigurationError: A value is missing, or makes no sense.
    """
    kind = LAWS[table.choice("law", tuple(LAWS))]

    def parameter(name: str) -> Any:
        if name == "mode":
            return table.choice("mode", MODES)
        given = table.numbers(name)
        if name == "target":
            return goal_of(arm, given, name) if issubclass(kind, TipLaw) else given
        return given if isinstance(table.values[name], list) else float(given[0])

    own = signature(kind).parameters
    table.knows("law", *own)
    names = [name for name, p in own.items() if name in table.values or p.default is p.empty]
    law: Controller = kind(**{name: parameter(name) for name in names})
    return law


def built(kind: Callable[..., T], given: Table, **made: Callable[[Any], Any]) -> T:
    """Make an object from a table of the names of its fields.

    Args:
        kind: The class, which checks its values.
        given: The table.
        made: What makes the value of a field of that in the table, for fields that need it.

    Raises:
        ConfigurationError: A field does not exist or is missing, or a value makes no sense.
    """
    fields = signature(kind).parameters
    given.knows(*fields)
    for name, each in fields.items():
        if each.default is each.empty and name not in given.values:
            raise given.fail(name, f"a {kind.__name__} needs it")
    values = {k: made[k](v) if k in made else v for k, v in given.values.items()}
    try:
        return kind(**values)
    except TypeError as error:
        raise ConfigurationError(f"{given.where}: {error}") from None


def read_plant(table: Table) -> Plant:
    """Return what acts on the arm: the fields of `Plant`."""

    def passive(value: Any) -> Any:
        if isinstance(value, str):
            return value
        joints = table.inner("passive")
        return {name: _passive(joints.inner(name)) for name in joints.values}

    def friction(value: Any) -> Any:
        if not isinstance(value, Mapping):
            return value
        return built(WheelFriction, table.inner("wheel_friction"))

    def pushed(name: str) -> Callable[[Any], dict[str, Wrench]]:
        links = table.inner(name)
        return lambda _: {link: _wrench(links, link) for link in links.values}

    return built(
        Plant,
        table,
        wheels=lambda _: built(WheelHold, table.inner("wheels")),
        wrenches=pushed("wrenches"),
        thrusters=pushed("thrusters"),
        passive=passive,
        wheel_friction=friction,
    )


def _passive(own: Table) -> PassiveJoint:
    own.knows(*PassiveJoint._fields)
    return PassiveJoint(**{name: own.take(name, float) for name in own.values})


def _wrench(pushed: Table, link: str) -> Wrench:
    """Return a wrench, or one that changes at given times."""
    if not isinstance(pushed.values[link], Mapping):
        return pushed.numbers(link)
    pieces = pushed.inner(link)
    pieces.knows("times", "values")
    times, values = pieces.numbers("times"), pieces.values.get("values")
    if not isinstance(values, list) or len(values) != len(times) or (np.diff(times) <= 0.0).any():
        raise pieces.fail("values", "give increasing times, and a wrench from each time on")
    rows = [Table(pieces.where, {"values": row}).numbers("values") for row in values]
    if any(len(row) != 6 for row in rows):
        raise pieces.fail("values", "give 6 numbers each, force [N] and torque [N m]")

    def wrench(t: float) -> ArrayLike:
        now = int(np.searchsorted(times, t, side="right")) - 1
        return rows[now] if now >= 0 else np.zeros(6)

    return wrench


def read_sampling(table: Table) -> Sampling | None:
    """Return period, delay and noise of a controller of fixed rate; None if there are none."""
    if "sampling" not in table.values:
        return None
    return built(Sampling, table.inner("sampling"))


def read_integration(table: Table, default: Integration) -> Integration:
    """Return how to integrate: `default` with what the table gives."""
    table.knows(*signature(Integration).parameters)
    return replace(default, **table.values)


def read_phases(table: Table, arm: SpaceArm) -> list[Phase]:
    """Return the phases of a flight, a table [[phases]] for each, with the fields of `Phase`.

    Raises:
        ConfigurationError: There are none, or a value makes no sense.
    """
    listed = table.values.get("phases")
    if not isinstance(listed, list) or not listed:
        raise table.fail("phases", "give one or more tables [[phases]]")
    return [_phase(Table(f"phase {i}", values), arm) for i, values in enumerate(listed)]


def _phase(table: Table, arm: SpaceArm) -> Phase:
    table.knows(*signature(Phase).parameters)
    return Phase(
        read_laws(table.inner("controller"), arm),
        table.positive("duration", float),
        _then(table),
        plant=read_plant(table.inner("plant")),
        sampling=read_sampling(table),
        stop=table.texts("stop"),
        integration=read_integration(table.inner("integration"), Integration()),
        **table.some("mode", "name"),
    )


def read_laws(table: Table, arm: SpaceArm) -> Controller | dict[str, Controller]:
    """Return a control law, or one for each tip that the table names."""
    if table.values and all(isinstance(value, Mapping) for value in table.values.values()):
        return {tip: read_law(table.inner(tip), arm) for tip in table.values}
    return read_law(table, arm)


def _then(table: Table) -> Grasp | Release | None:
    """Return what happens at the end of a phase."""
    if "then" not in table.values:
        return None
    if table.values["then"] == "release":
        return Release()
    if not isinstance(table.values["then"], Mapping):
        raise table.fail("then", 'give "release" or {grasp = {mass = ...}}')
    then = table.inner("then")
    then.knows("grasp")
    body = then.inner("grasp")
    body.positive("mass", float)
    return built(Grasp, body)
