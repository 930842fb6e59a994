"""Proof that paths in joint space are free of singular configurations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError
from spacearm.mechanics.blocks import Progress
from spacearm.mechanics.jacobian import task_jacobian
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_vector
from spacearm.polynomial.certificate import WHOLE, Certificate, certify
from spacearm.polynomial.jets import Jets
from spacearm.singularities.rounding import error_bars


def prove_free(
    arm: SpaceArm,
    mode: BaseMode,
    minors: Sequence[Jets],
    path: npt.ArrayLike,
    limits: bool,
    progress: Progress | None = None,
) -> Certificate:
    """Prove that a path meets no common root of minors.

    Where all minors are rounding the arm is singular if its sigma_min is too; else it is undecided.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        minors: Minors whose common roots hold the whole singular set.
        path: (m, n) joint positions, at least one.
        limits: Whether only what lies within the joint limits counts.
        progress: Called as progress(done, 1000), in thousandths of the path.
    """
    rows = np.array([joint_vector(arm, q, "path") for q in np.atleast_2d(np.asarray(path))])
    if not len(rows):
        raise ConfigurationError("path has no rows; give at least one configuration")

    def singular(q: Array) -> bool:
        cfg = arm.at(q)
        sigma = np.linalg.svd(task_jacobian(cfg, mode=mode), compute_uv=False)[-1]
        return bool(sigma <= error_bars(cfg, mode=mode).sigma)

    decides = singular if len(minors) > 1 else None
    if not limits:
        return certify(minors, rows, decides, progress)
    margin = np.inf
    for number, ends in _within(arm, rows):
        if progress:
            progress(WHOLE * number // len(rows), WHOLE)
        proof = certify(minors, ends, decides)
        if not proof:
            return proof._replace(segment=number)
        margin = min(margin, proof.margin)
    noise = max(minor.noise() / minor.scale for minor in minors)
    return Certificate(True, None, None, margin, "free", noise)


def _within(arm: SpaceArm, path: Array) -> list[tuple[int, Array]]:
    """Return the parts of a path within the joint limits: number of the segment and ends (2, n)."""
    parts = []
    starts, ends = (path[:-1], path[1:]) if len(path) > 1 else (path, path)
    for number, (q0, q1) in enumerate(zip(starts, ends, strict=True)):
        step = q1 - q0
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.stack(((arm.lower - q0) / step, (arm.upper - q0) / step))
        still = step == 0.0
        if (still & ((q0 < arm.lower) | (q0 > arm.upper))).any():
            continue
        first = max(0.0, float(t.min(axis=0)[~still].max(initial=0.0)))
        last = min(1.0, float(t.max(axis=0)[~still].min(initial=1.0)))
        if first <= last:
            parts.append((number, np.array([q0 + first * step, q0 + last * step])))
    return parts
