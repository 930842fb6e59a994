"""Motions: joint positions and spacecraft poses over time; trajectories have torques, too."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, TypeVar

import numpy as np
import pinocchio as pin
import scipy

from spacearm.arrays import (
    LARGEST,
    Array,
    ArrayLike,
    finite,
    numbers_of,
    plain,
    read_only,
    shape_of,
    within,
)
from spacearm.errors import ConfigurationError, listed
from spacearm.files import arrays_in
from spacearm.mechanics.batch import evaluate
from spacearm.mechanics.dynamics import momentum_and_torque
from spacearm.mechanics.jacobian import drift_of, momentum_matrix, singular_values, solve_locked
from spacearm.model.arguments import FLOATING, BaseMode, free_components
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.model.frames import pose_between
from spacearm.model.joints import joint_vector
from spacearm.model.wheels import WheelLoad, carried
from spacearm.motion import motion_file
from spacearm.motion.events import Event, events_table
from spacearm.motion.goal import origin_of
from spacearm.motion.motion_file import Layout, Quantity, unit_quaternions
from spacearm.motion.plant import MotorLoad, jump_notes, motor_notes, motor_table
from spacearm.polynomial.certificate import Certificate
from spacearm.polynomial.tubes import straight
from spacearm.results import Cell, Column, Description, Measure, Result, Table, joint_measures
from spacearm.signatures import fits, shown
from spacearm.singularities.nearest import distances_found
from spacearm.singularities.sets import prove_regular

if TYPE_CHECKING:
    import xarray as xr

#: What is said of the loads of a motion that ends so.
UNBOUNDED = (
    "no bound: the tip is led at a constant speed to where the task Jacobian is singular, and "
    "joint rates, momentum and torque grow without limit there"
)


class RateJump(NamedTuple):
    """A jump of the joint rates, with a jump of what wheels hold that no torque follows.

    Attributes:
        t: When [s].
        q: (n,) joint positions then.
        change: (n,) of the joint rates [rad/s] or [m/s].
    """

    t: float
    q: Array
    change: Array


class Playable(Protocol):
    """Any object that `Motion.of` and `sa.view` take."""

    @property
    def arm(self) -> SpaceArm:
        """The arm."""

    @property
    def t(self) -> Any:
        """(m,) times, increasing [s]."""

    @property
    def q(self) -> Any:
        """(m, n) joint positions [rad] or [m]."""

    @property
    def base(self) -> Any:
        """(m, 7) or m pin.SE3: spacecraft poses."""


AnyMotion = TypeVar("AnyMotion", bound="Motion")


class Motion(Result):
    """A sampled motion.

    `len(motion)` is the number of samples, `motion[i]` the configuration of one of them and
    `motion.at(t)` that at a time. Between the samples the joints follow `spline`. What is not given
    is computed from the samples when it is first asked for.

    Attributes:
        arm: The arm.
        t: (m,) times, increasing [s].
        q: (m, n) joint positions [rad] or [m].
        base: (m, 7) poses of the spacecraft: position [m], quaternion xyzw, inertial frame.
        mode: What the spacecraft does; see `generalized_jacobian`.

    Raises:
        ConfigurationError: An array has the wrong shape, or values that no motion has.
    """

    arm: SpaceArm
    t: Array
    q: Array
    base: Array
    mode: BaseMode = field(default="free-floating", kw_only=True)

    #: All that is known at each time, stored or computed.
    QUANTITIES: ClassVar[Mapping[str, Quantity]] = {
        "t": Quantity("s"),
        "q": Quantity("rad or m", "joint"),
        "dq": Quantity("rad/s or m/s", "joint"),
        "base": Quantity("m, quaternion xyzw", "pose"),
        "tip": Quantity("m, quaternion xyzw", "pose"),
        "com": Quantity("m", "axis"),
        "sigma_min": Quantity("as in sa.singularity"),
    }

    def __post_init__(self) -> None:
        m, n = max((*shape_of(self.t), 1)[0], 1), self.arm.n
        for name, shape in (("t", (m,)), ("q", (m, n)), ("base", (m, 7))):
            object.__setattr__(self, name, finite(getattr(self, name), shape, f"motion: {name}"))
        super().__post_init__()
        free_components(self.mode)
        if not unit_quaternions(self.base):
            raise ConfigurationError(
                "motion: base holds quaternions that are not of length 1; give poses as "
                "pin.SE3ToXYZQUAT does"
            )
        if (np.diff(self.t) <= 0.0).any():
            raise ConfigurationError("motion: t does not increase; give times in order, each once")

    @classmethod
    def of(cls, thing: Any) -> Motion:
        """Return the motion in any object with `arm`, `t`, `q` and `base`, a motion as it is.

        Args:
            thing: The object; `base` may be (m, 7) numbers or a sequence of pin.SE3.

        Raises:
            ConfigurationError: The object lacks one of them, or its values are wrong.
        """
        if isinstance(thing, Motion):
            return thing
        fit = fits(thing, Playable) and isinstance(thing.arm, SpaceArm)
        if not fit or not isinstance(thing.base, Iterable):
            raise ConfigurationError(
                f"{shown(thing)} cannot be played; give a motion, or an object with arm, t (m,), "
                "q (m, n) and base (m poses)"
            )
        base = [pin.SE3ToXYZQUAT(b) if isinstance(b, pin.SE3) else b for b in thing.base]
        return Motion(thing.arm, thing.t, thing.q, numbers_of(base, "base"))

    def __len__(self) -> int:
        return len(self.t)

    @cached_property
    def spline(self) -> scipy.interpolate.PPoly:
        """Joint positions (n,) over time between the samples, as `sa.Tracking` follows them.

        It goes through the rates and accelerations of the samples where these are the motion's own,
        as those of a plan or a simulation; else it is a cubic spline through the positions.
        """
        if len(self) == 1:
            return scipy.interpolate.PPoly(self.q[None], [self.t[0], self.t[0] + 1.0])
        if not self._has_rates:
            return scipy.interpolate.CubicSpline(self.t, self.q)
        rows = np.stack((self.q, self.dq, self.ddq), axis=1)
        return scipy.interpolate.PPoly.from_bernstein_basis(
            scipy.interpolate.BPoly.from_derivatives(self.t, rows)
        )

    @property
    def _has_rates(self) -> bool:
        """Whether rates and accelerations are the motion's own, without jumps between samples."""
        begin, end = self.t[[0, -1]]
        inner = [jump for jump in self.jumps if begin < jump.t < end]
        known = {"dq", "ddq"} <= {each.name for each in fields(self)}
        return known and len(self) > 1 and not inner

    @cached_property
    def _base_spline(self) -> scipy.interpolate.CubicSpline:
        """Base (7,) over time through the poses of the samples, the quaternions not normalised."""
        quaternions = self.base[:, 3:]
        turned = (quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0.0
        signs = np.append(1.0, np.cumprod(np.where(turned, -1.0, 1.0)))
        rows = np.hstack((self.base[:, :3], signs[:, None] * quaternions))
        return scipy.interpolate.CubicSpline(self.t, rows)

    @cached_property
    def wheel_spline(self) -> scipy.interpolate.BSpline | None:
        """What wheels hold (w,) over time [N m s], where their torques are part of the motion."""
        return None

    def __getitem__(self, i: int) -> Configuration:
        q = joint_vector(self.arm, self.q[i], "q")
        return self._configuration(q, _pose(self.base[i]), i, i, 0.0)

    def __iter__(self) -> Iterator[Configuration]:
        return (self[i] for i in range(len(self)))

    def at(self, t: float) -> Configuration:
        """Return the configuration at a time; the first or last one outside the motion.

        The joints are on `spline`, which `sa.Tracking` follows. The base is on a cubic curve
        through its poses and twists at the two samples beside (see `base_twist`) where the motion
        has its own rates; else it is on cubic splines through all poses. Its error falls with the
        fourth power of the spacing of the samples, except near inner `jumps`, where the spline
        overshoots; `certificate` holds for the straight segments between samples there. Momentum
        and wheels are linear between the samples.

        Args:
            t: The time [s].
        """
        t = within(t, "t", -LARGEST, LARGEST, "a time [s]")
        i = int(np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, max(len(self) - 2, 0)))
        j = min(i + 1, len(self) - 1)
        if i == j or t <= self.t[i]:
            return self[i]
        if t >= self.t[j]:
            return self[j]
        span = self.t[j] - self.t[i]
        s = float((t - self.t[i]) / span)
        if self._has_rates:
            begin, end = _pose(self.base[i]), _pose(self.base[j])
            slopes = span * self.base_twist[[i, j]]
            pose = pose_between(begin, end, slopes[0], slopes[1], s)
        else:
            pose = _pose(self._base_spline(t))
        return self._configuration(np.asarray(self.spline(t)), pose, i, j, s)

    def _configuration(self, q: Array, base: pin.SE3, i: int, j: int, s: float) -> Configuration:
        """Return the configuration at a share s of the way from sample i to sample j."""
        cfg = kinematics(self.arm, q, base)
        pairs = zip(self._carried(i), self._carried(j), strict=True)
        momentum, wheels = ((1.0 - s) * before + s * after for before, after in pairs)
        if momentum.any():
            cfg = cfg.with_momentum(momentum)
        return cfg.with_wheels(wheels) if wheels.any() else cfg

    def _carried(self, i: int) -> tuple[Array, Array]:  # noqa: ARG002
        """Return the momentum (6,) of the system and what each wheel holds (w,) at a sample."""
        return np.zeros(6), np.zeros(len(self.arm.wheels))

    @cached_property
    def base_twist(self) -> Array:
        """(m, 6) twist of the base [linear [m/s]; angular [rad/s]], inertial axes.

        It follows from the momentum, as in `base_velocity`; components of the twist that `mode`
        does not let free are zero.
        """
        free = free_components(self.mode)
        twists = np.zeros((len(self), 6))
        for i, cfg in enumerate(self):
            A_b, A_q = momentum_matrix(cfg)
            h = (cfg.momentum - cfg.stored)[:free]
            twists[i, :free] = solve_locked(A_b[:free, :free], h - A_q[:free] @ self.dq[i])
        return read_only(twists)

    @cached_property
    def dq(self) -> Array:
        """(m, n) joint rates [rad/s] or [m/s], by differences of second order."""
        return self._rate(self.q)

    @cached_property
    def ddq(self) -> Array:
        """(m, n) joint accelerations [rad/s^2] or [m/s^2], by differences of the rates."""
        return self._rate(self.dq)

    @cached_property
    def tip(self) -> Array:
        """(m, 7) poses of the tip: position [m], quaternion xyzw, inertial frame."""
        return self._each(lambda cfg: pin.SE3ToXYZQUAT(cfg.tip))

    @cached_property
    def com(self) -> Array:
        """(m, 3) positions of the system CM [m]."""
        return self._each(lambda cfg: cfg.com)

    @cached_property
    def sigma_min(self) -> Array:
        """(m,) least singular value of the task Jacobian, as in `sa.singularity`."""
        if self.mode == "free-floating" and len(self.arm.tips) == 1:
            return read_only(evaluate(self.arm, self.q, ("sigma_min",))["sigma_min"])
        return self._each(lambda cfg: singular_values(cfg, mode=self.mode)[-1])

    @cached_property
    def distance(self) -> Array:
        """(m,) how far the nearest singular configuration found from each row is [rad].

        The nearest of all is no farther; see `NearestSingular`. Of over 2000 rows, 2000 are
        searched, and those at which the distance may be the least.
        """
        return read_only(distances_found(self.arm, self.mode, self.q))

    @property
    def control_points(self) -> Array:
        """(pieces, d, n) control points of the joint motion: straight from row to row."""
        return straight(self.q)

    @cached_property
    def certificate(self) -> Certificate | None:
        """The proof that straight segments between the rows meet no singularity.

        None where there is none for the arm, see `prove_regular`.
        """
        return prove_regular(self.arm, self.q, mode=self.mode)

    @property
    def origin(self) -> str:
        """What is at the origin of the inertial frame, from which all positions are given."""
        return origin_of(self[0])

    @property
    def story(self) -> str:
        """What kind of motion it is and how it ended, in one line."""
        return f"{self.mode}: {self.t[-1]:.4g} s"

    @property
    def singular_times(self) -> tuple[float, ...]:
        """Times at which a singularity is known to have been met [s]."""
        return ()

    @cached_property
    def jumps(self) -> tuple[RateJump, ...]:
        """Where the joint rates are known to jump."""
        return ()

    def to_dict(self) -> dict[str, Any]:
        """Return all fields and quantities as plain data; the arm by its name, arrays as lists."""
        more = {name: plain(getattr(self, name)) for name in self._layout(self.arm).quantities}
        return super().to_dict() | more | {"origin": self.origin}

    def to_xarray(self) -> xr.Dataset:
        """Return all quantities as labelled arrays, with units in their attributes.

        `motion.to_xarray().to_netcdf(path)` writes them for other programs.
        """
        import xarray as xr

        layout, data = self._layout(self.arm), {}
        for name, quantity in layout.quantities.items():
            dims = ("t", quantity.columns) if quantity.columns else ("t",)
            if (values := getattr(self, name)).size:  # netCDF has no empty dimensions: no wheels
                unit = quantity.unit_for(self.arm.slides)
                unit = self.arm.sigma_unit if name == "sigma_min" else unit
                data[name] = (dims, values, {"units": unit})
        times = data.pop("t")
        words = [name for name, kind in layout.details.items() if kind is str]
        attrs = {"arm": self.arm.name, "base_mode": self.mode}
        attrs |= {name: getattr(self, name) for name in words}
        return xr.Dataset(data, {"t": times, "joint": list(self.arm.joint_names)}, attrs)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the motion to a NumPy file, .npz; the arm is not in it.

        Raises:
            ConfigurationError: The path does not end in .npz.
            SpaceArmError: The file cannot be written.
        """
        motion_file.save_together({Path(path): self})

    @classmethod
    def load(cls: type[AnyMotion], path: str | os.PathLike[str], arm: SpaceArm) -> AnyMotion:
        """Read what `save` wrote: `Motion.load` any kind of motion, `Plan.load` a plan, and so on.

        Args:
            path: The file.
            arm: The arm of the motion, with the same joints.

        Raises:
            ConfigurationError: The file holds no motion of that kind, or one of other joints or
                wheels.
        """
        what = cls.__name__.lower()
        try:
            arrays = arrays_in(Path(path))
            kind = motion_file.kind_of(cls, motion_file.word(arrays, "kind"))
            joints, layout = motion_file.names(arrays), kind._layout(arm)
            held = motion_file.wheels(arrays, layout)
            values = motion_file.values(arrays, layout._replace(wheels=held), len(joints))
            if joints == arm.joint_names and held == layout.wheels:
                stored = {f.name for f in fields(kind) if f.metadata.get("in_file", True)} - {"arm"}
                return kind(arm=arm, **{name: values[name] for name in stored})
        except ValueError as error:  # ConfigurationError too
            raise ConfigurationError(f"{path} is not a saved {what}: {error}") from None
        if joints == arm.joint_names:
            raise ConfigurationError(
                f"{path} holds a motion of an arm with {held} wheel{'s' * (held != 1)}, and "
                f"{arm.name} has {layout.wheels}; load it with the same wheels=[...]"
            )
        raise ConfigurationError(
            f"{path} holds a motion of joints {listed(joints)}; {arm.name} has "
            f"{listed(arm.joint_names)}"
        )

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.arm.label}, {self.story}, {len(self)} samples)"

    @property
    def not_checked(self) -> str:
        """What the answer does not cover."""
        return "collisions"

    def describe(self) -> Description:
        """Describe the joints on the way, and spacecraft, tips and singularity at both ends."""
        arm, q = self.arm, self.q
        values = {"start": q[0], "end": q[-1], "least": q.min(axis=0), "largest": q.max(axis=0)}
        joints: dict[Column | str, Sequence[Cell]] = {"joint": arm.joint_names}
        joints |= {name: joint_measures(x, arm.slides) for name, x in values.items()}
        start, end = (self._facts(i) for i in (0, -1))
        ends = [(name, start[name], value) for name, value in end.items()]
        notes, tables = self._held()
        return Description(
            title=f"{arm.name}, {self.mode}",
            verdict=f"{self.t[-1]:.6g} s",
            notes=[f"origin: {self.origin}", *notes],
            tables=[
                Table.by_columns(joints, "Joints"),
                Table(("", "start", "end"), ends, "Spacecraft and tip"),
                *tables,
            ],
        )

    def _held(self) -> tuple[list[str], list[Table]]:
        """Say what controlling the attitude needs, and compare with the limits of the wheels.

        Free-floating, with wheels that do not act, it is one sentence.
        """
        floats = self.mode == FLOATING and bool(self.arm.wheels) and not self.wheels_act
        if not (floats or self.mode == "attitude-controlled") or len(self) < 2:
            return [], []
        if self.ended_singular:
            return [f"attitude control: {UNBOUNDED}"] * (not floats), []
        moved, torque = momentum_and_torque(self.arm, self.q, self.dq, self.ddq)
        rates = [np.linalg.norm(x, axis=1).max() for x in (moved, torque)]
        needs = "would need" if floats else "needs"
        notes = [f"attitude control {needs} up to {rates[0]:.4g} N m s and {rates[1]:.4g} N m"]
        notes += [] if floats else jump_notes(self.momentum_jump)
        if not self.arm.wheels or carried(self.arm.model, self.arm.wheels):
            return notes, []
        load = WheelLoad.of(self.arm.model, self.arm.wheels, self.momentum_on_board - moved, torque)
        if floats:
            return ["; ".join(filter(None, (*notes, load.in_time(self.t[-1] - self.t[0]))))], []
        return [*notes, *load.exceeded], [load.table()]

    @property
    def momentum_jump(self) -> float:
        """Largest jump of D_q dq, the attitude held, with the joint rates [N m s]."""
        if not self.jumps:
            return 0.0
        q, change = (np.array([jump[i] for jump in self.jumps]) for i in (1, 2))
        jumps, _ = momentum_and_torque(self.arm, q, change, np.zeros_like(q))
        return float(np.linalg.norm(jumps, axis=1).max())

    @property
    def momentum_on_board(self) -> Array:
        """(m, 3) angular momentum of the whole system, spacecraft axes, as far as it is known."""
        return np.zeros((len(self), 3))

    @property
    def wheels_act(self) -> bool:
        """Whether wheels change what they hold."""
        return False

    @property
    def ended_singular(self) -> bool:
        """Whether it ended at a singularity that the tip was led into at a constant speed."""
        return False

    def _facts(self, i: int) -> dict[str, Measure]:
        """Return what there is to say of a configuration, by its names."""
        cfg = self[i]
        tips = zip(self.arm.tips, cfg.tips, strict=True)
        named = {name if len(cfg.tips) > 1 else "tip": tip.translation for name, tip in tips}
        return {
            "spacecraft": Measure(cfg.base.translation, "m"),
            "attitude, rotation vector": Measure(pin.log3(cfg.base.rotation), "rad"),
            "attitude, quaternion xyzw": Measure(self.base[i, 3:]),
            **{name: Measure(place, "m") for name, place in named.items()},
            "sigma_min": Measure(self.sigma_min[i], self.arm.sigma_unit),
            "distance of a singular posture found": Measure(self.distance[i], "rad"),
        }

    @classmethod
    def _layout(cls, arm: SpaceArm) -> Layout:
        """Return what a file holds of such a motion of an arm; several tips have no one path."""
        left_out = () if len(arm.tips) == 1 else ("tip",)
        kept = {name: q for name, q in cls.QUANTITIES.items() if name not in left_out}
        return Layout.of(cls, kept, len(arm.wheels))

    def _rate(self, values: Array) -> Array:
        """Return the derivative by time of values over the joints; zero of a single sample."""
        if len(self) == 1:
            return read_only(np.zeros_like(self.q))
        return read_only(np.gradient(values, self.t, axis=0, edge_order=2 if len(self) > 2 else 1))

    def _each(self, value: Callable[[Configuration], ArrayLike]) -> Array:
        """Return the values of a function of the configuration at all samples."""
        return read_only(np.array([value(cfg) for cfg in self]))


class Drifting(Motion, kw_only=True):
    """Base of planned motions of a spacecraft that may have momentum on board.

    Attributes:
        momentum: (m, 6) [linear [kg m/s]; angular about the system CM [N m s]], inertial axes; what
            wheels hold is part of it.
        wheels: (m, w) what each wheel of the description holds [N m s].
    """

    momentum: Array
    wheels: Array

    QUANTITIES: ClassVar[Mapping[str, Quantity]] = {
        **Motion.QUANTITIES,
        "momentum": Quantity("kg m/s, kg m^2/s", "component"),
        "wheels": Quantity("N m s", "wheel"),
    }

    def _carried(self, i: int) -> tuple[Array, Array]:
        return self.momentum[i], self.wheels[i]

    @property
    def momentum_on_board(self) -> Array:
        """(m, 3) angular momentum of the whole system, axes of the spacecraft, which is held."""
        return np.asarray(self.momentum[:, 3:] @ _pose(self.base[0]).rotation)


def _pose(row: Array) -> pin.SE3:
    return pin.SE3(pin.Quaternion(row[3:]).normalized(), row[:3])


class Trajectory(Motion, kw_only=True):
    """The motion of an arm under joint torques, from `sa.simulate`: a `Motion` with more to it.

    Attributes:
        dq: (m, n) joint rates [rad/s] or [m/s].
        ddq: (m, n) joint accelerations [rad/s^2] or [m/s^2].
        torque: (m, n) joint torques [N m] or forces [N].
        momentum: (m, 6) [linear [kg m/s]; angular about the system CM [kg m^2/s]], inertial axes.
        impulse: (m, 6) what external wrenches added to the momentum since the start.
        wrenches: (m, 6) [force [N]; torque [N m]] on each link that wrenches or thrusters push, by
            its name: at the origin of its frame, inertial axes.
        wheels: (m, w) what each wheel holds [N m s].
        wheel_torque: (m, w) torque of each wheel's motor, to which limits of wheels apply [N m].
        wheel_friction: (m, w) torque of friction on each wheel, opposite to what it holds [N m].
        energy: (m,) kinetic energy without the spin of wheels [J].
        work: (m,) work of the torques since the start [J].
        other_work: (m,) work of springs, friction, wrenches and the wheels' motors since the start,
            on all but the spin of the wheels [J].
        exchanged: All work that was done and taken back [J].
        motors: Largest torque of each motor with a limit, and how long it was at the limit.
        events: What happened on the way.
        ended: Why it ended: "duration", the kind of the event that stopped it, or what failed.
        called: The functions that were called in Python, which is slow, and why.
    """

    dq: Array = field()
    ddq: Array
    torque: Array
    momentum: Array
    impulse: Array
    wrenches: Mapping[str, Array] = field(default_factory=dict)
    wheels: Array
    wheel_torque: Array
    wheel_friction: Array
    energy: Array
    work: Array
    other_work: Array
    exchanged: float
    motors: tuple[MotorLoad, ...] = ()
    events: tuple[Event, ...] = field()
    ended: str
    called: tuple[str, ...] = field(default=(), metadata={"in_file": False})

    QUANTITIES: ClassVar[Mapping[str, Quantity]] = {
        **Motion.QUANTITIES,
        "ddq": Quantity("rad/s^2 or m/s^2", "joint"),
        "torque": Quantity("N m or N", "joint"),
        "momentum": Quantity("kg m/s, kg m^2/s", "component"),
        "impulse": Quantity("kg m/s, kg m^2/s", "component"),
        "wheels": Quantity("N m s", "wheel"),
        "wheel_torque": Quantity("N m", "wheel"),
        "wheel_friction": Quantity("N m", "wheel"),
        "energy": Quantity("J"),
        "work": Quantity("J"),
        "other_work": Quantity("J"),
    }

    def _carried(self, i: int) -> tuple[Array, Array]:
        kept = free_components(self.mode)
        momentum = np.zeros(6)
        momentum[:kept] = self.momentum[0, :kept] + self.impulse[i, :kept]
        return momentum, self.wheels[i]

    @property
    def story(self) -> str:
        """What the spacecraft did and how the motion ended, in one line."""
        return super().story if self.ended == "duration" else f"{self.mode}: ended by {self.ended}"

    @property
    def singular_times(self) -> tuple[float, ...]:
        """Times of the singularities on the way [s]."""
        return tuple(event.t for event in self.events if event.kind == "singularity")

    @property
    def turnover(self) -> float:
        """Size of the energies exchanged [J]: the largest energy and all work."""
        return float(self.energy.max() + self.exchanged)

    @property
    def imbalance(self) -> float:
        """Largest difference of energy and work, over the turnover."""
        off = float(np.abs(self.energy - self.energy[0] - self.work - self.other_work).max())
        return off / self.turnover if self.turnover > 0.0 else 0.0

    @property
    def drift(self) -> float:
        """Largest change of the conserved momentum, over what the joints alone brought."""
        rates = zip(self, self.dq, strict=True)
        brought = np.array([momentum_matrix(cfg).A_q @ dq for cfg, dq in rates])
        return drift_of(self.momentum, self.impulse, brought, free_components(self.mode))

    def to_xarray(self) -> xr.Dataset:
        """Return all quantities as labelled arrays; wrenches along "link"."""
        data = super().to_xarray()
        if not self.wrenches:
            return data
        values = np.stack([*self.wrenches.values()], axis=1)
        data = data.assign_coords(link=[*self.wrenches])
        return data.assign(wrenches=(("t", "link", "component"), values, {"units": "N, N m"}))

    @property
    def wheels_act(self) -> bool:
        """Whether wheels change what they hold."""
        return bool(self.wheel_momentum_rate.any())

    @property
    def wheel_momentum_rate(self) -> Array:
        """(m, w) rate of what each wheel holds [N m]: torque of its motor and friction."""
        return self.wheel_torque + self.wheel_friction

    def to_dict(self) -> dict[str, Any]:
        """Return all fields and quantities as plain data, with the balances of both audits."""
        return super().to_dict() | {"imbalance": self.imbalance, "drift": self.drift}

    def describe(self) -> Description:
        """Describe the motion, its energies, its balances and what happened on the way."""
        motion = super().describe()
        energies = [
            ("kinetic energy", self.energy[0], self.energy[-1]),
            ("work of the torques", self.work[0], self.work[-1]),
        ]
        wheels: list[Table] = []
        spun: list[str] = []
        if self.arm.wheels and (self.wheels.any() or self.wheel_torque.any()):
            most = (np.abs(x).max(axis=0) for x in (self.wheels, self.wheel_torque))
            load = WheelLoad(self.arm.wheels, *most)
            wheels, spun = [load.table()], load.exceeded
        balances = {
            "energy balance off by": Measure(self.imbalance, "of the energy exchanged", ".1e"),
            "momentum balance off by": Measure(self.drift, "of that exchanged", ".1e"),
        }
        return replace(
            motion,
            verdict=f"{motion.verdict}, ended by {self.ended}",
            notes=[*motion.notes, *motor_notes(self.motors), *spun, *self.called],
            tables=[
                *motion.tables,
                *motor_table(self.motors),
                *wheels,
                Table(("", Column("start", "J"), Column("end", "J")), energies, "Energy"),
                Table.facts(balances, "Balances"),
            ],
            events=events_table(self.arm, self.events),
        )

    def __repr__(self) -> str:
        first = f", first {self.events[0].kind} at {self.events[0].t:.4g} s" if self.events else ""
        called = "".join(f"; {reason}" for reason in self.called)
        kind = type(self).__name__
        return (
            f"{kind}({self.arm.label}, {self.mode}: {self.t[-1]:.6g} s, {len(self.t)} times, "
            f"ended by {self.ended}{first}{called})"
        )
