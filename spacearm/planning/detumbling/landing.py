"""Landing: the motion of joints and wheels bent until the spacecraft rests and the tip arrives.

Newton's method, each step of which is a linear program: the limits of joints and wheels are linear
in the heights of ramps and waves, so that they hold while the ends are led to the goal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.mechanics.floating import placed
from spacearm.model.arm import Configuration
from spacearm.planning.detumbling.bounds import Bounds
from spacearm.planning.detumbling.course import WAVES, Course
from spacearm.planning.drift.drifting import steered_attitudes
from spacearm.planning.optimiser import ARRIVED, CurveOptimiser, Target
from spacearm.planning.wheels.limits import Wheels

COARSE = 24
"""Steps of the motions whose ends give the derivative."""
TOGETHER = 16
"""Motions that are integrated between two looks at the clock."""
BENT = 1e-5
"""Height of a wave by which the end is differentiated, [rad], [m], or share of the momentum."""
STEPS = 40
"""Newton steps, at most."""
LONGEST, SHORTEST = 0.5, 1e-3
"""The largest of them in any height, likewise, and that below which the search ends."""
CLOSE = 1e-2
"""Residual from which on the least change comes first, which the limits allow for."""
STALLED, QUICK = 1.0 - 1e-6, 0.05
"""What the merit falls to at least in a step, and the error where the derivative is used again."""
MISS, OVER, BEND, SPIN = 300.0, 300.0, 0.1, 0.01
"""What a unit of the residual, of excess over the limits, and of a wave of joint or wheel costs."""


@dataclass(frozen=True)
class Landing:
    """The search for a motion that ends at rest.

    Attributes:
        start: Configuration at the start.
        target: What the motion must achieve besides.
        rates: (n,) largest joint rates [rad/s] or [m/s].
        wheels: The wheels.
        h: (3,) angular momentum about the system CM, inertial axes [N m s].
        steps: Steps of the integration.
        bend: Whether joints may go aside from ramps; wheels may.
        check_time: Called at every step; it may raise an error to end the search.
    """

    start: Configuration
    target: Target
    rates: Array
    wheels: Wheels
    h: Array
    steps: int
    bend: bool
    check_time: Callable[[], None]

    def landed(self, course: Course) -> Course:
        """Return a course near another that arrives within the limits of joints and wheels.

        Raises:
            NoSolutionError: None was found.
        """
        left, radius = self.residual(course), LONGEST
        slope = self._slope(course)
        for _ in range(STEPS):
            kept = self._bounds.excess(course) <= 0.0
            if kept and np.linalg.norm(left) <= ARRIVED:
                return course
            self.check_time()
            steps = [partial(self._step, course, left, slope, radius)]
            if kept and np.linalg.norm(left) < CLOSE:
                steps.insert(0, partial(self._last, left, slope))
            for step in steps:
                tried = replace(course, heights=course.heights + step())
                there = self.residual(tried)
                nearer = self._merit(tried, there) < STALLED * self._merit(course, left)
                if nearer:
                    break
            if nearer:
                quickly = np.linalg.norm(there) < QUICK * np.linalg.norm(left)
                course, left, radius = tried, there, min(LONGEST, 2.0 * radius)
                slope = slope if quickly else self._slope(course)
            elif (radius := radius / 4.0) < SHORTEST:
                break
        raise NoSolutionError(self._failure(course, left))

    def rows(self, course: Course) -> tuple[Array, list[Configuration]]:
        """Return shares of the duration (m,) and the configurations there."""
        u = np.linspace(0.0, 1.0, self.steps + 1)
        Q = course.at(u)[:, : self._n]
        T = self._attitudes([course], self.steps)[0]
        return u, [placed(self.start, q, R) for q, R in zip(Q, T, strict=True)]

    def residual(self, course: Course, steps: int | None = None) -> Array:
        """Return how far the end is from the goal and, over all, the momentum left [1]."""
        return self._residuals([course], steps or self.steps)[0]

    def _merit(self, course: Course, left: Array) -> float:
        G, g = self._bounds.rows(course)
        over = float((G @ course.heights.ravel() - g).max(initial=0.0))
        return MISS * float(np.abs(left).sum()) + OVER * over

    def _step(self, course: Course, left: Array, slope: Array, radius: float) -> Array:
        """Return the change of the heights that leads nearest to the goal within a radius.

        Variables of the linear program: the new heights, their absolute values, what is left of
        each row of the residual on either side, and the excess over the limits.
        """
        x, free = course.heights.ravel(), self._free
        G, g = self._bounds.rows(course)
        N, k = int(free.sum()), len(left)
        unit = self._units.ravel()[free]
        now = x[free] / unit
        A, S = (G * self._units.ravel())[:, free], (slope * self._units.ravel())[:, free]
        room = g - G[:, ~free] @ x[~free]
        one, none = np.eye(N), np.zeros
        sides = np.hstack((np.eye(k), -np.eye(k)))
        found = linprog(
            np.concatenate((none(N), self._costs, np.full(2 * k, MISS), [OVER])),
            A_ub=np.vstack((
                np.column_stack((A, none((len(A), N + 2 * k)), -np.ones(len(A)))),
                np.column_stack((one, -one, none((N, 2 * k + 1)))),
                np.column_stack((-one, -one, none((N, 2 * k + 1)))),
            )),
            b_ub=np.concatenate((room, none(2 * N))),
            A_eq=np.column_stack((S, none((k, N)), sides, none((k, 1)))),
            b_eq=S @ now - left,
            bounds=[
                *zip(now - radius, now + radius, strict=True), *[(0.0, None)] * (N + 2 * k + 1)
            ],
        )  # fmt: skip
        step = np.zeros(len(x))
        if found.x is not None:
            step[free] = (found.x[:N] - now) * unit
        return step.reshape(course.heights.shape)

    def _last(self, left: Array, slope: Array) -> Array:
        """Return the least change of the heights that leads to the goal, limits left aside."""
        unit = self._units.ravel() * self._free
        step = np.linalg.lstsq(slope * unit, -left)[0] * unit
        return np.asarray(step.reshape(self._units.shape))

    def _failure(self, course: Course, left: Array) -> str:
        used, bound, words = self._bounds.use(course)
        worst = int((used / bound).argmax())
        if used[worst] > bound[worst]:
            return f"in {course.duration:.4g} s {words[worst]}"
        return f"in {course.duration:.4g} s the end stays {np.linalg.norm(left):.1e} off"

    def _residuals(self, courses: list[Course], steps: int) -> Array:
        """Return the residuals (p, k) of courses."""
        n, T = self._n, self._attitudes(courses, steps)[:, -1]
        out = []
        for course, R in zip(courses, T, strict=True):
            end = course.start + course.heights[0]
            still = (R.T @ self.h - self.wheels.axes @ end[n:]) / self._scale
            there = self._judge.residual(placed(self.start, end[:n], R))
            out.append(np.append(there, still))
        return np.array(out)

    def _slope(self, course: Course) -> Array:
        """Return the derivative (k, size) of the residual by the heights."""
        unit = self._units.ravel()
        places = np.flatnonzero(self._free)
        courses = [course]
        for i in places:
            heights = course.heights.ravel().copy()
            heights[i] += BENT * unit[i]
            courses.append(replace(course, heights=heights.reshape(course.heights.shape)))
        steps = max(COARSE, self.steps // 2)
        parts = []
        for first in range(0, len(courses), TOGETHER):
            self.check_time()
            parts.append(self._residuals(courses[first : first + TOGETHER], steps))
        ends = np.vstack(parts)
        slope = np.zeros((ends.shape[1], len(unit)))
        slope[:, places] = (ends[1:] - ends[0]).T / (BENT * unit[places])
        return slope

    def _attitudes(self, courses: list[Course], steps: int) -> Array:
        """Return the attitudes (p, m, 3, 3) along courses of the same duration."""
        n, u = self._n, np.linspace(0.0, 1.0, 2 * steps + 1)
        at = np.array([course.at(u) for course in courses])
        rates = np.array([course.rates(u)[:, :n] for course in courses])
        held = at[:, :, n:] @ self.wheels.axes.T
        t = courses[0].duration * u[::2]
        T = self.start.base.rotation
        return steered_attitudes(self.start.arm, T, t, at[:, :, :n], rates, self.h, held)

    @cached_property
    def _bounds(self) -> Bounds:
        return Bounds(self.start, self.target, self.rates, self.wheels)

    @cached_property
    def _judge(self) -> CurveOptimiser:
        return CurveOptimiser(self.start, self.target, 1)

    @cached_property
    def _n(self) -> int:
        return self.start.arm.n

    @cached_property
    def _scale(self) -> float:
        """Momentum that counts as one [N m s]."""
        held = float(np.abs(self.wheels.start).max())
        return max(float(np.linalg.norm(self.h)), held) or 1.0

    @cached_property
    def _units(self) -> Array:
        """(1 + WAVES, n + w) unit of each height."""
        return np.tile(self._unit_row, (1 + WAVES, 1))

    @cached_property
    def _unit_row(self) -> Array:
        w = len(self.wheels.names)
        return np.concatenate((np.ones(self._n), np.full(w, self._scale)))

    @cached_property
    def _free(self) -> npt.NDArray[np.bool_]:
        """(size,) whether a height may change; the joints' ramps do not where they have a goal."""
        free = np.ones((1 + WAVES, self._n + len(self.wheels.names)), dtype=bool)
        free[0, : self._n] = self.target.q is None
        free[1:, : self._n] = self.bend
        return free.ravel()

    @cached_property
    def _costs(self) -> Array:
        """What a unit of each free height costs; ramps nothing."""
        each = np.append(np.full(self._n, BEND), np.full(len(self.wheels.names), SPIN))
        cost = np.outer(np.append(0.0, np.ones(WAVES)), each)
        return np.asarray(cost.ravel()[self._free])
