"""Events as the compiled integrator looks for them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

from spacearm.errors import ConfigurationError, unknown
from spacearm.kernels.dynamics import events as compiled
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.model.mode import BaseMode
from spacearm.motion.events import CLOSE, EVENTS, NEAR, exact_distance, has_determinant, is_exact
from spacearm.motion.runs.compiled_laws import KINDS


class CompiledEvent(NamedTuple):
    """An event that a run looks for.

    Attributes:
        kind: The kind of event.
        detail: What to say about it.
        record: Fields of the kernels' record EVENT.
        function: Its value before the bound is taken off, where Python computes it.
    """

    kind: str
    detail: str
    record: dict[str, Any]
    function: Callable[[float, Configuration], float] | None = None


def compiled_events(
    arm: SpaceArm,
    mode: BaseMode,
    kinds: Collection[str],
    stop: Collection[str],
    reach: float,
    controllers: Mapping[int, Any],
    wheels: bool,
) -> list[CompiledEvent]:
    """Return the events of some kinds as the compiled integrator looks for them.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        kinds: Names in `EVENTS`.
        stop: Those that end the run.
        reach: The distance at which a target counts as reached.
        controllers: The controllers by the number of their tip.
        wheels: Whether the wheels can be full.

    Raises:
        ConfigurationError: A kind does not exist.
    """
    for kind in kinds:
        if kind not in EVENTS:
            raise ConfigurationError(unknown("event", kind, EVENTS))
    found: list[CompiledEvent] = []

    def add(kind: str, detail: str, compiled_kind: int, falling: bool = True, index: int = 0,
            bound: float = 0.0, function: Any = None) -> None:  # fmt: skip
        record = {"kind": compiled_kind, "index": index, "bound": bound, "falling": falling}
        found.append(CompiledEvent(kind, detail, record | {"stops": kind in stop}, function))

    if "singularity" in kinds and has_determinant(arm, mode):
        add("singularity", "S = 0", compiled.DETERMINANT, falling=False)
    elif "singularity" in kinds:

        def away(_: float, cfg: Configuration) -> float:
            return exact_distance(cfg, mode)

        exact = away if is_exact(arm) else None
        add("singularity", CLOSE, compiled.SINGULAR, bound=NEAR, function=exact)
    if "joint limit" in kinds:
        for j, name in enumerate(arm.joint_names):
            for which, limit in ((compiled.UPPER, arm.upper[j]), (compiled.LOWER, arm.lower[j])):
                if np.isfinite(limit):
                    add("joint limit", name, which, index=j, bound=float(limit))
    if "target" in kinds:
        for i, (tip, law) in enumerate(controllers.items()):
            detail = f"error {reach:g}" + (f", {arm.tips[tip]}" if tip >= 0 else "")
            if type(law) in KINDS:
                add("target", detail, compiled.NEAR, index=i, bound=reach)
            elif (error := getattr(law, "error", None)) is not None:

                def miss(t: float, cfg: Configuration, error: Any = error) -> float:
                    return float(np.linalg.norm(error(t, cfg)))

                add("target", detail, compiled.FUNCTION, bound=reach, function=miss)
    if "wheel full" in kinds and wheels:
        for i, wheel in enumerate(arm.wheels):
            add("wheel full", wheel.name, compiled.FULL, index=i)
    return found
