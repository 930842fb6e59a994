"""Motions: what stands beside a motion that is played, as plain data for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.motion.motion import Motion
from spacearm.viewer.panel.labels import short_names

MOST_SAMPLES = 600
"""Largest number of samples of a curve; more than a screen shows."""


def account(motion: Motion) -> dict[str, Any]:
    """Return span, events and curves of a motion, and where it ends.

    Args:
        motion: The motion.
    """
    rows = np.linspace(0, len(motion) - 1, min(len(motion), MOST_SAMPLES)).round().astype(int)
    rows = np.unique(rows)
    return {
        "span": [float(motion.t[0]), float(motion.t[-1])],
        "story": f"{type(motion).__name__}, {motion.story}",
        "events": _events(motion),
        "t": motion.t[rows].tolist(),
        "curves": _curves(motion, rows),
    }


def _events(motion: Motion) -> list[dict[str, Any]]:
    """Return what happened on the way."""
    found = getattr(motion, "events", ())
    return [{"t": float(e.t), "kind": e.kind, "detail": e.detail} for e in found]


def _curves(motion: Motion, rows: Array) -> list[dict[str, Any]]:
    """Return groups of curves: name, unit and values, in degrees where they are angles."""
    arm, names = motion.arm, short_names(motion.arm.joint_names)
    turning, sliding = np.flatnonzero(~arm.slides), np.flatnonzero(arm.slides)
    q, groups = motion.q[rows], []
    if len(turning):
        groups.append(_group("joints", "°", [names[j] for j in turning], np.degrees(q[:, turning])))
    if len(sliding):
        groups.append(_group("sliding joints", "m", [names[j] for j in sliding], q[:, sliding]))
    rpy = [pin.rpy.matrixToRpy(pin.Quaternion(row).toRotationMatrix())
           for row in motion.base[rows, 3:]]  # fmt: skip
    turned = np.degrees(np.unwrap(rpy, axis=0))
    groups.append(_group("attitude", "°", ["roll", "pitch", "yaw"], turned))
    distance = np.degrees(motion.distance[rows])[:, None]
    groups.append(_group("distance", "°", ["to a singular posture"], distance))
    groups.append(_group("sigma_min", arm.sigma_unit, ["sigma_min"], motion.sigma_min[rows, None]))
    if len(arm.tips) == 1:
        tip, com = motion.tip[rows, :3], motion.com[rows]
        groups.append(_group("tip", "m", ["x", "y", "z"], tip))
        radius = np.linalg.norm(tip - com, axis=1)[:, None]
        groups.append(_group("R from the CM", "m", ["R"], radius))
    if (torque := getattr(motion, "torque", None)) is not None:
        groups.append(_group("torques", "N m" if not len(sliding) else "N m or N", names,
                             torque[rows]))  # fmt: skip
    if arm.wheels and (wheels := getattr(motion, "wheels", None)) is not None:
        groups.append(_group("wheels", "N m s", [wheel.name for wheel in arm.wheels], wheels[rows]))
    return groups


def _group(name: str, unit: str, labels: list[str], values: Array) -> dict[str, Any]:
    """Return curves that share an axis; values that are not finite, which JSON lacks, are None."""
    columns = [[float(x) if np.isfinite(x) else None for x in column] for column in values.T]
    return {"name": name, "unit": unit, "labels": labels, "values": columns}
