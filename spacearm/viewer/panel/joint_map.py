"""Joint map: the singular curves over two joints through a configuration, for the page."""

from __future__ import annotations

from typing import Any

import numpy as np

from spacearm.errors import ConfigurationError
from spacearm.model.configuration import Configuration
from spacearm.singularities.map import singular_map
from spacearm.viewer.panel.readouts import FAR

POINTS = 61
"""Grid points in each joint: what is computed and drawn well within 100 ms."""
SHARES = 100
"""Number that stands for `FAR`."""


def joint_map(cfg: Configuration, joints: object) -> dict[str, Any]:
    """Return distances to the singular set and the singular curves over two joints.

    Args:
        cfg: The configuration; its other joints are held.
        joints: The numbers of the two joints; if None as `singular_map` chooses them.

    Returns:
        Plain data: `joints`; `shares`, whole numbers up to `SHARES` by rows of the second joint,
        from -pi to pi; `curves`, lists of points, None where they are not known exactly; `q`.

    Raises:
        ConfigurationError: The joints are no two revolute ones.
    """
    arm = cfg.arm
    names = None
    if joints is not None:
        names = _names(cfg, joints)
    found = singular_map(arm, names, cfg.q, POINTS)
    shares = np.clip(found.distance.T / FAR, 0.0, 1.0) * SHARES
    curves = found.curves
    return {
        "joints": [arm.joint_names.index(name) for name in found.joints],
        "shares": np.nan_to_num(shares, nan=0.0).round().astype(int).tolist(),
        "curves": None if curves is None else [curve.round(4).tolist() for curve in curves],
        "q": cfg.q.tolist(),
    }


def _names(cfg: Configuration, joints: object) -> tuple[str, str]:
    """Return the names of two joints by number."""
    n = cfg.arm.n
    if not isinstance(joints, list) or len(joints) != 2:
        raise ConfigurationError(f"joints is {str(joints)[:40]!r}; give two numbers of joints")
    for joint in joints:
        if not isinstance(joint, int) or isinstance(joint, bool) or not 0 <= joint < n:
            raise ConfigurationError(f"joint index is {str(joint)[:40]!r}; give 0 to {n - 1}")
    first, second = joints
    return cfg.arm.joint_names[first], cfg.arm.joint_names[second]
