"""Simulation: a floating arm under joint torques, in time.

The state that is integrated is the reduced one: joint positions and rates, and the spacecraft's
attitude as a unit quaternion. The work of the torques is integrated beside it, so that every
trajectory has a balance of its energy.

Controlled arms are stiff as a rule, because the inertia that a wrist moves is small; hence LSODA
(Petzold, SIAM J. Sci. Stat. Comput. 4(1), 136-148 (1983)), which switches to an implicit method
where that is faster.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, positive
from spacearm.errors import ConfigurationError, NoSolutionError, unknown
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_vector
from spacearm.model.mode import BaseMode
from spacearm.motion.controlled_arm import ControlledArm
from spacearm.motion.controllers import Controller, check_target
from spacearm.motion.events import EVENTS, Event, EventFinder, EventFunction, event_functions
from spacearm.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from scipy.integrate import DenseOutput, OdeSolver

METHODS = ("LSODA", "DOP853", "BDF", "Radau")
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
    progress: Callable[[float, float], object] | None = None,
) -> Trajectory:
    """Simulate an arm under the torques of a controller.

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
            one, else half a degree from the singular set), "joint limit", "target" (the
            controller's `error` falls to `reach`).
        stop: Which of them end the run.
        reach: How near the target is reached: norm of the error.
        dt: Spacing of the output [s]; a thousandth of the duration if None.
        method: scipy's integrator: "LSODA"; "DOP853" (explicit, of order 8: exact for smooth
            torques, slow for stiff ones), "BDF" or "Radau" (implicit). Of LSODA only one can run
            at a time: a simulation inside a controller takes another.
        progress: Called now and then as progress(t, duration), both simulated time [s].

    Raises:
        ConfigurationError: An argument does not make sense, or the target is out of reach.
        UnsupportedError: The arm has several tips.
        NoSolutionError: The controller gave no torques, the step collapsed, or the balance of
            energy or momentum is off: carries the trajectory so far, None before the first step.
    """
    from scipy import integrate  # slow to import

    duration = positive(duration, "duration", "time [s]")
    dt = duration / OUTPUTS if dt is None else positive(dt, "dt", "time [s]")
    if dt > duration:
        raise ConfigurationError(f"dt is {dt}; give a time from above 0 to the duration [s]")
    rtol, atol = positive(rtol, "rtol"), positive(atol, "atol")
    if rtol < FINEST:
        raise ConfigurationError(f"rtol is {rtol}; give a number from {FINEST:.2g} on")
    if method not in METHODS:
        raise ConfigurationError(unknown("method", method, METHODS))
    arm.require_one_tip()  # whose path the trajectory holds
    system = ControlledArm(arm, controller, mode, momentum, arm.at(q0, base=base))
    if mode != "fixed" and not system.h[:3].any():
        check_target(controller, system.start)
    dq = np.zeros(arm.n) if dq0 is None else joint_vector(arm, dq0, "dq0")
    start = np.concatenate((system.start.q, dq, pin.SE3ToXYZQUAT(system.start.base)[3:], [0.0]))
    functions = event_functions(arm, mode, {*events, *stop}, system.miss, reach)
    run = _Run(arm.n, start, functions, stop)
    with _alone(method):
        try:
            system.rate(0.0, start)  # what fails at once fails here: LSODA would print about it
            solver = getattr(integrate, method)
            run.integrate(solver(system.rate, 0.0, start, duration, rtol=rtol, atol=atol), progress)
        except NoSolutionError as error:
            run.fail("controller failed", str(error))
    if run.fault and not run.pieces:
        raise NoSolutionError(f"{arm.name}: {run.fault}", None)
    t = np.unique(np.append(np.arange(0.0, run.times[-1], dt), run.times[-1]))
    result = Trajectory(
        **system.along(t, run.states(t)),
        exchanged=run.exchanged,
        events=tuple(run.events),
        ended=run.ended,
    )
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
    """An integration on its way: its steps and events, and why it ended.

    Attributes:
        n: Number of joints.
        start: The state at the start.
        functions: The functions whose roots are events.
        stop: Kinds of events that end the run.
        times: Times at which the steps begin, and the end of the last one [s].
        pieces: The state in each step, a function of time.
        events: The events so far.
        ended: Why the run ended, as `Trajectory.ended`.
        fault: The message of the error that ended it, if there was one.
    """

    n: int
    start: Array
    functions: Sequence[EventFunction]
    stop: Collection[str]
    times: list[float] = field(default_factory=lambda: [0.0])
    pieces: list[DenseOutput] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    ended: str = "duration"
    fault: str = ""

    def integrate(
        self, solver: OdeSolver, progress: Callable[[float, float], object] | None
    ) -> None:
        """Step to the end, or to the event that stops the run."""
        finder = EventFinder(self.functions, self.n, 0.0, self.start)
        self.note(finder.at_start())
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
            self.note(finder.in_step(self.pieces[-1], solver.t))
            if progress and len(self.times) % REPORT == 0:
                progress(solver.t, solver.t_bound)

    def fail(self, ended: str, fault: str) -> None:
        """End the run for a reason that is an error."""
        self.ended, self.fault = ended, fault

    def note(self, events: list[Event]) -> None:
        """Keep events, up to the first that stops the run."""
        for event in events:
            self.events.append(event)
            if event.kind in self.stop:
                self.ended = event.kind
                self.cut(event.t)
                return

    def cut(self, t: float) -> None:
        """End the run within its last step, or before it."""
        if self.pieces and t <= self.times[-2]:
            self.times.pop()
            self.pieces.pop()
        else:
            self.times[-1] = t

    @property
    def collapsed(self) -> bool:
        """Whether the last steps together went (nearly) nowhere."""
        times = self.times
        return len(times) > PACE and times[-1] - times[-1 - PACE] < PACE * COLLAPSED

    @property
    def exchanged(self) -> float:
        """Work that the torques did and took back, all in all [J]."""
        return float(np.abs(np.diff(self.states(np.array(self.times))[:, -1])).sum())

    def states(self, t: Array) -> Array:
        """Return the states (m, ...) at times t."""
        from scipy.integrate import OdeSolution

        return OdeSolution(self.times, self.pieces)(t).T if self.pieces else self.start[None]


@contextmanager
def _alone(method: str) -> Iterator[None]:
    """Keep LSODA, which has global variables, to one run at a time, and its warnings to itself."""
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
