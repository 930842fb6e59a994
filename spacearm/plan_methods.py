"""The four ways to a goal: each takes a problem and gives a motion, or says why it cannot."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.configuration import Configuration
from spacearm.errors import ConfigurationError, NoSolutionError
from spacearm.following import Followed, follow
from spacearm.goal import miss
from spacearm.jacobian import generalized_jacobian
from spacearm.joint_space import ARRIVED, LANDINGS, Steering, Task
from spacearm.plan import walk
from spacearm.singularity import singular_values

Motion = list[Configuration]

WAVES = 3
LOOPS = (1, 2, 4, 8)
"""How many times a loop is run through."""
STARTS, CYCLE_STARTS, TURN_STARTS = 20, 12, 4
"""First guesses of the optimiser, for each number of loops."""
ENOUGH = 2
"""Curves of which the shortest is taken."""
AGAIN = 10.0
"""How much more clearance is aimed at where it was lost between the samples of a curve."""
REACHES = 40
"""Steps by which the tip is brought to a pose."""
AMPLE = 0.3
"""Share of the first guesses that aim at ample clearance."""
TURNS = 24
"""Attitudes about an axis from which the straight line is tried."""
TRIES = 4
"""Of the free ones the nearest that are steered to."""


@dataclass
class Problem:
    """What is to be planned.

    Attributes:
        start: Where the motion begins.
        task: What it must achieve.
        ample: Clearance that is aimed at first.
        seed: Of the first guesses.
        deadline: `time.monotonic` at which the search is given up.
        best: The best attempt so far that is no solution.
    """

    start: Configuration
    task: Task
    ample: float
    seed: int
    deadline: float
    best: Motion | None = field(default=None)

    def checked(self, motion: Motion) -> Motion:
        """A motion that arrives, if it keeps clearance and limits.

        Raises:
            NoSolutionError: It does not.
        """
        sigma = [singular_values(cfg)[-1] for cfg in motion]
        worst = int(np.argmin(sigma))
        if sigma[worst] < self.task.clearance:
            raise NoSolutionError(
                f"sigma_min falls to {sigma[worst]:.2g} at q = {_numbers(motion[worst].q)}, below "
                f"the clearance of {self.task.clearance:.2g}"
            )
        q = np.array([cfg.q for cfg in motion])
        over = np.maximum(q - self.task.upper, self.task.lower - q).max(axis=0)
        if over.max() > 1e-9:
            name = self.start.arm.joint_names[int(over.argmax())]
            raise NoSolutionError(f"joint {name!r} goes {over.max():.2g} beyond its limit")
        return motion

    def in_time(self) -> None:
        """Raises NoSolutionError once the time is up."""
        if time.monotonic() > self.deadline:
            raise NoSolutionError("the time is up (timeout)", self.best)


def straight(problem: Problem) -> Motion:
    """The line of the tip by J*."""
    if problem.task.tip is None:
        raise NoSolutionError("the goal is in joint space, no line leads there")
    motion = _along_line(problem, problem.start, problem.task.tip)
    if problem.task.attitude is not None:
        left = Steering(problem.start, problem.task, 1).left(motion[-1])
        if np.linalg.norm(left) > ARRIVED:
            raise NoSolutionError("the line ends with another attitude of the spacecraft")
    return problem.checked(motion)


def joint_space(problem: Problem) -> Motion:
    """The shortest joint curve that arrives, of the first few that are found."""
    return _steered(problem, problem.task, (0,), STARTS)


def cycles(problem: Problem) -> Motion:
    """A closed loop in joint space, run through as often as it takes, and a curve to the goal."""
    return _steered(problem, problem.task, LOOPS, CYCLE_STARTS)


def attitude_first(problem: Problem) -> Motion:
    """The spacecraft turned under the tip to where the line is free, then the line."""
    tip = problem.task.tip
    if tip is None or problem.task.attitude is not None:
        raise NoSolutionError("the goal is not only a place of the tip, to which a line could lead")
    free = _free_turns(problem, tip)
    for _, start in free[:TRIES]:
        task = problem.task._replace(tip=None, q=start.q, attitude=start.base.rotation)
        try:
            there = _steered(problem, task, (0, *LOOPS), TURN_STARTS)
            return problem.checked(there + _along_line(problem, there[-1], tip)[1:])
        except NoSolutionError:
            continue
    turns = ", ".join(f"{np.degrees(angle):.0f}" for angle, _ in free)
    raise NoSolutionError(
        f"the line is free after turns of {turns} deg, which could not be made"
        if free
        else "the line is free from no attitude that the spacecraft can take under the tip"
    )


def _steered(problem: Problem, task: Task, loops: Sequence[int], starts: int) -> Motion:
    """The shortest of the first few motions that the optimiser finds."""
    found: list[Motion] = []
    why = "no curve keeps all constraints"
    rng, wide = np.random.default_rng(problem.seed), starts * len(loops)
    for i, number in enumerate(n for _ in range(starts) for n in loops):
        problem.in_time()
        aim = max(task.clearance, problem.ample if i < AMPLE * wide else 0.0)
        x = None
        for clearance in (aim, AGAIN * aim):  # the second where it was lost between samples
            steering = Steering(problem.start, task._replace(clearance=clearance), WAVES, number)
            guess = _guess(steering, 0.2 + 0.8 * i / wide, rng) if x is None else x
            x, met = steering.solve(guess)
            if not met:
                break
            try:
                found.append(problem.checked(steering.arrive(x)))
                break
            except NoSolutionError as error:
                why = str(error)
        if len(found) == ENOUGH:
            break
    if not found:
        raise NoSolutionError(f"{why} ({wide} first guesses)", problem.best)
    return min(found, key=_travel)


def _guess(steering: Steering, width: float, rng: np.random.Generator) -> Array:
    """A first guess, the wider the farther from the start.

    Its end is where the tip would be right if the spacecraft had turned a little.
    """
    start, task, n = steering.start, steering.task, steering.arm.n
    x = width * rng.normal(size=steering.size)
    turn = pin.exp3(0.5 * width * rng.normal(size=3) * steering.turning)
    if task.q is not None:
        x[:n] = task.q
        return x
    low, high = np.maximum(task.lower, start.q - np.pi), np.minimum(task.upper, start.q + np.pi)
    x[:n] = np.clip(start.q + 2.0 * x[:n], low, high)
    if task.tip is not None:
        attitude = start.base.rotation @ turn if task.attitude is None else task.attitude
        cfg = start.arm.at(x[:n], pin.SE3(attitude, np.zeros(3))).centred(start.com)
        x[:n] = np.clip(_brought(cfg, task.tip).q, task.lower, task.upper)
    return x


def _brought(cfg: Configuration, tip: pin.SE3) -> Configuration:
    """The tip brought to a pose as near as may be, the attitude held."""
    rows = cfg.arm.task.indices
    for _ in range(REACHES):
        J, left = generalized_jacobian(cfg, "attitude-controlled")[rows], miss(cfg, tip)
        damping = 1e-3 + 0.1 * min(1.0, float(np.linalg.norm(left)))
        step = J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(len(rows)), left)
        step *= min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-12))
        cfg = cfg.arm.at(cfg.q + step, cfg.base).centred(cfg.com)
        if np.linalg.norm(left) < 1e-9:
            break
    return cfg


def _free_turns(problem: Problem, tip: pin.SE3) -> list[tuple[float, Configuration]]:
    """Turns [rad] under the tip after which the line is free, the least first."""
    normal = problem.start.arm.tree.plane_normal()
    axes = np.eye(3) if normal is None else np.eye(3)[[normal]]
    free = []
    for angle in np.pi * np.arange(1, TURNS // 2 + 1) / (TURNS // 2):
        for signed, axis in ((sign * angle, axis) for axis in axes for sign in (1.0, -1.0)):
            problem.in_time()
            try:
                start = _turn_under_tip(problem, signed * axis)
                problem.checked(_along_line(problem, start, tip))
            except (NoSolutionError, ConfigurationError):
                continue
            free.append((float(signed), start))
    return free


def _turn_under_tip(problem: Problem, w: Array) -> Configuration:
    """The spacecraft turned while the tip stays, the joints following step by step."""
    cfg, tip, steps = problem.start, problem.start.tip, 24
    for _ in range(steps):
        turned = pin.SE3(cfg.base.rotation @ pin.exp3(w / steps), np.zeros(3))
        cfg = _brought(cfg.arm.at(cfg.q, turned).centred(problem.start.com), tip)
    if np.linalg.norm(miss(cfg, tip)) > 1e-6 or np.abs(cfg.q - problem.start.q).max() > 2 * np.pi:
        raise NoSolutionError("the tip cannot stay there at this attitude")
    return cfg


def _travel(motion: Motion) -> float:
    return float(np.abs(np.diff([cfg.q for cfg in motion], axis=0)).sum())


def _numbers(q: Array) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in q) + ")"


def _along_line(problem: Problem, start: Configuration, tip: pin.SE3) -> Motion:
    """The tip straight to its goal, its end made exact.

    Raises:
        NoSolutionError: The line meets a singularity or a limit.
    """
    limited = bool(np.isfinite(problem.task.lower).any() or np.isfinite(problem.task.upper).any())
    rows = start.arm.task.indices
    goal = tip if max(rows) > 2 else tip.translation[rows]
    line: Followed = follow(start.arm, start.q, [goal], base=start.base, limits=limited)
    if not line.arrived:
        raise NoSolutionError(line.reason, [line.at(i) for i in range(len(line.t))])
    Q = line.q
    ramp = np.linspace(0.0, 1.0, len(Q))[:, None]
    for _ in range(LANDINGS):
        motion = walk(start, Q)
        left = miss(motion[-1], tip)
        if np.linalg.norm(left) <= ARRIVED:
            return motion
        J = generalized_jacobian(motion[-1])[rows]
        Q = Q + ramp * np.linalg.lstsq(J, left, rcond=None)[0]
    raise NoSolutionError("the end of the line cannot be made exact", motion)
