"""Wheels: bodies that spin on joints that are not the arm's, and hold momentum.

A balanced wheel with moment of inertia I, spinning about its axis a at the rate W relative to the
link that carries it, leaves the mass distribution unchanged and adds I W a to the angular momentum.
It is therefore treated as a part of that link that holds momentum.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.description.bodies import Joint
from spacearm.description.tree import Tree
from spacearm.errors import ModelError

BALANCED = 1e-6
"""Share of its size or moment of inertia by which a wheel may be out of balance."""


class Wheel(NamedTuple):
    """A wheel, or another body that holds angular momentum about an axis.

    Attributes:
        name: Name of its joint.
        frame: Index of the frame of the link that carries it, in the model.
        axis: (3,) unit vector of its axis, in that frame.
    """

    name: str
    frame: int
    axis: Array

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain data."""
        return {"name": self.name, "frame": self.frame, "axis": self.axis.tolist()}


def wheels_of(tree: Tree, model: pin.Model, path: Path) -> tuple[Wheel, ...]:
    """Return the wheels of a tree, in the order of its joints.

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


def rotor(tree: Tree, wheel: Joint) -> float:
    """Return the moment of inertia of a wheel about its axis [kg m^2]."""
    whole, _ = _spinning(tree, wheel)
    return float(wheel.axis @ whole.inertia @ wheel.axis)


def _spinning(tree: Tree, wheel: Joint) -> tuple[pin.Inertia, list[Joint]]:
    """Return the inertia of what a wheel spins, in its frame, and the joints on it that move."""
    behind, carried = [wheel.child], []
    for joint in tree.depth_first():
        if joint.parent in behind:
            behind.append(joint.child)
            carried += [] if joint.kind == "fixed" else [joint]
    hub, whole = tree.frames[wheel.child], pin.Inertia.Zero()
    for link in behind:
        if part := tree.links[link]:
            whole += hub.actInv(tree.frames[link]).act(part.spatial())
    return whole, carried


def _fault(tree: Tree, wheel: Joint) -> str | None:
    """Say why a joint is no wheel; None if it is one."""
    whole, carried = _spinning(tree, wheel)
    if carried:
        return f"carries joint {carried[0].name!r}"
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
