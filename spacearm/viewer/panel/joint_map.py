"""Joint map: the singular curves over two joints through a configuration, for the page."""

from __future__ import annotations

from typing import Any

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError
from spacearm.model.configuration import Configuration
from spacearm.model.mode import BaseMode
from spacearm.singularities.map import singular_map
from spacearm.singularities.sets import singular_set
from spacearm.viewer.panel.readouts import FAR

POINTS = 61
"""Grid points in each joint: what is computed and drawn well within 100 ms."""
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
    arm = cfg.arm
    names = None
    if joints is not None:
        names = _names(cfg, joints)
    if mode != "free-floating":
        return _held_map(cfg, names, mode)
    found = singular_map(arm, names, cfg.q, POINTS)
    curves = found.curves
    return {
        "joints": [arm.joint_names.index(name) for name in found.joints],
        "shares": _shares(found.distance),
        "curves": None if curves is None else [curve.round(4).tolist() for curve in curves],
        "q": cfg.q.tolist(),
    }


def _held_map(cfg: Configuration, names: tuple[str, str] | None, mode: BaseMode) -> dict[str, Any]:
    """Return the map of a spacecraft that is held."""
    from spacearm.mechanics.compiled import distances  # imports the compiler

    arm, found = cfg.arm, singular_set(cfg.arm, mode=mode)
    turning = [j for j in range(arm.n) if not arm.slides[j]]
    if names is None and len(turning) < 2:
        raise ConfigurationError(f"{arm.name} has no two revolute joints; a map needs them")
    pair = turning[-2:] if names is None else [arm.joint_names.index(name) for name in names]
    if pair[0] == pair[1] or any(arm.slides[j] for j in pair):
        raise ConfigurationError("a map is over two different revolute joints")
    angles = np.linspace(-np.pi, np.pi, POINTS)
    Q = np.tile(cfg.q[:, None], POINTS * POINTS)
    Q[pair] = angles.repeat(POINTS), np.tile(angles, POINTS)
    curves = None
    if found.complete and found.codimension == 1:
        curves = [c[:, pair].round(4).tolist() for c in found.curves((pair[0], pair[1]), cfg.q)]
    shares = _shares(distances(arm, Q, mode)["distance"].reshape(POINTS, POINTS))
    return {"joints": pair, "shares": shares, "curves": curves, "q": cfg.q.tolist()}


def _shares(distance: Array) -> list[list[int]]:
    """Return distances, first index the first joint, as `SHARES` by rows of the second one."""
    shares = np.clip(distance.T / FAR, 0.0, 1.0) * SHARES
    rows: list[list[int]] = np.nan_to_num(shares, nan=0.0).round().astype(int).tolist()
    return rows


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
