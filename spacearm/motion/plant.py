"""The plant of a simulation: what acts on an arm besides its controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import LARGEST, Array, finite, plain
from spacearm.errors import ConfigurationError, UnsupportedError, unknown
from spacearm.model.arguments import BaseMode, free_components
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.model.joints import joint_name

Wrench: TypeAlias = npt.ArrayLike | Callable[[float], npt.ArrayLike]
"""(6,) [force [N]; torque [N m]], or a function of time [s] that gives it."""
Motors: TypeAlias = Callable[[float], npt.ArrayLike]
"""A function of time [s] that gives the torque of each wheel (w,), which it takes up [N m]."""


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
        return {name: plain(value) for name, value in self._asdict().items()}


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


@dataclass(frozen=True, kw_only=True)
class WheelHold:
    """Wheels that hold the spacecraft's attitude at the start until they saturate.

    Their torque on the spacecraft is -stiffness phi - damping w_0, phi the rotation vector from the
    attitude at the start and w_0 the angular velocity, each wheel's share by the pseudo-inverse of
    their axes; it is cut to `torque`. A wheel that holds `capacity` takes no more: the event
    "wheel full".

    Attributes:
        stiffness: K [N m/rad].
        damping: C [N m s/rad].
        torque: Largest torque of a wheel's motor [N m].
        capacity: Largest momentum that a wheel holds [N m s].
    """

    stiffness: float
    damping: float
    torque: float = np.inf
    capacity: float = np.inf

    def to_dict(self) -> dict[str, Any]:
        """Return all fields."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping", "torque", "capacity"):
            value = getattr(self, name)
            if not value >= 0.0:
                raise ConfigurationError(f"{name} of the wheels is {value!r}; give one from 0 on")


@dataclass(frozen=True, kw_only=True)
class Plant:
    """What acts on a simulated arm besides its controller.

    Attributes:
        wheels: The law by which the wheels hold the attitude, or a function of time that gives the
            torque of each, the rate of what it holds (w,) [N m]; they keep what they hold if None.
        wrenches: Wrenches (6,) [force [N]; torque [N m]] on links by name, at the origin of the
            link's frame along inertial axes, or functions of time that give them.
        thrusters: The same along the axes of the link.
        passive: Springs, damping and friction of joints by name; such a joint may have torques too;
            "described" takes damping and dry friction of the robot's file (URDF, MJCF).
        limits: Whether the motors keep the limits of the description: torques are cut to the
            largest effort, and the torque that drives a joint falls to zero between 90 % and 100 %
            of its largest velocity.
    """

    wheels: WheelHold | Motors | None = None
    wrenches: Mapping[str, Wrench] = field(default_factory=dict)
    thrusters: Mapping[str, Wrench] = field(default_factory=dict)
    passive: Mapping[str, PassiveJoint] | Literal["described"] = field(default_factory=dict)
    limits: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.limits, (bool, np.bool_)):
            raise ConfigurationError(f"limits is {self.limits!r}; give True or False")
        for link, wrench, _ in self.pushed:
            _wrench_at(link, wrench, 0.0)
        if isinstance(self.passive, str):
            if self.passive != "described":
                raise ConfigurationError(unknown("passive", self.passive, ("described",)))
            return
        for name, joint in self.passive.items():
            values = np.array(joint, dtype=np.float64)
            if not (np.abs(values) <= LARGEST).all() or joint.slip <= 0.0 or joint.damping < 0.0:
                raise ConfigurationError(
                    f"passive joint {name!r} is {joint!r}; give finite numbers, damping from 0 on "
                    "and slip above 0"
                )

    @property
    def pushed(self) -> list[tuple[str, Wrench, bool]]:
        """Link, wrench and whether it is along the link's own axes, of all that is pushed."""
        return [
            *((link, wrench, False) for link, wrench in self.wrenches.items()),
            *((link, wrench, True) for link, wrench in self.thrusters.items()),
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain data, functions as their repr."""
        return {f.name: _plain(getattr(self, f.name)) for f in fields(self)}


@dataclass(frozen=True)
class System:
    """An arm at its start, and what acts on it besides its controllers; checked.

    Attributes:
        start: Configuration at the start.
        mode: What the spacecraft does.
        plant: What acts.
    """

    start: Configuration
    mode: BaseMode
    plant: Plant

    def __post_init__(self) -> None:
        free_components(self.mode)
        arm, h, wheels = self.arm, self.start.momentum, self.plant.wheels
        if self.mode == "fixed" and h.any():
            raise ConfigurationError(
                f"momentum of the start is {h.tolist()}; a fixed spacecraft takes it up"
            )
        for link, *_ in self.pushed:
            if link not in arm.tree.links:
                raise ConfigurationError(unknown("link", link, arm.tree.links))
        for name in self.passive:
            joint_name(arm, name)
        if wheels is None:
            return
        if self.mode != "free-floating":
            raise ConfigurationError(
                f"wheels turn the spacecraft and mode is {self.mode!r}; give mode='free-floating'"
            )
        if not arm.wheels:
            raise UnsupportedError(
                f"{arm.name} has no wheels; load it with wheels=[...], the names of joints"
            )
        if self.motors is not None:
            wheel_torques(self.motors(0.0), len(arm.wheels))

    @property
    def arm(self) -> SpaceArm:
        """The arm."""
        return self.start.arm

    @property
    def hold(self) -> WheelHold | None:
        """The law of the wheels, if they hold the attitude."""
        return self.plant.wheels if isinstance(self.plant.wheels, WheelHold) else None

    @property
    def motors(self) -> Motors | None:
        """The torques of the wheels over time, if they are given."""
        return None if isinstance(self.plant.wheels, WheelHold) else self.plant.wheels

    @cached_property
    def passive(self) -> Mapping[str, PassiveJoint]:
        """Springs, damping and friction of joints, by name."""
        given = self.plant.passive
        return described(self.arm) if isinstance(given, str) else given

    @property
    def pushed(self) -> list[tuple[str, Wrench, bool]]:
        """As in `Plant`."""
        return self.plant.pushed

    def configuration(self, y: Array) -> Configuration:
        """Return the configuration in a state, see `equations.plant`."""
        arm, n = self.arm, self.arm.n
        q, quaternion = y[:n].copy(), y[2 * n : 2 * n + 4]
        if self.mode == "fixed":
            placed = kinematics(arm, q, self.start.base)
        else:
            attitude = pin.Quaternion(quaternion / np.linalg.norm(quaternion))
            turned = kinematics(arm, q, pin.SE3(attitude, np.zeros(3)))
            placed = turned.centred(y[2 * n + 4 : 2 * n + 7])
        h = y[2 * n + 7 : 2 * n + 13]
        if not arm.wheels and not h.any():
            return placed
        return arm.at(q, base=placed.base, wheels=y[2 * n + 17 :], momentum=h)

    def acting(self, t: Array, q: Array, base: Array) -> dict[str, Array]:
        """Return the wrenches on each link that is pushed, along inertial axes.

        Args:
            t: (m,) times [s].
            q: (m, n) joint positions.
            base: (m, 7) poses of the spacecraft.

        Returns:
            (m, 6) [force [N]; torque [N m]] at the origin of the link's frame, by its name.
        """
        model, data = self.arm.model, pin.Data(self.arm.model)
        found: dict[str, Array] = {link: np.zeros((len(t), 6)) for link, *_ in self.pushed}
        for i, time in enumerate(t):
            if self.plant.thrusters:
                pose = pin.XYZQUATToSE3(base[i])
                pin.framesForwardKinematics(model, data, kinematics(self.arm, q[i], pose).full)
            for link, wrench, own in self.pushed:
                values = _wrench_at(link, wrench, float(time))
                if own:
                    R = data.oMf[model.getFrameId(link, pin.BODY)].rotation
                    values = (values.reshape(2, 3) @ R.T).ravel()
                found[link][i] += values
        return found


def wheel_torques(values: npt.ArrayLike, count: int) -> Array:
    """Return the torques of the wheels at a time, checked."""
    return finite(values, (count,), "wheels", "[N m], one for each wheel")


def checked_wrench(link: str, values: npt.ArrayLike) -> Array:
    """Return a wrench at a time, checked."""
    return finite(values, (6,), f"the wrench on {link!r}", "[force [N]; torque [N m]]")


def _wrench_at(link: str, wrench: Wrench, t: float) -> Array:
    """Return a wrench at a time, checked."""
    return checked_wrench(link, wrench(t) if callable(wrench) else wrench)


def _plain(value: Any) -> Any:
    """Return a field of a plant as plain data, functions as their repr."""
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}
    return repr(value) if callable(value) else plain(value)
