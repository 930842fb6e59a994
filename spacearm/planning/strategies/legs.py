"""Legs: a plan by way of other goals, at zero momentum.

Each leg is a plan at rest that begins where the last one ended. It may turn the spacecraft by an
equal part of what is allowed, so that all together do not turn it farther.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spacearm.errors import NoSolutionError
from spacearm.planning.account import Attempts
from spacearm.planning.problem import broken_as_flown, covered
from spacearm.planning.request import PlanRequest
from spacearm.planning.result import Plan, best_attempt, landed
from spacearm.planning.strategies.at_rest import at_rest, paced

PART, SHORT = 0.5, 2.0
"""Share of the time left that a leg may take, and the least time for it [s]."""


def by_way_of_goals(request: PlanRequest) -> Plan:
    """Return a plan that leads to other goals on its way; if a leg fails, all are sought anew.

    Raises:
        NoSolutionError: None was found; carries the best attempt at a leg.
        StoppedError: Ctrl-C; carries the best attempt at a leg.
    """
    goals = (*request.via, request.goal)
    keep = request.constraints.keep_attitude
    each = replace(request.constraints, keep_attitude=None if keep is None else keep / len(goals))
    attempts = Attempts(request.account)
    for number in attempts.each(itertools.count()):
        with attempts.at("legs"):
            legs: list[Plan] = []
            for i, goal in enumerate(goals):
                attempts.method = f"leg {i + 1} of {len(goals)}"
                request.account.check_time()
                leg = replace(
                    request,
                    start=legs[-1][-1] if legs else request.start,
                    goal=goal,
                    final_attitude=request.final_attitude if i == len(request.via) else None,
                    constraints=each,
                    search=replace(request.search, seed=request.search.seed + number),
                    account=request.account.part(max(PART * request.account.left, SHORT)),
                )
                legs.append(at_rest(leg))
            ends = np.cumsum([len(leg) - 1 for leg in legs])
            whole = landed(_joined(legs, request), on_the_way=ends[:-1].tolist())
            whole = paced(whole, request.constraints.joint_rates(whole.arm))
            if broken := broken_as_flown(whole, request):
                raise NoSolutionError(broken[1], whole)
            return covered(whole, request.constraints.collisions)
    told = dict.fromkeys(f"{method}: {why}" for method, _, why in attempts.failed)
    nothing = f"{request.start.arm.name}: no leg found in {request.account.elapsed:.1f} s"
    best = attempts.best if isinstance(attempts.best, Plan) else best_attempt(request.start, None)
    raise request.account.failure("; ".join(told) or nothing, best)


def _joined(legs: Sequence[Plan], request: PlanRequest) -> Plan:
    """Return the plan of all legs."""
    first = legs[0]
    tried = [
        a._replace(story=f"leg {i}: {a.story}") for i, leg in enumerate(legs, 1) for a in leg.tried
    ]
    return Plan.of_rows(
        ", ".join(dict.fromkeys(leg.method for leg in legs)),
        [first[0], *(cfg for leg in legs for cfg in list(leg)[1:])],
        request.constraints.joint_rates(first.arm),
        clearance=min(leg.clearance for leg in legs),
        tried=tuple(tried),
        checked=first.checked,
        apart=first.apart,
        obstacles=request.obstacles,
    )
