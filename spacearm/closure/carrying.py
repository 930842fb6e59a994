"""Carrying: arms that hold a target as one arm, the target fixed to its first tip.

What floats, turns and moves is then that arm, with all that is known of arms: its momentum, J*,
energy and bodies. Closure is that the other tips stay at their grasps. Where all tips rest, the
target rests too, so that the stacked J* of this arm is singular where that of the free hands is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.closure.closed_motions import closed_motions
from spacearm.closure.closing import Closure
from spacearm.closure.held_report import closed_distances
from spacearm.collisions.obstacles import Obstacle
from spacearm.collisions.separation import Collisions
from spacearm.description.tree import free_name
from spacearm.errors import UnsupportedError
from spacearm.mechanics.target import Target
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, SpaceArm, kinematics


class Gaps(NamedTuple):
    """How far tips are from their grasps at most: place [m] and angle [rad]."""

    gap: float
    turn: float


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
        tree, name = cfg.arm.whole, free_name("target", cfg.arm.whole.has)
        body = target.tree.renamed(lambda part: f"{name}_{part}")
        self.link, self._parts = body.root, set(body.links)
        at = self.grasps[0].inverse()
        arm = cfg.arm.on(tree.joined(body, name, cfg.arm.tips[0], at))
        self.start = arm.at(cfg.q, base=cfg.base, wheels=cfg.wheels, momentum=cfg.momentum)
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

    def gaps(self, cfg: Configuration) -> Gaps:
        """Return how far tips are from their grasps at most."""
        frame = self.frame(cfg)
        off = [(frame * F).actInv(tip) for F, tip in zip(self.grasps, cfg.tips, strict=True)]
        return Gaps(
            max(float(np.linalg.norm(pose.translation)) for pose in off),
            max(float(np.linalg.norm(pin.log3(pose.rotation))) for pose in off),
        )

    def closed(self, q: Array) -> Array:
        """Return the closed joint positions (n,) next to some."""
        cfg = kinematics(self.free, q, pin.SE3.Identity())
        return self._closure.solved(q, self.frame(cfg))[0]

    def distance(self, cfg: Configuration, mode: BaseMode) -> float:
        """Return how far a singular posture is along closure, to first order [rad]."""
        hands = kinematics(self.free, cfg.q.copy(), cfg.base)
        held = self.target.replace(pose=self.frame(cfg))
        closed = closed_motions(hands, held, mode)
        return float(closed_distances(hands, closed, mode).distances[-1])

    def collisions(self, obstacles: Sequence[Obstacle]) -> Collisions:
        """Return the bodies that must not meet; hands may touch the target that they hold."""
        tree = self.arm.tree
        hands = {tree.body_of[tip] for tip in self.arm.tips}
        holding = {link for link in tree.links if tree.body_of[link] in hands}
        return Collisions(
            self.arm,
            obstacles,
            [frozenset((a, b)) for a in self._parts for b in holding - self._parts],
        )

    def account(self, rows: Sequence[Configuration]) -> dict[str, Array]:
        """Return target, gap and gap_angle of the rows of a motion, by these names."""
        off = np.array([self.gaps(cfg) for cfg in rows])
        return {
            "target": np.array([pin.SE3ToXYZQUAT(self.frame(cfg)) for cfg in rows]),
            "gap": off[:, 0].copy(),
            "gap_angle": off[:, 1].copy(),
        }
