"""Loads in the scene: bodies that are held, what wheels hold, and the wrenches from outside."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import meshcat
import meshcat.geometry as g
import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.model.arm import Configuration
from spacearm.motion.motion import Motion
from spacearm.viewer.layers.held import HeldLayer
from spacearm.viewer.layers.shapes import along

TEAL, OLIVE = 0x009E73, 0x8A8A00
PARTS = (("force", 1, slice(3)), ("torque", 2, slice(3, 6)))
"""Parts of a wrench: name, heads of the arrow, and the components."""
LONGEST = 0.5
"""Length of the arrow of the largest load, as a share of the size of the system."""


class LoadLayer:
    """Loads of one configuration, or of a motion, in the layers "wheels", "wrenches" and "bodies".

    A ring stands about each wheel's axis, its arrow is what the wheel holds. Wrenches are drawn on
    the links that they push: the force as an arrow, the torque as one with two heads.

    Args:
        root: The node that holds the layers.
        cfg: The configuration at the start.
        motion: The motion; None for a configuration alone.
        size: Radius of the system [m].
    """

    def __init__(
        self,
        root: meshcat.Visualizer,
        cfg: Configuration,
        motion: Motion | None,
        size: float,
    ) -> None:
        self._wheels, self._wrenches = root["wheels"], root["wrenches"]
        self._held_bodies = HeldLayer(root, cfg.arm, motion, size)
        self._length = LONGEST * size
        self._arm, self._data = cfg.arm, pin.Data(cfg.arm.model)
        self._t = np.zeros(1) if motion is None else motion.t
        self._held: Any = getattr(motion, "wheels", None)
        self._push: Mapping[str, Array] = getattr(motion, "wrenches", {})
        for i in range(len(cfg.arm.wheels)):
            ring = self._wheels[str(i)]["ring"]
            material = g.MeshPhongMaterial(color=TEAL, opacity=0.5, transparent=True)
            ring.set_object(g.Cylinder(0.01 * size, 0.07 * size), material)
            _arrow(self._wheels[str(i)]["arrow"], TEAL, 1)
        for i in range(len(self._push)):
            for name, heads, _ in PARTS:
                _arrow(self._wrenches[str(i)][name], OLIVE, heads)

    def draw(self, cfg: Configuration, t: float) -> None:
        """Draw the loads at a time, of a motion, or those of the configuration."""
        self._held_bodies.draw(cfg)
        arm = self._arm  # without what it may hold for a while
        pin.framesForwardKinematics(arm.model, self._data, cfg.full)
        values = cfg.wheels[None] if self._held is None else self._held
        most = float(np.abs(values).max(initial=0.0))
        for i, wheel in enumerate(arm.wheels):
            pose = self._data.oMf[wheel.frame]
            at = pose.act(arm.tree.joints[wheel.name].origin.translation)
            axis, held = pose.rotation @ wheel.axis, float(self._now(values, t)[i])
            self._wheels[str(i)]["ring"].set_transform(along(at - axis, at + axis))
            self._point(self._wheels[str(i)]["arrow"], at, axis * held, most)
        for name, _, rows in PARTS:
            largest = (np.linalg.norm(x[:, rows], axis=1).max() for x in self._push.values())
            longest = max(map(float, largest), default=0.0)
            for i, (link, push) in enumerate(self._push.items()):
                at = self._data.oMf[arm.model.getFrameId(link, pin.BODY)].translation
                self._point(self._wrenches[str(i)][name], at, self._now(push, t)[rows], longest)

    def delete_held(self) -> None:
        """Draw no bodies that are held any more."""
        self._held_bodies.delete()

    def _now(self, values: Array, t: float) -> Array:
        """Return the values (m, k) at a time."""
        if len(values) == 1:
            return values[0]
        return np.array([np.interp(t, self._t, column) for column in values.T])

    def _point(self, node: meshcat.Visualizer, at: Array, load: Array, most: float) -> None:
        """Point an arrow from a place along a load; hide it where there is none."""
        seen = most > 0.0 and float(np.linalg.norm(load)) > 1e-3 * most
        node.set_property("visible", seen)
        if seen:
            way = self._length / most * load
            length = float(np.linalg.norm(way))
            node.set_transform(along(at, at + way) @ np.diag([length, length, length, 1.0]))


def _arrow(node: meshcat.Visualizer, color: int, heads: int) -> None:
    """Draw an arrow of length 1 along y about its middle."""
    material = g.MeshLambertMaterial(
        color=color, opacity=1.0, transparent=True, depthTest=False, depthWrite=False
    )
    node["shaft"].set_object(g.Cylinder(0.85, 0.02), material)
    shaft = np.eye(4)
    shaft[1, 3] = -0.075
    node["shaft"].set_transform(shaft)
    for i in range(heads):
        head, pose = node[f"head_{i}"], np.eye(4)
        head.set_object(g.Cylinder(0.18, radiusTop=0.0, radiusBottom=0.06), material)
        pose[1, 3] = 0.41 - 0.15 * i
        head.set_transform(pose)
