"""Legs: a plan by way of other goals, at zero momentum.

Each leg is a plan at rest that begins where the last one ended. It may turn the spacecraft by an
equal part of what is allowed, so that all together do not turn it farther. The last one may end
with a twist of the tip: it begins from rest where the others ended.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from spacearm.errors import NoSolutionError
from spacearm.model.arm import Configuration
from spacearm.planning.account import Attempts
from spacearm.planning.problem import broken_as_flown, covered
from spacearm.planning.request import PlanRequest
from spacearm.planning.result import Plan, best_attempt, landed
from spacearm.planning.strategies.at_rest import at_rest, paced
from spacearm.planning.strategies.drift import Drift

#: Share of the time left that a leg may take, and the least time for it [s].
PART, SHORT = 0.5, 2.0
#: Rest before a leg that ends with a twist [s].
PAUSE = 1e-3


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
            rows = [legs[0][0], *(cfg for leg in legs for cfg in list(leg)[1:])]
            whole = landed(_joined(legs, rows, request), on_the_way=ends[:-1].tolist())
            whole = paced(whole, request.constraints.joint_rates(whole.arm))
            if broken := broken_as_flown(whole, request):
                raise NoSolutionError(broken[1], whole)
            return covered(whole, request.constraints.collisions)
    told = dict.fromkeys(f"{method}: {why}" for method, _, why in attempts.failed)
    nothing = f"{request.start.arm.name}: no leg found in {request.account.elapsed:.1f} s"
    best = attempts.best if isinstance(attempts.best, Plan) else best_attempt(request.start, None)
    raise request.account.failure("; ".join(told) or nothing, best)


def to_a_twist(request: PlanRequest) -> Plan:
    """Return a plan that leads to other goals on its way and ends with a twist of the tip.

    Raises:
        NoSolutionError: None was found; carries the best attempt at a leg.
        StoppedError: Ctrl-C; carries the best attempt at a leg.
    """
    *via, last = request.via
    keep = request.constraints.keep_attitude
    part = None if keep is None else keep / (len(via) + 2)
    before = replace(
        request,
        via=tuple(via),
        goal=last,
        final_attitude=None,
        final_twist=None,
        duration=None,
        constraints=replace(request.constraints, keep_attitude=part and part * (len(via) + 1)),
    )
    way = by_way_of_goals(before)
    left = None if request.duration is None else request.duration - way.t[-1] - PAUSE
    if left is not None and left <= 0.0:
        raise NoSolutionError(
            f"the goals on the way take {way.t[-1]:.3g} s; give a longer duration", way
        )
    each = replace(request.constraints, keep_attitude=part)
    end = Drift(replace(request, start=way[-1], via=(), duration=left, constraints=each)).plan()
    t = np.append(way.t, way.t[-1] + PAUSE + end.t)
    whole = _joined((way, end), [*way, *end], request, t=t, final_rates=end.final_rates)
    if broken := broken_as_flown(whole, request):
        raise NoSolutionError(broken[1], whole)
    return covered(whole, request.constraints.collisions)


def _joined(
    legs: Sequence[Plan], rows: Sequence[Configuration], request: PlanRequest, **timing: Any
) -> Plan:
    """Return the plan of all legs through some rows; `timing` as for `Plan.of_rows`."""
    first = legs[0]
    tried = [
        a._replace(story=f"leg {i}: {a.story}") for i, leg in enumerate(legs, 1) for a in leg.tried
    ]
    return Plan.of_rows(
        ", ".join(dict.fromkeys(leg.method for leg in legs)),
        rows,
        request.constraints.joint_rates(first.arm),
        clearance=min(leg.clearance for leg in legs),
        tried=tuple(tried),
        checked=first.checked,
        apart=first.apart,
        obstacles=request.obstacles,
        **timing,
    )
