"""Control: laws that turn a configuration and its rates into joint torques.

A controller is anything that is called as controller(t, cfg, dq) and returns (n,) torques; those
here are data, so that a simulation can be written down and read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.configuration import Configuration, joint_vector
from spacearm.errors import ConfigurationError
from spacearm.jacobian import BaseMode, generalized_jacobian

Controller = Callable[[float, Configuration, Array], npt.ArrayLike]
Target: TypeAlias = npt.ArrayLike | pin.SE3 | Callable[[float], npt.ArrayLike | pin.SE3]
"""A point in the task's linear rows [m], a pose, or a function of time [s] that gives either."""


@dataclass(frozen=True)
class TransposedJacobian:
    """tau = J*^T (K_p (x_des - x) - K_d xdot), equation (42), with all rows in inertial axes.

    Attributes:
        target: Where the tip shall be: a point for tasks of linear rows only, or a pose.
        kp: Stiffness, one number or one per task row [N/m] or [N m/rad].
        kd: Damping, likewise [N s/m] or [N m s/rad].
        base: Which Jacobian: "fixed" is the law of an earth-bound arm, which on a floating one
            shows what goes wrong if the spacecraft's motion is ignored.
    """

    target: Target
    kp: npt.ArrayLike
    kd: npt.ArrayLike
    base: BaseMode = "free-floating"

    def __call__(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """(n,) torques [N m] or forces [N]."""
        J = generalized_jacobian(cfg, self.base)[cfg.arm.task.indices]
        tau: Array = J.T @ (
            np.asarray(self.kp) * self.error(t, cfg) - np.asarray(self.kd) * (J @ dq)
        )
        return tau

    def error(self, t: float, cfg: Configuration) -> Array:
        """(k,) x_des - x in the task's rows [m], [rad]."""
        target = self.target(t) if callable(self.target) else self.target
        rows, tip = cfg.arm.task.indices, cfg.tip
        error: Array
        if isinstance(target, pin.SE3):
            turn = pin.log3(target.rotation @ tip.rotation.T)
            error = np.concatenate((target.translation - tip.translation, turn))[rows]
            return error
        point = np.asarray(target, dtype=np.float64)
        if max(rows) > 2 or point.shape != (len(rows),) or not np.isfinite(point).all():
            raise ConfigurationError(
                f"target is {target!r}; the task {cfg.arm.task.names!r} takes "
                + ("a pin.SE3" if max(rows) > 2 else f"{len(rows)} finite numbers or a pin.SE3")
            )
        error = point - tip.translation[rows]
        return error


@dataclass(frozen=True)
class JointPD:
    """tau = K_p (q_des - q) - K_d dq.

    Attributes:
        target: (n,) joint positions [rad] or [m], or a function of time that gives them.
        kp: Stiffness, one number or one per joint.
        kd: Damping, likewise.
    """

    target: npt.ArrayLike | Callable[[float], npt.ArrayLike]
    kp: npt.ArrayLike
    kd: npt.ArrayLike

    def __call__(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """(n,) torques [N m] or forces [N]."""
        tau: Array = np.asarray(self.kp) * self.error(t, cfg) - np.asarray(self.kd) * dq
        return tau

    def error(self, t: float, cfg: Configuration) -> Array:
        """(n,) q_des - q [rad] or [m]."""
        target = self.target(t) if callable(self.target) else self.target
        error: Array = joint_vector(cfg.arm, target, "target") - cfg.q
        return error
