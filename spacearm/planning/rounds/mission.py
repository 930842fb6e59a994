"""Mission: what a plan with momentum on board is made of."""

from __future__ import annotations

from typing import NamedTuple

from spacearm.arrays import Array
from spacearm.model.arm import Configuration
from spacearm.planning.account import SearchAccount
from spacearm.planning.problem import Problem
from spacearm.planning.result import Plan
from spacearm.planning.rounds.at_rest import at_rest
from spacearm.planning.rounds.wish import Wish, problem_of

AGAIN, SHORT = ("joint space", "tree", "cycles"), 1.0
"""Methods by which a plan with momentum begins, after others, and the least time for each [s]."""


class Mission(NamedTuple):
    """What a plan with momentum is made of, all seen from the system CM."""

    cfg: Configuration
    wish: Wish
    seed: int
    search: SearchAccount

    def problem(self, moved: Array) -> Problem:
        """Return the problem if the system CM moves by (3,) [m] until the tip arrives."""
        return problem_of(self.cfg, self.wish.moved(self.cfg, moved), self.seed, self.search)

    def still(self, start: Configuration, moved: Array, number: int) -> Plan:
        """Return a plan without momentum from another start; after two others of other methods."""
        wish = self.wish.moved(self.cfg, moved)
        if number % 2 == 0:  # about where they will be
            wish = wish._replace(obstacles=self.wish.obstacles)
        if wish.method == "auto" and number > 1:
            wish = wish._replace(method=AGAIN[number % len(AGAIN)])
        time = max((self.search.timeout - self.search.elapsed) / 3.0, SHORT)
        return at_rest(start, wish, self.seed + number, self.search.part(time))
