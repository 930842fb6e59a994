"""Simulation: a floating arm under joint torques, in time.

The state that is integrated is the reduced one: joint positions and rates, and the spacecraft's
attitude as a unit quaternion. The spacecraft's twist follows from momentum at every instant and its
position from the system CM, which moves uniformly: momentum is kept by construction. The work of
the torques is integrated beside it, so that every trajectory carries its own energy balance.

Control is stiff as a rule, because a wrist feels little inertia; hence LSODA (Petzold, SIAM J. Sci.
Stat. Comput. 4(1), 136-148 (1983)), which turns to an implicit method where that pays.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.integrate import BDF, DOP853, LSODA, DenseOutput, OdeSolution, OdeSolver, Radau

from spacearm.arrays import Array, positive
from spacearm.errors import ConfigurationError, NoSolutionError, SpaceArmError, unknown
from spacearm.mechanics.dynamics import forward_dynamics
from spacearm.mechanics.floating import quaternion_rate
from spacearm.mechanics.momentum import momentum_vector
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration, kinematics
from spacearm.model.joints import joint_vector
from spacearm.model.mode import BaseMode, free_components
from spacearm.motion.controllers import Controller, check_target
from spacearm.motion.events import EVENTS, Event, Lookout, Measure, Watch, watches
from spacearm.motion.trajectory import Trajectory

METHODS: dict[str, Callable[..., OdeSolver]] = {
    "LSODA": LSODA, "DOP853": DOP853, "BDF": BDF, "Radau": Radau
}  # fmt: skip
FINEST = 100.0 * float(np.finfo(np.float64).eps)
"""The least `rtol` that scipy's integrators take."""
AUDIT = 1e4
"""How many times `rtol` the balances of energy and momentum may be off."""
STILL = 1e2
"""How many times `atol` [J] that of energy may be off besides: all there is near rest."""
PACE, COLLAPSED = 1000, 1e-5
"""The step has collapsed when so many go forward by less than so long each [s]."""
REPORT = 50
"""Steps between two reports of progress."""
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
    method: str = "LSODA",
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Moves an arm under the torques of a controller.

    Args:
        arm: The arm.
        q0: (n,) joint positions at the start [rad] or [m].
        controller: Called as controller(t, cfg, dq), returns (n,) torques [N m] or forces [N]; at
            times in any order, so that it must not remember.
        duration: How long [s].
        base: Pose of the spacecraft at the start; the identity if None.
        dq0: (n,) joint rates at the start; zeros if None.
        momentum: (6,) momentum [linear; angular about the system CM], inertial axes, kept; zero if
            None. Where the spacecraft's attitude is controlled only the linear one counts.
        mode: What the spacecraft does; see `generalized_jacobian`.
        rtol: Relative tolerance of each step.
        atol: Absolute one [rad], [m], [rad/s], [m/s], [J].
        events: What to note: "singularity" (a root of the singularity polynomial where the arm has
            one, else sigma_min a thousandth of sigma_max), "joint limit", "target" (the
            controller's `error` falls to `reach`).
        stop: Which of them end the run.
        reach: How near the target is reached: norm of the error.
        dt: Spacing of the output [s]; a thousandth of the duration if None.
        method: scipy's integrator: "LSODA"; "DOP853" (explicit, of order 8: exact for smooth
            torques, slow for stiff ones), "BDF" or "Radau" (implicit). Of LSODA only one can run
            at a time: a simulation inside a controller takes another.
        progress: Called with the simulated time [s] now and then.

    Raises:
        ConfigurationError: An argument does not make sense, or the target is out of reach.
        UnsupportedError: The arm has several tips.
        NoSolutionError: The controller gave no torques, the step collapsed, or the balance of
            energy or momentum is off: carries the trajectory so far, None before the first step.
    """
    duration = positive(duration, "duration", "time [s]")
    dt = duration / OUTPUTS if dt is None else positive(dt, "dt", "time [s]")
    if dt > duration:
        raise ConfigurationError(f"dt is {dt}; give a time from above 0 to the duration [s]")
    rtol, atol = positive(rtol, "rtol"), positive(atol, "atol")
    if rtol < FINEST:
        raise ConfigurationError(f"rtol is {rtol}; give a number from {FINEST:.2g} on")
    if method not in tuple(METHODS):
        raise ConfigurationError(unknown("method", method, METHODS))
    arm.require_one_tip()  # whose path the trajectory holds
    system = _System(arm, controller, mode, momentum, arm.at(q0, base=base))
    if mode != "fixed" and not system.h[:3].any():
        check_target(controller, system.start)
    dq = np.zeros(arm.n) if dq0 is None else joint_vector(arm, dq0, "dq0")
    start = np.concatenate((system.start.q, dq, pin.SE3ToXYZQUAT(system.start.base)[3:], [0.0]))
    run = _Run(arm.n, start, watches(arm, mode, {*events, *stop}, system.miss, reach), stop)
    with _alone(method):
        try:
            system.rate(0.0, start)  # what fails at once fails here: LSODA would print about it
            solver = METHODS[method](system.rate, 0.0, start, duration, rtol=rtol, atol=atol)
            run.integrate(solver, progress)
        except NoSolutionError as error:
            run.fail("controller failed", str(error))
    if run.fault and not run.pieces:
        raise NoSolutionError(f"{arm.name}: {run.fault}", None)
    t = np.unique(np.append(np.arange(0.0, run.times[-1], dt), run.times[-1]))
    rows = [system.output(s, y) for s, y in zip(t, run.states(t), strict=True)]
    exchanged = float(np.abs(np.diff(run.states(np.array(run.times))[:, -1])).sum())
    result = Trajectory.of(system.start, mode, t, rows, exchanged, tuple(run.events), run.ended)
    if run.fault:
        raise NoSolutionError(f"{arm.name}: {run.fault}", result)
    still = STILL * atol / result.turnover if result.turnover > 0.0 else 0.0
    for what, off, more in (("energy", result.imbalance, still), ("momentum", result.drift, 0.0)):
        if off > AUDIT * rtol + more:
            raise NoSolutionError(
                f"{arm.name}: the balance of {what} is off by {off:.1e} of what came and went; "
                "take smaller rtol and atol",
                result,
            )
    return result


@dataclass
class _Run:
    """An integration on its way."""

    n: int
    start: Array
    watched: Sequence[Watch]
    stop: Collection[str]
    times: list[float] = field(default_factory=lambda: [0.0])
    pieces: list[DenseOutput] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    ended: str = "duration"
    fault: str = ""

    def integrate(self, solver: OdeSolver, progress: Callable[[float], None] | None) -> None:
        """Steps to the end, or to the event that stops the run."""
        lookout = Lookout(self.watched, self.n, 0.0, self.start)
        self.note(lookout.met())
        while solver.status == "running" and self.ended == "duration":
            if solver.step() or self.collapsed:
                self.fail(
                    "step collapsed",
                    f"the step collapsed at t = {solver.t:.6g} s: the torques jump or are too "
                    "stiff; smooth them or lower the gains (LSODA, BDF and Radau bear most)",
                )
                return
            self.times.append(solver.t)
            self.pieces.append(solver.dense_output())
            self.note(lookout.step(self.pieces[-1], solver.t))
            if progress and len(self.times) % REPORT == 0:
                progress(solver.t)

    def fail(self, ended: str, fault: str) -> None:
        """Ends the run for a reason that is an error."""
        self.ended, self.fault = ended, fault

    def note(self, events: list[Event]) -> None:
        """Keeps events, up to the first that stops the run."""
        for event in events:
            self.events.append(event)
            if event.kind in self.stop:
                self.ended = event.kind
                self.cut(event.t)
                return

    def cut(self, t: float) -> None:
        """Ends the run within its last step, or before it."""
        if self.pieces and t <= self.times[-2]:
            self.times.pop()
            self.pieces.pop()
        else:
            self.times[-1] = t

    @property
    def collapsed(self) -> bool:
        """Whether the last steps went nowhere."""
        times = self.times
        return len(times) > PACE and times[-1] - times[-1 - PACE] < PACE * COLLAPSED

    def states(self, t: Array) -> Array:
        """(m, ...) the states at times t."""
        if not self.pieces:
            return self.start[None]
        return OdeSolution(self.times, self.pieces)(t).T


@contextmanager
def _alone(method: str) -> Iterator[None]:
    """Keeps LSODA, which has global variables, to one run; complaints become our errors."""
    if method != "LSODA":
        with np.errstate(over="ignore"):  # in scipy's difference quotients
            yield
        return
    if not LSODA_IS_FREE.acquire(blocking=False):
        raise ConfigurationError(
            "method is 'LSODA', with which another simulation is running; it can do one at a "
            "time: give this one 'DOP853' or 'BDF'"
        )
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "lsoda:")
            yield
    finally:
        LSODA_IS_FREE.release()


LSODA_IS_FREE = threading.Lock()


class _System:
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
        """The configuration and the joint rates in a state."""
        n = self.arm.n
        q, dq, quaternion = y[:n].copy(), y[n : 2 * n], y[2 * n : 2 * n + 4]
        if self.mode == "fixed":
            return self.arm.at(q, base=self.start.base), dq
        attitude = pin.Quaternion(quaternion / np.linalg.norm(quaternion))
        turned = kinematics(self.arm, q, pin.SE3(attitude, np.zeros(3)))
        return turned.centred(self.start.com + self.h[:3] / self.mass * t), dq

    def torques(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """What the controller asks for, checked."""
        try:
            tau = self.controller(t, cfg, dq)
            return joint_vector(self.arm, tau, "the controller's torque")
        except SpaceArmError as error:
            q = ", ".join(f"{x:.6g}" for x in cfg.q)
            raise NoSolutionError(f"at t = {t:.6g} s, q = ({q}): {error}") from None

    @property
    def miss(self) -> Measure | None:
        """How far the target is, for controllers that have one."""
        error = getattr(self.controller, "error", None)
        if error is None:
            return None
        return lambda t, y: float(np.linalg.norm(error(t, self.configuration(t, y)[0])))

    def rate(self, t: float, y: Array) -> Array:
        """The rate of the state (q, dq, attitude quaternion, work)."""
        cfg, dq = self.configuration(t, y)
        tau = self.torques(t, cfg, dq)
        motion = forward_dynamics(cfg, dq, tau, mode=self.mode, momentum=self.h)
        turning = quaternion_rate(y[2 * self.arm.n :][:4], motion.twist[3:])
        return np.concatenate((dq, motion.ddq, turning, [tau @ dq]))

    def output(self, t: float, y: Array) -> tuple[Configuration, Array, Array, Array, float]:
        """Configuration, joint rates, torques, momentum that is kept, and work."""
        cfg, dq = self.configuration(t, y)
        return cfg, dq, self.torques(t, cfg, dq), self.h, float(y[-1])
