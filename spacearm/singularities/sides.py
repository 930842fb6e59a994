"""Sides of the singular set: proofs that every motion crosses it, by the sign of det J*.

A motion free of singularities keeps the sign of det J*. Let the spacecraft have any attitude at
the end. The postures that reach a position are those with the tip as far from the system CM as the
goal is. For tasks with turns they are those with the system CM at the place that it has in the
frame of the tip at the goal. Both are trigonometric polynomials of the joint angles, as S is,
whose sign is that of det J*. Boxes of joint space in which one of these misses its value, or S has
the opposite sign, rounding included, are left out, others are halved. Where none is left, there is
no posture to go to.
"""

from __future__ import annotations

from contextlib import suppress
from functools import lru_cache
from itertools import product
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError, UnsupportedError
from spacearm.mechanics.floating import reactions
from spacearm.model.arguments import FLOATING
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.polynomial.trig import NotPolynomialError, TrigPolynomial
from spacearm.singularities.box_graph import FreeBoxes, free_boxes
from spacearm.singularities.polynomials import (
    fitting,
    minor_sampler,
    radius_squared,
    singularity_polynomial,
)
from spacearm.singularities.rounding import proven_sign

#: Largest number of joints whose space is divided, and of boxes at a time.
MOST_JOINTS, MOST_BOXES = 3, 20_000
#: Turn out of the plane of the arm that counts as none [rad].
TILTED = 1e-9
SIGNS = {1: "positive", -1: "negative"}

#: Functions of the joint angles, and the value that each has at a goal.
Levels: TypeAlias = list[tuple[TrigPolynomial, float]]


def parted(start: Configuration, goal: Configuration) -> str:
    """Return the proof that every joint path between two configurations is singular, or nothing."""
    if start.arm.n != start.arm.task.k:
        return ""
    here, there = (proven_sign(cfg) for cfg in (start, goal))
    if here * there >= 0:
        return ""
    return (
        f"det J* is {SIGNS[here]} at the start and {SIGNS[there]} at the goal, so that every way "
        "between them meets a singularity"
    )


def separated(start: Configuration, goal: Configuration, limits: bool) -> str:
    """Return the proof that no joint path leads round the singular set, or nothing.

    The boxes in which det J* has the opposite sign (`free_boxes`) are walls. Cells that are none
    hold all other configurations; those of start and goal are in different connected parts.

    Args:
        start: Where the path begins.
        goal: Where it ends, with the same sign of det J*.
        limits: Whether it stays within the joint limits.
    """
    arm = start.arm
    few = arm.n == arm.task.k and arm.n <= MOST_JOINTS and arm.coupling is None
    within = np.array((arm.lower, arm.upper) if limits else np.full(arm.n, np.inf) * [[-1], [1]])
    if not few or not np.isfinite(within[:, arm.slides]).all() or not proven_sign(start):
        return ""
    try:
        boxes = free_boxes(arm, within=(within[0], within[1]), most=MOST_BOXES)
    except UnsupportedError:  # det J* is no polynomial
        return ""
    low, high, child, free = boxes.cells
    S = minor_sampler(arm, [tuple(range(arm.n))], FLOATING)
    wall = free & (S(0.5 * (low + high))[:, 0] * S(start.q[None])[0, 0] < 0.0)
    cells = boxes.cells._replace(free=(child < 0) & ~wall)
    left = FreeBoxes(arm, FLOATING, cells, boxes.endless)
    ends = np.array((start.q, goal.q))
    with suppress(NoSolutionError):  # an end lies beyond its limit, by rounding
        if all(len([*left.ways(q, ends)]) == 1 for q in ends):
            return (
                f"det J* is {SIGNS[proven_sign(start)]} at start and goal, but every way between "
                f"them{' within the joint limits' * limits} meets a singularity, proven by boxes"
            )
    return ""


def dividable(arm: SpaceArm) -> bool:
    """Tell whether joint space is small enough for `on_the_other_side`, and S a polynomial."""
    turning = arm.coupling is None and not arm.slides.any()
    return arm.n == arm.task.k and arm.n <= MOST_JOINTS and turning


def on_the_other_side(
    start: Configuration, goal: pin.SE3, axes: Array, lower: Array, upper: Array
) -> str:
    """Return the proof that no attitude lets the tip be at a goal with the start's sign of det J*.

    Args:
        start: Where the motion begins, of an arm that is `dividable`.
        goal: Pose of the tip; what the task leaves open does not count.
        axes: (3, 3) the axes along which the task's rows are asked for, columns in inertial axes.
        lower: (n,) least joint positions.
        upper: (n,) largest.

    Returns:
        It in words, or nothing where there is none.
    """
    arm, sign = start.arm, proven_sign(start)
    try:
        levels, S = _levels(start, goal, axes), singularity_polynomial(arm)
    except NotPolynomialError:  # lost in rounding: nothing can be proven
        return ""
    if not sign or not levels:
        return ""
    wide = upper - lower >= 2.0 * np.pi
    low, high = np.where(wide, -np.pi, lower), np.where(wide, np.pi, upper)
    if not _none(levels, S, int(np.sign(S(start.q))), low, high):
        return ""
    within = "" if wide.all() else " within the joint limits"
    return (
        f"det J* is {SIGNS[sign]} at the start, and whatever the attitude of the spacecraft, it is "
        f"so in no posture{within} that brings the tip to the goal"
    )


def _levels(start: Configuration, goal: pin.SE3, axes: Array) -> Levels:
    """Return the functions whose values are known at a goal, none for tasks of other rows."""
    arm, normal = start.arm, start.arm.tree.plane_normal()
    here, there = (axes.T @ (pose.translation - start.com) for pose in (start.tip, goal))
    rows = {0, 1, 2} - {normal}
    if not rows <= set(arm.task.indices):
        return []
    if normal is not None:
        there[normal] = here[normal]  # in the plane of the arm
    levels = [(radius_squared(arm, mode=FLOATING), float(there @ there))]
    if len(arm.task.indices) > len(rows):
        turned, tilt = axes.T @ goal.rotation, axes.T @ start.tip.rotation
        off = pin.log3(turned @ tilt.T)
        if normal is not None and np.abs(np.delete(off, normal)).max() > TILTED:
            return levels  # no row asks for the tilt
        levels += zip(_sight(arm), -turned.T @ there, strict=True)
    return levels


@lru_cache(maxsize=16)
def _sight(arm: SpaceArm) -> list[TrigPolynomial]:
    """Fit the three components of the system CM as the tip sees it [m]."""

    def seen(Q: Array) -> Array:
        at = reactions(arm, Q)
        return -np.einsum("mji,mj->mi", at.R, at.r)

    with fitting(arm, "where the tip sees the system CM"):
        return TrigPolynomial.fit_each(seen, arm.n)


def _none(levels: Levels, S: TrigPolynomial, sign: int, low: Array, high: Array) -> bool:
    """Tell whether it is proven that in a box S has a sign nowhere where all levels are met."""
    corners = np.array(list(product((-0.5, 0.5), repeat=len(low))))
    centres, half = 0.5 * (low + high)[None], 0.5 * (high - low)
    while len(centres) * len(corners) <= MOST_BOXES:
        wide = np.broadcast_to(half, centres.shape)
        kept = S.sign(centres, wide) != -sign
        for f, level in levels:
            values, change = f.enclosure(centres, wide)
            kept &= np.abs(values - level) <= change
        centres = centres[kept]
        if not len(centres):
            return True
        centres = (centres[:, None] + half * corners).reshape(-1, len(low))
        half = 0.5 * half
    return False
