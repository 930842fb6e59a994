"""Limits of a joint motion along a path: rates, accelerations and torques of the motors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, finite
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.mechanics.dynamics import inverse_dynamics
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.planning.reactions import Wheels, momentum_and_torque
from spacearm.planning.timing import largest_rates


@dataclass(frozen=True)
class Limits:
    """The limits of a motion, infinite where there is none.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
        rate: (n,) largest joint rates [rad/s] or [m/s].
        acceleration: (n,) largest joint accelerations [rad/s^2] or [m/s^2].
        torque: (n,) largest torques [N m] or forces [N].
        wheels: The wheels that hold the attitude; None if none do.
    """

    arm: SpaceArm
    mode: BaseMode
    rate: Array
    acceleration: Array
    torque: Array
    wheels: Wheels | None = None

    @classmethod
    def of(
        cls,
        arm: SpaceArm,
        mode: BaseMode,
        rate: npt.ArrayLike | None,
        acceleration: npt.ArrayLike | None,
        torque: npt.ArrayLike | None,
        wheels: Wheels | None = None,
    ) -> Limits:
        """Return the limits given, those of the description in place of None.

        Raises:
            ConfigurationError: One is no positive number, nor one per joint.
            UnsupportedError: Neither accelerations nor torques have limits.
        """
        efforts = np.array([arm.tree.joints[name].effort for name in arm.joint_names])
        found = cls(
            arm=arm,
            mode=mode,
            rate=_bounds(arm, rate, "rate", largest_rates(arm)),
            acceleration=_bounds(arm, acceleration, "acceleration", np.full(arm.n, np.inf)),
            torque=_bounds(arm, torque, "torque", np.where(efforts > 0.0, efforts, np.inf)),
            wheels=wheels,
        )
        unlimited = np.isinf(found.acceleration) & np.isinf(found.torque)
        if unlimited.any():
            name = arm.joint_names[int(unlimited.argmax())]
            raise UnsupportedError(
                f"{arm.name}: nothing limits how fast joint {name!r} changes its rate: its "
                "description gives no effort; give torque or acceleration"
            )
        return found

    def load(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the shares of the limits that accelerations (n,) take.

        Torques come first, those of wheels last.
        """
        tau = inverse_dynamics(self.arm.at(q), dq, ddq, mode=self.mode).tau
        used, most = np.append(tau, ddq), np.append(self.torque, self.acceleration)
        if self.wheels is not None:
            spun = momentum_and_torque(self.arm, q[None], dq[None], ddq[None])[1][0]
            used = np.append(used, self.wheels.shares @ spun)
            most = np.append(most, self.wheels.torque)
        return np.asarray(used / most)[np.isfinite(most)]

    def fastest(self, q: Array, slope: Array) -> Array:
        """Return the rates (m,) of a path's parameter at which joints or wheels are at a limit.

        Args:
            q: (m, n) joint positions on the path.
            slope: (m, n) their derivative by the parameter.
        """
        with np.errstate(divide="ignore"):
            found = (self.rate / np.abs(slope)).min(axis=1)
        if self.wheels is None:
            return found
        taken = momentum_and_torque(self.arm, q, slope, np.zeros_like(slope))[0]
        return np.minimum(found, self.wheels.fastest(taken))

    def slowdown(self, q: Array, dq: Array, ddq: Array) -> float:
        """Return the factor by which a motion (m, n) must be slower for the limits to hold.

        At zero momentum and without gravity torques fall with its square.
        """
        rate = (np.abs(dq) / self.rate).max()
        load = max(np.abs(self.load(*row)).max() for row in zip(q, dq, ddq, strict=True))
        return float(max(rate, np.sqrt(load)))


def _bounds(arm: SpaceArm, given: npt.ArrayLike | None, name: str, default: Array) -> Array:
    """Return a limit for each joint (n,)."""
    if given is None:
        return default
    shape = (arm.n,) if np.iterable(given) else ()
    bounds = finite(given, shape, name, "(the largest one, for all joints or for each)")
    if not (bounds > 0.0).all():
        raise ConfigurationError(f"{name} is {given!r}; give positive numbers")
    return np.broadcast_to(bounds, arm.n)
