"""Joint curves: the turn of the spacecraft along them, and its derivative by the curve.

A curve leads from q_0 to q_1 in joint space, s from 0 to 1:

    q(s) = q_0 + s (q_1 - q_0) + sum_j c_j sin(j pi s).

Without momentum the attitude follows T' = T [A(q) q']x with the connection A = -D^-1 D_q of (33c),
in spacecraft axes. It is integrated by the fourth-order Magnus method as in `move`, and
differentiated exactly: what changes of the curve add to the turn of each interval is carried to the
end, and summed there.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array
from spacearm.equations.turns import GAUSS
from spacearm.mechanics.floating import chained, turns_and_effects
from spacearm.model.arm import SpaceArm


class Samples(NamedTuple):
    """A curve's turn and Jacobians at its m Gauss points and its end, in spacecraft axes.

    Attributes:
        J: (m + 1, 6, n) J*.
        A: (3, n) the connection at the end.
        r: (3,) the tip from the system CM there [m].
        R: (3, 3) attitude of the tip there.
        turn: (3, 3) rotation from the spacecraft axes at the end to those at the start.
        dphi: (3, waves + 1, n) turn of the axes at the end per change of the curve.
    """

    J: Array
    A: Array
    r: Array
    R: Array
    turn: Array
    dphi: Array


class CurveFamily:
    """The curves with some number of sines from one configuration.

    A curve is the vector p = (q_1, c_1, ..., c_waves), (waves + 1, n).

    Args:
        arm: The arm.
        q0: (n,) joint positions at the start of the curves.
        waves: Number of sines.
        intervals: Steps of the integration along a curve.
    """

    def __init__(self, arm: SpaceArm, q0: Array, waves: int, intervals: int) -> None:
        self.arm, self.q0, self.h = arm, q0, 1.0 / intervals
        s = np.add.outer(np.arange(intervals), GAUSS).ravel() / intervals
        self.s = np.append(s, 1.0)
        self.basis, self.slope = sines(self.s, waves)
        self._lengths = np.append(np.full(intervals, self.h), 0.0)

    def points(self, p: Array) -> Array:
        """Return the Gauss points of every interval, and the end, (2 intervals + 1, n)."""
        return self.q0 + self.basis @ (p - self._offset)

    def samples(self, p: Array, Q: Array) -> Samples:
        """Compute the samples of a curve at its `points` Q."""
        m, n = len(Q) // 2, self.arm.n
        nodes, rates = np.empty((2 * m + 2, n)), np.zeros((2 * m + 2, n))
        nodes[:-1], nodes[-1], rates[:-2] = Q, Q[-1], self.slope @ (p - self._offset)
        parts = turns_and_effects(  # the last one, at the end, has no length
            self.arm, nodes.reshape(-1, 2, n), rates.reshape(-1, 2, n), self._lengths
        )
        back = chained(parts.T[::-1].transpose(0, 2, 1))  # from there to the axes at the end
        effects = back[m - 1 :: -1, None, None] @ parts.effects[:-1]
        by_q, by_rate = effects.transpose(2, 0, 1, 3, 4).reshape(2, 2 * m, 3 * n)
        dphi = self.basis[:-1].T @ by_q + self.slope.T @ by_rate
        return Samples(
            parts.J.reshape(2 * m + 2, *parts.J.shape[2:])[:-1], parts.A[-1], parts.r[-1],
            parts.R[-1], back[-1].T, dphi.reshape(-1, 3, n).swapaxes(0, 1),
        )  # fmt: skip

    def rows(self, p: Array, m: int) -> Array:
        """Return joint positions (m + 1, n) at even steps of s."""
        basis, _ = sines(np.linspace(0.0, 1.0, m + 1), len(p) - 1)
        return self.q0 + basis @ (p - self._offset)

    @cached_property
    def _offset(self) -> Array:
        """(waves + 1, n) q_0 in the row of q_1: the curve depends on their difference."""
        offset = np.zeros((self.basis.shape[1], self.arm.n))
        offset[0] = self.q0
        return offset

    def length_squared(self, p: Array) -> tuple[float, Array]:
        """Return the integral of |q'|^2, least for the shortest curve, and its gradient."""
        weight = np.append(1.0, 0.5 * (np.pi * np.arange(1, len(p))) ** 2)[:, None]
        d = p - self._offset
        return float((weight * d * d).sum()), 2.0 * weight * d


def sines(s: Array, waves: int) -> tuple[Array, Array]:
    """Return the functions s and sin(j pi s) (m, waves + 1), and their slopes but the last."""
    j = np.pi * np.arange(1, waves + 1)
    basis = np.column_stack((s, np.sin(np.outer(s, j))))
    slope = np.column_stack((np.ones(len(s) - 1), j * np.cos(np.outer(s[:-1], j))))
    return basis, slope
