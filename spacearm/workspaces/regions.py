"""Regions of a workspace: whether a point is unreachable, path independent or path dependent."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, finite, named, shape_of
from spacearm.errors import ConfigurationError
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.polynomial.newton import meeting
from spacearm.singularities.exact_set import ExactSet
from spacearm.singularities.polynomial import radius_squared, tips_from_centre
from spacearm.workspaces.box import Box
from spacearm.workspaces.searched_shells import members
from spacearm.workspaces.shells import Shell

UPRIGHT = 1.0 - 1e-9
"""Cosine between the normal of a planar arm and the inertial axis from which it stands in plane."""
SAMPLE = 20_000
"""Singular configurations sampled in the search for one at a given distance."""
BEST = 20
"""Number of them, nearest to that distance, from which Newton's method starts."""


class Region(NamedTuple):
    """Kind of a point of the workspace, with singular configurations that reach it.

    Attributes:
        kind: "unreachable"; "path independent": no path to it meets a singularity there; or
            "path dependent": after some paths the arm is singular when the tip is there.
        radius: Distance of the point from the system CM [m].
        singular: Singular configurations with the tip at the point and the system CM at the
            origin, one for each shell that contains the point; empty unless path dependent.
        point: (3,) the point from the system CM, inertial axes [m].
    """

    kind: Literal["unreachable", "path independent", "path dependent"]
    radius: float
    singular: tuple[Configuration, ...]
    point: Array

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data."""
        return named(self)


def position(
    arm: SpaceArm, point: npt.ArrayLike, mode: BaseMode, start: Configuration | None = None
) -> Array:
    """Check a point and return it as (3,) from the system CM, inertial axes.

    Args:
        arm: The arm.
        point: (3,) the point [m], or (2,) in the plane of a planar arm.
        mode: What the spacecraft does.
        start: A configuration in whose inertial frame it is given; from the system CM if None.

    Raises:
        ConfigurationError: It is no such point, or a planar arm is tilted at the start.
    """
    normal = arm.tree.plane_normal()
    meaning = "[m], from the system CM" if start is None else "[m], in the inertial frame of start"
    centre = np.zeros(3) if start is None else centre_of(start, mode)
    if start is not None and normal is not None and start.base.rotation[normal, normal] < UPRIGHT:
        raise ConfigurationError(
            "start is tilted out of the inertial plane; give the point from the system CM, along "
            "the plane of the arm, and no start"
        )
    if normal is None:
        return finite(point, (3,), "point", meaning) - centre
    in_plane = shape_of(point) == (2,)
    p = finite(point, (2,) if in_plane else (3,), "point", f"{meaning}, or 2 in the plane")
    if not in_plane:
        return p - centre
    return np.insert(p - np.delete(centre, normal), normal, _height(arm, normal, mode))


def centre_of(cfg: Configuration, mode: BaseMode) -> Array:
    """Return (3,) what distances count from: the system CM, or that of a fixed spacecraft."""
    return cfg.base.act(cfg.arm.model.inertias[1].lever) if mode == "fixed" else cfg.com


def off_plane(arm: SpaceArm, point: Array, mode: BaseMode) -> float:
    """Compute the distance of a point (3,) from the plane of a planar arm's tip [m]."""
    normal = arm.tree.plane_normal()
    return 0.0 if normal is None else abs(float(point[normal]) - _height(arm, normal, mode))


def _height(arm: SpaceArm, normal: int, mode: BaseMode) -> float:
    """Compute the offset of a planar arm's tip from the system CM along the normal [m]."""
    return float(tips_from_centre(arm, np.zeros((1, arm.n)), mode)[0, normal])


def singular_at(
    point: Array, found: ExactSet, box: Box, shells: Iterable[Shell]
) -> tuple[Configuration, ...]:
    """Find a singular configuration with the tip at the point (3,) for each shell around it."""
    arm, mode, R = found.arm, found.mode, float(np.linalg.norm(point))
    equations = found.triangle.equations
    R2 = radius_squared(arm, mode=mode)
    Q = members(found, box, SAMPLE, np.random.default_rng(0))
    near = Q[np.argsort(np.abs(R2(Q) - R * R))[:BEST]]
    results = []
    for shell in shells:
        if shell.radius[0] - 1e-9 <= R <= shell.radius[1] + 1e-9:
            starts = [*shell.at[np.argsort(np.abs(shell.radius - R))[:1]], *near]
            meetings = (meeting(equations, R2, R * R, start) for start in starts)
            inside = (box.fold(q) for q in meetings if q is not None and box.holds(box.fold(q)))
            singular = (q for q in inside if found.are_singular(q[None])[0])
            if (q := next(singular, None)) is not None:
                results.append(_brought_to(arm, q, point, mode))
    return tuple(results)


def _brought_to(arm: SpaceArm, q: Array, point: Array, mode: BaseMode) -> Configuration:
    """Turn the configuration about the CM so that the tip, at its distance, is at the point."""
    cfg = arm.at(q)
    centre = centre_of(cfg, mode)
    tip = cfg.tip.translation - centre
    normal = arm.tree.plane_normal()
    if normal is None or not tip.any():
        R = pin.Quaternion.FromTwoVectors(tip, point).matrix()
    else:
        n = np.eye(3)[normal]
        along = tip @ point - (n @ tip) * (n @ point)
        R = pin.exp3(np.arctan2(n @ np.cross(tip, point), along) * n)
    return arm.at(q, base=pin.SE3(R, -R @ centre))
