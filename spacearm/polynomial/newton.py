"""Newton's method on trigonometric polynomials: roots, common roots, constrained extremes.

A point where F is stationary on S = 0 solves the Newton-Lagrange equations

    grad F + lambda grad S = 0,   S = 0

for the point and the multiplier lambda. Steps are limited in length; where the equations leave a
step undetermined, the shortest one is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from spacearm.arrays import Array
from spacearm.polynomial.trig import NOISE, TrigPolynomial

STEPS = 60
"""Largest number of steps."""
CONVERGED = 1e-14
"""Length of the step after which the iteration ends [rad]."""


class Smooth(Protocol):
    """A function with first and second derivatives."""

    def gradient(self, q: Array, /) -> Array:
        """Return the gradient (n,)."""

    def hessian(self, q: Array, /) -> Array:
        """Return the second derivatives (n, n)."""


class HalfSquare:
    """The function |q|^2 / 2, half the squared distance from the origin."""

    def gradient(self, q: Array, /) -> Array:
        """Return the gradient (n,)."""
        return q

    def hessian(self, q: Array, /) -> Array:
        """Return the second derivatives (n, n)."""
        return np.eye(len(q))


def shortened(step: Array, stride: float) -> Array:
    """Scale steps (..., n) down to the length `stride` where they are longer."""
    size = np.linalg.norm(step, axis=-1, keepdims=True)
    return step * np.minimum(1.0, stride / np.maximum(size, 1e-300))


def iterate(
    equations: Callable[[Array], tuple[Array, Array]],
    x: Array,
    n: int,
    stride: float,
    rcond: float | None = None,
) -> Array:
    """Solve equations by Newton's method with shortest steps.

    Args:
        equations: Gives the residuals (e,) and their derivatives (e, len(x)) at x.
        x: The first guess: n angles, then multipliers.
        n: Number of angles, whose step is limited.
        stride: Its largest length [rad].
        rcond: Singular values of the derivatives below this share of the largest count as zero.

    Returns:
        The last iterate, whether it converged or not.
    """
    for _ in range(STEPS):
        residual, derivatives = equations(x)
        step = np.linalg.lstsq(derivatives, -residual, rcond=rcond)[0]
        x = x + np.append(shortened(step[:n], stride), step[n:])
        if np.linalg.norm(step[:n]) < CONVERGED:
            break
    return x


def stationary(F: Smooth, S: TrigPolynomial | None, start: Array, stride: float = 0.1) -> Array:
    """Find a point near `start` where F is stationary on S = 0, or on all of space if S is None."""
    n = len(start)
    if S is None:
        return iterate(lambda x: (F.gradient(x), F.hessian(x)), start, n, stride)

    def equations(y: Array) -> tuple[Array, Array]:
        x, multiplier = y[:n], y[n]
        g = S.gradient(x)
        residual = np.append(F.gradient(x) + multiplier * g, S(x))
        H = F.hessian(x) + multiplier * S.hessian(x)
        return residual, np.block([[H, g[:, None]], [g[None], np.zeros((1, 1))]])

    g = S.gradient(start)
    multiplier = -(F.gradient(start) @ g) / max(float(g @ g), 1e-300)
    return iterate(equations, np.append(start, multiplier), n, stride)[:n]


def extreme(
    F: TrigPolynomial, S: TrigPolynomial, start: Array, better: Callable[[float, float], bool]
) -> Array:
    """Return a stationary point of F on S = 0 near `start` if it is better, else `start`."""
    x = stationary(F, S, start)
    on_set = abs(S(x)) <= NOISE * S.scale
    return x if on_set and better(F(x), F(start)) else start


def meeting(S: TrigPolynomial, F: TrigPolynomial, value: float, start: Array) -> Array | None:
    """Find a point near `start` with S = 0 and F = value, or None."""

    def equations(x: Array) -> tuple[Array, Array]:
        residual = np.array([S(x) / S.scale, (F(x) - value) / F.scale])
        return residual, np.array([S.gradient(x) / S.scale, F.gradient(x) / F.scale])

    x = iterate(equations, start, len(start), 0.3, rcond=1e-10)
    there = abs(S(x)) <= NOISE * S.scale and abs(F(x) - value) <= 1e-9 * F.scale
    return x if there else None


def polish(S: TrigPolynomial, points: Array) -> Array:
    """Move points (m, n) onto S = 0 along the gradient; steps that do not help are halved."""
    points = points.astype(np.float64)
    damping = np.ones(len(points))
    for _ in range(STEPS):
        values = S(points)
        off = np.flatnonzero(np.abs(values) > NOISE * S.scale / 10.0)
        if not len(off):
            break
        g = S.gradient(points[off])
        step = damping[off] * values[off] / np.maximum((g * g).sum(axis=1), 1e-300)
        moved = points[off] - np.clip(step[:, None] * g, -0.1, 0.1)
        better = np.abs(S(moved)) < np.abs(values[off])
        points[off[better]] = moved[better]
        damping[off] = np.where(better, 1.0, damping[off] / 2.0)
    return points
