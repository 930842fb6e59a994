"""Ghost: an arm drawn faintly, where a motion ends or where another one is."""

from __future__ import annotations

import meshcat
import meshcat.geometry as g
import numpy as np
import pinocchio as pin

from spacearm.model.arm import Configuration, SpaceArm
from spacearm.viewer.layers.shapes import along, shapes

GREY, STEEL, VIOLET = 0x7D8794, 0x3A7CA5, 0x6A3D9A


class Ghost:
    """An arm drawn in one faint colour, with the axes of its tip.

    Args:
        node: The node to draw under; what is there is replaced.
        arm: The arm.
        size: Radius of the system [m].
        color: The colour.
        opacity: From 0 to 1.
    """

    def __init__(
        self,
        node: meshcat.Visualizer,
        arm: SpaceArm,
        size: float,
        color: int = GREY,
        opacity: float = 0.2,
    ) -> None:
        self._node, self._arm, self._data = node, arm, pin.Data(arm.model)
        node.delete()
        faint = g.MeshPhongMaterial(
            color=color, opacity=opacity, transparent=True, depthWrite=False
        )
        self._drawn = []
        for i, shape in enumerate(shapes(arm)):
            body = node["bodies"][str(i)]
            body.set_object(shape.geometry, faint)
            self._drawn.append((body, arm.model.getFrameId(shape.link, pin.BODY), shape.pose))
        draw_axes(node["tip"], size, color)

    def place(self, cfg: Configuration) -> None:
        """Move it to a configuration."""
        pin.framesForwardKinematics(
            self._arm.model, self._data, cfg.full
        )  # without what it may hold
        for body, frame, pose in self._drawn:
            body.set_transform(self._data.oMf[frame].homogeneous @ pose)
        if len(cfg.arm.tips) == 1:
            self._node["tip"].set_transform(cfg.tip.homogeneous)


def draw_axes(node: meshcat.Visualizer, size: float, color: int) -> None:
    """Draw the axes of a frame, each 0.2 of a size [m] long, seen through everything."""
    solid = g.MeshBasicMaterial(color=color, transparent=True, depthTest=False, opacity=0.8)
    for axis in range(3):
        arrow = node[str(axis)]
        arrow.set_object(g.Cylinder(0.2 * size, 0.004 * size), solid)
        arrow.set_transform(along(np.zeros(3), 0.2 * size * np.eye(3)[axis]))
