"""Planner: the functions that plan, and which strategy solves a request.

Papadopoulos & Dubowsky (1993) end on an open problem, "the efficient construction of paths to reach
points in the path dependent workspace". A motion counts as a solution only if it arrives as
`sa.Tracking` flies it, with the clearance asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from spacearm.arrays import ArrayLike
from spacearm.errors import ConfigurationError, ImpossibleError, NoSolutionError, require_known
from spacearm.model.arguments import FLOATING, HELD, BaseMode
from spacearm.model.arm import Configuration
from spacearm.motion.goal import Goal, Origin
from spacearm.planning.request import Constraints, FinalTwist, Joints, PlanRequest, Search
from spacearm.planning.result import Connection, Plan
from spacearm.signatures import checked
from spacearm.singularities.sets import singular_set


@checked
def plan(
    start: Configuration,
    goal: Goal | Joints | Mapping[str, Goal],
    *,
    via: Sequence[Goal | Joints | Mapping[str, Goal]] = (),
    final_attitude: ArrayLike | pin.SE3 | float | None = None,
    final_twist: FinalTwist | None = None,
    duration: float | None = None,
    mode: BaseMode = FLOATING,
    origin: Origin = "spacecraft",
    constraints: Constraints = Constraints(),
    search: Search = Search(),
) -> Plan:
    """Find a joint motion that leads the tip of a floating arm to a goal, from rest to rest.

    With momentum the spacecraft drifts while the arm moves. Then plans at zero momentum, from an
    attitude turned by about the drift, and straight joint motions are bent until the tip arrives at
    a stated time; it does not stay there. With a `final_twist` they are bent in the same way.
    Wheels keep what they hold at the start.

    With `mode="attitude-controlled"` wheels hold the attitude: the momentum and the torque of each
    stay within its limits at every instant, as far as the duration allows. The wheels hold the
    angular momentum of the start; if the start says zero for all wheels, each holds its share.

    Methods, in the order in which "auto" tries them:

    - "straight": a line of the tip by J*;
    - "boxes", if the search has any: a path through boxes in which no posture is singular, then
      shortened;
    - "joint space": the shortest joint curve that arrives;
    - "roadmap": straight pieces through other postures, whose turns of the spacecraft add up;
    - "cycles": a closed loop in joint space that turns the spacecraft, repeated as often as needed,
      then a curve to the goal;
    - "attitude first": a joint motion that turns the spacecraft to an attitude from which the line
      is free (Nanos & Papadopoulos, 2015);
    - "tree": straight joint motions grown at random until one arrives, then shortened. It comes
      second if there are obstacles, and before "roadmap" if contacts stopped most paths so far.

    Args:
        start: Where it begins: the arm with its joint positions, the pose of the spacecraft, the
            constant momentum on board and what each wheel holds of it.
        goal: A point in the task's linear rows [m], a pose, or `Joints`; for an arm with several
            tips, goals by the names of tips. If only one tip is named, joints that do not lead to
            it are free to move; to hold them, load the arm with this tip alone.
        via: Goals on the way, in order; for several tips by the same names as `goal`. With momentum
            on board or a `final_twist` the joints rest there, else only where they turn sharply.
        final_attitude: (3, 3) attitude of the spacecraft at the end, or a pose with this attitude,
            or for planar arms an angle [rad]; any attitude if None.
        final_twist: (k,) twist with which the tip arrives, in the task's rows [m/s], [rad/s], along
            the axes of points, with the drift by the momentum included; at rest if None. For
            several tips by their names; those not named come to rest. What follows, such as a grasp
            or a `Phase`, begins with the joint rates `Plan.final_rates`.
        duration: When the motion ends [s]. If None as soon as the velocity limits and the wheels
            allow; with momentum or a twist approximately so.
        mode: What the spacecraft does: "free-floating", or "attitude-controlled".
        origin: Origin of the inertial frame: with "spacecraft" where the base of the start has it,
            so that poses of `SpaceArm.at` can be used as goals. With "cm" it is the system CM at
            the start, as for points of a `Workspace`, and the base gives the attitude.
        constraints: What must hold on the way.
        search: How to look for it, and for how long.

    Returns:
        The motion, with the proof that it meets no singularity in `certificate`.

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The arm has several tips, fewer joints than its task has rows, wheels
            that cannot hold the attitude, or no shapes that obstacles could meet.
        ImpossibleError: It is proven that there is no such motion: det J* changes its sign between
            start and goal, or the goal is out of reach. For arms of up to three joints the first
            is tried for all attitudes at the end. At zero momentum it says which relaxation was
            tried and works, such as another posture of the same pose. It is a NoSolutionError too.
        NoSolutionError: No motion was found; says which constraint stopped most attempts, what to
            relax, and why every method failed. Carries the best attempt (the start alone if there
            is no better).
        StoppedError: Ctrl-C; says and carries the same.

    Example:
        >>> import spacearm as sa
        >>> plan = sa.plan(sa.load("planar2").at([0.3, 1.2]), (0.9, 1.4))
        >>> plan.method, plan.certificate.free
        ('straight', True)
    """
    require_known("mode", mode, (FLOATING, HELD))
    if mode == FLOATING and constraints.wheels is not None:
        raise ConfigurationError(f"wheels hold no attitude while mode is {mode!r}; give {HELD!r}")
    request = PlanRequest.of(
        start, goal, origin, constraints, search, via, final_attitude, duration, final_twist
    )
    if mode == FLOATING:
        return _possible(request)
    from spacearm.planning.strategies.attitude_held import attitude_held

    return attitude_held(request, _floating)


@checked
def detumble(
    start: Configuration,
    goal: Goal | Joints | Mapping[str, Goal],
    *,
    final_attitude: ArrayLike | pin.SE3 | float | None = None,
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
        goal: A point in the task's linear rows [m], a pose, or `Joints`; for an arm with several
            tips the goal of one of them, by its name.
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
        >>> inertia = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
        >>> wheel = (
        ...     f'<link name="rotor"><inertial><mass value="2"/>{inertia}</inertial></link>'
        ...     '<joint name="wheel" type="continuous"><parent link="spacecraft"/>'
        ...     '<child link="rotor"/><axis xyz="0 0 1"/><limit effort="0.5" velocity="3"/>'
        ...     '<wheel/></joint></robot>'
        ... )
        >>> with open("wheeled.urdf", "w") as file:
        ...     text = sa.load("planar2").path.read_text().replace("</robot>", wheel)
        ...     _ = file.write(text)
        >>> start = sa.load("wheeled.urdf").at([0.3, 1.2], momentum=[0, 0, 0, 0, 0, 1.0])
        >>> sa.detumble(start, (0.9, 1.4)).wheels[-1].round(6)  # all of it [N m s]
        array([1.])
    """
    from spacearm.planning.strategies.detumbling import Detumbling

    request = PlanRequest.of(start, goal, origin, constraints, search, (), final_attitude, duration)
    return Detumbling(request).plan()


@checked
def connected(
    start: Configuration,
    goal: Configuration,
    *,
    limits: bool = True,
    search: Search = Search(timeout=10.0),
) -> Connection:
    """Decide whether a joint path leads from one posture to another without a singularity.

    The spacecraft floats; its pose does not matter. For an arm with as many joints as task rows
    the answer is "no" if det J* has opposite signs at start and goal, rounding included; with up to
    three joints also if boxes of the opposite sign lie between them. It then says which relaxation
    was tried and works, as `plan` does. It is "yes" by the straight line, or by a path of the
    planner, each with its certificate.

    Args:
        start: The posture at one end.
        goal: The posture at the other end, of the same arm.
        limits: Whether the path stays within the joint limits.
        search: How long to look for a path, and how.

    Returns:
        The answer, with the path or the reason.

    Raises:
        ConfigurationError: The two are of different arms.
        UnsupportedError: The arm has fewer joints than its task has rows, or several tips.
        StoppedError: Ctrl-C.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> sa.connected(arm.at([0.3, 1.2]), arm.at([0.3, -1.2])).answer
        'no'
    """
    from spacearm.planning.strategies.relaxations import relaxed  # slow to import, as all here
    from spacearm.singularities.sides import parted, separated

    arm = start.arm
    if goal.arm is not arm:
        raise ConfigurationError(
            f"goal is a configuration of {goal.arm!r}, start of {arm!r}; make both by at of one arm"
        )
    free = Constraints(limits=limits, collisions=False, clearance=0.0)
    there = arm.at(start.q), Joints(goal.q)

    def no(apart: str) -> Connection:
        request = PlanRequest.of(*there, "spacecraft", free, search, (), None, None)
        return Connection(arm, "no", "; ".join(filter(None, (apart, relaxed(request, _floating)))))

    if apart := parted(start, goal):
        return no(apart)
    ends = {"start": start, "goal": goal}
    if limits and (beyond := [name for name, cfg in ends.items() if cfg.outside_limits]):
        joint = ends[beyond[0]].outside_limits[0]
        why = f"joint {joint!r} is beyond its limits at the {beyond[0]}; limits=False ignores them"
        return Connection(arm, "no", why)
    straight = np.array([start.q, goal.q])
    proof = singular_set(arm).clearance(straight)
    if proof:
        return Connection(arm, "yes", "straight from one to the other", straight, proof)
    for name, cfg in ends.items():
        if (at := singular_set(arm).clearance(cfg.q[None])).verdict == "singular":
            why = f"the {name} is singular itself; leave it along sa.singularity(cfg).gradient"
            return Connection(arm, "no", why, certificate=at)
    if apart := separated(start, goal, limits):
        return no(apart)
    try:
        found = plan(*there, constraints=free, search=search)
    except ImpossibleError as error:
        return Connection(arm, "no", str(error))
    except NoSolutionError as error:
        return Connection(arm, "unknown", f"no path found: {error}")
    path = np.vstack((found.q[:-1], goal.q))  # ends there exactly
    proof = singular_set(arm).clearance(path)
    if not proof:
        return Connection(arm, "unknown", "a path was found that could not be proven free")
    return Connection(arm, "yes", f"by the planner: {found.method}", path, proof)


def _possible(request: PlanRequest) -> Plan:
    """Return the plan for a request, the spacecraft floating; where there is none, what works.

    Raises:
        ImpossibleError: There is proven to be none; says which relaxation works, by trying.
    """
    from spacearm.planning.strategies.relaxations import relaxed  # slow to import

    try:
        return _floating(request)
    except ImpossibleError as error:
        if request.moving or request.goals or request.via:
            raise
        tried = relaxed(request, _floating)
        raise ImpossibleError("; ".join(filter(None, (str(error), tried))), error.best) from None


def _floating(request: PlanRequest) -> Plan:
    """Return the plan of the strategy that is for a request, the spacecraft floating."""
    from spacearm.planning.strategies.legs import by_way_of_goals, to_a_goal  # slow to import

    return (by_way_of_goals if request.via else to_a_goal)(request)
