"""Events: what is watched while a motion is integrated, and where in a step it happened."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.optimize import brentq

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, UnsupportedError, unknown
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.singularities.polynomial import singularity_polynomial
from spacearm.singularities.report import singular_values

EVENTS = ("singularity", "joint limit", "target")
LOOK = 0.05
"""Largest joint motion [rad] or [m] between two looks for events."""
NEAR = 1e-3
"""Arms without a singularity polynomial count as singular at this sigma_min over sigma_max."""
ROUNDING = 1e-12
SHARPNESS = 1e-14
"""How sharply the time of an event is found, as a share of the largest time."""

Measure: TypeAlias = Callable[[float, Array], float]
"""A function of time and state; the state begins with the n joint positions."""


class Event(NamedTuple):
    """Something that happened on the way.

    Attributes:
        t: When [s].
        kind: "singularity", "joint limit" or "target".
        q: (n,) joint positions then.
        detail: More about it: the joint, the measure.
    """

    t: float
    kind: str
    q: Array
    detail: str


class Watch(NamedTuple):
    """A function of time and state whose root is an event.

    Attributes:
        kind: The kind of event.
        detail: What to say about it.
        value: The function.
        falling: Whether only a fall through zero counts.
    """

    kind: str
    detail: str
    value: Measure
    falling: bool


def watches(
    arm: SpaceArm, mode: BaseMode, kinds: Iterable[str], miss: Measure | None, reach: float
) -> list[Watch]:
    """What to watch for events of these kinds.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        kinds: Of `EVENTS`.
        miss: How far the target is, if there is one.
        reach: How near it counts as reached.
    """
    for kind in kinds:
        if kind not in EVENTS:
            raise ConfigurationError(unknown("event", kind, EVENTS))
    found = []
    if "singularity" in kinds:
        found.append(singular(arm, mode))
    if "joint limit" in kinds:
        found += limits(arm)
    if "target" in kinds and miss is not None:
        found.append(Watch("target", f"error {reach:g}", lambda t, y: miss(t, y) - reach, True))
    return found


def singular(arm: SpaceArm, mode: BaseMode) -> Watch:
    """A root of the singularity polynomial where the arm has one, else a small sigma_min."""

    def nearness(_: float, y: Array) -> float:
        sigma = singular_values(arm.at(y[: arm.n]), mode=mode)
        return float(sigma[-1] - NEAR * sigma[0])

    try:
        S = singularity_polynomial(arm, mode=mode)
    except UnsupportedError:
        return Watch("singularity", f"sigma_min {NEAR:g} of sigma_max", nearness, True)
    return Watch("singularity", "S = 0", lambda _, y: float(S(y[: arm.n])) / S.scale, False)


def limits(arm: SpaceArm) -> list[Watch]:
    """The room that every joint has to its limits."""

    def room(j: int, sign: float, limit: float) -> Measure:
        return lambda _, y: sign * (limit - float(y[j]))

    return [
        Watch("joint limit", name, room(j, sign, bounds[j]), True)
        for j, name in enumerate(arm.joint_names)
        for sign, bounds in ((1.0, arm.upper), (-1.0, arm.lower))
        if np.isfinite(bounds[j])
    ]


class Lookout:
    """Finds the events of a motion of n joints, step by step.

    Args:
        watched: What to watch.
        n: Number of joints, whose positions begin the state.
        t: Where the motion starts.
        y: The state there.
    """

    def __init__(self, watched: Sequence[Watch], n: int, t: float, y: Array) -> None:
        self.watched, self.n = watched, n
        self.t, self.q = t, y[:n].copy()
        self.values = [watch.value(t, y) for watch in watched]

    def met(self) -> list[Event]:
        """What is so already at the start."""
        return [
            Event(self.t, watch.kind, self.q, watch.detail)
            for watch, value in zip(self.watched, self.values, strict=True)
            if (value < 0.0 if watch.falling else abs(value) <= ROUNDING)
        ]

    def step(self, y: Callable[[float], Array], end: float) -> list[Event]:
        """The events of the next step, in order."""
        looks = np.linspace(self.t, end, 2 + int(np.abs(y(end)[: self.n] - self.q).max() / LOOK))
        found = []
        for start, t in pairwise(looks):
            state = y(t)
            values = [watch.value(t, state) for watch in self.watched]
            for watch, before, after in zip(self.watched, self.values, values, strict=True):
                fell, rose = before > 0.0 >= after, before < 0.0 <= after
                if (before >= 0.0 > after) if watch.falling else (fell or rose):
                    found.append(self._between(watch, y, float(start), float(t)))
            self.values = values
        self.t, self.q = end, state[: self.n].copy()
        return sorted(found, key=lambda event: event.t)

    def _between(self, watch: Watch, y: Callable[[float], Array], a: float, b: float) -> Event:
        t = brentq(lambda s: watch.value(s, y(s)), a, b, xtol=SHARPNESS * b)
        return Event(float(t), watch.kind, y(t)[: self.n].copy(), watch.detail)
