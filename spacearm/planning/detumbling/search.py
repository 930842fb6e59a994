"""SearchAccount: plans by which arm and wheels bring a tumbling spacecraft to rest.

The angular momentum h is constant in inertial axes; when all is at rest the wheels hold it, A s =
T^T h. Joints and wheels move along smooth curves, the attitude follows from h, and the curves are
bent until it ends at such an attitude, with the tip at its goal.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.collisions.obstacles import Obstacle
from spacearm.errors import NoSolutionError
from spacearm.model.arm import Configuration
from spacearm.planning.account import TimeUpError
from spacearm.planning.detumbling.bounds import Bounds
from spacearm.planning.detumbling.capacity import least_time
from spacearm.planning.detumbling.course import WAVES, Course
from spacearm.planning.detumbling.landing import Landing
from spacearm.planning.drift.bodies import kept_apart
from spacearm.planning.drift.ramps import ramp_ends
from spacearm.planning.problem import Problem
from spacearm.planning.result import FAILED, Attempt, Plan, best_attempt
from spacearm.planning.rounds.mission import Mission
from spacearm.planning.timing import PEAK, corners
from spacearm.planning.wheels.limits import Wheels

METHOD = "detumbling"
SOONEST, LONGER, LONGEST = 1.3, 1.3, 14
"""First duration tried, over the least, where none is asked for; the next over it; their number."""
WIDE = 0.5
"""Standard deviation of the random waves of later attempts [rad], share of the momentum."""
FINE, FEWEST = 0.04, 60
"""Turn of the spacecraft and joint motion from row to row [rad], and the least number of rows."""

SHARP = 4
"""How often there are twice as many rows where the joints would rest at a sharp turn."""


@dataclass
class Detumbling:
    """A search for a plan that ends at rest.

    Attributes:
        mission: What shall be planned.
        start: Configuration at the start, with what its wheels hold.
        wheels: The wheels.
        momentum: (6,) momentum, inertial axes.
        duration: When the motion ends [s]; None for about as soon as it can.
        obstacles: What must not be met.
        tried: What was tried so far.
        best: The last motion that ends at rest but breaks a constraint.
    """

    mission: Mission
    start: Configuration
    wheels: Wheels
    momentum: Array
    duration: float | None
    obstacles: tuple[Obstacle, ...]
    tried: list[Attempt] = field(default_factory=list)
    best: Plan | None = None

    def plan(self) -> Plan:
        """Return a plan that ends at rest; others are tried until the time is up.

        Raises:
            NoSolutionError: There is none; carries the best attempt.
            StoppedError: Ctrl-C; carries the best attempt.
        """
        name = self.start.arm.name
        still = self.mission.problem(np.zeros(3))  # refuses what nothing can solve
        try:
            least = least_time(self.wheels, self.momentum[3:], still.target.attitude)
        except NoSolutionError as error:
            raise NoSolutionError(f"{name}: {error}", self._alone) from None
        if self.duration is not None and self.duration < least:
            raise NoSolutionError(
                f"{name}: the torque of the wheels takes at least {least:.4g} s to take up the "
                f"momentum, whatever the way, and the duration is {self.duration:.4g} s",
                self._alone,
            )
        soonest = SOONEST * max(least, self._joint_time(still))
        reasons: dict[str, None] = {}
        for number in itertools.count():
            again, longer = divmod(number, 1 if self.duration else LONGEST)
            lasts = self.duration or LONGER**longer * soonest
            random, bend = (again, True) if self._few else (again // 2, again % 2 == 1)
            try:
                self.mission.search.check_time()
                return self._attempt(lasts, random, bend)
            except TimeUpError:
                break
            except KeyboardInterrupt:
                self.mission.search.end()
                break
            except NoSolutionError as error:
                self.tried.append(Attempt(METHOD, False, str(error)))
                reasons.setdefault(str(error))
        told = f" At last: {'; '.join(list(reasons)[-3:])}." if reasons else ""
        raise self.mission.search.failure(
            f"{name}: no plan found that ends at rest, in {len(self.tried)} attempts; torque and "
            f"capacity of the wheels take at least {least:.4g} s.{told} To relax: a longer "
            "duration, final_attitude open, or joints of the goal open",
            self.best or self._alone,
        )

    def _attempt(self, lasts: float, random: int, bend: bool) -> Plan:
        """Return a plan of this duration, from first guesses of this number.

        The joints go straight to the goal, unless they may `bend` to help the wheels.

        Raises:
            NoSolutionError: None was found.
        """
        problem = self.mission.problem(self._speed * lasts)
        rng = np.random.default_rng((self.mission.seed, len(self.tried)))
        n, w = self.start.arm.n, len(self.wheels.names)
        heights = np.zeros((1 + WAVES, n + w))
        if random:
            heights[1:3] = WIDE * rng.normal(size=(2, n + w))
            heights[1:3, n:] *= self._held
            heights[1:3, :n] *= bend
        target = problem.target
        h, check_time = self.momentum[3:], self.mission.search.check_time
        landing = Landing(
            self.start, target, problem.rates, self.wheels, h, FEWEST, bend, check_time
        )
        if target.q is not None:
            heights[0, :n] = target.q - self.start.q
        toward = target.attitude if target.attitude is not None else self._guess(random, rng)
        heights[0, n:] = (
            np.linalg.pinv(self.wheels.axes) @ toward.T @ self.momentum[3:] - self.wheels.start
        )
        course = Course(np.append(self.start.q, self.wheels.start), heights, lasts)
        if target.tip is not None:
            turn = landing.rows(course)[1][-1].base.rotation if target.attitude is None else toward
            reach = problem.rates * lasts / PEAK
            turn = turn @ self.start.base.rotation.T
            ends = ramp_ends(self.start, target, turn, reach, rng, self.mission.search.check_time)
            if len(ends):
                heights[0, :n] = ends[random % len(ends)] - self.start.q
        landing = replace(landing, steps=self._steps(landing, course))
        for _ in range(SHARP):
            course = landing.landed(course)
            way = np.array([cfg.q for cfg in landing.rows(course)[1]])
            if len(corners(np.diff(way, axis=0))) == 2:
                return self._checked(problem, landing, course)
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

    def _steps(self, landing: Landing, course: Course) -> int:
        """Return the number of steps that a motion takes."""
        rows = landing.rows(course)[1]
        turns = [
            np.linalg.norm(pin.log3(a.base.rotation.T @ b.base.rotation))
            for a, b in itertools.pairwise(rows)
        ]
        moved = np.abs(np.diff([cfg.q for cfg in rows], axis=0)).max(axis=1).sum()
        return max(FEWEST, math.ceil(2.0 * max(float(np.sum(turns)), float(moved)) / FINE))

    def _checked(self, problem: Problem, landing: Landing, course: Course) -> Plan:
        """Return the plan of a course that ends at rest, if it keeps all constraints.

        Raises:
            NoSolutionError: It does not.
        """
        u, rows = landing.rows(course)
        arm, t = self.start.arm, course.duration * u
        found = Plan.of_rows(
            METHOD, rows, problem.target.clearance, problem.rates, (), FAILED, None
        )
        base = found.base.copy()
        base[:, :3] += np.outer(t, self._speed)
        found = replace(
            found,
            t=t,
            base=base,
            momentum=np.tile(self.momentum, (len(t), 1)),
            wheels=course.at(u)[:, arm.n :],
            wheel_load=Bounds(self.start, problem.target, problem.rates, self.wheels).load(course),
            obstacles=self.obstacles,
        )
        self.best = found
        problem.check(rows)
        found = kept_apart(found, problem, self.obstacles)
        last = Attempt(METHOD, True, f"{found.travel}, {found.nearest}")
        return replace(found, tried=(*self.tried, last))

    def _joint_time(self, still: Problem) -> float:
        """Return a time that the joints take to the goal, or a hundredth of a turn of one [s]."""
        rate = still.rates
        way = 0.01 if still.target.q is None else np.abs(still.target.q - self.start.q)
        return float(max(PEAK * (way / rate).max(), PEAK * 0.01 / rate.max()))

    @cached_property
    def _few(self) -> bool:
        """Whether the wheels have no axis along a part of the turns, so that joints must help."""
        planar = self.start.arm.tree.plane_normal() is not None
        return not planar and bool(np.linalg.matrix_rank(self.wheels.axes) < 3)

    @cached_property
    def _alone(self) -> Plan:
        return best_attempt(self.start, None, ())

    @cached_property
    def _held(self) -> float:
        """Momentum on board [N m s]."""
        return float(np.linalg.norm(self.momentum[3:])) or 1.0

    @cached_property
    def _speed(self) -> Array:
        """(3,) velocity of the system CM [m/s]."""
        return self.momentum[:3] / self.start.arm.mass
