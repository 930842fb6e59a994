"""Joint curves: the turn of the spacecraft along them, and its derivative by the curve.

A curve leads from q_0 to q_1 in joint space, s from 0 to 1:

    q(s) = q_0 + s (q_1 - q_0) + sum_j c_j sin(j pi s).

Without momentum the attitude follows T' = T [A(q) q']x with the connection A = -D^-1 D_q of (33c),
in spacecraft axes. It is integrated by the fourth-order Magnus method as in `move`, and
differentiated exactly: changes dw of the angular velocity turn the end by dphi, the sum of all dw
carried to the end.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.mechanics.floating import GAUSS, magnus_step, magnus_step_derivative
from spacearm.mechanics.momentum import momentum_derivatives
from spacearm.mechanics.reduction import (
    base_response,
    base_response_derivative,
    reduced_jacobian,
)
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import kinematics


@dataclass(frozen=True, eq=False)
class Samples:
    """Matrices at m configurations, the spacecraft at the identity.

    Attributes:
        A: (m, 6, 6 + n) centroidal momentum matrices.
        J: (m, 6, 6 + n) tip Jacobians.
        dA: (m, n, 6, 6 + n) derivatives of A with respect to each joint.
        tip: m tip poses from the system CM.
    """

    A: Array
    J: Array
    dA: Array
    tip: list[pin.SE3]

    @cached_property
    def X(self) -> Array:
        """(m, 6, n) X = A_b^-1 A_q; the twist of the spacecraft is -X dq."""
        return base_response(self.A)

    @cached_property
    def dX(self) -> Array:
        """(m, n, 6, n) derivatives of X with respect to each joint."""
        return base_response_derivative(self.A, self.dA, self.X)

    @cached_property
    def J_star(self) -> Array:
        """(m, 6, n) J*."""
        return reduced_jacobian(self.J, self.X)


def sample(arm: SpaceArm, Q: Array) -> Samples:
    """Compute the samples at joint positions Q (m, n)."""
    at = [kinematics(arm, q, pin.SE3.Identity()).centred(np.zeros(3)) for q in Q]
    return Samples(
        A=np.array([cfg.A for cfg in at]),
        J=np.array([cfg.J for cfg in at]),
        dA=np.array([momentum_derivatives(arm, cfg.full_at_origin) for cfg in at]),
        tip=[cfg.tip for cfg in at],
    )


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

    def turn(self, p: Array, at: Samples) -> tuple[Array, Array]:
        """Compute the turn of the spacecraft along the curve, and its derivative.

        Args:
            p: The curve.
            at: The samples at its `points`.

        Returns:
            (3, 3) rotation from the spacecraft axes at the end to those at the start;
            (3, waves + 1, n) dphi per change of p, spacecraft axes at the end.
        """
        rates = self.slope @ (p - self._offset)
        A = -at.X[:-1, 3:]  # (33c)
        w = np.einsum("mij,mj->mi", A, rates)
        G = -np.einsum("mkij,mj->mik", at.dX[:-1, :, 3:], rates)
        dw = np.einsum("ma,mik->miak", self.basis[:-1], G)
        dw += np.einsum("ma,mik->miak", self.slope, A)
        w1, w2 = w[::2], w[1::2]
        dw1, dw2 = (part.reshape(len(part), 3, -1) for part in (dw[::2], dw[1::2]))
        angles = magnus_step(w1, w2, self.h)
        changes = magnus_step_derivative(w1, w2, dw1, dw2, self.h)
        T, dphi = np.eye(3), np.zeros((3, p.size))
        for angle, change in zip(angles, changes, strict=True):
            step = pin.exp3(angle)
            dphi = step.T @ dphi + pin.Jexp3(angle) @ change
            T = T @ step
        return T, dphi.reshape(3, *p.shape)


def sines(s: Array, waves: int) -> tuple[Array, Array]:
    """Return the functions s and sin(j pi s) (m, waves + 1), and their slopes but the last."""
    j = np.pi * np.arange(1, waves + 1)
    basis = np.column_stack((s, np.sin(np.outer(s, j))))
    slope = np.column_stack((np.ones(len(s) - 1), j * np.cos(np.outer(s[:-1], j))))
    return basis, slope
