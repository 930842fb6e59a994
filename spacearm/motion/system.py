"""A system and its controllers as what the equations of a run take: a setup and its numbers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, finite
from spacearm.compiler import symbols
from spacearm.compiler.expressions import asarray
from spacearm.compiler.users import over_symbols
from spacearm.equations.laws import Law, Source, State
from spacearm.equations.plant import Event, Pushed, Setup, moving, parts
from spacearm.errors import ConfigurationError, UnsupportedError, unknown
from spacearm.mechanics.arm_kernels import parameters_of, structure_of
from spacearm.model.arguments import BaseMode, free_components
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.model.frames import sound_pose
from spacearm.model.joints import joint_name, joint_vector
from spacearm.motion import controllers as law_types
from spacearm.motion.controllers import Controller, JointPD, gains
from spacearm.motion.events import CLOSE, EVENTS, has_determinant
from spacearm.motion.goal import goal_normal
from spacearm.motion.plant import (
    Motors,
    PassiveJoint,
    Plant,
    WheelHold,
    Wrench,
    checked_wrench,
    described,
    wheel_torques,
    wrench_at,
)
from spacearm.motion.user_functions import (
    Example,
    TracedConfiguration,
    copied,
    not_traced,
    values_of,
)
from spacearm.singularities.report import NO_INVERSE

KINDS: dict[type, str] = {
    JointPD: "joints",
    law_types.TransposedJacobian: "transposed",
    law_types.ResolvedRate: "resolved",
    law_types.DampedLeastSquares: "damped",
    law_types.Reactionless: "reactionless",
}
"""The laws that are equations; laws derived from them are users' laws."""
EXAMPLES = 3
"""States or times at which a function that is traced is compared with its own values."""
Outside = Callable[[float, Array], Array]
"""A function called outside: of time and the state, which only laws and events get."""


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
                values = wrench_at(link, wrench, float(time))
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
    """

    root: Event | None
    bound: float = 0.0
    value: Callable[[float, Configuration], float] | None = None
    kind: str = ""
    detail: str = ""
    stops: bool = False

    @property
    def falling(self) -> bool:
        """Whether only a fall through zero counts."""
        return self.root is None or self.root.kind != "determinant"


class Prepared(NamedTuple):
    """What the equations of a run take.

    Attributes:
        setup: What is known while tracing.
        laws: The numbers of the laws.
        plant: The other numbers.
        outside: The functions outside, by the names of `Setup.called`.
        notes: What is called outside, and why.
    """

    setup: Setup
    laws: Array
    plant: Array
    outside: dict[str, Outside]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Traced:
    """A user's function as it is traced: equal to others that are made of the same.

    Attributes:
        values: What the function is made of, see `values_of`.
        traced: The same of arrays.
        function: The function, which lives as long.
    """

    values: tuple[Any, ...]
    traced: Callable[..., Any] = field(compare=False)
    function: Callable[..., Any] = field(compare=False)

    def __call__(self, *arguments: Any) -> Any:
        """Run it over arrays."""
        return self.traced(*arguments)


@dataclass(frozen=True)
class Check:
    """A check of a user's function, equal to others of what is made of the same.

    Attributes:
        values: What the function is made of, see `values_of`.
        used: The arm and the mode that it is used with, and as what.
        ask: Says why it cannot be traced.
        function: The function, which lives as long.
    """

    values: tuple[Any, ...]
    used: tuple[SpaceArm, BaseMode, str]
    ask: Callable[[], str] = field(compare=False)
    function: Callable[..., Any] = field(compare=False)


@lru_cache(maxsize=64)
def checked(check: Check) -> str:
    """Say why a user's function cannot be traced; once for all that are made of the same."""
    return check.ask()


class Preparation:
    """The functions of a system and its controllers, as they are sorted: traced or outside.

    Args:
        system: The system.
        trace: Whether users' functions are traced where that can be done.
    """

    def __init__(self, system: System, trace: bool = True) -> None:
        self.system, self.trace = system, trace
        self.outside: dict[str, Outside] = {}
        self.notes: list[str] = []

    def source(
        self, name: str, what: str, function: Callable[..., Any], traced: Callable[..., Any],
        examples: Callable[[], Iterator[Example]], outside: Outside,
        used: Callable[..., Any] | None = None,
    ) -> Source:  # fmt: skip
        """Return a user's function as a source, traced or called outside.

        Args:
            name: The name of the function outside.
            what: What it is, for the note.
            function: The function.
            traced: The same of arrays.
            examples: Gives arguments of that, and what the function itself gives.
            outside: What is called outside, checks included.
            used: The same as equations call it, if they do so otherwise.
        """
        values, used_with = values_of(function), (self.system.arm, self.system.mode, what)
        ask = partial(not_traced, function, traced, examples)
        why = checked(Check(values, used_with, ask, function)) if self.trace else "too many"
        if not why:
            return Source(Traced(values, used or traced, function))
        self.outside[name] = outside
        self.notes.append(f"{what} is called in Python: {why}")
        return Source()

    def over_time(
        self, name: str, what: str, function: Callable[[float], Any], read: Callable[[Any], Array]
    ) -> Source:
        """Return a user's function of time as a source; `read` checks what it gives."""

        def examples() -> Iterator[Example]:
            for t in np.random.default_rng(0).uniform(0.0, 100.0, EXAMPLES):
                value = function(float(t))
                read(value)
                yield (t,), value.homogeneous if isinstance(value, pin.SE3) else value

        seen = over_symbols(function)
        return self.source(
            name,
            what,
            function,
            lambda t: _array(seen(t)),
            examples,
            lambda t, _: read(function(t)),
        )

    def target(
        self, i: int, function: Callable[[float], Any], read: Callable[[Any], Array]
    ) -> Source:
        """Return the moving target of law i as a source."""
        return self.over_time(f"target{i}", "the target", function, read)


def prepared(
    system: System,
    controllers: Mapping[int, Controller],
    wanted: Sequence[WantedEvent] = (),
    *,
    trace: bool = True,
) -> Prepared:
    """Return a system and its controllers as what the equations take.

    Args:
        system: The system.
        controllers: The controllers by the number of the tip that they lead; -1 for one that acts
            on all joints.
        wanted: The events that are looked for.
        trace: Whether users' functions are traced where that can be done.
    """
    todo = Preparation(system, trace)
    events = [(event, event.root) for event in wanted if event.root is not None]
    motors, count = system.motors, len(system.arm.wheels)
    laws, numbers = [], []
    for i, (tip, controller) in enumerate(controllers.items()):
        law, values = _law(todo, i, tip, controller)
        laws.append(law)
        numbers += [np.ravel(values[name]) for name, _ in law.numbers(system.arm.n)]
    setup = Setup(
        laws=tuple(laws),
        wheels=tuple(_body(system.arm, wheel.frame) for wheel in system.arm.wheels),
        holds=system.hold is not None,
        motors=None if motors is None else todo.over_time(
            "motors", "the torque of the wheels", motors, lambda tau: wheel_torques(tau, count)
        ),
        pushed=tuple(_pushed(todo, i) for i in range(len(system.pushed))),
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
    flat = [np.ravel(given[name]) for name, _ in setup.plant_shapes(system.arm.n)]
    return Prepared(
        setup, np.concatenate([np.zeros(0), *numbers]), np.concatenate(flat), todo.outside,
        tuple(todo.notes),
    )  # fmt: skip


def wanted_events(
    system: System,
    kinds: Collection[str],
    stop: Collection[str],
    reach: float,
    controllers: Mapping[int, Any],
) -> list[WantedEvent]:
    """Return the events of some kinds.

    Args:
        system: The system.
        kinds: Names in `EVENTS`.
        stop: Those that end the run.
        reach: The distance at which a target counts as reached.
        controllers: The controllers by the number of their tip.

    Raises:
        ConfigurationError: A kind does not exist.
    """
    for kind in kinds:
        if kind not in EVENTS:
            raise ConfigurationError(unknown("event", kind, EVENTS))
    found: list[WantedEvent] = []
    arm = system.arm

    def add(
        kind: str, detail: str, root: Event | None, bound: float = 0.0, value: Any = None
    ) -> None:
        found.append(WantedEvent(root, bound, value, kind, detail, kind in stop))

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
        for i, (tip, law) in enumerate(controllers.items()):
            detail = f"error {reach:g}" + (f", {arm.tips[tip]}" if tip >= 0 else "")
            if type(law) in KINDS:
                add("target", detail, Event("target", i), reach)
            elif (error := getattr(law, "error", None)) is not None:

                def miss(t: float, cfg: Configuration, error: Any = error) -> float:
                    return float(np.linalg.norm(error(t, cfg)))

                add("target", detail, Event("own", i), reach, miss)
    if "wheel full" in kinds and system.hold is not None:
        for i, wheel in enumerate(arm.wheels):
            add("wheel full", wheel.name, Event("wheel", i), system.hold.capacity)
    return found


def start_state(system: System, dq: Array) -> Array:
    """Return the state at the start."""
    cfg, where = system.start, parts(system.arm.n, len(system.arm.wheels))
    y = np.zeros(where.wheels.stop)
    y[where.q], y[where.dq] = cfg.q, dq
    y[where.attitude] = pin.SE3ToXYZQUAT(cfg.base)[3:]
    y[where.com], y[where.momentum], y[where.wheels] = cfg.com, cfg.momentum, cfg.wheels
    return y


def coupled(system: System, setup: Setup) -> int:
    """Return how many leading components of the state its rate depends on.

    Without wrenches the momentum stays and the system CM moves evenly, whatever the arm does; the
    attitude counts where there is momentum, or a law that may look at it.
    """
    where, momentum = parts(system.arm.n, len(system.arm.wheels)), system.start.momentum
    if setup.wheels:
        return where.wheels.stop
    if setup.pushed:
        return where.momentum.stop
    if momentum[:3].any():
        return where.com.stop
    joints_only = all(law.kind == "joints" for law in setup.laws)
    return where.dq.stop if joints_only and not momentum.any() else where.attitude.stop


def _body(arm: SpaceArm, frame: int) -> int:
    """Return the number of the body that a frame is fixed to."""
    return int(arm.model.frames[frame].parentJoint) - 1


def _law(
    todo: Preparation, i: int, tip: int, controller: Controller
) -> tuple[Law, dict[str, npt.ArrayLike]]:
    """Return a controller as a law, with its numbers by name."""
    arm, n = todo.system.arm, todo.system.arm.n
    joints = tuple(joints_of(arm, tip)) if tip >= 0 and len(arm.tips) > 1 else None
    law = Law(KINDS.get(type(controller), "own"), tip=max(tip, 0), joints=joints)
    if law.kind == "own":
        return law._replace(source=_own_law(todo, i, controller)), {}
    if isinstance(controller, JointPD):
        numbers: dict[str, npt.ArrayLike] = {
            name: np.broadcast_to(gains(getattr(controller, name), n, name), n)
            for name in ("kp", "kd")
        }

        def positions(values: Any) -> Array:
            return joint_vector(arm, values, "target")

        if callable(controller.target):
            return law._replace(source=todo.target(i, controller.target, positions)), numbers
        return law, numbers | {"target": positions(controller.target)}
    assert isinstance(controller, law_types.TipLaw)
    return _tip_law(todo, i, controller, law)


def _tip_law(
    todo: Preparation, i: int, controller: law_types.TipLaw, law: Law
) -> tuple[Law, dict[str, npt.ArrayLike]]:
    """Return a law that leads a tip, with its numbers."""
    arm, task = todo.system.arm, todo.system.arm.task
    k = len(task.rows)
    numbers: dict[str, npt.ArrayLike] = {}
    first = controller.goal(0.0)
    pose = isinstance(first, pin.SE3) or np.shape(first) == (4, 4)
    law = law._replace(
        mode=controller.mode,
        rows=tuple(int(row) for row in task.indices[:k]),
        scale=tuple(float(scale) for scale in task.scale[:k, 0]),
        normal=goal_normal(arm),
        pose=pose,
        least=NO_INVERSE,
    )
    read = goal_reader(arm, pose)
    numbers["target"] = read(first)
    if callable(controller.target):
        law = law._replace(source=todo.target(i, controller.target, read))
    for name in ("kp", "kd", "gain"):
        if hasattr(controller, name):
            numbers[name] = np.broadcast_to(gains(getattr(controller, name), k, name), k)
    if isinstance(controller, law_types.TransposedJacobian):
        return law, numbers
    assert isinstance(controller, law_types.RateLaw)
    numbers["servo"] = controller.servo
    if isinstance(controller, law_types.DampedLeastSquares):
        numbers |= {"damping": controller.damping, "threshold": controller.threshold}
    if isinstance(controller, law_types.Reactionless):
        law = law._replace(rank=law_types.rank_of_turns(arm))
    if isinstance(controller, law_types.ResolvedRate) and controller.rest is not None:
        law, numbers["rest"] = law._replace(rests=True), joint_vector(arm, controller.rest, "rest")
    return law, numbers


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


def _own_law(todo: Preparation, i: int, controller: Controller) -> Source:
    """Return a user's law."""
    system = todo.system
    arm, n = system.arm, system.arm.n

    def torque(values: npt.ArrayLike) -> Array:
        return joint_vector(arm, values, "the controller's torque")

    def outside(t: float, y: Array) -> Array:
        return torque(controller(t, system.configuration(y), y[n : 2 * n].copy()))

    law = over_symbols(controller)

    def of_state(xp: Any, state: State) -> Any:
        cfg: Any = TracedConfiguration(arm, xp, state)
        return _array(law(state.t, cfg, copied(state.dq)))

    def traced(t: Any, y: Any) -> Any:
        return of_state(symbols, _placed(system, t, y))

    def examples() -> Iterator[Example]:
        rng = np.random.default_rng(0)
        for _ in range(EXAMPLES):
            y = start_state(system, rng.normal(size=n))
            y[:n] = rng.uniform(-1.0, 1.0, n)
            t = float(rng.uniform(0.0, 100.0))
            yield (t, y), outside(t, y)

    what = f"the controller {type(controller).__name__}"
    return todo.source(f"law{i}", what, controller, traced, examples, outside, of_state)


def _placed(system: System, t: Any, y: Any) -> State:
    """Return a state of symbols."""
    arm = system.arm
    setup = Setup(wheels=(0,) * len(arm.wheels))
    numbers = np.concatenate((system.start.base.translation, np.zeros(3 * len(arm.wheels))))
    tree, p = structure_of(arm, system.mode), parameters_of(arm)
    return moving(symbols, tree, p, t, y, np.zeros(0), numbers, setup)


def _pushed(todo: Preparation, i: int) -> Pushed:
    """Return what is pushed by wrench i."""
    arm = todo.system.arm
    link, wrench, own = todo.system.pushed[i]
    source = None
    if callable(wrench):
        source = todo.over_time(f"wrench{i}", f"the wrench on {link!r}", wrench,
                                lambda values: checked_wrench(link, values))  # fmt: skip
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
    still = PassiveJoint(slip=1.0)
    passive = [system.passive.get(name, system.passive.get(f"q{j + 1}", still))
               for j, name in enumerate(arm.joint_names)]  # fmt: skip
    names = ("stiffness", "relaxed", "damping", "friction", "slip")
    described = [arm.tree.joints[name] for name in arm.joint_names]
    frames = [arm.model.frames[arm.model.getFrameId(link, pin.BODY)].placement
              for link, *_ in system.pushed]  # fmt: skip
    wrenches = [np.zeros(6) if callable(wrench) else checked_wrench(link, wrench)
                for link, wrench, _ in system.pushed]  # fmt: skip
    axes = [arm.model.frames[wheel.frame].placement.rotation @ wheel.axis for wheel in arm.wheels]
    known = {
        "base": system.start.base.translation,
        "axes": np.array(axes).reshape(-1, 3),
        "places": np.array([frame.translation for frame in frames]),
        "turns": np.array([frame.rotation for frame in frames]),
        "wrenches": np.array(wrenches),
        "bounds": np.array(bounds),
        "effort": np.array([joint.effort for joint in described]),
        "speed": np.array([joint.velocity for joint in described]),
        **dict(zip(names, np.array(passive, dtype=float).T, strict=True)),
    }
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
