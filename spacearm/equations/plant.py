"""The state of a simulated arm: its rate, the functions whose roots are events, what is reported.

The state y is one array. It holds positions q (n) and rates dq (n) of the joints, the spacecraft's
attitude as a quaternion xyzw of any length, and the system CM (3) [m]. Then follow the momentum
[linear; angular about the system CM] (6) in inertial axes, the work (4) of torques, passive
joints, wrenches and wheels [J], and what each wheel holds (w) [N m s].
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from spacearm.equations import laws as control
from spacearm.equations.dynamics import Loads, accelerations, twists
from spacearm.equations.kinematics import Parameters, Structure, posture, task_jacobian_at
from spacearm.equations.laws import Law, Pose, Source, State, attitude, called
from spacearm.equations.linear_algebra import determinant

#: Share of its largest rate from which the torque that drives a joint falls, to zero there.
SLOWING = 0.9
#: No momentum, and the attitude along the inertial axes.
STILL, LEVEL = np.zeros(3), np.array((0.0, 0.0, 0.0, 1.0))
#: Names and shapes of numbers that stand one after the other.
Shapes = tuple[tuple[str, tuple[int, ...]], ...]
#: Functions outside by name.
Calls = Mapping[str, Callable[..., Any]]


class Pushed(NamedTuple):
    """A frame that a wrench acts on.

    Attributes:
        body: The body that it is fixed to.
        own: Whether the wrench is along its own axes, else the inertial ones.
        source: Where the wrench comes from over time; None if it is always the same.
    """

    body: int
    own: bool
    source: Source | None = None


class Event(NamedTuple):
    """A function whose root is an event.

    Attributes:
        kind: "determinant" of the task Jacobian, its rows of length 1. "upper" or "lower" limit of
            a joint, "target" of a law, "wheel": each as far as it is away. "own": a function
            outside of (1 + states,) time and state, less its bound.
        of: Which joint, law or wheel.
    """

    kind: str
    of: int = 0


class Setup(NamedTuple):
    """What is known of a run while it is traced.

    Attributes:
        laws: The laws, whose torques add up.
        wheels: The body that carries each wheel.
        holds: Whether the wheels hold the attitude.
        sampled: Whether their law acts at control instants; their torques are then held, too.
        drag: Whether friction slows the wheels; its numbers are those of `wheel_friction`.
        motors: Where the torques of the wheels over time come from, else.
        pushed: What is pushed.
        passive: Whether joints have springs or friction.
        limits: Whether torques are cut to the largest, and fall near the largest rates.
        events: The event functions.
    """

    laws: tuple[Law, ...] = ()
    wheels: tuple[int, ...] = ()
    holds: bool = False
    sampled: bool = False
    drag: bool = False
    motors: Source | None = None
    pushed: tuple[Pushed, ...] = ()
    passive: bool = False
    limits: bool = False
    events: tuple[Event, ...] = ()

    def plant_shapes(self, n: int) -> Shapes:
        """Return the layout of the other numbers."""
        w, p = len(self.wheels), len(self.pushed)
        joint = ("stiffness", "relaxed", "damping", "friction", "slip")
        return (
            ("base", (3,)),
            *((name, (n,)) for name in (joint if self.passive else ())),
            *((name, (n,)) for name in (("effort", "speed") if self.limits else ())),
            ("axes", (w, 3)),
            *((("spread", (w, 3)), ("torque", (w,)), ("capacity", (w,)), ("hold", (2,)),
               ("level", (3, 3))) if self.holds else ()),
            *((("drag", (3,)),) if self.drag else ()),
            ("places", (p, 3)), ("turns", (p, 3, 3)), ("wrenches", (p, 6)),
            ("bounds", (len(self.events),)),
        )  # fmt: skip

    def called(self, n: int) -> tuple[tuple[str, int], ...]:
        """Return names of the functions outside, and how many numbers each gives."""
        counts = [(law.name(i), law.called(n)) for i, law in enumerate(self.laws)]
        sources = [("motors", self.motors, len(self.wheels))]
        sources += [(f"wrench{i}", pushed.source, 6) for i, pushed in enumerate(self.pushed)]
        counts += [(name, count) for name, source, count in sources if source == "outside"]
        counts += [(f"event{i}", 1) for i, event in enumerate(self.events) if event.kind == "own"]
        return tuple((name, count) for name, count in counts if count)


def size(shapes: Shapes) -> int:
    """Return how many numbers there are."""
    return sum(int(np.prod(shape)) for _, shape in shapes)


def taken(flat: Any, shapes: Shapes) -> dict[str, Any]:
    """Return the numbers of a flat array by name."""
    found, first = {}, 0
    for name, shape in shapes:
        last = first + int(np.prod(shape))
        found[name] = flat[first:last].reshape(shape) if shape else flat[first]
        first = last
    return found


class Parts(NamedTuple):
    """Where the parts of a state stand."""

    q: slice
    dq: slice
    attitude: slice
    com: slice
    momentum: slice
    works: slice
    wheels: slice


@lru_cache(maxsize=64)
def parts(n: int, wheels: int) -> Parts:
    """Return where the parts of the state of an arm with n joints and some wheels stand."""
    ends = np.cumsum((0, n, n, 4, 3, 6, 4, wheels))
    return Parts(*(slice(int(a), int(b)) for a, b in pairwise(ends)))


def moving(
    xp: Any, tree: Structure, p: Parameters, t: Any, y: Any, laws: Any, plant: Any, setup: Setup
) -> State:
    """Place the arm in a state; arguments as of `state_rate`."""
    n = tree.n
    where = parts(n, len(setup.wheels))
    given = taken(plant, setup.plant_shapes(n))
    own, first = [], 0
    for shapes in (law.numbers(n) for law in setup.laws):
        own.append(taken(laws[first : first + size(shapes)], shapes))
        first += size(shapes)
    at = posture(xp, tree, p, y[where.q])
    R = attitude(xp, y[where.attitude])
    fixed = tree.mode == "fixed"
    com = given["base"] + R @ at.r_cm if fixed else y[where.com]
    base = given["base"] if fixed else com - R @ at.r_cm
    tips = tuple(
        Pose(R @ at.tip_rotations[i], com + R @ at.tip_positions[i]) for i in range(len(tree.tips))
    )
    return State(
        tree, at, t, y, y[where.q], y[where.dq], Pose(R, base), com, tips, y[where.wheels],
        y[where.momentum], given, own,
    )  # fmt: skip


def torques(
    xp: Any, tree: Structure, p: Parameters, t: Any, y: Any, laws: Any, plant: Any, *,
    setup: Setup, memory: Any = None, **calls: Callable[..., Any],
) -> Any:  # fmt: skip
    """Compute the torques (n,) that the laws ask for; see `state_rate`.

    The next memory (M,) of the laws stands after the torques, one law after the other; `memory`
    (M,) is the one that they have.
    """
    return _asked(xp, moving(xp, tree, p, t, y, laws, plant, setup), setup, calls, memory)


def _asked(xp: Any, now: State, setup: Setup, calls: Calls, memory: Any = None) -> Any:
    """Compute the torques (n,) that the laws ask for, and their next memory; see `torques`."""
    n, first = now.tree.n, 0
    tau: Any = np.zeros(n)
    following: list[Any] = []
    for i, (law, numbers) in enumerate(zip(setup.laws, now.own, strict=True)):
        call = calls.get(law.name(i))
        if not law.memory:
            tau = tau + control.law_torques(xp, now, law, numbers, call)
            continue
        own = memory[first : first + law.memory]
        found = control.law_torques(xp, now, law, numbers, call, own)
        tau = tau + found[:n]
        following.append(found[n:])
        first += law.memory
    return xp.concatenate([tau, *following]) if following else tau


def cut_torques(xp: Any, tau: Any, dq: Any, effort: Any, speed: Any) -> Any:
    """Cut torques (n,) to what joints can give at their rates, of the largest of both."""
    tau = xp.minimum(xp.maximum(tau, -effort), effort)
    share = xp.absolute(dq) / speed
    rest = xp.maximum((1.0 - share) / (1.0 - SLOWING), 0.0)
    drives = xp.logical_and(share > SLOWING, tau * dq > 0.0)
    return tau * xp.where(drives, rest, 1.0)


def _given(xp: Any, now: State, setup: Setup, calls: Calls, held: Any) -> Any:
    """Compute the torques (n,) of the motors, those of the laws if none are held."""
    tau = _asked(xp, now, setup, calls) if held is None else held[: now.tree.n]
    if not setup.limits:
        return tau
    return cut_torques(xp, tau, now.dq, now.given["effort"], now.given["speed"])


def yielding(xp: Any, now: State, setup: Setup) -> Any:
    """Compute the torques (n,) of springs, damping and dry friction."""
    if not setup.passive:
        return np.zeros(now.tree.n)
    q, dq, given = now.q, now.dq, now.given
    spring = given["stiffness"] * (q - given["relaxed"])
    return -spring - given["damping"] * dq - given["friction"] * xp.tanh(dq / given["slip"])


def state_rate(
    xp: Any, tree: Structure, p: Parameters, t: Any, y: Any, laws: Any, plant: Any, *,
    setup: Setup, held: Any = None, **calls: Callable[..., Any],
) -> Any:  # fmt: skip
    """Compute the rate (states,) of a state; with NaN where there is none.

    Args:
        xp: The array library.
        tree: The structure of the arm, in the mode of the plant.
        p: Its numbers.
        t: Time [s].
        y: (states,) the state.
        laws: The numbers of the laws, one law after the other, as `Law.numbers` lays them out.
        plant: The other numbers, as `Setup.plant_shapes` does.
        setup: What else is known.
        held: (n,) torques of a controller of fixed rate, in place of those of the laws; then (w,)
            those of wheels that are sampled.
        calls: The functions outside.
    """
    now = moving(xp, tree, p, t, y, laws, plant, setup)
    R = now.base.rotation
    tau = _given(xp, now, setup, calls, held)
    give, dq = yielding(xp, now, setup), now.dq
    wheels = list(_wheels(now, setup))
    pushes = list(_pushes(xp, now, setup, calls))
    loads = _loads(xp, now, wheels, pushes)
    nu, _ = twists(xp, tree, now.at, dq, loads)
    spin = _motors(xp, now, setup, calls, nu, held)
    if spin:
        loads = _loads(xp, now, wheels, pushes, spin)
    ddq = accelerations(xp, tree, now.at, dq, tau + give, loads)
    turning = control.quaternion_rate(xp, y[parts(tree.n, 0).attitude], nu[0, 3:])
    drift = np.zeros(3) if tree.mode == "fixed" else now.momentum[:3] / now.at.M
    forces = sum((F for _, _, F, _ in pushes), np.zeros(3))
    moments = sum((N + xp.cross(r, F) for _, r, F, N in pushes), np.zeros(3))
    power = [(tau * dq).sum(), (give * dq).sum(), 0.0, 0.0]
    for body, r, F, N in pushes:
        v = R.T @ drift + nu[body, :3] + xp.cross(nu[body, 3:], r)
        power[2] = power[2] + F @ v + N @ nu[body, 3:]
    for i, (body, axis, _) in enumerate(wheels):
        power[3] = power[3] - spin[i] * (axis @ nu[body, 3:])
    return xp.concatenate([
        dq, ddq, turning, drift, R @ forces,
        R @ moments, xp.stack(power), *([xp.stack(spin)] if spin else []),
    ])  # fmt: skip


def loaded_accelerations(
    xp: Any, tree: Structure, p: Parameters, q: Any, dq: Any, tau: Any, placed: Any, *,
    setup: Setup, h: Any = STILL, spin: Any = (), wrenches: Any = (),
) -> Any:  # fmt: skip
    """Compute the joint accelerations (n,) of a state; vectors in spacecraft axes.

    Args:
        xp: The array library.
        tree: The structure of the arm.
        p: Its numbers.
        q: (n,) joint positions.
        dq: (n,) joint rates.
        tau: (n,) joint torques.
        placed: The numbers of the plant but for the wrenches, as `Setup.plant_shapes` lays them
            out.
        setup: The wheels and what is pushed.
        h: (3,) angular momentum about the system CM.
        spin: (w,) momentum that each wheel holds.
        wrenches: (k, 6) [force; torque].
    """
    n = tree.n
    y = xp.concatenate([q, dq, LEVEL, np.zeros(6), h, np.zeros(4), xp.asarray(spin)])
    plant = xp.concatenate([placed, *wrenches])
    rate = state_rate(xp, tree, p, 0.0, y, np.zeros(0), plant, setup=setup, held=tau)
    return rate[n : 2 * n]


def _wheels(now: State, setup: Setup) -> Iterator[tuple[int, Any, Any]]:
    """Return body, axis (3,) and momentum [N m s] of each wheel, spacecraft axes."""
    for i, body in enumerate(setup.wheels):
        axis = now.at.rotations[body] @ now.given["axes"][i]
        yield body, axis, now.wheels[i]


def _pushes(xp: Any, now: State, setup: Setup, calls: Calls) -> Iterator[tuple[int, Any, Any, Any]]:
    """Return body, point from the system CM, force and moment there (3,), spacecraft axes."""
    at = now.at
    for i, pushed in enumerate(setup.pushed):
        wrench = _over_time(xp, pushed.source, calls.get(f"wrench{i}"), now.t)
        if wrench is None:
            wrench = now.given["wrenches"][i]
        own = at.rotations[pushed.body]
        to = own @ now.given["turns"][i] if pushed.own else now.base.rotation.T
        r = at.origins[pushed.body] + own @ now.given["places"][i]
        yield pushed.body, r, to @ wrench[:3], to @ wrench[3:]


def _over_time(xp: Any, source: Source | None, call: Any, t: Any) -> Any:
    """Return the numbers of a source at a time; None if there is none."""
    if source is None:
        return None
    return xp.asarray(source(t)) if callable(source) else called(xp, call, xp.stack([t]))


def _loads(xp: Any, now: State, wheels: Any, pushes: Any, spin: Any = ()) -> Loads:
    """Return what wheels, their motors, and wrenches from outside do to the bodies."""
    at = now.at
    rest = [np.zeros(3)] * len(at.masses)
    held, forces, moments = [*rest], [*rest], [*rest]
    for body, axis, momentum in wheels:
        held[body] = held[body] + momentum * axis
    for (body, axis, _), rate in zip(wheels, spin, strict=False):
        moments[body] = moments[body] - rate * axis
    for body, r, force, moment in pushes:
        forces[body] = forces[body] + force
        moments[body] = moments[body] + moment + xp.cross(r - at.centres[body], force)
    wrenches = xp.concatenate([xp.stack(forces), xp.stack(moments)], axis=1)
    return Loads(now.base.rotation.T @ now.momentum[3:], xp.stack(held), wrenches)


def _motors(xp: Any, now: State, setup: Setup, calls: Calls, nu: Any, held: Any) -> list[Any]:
    """Compute the rate of what each wheel holds: torque of its motor and friction [N m].

    Wheels that hold turn the spacecraft by -K phi - C w_0, phi the rotation vector from its
    attitude at the start. A wheel that holds all that it can takes no more.
    """
    if setup.motors is not None:
        spin = [*_over_time(xp, setup.motors, calls.get("motors"), now.t)]
    elif not setup.holds:
        spin = [0.0] * len(setup.wheels)
    elif setup.sampled and held is not None:
        spin = [*_unless_full(xp, now, held[now.tree.n :])]
    else:
        spin = [*held_attitude(xp, now, nu[0, 3:])]
    if not setup.drag:
        return spin
    friction = wheel_friction(xp, now.wheels, now.given["drag"])
    return [one + friction[i] for i, one in enumerate(spin)]


def wheel_friction(xp: Any, momentum: Any, drag: Any) -> Any:
    """Compute the torques (w,) of friction on wheels [N m], which slow them.

    Args:
        xp: The array library.
        momentum: (w,) what each wheel holds [N m s].
        drag: (3,) rate of viscous friction [1/s], dry friction [N m], and the momentum below which
            dry friction falls [N m s].
    """
    return -(drag[0] * momentum + drag[1] * xp.tanh(momentum / drag[2]))


def held_attitude(xp: Any, now: State, spin: Any) -> Any:
    """Compute the torques (w,) of wheels that hold the attitude, w_0 (3,) being that of `spin`."""
    return _unless_full(xp, now, _restoring(xp, now, spin))


def _restoring(xp: Any, now: State, spin: Any) -> Any:
    """Compute the torques (w,) that the law of the wheels asks for, cut to the largest."""
    given, R = now.given, now.base.rotation
    phi = R.T @ control.rotation_vector(xp, given["level"], R)
    asked = given["spread"] @ (given["hold"][0] * phi + given["hold"][1] * spin)
    return xp.minimum(xp.maximum(asked, -given["torque"]), given["torque"])


def _unless_full(xp: Any, now: State, asked: Any) -> Any:
    """Compute the torques (w,) of wheels: a wheel that holds all that it can takes no more."""
    momentum = now.wheels
    full = xp.logical_and(xp.absolute(momentum) >= now.given["capacity"], asked * momentum > 0.0)
    return xp.where(full, 0.0, asked)


def wheel_torques(
    xp: Any, tree: Structure, p: Parameters, t: Any, y: Any, laws: Any, plant: Any, *,
    measured: Any, gyro: Any, setup: Setup, **_: Callable[..., Any],
) -> Any:  # fmt: skip
    """Compute the torques (w,) that the law of the wheels asks for at a control instant.

    Args:
        xp: The array library.
        tree: As in `state_rate`, like the arguments that are not described here.
        p: As there.
        t: As there.
        y: As there.
        laws: As there.
        plant: As there.
        measured: (states,) the state as it is measured, whose attitude counts.
        gyro: (3,) error of the measured angular velocity, spacecraft axes [rad/s].
        setup: As there.
    """
    now = moving(xp, tree, p, t, y, laws, plant, setup)
    nu, _ = twists(xp, tree, now.at, now.dq, _loads(xp, now, list(_wheels(now, setup)), []))
    seen = moving(xp, tree, p, t, measured, laws, plant, setup)
    return _restoring(xp, seen, nu[0, 3:] + gyro)


def event_values(
    xp: Any, tree: Structure, p: Parameters, t: Any, y: Any, laws: Any, plant: Any, *,
    setup: Setup, **calls: Callable[..., Any],
) -> Any:  # fmt: skip
    """Compute the event functions (e,); arguments as of `state_rate`."""
    now = moving(xp, tree, p, t, y, laws, plant, setup)
    found: list[Any] = []
    for i, (kind, index) in enumerate(setup.events):
        bound = now.given["bounds"][i]
        if kind == "determinant":
            J = task_jacobian_at(xp, tree, now.at)
            lengths = xp.sqrt((J * J).sum(axis=1))
            found.append(determinant(xp, J / xp.where(lengths > 0.0, lengths, 1.0)[:, None]))
        elif kind == "upper":
            found.append(bound - now.q[index])
        elif kind == "lower":
            found.append(now.q[index] - bound)
        elif kind == "wheel":
            found.append(bound - xp.absolute(now.wheels[index]))
        elif kind == "target":
            law = setup.laws[index]
            call = calls.get(law.name(index))
            found.append(control.law_miss(xp, now, law, now.own[index], call) - bound)
        else:
            seen = xp.concatenate([xp.stack([t]), y])
            found.append(called(xp, calls[f"event{i}"], seen)[0] - bound)
    return xp.stack(found)


class Observed(NamedTuple):
    """What is reported of a state; inertial axes.

    Attributes:
        torque: (n,) torques [N m].
        ddq: (n,) accelerations of the joints.
        spin: (w,) rates of what the wheels hold [N m].
        base: (7,) pose of the spacecraft: position and quaternion.
        momentum: (6,) [linear; angular about the system CM].
        brought: (6,) of it what the joints bring alone.
        energy: Kinetic energy [J].
    """

    torque: Any
    ddq: Any
    spin: Any
    base: Any
    momentum: Any
    brought: Any
    energy: Any


def observe(
    xp: Any, tree: Structure, p: Parameters, t: Any, y: Any, laws: Any, plant: Any, *,
    setup: Setup, held: Any = None, **calls: Callable[..., Any],
) -> Observed:  # fmt: skip
    """Compute what is reported of a state; arguments as of `state_rate`."""
    now = moving(xp, tree, p, t, y, laws, plant, setup)
    at, R = now.at, now.base.rotation
    tau = _given(xp, now, setup, calls, held)
    loads = _loads(xp, now, list(_wheels(now, setup)), [])
    nu, _ = twists(xp, tree, at, now.dq, loads)
    brought = at.P.T @ (tree.gains @ now.dq)
    w = nu[:, 3:]
    v = nu[:, :3] + xp.cross(w, at.centres)
    own, spins = at.masses * v, (at.inertias @ w[..., None])[..., 0]
    energy = 0.5 * ((own * v).sum() + (spins * w).sum())
    linear = R @ own.sum(axis=0)
    if tree.mode != "fixed":
        linear = now.momentum[:3]
        energy = energy + 0.5 * (linear @ linear) / at.M[0]
    angular = R @ (spins + xp.cross(at.centres, own) + loads.held).sum(axis=0)
    quaternion = y[parts(tree.n, 0).attitude]
    rate = state_rate(xp, tree, p, t, y, laws, plant, setup=setup, held=held, **calls)
    where = parts(tree.n, len(setup.wheels))
    unit = quaternion / xp.sqrt((quaternion * quaternion).sum())
    return Observed(
        torque=tau,
        ddq=rate[where.dq],
        spin=rate[where.wheels],
        base=xp.concatenate([now.base.translation, unit]),
        momentum=xp.concatenate([linear, angular]),
        brought=xp.concatenate([R @ brought[:3], R @ brought[3:]]),
        energy=energy,
    )


#: Most evaluations of a search for a root.
ROUNDS = 400


def crossing(xp: Any, value: Callable[[Any], Any], bracket: Any, sharpness: float) -> Any:
    """Compute where a function crosses zero, just beyond it, by Chandrupatla's method.

    Inverse quadratic interpolation where that is safe, else bisection: Chandrupatla, Adv. Eng.
    Softw. 28, 145 (1997), DOI 10.1016/S0965-9978(96)00051-8.

    Args:
        xp: The array library.
        value: The function.
        bracket: (4,) a place, one beyond it, and the values there: of different signs, or one 0.
        sharpness: Tolerance, as a share of the place.
    """
    a, b, at_a, at_b = bracket
    falls = xp.logical_or(at_a > 0.0, xp.logical_and(at_a >= 0.0, at_b < 0.0))
    side = xp.where(falls, 1.0, -1.0)

    def ahead(f: Any) -> Any:
        return xp.where(f * side > 0.0, 1.0, 0.0)

    def step(x1: Any, x2: Any, x3: Any, f1: Any, f2: Any, f3: Any, share: Any) -> Any:
        wide = xp.absolute(x2 - x1)
        tolerance = sharpness * xp.absolute(x1) / xp.maximum(wide, 1e-300)
        open_ = xp.logical_and(tolerance < 1.0, xp.absolute(f1) > 0.0)
        least = xp.minimum(0.5 * tolerance, 0.5)
        t = x1 + xp.minimum(xp.maximum(share, least), 1.0 - least) * (x2 - x1)
        at = value(t)
        same = xp.absolute(ahead(at) - ahead(f1)) < 0.5
        x1, x2, x3 = t, xp.where(same, x2, x1), xp.where(same, x1, x2)
        f1, f2, f3 = at, xp.where(same, f2, f1), xp.where(same, f1, f2)
        xi, phi = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
        curved = f1 / (f2 - f1) * f3 / (f2 - f3)
        curved = curved + (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
        safe = xp.logical_and(phi * phi < xi, (1.0 - phi) ** 2 < 1.0 - xi)
        safe = xp.logical_and(safe, xp.absolute(curved) < np.inf)
        return x1, x2, x3, f1, f2, f3, xp.where(safe, curved, 0.5), open_

    def guarded(*state: Any) -> Any:
        *found, open_ = step(*state)
        return *(xp.where(open_, new, old) for new, old in zip(found, state, strict=True)), open_

    straight = at_b / (at_b - at_a)
    share = xp.where(straight <= np.inf, straight, 0.5)
    x1, x2, _, f1, *_ = xp.while_any(guarded, b, a, a, at_b, at_a, at_a, share, most=ROUNDS)
    return xp.where(xp.absolute(f1) > 0.0, xp.maximum(x1, x2), x1)
