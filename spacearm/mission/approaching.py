"""Approach: the motion by which the tip comes to a grapple frame and moves as it does.

The tip is led to a stand-off on the axis of the frame, which tumbles with its target, takes up its
motion there and closes in along the axis. At contact it has the pose of the frame and, as
J* dq = v, its twist.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import zip_longest
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, finite, numbers_of, positive
from spacearm.collisions.obstacles import Obstacle, obstacles_of
from spacearm.collisions.separation import contact_on
from spacearm.errors import (
    ConfigurationError,
    ImpossibleError,
    NoSolutionError,
    UnsupportedError,
    require_known,
)
from spacearm.mechanics.batch import evaluate
from spacearm.mechanics.dynamics import generalized_velocity, momentum_and_torque
from spacearm.mechanics.floating import STEP, attitudes, placed, reactions, samples, walk
from spacearm.mechanics.target import Target
from spacearm.mission.braking import Braking, braked
from spacearm.mission.catch_report import Catch, grasp_of, in_hand
from spacearm.mission.kept_limits import CatchLimits
from spacearm.model.arguments import FLOATING, HELD, BaseMode
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.flights import load_peaks
from spacearm.motion.following import Followed, follow
from spacearm.motion.goal import goal_axes, largest, out_of_reach, twist_between
from spacearm.motion.motion import Motion
from spacearm.planning.account import SearchAccount, TimeUpError
from spacearm.planning.many_curves import drifting_attitudes, rotation_vectors, rotations_of
from spacearm.planning.optimiser import Target as End
from spacearm.planning.planner import plan
from spacearm.planning.problem import Problem, bounds_of
from spacearm.planning.reactions import Wheels, boundless, load_of
from spacearm.planning.request import Constraints, Joints, PlanRequest, Search
from spacearm.planning.result import Plan
from spacearm.planning.strategies.at_rest import by_methods
from spacearm.planning.strategies.attitude_held import attitude_held
from spacearm.planning.strategies.drift import ramp_ends, stretched
from spacearm.planning.timing import PEAK, eased, rate_bounds
from spacearm.signatures import shown
from spacearm.singularities.sets import singular_set

#: What is grasped: a frame, that of each tip, or those of tips that grasp one after the other.
Grapple: TypeAlias = str | Mapping[str, str] | Sequence[Mapping[str, str]] | None
#: Poses through which the tip is led while it takes up the target's motion, and closing in.
NODES = 400
#: Distance to the singular set that is proven at most [rad], also as a share of that to first
#: order.
PROVEN, MOST = math.radians(20.0), 0.7
#: The same of an approach that is rehearsed.
COARSE = 10
#: Rows of the tasks that are poses, of planar arms and others.
PLANE, SPACE = (0, 1, 5), (0, 1, 2, 3, 4, 5)
#: How far a grapple frame may be off the plane in which a planar arm moves [m], [rad].
OFF_PLANE = 1e-6
NO_WAY = "no straight way leads to where the tip could close in"
#: Intervals into which the first contacts divide the window.
TIMES = 12
#: Parts of the window from which candidates are taken in turn.
PARTS = 4
#: Whether a candidate is out of reach, how much it faces away, its time [s] and its frame.
Ranked: TypeAlias = tuple[bool, float, float, str]


@dataclass(frozen=True, eq=False)
class Approach:
    """What is asked for, checked; see `catch`, and the search for a way to a contact.

    A held spacecraft moves as one that no joint motion turns: `floats` is the start of that one.
    """

    start: Configuration
    target: Target
    grapples: tuple[str, ...]
    asked: Grapple
    window: tuple[float, float]
    approach: float
    closing: float
    touching: tuple[str, ...]
    bears: Array
    constraints: Constraints
    mode: BaseMode
    account: SearchAccount = field(default_factory=lambda: SearchAccount(math.inf))

    @classmethod
    def of(
        cls,
        start: Configuration,
        target: Target,
        grapple: Grapple,
        window: Sequence[float],
        approach: float,
        closing: float,
        touching: Sequence[str] | None,
        bears: Sequence[float],
        constraints: Constraints,
        mode: BaseMode,
        account: SearchAccount | None = None,
    ) -> Approach:
        """Check what was given; the account has the time of the whole search."""
        arm = start.arm
        require_known("mode", mode, (FLOATING, HELD))
        if mode == FLOATING and constraints.wheels is not None and not arm.wheels:
            raise ConfigurationError(
                f"constraints have wheels, and {arm.name} has none while it floats; give "
                f"mode={HELD!r}, or name their joints by wheels=[...]"
            )
        if not target.grapples:
            raise ConfigurationError(
                f"{target.name} has no grapple frame; give sa.Target(..., grapples={{name: pose}})"
            )
        grapples = cls.named(arm, target, grapple)
        early, late = finite(window, (2,), "window", "[s], the earliest and the latest contact")
        if not 0.0 <= early <= late:
            raise ConfigurationError(
                f"window is {shown(window)}; give two increasing times from 0 s on"
            )
        most = numbers_of(bears, "bears")
        if most.shape != (2,) or not (most > 0.0).all():
            raise ConfigurationError(
                f"bears is {shown(bears)}; give a force [N] and a moment [N m] > 0"
            )
        if touching is None:
            lumps = [arm.tree.lumps[arm.tree.body_of[tip]] for tip in arm.tips]
            touching = [link for lump in lumps for link in lump]
        require_known(f"link of {arm.name}", touching, arm.tree.links)
        return cls(
            start, target.relative_to(start), grapples, grapple, (float(early), float(late)),
            positive(approach, "approach", "distance [m]"),
            positive(closing, "closing", "speed [m/s]"), tuple(touching),
            np.array(most), constraints, mode, account or SearchAccount(math.inf),
        )  # fmt: skip

    @classmethod
    def named(cls, arm: SpaceArm, target: Target, grapple: Grapple) -> tuple[str, ...]:
        """Return the grapple frames by which the arm may catch.

        Raises:
            ConfigurationError: There is no such frame.
            UnsupportedError: The arm has several tips, or its task is not a pose.
        """
        if len(arm.tips) > 1 or tuple(arm.task.indices) not in (PLANE, SPACE):
            raise UnsupportedError(
                f"{arm.name} has the task {arm.task.names!r} for {', '.join(arm.tips)}; a target "
                "is caught by the pose of one, sa.load(..., task='pose'), of a planar arm "
                "task='x y rz', or by several at once, grapple={tip: frame}"
            )
        name = grapple if isinstance(grapple, str) else None
        for given in in_turn(grapple):
            require_known(f"tip of {arm.name}", given, arm.tips)
            name = given.get(arm.tip)
        if name is None:
            return tuple(target.grapples)
        require_known(f"grapple of {target.name}", name, target.grapples)
        return (name,)

    @property
    def axis(self) -> Array:
        """The axis of a grapple frame that points into the target: z, for planar arms x."""
        return np.eye(3)[0 if len(self.start.arm.task.rows) < len(SPACE) else 2]

    @property
    def choices(self) -> tuple[str, ...]:
        """The frames of which one is grasped."""
        return self.grapples

    @cached_property
    def wheels(self) -> Wheels | None:
        """The wheels that hold the attitude, if they do."""
        return Wheels.of(self.start, self.constraints.wheels) if self.mode == HELD else None

    @cached_property
    def floats(self) -> Configuration:
        """The start, of a held spacecraft that of one that no joint motion turns."""
        cfg = self.start
        if self.mode == FLOATING:
            return cfg
        kept = np.append(cfg.momentum[:3], np.zeros(3))
        return boundless(cfg.arm).at(cfg.q, base=cfg.base, momentum=kept)

    @property
    def moving(self) -> bool:
        """Whether the spacecraft drifts or turns whatever the joints do."""
        return bool(self.floats.momentum.any() or self.floats.wheels.any())

    def drifted(self, t: float) -> Configuration:
        """Return the start, its system CM where it drifts until a time [s]."""
        cfg = self.floats
        return cfg.centred(cfg.com + t * cfg.momentum[:3] / cfg.arm.mass)

    @cached_property
    def proves(self) -> float:
        """Distance to the singular set [rad] to ask for at most: the start has no more."""
        about = evaluate(self.floats.arm, self.start.q[None], ("distance",))["distance"]
        return min(PROVEN, float(MOST * about[0]))

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

    def closes(self, _: str) -> tuple[float, float]:
        """When the tip of a grapple frame begins to close in, and how long that takes [s]."""
        return self.duration

    def candidates(self) -> Iterator[list[tuple[float, str]]]:
        """Yield times and grapple frames, then those half way between, and so on.

        Of each list those in reach come first. The first few of a list lie in different parts of
        the window; of each part those come first whose open side faces the arm.
        """
        early, late = self.window
        early = max(early, sum(self.duration) + 1.0)
        number = TIMES if late > early else 0
        times = np.linspace(early, late, number + 1)[: number + 1 if late >= early else 0]
        while True:
            near = list[Ranked]()
            for t in times.tolist():
                near += [(*self.rank(t, name), t, name) for name in self.choices]
            yield [(t, name) for _, _, t, name in self._spread(near)]
            number *= 2
            times = np.linspace(early, late, number + 1)[1::2]

    def _spread(self, ranked: list[Ranked]) -> list[Ranked]:
        """Return candidates in an order in which any first few are spread over the window."""
        early, late = self.window
        width = max(late - early, 1e-9) / PARTS
        parts: list[list[Ranked]] = [[] for _ in range(PARTS)]
        for one in sorted(ranked):
            parts[min(max(int((one[2] - early) / width), 0), PARTS - 1)].append(one)
        parts = sorted(part for part in parts if part)
        in_turn = [one for turn in zip_longest(*parts) for one in turn if one is not None]
        return sorted(in_turn, key=lambda one: one[0])

    def rank(self, t: float, grapple: str) -> tuple[bool, float]:
        """Return, of a frame at a time, what `away` does: what is tried first is the least."""
        return away(self.drifted(t), self.target.at(t, grapple).pose, self.axis)

    def path(
        self, t: float, grapple: str, first: Configuration | None = None, nodes: int = NODES
    ) -> tuple[list[pin.SE3], Array]:
        """Return the poses of the tip from the stand-off to contact at t, and their times [s].

        At the first the joints rest, at the stand-off if None; the tip then takes up the motion of
        the stand-off, and closes in. All rates begin and end at zero relative to both.
        """
        frames, joined, clock = self._frames(t, grapple, nodes)
        rests = frames[:1] * len(frames) if first is None else self._resting(first, clock)
        return [_between(*pair) for pair in zip(rests, frames, joined, strict=True)], clock

    def _frames(self, t: float, grapple: str, nodes: int) -> tuple[list[pin.SE3], Array, Array]:
        """Return where the tip would be, had it the target's motion, its share of it, and times.

        Each (2 nodes + 1,): poses, shares, and times from the stand-off to contact at t [s].
        """
        join, close = self.duration
        clock = np.linspace(0.0, join + close, 2 * nodes + 1)
        begin = t - clock[-1]
        joined = eased(np.clip(clock / join, 0.0, 1.0))
        since, lasts = self.closes(grapple)
        away = self.approach * (1.0 - eased(np.clip((clock - since) / lasts, 0.0, 1.0)))
        frames = [self.target.at(begin + float(s), grapple).pose for s in clock]
        frames = [
            pose * pin.SE3(np.eye(3), -d * self.axis) for pose, d in zip(frames, away, strict=True)
        ]
        return frames, joined, clock

    def _resting(self, cfg: Configuration, clock: Array) -> list[pin.SE3]:
        """Return where the tip is at times (m,) [s] after a configuration, the joints at rest."""
        if not self.moving:
            return [cfg.tip] * len(clock)
        own, Q = self.floats, np.tile(cfg.q, (1, len(clock), 1))
        T, drift = cfg.base.rotation, own.momentum[:3] / own.arm.mass
        stored = own.base.rotation.T @ own.stored[3:]
        turns = drifting_attitudes(own.arm, T, clock, Q, own.momentum[3:], stored)[0]
        tips = [placed(cfg, cfg.q, R).tip for R in turns]
        for tip, s in zip(tips, clock, strict=True):
            tip.translation += s * drift
        return tips

    def attempt(
        self, t: float, grapple: str, ways: Iterator[Joints], search: Search, lasts: float
    ) -> Catch:
        """Return the catch at a time by a grapple frame.

        Args:
            t: The time of contact [s].
            grapple: The grapple frame.
            ways: Where straight ways end that were not tried yet, from `straight`.
            search: How to look, until the time is up.
            lasts: Time after which no other straight way is begun, and which the planner is given
                to bend one where none is left [s].

        Raises:
            SpaceArmError: There is none, or none was found.
        """
        poses, clock = self.path(t, grapple, nodes=1)
        if why := self._out_of_plane(poses) or out_of_reach(self.drifted(t), poses[-1]):
            raise ImpossibleError(why)
        stands, ends = t - float(clock[-1]), time.monotonic() + lasts
        failed = NoSolutionError(NO_WAY)
        for goal in ways:
            self.account.check_time()
            try:
                return self._caught(t, grapple, self._reach(goal, stands, search))
            except NoSolutionError as error:
                failed = error
            if time.monotonic() >= ends:
                raise failed
        left = ends - time.monotonic()
        if left <= 0.0 or (search.method == "straight" and not self.moving):
            raise failed
        look = replace(search, timeout=min(left, search.timeout))
        return self._caught(t, grapple, self._reach(poses[0], stands, look))

    def _out_of_plane(self, poses: list[pin.SE3]) -> str:
        """Return a message if a planar arm cannot come to poses since they leave its plane."""
        cfg, arm = self.start, self.start.arm
        others = [i for i in SPACE if i not in arm.task.indices]
        ways = [twist_between(cfg.tip, pose).reshape(2, 3) @ goal_axes(cfg) for pose in poses]
        off = np.abs([way.ravel()[others] for way in ways]).max(axis=0)
        if off.max(initial=0.0) <= OFF_PLANE:
            return ""
        return (
            f"the grapple frame is up to {largest(off, others)} off the plane in which the tip of "
            f"{arm.name} moves"
        )

    def straight(self, t: float, grapple: str, search: Search) -> Iterator[Joints]:
        """Yield where straight ways to the stand-off end from which the tip can be led to contact.

        Those come first from which the approach takes the least of the joints' rates. There are
        none with momentum: the planner bends ways.
        """
        if self.moving:
            return
        start, constraints = self.floats, self.constraints
        tip = self.path(t, grapple, nodes=1)[0][0]
        target = End(tip, None, None, 0.0, *bounds_of(start, constraints.limits))
        room = constraints.joint_rates(self.start.arm) * (t - sum(self.duration)) / PEAK
        rng = np.random.default_rng((search.seed, int(1e3 * t)))
        account = self.account.part(search.timeout)
        try:
            found = ramp_ends(start, target, np.eye(3), room, rng, account)
        except TimeUpError:
            return
        if not len(found):
            return
        share, Q, turns = self.rehearsed(t, grapple, found)
        u = np.linspace(0.0, 1.0, Q.shape[1])[:, None]
        ways = np.hstack((start.q + u * (found[:, None] - start.q), Q)).reshape(-1, start.arm.n)
        clear = evaluate(start.arm, ways, ("distance",))["distance"].reshape(len(Q), -1)
        clear = np.minimum(clear.min(axis=1), PROVEN / MOST)
        clock = self.path(t, grapple, nodes=COARSE)[1]
        for i in np.lexsort((share, -clear)):
            self.account.check_time()
            if share[i] <= 1.0 and not self._meets(clock, Q[i], turns[i], t):
                yield Joints(found[i])

    def _meets(self, clock: Array, Q: Array, T: Array, t: float) -> bool:
        """Return whether bodies meet on rows of an approach; most that meet do so at contact."""
        start = self.floats
        rows = samples([placed(start, *row) for row in zip(Q, T, strict=True)])
        for part in (slice(-2, None), slice(None)) if self.constraints.collisions else ():
            way = Motion(start.arm, clock[part], rows["q"][part], rows["base"][part])
            if contact_on(way, self._around(t - float(clock[-1])), self.account.check_time):
                return True
        return False

    def rehearsed(self, t: float, grapple: str, Q: Array) -> tuple[Array, Array, Array]:
        """Lead the tip from straight ways' ends (m, n) to contact, in a few steps, all at once.

        Returns:
            (m,) the largest share of their rates that joints take, infinite beyond joint limits;
            (m, k, n) joint positions and (m, k, 3, 3) attitudes on the way.
        """
        start, arm = self.floats, self.floats.arm
        frames, joined, clock = self._frames(t, grapple, COARSE)
        most, step = self.constraints.joint_rates(self.start.arm), float(clock[1])
        T = np.array([attitudes(start, np.stack((start.q, q)))[-1] for q in Q])
        share, rows, turns = np.zeros(len(Q)), [Q], [T]
        at = reactions(arm, Q)
        rest, origin = T @ at.R, start.com + (T @ at.r[..., None])[..., 0]
        for frame, b in zip(frames[1:], joined[1:], strict=True):
            q, T = rows[-1], turns[-1]
            at = reactions(arm, q)
            R, r = T @ at.R, start.com + (T @ at.r[..., None])[..., 0]
            back = np.swapaxes(rest, 1, 2)
            wanted = rest @ rotations_of(b * rotation_vectors(back @ frame.rotation))
            turn = rotation_vectors(wanted @ np.swapaxes(R, 1, 2))
            way = (1.0 - b) * origin + b * frame.translation - r
            twist = (np.stack((way, turn), axis=1) @ T).reshape(-1, 6, 1)  # spacecraft axes
            dq = (np.linalg.pinv(at.J) @ twist)[..., 0]
            share = np.maximum(share, (np.abs(dq) / most).max(axis=1) / step)
            rows.append(q + dq)
            turns.append(T @ rotations_of((at.A @ dq[..., None])[..., 0]))
        ways = np.stack(rows, axis=1)
        if self.constraints.limits:
            beyond = (ways < arm.lower) | (ways > arm.upper)
            share[beyond.any(axis=(1, 2))] = math.inf
        return share, ways, np.stack(turns, axis=1)

    def _caught(self, t: float, grapple: str, reach: Plan) -> Catch:
        """Return the catch at a time by a grapple frame, from a plan to about the stand-off.

        Raises:
            SpaceArmError: It keeps not all constraints.
        """
        target = self.target
        poses, clock = self.path(t, grapple, reach[-1])
        chase = follow(
            reach[-1], poses[1:], times=clock[1:], at_rest=False, mode=self.mode,
            limits=self.constraints.limits, progress=self.account.tick,
        )  # fmt: skip
        self._check_chase(chase, t)
        wheels, load = self.wheels, ""
        if wheels is not None:
            chase, load = self._borne(chase, wheels)
        end, frame = chase[-1], target.at(t, grapple)
        v = generalized_velocity(end, chase.dq[-1], self.mode)
        stack = end.arm.grasp(**in_hand(target, t, end.tip)).at(end.q, base=end.base)
        held = stack.with_momentum(end.momentum + (stack.A - end.A) @ v).with_wheels(end.wheels)
        if wheels is not None:  # what they hold once the joints rest
            start = wheels.shares @ (end.base.rotation.T @ held.momentum[3:])
            wheels = replace(wheels, start=start)
        try:
            brake = braked(
                held, chase.dq[-1], grasp_of(target, t, end.tip), self.constraints.limits,
                self.efforts, self.bears, wheels, self.account.check_time,
            )  # fmt: skip
        except NoSolutionError as error:
            raise NoSolutionError(f"with {target.name} in the hand, {error}") from None
        told, proven = self._told(t, reach, chase, brake), self._proven(reach, chase)
        off = end.tip.actInv(frame.pose)
        return Catch(
            **told,
            grapple=grapple,
            distance_proven=proven,
            place_error=float(np.linalg.norm(off.translation)),
            turn_error=float(np.linalg.norm(pin.log3(off.rotation))),
            twist_error=end.J @ v - frame.twist,
            momentum=held.momentum,
            wheel_load=(reach.wheel_load, load, brake.wheel_load) if load else (),
        )

    def _check_chase(self, chase: Followed, t: float) -> None:
        """Refuse a way from the stand-off that ends early, is too fast, or meets something."""
        if not chase.arrived:
            raise NoSolutionError(f"on the way from the stand-off: {chase.reason}")
        most = self.constraints.joint_rates(self.start.arm)
        self._check_loads("rate", rate_bounds(chase.spline), most)
        self._check_contacts(chase, t)

    def _told(self, t: float, reach: Plan, chase: Followed, brake: Braking) -> dict[str, Any]:
        """Return what a catch at a time holds of its parts, whose torques are checked."""
        led = load_peaks(chase, check_time=self.account.check_time).bound[: self.start.arm.n]
        torque = np.maximum(led, brake.largest_torques)
        self._check_loads("torque", torque, self.efforts)
        begin = max(t - float(chase.t[-1] + reach.t[-1]), 0.0)
        parts: dict[str, Any] = {
            "target": self.target,
            "plan": reach,
            "chase": chase,
            "brake": brake,
        }
        wheels = self._wheels_after(brake[-1])
        limits = CatchLimits(
            rates=self.constraints.joint_rates(self.start.arm),
            torques=self.efforts,
            loads=self.bears,
            positions=self.constraints.limits,
            clearance=self.constraints.clearance,
            wheels=wheels,
        )
        parts |= {"torque": torque, "limits": limits, "wheels": wheels}
        return {**parts, "t": t, "begin": begin, "tried": ()}

    def _straight(self, goal: Joints, lasts: float, t: float, search: Search) -> Plan:
        """Return the plan of a straight joint motion until a time t.

        It lasts so long [s], longer if it must.
        """
        way = np.asarray(goal.q) - self.start.q
        u = np.linspace(0.0, 1.0, 1 + max(1, math.ceil(np.abs(way).max() / STEP)))

        def floating(request: PlanRequest) -> Plan:
            rows = walk(request.start, request.start.q + u[:, None] * way)
            found = by_methods(Problem.of(request), {"straight": lambda _: rows})
            return stretched(found, lasts, request.account) if found.t[-1] < lasts else found

        own = replace(self.constraints, obstacles=self._others(t - lasts))
        look = replace(search, method="auto")
        request = PlanRequest.of(self.start, goal, "spacecraft", own, look, (), None, None)
        return attitude_held(request, floating) if self.wheels else floating(request)

    def _reach(self, goal: pin.SE3 | Joints, t: float, search: Search) -> Plan:
        """Return the plan to the stand-off, until a time; it minds the target if it has to."""
        joints = isinstance(goal, Joints)
        if self.moving or (not joints and any(one.moves for one in self._others())):
            return self._planned_among(goal, t, t, search)
        if joints:
            for lasts in (min(t, self.duration[0]), t):  # as late as may be, then from time 0 on
                reach = self._in_time(self._straight(goal, lasts, t, search), t)
                if not self._met(reach, t):
                    return reach
            raise NoSolutionError("the straight way to the stand-off meets what moves")
        reach = plan(self.start, goal, mode=self.mode, constraints=self.constraints, search=search)
        if not self._met(self._in_time(reach, t), t):
            return reach
        lasts = min(t, 1.5 * float(reach.t[-1]))
        return self._planned_among(goal, t, lasts if t - lasts <= self.rests_until else t, search)

    def _in_time(self, reach: Plan, t: float) -> Plan:
        """Return a plan, if it takes no longer than a time."""
        if (late := float(reach.t[-1]) - t) > 1e-9 * t:  # not by rounding
            why = f" ({reach.wheel_load})" if reach.wheel_load else ""
            raise NoSolutionError(f"the way to the stand-off takes {late:.3g} s too long{why}")
        return reach

    def _met(self, reach: Plan, t: float) -> bool:
        """Return whether the arm meets anything on a way that ends at a time, or before it."""
        if not self.constraints.collisions:
            return False
        begin = t - float(reach.t[-1])
        if begin > self.rests_until:
            return True
        return contact_on(reach, self._around(begin), self.account.check_time) is not None

    def check_start(self) -> None:
        """Refuse a start at which the target, or an obstacle, is met at once."""
        if self.constraints.collisions and (met := contact_on(self.start, self._around(0.0))):
            raise NoSolutionError(
                f"at time 0 {met}; move the start or the target, or name links that may touch it "
                "by touching=[...]"
            )

    @cached_property
    def rests_until(self) -> float:
        """Time [s] until which nothing meets the arm at rest at the start."""
        end = self.window[1] if self.constraints.collisions else 0.0
        while end > 1e-3 * self.window[1]:
            row = samples([self.start] * 2)
            contact = contact_on(
                Motion(self.start.arm, np.array([0.0, end]), row["q"], row["base"]),
                self._around(0.0),
                self.account.check_time,
            )
            if contact is None:
                return end
            end = 0.95 * contact.t
        return 0.0

    def _planned_among(
        self, goal: pin.SE3 | Joints, t: float, duration: float, search: Search
    ) -> Plan:
        """Return a plan until a time t that lasts so long [s] and holds the target off."""
        among = self.constraints
        if among.collisions:
            among = replace(among, obstacles=self._around(t - duration))
        return plan(
            self.start, goal, duration=duration, mode=self.mode, constraints=among, search=search
        )

    def _wheels_after(self, end: Configuration) -> Wheels | None:
        """Return the wheels as they are once the joints rest, None where there are none."""
        if self.wheels is not None or not self.start.arm.wheels:
            return self.wheels
        return Wheels.free(end, self.constraints.wheels)

    def _borne(self, chase: Followed, wheels: Wheels) -> tuple[Followed, str]:
        """Return the motion to contact with what wheels hold, and a report of that.

        Raises:
            NoSolutionError: They cannot hold it.
        """
        load = load_of(chase.arm, chase.spline)
        slower, why = wheels.slowdown(load)
        if slower > 1.0:
            raise NoSolutionError(f"on the way from the stand-off {why}")
        moving, _ = momentum_and_torque(chase.arm, chase.q, chase.dq, chase.ddq)
        held = wheels.momenta(moving)[:, : len(chase.arm.wheels)]
        return replace(chase, wheels=held), wheels.story(load)

    def settled(self, found: Catch) -> Catch:
        """Return a catch with all that is proven of how far singular postures are, in the time."""
        if found.distance_proven >= PROVEN:
            return found
        known = singular_set(found.arm, mode=self.mode)
        clear = list[float]()
        try:
            for way in (found.plan, found.chase):
                proof = known.clearance(way, at_least=PROVEN, progress=self.account.tick)
                clear.append(proof.clearance)
        except TimeUpError:
            return found
        return replace(found, distance_proven=max(found.distance_proven, min(clear)))

    def _proven(self, *motions: Motion) -> float:
        """Return the distance [rad] of motions within which no posture is singular, proven.

        More than most of what it is to first order is not asked of the proof, which is short then.

        Raises:
            NoSolutionError: It is not proven that they meet no singularity.
        """
        arm, least = self.floats.arm, self.proves
        known = singular_set(self.start.arm, mode=self.mode)
        for motion in motions:
            about = evaluate(arm, motion.q, ("distance",))["distance"].min()
            least = min(least, float(MOST * about))
            proof = known.clearance(motion, at_least=least, progress=self.account.tick)
            least = min(least, proof.clearance)
            if least <= 0.0:
                raise NoSolutionError("it is not proven that the way meets no singularity")
        return least

    def _others(self, begin: float = 0.0) -> tuple[Obstacle, ...]:
        """Return the obstacles besides the target, as a motion meets them that begins at a time."""
        given = obstacles_of(self.constraints.obstacles, self.start)
        return tuple(replace(one, begin=one.begin + begin) for one in given)

    def _around(self, begin: float) -> tuple[Obstacle, ...]:
        """Return what must not be met by a motion that begins at a time, the target among it."""
        target = Obstacle.of_target(self.target, begin=begin, may_touch=self.touching)
        return (*self._others(begin), target)

    def _check_loads(self, what: str, loads: Array, most: Array) -> None:
        """Refuse what is more than joints can, (n,) each."""
        excess = loads / most
        j = int(excess.argmax())
        if excess[j] > 1.0:
            name = self.start.arm.joint_names[j]
            raise NoSolutionError(f"joint {name!r} would need {excess[j]:.3g} times its {what}")

    def _check_contacts(self, chase: Motion, t: float) -> None:
        """Refuse a motion to contact at a time on which anything is met."""
        if not self.constraints.collisions:
            return
        begin = t - float(chase.t[-1])
        contact = contact_on(chase, self._around(begin), self.account.check_time)
        if contact is not None:
            meet = f"{' and '.join(contact.links)} meet after {begin + contact.t:.4g} s"
            raise NoSolutionError(meet)


def in_turn(grapple: Grapple) -> list[Mapping[str, str]]:
    """Return the frames of tips by the turns in which they grasp; none where no tips are named."""
    if grapple is None or isinstance(grapple, str):
        return []
    return [grapple] if isinstance(grapple, Mapping) else [*grapple]


def away(cfg: Configuration, pose: pin.SE3, axis: Array) -> tuple[bool, float]:
    """Return whether a frame is out of reach, and the cosine by which its open side looks away."""
    off = float(np.linalg.norm(pose.translation - cfg.com))
    facing = -(pose.rotation @ axis) @ (cfg.com - pose.translation) / max(off, 1e-9)
    return bool(out_of_reach(cfg, pose)), -float(facing)


def _between(a: pin.SE3, b: pin.SE3, s: float) -> pin.SE3:
    """Return a pose between two: the straight line of its origin, the shortest turn."""
    R = a.rotation @ pin.exp3(s * pin.log3(a.rotation.T @ b.rotation))
    return pin.SE3(R, (1.0 - s) * a.translation + s * b.translation)
