"""Drift: a plan for a spacecraft with momentum, or to a twist, at whose end tips pass their goals.

Unknowns are the heights of waves, of a ramp that moves the end, and of a swing that ends with a
rate; all are added to a joint motion. The attitude follows from D w_0 = T^T h - s - D_q dq, where
s is what the wheels hold. Equations: the goal, at a stated time, and the twist there, A_b v_b = h
- s - A_q dq and v = J_b v_b + J_q dq, solved by Newton's method. Bounds are checked afterwards.

With angular momentum h and the joints locked the spacecraft would turn by about D^-1 h t in a time
t. So the search begins with a plan at zero momentum that starts from an attitude turned by as much,
or with a straight joint motion. All is seen from the system CM, which moves straight.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, Integers
from spacearm.equations.turns import GAUSS
from spacearm.errors import NoSolutionError
from spacearm.mechanics.batch import evaluate
from spacearm.mechanics.dynamics import generalized_velocity
from spacearm.mechanics.floating import placed
from spacearm.mechanics.jacobian import base_velocity, generalized_jacobian
from spacearm.model.arm import Configuration
from spacearm.motion.goal import goal_axes, goal_rows
from spacearm.planning.account import Attempts, SearchAccount
from spacearm.planning.many_curves import drifting_attitudes, inverse_kinematics, spacecraft_turns
from spacearm.planning.optimiser import ARRIVED, Target
from spacearm.planning.problem import Problem, contact_as_flown
from spacearm.planning.request import PlanRequest
from spacearm.planning.result import Plan, best_attempt, landed
from spacearm.planning.strategies.at_rest import at_rest
from spacearm.planning.timing import PEAK, eased, rate_bounds, swing

#: Time for a motion over that at zero momentum, where none is asked for: bent ways are longer.
SLACK = 1.2
#: One in so many ways begins with a plan at zero momentum; ends of ramps found at once.
EACH, AT_ONCE = 5, 8
#: Rows of them, at least.
ROWS = 40
#: Name of the method of joint motions, and how far those after the first go aside [rad].
JOINTS, DETOUR = "joint space", 0.4
#: Largest turn of the spacecraft, and motion of a joint, from row to row [rad], [m].
FINE = 0.05
#: Joint motion at the rates at the end for as long as a swing to them may last [rad] or [m]; that
#: for which there is time where no duration is asked for, of this length at most [s]; its rows.
SWUNG, QUICK, LEISURE, SWING_ROWS = 2.5, 0.5, 5.0, 60

#: Methods by which a plan with momentum begins, after others, and the least time for each [s].
AGAIN, SHORT = ("joint space", "tree", "cycles"), 1.0

#: Number of waves 1 - cos(2 pi k u) by which a motion is bent.
WAVES = 4
#: Rows of the motions whose ends give the derivative.
COARSE = 30
#: Height of a wave by which the end is differentiated [rad] or [m].
BENT = 1e-4
#: Fall of the error with which a derivative is used again.
KEPT = 0.1
#: Newton steps, at most.
STEPS = 30
#: Longest of them, in every height [rad] or [m].
LONGEST = 0.3
#: First guesses of inverse kinematics, its steps, and intervals of the integration along each.
GUESSES, RAMP_STEPS, INTERVALS = 300, 25, 6
#: Error of the tip that bending a motion makes up for [m], [rad].
NEAR = 0.1
#: Ends nearer to each other than this count once [rad], [m].
SAME = 0.1


class Drift:
    """The search for a plan with momentum.

    Args:
        request: What is asked.
    """

    def __init__(self, request: PlanRequest) -> None:
        self.request, self.start, self.account = request, request.start, request.account
        self.attempts = Attempts(request.account)
        self.best: Plan | None = None
        self._lasts = request.duration or 0.0
        self._turn = pin.exp3(self._spin * self._lasts)
        self._ends: list[Array] = []

    def plan(self) -> Plan:
        """Return a plan that arrives; others are tried until the time is up.

        Raises:
            NoSolutionError: There is none; carries the best attempt.
            StoppedError: Ctrl-C; carries the best attempt.
        """
        if self._lasts or not self.request.drift.any():
            Problem.of(self.request.at_rest(self._lasts)).require_side()  # or nothing solves it
        for number in self.attempts.each(itertools.count()):
            with self.attempts.at("at zero momentum"):
                self.account.check_time()
                if number % EACH and self._lasts and not self.request.goals:
                    return self._bent_ramp()
                return self._bent_plan(number // EACH)
        h, tried = self.start.momentum.round(6).tolist(), self.attempts.failed
        v = self.request.final_twist
        asked = f"momentum {h}" if v is None else f"momentum {h} and final_twist {v.tolist()}"
        raise self.account.failure(
            f"{self.start.arm.name}: no plan found with {asked}, in {len(tried)} "
            f"attempt{'s' * (len(tried) != 1)} ({self.account.limit}). {self.attempts.told}",
            self.best or best_attempt(self.start, None, tried),
        )

    def _bent_ramp(self) -> Plan:
        """Return a plan made of a straight joint motion.

        Raises:
            NoSolutionError: None of it arrives, or it breaks a constraint.
        """
        self.attempts.method = JOINTS
        problem = Problem.of(self.request.at_rest(self._lasts))
        end = self._next_end(problem)
        way = end - self.start.q
        aside = np.zeros(len(way))
        if any(attempt.method == JOINTS for attempt in self.attempts.failed):
            aside = self._rng.normal(scale=DETOUR, size=len(way))
        spin = float(np.linalg.norm(self._spin)) * self._lasts
        u = np.linspace(0.0, 1.0, ROWS + math.ceil(max(spin, np.abs(way).max()) / FINE))
        wave = 0.5 - 0.5 * np.cos(2.0 * np.pi * u[:, None])
        Q = self.start.q + eased(u)[:, None] * way + wave * aside
        rate = self._final_rate(placed(self.start, end, self._turn @ self.start.base.rotation))
        return self._arrived(problem, self._lasts * u, Q, rate)

    def _next_end(self, problem: Problem) -> Array:
        """Return joint positions (n,) at the goal where a straight motion ends.

        Raises:
            NoSolutionError: None can be reached in time.
        """
        if not self._ends:
            reach = problem.rates * self._lasts / PEAK
            ends = ramp_ends(self.start, problem.target, self._turn, reach, self._rng, self.account)
            self._ends = [*ends[:AT_ONCE]]
        if not self._ends:
            raise NoSolutionError("no joint positions at the goal can be reached in time")
        return self._ends.pop(0)

    @property
    def _rng(self) -> np.random.Generator:
        """The random numbers of this attempt."""
        return np.random.default_rng((self.request.search.seed, len(self.attempts.failed)))

    def _bent_plan(self, number: int) -> Plan:
        """Return a plan made of one at zero momentum, of several the one of this number.

        Raises:
            NoSolutionError: None of it arrives, or it breaks a constraint.
        """
        still = at_rest(self._still(number))
        self.attempts.method = f"{still.method}, bent"
        rate = self._final_rate(still[-1])
        if self.request.duration is None:
            swinging = min(QUICK / rate, LEISURE) if rate else 0.0
            self._lasts = max(SLACK * float(still.t[-1]), self._lasts, swinging) or LEISURE
        elif still.t[-1] > self.request.duration:
            raise NoSolutionError(_late(still, self.request.duration))
        t, Q = _rows(still, self._lasts, float(np.linalg.norm(self._spin)))
        problem = Problem.of(self.request.at_rest(self._lasts))
        end = Arrival(self.start, problem.target, t).rows(Q)[-1].base.rotation
        self._turn = end @ still[-1].base.rotation.T @ self._turn  # by what this way drifts
        return self._arrived(problem, t, Q, rate)

    def _still(self, number: int) -> PlanRequest:
        """Return a request without momentum whose start is turned by the drift."""
        request, search = self.request.at_rest(self._lasts), self.request.search
        attitude = pin.SE3(self._turn @ self.start.base.rotation, np.zeros(3))
        start = self.start.arm.at(self.start.q, base=attitude).centred(self.start.com)
        method = search.method
        if method == "auto" and number > 1 and not self.request.goals:
            method = AGAIN[number % len(AGAIN)]
        return replace(
            request,
            start=start,
            obstacles=() if number % 2 else self.request.obstacles,  # about where they will be
            search=replace(search, method=method, seed=search.seed + number),
            account=self.account.part(max(self.account.left / 3.0, SHORT)),
        )

    def _final_rate(self, end: Configuration) -> float:
        """Return about the largest rate of a joint at the end [rad/s] or [m/s]; 0 for at rest."""
        v = self.request.final_twist
        if v is None:
            return 0.0
        end = end.with_momentum(self.start.momentum).with_wheels(self.start.wheels)
        still = twist_of(end, np.zeros(end.arm.n))
        rates = np.linalg.lstsq(goal_rows(end, generalized_jacobian(end)), v - still)[0]
        return float(np.abs(rates).max())

    def _arrived(self, problem: Problem, t: Array, Q: Array, rate: float) -> Plan:
        """Return a plan made of joint positions (m, n) at times t (m,), if it can be.

        Args:
            problem: What it must keep.
            t: The times.
            Q: The joint positions.
            rate: About the largest rate of a joint at the end.

        Raises:
            NoSolutionError: It cannot arrive, or breaks a constraint.
        """
        swung = min(SWUNG / rate, self._lasts) if rate else self._lasts
        if problem.target.twist is not None:
            before = t < (1.0 - 1e-9) * (t[-1] - swung)
            swinging = np.linspace(max(t[-1] - swung, 0.0), t[-1], max(SWING_ROWS, sum(~before)))
            denser = np.append(t[before], swinging)
            t, Q = denser, np.column_stack([np.interp(denser, t, q) for q in Q.T])
        rows, rates = Arrival(self.start, problem.target, t, swung).bent(Q)
        wheels = np.tile(self.start.wheels, (len(t), 1))
        at = {"t": t, "wheels": wheels, "final_rates": rates}
        found = problem.plan(self.attempts.method, rows, self.request, **at)
        self.best = found = landed(found)
        problem.check(found)
        over = rate_bounds(found.spline) / problem.rates
        if over.max() > 1.0:
            self._lasts *= 1.0 if self.request.duration else float(over.max())
            name = found.arm.joint_names[int(over.argmax())]
            raise NoSolutionError(f"joint {name!r} moves at {over.max():.3g} times its limit")
        return problem.arrived(found, self.attempts.failed)

    @cached_property
    def _spin(self) -> Array:
        """(3,) angular velocity of the spacecraft at the start, joints at rest [rad/s]."""
        return base_velocity(self.start, np.zeros(self.start.arm.n))[3:]


def _rows(plan: Plan, lasts: float, spin: float) -> tuple[Array, Array]:
    """Return times (m,) and joint positions (m, n) of a plan that lasts longer, in small steps."""
    if len(plan) == 1:
        return lasts * np.linspace(0.0, 1.0, ROWS + 1), np.tile(plan.q, (ROWS + 1, 1))
    t = plan.t / plan.t[-1] * lasts  # ends there exactly
    step = np.maximum(np.abs(np.diff(plan.q, axis=0)).max(axis=1), spin * np.diff(t))
    parts = np.maximum(1, np.ceil(step / FINE)).astype(int)
    at = np.concatenate([*(i + np.arange(k) / k for i, k in enumerate(parts)), [len(parts)]])
    rows = np.arange(len(t))
    return np.interp(at, rows, t), np.column_stack([np.interp(at, rows, q) for q in plan.q.T])


def twist_of(cfg: Configuration, dq: Array) -> Array:
    """Return the twist of the tips (k,) with the momentum of a configuration, as goals have it."""
    return goal_rows(cfg, cfg.J @ generalized_velocity(cfg, dq))


def stretched(plan: Plan, duration: float | None, account: SearchAccount) -> Plan:
    """Return a plan without momentum that ends at a time [s], if one is asked for and it moves.

    Raises:
        NoSolutionError: The velocity limits do not allow it, or it meets an obstacle that moves.
    """
    if duration is None or len(plan) == 1:
        return plan
    if plan.t[-1] > duration:
        raise NoSolutionError(f"{plan.arm.name}: {_late(plan, duration)}", plan)
    plan = replace(plan, t=plan.t / plan.t[-1] * duration)
    moving = any(obstacle.moves for obstacle in plan.obstacles)
    if moving and (contact := contact_as_flown(plan, account.check_time)):
        raise NoSolutionError(f"{plan.arm.name}: {contact}", replace(plan, apart=None))
    return plan


def _late(plan: Plan, duration: float) -> str:
    """Return why a plan does not arrive in time, in words."""
    return (
        f"the way takes {plan.t[-1]:.4g} s within the velocity limits, more than the duration of "
        f"{duration:.4g} s"
    )


@dataclass(frozen=True)
class Arrival:
    """The search for a motion that arrives at a stated time in spite of momentum.

    Attributes:
        start: Configuration at the start, with the momentum.
        target: What the motion must achieve.
        t: (m,) times of the rows [s].
        swung: How long the swing to the rates at the end lasts [s].
    """

    start: Configuration
    target: Target
    t: Array
    swung: float = 0.0

    def bent(self, Q: Array) -> tuple[list[Configuration], Array]:
        """Return a motion near joint positions (m, n) that arrives, and its rates at the end (n,).

        Newton's method on the heights of the shapes; of all corrections the one of least squares.

        Raises:
            NoSolutionError: It does not converge; carries the last motion.
        """
        shapes = self._shapes(self.t)
        height = np.zeros((shapes.shape[1], Q.shape[1]))
        rows = self.rows(Q)
        left = self.residual(rows[-1], height)
        slope = None
        for _ in range(STEPS):
            if np.linalg.norm(left) <= ARRIVED:
                return rows, self._final_rates(height)
            slope = self._slope(Q + shapes @ height, height) if slope is None else slope
            full = np.linalg.lstsq(slope, left)[0]
            full *= min(1.0, LONGEST / np.abs(full).max())
            for share in (1.0, 0.5, 0.25, 0.1):
                tried = height - share * full.reshape(height.shape)
                there = self.rows(Q + shapes @ tried)
                fall = np.linalg.norm(self.residual(there[-1], tried)) / np.linalg.norm(left)
                if fall < 1.0:
                    break
            else:
                break
            slope = slope if fall < KEPT else None
            height, rows, left = tried, there, self.residual(there[-1], tried)
        raise NoSolutionError(
            f"with this momentum and twist the end stays {np.linalg.norm(left):.1e} off", rows
        )

    def rows(self, Q: Array) -> list[Configuration]:
        """Return the configurations along joint positions (m, n)."""
        T = self._attitudes(self.t, Q[None])[0]
        return [placed(self.start, q, R) for q, R in zip(Q, T, strict=True)]

    def residual(self, end: Configuration, height: Array) -> Array:
        """Return the difference between the target and the end of a motion with these heights."""
        missed = self.target.missed(self.start, end)
        if self.target.twist is None:
            return missed
        end = end.with_momentum(self.start.momentum).with_wheels(self.start.wheels)
        return np.append(missed, self.target.twist - twist_of(end, self._final_rates(height)))

    def _final_rates(self, height: Array) -> Array:
        """Return the rates (n,) at the end of a motion with these heights."""
        return height[-1] if self.target.twist is not None else np.zeros(height.shape[1])

    def _slope(self, Q: Array, height: Array) -> Array:
        """Return the derivative of the residual by all heights, from motions of few rows."""
        few = np.linspace(self.t[0], self.t[-1], COARSE + 1)
        if self.target.twist is not None:
            swinging = np.linspace(self.t[-1] - self.swung, self.t[-1], COARSE)
            few = np.append(few[few < 0.999 * swinging[0]], swinging)
        coarse = np.column_stack([np.interp(few, self.t, q) for q in Q.T])
        shapes = self._shapes(few)
        n, size = Q.shape[1], shapes.shape[1] * Q.shape[1]
        heights = BENT * np.vstack((np.zeros(size), np.eye(size))).reshape(size + 1, -1, n)
        each = coarse + shapes @ heights
        T = self._attitudes(few, each)[:, -1]
        ends = [
            self.residual(placed(self.start, q[-1], R), height + by)
            for q, R, by in zip(each, T, heights, strict=True)
        ]
        return np.column_stack([(end - ends[0]) / BENT for end in ends[1:]])

    def _attitudes(self, t: Array, Q: Array) -> Array:
        T, h = self.start.base.rotation, self.start.momentum[3:]
        return drifting_attitudes(self.start.arm, T, t, Q, h, T.T @ self.start.stored[3:])

    def _shapes(self, t: Array) -> Array:
        """Return the shapes (m, shapes) at times: ramp, waves, and last the swing.

        There is no ramp where the joints have a goal, and no swing to the end at rest.
        """
        u = (t - t[0]) / (t[-1] - t[0])
        shapes = [1.0 - np.cos(2.0 * np.pi * k * u) for k in range(1, WAVES + 1)]
        if self.target.q is None:
            shapes.insert(0, eased(u))
        if self.target.twist is not None:
            shapes.append(self.swung * swing(np.clip(1.0 - (t[-1] - t) / self.swung, 0.0, 1.0)))
        return np.column_stack(shapes)


def ramp_ends(
    start: Configuration,
    target: Target,
    turn: Array,
    reach: Array,
    rng: np.random.Generator,
    account: SearchAccount,
) -> Array:
    """Return joint positions (m, n) at the goal, those that are reached soonest first.

    The spacecraft ends turned by the straight joint motion there and by the drift, which is taken
    as that of the start. Square arms end on the start's side of the singular set.

    Args:
        start: Configuration at the start.
        target: What the motion must achieve.
        turn: (3, 3) the drift until the end, inertial axes.
        reach: (n,) the largest motion of each joint [rad], [m].
        rng: Draws the first guesses.
        account: The time that it may take.
    """
    arm, q0 = start.arm, start.q
    if target.q is not None:
        return target.q[None]
    if target.tip is None:
        return q0[None]
    lower, upper = (np.clip(b, q0 - reach, q0 + reach) for b in (target.lower, target.upper))
    nodes = (np.arange(INTERVALS)[:, None] + GAUSS).ravel() / INTERVALS

    def attitudes(Q: Array, _: Integers) -> Array:
        way = (Q - q0)[:, None]
        rates = np.broadcast_to(way, (len(Q), len(nodes), arm.n))
        line = spacecraft_turns(arm, q0 + nodes[:, None] * way, rates)
        return turn @ start.base.rotation @ line

    guesses = rng.uniform(lower, upper, (GUESSES, arm.n))
    tip = pin.SE3(target.tip.rotation, target.tip.translation - start.com)
    axes, limits = goal_axes(start), (lower, upper)
    Q, _, off = inverse_kinematics(
        arm, guesses, tip, attitudes, axes, RAMP_STEPS, account.check_time, limits
    )
    Q = Q[off < NEAR]
    if arm.n == arm.task.k and len(Q):
        side = evaluate(arm, np.vstack((q0, Q)), ("determinant",))["determinant"]
        Q = Q[side[1:] * side[0] > 0.0]
    Q = Q[np.argsort((np.abs(Q - q0) / reach).max(axis=1))]
    first = [np.abs(Q[:i] - q).max(axis=1).min(initial=np.inf) > SAME for i, q in enumerate(Q)]
    return Q[np.array(first, dtype=bool)]
