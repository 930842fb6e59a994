"""What is asked of the planner: the constraints that a plan keeps, and how it is searched for."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, ArrayLike, Parameters, finite, plain, positive, whole, within
from spacearm.collisions.obstacles import Obstacle, ObstacleLike, obstacles_of
from spacearm.errors import ConfigurationError, listed, require_known
from spacearm.model.arguments import require_possible
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.joints import joint_vector
from spacearm.motion.goal import Goal, Origin, goal_pose, started
from spacearm.motion.plant import WheelHold
from spacearm.planning.account import Progress, SearchAccount
from spacearm.planning.timing import for_each_joint, largest_rates
from spacearm.signatures import checked
from spacearm.singularities.box_graph import FreeBoxes

#: Largest clearance [rad]: the distance to the singular set is too rough beyond.
FARTHEST = 1.0
#: The task's rows of a twist [m/s], [rad/s]; of several tips by their names.
FinalTwist: TypeAlias = ArrayLike | Mapping[str, ArrayLike]


@checked
@dataclass(frozen=True)
class Joints:
    """A goal in joint space.

    Attributes:
        q: (n,) joint positions [rad] or [m].
    """

    q: ArrayLike

    def to_dict(self) -> dict[str, Any]:
        """Return the goal as plain data, q as a list."""
        return {"q": np.asarray(self.q).tolist()}


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Constraints(Parameters):
    """What must hold on the way of a plan.

    Attributes:
        limits: Whether the joint limits must hold.
        collisions: Whether the spacecraft and the links must not meet each other. Links count with
            their collision geometry, or their visuals if they have none; meshes as convex hulls.
            Bodies on both sides of one joint may touch. `Plan.checked` says what was checked.
        obstacles: What else the spacecraft and the links must not meet, one or several:
            `Obstacle.box`, `.sphere`, `.cylinder`, `.mesh` and `.robot`, and configurations or
            motions of other robots. They are given in the inertial frame, like the base of the
            start and goal poses. Those that move start with the plan. That none is met is proven
            for the motion with the spacecraft turning as it does.
        clearance: Least distance from every singular posture on the way [rad], from 0 to 1: proven
            for what is flown if J* has minors, else to first order at the rows. If None, 0.1
            degrees, but no more than half the distance at the start.
        keep_attitude: Largest turn of the floating spacecraft on the way [rad], proven between the
            rows too. Joints of another arm, if they count, move to keep it. None allows any turn.
        rates: Largest joint rates [rad/s] or [m/s], one number or (n,); if None those of the
            description, and 0.5 where it gives none.
        wheels: Limits of each wheel that holds the attitude or detumbles; if None those of the
            description, `effort` and `velocity` times its moment of inertia. A spacecraft without
            wheels in its description is held by three, about its axes.

    Raises:
        ConfigurationError: A value does not make sense.
    """

    limits: bool = True
    collisions: bool = True
    obstacles: ObstacleLike | Sequence[ObstacleLike] = ()
    clearance: float | None = None
    keep_attitude: float | None = None
    rates: ArrayLike | None = None
    wheels: WheelHold | None = None

    def __post_init__(self) -> None:
        if self.clearance is not None:
            within(self.clearance, "clearance", 0.0, FARTHEST, "an angle [rad]")
        if self.keep_attitude is not None:
            positive(self.keep_attitude, "keep_attitude", "angle [rad]")
        none = isinstance(self.obstacles, Sequence) and not self.obstacles
        if not self.collisions and not none:
            raise ConfigurationError("obstacles count as collisions do; leave out collisions=False")

    def joint_rates(self, arm: SpaceArm) -> Array:
        """Return the largest rates of the joints of an arm (n,) [rad/s] or [m/s].

        Raises:
            ConfigurationError: They are not positive numbers, one for all or one per joint.
        """
        return for_each_joint(arm, self.rates, "rates", largest_rates(arm))


@checked
@dataclass(frozen=True, kw_only=True)
class Search:
    """How a plan is searched for.

    Attributes:
        seed: Seed of the random first guesses; the same seed gives the same plan, if it is found
            in time.
        timeout: Time after which the search is given up [s]. Until then it goes on with other first
            guesses.
        method: "auto", or one of the methods of `plan`.
        progress: Called now and then as progress(t, timeout), both in s.
        boxes: Boxes of the floating arm, from `free_boxes`; the method "boxes" goes through them.

    Raises:
        ConfigurationError: A value does not make sense.
    """

    seed: int = 0
    timeout: float = 60.0
    method: str = "auto"
    progress: Progress | None = None
    boxes: FreeBoxes | None = None

    def __post_init__(self) -> None:
        whole(self.seed, "seed", 0, math.inf)
        if self.method == "boxes" and self.boxes is None:
            raise ConfigurationError(
                'method "boxes" needs boxes; give boxes=sa.free_boxes(arm), or those of a file'
            )
        positive(self.timeout, "timeout", "time [s]", least=0.0)

    def to_dict(self) -> dict[str, Any]:
        """Return seed, timeout and method as plain data."""
        left_out = ("progress", "boxes")
        return {name: plain(value) for name, value in vars(self).items() if name not in left_out}


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanRequest:
    """What is asked of a strategy.

    Attributes:
        start: Where the plan begins, with the momentum on board and what the wheels hold of it.
        goal: Where the tip or the joints are to arrive.
        goals: Where several tips are to arrive, by their names, in place of `goal`.
        via: Goals on the way, of several tips by their names.
        final_attitude: Attitude of the spacecraft at the end, as for `plan`.
        final_twist: (k,) twist of the tip at the end in the task's rows, of several tips one after
            the other; None for at rest.
        duration: When it ends [s]; None for as soon as it can.
        constraints: What must hold on the way.
        obstacles: The obstacles among them.
        search: How to look for it.
        account: The time of the search, and what stops it.
        held: The arm itself where the start is one on a spacecraft that does not turn.
    """

    start: Configuration
    goal: Goal | Joints
    goals: Mapping[str, Goal] = field(default_factory=dict)
    via: tuple[Goal | Joints | Mapping[str, Goal], ...] = ()
    final_attitude: ArrayLike | pin.SE3 | float | None = None
    final_twist: Array | None = None
    duration: float | None = None
    constraints: Constraints
    obstacles: tuple[Obstacle, ...] = ()
    search: Search
    account: SearchAccount
    held: SpaceArm | None = None

    @classmethod
    def of(
        cls,
        start: Configuration,
        goal: Goal | Joints | Mapping[str, Goal],
        origin: Origin,
        constraints: Constraints,
        search: Search,
        via: Sequence[Goal | Joints | Mapping[str, Goal]],
        final_attitude: ArrayLike | pin.SE3 | float | None,
        duration: float | None,
        final_twist: FinalTwist | None = None,
    ) -> PlanRequest:
        """Return what the arguments of `plan` ask for, checked.

        Raises:
            ConfigurationError: An argument does not make sense.
            UnsupportedError: The arm can never do its task, or has several tips, of
                which none is named.
        """
        start, goals, via = started(start, origin), dict[str, Goal](), tuple(via)
        if isinstance(goal, Mapping):
            start, goals = _with_tips(start, goal), dict(goal)
            goal = next(iter(goals.values()))
        for other in via:
            named = set(other) if isinstance(other, Mapping) else set()
            if named != set(goals) and (named or len(goals) > 1):
                tips = listed(goals) if goals else "none"
                raise ConfigurationError(
                    f"via has {plain(other)!r}; name the tips that goal names: {tips}"
                )
        if len(goals) == 1:
            via = tuple(next(iter(v.values())) if isinstance(v, Mapping) else v for v in via)
        arm, goals = start.arm, goals if len(goals) > 1 else {}
        if not goals:
            arm.require_one_tip()  # whose path the plan holds
            for i, other in enumerate(via):
                if isinstance(other, Joints):
                    joint_vector(arm, other.q, f"via[{i}]")
                else:
                    goal_pose(start, other, f"via[{i}]")
        require_possible(arm, "free-floating")
        twist = None if final_twist is None else _twist(arm, final_twist)
        if twist is not None and not twist.any() and not start.momentum.any():
            twist = None
        return cls(
            start=start,
            goal=goal,
            goals=goals,
            via=via,
            final_attitude=final_attitude,
            final_twist=twist,
            duration=None if duration is None else positive(duration, "duration", "time [s]"),
            constraints=constraints,
            obstacles=obstacles_of(constraints.obstacles, start),
            search=search,
            account=SearchAccount(float(search.timeout), search.progress),
        )

    @property
    def moving(self) -> bool:
        """Whether there is momentum on board, in the wheels or in sum."""
        return bool(self.start.momentum.any() or self.start.wheels.any())

    @property
    def timed(self) -> bool:
        """Whether where it ends depends on the times: there is momentum, or a twist at the end."""
        return self.moving or self.final_twist is not None

    @property
    def aims(self) -> dict[str, tuple[Configuration, pin.SE3]]:
        """The start of each of several tips, of an arm with this tip alone, and its goal."""
        cfg, aims = self.start, {}
        for name in cfg.arm.tips if self.goals else ():
            start = cfg.arm.replace(tip=name, joints=cfg.arm.joint_names).at(cfg.q, base=cfg.base)
            start = start.centred(cfg.com)
            aims[name] = start, goal_pose(start, self.goals[name], "goal")
        return aims

    @property
    def drift(self) -> Array:
        """(3,) velocity of the system CM [m/s]."""
        return self.start.momentum[:3] / self.start.arm.mass

    def at_rest(self, duration: float = 0.0) -> PlanRequest:
        """Return the request seen from the system CM, which drifts on until the tip arrives.

        The start has no momentum and the goal is moved back. Obstacles, which drift the other way
        there, are left out.
        """
        arm, goal, back = self.start.arm, self.goal, pin.SE3(np.eye(3), -self.drift * duration)
        start = arm.at(self.start.q, base=self.start.base)
        goals = {name: back * pose for name, (_, pose) in self.aims.items()}
        if not isinstance(goal, Joints) and not goals:
            goal = back * goal_pose(start, goal, "goal")
        return replace(self, start=start, goal=goal, goals=goals, duration=None, obstacles=())


def _twist(arm: SpaceArm, given: FinalTwist) -> Array:
    """Return the twist at the end (k,) of all tips; tips that are not named come to rest.

    Raises:
        ConfigurationError: It has not a number for each row of the task, or a name is not a tip.
    """
    if not isinstance(given, Mapping):
        if len(arm.tips) > 1:
            raise ConfigurationError(
                f"final_twist is {given!r}; give one for each of the tips by name: "
                f"{listed(arm.tips)}"
            )
        given = {arm.tips[0]: given}
    require_known("tip", given, arm.tips, "final_twist: ")
    k = len(arm.task.rows)
    meaning = f"[m/s] or [rad/s], one for each row of the task: {' '.join(arm.task.rows)}"
    rest = np.zeros(k)
    return np.concatenate(
        [finite(given.get(name, rest), (k,), "final_twist", meaning) for name in arm.tips]
    )


def _with_tips(start: Configuration, tips: Collection[str]) -> Configuration:
    """Return the start of an arm with some of its tips, all of its joints.

    Raises:
        ConfigurationError: A name is no tip, or there are none.
    """
    arm = start.arm
    if not tips:
        raise ConfigurationError(f"goal is empty; name some of the tips {listed(arm.tips)}")
    require_known("tip", tips, arm.tips, "goal: ")
    some = tuple(tip for tip in arm.tips if tip in tips)
    if some == arm.tips:
        return start
    arm = arm.replace(tip=some, joints=arm.joint_names)
    wheels = start.wheels if start.wheels.any() else None
    moved = arm.at(start.q, base=start.base, wheels=wheels, momentum=start.momentum)
    return moved.centred(start.com)
