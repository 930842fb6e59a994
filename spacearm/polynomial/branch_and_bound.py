"""Proof by halving boxes: the range of a polynomial on the common roots of others.

On S_1 = ... = S_c = 0 the functions F and G = F + sum lambda_i S_i are the same, whatever the
lambda_i. Take a box with centre c and half widths h, and lambda_i so that the gradient of G at c is
small. There G differs from G(c) by less than |grad G(c)| h + h B h / 2, where B bounds the second
derivatives of G everywhere. Boxes that hold no common root, or whose range lies inside intervals
that are attained already, are done; others are halved. Near an extreme the gradient of G vanishes,
so that boxes of width sqrt(tolerance) suffice.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array
from spacearm.polynomial.trig import TrigPolynomial

#: Largest number of boxes at a time; only extremes that are not isolated points need more.
MOST_BOXES = 400_000


class Proof(NamedTuple):
    """Proof that F on common roots of equations stays inside intervals.

    Attributes:
        gap: By how much F may still lie outside, proven.
        outside: (n,) a configuration near which a root may lie outside by more, or None.
    """

    gap: float
    outside: Array | None


def enclose(
    F: TrigPolynomial,
    equations: Sequence[TrigPolynomial],
    intervals: Array,
    low: Array,
    high: Array,
    tolerance: float,
) -> Proof:
    """Prove that F stays within `intervals`, up to `tolerance`, on common roots in a box.

    Args:
        F: The function.
        equations: Their common roots count; the whole box if there are none.
        intervals: (k, 2) sorted, disjoint.
        low: (n,) corner of the box.
        high: (n,) opposite corner.
        tolerance: In the unit of F.
    """
    degrees = np.array([f.degrees for f in (F, *equations)])
    matters = [int(j) for j in np.flatnonzero(degrees.any(axis=0))] or [0]
    others = {j: 0.0 for j in range(F.n) if j not in matters}
    if others:
        F = F.fix(others)
        equations = [S.fix(others) for S in equations]
    corners = np.array(list(product((-0.5, 0.5), repeat=len(matters))))
    centres = (0.5 * (low + high))[None, matters]
    half = 0.5 * (high - low)[matters]
    gap = np.inf
    while len(centres):
        for S in equations:
            centres = centres[S.sign(centres, np.broadcast_to(half, centres.shape)) == 0]
            if not len(centres):
                return Proof(min(gap, tolerance), None)
        least, most = _range(F, equations, centres, half)
        overhang = _overhang(least, most, intervals)
        gap = min(gap, float(overhang.max()))
        waiting = overhang > tolerance
        if not waiting.any():
            return Proof(tolerance, None)
        if waiting.sum() * len(corners) > MOST_BOXES or half.max() < 1e-9:
            worst = np.zeros(len(low))
            worst[matters] = centres[np.argmax(overhang)]
            return Proof(gap, worst)
        centres = (centres[waiting][:, None] + half * corners).reshape(-1, len(matters))
        half = half / 2.0
    return Proof(min(gap, tolerance), None)


def _range(
    F: TrigPolynomial, equations: Sequence[TrigPolynomial], centres: Array, half: Array
) -> tuple[Array, Array]:
    """Bound F on the common roots in each box: least and largest value, (m,) each."""
    if not equations:
        value, reach = F.enclosure(centres, np.broadcast_to(half, centres.shape))
        return value - reach, value + reach
    gradient = F.gradient(centres)
    slopes = np.stack([S.gradient(centres) for S in equations], axis=1)
    of_F = 0.5 * half @ F.curvature @ half
    of_S = np.array([0.5 * half @ S.curvature @ half for S in equations])
    multipliers = -_least_squares(slopes, gradient)
    rest = gradient + (multipliers[:, None] @ slopes)[:, 0]
    with_S = np.abs(rest) @ half + np.abs(multipliers) @ of_S
    better = with_S < np.abs(gradient) @ half
    multipliers = np.where(better[:, None], multipliers, 0.0)
    rest = np.where(better[:, None], rest, gradient)
    values = np.stack([S(centres) for S in equations], axis=1)
    noise = np.array([S.noise() for S in equations])
    value = F(centres) + (multipliers * values).sum(axis=1)
    reach = np.abs(rest) @ half + of_F + F.noise()
    reach = reach + np.abs(multipliers) @ (of_S + noise)
    return value - reach, value + reach


def _least_squares(slopes: Array, gradient: Array) -> Array:
    """Return the factors (m, c) of slopes (m, c, n) that come nearest to gradients (m, n)."""
    if slopes.shape[1] == 1:
        g = slopes[:, 0]
        product_with = (gradient * g).sum(axis=1)
        return np.asarray((product_with / np.maximum((g * g).sum(axis=1), 1e-300))[:, None])
    inverse = np.linalg.pinv(slopes.swapaxes(1, 2), rcond=1e-9)
    return np.asarray((inverse @ gradient[:, :, None])[..., 0])


def _overhang(least: Array, most: Array, intervals: Array) -> Array:
    """Compute by how much each range exceeds the interval that fits it best, (m,)."""
    out = np.maximum(intervals[:, :1] - least, most - intervals[:, 1:])
    return np.maximum(out.min(axis=0), 0.0) if len(intervals) else np.full(len(least), np.inf)
