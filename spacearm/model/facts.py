"""Facts: what an arm consists of, as plain data."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

if TYPE_CHECKING:
    from spacearm.description.bodies import Joint
    from spacearm.model.arm import SpaceArm


def facts(arm: SpaceArm) -> dict[str, Any]:
    """Return the bodies, joints, limits, tip, task and wheels of an arm as plain JSON data."""
    return {
        "name": arm.name,
        "path": str(arm.path),
        "n": arm.n,
        "mass": arm.mass,
        "tip": arm.tips[0] if len(arm.tips) == 1 else list(arm.tips),
        "task": arm.task.to_dict(),
        "cm_at_zero": arm.at(np.zeros(arm.n)).com.tolist(),
        "bodies": [
            {
                "link": link,
                "mass": body.mass,
                "cm": body.lever.tolist(),
                "inertia": body.inertia.tolist(),
            }
            for link, body in bodies(arm).items()
        ],
        "joints": [_joint(joint) for joint in arm.tree.depth_first() if joint.movable],
        "wheels": [wheel.to_dict() for wheel in arm.wheels],
    }


def bodies(arm: SpaceArm) -> dict[str, pin.Inertia]:
    """Return the rigid bodies, the spacecraft first, by the names of their links that have mass."""
    joints = list(arm.model.names)[2:]
    leaders = [arm.tree.root, *(arm.tree.joints[name].child for name in joints)]
    lumps = arm.tree.lumps()
    names = [
        " + ".join(link for link in lumps[leader] if arm.tree.links[link]) for leader in leaders
    ]
    return dict(zip(names, list(arm.model.inertias)[1:], strict=True))


def _joint(joint: Joint) -> dict[str, Any]:
    """Return a joint as plain data; limits that it does not have are None."""
    limits = {name: getattr(joint, name) for name in ("lower", "upper", "velocity", "effort")}
    return {
        "name": joint.name,
        "type": joint.kind,
        "parent": joint.parent,
        "child": joint.child,
        **{name: float(x) if math.isfinite(x) else None for name, x in limits.items()},
        "mimic": joint.mimic._asdict() if joint.mimic else None,
    }
