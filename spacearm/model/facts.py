"""Facts: the rigid bodies and joints of an arm, as plain data."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from spacearm.arrays import plain
from spacearm.description.bodies import Joint
from spacearm.description.tree import Tree
from spacearm.notebook.tables import joint_table, joint_value, shown, table

if TYPE_CHECKING:
    from spacearm.model.arm import SpaceArm


def facts(arm: SpaceArm) -> dict[str, Any]:
    """Return an arm as plain JSON data: bodies, joints, limits, tip, task, held joints, notes."""
    return {
        "name": arm.name,
        "path": str(arm.path),
        "n": arm.n,
        "mass": arm.mass,
        "tip_link": plain(arm.tips if len(arm.tips) > 1 else arm.tip),
        "tip_reason": arm.tip_reason,
        "task": plain(arm.task),
        "cm_at_zero": plain(arm.at(np.zeros(arm.n)).com),
        "bodies": [
            {
                "link": link,
                "mass": body.mass,
                "cm": body.lever.tolist(),
                "inertia": body.inertia.tolist(),
            }
            for link, body in bodies(arm.tree, arm.model).items()
        ],
        "joint_data": [_joint(joint) for joint in arm.tree.depth_first() if joint.movable],
        "held": dict(arm.held),
        "wheel_data": plain(arm.wheels),
        "notes": list(arm.notes),
    }


def facts_shown(arm: SpaceArm) -> str:
    """Return an arm as HTML tables: tips and task, joints with limits, bodies, what was assumed."""
    held = [(name, arm.whole.joints[name].kind == "prismatic", at) for name, at in arm.held.items()]
    rest = [("held", f"{name} at {joint_value(at, slides)}") for name, slides, at in held]
    rest += [("wheel", wheel.name) for wheel in arm.wheels]
    rest += [("note", note) for note in arm.notes]
    chosen = [("tip", f"{', '.join(arm.tips)} ({arm.tip_reason})"), ("task", arm.task.names)]
    return shown(
        f"{arm.name}: {arm.n} joints, {arm.mass:g} kg",
        table(("", ""), chosen + rest),
        joint_table(arm.joint_names, arm.slides, {"lower": arm.lower, "upper": arm.upper}),
        table(
            ("body", "mass [kg]", "CM in its frame [m]"),
            [(name, b.mass, b.lever) for name, b in bodies(arm.tree, arm.model).items()],
        ),
    )


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
