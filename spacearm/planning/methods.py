"""The seven methods of planning: each takes a problem and returns rows that solve it, or fails.

A method that fails raises a NoSolutionError that says why.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, NoSolutionError
from spacearm.mechanics.floating import attitudes, placed
from spacearm.mechanics.jacobian import generalized_jacobian, turning_axes
from spacearm.model.arm import Configuration
from spacearm.motion.following import check_start, follow, how_it_ended
from spacearm.motion.goal import Goal, as_goal, goal_axes, goal_rows, miss, steady
from spacearm.motion.leading import straight_line
from spacearm.planning.guesses import ACROSS, CLOSE, Guess, GuessFinder
from spacearm.planning.many_curves import inverse_kinematics
from spacearm.planning.optimiser import ARRIVED, ITERATIONS, NEWTON_STEPS, CurveOptimiser, Target
from spacearm.planning.problem import InContactError, Problem, Rows, joints_of, travel
from spacearm.planning.roadmap import Roadmap
from spacearm.planning.timing import rest_to_rest_times
from spacearm.planning.tree import BOXES, by_boxes, by_tree, straight_rows

#: Sizes of the curves that are tried [rad].
WIDTHS = (0.3, 0.6, 1.0, 2.0)
#: Numbers of curves of each size that are tried at once: many where few do not do.
FEW, MANY = 75, 600
#: Postures about which loops are tried, in the first round and in later ones.
FIRST_PLACES, PLACES = 2, 8
#: Curves with a singularity on the way that are optimised, over the number of joints.
STARTS = 60
#: Guesses that are checked for contacts with obstacles, which takes long.
CHECKED = 40
#: Free guesses that are optimised, others, and solutions of which the shortest is taken.
TRIES, OTHERS, ENOUGH = 6, 2, 2
#: Curves to ends nearer to each other than this are much the same to the optimiser [rad], [m].
SAME = 0.1
#: Iterations of the optimiser in which the first of those others must succeed.
QUICK = 25
#: Attitudes about an axis from which the straight line is tried; steps of the turn to each.
TURNS, TURN_STEPS = 72, 24
#: Attitudes, nearest first, to which a motion is looked for.
NEAREST = 4


def straight(problem: Problem) -> Rows:
    """Lead the tip along a straight line by J*."""
    start, target = problem.start, problem.target
    problem.account.check_time()
    if np.linalg.norm(target.missed(start, start)) <= ARRIVED:
        return [start]
    if target.tip is None:
        raise NoSolutionError("the goal is in joint space; no line leads there")
    rows = _along_line(problem, start, target.tip)
    if np.linalg.norm(target.missed(start, rows[-1])) > ARRIVED:
        raise NoSolutionError("the line ends with another attitude of the spacecraft")
    return problem.check(rows)


def joint_space(problem: Problem) -> Rows:
    """Find the shortest joint curve that arrives, of the first few."""
    tries = list(itertools.product((FEW, MANY), WIDTHS))  # cheap ones first
    if problem.account.rounds == 0:  # a roadmap often does what these do not
        tries = tries[: len(WIDTHS) if problem.target.attitude is None else 2]
    finder = problem.guesses(problem.start, problem.target)
    mixed: list[list[Guess]] = []
    for m, width in tries:
        guesses = list(finder.curves(width, m))
        mixed += [guesses] if m == MANY else []
        free = [guess for guess in guesses if guess.room > problem.target.clearance]
        apart = _without_contact(problem, finder, _apart(free, problem.start.arm.n))
        others = [guess for guess in guesses[len(free) :] if m == MANY or guess.room != ACROSS]
        others = list(itertools.islice(_apart(others, problem.start.arm.n), OTHERS))
        for some, iterations in ((apart, ITERATIONS), (others, QUICK if m == FEW else ITERATIONS)):
            with suppress(_NoneDoesError):  # more may do
                return _optimised(problem, finder, some, iterations)
    best = [guess for same in itertools.zip_longest(*mixed) for guess in same if guess]
    if not best:
        found = problem.account.postures["usable"]
        raise NoSolutionError(
            f"{found} joint positions were found at the goal, and none of the curves tried leads "
            "to one of them"
            if found
            else "no joint positions that keep all constraints were found at the goal"
        )
    return _optimised(problem, finder, best[: STARTS // problem.start.arm.n])


def cycles(problem: Problem) -> Rows:
    """Repeat a closed loop in joint space as often as it takes, then follow a curve to the goal."""
    return _by_loops(problem, problem.target)


def roadmap(problem: Problem) -> Rows:
    """Repeat a loop of straight pieces as often as it takes, then go by a few to the goal."""
    return _by_loops(problem, problem.target, lambda finder: Roadmap(finder).guesses())


def attitude_first(problem: Problem) -> Rows:
    """Turn the spacecraft under the tip to where the line is free, then follow the line."""
    tip = problem.target.tip
    if tip is None or problem.target.attitude is not None:
        raise NoSolutionError("the goal is not only a place of the tip, to which a line could lead")
    free = []
    for turn, start in _turns_under_tip(problem):
        with suppress(NoSolutionError, ConfigurationError):
            problem.check(_along_line(problem, start, tip))
            free.append((turn, start))
    turns = ", ".join(turn for turn, _ in free)
    for _, start in free[:NEAREST]:
        target = problem.target._replace(tip=None, q=start.q, attitude=start.base.rotation)
        try:
            there = _by_loops(problem, target)
            rows = problem.check([*there, *_along_line(problem, there[-1], tip)[1:]])
        except NoSolutionError:
            continue
        problem.note = f"the line is free after turns of {turns}"
        return rows
    raise NoSolutionError(
        f"the line is free after turns of {turns}, which could not be made"
        if free
        else "the line is free from no attitude that the spacecraft can take under the tip"
    )


def _apart(guesses: Iterable[Guess], n: int) -> Iterator[Guess]:
    """Yield the first of those curves (without loops) that end in about the same posture (n,)."""
    ends = np.empty((0, n))
    for guess in guesses:
        if np.abs(ends - guess.x[:n]).max(axis=1).min(initial=np.inf) > SAME:
            ends = np.vstack((ends, guess.x[:n]))
            yield guess


class _NoneDoesError(NoSolutionError):
    """None of the guesses that were optimised is a solution."""


def _optimised(
    problem: Problem, finder: GuessFinder, guesses: Iterable[Guess], iterations: int = ITERATIONS
) -> Rows:
    """Return the shortest of the first few solutions that the optimiser makes of guesses.

    Raises:
        _NoneDoesError: There is none.
    """
    found: list[Rows] = []
    why = "none of the curves tried keeps all constraints"
    ways, contacts = problem.account.ways, problem.account.ways["contact"]
    for guess in guesses:
        try:
            met = ways["contact"] > contacts
            found.append(_solved(problem, finder, guess, iterations, met))
        except NoSolutionError as error:
            why = str(error)
            if isinstance(error.best, Sequence):
                problem.best = error.best
        if len(found) == ENOUGH:
            break
    if not found:
        raise _NoneDoesError(why, problem.best)
    return min(found, key=travel)


def _solved(
    problem: Problem, finder: GuessFinder, guess: Guess, iterations: int, met: bool
) -> Rows:
    """Return a solution that the optimiser makes of a guess, else the guess as it is.

    Bodies that may meet take the optimiser time. They count only where they met without, on this
    guess, or if it is free on one before it.

    Raises:
        NoSolutionError: Neither is a solution.
    """
    aim = min(problem.ample, guess.room) if guess.room > 0.0 else problem.ample
    target = finder.target._replace(clearance=max(aim, finder.target.clearance))
    bodies = None if problem.collisions and problem.collisions.obstacles else problem.collisions
    for counting in (bodies,) if met and guess.room > 0.0 else (None, bodies):
        problem.account.check_time()
        optimiser = CurveOptimiser(
            finder.start, target, guess.shape, guess.loops, problem.account.check_time, counting
        )
        try:
            return problem.check(optimiser.refine(optimiser.solve(guess.x, iterations)))
        except NoSolutionError as error:
            if guess.room <= 0.0 and not isinstance(error, InContactError):
                raise
            if not isinstance(error, InContactError):
                break
    return problem.check(optimiser.refine(guess.x))


def _by_loops(
    problem: Problem,
    target: Target,
    guesses_of: Callable[[GuessFinder], Iterator[Guess]] = GuessFinder.loops_and_lines,
) -> Rows:
    """Run through loops at the start, or after a straight motion to where loops turn more.

    Raises:
        NoSolutionError: No loop leads to the target.
    """
    why = ""
    for there in _loop_places(problem, target):
        before = float(rest_to_rest_times(joints_of(there), problem.rates)[-1])
        finder = problem.guesses(there[-1], target)
        try:
            guesses = _without_contact(problem, finder, guesses_of(finder), before)
            return [*there, *_optimised(problem, finder, guesses)[1:]]
        except NoSolutionError as error:
            why = why or str(error)
    raise NoSolutionError(why, problem.best)


def _loop_places(problem: Problem, target: Target) -> Iterator[Rows]:
    """Yield the motions to where loops are tried, that keep all constraints: the start first."""
    yield [problem.start]
    left = PLACES if problem.account.rounds else FIRST_PLACES
    for place in problem.guesses(problem.start, target).loop_places():
        with suppress(NoSolutionError):
            yield problem.check(problem.walk(problem.start, straight_rows(problem.start.q, place)))
            left -= 1
        if not left:
            return


def _without_contact(
    problem: Problem, finder: GuessFinder, guesses: Iterable[Guess], before: float = 0.0
) -> list[Guess]:
    """Return the first few guesses, begun at a time [s], in which no bodies meet."""
    start = finder.start
    among = problem.collisions is not None and problem.collisions.obstacles
    few = itertools.islice(guesses, CHECKED if among else None)
    apart = (g for g in few if problem.contact(start, finder.points(g), before) is None)
    return list(itertools.islice(apart, TRIES))


def _turns_under_tip(problem: Problem) -> list[tuple[str, Configuration]]:
    """Return turns of the spacecraft under a tip that stays, with the configuration after each.

    Inverse kinematics finds the joint positions step by step, so that they change continuously.
    """
    start, check_time = problem.start, problem.account.check_time
    axes = np.eye(3)[list(turning_axes(start.arm))]
    angles = np.pi * np.arange(1, TURNS // 2 + 1) / (TURNS // 2)
    angles = np.column_stack((angles, -angles)).ravel()
    w = (angles[:, None, None] * axes).reshape(-1, 3)
    Q = np.tile(start.q, (len(w), 1))
    tip = start.centred(np.zeros(3)).tip
    for share in np.arange(1, TURN_STEPS + 1) / TURN_STEPS:
        T = start.base.rotation @ Rotation.from_rotvec(share * w).as_matrix()
        Q, _, off = inverse_kinematics(start.arm, Q, tip, T, goal_axes(start), 4, check_time)
    there = (off < CLOSE) & (np.abs(Q - start.q).max(axis=1) < 2.0 * np.pi)
    return [
        (_in_words(w[i]), start.arm.at(Q[i], base=pin.SE3(T[i], np.zeros(3))).centred(start.com))
        for i in np.flatnonzero(there)
    ]


def _in_words(w: Array) -> str:
    """Describe a turn about one axis."""
    axis = int(np.abs(w).argmax())
    return f"{np.degrees(w[axis]):.0f} deg about {'xyz'[axis]}"


def _along_line(problem: Problem, start: Configuration, tip: pin.SE3) -> Rows:
    """Lead the tip straight to its goal, and make the end exact by Newton's method.

    Raises:
        NoSolutionError: The line meets a singularity or a limit.
    """
    limits = np.append(problem.target.lower, problem.target.upper)
    if np.linalg.norm(miss(start, tip)) <= ARRIVED:
        return [start]
    Q = _line(problem, start, as_goal(start, tip), bool(np.isfinite(limits).any()))
    ramp = np.linspace(0.0, 1.0, len(Q))[:, None]
    for _ in range(NEWTON_STEPS):
        problem.account.check_time()
        end = placed(start, Q[-1], attitudes(start, Q)[-1])
        left = miss(end, tip)
        if np.linalg.norm(left) <= ARRIVED:
            return problem.walk(start, Q)
        J = goal_rows(end, generalized_jacobian(end))
        Q = Q + ramp * np.linalg.lstsq(J, left, rcond=None)[0]
    raise NoSolutionError("the end of the line cannot be made exact", problem.walk(start, Q))


def _line(problem: Problem, start: Configuration, goal: Goal, limited: bool) -> Array:
    """Return joint positions (m, n) along the line, its end nearly exact.

    Raises:
        NoSolutionError: The line meets a singularity or a limit.
    """
    arm = start.arm
    if not steady(arm):  # the directions of the task turn on the way
        look = problem.account.check_time
        slow = follow(start, [goal], limits=limited, progress=lambda *_: look())
        if not slow.arrived:
            raise NoSolutionError(slow.reason, list(slow))
        return slow.q
    check_start(start, "free-floating", limited)
    line = straight_line(start, goal, limited)
    if line.end.kind != "arrived":
        why = how_it_ended(arm, line.tip, line.end.t, line.length, line.end)
        raise NoSolutionError(why, problem.walk(start, line.q))
    return line.q


#: In the order in which "auto" tries them, "boxes" only where some are given; with obstacles "tree"
#: after "straight", where contacts stop most ways before "roadmap".
METHODS: dict[str, Callable[[Problem], Rows]] = {
    "straight": straight,
    BOXES: by_boxes,
    "joint space": joint_space,
    "roadmap": roadmap,
    "cycles": cycles,
    "attitude first": attitude_first,
    "tree": by_tree,
}
