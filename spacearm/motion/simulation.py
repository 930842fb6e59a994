"""Simulation: a floating arm under joint torques, in time.

The state that is integrated is the reduced one: joint positions and rates, the spacecraft's
attitude as a unit quaternion, and what changes under wrenches and wheels only: momentum and the
system CM. The work of the torques is integrated beside it, so that every trajectory has a balance
of its energy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from spacearm.arrays import finite, plain, positive
from spacearm.errors import ConfigurationError, NoSolutionError, unknown
from spacearm.model.arguments import BaseMode, of_configuration
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.joints import joint_vector
from spacearm.motion.controllers import Controller, check_controller, check_target
from spacearm.motion.events import EVENTS
from spacearm.motion.goal import Origin, started
from spacearm.motion.plant import Plant, System
from spacearm.motion.runs.run import Runs
from spacearm.motion.runs.setup import coupled, prepared, start_state, wanted_events
from spacearm.motion.trajectory import Trajectory

METHODS = ("auto", "DOP853", "Rodas5P")
FINEST = 100.0 * float(np.finfo(np.float64).eps)
"""The least `rtol` that the integrators take."""
AUDIT = 1e4
"""How many times `rtol` the balances of energy and momentum may be off."""
STILL = 1e2
"""How many times `atol` [J] that of energy may be off besides: all there is near rest."""
OUTPUTS = 1000


@dataclass(frozen=True, kw_only=True)
class Integration:
    """How a simulation is integrated, and what is looked for on the way.

    Attributes:
        rtol: Relative tolerance of each step.
        atol: Absolute one [rad], [m], [rad/s], [m/s], [J].
        dt: Spacing of the output [s]; a thousandth of the duration if None.
        events: What to note: "singularity" (the determinant of the task Jacobian changes its sign,
            or where J* is not square the distance to the singular set falls to half a degree),
            "joint limit", "target" (the controller's `error` falls to `reach`), "wheel full".
        reach: How near the target is reached: norm of the error.
        method: "DOP853" (explicit, of order 8), "Rodas5P" (linearly implicit, of order 5, for stiff
            torques) or "auto", which begins with the first and takes the second where that pays.
    """

    rtol: float = 1e-8
    atol: float = 1e-10
    dt: float | None = None
    events: Sequence[str] = EVENTS
    reach: float = 1e-3
    method: str = "auto"

    def __post_init__(self) -> None:
        for name in ("rtol", "atol", "reach"):
            positive(getattr(self, name), name)
        if self.rtol < FINEST:
            raise ConfigurationError(f"rtol is {self.rtol}; give a number from {FINEST:.2g} on")
        if self.dt is not None:
            positive(self.dt, "dt", "time [s]")
        if self.method not in METHODS:
            raise ConfigurationError(unknown("method", self.method, METHODS))

    def to_dict(self) -> dict[str, Any]:
        """Return all fields."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}


@of_configuration
def simulate(
    start: Configuration,
    controller: Controller | Mapping[str, Controller],
    duration: float,
    *,
    dq: npt.ArrayLike | None = None,
    mode: BaseMode = "free-floating",
    origin: Origin = "spacecraft",
    plant: Plant = Plant(),
    stop: Sequence[str] = (),
    period: float | None = None,
    delay: float = 0.0,
    integration: Integration = Integration(),
    progress: Callable[[float, float], object] | None = None,
) -> Trajectory:
    """Simulate an arm under the torques of a controller.

    Args:
        start: The configuration at the start: joint positions, pose of the spacecraft, what the
            wheels hold, and the momentum. Where the spacecraft's attitude is controlled only the
            linear momentum counts.
        controller: Called as controller(t, cfg, dq), returns (n,) torques [N m] or forces [N]; at
            times in any order, so that it must not remember. Plain array code is compiled, other
            code is called in Python. Of an arm with several tips a law for each, by the tip's name:
            it acts on the joints that move that tip.
        duration: How long [s].
        dq: (n,) joint rates at the start [rad/s] or [m/s]; zeros if None.
        mode: What the spacecraft does; see `generalized_jacobian`.
        origin: Where the inertial frame has its origin: "spacecraft", as the pose of the start
            says, so that poses of `SpaceArm.at` are goals as they are; or "cm", the system CM at
            the start, as for points of a `Workspace`, the pose giving the attitude.
        plant: What acts besides: wheels, wrenches, thrusters, springs and friction, motor limits.
        stop: Events that end the run; see `Integration`.
        period: Period of a controller of fixed rate, which holds its torques in between [s]; None
            for one that acts at all times.
        delay: Time after which these torques act, up to the period [s].
        integration: Tolerances, spacing of the output, and the events that are noted.
        progress: Called now and then as progress(t, duration), both simulated time [s].

    Returns:
        The trajectory; of a run that Ctrl-C interrupted what there is, `ended` "interrupted".

    Raises:
        ConfigurationError: An argument does not make sense, or the target is out of reach.
        UnsupportedError: The arm has several tips and one controller, or no wheels to hold.
        NoSolutionError: The controller gave no torques, the step collapsed, or the balance of
            energy or momentum is off: carries the trajectory so far, None before the first step.

    Example:
        >>> import spacearm as sa
        >>> law = sa.JointPD(target=[0.5, 1.0], kp=5, kd=9)
        >>> sa.simulate(sa.load("planar2").at([0.3, 1.2]), law, 5.0)
        Trajectory(planar2, free-floating: 5 s, 1001 times, ended by duration)
    """
    arm, duration = start.arm, positive(duration, "duration", "time [s]")
    rates = np.zeros(arm.n) if dq is None else joint_vector(arm, dq, "dq")
    system = System(started(start, origin), mode, plant)
    controllers = _by_tip(arm, controller)
    if mode != "fixed" and not start.momentum[:3].any() and not plant.pushed and len(arm.tips) == 1:
        for one in controllers.values():
            check_target(one, system.start)
    kinds = (*integration.events, *stop)
    wanted = wanted_events(system, kinds, stop, integration.reach, controllers)
    ready = prepared(system, controllers, wanted)
    dt = duration / OUTPUTS if integration.dt is None else integration.dt
    if dt > duration:
        raise ConfigurationError(f"dt is {dt}; give a time from above 0 to the duration [s]")
    run = Runs(
        [system], [controllers], [ready], start_state(system, rates)[None],
        coupled(system, ready.setup), np.arange(0.0, duration, dt), duration, wanted,
        (integration.rtol, integration.atol), integration.method,
    )  # fmt: skip
    if period is None:
        run.advance(duration, progress)
    else:
        period = positive(period, "period", "time [s]")
        delay = float(finite(delay, (), "delay", "[s]"))
        if not 0.0 <= delay <= period:
            raise ConfigurationError(f"delay is {delay}; give a time from 0 to the period [s]")
        run.advance_sampled(duration, period, delay, progress)
    fault = run.fault[0]
    if fault and run.batch.steps[0] == 0:
        raise NoSolutionError(f"{arm.name}: {fault}", None)
    result = run.trajectory()
    if fault:
        raise NoSolutionError(f"{arm.name}: {fault}", result)
    _audit(result, run.drift, integration)
    return result


def _audit(result: Trajectory, drift: float, integration: Integration) -> None:
    """Check the balances of energy and momentum.

    Raises:
        NoSolutionError: One is off.
    """
    still = STILL * integration.atol / result.turnover if result.turnover > 0.0 else 0.0
    for what, off, more in (("energy", result.imbalance, still), ("momentum", drift, 0.0)):
        if off > AUDIT * integration.rtol + more:
            raise NoSolutionError(
                f"{result.arm.name}: the balance of {what} is off by {off:.1e} of what came and "
                "went; take smaller rtol and atol",
                result,
            )


def _by_tip(
    arm: SpaceArm, controller: Controller | Mapping[str, Controller]
) -> dict[int, Controller]:
    """Return the controllers by the number of the tip that they lead, -1 for all joints."""
    if not isinstance(controller, Mapping):
        check_controller(controller)
        arm.require_one_tip()  # whose path the trajectory holds
        return {-1: controller}
    for tip, law in controller.items():
        check_controller(law)
        if tip not in arm.tips:
            raise ConfigurationError(unknown("tip", tip, arm.tips))
    return {arm.tips.index(tip): law for tip, law in controller.items()}
