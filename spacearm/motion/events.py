"""Events: functions of time and state whose roots are events, and the search for these roots."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from spacearm.arrays import Array, plain
from spacearm.mechanics.distance import distance_at
from spacearm.mechanics.jacobian import singular_values
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.goal import steady
from spacearm.singularities.nearest import nearest_locally
from spacearm.singularities.polynomials import NEVER

EVENTS = ("singularity", "joint limit", "target", "wheel full")
LOOK = 0.05
"""Largest joint motion [rad] or [m] between two evaluations of the event functions."""
NEAR = float(np.radians(0.5))
"""Arms without a singularity polynomial meet a singularity this far from the singular set [rad]."""
DOUBTFUL = 2.0
"""By what factor from that a distance to first order decides; nearer to it the exact one does."""
CLOSE = f"{np.degrees(NEAR):g} deg from the singular set"
"""What is said of it."""
ROUNDING = 1e-12
"""Values of an event function below this are zero at the start."""
SHARPNESS = 1e-14
"""Tolerance of the time of an event, as a share of the largest time."""

Measure: TypeAlias = Callable[[float, Array], float]
"""A function of time and state; the state begins with the n joint positions."""


class Event(NamedTuple):
    """Something that happened on the way.

    Attributes:
        t: When [s].
        kind: "singularity", "joint limit", "target" or "wheel full".
        q: (n,) joint positions then.
        detail: More about it: the name of the joint, or the measure and its value.
        nearest: (n,) the singular configuration nearest to q, at a singularity of a redundant arm
            with one tip; else None.
    """

    t: float
    kind: str
    q: Array
    detail: str
    nearest: Array | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the event as plain data, q as a list."""
        return {name: plain(value) for name, value in self._asdict().items()}


class EventFunction(NamedTuple):
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


@lru_cache(maxsize=64)
def has_determinant(arm: SpaceArm, mode: BaseMode) -> bool:
    """Tell whether J* is square, and the task one that the arm can do somewhere."""
    if arm.task.k != arm.n:
        return False
    rng = np.random.default_rng(0)
    probes = [
        singular_values(arm.at(q), mode=mode) for q in rng.uniform(-np.pi, np.pi, (32, arm.n))
    ]
    return any(sigma[-1] > NEVER * sigma[0] for sigma in probes)


def clear_of_singularities(cfg: Configuration, mode: BaseMode, axes: Array | None = None) -> float:
    """Return the distance to the singular set less `NEAR` [rad], no more than 1."""
    distance = distance_at(cfg, mode, axes)
    if NEAR / DOUBTFUL < distance < DOUBTFUL * NEAR and is_exact(cfg.arm):
        distance = exact_distance(cfg, mode, distance)
    return min(distance, 1.0) - NEAR


def is_exact(arm: SpaceArm) -> bool:
    """Tell whether the distance at which the arm meets a singularity is the exact one.

    Of arms with several tips it would take long; tasks whose directions turn with the spacecraft
    have no singular set in joint space.
    """
    return arm.n > arm.task.k and len(arm.tips) == 1 and steady(arm)


def exact_distance(cfg: Configuration, mode: BaseMode, otherwise: float = 1.0) -> float:
    """Return the distance to the part of the singular set that lies about [rad]."""
    found = nearest_locally(cfg.arm, mode, cfg.q)
    return otherwise if found is None else found[1]


def with_nearest(event: Event, arm: SpaceArm, mode: BaseMode) -> Event:
    """Add the nearest singular configuration to an event, if it is a singularity and has one."""
    if event.kind != "singularity" or not is_exact(arm):
        return event
    found = nearest_locally(arm, mode, event.q)
    return event if found is None else event._replace(nearest=found[0])


def limit_functions(arm: SpaceArm) -> list[EventFunction]:
    """Return the distance of every joint to each of its limits."""

    def distance(j: int, sign: float, limit: float) -> Measure:
        return lambda _, y: sign * (limit - float(y[j]))

    return [
        EventFunction("joint limit", name, distance(j, sign, bounds[j]), True)
        for j, name in enumerate(arm.joint_names)
        for sign, bounds in ((1.0, arm.upper), (-1.0, arm.lower))
        if np.isfinite(bounds[j])
    ]


class EventFinder:
    """The search for the events of a motion of n joints, step by step.

    Args:
        functions: The functions whose roots are events.
        n: Number of joints, whose positions begin the state.
        t: Time at which the motion starts.
        y: The state then.
    """

    def __init__(self, functions: Sequence[EventFunction], n: int, t: float, y: Array) -> None:
        self.functions, self.n = functions, n
        self.t, self.q = t, y[:n].copy()
        self.values = [function.value(t, y) for function in functions]

    def at_start(self) -> list[Event]:
        """Return the events that are already so at the start."""
        return [
            Event(self.t, function.kind, self.q, function.detail)
            for function, value in zip(self.functions, self.values, strict=True)
            if (value < 0.0 if function.falling else abs(value) <= ROUNDING)
        ]

    def in_step(self, y: Callable[[float], Array], end: float) -> list[Event]:
        """Return the events of the next step, in order.

        Args:
            y: The state in the step, a function of time.
            end: Time at which the step ends.
        """
        looks = np.linspace(self.t, end, 2 + int(np.abs(y(end)[: self.n] - self.q).max() / LOOK))
        found = []
        for start, t in pairwise(looks):
            state = y(t)
            values = [function.value(t, state) for function in self.functions]
            for function, before, after in zip(self.functions, self.values, values, strict=True):
                fell, rose = before > 0.0 >= after, before < 0.0 <= after
                if (before >= 0.0 > after) if function.falling else (fell or rose):
                    found.append(self._between(function, y, float(start), float(t)))
            self.values = values
        self.t, self.q = end, state[: self.n].copy()
        return sorted(found, key=lambda event: event.t)

    def _between(
        self, function: EventFunction, y: Callable[[float], Array], a: float, b: float
    ) -> Event:
        """Return the event between two times."""
        from scipy.optimize import brentq  # slow to import

        def value(s: float) -> float:
            return function.value(s, y(s))

        before, after = value(a), value(b)  # the last step may end with another sign, by rounding
        t = a if before * after > 0.0 else brentq(value, a, b, xtol=SHARPNESS * b)
        return Event(float(t), function.kind, y(t)[: self.n].copy(), function.detail)
