"""The control laws: torques from time, configuration and joint rates.

What they are for, and where they are from, stands with the controllers in `motion.controllers`,
which call the same functions with numbers. Joint rates follow from the bidiagonal form
J^T = L B R^T of `singular_values`: no J J^T is formed, so that rates near a singularity keep their
digits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np

from spacearm.equations import linear_algebra
from spacearm.equations.dynamics import inverse_dynamics
from spacearm.equations.kinematics import Mode, Posture, Structure, jacobian_at
from spacearm.equations.linear_algebra import reflected, unreflected
from spacearm.equations.turns import cross_matrix

#: Cosine of the tilt below which the smallest rotation to upright is not unique.
UPSIDE_DOWN = 1e-9 - 1.0


class Pose(NamedTuple):
    """A pose in the inertial frame.

    Attributes:
        rotation: (3, 3) attitude.
        translation: (3,) position [m].
    """

    rotation: Any
    translation: Any


def attitude(xp: Any, quaternion: Any) -> Any:
    """Compute the rotation (3, 3) of a quaternion xyzw (4,) of any length, equation (27)."""
    X, n = cross_matrix(xp, quaternion[:3]), quaternion[3]
    return np.eye(3) + 2.0 / (quaternion * quaternion).sum() * (n * X + X @ X)


def quaternion_rate(xp: Any, quaternion: Any, w: Any) -> Any:
    """Compute the rate (4,) of a quaternion xyzw under w (3,) in its own axes, equation (36)."""
    e, n = quaternion[:3], quaternion[3]
    return 0.5 * xp.concatenate([n * w + xp.cross(e, w), xp.stack([-(e @ w)])])


def goal_axes(xp: Any, R: Any, normal: int | None) -> Any:
    """Compute the axes (3, 3) along which goals are given, columns in inertial axes.

    Args:
        xp: The array library.
        R: (3, 3) attitude of the spacecraft.
        normal: Axis (0, 1, 2) that tilts with the spacecraft; None if the axes are inertial.
    """
    if normal is None:
        return np.eye(3)
    sign = xp.where(R[normal, normal] < UPSIDE_DOWN, -1.0, 1.0)
    to = R[:, normal]
    v = xp.cross(sign * np.eye(3)[normal], to)
    cosine = sign * to[normal]
    ahead = cosine > 0.0
    rest = xp.where(ahead, 1.0 + cosine, (v * v).sum() / xp.where(ahead, 1.0, 1.0 - cosine))
    X = cross_matrix(xp, v)
    T = np.eye(3) + X + X @ X / rest
    stays = 1.0 * (np.arange(3) == (normal + 1) % 3)
    return T * (stays + sign * (1.0 - stays))


def rotation_vector(xp: Any, start: Any, end: Any) -> Any:
    """Compute the rotation vector (3,) from one attitude (3, 3) to another, inertial axes [rad].

    The quaternion of end start^T follows from the largest of its four numbers: Shepperd, J. Guid.
    Control 1(3), 223-224 (1978), DOI 10.2514/3.55767b.
    """
    T = end @ start.T
    trace, S = T[0, 0] + T[1, 1] + T[2, 2], T + T.T
    v = xp.stack([T[2, 1] - T[1, 2], T[0, 2] - T[2, 0], T[1, 0] - T[0, 1]])
    found = xp.concatenate([xp.stack([1.0 + trace]), v])
    most = trace
    for i in range(3):
        larger = T[i, i] > most
        along = S[i] + (1.0 - trace) * np.eye(3)[i]
        found = xp.where(larger, xp.concatenate([v[i : i + 1], along]), found)
        most = xp.where(larger, T[i, i], most)
    n, e = found[0], found[1:]
    length = xp.sqrt((e * e).sum())
    angle = xp.where(n < 0.0, -2.0, 2.0) * xp.arctan2(length, xp.absolute(n))
    return e * (angle * linear_algebra.reciprocal(xp, length))


def goal_step(xp: Any, A: Any, rows: tuple[int, ...], start: Any, end: Any) -> Any:
    """Compute the rows (k,) of the twist that leads to a goal in unit time [m], [rad].

    Args:
        xp: The array library.
        A: (3, 3) the goal axes.
        rows: The task's rows of a twist [linear; angular].
        start: The tip, or another goal.
        end: A `Pose`, or a point (k,) along the goal axes for linear rows only [m].
    """
    if isinstance(end, Pose):
        turn = rotation_vector(xp, start.rotation, end.rotation)
        whole = [A.T @ (end.translation - start.translation), A.T @ turn]
        return xp.concatenate(whole)[np.array(rows)]
    return end - ((A.T @ start.translation)[np.array(rows)] if isinstance(start, Pose) else start)


#: Half the time over which the velocity of a moving target is taken [s].
INSTANT = 1e-6


#: Where numbers over time come from: a function that is traced, of time, or of a user's law of the
#: array library and the `State`; "outside" where it is called as the machine code runs.
Source = Callable[..., Any] | Literal["outside"]


class Law(NamedTuple):
    """What is known of a law while it is traced.

    Attributes:
        kind: "joints", "transposed", "resolved", "damped", "reactionless", or "own" for a user's.
        source: Of a user's law where its torques come from, else where a moving target does; None
            if the target stays.
        tip: The tip that it leads.
        joints: (n,) share of its torques that each joint takes; None for all.
        mode: What the law takes the spacecraft to do.
        rows: (k,) rows of a twist [linear; angular] that it leads.
        scale: (k,) their factors.
        normal: As in `goal_axes`.
        pose: Whether the target is a pose, else a point.
        rests: Whether a redundant arm tends to its posture of rest.
        rank: Number of directions that the spacecraft can be turned in.
        least: Share of the largest singular value below which J* has no inverse.
        memory: How many numbers it remembers from one control instant to the next. A source of such
            a law takes them too, and gives the next ones after the torques.
    """

    kind: str
    source: Source | None = None
    tip: int = 0
    joints: tuple[float, ...] | None = None
    mode: Mode = "free-floating"
    rows: tuple[int, ...] = ()
    scale: tuple[float, ...] = ()
    normal: int | None = None
    pose: bool = False
    rests: bool = False
    rank: int = 0
    least: float = 0.0
    memory: int = 0

    def numbers(self, n: int) -> tuple[tuple[str, tuple[int, ...]], ...]:
        """Return names and shapes of its numbers, for an arm of n joints."""
        k = (len(self.rows),)
        if self.kind == "own":
            return ()
        if self.kind == "joints":
            fixed = () if self.source else (("target", (n,)),)
            integral = (("ki", (n,)), ("limit", (n,))) if self.memory else ()
            return (("kp", (n,)), ("kd", (n,)), *integral, *fixed)
        fixed = () if self.source else (("target", (12,) if self.pose else k),)
        if self.kind == "transposed":
            return (("kp", k), ("kd", k), *fixed)
        common = (("gain", k), ("servo", ()), *fixed)
        if self.kind == "resolved":
            return (*common, ("rest", (n,))) if self.rests else common
        return (*common, ("damping", ()), ("threshold", ()))

    def name(self, i: int) -> str:
        """Return the name of its function outside, if it is law i."""
        return f"law{i}" if self.kind == "own" else f"target{i}"

    def called(self, n: int) -> int:
        """Return how many numbers its function outside gives; 0 if it has none."""
        if self.source != "outside":
            return 0
        if self.kind == "own":
            return n + self.memory
        if self.kind == "joints":
            return n
        return 12 if self.pose else len(self.rows)


class State(NamedTuple):
    """A state of a plant, with all that laws see of it.

    Attributes:
        tree: The structure of the arm.
        at: The posture.
        t: Time [s].
        y: The state.
        q: (n,) joint positions.
        dq: (n,) joint rates.
        base: The spacecraft.
        com: (3,) the system CM [m].
        tips: The tips.
        wheels: (w,) what each wheel holds [N m s].
        momentum: (6,) of the whole.
        given: The numbers of the plant by name.
        own: The numbers of each law by name.
    """

    tree: Structure
    at: Posture
    t: Any
    y: Any
    q: Any
    dq: Any
    base: Pose
    com: Any
    tips: tuple[Pose, ...]
    wheels: Any
    momentum: Any
    given: dict[str, Any]
    own: list[dict[str, Any]]


def law_torques(
    xp: Any, state: State, law: Law, numbers: Mapping[str, Any], call: Callable[..., Any] | None,
    memory: Any = None,
) -> Any:  # fmt: skip
    """Compute the torques (n,) of a law; NaN where it gives none.

    What a law with a memory remembers next (m,) stands after its torques.

    Args:
        xp: The array library.
        state: The state.
        law: The law.
        numbers: Its numbers, by the names of `Law.numbers`.
        call: Its function outside, if it has one: of (1 + states,) time and state of a user's law,
            of (1,) time of a target.
        memory: (m,) what it remembers, if it has a memory.
    """
    remembered = [memory] if law.memory else []
    if law.kind == "own":
        if callable(law.source):
            tau = xp.asarray(law.source(xp, state, *remembered))
        else:
            tau = called(xp, call, xp.concatenate([xp.stack([state.t]), state.y, *remembered]))
    elif law.kind == "joints":
        error = _target(xp, law, numbers, call, state.t) - state.q
        tau = joint_pd(numbers["kp"], numbers["kd"], error, state.dq)
        if law.memory:
            gains = numbers["ki"], numbers["limit"]
            tau = xp.concatenate(joint_integral(xp, *gains, tau, error, state.t, memory))
    else:
        J = law_jacobian(xp, state, law)
        error, feed = law_errors(xp, state, law, numbers, call)
        if law.kind == "transposed":
            tau = transposed(J, numbers["kp"], numbers["kd"], error, feed, state.dq)
        else:
            rates = _rates(xp, state, law, numbers, J, feed + numbers["gain"] * error)
            tree, wanted = replace(state.tree, mode=law.mode), numbers["servo"] * (rates - state.dq)
            tau = inverse_dynamics(xp, tree, state.at, state.dq, wanted)
    if law.joints is None:
        return tau
    return np.append(law.joints, np.ones(law.memory)) * tau


def _rates(xp: Any, state: State, law: Law, numbers: Mapping[str, Any], J: Any, wanted: Any) -> Any:
    """Compute the joint rates (n,) that a law asks for, so that the tip moves as is wanted (k,)."""
    if law.kind == "resolved":
        rest = numbers["rest"] - state.q if law.rests else None
        gain = numbers["gain"].sum() / len(law.rows)
        return resolved_rates(xp, J, wanted, law.least, rest, gain)
    scale, damping = np.array(law.scale), (numbers["damping"], numbers["threshold"])
    J, wanted = scale[:, None] * J, scale * wanted
    if law.kind == "damped":
        return damped_rates(xp, J, wanted, *damping)
    D_q = state.at.P[:, 3:].T @ state.tree.gains
    return reactionless_rates(xp, J, D_q, law.rank, law.least, wanted, *damping)


def joint_pd(kp: Any, kd: Any, error: Any, dq: Any) -> Any:
    """Compute K_p (q_des - q) - K_d dq."""
    return kp * error - kd * dq


def joint_integral(
    xp: Any, ki: Any, limit: Any, tau: Any, error: Any, t: Any, memory: Any
) -> tuple[Any, Any]:
    """Add an integral term to torques (n,) and cut the sum to the limits.

    The integral is a sum over the control instants: of the error, times the time since the instant
    before. It stops where a larger one would lead farther beyond the limit (conditional
    integration): Åström & Hägglund, Advanced PID Control (2006), section 3.5.

    Args:
        xp: The array library.
        ki: (n,) gains of the integral.
        limit: (n,) largest torques.
        tau: (n,) torques without it.
        error: (n,) target minus what is there.
        t: The time [s].
        memory: (n + 1,) the integral, and the time of the instant before.

    Returns:
        The torques (n,), and what the memory is next (n + 1,).
    """
    before, last = memory[:-1], memory[-1]
    integral = before + (t - last) * error
    asked = tau + ki * integral
    beyond = xp.logical_and(xp.absolute(asked) > limit, ki * error * asked > 0.0)
    integral = xp.where(beyond, before, integral)
    asked = tau + ki * integral
    cut = xp.where(asked > limit, limit, xp.where(asked < -limit, -limit, asked))
    return cut, xp.concatenate([integral, xp.stack([t])])


def transposed(J: Any, kp: Any, kd: Any, error: Any, feed: Any, dq: Any) -> Any:
    """Compute J*^T (K_p (x_des - x) + K_d (xdot_des - J* dq)), equation (42)."""
    return J.T @ (kp * error + kd * (feed - J @ dq))


def law_jacobian(xp: Any, state: State, law: Law) -> Any:
    """Compute the task's rows (k, n) of J* along the goal axes, unscaled."""
    J = jacobian_at(xp, replace(state.tree, mode=law.mode), state.at)[6 * law.tip : 6 * law.tip + 6]
    A = state.base.rotation.T @ goal_axes(xp, state.base.rotation, law.normal)
    return xp.concatenate([A.T @ J[:3], A.T @ J[3:]])[np.array(law.rows)]


def law_errors(
    xp: Any, state: State, law: Law, numbers: Mapping[str, Any], call: Any
) -> tuple[Any, Any]:
    """Compute target minus tip (k,) in the task's rows, and the velocity of the target (k,)."""
    A = goal_axes(xp, state.base.rotation, law.normal)
    goal = _target(xp, law, numbers, call, state.t)
    error = goal_step(xp, A, law.rows, state.tips[law.tip], goal)
    if law.source is None:
        return error, np.zeros(len(law.rows))
    before, after = (_target(xp, law, numbers, call, state.t + s) for s in (-INSTANT, INSTANT))
    return error, goal_step(xp, A, law.rows, before, after) / (2.0 * INSTANT)


def law_miss(xp: Any, state: State, law: Law, numbers: Mapping[str, Any], call: Any) -> Any:
    """Compute how far the target is: the norm of the error of a law."""
    if law.kind == "joints":
        error = _target(xp, law, numbers, call, state.t) - state.q
    else:
        error, _ = law_errors(xp, state, law, numbers, call)
    return xp.sqrt((error * error).sum())


def _target(xp: Any, law: Law, numbers: Mapping[str, Any], call: Any, t: Any) -> Any:
    """Return the target of a law at a time: joint positions (n,), a point (k,) or a `Pose`."""
    if law.source is None:
        values = numbers["target"]
    elif callable(law.source):
        values = xp.asarray(law.source(t))
        if law.pose:
            return Pose(values[:3, :3], values[:3, 3])
    else:
        values = called(xp, call, xp.stack([t]))
    return Pose(values[3:].reshape(3, 3), values[:3]) if law.pose else values


def called(xp: Any, call: Any, values: Any) -> Any:
    """Return what a function outside gives; NaN where it fails."""
    found = call(values)
    return xp.where(xp.absolute(found[0]) > 0.5, np.nan, found[1:])


def resolved_rates(
    xp: Any, J: Any, wanted: Any, least: float, rest: Any = None, gain: Any = 0.0
) -> Any:
    """Compute J^+ xdot + gain (1 - J^+ J) rest (n,); NaN where J has no right inverse.

    Args:
        xp: The array library.
        J: (k, n) the Jacobian.
        wanted: (k,) xdot.
        least: Share of the largest singular value up to which the least one is zero.
        rest: (n,) rates wanted in the null space; None for none.
        gain: Their factor.
    """
    k, n = J.shape
    if k > n:
        return np.full(n, np.nan)
    form = linear_algebra.bidiagonal(xp, J)
    within = np.zeros(n - k) if rest is None else gain * reflected(xp, form.left, rest)[k:]
    regular = form.least(xp) > least * least * form.largest(xp)
    return xp.where(regular, form.solution(xp, wanted, within), np.nan)


def damped_rates(xp: Any, J: Any, wanted: Any, damping: Any, threshold: Any) -> Any:
    """Compute J^T (J J^T + lambda^2 1)^-1 xdot (n,).

    Args:
        xp: The array library.
        J: (k, n) the Jacobian, its rows scaled.
        wanted: (k,) xdot, scaled likewise.
        damping: Largest lambda.
        threshold: sigma_min below which there is damping:
            lambda^2 = damping^2 (1 - (sigma_min / threshold)^2).
    """
    k, n = J.shape
    form = linear_algebra.bidiagonal(xp, J if k <= n else J.T)
    q, e = form.q, form.e
    nearness = xp.minimum(xp.sqrt(form.least(xp)) / threshold, 1.0)
    square = damping * damping * (1.0 - nearness * nearness)
    if k > n:  # (J^T J + lambda^2 1)^-1 J^T xdot
        seen = reflected(xp, form.left, wanted)[:n]
        ends = [q[0] * seen[0], *(q[i] * seen[i] + e[i - 1] * seen[i - 1] for i in range(1, n))]
        return unreflected(xp, form.right, _damped(xp, q, e, xp.stack(ends), square))
    z = _damped(xp, q, e, reflected(xp, form.right, wanted), square)
    y = [*(q[i] * z[i] + e[i] * z[i + 1] for i in range(k - 1)), q[k - 1] * z[k - 1]]
    return unreflected(xp, form.left, xp.concatenate([xp.stack(y), np.zeros(n - k)]))


def reactionless_rates(
    xp: Any, J: Any, D_q: Any, rank: int, least: float, wanted: Any, damping: Any, threshold: Any
) -> Any:
    """Compute the damped rates (n,) among those with D_q dq = 0; NaN if there are none.

    Args:
        xp: The array library.
        J: (k, n) the Jacobian, its rows scaled.
        D_q: (3, n) angular momentum per joint rate.
        rank: Its rank.
        least: Share of the longest row up to which what the others leave of a row is zero.
        wanted: As in `damped_rates`, as the others.
        damping: Largest lambda.
        threshold: sigma_min of J N below which there is damping, N a basis of the null space.
    """
    n = D_q.shape[1]
    if rank >= n:
        return np.full(n, np.nan)
    rows, reflections, longest = D_q, [], None
    for i in range(rank):
        sizes = (rows[:, i:] * rows[:, i:]).sum(axis=1)
        row, size = rows[0, i:], sizes[0]
        for other in (1, 2):
            longer = sizes[other] > size
            row = xp.where(longer, rows[other, i:], row)
            size = xp.where(longer, sizes[other], size)
        longest = size if longest is None else longest
        reflections.append(
            linear_algebra.reflector(xp, xp.where(size > least * least * longest, row, 0.0))[1]
        )
        rows = reflections[-1].of(xp, rows.T).T
    J_N = reflected(xp, reflections, J.T)[rank:].T
    rates = damped_rates(xp, J_N, wanted, damping, threshold)
    return unreflected(xp, reflections, xp.concatenate([np.zeros(rank), rates]))


def _damped(xp: Any, q: Any, e: Any, x: Any, square: Any) -> Any:
    """Compute (B^T B + lambda^2 1)^-1 x by the stationary qd transform, without subtractions."""
    k = len(q)
    rest, d, factors = square, [q[0] * q[0] + square], []
    z = [x[0]]
    for i in range(k - 1):
        inverse = linear_algebra.reciprocal(xp, d[i])
        factors.append(q[i] * e[i] * inverse)
        rest = e[i] * e[i] * rest * inverse + square
        d.append(q[i + 1] * q[i + 1] + rest)
        z.append(x[i + 1] - factors[i] * z[i])
    found = [z[k - 1] * linear_algebra.reciprocal(xp, d[k - 1])]
    for i in range(k - 2, -1, -1):
        found = [z[i] * linear_algebra.reciprocal(xp, d[i]) - factors[i] * found[0], *found]
    return xp.stack(found)
