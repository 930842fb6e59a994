"""Plans at zero momentum: the methods are tried from cheap to thorough, with an account of them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

from spacearm.errors import NoSolutionError
from spacearm.model.arm import Configuration
from spacearm.planning.account import SearchAccount, TimeUpError
from spacearm.planning.methods import METHODS
from spacearm.planning.problem import Problem
from spacearm.planning.result import IGNORED, Attempt, Plan, best_attempt
from spacearm.planning.rounds.wish import Wish, problem_of
from spacearm.planning.tips.reactionless import reactionless

REACTIONLESS = "reactionless"
"""Name of the method that comes before the others where the attitude is to be kept."""


def at_rest(cfg: Configuration, wish: Wish, seed: int, search: SearchAccount) -> Plan:
    """Return a plan at zero momentum.

    Raises:
        NoSolutionError: None was found; carries the best attempt.
        StoppedError: Ctrl-C; carries the best attempt.
    """
    problem = problem_of(cfg, wish, seed, search)
    bodies = problem.collisions
    tried: dict[str, str] = {}
    methods = METHODS if problem.keep is None else {REACTIONLESS: reactionless, **METHODS}
    order = list(methods)
    if wish.obstacles:
        order.sort(key=lambda name: name not in (REACTIONLESS, "straight", "tree"))
    for name in _in_rounds(order, wish.method, search):
        try:
            rows = methods[name](problem)
        except TimeUpError as error:
            tried.setdefault(name, str(error))
            break
        except NoSolutionError as error:
            tried[name] = str(error)
            problem.best = error.best if isinstance(error.best, list) else problem.best
            continue
        except KeyboardInterrupt:
            search.end()
            tried[name] = "stopped by Ctrl-C"
            break
        checked = IGNORED if bodies is None else bodies.account
        apart = True if bodies is not None and bodies.bodies else None
        failed = [Attempt(name, False, story) for name, story in tried.items()]
        least = problem.target.clearance
        found = Plan.of_rows(
            name, rows, least, problem.rates, failed, checked, apart, wish.obstacles
        )
        story = f"{found.travel}, {found.nearest}"
        arrived = Attempt(name, True, "; ".join(filter(None, (story, problem.note))))
        return replace(found, tried=(*found.tried, arrived))
    failed = [Attempt(name, False, story) for name, story in tried.items()]
    raise search.failure(_failure(problem, tried), best_attempt(cfg, problem.best, failed))


def _in_rounds(methods: Collection[str], method: str, search: SearchAccount) -> Iterator[str]:
    """Yield the methods in order; again and again those that begin with random guesses."""
    yield from methods if method == "auto" else (method,)
    again = [name for name in methods if name != "straight" and method in ("auto", name)]
    while again:
        search.rounds += 1
        yield from again


def _failure(problem: Problem, tried: Mapping[str, str]) -> str:
    """Return the message of a search without a plan."""
    search = problem.search
    rounds = f"{search.rounds + 1} rounds" if search.rounds else "1 round"
    stories = "; ".join(f"{name}: {story}" for name, story in tried.items())
    parts = (f"no plan found in {search.elapsed:.1f} s, {rounds}", search.verdict, stories)
    return f"{problem.start.arm.name}: {'. '.join(filter(None, parts))}"
