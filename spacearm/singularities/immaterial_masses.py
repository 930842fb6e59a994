"""Masses that do not matter: a body that the task holds at rest has no momentum.

A rigid body fixed to the tip, of spatial inertia X about the tip's frame, adds X times the tip's
twist to the momentum: A' = A + X J. If the task has all rows of that twist, then

    [A'; J] = [[1, X], [0, 1]] [A; J],

and S = det [A; J] and all maximal minors stay exactly the same. With them stay the singular set,
its distances, and the proofs that paths and boxes are free of it. sigma_min does not stay.

Singular means: arm and spacecraft can move with zero momentum while the tip is at rest. What is at
rest has no momentum, whatever its mass is.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from spacearm.errors import listed
from spacearm.mechanics.jacobian import plane_of_motion
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm


def any_payload(arm: SpaceArm, mode: BaseMode) -> bool:
    """Check whether the singular set is the same for every rigid body held at the tips.

    It is if the task has all rows of the tip's twist: six, or three for an arm that moves in a
    plane. Such an arm has to stay planar: the body's CM lies in the plane of the others, and a
    principal axis is normal to it. On a fixed spacecraft no mass matters.
    """
    if mode == "fixed":
        return True
    rows = {i % 6 for i in arm.task.indices}
    normal = arm.tree.plane_normal() if mode == "attitude-controlled" else plane_of_motion(arm)
    return len(rows) == 6 or (normal is not None and rows >= {*{0, 1, 2} - {normal}, 3 + normal})


def immaterial_links(arm: SpaceArm, mode: BaseMode) -> tuple[str, ...]:
    """Return the links whose mass, inertia and CM do not change where the arm is singular.

    Those that move as one body with a tip, where `any_payload` is true. Their CM and inertia have
    to keep an arm planar that is.
    """
    massive = arm.whole.massive()
    if mode == "fixed":
        return tuple(massive)
    if not any_payload(arm, mode):
        return ()
    body_of = arm.tree.body_of
    held = {body_of[tip] for tip in arm.tips}
    return tuple(link for link in massive if body_of[link] in held)


def payload_note(arm: SpaceArm, mode: BaseMode) -> str:
    """Say for which payloads the singular set and what is proven about it hold."""
    if mode == "fixed":
        return "The singular set is the same for any payload: the spacecraft is fixed."
    if not any_payload(arm, mode):
        return (
            f"The singular set is that of this payload: the task {arm.task.names!r} leaves it free "
            "to move."
        )
    links = immaterial_links(arm, mode)
    planar = "" if len({i % 6 for i in arm.task.indices}) == 6 else " that keeps the arm planar"
    own = f", and for any mass of {listed(list(links))}" if links else ""
    return f"The singular set is the same for any payload{planar}{own}."


@lru_cache(maxsize=64)
def digest_of_set(arm: SpaceArm, mode: BaseMode) -> str:
    """Return a digest of all of an arm that its singular set depends on.

    Masses that do not matter are left out: the same digest, the same set.
    """
    model, joints = arm.model, arm.tree.movable()
    held = set[int]()
    if mode == "fixed":
        held = {*range(model.njoints)}
    elif any_payload(arm, mode):
        held = {model.frames[frame].parentJoint for frame in arm.tip_frames}
    numbers = [model.inertias[i].toDynamicParameters() for i in {*range(model.njoints)} - held]
    numbers += [pose.homogeneous.ravel() for pose in model.jointPlacements]
    numbers += [model.frames[frame].placement.homogeneous.ravel() for frame in arm.tip_frames]
    numbers += [arm.offsets] if arm.coupling is None else [arm.offsets, arm.coupling.ravel()]
    numbers += [joint.axis for joint in joints]
    kinds = [joint.kind for joint in joints]
    words = arm.joint_names, arm.tips, arm.task.names, kinds, mode, sorted(held)
    return hashlib.sha256(np.concatenate(numbers).tobytes() + repr(words).encode()).hexdigest()


@dataclass(frozen=True)
class SameSet:
    """All arms with the same singular set and the same ranges of joints: one stands for them.

    Attributes:
        digest: What they have in common.
        arm: One of them.
        mode: What the spacecraft does.
    """

    digest: str
    arm: SpaceArm = field(compare=False)
    mode: BaseMode = field(compare=False)

    @classmethod
    def of(cls, arm: SpaceArm, mode: BaseMode) -> SameSet:
        """Return what stands for an arm."""
        ranges = np.array((arm.lower, arm.upper))[:, arm.slides].tolist()
        return cls(f"{digest_of_set(arm, mode)} {ranges}", arm, mode)
