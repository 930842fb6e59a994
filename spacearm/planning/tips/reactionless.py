"""Reactionless: a tip led to its goal while other joints keep the attitude of the spacecraft."""

from __future__ import annotations

import numpy as np

from spacearm.errors import NoSolutionError
from spacearm.planning.account import TimeUpError
from spacearm.planning.many_curves import turning_axes
from spacearm.planning.problem import Problem, Rows
from spacearm.planning.tips.resolved import Aim, Bias, Resolved

FIRM = (np.inf, 1000.0, 500.0, 200.0, 100.0, 50.0, 20.0, 5.0)
"""How firmly the attitude is kept, in turn; see `Bias`."""
TRIES = 24
"""Ways tried in a round."""
ASIDE, EASE = 1.0, 1.0
"""Size of the joint motions aside [rad], and of the logarithm of how easily each joint moves."""


def reactionless(problem: Problem) -> Rows:
    """Lead the tip straight to its goal by joint motions that do not turn the spacecraft.

    The first is that of least joint motion; others go aside where they can.

    Raises:
        NoSolutionError: None of the ways tried solves the problem.
    """
    arm, tip = problem.start.arm, problem.target.tip
    if tip is None:
        raise NoSolutionError("the goal is no place of the tip")
    turns = len(turning_axes(arm))
    if arm.n < arm.task.k + turns:
        raise NoSolutionError(
            f"{arm.n} joints cannot do {arm.task.k} task rows and hold {turns} of the attitude; "
            "let the joints of another arm count too (joints='all'), or hold the attitude by "
            "wheels (mode='attitude-controlled')"
        )
    rng = np.random.default_rng((problem.seed, problem.search.rounds))
    limits = problem.target.lower, problem.target.upper
    together, why = Resolved((Aim(problem.start, tip),), limits), ""
    turned: float = problem.search.ways["turn"]
    for i in range(TRIES):
        aside, ease = rng.normal(size=(2, arm.n))
        if i < len(FIRM) and problem.search.rounds == 0:
            aside, ease = np.zeros((2, arm.n))
        bias = Bias(ASIDE * aside, np.exp(EASE * ease), FIRM[i % len(FIRM)])
        try:
            return problem.check(together.led(bias, problem.stopped))
        except TimeUpError:
            raise
        except NoSolutionError as error:
            if isinstance(error.best, list):
                problem.best = error.best
            if problem.search.ways["turn"] > turned or not why:
                why, turned = str(error), np.inf  # the firmest that arrives
    raise NoSolutionError(why, problem.best)
