"""Newton's method on trigonometric polynomials: roots, common roots, constrained extremes.

A point where F is stationary on S = 0 solves the Newton-Lagrange equations

    grad F + lambda grad S = 0,   S = 0

for the point and the multiplier lambda. Steps are limited in length; where the equations leave a
step undetermined, the shortest one is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy

from spacearm.arrays import Array
from spacearm.polynomial.jets import Jets, Pointwise, stacked
from spacearm.polynomial.trig import NOISE, TrigPolynomial

#: Largest number of steps.
STEPS = 60
#: Length of the step after which the iteration ends [rad].
CONVERGED = 1e-14
#: Largest number of Gauss-Newton steps onto common roots; the longest of them [rad].
ONTO_STEPS, ONTO_STRIDE = 30, 0.05
#: Longest step towards a stationary point [rad].
STRIDE = 0.1
#: Largest joint motion of one run of an optimisation [rad].
SHORT = 0.4
#: Largest number of runs.
MOST_WAYS = 60
#: Distance from its limit below which a joint counts as at the limit [rad].
AT_LIMIT = 1e-7


#: Longest component of a step that is scaled: squares of longer ones may overflow.
LONGEST_STEP = 1e100


def shortened(step: Array, stride: float) -> Array:
    """Scale steps (..., n) down to the length `stride` where they are longer.

    Steps that are not finite, as those of slopes that vanish, become zero.
    """
    finite = np.isfinite(step).all(axis=-1, keepdims=True)
    step = np.clip(np.where(finite, step, 0.0), -LONGEST_STEP, LONGEST_STEP)
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


def stationary(F: Pointwise, constraints: Sequence[Pointwise], start: Array) -> Array:
    """Find a point near `start` where F is stationary on common roots, or on all of space."""
    n = len(start)

    def equations(y: Array) -> tuple[Array, Array]:
        x, multipliers = y[:n], y[n:]
        G = np.array([S.gradient(x) for S in constraints]).reshape(-1, n)
        residual = np.append(F.gradient(x) + multipliers @ G, [S(x) for S in constraints])
        H = F.hessian(x)
        for multiplier, S in zip(multipliers, constraints, strict=True):
            H = H + multiplier * S.hessian(x)
        return residual, np.block([[H, G.T], [G, np.zeros((len(G), len(G)))]])

    G = np.array([S.gradient(start) for S in constraints]).reshape(-1, n)
    multipliers = np.linalg.lstsq(G.T, -F.gradient(start), rcond=None)[0]
    return iterate(equations, np.append(start, multipliers), n, STRIDE)[:n]


def bounded_extreme(
    F: TrigPolynomial,
    equations: Sequence[TrigPolynomial],
    start: Array,
    sign: float,
    box: tuple[Array, Array] | None = None,
) -> Array:
    """Minimise sign * F on common roots near `start`, which is returned if no better.

    A box (lower, upper corner) bounds the roots.

    Sequential quadratic programming finds the active limits, in short runs so that it stays on its
    piece of the set. Newton's method on the free joints then gives all digits.
    """
    objective, on_roots = Pointwise(F), [Pointwise(S, S.scale) for S in equations]
    on_set: Any = [{"type": "eq", "fun": S, "jac": S.gradient} for S in on_roots]
    search: Any = scipy.optimize.minimize  # its stubs are for functions of float64 only
    options, x = {"maxiter": 50, "ftol": 1e-12 * F.scale}, start
    least, most = box if box else (np.full(len(x), -np.inf), np.full(len(x), np.inf))
    for _ in range(MOST_WAYS):
        low, high = np.maximum(x - SHORT, least), np.minimum(x + SHORT, most)
        result = search(
            lambda q: sign * objective(q),
            x,
            jac=lambda q: sign * objective.gradient(q),
            bounds=list(zip(low, high, strict=True)),
            constraints=on_set,
            method="SLSQP",
            options=options,
        )
        moved, x = result.x - x, np.clip(result.x, low, high)
        if np.abs(moved).max() < 0.999 * SHORT:
            break
    on_least, on_most = x - least < AT_LIMIT, most - x < AT_LIMIT
    held, x = on_least | on_most, np.where(on_least, least, np.where(on_most, most, x))
    if not held.all():
        fixed = {int(j): float(x[j]) for j in np.flatnonzero(held)}
        free = [objective, *on_roots]
        if fixed:
            free = [Pointwise(F.fix(fixed)), *(Pointwise(S.fix(fixed), S.scale) for S in equations)]
        x[~held] = stationary(free[0], free[1:], x[~held])
    if ((x < least - 1e-12) | (x > most + 1e-12)).any():
        return start
    sound = all(abs(S(x)) <= NOISE for S in on_roots)
    return x if sound and sign * F(x) <= sign * F(start) else start


def meeting(
    constraints: Sequence[TrigPolynomial], F: TrigPolynomial, value: float, start: Array
) -> Array | None:
    """Find a common root of the constraints near `start` at which F = value, or None."""

    def equations(x: Array) -> tuple[Array, Array]:
        residual = [*(S(x) / S.scale for S in constraints), (F(x) - value) / F.scale]
        slopes = [*(S.gradient(x) / S.scale for S in constraints), F.gradient(x) / F.scale]
        return np.array(residual), np.array(slopes)

    x = iterate(equations, start, len(start), 0.3, rcond=1e-10)
    on_set = all(abs(S(x)) <= NOISE * S.scale for S in constraints)
    return x if on_set and abs(F(x) - value) <= 1e-9 * F.scale else None


def polish(S: TrigPolynomial, points: Array) -> Array:
    """Move points (m, n) onto S = 0 along the gradient; steps that do not help are halved."""
    points = points.astype(np.float64)
    damping = np.ones(len(points))
    values = S(points)
    for _ in range(STEPS):
        off = np.flatnonzero(np.abs(values) > NOISE * S.scale / 10.0)
        if not len(off):
            break
        g = S.gradient(points[off])
        step = damping[off] * values[off] / np.maximum((g * g).sum(axis=1), 1e-300)
        moved = points[off] - np.clip(step[:, None] * g, -0.1, 0.1)
        there = S(moved)
        better = np.abs(there) < np.abs(values[off])
        points[off[better]] = moved[better]
        values[off[better]] = there[better]
        damping[off] = np.where(better, 1.0, damping[off] / 2.0)
    return points


def onto(polynomials: Sequence[TrigPolynomial], points: Array) -> Array:
    """Move points (m, n) onto the common roots by the Gauss-Newton method."""
    scaled = [Jets.of(f) for f in polynomials]
    for _ in range(ONTO_STEPS):
        values, G = stacked(scaled, points, 1)[:2]
        step = -(np.linalg.pinv(G, rcond=1e-9) @ values[:, :, None])[:, :, 0]
        points = points + shortened(step, ONTO_STRIDE)
        if np.abs(step).max(initial=0.0) < 1e-14:
            break
    return points
