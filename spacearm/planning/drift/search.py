"""SearchAccount: plans of a spacecraft with momentum, each made of one that has none.

With angular momentum h and the joints locked the spacecraft would turn by about D^-1 h t in a time
t. So the search begins with a plan at zero momentum that starts from an attitude turned by as much,
and then bends it until it arrives from where the spacecraft is. All is seen from the system CM,
which moves straight.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.collisions.courses import Recorded
from spacearm.collisions.obstacles import Obstacle
from spacearm.collisions.separation import Collisions
from spacearm.errors import NoSolutionError
from spacearm.mechanics.jacobian import base_velocity
from spacearm.model.arm import Configuration
from spacearm.planning.account import TimeUpError
from spacearm.planning.drift.arrival import Arrival
from spacearm.planning.drift.bodies import kept_apart
from spacearm.planning.drift.ramps import ramp_ends
from spacearm.planning.problem import Problem
from spacearm.planning.result import FAILED, Attempt, Plan, best_attempt
from spacearm.planning.rounds.mission import Mission
from spacearm.planning.timing import PEAK, eased

SLACK = 1.2
"""Time for a motion over that at zero momentum, where none is asked for: bent ways are longer."""
EACH, AT_ONCE = 5, 8
"""One in so many ways begins with a plan at zero momentum; ends of ramps found at once."""
ROWS = 40
"""Rows of them, at least."""
JOINTS, DETOUR = "joint space", 0.4
"""Name of the method of joint motions, and how far those after the first go aside [rad]."""
FINE = 0.05
"""Largest turn of the spacecraft, and motion of a joint, from row to row [rad], [m]."""


@dataclass
class Drift:
    """A search for a plan with momentum.

    Attributes:
        mission: What shall be planned.
        start: Configuration at the start.
        momentum: (6,) momentum, inertial axes.
        duration: When to arrive [s]; None for about as soon as the velocity limits allow.
        obstacles: What must not be met.
        tried: What was tried so far.
        best: The last attempt that arrives but breaks a constraint.
    """

    mission: Mission
    start: Configuration
    momentum: Array
    duration: float | None
    obstacles: tuple[Obstacle, ...]
    tried: list[Attempt] = field(default_factory=list)
    best: Plan | None = None
    _ends: list[Array] = field(default_factory=list)

    def plan(self) -> Plan:
        """Return a plan that arrives; others are tried until the time is up.

        Raises:
            NoSolutionError: There is none; carries the best attempt.
            StoppedError: Ctrl-C; carries the best attempt.
        """
        lasts = self.duration or 0.0
        if lasts or not self._speed.any():
            self.mission.problem(self._speed * lasts)  # refuses what nothing can solve
        turn = pin.exp3(self._spin * lasts)
        for number in itertools.count():
            method = "at zero momentum"
            try:
                self.mission.search.check_time()
                if number % EACH and lasts:
                    method, still = JOINTS, None
                    problem = self.mission.problem(self._speed * lasts)
                    t, Q = self._ramp(problem, turn, lasts)
                else:
                    still = self.mission.still(
                        self._turned(turn), self._speed * lasts, number // EACH
                    )
                    method = f"{still.method}, bent"
                    lasts = self._lasts(still, lasts)
                    t, Q = _rows(still, lasts, float(np.linalg.norm(self._spin)))
                    problem = self.mission.problem(self._speed * lasts)
                bend = Arrival(self.start, problem.target, t, self.momentum[3:])
                if still is not None:  # from where the same way would arrive
                    ends = bend.rows(Q)[-1].base.rotation
                    turn = ends @ still[-1].base.rotation.T @ turn
                return self._checked(problem, method, t, bend.bent(Q))
            except TimeUpError:
                break
            except KeyboardInterrupt:
                self.mission.search.end()
                break
            except NoSolutionError as error:
                self.tried.append(Attempt(method, False, str(error)))
        name, h = self.start.arm.name, self.momentum.round(6).tolist()
        stories = {a.method: a.story for a in self.tried}
        story = "; ".join(f"{method}: {why}" for method, why in stories.items())
        raise self.mission.search.failure(
            f"{name}: no plan found with momentum {h}, in {len(self.tried)} attempts. {story}",
            self.best or best_attempt(self.start, None, self.tried),
        )

    def _ramp(self, problem: Problem, turn: Array, lasts: float) -> tuple[Array, Array]:
        """Return times (m,) and joint positions (m, n) of a motion from rest to rest.

        Raises:
            NoSolutionError: None is near a solution.
        """
        if not self._ends:
            reach = problem.rates * lasts / PEAK
            rng = np.random.default_rng((self.mission.seed, len(self.tried)))
            check_time = self.mission.search.check_time
            self._ends = [
                *ramp_ends(self.start, problem.target, turn, reach, rng, check_time)[:AT_ONCE]
            ]
        if not self._ends:
            raise NoSolutionError("no joint positions at the goal can be reached in time")
        way = self._ends.pop(0) - self.start.q
        detour = np.zeros(len(way))
        if any(attempt.method == JOINTS for attempt in self.tried):
            detour = np.random.default_rng((self.mission.seed, len(self.tried))).normal(
                scale=DETOUR, size=len(way)
            )
        spin = float(np.linalg.norm(self._spin)) * lasts
        u = np.linspace(0.0, 1.0, ROWS + math.ceil(max(spin, np.abs(way).max()) / FINE))
        aside = 0.5 - 0.5 * np.cos(2.0 * np.pi * u[:, None])
        return lasts * u, self.start.q + eased(u)[:, None] * way + aside * detour

    def _checked(self, problem: Problem, method: str, t: Array, rows: list[Configuration]) -> Plan:
        """Return a plan with rows that arrive, if they keep all constraints.

        Raises:
            NoSolutionError: They do not.
        """
        arm = self.start.arm
        found = Plan.of_rows(
            method, rows, problem.target.clearance, problem.rates, (), FAILED, None
        )
        base = found.base.copy()
        base[:, :3] += np.outer(t, self._speed)
        h, spins = (np.tile(x, (len(t), 1)) for x in (self.momentum, self.start.wheels))
        found = replace(found, t=t, base=base, momentum=h, wheels=spins, obstacles=self.obstacles)
        self.best = found
        problem.check(rows)
        over = (np.abs(np.diff(found.q, axis=0)) / np.diff(t)[:, None]).max(axis=0)
        over /= problem.rates
        if over.max() > 1.0:
            name = arm.joint_names[int(over.argmax())]
            raise NoSolutionError(f"joint {name!r} moves at {over.max():.3g} times its limit")
        found = kept_apart(found, problem, self.obstacles)
        last = Attempt(method, True, f"{found.travel}, {found.nearest}")
        return replace(found, tried=(*self.tried, last))

    def _lasts(self, still: Plan, lasts: float) -> float:
        """Return when the tip shall arrive [s].

        Raises:
            NoSolutionError: The velocity limits do not allow it.
        """
        if self.duration is None:
            return max(SLACK * float(still.t[-1]), lasts)
        if still.t[-1] > self.duration:
            raise NoSolutionError(_late(still, self.duration))
        return self.duration

    def _turned(self, turn: Array) -> Configuration:
        """Return the start, turned about the system CM by a rotation (3, 3)."""
        attitude = pin.SE3(turn @ self.start.base.rotation, np.zeros(3))
        return self.start.arm.at(self.start.q, base=attitude).centred(self.start.com)

    @cached_property
    def _spin(self) -> Array:
        """(3,) angular velocity of the spacecraft at the start, joints at rest [rad/s]."""
        start = self.start.with_momentum(self.momentum)
        return base_velocity(start, np.zeros(start.arm.n))[3:]

    @cached_property
    def _speed(self) -> Array:
        """(3,) velocity of the system CM [m/s]."""
        return self.momentum[:3] / self.start.arm.mass


def _rows(plan: Plan, lasts: float, spin: float) -> tuple[Array, Array]:
    """Return times (m,) and joint positions (m, n) of a plan that lasts longer, in small steps."""
    t = plan.t / plan.t[-1] * lasts  # ends there exactly
    step = np.maximum(np.abs(np.diff(plan.q, axis=0)).max(axis=1), spin * np.diff(t))
    parts = np.maximum(1, np.ceil(step / FINE)).astype(int)
    at = np.concatenate([*(i + np.arange(k) / k for i, k in enumerate(parts)), [len(parts)]])
    rows = np.arange(len(t))
    return np.interp(at, rows, t), np.column_stack([np.interp(at, rows, q) for q in plan.q.T])


def stretched(plan: Plan, duration: float) -> Plan:
    """Return a plan without momentum that ends at a time [s].

    Raises:
        NoSolutionError: The velocity limits do not allow it, or it meets an obstacle that moves.
    """
    if plan.t[-1] > duration:
        raise NoSolutionError(f"{plan.arm.name}: {_late(plan, duration)}", plan)
    found = replace(plan, t=plan.t / plan.t[-1] * duration)
    if plan.obstacles:
        contact = Collisions(plan.arm, plan.obstacles).contact(Recorded(found))
        if contact is not None:
            raise NoSolutionError(f"{plan.arm.name}: {contact}", replace(found, apart=None))
    return found


def _late(plan: Plan, duration: float) -> str:
    """Return why a plan does not arrive in time, in words."""
    return (
        f"the way takes {plan.t[-1]:.4g} s within the velocity limits, more than the duration of "
        f"{duration:.4g} s"
    )
