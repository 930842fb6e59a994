"""Facts: the rigid bodies and joints of an arm, as plain data."""

from __future__ import annotations

import math
from typing import Any

import pinocchio as pin

from spacearm.description.bodies import Joint
from spacearm.description.tree import Tree


def facts(tree: Tree, model: pin.Model) -> dict[str, Any]:
    """Return the bodies and the movable joints of an arm as plain JSON data."""
    return {
        "bodies": [
            {
                "link": link,
                "mass": body.mass,
                "cm": body.lever.tolist(),
                "inertia": body.inertia.tolist(),
            }
            for link, body in bodies(tree, model).items()
        ],
        "joints": [_joint(joint) for joint in tree.depth_first() if joint.movable],
    }


def bodies(tree: Tree, model: pin.Model) -> dict[str, pin.Inertia]:
    """Return the rigid bodies, the spacecraft first, by the names of their links that have mass."""
    joints = list(model.names)[2:]
    leaders = [tree.root, *(tree.joints[name].child for name in joints)]
    lumps = tree.lumps()
    names = [" + ".join(link for link in lumps[leader] if tree.links[link]) for leader in leaders]
    return dict(zip(names, list(model.inertias)[1:], strict=True))


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
