"""Wheels: bodies on joints that are not the arm's, and the momentum that they hold.

A balanced wheel that spins about its axis a, with moment of inertia I and rate W relative to the
link that carries it, leaves the mass distribution as it is and adds I W a to the angular momentum:
seen from outside it is a part of that link that holds momentum.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.description.bodies import Joint
from spacearm.description.tree import Tree
from spacearm.errors import ModelError

BALANCED = 1e-6
"""By what share of its size or moment of inertia a wheel may miss being balanced."""


class Wheel(NamedTuple):
    """A wheel, or another body that holds momentum about an axis.

    Attributes:
        name: Name of its joint.
        frame: Index of the frame of the link that carries it, in the model.
        axis: (3,) unit vector it spins about, in that frame.
    """

    name: str
    frame: int
    axis: Array


def wheels_of(tree: Tree, model: pin.Model, path: Path) -> tuple[Wheel, ...]:
    """The wheels of a tree, in the order of its joints.

    Raises:
        ModelError: One carries a joint, or is not balanced.
    """
    joints = [joint for joint in tree.depth_first() if joint.kind == "wheel"]
    for joint in joints:
        if fault := _fault(tree, joint):
            raise ModelError(f"{path}: wheel {joint.name!r} {fault}; leave it a joint")
    return tuple(
        Wheel(j.name, model.getFrameId(j.parent, pin.BODY), j.origin.rotation @ j.axis)
        for j in joints
    )


def _fault(tree: Tree, wheel: Joint) -> str | None:
    """Why the joint is no wheel, or None if it is one."""
    whole, waiting = pin.Inertia.Zero(), [(wheel.child, pin.SE3.Identity())]
    while waiting:
        link, pose = waiting.pop()
        if part := tree.links[link]:
            whole += pose.act(part.spatial())
        for joint in tree.joints.values():
            if joint.parent == link:
                if joint.kind != "fixed":
                    return f"carries joint {joint.name!r}"
                waiting.append((joint.child, pose * joint.origin))
    if whole.mass == 0.0:
        return None
    off_axis = np.linalg.norm(np.cross(wheel.axis, whole.lever))
    moment = float(np.trace(whole.inertia))
    if off_axis > BALANCED * np.sqrt(moment / whole.mass):
        return f"is not balanced: its CM is {off_axis:.3g} m off its axis"
    a, I = np.outer(wheel.axis, wheel.axis), whole.inertia
    spin = float(wheel.axis @ I @ wheel.axis)
    round_one = spin * a + (moment - spin) / 2.0 * (np.eye(3) - a)
    if np.abs(I - round_one).max() > BALANCED * moment:
        return "is not balanced: its inertia is not the same all round its axis"
    return None
