"""What the motions of an arm do to its spacecraft, free-floating and attitude-controlled.

With an ideally controlled attitude the arm has the angular momentum D_q dq about the system CM, and
wheels must absorb the opposite; their torque is its derivative. Wheels are sized for motions, or
for a speed of the tip in the worst direction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from spacearm.arrays import (
    Array,
    ArrayLike,
    Progress,
    counted,
    finite,
    generator,
    positive,
    whole,
    within,
)
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError, listed
from spacearm.mechanics.distance import distance_at
from spacearm.mechanics.dynamics import inverse_dynamics
from spacearm.mechanics.floating import attitudes_over_time, placed
from spacearm.mechanics.jacobian import base_velocity, momentum_matrix, task_jacobian
from spacearm.model.arguments import FLOATING, HELD
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.wheels import WheelLoad, carried, held_about_any_axis
from spacearm.motion.flights import Flight
from spacearm.motion.motion import UNBOUNDED, Motion, Playable, Trajectory
from spacearm.motion.plant import MotorLoad, jump_notes, motor_notes
from spacearm.planning.result import Plan
from spacearm.results import Cell, Column, Description, Measure, Result, Table
from spacearm.signatures import checked
from spacearm.singularities.risk import NEAR, uniform

#: Those that are reported of the momentum of wheels.
PERCENTILES = (50.0, 90.0, 95.0, 99.0, 100.0)


class Reaction(Result):
    """What a motion of the arm does to its spacecraft, in up to three cases.

    *Free-floating*: the same joint motion while nothing controls the attitude and the wheels keep
    the momentum that they hold at the start (`excursion`, `rate`). If the motion itself is not
    free-floating, system and wheels have no momentum in this case. *Attitude-controlled*: the same
    joint motion with an ideal control of the attitude (`momentum`, `torque`, `wheels`, `load`). *As
    simulated*: what the motion itself did, if that is neither (`simulated`, `wheel_momentum`,
    `wheel_torque`, `motors`). The first two depend on the joint motion, and on momentum and wheels
    at its start, only.

    All vectors are in spacecraft axes, momenta about the system CM.

    Attributes:
        arm: The arm.
        t: (m,) times [s].
        excursion: (m, 3) rotation vector of the free-floating base from its attitude at the start
            [rad].
        rate: (m, 3) angular velocity of the free-floating base [rad/s].
        momentum: (m, 3) angular momentum D_q dq of the joint motion, attitude-controlled [N m s].
        on_board: (m, 3) angular momentum of the whole system [N m s], in the spacecraft axes of the
            start, with what wrenches add.
        torque: (m, 3) torque on the base, attitude-controlled: the derivative of `momentum` [N m].
        simulated: (m, 3) rotation vector of the base in the motion itself, from its attitude at the
            start [rad].
        wheel_momentum: (m, w) momentum of each wheel in the motion itself [N m s]; w = 0 if the
            wheels did not act.
        wheel_torque: (m, w) torque of each wheel's motor in the motion itself [N m].
        motors: The motors of the wheels that have a torque limit, in the motion itself.
        full: Names of the wheels that reached their capacity in the motion itself.
        camera: (3,) unit vector of a camera's line of sight; None for the worst one.
        unbounded: Whether the motion ends at a singularity that the tip is led into at a constant
            speed. Rates, momentum and torque have no bound there, so the last samples mean little.
        jump: Largest jump of `momentum` where the rates of the joints jump [N m s].
    """

    arm: SpaceArm
    t: Array
    excursion: Array
    rate: Array
    momentum: Array
    on_board: Array
    torque: Array
    simulated: Array
    wheel_momentum: Array
    wheel_torque: Array
    motors: tuple[MotorLoad, ...] = ()
    full: tuple[str, ...] = ()
    camera: Array | None = field(default=None)
    unbounded: bool = field(default=False)
    jump: float = field(default=0.0)

    JSON: ClassVar[Mapping[str, str]] = {"momentum": "joint_momentum", "torque": "holding_torque"}

    @cached_property
    def angle(self) -> Array:
        """(m,) rotation of the free-floating base from its attitude at the start [rad]."""
        return np.linalg.norm(self.excursion, axis=1)

    @cached_property
    def simulated_angle(self) -> Array:
        """(m,) rotation of the base in the motion itself, from its attitude at the start [rad]."""
        return np.linalg.norm(self.simulated, axis=1)

    @cached_property
    def wheels(self) -> Array:
        """(m, 3) momentum that wheels hold, attitude-controlled [N m s]."""
        return np.asarray(self.on_board - self.momentum)

    @cached_property
    def impulse(self) -> Array:
        """(3,) angular impulse of thrusters that hold the attitude, about each axis [N m s].

        It is the integral of the torque's size; thrusters with lever arm a take impulse / a [N s].
        """
        return np.asarray(np.abs(np.diff(self.momentum, axis=0)).sum(axis=0))

    @cached_property
    def pointing(self) -> Array:
        """(m,) angle between the camera's line of sight and that at the start, floating [rad].

        Without a camera the largest that any camera has: the turn of the spacecraft.
        """
        if self.camera is None:
            return self.angle
        lines = np.array([pin.exp3(turn) @ self.camera for turn in self.excursion])
        across = np.linalg.norm(np.cross(self.camera, lines), axis=1)
        return np.asarray(np.arctan2(across, lines @ self.camera))

    @cached_property
    def smear(self) -> Array:
        """(m,) speed at which the line of sight turns, floating; the worst one without a camera.

        In [rad/s]: times the exposure it is the smear of a picture.
        """
        turning = self.rate if self.camera is None else np.cross(self.rate, self.camera)
        return np.linalg.norm(turning, axis=1)

    @cached_property
    def load(self) -> WheelLoad | None:
        """What each wheel of the spacecraft holds and gives at most.

        None if it has no wheels, or has some on links that move with the arm, or if the loads have
        no bound.
        """
        if self.unbounded or not self.arm.wheels or carried(self.arm.model, self.arm.wheels):
            return None
        return WheelLoad.of(self.arm.model, self.arm.wheels, self.wheels, self.torque)

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data, with the largest of each kind and the impulse."""
        largest: dict[str, Any] = {
            "largest_smear": float(self.smear.max()),
            "largest_wheels": np.abs(self.wheels).max(axis=0).tolist(),
            "largest_holding_torque": np.abs(self.torque).max(axis=0).tolist(),
            "thruster_impulse": self.impulse.tolist(),
        }
        return super().to_dict() | {
            "exceeded": [] if self.load is None else self.load.exceeded,
            "largest_angle": float(self.angle.max()),
            "largest_pointing": float(self.pointing.max()),
            **(dict.fromkeys(largest) if self.unbounded else largest),
        }

    def describe(self) -> Description:
        """Describe what was simulated, and the free-floating and attitude-controlled cases."""
        floating, controlled = "free-floating", "attitude-controlled"
        largest = (
            (f"rotation, {floating}", np.abs(self.excursion).max(axis=0), "rad"),
            (f"wheel momentum, {controlled}", np.abs(self.wheels).max(axis=0), "N m s"),
            (f"torque, {controlled}", np.abs(self.torque).max(axis=0), "N m"),
            (f"thruster impulse, {controlled}", self.impulse, "N m s"),
        )
        rows: list[Sequence[Cell]] = [
            (name, *(Measure(x, unit) for x in values)) for name, values, unit in largest
        ]
        if self.unbounded:
            rows[1:] = [(row[0], *3 * ("no bound",)) for row in rows[1:]]
        sight = {
            "rotation of the line of sight": Measure(float(self.pointing.max()), "rad"),
            "at up to": Measure(float(self.smear.max()), "rad/s"),
        }
        load = self.load
        exceeded = [] if load is None else [f"{controlled}: {each}" for each in load.exceeded]
        if load is not None and exceeded and (slower := load.in_time(self.t[-1] - self.t[0])):
            exceeded.append(slower)
        which = "worst line of sight" if self.camera is None else "line of sight of the camera"
        jumps = [] if self.unbounded else jump_notes(self.jump)
        cases = [*self._as_simulated(), self._free_floating(), self._attitude_controlled()]
        return Description(
            title=f"{self.arm.name}, {self.t[-1] - self.t[0]:.4g} s",
            verdict=" ".join(cases),
            tone="bad" if exceeded or self.unbounded else "",
            notes=[*self._saturation(), *exceeded, *jumps],
            tables=[
                *self._wheels_as_simulated(),
                *([] if load is None else [load.table(controlled)]),
                Table(("largest", "about x", "about y", "about z"), rows),
                Table.facts(sight, f"Free-floating, {which}"),
            ],
        )

    def _as_simulated(self) -> list[str]:
        """Say what the motion itself did, where it is neither of the other cases."""
        if not self.wheel_torque.size:
            return []
        rotated = np.degrees(self.simulated_angle.max())
        h, tau = (np.abs(x).max() for x in (self.wheel_momentum, self.wheel_torque))
        return [
            f"As simulated, wheels on: the base rotates by up to {rotated:.4g}°, and a wheel holds "
            f"up to {h:.4g} N m s and applies up to {tau:.4g} N m."
        ]

    def _free_floating(self) -> str:
        """Say what the joint motion does to a free-floating base."""
        rotated = np.degrees(self.angle.max())
        return f"Free-floating: the base rotates by up to {rotated:.4g}°."

    def _attitude_controlled(self) -> str:
        """Say what an ideal control of the attitude takes."""
        if self.unbounded:
            return f"Attitude-controlled: {UNBOUNDED}."
        h, tau = (np.linalg.norm(x, axis=1).max() for x in (self.wheels, self.torque))
        return f"Attitude-controlled: the wheels need {h:.4g} N m s and {tau:.4g} N m."

    def _saturation(self) -> list[str]:
        """Say which wheels saturated in the motion itself."""
        notes = [f"as simulated, {note}" for note in motor_notes(self.motors)]
        if self.full:
            notes.append(f"as simulated, wheels that reached their capacity: {listed(self.full)}")
        return notes

    def _wheels_as_simulated(self) -> list[Table]:
        """Return the table of what the wheels did in the motion itself."""
        if not self.wheel_torque.size:
            return []
        largest = (np.abs(x).max(axis=0) for x in (self.wheel_momentum, self.wheel_torque))
        return [WheelLoad(self.arm.wheels, *largest).table("as simulated")]


@checked
def reaction(
    motion: Playable,
    *,
    camera: ArrayLike | None = None,
    progress: Progress | None = None,
) -> Reaction:
    """Compute what a joint motion does to the spacecraft, free-floating and attitude-controlled.

    Free-floating, the base rotates with w_0 = D^-1 (h - h_w - D_q dq), equation (33c) with the
    momentum h and the wheels' momentum h_w of the start, both zero if the motion itself is not
    free-floating; external wrenches act only where the motion itself is free-floating and was
    simulated with them. Attitude-controlled, the wheels
    absorb the momentum -D_q dq, besides what is on board; their torque is the derivative of D_q dq,
    which `inverse_dynamics` reports as the reaction. A simulation in which wheels acted is reported
    beside these two, with the loads that were recorded.

    The motions that `sa.plan`, `sa.simulate` and `sa.follow` return have their own rates and
    accelerations. For other motions they are differences between samples: sample finely. Wheels of
    the spacecraft share momentum and torque by the pseudo-inverse of their axes; the answer says
    what exceeds their limits, and by how much.

    Args:
        motion: Any motion of the package, or an object with arm, t, q and base; see `Motion.of`.
        camera: (3,) a camera's line of sight in spacecraft axes.
        progress: Called now and then as progress(done, samples).

    Returns:
        Over time, rotation and rate of the free-floating base; momentum, torque and impulse of an
        attitude-controlled one; and what was simulated.

    Raises:
        ConfigurationError: The motion has fewer than two samples, or `camera` is not a direction.
        UnsupportedError: A body is grasped or released on the way while the attitude is controlled.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> way = sa.follow(arm.at([0.3, 1.2]), [(1.5, 1.2)])
        >>> bool(sa.reaction(way).angle.max() < 0.1)
        True
    """
    run = Motion.of(motion)
    if len(run) < 2:
        raise ConfigurationError("the motion has one sample only; a reaction needs two or more")
    sight: Array | None = None
    if camera is not None:
        line = finite(camera, (3,), "camera", "of the line of sight in spacecraft axes")
        if not line.any():
            raise ConfigurationError("camera is zero; give the direction of its line of sight")
        sight = line / np.linalg.norm(line)
    floating = _free_floating(run)
    start = run[0].base.rotation
    on_board: Array = np.zeros((len(run), 6))
    if isinstance(run, Plan) or (isinstance(run, Trajectory) and run.mode == FLOATING):
        on_board = run.momentum
    excursion = np.array([pin.log3(start.T @ cfg.base.rotation) for cfg in floating])
    momentum, rate, torque = np.zeros((3, len(run), 3))
    for i in counted(range(len(run)), progress):
        cfg, afloat = run[i], floating[i]
        momentum[i] = _held_momentum(cfg) @ run.dq[i]
        rate[i] = afloat.base.rotation.T @ base_velocity(afloat, run.dq[i])[3:]
        taken = inverse_dynamics(cfg, run.dq[i], run.ddq[i], mode=HELD)
        torque[i] = cfg.base.rotation.T @ taken.reaction[3:]
    return Reaction(
        arm=run.arm,
        t=run.t,
        excursion=excursion,
        rate=rate,
        momentum=momentum,
        on_board=on_board[:, 3:] @ start,
        torque=torque,
        simulated=np.array([pin.log3(start.T @ cfg.base.rotation) for cfg in run]),
        **_recorded(run),
        camera=sight,
        unbounded=run.ended_singular,
        jump=run.momentum_jump,
    )


def _free_floating(run: Motion) -> Sequence[Configuration]:
    """Return the configurations of the joint motion while nothing controls the attitude.

    They are those of the motion itself where it is free-floating and its wheels do not act.

    Raises:
        UnsupportedError: They are not, and the arm changes on the way.
    """
    first = run[0]
    if run.mode == FLOATING and not run.wheels_act:
        return list(run)
    if isinstance(run, Flight) and any(phase.arm is not run.arm for phase in run.phases):
        raise UnsupportedError(
            f"{run.arm.name}: the arm changes on the flight, so that no free-floating motion "
            "compares with it; give its phases one by one: flight.phases[0]"
        )
    if run.mode != FLOATING:  # whoever controls the attitude absorbs the momentum on board
        first = run.arm.at(run.q[0], base=first.base)
    attitudes = attitudes_over_time(first, run.spline, run.t)
    rows = [placed(first, q, T) for q, T in zip(run.q, attitudes, strict=True)]
    return [cfg.with_momentum(first.momentum).with_wheels(first.wheels) for cfg in rows]


def _recorded(run: Motion) -> dict[str, Any]:
    """Return what the wheels did in the motion itself, as fields of `Reaction`."""
    if not isinstance(run, Trajectory) or not run.wheels_act:
        none = np.zeros((len(run), 0))
        return {"wheel_momentum": none, "wheel_torque": none}
    names = [wheel.name for wheel in run.arm.wheels]
    full = {event.detail for event in run.events if event.kind == "wheel full"}
    return {
        "wheel_momentum": run.wheels,
        "wheel_torque": run.wheel_torque,
        "motors": tuple(load for load in run.motors if load.motor in names),
        "full": tuple(name for name in names if name in full),
    }


def _held_momentum(cfg: Configuration) -> Array:
    """Return D_q (3, n), in spacecraft axes: the arm's momentum while the attitude is held."""
    return np.asarray(cfg.base.rotation.T @ momentum_matrix(cfg).A_q[3:])


class WheelSizing(Result):
    """The momentum, and for motions the torque, that wheels need to hold the attitude.

    A case is a motion, or a posture at which the tip moves at a speed in the worst direction.

    Attributes:
        arm: The arm.
        cases: "motions" or "postures".
        tip_speed: Speed of the tip [m/s], or [rad/s] for a task without linear rows; NaN for
            motions.
        axes: (m, 3) largest momentum about each axis of the spacecraft [N m s].
        momentum: (m,) largest momentum about any axis [N m s].
        torque: (m, 3) largest torque about each axis [N m]; NaN for postures.
        q: (m, n) the postures; for motions the posture with the largest momentum.
        left_out: Share of the postures drawn that were left out, being nearer to a singularity of
            the held arm than `near`: joint rates and momentum have no bound there.
        near: Distance to a singularity below which postures are left out [rad]; zero for motions.
    """

    arm: SpaceArm
    cases: str
    tip_speed: float
    axes: Array
    momentum: Array
    torque: Array
    q: Array
    left_out: float
    near: float

    JSON: ClassVar[Mapping[str, str]] = {
        "axes": "axis_momentum",
        "momentum": "wheel_momentum",
        "torque": "holding_torque",
    }

    @cached_property
    def worst(self) -> int:
        """Number of the case with the largest momentum."""
        return int(np.argmax(self.momentum))

    def covering(self, percent: float) -> tuple[Array, float]:
        """Return the momentum about each axis (3,) and about any that covers a share of the cases.

        Args:
            percent: The share, up to 100.

        Raises:
            ConfigurationError: It is not from 0 to 100.
        """
        share = within(percent, "percent", 0.0, 100.0)
        each = np.percentile(self.axes, share, axis=0)
        return np.asarray(each), float(np.percentile(self.momentum, share))

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data, with the percentiles of the momentum."""
        found = {f"{p:g}": float(np.percentile(self.momentum, p)) for p in PERCENTILES}
        return super().to_dict() | {"percentiles": found}

    def describe(self) -> Description:
        """Describe the momentum about each axis that covers shares of the cases."""
        about = f"{len(self.momentum):,} {self.cases}"
        if self.cases == "postures":
            unit = "m/s" if min(self.arm.task.indices) < 3 else "rad/s"
            about += f" at {self.tip_speed:g} {unit}"
        half, most = (float(np.percentile(self.momentum, p)) for p in (50.0, 99.0))
        rows = []
        for percent in PERCENTILES:
            each, whole = self.covering(percent)
            rows.append((f"{percent:g} %", *each, whole))
        axes = [Column(f"about {axis}", "N m s", ".4g") for axis in ("x", "y", "z", "any axis")]
        left_out = (
            f"left out: {self.left_out:.1%} of the postures drawn, within "
            f"{np.degrees(self.near):.3g}° of a singularity of the held arm"
        )
        notes = [left_out] if self.cases == "postures" else []
        on_board = [] if carried(self.arm.model, self.arm.wheels) else self.arm.wheels
        held = held_about_any_axis(self.arm.model, on_board)
        if 0.0 < held < np.inf:
            notes.append(
                f"the wheels of {self.arm.name} hold {held:.4g} N m s about any axis, enough for "
                f"{np.mean(self.momentum <= held):.0%} of the {self.cases}"
            )
        return Description(
            title=f"{self.arm.name}, {about}",
            verdict=f"median {half:.4g} N m s, 99 % below {most:.4g}, "
            f"worst {self.momentum.max():.4g}",
            notes=notes,
            tables=[Table(("covered", *axes), rows)],
        )


@checked
def size_wheels(
    arm: SpaceArm,
    motions: Playable | Sequence[Playable] | None = None,
    *,
    tip_speed: float | None = None,
    samples: int = 2000,
    near: float = NEAR,
    seed: int = 0,
    progress: Progress | None = None,
) -> WheelSizing:
    """Compute the momentum that wheels need to hold the attitude against the arm's motions.

    For motions it is the largest on the way, with the torque; see `reaction`. For a tip speed it is
    computed for many postures, uniform within the joint limits, while the tip moves at this speed
    in the worst direction and does not turn: the largest singular value of D_q J^+, where J is the
    Jacobian with the attitude held. It grows in proportion to the speed.

    Args:
        arm: The arm.
        motions: One motion of this arm, or several.
        tip_speed: Speed of the tip [m/s] instead; [rad/s] for a task without linear rows.
        samples: Number of postures.
        near: Distance to the singularities of the held arm below which postures are left out
            [rad]; the joint rates grow there without bound.
        seed: Of the postures.
        progress: Called now and then as progress(done, cases).

    Returns:
        The momentum of each case, about each axis and about any.

    Raises:
        ConfigurationError: Neither motions nor a speed is given, or both, or motions of other arms.
        UnsupportedError: The arm has several tips, or a sliding joint without limits.
        NoSolutionError: All postures are near singularities.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> slow, fast = (sa.size_wheels(arm, tip_speed=v, samples=50) for v in (0.1, 0.2))
        >>> round(float(fast.momentum.max() / slow.momentum.max()), 6)
        2.0
    """
    if (motions is None) == (tip_speed is None):
        raise ConfigurationError("give motions or tip_speed, one of them")
    if motions is not None:
        given = list(motions) if isinstance(motions, Sequence) else [motions]
        return _of_motions(arm, given, progress)
    arm.require_one_tip()
    speed = positive(tip_speed, "tip_speed", "speed [m/s]")
    near = within(near, "near", 0.0, what="a distance [rad]")
    Q = uniform(arm, True, whole(samples, "samples", 1), generator(seed))
    cfgs: list[Configuration] = []
    moved: list[Array] = []
    for q in counted(Q, progress):
        if distance_at(cfg := arm.at(q), HELD) > near:
            cfgs.append(cfg)
            moved.append(speed * _momentum_by_speed(cfg))
    if not cfgs:
        raise NoSolutionError(
            f"all {samples} postures of {arm.name} are within {np.degrees(near):.3g}° of a "
            "singularity of the arm with its attitude held; lower near, or take fewer task rows"
        )
    G = np.array(moved)
    return WheelSizing(
        arm=arm,
        cases="postures",
        tip_speed=speed,
        axes=np.linalg.norm(G, axis=2),
        momentum=np.linalg.norm(G, ord=2, axis=(1, 2)),
        torque=np.full((len(G), 3), np.nan),
        q=np.array([cfg.q for cfg in cfgs]),
        left_out=1.0 - len(cfgs) / len(Q),
        near=near,
    )


def _momentum_by_speed(cfg: Configuration) -> Array:
    """Compute the angular momentum (3, r) by each linear task row of the tip's velocity.

    The attitude is held, and what the task has besides stays at rest; [N m s] by [m/s]. For tasks
    without linear rows it is by each row [rad/s]. Spacecraft and task axes, redundant arms with the
    least joint rates.
    """
    task = cfg.arm.task
    J = task_jacobian(cfg, mode=HELD) / task.scale
    rows = [i for i, row in enumerate(task.indices) if row < 3] or list(range(task.k))
    return np.asarray((_held_momentum(cfg) @ np.linalg.pinv(J))[:, rows])


def _of_motions(
    arm: SpaceArm, motions: Sequence[Playable], progress: Progress | None
) -> WheelSizing:
    """Size wheels for motions."""
    if not motions:
        raise ConfigurationError("motions is empty; give one motion or several")
    for i, motion in enumerate(motions):
        if motion.arm.joint_names != arm.joint_names:
            raise ConfigurationError(
                f"motion {i} is one of {motion.arm.name}, with other joints than {arm.name}"
            )
    found = []
    for i, motion in enumerate(motions):

        def tell(done: int, of: int, before: int = i) -> None:
            if progress:
                progress(before * of + done, len(motions) * of)

        found.append(reaction(motion, progress=tell))
    sizes = [np.linalg.norm(each.wheels, axis=1) for each in found]
    where = [int(np.argmax(size)) for size in sizes]
    return WheelSizing(
        arm=arm,
        cases="motions",
        tip_speed=np.nan,
        axes=np.array([np.abs(each.wheels).max(axis=0) for each in found]),
        momentum=np.array([size.max() for size in sizes]),
        torque=np.array([np.abs(each.torque).max(axis=0) for each in found]),
        q=np.array([motion.q[i] for motion, i in zip(motions, where, strict=True)]),
        left_out=0.0,
        near=0.0,
    )
