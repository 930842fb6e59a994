"""Loads in the scene: what wheels hold, and the wrenches from outside, as arrows."""

from __future__ import annotations

from typing import Any

import meshcat
import meshcat.geometry as g
import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.model.configuration import Configuration
from spacearm.motion.motion import Motion
from spacearm.viewer.layers.shapes import along

TEAL, RUST = 0x009E73, 0xB2182B
LONGEST = 0.5
"""Length of the arrow of the largest load, as a share of the size of the system."""


class LoadLayer:
    """Arrows of one configuration, or of a motion, in the layers "wheels" and "wrenches".

    A ring stands about each wheel's axis, its arrow is what the wheel holds. The wrenches are drawn
    as their sum: the force at the system CM, and the moment about it as an arrow with two heads.

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
        self._length = LONGEST * size
        self._data = pin.Data(cfg.arm.model)
        self._t = np.zeros(1) if motion is None else motion.t
        self._held: Any = getattr(motion, "wheels", None)
        impulse: Any = getattr(motion, "impulse", None)
        self._push = np.zeros((1, 6)) if impulse is None else _rates(self._t, impulse)
        for i in range(len(cfg.arm.wheels)):
            ring = self._wheels[str(i)]["ring"]
            material = g.MeshPhongMaterial(color=TEAL, opacity=0.5, transparent=True)
            ring.set_object(g.Cylinder(0.01 * size, 0.07 * size), material)
            _arrow(self._wheels[str(i)]["arrow"], TEAL, 1)
        for name, heads in (("force", 1), ("moment", 2)):
            _arrow(self._wrenches[name], RUST, heads)

    def draw(self, cfg: Configuration, t: float) -> None:
        """Draw the loads at a time, of a motion, or those of the configuration."""
        arm = cfg.arm
        pin.framesForwardKinematics(arm.model, self._data, cfg.full)
        values = cfg.wheels[None] if self._held is None else self._held
        most = float(np.abs(values).max(initial=0.0))
        for i, wheel in enumerate(arm.wheels):
            pose = self._data.oMf[wheel.frame]
            at = pose.act(arm.tree.joints[wheel.name].origin.translation)
            axis, held = pose.rotation @ wheel.axis, float(self._now(values, t)[i])
            self._wheels[str(i)]["ring"].set_transform(along(at - axis, at + axis))
            self._point(self._wheels[str(i)]["arrow"], at, axis * held, most)
        push = self._now(self._push, t)
        for name, rows in (("force", slice(3)), ("moment", slice(3, 6))):
            longest = float(np.linalg.norm(self._push[:, rows], axis=1).max())
            self._point(self._wrenches[name], cfg.com, push[rows], longest)

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


def _rates(t: Array, impulse: Array) -> Array:
    """Return the wrenches (m, 6) that brought an impulse, zero where that is rounding."""
    if len(t) < 2:
        return np.zeros((1, 6))
    rates = np.gradient(impulse, t, axis=0)
    rates[np.abs(rates) <= 1e-9 * np.abs(rates).max(initial=0.0)] = 0.0
    return rates if np.abs(impulse).max() > 0.0 else np.zeros((1, 6))


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
