"""Optimiser: the shortest joint curve that arrives, with the attitude of the spacecraft as state.

A curve leads from q_0 to q_1 in joint space, s from 0 to 1:

    q(s) = q_0 + s (q_1 - q_0) + sum_j c_j b_j(s)

with b_j(s) = sin(j pi s), or hats that are 1 at one corner and 0 at the others.

Without momentum the attitude follows T' = T [A(q) q']x with the connection A = -D^-1 D_q of (33c),
in spacecraft axes. It is integrated by the fourth-order Magnus method as in `move`, and
differentiated exactly: what changes of the curve add to the turn of each interval is carried to the
end, and summed there.

The unknowns are the coefficients of a `CurveFamily`. The pose of the tip at the end, and the
attitude of the spacecraft if asked for, are equality constraints; clearance from singularities and
joint limits are inequality constraints. All gradients are exact but that of the distance to the
singular set, which is to first order like the distance. The solver is scipy's SLSQP
(Kraft, DFVLR-FB 88-28 (1988)).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
from scipy.linalg import block_diag
from scipy.optimize import minimize

from spacearm.arrays import Array, Integers
from spacearm.collisions.separation import Collisions
from spacearm.equations.turns import GAUSS
from spacearm.errors import NoSolutionError
from spacearm.mechanics.batch import evaluate
from spacearm.mechanics.distance import linearise
from spacearm.mechanics.floating import Walk, attitudes, chained, placed, turns_and_effects, walk
from spacearm.mechanics.jacobian import turning_axes
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.joints import joint_scales
from spacearm.motion.goal import goal_axes, goal_rows, twist_between

#: Steps of the integration along a curve: enough for the optimiser, not for the end of a plan.
INTERVALS = 16
#: Steps along each straight piece, likewise.
EACH = 8
#: Factor on the clearance asked for, because the way may come nearer between the samples.
MARGIN = 1.2
ITERATIONS = 60
#: Distance kept from the joint limits, because curves may bulge between the samples [rad], [m].
INSET = 1e-3
#: Largest norm of the residual at the end of a plan [m], [rad].
ARRIVED = 1e-8
#: How much shorter than those to the least cost the first steps of the solver are.
STIFF = 4.0
#: Residual at the end of a curve from which Newton's method is not tried [m], [rad].
LOST = 0.5
#: Newton steps to the end of a plan, and of a curve, whose derivatives are those of few steps.
NEWTON_STEPS, REFINED = 6, 12
#: Length beyond which `refine` gives up a curve [rad] or [m].
LONGEST = 200.0
#: Distances to the singular set beyond this are not distinguished [rad]: they are too rough.
FAR = 1.0
#: Up to which distance [rad] the way out tells sides apart; cosine of the angle between two.
NEARBY, TURNS_ROUND = 0.5, -0.8
#: Samples of which the two bodies nearest to contact count.
TOGETHER = 4
#: Distance kept between bodies in the middle, as they may come nearer between the samples [m].
ROOM = 0.06
#: Bodies that stay farther apart on a guess do not count for the optimiser [m].
BESIDE = 0.3
#: Joint motion between the rows of a plan [rad] or [m].
SPACING = 0.02


class Target(NamedTuple):
    """What a joint motion must achieve.

    Attributes:
        tip: Pose of the tip at the end, None if it is free.
        q: (n,) joint positions at the end, None if they are free.
        attitude: (3, 3) attitude of the spacecraft at the end, None if it is free.
        clearance: Least distance to the singular set on the way [rad].
        lower: (n,) least joint positions.
        upper: (n,) largest.
        tips: Poses of several tips at the end, in place of `tip`.
        twist: (k,) twist of the tips at the end along the goal axes; None for at rest.
    """

    tip: pin.SE3 | None
    q: Array | None
    attitude: Array | None
    clearance: float
    lower: Array
    upper: Array
    tips: tuple[pin.SE3, ...] = ()
    twist: Array | None = None

    def missed(self, start: Configuration, end: Configuration) -> Array:
        """Return the difference between the target and the end of a motion from a start."""
        if self.tips:
            ways = [twist_between(*pair) for pair in zip(end.tips, self.tips, strict=True)]
            return goal_rows(start, np.concatenate(ways))
        return self.residual(start, end.q, end.base.rotation, end.tip)

    def residual(self, start: Configuration, q: Array, T: Array, tip: pin.SE3) -> Array:
        """Return the difference between the target and joint positions, attitude and tip."""
        parts: list[Array] = [np.empty(0)]
        if self.tip is not None:
            twist = twist_between(tip, self.tip)[:, None]
            parts.append(start.arm.task.components(twist, goal_axes(start))[:, 0])
        if self.attitude is not None:
            parts.append(pin.log3(T.T @ self.attitude)[list(turning_axes(start.arm))])
        if self.q is not None:
            parts.append(self.q - q)
        return np.concatenate(parts)


class _Values(NamedTuple):
    """Residuals at the end, margins on the way, and their derivatives with respect to x."""

    end: Array
    d_end: Array
    margins: Array
    d_margins: Array


class CurveOptimiser:
    """The optimisation problem of motions from one configuration: closed loops first, then a curve.

    The unknowns x are those of the curve, (count + 1, n), and those of the loop, (count, n), one
    after the other. The loop is run through `loops` times: its holonomy L turns the spacecraft by
    L^loops.

    Args:
        start: Configuration in which the motion begins.
        target: What it must achieve.
        shape: What curve and loop are made of.
        loops: How many times the loop is run through; 0 for none.
        check_time: Called at every evaluation; it may raise an error to end the search.
        collisions: The bodies of the arm that must not meet, as far as they come near each other
            where the search begins; None if they do not count.
    """

    def __init__(
        self,
        start: Configuration,
        target: Target,
        shape: Shape,
        loops: int = 0,
        check_time: Callable[[], None] = lambda: None,
        collisions: Collisions | None = None,
    ) -> None:
        self.start, self.target, self.shape, self.loops = start, target, shape, loops
        self._check_time = check_time
        self._collisions, self._pairs = collisions, np.arange(0)
        self.arm: SpaceArm = start.arm
        self.family = CurveFamily(self.arm, start.q, shape, shape.intervals)
        det = evaluate(self.arm, start.q[None], ("determinant",))["determinant"][0]
        self.sense = math.copysign(1.0, det) if self._square else 1.0
        self._turns = list(turning_axes(self.arm))
        self._axes = goal_axes(start)
        limit, n = np.concatenate((target.upper, target.lower)), self.arm.n
        some = np.isfinite(limit)
        sign, joint = np.repeat((1.0, -1.0), n), np.tile(np.arange(n), 2)
        self._bounds = sign[some], limit[some], joint[some]
        self._last: tuple[bytes, _Values] | None = None

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.arm.n * (self.shape.count + 1 + (self.shape.count if self.loops else 0))

    def parts(self, x: Array) -> list[Array]:
        """Return the coefficients (count + 1, n) of the curve, and of the loop if there is one."""
        p = x.reshape(-1, self.arm.n)
        curve, loop = p[: self.shape.count + 1], p[self.shape.count + 1 :]
        return [curve, np.vstack((self.start.q, loop))] if self.loops else [curve]

    @property
    def _curve(self) -> int:
        """Number of unknowns of the curve."""
        return self.arm.n * (self.shape.count + 1)

    @property
    def _square(self) -> bool:
        """Whether J* is square in the task's rows."""
        return self.arm.task.k == self.arm.n

    def values(self, x: Array) -> _Values:
        """Return all constraints on a motion, computed once for the same x."""
        self._check_time()
        if self._last is None or self._last[0] != x.tobytes():
            self._last = x.tobytes(), self._values(x)
        return self._last[1]

    def _values(self, x: Array) -> _Values:
        sampled = self._sampled(x)
        room, slopes = [], []
        for i, (Q, at) in enumerate(sampled):
            margins = [self._singularity_margins(Q, at), self._limit_margins(Q)]
            if self._collisions is not None and len(self._pairs):
                margins.append(self._contact_margins(self._collisions, Q))
            own = slice(0, self._curve) if i == 0 else slice(self._curve, None)
            for gap, slope in margins:
                wide = np.zeros((len(gap), self.size))
                wide[:, own] = slope[:, self.arm.n * i :]  # the end of a loop is its start
                room.append(gap)
                slopes.append(wide)
        return _Values(*self._end(sampled), np.concatenate(room), np.vstack(slopes))

    def _sampled(self, x: Array) -> list[tuple[Array, Samples]]:
        """Return the points of the curve, and of the loop if there is one, with their samples."""
        lines = [(p, self.family.points(p)) for p in self.parts(x)]
        return [(Q, self.family.samples(p, Q)) for p, Q in lines]

    def _end(self, sampled: list[tuple[Array, Samples]]) -> tuple[Array, Array]:
        """Return the residual at the end of a motion, and its derivatives."""
        T, dphi = self._end_attitude([(at.turn, at.dphi) for _, at in sampled])
        Q, at = sampled[0]
        return self._end_constraints(Q[-1], at, T, dphi)

    def _end_attitude(self, turns: list[tuple[Array, Array]]) -> tuple[Array, Array]:
        """Return the attitude at the end and dphi (3, size), from those of curve and loop."""
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

    def _end_constraints(self, q: Array, at: Samples, T: Array, dphi: Array) -> tuple[Array, Array]:
        """Return the residual at the end, and its derivatives."""
        r, n = at.r, self.arm.n
        reached = pin.SE3(T @ at.R, self.start.com + T @ r)
        slopes: list[Array] = [np.empty((0, self.size))]
        if self.target.tip is not None:
            J, A = at.J[-1], at.A
            twist = np.vstack((-pin.skew(r) @ dphi, dphi))
            twist[:, :n] += np.vstack((J[:3] + pin.skew(r) @ A, J[3:] - A))  # its attitude held
            twist = (T @ twist.reshape(2, 3, -1)).reshape(6, -1)
            twist[3:] = pin.Jlog3(self.target.tip.rotation @ reached.rotation.T) @ twist[3:]
            slopes.append(-self.arm.task.components(twist, self._axes))
        if self.target.attitude is not None:
            R = T.T @ self.target.attitude
            slopes.append(-(pin.Jlog3(R) @ R.T @ dphi)[self._turns])
        if self.target.q is not None:
            slopes.append(-np.eye(n, self.size))
        return self.target.residual(self.start, q, T, reached), np.vstack(slopes)

    def _singularity_margins(self, Q: Array, at: Samples) -> tuple[Array, Array]:
        """Return signed distances to the singular set less the clearance (m,), and derivatives.

        The sign is that of det J*, so that the margin goes through zero at a singularity. The
        derivative is that to first order, along the shortest way: right where the margin binds.
        """
        near = linearise(self.arm, Q)
        distance, away = np.minimum(near.distance, FAR), near.rows[:, 0] / joint_scales(self.arm)
        if self._square:
            sign = self.sense * np.sign(np.linalg.det(at.J[:, self.arm.task.indices]))
        else:
            sign = sides(near.rows[:, 0], distance)
        slope = np.einsum("m,ma,mk->mak", sign, self.family.basis, away)
        return sign * distance - MARGIN * self.target.clearance, slope.reshape(len(Q), -1)

    def _limit_margins(self, Q: Array) -> tuple[Array, Array]:
        """Return the least distance of every joint to each of its limits, and its derivatives."""
        sign, bound, j = self._bounds
        gap = sign * (bound - Q[:, j]) - INSET
        worst, each = gap.argmin(axis=0), np.arange(len(j))
        slopes = np.zeros((len(j), self.family.basis.shape[1], self.arm.n))
        slopes[each, :, j] = -sign[:, None] * self.family.basis[worst]
        return gap[worst, each], slopes.reshape(len(j), self.family.basis.shape[1] * self.arm.n)

    def _contact_margins(self, collisions: Collisions, Q: Array) -> tuple[Array, Array]:
        """Return how far the bodies of the arm stay from contact, and derivatives.

        Least distances less `ROOM`, one for every few samples.
        """
        every = np.arange(0, len(Q), 2)
        room = ROOM * np.sin(np.pi * self.family.s)  # the ends are as they are
        gaps, slopes = [], []
        for part in np.array_split(every, -(-len(every) // TOGETHER)):
            near = np.array([collisions.gaps(Q[i], self._pairs) - room[i] for i in part])
            worst, number = np.unravel_index(near.argmin(), near.shape)
            i = part[worst]
            away = collisions.gap_slope(Q[i], int(self._pairs[number]))
            gaps.append(near[worst, number])
            slopes.append(np.outer(self.family.basis[i], away).ravel())
        return np.array(gaps), np.array(slopes)

    def _pairs_near(self, x: Array) -> Integers:
        """Return the numbers of the pairs of bodies that come near each other on a motion."""
        if self._collisions is None:
            return np.arange(0)
        Q = np.concatenate([self.family.points(p) for p in self.parts(x)])
        least = np.min([self._collisions.gaps(q) for q in Q[::2]], axis=0)
        return np.flatnonzero(least < BESIDE)

    def solve(self, x: Array, iterations: int = ITERATIONS) -> Array:
        """Return the shortest motion near a guess x; it need not keep all constraints.

        Raises:
            NoSolutionError: It ends nowhere near the goal.
        """
        self._pairs, self._last = self._pairs_near(x), None
        solve: Any = minimize  # its stubs know no exact gradients of constraints
        scale, to = self._scaled(x)
        result = solve(
            lambda y: self.cost(to @ y)[0] / scale,
            np.linalg.solve(to, x),
            jac=lambda y: self.cost(to @ y)[1] @ to / scale,
            method="SLSQP",
            constraints=(
                {
                    "type": "eq",
                    "fun": lambda y: self.values(to @ y).end,
                    "jac": lambda y: self.values(to @ y).d_end @ to,
                },
                {
                    "type": "ineq",
                    "fun": lambda y: self.values(to @ y).margins,
                    "jac": lambda y: self.values(to @ y).d_margins @ to,
                },
            ),
            options={"maxiter": iterations, "ftol": 1e-4},
        )
        found = to @ np.asarray(result.x)
        if (off := np.linalg.norm(self.values(found).end)) > LOST:
            raise NoSolutionError(f"the end stays {off:.1e} off")
        return found

    def _scaled(self, x: Array) -> tuple[float, Array]:
        """Return the cost of a guess x, and what turns unknowns for the solver into x.

        In those the second derivatives of the cost, as a share of that, are the unit matrix over
        `STIFF`; the solver begins with the unit matrix.
        """
        scale = max(self.cost(x)[0], 1.0)
        curve = block_diag(np.eye(1), self.shape.weights)
        both = [curve, *([self.loops * self.shape.weights] if self.loops else [])]
        root = np.linalg.cholesky(
            np.kron(block_diag(*both), STIFF * 2.0 / scale * np.eye(self.arm.n))
        )
        return scale, np.linalg.inv(root.T)

    def refine(self, x: Array) -> Walk:
        """Return the rows of a motion, its end made exact by Newton's method.

        Corners beyond the joint limits are moved there first, and stay.

        Raises:
            NoSolutionError: The end cannot be made exact.
        """
        for _ in range(REFINED):
            if (length := self.cost(x)[0] ** 0.5) > LONGEST:
                raise NoSolutionError(f"a curve grew to {length:.3g} rad")
            self._check_time()
            x, free = self._within_limits(x)
            Q = self.positions(x)
            end = placed(self.start, Q[-1], attitudes(self.start, Q)[-1])
            left = self.target.missed(self.start, end)
            if np.linalg.norm(left) <= ARRIVED:
                return walk(self.start, Q)
            by_corners = self._end(self._sampled(x))[1] @ self._from_corners * free
            x = x - self._from_corners @ np.linalg.lstsq(by_corners, left, rcond=1e-9)[0]
        raise NoSolutionError(f"the end stays {np.linalg.norm(left):.1e} off", walk(self.start, Q))

    def _within_limits(self, x: Array) -> tuple[Array, Array]:
        """Return unknowns with all corners within the joint limits, and which have room (size,)."""
        if not isinstance(self.shape, Corners):
            return x, np.ones(self.size)
        lower, upper = self.target.lower + 0.5 * INSET, self.target.upper - 0.5 * INSET
        straight = np.concatenate((self.start.q, np.zeros(self.size - self.arm.n)))
        aside = np.linalg.solve(self._from_corners, x - straight).reshape(-1, self.arm.n)
        corners = self.start.q + aside
        kept = np.clip(corners, lower, upper)
        moved = (self._from_corners @ (kept - self.start.q).ravel()) + straight
        return moved, ((kept > lower) & (kept < upper)).ravel().astype(float)

    @cached_property
    def _from_corners(self) -> Array:
        """(size, size) how the unknowns change with the corners of curve and loop."""
        if not isinstance(self.shape, Corners):
            return np.eye(self.size)
        pieces = self.shape.pieces
        at_corners, _ = self.shape.at(np.arange(1, pieces + 1) / pieces)
        order = [pieces - 1, *range(pieces - 1)]  # the end is the first unknown
        blocks = [at_corners[order], *([at_corners[:-1, 1:]] if self.loops else [])]
        return np.linalg.inv(np.kron(block_diag(*blocks), np.eye(self.arm.n)))

    def positions(self, x: Array) -> Array:
        """Return the joint positions (m, n) along loops and curve."""
        lines = []
        for p in self.parts(x):
            length = math.sqrt(self.family.length_squared(p)[0])
            lines.append(self.family.rows(p, int(np.clip(length / SPACING, 60, 2000))))
        return np.vstack([line[:-1] for line in self.loops * lines[1:]] + [lines[0]])

    def cost(self, x: Array) -> tuple[float, Array]:
        """Return the sum of the integrals of |q'|^2, and its gradient."""
        value, gradient = 0.0, np.empty(0)
        for i, p in enumerate(self.parts(x)):
            one, slope = self.family.length_squared(p)
            times = self.loops if i else 1
            value += times * one
            gradient = np.append(gradient, times * slope[i:])  # the loop has no end of its own
        return value, gradient


class Samples(NamedTuple):
    """A curve's turn and Jacobians at its m Gauss points and its end, in spacecraft axes.

    Attributes:
        J: (m + 1, 6, n) J*.
        A: (3, n) the connection at the end.
        r: (3,) the tip from the system CM there [m].
        R: (3, 3) attitude of the tip there.
        turn: (3, 3) rotation from the spacecraft axes at the end to those at the start.
        dphi: (3, count + 1, n) turn of the axes at the end per change of the curve.
    """

    J: Array
    A: Array
    r: Array
    R: Array
    turn: Array
    dphi: Array


class CurveFamily:
    """The curves of some shape from one configuration.

    A curve is the vector p = (q_1, c_1, ..., c_count), (count + 1, n).

    Args:
        arm: The arm.
        q0: (n,) joint positions at the start of the curves.
        shape: What the curves are made of.
        intervals: Steps of the integration along a curve.
    """

    def __init__(self, arm: SpaceArm, q0: Array, shape: Shape, intervals: int) -> None:
        self.arm, self.q0, self.h = arm, q0, 1.0 / intervals
        self.shape = shape
        s = np.add.outer(np.arange(intervals), GAUSS).ravel() / intervals
        self.s = np.append(s, 1.0)
        self.basis, self.slope = self.shape.at(self.s)
        self._lengths = np.append(np.full(intervals, self.h), 0.0)

    def points(self, p: Array) -> Array:
        """Return the Gauss points of every interval, and the end, (2 intervals + 1, n)."""
        return self.q0 + self.basis @ (p - self._offset)

    def samples(self, p: Array, Q: Array) -> Samples:
        """Compute the samples of a curve at its `points` Q."""
        m, n = len(Q) // 2, self.arm.n
        nodes, rates = np.empty((2 * m + 2, n)), np.zeros((2 * m + 2, n))
        nodes[:-1], nodes[-1], rates[:-2] = Q, Q[-1], self.slope @ (p - self._offset)
        parts = turns_and_effects(  # the last one, at the end, has no length
            self.arm, nodes.reshape(-1, 2, n), rates.reshape(-1, 2, n), self._lengths
        )
        back = chained(parts.T[::-1].transpose(0, 2, 1))  # from there to the axes at the end
        effects = back[m - 1 :: -1, None, None] @ parts.effects[:-1]
        by_q, by_rate = effects.transpose(2, 0, 1, 3, 4).reshape(2, 2 * m, 3 * n)
        dphi = self.basis[:-1].T @ by_q + self.slope.T @ by_rate
        return Samples(
            parts.J.reshape(2 * m + 2, *parts.J.shape[2:])[:-1], parts.A[-1], parts.r[-1],
            parts.R[-1], back[-1].T, dphi.reshape(-1, 3, n).swapaxes(0, 1),
        )  # fmt: skip

    def rows(self, p: Array, m: int) -> Array:
        """Return joint positions (>= m + 1, n) at even steps of s, all corners among them."""
        m = -(-m // self.shape.pieces) * self.shape.pieces
        basis, _ = self.shape.at(np.linspace(0.0, 1.0, m + 1))
        return self.q0 + basis @ (p - self._offset)

    @cached_property
    def _offset(self) -> Array:
        """(count + 1, n) q_0 in the row of q_1: the curve depends on their difference."""
        offset = np.zeros((self.basis.shape[1], self.arm.n))
        offset[0] = self.q0
        return offset

    def length_squared(self, p: Array) -> tuple[float, Array]:
        """Return the integral of |q'|^2, least for the shortest curve, and its gradient."""
        d = p - self._offset
        weighed = np.vstack((d[:1], self.shape.weights @ d[1:]))
        return float((d * weighed).sum()), 2.0 * weighed


@dataclass(frozen=True)
class Sines:
    """Curves that are a straight line and sines.

    Attributes:
        count: Number of sines.
    """

    count: int

    @property
    def pieces(self) -> int:
        """Number of pieces that curves are smooth on."""
        return 1

    @property
    def intervals(self) -> int:
        """Steps of the integration along a curve."""
        return INTERVALS

    @property
    def weights(self) -> Array:
        """Integrals (count, count) of the products of the slopes b_j'."""
        return np.diag(0.5 * (np.pi * np.arange(1, self.count + 1)) ** 2)

    def at(self, s: Array) -> tuple[Array, Array]:
        """Return the functions s and b_j(s) (m, count + 1), and their slopes but the last."""
        j = np.pi * np.arange(1, self.count + 1)
        basis = np.column_stack((s, np.sin(np.outer(s, j))))
        slope = np.column_stack((np.ones(len(s) - 1), j * np.cos(np.outer(s[:-1], j))))
        return basis, slope


@dataclass(frozen=True)
class Corners:
    """Curves that are straight from corner to corner, as long on s each.

    Attributes:
        count: Number of corners between start and end.
    """

    count: int

    @property
    def pieces(self) -> int:
        """Number of pieces that curves are smooth on."""
        return self.count + 1

    @property
    def intervals(self) -> int:
        """Steps of the integration along a curve, the same for all pieces."""
        return self.pieces * EACH

    @property
    def weights(self) -> Array:
        """Integrals (count, count) of the products of the slopes b_j'."""
        neighbours = np.eye(self.count, k=1) + np.eye(self.count, k=-1)
        return self.pieces * (2.0 * np.eye(self.count) - neighbours)

    def at(self, s: Array) -> tuple[Array, Array]:
        """Return the functions s and b_j(s) (m, count + 1), and their slopes but the last."""
        beyond = self.pieces * s[:, None] - np.arange(1, self.count + 1)
        near = np.abs(beyond) < 1.0
        slope = -self.pieces * near * np.sign(beyond)
        basis = np.column_stack((s, near * (1.0 - np.abs(beyond))))
        return basis, np.column_stack((np.ones(len(s) - 1), slope[:-1]))


Shape: TypeAlias = Sines | Corners


def sides(away: Array, distance: Array) -> Array:
    """Tell on which side of the singular set of a redundant arm points on curves are (..., m).

    The set has as a rule two dimensions less than joint space, and thus no sides. But where two
    joints turn the tip in almost the same way, it is all but singular on what divides joint space.
    Then the direction away from the set turns round from one point to the next.

    Args:
        away: (..., m, n) unit vectors away from the set.
        distance: (..., m) distances to it [rad].

    Returns:
        1 for the side of the first point, -1 for the other.
    """
    near = np.maximum(distance[..., 1:], distance[..., :-1]) < NEARBY
    flips = near & ((away[..., 1:, :] * away[..., :-1, :]).sum(axis=-1) < TURNS_ROUND)
    ones = np.ones((*distance.shape[:-1], 1))
    return np.cumprod(np.concatenate((ones, np.where(flips, -1.0, 1.0)), axis=-1), axis=-1)
