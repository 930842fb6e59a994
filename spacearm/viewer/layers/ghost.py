"""Ghost: where a motion ends, drawn faintly."""

from __future__ import annotations

import meshcat
import meshcat.geometry as g
import numpy as np
import pinocchio as pin

from spacearm.model.configuration import Configuration
from spacearm.viewer.shapes import along, shapes

GREY = 0x7D8794


def draw_ghost(node: meshcat.Visualizer, cfg: Configuration, size: float) -> None:
    """Draw a configuration as a ghost, with the axes of its tip.

    Args:
        node: The node to draw under; what is there is replaced.
        cfg: The configuration.
        size: Radius of the system [m].
    """
    node.delete()
    model, data = cfg.arm.model, pin.Data(cfg.arm.model)
    pin.framesForwardKinematics(model, data, cfg.full)
    faint = g.MeshPhongMaterial(color=GREY, opacity=0.2, transparent=True, depthWrite=False)
    for i, shape in enumerate(shapes(cfg.arm)):
        frame = data.oMf[model.getFrameId(shape.link, pin.BODY)].homogeneous
        node["bodies"][str(i)].set_object(shape.geometry, faint)
        node["bodies"][str(i)].set_transform(frame @ shape.pose)
    for axis in range(3):
        reach = 0.2 * size * np.eye(3)[axis]
        solid = g.MeshBasicMaterial(color=GREY, transparent=True, depthTest=False, opacity=0.8)
        arrow = node["tip"][str(axis)]
        arrow.set_object(g.Cylinder(0.2 * size, 0.004 * size), solid)
        arrow.set_transform(cfg.tip.homogeneous @ along(np.zeros(3), reach))
