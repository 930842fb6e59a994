"""Tracking: the torques by which an arm keeps to a motion."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, BSpline, CubicSpline, PPoly

from spacearm.arrays import Array, positive
from spacearm.mechanics.dynamics import inverse_dynamics
from spacearm.model.arm import Configuration
from spacearm.motion.controllers import Law
from spacearm.motion.motion import Motion
from spacearm.planning.result import Plan
from spacearm.planning.timing import rest_to_rest_spline, smooth
from spacearm.signatures import checked


@checked
@dataclass(frozen=True)
class Tracking(Law):
    """tau = inverse dynamics of ddq_d + 2 rate (dq_d - dq) + rate^2 (q_d - q): computed torque.

    The inverse dynamics control of Siciliano, Sciavicco, Villani & Oriolo, Robotics (2009), section
    8.5.2, DOI 10.1007/978-1-84628-642-1, with the dynamics of the floating arm.

    Where wheels bring a tumbling spacecraft to rest, the law minds their torques: `wheel_torques`,
    which `sa.simulate` takes as `wheels=`.

    q_d is a spline through the rows of the motion over time, and through their rates and
    accelerations where these are its own, as of paths that are followed; before it begins and after
    it has ended the joints hold still. Plans start and end at rest.

    Attributes:
        motion: The motion that the joints keep to.
        rate: Rate at which errors vanish, critically damped [1/s].
    """

    motion: Motion
    rate: float = 5.0

    def __post_init__(self) -> None:
        positive(self.rate, "rate", "rate [1/s]")

    @cached_property
    def _wanted(self) -> PPoly:
        motion = self.motion
        if isinstance(motion, Plan):
            return rest_to_rest_spline(motion.t, motion.q)
        begin, end = motion.t[[0, -1]]
        inner = [jump for jump in motion.jumps if begin < jump.t < end]
        if {"dq", "ddq"} <= self._known and len(motion) > 1 and not inner:
            rows = np.stack((motion.q, motion.dq, motion.ddq), axis=1)
            return PPoly.from_bernstein_basis(BPoly.from_derivatives(motion.t, rows))
        return CubicSpline(motion.t, motion.q)

    @cached_property
    def _momentum(self) -> Array:
        momentum = getattr(self.motion, "momentum", None)
        return np.zeros(6) if momentum is None else np.array(momentum[0])

    @property
    def _known(self) -> set[str]:
        """Names of what is given of the motion, not differenced."""
        return {f.name for f in fields(self.motion)}

    @cached_property
    def _wheels(self) -> BSpline | None:
        if not isinstance(self.motion, Plan) or self.motion.mode != "free-floating":
            return None
        changing = self.motion.wheels.size and np.ptp(self.motion.wheels, axis=0).any()
        return smooth(self.motion.t, self.motion.wheels) if changing else None

    def wheel_torques(self, t: float) -> Array:
        """Return the torques (w,) that the wheels take up at a time [N m]."""
        begin, end = self.motion.t[[0, -1]]
        if self._wheels is None or not begin <= t <= end:
            return np.zeros(len(self.motion.arm.wheels))
        return np.asarray(self._wheels(t, 1))

    def wanted(self, t: float) -> tuple[Array, Array, Array]:
        """Return joint positions, rates and accelerations (n,) of the motion at a time."""
        begin, end = self.motion.t[[0, -1]]
        inside = float(np.clip(t, begin, end))
        moves = float(inside == t)
        return (
            self._wanted(inside),
            moves * self._wanted(inside, 1),
            moves * self._wanted(inside, 2),
        )

    def __call__(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """Return the torques (n,) [N m] or forces [N]."""
        q, rates, ddq = self.wanted(t)
        ddq = ddq + 2.0 * self.rate * (rates - dq) + self.rate**2 * (q - cfg.q)
        wrenches = {}
        if self._wheels is not None:
            turned = cfg.arm.at(cfg.q, base=cfg.base, wheels=self.wheel_torques(t)).stored
            wrenches[cfg.arm.tree.root] = -turned  # on the spacecraft
        cfg, mode = cfg.with_momentum(self._momentum), self.motion.mode
        return inverse_dynamics(cfg, dq, ddq, mode=mode, wrenches=wrenches).tau

    def error(self, t: float, cfg: Configuration) -> Array:
        """Return q_d - q (n,) [rad] or [m]."""
        return self.wanted(t)[0] - cfg.q

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters as plain data; of the motion its story."""
        return {"motion": repr(self.motion), "rate": self.rate}
