"""Equations of motion of an arm under a controller, in the reduced state (q, dq, attitude, work).

The spacecraft's twist follows from momentum at every instant and its position from the system CM,
which moves uniformly: momentum is kept by construction.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, NoSolutionError, SpaceArmError
from spacearm.mechanics.dynamics import forward_dynamics, kinetic_energy, spacecraft_twist
from spacearm.mechanics.floating import quaternion_rate
from spacearm.mechanics.momentum import momentum_matrix, momentum_vector
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration, kinematics
from spacearm.model.joints import joint_vector
from spacearm.model.mode import BaseMode, free_components
from spacearm.motion.controllers import Controller
from spacearm.motion.events import Measure
from spacearm.motion.motion import samples


class ControlledArm:
    """The equations of motion of one arm under one controller."""

    def __init__(
        self,
        arm: SpaceArm,
        controller: Controller,
        mode: BaseMode,
        momentum: npt.ArrayLike | None,
        start: Configuration,
    ) -> None:
        free_components(mode)
        self.arm, self.controller, self.mode, self.start = arm, controller, mode, start
        self.h, self.mass = momentum_vector(momentum), arm.mass
        if mode == "fixed" and self.h.any():
            raise ConfigurationError(f"momentum is {momentum!r}; a fixed spacecraft takes it up")

    def configuration(self, t: float, y: Array) -> tuple[Configuration, Array]:
        """Return the configuration and the joint rates in a state."""
        n = self.arm.n
        q, dq, quaternion = y[:n].copy(), y[n : 2 * n], y[2 * n : 2 * n + 4]
        if self.mode == "fixed":
            return self.arm.at(q, base=self.start.base), dq
        attitude = pin.Quaternion(quaternion / np.linalg.norm(quaternion))
        turned = kinematics(self.arm, q, pin.SE3(attitude, np.zeros(3)))
        return turned.centred(self.start.com + self.h[:3] / self.mass * t), dq

    def torques(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """Return what the controller asks for, checked.

        Raises:
            NoSolutionError: The controller failed, or gave no torques.
        """
        try:
            tau = self.controller(t, cfg, dq)
            return joint_vector(self.arm, tau, "the controller's torque")
        except SpaceArmError as error:
            q = ", ".join(f"{x:.6g}" for x in cfg.q)
            raise NoSolutionError(f"at t = {t:.6g} s, q = ({q}): {error}") from None

    @property
    def miss(self) -> Measure | None:
        """Distance to the target as a function of time and state, None without a target."""
        error = getattr(self.controller, "error", None)
        if error is None:
            return None
        return lambda t, y: float(np.linalg.norm(error(t, self.configuration(t, y)[0])))

    def rate(self, t: float, y: Array) -> Array:
        """Return the rate of the state (q, dq, attitude quaternion, work)."""
        cfg, dq = self.configuration(t, y)
        tau = self.torques(t, cfg, dq)
        motion = forward_dynamics(cfg, dq, tau, mode=self.mode, momentum=self.h)
        turning = quaternion_rate(y[2 * self.arm.n :][:4], motion.twist[3:])
        return np.concatenate((dq, motion.ddq, turning, [tau @ dq]))

    def along(self, t: Array, states: Array) -> dict[str, Any]:
        """Return the fields of a `Trajectory` that follow from the states (m, ...) at times t."""
        cfgs, rates, torques, momenta, energies = [], [], [], [], []
        for s, y in zip(t, states, strict=True):
            cfg, dq = self.configuration(s, y)
            matrix = momentum_matrix(cfg)
            twist = spacecraft_twist(cfg, dq, self.mode, self.h)
            cfgs.append(cfg)
            rates.append(dq)
            torques.append(self.torques(s, cfg, dq))
            momenta.append(matrix.A_b @ twist + matrix.A_q @ dq)
            energies.append(kinetic_energy(cfg, dq, mode=self.mode, momentum=self.h))
        return {
            "arm": self.arm,
            "mode": self.mode,
            "t": t,
            **samples(cfgs),
            "dq": np.array(rates),
            "torque": np.array(torques),
            "momentum": np.array(momenta),
            "energy": np.array(energies),
            "work": states[:, -1].copy(),
        }
