"""Trajectory: the motion of an arm under torques, with its balances of energy and momentum."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from spacearm.arrays import Array
from spacearm.mechanics.jacobian import momentum_matrix
from spacearm.model.arguments import free_components
from spacearm.model.arm import Configuration
from spacearm.motion.events import Event
from spacearm.motion.motion import Motion
from spacearm.motion.motion_file import Quantity
from spacearm.notebook.tables import table

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Trajectory(Motion):
    """The motion of an arm under joint torques, from `sa.simulate`: a `Motion` with more to it.

    Attributes:
        dq: (m, n) joint rates [rad/s] or [m/s].
        torque: (m, n) joint torques [N m] or forces [N].
        momentum: (m, 6) [linear [kg m/s]; angular about the system CM [kg m^2/s]], inertial axes.
        impulse: (m, 6) what external wrenches added to the momentum since the start.
        wrenches: (m, 6) [force [N]; torque [N m]] on each link that wrenches or thrusters push, by
            its name: at the origin of its frame, inertial axes.
        wheels: (m, w) what each wheel holds [N m s].
        energy: (m,) kinetic energy without the spin of wheels [J].
        work: (m,) work of the torques since the start [J].
        other_work: (m,) work of springs, friction, wrenches and the wheels' motors since the start,
            on all but the spin of the wheels [J].
        exchanged: Work that was done and taken back, all in all [J].
        events: What happened on the way.
        ended: Why it ended: "duration", the kind of the event that stopped it, or what failed.
        called: The functions that were called in Python, which takes long, and why.
    """

    dq: Array = field()
    torque: Array
    momentum: Array
    impulse: Array
    wrenches: Mapping[str, Array] = field(default_factory=dict)
    wheels: Array
    energy: Array
    work: Array
    other_work: Array
    exchanged: float
    events: tuple[Event, ...]
    ended: str
    called: tuple[str, ...] = field(default=(), metadata={"in_file": False})

    QUANTITIES: ClassVar[Mapping[str, Quantity]] = {
        **Motion.QUANTITIES,
        "torque": Quantity("N m or N", "joint"),
        "momentum": Quantity("kg m/s, kg m^2/s", "component"),
        "impulse": Quantity("kg m/s, kg m^2/s", "component"),
        "wheels": Quantity("N m s", "wheel"),
        "energy": Quantity("J"),
        "work": Quantity("J"),
        "other_work": Quantity("J"),
    }

    def __getitem__(self, i: int) -> Configuration:
        cfg, kept = super().__getitem__(i), free_components(self.mode)
        momentum = np.zeros(6)
        momentum[:kept] = self.momentum[0, :kept] + self.impulse[i, :kept]
        return self.arm.at(cfg.q, base=cfg.base, wheels=self.wheels[i], momentum=momentum)

    @property
    def story(self) -> str:
        """What the spacecraft did and how the motion ended, in one line."""
        return super().story if self.ended == "duration" else f"{self.mode}: ended by {self.ended}"

    @property
    def singular_times(self) -> tuple[float, ...]:
        """Times of the singularities on the way [s]."""
        return tuple(event.t for event in self.events if event.kind == "singularity")

    @property
    def turnover(self) -> float:
        """The energies that came and went [J]: the largest there was, and all work."""
        return float(self.energy.max() + self.exchanged)

    @property
    def imbalance(self) -> float:
        """Largest difference of energy and work, over the turnover."""
        off = float(np.abs(self.energy - self.energy[0] - self.work - self.other_work).max())
        return off / self.turnover if self.turnover > 0.0 else 0.0

    @property
    def drift(self) -> float:
        """Largest change of the momentum that is kept, over what the joints alone brought."""
        f = free_components(self.mode)
        rates = zip(self, self.dq, strict=True)
        brought = [momentum_matrix(cfg).A_q[:f] @ dq for cfg, dq in rates]
        change = np.abs((self.momentum - self.impulse - self.momentum[0])[:, :f]).max(initial=0.0)
        most = np.abs([*brought, self.momentum[0, :f], *self.impulse[:, :f]]).max(initial=0.0)
        return float(change / most) if most > 0.0 else 0.0

    def to_xarray(self) -> xr.Dataset:
        """Return all quantities as labelled arrays; wrenches along "link"."""
        data = super().to_xarray()
        if not self.wrenches:
            return data
        values = np.stack([*self.wrenches.values()], axis=1)
        units = {"units": "N, N m"}
        data = data.assign_coords(link=[*self.wrenches])
        return data.assign(wrenches=(("t", "link", "component"), values, units))

    def to_dict(self) -> dict[str, Any]:
        """Return all fields and quantities as plain data, with the balances of both audits."""
        return super().to_dict() | {"imbalance": self.imbalance, "drift": self.drift}

    def _tables(self) -> tuple[str, ...]:
        energies = [
            ("kinetic energy [J]", self.energy[0], self.energy[-1]),
            ("work of the torques [J]", self.work[0], self.work[-1]),
        ]
        events = [(event.kind, event.t, event.detail) for event in self.events]
        return (
            *super()._tables(),
            table(("", "start", "end"), energies),
            table(("event", "t [s]", ""), events or [("none", "", "")]),
        )

    def __repr__(self) -> str:
        first = f", first {self.events[0].kind} at {self.events[0].t:.4g} s" if self.events else ""
        called = "".join(f"; {reason}" for reason in self.called)
        return (
            f"Trajectory({self.arm.name}, {self.mode}: {self.t[-1]:.6g} s, {len(self.t)} times, "
            f"ended by {self.ended}{first}{called})"
        )
