"""Holding: postures in which the tips of an arm hold one target, or the fixed world.

Closed from a rough start; asked whether the closed chain is singular and how it gets away; led
along paths of the target.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, ArrayLike, Progress, ReadOnlyMapping, generator
from spacearm.closure.closing import Closure, Gaps, anywhere, named, placed
from spacearm.closure.held_report import ClosedMap, HeldReport, closed_map, held_report
from spacearm.closure.regrasping import Freed, Regrasp
from spacearm.closure.target_paths import Carrying, FollowedTarget, Frame, TargetCurve, check_chain
from spacearm.closure.target_plans import TargetPlan, TargetTree
from spacearm.closure.target_runs import Simulation, TargetRun
from spacearm.collisions.obstacles import ObstacleLike
from spacearm.collisions.separation import CollisionReport, contacts_of
from spacearm.description.loops import chain_of, closed_chain
from spacearm.errors import ConfigurationError, NoSolutionError, listed, warn
from spacearm.mechanics.target import Target
from spacearm.model.arguments import FLOATING, BaseMode
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.model.frames import PoseLike, pose_facts, sound_pose
from spacearm.model.joints import joint_vector
from spacearm.model.task import ROWS, Task, with_length
from spacearm.motion import following
from spacearm.motion.controllers import Controller
from spacearm.motion.motion import Motion
from spacearm.motion.plant import Integration, Plant
from spacearm.planning.request import Constraints, Search
from spacearm.results import Column, Description, Measure, Result, Table, joint_measures
from spacearm.signatures import checked
from spacearm.singularities.report import TOLERANCE

#: Gap up to which a grasp is closed [m], [rad].
CLOSED = 1e-9
#: Random postures from which closure is tried where the start leads to none.
POSTURES = 20


class Held(Result):
    """A posture in which the tips of an arm hold one target or the fixed world, from `sa.hold`.

    Attributes:
        configuration: The configuration. Its task has all rows, for planar arms those of the plane.
        target: The target, at the pose in which it is held; None if the fixed world is held.
        grasps: Frame that each tip holds: pose in the target's frame, or in the inertial frame.
        gap: Largest distance of a tip from its grasp [m].
        turn: Largest angle between them [rad].
        tries: Number of postures from which closure was sought; 1 if the start led to it.
    """

    configuration: Configuration
    target: Target | None
    grasps: Mapping[str, pin.SE3]
    gap: float
    turn: float
    tries: int

    @property
    def arm(self) -> SpaceArm:
        """The arm."""
        return self.configuration.arm

    @property
    def q(self) -> Array:
        """(n,) joint positions [rad] or [m]."""
        return self.configuration.q

    @property
    def closed(self) -> bool:
        """Whether all tips are at their grasps; False for the best try of a `NoSolutionError`."""
        return max(self.gap, self.turn) <= CLOSED

    @cached_property
    def carrying(self) -> Carrying:
        """The arms with the target, which is fixed to the first tip."""
        return Carrying(self.configuration, self.target, self.grasps)

    def report(
        self,
        *,
        mode: BaseMode = FLOATING,
        tolerance: float = TOLERANCE,
        exact: bool = False,
        progress: Progress | None = None,
    ) -> HeldReport:
        """Report whether the closed chain is singular, what is lost, and the way out along closure.

        It is singular exactly where the stacked J* of the free hands is, whatever the target
        weighs. The momentum of arm and target together is zero.

        Args:
            mode: What the spacecraft does; see `generalized_jacobian`. It does not matter if the
                fixed world is held.
            tolerance: Distance along closure up to which a posture is singular [rad].
            exact: Whether to search for the nearest singular posture along closure, and to certify
                how far singular postures of the free hands are at least, which holds along closure
                too; see `singularity`. Kind and directions are still decided by first-order
                estimates. Without it the distance is a first-order estimate.
            progress: As in `singularity`, for `exact`.

        Returns:
            Kind, distance, directions, the way out and internal motions.

        Raises:
            ConfigurationError: `mode` or `tolerance` is not valid.
        """
        return held_report(
            self.configuration, self.target, self.grasps, mode, tolerance, exact, progress
        )

    def map(
        self,
        axes: tuple[str, str] = ("x", "y"),
        span: tuple[float, float] = (0.5, 0.5),
        points: int = 31,
        *,
        mode: BaseMode = FLOATING,
        limits: bool = True,
        progress: Progress | None = None,
    ) -> ClosedMap:
        """Map how far singular postures are while what is held moves in two directions.

        Each posture of the grid is closed from its neighbour, beginning with this one; if the arms
        have more joints than they need, it is one of many. If the fixed world is held, the
        spacecraft moves.

        Args:
            axes: The two directions, rows of the task: "x", "y", "z", "rx", "ry", "rz".
            span: How far it moves to both sides [m], or turns [rad].
            points: Number of points along each, an odd number.
            mode: As of `report`.
            limits: Whether the joints stay within their limits.
            progress: Called with the number of postures done, and of all.

        Returns:
            First-order estimates of distances, and least singular values, which `sa.plot` draws.

        Raises:
            ConfigurationError: A value is not valid.
        """
        closure = Closure(self.arm, tuple(self.grasps.values()), True, limits)
        return closed_map(
            self.configuration, self.target, closure, axes, span, points, mode, progress
        )

    def follow(
        self,
        path: following.Path,
        *,
        frame: Frame = "inertial",
        mode: BaseMode = FLOATING,
        length: float | None = None,
        speed: float | None = None,
        times: ArrayLike | None = None,
        at_rest: bool = True,
        rest: ArrayLike | None = None,
        limits: bool = True,
        progress: Callable[[float, float], object] | None = None,
    ) -> FollowedTarget:
        """Lead the target along a path with all grasps closed, as `sa.follow` leads a tip.

        The target goes straight to the beginning first. Closure is restored along the way, not only
        integrated. With redundant joints the internal motion is that of least joint rates, or the
        one towards `rest`.

        Args:
            path: The corners, a sequence of poses of the target's frame; or a function of the path
                length that gives a pose.
            frame: Where poses are given: in the "inertial" frame, or in that of the "spacecraft",
                which turns as the arms move.
            mode: What the spacecraft does; see `generalized_jacobian`.
            length: Length of a path given as a function [m], or [rad] of a mere turn.
            speed: Constant speed along the path [m/s]; see `sa.follow`.
            times: (m,) when the target passes each corner [s]; see `sa.follow`.
            at_rest: Whether a motion with times begins and ends at rest.
            rest: (n,) joint positions to which redundant joints move in the null space, by 1/s.
            limits: Whether joint limits stop the motion.
            progress: Called after every step as progress(s, length), of the whole path.

        Returns:
            The motion of the arms with the target, up to where it ended, and at each row the gaps
            of the grasps and the distance found along closure. Between the rows nothing is checked.

        Raises:
            ConfigurationError: An argument does not make sense, or the start is singular or, where
                limits count, beyond them.
            UnsupportedError: The fixed world is held, there is momentum and the path has no times,
                or there are fewer joints than rows of all tips.
        """
        carrying, start = self.carrying, self.carrying.start
        check_chain(carrying, mode, limits, times is not None)
        seen = carrying.aim(start, frame)
        pieces, pace, timed = following.path_pieces(seen, path, length, speed, times, at_rest)
        inner = None if rest is None else joint_vector(carrying.arm, rest, "rest")

        def curve(at: Configuration, piece: following.Segment) -> TargetCurve:
            return TargetCurve(carrying, at, piece, mode, limits, frame, inner, 1.0 / pace)

        led, told = following.told_along(
            start, seen, pieces, pace, timed, curve, progress, "target"
        )
        return FollowedTarget(mode=mode, **told, **carrying.told(mode, led.rows))

    def plan(
        self,
        goal: PoseLike,
        *,
        frame: Frame = "inertial",
        mode: BaseMode = FLOATING,
        constraints: Constraints = Constraints(),
        search: Search = Search(),
    ) -> TargetPlan:
        """Plan a motion that leads the target to a pose, past obstacles and singular postures.

        A tree of straight motions of the target is grown; those that arrive are shortened. All
        grasps stay closed. With redundant joints the internal motion is that of least joint rates.

        Args:
            goal: The pose of the target's frame.
            frame: Where it is given: in the "inertial" frame, or in that of the "spacecraft" at the
                end. The motions are straight in this frame.
            mode: What the spacecraft does; see `generalized_jacobian`.
            constraints: What must hold; see `plan`. `clearance` is along closure, to the nearest
                singular posture found by search. Limits, clearance and `keep_attitude` are checked
                at the rows. That no bodies meet on the way is proven; hands may touch the target.
            search: Seed, timeout and progress; there is one method.

        Returns:
            The motion, within the joint rates, smooth, at rest at each corner.

        Raises:
            ConfigurationError: An argument does not make sense, or the start is singular or, where
                limits count, beyond them.
            UnsupportedError: The fixed world is held, there is momentum, or there are fewer joints
                than rows of all tips.
            NoSolutionError: No way was found in time, or the start does not keep the constraints;
                says what stopped most branches. `best` is the way that came nearest, if any did.
        """
        pose = sound_pose(goal, "goal")
        return TargetTree(self.carrying, pose, frame, mode, constraints, search).plan()

    def simulate(
        self,
        controller: Controller,
        duration: float,
        *,
        dq: ArrayLike | None = None,
        squeeze: Mapping[str, ArrayLike] | None = None,
        bears: Sequence[float] | Mapping[str, Sequence[float]] = (np.inf, np.inf),
        plant: Plant = Plant(),
        integration: Integration = Integration(),
        progress: Callable[[float, float], object] | None = None,
    ) -> TargetRun:
        """Simulate the arms that hold the target under joint torques, the spacecraft floating.

        Momentum and energy are integrated, not prescribed: their balances show how accurate the
        integration is. After each step joints and velocities are corrected to the nearest closed
        ones.

        Args:
            controller: Called as controller(t, cfg, dq), returns (n,) torques [N m] or forces [N]:
                a law such as `sa.Tracking(held.follow(path))` or `sa.JointPD`. cfg is that of the
                arms with the target.
            duration: How long [s].
            dq: (n,) joint rates at the start, which keep the grasps closed; zeros if None.
            squeeze: What the hands give the target without moving it: for each tip [force [N];
                moment about the grasp [N m]], axes of the target, balanced. The torques of the law
                are changed so that this squeeze acts at all times; zeros ask for none. If None, the
                squeeze is what the law makes it. The least wrenches that give the same motion count
                as moving the target, with moments weighed by the length of the task.
            bears: Largest force [N] and largest moment [N m] at each grasp, or by tip, the others
                without limits. The run ends where one is exceeded, with the event "grasp".
            plant: What else acts: wheels, passive joints, and motor limits, which cut all torques,
                also those that squeeze; no wrenches.
            integration: Tolerances, spacing of the output, and whether to record joint limits and
                full wheels.
            progress: Called after every step as progress(t, duration) [s].

        Returns:
            The run, with what each grasp bears and how far it is open.

        Raises:
            ConfigurationError: An argument does not make sense, rates open the grasps, or wrenches
                that squeeze do not balance.
            UnsupportedError: The fixed world is held, or the plant has wrenches, or wheels that the
                spacecraft has not.
            NoSolutionError: The step collapsed, or the balance of energy or momentum is off.
        """
        run = Simulation(self.carrying, controller, squeeze, bears, plant, integration)
        return run.run(duration, dq, progress)

    def regrasp(
        self,
        tip: str,
        grasp: str | PoseLike,
        *,
        approach: ArrayLike = 0.1,
        closing: float = 0.02,
        constraints: Constraints = Constraints(),
        search: Search = Search(),
    ) -> Regrasp:
        """Find how one hand lets go and grasps another frame, while the others hold on.

        The joints of the other hands are locked. The freed hand backs off, moves by a plan of
        `sa.plan` with the target as the load of another hand, and closes in: three motions from
        rest to rest. The spacecraft floats with the momentum that it has. The first posture at the
        new grasp to which a plan is found is taken. If the fixed world is held, the other grasps
        support the spacecraft: a step of a walk.

        Args:
            tip: The hand that lets go.
            grasp: What it grasps: a grapple frame of the target, or a pose as of `sa.hold`.
            approach: How far it backs off and closes in along its z axis [m]; or, as for planar
                arms, the displacement of the hand as it closes in, (3,) in its own axes.
            closing: Largest mean speed of backing off and closing in [m/s].
            constraints: What must hold; see `plan`. While it backs off and closes in, the hand may
                touch the target. Obstacles rest.
            search: Seed, timeout, method and progress; see `plan`.

        Returns:
            The three motions, with a proof for each. `after` takes it and returns how the target is
            then held.

        Raises:
            ConfigurationError: An argument does not make sense, or nothing else holds.
            UnsupportedError: An obstacle moves, or the freed arm has fewer joints than its task.
            NoSolutionError: No way was found; says why, of the first postures that were tried.
            StoppedError: Ctrl-C.
        """
        pose, here = _frame(self.target, tip, grasp), (self.configuration, self.target, self.grasps)
        return Freed(*here, tip, approach, closing, constraints, search).regrasped(pose)

    def collision_check(
        self,
        motion: Motion | None = None,
        obstacles: ObstacleLike | Sequence[ObstacleLike] = (),
        *,
        progress: Callable[[float, float], object] | None = None,
    ) -> CollisionReport:
        """Check whether arms, spacecraft and target meet each other or obstacles.

        Hands may touch the target; all else is as in `sa.collision_check`.

        Args:
            motion: A motion of the target, from `follow` or `simulate`; this posture if None.
            obstacles: What must not be met besides; see `plan`.
            progress: Called after every sample as progress(done, samples).

        Returns:
            Whether they stay apart, where not, and the distances at the samples.

        Raises:
            ConfigurationError: It is the motion of another arm.
            UnsupportedError: The fixed world is held, or no two bodies have shapes that could meet.
        """
        carrying = self.carrying
        if motion is not None and set(motion.arm.tree.links) != set(carrying.arm.tree.links):
            raise ConfigurationError(
                f"motion is one of {motion.arm.name}, not of it with this target; give one as "
                "Held.follow makes it"
            )
        thing = carrying.start if motion is None else motion
        return contacts_of(thing, obstacles, carrying.touching, progress=progress)

    def after(self, motion: Motion | Regrasp) -> Held:
        """Return how the target is held at the end of a motion, or after a hand has regrasped.

        Args:
            motion: A motion of the same joints, such as one of `follow`; or what `regrasp` returns.

        Raises:
            ConfigurationError: It is the motion of another arm.
        """
        if isinstance(motion, Regrasp):
            return _held(motion.end, motion.target, motion.grasps, 1)
        if motion.arm.joint_names != self.arm.joint_names:
            raise ConfigurationError(
                f"motion is one of {motion.arm.name} with other joints; give one of this target, "
                "as Held.follow makes it"
            )
        end = motion[-1]
        there = kinematics(self.arm, end.q.copy(), end.base)
        there = there.with_momentum(end.momentum).with_wheels(end.wheels)
        first = self.grasps[self.arm.tips[0]].inverse()
        moved = self.target and self.target.replace(pose=there.tips[0] * first)
        return _held(there, moved, self.grasps, 1)

    not_checked = "collisions, and singular postures: Held.report()"

    def describe(self) -> Description:
        """Describe where what is held is, and where it is grasped."""
        cfg, target = self.configuration, self.target
        moved = cfg.base if target is None else target.pose
        rows = [(tip, *pose_facts(grasp).values()) for tip, grasp in self.grasps.items()]
        place = {
            **pose_facts(moved),
            "largest gap of a grasp": Measure(self.gap, "m", ".1e"),
            "and angle": Measure(self.turn, "rad", ".1e"),
        }
        outside = f"; outside its limits: {listed(cfg.outside_limits)}" * bool(cfg.outside_limits)
        far = "; the start led to none: found from a random posture" * (self.tries > 1)
        columns = (Column("tip"), Column("holds, place"), Column("roll, pitch, yaw"))
        joints = {"joint": cfg.arm.joint_names, "q": joint_measures(cfg.q, cfg.arm.slides)}
        return Description(
            title=f"{cfg.arm.name} and {named(target)}",
            verdict=f"held by {listed(list(self.grasps))}{far}{outside}",
            tone="good" if not outside else "caution",
            tables=[
                Table.facts(place, "The spacecraft" if target is None else target.name),
                Table(columns, rows, "Grasps"),
                Table.by_columns(joints, "Posture"),
            ],
        )


@checked
def hold(
    start: Configuration,
    target: Target | None = None,
    grasps: Mapping[str, str | PoseLike] | None = None,
    *,
    fixed: bool = False,
    limits: bool = True,
    seed: int = 0,
) -> Held:
    """Find a posture in which the tips of an arm hold one target, near a rough start.

    Gauss-Newton steps of joints and target close the chain within the joint limits. They begin at
    the start, then at random postures farther and farther from it. The target begins where it is
    given, or at the first tip. A start that is closed already is kept, with the target where the
    tips are.

    Args:
        start: The start. Its arm has all tips that hold: `sa.load(source, tip=["left", "right"])`.
        target: What is held, roughly where it is; its twist does not count. None for the fixed
            world, such as handrails of a station.
        grasps: What each tip holds: the name of a grapple frame of the target, or a pose in the
            target's frame. For the fixed world it is a pose in the inertial frame. z points into
            what is held, as the z axis of the hand does. Default, without a target: what the arm's
            file closes, by an equality of MJCF or a joint of SDF that closes a loop, or two links
            that hold each other; see `load`.
        fixed: Whether the target stays where it is; if the fixed world is held, whether the
            spacecraft does.
        limits: Whether the joints stay within their limits.
        seed: Seed of the random postures.

    Returns:
        The closed posture.

    Raises:
        ConfigurationError: The grasps are not those of all tips, or a value is not valid.
        NoSolutionError: Nothing tried closes; names the remaining gap. `best` is the nearest try.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("dual_ur5", tip=["left", "right"])
        >>> start = arm.at([0.4, -1, 1.5, 0.3, 0.5, 0] * 2)
        >>> box = sa.Bus(90, size=(0.4, 0.4, 0.4))
        >>> debris = sa.Target(box, start.tips[0] * sa.pose((0, 0, 0.3)))
        >>> sides = {"left": sa.pose((0, 0, -0.2)), "right": sa.pose((0, 0, 0.2), (3.1416, 0, 0))}
        >>> held = sa.hold(start, debris, sides)
        >>> held.report().kind
        'regular'
    """
    arm = _with_all_rows(start.arm)
    if grasps is None:
        target, grasps = _described(start, target)
    frames = _frames(start.arm, target, grasps)
    start = replace(start, arm=arm)
    closure = Closure(arm, tuple(frames.values()), fixed, limits)
    where = start.base.actInv(pin.SE3.Identity() if target is None else target.pose)
    rng, found = generator(seed), list[Held]()
    hand, q = frames[arm.tips[0]].inverse(), start.q
    in_hand = start.base.actInv(start.tips[0] * hand)
    kept = _held(*placed(start, target, q, in_hand), frames, 1)
    if kept.closed and not (fixed or (limits and start.outside_limits)):
        return kept
    for tries in range(1, 2 + POSTURES):
        at = where
        if tries > 1:
            q = start.q + (tries - 1) / POSTURES * (anywhere(arm, limits, rng) - start.q)
            if tries % 2 and not fixed:
                at = kinematics(arm, q, pin.SE3.Identity()).tips[0] * hand
        cfg, there = placed(start, target, *closure.solved(q, at))
        found.append(_held(cfg, there, frames, tries))
        if found[-1].closed:
            return found[-1]
    best = min(found, key=lambda held: held.gap + held.turn)
    raise NoSolutionError(
        f"{arm.name} does not hold {named(target)}: from the start and {POSTURES} random postures "
        f"on, a tip stays {best.gap:.3g} m and {np.degrees(best.turn):.3g}° off its grasp at best; "
        f"correct the grasps{', or let what is held move: fixed=False' * fixed}"
        f"{', or try limits=False' * limits}",
        best,
    )


def closed_by_itself(start: Configuration) -> Held | None:
    """Return a posture near a start in which the chain closes that its arm describes.

    None if it describes none, or none closes within the joint limits, which is warned of.
    """
    if chain_of(start.arm.whole, start.arm.tips) is None:
        return None
    try:
        return hold(start)
    except NoSolutionError as error:
        warn(f"the chain is shown open: {error}")
        return None


def _described(
    start: Configuration, target: Target | None
) -> tuple[Target | None, Mapping[str, pin.SE3]]:
    """Return what the description of the arm holds, at the first tip, and its grasps."""
    arm, chain = start.arm, closed_chain(start.arm.whole)
    if target is not None or chain is None:
        raise ConfigurationError(
            f"there are no grasps, and {arm.name} describes no closed chain"
            f"{' that holds a target' * (chain is not None)}; give grasps={{tip: frame}}"
        )
    if set(chain.tips) != set(arm.tips):
        raise ConfigurationError(
            f"the tips of {arm.name} are {listed(arm.tips)}, and {listed(chain.loops)} close the "
            f"chain of {listed(chain.tips)}; load it without tip, or give grasps={{tip: frame}}"
        )
    if chain.held is None:
        return None, chain.grasps
    return Target(chain.held, start.tips[0] * chain.grasps[arm.tips[0]].inverse()), chain.grasps


def _held(
    cfg: Configuration, target: Target | None, frames: Mapping[str, pin.SE3], tries: int
) -> Held:
    """Return what was found, with its gaps."""
    there = pin.SE3.Identity() if target is None else target.pose
    gaps = Gaps.of(cfg.tips, there, frames.values())
    return Held(cfg, target, ReadOnlyMapping(frames), *gaps, tries)


def _with_all_rows(arm: SpaceArm) -> SpaceArm:
    """Return an arm whose task has all rows, of a planar arm those of its plane."""
    normal = arm.tree.plane_normal()
    rows = (
        ROWS if normal is None else [r for i, r in enumerate(ROWS) if (i % 3 == normal) == (i > 2)]
    )
    task = Task(" ".join(rows), arm.task.length)
    return replace(arm, task=with_length(task, arm.tree, arm.tips, arm.path), _asked=task)


def _frames(
    arm: SpaceArm, target: Target | None, grasps: Mapping[str, str | PoseLike]
) -> dict[str, pin.SE3]:
    """Return the grasps as poses, in the order of the arm's tips."""
    if not isinstance(grasps, Mapping) or set(grasps) != set(arm.tips):
        raise ConfigurationError(
            f"grasps is {grasps!r}; give {{tip: frame}} for each tip of {arm.name}: "
            f"{listed(arm.tips)}; sa.load(source, tip=[...]) names other tips"
        )
    return {tip: _frame(target, tip, grasps[tip]) for tip in arm.tips}


def _frame(target: Target | None, tip: str, grasp: str | PoseLike) -> pin.SE3:
    """Return what a tip holds as a pose."""
    if not isinstance(grasp, str):
        return sound_pose(grasp, f"grasp of {tip!r}")
    if target is None:
        raise ConfigurationError(
            f"grasp of {tip!r} is {grasp!r}; give a pose: the fixed world has no named frames"
        )
    return target.frame(grasp)
