"""Runs of arms that hold one target: simulated in time, with the forces at the grasps.

The first tip carries the target, and v = (v_b, dq). The other tips i move with the target: C v = 0
with C_i = J_i - X_i J_0, where X_i takes the twist of the first grasp to that of grasp i. Hence

    M dv + c = (0, tau) + C^T lambda,   C dv = -dC v - 2 b C v - b^2 e,

e what grasps are open, which decays at the rate b (Baumgarte, Comput. Methods Appl. Mech. Eng. 1,
1-16 (1972), DOI 10.1016/0045-7825(72)90018-7). lambda is internal: momentum is kept. The hands give
the target the wrenches w, of which only G^T w moves it. The rest of w squeezes it: joint torques
J_q^T w_i of wrenches with G^T w_i = 0 add w_i to w, and nothing moves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.integrate import DOP853

from spacearm import errors
from spacearm.arrays import Array, ArrayLike, finite, numbers_of, positive
from spacearm.closure.closing import carried
from spacearm.closure.shared_loads import least_shares
from spacearm.closure.target_paths import HELD, Carrying, gaps_table
from spacearm.compiler import numbers
from spacearm.equations.laws import Pose, State, quaternion_rate
from spacearm.equations.plant import cut_torques, held_attitude, taken, yielding
from spacearm.mechanics import dynamics
from spacearm.mechanics.arm_kernels import structure_of
from spacearm.mechanics.floating import samples
from spacearm.model.arm import Configuration, kinematics
from spacearm.model.frames import LWA
from spacearm.model.joints import joint_vector
from spacearm.motion.controllers import Controller, memory_at_start
from spacearm.motion.events import Event, first_fall
from spacearm.motion.goal import twist_between
from spacearm.motion.motion import Trajectory
from spacearm.motion.motion_file import Quantity
from spacearm.motion.plant import Integration, Plant, WheelHold, wheel_torques
from spacearm.motion.simulation import audit
from spacearm.motion.system import System, prepared
from spacearm.results import Column, Description, Table
from spacearm.signatures import shown

#: Rate at which open grasps close [1/s].
PULL = 5.0
#: Share of the largest singular value up to which directions of closure are the same.
ROUNDING = 1e-11


class ClosedState(NamedTuple):
    """Accelerations and forces of one state.

    Attributes:
        dv: (6 + n,) accelerations of spacecraft (spatial, its own axes) and joints.
        tau: (n,) joint torques, those that squeeze included [N m] or [N].
        wrenches: (tips, 6) what each hand gives the target, [force [N]; moment about the grasp
            [N m]], inertial axes.
    """

    dv: Array
    tau: Array
    wrenches: Array


def closure_rows(cfg: Configuration) -> Array:
    """Return C (6 (tips - 1), 6 + n): the velocities at which grasps open, inertial axes."""
    first, *others = np.split(cfg.J, len(cfg.tips))
    at = cfg.tips[0].translation
    pairs = zip(cfg.tips[1:], others, strict=True)
    none = np.empty((0, first.shape[1]))  # of one tip
    return np.vstack([none, *(J - carried(tip.translation - at) @ first for tip, J in pairs)])


def onto_closure(cfg: Configuration, v: Array) -> Array:
    """Return the velocities next to v (6 + n,), by energy, that keep the grasps closed.

    Impulses of the grasps lead there: momentum stays.
    """
    C, M = closure_rows(cfg), dynamics.mass_matrix(cfg)
    X = dynamics.solve(cfg.arm, M, C.T, dynamics.M_BB)
    return v - X @ np.linalg.lstsq(C @ X, C @ v, rcond=ROUNDING)[0]


def closed_state(
    carrying: Carrying,
    cfg: Configuration,
    v: Array,
    tau: Array,
    squeeze: Array | None,
    others: Array | None = None,
) -> ClosedState:
    """Compute accelerations and the wrenches of the hands on the target.

    Args:
        carrying: The arms with the target.
        cfg: Their configuration.
        v: (6 + n,) twist of the spacecraft in its own axes, and joint rates.
        tau: (n,) joint torques [N m] or [N].
        squeeze: (tips, 6) the balanced wrenches wanted, inertial axes; None for those that tau
            brings.
        others: (6 + n,) generalized forces of all else that acts; None for none.
    """
    arm, tips = cfg.arm, cfg.tips
    M, c, C = dynamics.mass_matrix(cfg), dynamics.bias_forces(cfg, v, None), closure_rows(cfg)
    drift = _drift(cfg, v)
    first, *twists = np.split(cfg.J @ v, len(tips))
    spin, grasp = first[3:], carrying.frame(cfg)
    bias = [np.empty(0)]
    for i, twist in enumerate(twists, 1):
        lever = tips[i].translation - tips[0].translation
        turning = np.concatenate((pin.skew(spin) @ (twist[:3] - first[:3]), np.zeros(3)))
        open_ = twist_between(grasp * carrying.grasps[i], tips[i])
        opens = twist - carried(lever) @ first
        bias.append(
            drift[i] - carried(lever) @ drift[0] - turning + 2.0 * PULL * opens + PULL**2 * open_
        )
    force = np.concatenate((np.zeros(6), tau)) - c + (0.0 if others is None else others)
    X = dynamics.solve(arm, M, np.column_stack((C.T, force)), dynamics.M_BB)
    X, free = X[:, :-1], X[:, -1]
    impulse = -np.linalg.lstsq(C @ X, np.concatenate(bias) + C @ free, rcond=ROUNDING)[0]
    dv = free + X @ impulse
    w = np.vstack((np.zeros((1, 6)), -impulse.reshape(-1, 6)))
    levers = [tip.translation - tips[0].translation for tip in tips]
    sums = sum(carried(lever).T @ each for lever, each in zip(levers, w, strict=True))
    w[0] = _weight(carrying, cfg, v, cfg.J[:6] @ dv + drift[0]) - sums
    if squeeze is None:
        return ClosedState(dv, tau, w)
    more = squeeze - balanced(carrying, cfg, w)
    return ClosedState(dv, tau + cfg.J[:, 6:].T @ more.ravel(), w + more)


def balanced(carrying: Carrying, cfg: Configuration, w: Array) -> Array:
    """Return the part of wrenches (tips, 6) that does not move the target: w - (G^T)^+ G^T w.

    The pseudo-inverse gives the least wrenches; moments count by the length of the task.
    """
    at = carrying.frame(cfg).translation
    levers = [tip.translation - at for tip in cfg.tips]
    total = sum(carried(lever).T @ each for lever, each in zip(levers, w, strict=True))
    shares = least_shares(levers, carrying.arm.task.length or 1.0)
    return np.asarray(w - (shares @ total).reshape(w.shape))


def _drift(cfg: Configuration, v: Array) -> Array:
    """Return the accelerations (tips, 6) of the tips where dv = 0, inertial axes."""
    arm = cfg.arm
    model, data = arm.model, arm.borrow()
    full = np.concatenate((v[:6], arm.all_rates(v[6:])))
    pin.forwardKinematics(model, data, cfg.full_at_origin, full, np.zeros_like(full))
    pin.updateFramePlacements(model, data)
    found = [
        pin.getFrameClassicalAcceleration(model, data, frame, LWA).vector
        for frame in arm.tip_frames
    ]
    arm.give_back(data)
    return np.array(found)


def _weight(carrying: Carrying, cfg: Configuration, v: Array, acceleration: Array) -> Array:
    """Return the wrench (6,) at the first grasp that moves the target so, by Newton and Euler.

    Args:
        carrying: The arms with the target.
        cfg: The configuration.
        v: (6 + n,) velocities.
        acceleration: (6,) that of the first grasp, inertial axes.
    """
    target, frame = carrying.target, carrying.frame(cfg)
    w, dw = (cfg.J[3:6] @ v), acceleration[3:]
    W = pin.skew(w)
    lever = frame.act(target.com) - cfg.tips[0].translation
    force = target.mass * (acceleration[:3] + (pin.skew(dw) + W @ W) @ lever)
    I = frame.rotation @ target.inertia @ frame.rotation.T
    moment = I @ dw + W @ I @ w
    return np.concatenate((force, moment + pin.skew(lever) @ force))


#: Share of the velocities of the tips, and velocity, up to which rates at the start are closed.
OPENING, STILL = 1e-6, 1e-9
#: Share of wrenches up to which they count as balanced.
UNBALANCED = 1e-6


class TargetRun(Trajectory, kw_only=True):
    """The motion of arms that hold a target under joint torques, from `Held.simulate`.

    Its arm is the arms with the target, which is fixed to the first tip.

    Attributes:
        target: (m, 7) poses of the target: position [m], quaternion xyzw, inertial frame.
        gap: (m,) largest distance of a tip from its grasp [m].
        gap_angle: (m,) largest angle between them [rad].
        grasps: (m, 6) what the hand at each tip gives the target, [force [N]; moment about the
            grasp [N m]], inertial axes.
    """

    target: Array
    gap: Array
    gap_angle: Array
    grasps: Mapping[str, Array] = field(default_factory=dict)

    QUANTITIES: ClassVar[Mapping[str, Quantity]] = {
        **Trajectory.QUANTITIES,
        **{name: HELD[name] for name in ("target", "gap", "gap_angle")},
    }

    @property
    def overloaded(self) -> list[str]:
        """Joints whose torque reaches the largest of the description in some row."""
        arm, most = self.arm, np.abs(self.torque).max(axis=0)
        effort = np.array([arm.tree.joints[name].effort for name in arm.joint_names])
        full = most >= (1.0 - ROUNDING) * effort
        return [name for name, over in zip(arm.joint_names, full, strict=True) if over]

    not_checked = "collisions; singular postures of the closed chain: Held.after(run).report()"

    def describe(self) -> Description:
        """Describe the motion, its balances, and what the grasps bear."""
        motion = super().describe()
        rows = []
        for tip, w in self.grasps.items():
            force, moment = (float(np.linalg.norm(x, axis=1).max()) for x in np.split(w, 2, axis=1))
            rows.append((tip, force, moment))
        columns = (Column("tip"), Column("largest force", "N"), Column("largest moment", "N m"))
        table = Table(columns, rows, "What the grasps bear")
        notes, over = [*motion.notes], self.overloaded
        if over:
            notes.append(
                f"the largest torque of the description is reached by {errors.listed(over)}; "
                "sa.Plant(limits=True) cuts what is beyond, and neither what the law asks for nor "
                "squeeze is kept then"
            )
        return replace(motion, notes=notes, tables=[*motion.tables, gaps_table(self), table])


class Simulation:
    """The state y = (q, dq, spacecraft's place, quaternion and twist, works, wheels).

    Works are that of the torques, that of all else, and all that came and went. Arguments and
    errors are those of `Held.simulate`.
    """

    def __init__(
        self,
        carrying: Carrying,
        controller: Controller,
        squeeze: Mapping[str, ArrayLike] | None,
        bears: Sequence[float] | Mapping[str, Sequence[float]],
        plant: Plant,
        integration: Integration,
    ) -> None:
        self.carrying, self.controller, self.n = carrying, controller, carrying.arm.n
        self.asked, self.bears = bears, _borne(carrying.arm.tips, bears)
        self.integration = integration
        self.squeeze = None if squeeze is None else _squeeze(carrying, squeeze)
        if plant.pushed:
            links = errors.listed([link for link, *_ in plant.pushed])
            raise errors.UnsupportedError(
                f"wrenches on {links} are not simulated with a held target; give wheels, passive "
                "and limits of the plant only"
            )
        sampled = isinstance(plant.wheels, WheelHold) and plant.wheels.sampled
        if sampled or plant.friction_of_wheels.acts:
            raise errors.UnsupportedError(
                "wheels that are sampled or have friction are not simulated with a held target; "
                "leave sampled and wheel_friction out"
            )
        if len(memory_at_start(controller, carrying.start)):
            raise errors.UnsupportedError(
                f"{type(controller).__name__} has a memory, and a held target is simulated without "
                "a control period; give a law without memory"
            )
        self.system = System(carrying.start, plant=plant)
        ready = prepared(self.system, trace=False)
        self.setup, shapes = ready.setup, ready.setup.plant_shapes(self.n)
        self.given = taken(ready.plant, shapes)
        self.capacity = self.given["capacity"] if self.setup.holds else np.full(1, np.inf)
        full = bool(np.isfinite(self.capacity).any())
        known = {"joint limit", *["wheel full"] * full} & {*integration.events}
        self.events = ["grasp", *sorted(known)]

    def run(
        self,
        duration: float,
        dq: ArrayLike | None,
        progress: Callable[[float, float], object] | None,
    ) -> TargetRun:
        """Simulate; arguments, results and errors as of `Held.simulate`."""
        arm, integration = self.carrying.arm, self.integration
        duration = positive(duration, "duration", "time [s]")
        y = self.start(np.zeros(arm.n) if dq is None else joint_vector(arm, dq, "dq"))
        times = np.append(integration.times(duration), duration)
        method: Callable[..., Any] = DOP853
        solver = method(self.rate, 0.0, y, duration, rtol=integration.rtol, atol=integration.atol)
        t, states, events, ended = [0.0], [y], list[Event](), "duration"
        before = self.rooms(0.0, y)
        if before[0] < 0.0:
            raise errors.ConfigurationError(
                f"bears is {self.asked!r}, and more than that is borne at the start; squeeze "
                "less, or give a larger force [N] and moment [N m]"
            )
        while solver.status == "running" and ended == "duration":
            if failure := solver.step():
                raise errors.NoSolutionError(
                    f"{arm.name}: the step size collapsed at {solver.t:.4g} s: {failure}"
                )
            piece, end = solver.dense_output(), solver.t
            after = self.rooms(end, solver.y)

            def along(s: float, piece: Any = piece) -> Array:
                return self.rooms(s, piece(s))

            if fall := first_fall(along, before, after, solver.t_old, end):
                end, kind = fall[0], self.events[fall[1]]
                events.append(self.event(end, piece(end), kind))
                ended = "grasp" if kind == "grasp" else ended
                end = end if ended == "grasp" else solver.t
            rows = times[(times > t[-1]) & (times <= end)].tolist()
            rows += [end] if ended == "grasp" and (not rows or rows[-1] < end) else []
            t += rows
            states += [self.closed(piece(s)) for s in rows]
            solver.y = self.closed(solver.y)
            solver.f = self.rate(solver.t, solver.y)
            before = after
            if progress:
                progress(float(solver.t), duration)
        result = self._result(np.array(t), np.array(states), tuple(events), ended)
        audit(result, result.drift, integration)
        return result

    def _result(self, t: Array, states: Array, events: tuple[Event, ...], ended: str) -> TargetRun:
        """Return the run with these rows."""
        carrying, n = self.carrying, self.n
        arm, m = carrying.arm, len(t)
        pairs = [self.parts(y) for y in states]
        acting = [self.others(s, *pair) for s, pair in zip(t, pairs, strict=True)]
        found = [self.state(s, *pair, others) for s, pair, (_, others)
                 in zip(t, pairs, acting, strict=True)]  # fmt: skip
        wrenches = np.array([one.wrenches for one in found])
        rows: Any = [cfg for cfg, _ in pairs]
        return TargetRun(
            arm=arm,
            t=t,
            **samples(rows),
            dq=states[:, n : 2 * n].copy(),
            ddq=np.array([one.dv[6:] for one in found]),
            torque=np.array([one.tau for one in found]),
            momentum=np.array([cfg.A @ v + cfg.stored for cfg, v in pairs]),
            impulse=np.zeros((m, 6)),
            wheels=states[:, 2 * n + 16 :].copy(),
            wheel_torque=np.array([taken_up for taken_up, _ in acting]),
            wheel_friction=np.zeros((m, len(arm.wheels))),
            energy=np.array([0.5 * v @ dynamics.mass_matrix(cfg) @ v for cfg, v in pairs]),
            work=states[:, 2 * n + 13].copy(),
            other_work=states[:, 2 * n + 14].copy(),
            exchanged=float(states[-1, 2 * n + 15]),
            events=events,
            ended=ended,
            grasps={tip: wrenches[:, i].copy() for i, tip in enumerate(arm.tips)},
            **carrying.account(rows),
        )

    def start(self, dq: Array) -> Array:
        """Return the state at the start.

        Raises:
            ConfigurationError: The rates open the grasps.
        """
        cfg = self.carrying.start
        v = dynamics.generalized_velocity(cfg, dq)
        opening = np.abs(closure_rows(cfg) @ v).max(initial=0.0)
        size = np.abs(cfg.J @ v).max()
        if opening > OPENING * size + STILL:
            raise errors.ConfigurationError(
                f"dq opens the grasps at {opening:.2g} m/s or rad/s; give rates that keep them "
                "closed, such as those of Held.follow, or None to start at rest"
            )
        v = onto_closure(cfg, v)
        works = np.zeros(3)
        return np.concatenate((cfg.q, v[6:], pin.SE3ToXYZQUAT(cfg.base), v[:6], works, cfg.wheels))

    def parts(self, y: Array) -> tuple[Configuration, Array]:
        """Return configuration and velocities (6 + n,) of a state."""
        n = self.n
        x, turn = y[2 * n : 2 * n + 3], y[2 * n + 3 : 2 * n + 7]
        R = pin.Quaternion(turn / np.linalg.norm(turn)).matrix()
        cfg = kinematics(self.carrying.arm, y[:n].copy(), pin.SE3(R, x.copy()))
        if (momentum := self.carrying.start.momentum).any():
            cfg = cfg.with_momentum(momentum)
        if (wheels := y[2 * n + 16 :]).any():
            cfg = cfg.with_wheels(wheels)
        return cfg, np.concatenate((y[2 * n + 7 : 2 * n + 13], y[n : 2 * n]))

    def closed(self, y: Array) -> Array:
        """Return the closed state next to one."""
        y, n = y.copy(), self.n
        y[:n] = self.carrying.closed(y[:n])
        cfg, v = self.parts(y)
        v = onto_closure(cfg, v)
        y[2 * n + 7 : 2 * n + 13], y[n : 2 * n] = v[:6], v[6:]
        return y

    def others(self, t: float, cfg: Configuration, v: Array) -> tuple[Array, Array]:
        """Return what wheels take up (w,), and generalized forces (6 + n,) of them and joints."""
        base, tree = Pose(cfg.base.rotation, cfg.base.translation), structure_of(cfg.arm)
        at: Any = None
        now = State(tree, at, t, None, cfg.q, v[6:], base, cfg.com, (), cfg.wheels, cfg.momentum,
                    self.given, [])  # fmt: skip
        taken_up: Array = np.zeros(len(cfg.arm.wheels))
        if self.system.motors is not None:
            taken_up = wheel_torques(self.system.motors(t), len(taken_up))
        elif self.setup.holds:
            taken_up = np.asarray(held_attitude(numbers, now, v[3:6]))
        give = np.concatenate((np.zeros(6), yielding(numbers, now, self.setup)))
        return taken_up, give + (dynamics.motor_reactions(cfg, taken_up) if taken_up.any() else 0.0)

    def state(self, t: float, cfg: Configuration, v: Array, others: Array) -> ClosedState:
        """Return accelerations and forces in a state, under other forces (6 + n,)."""
        tau = joint_vector(cfg.arm, self.controller(t, cfg, v[6:].copy()), "controller")
        R = self.carrying.frame(cfg).rotation
        squeeze = self.squeeze
        if squeeze is not None:
            squeeze = (squeeze.reshape(-1, 3) @ R.T).reshape(squeeze.shape)
            found = closed_state(self.carrying, cfg, v, tau, squeeze, others)
            tau = found.tau
        cut = self._cut(tau, v[6:])
        if squeeze is not None and (cut == tau).all():
            return found
        return closed_state(self.carrying, cfg, v, cut, None, others)

    def _cut(self, tau: Array, dq: Array) -> Array:
        """Return torques (n,) as the motors give them."""
        if not self.setup.limits:
            return tau
        return np.asarray(cut_torques(numbers, tau, dq, self.given["effort"], self.given["speed"]))

    def rate(self, t: float, y: Array) -> Array:
        """Return the derivative of the state by time."""
        cfg, v = self.parts(y)
        taken_up, others = self.others(t, cfg, v)
        now, n = self.state(t, cfg, v, others), self.n
        turning = quaternion_rate(numbers, y[2 * n + 3 : 2 * n + 7], v[3:6])
        power = np.array([now.tau @ v[6:], others @ v])
        return np.concatenate(
            (v[6:], now.dv[6:], cfg.base.rotation @ v[:3], turning, now.dv[:6],
             power, [np.abs(power).sum()], taken_up)
        )  # fmt: skip

    def room(self, t: float, y: Array, kind: str) -> Array:
        """Return how far joints (n,), wheels (w,) or loads of grasps (tips, 2) are from limits."""
        cfg, v = self.parts(y)
        if kind == "joint limit":
            return np.minimum(cfg.arm.upper - cfg.q, cfg.q - cfg.arm.lower)
        if kind == "wheel full":
            return np.asarray(self.capacity - np.abs(cfg.wheels))
        if not np.isfinite(self.bears).any():
            return self.bears
        return self.bears - _loads(self.state(t, cfg, v, self.others(t, cfg, v)[1]).wrenches)

    def rooms(self, t: float, y: Array) -> Array:
        """Return how far a state is from each event."""
        return np.array([float(self.room(t, y, kind).min()) for kind in self.events])

    def event(self, t: float, y: Array, kind: str) -> Event:
        """Return an event."""
        room, (cfg, _) = self.room(t, y, kind), self.parts(y)
        first, arm = int(room.argmin()), cfg.arm
        if kind == "grasp":
            tip, what = divmod(first, 2)
            load, unit = self.bears[tip, what] - room[tip, what], ("N", "N m")[what]
            return Event(t, kind, cfg.q, f"{arm.tips[tip]}: {load:.4g} {unit}")
        names = arm.joint_names if kind == "joint limit" else [wheel.name for wheel in arm.wheels]
        return Event(t, kind, cfg.q, names[first])


def _borne(tips: Sequence[str], bears: Sequence[float] | Mapping[str, Sequence[float]]) -> Array:
    """Return the largest force [N] and moment [N m] (tips, 2) of each grasp.

    Raises:
        ConfigurationError: A name is not a tip, or they are not two numbers above 0.
    """
    given = bears if isinstance(bears, Mapping) else dict.fromkeys(tips, bears)
    errors.require_known("tip", given, tips, "bears: ")
    for each in given.values():
        most = numbers_of(each, "bears")
        if most.shape != (2,) or not (most > 0.0).all():
            raise errors.ConfigurationError(
                f"bears is {shown(bears)}; give a force [N] and a moment [N m] above 0, or both by "
                "tip"
            )
    return np.array([given.get(tip, (np.inf, np.inf)) for tip in tips], dtype=np.float64)


def _loads(wrenches: Array) -> Array:
    """Return force [N] and moment [N m] (tips, 2) of wrenches (tips, 6)."""
    return np.linalg.norm(wrenches.reshape(-1, 2, 3), axis=2)


def _squeeze(carrying: Carrying, given: Mapping[str, ArrayLike]) -> Array:
    """Return the wrenches (tips, 6) by which the hands are to squeeze, axes of the target.

    Raises:
        ConfigurationError: They are not those of all tips, or do not balance.
    """
    cfg, tips = carrying.start, carrying.arm.tips
    if set(given) != set(tips):
        raise errors.ConfigurationError(
            f"squeeze is {given!r}; give a wrench (6,) for each tip: {', '.join(tips)}"
        )
    w = np.array([finite(given[tip], (6,), f"squeeze of {tip!r}", "[N], [N m]") for tip in tips])
    R = carrying.frame(cfg).rotation
    turned = (w.reshape(-1, 3) @ R.T).reshape(w.shape)
    off = turned - balanced(carrying, cfg, turned)
    if np.abs(off).max() > UNBALANCED * max(np.abs(w).max(), 1.0):
        at = carrying.frame(cfg).translation
        total = sum(
            carried(tip.translation - at).T @ each
            for tip, each in zip(cfg.tips, turned, strict=True)
        )
        raise errors.ConfigurationError(
            f"squeeze does not balance: it gives the target {np.round(total, 6).tolist()} "
            "[N], [N m] about its frame; wrenches that squeeze have no sum, as (0, 0, f, 0, 0, 0) "
            "at two grasps that face each other, in the axes of the target"
        )
    return w
