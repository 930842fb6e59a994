"""Joint map: the singular curves over two joints through a configuration, for the page."""

from __future__ import annotations

from typing import Any

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError
from spacearm.mechanics.distance import distances
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.singularities.map import telling_joints
from spacearm.singularities.sets import singular_set
from spacearm.viewer.panel.readouts import FAR

POINTS = 61
"""Grid points in each joint: what is computed and drawn well within 100 ms."""
RESOLUTION = np.radians(2.0)
"""What can be told apart on the page [rad]."""
SHARES = 100
"""Number that stands for `FAR`."""


def joint_map(
    cfg: Configuration, joints: object, mode: BaseMode = "free-floating"
) -> dict[str, Any]:
    """Return distances to the singular set and the singular curves over two joints.

    Args:
        cfg: The configuration; its other joints are held.
        joints: The numbers of the two joints; if None as `singular_map` chooses them.
        mode: What the spacecraft does.

    Returns:
        Plain data: `joints`; `shares`, whole numbers up to `SHARES` by rows of the second joint,
        from -pi to pi; `curves`, lists of points, None where they are not known exactly; `q`.

    Raises:
        ConfigurationError: The joints are no two revolute ones.
    """
    arm, found = cfg.arm, singular_set(cfg.arm, mode=mode)
    pair = telling_joints(arm) if joints is None else _pair(arm, joints)
    angles = np.linspace(-np.pi, np.pi, POINTS)
    Q = np.tile(cfg.q, (POINTS * POINTS, 1))
    Q[:, pair] = np.stack([angles.repeat(POINTS), np.tile(angles, POINTS)], axis=1)
    shares = _shares(distances(arm, Q, mode)[0].reshape(POINTS, POINTS))
    curves = None
    if found.complete and found.codimension == 1:
        traced = found.curves(pair, cfg.q, resolution=RESOLUTION)
        curves = [curve[:, pair].round(4).tolist() for curve in traced]
    return {"joints": pair, "shares": shares, "curves": curves, "q": cfg.q.tolist()}


def _shares(distance: Array) -> list[list[int]]:
    """Return distances, first index the first joint, as `SHARES` by rows of the second one."""
    shares = np.clip(distance.T / FAR, 0.0, 1.0) * SHARES
    rows: list[list[int]] = np.nan_to_num(shares, nan=0.0).round().astype(int).tolist()
    return rows


def _pair(arm: SpaceArm, joints: object) -> list[int]:
    """Return the numbers of two different revolute joints, as the page gave them."""
    if not isinstance(joints, list) or len(joints) != 2:
        raise ConfigurationError(f"joints is {str(joints)[:40]!r}; give two numbers of joints")
    for joint in joints:
        if not isinstance(joint, int) or isinstance(joint, bool) or not 0 <= joint < arm.n:
            raise ConfigurationError(f"joint index is {str(joint)[:40]!r}; give 0 to {arm.n - 1}")
    if joints[0] == joints[1] or arm.slides[joints].any():
        raise ConfigurationError("a map is over two different revolute joints")
    return joints
