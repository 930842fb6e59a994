"""The four ways to a goal: each takes a problem and gives a motion, or says why it cannot."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, NoSolutionError
from spacearm.mechanics.floating import walk
from spacearm.mechanics.jacobian import generalized_jacobian
from spacearm.model.configuration import Configuration
from spacearm.motion.following import Followed, follow
from spacearm.motion.goal import as_goal, goal_axes, in_rows, miss
from spacearm.planning.guesses import CLOSE, Guess, Search
from spacearm.planning.many_curves import landed, turning_axes
from spacearm.planning.optimiser import ARRIVED, LANDINGS, SPACING, Steering, Task
from spacearm.planning.problem import WAVES, Motion, Problem

WIDTHS = (0.3, 0.6, 1.0, 2.0)
"""How far curves go about [rad]."""
HUBS = 8
"""Places where loops are tried."""
STARTS = 60
"""Curves that are no motions yet but may be made ones, over the number of joints."""
TRIES, ENOUGH = 6, 2
"""Guesses that are optimised, and motions of which the shortest is taken."""
TURNS, TURN_STEPS = 72, 24
"""Attitudes about an axis from which the straight line is tried."""
NEAREST = 4
"""Of the free ones the nearest that are steered to."""


def straight(problem: Problem) -> Motion:
    """The line of the tip by J*."""
    steering = Steering(problem.start, problem.task, 1)
    if np.linalg.norm(steering.left(problem.start)) <= ARRIVED:
        return [problem.start]
    if problem.task.tip is None:
        raise NoSolutionError("the goal is in joint space, no line leads there")
    motion = _along_line(problem, problem.start, problem.task.tip)
    if np.linalg.norm(steering.left(motion[-1])) > ARRIVED:
        raise NoSolutionError("the line ends with another attitude of the spacecraft")
    return problem.checked(motion)


def joint_space(problem: Problem) -> Motion:
    """The shortest joint curve that arrives, of the first few that are found."""
    search = problem.search(problem.start, problem.task)
    tries = []
    for width in WIDTHS:
        problem.in_time()
        tries.append(list(search.direct(width)))
    mixed = [guess for same in itertools.zip_longest(*tries) for guess in same if guess]
    if not mixed:
        raise NoSolutionError("no joint positions, clear of singularities, were found at the goal")
    free = (guess for guess in mixed if guess.room > problem.task.clearance)
    apart = _apart(problem, search, free)
    return _steered(problem, search, apart or mixed[: STARTS // problem.start.arm.n])


def cycles(problem: Problem) -> Motion:
    """A closed loop in joint space, run through as often as it takes, and a curve to the goal."""
    return _turned(problem, problem.task)


def attitude_first(problem: Problem) -> Motion:
    """The spacecraft turned under the tip to where the line is free, then the line."""
    tip = problem.task.tip
    if tip is None or problem.task.attitude is not None:
        raise NoSolutionError("the goal is not only a place of the tip, to which a line could lead")
    free = _free_turns(problem, tip)
    turns = ", ".join(turn for turn, _ in free)
    for _, start in free[:NEAREST]:
        task = problem.task._replace(tip=None, q=start.q, attitude=start.base.rotation)
        try:
            there = _turned(problem, task)
            motion = problem.checked(there + _along_line(problem, there[-1], tip)[1:])
        except NoSolutionError:
            continue
        problem.note = f"the line is free after turns of {turns}"
        return motion
    raise NoSolutionError(
        f"the line is free after turns of {turns}, which could not be made"
        if free
        else "the line is free from no attitude that the spacecraft can take under the tip"
    )


def _steered(problem: Problem, search: Search, guesses: Iterable[Guess]) -> Motion:
    """The shortest of the first few motions that the optimiser makes of guesses.

    Raises:
        NoSolutionError: There is none.
    """
    found: list[Motion] = []
    why = "none of the curves tried keeps all constraints"
    for guess in guesses:
        problem.in_time()
        aim = min(problem.ample, guess.room) if guess.room > 0.0 else problem.ample
        task = search.task._replace(clearance=max(aim, search.task.clearance))
        steering = Steering(search.start, task, WAVES, guess.loops)
        x, met = steering.solve(guess.x, problem.in_time)
        for unknowns, usable in ((x, met), (guess.x, guess.room > 0.0)):
            if not usable:
                continue
            try:
                found.append(problem.checked(steering.arrive(unknowns)))
                break
            except NoSolutionError as error:
                problem.in_time()
                why = str(error)
                if isinstance(error.best, list):
                    problem.best = error.best
        if len(found) == ENOUGH:
            break
    if not found:
        raise NoSolutionError(why, problem.best)
    return min(found, key=_travel)


def _turned(problem: Problem, task: Task) -> Motion:
    """Loops where the joints are, or after a straight motion to where loops turn more."""
    why = ""
    for hub in _places(problem, task):
        if problem.contact(np.array([problem.start.q, hub])) is not None:
            continue
        there = walk(problem.start, _line(problem.start.q, hub))
        search = problem.search(there[-1], task)
        try:
            guesses = _apart(problem, search, search.looped())
            return there + _steered(problem, search, guesses)[1:]
        except NoSolutionError as error:
            why = why or str(error)
    raise NoSolutionError(f"{why} ({HUBS} places for loops)", problem.best)


def _places(problem: Problem, task: Task) -> Iterator[Array]:
    """Where loops are tried, (n,) each."""
    yield problem.start.q
    problem.in_time()
    yield from problem.search(problem.start, task).hubs(HUBS)


def _apart(problem: Problem, search: Search, guesses: Iterable[Guess]) -> list[Guess]:
    """The first few guesses in which no bodies meet."""
    apart = (g for g in guesses if problem.contact(search.points(g)) is None)
    return list(itertools.islice(apart, TRIES))


def _line(start: Array, end: Array) -> Array:
    """(m, n) rows of a straight motion; only the start where it goes nowhere."""
    steps = math.ceil(float(np.abs(end - start).sum()) / SPACING)
    return start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - start)


def _free_turns(problem: Problem, tip: pin.SE3) -> list[tuple[str, Configuration]]:
    """Turns under the tip after which the line is free, the least first."""
    free = []
    for turn, start in _turns_under_tip(problem.start):
        problem.in_time()
        try:
            problem.checked(_along_line(problem, start, tip))
        except (NoSolutionError, ConfigurationError):
            continue
        free.append((turn, start))
    return free


def _turns_under_tip(start: Configuration) -> list[tuple[str, Configuration]]:
    """The spacecraft turned while the tip stays, the joints following step by step."""
    axes = np.eye(3)[list(turning_axes(start.arm))]
    angles = np.pi * np.arange(1, TURNS // 2 + 1) / (TURNS // 2)
    angles = np.column_stack((angles, -angles)).ravel()
    w = (angles[:, None, None] * axes).reshape(-1, 3)
    Q = np.tile(start.q, (len(w), 1))
    tip = pin.SE3(start.tip.rotation, start.tip.translation - start.com)
    for share in np.arange(1, TURN_STEPS + 1) / TURN_STEPS:
        T = start.base.rotation @ Rotation.from_rotvec(share * w).as_matrix()
        Q, off = landed(start.arm, Q, tip, T, goal_axes(start), 4)
    there = (off < CLOSE) & (np.abs(Q - start.q).max(axis=1) < 2.0 * np.pi)
    return [
        (_turn(w[i]), start.arm.at(Q[i], base=pin.SE3(T[i], np.zeros(3))).centred(start.com))
        for i in np.flatnonzero(there)
    ]


def _turn(w: Array) -> str:
    """A turn about one axis."""
    axis = int(np.abs(w).argmax())
    return f"{np.degrees(w[axis]):.0f} deg about {'xyz'[axis]}"


def _travel(motion: Motion) -> float:
    return float(np.abs(np.diff([cfg.q for cfg in motion], axis=0)).sum())


def _along_line(problem: Problem, start: Configuration, tip: pin.SE3) -> Motion:
    """The tip straight to its goal, its end made exact.

    Raises:
        NoSolutionError: The line meets a singularity or a limit.
    """
    limited = bool(np.isfinite(problem.task.lower).any() or np.isfinite(problem.task.upper).any())
    if np.linalg.norm(miss(start, tip)) <= ARRIVED:
        return [start]
    goal = as_goal(start, tip)
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
        J = in_rows(motion[-1], generalized_jacobian(motion[-1]))
        Q = Q + ramp * np.linalg.lstsq(J, left, rcond=None)[0]
    raise NoSolutionError("the end of the line cannot be made exact", motion)
