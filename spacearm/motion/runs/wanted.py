"""The events that runs look for."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

from spacearm.equations.plant import Event
from spacearm.errors import ConfigurationError, unknown
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.model.mode import BaseMode
from spacearm.motion.events import CLOSE, EVENTS, has_determinant
from spacearm.motion.runs.setup import KINDS, RunEvent


class WantedEvent(NamedTuple):
    """An event that runs look for.

    Attributes:
        kind: The kind of event, as `Event` has it.
        detail: What to say about it.
        stops: Whether it ends the run.
        function: Which function: "distance" to the singular set, or a kind of `plant.Event`.
        number: Of the joint, wheel, or law.
        bound: What is taken off its value, or what it is taken off.
        value: The function in Python, of time and configuration, of "own".
    """

    kind: str
    detail: str
    stops: bool
    function: str
    number: int = 0
    bound: float = 0.0
    value: Callable[[float, Configuration], float] | None = None

    @property
    def run_event(self) -> RunEvent:
        """It as an event function of a run."""
        return RunEvent(Event(self.function, self.number), self.bound, self.value)

    @property
    def falling(self) -> bool:
        """Whether only a fall through zero counts."""
        return self.function != "determinant"

    @property
    def distance(self) -> bool:
        """Whether it is the distance to the singular set."""
        return self.function == "distance"


def wanted_events(
    arm: SpaceArm,
    mode: BaseMode,
    kinds: Collection[str],
    stop: Collection[str],
    reach: float,
    controllers: Mapping[int, Any],
    capacity: float | None,
) -> list[WantedEvent]:
    """Return the events of some kinds.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        kinds: Names in `EVENTS`.
        stop: Those that end the run.
        reach: The distance at which a target counts as reached.
        controllers: The controllers by the number of their tip.
        capacity: Largest momentum of a wheel; None if they cannot be full [N m s].

    Raises:
        ConfigurationError: A kind does not exist.
    """
    for kind in kinds:
        if kind not in EVENTS:
            raise ConfigurationError(unknown("event", kind, EVENTS))
    found: list[WantedEvent] = []

    def add(kind: str, detail: str, function: str, *values: Any) -> None:
        found.append(WantedEvent(kind, detail, kind in stop, function, *values))

    if "singularity" in kinds and has_determinant(arm, mode):
        add("singularity", "S = 0", "determinant")
    elif "singularity" in kinds:
        add("singularity", CLOSE, "distance")
    if "joint limit" in kinds:
        for j, name in enumerate(arm.joint_names):
            for which, limit in (("upper", arm.upper[j]), ("lower", arm.lower[j])):
                if np.isfinite(limit):
                    add("joint limit", name, which, j, float(limit))
    if "target" in kinds:
        for i, (tip, law) in enumerate(controllers.items()):
            detail = f"error {reach:g}" + (f", {arm.tips[tip]}" if tip >= 0 else "")
            if type(law) in KINDS:
                add("target", detail, "target", i, reach)
            elif (error := getattr(law, "error", None)) is not None:

                def miss(t: float, cfg: Configuration, error: Any = error) -> float:
                    return float(np.linalg.norm(error(t, cfg)))

                add("target", detail, "own", i, reach, miss)
    if "wheel full" in kinds and capacity is not None:
        for i, wheel in enumerate(arm.wheels):
            add("wheel full", wheel.name, "wheel", i, capacity)
    return found
