"""Planner: tries the methods of planning from cheap to thorough, and keeps an account of them.

Papadopoulos & Dubowsky (1993) end on an open problem, "the efficient construction of paths to reach
points in the path dependent workspace". A motion counts as a solution only if it arrives when its
rows are replayed, with the clearance asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import positive
from spacearm.collisions.obstacles import obstacles_of
from spacearm.errors import ConfigurationError, UnsupportedError, listed, unknown
from spacearm.model.arguments import FLOATING, HELD, BaseMode, of_configuration
from spacearm.model.arm import Configuration
from spacearm.motion.goal import Goal, Origin, started
from spacearm.planning.account import SearchAccount
from spacearm.planning.request import Constraints, Search
from spacearm.planning.result import Joints, Plan

SEVERAL = ("auto", "straight", "joint space")
"""Methods for several tips."""


@of_configuration
def plan(
    start: Configuration,
    goal: Goal | Joints | Mapping[str, Goal],
    *,
    via: Sequence[Goal | Joints] = (),
    final_attitude: npt.ArrayLike | pin.SE3 | float | None = None,
    duration: float | None = None,
    mode: BaseMode = FLOATING,
    origin: Origin = "spacecraft",
    constraints: Constraints = Constraints(),
    search: Search = Search(),
) -> Plan:
    """Find a joint motion that leads the tip of a floating arm to a goal, from rest to rest.

    With momentum the spacecraft drifts while the arm moves. Then plans at zero momentum, from an
    attitude turned by about the drift, and straight joint motions are bent until the tip arrives at
    a stated time; it does not stay there. What the wheels of the start hold they keep.

    With `mode="attitude-controlled"` wheels hold the attitude: what each holds and gives is kept
    within its limits at every instant, as far as the duration allows. The wheels hold the angular
    momentum of the start; where its wheels are all zero, each its share of it.

    Methods, in the order in which "auto" tries them: "straight", a line of the tip by J*; "tree",
    straight joint motions grown at random until one arrives, then shortened; "joint space", the
    shortest joint curve that arrives; "cycles", a closed loop in joint space that turns
    the spacecraft, run through as often as it takes, then a curve to the goal; "attitude first", a
    joint motion that turns the spacecraft to an attitude from which the line is free (Nanos &
    Papadopoulos, 2015).

    Args:
        start: Where it begins: the arm with its joint positions, the pose of the spacecraft, the
            constant momentum on board and what each wheel holds of it.
        goal: A point in the task's linear rows [m], a pose, or `Joints`; of an arm with several
            tips goals by the names of tips. If one is named, joints that do not lead to it are free
            to move; to hold them, load the arm with this tip alone.
        via: Goals on the way, in order, at zero momentum; the joints come to rest there only where
            they turn sharply.
        final_attitude: (3, 3) attitude that the spacecraft shall have at the end, or a pose with
            it, or for planar arms an angle [rad].
        duration: When the motion ends [s]; if None as soon as the velocity limits and the wheels
            allow, with momentum about so.
        mode: What the spacecraft does: "free-floating", or "attitude-controlled".
        origin: Where the inertial frame has its origin: "spacecraft", as the start says, so that
            poses of `SpaceArm.at` are goals as they are; or "cm", the system CM at the start, as
            for points of a `Workspace`, the base of the start giving the attitude.
        constraints: What must hold on the way.
        search: How to look for it, and for how long.

    Returns:
        The motion, with the proof that it meets no singularity in `certificate`.

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The arm has several tips, fewer joints than its task has rows, wheels
            that cannot hold the attitude, or no shapes that obstacles could meet.
        NoSolutionError: No motion was found; says which constraint stopped most attempts and what
            to relax, and why every method failed, and carries the best attempt (the start alone,
            where there is no better).
        StoppedError: Ctrl-C; says and carries the same.

    Example:
        >>> import spacearm as sa
        >>> plan = sa.plan(sa.load("planar2").at([0.3, 1.2]), (0.9, 1.4))
        >>> plan.method, plan.certificate.free
        ('straight', True)
    """
    from spacearm.planning.drift.search import Drift, stretched  # slow to import, as all here
    from spacearm.planning.rounds.at_rest import at_rest
    from spacearm.planning.rounds.legs import by_way_of
    from spacearm.planning.rounds.mission import Mission
    from spacearm.planning.rounds.together import together
    from spacearm.planning.rounds.wish import Wish
    from spacearm.planning.wheels.held import held_plan
    from spacearm.planning.wheels.limits import Wheels

    if mode not in (FLOATING, HELD):
        raise ConfigurationError(unknown("mode", mode, (FLOATING, HELD)))
    start, goal, goals = _goals_of(started(start, origin), goal)
    if goals and (search.method not in SEVERAL or final_attitude is not None):
        raise UnsupportedError(
            "several tips are led by the methods 'straight' and 'joint space' and end with any "
            "attitude; leave out method and final_attitude"
        )
    arm, around = start.arm, obstacles_of(constraints.obstacles, start.arm)
    duration = None if duration is None else positive(duration, "duration", "time [s]")
    account = SearchAccount(float(search.timeout), search.progress)
    held = arm if mode == HELD else None
    wish = Wish(goal, final_attitude, constraints, search.method, around, held)

    def find(start: Configuration, lasts: float | None) -> Plan:
        moving, seed = bool(start.momentum.any() or start.wheels.any()), search.seed
        if goals and moving:
            raise UnsupportedError("several tips are led at zero momentum only; lead one")
        if via and (moving or goals):
            raise UnsupportedError(
                "goals on the way (via) are for one tip at zero momentum; plan leg by leg"
            )
        if moving:
            mission = Mission(_at_rest(start), wish, seed, account)
            return Drift(mission, start, start.momentum, lasts, around).plan()
        if goals:
            found = together(start, goals, wish, seed, account)
        elif via:
            found = by_way_of(start, via, wish, seed, account)
        else:
            found = at_rest(start, wish, seed, account)
        return found if lasts is None or len(found) == 1 else stretched(found, lasts)

    if held is None:
        if constraints.wheels is not None:
            raise ConfigurationError(
                f"wheels hold no attitude while mode is {mode!r}; give {HELD!r}"
            )
        return find(start, duration)
    if final_attitude is not None:
        raise ConfigurationError("final_attitude is of no use: the attitude stays what it is")
    return held_plan(start, Wheels.of(start, constraints.wheels), find, duration)


@of_configuration
def detumble(
    start: Configuration,
    goal: Goal | Joints | Mapping[str, Goal],
    *,
    final_attitude: npt.ArrayLike | pin.SE3 | float | None = None,
    duration: float | None = None,
    origin: Origin = "spacecraft",
    constraints: Constraints = Constraints(),
    search: Search = Search(),
) -> Plan:
    """Find a motion of arm and wheels that brings a tumbling spacecraft to rest, the tip at a goal.

    The wheels take up the angular momentum of the start on the way, each within its limits, and the
    spacecraft rests when the tip arrives. The arm helps: its motion turns the spacecraft and
    changes its inertia. Alone it cannot: joint torques are internal.

    Args:
        start: Where it begins, with the momentum on board and what each wheel holds of it.
        goal: A point in the task's linear rows [m], a pose, or `Joints`; of an arm with several
            tips that of one of them, by its name.
        final_attitude: Attitude at the end, as for `plan`; any if None.
        duration: When the motion ends [s]; if None about as soon as it can.
        origin: Where the inertial frame has its origin, as for `plan`.
        constraints: What must hold on the way; the spacecraft turns, so not `keep_attitude`.
        search: How long to look for it; the method is one of its own.

    Returns:
        The motion.

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The spacecraft has no wheels, or as for `plan`.
        NoSolutionError: No motion was found; says why, and carries the best attempt.
        StoppedError: Ctrl-C; says and carries the same.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("mda6", wheels=["wheel_x", "wheel_y", "wheel_z"])  # doctest: +SKIP
        >>> start = arm.at(q, momentum=[0, 0, 0, 1, -2, 0.5])  # doctest: +SKIP
        >>> plan = sa.detumble(start, sa.Joints(q))  # doctest: +SKIP
    """
    from spacearm.planning.detumbling.search import Detumbling
    from spacearm.planning.rounds.mission import Mission
    from spacearm.planning.rounds.wish import Wish
    from spacearm.planning.wheels.limits import Wheels

    if constraints.keep_attitude is not None or search.method != "auto":
        raise ConfigurationError(
            "the spacecraft turns while it is brought to rest, by a method of its own; leave out "
            "keep_attitude and method"
        )
    start, goal, goals = _goals_of(started(start, origin), goal)
    if goals:
        raise UnsupportedError("a spacecraft is brought to rest with one tip led; name one")
    around = obstacles_of(constraints.obstacles, start.arm)
    duration = None if duration is None else positive(duration, "duration", "time [s]")
    account = SearchAccount(float(search.timeout), search.progress)
    wish = Wish(goal, final_attitude, constraints, "auto", around)
    mission = Mission(_at_rest(start), wish, search.seed, account)
    wheels = Wheels.free(start, constraints.wheels)
    return Detumbling(mission, start, wheels, start.momentum, duration, around).plan()


def _at_rest(start: Configuration) -> Configuration:
    """Return the same posture and attitude without momentum."""
    return start.arm.at(start.q, base=start.base)


def _goals_of(
    start: Configuration, goal: Goal | Joints | Mapping[str, Goal]
) -> tuple[Configuration, Goal | Joints, Mapping[str, Goal]]:
    """Return the start with the tips that have goals, the goal of one tip, and those of several.

    All joints of an arm whose tips are chosen count.

    Raises:
        ConfigurationError: A name is no tip, or there are no goals.
        UnsupportedError: The arm has fewer joints than its task has rows, or several tips, of which
            none is named.
    """
    arm, goals = start.arm, dict[str, Goal]()
    if isinstance(goal, Mapping):
        if not goal:
            raise ConfigurationError(f"goal is empty; name some of the tips {listed(arm.tips)}")
        for name in goal:
            if name not in arm.tips:
                raise ConfigurationError(f"goal: {unknown('tip', name, arm.tips)}")
        tips = tuple(tip for tip in arm.tips if tip in goal)
        if tips != arm.tips:
            arm = arm.replace(tip=tips, joints=arm.joint_names)
            com, momentum = start.com, start.momentum
            wheels = start.wheels if start.wheels.any() else None
            start = arm.at(start.q, base=start.base, wheels=wheels, momentum=momentum).centred(com)
        goals = dict(goal) if len(goal) > 1 else goals
        goal = next(iter(goal.values()))
    if not goals:
        arm.require_one_tip()  # whose path the plan holds
    if arm.n < arm.task.k:
        raise UnsupportedError(
            f"{arm.name} has {arm.n} joints for {arm.task.k} task rows ({arm.task.names}) and can "
            f"never do this task; take one with {arm.n} rows"
        )
    return start, goal, goals
