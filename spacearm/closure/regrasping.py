"""Regrasping: one of several hands lets go and grasps elsewhere, while the others hold on.

Meanwhile the joints of the hands that hold are locked, and the target is a payload of one of them.
So what moves is one arm with one tip, and what is singular, planned and flown is that arm. The
hand backs off from its grasp, moves to where it can close in on the other one, and closes in.
Where the fixed world is held the spacecraft stands on it, as a body so heavy that no joint moves
it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from spacearm.arrays import (
    Array,
    ArrayLike,
    ReadOnlyMapping,
    finite,
    generator,
    positive,
    shape_of,
)
from spacearm.closure.closing import Closure, Gaps, anywhere, named
from spacearm.closure.target_paths import with_target
from spacearm.collisions.bodies import but_for, left_out
from spacearm.collisions.separation import Collisions
from spacearm.errors import (
    ConfigurationError,
    NoSolutionError,
    UnsupportedError,
    listed,
    require_known,
)
from spacearm.mechanics.floating import placed
from spacearm.mechanics.target import Target
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.model.frames import pose_facts
from spacearm.motion.controllers import Tracking
from spacearm.motion.flights import Flight, Phase, joined, simulate_phases
from spacearm.motion.motion import Motion
from spacearm.motion.plant import Integration, Plant
from spacearm.planning import planner
from spacearm.planning.account import Attempts, SearchAccount
from spacearm.planning.many_curves import FlownRows
from spacearm.planning.problem import broken_as_flown, clearance_of
from spacearm.planning.reactions import boundless, largest_turn
from spacearm.planning.request import Constraints, Joints, PlanRequest, Search
from spacearm.planning.result import Attempt, Plan
from spacearm.planning.timing import rest_to_rest_times
from spacearm.results import Column, Description, Result, Table
from spacearm.singularities.nearest import angle

#: Intervals in which a hand backs off, and the longest joint motion of one [rad] or [m].
NODES, STRIDE = 40, 0.2
#: What a posture may leave open [m], [rad]; postures nearer to each other are one [rad] or [m].
OPEN, SAME = 1e-9, 0.05
#: Random postures from which the other grasp is sought.
POSTURES = 30
#: Share of the time left that a plan to a posture may take, and the least time for it [s].
PART, SHORT = 0.4, 2.0
#: Most failures that a message tells.
TOLD = 3
#: How many times as much as all of its robot a spacecraft weighs that stands on the fixed world.
GROUNDED = 1e9
#: The parts of the motion, in order.
PARTS = ("backing off", "moving", "closing in")


class Regrasp(Result, kw_only=True):
    """How one of several hands lets go and grasps elsewhere, from `Held.regrasp`.

    Its arm is that of the freed hand: the joints of the others are locked, and the target is fixed
    to one of the hands that hold. `Held.after` takes it and returns how the target is then held.
    `sa.view` and `sa.plot` take it as a motion.

    Attributes:
        target: The target where it is at the end; None if the fixed world is held.
        tip: The hand that is freed.
        grasps: What each tip holds at the end, as of `Held`.
        back: The motion from the old grasp to where the hand is free, from rest to rest.
        plan: The motion to where it can close in.
        close: The motion to the other grasp.
        end: The configuration of all arms at the end, without the target.
        checked: What the proof that nothing meets covers, in one sentence; empty if none was asked
            for. While it backs off and closes in, the hand may touch the target.
        tried: The postures at the other grasp that were tried, and what came of them.
    """

    target: Target | None
    tip: str
    grasps: Mapping[str, pin.SE3]
    back: Plan
    plan: Plan
    close: Plan
    end: Configuration
    checked: str
    tried: tuple[Attempt, ...]

    @property
    def arm(self) -> SpaceArm:
        """The arm of the freed hand."""
        return self.plan.arm

    @property
    def parts(self) -> tuple[Plan, Plan, Plan]:
        """The three motions, each with a clock of its own."""
        return self.back, self.plan, self.close

    @cached_property
    def motion(self) -> Motion:
        """All three as one."""
        return joined(*self.parts)

    @property
    def t(self) -> Array:
        """(m,) times of the whole motion [s]."""
        return self.motion.t

    @property
    def q(self) -> Array:
        """(m, n) joint positions of the freed arm [rad] or [m]."""
        return self.motion.q

    @property
    def base(self) -> Array:
        """(m, 7) poses of the spacecraft, inertial frame."""
        return self.motion.base

    @cached_property
    def distance_proven(self) -> float:
        """How far singular postures of the freed arm are from all three motions, proven [rad]."""
        near = [part.nearest for part in self.parts]
        return min(0.0 if one is None else one.distance_proven for one in near)

    def fly(
        self,
        *,
        plant: Plant = Plant(),
        integration: Integration = Integration(),
        progress: Callable[[float, float], object] | None = None,
    ) -> Flight:
        """Simulate it: `sa.Tracking` leads the freed joints, brakes lock the others.

        Args:
            plant: What else acts, as in `simulate`.
            integration: How it is integrated.
            progress: Called now and then as progress(t, duration).

        Returns:
            The flight: "backing off", "moving" and "closing in". The momentum is conserved.

        Raises:
            SpaceArmError: As `simulate_phases` raises.
        """
        phases = [
            Phase(
                Tracking(part), float(part.t[-1]), plant=plant, integration=integration, name=name
            )
            for name, part in zip(PARTS, self.parts, strict=True)
        ]
        return simulate_phases(self.back[0], phases, progress=progress)

    @property
    def not_checked(self) -> str:
        """What the answer does not cover."""
        left = left_out(self.checked)
        return f"{left}; " * bool(left) + "forces at the grasps that hold"

    def describe(self) -> Description:
        """Describe the three motions, what is proven of them, and what was tried."""
        rows = [
            (
                name,
                part.t[-1],
                angle(0.0 if (near := part.nearest) is None else near.distance_proven, down=True),
                part.method,
            )
            for name, part in zip(PARTS, self.parts, strict=True)
        ]
        columns = (Column("part"), Column("lasts", "s"), Column("no singular posture nearer than"))
        tried = [(a.method, "arrives" if a.arrived else "fails", a.story) for a in self.tried]
        held = listed([tip for tip in self.grasps if tip != self.tip])
        return Description(
            title=f"{self.end.arm.name} and {named(self.target)}",
            verdict=f"{self.tip} regrasps while {held} holds on, in {self.t[-1]:.4g} s"
            f"{but_for(left_out(self.checked))}",
            tone="good",
            notes=[self.checked] if self.checked else [],
            tables=[
                Table.facts(pose_facts(self.grasps[self.tip], "grasp, place")),
                Table((*columns, Column("by")), rows, "Parts; distances are proven"),
                Table(("posture at the grasp", "", ""), tried, "Tried"),
            ],
        )


class Freed:
    """The arm of a hand that is freed, and the search for its way to another grasp.

    Args:
        cfg: The configuration of all arms, closed.
        target: The target, as it is held; None for the fixed world.
        grasps: What each tip holds.
        tip: The hand.
        approach: As of `Held.regrasp`; so are the others.
        closing: Mean speed of the way in [m/s].
        constraints: What must hold.
        search: How to look.

    Raises:
        ConfigurationError: As `Held.regrasp` raises.
        UnsupportedError: Likewise.
    """

    def __init__(
        self,
        cfg: Configuration,
        target: Target | None,
        grasps: Mapping[str, pin.SE3],
        tip: str,
        approach: ArrayLike,
        closing: float,
        constraints: Constraints,
        search: Search,
    ) -> None:
        self.all, self.target, self.grasps, self.tip = cfg, target, grasps, tip
        self.approach = way_in(cfg, tip, approach)
        self.closing = positive(closing, "closing", "speed [m/s]")
        self.search, self.account = search, SearchAccount(search.timeout, search.progress)
        keep = constraints.keep_attitude
        self.constraints = replace(constraints, keep_attitude=keep and keep / len(PARTS))
        self.start, parts = freed(cfg, target, grasps, tip)
        self.arm = self.start.arm
        tree = self.arm.tree
        hand = tree.lumps[tree.body_of[tip]]
        touching = [frozenset((a, b)) for a in parts for b in hand]
        request = PlanRequest.of(
            self.start, Joints(self.start.q), "spacecraft", constraints, search, (), None, None
        )
        if any(obstacle.moves for obstacle in request.obstacles):
            raise UnsupportedError(
                "an obstacle moves, and a hand regrasps in three motions; give obstacles that rest"
            )
        self.request = replace(
            request,
            obstacles=(),
            constraints=replace(self.constraints, collisions=False, obstacles=()),
        )
        self.obstacles = request.obstacles
        bodies = Collisions(self.arm, self.obstacles, touching)
        self.bodies = bodies if constraints.collisions and bodies else None
        here = (pin.SE3.Identity(),)
        self.closure = Closure(self.arm, here, fixed=True, limits=constraints.limits)

    def off(self, q: Array, pose: pin.SE3) -> Array:
        """Return joint positions (m, n) along which the hand backs off from a pose.

        Args:
            q: (n,) joint positions at the pose.
            pose: Where the hand is, seen from the spacecraft.

        Raises:
            NoSolutionError: It cannot.
        """
        way = [q]
        for share in np.linspace(0.0, 1.0, NODES + 1)[1:]:
            there = pose * pin.SE3(np.eye(3), -share * self.approach)
            way.append(self.closure.solved(way[-1], there)[0])
            if (
                max(self.closure.gaps(way[-1], there)) > OPEN
                or np.abs(way[-1] - way[-2]).max() > STRIDE
            ):
                far = share * float(np.linalg.norm(self.approach))
                raise NoSolutionError(
                    f"the hand cannot back off by more than {far:.3g} m: joint limits or a "
                    "singular posture stop it; give a shorter approach"
                )
        return np.array(way)

    def flown(self, name: str, start: Configuration, Q: Array) -> Plan:
        """Return the motion along joint positions (m, n), as it is flown.

        Raises:
            NoSolutionError: It breaks a constraint.
        """
        arm, rates = self.arm, self.constraints.joint_rates(self.arm)
        t = rest_to_rest_times(Q, rates)
        t *= max(1.0, float(np.linalg.norm(self.approach)) / self.closing / t[-1])
        wheels = np.tile(start.wheels, (len(t), 1))
        turns = FlownRows(start, t, Q, wheels, np.zeros(arm.n)).attitudes(parts=2.0)
        rows = [placed(start, q, R) for q, R in zip(Q, turns, strict=True)]
        found = Plan.of_rows(
            name, rows, rates, t=t, momentum=start.momentum, wheels=wheels,
            clearance=clearance_of(start, self.constraints.clearance)[0],
        )  # fmt: skip
        if broken := broken_as_flown(found, self.request):
            raise NoSolutionError(f"{name}: {broken[1]}")
        most = self.constraints.keep_attitude
        if most is not None and (turn := largest_turn(rows)) > most:
            raise NoSolutionError(f"{name}: the spacecraft turns by up to {angle(turn)}")
        if self.bodies is not None:
            if contact := self.bodies.contact(found.swept, self.account.check_time):
                raise NoSolutionError(f"{name}: {contact}")
            found = replace(
                found, checked=self.bodies.account, apart=True, obstacles=self.obstacles
            )
        return found

    def postures(self, q: Array, pose: pin.SE3) -> Iterator[Array]:
        """Yield joint positions (n,) at a pose seen from the spacecraft, from some and random ones.

        Raises:
            NoSolutionError: There are none.
        """
        rng, found, least = generator(self.search.seed), list[Array](), Gaps(np.inf, np.inf)
        for number in range(POSTURES + 1):
            self.account.check_time()
            other = anywhere(self.arm, self.constraints.limits, rng)
            there = self.closure.solved(q + number / POSTURES * (other - q), pose)[0]
            gaps = self.closure.gaps(there, pose)
            least = min(least, gaps, key=max)
            new = all(np.abs(there - known).max() > SAME for known in found)
            if max(gaps) <= OPEN and new:
                found.append(there)
                yield there
        if not found:
            raise NoSolutionError(
                f"from here and {POSTURES} random postures on, the hand stays {least.gap:.3g} m "
                f"and {least.turn:.3g} rad off the grasp while the others keep still; lead the "
                f"target nearer first, by Held.plan{', or limits=False' * self.constraints.limits}"
            )

    def regrasped(self, grasp: pin.SE3) -> Regrasp:
        """Return the way to another grasp; results and errors as of `Held.regrasp`."""
        cfg, target = self.all, self.target
        frame = pin.SE3.Identity() if target is None else target.pose
        back, way, close, tried = self.parts(cfg.base.actInv(frame * grasp))
        moved = dict(zip(close.arm.joint_names, close.q[-1], strict=True))
        held = zip(cfg.arm.joint_names, cfg.q, strict=True)
        q = np.array([moved.get(name, x) for name, x in held])
        last = close[-1].base
        base = cfg.base if target is None else last
        end = kinematics(cfg.arm, q, base).with_momentum(cfg.momentum).with_wheels(cfg.wheels)
        return Regrasp(
            target=target and target.replace(pose=last * cfg.base.actInv(target.pose)),
            tip=self.tip,
            grasps=ReadOnlyMapping({**self.grasps, self.tip: grasp}),
            back=back,
            plan=way,
            close=close,
            end=end,
            checked=close.checked if self.bodies is not None else "",
            tried=tried,
        )

    def parts(self, pose: pin.SE3) -> tuple[Plan, Plan, Plan, tuple[Attempt, ...]]:
        """Return the motions to another pose of the hand seen from the spacecraft, and attempts.

        Raises:
            NoSolutionError: None was found.
            StoppedError: Ctrl-C.
        """
        begin = self.start.base.actInv(self.start.tip)
        attempts = Attempts(self.account)
        with attempts.at("backing off"):
            back = self.flown(PARTS[0], self.start, self.off(self.start.q, begin))
            for number, q in enumerate(attempts.each(self.postures(back.q[-1], pose)), 1):
                with attempts.at(f"posture {number}"):
                    Q = self.off(q, pose)[::-1]
                    if self.bodies is not None and (contact := self.bodies.contact(Q)):
                        raise NoSolutionError(f"{PARTS[2]}: {contact}")
                    time = max(PART * self.account.left, SHORT)
                    search = replace(self.search, timeout=time, progress=None)
                    goal, free = Joints(Q[0]), self.constraints
                    way = planner.plan(back[-1], goal, constraints=free, search=search)
                    close = self.flown(PARTS[2], way[-1], np.vstack((way.q[-1:], Q[1:])))
                    arrives = Attempt(f"posture {number}", True, way.travel)
                    return back, way, close, (*attempts.failed, arrives)
        told = [f"{method}: {why}" for method, _, why in attempts.stories[:TOLD]]
        tried = sum(method.startswith("posture") for method, _, _ in attempts.failed)
        count = f"{tried} posture{'s' * (tried != 1)} at the grasp tried ({self.account.limit})"
        why = "; ".join([count, *told])
        raise self.account.failure(f"{self.tip} does not regrasp: {why}", attempts.best)


def freed(
    cfg: Configuration, target: Target | None, grasps: Mapping[str, pin.SE3], tip: str
) -> tuple[Configuration, list[str]]:
    """Return the arm of one hand, all that moves others locked, and the links of the target.

    Raises:
        ConfigurationError: The hand is the only one that holds, or has no joint of its own.
    """
    arm, tree = cfg.arm, cfg.arm.whole
    others = [other for other in arm.tips if other != tip]
    if not others:
        raise ConfigurationError(f"only {tip!r} holds, and nothing would; hold by another tip too")
    ways = {name: {tree.leader(joint).name for joint in tree.movable(name)} for name in arm.tips}
    own = ways[tip].difference(*(ways[other] for other in others))
    if not own:
        raise ConfigurationError(f"every joint on the way to {tip!r} moves another tip that holds")
    links, momentum, carrying = list[str](), None, arm
    if target is not None:
        holder = others[0]
        start, body = with_target(cfg, target, grasps[holder].inverse(), holder)
        links, carrying, momentum = list(body.links), start.arm, cfg.momentum
    held = {name: float(x) for name, x in zip(arm.joint_names, cfg.q, strict=True)}
    locked = {name: x for name, x in held.items() if name not in own}
    one = carrying.replace(tip=tip, joints="tip", locked=locked)
    one = one if target is not None else boundless(one, GROUNDED * one.mass)
    q = [held[name] for name in one.joint_names]
    return one.at(q, base=cfg.base, wheels=cfg.wheels, momentum=momentum), links


def way_in(cfg: Configuration, tip: str, approach: ArrayLike) -> Array:
    """Return the way (3,) of a hand as it closes in, its own axes [m].

    Raises:
        ConfigurationError: It is not a length or vector, or leads out of the plane of a planar arm.
    """
    require_known("tip", tip, cfg.arm.tips)
    if shape_of(approach) == ():
        approach = (0.0, 0.0, positive(approach, "approach", "distance [m]"))
    along = finite(approach, (3,), "approach", "[m], a distance or (3,) in the axes of the hand")
    positive(float(np.linalg.norm(along)), "length of approach", "distance [m]")
    normal = cfg.arm.tree.plane_normal()
    if normal is not None:
        out = cfg.base.rotation[:, normal] @ cfg.tips[cfg.arm.tips.index(tip)].rotation @ along
        if abs(out) > OPEN:
            raise ConfigurationError(
                f"approach leads the hand out of the plane of {cfg.arm.name}; give it in the axes "
                "of the hand, such as approach=(0.1, 0, 0)"
            )
    return along
