"""Simulation: a floating arm under joint torques, in time.

The state that is integrated is the reduced one: joint positions and rates, and the spacecraft's
attitude as a unit quaternion. The spacecraft's twist follows from momentum at every instant and its
position from the system CM, which moves uniformly: momentum is kept by construction. The work of
the torques is integrated beside it, so that every trajectory carries its own energy balance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.integrate import DOP853, OdeSolution
from scipy.optimize import brentq

from spacearm.arm import SpaceArm
from spacearm.arrays import Array
from spacearm.configuration import Configuration, joint_vector
from spacearm.control import Controller
from spacearm.dynamics import forward_dynamics, spacecraft_twist
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError, unknown
from spacearm.jacobian import FREE_TWIST, BaseMode
from spacearm.momentum import momentum_vector
from spacearm.singularity import singularity
from spacearm.singularity_polynomial import singularity_polynomial
from spacearm.trajectory import Event, Trajectory

EVENTS = ("singularity", "joint limit", "target")
AUDIT = 1e-4
"""Share of the energies that came and went by which a balance may be off."""
COLLAPSED = 1e-10
"""Share of the duration below which a step has collapsed."""
LOOKS = 8
"""Points of each step at which events are looked for."""
NEAR = 1e-3
"""Arms without a singularity polynomial count as singular at this sigma_min over sigma_max."""
OUTPUTS = 1000


def simulate(
    arm: SpaceArm,
    q0: npt.ArrayLike,
    controller: Controller,
    duration: float,
    *,
    base: pin.SE3 | None = None,
    dq0: npt.ArrayLike | None = None,
    momentum: npt.ArrayLike | None = None,
    mode: BaseMode = "free-floating",
    rtol: float = 1e-8,
    atol: float = 1e-10,
    events: Sequence[str] = EVENTS,
    stop: Sequence[str] = (),
    reach: float = 1e-3,
    dt: float | None = None,
) -> Trajectory:
    """Moves an arm under the torques of a controller.

    By the Runge-Kutta method of order 8 of Dormand and Prince (scipy's DOP853).

    Args:
        arm: The arm.
        q0: (n,) joint positions at the start [rad] or [m].
        controller: Called as controller(t, cfg, dq), returns (n,) torques [N m] or forces [N].
        duration: How long [s].
        base: Pose of the spacecraft at the start; the identity if None.
        dq0: (n,) joint rates at the start; zeros if None.
        momentum: (6,) momentum [linear; angular about the system CM], inertial axes, kept; zero if
            None. Where the spacecraft's attitude is controlled only the linear one counts.
        mode: What the spacecraft does; see `generalized_jacobian`.
        rtol: Relative tolerance of each step.
        atol: Absolute one [rad], [m], [rad/s], [m/s].
        events: What to note: "singularity" (a root of the singularity polynomial where the arm has
            one, else sigma_min a thousandth of sigma_max), "joint limit", "target" (the
            controller's `error` falls to `reach`).
        stop: Which of them end the run.
        reach: How near the target is reached: norm of the error.
        dt: Spacing of the output [s]; a thousandth of the duration if None.

    Raises:
        ConfigurationError: An argument does not make sense.
        NoSolutionError: The controller gave torques that are none, the step collapsed, or the
            energy balance is off: carries the trajectory so far.
    """
    if not (np.isfinite(duration) and duration > 0.0):
        raise ConfigurationError(f"duration is {duration}; give a positive time [s]")
    dt = duration / OUTPUTS if dt is None else dt
    if not 0.0 < dt <= duration:
        raise ConfigurationError(f"dt is {dt}; give a time from above 0 to the duration [s]")
    for name in (*events, *stop):
        if name not in EVENTS:
            raise ConfigurationError(unknown("event", name, EVENTS))
    system = _System(arm, controller, mode, momentum, arm.at(q0, base), duration)
    dq = np.zeros(arm.n) if dq0 is None else joint_vector(arm, dq0, "dq0")
    start = np.concatenate((system.start.q, dq, pin.SE3ToXYZQUAT(system.start.base)[3:], [0.0]))
    watched = _watches(system, {*events, *stop}, reach)
    times, pieces, noted = [0.0], [], []
    fault, ended = None, "duration"
    try:
        solver = DOP853(system.rate, 0.0, start, duration, rtol=rtol, atol=atol)
        while solver.status == "running" and ended == "duration":
            fault = solver.step()
            if fault or (solver.t < duration and (solver.step_size or 0.0) < COLLAPSED * duration):
                fault = f"the step collapsed at t = {solver.t:.6g} s; the motion is too stiff"
                break
            piece = solver.dense_output()
            times.append(solver.t)
            pieces.append(piece)
            new = _happened(system, watched, piece, times[-2], times[-1])
            for event in new:
                noted.append(event)
                if event.kind in stop:
                    ended = event.kind
                    times[-1] = event.t
                    break
    except ConfigurationError as error:
        fault = f"at t = {times[-1]:.6g} s: {error}"
    if not pieces:
        raise NoSolutionError(f"{arm.name}: no step could be taken: {fault}", None)
    solution = OdeSolution(times, pieces)
    t = np.unique(np.append(np.arange(0.0, times[-1], dt), times[-1]))
    rows = [system.output(s, solution(s)) for s in t]
    result = Trajectory.of(system.start, mode, t, rows, tuple(noted), fault or ended)
    if fault:
        raise NoSolutionError(f"{arm.name}: {fault}", result)
    if result.imbalance > AUDIT:
        raise NoSolutionError(
            f"{arm.name}: the energy balance is off by {result.imbalance:.1e} of what came and "
            "went; take smaller rtol and atol",
            result,
        )
    return result


class _System:
    """The equations of motion of one arm under one controller."""

    def __init__(
        self,
        arm: SpaceArm,
        controller: Controller,
        mode: BaseMode,
        momentum: npt.ArrayLike | None,
        start: Configuration,
        duration: float,
    ) -> None:
        if mode not in FREE_TWIST:
            raise ConfigurationError(unknown("mode", mode, FREE_TWIST))
        self.arm, self.controller, self.mode, self.start = arm, controller, mode, start
        self.duration = duration
        self.h = momentum_vector(momentum)
        if mode == "fixed" and self.h.any():
            raise ConfigurationError(f"momentum is {momentum!r}; a fixed spacecraft takes it up")

    def configuration(self, t: float, y: Array) -> tuple[Configuration, Array]:
        """The configuration and the joint rates in a state."""
        n = self.arm.n
        q, dq, quaternion = y[:n], y[n : 2 * n], y[2 * n : 2 * n + 4]
        if self.mode == "fixed":
            return self.arm.at(q, self.start.base), dq
        R = pin.Quaternion(quaternion / np.linalg.norm(quaternion)).matrix()
        turned = self.arm.at(q, pin.SE3(R, np.zeros(3)))
        com = self.start.com + self.h[:3] / self.arm.mass * t
        return self.arm.at(q, pin.SE3(R, com - turned.com)), dq

    def torques(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """What the controller asks for, checked."""
        return joint_vector(self.arm, self.controller(t, cfg, dq), "the controller's torque")

    def rate(self, t: float, y: Array) -> Array:
        """The rate of the state (q, dq, attitude quaternion, work)."""
        cfg, dq = self.configuration(t, y)
        tau = self.torques(t, cfg, dq)
        ddq = forward_dynamics(cfg, dq, tau, base=self.mode, momentum=self.h).ddq
        w = spacecraft_twist(cfg, dq, self.mode, self.h)[3:]
        x, s = y[2 * self.arm.n :][:3], y[2 * self.arm.n + 3]
        turning = 0.5 * np.append(s * w + np.cross(w, x), -w @ x)  # (36) in inertial axes
        return np.concatenate((dq, ddq, turning, [tau @ dq]))

    def output(self, t: float, y: Array) -> tuple[Configuration, Array, Array, Array, float]:
        """Configuration, joint rates, torques, momentum that is kept, and work."""
        cfg, dq = self.configuration(t, y)
        return cfg, dq, self.torques(t, cfg, dq), self.h, float(y[-1])


class _Watch(NamedTuple):
    """A function of time and state whose root is an event."""

    kind: str
    detail: str
    value: Callable[[float, Array], float]
    falling: bool  # whether only a fall through zero counts


def _watches(system: _System, kinds: set[str], reach: float) -> list[_Watch]:
    watches = []
    if "singularity" in kinds:
        watches.append(_singularity(system))
    if "joint limit" in kinds:
        watches += _limits(system.arm)
    error = getattr(system.controller, "error", None)
    if "target" in kinds and error is not None:

        def miss(t: float, y: Array) -> float:
            return float(np.linalg.norm(error(t, system.configuration(t, y)[0]))) - reach

        watches.append(_Watch("target", f"error {reach:g}", miss, True))
    return watches


def _singularity(system: _System) -> _Watch:
    """A root of S where there is one, else a small sigma_min."""
    arm = system.arm

    def nearness(_: float, y: Array) -> float:
        report = singularity(arm.at(y[: arm.n]), base=system.mode)
        return report.sigma_min - NEAR * float(report.sigma[0])

    try:
        S = singularity_polynomial(arm, system.mode)
    except UnsupportedError:
        return _Watch("singularity", f"sigma_min {NEAR:g} of sigma_max", nearness, True)
    return _Watch("singularity", "S = 0", lambda _, y: float(S(y[: arm.n])) / S.scale, False)


def _limits(arm: SpaceArm) -> list[_Watch]:
    def room(j: int, sign: float, limit: float) -> Callable[[float, Array], float]:
        return lambda _, y: sign * (limit - float(y[j]))

    return [
        _Watch("joint limit", name, room(j, sign, limits[j]), True)
        for j, name in enumerate(arm.joint_names)
        for sign, limits in ((1.0, arm.upper), (-1.0, arm.lower))
        if np.isfinite(limits[j])
    ]


def _happened(
    system: _System, watches: list[_Watch], y: Callable[[float], Array], start: float, end: float
) -> list[Event]:
    """The events of one step, in order."""
    looks = np.linspace(start, end, LOOKS + 1)
    found = []
    for kind, detail, g, falling in watches:
        values = [g(t, y(t)) for t in looks]
        for (a, b), (before, after) in zip(pairwise(looks), pairwise(values), strict=True):
            if before > 0.0 >= after or (not falling and before < 0.0 <= after):
                t = brentq(lambda s, g=g: g(s, y(s)), a, b, xtol=1e-14 * system.duration)
                found.append(Event(float(t), kind, y(t)[: system.arm.n].copy(), detail))
    return sorted(found, key=lambda event: event.t)
