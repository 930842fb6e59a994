"""Legs: a plan by way of other goals, one after the other, at zero momentum."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

from spacearm.collisions.courses import Recorded
from spacearm.collisions.separation import Collisions
from spacearm.errors import NoSolutionError
from spacearm.model.arm import Configuration
from spacearm.motion.goal import Goal
from spacearm.planning.account import SearchAccount, TimeUpError
from spacearm.planning.result import Attempt, Joints, Plan, best_attempt
from spacearm.planning.rounds.at_rest import at_rest
from spacearm.planning.rounds.wish import Wish

PART, SHORT = 0.5, 2.0
"""Share of the time left that a leg may take, and the least time for it [s]."""


def by_way_of(
    cfg: Configuration, via: Sequence[Goal | Joints], wish: Wish, seed: int, search: SearchAccount
) -> Plan:
    """Return a plan that leads to other goals on its way.

    Each leg begins where the last one ended. If one fails, all are sought anew with another seed.
    Each may turn the spacecraft by an equal part of what is allowed, so that all together do not
    turn it farther.

    Args:
        cfg: Where it begins.
        via: The goals on the way, one or more.
        wish: What the plan shall be like.
        seed: Of the first guesses.
        search: The time it may take, and its account.

    Raises:
        NoSolutionError: None was found; carries the best attempt at a leg.
        StoppedError: Ctrl-C; carries the best attempt at a leg.
    """
    count = len(via) + 1
    keep = wish.constraints.keep_attitude
    each = replace(wish.constraints, keep_attitude=None if keep is None else keep / count)
    reasons: dict[str, None] = {}
    best: object = None
    for number in itertools.count():
        legs: list[Plan] = []
        try:
            for goal in (*via, wish.goal):
                search.check_time()
                last = len(legs) == len(via)
                one = wish._replace(
                    goal=goal,
                    constraints=each,
                    final_attitude=wish.final_attitude if last else None,
                )
                time = search.timeout - search.elapsed
                part = search.part(max(PART * time, SHORT))
                legs.append(at_rest(legs[-1][-1] if legs else cfg, one, seed + number, part))
            return _joined(legs, wish)
        except TimeUpError:
            break
        except KeyboardInterrupt as stop:
            best = getattr(stop, "best", None) or best
            search.end()
            break
        except NoSolutionError as error:
            best = error.best or best
            reasons.setdefault(f"leg {len(legs) + 1} of {count}: {error}")
    raise search.failure(
        "; ".join(reasons) or f"{cfg.arm.name}: no leg of the plan found in {search.elapsed:.1f} s",
        best if isinstance(best, Plan) else best_attempt(cfg, None, ()),
    )


def _joined(legs: Sequence[Plan], wish: Wish) -> Plan:
    """Return the plan of all legs.

    Raises:
        NoSolutionError: It meets an obstacle that moves, which a leg alone does not.
    """
    rows = [legs[0][0], *(cfg for leg in legs for cfg in list(leg)[1:])]
    methods = ", ".join(dict.fromkeys(leg.method for leg in legs))
    tried: list[Attempt] = []
    for i, leg in enumerate(legs):
        tried += [a._replace(story=f"leg {i + 1}: {a.story}") for a in leg.tried]
    first = legs[0]
    found = Plan.of_rows(
        methods, rows, min(leg.clearance for leg in legs),
        wish.constraints.joint_rates(first.arm), tried, first.checked, first.apart, wish.obstacles,
    )  # fmt: skip
    if found.obstacles:
        contact = Collisions(found.arm, found.obstacles).contact(Recorded(found))
        if contact is not None:
            raise NoSolutionError(str(contact))
    return found
