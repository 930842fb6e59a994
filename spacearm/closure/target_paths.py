"""Paths of a held target: all tips led at once, so that the target follows and closure is kept.

Arms that hold a target are carried as one arm, the target fixed to its first tip: what floats and
turns is that arm, with all that is known of arms, its momentum, J*, energy and bodies. Closure is
that the other tips stay at their grasps. Where all tips rest, the target rests too, so that the
stacked J* of this arm is singular where that of the free hands is.

With G_i the twist of grasp i by that of the target, the joints move as J*_i dq = G_i v_t for all
tips i.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.closure.closed_distances import ClosedSearch, closed_distances
from spacearm.closure.closing import Closure, Gaps, carried, closed_motions
from spacearm.description.tree import Tree, free_name
from spacearm.errors import UnsupportedError, require_known
from spacearm.mechanics.jacobian import generalized_jacobian
from spacearm.mechanics.target import Target
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.motion import following
from spacearm.motion import goal as goals
from spacearm.motion.motion_file import Quantity
from spacearm.results import Cell, Description, Measure, Table

#: How many rows of a motion are searched at most, and from how many of them in all directions.
SEARCHED, WIDELY = 40, 4
#: From how many random postures these are.
TRIES = 4


def with_target(
    cfg: Configuration, target: Target, at: pin.SE3, tip: str = ""
) -> tuple[Configuration, Tree]:
    """Return a configuration with a target at a pose in the frame of a tip, and the target's tree.

    Without a name it is the first tip. The target's links get names that the arm has not.
    """
    tree, name = cfg.arm.whole, free_name("target", cfg.arm.whole.has)
    body = target.tree.renamed(lambda part: f"{name}_{part}")
    arm = cfg.arm.on(tree.joined(body, name, tip or cfg.arm.tips[0], at))
    return arm.at(cfg.q, base=cfg.base, wheels=cfg.wheels, momentum=cfg.momentum), body


class Carrying:
    """Arms that hold a target.

    Attributes:
        start: The configuration at the start, the target fixed to the first tip.
        free: The arm without the target.
        target: The target.
        grasps: What each tip holds, in the order of the tips.
        link: Name of the target's link.

    Args:
        cfg: The configuration at the start, closed.
        target: The target, as it is held.
        grasps: The grasps by tip.

    Raises:
        UnsupportedError: It is the fixed world that is held.
    """

    def __init__(
        self, cfg: Configuration, target: Target | None, grasps: Mapping[str, pin.SE3]
    ) -> None:
        if target is None:
            raise UnsupportedError(
                "the tips hold the fixed world, which nothing moves; give a target to sa.hold"
            )
        self.free, self.target, self.grasps = cfg.arm, target, tuple(grasps.values())
        self.start, body = with_target(cfg, target, self.grasps[0].inverse())
        self.link, self._parts = body.root, set(body.links)
        self._closure = Closure(self.free, self.grasps, fixed=False, limits=False)

    @property
    def arm(self) -> SpaceArm:
        """The arm with the target."""
        return self.start.arm

    @cached_property
    def of_target(self) -> SpaceArm:
        """The same arm with the target's frame as its only tip."""
        return self.arm.replace(tip=self.link, joints=self.arm.joint_names)

    def frame(self, cfg: Configuration) -> pin.SE3:
        """Return the pose of the target in a configuration, inertial frame."""
        return cfg.tips[0] * self.grasps[0].inverse()

    def aim(self, cfg: Configuration, frame: Frame) -> Configuration:
        """Return a configuration whose tip is the target's frame, seen from a frame.

        Raises:
            ConfigurationError: There is no such frame.
        """
        require_known("frame", frame, ("inertial", "spacecraft"))
        base = cfg.base if frame == "inertial" else pin.SE3.Identity()
        return kinematics(self.of_target, cfg.q.copy(), base)

    def gaps(self, cfg: Configuration) -> Gaps:
        """Return how far tips are from their grasps at most."""
        return Gaps.of(cfg.tips, self.frame(cfg), self.grasps)

    def closed(self, q: Array) -> Array:
        """Return the closed joint positions (n,) next to some."""
        cfg = kinematics(self.free, q, pin.SE3.Identity())
        return self._closure.solved(q, self.frame(cfg))[0]

    def search(self, mode: BaseMode) -> ClosedSearch:
        """Return a search for singular postures along closure.

        Args:
            mode: What the spacecraft does.
        """
        return ClosedSearch(self._closure, mode)

    def hands(self, cfg: Configuration) -> tuple[Configuration, Target]:
        """Return a configuration without the target, and the target where it is."""
        free = kinematics(self.free, cfg.q.copy(), cfg.base)
        return free, self.target.replace(pose=self.frame(cfg))

    def closure_distances(
        self, mode: BaseMode, rows: Sequence[Configuration], search: ClosedSearch | None = None
    ) -> Array:
        """Return how far the nearest singular postures found along closure are (m,) [rad].

        At most `SEARCHED` rows are searched; what they find counts for the others too. If nothing
        is found at all, the distances are first-order estimates.

        Args:
            mode: What the spacecraft does.
            rows: The rows of a motion.
            search: A search that knows some singular postures.
        """
        search = self.search(mode) if search is None else search
        chosen = np.unique(np.linspace(0, len(rows) - 1, SEARCHED).astype(int))
        widely = chosen[np.unique(np.linspace(0, len(chosen) - 1, WIDELY).astype(int))]
        for i in [*widely, *chosen]:
            search.look(*self.hands(rows[i]), tries=TRIES if i in widely else 0)
        if search.found:
            return np.array([search.distance(cfg.q) for cfg in rows])
        near = list[float]()
        for cfg in rows:
            free, held = self.hands(cfg)
            closed = closed_motions(free, held, mode)
            near.append(float(closed_distances(free, closed, mode, ranks=1).distances[-1]))
        return np.array(near)

    @property
    def touching(self) -> list[frozenset[str]]:
        """Pairs of links that may touch: hands and the target that they hold."""
        tree = self.arm.tree
        hands = {tree.body_of[tip] for tip in self.arm.tips}
        holding = {link for link in tree.links if tree.body_of[link] in hands}
        return [frozenset((a, b)) for a in self._parts for b in holding - self._parts]

    def told(
        self,
        mode: BaseMode,
        rows: Sequence[Configuration],
        search: ClosedSearch | None = None,
    ) -> dict[str, Any]:
        """Return what rows tell of closure along a motion, by the fields of `FollowedTarget`."""
        near = self.closure_distances(mode, rows, search)
        return {"closure_distance": near, **self.account(rows)}

    def account(self, rows: Sequence[Configuration]) -> dict[str, Any]:
        """Return target, gap and gap_angle of the rows of a motion, by these names."""
        off = np.array([self.gaps(cfg) for cfg in rows])
        return {
            "target": np.array([pin.SE3ToXYZQUAT(self.frame(cfg)) for cfg in rows]),
            "gap": off[:, 0].copy(),
            "gap_angle": off[:, 1].copy(),
        }


#: In which poses of a target are given.
Frame: TypeAlias = Literal["inertial", "spacecraft"]
#: What is reported of each row of a motion with a held target.
HELD: Mapping[str, Quantity] = {
    "target": Quantity("m, quaternion xyzw", "pose"),
    "gap": Quantity("m"),
    "gap_angle": Quantity("rad"),
    "closure_distance": Quantity("rad"),
}
#: What is not checked between the rows of it.
BETWEEN = "closure, limits and distances between the rows"


class FollowedTarget(following.Followed, kw_only=True):
    """The motion of arms whose held target follows a path, from `Held.follow`.

    Its arm is the arms with the target, which is fixed to the first tip.

    Attributes:
        target: (m, 7) poses of the target: position [m], quaternion xyzw, inertial frame.
        gap: (m,) largest distance of a tip from its grasp [m].
        gap_angle: (m,) largest angle between them [rad].
        closure_distance: (m,) how far the nearest singular posture found along closure is [rad], an
            upper bound found by search; first-order estimates where none is found at all.
    """

    target: Array
    gap: Array
    gap_angle: Array
    closure_distance: Array

    QUANTITIES: ClassVar[Mapping[str, Quantity]] = {**following.Followed.QUANTITIES, **HELD}

    @property
    def not_checked(self) -> str:
        """What the answer does not cover."""
        return f"collisions; {BETWEEN}"

    def describe(self) -> Description:
        """Describe the motion, why it ended, and what closure does on the way."""
        motion = super().describe()
        return replace(motion, tables=[*motion.tables, gaps_table(self)])


def gaps_table(motion: Any) -> Table:
    """Return what is reported about closure along the rows of a motion."""
    facts: dict[str, Cell] = {
        "largest gap of a grasp": Measure(float(motion.gap.max()), "m", ".1e"),
        "and angle": Measure(float(motion.gap_angle.max()), "rad", ".1e"),
    }
    if hasattr(motion, "closure_distance"):
        least = float(motion.closure_distance.min())
        facts["nearest singular posture found along closure"] = Measure(least, "rad")
    return Table.facts(facts, "At the rows")


class TargetCurve(following.TipCurve):
    """The curve of states along which a held target follows one segment.

    Args:
        carrying: The arms with the target.
        cfg: Configuration at its start.
        segment: The segment, of the target's frame.
        mode: What the spacecraft does.
        limits: Whether joint limits end it.
        frame: In which the segment is given.
        rest: (n,) joint positions to which the joints move in the null space; None for none.
        gain: How fast, for a unit of the segment.
    """

    def __init__(
        self,
        carrying: Carrying,
        cfg: Configuration,
        segment: following.Segment,
        mode: BaseMode,
        limits: bool,
        frame: Frame = "inertial",
        rest: Array | None = None,
        gain: float = 1.0,
    ) -> None:
        self.carrying, self.relative = carrying, frame == "spacecraft"
        self.rest, self.gain = rest, gain
        super().__init__(cfg, segment, mode, limits)

    def jacobian(self, cfg: Configuration) -> Array:
        """Return the rows (k, n) of J* of all tips; seen from the spacecraft J."""
        J = generalized_jacobian(cfg, mode="fixed" if self.relative else self.mode)
        return goals.goal_rows(cfg, J)

    def wanted(self, cfg: Configuration, s: float) -> Array:
        """Return the twists (6 tips,) of all grasps, and back to where they should be."""
        pose, twist = self.segment.pose(s), self.segment.twist(s)
        if self.relative:
            base = cfg.base
            pose, twist = base * pose, np.kron(np.eye(2), base.rotation) @ twist
        x = list[Array]()
        for tip, grasp in zip(cfg.tips, self.carrying.grasps, strict=True):
            there = pose * grasp
            moved = carried(there.translation - pose.translation) @ twist
            x.append(moved + self.correction * goals.twist_between(tip, there))
        return np.concatenate(x)

    def adrift(self, cfg: Configuration) -> Array:
        """Return the twists of the tips by the momentum alone; none, seen from the spacecraft."""
        return np.zeros(len(cfg.J)) if self.relative else super().adrift(cfg)

    def inner(self, cfg: Configuration) -> Array:
        """Return the joint rates (n,) towards the positions at rest."""
        return super().inner(cfg) if self.rest is None else self.gain * (self.rest - cfg.q)

    def place(self, cfg: Configuration) -> Array:
        """Return where (3,) the target is [m]."""
        return self.carrying.frame(cfg).translation


def check_chain(carrying: Carrying, mode: BaseMode, limits: bool, timed: bool) -> None:
    """Refuse what cannot lead a target anywhere.

    Raises:
        ConfigurationError: The start is singular, or beyond the joint limits where they count.
        UnsupportedError: There is momentum and no times, or the arms have too few joints.
    """
    arm = carrying.arm
    if arm.n < arm.task.k:
        raise UnsupportedError(
            f"{arm.name} has {arm.n} joints for the {arm.task.k} rows of {len(arm.tips)} tips, so "
            "that the target cannot follow any path; Held.report() tells how it can move"
        )
    following.check_start(carrying.start, mode, limits, timed, "target")
