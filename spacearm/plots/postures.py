"""Plots of postures of planar arms: figures 1 to 3 of Papadopoulos & Dubowsky (1993)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from matplotlib.patches import Polygon

from spacearm.arrays import Array
from spacearm.errors import UnsupportedError
from spacearm.model.arm import Configuration
from spacearm.plots.style import BLUE, GREY, RED
from spacearm.singularities.report import singularity

GOLD = "#d9b25f"
SECONDS = 0.75
"""Time [s] over which velocities are drawn as displacements."""


def draw_posture(axes: Any, cfg: Configuration, *, color: str = GREY, label: bool = True) -> None:
    """Draw a spacecraft, its arm and the system CM.

    Args:
        axes: Matplotlib axes.
        cfg: A configuration of a planar arm. Its spacecraft is drawn as a square about its CM with
            the first joint on its edge.
        color: Colour of the arm.
        label: Whether to name the system CM.

    Raises:
        UnsupportedError: The arm does not move in a plane.
    """
    points = _joints(cfg)
    centre = _flat(cfg, cfg.base.act(cfg.arm.model.inertias[1].lever))
    reach = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    half = max(float(np.abs(cfg.arm.mount.translation).max()), 0.1 * float(reach))
    x = _flat(cfg, cfg.base.rotation[:, _rows(cfg)[0]])
    side = half * np.array([x, (-x[1], x[0])])
    corners = centre + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ side
    axes.add_patch(Polygon(corners, facecolor=GOLD, edgecolor=GREY, alpha=0.9))
    axes.plot(*points.T, "-o", color=color, lw=5, ms=9, mfc="white", mec=color)
    com = _flat(cfg, cfg.com)
    axes.plot(*com, marker="P", ms=9, color="black", ls="none", zorder=3)
    if label:
        axes.annotate("CM", com, (-6, -18), textcoords="offset points", ha="right")
    names = ["xyz"[i] for i in _rows(cfg)]
    axes.set(aspect="equal", xlabel=f"{names[0]} [m]", ylabel=f"{names[1]} [m]")


def draw_velocities(axes: Any, cfg: Configuration) -> None:
    """Draw the velocities that unit joint rates give to the tip, and the lost direction.

    Args:
        axes: Matplotlib axes.
        cfg: A configuration of a planar arm whose task is the position of its tip.

    Raises:
        UnsupportedError: The arm does not move in a plane, or its task is another one.
    """
    rows = _rows(cfg)
    if tuple(cfg.arm.task.indices) != rows:
        raise UnsupportedError(
            f"{cfg.arm.name}: tip velocities are drawn for the task "
            f"'{' '.join('xyz'[i] for i in rows)}', not {cfg.arm.task.names!r}; use sa.view"
        )
    report, tip = singularity(cfg), _flat(cfg, cfg.tip.translation)
    sides, sigma, _ = np.linalg.svd(report.jacobian)
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    circle = np.array([np.cos(turn), np.sin(turn)])
    axes.plot(*(tip[:, None] + SECONDS * (sides * sigma) @ circle), color=BLUE, lw=2)
    for lost in report.lost.T:
        for sign in (1.0, -1.0):
            arrow = {"arrowstyle": "-|>", "color": RED, "lw": 2.5}
            axes.annotate("", tip + sign * 0.8 * lost, tip, arrowprops=arrow)
        away = np.sign(lost @ (tip - _flat(cfg, cfg.com))) * lost
        side = "bottom" if away[1] > 0.0 else "top"
        axes.text(*(tip + 0.85 * away), "no motion\nthis way", color=RED, va=side, ha="center")


def _rows(cfg: Configuration) -> tuple[int, int]:
    """Return which of x, y, z span the plane."""
    normal = cfg.arm.tree.plane_normal()
    if normal is None:
        raise UnsupportedError(f"{cfg.arm.name} does not move in a plane; use sa.view")
    first, second = (i for i in range(3) if i != normal)
    return first, second


def _flat(cfg: Configuration, vector: Array) -> Array:
    """Return the (2,) components of a vector in the plane."""
    return vector[list(_rows(cfg))]


def _joints(cfg: Configuration) -> Array:
    """Return (n + 1, 2) positions of the joints on the way to the tip, and of the tip [m]."""
    arm, data = cfg.arm, pin.Data(cfg.arm.model)
    pin.forwardKinematics(arm.model, data, cfg.full)
    chain = [joint.name for joint in arm.tree.chain(arm.tip) if joint.movable]
    places = [data.oMi[arm.model.getJointId(name)].translation for name in chain]
    return np.array([_flat(cfg, place) for place in (*places, cfg.tip.translation)])
