"""The largest distance of a tip from the system CM: an upper bound, proven.

The tip from the CM is p = sum_k T_k b_k, with b_k constant in body k and T_k its rotation. The
largest |p| is the largest u . p over all directions u. Seen from body k, what it and the bodies
beyond it can add to that is

    h_k(u) = u . b_k + sum_c g_c(angle of u and the axis of joint c),   g_c(t) = max h_c(u),

c the joints on body k, the maximum over all u at the angle t from the axis of joint c: a turn of
the joint takes u around. So functions of one angle, made from the tip on, give the bound. Each is a
maximum of functions whose second derivatives are at most the length rho of what it adds: between
points at a distance s it is below the chord + rho s^2 / 8.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.equations.reach import attitudes_at_zero, constant_vectors
from spacearm.mechanics.many import parameters_of, structure_of
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm

ANGLES = 4096
"""Number of intervals of the angle to an axis, 0 to pi."""
AROUND, FINER, REFINED = 128, 8, 2
"""Intervals around an axis; into how many those that may hold the maximum are divided, how
often."""
PARALLEL = 1e-14
"""Sine of the angle of two axes below which they are parallel."""
ROUNDING = 1e-13
"""Share of the length of all that is added below which values are the same."""


def largest_distance(arm: SpaceArm, mode: BaseMode) -> float:
    """Bound the distance of the tip from the system CM over the whole torus, from above [m].

    For a fixed spacecraft from its own CM. The arm has revolute joints, none of which mimics
    another.
    """
    tree, p = structure_of(arm, mode), parameters_of(arm)
    axes = attitudes_at_zero(tree, p)[:, :, 2]
    own, count = constant_vectors(tree, p), len(tree.parents)
    length = np.linalg.norm(own, axis=1)
    tables: dict[int, Array] = {}
    for k in range(count - 1, -1, -1):
        beyond = [c for c in range(k + 1, count) if tree.parents[c] == k]
        for c in beyond:
            length[k] += length[c]
        reaches = [_Reach(axes[c], tables.pop(c), length[c]) for c in beyond]
        skew = [c for c in beyond if np.hypot(*axes[c, :2]) > PARALLEL]  # others do not vary
        off_axis = float(np.hypot(*own[k, :2])) + sum(float(length[c]) for c in skew)
        tables[k] = _largest_around(own[k], reaches, off_axis, ROUNDING * length[k])
    step = np.pi / ANGLES
    return float(tables[0].max() + length[0] * (step**2 / 8.0 + 2.0 * ROUNDING * count))


class _Reach:
    """What the bodies beyond a joint can add, an upper bound, by the angle of u to its axis."""

    def __init__(self, axis: Array, table: Array, length: float) -> None:
        self.axis, self.table = axis, table
        self.above = length * (np.pi / ANGLES) ** 2 / 8.0

    def __call__(self, cosine: Array) -> Array:
        x = np.arccos(np.clip(cosine, -1.0, 1.0)) * (ANGLES / np.pi)
        i = np.minimum(x.astype(np.intp), ANGLES - 1)
        low = self.table[i]
        return np.asarray(low + (x - i) * (self.table[i + 1] - low) + self.above)


def _largest_around(own: Array, reaches: list[_Reach], length: float, rounding: float) -> Array:
    """Bound the maxima (ANGLES + 1,) of h over all u at each angle from the z axis.

    `length` bounds the distance from that axis of all that is added.
    """
    t = np.linspace(0.0, np.pi, ANGLES + 1)
    high, low = np.cos(t), np.sin(t)

    def h(row: npt.NDArray[np.int_], turn: Array) -> Array:
        cosine, sine, z = low[row] * np.cos(turn), low[row] * np.sin(turn), high[row]
        value = cosine * own[0] + sine * own[1] + z * own[2]
        for reach in reaches:
            a = reach.axis
            value = value + reach(cosine * a[0] + sine * a[1] + z * a[2])
        return value

    width = 2.0 * np.pi / AROUND
    row = np.arange(ANGLES + 1).repeat(AROUND)
    start = np.tile(width * np.arange(AROUND), ANGLES + 1)
    values = h(row, start).reshape(ANGLES + 1, AROUND)
    best = np.full(ANGLES + 1, -np.inf)
    left, right = values.ravel(), np.roll(values, -1, axis=1).ravel()
    for refinement in range(REFINED + 1):
        np.maximum.at(best, row, np.maximum(left, right))
        above = length * low[row] * width**2 / 8.0
        bound = np.maximum(left, right) + above
        if refinement == REFINED:
            break
        kept = bound > best[row] + rounding
        width /= FINER
        row, start = row[kept].repeat(FINER), start[kept]
        ends = np.stack((left[kept], right[kept]))
        start = (start[:, None] + width * np.arange(FINER)).ravel()
        inner = h(row, start).reshape(-1, FINER)
        inner[:, 0] = ends[0]
        left = inner.ravel()
        right = np.concatenate((inner[:, 1:], ends[1][:, None]), axis=1).ravel()
    most = best + rounding
    np.maximum.at(most, row, bound)
    return most
