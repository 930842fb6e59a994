"""Two hands: a target is caught by several tips, and braked by all of them.

All tips are led to stand-offs before their grapple frames, take up the motion of these and close
in together, or one after the other. A hand that holds moves on with the target and applies no
wrench to it. Once all hold, the chain is closed: its target comes to rest, seen from the
spacecraft, along the screw that it moves along then, and all joints follow closure. Torques are
those by which the hands give the target the least wrenches that move it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin

from spacearm import errors
from spacearm.arrays import Array, ReadOnlyMapping
from spacearm.closure.closed_distances import ClosedSearch
from spacearm.closure.closing import Gaps, carried, target_momentum
from spacearm.closure.holding import Held, hold
from spacearm.closure.shared_loads import LOOSE, shared_peaks
from spacearm.closure.target_paths import Carrying, TargetCurve, with_target
from spacearm.closure.target_runs import TargetRun, closed_state, onto_closure
from spacearm.mechanics.dynamics import (
    Capture,
    generalized_velocity,
    inverse_dynamics,
    mass_matrix,
    solve,
)
from spacearm.mechanics.floating import carried_along, samples
from spacearm.mechanics.target import Target
from spacearm.mission.approaching import NO_WAY, Approach, Grapple, away, in_turn
from spacearm.mission.braking import Braking, BrakingTry, shortest
from spacearm.mission.catch_report import Catch
from spacearm.mission.kept_limits import with_checks
from spacearm.model.arguments import FLOATING
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.motion import following
from spacearm.motion.controllers import Tracking
from spacearm.motion.events import Event
from spacearm.motion.flights import Flight, Phase, simulate_phases
from spacearm.motion.goal import out_of_reach, twist_between
from spacearm.motion.motion import Motion, Trajectory
from spacearm.motion.plant import Integration, Plant
from spacearm.planning.account import TimeUpError
from spacearm.planning.planner import plan
from spacearm.planning.problem import LEAST
from spacearm.planning.request import Joints, Search
from spacearm.planning.result import Plan
from spacearm.planning.timing import rate_bounds
from spacearm.results import Description
from spacearm.singularities.nearest import angle


class ClosedBraking(Braking, kw_only=True):
    """The motion by which arms that hold a target bring their joints to rest along closure.

    Its arm is the arms with the target, which is fixed to the first tip. `wrench` (m, 6 tips) is
    what each hand gives the target, axes of its tip.

    Attributes:
        gap: (m,) largest distance of a tip from its grasp [m].
        gap_angle: (m,) largest angle between them [rad].
        closure_distance: (m,) how far the nearest singular posture found along closure is [rad], as
            of `FollowedTarget`.
    """

    gap: Array
    gap_angle: Array
    closure_distance: Array


class HandsFlight(Flight, kw_only=True):
    """The flight of a catch by several hands, from `Catch.fly`.

    From the first grasp on its phases are a `TargetRun` each. `tip_wrench` has (m, 6 tips).

    Attributes:
        carryings: How the target is carried in each phase; None before the first grasp.
    """

    carryings: tuple[Carrying | None, ...] = ()

    def phase_distances(self, i: int) -> Array:
        """Return the distance to the singular set [rad] in phase i, as `Flight.phase_distances`.

        Where all tips hold the target it is that of the nearest posture found along closure.
        """
        run, carrying = self.phases[i], self.carryings[i]
        if carrying is None or len(carrying.grasps) < len(self.arm.tips):
            return run.distance
        return carrying.closure_distances(FLOATING, [*run])

    def phase_wrenches(self, i: int) -> Array:
        """Return the wrenches of all tips in phase i, as `Flight.phase_wrenches`."""
        run, tips = self.phases[i], self.arm.tips
        if not isinstance(run, TargetRun):
            return np.zeros((len(run), 6 * len(tips)))
        turns = [[tip.rotation for tip in cfg.tips] for cfg in run]
        none = np.zeros((len(run), 6))
        given = np.stack([run.grasps.get(tip, none) for tip in tips], axis=1)
        in_tips = given.reshape(*given.shape[:2], 2, 3) @ np.array(turns)
        return in_tips.reshape(len(given), -1)


class HandsCatch(Catch, kw_only=True):
    """How several hands catch a target, from `sa.catch`.

    It is a `Catch`: at contact the last hand grasps, `brake` is along closure, `twist_error`
    (6 tips,) is that of all tips, place and angle are those of the tip that is farthest off.
    Nothing is proven of singular postures: `distance_proven` is 0.

    Attributes:
        held: How the target is held at contact, with the momentum of both.
        grasped: When each tip grasps [s]; from then on it moves as its frame does.
    """

    held: Held
    grasped: Mapping[str, float]
    brake: ClosedBraking = field()

    @cached_property
    def clearance(self) -> float:
        """Distance of the nearest singular posture found from the samples [rad], an upper bound.

        Of the free hands up to contact, then along closure.
        """
        ways = self.plan.distance, self.chase.distance, self.brake.closure_distance
        return float(min(way.min() for way in ways))

    @property
    def margin(self) -> str:
        """How near singular postures are, in words."""
        return (
            f"nearest singular posture found from the samples: {angle(self.clearance)} (upper "
            "bound, found by search; a nearer one may have been missed)"
        )

    @property
    def not_checked(self) -> str:
        """What the answer does not cover."""
        return (
            f"singular postures, joint limits and closure between the rows; {super().not_checked}"
        )

    def fly(
        self,
        actual: Target | None = None,
        *,
        plant: Plant = Plant(),
        integration: Integration = Integration(),
        progress: Callable[[float, float], object] | None = None,
    ) -> Flight:
        """Simulate the catch, as `Catch.fly`: each grasp is a plastic impact.

        From then on arms and target are as `Held.simulate` has them, without squeezing. Wheels do
        what the plant says.

        Args:
            actual: The target as it is; the hands grasp it wherever they are then.
            plant: What else acts, as in `Held.simulate`.
            integration: How it is integrated.
            progress: Called now and then as progress(t, duration).

        Returns:
            The flight: "approach", "closing in" and "braking", a `TargetRun`; where hands grasp
            one after the other, "closing in" of each, from the second one on a `TargetRun`, too.

        Raises:
            SpaceArmError: As `simulate_phases` and `Held.simulate` raise.
        """
        target, arm = (actual or self.target).relative_to(self.plan[0]), self.arm
        total = self.t + float(self.brake.t[-1])
        begun = replace(self.plan, t=self.begin + self.plan.t)
        contacts, stands = sorted(set(self.grasped.values())), self.t - float(self.chase.t[-1])
        turns = [[tip for tip, t in self.grasped.items() if t == contact] for contact in contacts]
        words = [f"closing in{f', {errors.listed(tips)}' * (len(turns) > 1)}" for tips in turns]

        def tell(begin: float) -> Callable[[float, float], object] | None:
            return progress and (lambda t, _: progress(begin + t, total))

        phases = [
            Phase(
                Tracking(motion), duration, plant=plant, name=name, integration=integration
            )
            for name, motion, duration in (
                ("approach", begun, float(begun.t[-1])),
                (words[0], self.chase, contacts[0] - stands),
            )
        ]  # fmt: skip
        free = simulate_phases(self.plan[0], phases, progress=tell(0.0))
        runs: list[Trajectory] = [*free.phases]
        carryings: list[Carrying | None] = [None] * len(runs)
        begins, events, hits = free.begins.tolist(), [*free.events], list[Capture]()
        end, dq, met = runs[-1][-1], free.dq[-1], target.at(float(free.t[-1]))
        pose, twist = met.pose, met.twist
        for i, (contact, until) in enumerate(pairwise([*contacts, total])):
            tips = [tip for tip in arm.tips if self.grasped[tip] <= contact]
            places = dict(zip(arm.tips, end.tips, strict=True))
            grasps = {tip: pose.actInv(places[tip]) for tip in tips}
            hands = kinematics(arm.replace(tip=tips, joints=arm.joint_names), end.q, end.base)
            there = target.replace(pose=pose)
            held = hold(hands.with_momentum(end.momentum), there, grasps, limits=False)
            hit = impact(held, dq, twist)
            held = replace(held, configuration=held.configuration.with_momentum(hit.momentum))
            run = held.simulate(
                Tracking(self._from(contact, tips[0])), until - contact, dq=hit.dq,
                squeeze=dict.fromkeys(tips, np.zeros(6)), plant=plant, integration=integration,
                progress=tell(contact),
            )  # fmt: skip
            whole = run.arm.replace(tip=[*arm.tips], joints=run.arm.joint_names)
            run = replace(run, arm=whole)
            detail = f"{errors.listed(turns[i])}: " * (len(turns) > 1)
            detail += f"{target.mass:g} kg, {hit.energy_lost:.3g} J lost"
            events += [Event(contact, "grasp", end.q, detail)]
            events += [event._replace(t=contact + event.t) for event in run.events]
            runs, begins, hits = [*runs, run], [*begins, contact], [*hits, hit]
            carryings.append(held.carrying)
            last, dq, pose = run[-1], run.dq[-1], pin.XYZQUATToSE3(run.target[-1])
            v = generalized_velocity(last, dq)
            seen = kinematics(held.carrying.of_target, last.q, last.base)
            twist, end = seen.J @ v, kinematics(arm, last.q, last.base)
            end = end.with_momentum(end.A @ v)
        names = ["approach", *words, "braking"]
        flight = HandsFlight.joined(runs, begins, events, hits, names, [None] * len(runs))
        return with_checks(replace(flight, carryings=tuple(carryings)), self.limits)

    def _from(self, contact: float, tip: str) -> Motion:
        """Return the motion from a contact on, of the arms with the target in their hands.

        Args:
            contact: When [s].
            tip: A hand that holds it then.
        """
        if contact >= self.t:
            return self.brake
        chase, frame = self.chase, self.target.frame(self.frames[tip])
        arm = with_target(chase[-1], self.target, frame.inverse(), tip)[0].arm
        clock = chase.t - chase.t[-1] + self.t - contact
        momentum = np.tile(self.momentum, (len(chase), 1))
        return replace(chase, arm=arm, t=clock, momentum=momentum)

    def describe(self) -> Description:
        """Describe it as `Catch.describe`, and when each hand grasps."""
        told = super().describe()
        times = [f"{tip} grasps after {t:.4g} s" for tip, t in self.grasped.items()]
        return replace(told, notes=[errors.listed(times), *told.notes])

    def to_dict(self) -> dict[str, Any]:
        """Return what `Catch` tells, when hands grasp, and how far singular postures are."""
        return super().to_dict() | {"clearance": self.clearance, "grasped": dict(self.grasped)}


class HandsCurve(following.TipCurve):
    """The curve of states along which several tips follow each its segment.

    Args:
        cfg: Configuration at its start.
        segments: Those of all tips, over the time.
        limits: Whether joint limits end it.
    """

    def __init__(
        self, cfg: Configuration, segments: Sequence[following.Segment], limits: bool
    ) -> None:
        self.segments = segments
        super().__init__(cfg, segments[0], FLOATING, limits)

    def wanted(self, cfg: Configuration, s: float) -> Array:
        """Return the twists (6 tips,) of the tips, and back to where they should be."""
        pairs = zip(cfg.tips, self.segments, strict=True)
        return np.concatenate(
            [one.twist(s) + self.correction * twist_between(tip, one.pose(s)) for tip, one in pairs]
        )

    def place(self, cfg: Configuration) -> Array:
        """Return where (3,) the first tip is [m]."""
        return cfg.tips[0].translation


class HandsApproach(Approach):
    """What is asked for of several hands, checked; `grapples` are the frames of the tips."""

    @classmethod
    def named(cls, arm: SpaceArm, target: Target, grapple: Grapple) -> tuple[str, ...]:
        """Return the grapple frames of all tips, in their order.

        Raises:
            ConfigurationError: They are not those of all tips.
            UnsupportedError: The task is not a pose, or the joints are too few for it.
        """
        given = [pair for group in in_turn(grapple) for pair in group.items()]
        if sorted(tip for tip, _ in given) != sorted(arm.tips):
            raise errors.ConfigurationError(
                f"grapple is {grapple!r}; give {{tip: frame}} for each tip of {arm.name}: "
                f"{errors.listed(arm.tips)}; sa.load(source, tip=[...]) names other tips"
            )
        for _, name in given:
            errors.require_known(f"grapple of {target.name}", name, target.grapples)
        frames = tuple(dict(given)[tip] for tip in arm.tips)
        if len(set(frames)) < len(frames):
            raise errors.ConfigurationError(
                f"grapple is {grapple!r}; give each tip a frame of its own"
            )
        if arm.task.k < 6 * len(frames) or arm.n < arm.task.k:
            raise errors.UnsupportedError(
                f"{arm.name} has the task {arm.task.names!r} and {arm.n} joints; several hands "
                f"catch by their poses, {6 * len(frames)} rows: sa.load(..., task='pose')"
            )
        return frames

    def check_start(self) -> None:
        """Refuse what several hands cannot do, and a start at which the target is met at once."""
        if self.mode != FLOATING:
            raise errors.UnsupportedError(
                f"mode is {self.mode!r}; several hands catch from a spacecraft that floats: leave "
                "out mode, or catch by one tip"
            )
        if self.moving:
            raise errors.UnsupportedError(
                "the start has momentum on board, with which several hands catch nothing; leave "
                "out momentum and wheels of the start, or catch by one tip"
            )
        super().check_start()

    @cached_property
    def turns(self) -> dict[str, int]:
        """Number of the turn in which each frame is grasped, from 0 on."""
        groups = in_turn(self.asked)
        return {frame: i for i, group in enumerate(groups) for frame in group.values()}

    @property
    def duration(self) -> tuple[float, float]:
        """How long the tips take up the target's motion, and how long all close in [s]."""
        takes_up, close = super().duration
        return takes_up, (1 + max(self.turns.values())) * close

    def closes(self, grapple: str) -> tuple[float, float]:
        """When the tip of a grapple frame begins to close in, and how long that takes [s]."""
        takes_up, close = super().duration
        return takes_up + self.turns[grapple] * close, close

    @property
    def choices(self) -> tuple[str, ...]:
        """All frames together, the only choice."""
        return (", ".join(self.grapples),)

    @cached_property
    def proves(self) -> float:
        """Distance to the singular set at which no other catch is sought: there is none."""
        return math.inf

    def settled(self, found: Catch) -> Catch:
        """Return a catch as it is: nothing is proven of several hands."""
        return found

    @cached_property
    def single(self) -> tuple[SpaceArm, ...]:
        """The arm with each tip as the only one."""
        arm = self.start.arm
        return tuple(arm.replace(tip=tip, joints=arm.joint_names) for tip in arm.tips)

    def hands(self, cfg: Configuration) -> list[tuple[Configuration, str]]:
        """Return a configuration with each tip as the only one, and the frame of that."""
        q, base = cfg.q.copy(), cfg.base
        return [
            (kinematics(one, q, base), name)
            for one, name in zip(self.single, self.grapples, strict=True)
        ]

    def rank(self, t: float, _: str) -> tuple[bool, float]:
        """Return whether a frame is out of reach at a time, and how much one looks away at most."""
        hands = self.hands(self.start)
        return max(away(cfg, self.target.at(t, name).pose, self.axis) for cfg, name in hands)

    def straight(self, *_: object) -> Iterator[Joints]:
        """Yield once: tips are led along straight lines once for each time."""
        yield Joints(self.start.q)

    def attempt(
        self, t: float, grapple: str, ways: Iterator[Joints], search: Search, lasts: float
    ) -> Catch:
        """Return the catch at a time, as `Approach.attempt`.

        Straight lines of the tips are tried first, then all that `plan` has.

        Raises:
            SpaceArmError: There is none, or none was found.
        """
        goals = dict[str, pin.SE3]()
        for cfg, name in self.hands(self.start):
            if why := out_of_reach(cfg, self.target.at(t, name).pose):
                raise errors.ImpossibleError(f"{cfg.arm.tip}: {why}")
            goals[cfg.arm.tip] = self.path(t, name, nodes=1)[0][0]
        stands, look = t - sum(self.duration), replace(search, method="straight")
        if lasts > 0.0 and search.method != "straight":
            look = replace(search, timeout=min(lasts, search.timeout))
        elif next(ways, None) is None:
            raise errors.NoSolutionError(NO_WAY)
        among = replace(self.constraints, wheels=None)
        reach = plan(self.start, goals, constraints=among, search=look)
        slowly = min(stands, self.duration[0])  # as the tips take up the target's motion then
        still = len(reach) > 1 and not any(obstacle.moves for obstacle in reach.obstacles)
        if still and self._in_time(reach, stands).t[-1] < slowly:
            reach = replace(reach, t=reach.t / reach.t[-1] * slowly)
        if self._met(self._in_time(reach, stands), stands):
            raise errors.NoSolutionError("the way to the stand-off meets the target")
        return self._caught(t, grapple, reach)

    def _chase(self, t: float, reach: Plan) -> following.Followed:
        """Return the motion of all tips from the stand-offs to contact.

        Raises:
            NoSolutionError: It does not arrive.
        """
        start, segments = reach[-1], list[following.Segment]()
        hands = self.hands(start)
        for cfg, name in hands:
            poses, clock = self.path(t, name, cfg)
            segments.append(following.timed_curve(cfg, poses, clock, at_rest=False))
        _, told = following.told_along(
            start, hands[0][0], segments[:1], 1.0, True,
            lambda at, _: HandsCurve(at, segments, self.constraints.limits), self.account.tick,
            what="first tip",
        )  # fmt: skip
        return following.Followed(**told)

    def _caught(self, t: float, _: str, reach: Plan) -> Catch:
        """Return the catch at a time, from a plan to the stand-offs.

        Raises:
            SpaceArmError: It keeps not all constraints.
        """
        arm, target, chase = self.start.arm, self.target, self._chase(t, reach)
        self._check_chase(chase, t)
        rates = self.constraints.joint_rates(arm)
        least = LEAST if self.constraints.clearance is None else self.constraints.clearance
        if (near := float(chase.distance.min())) < least:
            raise errors.NoSolutionError(
                f"from the stand-off on a singular posture is about {angle(near)} away, and the "
                f"clearance is {angle(least)}"
            )
        end, met = chase[-1], target.at(t)
        frames = dict(zip(arm.tips, self.grapples, strict=True))
        takes = sum(self.duration)
        grasped = {tip: t - takes + sum(self.closes(name)) for tip, name in frames.items()}
        held = hold(end, target.replace(pose=met.pose), frames, fixed=True, limits=False)
        hit = impact(held, chase.dq[-1], met.twist)
        held = replace(held, configuration=held.configuration.with_momentum(hit.momentum))
        try:
            brake = self._braked(held, hit.dq, rates, float(least))
        except errors.NoSolutionError as error:
            raise errors.NoSolutionError(f"with {target.name} in the hands, {error}") from None
        told = self._told(t, reach, chase, brake)
        wanted = [target.at(t, name) for name in self.grapples]
        off = Gaps.of(end.tips, met.pose, [target.frame(name) for name in self.grapples])
        twists = end.J @ generalized_velocity(end, chase.dq[-1])
        return HandsCatch(
            **told,
            grapple=ReadOnlyMapping(frames),
            distance_proven=0.0,
            place_error=off.gap,
            turn_error=off.turn,
            twist_error=twists - np.concatenate([frame.twist for frame in wanted]),
            momentum=hit.momentum,
            wheel_load=(),
            held=held,
            grasped=ReadOnlyMapping(grasped),
        )

    def _braked(self, held: Held, dq: Array, rates: Array, least: float) -> ClosedBraking:
        """Return the shortest braking that keeps limits, rates, torques and what grasps bear.

        Args:
            held: How the target is held, with the momentum of both.
            dq: (n,) joint rates at contact, which keep the grasps closed.
            rates: (n,) the largest.
            least: Least distance to a singular posture along closure [rad].

        Raises:
            NoSolutionError: None of the times tried does; says why.
            TimeUpError: The time is up, and none is found.
        """
        carrying = held.carrying
        seen = kinematics(carrying.of_target, held.q.copy(), pin.SE3.Identity())
        twist = seen.J[:, 6:] @ dq
        search = carrying.search(FLOATING)

        def tried(duration: float) -> BrakingTry[ClosedBraking]:
            return self._tried_braking(carrying, seen.tip, twist, duration, rates, least, search)

        brake = shortest(tried)
        near = carrying.closure_distances(FLOATING, [*brake], search)
        if near.min() < least:
            raise errors.NoSolutionError(
                f"braking in {brake.t[-1]:.3g} s leads to {angle(float(near.min()))} of a singular "
                "posture"
            )
        brake = replace(brake, closure_distance=near)
        assert brake.peaks is not None  # within the limits, otherwise loose
        try:
            peaks = shared_peaks(brake, carrying, self.account.check_time, margin=LOOSE)
        except TimeUpError:
            return brake
        peaks = peaks._replace(bound=np.minimum(peaks.bound, brake.peaks.bound))
        return replace(brake, peaks=peaks)

    def _tried_braking(
        self, carrying: Carrying, pose: pin.SE3, twist: Array, duration: float, rates: Array,
        least: float, search: ClosedSearch,
    ) -> BrakingTry[ClosedBraking]:  # fmt: skip
        """Return the braking in a duration [s], or why it is not possible.

        Args:
            carrying: The arms with the target, with the momentum of both.
            pose: Where the target is at contact, seen from the spacecraft.
            twist: (6,) its twist there.
            duration: How long it takes [s].
            rates: (n,) the largest joint rates.
            least: Least distance to a singular posture along closure [rad].
            search: The search for these.
        """
        start = carrying.start
        led, last, _ = following.rows_along(  # time is counted in durations
            start.with_momentum(duration * start.momentum),
            [stopping(pose, duration * twist)], 1.0,
            lambda at, piece: TargetCurve(
                carrying, at, piece, FLOATING, self.constraints.limits, "spacecraft"
            ),
            self.account.tick,
        )  # fmt: skip
        if last.kind != "arrived":
            after = duration * led.s[-1]
            why = f"braking in {duration:.3g} s ends at a {last.kind} after {after:.3g} s"
            return BrakingTry(None, True, why)
        self.account.check_time()
        brake = closed_braking(carrying, led, duration, search, least)
        near = float(brake.closure_distance.min())
        if near < least:
            why = f"braking in {duration:.3g} s leads to about {angle(near)} of a singular posture"
            return BrakingTry(None, True, why)
        found = self._judged(brake, rates)  # at the samples
        if found.brake is None:
            return found
        allowed = np.concatenate((self.efforts, np.tile(self.bears, len(carrying.grasps))))
        peaks = shared_peaks(brake, carrying, self.account.check_time, allowed=allowed)
        return self._judged(replace(brake, peaks=peaks), rates)

    def _judged(self, brake: ClosedBraking, rates: Array) -> BrakingTry[ClosedBraking]:
        """Return a braking as possible if it keeps rates, torques and what the grapples bear."""
        faster, (force, moment) = float((rate_bounds(brake.spline) / rates).max()), brake.borne
        torque = float((brake.largest_torques / self.efforts).max())
        why = (
            f"braking in {brake.t[-1]:.3g} s takes {torque:.3g} times the torque and {faster:.3g} "
            f"times the rate of a joint, and {force:.3g} N and {moment:.3g} N m of a grapple"
        )
        fits = max(torque, faster) <= 1.0 and force <= self.bears[0] and moment <= self.bears[1]
        return BrakingTry(brake if fits else None, False, why)


def stopping(pose: pin.SE3, way: Array) -> following.Segment:
    """Return the screw along which what moves comes to rest, over the share of the time.

    Args:
        pose: Where it is.
        way: (6,) how far it would move meanwhile, [that of its frame's origin; turn].
    """

    def along(s: float) -> pin.SE3:
        s = min(s, 1.0)
        done = (s - s**3 + 0.5 * s**4) * way
        return pin.SE3(pin.exp3(done[3:]) @ pose.rotation, pose.translation + done[:3])

    def rate(s: float) -> Array:
        s = min(s, 1.0)
        return (1.0 - 3.0 * s**2 + 2.0 * s**3) * way

    return following.Segment(1.0, along, rate, False)


def closed_braking(
    carrying: Carrying,
    led: following.Led,
    duration: float,
    search: ClosedSearch,
    least: float,
) -> ClosedBraking:
    """Return the braking with its torques and wrenches.

    Distances along closure are estimates where they are far above the least that is allowed.

    Args:
        carrying: The arms with the target, with the momentum of both.
        led: The rows over the share of the time.
        duration: How long it takes [s].
        search: The search for singular postures along closure.
        least: Least distance to one [rad].
    """
    momentum, none = carrying.start.momentum, np.zeros((len(carrying.grasps), 6))
    rows = [cfg.with_momentum(momentum) for cfg in led.rows]
    dq, ddq = led.dq / duration, led.ddq / duration**2
    torque, wrench = list[Array](), list[Array]()
    for cfg, rates, change in zip(rows, dq, ddq, strict=True):
        tau = inverse_dynamics(cfg, rates, change).tau
        state = closed_state(carrying, cfg, generalized_velocity(cfg, rates), tau, none)
        turns = np.array([tip.rotation for tip in cfg.tips])
        torque.append(state.tau)
        wrench.append((state.wrenches.reshape(-1, 2, 3) @ turns).ravel())
    gaps = carrying.account(rows)
    return ClosedBraking(
        arm=carrying.arm, t=duration * led.s, **samples(rows),
        **carried_along(carrying.start, len(rows)),
        dq=dq, ddq=ddq, torque=np.array(torque), wrench=np.array(wrench),
        gap=gaps["gap"], gap_angle=gaps["gap_angle"],
        closure_distance=np.array([search.least(*carrying.hands(cfg), least) for cfg in rows]),
    )  # fmt: skip


def impact(held: Held, dq: Array, twist: Array) -> Capture:
    """Return what all hands do to a target and it to them as they grasp, a plastic impact.

    The velocities just after are those next to the velocities before, by energy, that keep the
    grasps closed: impulses of the grasps lead there, momentum stays.

    Args:
        held: How it is held, with the momentum of the arm alone.
        dq: (n,) joint rates before.
        twist: (6,) that of the target's frame before.
    """
    arm, carrying, target = held.configuration, held.carrying, held.target
    assert target is not None
    whole, at = carrying.start, target.pose.translation
    before = generalized_velocity(arm, dq)
    J = carried(at - arm.tips[0].translation) @ arm.J[:6]
    M, M_t, M_whole = mass_matrix(arm), target_momentum(target, at), mass_matrix(whole)
    h = M @ before + J.T @ M_t @ twist
    first = solve(whole.arm, M_whole, h, "the mass matrix with the target")
    after = onto_closure(whole, first)
    energy = before @ M @ before + twist @ M_t @ twist - after @ M_whole @ after
    momentum = whole.A @ after
    lever = carried(arm.tips[0].translation - at)
    return Capture(
        configuration=whole.with_momentum(momentum),
        twist=np.kron(np.eye(2), whole.base.rotation) @ after[:6],
        dq=after[6:],
        momentum=momentum,
        impulse=np.linalg.solve(lever.T, -M_t @ (J @ after - twist)),
        energy_lost=0.5 * float(energy),
    )
