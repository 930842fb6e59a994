"""Motions in TOML files: control laws, what acts, how to integrate, phases of a flight.

The keys are the names in Python: a table has the fields of the class that it stands for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from inspect import signature
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.motion.controllers import LAWS, Controller, TipLaw
from spacearm.motion.flights import Grasp, Phase, Release
from spacearm.motion.goal import goal_of
from spacearm.motion.plant import Integration, PassiveJoint, Plant, Sampling, WheelHold, Wrench
from spacearm.sweeps.toml import Table

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

    law: Controller = kind(**{name: parameter(name) for name in _fields(table, kind, "law")})
    return law


def read_plant(table: Table) -> Plant:
    """Return what acts on the arm: wheels, wrenches, thrusters, passive, limits."""
    options: dict[str, Any] = {}
    for name in _fields(table, Plant):
        if name == "limits":
            options[name] = table.take(name, bool)
        elif name == "wheels":
            options[name] = _of_numbers(table.inner(name), WheelHold)
        elif name == "passive" and isinstance(table.values[name], str):
            options[name] = table.take(name, str)
        elif name == "passive":
            joints = table.inner(name)
            options[name] = {j: _of_numbers(joints.inner(j), PassiveJoint) for j in joints.values}
        else:
            pushed = table.inner(name)
            options[name] = {link: _wrench(pushed, link) for link in pushed.values}
    return Plant(**options)


def _wrench(pushed: Table, link: str) -> Wrench:
    """Return a wrench, or one that changes at given times."""
    if not isinstance(pushed.values[link], Mapping):
        return pushed.numbers(link)
    pieces = pushed.inner(link)
    pieces.knows("times", "values")
    times, values = pieces.numbers("times"), pieces.values.get("values")
    if not isinstance(values, list) or len(values) != len(times) or (np.diff(times) <= 0.0).any():
        raise pieces.fail("values", "give as many wrenches as growing times, each from then on")
    rows = [Table(pieces.where, {"values": row}).numbers("values") for row in values]
    if any(len(row) != 6 for row in rows):
        raise pieces.fail("values", "give 6 numbers each, force [N] and torque [N m]")

    def wrench(t: float) -> npt.ArrayLike:
        now = int(np.searchsorted(times, t, side="right")) - 1
        return rows[now] if now >= 0 else np.zeros(6)

    return wrench


def read_sampling(table: Table) -> Sampling | None:
    """Return period, delay and noise of a controller of fixed rate; None if there are none."""
    if "sampling" not in table.values:
        return None
    given = table.inner("sampling")
    options: dict[str, Any] = {}
    for name in _fields(given, Sampling):
        if name == "seed":
            options[name] = given.take(name, int)
        elif name.endswith("noise") and isinstance(given.values[name], list):
            options[name] = given.numbers(name)
        else:
            options[name] = given.take(name, float)
    return Sampling(**options)


def read_integration(table: Table, default: Integration) -> Integration:
    """Return how to integrate: `default` with what the table gives."""
    options: dict[str, Any] = {}
    for name in _fields(table, Integration):
        if name == "events":
            options[name] = table.texts(name)
        else:
            options[name] = table.take(name, str if name == "method" else float)
    return replace(default, **options)


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
    _fields(table, Phase)
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
    more = {name: body.values[name] for name in _fields(body, Grasp) if name != "mass"}
    return Grasp(mass=body.positive("mass", float), **more)


def _of_numbers(table: Table, kind: Any) -> Any:
    """Return an object whose fields are all numbers."""
    return kind(**{name: table.take(name, float) for name in _fields(table, kind)})


def _fields(table: Table, kind: Any, *more: str) -> list[str]:
    """Return which fields of a class a table gives, or misses; refuse other keys."""
    own = signature(kind).parameters
    table.knows(*more, *own)
    return [name for name, f in own.items() if name in table.values or f.default is f.empty]
