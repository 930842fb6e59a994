"""Simulations one after the other, with bodies that are grasped and released between."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, fields
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, finite, plain
from spacearm.errors import ConfigurationError
from spacearm.mechanics.dynamics import Capture, JointState, capture, generalized_velocity
from spacearm.model.arguments import of_configuration
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.controllers import Controller
from spacearm.motion.events import Event
from spacearm.motion.flights.flight import Flight
from spacearm.motion.plant import Plant
from spacearm.motion.simulation import Integration, simulate
from spacearm.motion.trajectory import Trajectory

Laws: TypeAlias = Controller | Mapping[str, Controller]


@dataclass(frozen=True, kw_only=True)
class Grasp:
    """A body that the tip grasps at the end of a phase, by a plastic impact (see `capture`).

    Attributes:
        mass: Its mass [kg].
        inertia: (3, 3) its inertia about its CM, tip axes [kg m^2]; a point mass if None.
        com: (3,) its CM in the tip frame [m].
        twist: (6,) its twist before, [velocity of its CM [m/s]; angular velocity [rad/s]], inertial
            axes; that of the tip if None: a grasp without impact.
        joints: "free" or "braked"; see `capture`.
    """

    mass: float
    inertia: npt.ArrayLike | None = None
    com: npt.ArrayLike = (0.0, 0.0, 0.0)
    twist: npt.ArrayLike | None = None
    joints: JointState = "free"

    def to_dict(self) -> dict[str, Any]:
        """Return all fields."""
        return {name: plain(getattr(self, name)) for name in self.__dataclass_fields__}


@dataclass(frozen=True)
class Release:
    """The release, at the end of a phase, of the body that was grasped last; nothing pushes it."""

    def to_dict(self) -> dict[str, Any]:
        """Return no fields."""
        return {}


@dataclass(frozen=True)
class Phase:
    """A part of a flight.

    Attributes:
        controller: As in `simulate`.
        duration: How long it is at most [s].
        then: What happens at its end. Where `stop` names events it happens at one of these only,
            and the flight ends if there was none.
        plant: As in `simulate`, for this phase.
        stop: As in `simulate`.
        period: As in `simulate`.
        delay: As in `simulate`.
        integration: As in `simulate`.
    """

    controller: Laws
    duration: float
    then: Grasp | Release | None = None
    _: KW_ONLY
    plant: Plant = Plant()
    stop: Sequence[str] = ()
    period: float | None = None
    delay: float = 0.0
    integration: Integration = Integration()

    def to_dict(self) -> dict[str, Any]:
        """Return all fields, the controller as its repr."""
        then = {type(self.then).__name__: self.then.to_dict()} if self.then else None
        rest = {f.name: plain(getattr(self, f.name)) for f in fields(self)[3:]}
        return {
            "controller": repr(self.controller), "duration": self.duration, "then": then, **rest
        }  # fmt: skip


@of_configuration
def simulate_phases(
    start: Configuration,
    phases: Sequence[Phase],
    *,
    dq: npt.ArrayLike | None = None,
    progress: Callable[[float, float], object] | None = None,
) -> Flight:
    """Simulate a free-floating arm that grasps and releases bodies in flight.

    Each phase is a run of `simulate` that begins where the last one ended. A grasp is a plastic
    impact in an instant, which keeps the momentum of arm and body together; the body then belongs
    to the arm. A release takes it away again: arm and body go on with the velocities that they
    have, and share the momentum.

    Args:
        start: The configuration at the start, as in `simulate`.
        phases: The phases, one or more.
        dq: (n,) joint rates at the start [rad/s] or [m/s]; zeros if None.
        progress: Called now and then as progress(t, duration), both simulated time [s].

    Returns:
        The runs of all phases, and what was grasped.

    Raises:
        ConfigurationError: There is no phase, a release has nothing to release, or an argument
            makes no sense.
        SpaceArmError: As `simulate` and `capture` raise.

    Example:
        >>> import numpy as np
        >>> import spacearm as sa
        >>> arm, law = sa.load("planar2"), sa.JointPD(target=[0.4, 0.9], kp=5.0, kd=5.0)
        >>> body = sa.Grasp(mass=2.0, inertia=0.1 * np.eye(3))
        >>> phases = [sa.Phase(law, 1.0, body), sa.Phase(law, 1.0, sa.Release())]
        >>> flight = sa.simulate_phases(arm.at([0.3, 1.0]), phases)
        >>> len(flight.phases), len(flight.captures)
        (2, 1)
    """
    if not phases:
        raise ConfigurationError("phases is empty; give one or more sa.Phase(controller, duration)")
    grasps = np.cumsum([isinstance(p.then, Grasp) - isinstance(p.then, Release) for p in phases])
    if grasps.min() < 0:
        raise ConfigurationError(
            f"phase {int(np.argmax(grasps < 0))} releases what nothing grasped; put a phase with "
            "then=sa.Grasp(...) before it"
        )
    total, begin, held = sum(phase.duration for phase in phases), 0.0, [start.arm]
    runs: list[Trajectory] = []
    begins, events, captures = list[float](), list[Event](), list[Capture]()
    for phase in phases:

        def report(t: float, _: float, begin: float = begin) -> None:
            if progress:
                progress(begin + t, total)

        run = simulate(
            start, phase.controller, phase.duration, dq=dq, plant=phase.plant, stop=phase.stop,
            period=phase.period, delay=phase.delay, integration=phase.integration, progress=report,
        )  # fmt: skip
        runs.append(run)
        begins.append(begin)
        events += [event._replace(t=begin + event.t) for event in run.events]
        begin += float(run.t[-1])
        if run.ended == "interrupted" or (phase.stop and run.ended == "duration"):
            break
        start, dq = run[-1], run.dq[-1]
        if isinstance(phase.then, Grasp):
            captures.append(_grasp(run, phase.then))
            held.append(captures[-1].configuration.arm)
            start, dq = _holding(held[-1], start, captures[-1].momentum), captures[-1].dq
            detail = f"{phase.then.mass:g} kg, {captures[-1].energy_lost:.3g} J lost"
            events.append(Event(begin, "grasp", run.q[-1], detail))
        elif isinstance(phase.then, Release):
            held.pop()
            start = _holding(held[-1], start, _kept(run, held[-1]))
            events.append(Event(begin, "release", run.q[-1], ""))
    return Flight(tuple(runs), np.array(begins), tuple(events), tuple(captures), runs[-1].ended)


def _holding(arm: SpaceArm, cfg: Configuration, momentum: Array) -> Configuration:
    """Return a configuration of an arm that holds something else now."""
    return arm.at(cfg.q, base=cfg.base, wheels=cfg.wheels, momentum=momentum)


def _grasp(run: Trajectory, body: Grasp) -> Capture:
    """Return the impact at the end of a phase."""
    cfg, dq = run[-1], run.dq[-1]
    twist = body.twist
    if twist is None:
        t = cfg.J @ generalized_velocity(cfg, dq)
        lever = cfg.tip.rotation @ finite(body.com, (3,), "com of the body", "[m], tip frame")
        twist = np.concatenate((t[:3] + np.cross(t[3:], lever), t[3:]))
    return capture(cfg, twist, body.mass, body.inertia, body.com, dq=dq, joints=body.joints)


def _kept(run: Trajectory, arm: SpaceArm) -> Array:
    """Return the momentum (6,) that an arm keeps which releases what it held at the end."""
    cfg = run[-1]
    v = generalized_velocity(cfg, run.dq[-1])
    kept: Array = arm.at(cfg.q, base=cfg.base).A @ v + cfg.stored
    return kept
