"""Building blocks of the kernels: compiler settings, small vectors, sine and cosine.

Kernels for many configurations work on lanes, those for one on `read` and `put` vectors.

numba from PyPI comes without Intel's SVML, so that calls of math.sin do not vectorise. The sine and
cosine here do.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, TypeAlias

import numba
import numpy as np
import numpy.typing as npt
from numba.extending import intrinsic

from spacearm.kernels.kept import SECONDS, keep

cgutils: Any = import_module("numba.core.cgutils")
types: Any = import_module("numba.core.types")
inline: Any = intrinsic  # typed in part only

LANES = 32
"""Configurations computed side by side: they fill vector registers and fit the first cache."""

Lanes = npt.NDArray[np.float64]
"""Work array; its last index counts the lanes."""

Record: TypeAlias = Any
"""One element of an array of records, its fields read as attributes."""

Vector = tuple[float, float, float]
Rows = tuple[Vector, Vector, Vector]
"""A matrix (3, 3)."""
Six = tuple[float, float, float, float, float, float]
"""A symmetric one: xx, xy, xz, yy, yz, zz."""


def record(*fields: tuple[str, Any] | tuple[str, Any, Any]) -> np.dtype[np.void]:
    """Return the type of records with these fields."""
    return np.dtype((np.record, np.dtype(list(fields), align=True)))


def compiler(*, cache: bool = False, said: str = SECONDS, **options: Any) -> Any:
    """Return the decorator that compiles a function; with `cache` what it compiles is kept.

    What is `said` before it compiles: see `kept.keep`.
    """
    compiled: Any = numba.njit(**options)
    return (lambda function: keep(compiled(function), said)) if cache else compiled


SETTINGS: dict[str, Any] = {
    "error_model": "numpy",  # a division by zero gives infinity, without a branch
    "fastmath": {"contract"},  # a * b + c may be rounded once; nothing else is rearranged
    "nogil": True,
}

step = compiler(**SETTINGS, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""A step of a kernel, compiled into the function that calls it."""

part = compiler(**SETTINGS, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""A part of a kernel, compiled once and called by others."""

merged = compiler(**SETTINGS, inline="always", no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Most of a kernel, copied into it before it is compiled: large steps are not optimised twice."""


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


@step
def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@step
def minus(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@step
def times(s: float, a: Vector) -> Vector:
    """Return s a."""
    return (s * a[0], s * a[1], s * a[2])


@step
def turn(R: Rows, a: Vector) -> Vector:
    """Return R a."""
    return (dot(R[0], a), dot(R[1], a), dot(R[2], a))


@step
def turn_back(R: Rows, a: Vector) -> Vector:
    """Return R^T a."""
    return (
        R[0][0] * a[0] + R[1][0] * a[1] + R[2][0] * a[2],
        R[0][1] * a[0] + R[1][1] * a[1] + R[2][1] * a[2],
        R[0][2] * a[0] + R[1][2] * a[1] + R[2][2] * a[2],
    )


@step
def symmetric(D: Six, a: Vector) -> Vector:
    """Return D a."""
    return (
        D[0] * a[0] + D[1] * a[1] + D[2] * a[2],
        D[1] * a[0] + D[3] * a[1] + D[4] * a[2],
        D[2] * a[0] + D[4] * a[1] + D[5] * a[2],
    )


def _numbers(builder: Any, context: Any, kind: Any, array: Any, count: int) -> list[Any]:
    """Return pointers to the first numbers of an array."""
    data = context.make_array(kind)(context, builder, array).data
    return [cgutils.gep_inbounds(builder, data, i) for i in range(count)]


def _reads(*shape: int) -> Any:
    """Return the compiled function that reads the first numbers of an array as a tuple."""
    kind: Any = types.float64
    for count in reversed(shape):
        kind = types.UniTuple(kind, count)

    @inline
    def read(_: Any, array: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            count = int(np.prod(shape))
            at = _numbers(builder, context, signature.args[0], values[0], count)
            found = [builder.load(pointer) for pointer in at]
            if len(shape) == 1:
                return context.make_tuple(builder, kind, found)
            rows = [context.make_tuple(builder, kind.dtype, found[i : i + shape[1]])
                    for i in range(0, count, shape[1])]  # fmt: skip
            return context.make_tuple(builder, kind, rows)

        return kind(array), code

    return read


read = _reads(3)
"""Return three numbers of an array."""
read_rows = _reads(3, 3)
"""Return the rows of an array (3, 3)."""
read_six = _reads(6)
"""Return six numbers of an array."""


@inline
def put(_: Any, array: Any, numbers: Any) -> Any:
    """Write a tuple to an array."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        at = _numbers(builder, context, signature.args[0], values[0], numbers.count)
        for i, pointer in enumerate(at):
            builder.store(builder.extract_value(values[1], i), pointer)
        return context.get_dummy_value()

    return types.void(array, numbers), code


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
