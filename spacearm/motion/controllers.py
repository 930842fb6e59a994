"""Control: laws that turn a configuration and its rates into joint torques.

A controller is anything that is called as controller(t, cfg, dq) and returns (n,) torques; those
here are data, so that a simulation can be written down and read. `mode` says which Jacobian a law
believes in: "fixed" is the law of an earth-bound arm, which on a floating one shows what goes wrong
if the spacecraft's motion is ignored.

Some laws ask for joint rates. Their torques then come from inverse dynamics, which let the rates
follow with the time constant 1 / `servo`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, positive
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.mechanics.dynamics import inverse_dynamics
from spacearm.mechanics.jacobian import generalized_jacobian
from spacearm.model.configuration import Configuration
from spacearm.model.joints import joint_vector
from spacearm.model.mode import BaseMode
from spacearm.motion.goal import Goal, goal_pose, in_rows, miss, out_of_reach, twist_between
from spacearm.singularities.report import NO_INVERSE

Controller = Callable[[float, Configuration, Array], npt.ArrayLike]
Target: TypeAlias = Goal | Callable[[float], Goal]
"""A goal, or a function of time [s] that gives one: a moving target, or a path and the speed."""

INSTANT = 1e-6
"""Half the time over which the velocity of a moving target is taken [s]."""


@dataclass(frozen=True, kw_only=True)
class TipLaw(ABC):
    """What the laws that lead the tip have in common.

    They assume zero momentum. Where `simulate` is given some, the drift J_b A_b^-1 h of the tip is
    a disturbance to them, which leaves an error.

    Attributes:
        target: Where the tip shall be: a point for tasks of linear rows only, along the goal axes
            (see `follow`), a pose, or a function of time that gives either.
        mode: Which Jacobian.
    """

    target: Target
    mode: BaseMode = "free-floating"

    @abstractmethod
    def __call__(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """(n,) torques [N m] or forces [N]."""

    def goal(self, t: float) -> Goal:
        """The target at a time."""
        return self.target(t) if callable(self.target) else self.target

    def error(self, t: float, cfg: Configuration) -> Array:
        """(k,) x_des - x in the task's rows [m], [rad]."""
        return miss(cfg, self.goal(t))

    def feed(self, t: float, cfg: Configuration) -> Array:
        """(k,) velocity of the target in the task's rows."""
        if not callable(self.target):
            return np.zeros(cfg.arm.task.k)
        before, after = (goal_pose(cfg, self.goal(t + s)) for s in (-INSTANT, INSTANT))
        return in_rows(cfg, twist_between(before, after)) / (2.0 * INSTANT)

    def jacobian(self, cfg: Configuration) -> Array:
        """(k, n) rows of J* that the task names."""
        return in_rows(cfg, generalized_jacobian(cfg, mode=self.mode))


@dataclass(frozen=True, kw_only=True)
class TransposedJacobian(TipLaw):
    """tau = J*^T (K_p (x_des - x) + K_d (xdot_des - xdot)), equation (42), xdot_des zero there.

    Attributes:
        kp: Stiffness, one number or one per task row [N/m] or [N m/rad].
        kd: Damping, likewise [N s/m] or [N m s/rad].
    """

    kp: npt.ArrayLike
    kd: npt.ArrayLike

    def __call__(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """(n,) torques [N m] or forces [N]."""
        J = self.jacobian(cfg)
        kp, kd = _gains(self.kp, len(J), "kp"), _gains(self.kd, len(J), "kd")
        return J.T @ (kp * self.error(t, cfg) + kd * (self.feed(t, cfg) - J @ dq))


@dataclass(frozen=True, kw_only=True)
class RateLaw(TipLaw):
    """What the laws that ask for joint rates have in common.

    Attributes:
        gain: How fast the error shall vanish [1/s], one number or one per task row.
        servo: How fast the joints shall take up their rates [1/s].
    """

    gain: npt.ArrayLike = 1.0
    servo: float = 20.0

    @abstractmethod
    def rates(self, t: float, cfg: Configuration) -> Array:
        """(n,) joint rates asked for [rad/s] or [m/s]."""

    def wanted(self, t: float, cfg: Configuration) -> Array:
        """(k,) tip velocity in the task's rows: xdot_des + gain (x_des - x)."""
        gain = _gains(self.gain, cfg.arm.task.k, "gain")
        return self.feed(t, cfg) + gain * self.error(t, cfg)

    def __call__(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """(n,) torques [N m] or forces [N]."""
        ddq = self.servo * (self.rates(t, cfg) - dq)
        return inverse_dynamics(cfg, dq, ddq, mode=self.mode).tau


@dataclass(frozen=True, kw_only=True)
class ResolvedRate(RateLaw):
    """dq = J*^+ xdot + (1 - J*^+ J*) dq_0: the inverse for square tasks, else the least rates.

    Umetani & Yoshida, IEEE Trans. Robot. Autom. 5(3), 303-314 (1989), DOI 10.1109/70.34766.

    Attributes:
        rest: (n,) joint positions that redundant arms tend to in their null space, as fast as
            `gain` on average; None for no motion there.
    """

    rest: npt.ArrayLike | None = None

    def rates(self, t: float, cfg: Configuration) -> Array:
        """(n,) joint rates asked for.

        Raises:
            NoSolutionError: J* is singular.
        """
        J = self.jacobian(cfg)
        U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
        if len(sigma) < len(J) or sigma[-1] <= NO_INVERSE * sigma[0]:
            raise NoSolutionError(
                f"J* is singular (sigma_min {sigma[-1]:.1e} of {sigma[0]:.1e}) and has no "
                "inverse; start elsewhere, or use DampedLeastSquares"
            )
        dq: Array = Vt.T @ ((U.T @ self.wanted(t, cfg)) / sigma)
        if self.rest is not None:
            away = joint_vector(cfg.arm, self.rest, "rest") - cfg.q
            dq = dq + np.asarray(self.gain).mean() * (away - Vt.T @ (Vt @ away))
        return dq


@dataclass(frozen=True, kw_only=True)
class DampedLeastSquares(RateLaw):
    """dq = J*^T (J* J*^T + lambda^2 1)^-1 xdot, lambda growing where sigma_min is small.

    lambda^2 = damping^2 (1 - (sigma_min / threshold)^2) below the threshold, else 0: Nakamura &
    Hanafusa, J. Dyn. Sys. Meas. Control 108(3), 163-171 (1986), with the measure of Chiaverini,
    IEEE Trans. Robot. Autom. 13(3), 398-410 (1997).

    Attributes:
        damping: Largest lambda, in the unit of sigma_min.
        threshold: sigma_min of the task Jacobian below which damping begins.
    """

    damping: float = 0.1
    threshold: float = 0.1

    def __post_init__(self) -> None:
        positive(self.threshold, "threshold")

    def rates(self, t: float, cfg: Configuration) -> Array:
        """(n,) joint rates asked for."""
        return self.nearest(t, cfg, self.jacobian(cfg))

    def nearest(self, t: float, cfg: Configuration, J: Array) -> Array:
        """The rates that a Jacobian (k, m) of the task gives, damped; (m,)."""
        scale = cfg.arm.task.scale
        U, sigma, Vt = np.linalg.svd(scale * J, full_matrices=False)
        nearness = min(sigma[-1] / self.threshold, 1.0)
        damped = sigma**2 + self.damping**2 * (1.0 - nearness**2)
        share = np.divide(sigma, damped, out=np.zeros_like(sigma), where=damped > 0.0)
        return Vt.T @ (share * (U.T @ (scale[:, 0] * self.wanted(t, cfg))))


@dataclass(frozen=True, kw_only=True)
class Reactionless(DampedLeastSquares):
    """The joint rates nearest to the task among those that do not turn the spacecraft, D_q dq = 0.

    With N a basis of the null space of D_q: dq = N (J* N)^+ xdot, damped. Yoshida, Hashizume &
    Abiko, Zero reaction maneuver, Proc. IEEE Int. Conf. Robot. Autom. (2001), 441-446.
    """

    def rates(self, t: float, cfg: Configuration) -> Array:
        """(n,) joint rates asked for.

        Raises:
            UnsupportedError: Every joint motion turns the spacecraft.
        """
        D_q = cfg.A[3:, 6:]
        _, sigma, Vt = np.linalg.svd(D_q)
        rank = int((sigma > NO_INVERSE * sigma[0]).sum())
        N = Vt[rank:].T
        if not N.shape[1]:
            raise UnsupportedError(
                f"every joint motion turns the spacecraft: D_q has rank {rank} and {cfg.arm.name} "
                f"{cfg.arm.n} joints; Reactionless takes more joints than that"
            )
        return N @ self.nearest(t, cfg, self.jacobian(cfg) @ N)


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
        kp, kd = _gains(self.kp, len(dq), "kp"), _gains(self.kd, len(dq), "kd")
        return kp * self.error(t, cfg) - kd * dq

    def error(self, t: float, cfg: Configuration) -> Array:
        """(n,) q_des - q [rad] or [m]."""
        target = self.target(t) if callable(self.target) else self.target
        return joint_vector(cfg.arm, target, "target") - cfg.q


def _gains(values: npt.ArrayLike, rows: int, name: str) -> Array:
    """A gain, or one for each of the rows."""
    try:
        gains = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        gains = np.full(rows, np.nan)
    if gains.shape not in ((), (rows,)):
        raise ConfigurationError(
            f"{name} has shape {gains.shape}; give one number, or {rows}, one a row"
        )
    if not np.isfinite(gains).all():
        raise ConfigurationError(f"{name} is {values!r}; give finite numbers")
    return gains


def check_target(controller: Controller, cfg: Configuration) -> None:
    """Refuses a fixed target farther from the system CM than the stretched virtual manipulator.

    Raises:
        ConfigurationError: The target is out of reach, for a spacecraft whose CM stays.
    """
    if not isinstance(controller, TipLaw) or callable(controller.target):
        return
    if far := out_of_reach(cfg, goal_pose(cfg, controller.target)):
        raise ConfigurationError(far)
