"""Held: the bodies that an arm holds for a part of its motion, drawn by their inertia."""

from __future__ import annotations

import meshcat
import meshcat.geometry as g
import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.description.bodies import Inertial
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.motion import Motion

STEEL = 0x8A8F98
LEAST = 0.03
"""Least half axis, as a share of the size of the system: a point mass is seen too."""


class HeldLayer:
    """Ellipsoids of uniform density with the mass and inertia of what is held, in "bodies".

    Args:
        root: The node that holds the layers.
        arm: The arm without them.
        motion: The motion; its configurations may be of arms that hold bodies.
        size: Radius of the system [m].
    """

    def __init__(
        self, root: meshcat.Visualizer, arm: SpaceArm, motion: Motion | None, size: float
    ) -> None:
        self._bodies: list[tuple[SpaceArm, int, Array, meshcat.Visualizer]] = []
        flight = getattr(motion, "flight", None)
        material = g.MeshPhongMaterial(color=STEEL, opacity=0.6, transparent=True)
        holders = dict.fromkeys(run.arm for run in flight.phases) if flight else ()
        for i, holder in enumerate(holders):
            for link, inertial in holder.tree.links.items():
                if link not in arm.tree.links and inertial is not None:
                    node = root["bodies"][f"held {i}"][link]
                    node.set_object(g.Sphere(1.0), material)
                    frame = holder.model.getFrameId(link, pin.BODY)
                    self._bodies.append((holder, frame, ellipsoid(inertial, LEAST * size), node))

    def draw(self, cfg: Configuration) -> None:
        """Draw what the arm of a configuration holds, hide the rest."""
        data = pin.Data(cfg.arm.model) if self._bodies else None
        if data:
            pin.framesForwardKinematics(cfg.arm.model, data, cfg.full)
        for arm, frame, shape, node in self._bodies:
            node.set_property("visible", arm is cfg.arm)
            if data and arm is cfg.arm:
                node.set_transform(data.oMf[frame].homogeneous @ shape)

    def delete(self) -> None:
        """Draw nothing any more."""
        for *_, node in self._bodies:
            node.delete()


def ellipsoid(body: Inertial, least: float) -> Array:
    """Return what makes a unit ball the ellipsoid (4, 4) of a body, in the frame of its link.

    A uniform ellipsoid of half axes a, b, c has the moments m (b^2 + c^2) / 5 and so on.
    """
    moments, axes = np.linalg.eigh(body.inertia)
    squares = 2.5 / body.mass * (moments.sum() - 2.0 * moments)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    shape = np.eye(4)
    shape[:3, :3] = axes * np.sqrt(np.maximum(squares, least**2))
    pose: Array = body.origin.homogeneous @ shape
    return pose
