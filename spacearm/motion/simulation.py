"""Simulation: a floating arm under joint torques, in time.

The state that is integrated is the reduced one: joint positions and rates, the spacecraft's
attitude as a unit quaternion, and what changes under wrenches and wheels only: momentum and the
system CM. The work of the torques is integrated beside it, so that every trajectory has a balance
of its energy.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt

from spacearm.arrays import finite, positive
from spacearm.errors import ConfigurationError, NoSolutionError, unknown
from spacearm.mechanics.jacobian import momentum_vector
from spacearm.model.arguments import BaseMode, of_arm
from spacearm.model.arm import SpaceArm
from spacearm.model.frames import PoseLike
from spacearm.model.joints import joint_vector
from spacearm.motion.controllers import Controller, check_controller, check_target
from spacearm.motion.events import EVENTS
from spacearm.motion.goal import Origin, started
from spacearm.motion.plant import Motors, PassiveJoint, Plant, WheelHold, Wrench, described
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


@of_arm
def simulate(
    arm: SpaceArm,
    q0: npt.ArrayLike,
    controller: Controller | Mapping[str, Controller],
    duration: float,
    *,
    base: PoseLike | None = None,
    origin: Origin = "spacecraft",
    dq0: npt.ArrayLike | None = None,
    momentum: npt.ArrayLike | None = None,
    wheels0: npt.ArrayLike | None = None,
    mode: BaseMode = "free-floating",
    wheels: WheelHold | Motors | None = None,
    wrenches: Mapping[str, Wrench] | None = None,
    thrusters: Mapping[str, Wrench] | None = None,
    passive: Mapping[str, PassiveJoint] | Literal["described"] | None = None,
    limits: Collection[str] = (),
    period: float | None = None,
    delay: float = 0.0,
    rtol: float = 1e-8,
    atol: float = 1e-10,
    events: Sequence[str] = EVENTS,
    stop: Sequence[str] = (),
    reach: float = 1e-3,
    dt: float | None = None,
    method: str = "auto",
    progress: Callable[[float, float], object] | None = None,
) -> Trajectory:
    """Simulate an arm under the torques of a controller.

    Args:
        arm: The arm.
        q0: (n,) joint positions at the start [rad] or [m].
        controller: Called as controller(t, cfg, dq), returns (n,) torques [N m] or forces [N]; at
            times in any order, so that it must not remember. Plain array code is compiled, other
            code is called in Python. Of an arm with several tips a law for each, by the tip's name:
            it acts on the joints that move that tip.
        duration: How long [s].
        base: Pose of the spacecraft at the start; the identity if None.
        origin: Where the inertial frame has its origin: "spacecraft", as `base` says, so that
            poses of `SpaceArm.at` are goals as they are; or "cm", the system CM at the start, as
            for points of a `Workspace`, `base` giving the attitude.
        dq0: (n,) joint rates at the start; zeros if None.
        momentum: (6,) momentum at the start [linear; angular about the system CM], inertial axes,
            that of the wheels included; zero if None. Where the spacecraft's attitude is
            controlled only the linear one counts.
        wheels0: (w,) what each wheel holds at the start [N m s]; zeros if None.
        mode: What the spacecraft does; see `generalized_jacobian`.
        wheels: The law by which the wheels hold the attitude, or a function of time that gives the
            torque of each, the rate of what it holds (w,) [N m]; they keep what they hold if None.
        wrenches: Wrenches (6,) [force [N]; torque [N m]] on links by name, at the origin of the
            link's frame along inertial axes, or functions of time that give them.
        thrusters: The same along the axes of the link.
        passive: Springs, damping and friction of joints by name; such a joint may have torques too;
            "described" takes damping and dry friction of the robot's file (URDF, MJCF).
        limits: "effort" cuts the torques to the largest of the description; "velocity" lets the
            torque that drives a joint fall to zero between 90 % and 100 % of its largest rate.
        period: Period of a controller of fixed rate, which holds its torques in between [s]; None
            for one that acts at all times.
        delay: Time after which these torques act, up to the period [s].
        rtol: Relative tolerance of each step.
        atol: Absolute one [rad], [m], [rad/s], [m/s], [J].
        events: What to note: "singularity" (the determinant of the task Jacobian changes its sign,
            or where J* is not square the distance to the singular set falls to half a degree),
            "joint limit", "target" (the controller's `error` falls to `reach`), "wheel full".
        stop: Which of them end the run.
        reach: How near the target is reached: norm of the error.
        dt: Spacing of the output [s]; a thousandth of the duration if None.
        method: "DOP853" (explicit, of order 8), "Rodas5P" (linearly implicit, of order 5, for stiff
            torques) or "auto", which begins with the first and takes the second where that pays.
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
        >>> sa.simulate(sa.load("planar2"), [0.3, 1.2], law, 5.0)
        Trajectory(planar2, free-floating: 5 s, 1001 times, ended by duration)
    """
    duration = positive(duration, "duration", "time [s]")
    dt = duration / OUTPUTS if dt is None else positive(dt, "dt", "time [s]")
    if dt > duration:
        raise ConfigurationError(f"dt is {dt}; give a time from above 0 to the duration [s]")
    rtol, atol, reach = positive(rtol, "rtol"), positive(atol, "atol"), positive(reach, "reach")
    if rtol < FINEST:
        raise ConfigurationError(f"rtol is {rtol}; give a number from {FINEST:.2g} on")
    if method not in METHODS:
        raise ConfigurationError(unknown("method", method, METHODS))
    h = momentum_vector(momentum)
    if mode == "fixed" and h.any():
        raise ConfigurationError(f"momentum is {momentum!r}; a fixed spacecraft takes it up")
    dq = np.zeros(arm.n) if dq0 is None else joint_vector(arm, dq0, "dq0")
    if isinstance(passive, str):
        if passive != "described":
            raise ConfigurationError(unknown("passive", passive, ("described",)))
        passive = described(arm)
    plant = Plant(
        arm,
        mode,
        started(arm.at(q0, base=base, wheels=wheels0), origin),
        passive or {},
        tuple(limits),
        wheels if isinstance(wheels, WheelHold) else None,
        None if isinstance(wheels, WheelHold) else wheels,
        wrenches or {},
        thrusters or {},
    )
    controllers = _by_tip(arm, controller)
    if mode != "fixed" and not h[:3].any() and not plant.pushed and len(arm.tips) == 1:
        for one in controllers.values():
            check_target(one, plant.start)
    capacity = None if plant.hold is None else plant.hold.capacity
    kinds = dict.fromkeys((*events, *stop))
    wanted = wanted_events(arm, mode, kinds, stop, reach, controllers, capacity)
    ready = prepared(plant, controllers, wanted)
    y, needs = start_state(plant, dq, h), coupled(plant, ready.setup, h)
    outputs = np.arange(0.0, duration, dt)
    run = Runs([plant], [controllers], [ready], y[None], needs, outputs, duration, wanted,
               (rtol, atol), method)  # fmt: skip
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
    _audit(result, run.drift, rtol, atol)
    return result


def _audit(result: Trajectory, drift: float, rtol: float, atol: float) -> None:
    """Check the balances of energy and momentum.

    Raises:
        NoSolutionError: One is off.
    """
    still = STILL * atol / result.turnover if result.turnover > 0.0 else 0.0
    for what, off, more in (("energy", result.imbalance, still), ("momentum", drift, 0.0)):
        if off > AUDIT * rtol + more:
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
