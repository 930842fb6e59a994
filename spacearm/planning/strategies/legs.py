"""Legs: a plan by way of other goals.

Each leg is a plan that begins where the last one ended. It may turn the spacecraft by an equal part
of what is allowed, so that all together do not turn it farther. With momentum on board, or where
the last one ends with a twist of the tip, the joints rest between legs.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.mechanics.floating import placed
from spacearm.model.arm import Configuration
from spacearm.planning.account import Attempts
from spacearm.planning.many_curves import drifting_attitudes
from spacearm.planning.problem import broken_as_flown, covered
from spacearm.planning.request import PlanRequest
from spacearm.planning.result import Plan, best_attempt, landed
from spacearm.planning.strategies.at_rest import at_rest, paced
from spacearm.planning.strategies.drift import Drift, stretched
from spacearm.planning.timing import rest_to_rest_times

#: Share of the time left that a leg may take, and the least time for it [s].
PART, SHORT = 0.5, 2.0
#: Rest before the next leg, where joints rest between them [s].
PAUSE = 1e-3


def by_way_of_goals(request: PlanRequest) -> Plan:
    """Return a plan that leads to other goals on its way; if a leg fails, all are sought anew.

    Where it is timed and a duration is asked for, each leg takes its share of it.

    Raises:
        NoSolutionError: None was found; carries the best attempt at a leg.
        StoppedError: Ctrl-C; carries the best attempt at a leg.
    """
    number, duration = len(request.via) + 1, request.duration
    whole, lasts = _found(request, [None] * number)
    if not request.timed:
        return stretched(whole, duration, request.account)
    if duration is None:
        return whole
    left = duration - PAUSE * (number - 1)
    if (way := rest_to_rest_times(whole.q, request.constraints.joint_rates(whole.arm))[-1]) > left:
        raise NoSolutionError(
            f"the goals on the way and the last take {way:.3g} s; give a longer duration", whole
        )
    return _found(request, [*(left * lasts / lasts.sum())])[0]


def to_a_goal(request: PlanRequest) -> Plan:
    """Return a plan to one goal, with none on the way; raises as `by_way_of_goals`."""
    if request.timed:
        return Drift(request).plan()
    return stretched(at_rest(request), request.duration, request.account)


def _found(request: PlanRequest, durations: Sequence[float | None]) -> tuple[Plan, Array]:
    """Return a plan whose legs last so long [s], None for any; and how long they do (k,) [s]."""
    goals: tuple[Any, ...] = (*request.via, request.goals or request.goal)
    keep = request.constraints.keep_attitude
    each = replace(request.constraints, keep_attitude=None if keep is None else keep / len(goals))
    attempts = Attempts(request.account)
    for number in attempts.each(itertools.count()):
        with attempts.at("legs"):
            legs: list[Plan] = []
            for i, (goal, lasts) in enumerate(zip(goals, durations, strict=True)):
                attempts.method = f"leg {i + 1} of {len(goals)}"
                request.account.check_time()
                several, last = isinstance(goal, Mapping), i == len(goals) - 1
                leg = replace(
                    request,
                    start=_next(legs[-1][-1], request.timed) if legs else request.start,
                    goal=next(iter(goal.values())) if several else goal,
                    goals=goal if several else {},
                    via=(),
                    final_attitude=request.final_attitude if last else None,
                    final_twist=request.final_twist if last else None,
                    duration=lasts,
                    constraints=each,
                    search=replace(request.search, seed=request.search.seed + number),
                    account=request.account.part(max(PART * request.account.left, SHORT)),
                )
                legs.append(to_a_goal(leg))
            whole = _joined(legs, request)
            if broken := broken_as_flown(whole, request):
                raise NoSolutionError(broken[1], whole)
            whole = covered(whole, request.constraints.collisions)
            return whole, np.array([leg.t[-1] for leg in legs])
    told = dict.fromkeys(f"{method}: {why}" for method, _, why in attempts.failed)
    account = request.account
    nothing = f"{request.start.arm.name}: no leg found in {account.elapsed:.1f} s ({account.limit})"
    best = attempts.best if isinstance(attempts.best, Plan) else best_attempt(request.start, None)
    raise request.account.failure("; ".join(told) or nothing, best)


def _next(end: Configuration, timed: bool) -> Configuration:
    """Return where the next leg begins: where the last one ends, or after a rest of the joints."""
    if not timed:
        return end
    arm, T, h = end.arm, end.base.rotation, end.momentum
    still = np.tile(end.q, (1, 2, 1))
    T = drifting_attitudes(arm, T, np.array([0.0, PAUSE]), still, h[3:], T.T @ end.stored[3:])[0, 1]
    start = placed(end, end.q, T).centred(end.com + h[:3] / arm.mass * PAUSE)
    return start.with_momentum(h).with_wheels(end.wheels)


def _joined(legs: Sequence[Plan], request: PlanRequest) -> Plan:
    """Return the plan of all legs."""
    first, skipped = legs[0], 0 if request.timed else 1
    rows: dict[str, Any] = {
        name: np.concatenate([getattr(leg, name)[skipped * (leg is not first) :] for leg in legs])
        for name in ("q", "base", "momentum", "wheels")
    }
    tried = [
        a._replace(story=f"leg {i}: {a.story}") for i, leg in enumerate(legs, 1) for a in leg.tried
    ]
    begin = np.cumsum([0.0, *(leg.t[-1] + PAUSE for leg in legs)])
    limits = request.constraints.joint_rates(first.arm)
    timed = np.concatenate([t + leg.t for t, leg in zip(begin, legs, strict=False)])
    whole = replace(
        first,
        **rows,
        t=timed if request.timed else rest_to_rest_times(rows["q"], limits),
        method=", ".join(dict.fromkeys(leg.method for leg in legs)),
        clearance=min(leg.clearance for leg in legs),
        tried=tuple(tried),
        final_rates=legs[-1].final_rates,
        obstacles=request.obstacles,
    )
    if request.timed:
        return whole
    ends = np.cumsum([len(leg) - 1 for leg in legs])
    return paced(landed(whole, on_the_way=ends[:-1].tolist()), limits)
