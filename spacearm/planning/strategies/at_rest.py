"""At rest: a plan at zero momentum for one tip or the joints, by the first method that finds one.

Unknowns are the joint positions along the way; the spacecraft turns with them by (33c), w_0 = -D^-1
D_q dq. Equations: the tip, the joints or the attitude of the spacecraft at the end. Bounds: joint
limits, clearance from the singular set, distance between bodies, turn of the spacecraft.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import require_known
from spacearm.planning.account import Attempts, SearchAccount
from spacearm.planning.methods import METHODS
from spacearm.planning.problem import Problem, Rows
from spacearm.planning.request import PlanRequest
from spacearm.planning.result import Plan, best_attempt, landed
from spacearm.planning.strategies.resolved_motion import reactionless
from spacearm.planning.tree import BOXES

#: Name of the method that comes before the others where the attitude is to be kept.
REACTIONLESS = "reactionless"


def at_rest(request: PlanRequest) -> Plan:
    """Return a plan at zero momentum.

    Raises:
        ConfigurationError: The method asked for is none of those that there are.
        NoSolutionError: None was found; carries the best attempt.
        StoppedError: Ctrl-C; carries the best attempt.
    """
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
        NoSolutionError: None does; carries the best attempt.
        StoppedError: Ctrl-C; carries the best attempt.
    """
    account, asked = problem.account, problem.request.search.method
    require_known("method", asked, ("auto", *methods))
    attempts = Attempts(account)
    for name in attempts.each(_in_rounds(methods, asked, account)):
        with attempts.at(name):
            found = Plan.of_rows(
                name,
                methods[name](problem),
                problem.rates,
                clearance=problem.target.clearance,
                obstacles=problem.request.obstacles,
            )
            wanted = problem.target.attitude if problem.target.tip is None else None
            found = paced(landed(found, wanted), problem.rates)
            problem.check([*found])
            return problem.arrived(found, attempts.stories)
    rounds = f"{account.rounds + 1} rounds" if account.rounds else "1 round"
    parts = (f"no plan found in {account.elapsed:.1f} s, {rounds}", account.verdict, attempts.told)
    raise account.failure(
        f"{problem.start.arm.name}: {'. '.join(filter(None, parts))}",
        best_attempt(problem.start, problem.best or attempts.best, attempts.stories),
    )


def paced(found: Plan, rates: Array) -> Plan:
    """Return a plan at zero momentum slowed down until its joints keep their rates (n,)."""
    if len(found) == 1:
        return found
    over = (np.abs(np.diff(found.q, axis=0)) / np.diff(found.t)[:, None] / rates).max()
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
