"""The shortest joint curve that arrives: trajectory optimisation with the attitude as state.

Unknown is a curve of `curve`; the end of the tip, and of the spacecraft where asked, are equality
constraints, clearance from singularities and joint limits inequalities. All gradients are exact.
The optimiser is scipy's SLSQP (Kraft, DFVLR-FB 88-28 (1988)), from many starts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.mechanics.floating import walk
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.motion.goal import goal_axes, twist_between
from spacearm.planning.curve import CurveFamily, Samples, sample
from spacearm.planning.many_curves import turning_axes

INTERVALS = 16
"""Steps of the integration along a curve; exact enough to steer by, not to arrive by."""
MARGIN = 1.2
"""How much more than the clearance asked for is aimed at, for what lies between the samples."""
ITERATIONS = 60
INSET = 1e-3
"""How far from the joint limits a curve is held, for what lies between the samples [rad], [m]."""
CLOSE = 1e-4
"""How near the end must come before it is made exact by `arrive`."""
ARRIVED = 1e-8
"""How near the end of a plan is: norm of what is left [m], [rad]."""
LANDINGS = 6
LONGEST = 200.0
"""Curves that grow longer on the way to their end are given up [rad] or [m]."""
SPACING = 0.02
"""Joint motion between the rows of a plan [rad] or [m]."""


class Task(NamedTuple):
    """What a joint motion must achieve.

    Attributes:
        tip: Where the tip shall be at the end, if it matters.
        q: (n,) where the joints shall be at the end, if it matters.
        attitude: (3, 3) the spacecraft's at the end, if it matters.
        clearance: Least sigma_min of the task Jacobian on the way.
        lower: (n,) least joint positions.
        upper: (n,) largest.
    """

    tip: pin.SE3 | None
    q: Array | None
    attitude: Array | None
    clearance: float
    lower: Array
    upper: Array


class _Values(NamedTuple):
    """Residuals and their derivatives with respect to p, flattened."""

    end: Array
    d_end: Array
    room: Array
    d_room: Array


class Steering:
    """The constraints on motions from one configuration: closed loops first, then a curve.

    The unknowns x are those of the curve, (waves + 1, n), and those of the loop, (waves, n), one
    after the other. The loop is run through `loops` times: its holonomy L turns the spacecraft by
    L^loops.

    Args:
        start: Where the motion begins.
        task: What it must achieve.
        waves: Number of sines of curve and loop.
        loops: How many times the loop is run through; 0 for none.
    """

    def __init__(self, start: Configuration, task: Task, waves: int, loops: int = 0) -> None:
        self.start, self.task, self.waves, self.loops = start, task, waves, loops
        self.arm: SpaceArm = start.arm
        self.family = CurveFamily(self.arm, start.q, waves, INTERVALS)
        J = self._task_jacobians(sample(self.arm, start.q[None]))[0]
        self.sense = math.copysign(1.0, np.linalg.det(J[0])) if self._square else 1.0
        self._turns = list(turning_axes(self.arm))
        self._axes = goal_axes(start)
        self._last: tuple[bytes, _Values] | None = None

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.arm.n * (self.waves + 1 + (self.waves if self.loops else 0))

    def parts(self, x: Array) -> list[Array]:
        """(waves + 1, n) each: the curve, and the loop if there is one."""
        p = x.reshape(-1, self.arm.n)
        curve, loop = p[: self.waves + 1], p[self.waves + 1 :]
        return [curve, np.vstack((self.start.q, loop))] if self.loops else [curve]

    @property
    def _square(self) -> bool:
        return self.arm.task.k == self.arm.n

    def _task_jacobians(self, at: Samples) -> tuple[Array, Array]:
        """(m, k, n) task Jacobians and (m, n, k, n) their derivatives, spacecraft axes."""
        rows, scale = self.arm.task.indices, self.arm.task.scale
        return scale * at.J_star[:, rows], scale * at.dJ_star[:, :, rows]

    def values(self, x: Array) -> _Values:
        """All constraints on a motion, computed once."""
        if self._last is None or self._last[0] != x.tobytes():
            self._last = x.tobytes(), self._values(x)
        return self._last[1]

    def _values(self, x: Array) -> _Values:
        parts = self.parts(x)
        room, slopes, turns = [], [], []
        for i, p in enumerate(parts):
            Q = self.family.points(p)
            at = sample(self.arm, Q)
            turns.append(self.family.turn(p, at))
            for gap, slope in (self._clear(at), self._within(Q)):
                wide = np.zeros((len(gap), self.size))
                if i == 0:
                    end, wide[:, : p.size] = at, slope
                else:
                    wide[:, p.size :] = slope[:, self.arm.n :]  # its end is its start
                room.append(gap)
                slopes.append(wide)
        T, dphi = self._turned(turns)
        left, d_left = self._end(parts[0][0], end, T, dphi)
        return _Values(left, d_left, np.concatenate(room), np.vstack(slopes))

    def _turned(self, turns: list[tuple[Array, Array]]) -> tuple[Array, Array]:
        """Attitude at the end and (3, size) dphi, from those of curve and loop."""
        T0, (C, d_curve) = self.start.base.rotation, turns[0]
        dphi = np.zeros((3, self.size))
        dphi[:, : d_curve[0].size] = d_curve.reshape(3, -1)
        if not self.loops:
            return T0 @ C, dphi
        L, d_loop = turns[1]
        once, whole, carried = d_loop[:, 1:].reshape(3, -1), np.eye(3), np.zeros((3, 3))
        for _ in range(self.loops):
            whole, carried = whole @ L, L.T @ carried + np.eye(3)
        dphi[:, d_curve[0].size :] = C.T @ carried @ once
        return T0 @ whole @ C, dphi

    def left(self, cfg: Configuration) -> Array:
        """What is left to the goal where a motion ended."""
        return self._left(cfg.q, cfg.base.rotation, cfg.tip)

    def _left(self, q: Array, T: Array, tip: pin.SE3) -> Array:
        parts: list[Array] = [np.empty(0)]
        if self.task.tip is not None:
            parts.append(self._rows(twist_between(tip, self.task.tip)[:, None])[:, 0])
        if self.task.attitude is not None:
            parts.append(pin.log3(T.T @ self.task.attitude)[self._turns])
        if self.task.q is not None:
            parts.append(self.task.q - q)
        return np.concatenate(parts)

    def _rows(self, twist: Array) -> Array:
        """(k, m) the task's rows of twists (6, m), along the goal axes."""
        return self.arm.task.components(twist, self._axes)

    def _end(self, q: Array, at: Samples, T: Array, dphi: Array) -> tuple[Array, Array]:
        """What is left to the goal, and its derivatives."""
        tip, n = at.tip[-1], self.arm.n
        reached = pin.SE3(T @ tip.rotation, self.start.com + T @ tip.translation)
        slopes: list[Array] = [np.empty((0, self.size))]
        if self.task.tip is not None:
            held = np.linalg.solve(at.A[-1, :3, :3], at.A[-1, :3, 6:])  # its attitude held
            twist = np.vstack((-pin.skew(tip.translation) @ dphi, dphi))
            twist[:, :n] += at.J[-1, :, 6:] - at.J[-1, :, :3] @ held
            twist = (T @ twist.reshape(2, 3, -1)).reshape(6, -1)
            twist[3:] = pin.Jlog3(self.task.tip.rotation @ reached.rotation.T) @ twist[3:]
            slopes.append(-self._rows(twist))
        if self.task.attitude is not None:
            R = T.T @ self.task.attitude
            slopes.append(-(pin.Jlog3(R) @ R.T @ dphi)[self._turns])
        if self.task.q is not None:
            slopes.append(-np.eye(n, self.size))
        return self._left(q, T, reached), np.vstack(slopes)

    def _clear(self, at: Samples) -> tuple[Array, Array]:
        """(m,) signed sigma_min less what is asked for; its sign changes at a singularity."""
        J, dJ = self._task_jacobians(at)
        U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
        sign = self.sense * np.sign(np.linalg.det(J)) if self._square else np.ones(len(J))
        gradient = np.einsum("mi,mkij,mj->mk", U[:, :, -1], dJ, Vt[:, -1])
        slope = np.einsum("m,ma,mk->mak", sign, self.family.basis, gradient)
        return sign * sigma[:, -1] - MARGIN * self.task.clearance, slope.reshape(len(J), -1)

    def _within(self, Q: Array) -> tuple[Array, Array]:
        """Least room of every limited joint to its limits."""
        room, slopes = [np.empty(0)], [np.empty((0, self.family.basis.shape[1] * self.arm.n))]
        for sign, bound in ((1.0, self.task.upper), (-1.0, self.task.lower)):
            for j in np.flatnonzero(np.isfinite(bound)):
                gap = sign * (bound[j] - Q[:, j]) - INSET
                worst = int(gap.argmin())
                slope = np.zeros((self.family.basis.shape[1], self.arm.n))
                slope[:, j] = -sign * self.family.basis[worst]
                room.append(gap[worst : worst + 1])
                slopes.append(slope.reshape(1, -1))
        return np.concatenate(room), np.vstack(slopes)

    def solve(self, x: Array, in_time: Callable[[], None]) -> tuple[Array, bool]:
        """The shortest motion near a first guess, and whether it keeps all constraints.

        Args:
            x: The guess.
            in_time: Called after every step; it may raise an error to end the search.
        """
        solve: Any = minimize  # its stubs know no exact gradients of constraints
        result = solve(
            lambda x: self.cost(x)[0],
            x,
            jac=lambda x: self.cost(x)[1],
            method="SLSQP",
            callback=lambda _: in_time(),
            constraints=(
                {
                    "type": "eq",
                    "fun": lambda x: self.values(x).end,
                    "jac": lambda x: self.values(x).d_end,
                },
                {
                    "type": "ineq",
                    "fun": lambda x: self.values(x).room,
                    "jac": lambda x: self.values(x).d_room,
                },
            ),
            options={"maxiter": ITERATIONS, "ftol": 1e-4},
        )
        values = self.values(result.x)
        slack = 0.5 * min((MARGIN - 1.0) * self.task.clearance, INSET)
        met = np.abs(values.end).max() < CLOSE and values.room.min() > -slack
        return result.x, bool(met)

    def arrive(self, x: Array) -> list[Configuration]:
        """The motion, its end made exact by Newton's method.

        Raises:
            NoSolutionError: The end cannot be made exact.
        """
        for _ in range(LANDINGS):
            if (length := self.cost(x)[0] ** 0.5) > LONGEST:
                raise NoSolutionError(f"a curve grew to {length:.3g} rad")
            motion = walk(self.start, self.rows(x))
            left = self.left(motion[-1])
            if np.linalg.norm(left) <= ARRIVED:
                return motion
            x = x - np.linalg.lstsq(self.values(x).d_end, left, rcond=1e-9)[0]
        raise NoSolutionError(f"the end stays {np.linalg.norm(left):.1e} off", motion)

    def rows(self, x: Array) -> Array:
        """(m, n) joint positions along all of it, every loop."""
        lines = []
        for p in self.parts(x):
            length = math.sqrt(self.family.length_squared(p)[0])
            lines.append(self.family.rows(p, int(np.clip(length / SPACING, 60, 2000))))
        return np.vstack([line[:-1] for line in self.loops * lines[1:]] + [lines[0]])

    def cost(self, x: Array) -> tuple[float, Array]:
        """The sum of the integrals of |q'|^2, and its gradient."""
        value, gradient = 0.0, np.empty(0)
        for i, p in enumerate(self.parts(x)):
            one, slope = self.family.length_squared(p)
            times = self.loops if i else 1
            value += times * one
            gradient = np.append(gradient, times * slope[i:])  # the loop has no end of its own
        return value, gradient
