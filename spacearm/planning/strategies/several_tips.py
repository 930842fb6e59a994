"""Several tips: led to their goals at once, at zero momentum.

The tips follow straight lines if the stacked J* allows. Else the unknowns are the end q_1 of curves
q_0 + s (q_1 - q_0) + sin(pi s) c with a random c; the equations are that all tips arrive with the
attitude that the whole curve makes, solved by Newton's method. Bounds are as for one tip.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError, UnsupportedError
from spacearm.mechanics.floating import attitudes, walk
from spacearm.planning.optimiser import ARRIVED, SPACING
from spacearm.planning.problem import Problem, Rows, travel
from spacearm.planning.request import PlanRequest
from spacearm.planning.result import Plan
from spacearm.planning.strategies.at_rest import by_methods
from spacearm.planning.strategies.resolved_motion import Aim, Bias, Resolved

#: Sizes of the first guesses of joint motions [rad], [m], one after the other.
WIDTHS = (0.5, 1.0, 2.0, 3.0)
#: Size of the curves' sines over that of the motions; every second one is straight.
BENT = 0.5
#: Newton steps to the end of a curve, at most, and the longest of them [rad], [m].
STEPS, LONGEST = 30, 0.5
#: Rows of a curve while its end is sought.
COARSE = 40
#: Curves tried in the first round, and in each after it.
FIRST, NEXT = 20, 60


def several_tips(request: PlanRequest) -> Plan:
    """Return a plan at zero momentum that leads several tips to their goals.

    Raises:
        ConfigurationError: A method for one tip is asked for.
        UnsupportedError: An attitude at the end is asked for.
        NoSolutionError: None was found; carries the best attempt.
        StoppedError: Ctrl-C; carries the best attempt.
    """
    if request.final_attitude is not None:
        raise UnsupportedError("several tips end with any attitude; leave out final_attitude")
    problem = Problem.of(request)
    aims = [Aim(*aim) for aim in request.aims.values()]
    resolved = Resolved(aims, (problem.target.lower, problem.target.upper))
    methods = {"straight": _straight, "joint space": _joint_space}
    return by_methods(
        problem, {name: partial(method, resolved=resolved) for name, method in methods.items()}
    )


def _straight(problem: Problem, resolved: Resolved) -> Rows:
    """Lead the tips along straight lines."""
    n = problem.start.arm.n
    firm = np.inf if problem.keep is not None else 0.0
    led = resolved.led(Bias(np.zeros(n), np.ones(n), firm), problem.stopped)
    return problem.check(walk(problem.start, np.array([cfg.q for cfg in led])))


def _joint_space(problem: Problem, resolved: Resolved) -> Rows:
    """Move the joints along a curve, the shortest of those that a round finds."""
    rng, postures, target = problem.rng, problem.account.postures, problem.target
    found: list[Rows] = []
    why = "no curve was found that leads all tips to their goals"
    for i in range(NEXT if problem.account.rounds else FIRST):
        width = WIDTHS[i % len(WIDTHS)]
        guess, bend = rng.normal(scale=width, size=(2, problem.start.arm.n))
        curve = _landed(problem, resolved, guess, BENT * bend * (i // len(WIDTHS) % 2))
        postures["tried"] += 1
        if curve is None:
            continue
        postures["reached"] += 1
        if ((curve > target.upper) | (curve < target.lower)).any():
            postures["limits"] += 1
            continue
        if problem.collisions is not None and problem.collisions.touch(curve[-1]):
            postures["contact"] += 1
            continue
        postures["usable"] += 1
        try:
            found.append(problem.check(walk(problem.start, curve)))
        except NoSolutionError as error:
            why = str(error)
    if not found:
        raise NoSolutionError(why, problem.best)
    return min(found, key=travel)


def _landed(problem: Problem, resolved: Resolved, way: Array, bend: Array) -> Array | None:
    """Return the rows (m, n) of a curve that arrives; None if there is none nearby.

    Args:
        problem: The problem.
        resolved: The tips and their goals.
        way: (n,) the first guess of the joint motion.
        bend: (n,) coefficients of the sine.
    """
    start = problem.start
    end = np.clip(start.q + way, problem.target.lower, problem.target.upper)
    length = np.abs(np.diff(_curve(start.q, end, bend, COARSE), axis=0)).sum()
    for _ in range(STEPS):
        problem.account.check_time()
        curve = _curve(start.q, end, bend, max(COARSE, math.ceil(length / SPACING)))
        left, J = resolved.rows(end, attitudes(resolved.start, curve)[-1], 1.0)
        if np.abs(left).max() <= ARRIVED:
            return curve
        step = np.linalg.lstsq(J, left)[0]
        end = end + step * min(1.0, LONGEST / np.abs(step).max())
    return None


def _curve(start: Array, end: Array, bend: Array, m: int) -> Array:
    """Return the rows (m + 1, n) of a curve."""
    s = np.linspace(0.0, 1.0, m + 1)[:, None]
    return start + s * (end - start) + np.sin(np.pi * s) * bend
