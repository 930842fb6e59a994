"""Catching: when and where a tumbling target is grasped, and the motion that arrives with it.

The tip arrives with the pose and the twist of a grapple frame, so that nothing strikes. The arm
with the target in its hand is then braked: the joints come to rest along a straight line, and the
whole tumbles on as one body with the momentum of the target.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice

from spacearm.errors import ImpossibleError, NoSolutionError, SpaceArmError
from spacearm.mechanics.target import Target
from spacearm.mission.approaching import NO_WAY, Approach, Grapple, in_turn
from spacearm.mission.catch_report import Candidate, Catch
from spacearm.mission.two_hands import HandsApproach
from spacearm.model.arguments import FLOATING, BaseMode
from spacearm.model.arm import Configuration
from spacearm.planning.account import SHORTEST, SearchAccount, TimeUpError
from spacearm.planning.request import Constraints, Joints, Search
from spacearm.signatures import checked

#: Share of the time that is given to each contact on each pass, 0 for one straight way; the first
#: passes, so many, add contacts half way between.
SHARES, FINER = (0.0, 0.0, 1 / 30, 1 / 10, 1 / 3), 2
#: Reasons that the message of a search without result names.
REASONS = 3


@checked
def catch(
    start: Configuration,
    target: Target,
    grapple: Grapple = None,
    *,
    window: Sequence[float] = (0.0, 60.0),
    approach: float = 0.2,
    closing: float = 0.05,
    touching: Sequence[str] | None = None,
    bears: Sequence[float] = (math.inf, math.inf),
    wanted: int = 3,
    mode: BaseMode = FLOATING,
    constraints: Constraints = Constraints(),
    search: Search = Search(),
) -> Catch:
    """Find when and by which grapple frame an arm catches a tumbling target, and how.

    Contacts in all parts of the window are tried in turn, of each part those first whose open side
    faces the arm; contacts out of reach come last. Of the first that succeed, the one with the
    largest proven distance to the singular set is returned. The joints start at rest. With momentum
    on board the spacecraft drifts on the way, and the arm moves from time 0 on.

    With `mode="attitude-controlled"` wheels hold the attitude until the joints rest again, and take
    up the angular momentum of the target, each within its torque and capacity.

    Args:
        start: The arm at time 0, with momentum on board and what its wheels hold of it. Poses of
            the target are in the inertial frame of its base.
        target: The target.
        grapple: Name of the grapple frame; any of them if None. For an arm with several tips the
            frame of each, {tip: frame}: all of them grasp at the same time. With a sequence of such
            mappings they grasp one after the other. Each hand that holds moves on with the target
            while the next one closes in, and all brake once the last one has grasped.
        window: Earliest and latest contact [s]; if hands grasp one after the other, of the last
            contact.
        approach: Distance of the stand-off, from which the tip closes in along the z axis of the
            grapple frame, with a planar arm along its x axis [m].
        closing: Mean speed at which it closes in [m/s].
        touching: Links of the arm that may touch the target; if None those that move as the tip.
        bears: Largest force [N] and largest moment [N m] that the grapple bears at the tip while
            the arm is braked with the target in its hand.
        wanted: How many catches to find before the best is taken; fewer if one keeps as far from
            the singular set as asked for.
        mode: What the spacecraft does: "free-floating", or "attitude-controlled".
        constraints: What must hold on the way, as for `plan`. Rates and torques are those of the
            description, unless rates are given.
        search: How to look: `timeout` is for the whole call [s], `method` for the motion to the
            stand-off; "straight" tries straight ones only.

    Returns:
        The catch.

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The arm has several tips, its task is not a pose (in space, or in the
            plane of the arm), or wheels cannot hold it.
        NoSolutionError: Nothing tried catches the target; says why, for each time and frame.

    Example:
        >>> import spacearm as sa
        >>> start = sa.load("chaser7").at([0, 0.6, 0, 1.2, 0, 0.8, 0])
        >>> ring = sa.pose((0, 0, -0.5))  # in the frame of the target, z into it
        >>> place = start.tip * sa.pose((0.1, 0, 0.8))
        >>> debris = sa.Target(
        ...     sa.Bus(60, size=(0.8, 0.8, 1), name="debris"),
        ...     place,
        ...     twist=(0, 0.002, 0, 0.02, 0.03, 0.02),
        ...     grapples={"ring": ring},
        ... )
        >>> catch = sa.catch(start, debris, window=(10, 10))
        >>> bool(catch.place_error < 1e-6 and abs(catch.twist_error).max() < 1e-5)
        True
    """
    account = SearchAccount(search.timeout, search.progress)
    several = sum(map(len, in_turn(grapple))) > 1
    kind = HandsApproach if several else Approach
    request = kind.of(
        start, target, grapple, window, approach, closing, touching, bears, constraints, mode,
        account,
    )  # fmt: skip
    request.check_start()
    tried, found = dict[tuple[float, str], Candidate](), dict[tuple[float, str], Catch]()
    kept = dict[tuple[float, str], Iterator[Joints]]()
    passes = list(islice(request.candidates(), FINER))
    if not passes[0]:
        takes = sum(request.duration) + 1.0
        raise NoSolutionError(
            f"the window ends after {window[1]:.4g} s, and the earliest contact is after "
            f"{takes:.4g} s: the tip takes up the motion of the target and closes in, each in "
            "approach / closing; let the window end later, or raise closing"
        )
    waiting, ended, enough = list[tuple[float, str]](), False, False
    shares = SHARES[FINER:] if request.moving else SHARES
    if search.method == "straight" and not request.moving:  # each until the time is up
        shares = (*SHARES[:FINER], 1.0)
    for number, share in enumerate(shares):
        again = list[tuple[float, str]]()
        waiting = passes[number] + waiting if number < FINER else waiting
        for t, name in waiting:
            enough = enough or len(found) >= wanted
            ended = ended or account.left <= 0.0
            if enough or ended:
                break
            look = replace(
                search,
                seed=search.seed + number,
                timeout=max(account.left, SHORTEST),
                progress=None,
            )
            straight = kept.setdefault((t, name), request.straight(t, name, look))
            try:
                account.check_time()
                one = request.attempt(t, name, straight, look, share * search.timeout)
            except TimeUpError:
                ended = True
            except SpaceArmError as error:
                if (t, name) not in tried or tried[t, name].story == NO_WAY:
                    tried[t, name] = Candidate(t, name, False, str(error))
                again += [(t, name)] * (not isinstance(error, ImpossibleError))
            else:
                if not found:  # as long again, at most
                    account.timeout = min(account.timeout, 2.0 * account.elapsed + 1.0)
                found[t, name] = one
                tried[t, name] = Candidate(t, name, True, one.margin)
                enough = one.clearance >= request.proves  # none is known to be better
        waiting = again
    if not found:
        count = sum(map(len, passes))
        raise NoSolutionError(
            f"{start.arm.name} does not catch {target.name} in the window of {window[0]:.4g} to "
            f"{window[1]:.4g} s: {_failures(tried, count, search.timeout if ended else None)}",
            tuple(tried.values()),
        )
    account.timeout = search.timeout
    at = max(found, key=lambda at: found[at].clearance)
    best = request.settled(found[at])
    tried[at] = Candidate(*at, True, best.margin)
    return replace(best, tried=tuple(tried.values()))


def _failures(
    tried: Mapping[tuple[float, str], Candidate], count: int, timeout: float | None
) -> str:
    """Say how many candidates were tried, why they fail, and what to do.

    Args:
        tried: The candidates that were tried.
        count: How many there are.
        timeout: Time after which the search was ended [s]; None if it was not.
    """
    pairs = f"{len(tried)} of {count} candidates (contact time and grapple frame) were tried"
    remedy = "widen the window, start nearer, or name another grapple frame"
    if timeout is not None:
        pairs = f"the search ended after timeout = {timeout:.4g} s, when {pairs}"
        remedy = f"give a longer timeout (search.timeout), {remedy}"
    reasons = dict[str, list[Candidate]]()
    for one in tried.values():
        reasons.setdefault(one.story, []).append(one)
    told = [
        f"{alike[0].t:.4g} s, {alike[0].grapple}"
        f"{f' and {len(alike) - 1} more' * (len(alike) > 1)}: {story}"
        for story, alike in list(reasons.items())[:REASONS]
    ]
    return "; ".join([pairs, *told, remedy])
