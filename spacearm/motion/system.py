"""Systems: an arm at its start with all that acts on it, as what the equations of a run take."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, finite
from spacearm.compiler import symbols
from spacearm.compiler.expressions import asarray
from spacearm.equations.laws import Law, Source, State
from spacearm.equations.plant import (
    Event,
    Parts,
    Pushed,
    Setup,
    cut_torques,
    moving,
    parts,
)
from spacearm.errors import ConfigurationError, UnsupportedError, require_known
from spacearm.mechanics.arm_kernels import parameters_of, structure_of
from spacearm.model.arguments import BaseMode, free_components
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.model.frames import sound_pose
from spacearm.model.joints import joint_name, joint_vector
from spacearm.motion import controllers as law_types
from spacearm.motion import plant as plants
from spacearm.motion import user_functions as users
from spacearm.motion.controllers import Controller, JointPD, gains, memory_at_start, torque_limits
from spacearm.motion.events import CLOSE, EVENTS, has_determinant
from spacearm.motion.goal import goal_normal
from spacearm.motion.plant import Integration, MotorLoad, PassiveJoint, Plant, WheelHold
from spacearm.singularities.report import NO_INVERSE

#: The laws that are equations; laws derived from them are users' laws.
KINDS: dict[type, str] = {
    JointPD: "joints",
    law_types.TransposedJacobian: "transposed",
    law_types.ResolvedRate: "resolved",
    law_types.DampedLeastSquares: "damped",
    law_types.Reactionless: "reactionless",
}
#: States or times at which a function that is traced is compared with its own values.
EXAMPLES = 3
#: A function called outside: of time and the state, which only laws and events get.
Outside = Callable[[float, Array], Array]


@dataclass(frozen=True)
class System:
    """An arm at its start, and all that acts on it; checked.

    Attributes:
        start: Configuration at the start.
        mode: What the spacecraft does.
        plant: What acts besides the controllers.
        controllers: The controllers by the number of the tip that they lead; -1 for one that acts
            on all joints.
        dq: (n,) joint rates at the start; zeros if None.
    """

    start: Configuration
    mode: BaseMode = "free-floating"
    plant: Plant = Plant()
    controllers: Mapping[int, Controller] = field(default_factory=dict)
    dq: Array | None = None

    def __post_init__(self) -> None:
        free_components(self.mode)
        arm, h = self.arm, self.start.momentum
        if self.mode == "fixed" and h.any():
            raise ConfigurationError(
                f"momentum of the start is {h.tolist()}; a fixed spacecraft takes it up"
            )
        require_known("link", [link for link, *_ in self.plant.pushed], arm.tree.links)
        for name in self.passive:
            joint_name(arm, name)
        _ = self.memories  # raises for one that makes no sense
        if self.plant.wheels is None and not self.plant.friction_of_wheels.acts:
            return
        if self.mode != "free-floating":
            raise ConfigurationError(
                f"wheels turn the spacecraft and mode is {self.mode!r}; give mode='free-floating'"
            )
        if not arm.wheels:
            raise UnsupportedError(f"{arm.name} has no wheels; name their joints by wheels=[...]")
        if self.motors is not None:
            plants.wheel_torques(self.motors(0.0), len(arm.wheels))

    @property
    def arm(self) -> SpaceArm:
        """The arm."""
        return self.start.arm

    @property
    def hold(self) -> WheelHold | None:
        """The law of the wheels, if they hold the attitude."""
        return self.plant.wheels if isinstance(self.plant.wheels, WheelHold) else None

    @property
    def motors(self) -> plants.Motors | None:
        """The torques of the wheels over time, if they are given."""
        return None if isinstance(self.plant.wheels, WheelHold) else self.plant.wheels

    @cached_property
    def memories(self) -> tuple[Array, ...]:
        """What each law remembers at the start (m,), empty if it has no memory."""
        return tuple(memory_at_start(law, self.start) for law in self.controllers.values())

    @property
    def memory(self) -> Array:
        """What all laws remember at the start (M,), one law after the other."""
        return np.concatenate((np.zeros(0), *self.memories))

    @cached_property
    def passive(self) -> Mapping[str, PassiveJoint]:
        """Springs, damping and friction of joints, by name."""
        given = self.plant.passive
        return plants.described(self.arm) if isinstance(given, str) else given

    @cached_property
    def parts(self) -> Parts:
        """Where the parts of a state stand."""
        return parts(self.arm.n, len(self.arm.wheels))

    @property
    def state(self) -> Array:
        """The state at the start, see `equations.plant`."""
        cfg, at = self.start, self.parts
        y = np.zeros(at.wheels.stop)
        y[at.q], y[at.com], y[at.momentum], y[at.wheels] = cfg.q, cfg.com, cfg.momentum, cfg.wheels
        y[at.dq] = 0.0 if self.dq is None else self.dq
        y[at.attitude] = pin.SE3ToXYZQUAT(cfg.base)[3:]
        return y

    def coupled(self, setup: Setup) -> int:
        """Return how many leading components of the state its rate depends on.

        Without wrenches the momentum stays and the system CM moves evenly, whatever the arm does;
        the attitude counts where there is momentum, or a law that may look at it.
        """
        at, h = self.parts, self.start.momentum
        if setup.wheels:
            return at.wheels.stop
        if setup.pushed:
            return at.momentum.stop
        if h[:3].any():
            return at.com.stop
        joints_only = all(law.kind == "joints" for law in setup.laws)
        return at.dq.stop if joints_only and not h.any() else at.attitude.stop

    def configuration(self, y: Array) -> Configuration:
        """Return the configuration in a state, see `equations.plant`."""
        arm, at = self.arm, self.parts
        q, quaternion, h = y[at.q].copy(), y[at.attitude], y[at.momentum]
        if self.mode == "fixed":
            placed = kinematics(arm, q, self.start.base)
        else:
            attitude = pin.Quaternion(quaternion / np.linalg.norm(quaternion))
            placed = kinematics(arm, q, pin.SE3(attitude, np.zeros(3)), y[at.com].copy())
        placed = placed.with_momentum(h) if h.any() else placed
        return placed.with_wheels(y[at.wheels]) if arm.wheels else placed

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
        found: dict[str, Array] = {link: np.zeros((len(t), 6)) for link, *_ in self.plant.pushed}
        for i, time in enumerate(t):
            if self.plant.thrusters:
                pose = pin.XYZQUATToSE3(base[i])
                pin.framesForwardKinematics(model, data, kinematics(self.arm, q[i], pose).full)
            for link, wrench, own in self.plant.pushed:
                values = plants.wrench_at(link, wrench, float(time))
                if own:
                    R = data.oMf[model.getFrameId(link, pin.BODY)].rotation
                    values = (values.reshape(2, 3) @ R.T).ravel()
                found[link][i] += values
        return found


class WantedEvent(NamedTuple):
    """An event that runs look for.

    Attributes:
        root: Its function; None for the distance to the singular set.
        bound: What is taken off its value, or what it is taken off.
        value: Of a function "own" that of time and configuration, in Python.
        kind: The kind of event, as `motion.events.Event` has it.
        detail: What to say about it.
        stops: Whether it ends the run.
        moving: Whether it is that of a target that moves: to be there from the start is none.
    """

    root: Event | None
    bound: float = 0.0
    value: Callable[[float, Configuration], float] | None = None
    kind: str = ""
    detail: str = ""
    stops: bool = False
    moving: bool = False

    @property
    def falling(self) -> bool:
        """Whether only a fall through zero counts."""
        return self.root is None or self.root.kind != "determinant"


class Prepared(NamedTuple):
    """What the equations of a run take.

    Attributes:
        wanted: The events that are looked for.
        setup: What is known while tracing.
        laws: The numbers of the laws.
        plant: The other numbers.
        outside: The functions outside, by the names of `Setup.called`.
        notes: What is called outside, and why.
    """

    wanted: Sequence[WantedEvent]
    setup: Setup
    laws: Array
    plant: Array
    outside: dict[str, Outside]
    notes: tuple[str, ...]


class Preparation:
    """The users' functions of a system, as they are sorted: traced or called outside.

    Args:
        system: The system.
        trace: Whether they are traced where that can be done.
    """

    def __init__(self, system: System, trace: bool) -> None:
        self.system, self.trace = system, trace
        self.outside: dict[str, Outside] = {}
        self.notes: list[str] = []

    def source(
        self, name: str, what: str, function: users.UserFunction, outside: Outside
    ) -> Source:
        """Return a function as a source, traced or called outside.

        Args:
            name: The name of the function outside.
            what: What it is, for the note.
            function: The function.
            outside: What is called outside, checks included.
        """
        used_with = self.system.arm, self.system.mode, what
        why = users.not_traced(function, used_with) if self.trace else "too many"
        if not why:
            return function
        self.outside[name] = outside
        self.notes.append(f"{what} is called in Python: {why}")
        return "outside"

    def over_time(
        self, name: str, what: str, function: Callable[[float], Any], read: Callable[[Any], Array]
    ) -> Source:
        """Return a function of time as a source; `read` checks what it gives."""

        def examples() -> Iterator[users.Example]:
            for t in np.random.default_rng(0).uniform(0.0, 100.0, EXAMPLES):
                value = function(float(t))
                read(value)
                yield (t,), value.homogeneous if isinstance(value, pin.SE3) else value

        seen = users.over_symbols(function)
        traced = users.UserFunction.of(function, lambda t: _array(seen(t)), examples)
        return self.source(name, what, traced, lambda t, _: read(function(t)))

    def law(self, i: int, controller: Controller) -> Source:
        """Return a law as a source."""
        system, seen = self.system, users.over_symbols(controller)
        arm, at, start = system.arm, system.parts, system.memories[i]
        update: Any = getattr(controller, "update", None)
        updated = users.over_symbols(update) if len(start) else None

        def outside(t: float, given: Array) -> Array:
            y, memory = np.split(given, [at.wheels.stop])
            cfg, remembered = system.configuration(y), [memory] if len(start) else []
            tau = controller(t, cfg, y[at.dq].copy(), *map(np.copy, remembered))
            tau = joint_vector(arm, tau, "the controller's torque")
            if updated is None:
                return tau
            following = update(t, cfg, y[at.dq].copy(), memory.copy())
            following = finite(following, start.shape, "the next memory of the controller")
            return np.concatenate((tau, following))

        def of_state(xp: Any, state: State, *memory: Any) -> Any:
            cfg: Any = users.TracedConfiguration(arm, xp, state)

            def of(function: Any) -> Any:
                given = map(users.copied, (state.dq, *memory))
                return _array(function(state.t, cfg, *given))

            return of(seen) if updated is None else xp.concatenate([of(seen), of(updated)])

        def traced(t: Any, y: Any, *memory: Any) -> Any:
            setup = Setup(wheels=(0,) * len(arm.wheels))
            numbers = np.append(system.start.base.translation, np.zeros(3 * len(arm.wheels)))
            tree, p = structure_of(arm, system.mode), parameters_of(arm)
            placed = moving(symbols, tree, p, t, y, np.zeros(0), numbers, setup)
            return of_state(symbols, placed, *memory)

        def examples() -> Iterator[users.Example]:
            rng = np.random.default_rng(0)
            for _ in range(EXAMPLES):
                y = system.state
                y[at.q], y[at.dq] = rng.uniform(-1.0, 1.0, arm.n), rng.normal(size=arm.n)
                y[at.momentum] = 0.0 if system.mode == "fixed" else rng.normal(size=6)
                t = float(rng.uniform(0.0, 100.0))
                if updated is None:
                    yield (t, y), outside(t, y)
                    continue
                memory = start + rng.normal(size=len(start))
                yield (t, y, memory), outside(t, np.concatenate((y, memory)))

        function = users.UserFunction.of(controller, traced, examples, of_state)
        what = f"the controller {type(controller).__name__}"
        return self.source(f"law{i}", what, function, outside)


def prepared(system: System, wanted: Sequence[WantedEvent] = (), *, trace: bool = True) -> Prepared:
    """Return a system as what the equations take.

    Args:
        system: The system.
        wanted: The events that are looked for.
        trace: Whether users' functions are traced where that can be done.
    """
    todo, arm, motors = Preparation(system, trace), system.arm, system.motors
    events = [(event, event.root) for event in wanted if event.root is not None]
    laws = [_law(todo, i, *one) for i, one in enumerate(system.controllers.items())]
    setup = Setup(
        laws=tuple(law for law, _ in laws),
        wheels=tuple(_body(arm, wheel.frame) for wheel in arm.wheels),
        holds=system.hold is not None,
        sampled=system.hold is not None and system.hold.sampled,
        drag=system.plant.friction_of_wheels.acts,
        motors=None if motors is None else todo.over_time(
            "motors", "the torque of the wheels", motors,
            lambda tau: plants.wheel_torques(tau, len(arm.wheels)),
        ),
        pushed=tuple(_pushed(todo, i) for i in range(len(system.plant.pushed))),
        passive=bool(system.passive),
        limits=system.plant.limits,
        events=tuple(root for _, root in events),
    )  # fmt: skip
    todo.outside |= {
        f"event{i}": partial(_value, system, event.value)
        for i, (event, _) in enumerate(events)
        if event.value is not None
    }
    given = _plant_numbers(system, setup, [event.bound for event, _ in events])
    plant = [np.ravel(given[name]) for name, _ in setup.plant_shapes(arm.n)]
    numbers = [np.zeros(0), *(values for _, own in laws for values in own)]
    return Prepared(
        wanted, setup, np.concatenate(numbers), np.concatenate(plant), todo.outside,
        tuple(todo.notes),
    )  # fmt: skip


def wanted_events(
    system: System, integration: Integration, stop: Collection[str] = ()
) -> list[WantedEvent]:
    """Return the events that a run looks for.

    Args:
        system: The system.
        integration: Which are noted.
        stop: Those that end the run.

    Raises:
        ConfigurationError: One does not exist.
    """
    kinds, reach = (*integration.events, *stop), integration.reach
    require_known("event", kinds, EVENTS)
    found: list[WantedEvent] = []
    arm = system.arm

    def add(
        kind: str, detail: str, root: Event | None, bound: float = 0.0, value: Any = None,
        moving: bool = False,
    ) -> None:  # fmt: skip
        found.append(WantedEvent(root, bound, value, kind, detail, kind in stop, moving))

    if "singularity" in kinds and has_determinant(arm, system.mode):
        add("singularity", "S = 0", Event("determinant"))
    elif "singularity" in kinds:
        add("singularity", CLOSE, None)
    if "joint limit" in kinds:
        for j, name in enumerate(arm.joint_names):
            for which, limit in (("upper", arm.upper[j]), ("lower", arm.lower[j])):
                if np.isfinite(limit):
                    add("joint limit", name, Event(which, j), float(limit))
    if "target" in kinds:
        for i, (tip, law) in enumerate(system.controllers.items()):
            moving = bool(getattr(law, "moving", False))
            detail = f"error {reach:g}" + " to the moving target" * moving
            detail += f", {arm.tips[tip]}" if tip >= 0 else ""
            if type(law) in KINDS:
                add("target", detail, Event("target", i), reach, moving=moving)
            elif (error := getattr(law, "error", None)) is not None:

                def miss(t: float, cfg: Configuration, error: Any = error) -> float:
                    return float(np.linalg.norm(error(t, cfg)))

                add("target", detail, Event("own", i), reach, miss, moving)
    if "wheel full" in kinds and system.hold is not None:
        for i, wheel in enumerate(arm.wheels):
            add("wheel full", wheel.name, Event("wheel", i), system.hold.capacity)
    return found


#: Relative difference from a limit that is rounding.
AT_LIMIT = 1e-9


def motor_loads(
    system: System, t: Array, dq: Array, torque: Array, wheel_torque: Array
) -> tuple[MotorLoad, ...]:
    """Return the load of each joint and wheel motor that has a limit.

    Args:
        system: The system that was simulated.
        t: (m,) times [s].
        dq: (m, n) joint rates [rad/s] or [m/s].
        torque: (m, n) joint torques [N m] or [N].
        wheel_torque: (m, w) torques of the wheels' motors [N m].
    """
    arm, hold = system.arm, system.hold
    found = []
    for j, name in enumerate(arm.joint_names):
        joint = arm.tree.joints[name]
        if np.isfinite(joint.effort):
            asked = np.copysign(joint.effort, torque[:, j])
            available = np.abs(cut_torques(np, asked, dq[:, j], joint.effort, joint.velocity))
            load = _against(t, torque[:, j], available)
            found.append(MotorLoad(name, *load, float(joint.effort), system.plant.limits))
    for i, wheel in enumerate(arm.wheels):
        enforced = hold is not None and np.isfinite(hold.torque)
        limit = float(hold.torque if hold is not None and enforced else wheel.torque)
        if np.isfinite(limit) and wheel_torque.any():
            load = _against(t, wheel_torque[:, i], np.full(len(t), limit))
            found.append(MotorLoad(wheel.name, *load, limit, enforced))
    return tuple(found)


def _against(t: Array, torque: Array, available: Array) -> tuple[float, float]:
    """Return the largest size of torques (m,), and the share of time at what is available (m,)."""
    size = np.abs(torque)
    at_limit = size >= available * (1.0 - AT_LIMIT)
    return float(size.max()), plants.share_of_time(t, at_limit)


def _body(arm: SpaceArm, frame: int) -> int:
    """Return the number of the body that a frame is fixed to."""
    return int(arm.model.frames[frame].parentJoint) - 1


def _law(
    todo: Preparation, i: int, tip: int, controller: Any
) -> tuple[Law, list[npt.NDArray[Any]]]:
    """Return a controller as a law, with its numbers."""
    arm, n = todo.system.arm, todo.system.arm.n
    joints = tuple(joints_of(arm, tip)) if tip >= 0 and len(arm.tips) > 1 else None
    memory = len(todo.system.memories[i])
    kind = KINDS.get(type(controller), "own")
    law = Law(kind, tip=max(tip, 0), joints=joints, memory=memory)
    if law.kind == "own":
        return law._replace(source=todo.law(i, controller)), []
    rows, read = n, _joint_reader(arm)
    if law.kind != "joints":
        task, first = arm.task, controller.goal(0.0)
        rows = len(task.rows)
        law = law._replace(
            mode=controller.mode,
            rows=tuple(int(row) for row in task.indices[:rows]),
            scale=tuple(float(scale) for scale in task.scale[:rows, 0]),
            normal=goal_normal(arm),
            pose=isinstance(first, pin.SE3) or np.shape(first) == (4, 4),
            least=NO_INVERSE,
            rests=getattr(controller, "rest", None) is not None,
            rank=law_types.rank_of_turns(arm) if law.kind == "reactionless" else 0,
        )
        read = goal_reader(arm, law.pose)
    if callable(controller.target):
        source = todo.over_time(f"target{i}", "the target", controller.target, read)
        law = law._replace(source=source)
    numbers = []
    for name, shape in law.numbers(n):
        value = getattr(controller, name)
        if name == "target":
            value = read(value)
        elif name == "rest":
            value = joint_vector(arm, value, "rest")
        elif name == "limit":
            value = torque_limits(value, rows)
        elif shape:
            value = np.full(rows, gains(value, rows, name))
        numbers.append(np.ravel(value))
    return law, numbers


def _joint_reader(arm: SpaceArm) -> Callable[[Any], Array]:
    """Return what checks the joint positions that are wanted."""
    return lambda values: joint_vector(arm, values, "target")


def goal_reader(arm: SpaceArm, pose: bool) -> Callable[[Any], Array]:
    """Return the function that reads a goal as numbers, checked: (k,), or (12,) of a pose."""
    task = arm.task
    k = len(task.rows)

    def read(goal: Any) -> Array:
        is_pose = isinstance(goal, pin.SE3) or np.shape(goal) == (4, 4)
        if is_pose != pose:
            raise ConfigurationError(
                "target is a pose at one time and a point at another; give one kind only"
            )
        if pose:
            placed = sound_pose(goal, "target")
            return np.concatenate((placed.translation, placed.rotation.ravel()))
        if max(task.indices[:k]) > 2:
            raise ConfigurationError(f"target is {goal!r}; the task {task.names!r} takes a pin.SE3")
        meaning = f"[m], one for each row of the task {task.names!r}, or a pin.SE3"
        return finite(goal, (k,), "target", meaning)

    return read


def joints_of(arm: SpaceArm, tip: int) -> Array:
    """Return (n,) 1 for the joints that move a tip, else 0."""
    tree = structure_of(arm)
    return 1.0 * (np.abs(tree.reaches[tip] @ np.abs(tree.gains)) > 0.0)


def _pushed(todo: Preparation, i: int) -> Pushed:
    """Return what is pushed by wrench i."""
    arm = todo.system.arm
    link, wrench, own = todo.system.plant.pushed[i]
    source = None
    if callable(wrench):
        source = todo.over_time(f"wrench{i}", f"the wrench on {link!r}", wrench,
                                lambda values: plants.wrench_at(link, values, 0.0))  # fmt: skip
    return Pushed(_body(arm, arm.model.getFrameId(link, pin.BODY)), own, source)


def _value(
    system: System, value: Callable[[float, Configuration], float], t: float, y: Array
) -> Array:
    """Return the value of an event function that is called outside."""
    return np.array([value(t, system.configuration(y))])


def _array(values: Any) -> Any:
    """Return values as an array of numbers, or of symbols."""
    try:
        return np.asarray(values, dtype=float)
    except TypeError:
        return asarray(values)


def _plant_numbers(system: System, setup: Setup, bounds: list[float]) -> dict[str, Array]:
    """Return the numbers of a system by name; (n,) each of springs, friction and joint limits."""
    arm, hold = system.arm, system.hold
    frames = [arm.model.frames[arm.model.getFrameId(link, pin.BODY)].placement
              for link, *_ in system.plant.pushed]  # fmt: skip
    wrenches = [np.zeros(6) if callable(wrench) else plants.wrench_at(link, wrench, 0.0)
                for link, wrench, _ in system.plant.pushed]  # fmt: skip
    axes = [arm.model.frames[wheel.frame].placement.rotation @ wheel.axis for wheel in arm.wheels]
    known = {
        "base": system.start.base.translation,
        "axes": np.array(axes).reshape(-1, 3),
        "places": np.array([frame.translation for frame in frames]),
        "turns": np.array([frame.rotation for frame in frames]),
        "wrenches": np.array(wrenches),
        "bounds": np.array(bounds),
    }
    if setup.drag:
        known["drag"] = system.plant.friction_of_wheels.numbers
    if setup.passive:
        still = PassiveJoint(slip=1.0)
        passive = [system.passive.get(name, system.passive.get(f"q{j + 1}", still))
                   for j, name in enumerate(arm.joint_names)]  # fmt: skip
        names = ("stiffness", "relaxed", "damping", "friction", "slip")
        known |= zip(names, np.array(passive, dtype=float).T, strict=True)
    if setup.limits:
        described = [arm.tree.joints[name] for name in arm.joint_names]
        known["effort"] = np.array([joint.effort for joint in described])
        known["speed"] = np.array([joint.velocity for joint in described])
    if hold is not None:
        on_bus = np.where(np.array(setup.wheels) == 0, 1.0, 0.0)[:, None]
        count = len(arm.wheels)
        known |= {
            "spread": np.linalg.pinv((known["axes"] * on_bus).T),
            "torque": np.full(count, hold.torque),
            "capacity": np.full(count, hold.capacity),
            "hold": np.array([hold.stiffness, hold.damping]),
            "level": system.start.base.rotation,
        }
    return known
