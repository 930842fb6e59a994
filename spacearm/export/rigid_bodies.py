"""The rigid bodies of an arm with the joints that carry them, as files of simulators name them."""

from __future__ import annotations

from dataclasses import dataclass

import pinocchio as pin

from spacearm.description.bodies import Joint
from spacearm.description.visuals import Shape
from spacearm.model.arm import SpaceArm


@dataclass(frozen=True, eq=False)
class RigidBody:
    """A body: a link, and all that is fixed to it.

    Attributes:
        name: The link whose frame it has.
        parent: Number of the body that its joint starts from; None for the spacecraft.
        joint: Its joint; None for the spacecraft.
        pose: Pose of its frame in that of the parent at zero.
        inertia: Its mass, CM and inertia about it.
        frames: Poses of the other links that belong to it, by name.
        visual: What is drawn of all these links, in its frame.
        collision: What collides, likewise.
    """

    name: str
    parent: int | None
    joint: Joint | None
    pose: pin.SE3
    inertia: pin.Inertia
    frames: dict[str, pin.SE3]
    visual: list[Shape]
    collision: list[Shape]


def rigid_bodies(arm: SpaceArm) -> list[RigidBody]:
    """Return the bodies, parents first; held and locked joints are fixed."""
    model, tree = arm.model, arm.tree
    into = {joint.name: joint for joint in tree.joints.values()}
    found = []
    for i in range(1, model.njoints):
        joint = into[model.names[i]] if i > 1 else None
        lead = joint.child if joint else tree.root
        links = {
            frame.name: frame.placement
            for frame in model.frames
            if frame.type == pin.BODY and frame.parentJoint == i
        }
        shapes = [(at, tree.visuals[link]) for link, at in links.items() if link in tree.visuals]
        found.append(
            RigidBody(
                name=lead,
                parent=int(model.parents[i]) - 1 if joint else None,
                joint=joint,
                pose=model.jointPlacements[i],
                inertia=model.inertias[i],
                frames={link: at for link, at in links.items() if link != lead},
                visual=[s._replace(pose=at * s.pose) for at, part in shapes for s in part.visual],
                collision=[
                    s._replace(pose=at * s.pose) for at, part in shapes for s in part.collision
                ],
            )
        )
    return found
