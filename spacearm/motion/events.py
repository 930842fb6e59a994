"""Events: what may happen on the way, and the distance at which a singularity is met."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy

from spacearm.arrays import Array, named
from spacearm.mechanics.distance import distance_at
from spacearm.model.arguments import BaseMode, impossible
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.goal import steady
from spacearm.results import Column, Table, joint_measures
from spacearm.singularities.nearest import nearest_locally

#: What a simulation looks for.
EVENTS = ("singularity", "joint limit", "target", "wheel full")
#: All kinds of `Event`.
EVENT_KINDS = (*EVENTS, "grasp", "release", "limit exceeded", "arrived")
#: Largest joint motion [rad] or [m] between two evaluations of the event functions.
LOOK = 0.05
#: Arms without a singularity polynomial meet a singularity this far from the singular set [rad].
NEAR = float(np.radians(0.5))
#: By what factor from that a distance to first order decides; nearer to it the exact one does.
DOUBTFUL = 2.0
#: What is said of it.
CLOSE = f"{np.degrees(NEAR):g} deg from the singular set"
#: Values of an event function below this are zero at the start.
ROUNDING = 1e-12
#: Tolerance of the time of an event, as a share of the largest time.
SHARPNESS = 1e-14


class Event(NamedTuple):
    """Something that happened on the way.

    Attributes:
        t: When [s].
        kind: One of `EVENT_KINDS`. "singularity": a singular posture is met. "joint limit": a joint
            reaches an end of its range. "target": a controller's error falls to `reach`. "wheel
            full": a wheel holds as much as the law allows. "grasp": a body is grasped; in
            `Held.simulate`, a grasp bears its largest load. "release": a body is released. "limit
            exceeded": a simulated catch exceeds a limit that was planned with. "arrived": the end
            of a path is reached.
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
        return named(self)


def has_determinant(arm: SpaceArm, mode: BaseMode) -> bool:
    """Tell whether J* is square, and the task one that the arm can do somewhere."""
    return arm.task.k == arm.n and not impossible(arm, mode)


def clear_of_singularities(cfg: Configuration, mode: BaseMode, axes: Array | None = None) -> float:
    """Return the distance to the singular set less `NEAR` [rad], no more than 1."""
    distance = distance_at(cfg, mode, axes)
    if NEAR / DOUBTFUL < distance < DOUBTFUL * NEAR and is_exact(cfg.arm):
        found = nearest_locally(cfg.arm, mode, cfg.q)
        distance = distance if found is None else found[1]
    return min(distance, 1.0) - NEAR


def is_exact(arm: SpaceArm) -> bool:
    """Tell whether the distance at which the arm meets a singularity is the exact one.

    Of arms with several tips it would take long; tasks whose directions turn with the spacecraft
    have no singular set in joint space.
    """
    return arm.n > arm.task.k and len(arm.tips) == 1 and steady(arm)


def first_fall(
    values: Callable[[float], Array], before: Array, after: Array, a: float, b: float
) -> tuple[float, int] | None:
    """Return when the first of some functions falls below zero in a step, and which; None if none.

    Args:
        values: The functions of time.
        before: Their values at the end of the step before, which differ by rounding from those at
            the beginning of this one.
        after: Those at the end of the step.
        a: When the step begins.
        b: When it ends.
    """
    found = []
    for i in np.flatnonzero((before >= 0.0) & (after < 0.0)).tolist():

        def value(t: float, i: int = i) -> float:
            return float(values(t)[i])

        crosses = value(a) * value(b) <= 0.0
        found.append((scipy.optimize.brentq(value, a, b, xtol=SHARPNESS * b) if crosses else a, i))
    if not found:
        return None
    t, which = min(found)
    at = values(t)
    at[which] = max(at[which], 0.0)  # another may have fallen before, and risen again with this one
    sooner = first_fall(values, before, at, a, t) if t > a and (at < 0.0).any() else None
    return sooner if sooner and sooner[0] < t - SHARPNESS * b else (t, which)


def events_table(arm: SpaceArm, events: Sequence[Event]) -> Table:
    """Return what happened on the way of an arm."""
    columns: list[Column | str] = ["event", Column("time", "s", ".4f"), *arm.joint_names, ""]
    rows = [(e.kind, e.t, *joint_measures(e.q, arm.slides), e.detail) for e in events]
    return Table(columns, rows)
