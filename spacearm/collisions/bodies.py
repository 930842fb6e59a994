"""Bodies of an arm that may collide, and how far its joints can move them.

A link counts with its collision geometry. Where the description gives none that can be read, its
visuals stand in, each as its convex hull, or as the box around it where it is flat. Links without
either are not checked, and `Bodies.account` names them.
"""

from __future__ import annotations

from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from spacearm.collisions.solids import collision_solids, visual_solids
from spacearm.description.shapes import Visuals
from spacearm.errors import listed
from spacearm.model.arm import SpaceArm


class Body(NamedTuple):
    """A shape: its link, the joint that carries it, and its pose there.

    Each joint between the spacecraft and the body moves its points by at most `reach` [m/rad], plus
    the displacement of the sliding joints between, named in `slides`; a sliding joint itself by 1.
    The points are at most `far` [m] from the origin of the spacecraft frame, plus all of these
    displacements.
    """

    link: str
    joint: int
    pose: pin.SE3
    shape: coal.CollisionGeometry
    reach: dict[int, float]
    slides: dict[int, list[int]]
    far: float


class Bodies:
    """The bodies of an arm that may collide.

    Attributes:
        all: The bodies.
        by_collision: Links that count with their collision geometry.
        by_visual: Links that count with their visuals.
        without: Links whose shapes cannot be used, and moving bodies without any: not checked.

    Args:
        arm: The arm.

    Raises:
        ModelError: Collision geometry of a link is faulty.
    """

    def __init__(self, arm: SpaceArm) -> None:
        self.all: list[Body] = []
        self.by_collision: list[str] = []
        self.by_visual: list[str] = []
        self.without: list[str] = []
        for leader, links in arm.tree.lumps().items():
            found = [link for link in links if self._add(arm, link)]
            if not found and any(arm.tree.links[link] for link in links):
                self.without.append(leader)

    def _add(self, arm: SpaceArm, link: str) -> bool:
        """Add the shapes of a link; return whether it has any."""
        shapes = arm.tree.visuals.get(link, Visuals())
        if found := list(collision_solids(arm, link, shapes)):
            self.by_collision.append(link)
        elif found := list(visual_solids(shapes)):
            self.by_visual.append(link)
        elif shapes.visual or shapes.collision:
            self.without.append(link)
        frame = arm.model.frames[arm.model.getFrameId(link, pin.BODY)]
        for solid, at in found:
            pose = frame.placement * at
            self.all.append(
                Body(link, frame.parentJoint, pose, solid, *_reach(arm, frame, pose, solid))
            )
        return bool(found) or link in self.without

    @property
    def account(self) -> str:
        """What a check of collisions covers, in one sentence."""
        if not self.all:
            return "collisions NOT checked: the description gives the links no shapes"
        ways = [
            f"{len(self.by_collision)} links by their collision geometry" * bool(self.by_collision),
            f"by their visuals {listed(self.by_visual)}" * bool(self.by_visual),
        ]
        missed = f"; NOT checked, without shapes: {listed(self.without)}" * bool(self.without)
        return f"collisions checked: {', '.join(filter(None, ways))}{missed}"


def extent(pose: pin.SE3, shape: coal.CollisionGeometry) -> float:
    """Return a length that no point of a shape at a pose is farther than from the origin [m]."""
    shape.computeLocalAABB()
    return float(np.linalg.norm(pose.act(shape.aabb_center)) + shape.aabb_radius)


def _reach(
    arm: SpaceArm, frame: pin.Frame, pose: pin.SE3, shape: coal.CollisionGeometry
) -> tuple[dict[int, float], dict[int, list[int]], float]:
    """Return reach and slides of a body, for each joint that carries it, and its far."""
    far = extent(pose, shape)
    reach: dict[int, float] = {}
    slides: dict[int, list[int]] = {}
    between: list[int] = []
    joint = frame.parentJoint
    while joint > 1:
        sliding = arm.tree.joints[arm.model.names[joint]].kind == "prismatic"
        reach[joint], slides[joint] = (1.0, []) if sliding else (far, list(between))
        between += [joint - 2] if sliding else []
        far += float(np.linalg.norm(arm.model.jointPlacements[joint].translation))
        joint = arm.model.parents[joint]
    return reach, slides, far
