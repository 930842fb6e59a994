"""Joint curves: the turn of the spacecraft along them, and its derivative by the curve.

A curve leads from q_0 to q_1 in joint space, s from 0 to 1:

    q(s) = q_0 + s (q_1 - q_0) + sum_j c_j sin(j pi s).

Without momentum the attitude follows T' = T [A(q) q']x with the connection A = -D^-1 D_q of (33c),
in spacecraft axes. It is integrated by the fourth-order Magnus method as in `move`, and
differentiated exactly: changes dw of the angular velocity turn the end by dphi, the sum of all dw
carried to the end.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array
from spacearm.mechanics.floating import GAUSS
from spacearm.model.arm import SpaceArm


class Samples(NamedTuple):
    """Matrices at the m Gauss points of a curve and at its end, in spacecraft axes.

    Attributes:
        J: (m + 1, 6, n) J*.
        A: (m + 1, 3, n) the connection.
        r: (m + 1, 3) the tip from the system CM [m].
        R: (m + 1, 3, 3) attitude of the tip.
        G: (m + 1, 3, n) derivatives of A q' with q' held.
        rates: (m + 1, n) q', zero at the end.
    """

    J: Array
    A: Array
    r: Array
    R: Array
    G: Array
    rates: Array


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

    def points(self, p: Array) -> Array:
        """Return the Gauss points of every interval, and the end, (2 intervals + 1, n)."""
        return self.q0 + self.basis @ (p - self._offset)

    def samples(self, p: Array, Q: Array) -> Samples:
        """Compute the samples of a curve at its `points` Q, by compiled kernels."""
        from spacearm.mechanics.connection import connections  # imports the compiler

        rates = np.zeros_like(Q)
        rates[:-1] = self.slope @ (p - self._offset)
        at, G = connections(self.arm, Q.T, rates)
        return Samples(*at, G, rates)

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

    def turn(self, at: Samples) -> tuple[Array, Array]:
        """Compute the turn of the spacecraft along a curve, and its derivative.

        Args:
            at: The samples of the curve.

        Returns:
            (3, 3) rotation from the spacecraft axes at the end to those at the start;
            (3, waves + 1, n) dphi per change of the curve, spacecraft axes at the end.
        """
        from spacearm.kernels.paths.turns import turn_and_slope  # imports the compiler

        T, dphi = np.empty((3, 3)), np.empty((3, self.basis.shape[1], self.arm.n))
        last = len(at.A) - 1
        turn_and_slope(
            at.A[:last], at.G[:last], at.rates[:last], self.basis[:last], self.slope, self.h, T,
            dphi,
        )  # fmt: skip
        return T, dphi


def sines(s: Array, waves: int) -> tuple[Array, Array]:
    """Return the functions s and sin(j pi s) (m, waves + 1), and their slopes but the last."""
    j = np.pi * np.arange(1, waves + 1)
    basis = np.column_stack((s, np.sin(np.outer(s, j))))
    slope = np.column_stack((np.ones(len(s) - 1), j * np.cos(np.outer(s[:-1], j))))
    return basis, slope
