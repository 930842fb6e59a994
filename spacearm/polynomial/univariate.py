"""Real roots of trigonometric polynomials of one angle, many at once.

f(q) = sum_k c_k exp(i k q), |k| <= d, is z^-d times a polynomial of degree 2d in z = exp(i q); its
real roots are the roots of that polynomial on the unit circle. Degree 1 has them in closed form,
higher ones as eigenvalues of the companion matrix, polished by Newton's method on f itself.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, named

Complex: TypeAlias = npt.NDArray[np.complexfloating[Any, Any]]

SAME = 1e-6
"""Roots nearer than this are one root with a multiplicity [rad]."""
NEAR_CIRCLE = 1e-2
"""Multiple roots split off the unit circle by a root of rounding, less than this; the value of f
then decides."""
POLISH = 8
"""Newton steps for every root."""


class Roots(NamedTuple):
    """Real roots along one joint.

    Attributes:
        angles: (r,) roots in (-pi, pi], growing [rad].
        multiplicity: (r,) their multiplicities.
        everywhere: Whether the polynomial vanishes along the whole line.
    """

    angles: Array
    multiplicity: npt.NDArray[np.int_]
    everywhere: bool

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data."""
        return named(self)


def orders(degree: int) -> Array:
    """Return the orders k = -d ... d."""
    return np.arange(-degree, degree + 1).astype(np.float64)


def distinct(angles: Array) -> tuple[Array, npt.NDArray[np.int_]]:
    """Return distinct angles, in growing order, with multiplicities; NaN is left out."""
    angles = np.sort(angles[~np.isnan(angles)])
    if not len(angles):
        return angles, np.empty(0, dtype=np.int_)
    gap_before = np.diff(angles, prepend=angles[-1] - 2.0 * np.pi)
    starts = np.flatnonzero(gap_before > SAME)
    if not len(starts):
        return angles[:1], np.array([len(angles)])
    sizes = np.diff(starts, append=starts[0] + len(angles))
    return angles[starts], sizes


def line_roots(lines: Complex) -> Array:
    """Find the real roots (m, 2 d) of polynomials (m, 2 d + 1); NaN where there are fewer."""
    m, size = lines.shape
    d = size // 2
    if d == 0 or m == 0:
        return np.full((m, 2 * d), np.nan)
    if d == 1:
        c, z = lines[:, 1].real, 2.0 * lines[:, 2]
        return _first_degree_roots(c, z.real, -z.imag).T
    found = np.full((m, 2 * d), np.nan)
    scale = np.abs(lines).max(axis=1)
    usable = np.abs(lines[:, -1]) > 1e-13 * scale
    for row in np.flatnonzero(~usable):  # of lower degree on this line
        inner = lines[row, 1:-1][None]
        found[row, : 2 * d - 2] = line_roots(inner)[0] if scale[row] > 0.0 else np.nan
    if not usable.any():
        return found
    monic = lines[usable, :-1] / lines[usable, -1:]
    companion = np.zeros((len(monic), 2 * d, 2 * d), dtype=complex)
    companion[:, np.arange(1, 2 * d), np.arange(2 * d - 1)] = 1.0
    companion[:, :, -1] = -monic
    z = np.linalg.eigvals(companion).astype(complex)
    line, column = np.nonzero(np.abs(np.log(np.maximum(np.abs(z), 1e-300))) < NEAR_CIRCLE)
    near = np.flatnonzero(usable)[line]
    angles, values = _polish(lines[near], np.angle(z[line, column])[:, None])
    real = np.abs(values) <= 1e-12 * scale[near, None]
    found[near, column] = np.where(real, wrap(angles), np.nan)[:, 0]
    return found


def real_roots(rows: Array) -> Array:
    """Find the real roots (2 d, m), as `line_roots`, of sums of real waves (2 d + 1, m).

    The rows are the factors of 1, cos q, ..., cos d q, sin q, ..., sin d q.
    """
    d = len(rows) // 2
    if d == 1:
        return _first_degree_roots(*rows)
    lines = np.empty((rows.shape[1], 2 * d + 1), dtype=complex)
    lines[:, d] = rows[0]
    lines[:, d + 1 :] = 0.5 * (rows[1 : d + 1] - 1j * rows[d + 1 :]).T
    lines[:, :d] = np.conj(lines[:, :d:-1])
    return line_roots(lines).T


def _first_degree_roots(c: Array, a: Array, b: Array) -> Array:
    """Solve a cos q + b sin q + c = 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = -c / np.hypot(a, b)
        touching = np.abs(np.abs(cosine) - 1.0) < 4e-16
        spread = np.arccos(np.where(touching, np.sign(cosine), cosine))
    middle = np.arctan2(b, a)
    return wrap(np.stack((middle - spread, middle + spread)))


def _polish(lines: Complex, angles: Array) -> tuple[Array, Array]:
    """Take Newton steps where they make the value smaller; return angles and values."""
    values, slopes = line_values(lines, angles)
    for _ in range(POLISH):
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(slopes != 0.0, values / slopes, 0.0)
        tried = angles - np.clip(step, -0.1, 0.1)
        new, new_slopes = line_values(lines, tried)
        better = np.abs(new) < np.abs(values)
        if not better.any():
            break
        angles = np.where(better, tried, angles)
        values, slopes = np.where(better, new, values), np.where(better, new_slopes, slopes)
    return angles, values


def line_values(lines: Complex, angles: Array) -> tuple[Array, Array]:
    """Evaluate polynomials (m, 2 d + 1) at angles (m, r): values and slopes, (m, r) each."""
    k = orders(lines.shape[1] // 2)
    waves = lines[:, None, :] * np.exp(1j * angles[:, :, None] * k)
    return waves.sum(axis=2).real, (waves * (1j * k)).sum(axis=2).real


def wrap(angles: Array) -> Array:
    """Wrap angles to (-pi, pi]."""
    return np.pi - (np.pi - angles) % (2.0 * np.pi)
