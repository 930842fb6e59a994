"""Catching: when and where a tumbling target is grasped, and the motion that arrives with it.

The tip is led to a stand-off on the axis of a grapple frame, which tumbles with the target, takes
up its motion there and closes in along the axis. At contact it has the pose of the frame and, as
J* dq = v, its twist, so that nothing strikes. The arm with the target in its hand is then braked:
the joints come to rest along a straight line, and the whole tumbles on as one body with the
momentum of the target.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, finite, plain, positive, shape_of
from spacearm.collisions.obstacles import Obstacle, obstacles_of
from spacearm.collisions.separation import collision_check
from spacearm.errors import (
    ConfigurationError,
    ImpossibleError,
    NoSolutionError,
    SpaceArmError,
    UnsupportedError,
    unknown,
)
from spacearm.mechanics.batch import evaluate
from spacearm.mechanics.dynamics import generalized_velocity, spacecraft_twist
from spacearm.mechanics.floating import STEP, move, walk
from spacearm.mechanics.jacobian import generalized_jacobian
from spacearm.mechanics.target import Target
from spacearm.mission.braking import Braking, braked, largest_torques, outside
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.controllers import Tracking
from spacearm.motion.flights import Flight, Grasp, Phase, simulate_phases
from spacearm.motion.following import Followed, follow
from spacearm.motion.goal import out_of_reach, twist_between
from spacearm.motion.motion import Motion, samples
from spacearm.motion.plant import Integration, Plant
from spacearm.planning.planner import plan
from spacearm.planning.problem import Problem
from spacearm.planning.request import Constraints, Joints, PlanRequest, Search
from spacearm.planning.result import Plan
from spacearm.planning.strategies.at_rest import by_methods
from spacearm.planning.strategies.drift import ramp_ends, stretched
from spacearm.planning.timing import PEAK, eased
from spacearm.results import Cell, Column, Description, Measure, Result, Table
from spacearm.signatures import checked
from spacearm.singularities.nearest import angle
from spacearm.singularities.sets import singular_set

NODES = 400
"""Poses through which the tip is led while it takes up the target's motion, and closing in."""
PROVEN, MOST = math.radians(20.0), 0.7
"""Distance to the singular set that is proven at most [rad], also as a share of that to first
order."""
COARSE, POSTURES, POSTURES_IN = 10, 8, 30.0
"""The same of an approach that is rehearsed, from so many postures at most, and the time in which
these are sought, at most [s]."""
SHARES = (2.0, 6.0, 20.0)
"""Time that is given to each contact on the first, the second and the third pass [s]."""


class Candidate(NamedTuple):
    """A time and a grapple frame, and what came of it.

    Attributes:
        t: Time of contact [s].
        grapple: The grapple frame.
        caught: Whether a motion catches the target there.
        story: How near to the singular set it comes, or why there is none.
    """

    t: float
    grapple: str
    caught: bool
    story: str

    def to_dict(self) -> dict[str, Any]:
        """Return all fields."""
        return self._asdict()


class Catch(Result, kw_only=True):
    """How an arm catches a target, from `sa.catch`.

    Time begins with the start; the target is then where it is at its time 0. The arm rests until
    `begin`, moves as `plan` to the stand-off, then as `chase` until contact, both with their own
    clocks, and `brake` brings the joints to rest with the target in the hand.

    Attributes:
        target: The target.
        grapple: The grapple frame that is grasped.
        t: Time of contact [s].
        begin: When the arm begins to move [s].
        plan: The motion to the stand-off, from rest to rest.
        chase: The motion from there to contact, which ends with the twist of the frame.
        brake: The motion of the arm with the target, from contact until its joints rest.
        distance_proven: No singular posture is nearer to both motions than this, proven [rad].
        place_error: Distance of the tip from the grapple frame at contact [m].
        turn_error: Angle between them [rad].
        twist_error: (6,) twist of the tip less that of the frame [m/s], [rad/s].
        torque: (n,) largest torques from the stand-off on and while braking [N m] or [N].
        momentum: (6,) momentum of arm and target together about the CM of both [kg m/s], [N m s].
        tried: All that was tried, in that order.
    """

    target: Target
    grapple: str
    t: float
    begin: float
    plan: Plan
    chase: Followed
    brake: Braking
    distance_proven: float
    place_error: float
    turn_error: float
    twist_error: Array
    torque: Array
    momentum: Array
    tried: tuple[Candidate, ...]

    @property
    def arm(self) -> SpaceArm:
        """The arm, without the target."""
        return self.plan.arm

    @cached_property
    def approach(self) -> Motion:
        """The motion from the start to contact, as one."""
        return joined(self.begin, self.plan, self.chase)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the motion up to contact, as `Motion.save`.

        Args:
            path: The file, NPZ.
        """
        self.approach.save(path)

    def fly(
        self,
        actual: Target | None = None,
        *,
        plant: Plant = Plant(),
        integration: Integration = Integration(),
        progress: Callable[[float, float], object] | None = None,
    ) -> Flight:
        """Simulate the catch: `sa.Tracking` leads the joints, the grasp is a plastic impact.

        Args:
            actual: The target as it is, where it differs from what was planned with, in mass,
                inertia or motion: it is grasped by the tip wherever it is then.
            plant: What else acts, as in `simulate`.
            integration: How it is integrated.
            progress: Called now and then as progress(t, duration).

        Returns:
            The flight: approach, closing in, braking.

        Raises:
            SpaceArmError: As `simulate_phases` raises.
        """
        grasp = grasp_of(actual or self.target, self.t, self.chase[-1].tip)
        begun = replace(self.plan, t=self.begin + self.plan.t)
        stages = (
            Phase(Tracking(begun), float(begun.t[-1]), plant=plant, integration=integration),
            Phase(Tracking(self.chase), float(self.chase.t[-1]), grasp, plant=plant,
                  integration=integration),
            Phase(Tracking(self.brake), float(self.brake.t[-1]), plant=plant,
                  integration=integration),
        )  # fmt: skip
        return simulate_phases(self.plan[0], stages, progress=progress)

    @property
    def tumble(self) -> Array:
        """(3,) angular velocity of arm and target once the joints rest, inertial axes [rad/s]."""
        end = self.brake[-1].with_momentum(self.momentum)
        return spacecraft_twist(end, np.zeros(self.arm.n))[3:]

    @property
    def not_checked(self) -> str:
        """What the answer does not cover: of collisions, and of the forces."""
        before = f"{self.plan.not_checked}; " * bool(self.plan.not_checked)
        return (
            f"{before}torques up to the stand-off; sensors and forces of the contact itself; "
            "collisions while the arm is braked with the target in its hand"
        )

    def describe(self) -> Description:
        """Describe when and where it catches, with what margins, and what was tried."""
        rates = np.linalg.norm(self.twist_error[:3]), np.linalg.norm(self.twist_error[3:])
        proven = angle(self.distance_proven, down=True)
        facts: dict[str, Cell] = {
            "begins to move": Measure(self.begin, "s"),
            "at the stand-off": Measure(self.begin + self.plan.t[-1], "s"),
            "contact": Measure(self.t, "s"),
            "joints at rest": Measure(self.t + self.brake.t[-1], "s"),
            "singular posture, proven": f"none nearer than {proven}",
            "tip off the grapple frame": Measure(self.place_error, "m", ".1e"),
            "turned off it": Measure(self.turn_error, "rad", ".1e"),
            "relative velocity": Measure(float(rates[0]), "m/s", ".1e"),
            "relative angular velocity": Measure(float(rates[1]), "rad/s", ".1e"),
            "largest torques": Measure(self.torque, "N m"),
            "the grapple bears": Measure(float(self.brake.borne[0]), "N"),
            "and about it": Measure(float(self.brake.borne[1]), "N m"),
            "angular momentum afterwards": Measure(self.momentum[3:], "N m s"),
            "turns afterwards at": Measure(float(np.linalg.norm(self.tumble)), "rad/s"),
        }
        rows = [(c.t, c.grapple, "caught" if c.caught else "not", c.story) for c in self.tried]
        columns = (Column("contact", "s"), Column("grapple frame"), Column(""), Column(""))
        return Description(
            title=f"{self.arm.name} and {self.target.name}",
            verdict=f"caught by {self.grapple} after {self.t:.4g} s",
            tone="good",
            notes=[self.plan.checked],
            tables=[Table.facts(facts), Table(columns, rows, "Tried")],
            not_checked=self.not_checked,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return all but the parts of the motion as plain data; the motion up to contact as one."""
        way = self.approach
        told = {
            "arm": self.arm.name,
            "target": self.target.name,
            "grapple": self.grapple,
            "contact": self.t,
            "begin": self.begin,
            "standing": self.begin + self.plan.t[-1],
            "rest": self.t + self.brake.t[-1],
            "distance_proven": self.distance_proven,
            "place_error": self.place_error,
            "turn_error": self.turn_error,
            "twist_error": self.twist_error,
            "torque": self.torque,
            "borne": self.brake.borne,
            "momentum": self.momentum,
            "tumble": self.tumble,
            "contacts": self.tried,
            "not_checked": self.not_checked,
            "t": way.t,
            "q": way.q,
            "base": way.base,
        }
        return {name: plain(value) for name, value in told.items()}


@checked
def catch(
    start: Configuration,
    target: Target,
    grapple: str | None = None,
    *,
    window: Sequence[float] = (0.0, 60.0),
    approach: float = 0.2,
    closing: float = 0.05,
    touching: Sequence[str] | None = None,
    bears: Sequence[float] = (math.inf, math.inf),
    wanted: int = 3,
    constraints: Constraints = Constraints(),
    search: Search = Search(),
) -> Catch:
    """Find when and by which grapple frame a free-floating arm catches a tumbling target, and how.

    Contacts throughout the window are tried, those in reach whose open side faces the arm first.
    Of the first that succeed that one is returned whose way keeps farthest from the singular set,
    proven. The arm starts at rest and without momentum.

    Args:
        start: The arm at time 0. Poses of the target are in the inertial frame of its base.
        target: The target.
        grapple: Name of the grapple frame; any of them if None.
        window: Earliest and latest contact [s].
        approach: Distance of the stand-off, from which the tip closes in along the z axis of the
            grapple frame [m].
        closing: Mean speed at which it closes in [m/s].
        touching: Links of the arm that may touch the target; if None those that move as the tip.
        bears: Largest force [N] and largest moment [N m] that the grapple bears at the tip while
            the arm is braked with the target in its hand.
        wanted: How many catches are found before the best is taken.
        constraints: What must hold on the way, as for `plan`. Rates and torques are those of the
            description, unless rates are given.
        search: How to look; `timeout` is that of the whole search [s].

    Returns:
        The catch.

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The start has momentum, the arm several tips, or its task is no pose.
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
    request = _Request.of(
        start, target, grapple, window, approach, closing, touching, bears, constraints
    )
    begun = time.monotonic()
    ends = begun + search.timeout
    tried, found = dict[tuple[float, str], Candidate](), list[Catch]()
    waiting = request.candidates()
    for number, share in enumerate(SHARES):
        again = list[tuple[float, str]]()
        for t, name in waiting:
            left = ends - time.monotonic()
            if len(found) >= wanted or left <= 0.0:
                break
            if search.progress:
                search.progress(time.monotonic() - begun, search.timeout)
            look = replace(
                search, seed=search.seed + number, timeout=min(share, left), progress=None
            )
            try:
                one = request.attempt(t, name, look)
            except SpaceArmError as error:
                tried[t, name] = Candidate(t, name, False, str(error))
                again += [(t, name)] * (not isinstance(error, ImpossibleError))
            else:
                if not found:  # as long again, at most
                    ends = min(ends, 2.0 * time.monotonic() - begun + 1.0)
                found.append(one)
                tried[t, name] = _told(one)
                if one.distance_proven >= PROVEN:  # none is known to be better
                    ends = -math.inf
        waiting = again
    if not found:
        stories = "; ".join(
            f"{c.t:.4g} s, {c.grapple}: {c.story}" for c in list(tried.values())[:3]
        )
        raise NoSolutionError(
            f"{start.arm.name} does not catch {target.name} in the window of {window[0]:.4g} to "
            f"{window[1]:.4g} s: {stories or 'no time was left'}; widen the window, start nearer, "
            "or name another grapple frame",
            tuple(tried.values()),
        )
    best = max(found, key=lambda one: one.distance_proven)
    if best.distance_proven < PROVEN:  # of this one all that can be
        ways = (best.plan, best.chase)
        clear = [singular_set(best.arm).clearance(way, at_least=PROVEN).clearance for way in ways]
        best = replace(best, distance_proven=max(best.distance_proven, min(clear)))
        tried[best.t, best.grapple] = _told(best)
    return replace(best, tried=tuple(tried.values()))


def _told(found: Catch) -> Candidate:
    """Return what is told of a time and frame by which a catch was found."""
    story = f"no singular posture nearer than {angle(found.distance_proven, down=True)}, proven"
    return Candidate(found.t, found.grapple, True, story)


@dataclass(frozen=True, eq=False)
class _Request:
    """What is asked for, checked; see `catch`."""

    start: Configuration
    target: Target
    grapples: tuple[str, ...]
    window: tuple[float, float]
    approach: float
    closing: float
    touching: tuple[str, ...]
    bears: Array
    constraints: Constraints

    @classmethod
    def of(
        cls,
        start: Configuration,
        target: Target,
        grapple: str | None,
        window: Sequence[float],
        approach: float,
        closing: float,
        touching: Sequence[str] | None,
        bears: Sequence[float],
        constraints: Constraints,
    ) -> _Request:
        """Check what was given."""
        arm = start.arm
        if start.momentum.any() or start.wheels.any():
            raise UnsupportedError(
                "the start has momentum on board, and catches begin at zero momentum; "
                "sa.detumble brings the spacecraft to rest before"
            )
        if len(arm.tips) > 1 or arm.task.k < 6:
            raise UnsupportedError(
                f"{arm.name} has the task {arm.task.names!r} of {len(arm.tips)} tip(s); a target "
                "is caught by the pose of one: sa.load(..., task='pose')"
            )
        if not target.grapples:
            raise ConfigurationError(
                f"{target.name} has no grapple frame; give sa.Target(..., grapples={{name: pose}})"
            )
        if grapple is not None and grapple not in target.grapples:
            raise ConfigurationError(unknown(f"grapple of {target.name}", grapple, target.grapples))
        early, late = finite(window, (2,), "window", "[s], the earliest and the latest contact")
        if not 0.0 <= early <= late:
            raise ConfigurationError(f"window is {window!r}; give two growing times from 0 s on")
        most = shape_of(bears) == (2,) and np.asarray(bears, dtype=np.float64)
        if most is False or not (most > 0.0).all():
            raise ConfigurationError(f"bears is {bears!r}; give a force [N] and a moment [N m] > 0")
        if touching is None:
            touching = arm.tree.lumps[arm.tree.body_of[arm.tip]]
        for link in touching:
            if link not in arm.tree.links:
                raise ConfigurationError(unknown(f"link of {arm.name}", link, arm.tree.links))
        return cls(
            start, target, tuple(target.grapples) if grapple is None else (grapple,),
            (float(early), float(late)), positive(approach, "approach", "distance [m]"),
            positive(closing, "closing", "speed [m/s]"), tuple(touching),
            np.array(most), constraints,
        )  # fmt: skip

    @property
    def efforts(self) -> Array:
        """Largest torques (n,) of the joints [N m] or [N]."""
        arm = self.start.arm
        return np.array([arm.tree.joints[name].effort for name in arm.joint_names])

    @property
    def duration(self) -> tuple[float, float]:
        """How long the tip takes up the target's motion, and how long it closes in [s]."""
        close = self.approach / self.closing
        return close, close

    def candidates(self) -> list[tuple[float, str]]:
        """Return times and grapple frames: those in reach first, whose open side faces the arm."""
        early, late = self.window
        early = max(early, sum(self.duration) + 1.0)
        times = np.linspace(early, late, 13) if late > early else np.array([late])
        near = []
        for t in times if late >= early else ():
            for name in self.grapples:
                pose = self.target.at(float(t), name).pose
                off = float(np.linalg.norm(pose.translation - self.start.com))
                blocked = pose.act(np.array([0.0, 0.0, -1.0])) - pose.translation
                facing = blocked @ (self.start.com - pose.translation) / max(off, 1e-9)
                near.append((bool(out_of_reach(self.start, pose)), -facing, float(t), name))
        return [(t, name) for _, _, t, name in sorted(near)]

    def path(
        self, t: float, grapple: str, first: pin.SE3 | None = None, nodes: int = NODES
    ) -> tuple[list[pin.SE3], Array]:
        """Return the poses of the tip from the stand-off to contact at t, and their times [s].

        The first is where the tip rests, at the stand-off if None; the tip then takes up the motion
        of the stand-off, and closes in. All rates begin and end at zero relative to both.
        """
        join, close = self.duration
        clock = np.linspace(0.0, join + close, 2 * nodes + 1)
        begin = t - clock[-1]
        joined = eased(np.clip(clock / join, 0.0, 1.0))
        away = self.approach * (1.0 - eased(np.clip((clock - join) / close, 0.0, 1.0)))
        frames = [self.target.at(begin + float(s), grapple).pose for s in clock]
        frames = [
            pose * pin.SE3(np.eye(3), np.array([0.0, 0.0, -d]))
            for pose, d in zip(frames, away, strict=True)
        ]
        first = frames[0] if first is None else first
        return [_between(first, pose, b) for pose, b in zip(frames, joined, strict=True)], clock

    def attempt(self, t: float, grapple: str, search: Search) -> Catch:
        """Return the catch at a time by a grapple frame.

        Raises:
            SpaceArmError: There is none, or none was found.
        """
        poses, clock = self.path(t, grapple, nodes=1)
        if why := out_of_reach(self.start, poses[-1]):
            raise ImpossibleError(why)
        stands, failed = t - float(clock[-1]), NoSolutionError("no time was left")
        ends = time.monotonic() + search.timeout
        for goal in self._ends(t, grapple, poses[0], search):
            if (left := ends - time.monotonic()) <= 0.0:
                break
            try:
                reach = self._reach(goal, stands, replace(search, timeout=left))
                return self._caught(t, grapple, reach)
            except NoSolutionError as error:
                failed = error
        raise failed

    def _ends(
        self, t: float, grapple: str, stand: pin.SE3, search: Search
    ) -> Iterator[pin.SE3 | Joints]:
        """Yield goals at the stand-off from which the tip can be led to contact, then its pose.

        The first are postures where straight joint motions end, those from which the approach
        takes the least of the joints' rates before others.
        """
        start, rates = self.start, self.constraints.joint_rates(self.start.arm)
        request = self._planned(stand, replace(search, timeout=POSTURES_IN))
        room = rates * (t - sum(self.duration)) / PEAK
        rng = np.random.default_rng((search.seed, int(1e3 * t)))
        target = Problem.of(request).target
        found = ramp_ends(start, target, np.eye(3), room, rng, request.account)
        known = [(self._rehearsed(t, grapple, move(start, q)), q) for q in found[:POSTURES]]
        for share, q in sorted(known, key=lambda one: one[0]):
            if share <= 1.0:
                yield Joints(q)
        yield stand

    def _rehearsed(self, t: float, grapple: str, stand: Configuration) -> float:
        """Return the largest share of their rates that joints take on the approach, in few steps.

        It is infinite if joint limits or the target are in the way.
        """
        poses, clock = self.path(t, grapple, stand.tip, COARSE)
        arm, most = self.start.arm, self.constraints.joint_rates(self.start.arm)
        rows, share = [stand], 0.0
        for pose in poses[1:]:
            here = rows[-1]
            dq = np.linalg.pinv(generalized_jacobian(here)) @ twist_between(here.tip, pose)
            share = max(share, float((np.abs(dq) / most).max() / clock[1]))
            if share > 1.0 or (self.constraints.limits and outside(arm, here.q + dq)):
                return math.inf
            rows.append(move(here, here.q + dq))
        way = Motion(arm, clock, **samples(rows))
        around = self._as_obstacle(t - float(clock[-1]))
        met = self.constraints.collisions and collision_check(way, obstacles=around).contact
        return math.inf if met else share

    def _caught(self, t: float, grapple: str, reach: Plan) -> Catch:
        """Return the catch at a time by a grapple frame, from a plan to about the stand-off.

        Raises:
            SpaceArmError: It keeps not all constraints.
        """
        target = self.target
        poses, clock = self.path(t, grapple, reach[-1].tip)
        begin = t - float(clock[-1] + reach.t[-1])
        chase = follow(
            reach[-1], poses[1:], times=clock[1:], at_rest=False, limits=self.constraints.limits
        )
        if not chase.arrived:
            raise NoSolutionError(f"on the way from the stand-off: {chase.reason}")
        most = self.constraints.joint_rates(self.start.arm)
        self._check_loads("rate", np.abs(chase.dq).max(axis=0), most)
        end, frame = chase[-1], target.at(t, grapple)
        v = generalized_velocity(end, chase.dq[-1])
        stack = end.arm.grasp(**_in_hand(target, t, end.tip)).at(end.q, base=end.base)
        held = stack.with_momentum(stack.A @ v)
        try:
            brake = braked(
                held, chase.dq[-1], grasp_of(target, t, end.tip), self.constraints.limits,
                self.efforts, self.bears,
            )  # fmt: skip
        except NoSolutionError as error:
            raise NoSolutionError(f"with {target.name} in the hand, {error}") from None
        torque = np.maximum(
            largest_torques(chase, chase.dq, chase.ddq, np.zeros(6)),
            np.abs(brake.torque).max(axis=0),
        )
        self._check_loads("torque", torque, self.efforts)
        self._check_contacts(joined(begin, reach, chase))
        proven = _proven(reach, chase)
        off = end.tip.actInv(frame.pose)
        return Catch(
            target=target,
            grapple=grapple,
            t=t,
            begin=begin,
            plan=reach,
            chase=chase,
            brake=brake,
            distance_proven=proven,
            place_error=float(np.linalg.norm(off.translation)),
            turn_error=float(np.linalg.norm(pin.log3(off.rotation))),
            twist_error=end.J @ v - frame.twist,
            torque=torque,
            momentum=held.momentum,
            tried=(),
        )

    def _planned(self, goal: pin.SE3 | Joints, search: Search) -> PlanRequest:
        """Return what is asked of a plan to the stand-off."""
        start, constraints = self.start, self.constraints
        return PlanRequest.of(start, goal, "spacecraft", constraints, search, (), None, None)

    def _straight(self, goal: Joints, t: float, search: Search) -> Plan:
        """Return the plan of a straight joint motion, no faster than the approach if t allows."""
        start, way = self.start, np.asarray(goal.q) - self.start.q
        u = np.linspace(0.0, 1.0, 1 + max(1, math.ceil(np.abs(way).max() / STEP)))
        rows = walk(start, start.q + u[:, None] * way)
        request, lasts = self._planned(goal, search), min(t, self.duration[0])
        found = by_methods(Problem.of(request), {"straight": lambda _: rows})
        return stretched(found, lasts, request.account) if found.t[-1] < lasts else found

    def _reach(self, goal: pin.SE3 | Joints, t: float, search: Search) -> Plan:
        """Return the plan to the stand-off, until a time; it minds the target if it has to."""
        straight = isinstance(goal, Joints)
        if straight:
            reach = self._straight(goal, t, search)
        else:
            reach = plan(self.start, goal, constraints=self.constraints, search=search)
        if (late := float(reach.t[-1]) - t) > 0.0:
            raise NoSolutionError(f"the way to the stand-off takes {late:.3g} s too long")
        duration = min(t, 1.5 * float(reach.t[-1]))
        around = self._as_obstacle(t - float(reach.t[-1]))
        if not self.constraints.collisions or not collision_check(reach, obstacles=around).contact:
            return reach
        if straight:
            raise NoSolutionError("the straight way to the stand-off meets the target")
        kept = obstacles_of(self.constraints.obstacles, self.start.arm)
        among = replace(self.constraints, obstacles=(*kept, self._as_obstacle(t - duration)))
        return plan(self.start, goal, duration=duration, constraints=among, search=search)

    def _as_obstacle(self, begin: float) -> Obstacle:
        """Return the target as what must not be met by a motion that begins at a time."""
        return Obstacle.of_target(self.target, begin=begin, may_touch=self.touching)

    def _check_loads(self, what: str, loads: Array, most: Array) -> None:
        """Refuse what is more than joints can, (n,) each."""
        excess = loads / most
        j = int(excess.argmax())
        if excess[j] > 1.0:
            name = self.start.arm.joint_names[j]
            raise NoSolutionError(f"joint {name!r} would need {excess[j]:.3g} times its {what}")

    def _check_contacts(self, motion: Motion) -> None:
        if not self.constraints.collisions:
            return
        contact = collision_check(motion, obstacles=self._as_obstacle(0.0)).contact
        if contact is not None:
            raise NoSolutionError(f"{' and '.join(contact.links)} meet after {contact.t:.4g} s")


def _between(a: pin.SE3, b: pin.SE3, s: float) -> pin.SE3:
    """Return a pose between two: the straight line of its origin, the shortest turn."""
    R = a.rotation @ pin.exp3(s * pin.log3(a.rotation.T @ b.rotation))
    return pin.SE3(R, (1.0 - s) * a.translation + s * b.translation)


def _in_hand(target: Target, t: float, tip: pin.SE3) -> dict[str, Any]:
    """Return mass, inertia and CM of a target at a time, in the axes of the tip, for a grasp."""
    seen = tip.actInv(target.at(t).pose)
    R = seen.rotation
    return {
        "mass": target.mass,
        "inertia": R @ target.inertia @ R.T,
        "com": seen.act(target.com),
    }


def grasp_of(target: Target, t: float, tip: pin.SE3) -> Grasp:
    """Return the grasp of a target at a time [s] by a tip."""
    frame = target.at(t)
    v, w = frame.twist[:3], frame.twist[3:]
    twist = np.concatenate((v + np.cross(w, frame.pose.rotation @ target.com), w))
    return Grasp(**_in_hand(target, t, tip), twist=twist)


def joined(begin: float, reach: Motion, chase: Motion) -> Motion:
    """Return a wait until `begin` [s] and two motions, one after the other, as one."""
    t = np.concatenate((begin + reach.t, begin + reach.t[-1] + chase.t[1:]))
    q = np.concatenate((reach.q, chase.q[1:]))
    base = np.concatenate((reach.base, chase.base[1:]))
    if begin > 0.0:
        t, q, base = np.append(0.0, t), np.vstack((q[:1], q)), np.vstack((base[:1], base))
    return Motion(reach.arm, t, q, base)


def _proven(*motions: Motion) -> float:
    """Return the distance [rad] of motions within which no posture is singular, proven.

    More than most of what it is to first order is not asked of the proof, which is short then.

    Raises:
        NoSolutionError: It is not proven that they meet no singularity.
    """
    arm, least = motions[0].arm, PROVEN
    for motion in motions:
        about = evaluate(arm, motion.q, ("distance",))["distance"].min()
        least = min(least, float(MOST * about))
        least = min(least, singular_set(arm).clearance(motion, at_least=least).clearance)
        if least <= 0.0:
            raise NoSolutionError("it is not proven that the way meets no singularity")
    return least
