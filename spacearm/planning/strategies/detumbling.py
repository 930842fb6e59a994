"""Detumbling: a plan by which arm and wheels bring a tumbling spacecraft to rest.

Unknowns are the heights of polynomials over time for joints and wheels; the attitude follows from
D w_0 = T^T h - A s - D_q dq, A the axes of the wheels and s what they hold. Equations, at the end:
the goal of the tip, and that the wheels hold the whole momentum, A s = T^T h. Bounds: limits and
rates of the joints, capacity and torque of the wheels, at every instant; others are checked
afterwards. From capacity and torque follows a time below which no motion ends at rest.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.optimize import linprog

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError, listed
from spacearm.planning.account import Attempts
from spacearm.planning.problem import Problem
from spacearm.planning.reactions import Wheels
from spacearm.planning.request import PlanRequest
from spacearm.planning.result import Plan, best_attempt, landed
from spacearm.planning.strategies.drift import ramp_ends
from spacearm.planning.strategies.rest_motion import WAVES, Bounds, Landing, RestMotion
from spacearm.planning.timing import PEAK, corners

METHOD = "detumbling"
#: First duration tried, over the least, where none is asked for; the next over it; their number.
SOONEST, LONGER, LONGEST = 1.3, 1.3, 14
#: Standard deviation of the random waves of later attempts [rad], share of the momentum.
WIDE = 0.5
#: Turn of the spacecraft and joint motion from row to row [rad], and the least number of rows.
FINE, FEWEST = 0.04, 60
#: How often there are twice as many rows where the joints would rest at a sharp turn.
SHARP = 4
#: Number of wheels up to which all combinations of their limits are looked at.
MANY = 12
#: What stands for a wheel without a limit, times the momentum.
UNLIMITED = 1e6
#: Share of a momentum that may be across the axes of the wheels.
SPANNED = 1e-6


class Detumbling:
    """The search for a plan that ends at rest.

    Args:
        request: What is asked.

    Raises:
        ConfigurationError: The attitude is to be kept, or a method is named.
        UnsupportedError: Several tips are led, or the spacecraft has no wheels, or one is on a
            link that moves.
    """

    def __init__(self, request: PlanRequest) -> None:
        if request.constraints.keep_attitude is not None or request.search.method != "auto":
            raise ConfigurationError(
                "the spacecraft turns while it is brought to rest, by a method of its own; leave "
                "out keep_attitude and method"
            )
        if request.goals:
            raise UnsupportedError("a spacecraft is brought to rest with one tip led; name one")
        self.request, self.start, self.account = request, request.start, request.account
        self.wheels = Wheels.free(request.start, request.constraints.wheels)
        self.attempts = Attempts(request.account)
        self.best: Plan | None = None

    def plan(self) -> Plan:
        """Return a plan that ends at rest; others are tried until the time is up.

        Raises:
            NoSolutionError: There is none; carries the best attempt.
            StoppedError: Ctrl-C; carries the best attempt.
        """
        name, duration = self.start.arm.name, self.request.duration
        alone = best_attempt(self.start, None)
        still = Problem.of(self.request.at_rest())  # refuses what nothing can solve
        still.require_side()
        try:
            least = least_time(self.wheels, self.start.momentum[3:], still.target.attitude)
        except NoSolutionError as error:
            raise NoSolutionError(f"{name}: {error}", alone) from None
        if duration is not None and duration < least:
            raise NoSolutionError(
                f"{name}: the torque of the wheels takes at least {least:.4g} s to take up the "
                f"momentum, whatever the way, and the duration is {duration:.4g} s",
                alone,
            )
        way = 0.01 if still.target.q is None else np.abs(still.target.q - self.start.q)
        rests = PEAK * max((way / still.rates).max(), 0.01 / still.rates.max())
        soonest = SOONEST * max(least, float(rests))
        planar = self.start.arm.tree.plane_normal() is not None
        few = not planar and np.linalg.matrix_rank(self.wheels.axes) < 3  # joints must help
        for number in self.attempts.each(itertools.count()):
            again, longer = divmod(number, 1 if duration else LONGEST)
            random, bend = (again, True) if few else (again // 2, again % 2 == 1)
            with self.attempts.at(METHOD):
                self.account.check_time()
                return self._attempt(duration or LONGER**longer * soonest, random, bend)
        failed = self.attempts.failed
        reasons = list(dict.fromkeys(attempt.story for attempt in failed))[-3:]
        told = f" Last attempts: {'; '.join(reasons)}." if reasons else ""
        raise self.account.failure(
            f"{name}: no plan found that ends at rest, in {len(failed)} "
            f"attempt{'s' * (len(failed) != 1)} ({self.account.limit}); torque and capacity of "
            f"the wheels take at least {least:.4g} s.{told} To relax: give a longer timeout or "
            "duration, or leave final_attitude or joints of the goal open",
            self.best or alone,
        )

    def _attempt(self, lasts: float, random: int, bend: bool) -> Plan:
        """Return a plan of this duration, from first guesses of this number.

        The joints go straight to the goal, unless they may `bend` to help the wheels.

        Raises:
            NoSolutionError: None was found.
        """
        problem = Problem.of(self.request.at_rest(lasts))
        rng = np.random.default_rng((self.request.search.seed, len(self.attempts.failed)))
        n, w, h = self.start.arm.n, len(self.wheels.names), self.start.momentum[3:]
        heights = np.zeros((1 + WAVES, n + w))
        if random:
            heights[1:3] = WIDE * rng.normal(size=(2, n + w))
            heights[1:3, n:] *= float(np.linalg.norm(h)) or 1.0
            heights[1:3, :n] *= bend
        target = problem.target
        bounds = Bounds(self.start.arm, target, problem.rates, self.wheels)
        landing = Landing(self.start, target, bounds, FEWEST, bend, self.account)
        if target.q is not None:
            heights[0, :n] = target.q - self.start.q
        toward = target.attitude if target.attitude is not None else self._guess(random, rng)
        heights[0, n:] = self.wheels.shares @ toward.T @ h - self.wheels.start
        motion = RestMotion(np.append(self.start.q, self.wheels.start), heights, lasts)
        if target.tip is not None:
            turn = landing.rows(motion)[1][-1].base.rotation if target.attitude is None else toward
            reach = problem.rates * lasts / PEAK
            turn = turn @ self.start.base.rotation.T
            ends = ramp_ends(self.start, target, turn, reach, rng, self.account)
            if len(ends):
                heights[0, :n] = ends[random % len(ends)] - self.start.q
        landing = replace(landing, steps=self._steps(landing, motion))
        for _ in range(SHARP):
            motion = landing.landed(motion)
            way = np.array([cfg.q for cfg in landing.rows(motion)[1]])
            if len(corners(np.diff(way, axis=0))) == 2:
                return self._checked(problem, landing, motion)
            landing = replace(landing, steps=2 * landing.steps)
        raise NoSolutionError("all joints turn back at once")

    def _guess(self, random: int, rng: np.random.Generator) -> Array:
        """Return an attitude at which the spacecraft may end, that of the start first."""
        if not random:
            return np.asarray(self.start.base.rotation)
        normal = self.start.arm.tree.plane_normal()
        if normal is not None:
            turn = rng.uniform(-np.pi, np.pi) * np.eye(3)[normal]
        else:
            turn = rng.normal(size=3)
        return np.asarray(self.start.base.rotation @ pin.exp3(turn))

    def _steps(self, landing: Landing, motion: RestMotion) -> int:
        """Return the number of steps that a motion takes."""
        rows = landing.rows(motion)[1]
        turns = [
            np.linalg.norm(pin.log3(a.base.rotation.T @ b.base.rotation))
            for a, b in itertools.pairwise(rows)
        ]
        moved = np.abs(np.diff([cfg.q for cfg in rows], axis=0)).max(axis=1).sum()
        return max(FEWEST, math.ceil(2.0 * max(float(np.sum(turns)), float(moved)) / FINE))

    def _checked(self, problem: Problem, landing: Landing, motion: RestMotion) -> Plan:
        """Return the plan of a motion that ends at rest, if it keeps all constraints.

        Raises:
            NoSolutionError: It does not.
        """
        u, rows = landing.rows(motion)
        t, wheels = motion.duration * u, motion.at(u)[:, self.start.arm.n :]
        found = problem.plan(METHOD, rows, self.request, t=t, wheels=wheels)
        self.best = found = landed(replace(found, wheel_load=landing.bounds.load(motion)))
        problem.check(found)
        return problem.arrived(found, self.attempts.failed)


def least_time(wheels: Wheels, momentum: Array, attitude: Array | None) -> float:
    """Return a time [s] below which no motion ends at rest, from torque and capacity.

    At rest the wheels hold the whole momentum, A s = T^T h. From what they hold at the start each
    comes no farther than its torque leads in the time.

    Args:
        wheels: The wheels.
        momentum: (3,) angular momentum about the system CM [N m s], inertial axes.
        attitude: (3, 3) attitude at the end; None for any.

    Raises:
        NoSolutionError: They cannot hold it in any time; says why.
    """
    h = float(np.linalg.norm(momentum))
    if h == 0.0 and attitude is None:
        return 0.0
    if (full := np.abs(wheels.start) > wheels.capacity).any():
        name = wheels.names[int(full.argmax())]
        raise NoSolutionError(
            f"wheel {name} holds {wheels.start[full][0]:.4g} N m s at the start, of at most "
            f"{wheels.capacity[full][0]:.4g}; unload it first"
        )
    scale = max(h, float(np.abs(wheels.start).max()))
    capacity = np.minimum(wheels.capacity, UNLIMITED * scale)
    torque = np.minimum(wheels.torque, UNLIMITED * scale)
    if attitude is not None:
        return _at_attitude(wheels, attitude.T @ momentum, capacity, torque)
    most = _most(wheels.axes, capacity)
    if most < h:
        raise NoSolutionError(
            f"at rest the wheels hold all of the momentum, {h:.4g} N m s, and those of this "
            f"spacecraft hold at most {most:.4g} N m s together, whatever the attitude; unload "
            "momentum by thrusters first, or add wheels"
        )
    short = h - float(np.linalg.norm(wheels.axes @ wheels.start))
    return max(0.0, short / _most(wheels.axes, torque))


def _at_attitude(wheels: Wheels, h: Array, capacity: Array, torque: Array) -> float:
    """Return the least time in which wheels come to hold h (3,), spacecraft axes."""
    held = np.linalg.pinv(wheels.axes) @ h
    across = float(np.linalg.norm(wheels.axes @ held - h))
    if across > SPANNED * np.linalg.norm(h):
        raise NoSolutionError(
            f"at rest at final_attitude {across:.4g} of the {np.linalg.norm(h):.4g} N m s would be "
            f"across the axes of the wheels {listed(wheels.names)}, which cannot hold it; leave "
            "final_attitude open, give one that turns their axes to the momentum, or add wheels"
        )
    w = len(held)
    within = np.vstack((np.eye(w), -np.eye(w)))
    found = linprog(
        np.append(np.zeros(w), 1.0),
        A_ub=np.column_stack((within, -np.tile(torque, 2))),
        b_ub=np.concatenate((wheels.start, -wheels.start)),
        A_eq=np.column_stack((wheels.axes, np.zeros(3))),
        b_eq=wheels.axes @ held,  # h without its rounding across the axes
        bounds=[*zip(-capacity, capacity, strict=True), (0.0, None)],
    )
    if found.x is None:
        needed = ", ".join(
            f"{name} {s:.4g} of at most {c:.4g}"
            for name, s, c in zip(wheels.names, held, wheels.capacity, strict=True)
        )
        raise NoSolutionError(
            f"at rest at final_attitude the wheels would hold more than they can ({needed} N m s, "
            "shared evenly); leave final_attitude open, or unload momentum first"
        )
    return float(found.x[-1])


def _most(axes: Array, each: Array) -> float:
    """Return the largest length of A s where no wheel has more than (w,); convex: at a corner."""
    if len(each) > MANY:
        return float(each.sum())
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=len(each)))) * each
    return float(np.linalg.norm(corners @ axes.T, axis=1).max())
