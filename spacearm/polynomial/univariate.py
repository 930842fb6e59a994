"""Real roots of trigonometric polynomials of one angle, many at once.

f(q) = sum_k c_k exp(i k q), |k| <= d, is z^-d times a polynomial of degree 2d in z = exp(i q); its
real roots are the roots of that polynomial on the unit circle. Degree 1 has them in closed form.
Many polynomials of higher degree are solved by Aberth's iteration. Few, and those for which that
is not sure, are solved by the eigenvalues of the companion matrix, polished by Newton's method on
f itself.

O. Aberth, Math. Comput. 27, 339-344 (1973), DOI 10.1090/S0025-5718-1973-0329236-7. Newton's step of
each root is corrected for the others, which repel it; simple roots are approached cubically. Where
the iteration does not end, or the sum of what it found is not that of the roots, it says so.
"""

from __future__ import annotations

from collections import Counter
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, Integers, named
from spacearm.compiler import numbers

#: Multiple roots split off the unit circle by a root of rounding, less than this; the value of f
#: then decides.
NEAR_CIRCLE = 1e-2
#: Newton steps for every root.
POLISH = 8
#: Longest of these steps [rad].
LONGEST = 0.1
#: Share of the scale below which a value is zero.
ZERO = 1e-12
#: Bound of the iteration.
MOST = 60
#: Size of the steps, as a share of the root, with which it ends.
SETTLED = 1e-8
#: Share of the sizes of the roots by which their sum may be wrong.
SUM = 1e-5


def circle_roots(xp: Any, d: int, line: Any) -> tuple[Any, Any]:
    """Find the real roots of c + sum_k a_k cos k q + b_k sin k q, k = 1 ... d.

    Args:
        xp: The array library.
        d: The degree.
        line: (2 d + 1,) c, a_1 ... a_d, b_1 ... b_d; the last a and b are not both zero.

    Returns:
        (2 d,) angles in (-pi, pi], NaN where there are fewer, and 1 if they are sure, else 0.
    """
    x, y, sure = _all_roots(xp, d, line)
    return _polished(xp, d, line, x, y), sure


def _polished(xp: Any, d: int, line: Any, x: Any, y: Any) -> Any:
    """Return the angles (2 d,) of the roots x + i y that lie on the unit circle, NaN of others."""
    squares, angles = x * x + y * y, xp.arctan2(y, x)
    near = xp.logical_and(squares > np.exp(-2.0 * NEAR_CIRCLE), squares < np.exp(2.0 * NEAR_CIRCLE))
    values, slopes = _values(xp, d, line, angles)

    def polish(angles: Any, values: Any, slopes: Any) -> tuple[Any, ...]:
        step = xp.where(slopes * slopes > 0.0, values / slopes, 0.0)
        tried = angles - xp.minimum(xp.maximum(step, -LONGEST), LONGEST)
        new, new_slopes = _values(xp, d, line, tried)
        better = xp.logical_and(near, xp.absolute(new) < xp.absolute(values))
        goes_on = xp.where(better, 1.0, 0.0).sum() > 0.0
        return (
            xp.where(better, tried, angles), xp.where(better, new, values),
            xp.where(better, new_slopes, slopes), goes_on,
        )  # fmt: skip

    angles, values, _ = xp.while_any(polish, angles, values, slopes, most=POLISH)
    scale = xp.absolute(line[0])
    for k in range(1, d + 1):
        scale = xp.maximum(scale, 0.5 * xp.hypot(line[k], line[d + k]))
    real = xp.logical_and(near, xp.absolute(values) <= ZERO * scale)
    return xp.where(real, angles, np.nan)


def _all_roots(xp: Any, d: int, line: Any) -> tuple[Any, Any, Any]:
    """Find the roots (2 d,) in z = exp(i q), their real and imaginary parts; and 1 if sure."""
    half = 0.5 * line
    a, b = half[1 : d + 1], half[d + 1 :]
    real = xp.concatenate([a[::-1], line[:1], a])
    imaginary = xp.concatenate([b[::-1], np.zeros(1), -b])
    size = real[-1] * real[-1] + imaginary[-1] * imaginary[-1]
    c = [
        ((r * real[-1] + i * imaginary[-1]) / size, (i * real[-1] - r * imaginary[-1]) / size)
        for r, i in zip(real, imaginary, strict=True)
    ]
    n = 2 * d
    others = ~np.eye(n, dtype=bool)
    turns = (np.arange(n) + 0.3) * (2.0 * np.pi / n)
    radii = 1.0 + 0.3 * np.sin(5.0 * np.arange(n) + 1.0)  # off the circle, and not in pairs

    def step(x: Any, y: Any, _: Any) -> tuple[Any, ...]:
        p, q = x + c[n - 1][0], y + c[n - 1][1]
        s, t = xp.stack([1.0] * n), xp.stack([0.0] * n)
        for k in range(n - 2, -1, -1):  # Horner, with the derivative
            s, t = s * x - t * y + p, s * y + t * x + q
            p, q = p * x - q * y + c[k][0], p * y + q * x + c[k][1]
        dx, dy = x[:, None] - x, y[:, None] - y
        inverse = np.where(others, 1.0, 0.0) / (dx * dx + dy * dy + np.eye(n))
        u, v = (dx * inverse).sum(axis=1), -(dy * inverse).sum(axis=1)
        s, t = s - (p * u - q * v), t - (p * v + q * u)
        size = s * s + t * t
        inverse = xp.where(size > 0.0, 1.0 / size, 0.0)
        wx, wy = (p * s + q * t) * inverse, (q * s - p * t) * inverse
        moves = wx * wx + wy * wy > SETTLED**2 * (x * x + y * y)
        left = xp.where(moves, 1.0, 0.0).sum()
        return x - wx, y - wy, left, left > 0.0

    x, y, left = xp.while_any(step, radii * np.cos(turns), radii * np.sin(turns), 1.0, most=MOST)
    sizes = xp.sqrt(x * x + y * y).sum()
    off = xp.hypot(x.sum() + c[n - 1][0], y.sum() + c[n - 1][1])
    sure = xp.logical_and(left < 0.5, off < SUM * sizes)
    return x, y, xp.where(sure, 1.0, 0.0)


def _values(xp: Any, d: int, line: Any, angles: Any) -> tuple[Any, Any]:
    """Return values and slopes at angles."""
    cosine, sine = xp.cos(angles), xp.sin(angles)
    c, s = cosine, sine
    values, slopes = line[0] + 0.0 * c, 0.0 * c
    for k in range(1, d + 1):
        values = values + (line[k] * c + line[d + k] * s)
        slopes = slopes + k * (line[d + k] * c - line[k] * s)
        c, s = cosine * c - sine * s, sine * c + cosine * s
    return values, slopes


@lru_cache(maxsize=16)
def compiled_roots(d: int) -> Any:
    """Return `circle_roots` as machine code."""
    from spacearm.compiler import symbols
    from spacearm.compiler.kernel import compiled

    return compiled(lambda line: circle_roots(symbols, d, line), {"line": (2 * d + 1,)})


Complex: TypeAlias = npt.NDArray[np.complexfloating[Any, Any]]

#: Roots nearer than this are one root with a multiplicity [rad].
SAME = 1e-6
#: Lines of a degree at which the iteration is compiled.
MANY = 2000

_lines: Counter[int] = Counter()  # solved so far, by degree


class Roots(NamedTuple):
    """Real roots along one joint.

    Attributes:
        angles: (r,) roots in (-pi, pi], growing [rad].
        multiplicity: (r,) their multiplicities.
        everywhere: Whether the polynomial vanishes along the whole line.
    """

    angles: Array
    multiplicity: Integers
    everywhere: bool

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data."""
        return named(self)


def orders(degree: int) -> Array:
    """Return the orders k = -d ... d."""
    return np.arange(-degree, degree + 1).astype(np.float64)


def distinct(angles: Array) -> tuple[Array, Integers]:
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
    d = lines.shape[1] // 2
    z = 2.0 * lines[:, d + 1 :]
    return real_roots(np.concatenate((lines[:, d : d + 1].real, z.real, -z.imag), axis=1).T).T


def real_roots(rows: Array) -> Array:
    """Find the real roots (2 d, m), as `line_roots`, of sums of real waves (2 d + 1, m).

    The rows are the factors of 1, cos q, ..., cos d q, sin q, ..., sin d q.
    """
    d, m = len(rows) // 2, rows.shape[1]
    if d == 0 or m == 0:
        return np.full((2 * d, m), np.nan)
    if d == 1:
        return _first_degree_roots(*rows)
    sizes = 0.5 * np.hypot(rows[1 : d + 1], rows[d + 1 :])
    lower = sizes[-1] <= 1e-13 * np.maximum(np.abs(rows[0]), sizes.max(axis=0))
    found = np.full((2 * d, m), np.nan)
    if lower.any():  # of lower degree on these lines
        found[:-2, lower] = real_roots(np.delete(rows[:, lower], (d, 2 * d), axis=0))
    _lines[d] += m
    found[:, ~lower] = (_iterated if _lines[d] > MANY else _by_eigenvalues)(rows[:, ~lower])
    return found


def _iterated(rows: Array) -> Array:
    """Find the roots (2 d, m) by Aberth's iteration."""
    found, sure = compiled_roots(len(rows) // 2)({"line": rows.T})
    doubtful = sure == 0.0
    found[doubtful] = _by_eigenvalues(rows[:, doubtful]).T
    return wrap(found.T)


def _by_eigenvalues(rows: Array) -> Array:
    """Find the roots (2 d, m) by the companion matrix."""
    d, m = len(rows) // 2, rows.shape[1]
    z = 0.5 * (rows[1 : d + 1] - 1j * rows[d + 1 :])
    monic = np.concatenate((np.conj(z[::-1]), rows[:1], z[:-1])) / z[-1]
    companion = np.zeros((m, 2 * d, 2 * d), dtype=complex)
    companion[:, np.arange(1, 2 * d), np.arange(2 * d - 1)] = 1.0
    companion[:, :, -1] = -monic.T
    roots = np.linalg.eigvals(companion).T
    with np.errstate(divide="ignore", invalid="ignore"):
        return wrap(_polished(numbers, d, rows, roots.real, roots.imag))


def _first_degree_roots(c: Array, a: Array, b: Array) -> Array:
    """Solve a cos q + b sin q + c = 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = -c / np.hypot(a, b)
        touching = np.abs(np.abs(cosine) - 1.0) < 4e-16
        spread = np.arccos(np.where(touching, np.sign(cosine), cosine))
    middle = np.arctan2(b, a)
    return wrap(np.stack((middle - spread, middle + spread)))


def wrap(angles: Array) -> Array:
    """Wrap angles to (-pi, pi]."""
    return np.pi - (np.pi - angles) % (2.0 * np.pi)
