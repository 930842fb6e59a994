"""Readouts: a configuration, a map and a motion as plain data for JSON."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.collisions.separation import Collisions, collision_geometry
from spacearm.description.model_catalogue import catalogue
from spacearm.description.shapes import Mesh
from spacearm.errors import ConfigurationError, SpaceArmError, UnsupportedError, listed
from spacearm.mechanics.distance import distances
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.wheels import wheel_table
from spacearm.results import short_names
from spacearm.singularities.joint_boxes import FreeBox
from spacearm.singularities.map import telling_joints
from spacearm.singularities.report import IN_WORDS, TOLERANCE, SingularityReport
from spacearm.singularities.sets import singular_set

#: Distance to the singular set below which a posture counts as near it [rad].
NEAR = math.radians(5.0)
#: Distance to the singular set from which on colours do not change [rad].
FAR = math.radians(30.0)
#: Direction to view a spatial arm from.
VIEW = (0.55, -0.75, 0.5)
#: Directions to view planar arms from: near the normal of their plane, x, y or z.
PLANE_VIEWS = ((1.0, -0.2, 0.3), (0.2, -1.0, 0.3), (0.0, -0.35, 1.0))
#: Joint motions below this are not named [rad] or [m].
STILL = math.radians(0.05)


def about(arm: SpaceArm, held: bool = False) -> dict[str, Any]:
    """Return what the panel shows of an arm once, whose tips hold one thing or not."""
    normal, collisions = arm.tree.plane_normal(), _collisions(arm)
    wheels = wheel_table(arm.model, arm.wheels)
    return {
        "model": arm.name,
        "tip": ", ".join(arm.tips),
        "tip_reason": arm.tip_reason,
        "task": list(arm.task.rows) if held or len(arm.tips) == 1 else [],  # what is grabbed
        "unit": arm.sigma_unit,
        "meaning": IN_WORDS,
        "missing": listed(_missing_meshes(arm)),
        "contacts": collisions if isinstance(collisions, str) else collisions.account,
        "held": dict(arm.held),
        "wheels": {"head": wheels.head("rad"), "rows": wheels.body("rad")},
        "near": NEAR,
        "tolerance": TOLERANCE,
        "view": VIEW if normal is None else PLANE_VIEWS[normal],
        "normal": None if normal is None else np.eye(3)[normal].tolist(),
    }


def joints(arm: SpaceArm, lower: Array, upper: Array) -> list[dict[str, Any]]:
    """Return name, label, kind and range of the joints.

    Args:
        arm: The arm.
        lower: (n,) lower ends of the ranges [rad] or [m].
        upper: (n,) upper ends.
    """
    rows = zip(arm.joint_names, short_names(arm.joint_names), arm.slides, strict=True)
    return [
        {"name": name, "label": label, "angle": not slides, "lower": float(lo), "upper": float(hi)}
        for (name, label, slides), lo, hi in zip(rows, lower, upper, strict=True)
    ]


def ranges(box: FreeBox, q: Array, lower: Array, upper: Array) -> dict[str, Any]:
    """Return joint ranges in which no posture is singular, as far as the sliders go.

    Args:
        box: The ranges.
        q: (n,) joint positions on show.
        lower: (n,) lower ends of the sliders [rad] or [m].
        upper: (n,) upper ends.
    """
    ends = zip(np.maximum(box.lower, lower), np.minimum(box.upper, upper), strict=True)
    return {"ranges": [[float(a), float(b)] for a, b in ends], "holds": box.contains(q)}


def readout(report: SingularityReport, held: pin.SE3 | None = None) -> dict[str, Any]:
    """Return what the panel shows of the configuration of a report.

    Args:
        report: The report.
        held: Where that is which several tips hold, and whose report it is; None for that of tips.
    """
    cfg, joints = report.configuration, report.configuration.arm.joint_names
    led, tip = held is not None or len(cfg.tips) == 1, held or cfg.tips[0]
    directions = np.hstack((report.available, report.lost)).T if led else np.empty(0)
    names = dict(zip(joints, short_names(joints), strict=True))
    return {
        "q": cfg.q.tolist(),
        "attitude": pin.rpy.matrixToRpy(cfg.base.rotation).tolist(),
        "base": pin.SE3ToXYZQUAT(cfg.base).tolist(),
        "distance": report.distance if math.isfinite(report.distance) else None,
        "near": report.kind == "regular" and report.distance < NEAR,
        "away": _shortened(report.way_out, names),
        "sigma": report.sigma.tolist(),
        "sigma_min": report.sigma_min,
        "error": report.error,
        "condition": report.condition if math.isfinite(report.condition) else None,
        "kind": report.kind,
        "impossible": report.impossible,
        "rank": report.rank,
        "directions": directions.tolist(),
        "gradient": report.gradient.tolist(),
        "outside": [names[name] for name in cfg.outside_limits],
        "radius": float(np.linalg.norm(tip.translation - cfg.com)),
        "tip": tip.translation.tolist(),
        "tip_rpy": pose(tip)["rpy"],
        "axes": report.axes.T.tolist(),
        "contacts": _contacts(cfg),
    }


def pose(placement: pin.SE3) -> dict[str, list[float]]:
    """Return position [m] and roll, pitch and yaw [rad] of a pose."""
    rpy = pin.rpy.matrixToRpy(placement.rotation)
    return {"position": placement.translation.tolist(), "rpy": rpy.tolist()}


def as_python(cfg: Configuration, source: str, locked: Mapping[str, float], made: str) -> str:
    """Write a configuration as Python code.

    Args:
        cfg: The configuration.
        source: What `load` is given for the arm.
        locked: Joints that are locked besides, with their values [rad] or [m].
        made: How the file of the arm comes about, where there is none.
    """
    arm = cfg.arm
    pose = ", ".join(repr(float(x)) for x in pin.SE3ToXYZQUAT(cfg.base))
    known = {info.name for info in catalogue()}
    written = "" if source in known or Path(source).is_file() else f"  # {made}"
    tip = arm.tips[0] if len(arm.tips) == 1 else list(arm.tips)
    more = f", joints={arm.joints!r}" if arm.joints != "tip" else ""
    more += f", locked={dict(locked)!r}" if locked else ""
    limits = {wheel.name: (wheel.torque, wheel.capacity) for wheel in arm.wheels}
    known_limits = np.isfinite([*limits.values()]).all()
    more += f", wheels={limits if known_limits else list(limits)!r}" if limits else ""
    moving = "".join(
        f", {name}={values.tolist()!r}"
        for name, values in (("momentum", cfg.momentum), ("wheels", cfg.wheels))
        if values.any()
    )
    return (
        "import numpy as np\nimport pinocchio as pin\nimport spacearm as sa\n\n"
        f"arm = sa.load({source!r}, tip={tip!r}, task={arm.task.names!r}{more})"
        f"{written}\n"
        f"base = pin.XYZQUATToSE3(np.array([{pose}]))\n"
        f"cfg = arm.at({cfg.q.tolist()!r}, base=base{moving})\n"
    )


def joint_value(value: float, slides: bool) -> str:
    """Write a joint position for people: in degrees, or metres if it slides."""
    return f"{value:.4g} m" if slides else f"{np.degrees(value):.5g}°"


def turns(arm: SpaceArm, way: Array) -> str:
    """Write a joint motion (n,) for people, the largest parts first; small ones are left out."""
    order = [int(j) for j in np.argsort(-np.abs(way)) if abs(way[j]) > STILL]
    names = short_names(arm.joint_names)
    parts = (
        f"{names[j]} {way[j]:+.3g} m" if arm.slides[j] else f"{names[j]} {np.degrees(way[j]):+.1f}°"
        for j in order
    )
    return ", ".join(parts) or "hardly a motion"


def _shortened(way: str, names: Mapping[str, str]) -> str:
    """Return a joint motion in words, its parts separated by commas, with shorter names."""
    for name, short in names.items():
        label = short.replace("\\", r"\\")
        way = re.sub(rf"(?:(?<=^)|(?<=, )){re.escape(name)}(?= )", label, way)
    return way


def _missing_meshes(arm: SpaceArm) -> list[str]:
    """Return the names of the mesh files that the visuals of an arm name and that are not there."""
    parts = (part for drawn in arm.tree.visuals.values() for part in drawn.visual)
    meshes = (part.geometry for part in parts if isinstance(part.geometry, Mesh))
    return sorted({mesh.name for mesh in meshes if mesh.file is None})


@lru_cache(maxsize=16)
def _collisions(arm: SpaceArm) -> Collisions | str:
    """Return the collision check of an arm, or why there is none."""
    try:
        return collision_geometry(arm)
    except SpaceArmError as error:
        return f"collisions not checked: {error}"


def _contacts(cfg: Configuration) -> list[list[str]]:
    """Return the names of the bodies that meet each other."""
    found = _collisions(cfg.arm)
    return [] if isinstance(found, str) else [list(pair) for pair in found.touching(cfg.q)]


#: Grid points in each joint: what is computed and drawn well within 100 ms.
POINTS = 61
#: What can be told apart on the page [rad].
RESOLUTION = np.radians(2.0)
#: Number that stands for `FAR`.
SHARES = 100


def joint_map(
    cfg: Configuration, joints: object, mode: BaseMode = "free-floating"
) -> dict[str, Any]:
    """Return distances to the singular set and the singular curves over two joints.

    Args:
        cfg: The configuration; its other joints are held.
        joints: The numbers of the two joints; if None as `singular_map` chooses them, of several
            tips the first two.
        mode: What the spacecraft does.

    Returns:
        Plain data: `joints`; `shares`, whole numbers up to `SHARES` by rows of the second joint,
        from -pi to pi; `curves`, lists of points, None where they are not known exactly; `q`;
        `spacecraft`, the mode.

    Raises:
        ConfigurationError: The joints are not two revolute ones.
    """
    arm, found = cfg.arm, None
    with suppress(*[UnsupportedError] * (len(arm.tips) > 1)):  # minors too large to be traced
        found = singular_set(arm, mode=mode)
    if joints is None and len(arm.tips) > 1:
        joints = np.flatnonzero(~arm.slides)[:2].tolist()
    pair = telling_joints(arm) if joints is None else _pair(arm, joints)
    angles = np.linspace(-np.pi, np.pi, POINTS)
    Q = np.tile(cfg.q, (POINTS * POINTS, 1))
    Q[:, pair] = np.stack([angles.repeat(POINTS), np.tile(angles, POINTS)], axis=1)
    near = np.clip(distances(arm, Q, mode)[0].reshape(POINTS, POINTS).T / FAR, 0.0, 1.0)
    shares = np.nan_to_num(near * SHARES, nan=0.0).round().astype(int).tolist()
    curves = None
    if found is not None and found.complete and found.codimension == 1:
        traced = found.curves(pair, cfg.q, resolution=RESOLUTION)
        curves = [curve[:, pair].round(4).tolist() for curve in traced]
    about = {"joints": pair, "q": cfg.q.tolist(), "spacecraft": mode}
    return {**about, "shares": shares, "curves": curves}


def _pair(arm: SpaceArm, joints: object) -> list[int]:
    """Return the numbers of two different revolute joints, as the page gave them."""
    if not isinstance(joints, list) or len(joints) != 2:
        raise ConfigurationError(f"joints is {str(joints)[:40]!r}; give two numbers of joints")
    for joint in joints:
        joint_number(joint, arm)
    if joints[0] == joints[1] or arm.slides[joints].any():
        raise ConfigurationError("a map is over two different revolute joints")
    return joints


def joint_number(value: object, arm: SpaceArm) -> int:
    """Return the number of a joint out of a message.

    Raises:
        ConfigurationError: There is no such joint.
    """
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < arm.n:
        raise ConfigurationError(f"joint index is {str(value)[:40]}; give 0 to {arm.n - 1}")
    return value
