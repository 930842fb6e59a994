"""Planning problems given to a general motion planner, OMPL's RRT for systems with controls.

    pip install ompl
    python benchmarks/planning_ompl.py [FAMILY [NUMBER [TIMEOUT]]]

Both planners get the problems of `benchmarks/planning.py`. The state of OMPL's tree is the extended
one, joints and attitude of the spacecraft; its controls are joint rates, and a step turns the
spacecraft as momentum has it. RRT-Connect needs a way to lead one state to another exactly, which
there is none for: n rates lead n joints and three angles. OMPL stops where the tip is within
`NEAR` of the goal, and takes no account of bodies; spacearm arrives, and clear of contacts.
"""

from __future__ import annotations

import sys
import time
import warnings

import numpy as np
import pinocchio as pin
from ompl import base, control, util
from planning import Problem, UndrawnError, draw

import spacearm as sa
from spacearm.mechanics.floating import placed, walk

NUMBER, TIMEOUT = 20, 10.0
NEAR = 0.05
"""Distance at which OMPL has arrived, in arm lengths, an angle of so many radians likewise."""
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


def by_ompl(problem: Problem, timeout: float, limited: bool) -> bool:
    """Whether OMPL's RRT brings the tip near its goal in time."""
    start, arm = problem.start, problem.start.arm
    low = np.maximum(arm.lower, -np.pi) if limited else np.full(arm.n, -2.0 * np.pi)
    high = np.minimum(arm.upper, np.pi) if limited else np.full(arm.n, 2.0 * np.pi)
    space, bounds = base.RealVectorStateSpace(arm.n + 4), base.RealVectorBounds(arm.n + 4)
    for i, (a, b) in enumerate(zip((*low, *[-1.0] * 4), (*high, *[1.0] * 4), strict=True)):
        bounds.setLow(i, float(a))
        bounds.setHigh(i, float(b))
    space.setBounds(bounds)
    rates, limits = control.RealVectorControlSpace(space, arm.n), base.RealVectorBounds(arm.n)
    limits.setLow(-RATE)
    limits.setHigh(RATE)
    rates.setBounds(limits)
    setup = control.SimpleSetup(rates)
    information = setup.getSpaceInformation()

    def propagate(state: base.State, u: control.Control, h: float, result: base.State) -> None:
        cfg = configuration(start, state)
        dq = np.array([u[i] for i in range(arm.n)])
        fill(result, walk(cfg, np.stack((cfg.q, cfg.q + h * dq)))[-1])

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


def report(family: str, number: int, timeout: float) -> None:
    """Print how many problems each planner solves, and the median time of those."""
    taken: dict[str, list[float]] = {"spacearm": [], "OMPL's RRT": []}
    drawn = 0
    for i in range(number):
        try:
            problem = draw(family, i)
        except UndrawnError:
            continue
        drawn += 1
        limited = not family.startswith("planar")
        begun = time.perf_counter()
        try:
            sa.plan(
                problem.start.arm, problem.start.q, problem.goal, base=problem.start.base,
                limits=limited, timeout=timeout, **problem.asked,
            )  # fmt: skip
            taken["spacearm"].append(time.perf_counter() - begun)
        except sa.NoSolutionError:
            pass
        begun = time.perf_counter()
        if by_ompl(problem, timeout, limited):
            taken["OMPL's RRT"].append(time.perf_counter() - begun)
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
