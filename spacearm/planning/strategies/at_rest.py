"""At rest: a plan at zero momentum for tips or the joints, by the first method that finds one.

Unknowns are the joint positions along the way; the spacecraft turns with them by (33c), w_0 = -D^-1
D_q dq. Equations: the tip, the joints or the attitude of the spacecraft at the end. Bounds: joint
limits, clearance from the singular set, distance between bodies, turn of the spacecraft.

Several tips follow straight lines if the stacked J* allows. Else the unknowns are the end q_1 of
curves q_0 + s (q_1 - q_0) + sin(pi s) c with a random c. The equations are that all tips arrive
with the attitude that the whole curve makes, solved by Newton's method.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError, UnsupportedError, require_known
from spacearm.mechanics.floating import attitudes, walk
from spacearm.planning.account import Attempts, SearchAccount
from spacearm.planning.methods import METHODS
from spacearm.planning.optimiser import ARRIVED, SPACING
from spacearm.planning.problem import Problem, Rows, travel
from spacearm.planning.request import PlanRequest
from spacearm.planning.result import Plan, best_attempt, landed
from spacearm.planning.strategies.resolved_motion import Aim, Bias, Resolved, reactionless
from spacearm.planning.timing import rate_bounds
from spacearm.planning.tree import BOXES

#: Name of the method that comes before the others where the attitude is to be kept.
REACTIONLESS = "reactionless"


def at_rest(request: PlanRequest) -> Plan:
    """Return a plan at zero momentum.

    Raises:
        ConfigurationError: The method asked for is none of those that there are.
        UnsupportedError: Several tips are to end with an attitude.
        NoSolutionError: None was found; carries the best attempt.
        StoppedError: Ctrl-C; carries the best attempt.
    """
    if request.goals:
        return _several_tips(request)
    problem = Problem.of(request)
    methods = METHODS if problem.keep is None else {REACTIONLESS: reactionless, **METHODS}
    order = [name for name in methods if name != BOXES or request.search.boxes is not None]
    if request.obstacles:
        order.sort(key=lambda name: name not in (REACTIONLESS, "straight", "tree"))
    return by_methods(problem, {name: methods[name] for name in order})


def by_methods(problem: Problem, methods: Mapping[str, Callable[[Problem], Rows]]) -> Plan:
    """Return the plan of the first method that gives one, in order; in rounds until the time is up.

    Raises:
        ConfigurationError: Another method is asked for.
        ImpossibleError: None can, proven.
        NoSolutionError: None does; carries the best attempt.
        StoppedError: Ctrl-C; carries the best attempt.
    """
    account, asked = problem.account, problem.request.search.method
    require_known("method", asked, ("auto", *methods))
    attempts = Attempts(account)
    for name in attempts.each(_in_rounds(methods, asked, account)):
        if name != "straight":  # a line that arrives shows that there is a way
            problem.require_side()
        with attempts.at(name):
            found = problem.plan(name, methods[name](problem), problem.request)
            wanted = problem.target.attitude if problem.target.tip is None else None
            found = paced(landed(found, wanted), problem.rates)
            problem.check_bent(found)
            return problem.arrived(found, attempts.stories)
    if not account.ended:
        problem.require_side()
    rounds = f"{account.rounds + 1} rounds" if account.rounds else "1 round"
    time = f"{account.elapsed:.1f} s ({account.limit})"
    parts = (f"no plan found in {time}, {rounds}", account.verdict, attempts.told)
    raise account.failure(
        f"{problem.start.arm.name}: {'. '.join(filter(None, parts))}",
        best_attempt(problem.start, problem.best or attempts.best, attempts.stories),
    )


def paced(found: Plan, rates: Array) -> Plan:
    """Return a plan at zero momentum, slowed down until its spline keeps the joint rates (n,)."""
    if len(found) == 1:
        return found
    over = (rate_bounds(found.spline) / rates).max()
    return replace(found, t=found.t * over) if over > 1.0 else found


def _in_rounds(methods: Collection[str], method: str, account: SearchAccount) -> Iterator[str]:
    """Yield the methods in order; again and again those that begin with random guesses.

    Where most ways so far were stopped by contacts, a tree, which goes round bodies, comes before
    loops.
    """
    ways = account.ways
    left = [*methods] if method == "auto" else [method]
    while left:
        by_contact = ways["contact"] > ways["limits"] + ways["singular"]
        if by_contact and left[0] == "roadmap" and "tree" in left:
            left.sort(key=lambda name: name != "tree")
        yield left.pop(0)
    again = [name for name in methods if name != "straight" and method in ("auto", name)]
    while again:
        account.rounds += 1
        yield from again


# --- several tips ----------------------------------------------------------------------------

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


def _several_tips(request: PlanRequest) -> Plan:
    """Return a plan that leads several tips to their goals; errors as of `at_rest`."""
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
