"""Limits of a catch along its simulation: each with its largest value, and when it is exceeded.

The values are those of all recorded samples of a phase. Where a value is larger than both of its
neighbours, the parabola through the three gives the peak between the samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array, Booleans
from spacearm.model.arguments import HELD
from spacearm.model.arm import SpaceArm
from spacearm.motion.events import Event
from spacearm.motion.flights import CLEARANCE, AnyFlight, Flight, LimitCheck
from spacearm.motion.motion import Trajectory
from spacearm.planning.reactions import Wheels

#: Share of a limit up to which a simulation may exceed it by the errors of its integration.
TOLERANCE = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class CatchLimits:
    """The limits that a catch was planned with.

    Attributes:
        rates: (n,) largest joint rates [rad/s] or [m/s].
        torques: (n,) largest joint torques [N m] or forces [N].
        loads: (2,) largest force [N] and moment [N m] at each tip.
        positions: Whether the joint limits must hold.
        clearance: Least distance to the singular set [rad]; None where none was asked for.
        wheels: The wheels with their limits; None where the spacecraft has none.
    """

    rates: Array
    torques: Array
    loads: Array
    positions: bool
    clearance: float | None
    wheels: Wheels | None


class Limited(NamedTuple):
    """A limited quantity over time.

    Attributes:
        limit: What is limited.
        unit: Its unit.
        allowed: Its largest value.
        values: (m,) its values.
    """

    limit: str
    unit: str
    allowed: float
    values: Array


def with_checks(flight: AnyFlight, limits: CatchLimits) -> AnyFlight:
    """Return a flight with its limits checked; limits that are exceeded are events, too.

    Args:
        flight: The flight.
        limits: The limits.
    """
    found: dict[str, LimitCheck] = {}
    for i, (begin, run) in enumerate(zip(flight.begins, flight.phases, strict=True)):
        for series in _series(flight, i, run, limits):
            if not np.isfinite(series.allowed):
                continue
            check = _checked(series, begin + run.t)
            known = found.get(check.limit)
            found[check.limit] = check if known is None else known.worse(check)
    checks = tuple(found.values())
    events = [
        Event(check.exceeded, "limit exceeded", flight.at(check.exceeded).q, check.summary)
        for check in checks
        if check.exceeded is not None
    ]
    every = sorted([*flight.events, *events], key=lambda event: event.t)
    return replace(flight, limits=checks, events=tuple(every))


def _series(flight: Flight, i: int, run: Trajectory, limits: CatchLimits) -> Iterator[Limited]:
    """Yield the limited quantities of phase i."""
    arm = flight.arm
    slides = np.array(arm.slides)
    for j, name in enumerate(arm.joint_names):
        unit = "m/s" if slides[j] else "rad/s"
        yield Limited(f"rate of {name}", unit, float(limits.rates[j]), np.abs(run.dq[:, j]))
    for j, name in enumerate(arm.joint_names):
        unit = "N" if slides[j] else "N m"
        yield Limited(f"torque of {name}", unit, float(limits.torques[j]), np.abs(run.torque[:, j]))
    if limits.positions:
        yield from _positions(arm, slides, run.q)
    if np.isfinite(limits.loads).any():
        yield from _loads(flight, i, limits.loads)
    if limits.wheels is not None and arm.wheels and run.mode != HELD:
        for w, wheel in enumerate(arm.wheels):
            most, torque = limits.wheels.capacity[w], limits.wheels.torque[w]
            yield Limited(
                f"momentum of wheel {wheel.name}", "N m s", float(most), np.abs(run.wheels[:, w])
            )
            yield Limited(
                f"torque of wheel {wheel.name}", "N m", float(torque),
                np.abs(run.wheel_torque[:, w]),
            )  # fmt: skip
    if limits.clearance is not None:
        yield Limited(CLEARANCE, "rad", limits.clearance, flight.phase_distances(i))


def _loads(flight: Flight, i: int, most: Array) -> Iterator[Limited]:
    """Yield force and moment at each tip in phase i; `most` (2,) are the largest."""
    arm, run = flight.arm, flight.phases[i]
    wrenches = flight.phase_wrenches(i).reshape(len(run), len(arm.tips), 2, 3)
    loads = np.linalg.norm(wrenches, axis=3)
    for k, tip in enumerate(arm.tips):
        of = f" of {tip}" if len(arm.tips) > 1 else ""
        for what, unit, allowed, values in (
            (f"force at the grapple{of}", "N", most[0], loads[:, k, 0]),
            (f"moment about the grapple{of}", "N m", most[1], loads[:, k, 1]),
        ):
            yield Limited(what, unit, float(allowed), values)


def _positions(arm: SpaceArm, slides: Booleans, q: Array) -> Iterator[Limited]:
    """Yield the joint positions as far as they have limits."""
    for j, name in enumerate(arm.joint_names):
        unit = "m" if slides[j] else "rad"
        if np.isfinite(arm.upper[j]) and np.isfinite(arm.lower[j]):
            middle = 0.5 * (arm.upper[j] + arm.lower[j])
            half = 0.5 * (arm.upper[j] - arm.lower[j])
            yield Limited(
                f"{name} from the middle of its range", unit, float(half), np.abs(q[:, j] - middle)
            )
        elif np.isfinite(arm.upper[j]):
            yield Limited(f"{name} above its upper limit", unit, 0.0, q[:, j] - arm.upper[j])
        elif np.isfinite(arm.lower[j]):
            yield Limited(f"{name} below its lower limit", unit, 0.0, arm.lower[j] - q[:, j])


def _checked(series: Limited, t: Array) -> LimitCheck:
    """Return the largest value of a quantity at times t (m,), and when its limit is exceeded."""
    sign = -1.0 if series.limit == CLEARANCE else 1.0
    values, allowed = sign * series.values, sign * series.allowed
    slack = TOLERANCE * (abs(allowed) or 1.0)
    when, peak = _peak(t, values)
    over = values > allowed + slack
    first = None
    if over.any():
        first = _crossing(t, values, allowed, int(over.argmax()))
    elif peak > allowed + slack:
        first = when
    return LimitCheck(series.limit, sign * peak, series.allowed, series.unit, when, first)


def _crossing(t: Array, values: Array, allowed: float, i: int) -> float:
    """Return when values exceed a limit that they exceed first at sample i."""
    if i == 0 or not np.isfinite(values[i - 1]):
        return float(t[i])
    share = (allowed - values[i - 1]) / (values[i] - values[i - 1])
    return float(t[i - 1] + max(share, 0.0) * (t[i] - t[i - 1]))


def _peak(t: Array, values: Array) -> tuple[float, float]:
    """Return time and size of the largest value, between the samples too."""
    i = int(values.argmax())
    best = float(t[i]), float(values[i])
    if not 0 < i < len(t) - 1 or not np.isfinite(values[i - 1 : i + 2]).all():
        return best
    x, y = t[i - 1 : i + 2] - t[i], values[i - 1 : i + 2] - values[i]
    left, right = y[0] / x[0], y[2] / x[2]
    bend = (right - left) / (x[2] - x[0])
    slope = left - bend * x[0]
    if bend >= 0.0:
        return best
    off = -0.5 * slope / bend
    return float(t[i] + off), float(values[i] + 0.5 * slope * off)
