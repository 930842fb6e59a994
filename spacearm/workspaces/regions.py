"""Regions: what can happen to a tip that is brought to a point."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.model.mode import BaseMode
from spacearm.polynomial.trig import NOISE, TrigPolynomial
from spacearm.singularities.exact_set import SingularSet, singular_set
from spacearm.singularities.polynomial import radius_squared, tip_from_centre
from spacearm.workspaces.shells import Box, Shell

SAMPLE = 20_000
"""Singular configurations that one at the right distance is sought from."""
BEST = 20
"""Of them, those nearest to that distance, that are tried."""


class Region(NamedTuple):
    """What can happen at a point.

    Attributes:
        kind: "unreachable"; "path independent": no path to it meets a singularity there; or
            "path dependent": after some paths the arm is singular when the tip is there.
        radius: Distance of the point from the system CM [m].
        singular: Singular configurations with the tip at the point and the system CM at the
            origin, one for each shell that the point lies in; empty unless path dependent.
    """

    kind: Literal["unreachable", "path independent", "path dependent"]
    radius: float
    singular: tuple[Configuration, ...]


def position(arm: SpaceArm, point: npt.ArrayLike, mode: BaseMode) -> Array:
    """(3,) a checked point; (2,) counts in the plane of a planar arm."""
    try:
        p = np.asarray(point, dtype=np.float64)
    except (TypeError, ValueError):
        p = np.empty(0)
    normal = arm.tree.plane_normal()
    if p.shape == (2,) and normal is not None:
        p = np.insert(p, normal, _height(arm, normal, mode))
    if p.shape != (3,) or not np.isfinite(p).all():
        raise ConfigurationError(
            f"point is {point!r}; give 3 finite numbers from the system CM [m]"
            + (", or 2 in the plane" if normal is not None else "")
        )
    return p


def off_plane(arm: SpaceArm, point: Array, mode: BaseMode) -> float:
    """How far a point (3,) is from the plane in which a planar arm moves its tip [m]."""
    normal = arm.tree.plane_normal()
    return 0.0 if normal is None else abs(float(point[normal]) - _height(arm, normal, mode))


def _height(arm: SpaceArm, normal: int, mode: BaseMode) -> float:
    """How high a planar arm carries its tip over the system CM, along the normal [m]."""
    return float(tip_from_centre(arm, np.zeros(arm.n), mode)[normal])


def singular_at(
    point: Array, arm: SpaceArm, mode: BaseMode, box: Box, shells: Iterable[Shell]
) -> tuple[Configuration, ...]:
    """Singular configurations with the tip at the point (3,), from each shell that holds it."""
    found, R = singular_set(arm, mode=mode), float(np.linalg.norm(point))
    if not isinstance(found, SingularSet):
        return ()
    R2 = radius_squared(arm, mode)
    Q = box.fold(found.sample(SAMPLE, np.random.default_rng(0)))
    Q = Q[box.holds(Q)]
    near = Q[np.argsort(np.abs(R2(Q) - R * R))[:BEST]]
    results = []
    for shell in shells:
        if shell.radius[0] - 1e-9 <= R <= shell.radius[1] + 1e-9:
            starts = [*shell.at[np.argsort(np.abs(shell.radius - R))[:1]], *near]
            meetings = (_meeting(found.S, R2, R * R, start) for start in starts)
            inside = (box.fold(q) for q in meetings if q is not None and box.holds(box.fold(q)))
            if (q := next(inside, None)) is not None:
                results.append(_brought_to(arm, q, point, mode))
    return tuple(results)


def _meeting(S: TrigPolynomial, F: TrigPolynomial, value: float, start: Array) -> Array | None:
    """A point near `start` with S = 0 and F = value, by Newton's method, or None."""
    x = start
    for _ in range(60):
        residual = np.array([S(x) / S.scale, (F(x) - value) / F.scale])
        J = np.array([S.gradient(x) / S.scale, F.gradient(x) / F.scale])
        step = np.linalg.lstsq(J, -residual, rcond=1e-10)[0]
        x = x + step * min(1.0, 0.3 / max(float(np.linalg.norm(step)), 1e-300))
    there = abs(S(x)) <= NOISE * S.scale and abs(F(x) - value) <= 1e-9 * F.scale
    return x if there else None


def _brought_to(arm: SpaceArm, q: Array, point: Array, mode: BaseMode) -> Configuration:
    """The configuration turned about the CM so that the tip, at its distance, is at the point."""
    cfg = arm.at(q)
    centre = arm.model.inertias[1].lever if mode == "fixed" else cfg.com
    tip = cfg.tip.translation - centre
    normal = arm.tree.plane_normal()
    if normal is None or not tip.any():
        R = pin.Quaternion.FromTwoVectors(tip, point).matrix()
    else:
        n = np.eye(3)[normal]
        along = tip @ point - (n @ tip) * (n @ point)
        R = pin.exp3(np.arctan2(n @ np.cross(tip, point), along) * n)
    return arm.at(q, base=pin.SE3(R, -R @ centre))
