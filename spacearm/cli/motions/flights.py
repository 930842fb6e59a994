"""The phases of a flight from a TOML file, and what is printed of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.cli.motions.laws import KINDS, MORE, Law
from spacearm.cli.output import (
    out,
    print_json,
    say_stopped,
    table,
    vector,
    working,
    write_picture,
)
from spacearm.cli.wording import INTERRUPTED
from spacearm.errors import ConfigurationError, unknown
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.controllers import Controller
from spacearm.motion.events import EVENTS
from spacearm.motion.flights import Flight, Grasp, Phase, Release, simulate_phases
from spacearm.motion.goal import goal_of
from spacearm.motion.plant import Integration, PassiveJoint, Plant, WheelHold, Wrench
from spacearm.sweeps.toml import Table, parse

LAW = ("law", "target", "earthbound", *sorted({name for names in MORE.values() for name in names}))
"""Keys of a controller."""
NUMBERS = ("reach", "rtol", "atol", "dt")
RATE = ("period", "delay")
"""Keys of `Integration` and of `Phase` that are numbers."""
HOLD = ("stiffness", "damping", "torque", "capacity")
BODY = ("mass", "inertia", "com", "twist", "joints")


def read_phases(path: Path, arm: SpaceArm) -> list[Phase]:
    """Return the phases in a file.

    Raises:
        ConfigurationError: It cannot be read, or a value makes no sense.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"--phases {path} cannot be read: {error}") from None
    whole = parse(text, path.name)
    whole.knows("phase")
    listed = whole.values.get("phase", [])
    if not isinstance(listed, list) or not listed:
        raise whole.fail("phase", "give one or more tables [[phase]]")
    return [_phase(Table(f"phase {i}", values), arm) for i, values in enumerate(listed)]


def _phase(given: Table, arm: SpaceArm) -> Phase:
    given.knows(*LAW, "tips", "duration", "grasp", "release", "limits", "passive", "wheels",
                "wrenches", "thrusters", "stop", *RATE, *NUMBERS, "events", "method")  # fmt: skip
    numbers = {k: given.take(k, float) for k in (*NUMBERS, *RATE) if k in given.values}
    timing = {k: numbers.pop(k) for k in RATE if k in numbers}
    return Phase(
        _laws(given, arm),
        given.positive("duration", float),
        _then(given),
        plant=_plant(given),
        stop=_names(given, "stop"),
        integration=Integration(
            events=_names(given, "events") if "events" in given.values else EVENTS,
            method=given.take("method", str, "auto"),
            **numbers,
        ),
        **timing,
    )


def _plant(given: Table) -> Plant:
    """Return what acts on the arm in a phase."""
    options: dict[str, Any] = {}
    for name in ("wrenches", "thrusters"):
        if name in given.values:
            pushed = Table(f"{given.where}: {name}", given.values[name])
            options[name] = {link: _wrench(pushed, link) for link in pushed.values}
    if "passive" in given.values:
        options["passive"] = _passive(given)
    if "wheels" in given.values:
        held = Table(f"{given.where}: wheels", given.values["wheels"])
        held.knows(*HOLD)
        more = {k: held.take(k, float) for k in HOLD[2:] if k in held.values}
        options["wheels"] = WheelHold(
            stiffness=held.take("stiffness", float), damping=held.take("damping", float), **more
        )
    return Plant(limits=given.take("limits", bool, False), **options)


def _laws(given: Table, arm: SpaceArm) -> Controller | Mapping[str, Controller]:
    """Return the controller of a phase, or one for each tip."""
    if "tips" not in given.values:
        return _law(given, arm)
    if stray := [key for key in LAW if key in given.values]:
        raise given.fail(stray[0], "tips have laws of their own; leave it out")
    tips = Table(f"{given.where}: tips", given.values["tips"])
    if not tips.values:
        raise given.fail("tips", "give a table for each tip that has a law")
    laws = {name: Table(f"{tips.where}: {name}", tips.values[name]) for name in tips.values}
    for own in laws.values():
        own.knows(*LAW)
    return {name: _law(own, arm) for name, own in laws.items()}


def _law(given: Table, arm: SpaceArm) -> Controller:
    names = [law.value for law in Law]
    if (name := given.take("law", str, Law.TRANSPOSED.value)) not in names:
        raise given.fail("law", unknown("law", name, names))
    law = Law(name)
    kind: Any = KINDS[law]
    for key in LAW[3:]:
        if key in given.values and key not in MORE[law]:
            raise given.fail(key, f"{law.value} takes {', '.join(MORE[law])}")
    own = {key: _numbers(given, key) for key in MORE[law] if key in given.values}
    own = {key: value if key == "rest" else np.squeeze(value)[()] for key, value in own.items()}
    target = _numbers(given, "target")
    try:
        if law is Law.JOINTS:
            if "earthbound" in given.values:
                raise given.fail("earthbound", "joints sees no Jacobian; leave it out")
            return kind(target=target, **own)
        mode = "fixed" if given.take("earthbound", bool, False) else "free-floating"
        return kind(target=goal_of(arm, target, "target"), mode=mode, **own)
    except TypeError:
        raise given.fail(MORE[law][0], f"{law.value} needs {' and '.join(MORE[law])}") from None


def _then(given: Table) -> Grasp | Release | None:
    """Return what happens at the end of a phase."""
    if "grasp" not in given.values:
        return Release() if given.take("release", bool, False) else None
    if "release" in given.values:
        raise given.fail("release", "a phase ends with one of grasp and release; add a phase")
    body = Table(f"{given.where}: grasp", given.values["grasp"])
    body.knows(*BODY)
    return Grasp(mass=body.positive("mass", float),
                 **{k: body.values[k] for k in BODY[1:] if k in body.values})  # fmt: skip


def _passive(given: Table) -> dict[str, PassiveJoint] | str:
    """Return springs, damping and friction by joint, or "described"."""
    value = given.values["passive"]
    if isinstance(value, str):
        return value
    joints = Table(f"{given.where}: passive", value)
    own = {name: Table(f"{joints.where}: {name}", joints.values[name]) for name in joints.values}
    for one in own.values():
        one.knows(*PassiveJoint._fields)
    return {n: PassiveJoint(**{k: t.take(k, float) for k in t.values}) for n, t in own.items()}


def _wrench(given: Table, link: str) -> Wrench:
    """Return a wrench, or one that changes at given times."""
    value = given.values[link]
    if not isinstance(value, Mapping):
        return _numbers(given, link)
    pieces = Table(f"{given.where}: {link}", value)
    pieces.knows("times", "values")
    times, values = _numbers(pieces, "times"), pieces.values.get("values")
    if not isinstance(values, list) or len(values) != len(times) or (np.diff(times) <= 0.0).any():
        raise pieces.fail("values", "give as many wrenches as growing times, each from then on")
    rows = [_numbers(Table(pieces.where, {"values": row}), "values") for row in values]
    if any(len(row) != 6 for row in rows):
        raise pieces.fail("values", "give 6 numbers each, force [N] and torque [N m]")

    def wrench(t: float) -> npt.ArrayLike:
        now = int(np.searchsorted(times, t, side="right")) - 1
        return rows[now] if now >= 0 else np.zeros(6)

    return wrench


def _numbers(given: Table, key: str) -> Array:
    """Return a number or a list of them, as an array (m,)."""
    value = given.values.get(key)
    listed = value if isinstance(value, list) else [value]
    if not listed or any(type(number) not in (int, float) for number in listed):
        raise given.fail(key, "give a number, or a list of numbers")
    return np.array(listed, dtype=np.float64)


def _names(given: Table, key: str) -> list[str]:
    value = given.values.get(key, [])
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise given.fail(key, "give a list of names")
    return value


def fly(
    start: Configuration,
    phases: list[Phase],
    dq: Array | None,
    save: Path | None,
    output: Path | None,
    view: bool,
    as_json: bool,
) -> int:
    """Simulate the phases, print, save, draw and show them; return the exit code.

    Files get the number of their phase.
    """
    with working("simulating") as progress:
        flight = simulate_phases(start, phases, dq=dq, progress=progress)
    if as_json:
        print_json(flight.to_dict())
    else:
        print_flight(flight)
    for i, run in enumerate(flight.phases):
        if save:
            run.save(save.with_stem(f"{save.stem}_{i}"))
        if output:
            from spacearm.plots.motions import draw_motion

            write_picture(output.with_stem(f"{output.stem}_{i}"), draw_motion(run, None))
    if view:
        from spacearm.cli.views import serve_until_interrupted
        from spacearm.viewer.show import view as show

        serve_until_interrupted(show(flight, open=False))
    if flight.ended == "interrupted":
        say_stopped(f"{len(flight.phases)} of {len(phases)} phases simulated")
        return INTERRUPTED
    return 0


def print_flight(flight: Flight) -> None:
    """Print the phases and what happened."""
    end = flight.begins[-1] + flight.phases[-1].t[-1]
    out.print(f"{flight.phases[0].arm.name}: {end:.6g} s, ended by {flight.ended}")
    rows = table("phase", "from [s]", "to [s]", "ended by", "tip at the end [m]", "energy off by")
    for i, (run, begin) in enumerate(zip(flight.phases, flight.begins, strict=True)):
        tip = vector(run[-1].tip.translation) if len(run.arm.tips) == 1 else "several"
        rows.add_row(str(i), f"{begin:.4g}", f"{begin + run.t[-1]:.4g}", run.ended, tip,
                     f"{run.imbalance:.1e}")  # fmt: skip
    out.print(rows)
    if flight.events:
        rows = table("event", "time [s]", "")
        for event in flight.events:
            rows.add_row(event.kind, f"{event.t:.4f}", event.detail)
        out.print(rows)
