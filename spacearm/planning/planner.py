"""Planner: tries the methods of planning from cheap to thorough, and keeps an account of them.

Papadopoulos & Dubowsky (1993) end on an open problem, "the efficient construction of paths to reach
points in the path dependent workspace". A motion counts as a solution only if it arrives when its
rows are replayed, with the clearance asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Real

import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, positive, whole
from spacearm.collisions.obstacles import Obstacle, obstacles_of
from spacearm.errors import ConfigurationError, UnsupportedError, listed, unknown
from spacearm.mechanics.jacobian import momentum_vector
from spacearm.model.arguments import BaseMode, of_arm
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.frames import PoseLike
from spacearm.motion.goal import Goal, Origin, started
from spacearm.motion.motion import Motion
from spacearm.motion.plant import WheelHold
from spacearm.planning.result import Joints, Plan
from spacearm.planning.search import Progress, Search

FLOATING: BaseMode = "free-floating"
HELD: BaseMode = "attitude-controlled"

SEVERAL = ("auto", "straight", "joint space")
"""Methods for several tips."""


@of_arm
def plan(
    arm: SpaceArm,
    q0: npt.ArrayLike,
    goal: Goal | Joints | Mapping[str, Goal],
    *,
    base: PoseLike | None = None,
    origin: Origin = "spacecraft",
    clearance: float | None = None,
    final_attitude: npt.ArrayLike | pin.SE3 | float | None = None,
    limits: bool = True,
    collisions: bool = True,
    method: str = "auto",
    via: Sequence[Goal | Joints] = (),
    obstacles: Obstacle | Sequence[Obstacle | Configuration | Motion] = (),
    momentum: npt.ArrayLike | None = None,
    duration: float | None = None,
    keep_attitude: float | None = None,
    detumble: bool = False,
    mode: BaseMode = FLOATING,
    wheels: WheelHold | None = None,
    wheels0: npt.ArrayLike | None = None,
    seed: int = 0,
    timeout: float = 60.0,
    progress: Progress | None = None,
) -> Plan:
    """Find a joint motion that leads the tip of a floating arm to a goal, from rest to rest.

    With momentum the spacecraft drifts while the arm moves. Then plans at zero momentum, from an
    attitude turned by about the drift, and straight joint motions are bent until the tip arrives at
    a stated time; it does not stay there. With `detumble=True` wheels take up the angular momentum
    on the way, each within its limits, and the spacecraft rests when the tip arrives. The arm
    helps: its motion turns the spacecraft and changes its inertia. Alone it cannot: joint torques
    are internal.

    With `mode="attitude-controlled"` wheels hold the attitude: what each holds and gives is kept
    within its limits at every instant, as far as the duration allows.

    Methods, in the order in which "auto" tries them: "straight", a line of the tip by J*; "tree",
    straight joint motions grown at random until one arrives, then shortened; "joint space", the
    shortest joint curve that arrives; "cycles", a closed loop in joint space that turns
    the spacecraft, run through as often as it takes, then a curve to the goal; "attitude first", a
    joint motion that turns the spacecraft to an attitude from which the line is free (Nanos &
    Papadopoulos, 2015).

    Args:
        arm: The arm.
        q0: (n,) joint positions at the start [rad] or [m].
        goal: A point in the task's linear rows [m], a pose, or `Joints`; of an arm with several
            tips goals by the names of tips. If one is named, joints that do not lead to it are free
            to move; to hold them, load the arm with this tip alone.
        base: Pose of the spacecraft at the start; the identity if None.
        origin: Where the inertial frame has its origin: "spacecraft", as `base` says, so that
            poses of `SpaceArm.at` are goals as they are; or "cm", the system CM at the start, as
            for points of a `Workspace`, `base` giving the attitude.
        clearance: How far from the singular set the motion stays at least [rad], to first order as
            in `singularity`, from 0 to 1; if None, 0.1 degrees, but no more than half of what the
            start has.
        final_attitude: (3, 3) attitude that the spacecraft shall have at the end, or a pose with
            it, or for planar arms an angle [rad].
        limits: Whether the joint limits hold.
        collisions: Whether the spacecraft and the links must not meet. Links count with their
            collision geometry, or their visuals where they have none; meshes as convex hulls.
            Bodies on both sides of one joint may touch. `Plan.checked` says what was checked.
        method: "auto", or one of the five.
        via: Goals on the way, in order, at zero momentum; the joints come to rest there only where
            they turn sharply.
        obstacles: What the spacecraft and the links must not meet besides, in the inertial frame,
            as `base` and poses as goals are: `Obstacle.box`, `.sphere`, `.cylinder`, `.mesh` and
            `.robot`, and configurations or motions of other robots. Those that move begin with the
            plan. That none is met is proven for the motion with the spacecraft turning as it does.
        momentum: (6,) constant momentum [linear [kg m/s]; angular about the system CM [N m s]],
            inertial axes, that of the wheels included; zero if None. The wheels that hold an
            attitude hold the angular part.
        duration: When the motion ends [s]; if None as soon as the velocity limits and the wheels
            allow, with momentum about so.
        keep_attitude: Largest turn of the floating spacecraft on the way [rad], proven between the
            rows too; joints of another arm, if they count, move so as to keep it.
        detumble: Whether the wheels of the description bring the tumbling spacecraft to rest; at
            any attitude if `final_attitude` is None.
        mode: What the spacecraft does: "free-floating", or "attitude-controlled".
        wheels: Limits of each wheel that holds the attitude or detumbles; if None those of the
            description, `effort` and `velocity` times its moment of inertia. A spacecraft without
            wheels in its description is held by three, about its axes.
        wheels0: (w,) what each holds at the start [N m s], and keeps if the spacecraft floats and
            is not detumbled; if None its share of the momentum, or nothing if it floats.
        seed: Seed of the random first guesses; the same seed gives the same plan, if it is found
            in time.
        timeout: Time after which the search is given up [s]. Until then it goes on with other first
            guesses.
        progress: Called now and then as progress(t, timeout), both in s.

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
        >>> plan = sa.plan(sa.load("planar2"), [0.3, 1.2], (0.9, 1.4))
        >>> plan.method, plan.certificate.free
        ('straight', True)
    """
    from spacearm.planning.detumbling.search import Detumbling
    from spacearm.planning.drift.search import Drift, stretched  # slow to import, as all here
    from spacearm.planning.methods import METHODS
    from spacearm.planning.rounds.at_rest import at_rest
    from spacearm.planning.rounds.legs import by_way_of
    from spacearm.planning.rounds.mission import Mission
    from spacearm.planning.rounds.together import together
    from spacearm.planning.rounds.wish import Wish
    from spacearm.planning.wheels.held import held_plan
    from spacearm.planning.wheels.limits import Wheels

    if method not in ("auto", *METHODS):
        raise ConfigurationError(unknown("method", method, ("auto", *METHODS)))
    if not isinstance(timeout, Real) or not timeout > 0.0:
        raise ConfigurationError(f"timeout is {timeout!r}; give a positive time [s]")
    if mode not in (FLOATING, HELD):
        raise ConfigurationError(unknown("mode", mode, (FLOATING, HELD)))
    seed = whole(seed, "seed", 0)
    goals: Mapping[str, Goal] = {}
    if isinstance(goal, Mapping):
        arm, goals = _of_tips(arm, goal)
        if len(goals) == 1:
            (goal,) = goals.values()
            goals = {}
        elif method not in SEVERAL or final_attitude is not None:
            raise UnsupportedError(
                "several tips are led by the methods 'straight' and 'joint space' and end with any "
                "attitude; leave out method and final_attitude"
            )
    if not goals:
        arm.require_one_tip()  # whose path the plan holds
    if arm.n < arm.task.k:
        raise UnsupportedError(
            f"{arm.name} has {arm.n} joints for {arm.task.k} task rows ({arm.task.names}) and can "
            f"never do this task; take one with {arm.n} rows"
        )
    around = obstacles_of(obstacles, arm)
    if around and not collisions:
        raise ConfigurationError("obstacles count as collisions do; leave out collisions=False")
    cfg, search = started(arm.at(q0, base=base), origin), Search(float(timeout), progress)
    duration = None if duration is None else positive(duration, "duration", "time [s]")
    keep = (
        None if keep_attitude is None else positive(keep_attitude, "keep_attitude", "angle [rad]")
    )
    held = arm if mode == HELD else None
    wish = Wish(goal, clearance, final_attitude, limits, collisions, method, around, held, keep)
    h = momentum_vector(momentum)

    def find(start: Configuration, h: Array, lasts: float | None) -> Plan:
        if goals and (h.any() or start.wheels.any()):
            raise UnsupportedError("several tips are led at zero momentum only; lead one")
        if via and (h.any() or start.wheels.any() or goals):
            raise UnsupportedError(
                "goals on the way (via) are for one tip at zero momentum; plan leg by leg"
            )
        if h.any() or start.wheels.any():
            return Drift(Mission(start, wish, seed, search), start, h, lasts, around).plan()
        if goals:
            found = together(start, goals, wish, seed, search)
        elif via:
            found = by_way_of(start, via, wish, seed, search)
        else:
            found = at_rest(start, wish, seed, search)
        return found if lasts is None or len(found) == 1 else stretched(found, lasts)

    if detumble:
        if goals or via or keep is not None or held is not None or method != "auto":
            raise ConfigurationError(
                "detumble=True leads one tip by a method of its own, and the spacecraft turns; "
                "leave out other tips, via, keep_attitude, mode and method"
            )
        start = arm.at(q0, base=cfg.base, wheels=wheels0)
        mission = Mission(start, wish, seed, search)
        return Detumbling(mission, start, Wheels.free(start, wheels), h, duration, around).plan()
    if held is None:
        if wheels is not None:
            raise ConfigurationError(
                f"wheels hold no attitude while mode is {mode!r}; give {HELD!r}"
            )
        return find(arm.at(q0, base=cfg.base, wheels=wheels0), h, duration)
    if final_attitude is not None:
        raise ConfigurationError("final_attitude is of no use: the attitude stays what it is")
    return held_plan(cfg, Wheels.of(cfg, wheels, wheels0, h[3:]), find, h, duration)


def _of_tips(arm: SpaceArm, goals: Mapping[str, Goal]) -> tuple[SpaceArm, Mapping[str, Goal]]:
    """Return the arm with the tips that have goals, and the goals; all its joints count.

    Raises:
        ConfigurationError: A name is no tip, or there are no goals.
    """
    if not goals:
        raise ConfigurationError(f"goal is empty; name some of the tips {listed(arm.tips)}")
    for name in goals:
        if name not in arm.tips:
            raise ConfigurationError(f"goal: {unknown('tip', name, arm.tips)}")
    tips = tuple(tip for tip in arm.tips if tip in goals)
    if tips == arm.tips:
        return arm, goals
    return arm.replace(tip=tips, joints=arm.joint_names), goals
