"""The least distance of a tip from the system CM: a lower bound, proven.

Let a point x be given in the axes of body k. How near it and the bodies beyond it can bring the tip
to x is

    D_k(x) = G_(k+1)(r, z),   G_c(r, z) = min over the turn of D_c,

r and z the cylinder coordinates of x - b_k about the axis of joint c = k + 1; b_k as in
`outermost`. The least distance from the system CM is D_0(0). The functions G are known at the
nodes of grids, from the tip on. Each is a minimum of distances |x - w| to fixed points w, whose
second derivatives are between 0 and 1 / |x - w|. That bounds how far it may lie below its
interpolation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array
from spacearm.mechanics.compiled import bodies
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.workspaces.outermost import constant_vectors

NODES = 256
"""Number of intervals of the distance from an axis; twice as many along it."""
AROUND, FINER, REFINED = 48, 8, 2
"""Intervals of a turn; into how many those that may hold the least are divided, how often."""
TURNS = 2048
"""Intervals of the turn of the first joint."""
HOLE = 0.03
"""Share of the length of the arm below which a hole is not looked at."""
NEAR = (0.5, 1.5)
"""Shares of the known distance between which minima are refined."""
ROUNDING = 1e-13
"""Share of the length of the arm that rounding adds."""
ROWS = 1 << 14
"""Number of points whose turns are looked at together."""


class _Table(NamedTuple):
    """A lower bound of G on a grid.

    Attributes:
        values: (NODES + 1, 2 NODES + 1) at the nodes.
        step: Width of the intervals [m].
    """

    values: Array
    step: float

    def __call__(self, r: Array, z: Array) -> Array:
        """Bound G from below at points (m,)."""
        x, y = r / self.step, z / self.step + NODES
        i = np.clip(x.astype(np.intp), 0, NODES - 1)
        j = np.clip(y.astype(np.intp), 0, 2 * NODES - 1)
        u, v = x - i, y - j
        a, b, c, d = (self.values[i + p, j + q] for p in (0, 1) for q in (0, 1))
        interpolated = (1.0 - u) * ((1.0 - v) * a + v * b) + u * ((1.0 - v) * c + v * d)
        diagonal = np.sqrt(2.0) * self.step
        rough = np.maximum(np.maximum(a, b), np.maximum(c, d)) - diagonal
        below = self.step**2 / 4.0 / np.maximum(rough - diagonal, 1e-300)
        return np.asarray(np.maximum(rough, interpolated - below))


def least_distance(arm: SpaceArm, mode: BaseMode, known: float) -> float:
    """Bound the distance of the tip from the system CM over the whole torus, from below [m].

    0 where joints beside the way to the tip matter too, and where the distance that is `known` to
    be attained is so small that the bound would take long.
    """
    b, tip_body, tip = bodies(arm, mode)
    n = len(b) - 1
    own = constant_vectors(b, tip_body, tip)
    length = np.cumsum(np.linalg.norm(own, axis=1)[::-1])[::-1]
    if (
        n < 2
        or known < HOLE * length[0]
        or tip_body != n
        or any(b[k]["parent"] != k - 1 for k in range(1, n + 1))
    ):
        return 0.0
    reach, steps = float(np.linalg.norm(own[:2], axis=1).sum()), [0.0, 0.0]
    for k in range(2, n):  # points of a cell may lie two steps from where the tip can be asked for
        steps.append(reach / (NODES - 2))
        reach += 2.0 * steps[k] + float(np.linalg.norm(own[k]))
    nearer: _Table | None = None
    for k in range(n - 1, 1, -1):
        step = steps[k]
        r, z = np.meshgrid(
            step * np.arange(NODES + 1), step * np.arange(-NODES, NODES + 1), indexing="ij"
        )
        turned = _Turned(own[k], b[k + 1]["E"], own[k + 1], length[k], nearer, known)
        values = np.maximum(np.hypot(r, z) - length[k], 0.0)
        near = np.hypot(r, z) <= NODES * step
        values[near] = np.maximum(values[near], turned.least(r[near], z[near]))
        nearer = _Table(values, step)
    first = b[1]["E"].T @ -own[0]
    turned = _Turned(own[1], b[2]["E"], own[2], length[1], nearer, known)
    least = turned.least(np.hypot(first[:1], first[1:2]), first[2:], TURNS)
    return max(float(least[0]) - ROUNDING * n * float(length[0]), 0.0)


class _Turned(NamedTuple):
    """The function D of a body, and its minimum over the turn of the joint before it.

    Attributes:
        own: (3,) b of the body [m].
        E: (3, 3) attitude of the next one's axes.
        following: (3,) b of the next body.
        length: Largest distance of what follows from the joint before [m].
        nearer: G of the next joint; None if the next body carries the tip.
        known: Distance that is attained [m]; minima far from it do not matter.
    """

    own: Array
    E: Array
    following: Array
    length: float
    nearer: _Table | None
    known: float

    def D(self, x: Array, y: Array, z: Array) -> Array:
        """Bound D from below at points (m,)."""
        p = (np.stack((x, y, z), axis=-1) - self.own) @ self.E
        r, height = np.hypot(p[..., 0], p[..., 1]), p[..., 2]
        if self.nearer is None:
            out = float(np.hypot(*self.following[:2]))
            return np.asarray(np.hypot(r - out, height - self.following[2]))
        return self.nearer(r, height)

    def least(self, r: Array, z: Array, around: int = AROUND) -> Array:
        """Bound the minima of D over the turn from below, at points (m,)."""
        parts = [slice(i, i + ROWS) for i in range(0, len(r), ROWS)]
        return np.concatenate([self._least(r[part], z[part], around) for part in parts])

    def _least(self, r: Array, z: Array, around: int) -> Array:
        m, width = len(r), 2.0 * np.pi / around
        row = np.arange(m).repeat(around)
        start = np.tile(width * np.arange(around), m)
        values = self.D(r[row] * np.cos(start), r[row] * np.sin(start), z[row]).reshape(m, around)
        left, right = values.ravel(), np.roll(values, -1, axis=1).ravel()
        best, least = values.min(axis=1), np.full(m, np.inf)
        for refinement in range(REFINED + 1):
            smaller = np.minimum(left, right)
            rough = smaller - 0.5 * width * r[row]
            below = width**2 / 8.0 * r[row] * self.length / np.maximum(rough, 1e-300)
            bound = np.maximum(rough, smaller - below)
            matter = (best > NEAR[0] * self.known) & (best < NEAR[1] * self.known)
            open_ = (bound < best[row] - ROUNDING * self.length) & matter[row]
            open_ &= refinement < REFINED
            np.minimum.at(least, row[~open_], bound[~open_])
            if not open_.any():
                break
            width /= FINER
            row, ends = row[open_].repeat(FINER), np.stack((left[open_], right[open_]))
            start = (start[open_][:, None] + width * np.arange(FINER)).ravel()
            inside = self.D(r[row] * np.cos(start), r[row] * np.sin(start), z[row])
            inside = inside.reshape(-1, FINER)
            inside[:, 0] = ends[0]
            left = inside.ravel()
            right = np.concatenate((inside[:, 1:], ends[1][:, None]), axis=1).ravel()
            np.minimum.at(best, row, left)
        return least
