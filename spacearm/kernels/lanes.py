"""Building blocks of the kernels: compiler settings, small vectors, sine and cosine.

numba from PyPI comes without Intel's SVML, so that calls of math.sin do not vectorise. The sine and
cosine here do.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numba
import numpy as np
import numpy.typing as npt

from spacearm.kernels.kept import keep

LANES = 32
"""Configurations computed side by side: they fill vector registers and fit the first cache."""

Lanes = npt.NDArray[np.float64]
"""Work array; its last index counts the lanes."""

Record: TypeAlias = Any
"""One element of an array of records, its fields read as attributes."""

Vector = tuple[float, float, float]


def record(*fields: tuple[str, Any] | tuple[str, Any, Any]) -> np.dtype[np.void]:
    """Return the type of records with these fields."""
    return np.dtype((np.record, np.dtype(list(fields), align=True)))


def compiler(*, cache: bool = False, **options: Any) -> Any:
    """Return the decorator that compiles a function; with `cache` what it compiles is kept."""
    compiled: Any = numba.njit(**options)
    return (lambda function: keep(compiled(function))) if cache else compiled


SETTINGS: dict[str, Any] = {
    "error_model": "numpy",  # a division by zero gives infinity, without a branch
    "fastmath": {"contract"},  # a * b + c may be rounded once; nothing else is rearranged
    "nogil": True,
}

step = compiler(**SETTINGS, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""A step of a kernel, compiled into the function that calls it."""


@step
def dot(a: Vector, b: Vector) -> float:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@step
def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@step
def vector(x: Lanes, l: int) -> Vector:
    """Return lane l of x (3, lanes)."""
    return (x[0, l], x[1, l], x[2, l])


ROUND = 1.5 * 2.0**52
"""Adding and subtracting this number rounds to the nearest integer."""

LARGEST_ANGLE = 1e5
"""Largest angle [rad] at which `sine_cosine` is accurate to one unit in the last place."""


@step
def sine_cosine(q: Lanes, s: Lanes, c: Lanes) -> None:
    """Compute s = sin q, c = cos q for |q| <= LARGEST_ANGLE, in a form that vectorises.

    Reduction to |y| <= pi/4 with pi/2 in three parts (Cody & Waite, 1980), then the minimax
    polynomials of Sun's fdlibm.
    """
    for l in range(q.shape[0]):
        k = (q[l] * 0.6366197723675814 + ROUND) - ROUND
        y = q[l] - k * 1.57079632673412561417e00
        y = (y - k * 6.07710050630396597660e-11) - k * 2.02226624879595063154e-21
        z = y * y
        p = 2.75573137070700676789e-06 + z * (
            -2.50507602534068634195e-08 + z * 1.58969099521155e-10
        )
        p = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * p)
        sin_y = y + y * z * (-1.66666666666666324348e-01 + z * p)
        p = -2.75573143513906633035e-07 + z * (2.08757232129817e-09 + z * -1.13596475577881948e-11)
        p = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * p)
        cos_y = 1.0 - 0.5 * z + z * z * (4.16666666666666019037e-02 + z * p)
        quadrant = k - 4.0 * ((0.25 * k + ROUND) - ROUND)  # -2, -1, 0, 1 or 2
        odd = abs(quadrant) == 1.0
        sine = cos_y if odd else sin_y
        cosine = sin_y if odd else cos_y
        s[l] = -sine if abs(quadrant) == 2.0 or quadrant == -1.0 else sine
        c[l] = -cosine if abs(quadrant) == 2.0 or quadrant == 1.0 else cosine
