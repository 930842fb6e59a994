"""Many joint curves at once: the turn of the spacecraft along each, and inverse kinematics.

At zero momentum the turn depends on the curve alone. With angular momentum h about the system CM,
which is constant in inertial axes, the spacecraft of attitude T turns with w_0 = D^-1 (T^T h - s -
D_q dq) in its own axes, by (33c). Here s is what its wheels hold.

Between its rows a plan is searched for along straight lines. The splines through the same rows that
`Tracking` flies turn the spacecraft by a little more or less, so that rows are bent until it
arrives as flown.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from scipy.interpolate import BSpline, PPoly
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array, Integers
from spacearm.equations.turns import GAUSS
from spacearm.errors import NoSolutionError
from spacearm.mechanics.floating import Reactions, chained, momenta, reactions, turns_of_spacecraft
from spacearm.mechanics.jacobian import solve_locked, turning_axes
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.planning.timing import corners, flown_spline, smooth

#: Largest joint motion of one step of Newton's method [rad] or [m].
STRIDE = 0.5

#: What the tip misses where Newton's method stops [m], [rad].
DONE = 1e-10

#: Cosine of the angle beyond which the sine of a rotation does not tell its axis.
OPPOSITE = -0.9

#: Drift of the spacecraft over which attitudes are iterated at once [rad]; iterations, at most;
#: change of a rotation matrix that counts as none.
PART, PICARD, SETTLED = 0.5, 50, 1e-14
#: Largest motion of a joint, and turn by the momentum, in one step of the integration [rad] or [m];
#: least number of all steps.
FINE, FEWEST = 0.0025, 3200
#: Error of a joint [rad] or [m] that the steps of an interval may leave, as its rate varies.
EVEN = 1e-12
#: Waves 1 - cos(2 pi k s) of each joint by which rows are bent, s the share of their way.
SHAPES = 2
#: Height of a wave by which the end is differentiated [rad] or [m].
BENT = 1e-4
#: Share of the steps that take part in these differences.
COARSE = 0.1
#: Error of the attitude at the end that counts as none [rad].
TURNED = 1e-9
#: Newton steps, at most.
STEPS = 8
#: Joints that come nearer to their limits are not bent [rad] or [m].
SLACK = 1e-3

#: Returns the attitudes (r, 3, 3) of the spacecraft at the ends (r, n) of some of the curves.
Turns: TypeAlias = Callable[[Array, Integers], Array]


def spacecraft_turns(arm: SpaceArm, Q: Array, rates: Array) -> Array:
    """Return the turns of the spacecraft (K, 3, 3) along curves, by the Magnus method of `move`.

    Args:
        arm: The arm.
        Q: (K, 2 g, n) positions at the Gauss points of g equal intervals.
        rates: (K, 2 g, n) derivatives there, the curve's parameter from 0 to 1.
    """
    K, points, n = Q.shape
    g = points // 2
    parts = turns_of_spacecraft(
        arm, Q.reshape(-1, 2, n), rates.reshape(-1, 2, n), np.full(K * g, 1.0 / g)
    ).reshape(K, g, 3, 3)
    T = parts[:, 0]
    for i in range(1, g):
        T = T @ parts[:, i]
    return T


def held_jacobian(at: Reactions) -> Array:
    """Return the Jacobians (m, 6, n) with the attitude held: J* without the turning by A dq."""
    swept = np.cross(at.r[:, None], np.swapaxes(at.A, 1, 2))
    return at.J + np.concatenate((np.swapaxes(swept, 1, 2), -at.A), axis=1)


def inverse_kinematics(
    arm: SpaceArm,
    q: Array,
    tip: pin.SE3,
    attitude: Array | Turns,
    axes: Array,
    steps: int,
    check_time: Callable[[], None] = lambda: None,
    limits: tuple[Array, Array] = (np.array(-np.inf), np.array(np.inf)),
    *,
    turning: bool = False,
) -> tuple[Array, Array, Array]:
    """Find joint positions that bring the tip to a pose, by damped Newton steps from first guesses.

    Args:
        arm: The arm.
        q: (K, n) first guesses.
        tip: The pose, from the system CM.
        attitude: (K, 3, 3) attitudes of the spacecraft, held; or a function that gives them for
            joint positions (r, n) and the numbers of their curves: then the spacecraft turns with
            each step by (33c).
        axes: (3, 3) the goal axes; see `goal_axes`.
        steps: Number of steps.
        check_time: Called at every step; it may raise an error to end the search.
        limits: (n,) least and (n,) largest joint positions, which no step passes.
        turning: Whether the attitudes are first guesses too: they turn about the axes about which
            the arm can turn its spacecraft.

    Returns:
        (K, n) joint positions; (K, 3, 3) attitudes; (K,) norm of what the tip misses in the task's
        rows [m], [rad].
    """
    reacts, turns = callable(attitude), list(turning_axes(arm)) if turning else []
    T = np.empty((len(q), 3, 3)) if callable(attitude) else attitude.copy()
    q, miss, rows = q.copy(), np.empty(len(q)), np.arange(len(q))
    for step in range(steps + 1):
        check_time()
        if callable(attitude):
            T[rows] = attitude(q[rows], rows)
        at = reactions(arm, q[rows])
        left = _left(arm, at, T[rows], tip, axes)
        miss[rows] = np.linalg.norm(left, axis=1)
        far = miss[rows] > DONE
        if step == steps or not far.any():
            break
        J = at.J if reacts else held_jacobian(at)
        if turning:
            J = np.concatenate((J, _turning_jacobian(at)[:, :, turns]), axis=2)
        J, rows = _in_rows(arm, J, T[rows], axes)[far], rows[far]
        change = _damped_step(J, left[far])
        q[rows] = np.clip(q[rows] + change[:, : arm.n], *limits)
        if turning:
            turn = np.zeros((len(rows), 3))
            turn[:, turns] = change[:, arm.n :]
            T[rows] = T[rows] @ rotations_of(turn)
    return q, T, miss


def _turning_jacobian(at: Reactions) -> Array:
    """Return the Jacobians (m, 6, 3) of turns of the spacecraft about its own axes."""
    about = np.tile(np.vstack((np.zeros((3, 3)), np.eye(3))), (len(at.r), 1, 1))
    about[:, :3] = np.swapaxes(np.cross(np.eye(3), at.r[:, None]), 1, 2)  # e_i x r
    return about


def _left(arm: SpaceArm, at: Reactions, T: Array, tip: pin.SE3, axes: Array) -> Array:
    """Return what the tip misses (m, k) in the task's rows along the goal axes."""
    goal, T = pin.SE3(axes.T, np.zeros(3)) * tip, axes.T @ T
    turn = rotation_vectors(goal.rotation @ np.swapaxes(T @ at.R, 1, 2))
    reached = (T @ at.r[:, :, None])[:, :, 0]
    return np.concatenate((goal.translation - reached, turn), axis=1)[:, arm.task.indices]


def rotation_vectors(R: Array) -> Array:
    """Return the rotation vectors (m, 3) of rotations (m, 3, 3)."""
    sines = 0.5 * (R[:, [2, 0, 1], [1, 2, 0]] - R[:, [1, 2, 0], [2, 0, 1]])
    sine, cosine = np.linalg.norm(sines, axis=1), 0.5 * (np.trace(R, axis1=1, axis2=2) - 1.0)
    vectors = sines / np.sinc(np.arctan2(sine, cosine) / np.pi)[:, None]
    if (far := cosine < OPPOSITE).any():
        vectors[far] = Rotation.from_matrix(R[far]).as_rotvec()
    return vectors


def _in_rows(arm: SpaceArm, J: Array, T: Array, axes: Array) -> Array:
    """Return the task's rows (m, k, p), along the goal axes, of Jacobians in spacecraft axes."""
    turned = (axes.T @ T)[:, None] @ J.reshape(len(J), 2, 3, -1)
    return turned.reshape(J.shape)[:, arm.task.indices]


def _damped_step(J: Array, left: Array) -> Array:
    """Return damped Newton steps (m, p), none of whose components is larger than `STRIDE`."""
    damping = 1e-3 + 0.1 * np.minimum(1.0, np.linalg.norm(left, axis=1))
    Jt = np.swapaxes(J, 1, 2)
    square = J @ Jt + (damping**2)[:, None, None] * np.eye(J.shape[1])
    step = (Jt @ np.linalg.solve(square, left[:, :, None]))[:, :, 0]
    return step * np.minimum(1.0, STRIDE / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]


def drifting_attitudes(
    arm: SpaceArm, T: Array, t: Array, Q: Array, h: Array, stored: Array
) -> Array:
    """Return the attitudes (p, m, 3, 3) of the spacecraft along p joint motions at once.

    Args:
        arm: The arm.
        T: (3, 3) attitude at the start.
        t: (m,) times of the rows [s].
        Q: (p, m, n) joint positions of the rows, between which they are linear in time.
        h: (3,) angular momentum about the system CM [N m s], inertial axes.
        stored: (3,) what wheels hold of it all the time [N m s], spacecraft axes.
    """
    halves = np.empty((len(Q), 2 * len(t) - 1, arm.n))
    halves[:, ::2], halves[:, 1::2] = Q, 0.5 * (Q[:, :-1] + Q[:, 1:])
    D, D_q = _matrices(arm, halves)
    rates = np.diff(Q, axis=1) / np.diff(t)[:, None]
    taken = stored + np.einsum("pmkij,pmj->pmki", _stages(D_q), rates)
    return _turned(T, t, _stages(D), taken, h)


def steered_attitudes(
    arm: SpaceArm, T: Array, t: Array, Q: Array, dQ: Array, h: Array, stored: Array
) -> Array:
    """Return the attitudes (p, m, 3, 3) along p smooth motions of joints and wheels.

    Args:
        arm: The arm.
        T: (3, 3) attitude at the start.
        t: (m,) times of the rows [s].
        Q: (p, 2 m - 1, n) joint positions at the rows and at the times half way between.
        dQ: (p, 2 m - 1, n) their rates there.
        h: (3,) angular momentum about the system CM [N m s], inertial axes.
        stored: (p, 2 m - 1, 3) what the wheels hold of it there [N m s], spacecraft axes.
    """
    D, D_q = _matrices(arm, Q)
    taken = stored + np.einsum("pmij,pmj->pmi", D_q, dQ)
    return _turned(T, t, _stages(D), _stages(taken), h)


@dataclass(frozen=True)
class FlownRows:
    """Rows that a floating arm passes along quintic splines, its wheels likewise.

    Attributes:
        start: Configuration at the first row, with the momentum and what the wheels hold of it.
        t: (m,) times [s].
        q: (m, n) joint positions.
        wheels: (m, w) what the wheels hold [N m s].
        final_rates: (n,) joint rates at the end [rad/s] or [m/s].
    """

    start: Configuration
    t: Array
    q: Array
    wheels: Array
    final_rates: Array

    def attitudes(self, parts: float = 1.0) -> Array:
        """Return the attitudes (m, 3, 3) of the spacecraft at the rows, by steps of fourth order.

        Args:
            parts: Into how many parts the steps of `FINE` and `FEWEST` are divided.
        """
        times, at_rows = self._times(parts)
        return self.attitudes_from(self.start.base.rotation, times)[at_rows]

    def attitudes_bent(self, bends: Array, parts: float) -> Array:
        """Return the same (p, m, 3, 3) of these rows bent by each of bends (m, p, n), all small."""
        times, at_rows = self._times(parts)
        at_rest = corners(np.diff(self.q, axis=0))
        bend = flown_spline(self.t, bends, np.zeros(self.start.arm.n), at_rest)
        return self._along(self.start.base.rotation, times, bend)[:, at_rows]

    def attitudes_from(self, T: Array, times: Array) -> Array:
        """Return the attitudes (k, 3, 3) at times (k,) by a step from each to the next, T first."""
        return self._along(T, times, lambda *_: np.zeros((1, self.start.arm.n)))[0]

    def _times(self, parts: float) -> tuple[Array, Integers]:
        """Return the times (k,) of the steps of `attitudes`, and which are those of the rows."""
        steps = self.steps(parts)
        at_rows = np.append(0, np.cumsum(steps))
        number = np.arange(at_rows[-1]) - np.repeat(at_rows[:-1], steps)
        begin = np.repeat(self.t[:-1], steps) + number * np.repeat(np.diff(self.t) / steps, steps)
        return np.append(begin, self.t[-1]), at_rows

    def _along(self, T: Array, times: Array, bend: Callable[..., Array]) -> Array:
        """Return `attitudes_from` (p, k, 3, 3), bent by (..., p, n) over time and its rate."""
        arm, h = self.start.arm, self.start.momentum[3:]
        begin, length = times[:-1], np.diff(times)

        def ways(at: Array) -> Iterator[tuple[Array, Array]]:
            bent = (self.spline(at, order)[..., None, :] + bend(at, order) for order in (0, 1))
            return zip(*(np.moveaxis(values, -2, 0) for values in bent), strict=True)

        if not h.any() and not self.wheels.any():
            nodes = begin[:, None] + GAUSS * length[:, None]
            turns = [turns_of_spacecraft(arm, Q, dQ, length) for Q, dQ in ways(nodes)]
            return np.array([T @ np.concatenate((np.eye(3)[None], chained(R))) for R in turns])
        halves = np.append(np.column_stack((begin, begin + 0.5 * length)).ravel(), times[-1])
        held = np.tile(self.start.base.rotation.T @ self.start.stored[3:], (len(halves), 1))
        if (spins := self.spins) is not None:
            held = spins(halves) @ self._axes.T
        found = (
            steered_attitudes(arm, T, times, Q[None], dQ[None], h, held[None])
            for Q, dQ in ways(halves)
        )
        return np.concatenate([*found])

    @property
    def turning(self) -> float:
        """What turns the spacecraft besides the joints at most, T^T h - s [N m s]."""
        stored, spins = self.start.stored[None, 3:], self.spins
        if spins is not None:
            stored = spins.c @ self._axes.T  # its control points
        h = float(np.linalg.norm(self.start.momentum[3:]))
        return h + float(np.linalg.norm(stored, axis=1).max())

    @cached_property
    def spline(self) -> PPoly:
        """Joint positions (n,) over time."""
        return flown_spline(self.t, self.q, self.final_rates)

    @cached_property
    def spins(self) -> BSpline | None:
        """What the wheels hold (w,) over time [N m s]; None where that does not change."""
        return smooth(self.t, self.wheels) if np.ptp(self.wheels, axis=0).any() else None

    @property
    def _axes(self) -> Array:
        return np.column_stack([wheel.axis for wheel in self.start.arm.wheels])

    def landed(self, wanted: Mapping[int, Array]) -> tuple[FlownRows, Array]:
        """Return rows bent a little, so that the spacecraft passes rows with stated attitudes.

        Joint positions at these rows and at both ends stay, so that tips pass there as they should,
        too. Newton's method on the heights of smooth waves between them; of all corrections the one
        of least squares.

        Args:
            wanted: (3, 3) attitudes by the numbers of their rows, the last row among them.

        Returns:
            The rows, and the attitudes (m, 3, 3) there.

        Raises:
            NoSolutionError: It does not converge.
        """
        arm, q, stops = self.start.arm, self.q, sorted(wanted)
        way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1)))
        waves = []
        for first, last in pairwise([0, *stops]):
            share = np.clip((way - way[first]) / max(way[last] - way[first], 1e-300), 0.0, 1.0)
            waves.append(1.0 - np.cos(2.0 * np.pi * share[:, None] * np.arange(1, SHAPES + 1)))
        room = np.minimum(q - arm.lower, arm.upper - q).min(axis=0)
        far = (room > SLACK) | (room < 0.0)
        bends = np.eye(arm.n)[far | ~far.any()]
        shapes = np.einsum("ms,jn->msjn", np.hstack(waves), bends).reshape(len(q), -1, arm.n)

        def left(T: Array) -> Array:
            return np.concatenate([pin.log3(wanted[i].T @ T[i]) for i in stops])

        rows, T = self, self.attitudes(2.0)
        if np.linalg.norm(miss := left(T)) <= TURNED:
            return rows, T
        still = np.zeros((len(q), 1, arm.n))
        begun, *bent = map(left, self.attitudes_bent(np.hstack((still, BENT * shapes)), COARSE))
        slope = np.column_stack([(end - begun) / BENT for end in bent])
        for _ in range(STEPS):
            height = np.linalg.lstsq(slope, miss, rcond=1e-6)[0]
            rows = replace(rows, q=rows.q - np.tensordot(shapes, height, axes=(1, 0)))
            T = rows.attitudes(2.0)
            if np.linalg.norm(miss := left(T)) <= TURNED:
                return rows, T
        off = np.linalg.norm(miss)
        raise NoSolutionError(f"flown as a spline through its rows the motion ends {off:.1e} off")

    def steps(self, parts: float) -> Integers:
        """Return the steps (m - 1,) of the integration from row to row.

        The rate of a quintic with the leading coefficient c is integrated over k steps of a time
        dt with an error of about c dt^5 / (36 k^4), by two Gauss points. This is much where joints
        start and stop between two rows.
        """
        dt = np.diff(self.t)
        uneven = np.abs(self.spline.c[0]).max(axis=1) * dt**5 / (36.0 * EVEN)
        spin = np.linalg.norm(solve_locked(self.start.A[3:, 3:6], self.start.momentum[3:]))
        turned = np.maximum(np.abs(np.diff(self.q, axis=0)).max(axis=1), spin * dt)
        least = np.maximum(turned / FINE, dt / self.t[-1] * FEWEST)
        return np.ceil(parts * np.maximum(least, uneven**0.25)).astype(int)


def _turned(T: Array, t: Array, D: Array, taken: Array, h: Array) -> Array:
    """Return the attitudes (p, m, 3, 3) of spacecraft with w_0 = D^-1 (T^T h - taken).

    Magnus' series to fourth order, by Simpson's rule in each step from row to row. It takes the
    attitudes themselves: Picard's iteration finds those of all steps of a part at once.

    Args:
        T: (3, 3) attitude at the start.
        t: (m,) times of the rows [s].
        D: (p, m - 1, 3, 3, 3) at the begin, in the middle and at the end of each step.
        taken: (p, m - 1, 3, 3) there, the momentum of joint motion and wheels [N m s].
        h: (3,) angular momentum about the system CM [N m s], inertial axes.
    """
    spins = solve_locked(D, np.eye(3)) * np.diff(t)[:, None, None, None]
    drift = np.cumsum(np.abs(spins @ h).max(axis=(0, 2, 3)))
    out = np.empty((len(D), len(t), 3, 3))
    out[:, 0] = T
    ends = np.flatnonzero(np.diff(drift // PART)) + 1
    for first, last in pairwise([0, *ends, len(drift)]):
        steps = slice(first, last)
        out[:, first : last + 1] = out[:, first, None]
        middle = out[:, steps].copy()
        for _ in range(PICARD):
            before = out[:, first + 1 : last + 1].copy()
            at = np.stack((out[:, steps], middle, before), axis=2)
            left = np.einsum("pmkij,i->pmkj", at, h) - taken[:, steps]
            w1, w2, w3 = np.moveaxis((spins[:, steps] @ left[..., None])[..., 0], 2, 0)
            half = (5.0 * w1 + 8.0 * w2 - w3) / 24.0 + np.cross(w1, w2) / 48.0
            whole = (w1 + 4.0 * w2 + w3) / 6.0 + np.cross(w1, w3) / 12.0
            out[:, first + 1 : last + 1] = out[:, first, None] @ chained(rotations_of(whole))
            middle = out[:, steps] @ rotations_of(half)
            if np.abs(out[:, first + 1 : last + 1] - before).max() < SETTLED:
                break
    return out


def _matrices(arm: SpaceArm, Q: Array) -> tuple[Array, Array]:
    """Return D (..., 3, 3) and D_q (..., 3, n) at joint positions (..., n)."""
    D, D_q = momenta(arm, Q.reshape(-1, arm.n))
    return D.reshape(*Q.shape[:-1], 3, 3), D_q.reshape(*Q.shape[:-1], 3, arm.n)


def _stages(x: Array) -> Array:
    """Return what is known at rows and between (p, 2 m - 1, ...) by steps (p, m - 1, 3, ...)."""
    return np.stack((x[:, :-1:2], x[:, 1::2], x[:, 2::2]), axis=2)


def rotations_of(w: Array) -> Array:
    """Return the rotations (..., 3, 3) of rotation vectors (..., 3)."""
    return Rotation.from_rotvec(w.reshape(-1, 3)).as_matrix().reshape(*w.shape, 3)
