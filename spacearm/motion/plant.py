"""What acts on a simulated arm besides its controller, and how a simulation is integrated."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from spacearm.arrays import (
    LARGEST,
    Array,
    ArrayLike,
    Parameters,
    finite,
    named,
    positive,
    shape_of,
    steps,
    whole,
    within,
)
from spacearm.errors import ConfigurationError
from spacearm.model.arm import SpaceArm
from spacearm.motion.events import EVENTS
from spacearm.results import Table
from spacearm.signatures import checked, shown

#: (6,) [force [N]; torque [N m]], or a function of time [s] that gives it.
Wrench: TypeAlias = ArrayLike | Callable[[float], ArrayLike]
#: A function of time [s] that gives the torque of each wheel's motor (w,) [N m].
Motors: TypeAlias = Callable[[float], ArrayLike]


#: Intervals of the output of a run, if no other is asked for.
OUTPUTS = 1000
#: Most of them, as each takes up to a kilobyte.
MOST_OUTPUTS = 1_000_000
#: Share that is rounding: of an interval of the output, which is then not worth a row of its own,
#: and of a largest torque by which a multiple of its step may exceed it.
ROUNDING = 1e-9
#: The least `atol` that the integrators take.
LEAST_TOLERANCE = 1e-30
#: The least `rtol` that the integrators take.
FINEST = 100.0 * float(np.finfo(np.float64).eps)


class PassiveJoint(NamedTuple):
    """What a joint does besides its motor: a spring, damping and dry friction.

    Attributes:
        stiffness: Of the spring [N m/rad] or [N/m].
        rest: Where the spring is at rest [rad] or [m].
        damping: Viscous friction [N m s/rad] or [N s/m].
        friction: Dry friction [N m] or [N], smooth about rest: friction tanh(dq / slip).
        slip: Rate below which it falls [rad/s] or [m/s]; small values take small steps.
    """

    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    slip: float = 1e-3

    def to_dict(self) -> dict[str, Any]:
        """Return all fields."""
        return named(self)


def described(arm: SpaceArm) -> dict[str, PassiveJoint]:
    """Return damping and dry friction of the joints as the description gives them, by name.

    What joints that follow others by mimic take is added to what their leaders do.
    """
    coupling = np.eye(arm.n) if arm.coupling is None else np.abs(arm.coupling)
    joints = [arm.tree.joints[name] for name in list(arm.model.names)[2:]]
    damping = coupling.T**2 @ np.array([joint.damping for joint in joints])
    friction = coupling.T @ np.array([joint.friction for joint in joints])
    return {
        name: PassiveJoint(damping=float(damping[j]), friction=float(friction[j]))
        for j, name in enumerate(arm.joint_names)
        if damping[j] or friction[j]
    }


@checked
@dataclass(frozen=True, kw_only=True)
class WheelHold(Parameters):
    """Wheels that hold the spacecraft's attitude at the start until they saturate.

    Their torque on the spacecraft is -stiffness phi - damping w_0, where phi is the rotation vector
    from the attitude at the start and w_0 the angular velocity. Each wheel's share follows from the
    pseudo-inverse of their axes and is cut to `torque`. A wheel that holds `capacity` takes no
    more: the event "wheel full".

    Attributes:
        stiffness: K [N m/rad].
        damping: C [N m s/rad].
        torque: Largest torque of a wheel's motor [N m], friction of its bearings included.
        capacity: Largest momentum that a wheel holds [N m s].
        sampled: Whether a simulation computes the law at the control instants of its `sampling`,
            from the measured attitude and angular velocity, and holds the torques in between. If
            not, the law acts continuously and without noise.
        torque_quantum: Step of the torque of a sampled law [N m]: it is rounded to the nearest
            multiple that the motor can give; 0 for no rounding.
    """

    stiffness: float
    damping: float
    torque: float = np.inf
    capacity: float = np.inf
    sampled: bool = False
    torque_quantum: float = 0.0

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping", "torque", "capacity"):
            most = LARGEST if name in ("stiffness", "damping") else math.inf
            within(getattr(self, name), f"{name} of the wheels", 0.0, most)
        quantum = within(self.torque_quantum, "torque_quantum of the wheels", 0.0)
        if quantum > 0.0 and not self.sampled:
            raise ConfigurationError(
                f"torque_quantum of the wheels is {quantum:g} and sampled is False; give "
                "sampled=True, or leave torque_quantum out"
            )

    def quantised(self, torque: Array) -> Array:
        """Return torques, rounded to the nearest multiples of `torque_quantum` within `torque`."""
        quantum = self.torque_quantum
        if quantum == 0.0:
            return torque
        steps = self.torque / quantum
        most = math.inf if steps == math.inf else math.floor(steps * (1.0 + ROUNDING))
        return quantum * np.clip(np.round(torque / quantum), -most, most)


@checked
@dataclass(frozen=True, kw_only=True)
class WheelFriction(Parameters):
    """Friction in the bearings of a wheel: viscous, and dry (Coulomb), smooth about rest.

    A wheel that holds the momentum h is slowed by the torque viscous h + dry tanh(h / slip). The
    link that carries the wheel gets the opposite torque. The momentum h is that of the rotation
    relative to this link. The drag of reaction wheels is modelled as viscous and Coulomb friction
    (Markley and Crassidis, Fundamentals of Spacecraft Attitude Determination and Control (2014),
    section 4.8, DOI 10.1007/978-1-4939-0802-8). The hyperbolic tangent makes the dry part smooth
    (Andersson et al., Tribol. Int. 40, 580-587 (2007), DOI 10.1016/j.triboint.2005.11.014).

    Attributes:
        viscous: Coefficient of viscous friction [N m s/rad] over the moment of inertia of the wheel
            [1/s].
        dry: Torque of dry friction [N m].
        slip: Momentum below which dry friction falls [N m s]; small values take small steps.
    """

    viscous: float = 0.0
    dry: float = 0.0
    slip: float = 1e-3

    def __post_init__(self) -> None:
        within(self.viscous, "viscous of the wheel friction", 0.0, LARGEST, "a rate [1/s]")
        within(self.dry, "dry of the wheel friction", 0.0, LARGEST, "a torque [N m]")
        positive(self.slip, "slip of the wheel friction", "momentum [N m s]")

    @property
    def acts(self) -> bool:
        """Whether there is friction at all."""
        return self.viscous > 0.0 or self.dry > 0.0

    @property
    def numbers(self) -> Array:
        """(3,) the values as `equations.plant.wheel_friction` takes them."""
        return np.array([self.viscous, self.dry, self.slip])


@checked
@dataclass(frozen=True, kw_only=True)
class Plant(Parameters):
    """What acts on a simulated arm besides its controller.

    Attributes:
        wheels: The law by which the wheels hold the attitude, or a function of time that gives the
            torque of each motor (w,) [N m]. Without friction it is the rate of the momentum that
            the wheel holds. If None the motors are off.
        wrenches: Wrenches (6,) [force [N]; torque [N m]] on links by name, at the origin of the
            link's frame along inertial axes, or functions of time that give them.
        thrusters: The same along the axes of the link.
        passive: Springs, damping and friction of joints by name; such a joint may have torques too;
            "described" takes damping and dry friction of the robot's file (URDF, MJCF).
        wheel_friction: Friction in the bearings of each wheel: `WheelFriction(...)`, or one number,
            the rate of viscous friction [1/s]. What the wheel loses goes to the link that carries
            it. Limits of a wheel's torque are limits of its motor: the motor accelerates the wheel
            and overcomes friction.
        limits: Whether the motors keep the limits of the description: torques are cut to the
            largest effort, and the torque that drives a joint falls to zero between 90 % and 100 %
            of its largest velocity.
    """

    wheels: WheelHold | Motors | None = None
    wrenches: Mapping[str, Wrench] = field(default_factory=dict)
    thrusters: Mapping[str, Wrench] = field(default_factory=dict)
    passive: Mapping[str, PassiveJoint] | Literal["described"] = field(default_factory=dict)
    limits: bool = False
    wheel_friction: float | WheelFriction = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.wheel_friction, WheelFriction):
            within(self.wheel_friction, "wheel_friction", 0.0, LARGEST, "a rate [1/s]")
        for link, wrench, _ in self.pushed:
            wrench_at(link, wrench, 0.0)
        for name, joint in () if isinstance(self.passive, str) else self.passive.items():
            where = f"passive joint {name!r}: "
            for field_name, value in joint._asdict().items():
                finite(value, (), where + field_name)
            within(joint.damping, where + "damping", 0.0)
            positive(joint.slip, where + "slip")

    @property
    def friction_of_wheels(self) -> WheelFriction:
        """The friction of the wheels, if one number is given that is viscous."""
        given = self.wheel_friction
        return given if isinstance(given, WheelFriction) else WheelFriction(viscous=given)

    @property
    def pushed(self) -> list[tuple[str, Wrench, bool]]:
        """Link, wrench, and whether it is along the link's own axes, for each wrench."""
        both = (self.wrenches, False), (self.thrusters, True)
        return [(link, wrench, own) for given, own in both for link, wrench in given.items()]


@checked
@dataclass(frozen=True, kw_only=True)
class Integration(Parameters):
    """How a simulation is integrated, and which events it looks for on the way.

    Attributes:
        rtol: Relative tolerance of each step.
        atol: Absolute one [rad], [m], [rad/s], [m/s], [J].
        dt: Spacing of the output [s]; a thousandth of the duration if None.
        events: Events to record: "singularity", "joint limit", "target" and "wheel full".
            Singularity: the determinant of the task Jacobian changes its sign, or, where J* is not
            square, the distance to the singular set falls to half a degree. Target: the
            controller's `error` falls to `reach`.
        reach: How near the target is reached: norm of the error.
        method: "DOP853" (explicit, of order 8), "Rodas5P" (linearly implicit, of order 5, for stiff
            torques) or "auto", which begins with DOP853 and switches to Rodas5P where that is
            faster.
    """

    rtol: float = 1e-8
    atol: float = 1e-10
    dt: float | None = None
    events: Sequence[str] = EVENTS
    reach: float = 1e-3
    method: Literal["auto", "DOP853", "Rodas5P"] = "auto"

    def __post_init__(self) -> None:
        within(self.rtol, "rtol", FINEST)
        positive(self.atol, "atol", least=LEAST_TOLERANCE)
        positive(self.reach, "reach")
        if self.dt is not None:
            positive(self.dt, "dt", "time [s]")

    def times(self, duration: float) -> Array:
        """Return the times of the outputs of a run before its end [s].

        Raises:
            ConfigurationError: The time between them is longer than the run.
        """
        dt = steps(duration, self.dt or duration / OUTPUTS, "dt", MOST_OUTPUTS)
        if dt > duration:
            raise ConfigurationError(f"dt is {dt}; give a time from above 0 to the duration [s]")
        return dt * np.arange(math.ceil(duration / dt - ROUNDING))


@checked
@dataclass(frozen=True, kw_only=True)
class Sampling(Parameters):
    """How a controller in a computer sees the arm and acts.

    At each multiple of the period it gets what the sensors measure. Its torques act after the
    delay, until the next ones do. Noise is normally distributed, drawn anew at each sample. The
    system CM, the momentum and what wheels hold are known exactly. A controller with a memory
    updates it at each sample; see `simulate`.

    Attributes:
        period: Time between two samples [s].
        delay: Time after which torques act [s]; it may be longer than the period.
        position_noise: Standard deviation of the measured joint positions [rad] or [m], one number
            or (n,).
        rate_noise: That of the joint rates [rad/s] or [m/s], likewise.
        attitude_noise: That of the spacecraft's attitude, a turn about each of its axes [rad], one
            number or (3,).
        gyro_noise: That of the spacecraft's angular velocity about each of its axes [rad/s], one
            number or (3,). A law of the wheels that is sampled uses it; see `WheelHold`.
        seed: Seed of the noise; run i of `simulate_many` is that of `simulate` with seed + i.
    """

    period: float
    delay: float = 0.0
    position_noise: ArrayLike = 0.0
    rate_noise: ArrayLike = 0.0
    attitude_noise: ArrayLike = 0.0
    gyro_noise: ArrayLike = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        positive(self.period, "period", "time [s]")
        whole(self.seed, "seed", 0, math.inf)
        within(self.delay, "delay", 0.0, LARGEST, "a time [s]")

    @property
    def tracking_rate(self) -> float:
        """A rate for `Tracking` [1/s] that stays stable: at most 0.52 of the rate that does not.

        Under computed torque the joints are double integrators. With a torque held over the period
        T they are stable for rates below 1 / T; with a delay d much longer than T, for rates below
        0.648 / d.
        """
        return 0.5 / (self.period + 1.5 * self.delay)

    def noise(self, n: int) -> Array:
        """Return the standard deviations (2 n + 6,) of positions, rates, attitude and gyros.

        Raises:
            ConfigurationError: They have other shapes, or are below 0.
        """
        parts = []
        joints, spacecraft = ("position_noise", "rate_noise"), ("attitude_noise", "gyro_noise")
        for name in (*joints, *spacecraft):
            size = n if name in joints else 3
            value, shape = getattr(self, name), (size,) if shape_of(getattr(self, name)) else ()
            deviation = finite(value, shape, name, f"(standard deviation), one number or {size}")
            if deviation.min() < 0.0:
                raise ConfigurationError(f"{name} is {shown(value)}; give deviations from 0 on")
            parts.append(np.broadcast_to(deviation, size))
        return np.concatenate(parts)


def wheel_torques(values: ArrayLike, count: int) -> Array:
    """Return the torques of the wheels at a time, checked."""
    return finite(values, (count,), "wheels", "[N m], one for each wheel")


def wrench_at(link: str, wrench: Wrench, t: float) -> Array:
    """Return a wrench at a time, checked."""
    values = wrench(t) if callable(wrench) else wrench
    return finite(values, (6,), f"the wrench on {link!r}", "[force [N]; torque [N m]]")


class MotorLoad(NamedTuple):
    """Largest torque of a motor during a simulation, and how long it was at its limit.

    Attributes:
        motor: Name of the joint or wheel.
        largest: Largest torque [N m], or force of a sliding joint [N].
        share: Share of the time, 0 to 1, in which the torque is at the limit or beyond it: at the
            limit for the rate of the joint then, which falls near its largest velocity (`Plant`).
        limit: The limit at rest: the effort of the description, or the torque of `WheelHold`.
        enforced: Whether the simulation cut the torque to the limit.
    """

    motor: str
    largest: float
    share: float
    limit: float
    enforced: bool

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain data."""
        return named(self)


def share_of_time(t: Array, holds: npt.NDArray[np.bool_]) -> float:
    """Return the share of the time in which something holds at samples t (m,)."""
    if len(t) < 2:
        return float(holds.all())
    return float(np.trapezoid(holds.astype(float), t) / (t[-1] - t[0]))


def motor_table(motors: Sequence[MotorLoad]) -> list[Table]:
    """Return the table of motors with a limit; none if there are no such motors."""
    if not motors:
        return []
    columns = ("motor", "largest torque", "limit", "time at the limit")
    rows = [
        (load.motor, f"{load.largest:.4g}", f"{load.limit:.4g}", f"{load.share:.1%}")
        for load in motors
    ]
    return [Table(columns, rows, "Motors [N m], sliding joints [N]")]


def motor_notes(motors: Sequence[MotorLoad]) -> list[str]:
    """Say which motors were at their limit, and which went beyond a limit that was not enforced."""
    reached = [load for load in motors if load.share > 0.0]
    cut = [f"{load.motor} {load.share:.1%} of the time" for load in reached if load.enforced]
    beyond = [
        f"{load.motor} {load.largest:.4g} of {load.limit:.4g}, {load.share:.1%} of the time"
        for load in reached
        if not load.enforced
    ]
    notes = []
    if cut:
        notes.append(f"torque at its limit: {', '.join(cut)}")
    if beyond:
        notes.append(f"torque beyond its limit, which was not enforced: {', '.join(beyond)}")
    return notes


def jump_notes(size: float) -> list[str]:
    """Say by how much [N m s] the momentum of a motion jumps, if it does."""
    if not size:
        return []
    return [
        f"the joint rates jump, and what wheels hold by up to {size:.4g} N m s at once, which no "
        "torque can do; a path with times is smooth"
    ]
