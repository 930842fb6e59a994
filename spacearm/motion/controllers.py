"""Controllers: laws that give joint torques from time, configuration and joint rates.

A controller is anything that is called as controller(t, cfg, dq) and returns (n,) torques; those
here are plain data. Their `mode` selects the Jacobian: "fixed" is the law of an earth-bound arm,
which shows on a floating one what happens if the motion of the spacecraft is ignored.

A controller with a memory is called as controller(t, cfg, dq, memory). It has `memory0`, the (m,)
memory at the start or a function of the configuration there, and `update(t, cfg, dq, memory)`,
which returns the memory for the next control instant.

Some laws ask for joint rates. Inverse dynamics gives their torques, such that the joints take up
these rates with the time constant 1 / `servo`.
"""

from __future__ import annotations

import inspect
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from spacearm.arrays import (
    SMALLEST,
    Array,
    ArrayLike,
    Parameters,
    finite,
    positive,
    shape_of,
    within,
)
from spacearm.compiler import numbers
from spacearm.equations import laws
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.mechanics.dynamics import inverse_dynamics
from spacearm.mechanics.jacobian import generalized_jacobian, probes
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.model.joints import joint_vector
from spacearm.motion.goal import Goal, goal_pose, goal_rows, miss, out_of_reach, twist_between
from spacearm.motion.motion import Motion
from spacearm.signatures import checked, shown
from spacearm.singularities.report import NO_INVERSE

Controller = Callable[[float, Configuration, Array], ArrayLike]
#: A controller with a memory, with `memory0` and `update`.
MemoryController = Callable[[float, Configuration, Array, Array], ArrayLike]
#: A controller, or one for each tip by its name.
Laws: TypeAlias = (
    Controller | MemoryController | Mapping[str, Controller] | Mapping[str, MemoryController]
)
#: A goal, or a function of time [s] that gives one: a moving target, or a path and the speed.
MovingGoal: TypeAlias = Goal | Callable[[float], Goal]
#: Largest rate at which a law takes up rates or errors [1/s]: faster ones take steps too small.
FASTEST = 1e6
#: Share of a time that is rounding.
ROUNDING = 1e-12


@checked
@dataclass(frozen=True)
class Law(Parameters, ABC):
    """Base of all controllers here: torques from time, configuration and joint rates."""

    @property
    def moving(self) -> bool:
        """Whether the target moves."""
        return callable(getattr(self, "target", None))

    @abstractmethod
    def __call__(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """Return the torques (n,) [N m] or forces [N]."""

    @abstractmethod
    def error(self, t: float, cfg: Configuration) -> Array:
        """Return the target minus what is there, in the unit of each row."""


@checked
@dataclass(frozen=True, kw_only=True)
class TipLaw(Law):
    """Base of the laws that lead the tip to a target.

    The laws assume zero momentum. With momentum h the tip drifts by J_b A_b^-1 h, a disturbance
    that leaves an error.

    Attributes:
        target: Where the tip is to be: a point for tasks of linear rows only, along the goal axes
            (see `follow`), a pose, or a function of time that gives either.
        mode: Selects the Jacobian; see `generalized_jacobian`.
    """

    target: MovingGoal
    mode: BaseMode = "free-floating"

    def goal(self, t: float) -> Goal:
        """Return the target at a time."""
        return self.target(t) if callable(self.target) else self.target

    def error(self, t: float, cfg: Configuration) -> Array:
        """Return x_des - x (k,) in the task's rows [m], [rad]."""
        return miss(cfg, self.goal(t))

    def feed(self, t: float, cfg: Configuration) -> Array:
        """Return the velocity (k,) of the target in the task's rows [m/s], [rad/s]."""
        if not callable(self.target):
            return np.zeros(cfg.arm.task.k)
        before, after = (goal_pose(cfg, self.goal(t + s)) for s in (-laws.INSTANT, laws.INSTANT))
        return goal_rows(cfg, twist_between(before, after)) / (2.0 * laws.INSTANT)

    def jacobian(self, cfg: Configuration) -> Array:
        """Return the rows (k, n) of J* that the task names."""
        return goal_rows(cfg, generalized_jacobian(cfg, mode=self.mode))


@checked
@dataclass(frozen=True, kw_only=True)
class TransposedJacobian(TipLaw):
    """tau = J*^T (K_p (x_des - x) + K_d (xdot_des - xdot)), equation (42), xdot_des zero there.

    Attributes:
        kp: Stiffness, one number or one per task row [N/m] or [N m/rad].
        kd: Damping, likewise [N s/m] or [N m s/rad].
    """

    kp: ArrayLike
    kd: ArrayLike

    def __call__(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """Return the torques (n,) [N m] or forces [N]."""
        J = self.jacobian(cfg)
        kp, kd = gains(self.kp, len(J), "kp"), gains(self.kd, len(J), "kd")
        return laws.transposed(J, kp, kd, self.error(t, cfg), self.feed(t, cfg), dq)


@checked
@dataclass(frozen=True, kw_only=True)
class RateLaw(TipLaw):
    """Base of the laws that ask for joint rates.

    Attributes:
        gain: Rate at which the error is to vanish [1/s], one number or one per task row.
        servo: Rate at which the joints take up their rates [1/s].
    """

    gain: ArrayLike = 1.0
    servo: float = 20.0

    def __post_init__(self) -> None:
        within(self.servo, "servo", 0.0, FASTEST, "a rate [1/s]")

    @abstractmethod
    def rates(self, t: float, cfg: Configuration) -> Array:
        """Return the joint rates (n,) that the law asks for [rad/s] or [m/s]."""

    def wanted(self, t: float, cfg: Configuration) -> Array:
        """Return the tip velocity (k,) asked for in the task rows: xdot_des + gain (x_des - x)."""
        gain = gains(self.gain, cfg.arm.task.k, "gain")
        return self.feed(t, cfg) + gain * self.error(t, cfg)

    def __call__(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """Return the torques (n,) [N m] or forces [N]."""
        ddq = self.servo * (self.rates(t, cfg) - dq)
        return inverse_dynamics(cfg, dq, ddq, mode=self.mode).tau


@checked
@dataclass(frozen=True, kw_only=True)
class ResolvedRate(RateLaw):
    """dq = J*^+ xdot + (1 - J*^+ J*) dq_0: the inverse for square tasks, else the least rates.

    Umetani & Yoshida, IEEE Trans. Robot. Autom. 5(3), 303-314 (1989), DOI 10.1109/70.34766.

    Attributes:
        rest: (n,) joint positions to which redundant arms move in their null space, with the mean
            of `gain`; None for no motion there.
    """

    rest: ArrayLike | None = None

    def rates(self, t: float, cfg: Configuration) -> Array:
        """Return the joint rates (n,) that the law asks for [rad/s] or [m/s].

        Raises:
            NoSolutionError: J* is singular.
        """
        J = self.jacobian(cfg)
        sigma = np.linalg.svd(J, compute_uv=False)
        if len(sigma) < len(J) or sigma[-1] <= NO_INVERSE * sigma[0]:
            raise NoSolutionError(
                f"J* is singular (sigma_min {sigma[-1]:.1e} of {sigma[0]:.1e}) and has no "
                "inverse; start elsewhere, or use DampedLeastSquares"
            )
        away = None if self.rest is None else joint_vector(cfg.arm, self.rest, "rest") - cfg.q
        gain = np.asarray(self.gain).mean()
        return _by_numbers(laws.resolved_rates, J, self.wanted(t, cfg), 0.0, away, gain)


@checked
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
        super().__post_init__()
        within(self.damping, "damping", 0.0)
        positive(self.threshold, "threshold")

    def rates(self, t: float, cfg: Configuration) -> Array:
        """Return the joint rates (n,) that the law asks for [rad/s] or [m/s]."""
        return self.damped_rates(t, cfg, self.jacobian(cfg))

    def damped_rates(self, t: float, cfg: Configuration, J: Array) -> Array:
        """Return the damped rates (m,) for a Jacobian of the task.

        Args:
            t: The time [s].
            cfg: Where the arm is.
            J: (k, m) its rows along the task axes.
        """
        wanted = self._scaled(cfg, self.wanted(t, cfg))
        J = self._scaled(cfg, J)
        return _by_numbers(laws.damped_rates, J, wanted, self.damping, self.threshold)

    def _scaled(self, cfg: Configuration, rows: Array) -> Array:
        """Return the task's rows (k,) or (k, n), scaled."""
        scale = cfg.arm.task.scale[: len(rows)]
        return (scale if rows.ndim > 1 else scale[:, 0]) * rows


@checked
@dataclass(frozen=True, kw_only=True)
class Reactionless(DampedLeastSquares):
    """The joint rates nearest to the task among those that do not turn the spacecraft, D_q dq = 0.

    With N a basis of the null space of D_q: dq = N (J* N)^+ xdot, damped. Yoshida, Hashizume &
    Abiko, Zero reaction maneuver, Proc. IEEE Int. Conf. Robot. Autom. (2001), 441-446.

    In a simulation the joints follow these rates with the lag 1 / `servo`, so that the spacecraft
    turns a little, in proportion to the lag: up to some 0.1 degrees with 20/s.
    """

    def rates(self, t: float, cfg: Configuration) -> Array:
        """Return the joint rates (n,) that the law asks for [rad/s] or [m/s].

        Raises:
            UnsupportedError: Every joint motion turns the spacecraft.
        """
        rank, n = rank_at(cfg), cfg.arm.n
        if rank == n:
            raise UnsupportedError(
                f"every joint motion turns the spacecraft: D_q has rank {rank} and {cfg.arm.name} "
                f"{n} joints; Reactionless needs more joints than that"
            )
        J, wanted = self.jacobian(cfg), self._scaled(cfg, self.wanted(t, cfg))
        return _by_numbers(
            laws.reactionless_rates, self._scaled(cfg, J), cfg.A[3:, 6:], rank, NO_INVERSE, wanted,
            self.damping, self.threshold,
        )  # fmt: skip


@checked
@dataclass(frozen=True)
class JointPD(Law):
    """tau = K_p (q_des - q) - K_d dq + K_i int (q_des - q) dt.

    With an integral term the law has a memory and needs a control period: simulate it with
    `sampling=sa.Sampling(period=...)`. The integral is the sum over the control instants of the
    error times the time since the instant before. It stops growing while the torque is at its
    limit (anti-windup by conditional integration: Åström & Hägglund, Advanced PID Control (2006),
    section 3.5).

    Attributes:
        target: (n,) joint positions [rad] or [m], or a function of time that gives them.
        kp: Stiffness, one number or one per joint.
        kd: Damping, likewise.
        ki: Gain of the integral term [N m/(rad s)] or [N/(m s)], likewise; 0 for none.
        limit: Largest torque of a law with an integral term [N m] or [N], one number or one per
            joint; the torque is cut to it.
    """

    target: ArrayLike | Callable[[float], ArrayLike]
    kp: ArrayLike
    kd: ArrayLike
    ki: ArrayLike = 0.0
    limit: ArrayLike = np.inf

    def memory0(self, cfg: Configuration) -> Array | None:
        """Return the memory (n + 1,) at the start; None without an integral term.

        It is the integral of the error [rad s] or [m s], and the time of the last instant [s].

        Raises:
            ConfigurationError: There is a limit and no integral term.
        """
        n = cfg.arm.n
        limits = torque_limits(self.limit, n)
        if np.any(gains(self.ki, n, "ki")):
            return np.zeros(n + 1)
        if np.isfinite(limits).any():
            raise ConfigurationError(
                f"limit is {shown(self.limit)} and ki is 0; it holds for a law with an integral "
                "term only. Give ki, or cut the torques by plant=sa.Plant(limits=True)"
            )
        return None

    def __call__(
        self, t: float, cfg: Configuration, dq: Array, memory: Array | None = None
    ) -> Array:
        """Return the torques (n,) [N m] or forces [N]; `memory` is that of the integral term."""
        kp, kd = gains(self.kp, len(dq), "kp"), gains(self.kd, len(dq), "kd")
        tau = laws.joint_pd(kp, kd, self.error(t, cfg), dq)
        return tau if memory is None else self._integral(t, cfg, tau, memory)[0]

    def update(self, t: float, cfg: Configuration, dq: Array, memory: Array) -> Array:
        """Return the memory (n + 1,) for the next control instant."""
        return self._integral(t, cfg, self(t, cfg, dq), memory)[1]

    def _integral(
        self, t: float, cfg: Configuration, tau: Array, memory: Array
    ) -> tuple[Array, Array]:
        """Return torques with the integral term, and the memory next."""
        ki, limit = gains(self.ki, len(tau), "ki"), torque_limits(self.limit, len(tau))
        return laws.joint_integral(numbers, ki, limit, tau, self.error(t, cfg), t, memory)

    def error(self, t: float, cfg: Configuration) -> Array:
        """Return q_des - q (n,) [rad] or [m]."""
        target = self.target(t) if callable(self.target) else self.target
        return joint_vector(cfg.arm, target, "target") - cfg.q


#: The control laws that a file or an option can name.
LAWS: dict[str, Any] = {
    kind.__name__: kind
    for kind in (TransposedJacobian, ResolvedRate, DampedLeastSquares, Reactionless, JointPD)
}


def _by_numbers(function: Callable[..., Any], *arguments: Any) -> Array:
    """Return what an equation gives for numbers."""
    with np.errstate(all="ignore"):
        return function(numbers, *arguments)


def rank_of_turns(arm: SpaceArm) -> int:
    """Return in how many directions joint motions turn the spacecraft: the rank of D_q."""
    return max(map(rank_at, probes(arm)))


def rank_at(cfg: Configuration) -> int:
    """Return the rank of D_q in a configuration."""
    sigma = np.linalg.svd(cfg.A[3:, 6:], compute_uv=False)
    return int((sigma > NO_INVERSE * sigma[0]).sum())


def gains(values: ArrayLike, rows: int, name: str) -> Array:
    """Return a gain, or one for each of the rows."""
    if np.iterable(values):
        return finite(values, (rows,), name, "(gains, one for each row), or one for all rows")
    return finite(values, (), name, f"(a gain), or {rows}, one for each row")


def torque_limits(values: ArrayLike, n: int) -> Array:
    """Return the largest torque of each of n joints [N m] or [N], inf where there is no limit."""
    listed: list[Any] = list(values) if isinstance(values, Iterable) else [values]
    if len(listed) not in (1, n):
        raise ConfigurationError(
            f"limit is {shown(values)}; give the largest torque, or {n}, one for each joint"
        )
    limits = [within(value, "limit", SMALLEST, math.inf, "a torque") for value in listed]
    return np.broadcast_to(np.array(limits), n)


def memory_at_start(controller: Controller, cfg: Configuration) -> Array:
    """Return what a law remembers at the start (m,), empty if it has no memory.

    Raises:
        ConfigurationError: Its `memory0` is not a vector of finite numbers, or it has no `update`.
    """
    given = getattr(controller, "memory0", None)
    values = given(cfg) if callable(given) else given
    if values is None:
        if not isinstance(controller, Law) and not _takes(controller, cfg, 3):
            raise ConfigurationError(
                f"{type(controller).__name__} takes a memory and has no memory0; define memory0, "
                "an (m,) array or a function of the configuration at the start"
            )
        return np.zeros(0)
    name = f"memory0 of {type(controller).__name__}"
    size = shape_of(values)
    if len(size) != 1 or size[0] == 0:
        raise ConfigurationError(f"{name} is {shown(values)}; give an (m,) array of finite numbers")
    if not callable(getattr(controller, "update", None)):
        raise ConfigurationError(
            f"{type(controller).__name__} has memory0 and no update; define update(t, cfg, dq, "
            "memory), which returns the next memory (m,)"
        )
    return finite(values, size, name)


def _takes(controller: Controller, cfg: Configuration, count: int) -> bool:
    """Return whether a controller takes so many arguments, as far as its signature is known."""
    try:
        inspect.signature(controller).bind(*[cfg] * count)
    except (TypeError, ValueError) as error:
        return isinstance(error, ValueError)
    return True


def check_target(controller: Controller, cfg: Configuration) -> None:
    """Refuse a fixed target farther from the system CM than the stretched virtual manipulator.

    Raises:
        ConfigurationError: The target is out of reach, for a spacecraft whose CM stays.
    """
    if not isinstance(controller, TipLaw) or callable(controller.target):
        return
    if far := out_of_reach(cfg, goal_pose(cfg, controller.target)):
        raise ConfigurationError(far)


@checked
@dataclass(frozen=True)
class Tracking(Law):
    """tau = inverse dynamics of ddq_d + 2 rate (dq_d - dq) + rate^2 (q_d - q): computed torque.

    The inverse dynamics control of Siciliano, Sciavicco, Villani & Oriolo, Robotics (2009), section
    8.5.2, DOI 10.1007/978-1-84628-642-1, with the dynamics of the floating arm. Masses and momentum
    are those of the planned motion, whatever those of the simulated arm are. If wheels bring a
    tumbling spacecraft to rest, the law includes their torques; simulate with
    `sa.Plant(wheels=law.wheel_torques)`.

    q_d is a spline over time through the rows of the motion, and through their rates and
    accelerations if the motion has these, as followed paths do. Before it begins and after it has
    ended the joints hold still. Plans start and end at rest.

    Attributes:
        motion: The motion that the joints follow.
        rate: Rate at which errors vanish, critically damped [1/s].
    """

    motion: Motion
    rate: float = 5.0

    def __post_init__(self) -> None:
        positive(self.rate, "rate", "rate [1/s]", most=FASTEST)

    def wheel_torques(self, t: float) -> Array:
        """Return the torques (w,) that the wheels take up at a time [N m]."""
        wheels = self.motion.wheel_spline
        inside, moves = self._inside(t)
        if wheels is None or not moves:
            return np.zeros(len(self.motion.arm.wheels))
        return np.asarray(wheels(inside, 1))

    def _inside(self, t: float) -> tuple[float, bool]:
        """Return the time of the motion nearest to a time, and whether it is that one."""
        begin, end = self.motion.t[[0, -1]]
        inside = float(np.clip(t, begin, end))
        return inside, abs(t - inside) <= ROUNDING * abs(inside)

    def wanted(self, t: float) -> tuple[Array, Array, Array]:
        """Return joint positions, rates and accelerations (n,) of the motion at a time."""
        inside, moves = self._inside(t)
        q = self.motion.spline
        return q(inside), moves * q(inside, 1), moves * q(inside, 2)

    def __call__(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """Return the torques (n,) [N m] or forces [N]."""
        q, rates, ddq = self.wanted(t)
        ddq = ddq + 2.0 * self.rate * (rates - dq) + self.rate**2 * (q - cfg.q)
        wrenches = {}
        if self.motion.wheel_spline is not None:
            turned = cfg.arm.at(cfg.q, base=cfg.base, wheels=self.wheel_torques(t)).stored
            wrenches[cfg.arm.tree.root] = -turned  # on the spacecraft
        known = kinematics(self.motion.arm, cfg.q, cfg.base)
        if (momentum := getattr(self.motion, "momentum", np.zeros((1, 6)))[0]).any():
            known = known.with_momentum(momentum)
        if cfg.wheels.any():
            known = known.with_wheels(cfg.wheels)
        return inverse_dynamics(known, dq, ddq, mode=self.motion.mode, wrenches=wrenches).tau

    @property
    def moving(self) -> bool:
        """True: the target moves with the motion."""
        return True

    def error(self, t: float, cfg: Configuration) -> Array:
        """Return q_d - q (n,) [rad] or [m]."""
        return self.wanted(t)[0] - cfg.q

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters as plain data, the motion as its story."""
        return {"motion": repr(self.motion), "rate": self.rate}
