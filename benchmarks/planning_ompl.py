"""Planning problems given to a library of general motion planners: OMPL's RRT and RRT-Connect.

    pip install ompl
    python benchmarks/planning_ompl.py [FAMILY [NUMBER [TIMEOUT]]]

All planners get the problems of `benchmarks/planning.py`. The state of OMPL's trees is the extended
one, joints and attitude of the spacecraft. RRT's controls are joint rates; it stops where the tip
is within `NEAR` of the goal. RRT-Connect grows a second tree from the end of the known motion,
joints and attitude, which spacearm is not told. Its steps are straight in joint space and turn the
spacecraft as momentum has it; for want of an exact step between two states the trees join where
joints and attitude are led to within `NEAR`. OMPL takes no account of bodies; spacearm arrives, and
clear of contacts.
"""

from __future__ import annotations

import sys
import time
import warnings

import numpy as np
import pinocchio as pin
from ompl import base, control, geometric, util
from planning import Problem, UndrawnError, draw

import spacearm as sa
from spacearm.mechanics.floating import placed, walk

NUMBER, TIMEOUT = 20, 10.0
NEAR = 0.05
"""Distance at which OMPL has arrived, in arm lengths, an angle of so many radians likewise."""
RANGE, LEAST = 0.3, 0.01
"""Length of a step of RRT-Connect, in radians and parts of a quaternion, and the least [rad]."""
RATE, STEP, STEPS = 1.0, 0.05, (1, 10)
"""Largest joint rate [rad/s], a step of time [s], and how many of them one control lasts."""


class Miss(base.GoalRegion):
    """How far the tip is from its goal."""

    def __init__(self, information: control.SpaceInformation, problem: Problem) -> None:
        super().__init__(information)
        self.start, self.goal = problem.start, problem.goal
        self.length = float(np.linalg.norm(self.start.tip.translation - self.start.com))
        self.setThreshold(NEAR)

    def distanceGoal(self, state: base.State) -> float:
        """Return the distance in arm lengths and radians."""
        tip = configuration(self.start, state).tip
        if isinstance(self.goal, pin.SE3):
            turn = np.linalg.norm(pin.log3(self.goal.rotation.T @ tip.rotation))
            return float(
                np.linalg.norm(self.goal.translation - tip.translation) / self.length + turn
            )
        rows = self.start.arm.task.indices
        return float(np.linalg.norm(self.goal - tip.translation[rows]) / self.length)


def configuration(start: sa.Configuration, state: base.State) -> sa.Configuration:
    """Return the configuration of a state: n joint positions and a quaternion."""
    n = start.arm.n
    x = np.array([state[i] for i in range(n + 4)])
    return placed(start, x[:n], pin.Quaternion(x[n:] / np.linalg.norm(x[n:])).matrix())


def fill(state: base.State, cfg: sa.Configuration) -> None:
    """Write a configuration into a state; of the two quaternions that with w >= 0."""
    quaternion = pin.Quaternion(cfg.base.rotation).coeffs()
    for i, x in enumerate((*cfg.q, *quaternion * (1.0 if quaternion[3] >= 0.0 else -1.0))):
        state[i] = float(x)


def box(low: np.ndarray, high: np.ndarray) -> base.RealVectorBounds:
    """Return limits as OMPL has them."""
    bounds = base.RealVectorBounds(len(low))
    for i, (a, b) in enumerate(zip(low, high, strict=True)):
        bounds.setLow(i, float(a))
        bounds.setHigh(i, float(b))
    return bounds


def extended(arm: sa.SpaceArm, limited: bool) -> base.RealVectorStateSpace:
    """Return the space of joint positions and quaternions."""
    turn = 2.0 * np.pi * np.ones(arm.n)
    low, high = (
        (np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)) if limited else (-turn, turn)
    )
    space = base.RealVectorStateSpace(arm.n + 4)
    space.setBounds(box(np.append(low, [-1.0] * 4), np.append(high, [1.0] * 4)))
    return space


def lead(cfg: sa.Configuration, q: np.ndarray) -> sa.Configuration:
    """Return where a straight step in joint space ends, with the spacecraft turning."""
    return walk(cfg, np.stack((cfg.q, q)))[-1]


def by_rrt(problem: Problem, timeout: float, limited: bool) -> bool:
    """Whether OMPL's RRT brings the tip near its goal in time."""
    start, arm = problem.start, problem.start.arm
    space = extended(arm, limited)
    rates = control.RealVectorControlSpace(space, arm.n)
    rates.setBounds(box(np.full(arm.n, -RATE), np.full(arm.n, RATE)))
    setup = control.SimpleSetup(rates)
    information = setup.getSpaceInformation()

    def propagate(state: base.State, u: control.Control, h: float, result: base.State) -> None:
        cfg = configuration(start, state)
        fill(result, lead(cfg, cfg.q + h * np.array([u[i] for i in range(arm.n)])))

    setup.setStatePropagator(propagate)
    setup.setStateValidityChecker(information.satisfiesBounds)
    information.setPropagationStepSize(STEP)
    information.setMinMaxControlDuration(*STEPS)
    first = space.allocState()
    fill(first, start)
    setup.setStartState(first)
    setup.setGoal(Miss(information, problem))
    setup.setPlanner(control.RRT(information))
    setup.solve(timeout)
    return bool(setup.haveExactSolutionPath())


class Steps(base.MotionValidator):
    """Steps of RRT-Connect, of which it knows two ends, one in a tree and one that it asks for.

    OMPL asks for a state at `RANGE` on the line to another, or for that other state where it is
    nearer, by which trees join. The first is moved to where momentum leads; the second is refused
    unless momentum leads to within `NEAR`.
    """

    def __init__(self, information: base.SpaceInformation, start: sa.Configuration) -> None:
        super().__init__(information)
        self.information, self.start, self.known = information, start, set[bytes]()

    def checkMotion(self, first: base.State, second: base.State) -> bool:
        """Whether there is such a step; it is reversible, so that its direction is no matter."""
        ends = [self._numbers(state) for state in (first, second)]
        old, new = (first, second) if ends[0].tobytes() in self.known else (second, first)
        wanted = configuration(self.start, new)
        led = lead(configuration(self.start, old), wanted.q)
        if np.linalg.norm(ends[1] - ends[0]) < RANGE * (1.0 - 1e-9):
            return bool(np.linalg.norm(pin.log3(led.base.rotation.T @ wanted.base.rotation)) < NEAR)
        fill(new, led)
        where = self._numbers(new).tobytes()
        if where in self.known or np.linalg.norm(led.q - configuration(self.start, old).q) < LEAST:
            return False  # else a tree is led there for ever
        self.known.add(where)
        return bool(self.information.satisfiesBounds(new))

    def _numbers(self, state: base.State) -> np.ndarray:
        return np.array([state[i] for i in range(self.start.arm.n + 4)])


def by_rrt_connect(problem: Problem, timeout: float, limited: bool) -> bool:
    """Whether OMPL's RRT-Connect joins start and end in time."""
    setup = geometric.SimpleSetup(extended(problem.start.arm, limited))
    information = setup.getSpaceInformation()
    steps = Steps(information, problem.start)
    ends = [setup.getStateSpace().allocState() for _ in range(2)]
    for state, cfg in zip(ends, (problem.start, problem.end), strict=True):
        fill(state, cfg)
        steps.known.add(steps._numbers(state).tobytes())
    information.setMotionValidator(steps)
    setup.setStateValidityChecker(information.satisfiesBounds)
    setup.setStartAndGoalStates(*ends, NEAR)
    planner = geometric.RRTConnect(information)
    planner.setRange(RANGE)
    setup.setPlanner(planner)
    setup.solve(timeout)
    return bool(setup.haveExactSolutionPath())


def by_spacearm(problem: Problem, timeout: float, limited: bool) -> bool:
    """Whether spacearm arrives in time."""
    start = problem.start
    try:
        sa.plan(
            start,
            problem.goal,
            constraints=sa.Constraints(limits=limited),
            search=sa.Search(timeout=timeout),
            **problem.asked,
        )
    except sa.NoSolutionError:
        return False
    return True


def report(family: str, number: int, timeout: float) -> None:
    """Print how many problems each planner solves, and the median time of those."""
    planners = {
        "spacearm": by_spacearm, "OMPL's RRT": by_rrt, "OMPL's RRT-Connect": by_rrt_connect
    }  # fmt: skip
    taken: dict[str, list[float]] = {name: [] for name in planners}
    drawn = 0
    for i in range(number):
        try:
            problem = draw(family, i)
        except UndrawnError:
            continue
        drawn += 1
        for name, solve in planners.items():
            begun = time.perf_counter()
            if solve(problem, timeout, not family.startswith("planar")):
                taken[name].append(time.perf_counter() - begun)
    for name, seconds in taken.items():
        median = f"median {np.median(seconds):.2f} s" if seconds else "none in time"
        print(f"{family}, {name}: {len(seconds)} of {drawn} in {timeout:g} s each, {median}")


if __name__ == "__main__":
    warnings.simplefilter("ignore", sa.ModelWarning)
    util.noOutputHandler()
    util.RNG.setSeed(1)
    chosen, number, timeout = (*sys.argv[1:], "", "", "")[:3]
    for name in [chosen] if chosen else ["planar2", "planar3", "mda6", "chaser7 position"]:
        report(name, int(number or NUMBER), float(timeout or TIMEOUT))
