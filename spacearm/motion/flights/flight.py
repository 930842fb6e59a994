"""What became of the phases of a flight, one by one and as one motion."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from spacearm.arrays import Array, Result, plain, read_only
from spacearm.errors import UnsupportedError
from spacearm.mechanics.dynamics import Capture
from spacearm.model.arm import Configuration
from spacearm.motion.events import Event
from spacearm.motion.trajectory import Trajectory

SUMS = ("impulse", "work", "other_work")
"""Quantities that each phase counts from zero."""


@dataclass(frozen=True, eq=False, repr=False)
class Flight(Result):
    """What became of the phases.

    Attributes:
        phases: The trajectories, each of the arm with what it held then; their times begin at 0.
        begins: (p,) times at which they began [s].
        events: What happened, with times since the start of the flight; "grasp" and "release" too.
        captures: What each grasp did: impulse, energy lost, momenta.
        ended: Why the last phase ended.

    `motion` is all of them as one `Trajectory`.
    """

    phases: tuple[Trajectory, ...]
    begins: Array
    events: tuple[Event, ...]
    captures: tuple[Capture, ...]
    ended: str

    @cached_property
    def motion(self) -> Flown:
        """All phases as one motion, which `sa.view` plays and `sa.plot` draws."""
        return Flown.of_phases(self)

    def at(self, t: float) -> Configuration:
        """Return the configuration at a time since the start of the flight."""
        i = max(int(np.searchsorted(self.begins, t, side="right")) - 1, 0)
        return self.phases[i].at(t - self.begins[i])

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain data."""
        return {
            "phases": [run.to_dict() for run in self.phases],
            "begins": plain(self.begins),
            "events": [event.to_dict() for event in self.events],
            "captures": [taken.to_dict() for taken in self.captures],
            "ended": self.ended,
        }

    def __repr__(self) -> str:
        name, end = self.phases[0].arm.name, self.begins[-1] + self.phases[-1].t[-1]
        return f"Flight({name}: {len(self.phases)} phases, {end:.6g} s, ended by {self.ended})"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Flown(Trajectory):
    """A flight as one motion. Its configurations are of the arm with what it holds then.

    Momentum and energy jump where a body is grasped. Where a phase begins its first row is left
    out: positions are those of the last row of the phase before.

    Attributes:
        flight: The flight.
    """

    flight: Flight = field()

    @classmethod
    def of_phases(cls, flight: Flight) -> Flown:
        """Join the phases of a flight."""
        names = ("q", "base", "dq", "torque", "momentum", "wheels", "energy", *SUMS)
        joined: dict[str, Any] = {name: _joined(flight, name) for name in names}
        runs = flight.phases
        times = [begin + _rows(flight, i, "t") for i, begin in enumerate(flight.begins)]
        return cls(
            arm=runs[0].arm,
            t=np.concatenate(times),
            mode=runs[0].mode,
            exchanged=sum(run.exchanged for run in runs),
            wrenches=_wrenches(flight),
            events=flight.events,
            ended=flight.ended,
            called=tuple(dict.fromkeys(reason for run in runs for reason in run.called)),
            flight=flight,
            **joined,
        )

    @cached_property
    def tip(self) -> Array:
        """(m, 7) poses of the tip, as in `Motion`."""
        return read_only(_joined(self.flight, "tip"))

    @cached_property
    def com(self) -> Array:
        """(m, 3) positions of the system CM, with what is held [m]."""
        return read_only(_joined(self.flight, "com"))

    @cached_property
    def sigma_min(self) -> Array:
        """(m,) least singular value of the task Jacobian, with what is held."""
        return read_only(_joined(self.flight, "sigma_min"))

    @cached_property
    def distance(self) -> Array:
        """(m,) distance to the singular set [rad], with what is held."""
        return read_only(_joined(self.flight, "distance"))

    @cached_property
    def certificate(self) -> None:
        """None: each phase has a proof of its own."""
        return

    @property
    def imbalance(self) -> float:
        """The largest one of a phase."""
        return max(run.imbalance for run in self.flight.phases)

    @property
    def drift(self) -> float:
        """The largest one of a phase."""
        return max(run.drift for run in self.flight.phases)

    def at(self, t: float) -> Configuration:
        """Return the configuration at a time, of the arm with what it holds then."""
        return self.flight.at(t)

    def __getitem__(self, i: int) -> Configuration:
        counts = [len(_rows(self.flight, phase, "t")) for phase in range(len(self.flight.phases))]
        ends, row = np.cumsum(counts), range(len(self))[i]
        phase = int(np.searchsorted(ends, row, side="right"))
        return self.flight.phases[phase][row - int(ends[phase])]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Refuse: a file holds the motion of one arm.

        Raises:
            UnsupportedError: Always.
        """
        raise UnsupportedError(
            f"{path}: the arm of a flight changes; save its phases, flight.phases[0].save(path)"
        )


def _rows(flight: Flight, i: int, name: str) -> Array:
    """Return a quantity of phase i, the first row of later phases left out."""
    values: Array = getattr(flight.phases[i], name)
    return values[min(i, 1) :]


def _joined(flight: Flight, name: str) -> Array:
    """Return a quantity of all phases; of sums that begin at zero the whole."""
    parts, before = [], 0.0
    for i, run in enumerate(flight.phases):
        parts.append(_rows(flight, i, name) + before)
        if name in SUMS:
            before = before + getattr(run, name)[-1]
    return np.concatenate(parts)


def _wrenches(flight: Flight) -> dict[str, Array]:
    """Return the wrenches on each link that is pushed in any phase."""
    links = dict.fromkeys(link for run in flight.phases for link in run.wrenches)
    none = [np.zeros((len(run), 6)) for run in flight.phases]
    pairs = list(zip(flight.phases, none, strict=True))
    return {
        link: np.concatenate(
            [run.wrenches.get(link, zero)[min(i, 1) :] for i, (run, zero) in enumerate(pairs)]
        )
        for link in links
    }
