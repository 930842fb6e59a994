"""Flights: simulations one after the other, with bodies that are grasped and released between."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation, RotationSpline

from spacearm.arrays import Array, ArrayLike, Parameters, finite, plain, read_only
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.mechanics import dynamics
from spacearm.mechanics.motion_bounds import BodyLoad, OnBoard, Peaks, bounded_peaks, load_bends
from spacearm.model.arguments import FLOATING, BaseMode
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.motion.controllers import Laws
from spacearm.motion.events import Event, events_table
from spacearm.motion.motion import Motion, Trajectory
from spacearm.motion.plant import Integration, MotorLoad, Plant, Sampling
from spacearm.motion.simulation import simulate
from spacearm.results import Column, Description, Measure, Table, Tone
from spacearm.signatures import checked

AnyFlight = TypeVar("AnyFlight", bound="Flight")
#: Quantities that each phase counts from zero.
SUMS = ("impulse", "work", "other_work")
#: Exceeded limits that the verdict of a flight names.
TOLD_LIMITS = 3
#: What `Flight.to_dict` gives.
TOLD = ("names", "phases", "begins", "events", "captures", "ended", "limits", "not_checked")


class LimitCheck(NamedTuple):
    """A limit, and the largest value that a simulated motion takes of it.

    Attributes:
        limit: What is limited, such as "torque of joint_2".
        value: Largest value that was simulated; of a clearance the least.
        allowed: The limit.
        unit: Unit of both.
        t: When the value is reached [s].
        exceeded: When the limit is exceeded first [s]; None if it is kept.
    """

    limit: str
    value: float
    allowed: float
    unit: str
    t: float
    exceeded: float | None

    @property
    def summary(self) -> str:
        """The limit, the value and the time in one line."""
        word = "at least" if self.limit == CLEARANCE else "at most"
        return (
            f"{self.limit}: {self.value:.4g} {self.unit} after {self.t:.4g} s, {word} "
            f"{self.allowed:.4g} {self.unit} allowed"
        )

    def worse(self, other: LimitCheck) -> LimitCheck:
        """Return two checks of one limit as one: the worse value, the earlier time of exceeding."""
        sign = -1.0 if self.limit == CLEARANCE else 1.0
        worst = other if sign * other.value > sign * self.value else self
        first = [check.exceeded for check in (self, other) if check.exceeded is not None]
        return worst._replace(exceeded=min(first, default=None))

    def to_dict(self) -> dict[str, Any]:
        """Return all fields."""
        return self._asdict()


#: Name of the limit that is a least value: the distance to the singular set.
CLEARANCE = "clearance to the singular set"


class Flight(Trajectory, kw_only=True):
    """The phases of a flight as one motion, from `sa.simulate_phases`.

    Its configurations are those of the arm with what it holds at the time. Momentum and energy jump
    where a body is grasped. The first row of a phase is left out: its positions are those of the
    last row of the phase before. `events` have "grasp", "release" and "limit exceeded" too.

    Attributes:
        phases: The trajectories, each of the arm with what it held then; their times begin at 0.
        begins: (p,) times at which they began [s].
        captures: What each grasp did: impulse, energy lost, momenta.
        names: What each phase is called, its number where it has no name.
        bodies: What the hand holds in each phase.
        limits: The limits of what is simulated, each with its largest value and whether it is
            kept; empty where none were given. A catch gives those that it was planned with.
    """

    phases: tuple[Trajectory, ...]
    begins: Array
    captures: tuple[dynamics.Capture, ...]
    names: tuple[str, ...]
    bodies: tuple[Grasp | None, ...]
    limits: tuple[LimitCheck, ...] = ()

    @classmethod
    def joined(
        cls: type[AnyFlight],
        runs: Sequence[Trajectory],
        begins: Sequence[float],
        events: Sequence[Event],
        captures: Sequence[dynamics.Capture],
        names: Sequence[str],
        bodies: Sequence[Grasp | None],
    ) -> AnyFlight:
        """Join the runs of all phases."""
        known = [
            "q",
            "base",
            "dq",
            "ddq",
            "torque",
            "momentum",
            "wheels",
            "wheel_torque",
            "wheel_friction",
            "energy",
        ]
        values: dict[str, Any] = {name: _joined(runs, name) for name in (*known, *SUMS)}
        return cls(
            arm=runs[0].arm,
            t=np.concatenate([begin + _rows(runs, i, "t") for i, begin in enumerate(begins)]),
            mode=runs[0].mode,
            exchanged=sum(run.exchanged for run in runs),
            motors=_motors(runs),
            wrenches=_wrenches(runs),
            events=tuple(events),
            ended=runs[-1].ended,
            called=tuple(dict.fromkeys(reason for run in runs for reason in run.called)),
            phases=tuple(runs),
            begins=np.array(begins),
            captures=tuple(captures),
            names=tuple(name or str(i) for i, name in enumerate(names)),
            bodies=tuple(bodies),
            **values,
        )

    @cached_property
    def sigma_min(self) -> Array:
        """(m,) least singular value of the task Jacobian, with what is held."""
        return read_only(_joined(self.phases, "sigma_min"))

    @cached_property
    def distance(self) -> Array:
        """(m,) as `Motion.distance` [rad], with what is held."""
        return read_only(_joined(self.phases, "distance"))

    @cached_property
    def turning(self) -> Array:
        """(m,) rate at which the spacecraft turns [rad/s]."""
        rows = [
            _turning(run[row], run.dq[row], run.mode)
            for i, run in enumerate(self.phases)
            for row in range(min(i, 1), len(run))
        ]
        return read_only(np.array(rows))

    @cached_property
    def tip_wrench(self) -> Array:
        """(m, 6) force [N] and moment [N m] at the tip that move what is held, tip axes."""
        parts = [self.phase_wrenches(i)[min(i, 1) :] for i in range(len(self.phases))]
        return read_only(np.concatenate(parts))

    @property
    def left_over(self) -> Array:
        """(3,) angular momentum at the end that no wheel holds, inertial axes [N m s]."""
        end = self.phases[-1][-1]
        return np.asarray(end.momentum[3:] - end.stored[3:])

    @cached_property
    def certificate(self) -> None:
        """None: each phase has a proof of its own."""
        return

    @property
    def imbalance(self) -> float:
        """The largest one of a phase."""
        return max(run.imbalance for run in self.phases)

    @property
    def drift(self) -> float:
        """The largest one of a phase."""
        return max(run.drift for run in self.phases)

    def at(self, t: float) -> Configuration:
        """Return the configuration at a time, of the arm with what it holds then."""
        i = max(int(np.searchsorted(self.begins, t, side="right")) - 1, 0)
        return self.phases[i].at(t - self.begins[i])

    def __getitem__(self, i: int) -> Configuration:
        ends = np.cumsum([len(_rows(self.phases, i, "t")) for i in range(len(self.phases))])
        row = range(len(self))[i]
        phase = int(np.searchsorted(ends, row, side="right"))
        return self.phases[phase][row - int(ends[phase])]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Refuse: a file holds the motion of one arm.

        Raises:
            UnsupportedError: Always.
        """
        raise UnsupportedError(
            f"{path}: the arm of a flight changes; save its phases, flight.phases[0].save(path)"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the phases and what happened as plain data."""
        return {name: plain(getattr(self, name)) for name in TOLD}

    def phase_wrenches(self, i: int) -> Array:
        """Return the wrenches of `tip_wrench` in phase i, its first row among them.

        Args:
            i: Number of the phase.
        """
        return _borne(self.phases[i], self.bodies[i])

    def phase_distances(self, i: int) -> Array:
        """Return the distance to the singular set [rad] at the samples (m,) of phase i.

        Args:
            i: Number of the phase.
        """
        return self.phases[i].distance

    @property
    def exceeded(self) -> tuple[LimitCheck, ...]:
        """The limits that are exceeded."""
        return tuple(check for check in self.limits if check.exceeded is not None)

    def _loads(self) -> list[tuple[float, float, float]]:
        """Return how fast the spacecraft turns at the end of phases, and the most at the tip."""
        found = []
        for i, run in enumerate(self.phases):
            most = np.linalg.norm(self.phase_wrenches(i).reshape(-1, 2, 3), axis=2).max(axis=0)
            found.append((_turning(run[-1], run.dq[-1], run.mode), *most.tolist()))
        return found

    def _left(self) -> list[str]:
        """Say what wheels hold at the end, and what is left."""
        if not (self.wheels.any() or self.captures):
            return []
        held = ", ".join(
            f"{wheel.name} {most:.4g}, at the end {end:.4g}"
            for wheel, most, end in zip(
                self.arm.wheels, np.abs(self.wheels).max(axis=0), self.wheels[-1], strict=True
            )
        )
        end = self.phases[-1]
        left, turns = np.linalg.norm(self.left_over), _turning(end[-1], end.dq[-1], end.mode)
        return [
            *[f"wheels hold at most [N m s]: {held}"] * bool(held),
            f"{left:.3g} N m s are left, and the spacecraft turns at {turns:.3g} rad/s",
        ]

    def __repr__(self) -> str:
        return f"Flight({self.describe().headline})"

    def describe(self) -> Description:
        """Describe the phases, what happened on the way, and what momentum is left at the end."""
        arm, end = self.phases[0].arm, self.begins[-1] + self.phases[-1].t[-1]
        ends = self.begins + [run.t[-1] for run in self.phases]
        starts = zip(self.names, self.begins, ends, strict=True)
        rows = [
            (
                *first,
                run.ended,
                rotation,
                *loads,
                run.imbalance,
                *(tip.translation for tip in run[-1].tips),
            )
            for first, run, rotation, loads in zip(
                starts, self.phases, self._rotations(), self._loads(), strict=True
            )
        ]
        names = ("tip",) if len(arm.tips) == 1 else arm.tips
        columns: list[Column | str] = [
            "phase", Column("from", "s", ".4g"), Column("to", "s", ".4g"), "ended by",
            Column("largest base rotation", "rad", ".3g"),
            Column("angular rate then", "rad/s", ".3g"), Column("peak force at tip", "N", ".3g"),
            Column("peak moment", "N m", ".3g"), Column("energy off by", "", ".1e"),
            *(Column(f"{n} at the end", "m") for n in names),
        ]  # fmt: skip
        checks, tone = self._limits()
        return Description(
            title=arm.name,
            verdict=f"{len(self.phases)} phase{'s' * (len(self.phases) > 1)}, {end:.6g} s, "
            f"ended by {self.ended}{checks}",
            tone=tone,
            notes=self._left(),
            tables=[Table(columns, rows), *self._limit_tables()],
            events=events_table(arm, self.events),
        )

    def _rotations(self) -> list[float]:
        """Return the largest rotation of the spacecraft from its start in each phase [rad]."""
        first = pin.Quaternion(self.phases[0].base[0, 3:])
        return [
            max(first.angularDistance(pin.Quaternion(base[3:])) for base in run.base)
            for run in self.phases
        ]

    def _limits(self) -> tuple[str, Tone]:
        """Say whether the limits are kept, for the verdict."""
        if not self.limits:
            return "", ""
        over = self.exceeded
        if not over:
            return f"; all {len(self.limits)} limits kept", "good"
        told = "; ".join(check.summary for check in over[:TOLD_LIMITS])
        return f"; {len(over)} of {len(self.limits)} limits EXCEEDED: {told}", "bad"

    def _limit_tables(self) -> list[Table]:
        """Return the table of the limits, if any were given."""
        columns = ("limit", "value", "allowed", Column("time", "s", ".4g"), "")
        rows = [
            (
                check.limit,
                Measure(check.value, check.unit),
                Measure(check.allowed, check.unit),
                check.t,
                "kept" if check.exceeded is None else "exceeded",
            )
            for check in self.limits
        ]
        return [Table(columns, rows, "Limits")] * bool(rows)


def _motors(runs: Sequence[Trajectory]) -> tuple[MotorLoad, ...]:
    """Return the loads of motors in all phases; a motor whose limit changes has several."""
    total = sum(float(run.t[-1]) for run in runs)
    found: dict[tuple[str, float, bool], MotorLoad] = {}
    for run in runs:
        part = float(run.t[-1]) / total if total > 0.0 else 0.0
        for load in run.motors:
            key = load.motor, load.limit, load.enforced
            known = found.get(key, load._replace(largest=0.0, share=0.0))
            largest = max(known.largest, load.largest)
            found[key] = known._replace(largest=largest, share=known.share + part * load.share)
    return tuple(found.values())


def _turning(cfg: Configuration, dq: Array, mode: BaseMode) -> float:
    """Return the rate at which a spacecraft turns [rad/s]."""
    return float(np.linalg.norm(dynamics.spacecraft_twist(cfg, dq, mode)[3:]))


def _borne(run: Trajectory, body: Grasp | None) -> Array:
    """Return the wrenches (m, 6) at the tip that move a body in the hand, tip axes."""
    root = run.arm.tree.root
    found = np.zeros((len(run), 6))
    if body is None:
        return found
    for row in range(len(run)):
        cfg = run[row]
        pushed = {link: wrench[row] for link, wrench in run.wrenches.items()}
        motors = cfg.with_wheels(run.wheel_momentum_rate[row]).stored
        pushed[root] = pushed.get(root, np.zeros(6)) - motors
        found[row] = held_loads(cfg, run.dq[row], run.ddq[row], body, run.mode, pushed)[1]
    return found


def _rows(runs: Sequence[Trajectory], i: int, name: str) -> Array:
    """Return a quantity of phase i, the first row of later phases left out."""
    values: Array = getattr(runs[i], name)
    return values[min(i, 1) :]


def _joined(runs: Sequence[Trajectory], name: str) -> Array:
    """Return a quantity of all phases; of sums that begin at zero the whole."""
    parts, before = [], 0.0
    for i, run in enumerate(runs):
        parts.append(_rows(runs, i, name) + before)
        if name in SUMS:
            before = before + getattr(run, name)[-1]
    return np.concatenate(parts)


def _wrenches(runs: Sequence[Trajectory]) -> dict[str, Array]:
    """Return the wrenches on each link that is pushed in any phase."""
    links = dict.fromkeys(link for run in runs for link in run.wrenches)
    none = [np.zeros((len(run), 6)) for run in runs]
    return {
        link: np.concatenate(
            [run.wrenches.get(link, none[i])[min(i, 1) :] for i, run in enumerate(runs)]
        )
        for link in links
    }


@checked
@dataclass(frozen=True, kw_only=True)
class Grasp(Parameters):
    """A body that the tip grasps at the end of a phase, by a plastic impact (see `capture`).

    Attributes:
        mass: Its mass [kg].
        inertia: (3, 3) its inertia about its CM, tip axes [kg m^2]; a point mass if None.
        com: (3,) its CM in the tip frame [m].
        twist: (6,) its twist before the grasp, [velocity of its CM [m/s]; angular velocity
            [rad/s]], inertial axes; that of the tip if None: a grasp without impact.
        joints: "free" or "braked"; see `capture`.
    """

    mass: float
    inertia: ArrayLike | None = None
    com: ArrayLike = (0.0, 0.0, 0.0)
    twist: ArrayLike | None = None
    joints: dynamics.JointState = "free"

    def impact(self, cfg: Configuration, dq: Array, mode: BaseMode = FLOATING) -> dynamics.Capture:
        """Return the impact in a configuration with joint rates (n,), as `capture` computes it.

        Args:
            cfg: The configuration.
            dq: The joint rates.
            mode: What the spacecraft did until then.
        """
        twist = self.twist
        if mode != FLOATING:  # whose angular momentum is what the arm alone has
            v = dynamics.generalized_velocity(cfg, dq, mode)
            cfg = cfg.with_momentum(cfg.A @ v + cfg.stored)
        if twist is None:
            t = cfg.J @ dynamics.generalized_velocity(cfg, dq)
            lever = cfg.tip.rotation @ finite(self.com, (3,), "com of the body", "[m], tip frame")
            twist = np.concatenate((t[:3] + np.cross(t[3:], lever), t[3:]))
        return dynamics.capture(
            cfg, twist, self.mass, self.inertia, self.com, dq=dq, joints=self.joints
        )


def held_loads(
    cfg: Configuration,
    dq: Array,
    ddq: Array,
    body: Grasp,
    mode: BaseMode = FLOATING,
    wrenches: dynamics.Wrenches | None = None,
) -> tuple[Array, Array]:
    """Return the joint torques (n,), and the wrench (6,) at the tip that moves a body, tip axes.

    Args:
        cfg: The arm with the body in its hand.
        dq: (n,) joint rates [rad/s] or [m/s].
        ddq: (n,) joint accelerations [rad/s^2] or [m/s^2].
        body: The body.
        mode: What the spacecraft does.
        wrenches: What pushes links, as in `inverse_dynamics`.
    """
    arm, R = cfg.arm, cfg.base.rotation
    found = dynamics.inverse_dynamics(cfg, dq, ddq, mode=mode, wrenches=wrenches)
    v = dynamics.generalized_velocity(cfg, dq, mode)
    a = (found.base_acceleration.reshape(2, 3) @ R).ravel()
    a[:3] -= np.cross(v[3:6], v[:3])  # from classical to spatial acceleration
    full, rate = (np.append(x[:6], arm.all_rates(y)) for x, y in ((v, dq), (a, ddq)))
    data = arm.borrow()
    pin.forwardKinematics(arm.model, data, cfg.full_at_origin, full, rate)
    w = pin.getFrameVelocity(arm.model, data, arm.tip_frame, pin.LOCAL).angular
    tip = pin.getFrameClassicalAcceleration(arm.model, data, arm.tip_frame, pin.LOCAL)
    arm.give_back(data)
    com = np.asarray(body.com)
    I = np.zeros((3, 3)) if body.inertia is None else np.asarray(body.inertia)
    force = body.mass * (tip.linear + np.cross(tip.angular, com) + np.cross(w, np.cross(w, com)))
    moment = I @ tip.angular + np.cross(w, I @ w) + np.cross(com, force)
    return found.tau, np.concatenate((force, moment))


def load_peaks(
    motion: Motion,
    body: Grasp | None = None,
    check_time: Callable[[], None] | None = None,
    allowed: Array | float = 0.0,
) -> Peaks:
    """Bound the torques of a motion as `sa.Tracking` flies it, and the load on what it holds.

    The quantities are the torques of the n joints [N m] or [N], the force [N] and the moment [N m]
    at the tip that move the body; zero without one.

    Args:
        motion: The motion, of the arm with the body.
        body: The body in the hand.
        check_time: Called now and then; raises once the time is up.
        allowed: (n + 2,) as of `bounded_peaks`.
    """
    arm, way, mode = motion.arm, motion.spline, motion.mode
    at = flown_configurations(motion, arm)

    def loads(t: float) -> Array:
        if check_time is not None:
            check_time()
        cfg = at(t)
        if body is None:
            tau = dynamics.inverse_dynamics(cfg, way(t, 1), way(t, 2), mode=mode).tau
            return np.append(tau, (0.0, 0.0))
        tau, wrench = held_loads(cfg, way(t, 1), way(t, 2), body, mode)
        return np.append(tau, np.linalg.norm(wrench.reshape(2, 3), axis=1))

    def values(t: Array) -> Array:
        return np.array([loads(one) for one in t.tolist()])

    on_board = OnBoard.of(motion[0])
    held = None if body is None else body_load(arm, body)

    def bends(begin: Array, width: Array) -> Array:
        return load_bends(arm, mode, way, begin, width, on_board, held)

    return bounded_peaks(values, bends, motion.t, allowed=allowed)


def flown_configurations(motion: Motion, arm: SpaceArm) -> Callable[[float], Configuration]:
    """Return the configurations of an arm over time where `sa.Tracking` flies a motion.

    The spacecraft is at the origin; with momentum on board its attitude follows a spline.

    Args:
        motion: The motion.
        arm: Its arm, or that arm with other tips.
    """
    start, way = motion[0], motion.spline
    turning = motion.mode == FLOATING and start.momentum.any() and len(motion) > 1
    spun = Rotation.from_quat(motion.base[:, 3:])
    turns = RotationSpline(motion.t, spun) if turning else None

    def at(t: float) -> Configuration:
        R = start.base.rotation if turns is None else turns(t).as_matrix()
        cfg = kinematics(arm, way(t), pin.SE3(R, np.zeros(3)))
        cfg = cfg.with_momentum(start.momentum) if start.momentum.any() else cfg
        return cfg.with_wheels(start.wheels) if start.wheels.any() else cfg

    return at


def body_load(arm: SpaceArm, body: Grasp) -> BodyLoad:
    """Return a body in the hand as `load_bends` takes it."""
    tip = arm.model.frames[arm.tip_frame]
    inertia = 0.0 if body.inertia is None else float(np.linalg.norm(np.asarray(body.inertia), 2))
    com = float(np.linalg.norm(np.asarray(body.com)))
    return BodyLoad(tip.parentJoint, body.mass, inertia, tip.placement.translation, com)


@checked
@dataclass(frozen=True)
class Release(Parameters):
    """The release, at the end of a phase, of the body that was grasped last; nothing pushes it."""


@checked
@dataclass(frozen=True)
class Phase(Parameters):
    """A part of a flight; the spacecraft floats, unless its attitude is held.

    Attributes:
        controller: As in `simulate`.
        duration: Its longest duration [s]. then: What happens at its end. If `stop` names events,
            it happens at one of these only, and the flight ends if there was none.
        mode: What the spacecraft does, as in `simulate`; an attitude that is held is not changed by
            a grasp.
        plant: As in `simulate`, for this phase.
        sampling: As in `simulate`.
        stop: As in `simulate`.
        integration: As in `simulate`.
        name: What it is called.
    """

    controller: Laws
    duration: float
    then: Grasp | Release | None = None
    _: KW_ONLY
    mode: BaseMode = FLOATING
    plant: Plant = Plant()
    sampling: Sampling | None = None
    stop: Sequence[str] = ()
    integration: Integration = Integration()
    name: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return all fields, the controller as its repr."""
        then = {type(self.then).__name__: self.then.to_dict()} if self.then else None
        return super().to_dict() | {"controller": repr(self.controller), "then": then}


@checked
def simulate_phases(
    start: Configuration,
    phases: Sequence[Phase],
    *,
    dq: ArrayLike | None = None,
    progress: Callable[[float, float], object] | None = None,
) -> Flight:
    """Simulate an arm that grasps and releases bodies in flight.

    Each phase is a run of `simulate` that begins where the last one ended. A grasp is a plastic
    impact in an instant, which keeps the momentum of arm and body together; the body then belongs
    to the arm. A release takes it away again: arm and body go on with the velocities that they
    have, and share the momentum.

    Args:
        start: The configuration at the start, as in `simulate`.
        phases: The phases, one or more.
        dq: (n,) joint rates at the start [rad/s] or [m/s]; zeros if None.
        progress: Called now and then as progress(t, duration), both simulated time [s].

    Returns:
        The runs of all phases, and what was grasped.

    Raises:
        ConfigurationError: There is no phase, a release has nothing to release, or an argument
            makes no sense.
        SpaceArmError: As `simulate` and `capture` raise.

    Example:
        >>> import numpy as np
        >>> import spacearm as sa
        >>> arm, law = sa.load("planar2"), sa.JointPD(target=[0.4, 0.9], kp=5.0, kd=5.0)
        >>> body = sa.Grasp(mass=2.0, inertia=0.1 * np.eye(3))
        >>> phases = [sa.Phase(law, 1.0, body), sa.Phase(law, 1.0, sa.Release())]
        >>> flight = sa.simulate_phases(arm.at([0.3, 1.0]), phases)
        >>> len(flight.phases), len(flight.captures)
        (2, 1)
    """
    if not phases:
        raise ConfigurationError("phases is empty; give one or more sa.Phase(controller, duration)")
    grasps = np.cumsum([isinstance(p.then, Grasp) - isinstance(p.then, Release) for p in phases])
    if grasps.min() < 0:
        raise ConfigurationError(
            f"phase {int(np.argmax(grasps < 0))} releases what nothing grasped; put a phase with "
            "then=sa.Grasp(...) before it"
        )
    total, begin, held = sum(phase.duration for phase in phases), 0.0, [start.arm]
    grasped, bodies = list[Grasp](), list[Grasp | None]()
    runs: list[Trajectory] = []
    begins, events, captures = list[float](), list[Event](), list[dynamics.Capture]()
    for phase in phases:

        def report(t: float, _: float, begin: float = begin) -> None:
            if progress:
                progress(begin + t, total)

        run = simulate(
            start, phase.controller, phase.duration, dq=dq, mode=phase.mode, plant=phase.plant,
            stop=phase.stop, sampling=phase.sampling, integration=phase.integration,
            progress=report,
        )  # fmt: skip
        runs.append(run)
        begins.append(begin)
        bodies.append(grasped[-1] if grasped else None)
        events += [event._replace(t=begin + event.t) for event in run.events]
        begin += float(run.t[-1])
        if run.ended == "interrupted" or (len(phase.stop) and run.ended == "duration"):
            break
        start, dq = run[-1], run.dq[-1]
        if isinstance(phase.then, Grasp):
            captures.append(phase.then.impact(start, run.dq[-1], phase.mode))
            held.append(captures[-1].configuration.arm)
            grasped.append(phase.then)
            start, dq = _holding(held[-1], start, captures[-1].momentum), captures[-1].dq
            detail = f"{phase.then.mass:g} kg, {captures[-1].energy_lost:.3g} J lost"
            events.append(Event(begin, "grasp", run.q[-1], detail))
        elif isinstance(phase.then, Release):
            held.pop()
            grasped.pop()
            start = _holding(held[-1], start, _kept(run, held[-1]))
            events.append(Event(begin, "release", run.q[-1], ""))
    names = [phase.name for phase in phases[: len(runs)]]
    return Flight.joined(runs, begins, events, captures, names, bodies)


def _holding(arm: SpaceArm, cfg: Configuration, momentum: Array) -> Configuration:
    """Return a configuration of an arm that holds something else now."""
    return arm.at(cfg.q, base=cfg.base, wheels=cfg.wheels, momentum=momentum)


def _kept(run: Trajectory, arm: SpaceArm) -> Array:
    """Return the momentum (6,) that an arm keeps which releases what it held at the end."""
    cfg = run[-1]
    v = dynamics.generalized_velocity(cfg, run.dq[-1])
    return arm.at(cfg.q, base=cfg.base).A @ v + cfg.stored


def joined(*motions: Motion, begin: float = 0.0) -> Motion:
    """Return a wait until `begin` [s] and motions of one arm, one after the other, as one."""
    first, rest = motions[0], motions[1:]
    t, q, base = begin + first.t, first.q, first.base
    for motion in rest:
        t = np.append(t, t[-1] + motion.t[1:])
        q, base = np.vstack((q, motion.q[1:])), np.vstack((base, motion.base[1:]))
    if begin > 1e-9 * t[-1]:  # not by rounding
        t, q, base = np.append(0.0, t), np.vstack((q[:1], q)), np.vstack((base[:1], base))
    return Motion(first.arm, t, q, base, mode=first.mode)
