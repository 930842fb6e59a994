"""Proof by halving boxes: the range of a polynomial on the roots of another.

On S = 0 the functions F and G = F + lambda S are the same, whatever lambda. Take a box with centre
c and half widths h, and lambda so that the gradient of G at c is small. There G differs from G(c)
by less than |grad G(c)| h + h B h / 2, where B bounds the second derivatives of G everywhere.
Boxes that hold no root, or whose range lies inside intervals that are attained already, are done;
others are halved. Near an extreme the gradient of G vanishes, so that boxes of width
sqrt(tolerance) suffice.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array
from spacearm.polynomial.trig import TrigPolynomial

#: Largest number of boxes at a time; only extremes that are not isolated points need more.
MOST_BOXES = 400_000


class Proof(NamedTuple):
    """Proof that F on the roots of S stays inside intervals.

    Attributes:
        gap: By how much F may still lie outside, proven.
        outside: (n,) a configuration near which a root may lie outside by more, or None.
    """

    gap: float
    outside: Array | None


def enclose(
    F: TrigPolynomial,
    S: TrigPolynomial | None,
    intervals: Array,
    low: Array,
    high: Array,
    tolerance: float,
) -> Proof:
    """Prove that F stays within `intervals`, up to `tolerance`, on the roots of S in a box.

    Args:
        F: The function.
        S: Its roots count; everything does if None.
        intervals: (k, 2) sorted, disjoint.
        low: (n,) corner of the box.
        high: (n,) opposite corner.
        tolerance: In the unit of F.
    """
    matters = [j for j in range(F.n) if F.degrees[j] or (S is not None and S.degrees[j])] or [0]
    others = {j: 0.0 for j in range(F.n) if j not in matters}
    if others:
        F, S = F.fix(others), None if S is None else S.fix(others)
    corners = np.array(list(product((-0.5, 0.5), repeat=len(matters))))
    centres = (0.5 * (low + high))[None, matters]
    half = 0.5 * (high - low)[matters]
    gap = np.inf
    while len(centres):
        if S is not None:
            centres = centres[S.sign(centres, np.broadcast_to(half, centres.shape)) == 0]
            if not len(centres):
                return Proof(min(gap, tolerance), None)
        least, most = _range(F, S, centres, half)
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
    F: TrigPolynomial, S: TrigPolynomial | None, centres: Array, half: Array
) -> tuple[Array, Array]:
    """Bound F on the roots in each box: least and largest value, (m,) each."""
    if S is None:
        value, reach = F.enclosure(centres, np.broadcast_to(half, centres.shape))
        return value - reach, value + reach
    gradient, g = F.gradient(centres), S.gradient(centres)
    multiplier = -(gradient * g).sum(axis=1) / np.maximum((g * g).sum(axis=1), 1e-300)
    of_F, of_S = (0.5 * half @ f.curvature @ half for f in (F, S))
    with_S = np.abs(gradient + multiplier[:, None] * g) @ half + np.abs(multiplier) * of_S
    multiplier = np.where(with_S < np.abs(gradient) @ half, multiplier, 0.0)
    value = F(centres) + multiplier * S(centres)
    reach = np.abs(gradient + multiplier[:, None] * g) @ half + of_F + F.noise()
    reach = reach + np.abs(multiplier) * (of_S + S.noise())
    return value - reach, value + reach


def _overhang(least: Array, most: Array, intervals: Array) -> Array:
    """Compute by how much each range exceeds the interval that fits it best, (m,)."""
    out = np.maximum(intervals[:, :1] - least, most - intervals[:, 1:])
    return np.maximum(out.min(axis=0), 0.0) if len(intervals) else np.full(len(least), np.inf)
