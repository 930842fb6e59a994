"""The operations of tapes: each in NumPy, in C99, as an LLVM instruction, and its derivatives.

Sine and cosine are composed of other operations, within 1.1 units in the last place.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np


class Operation(NamedTuple):
    """An operation on numbers and masks.

    Attributes:
        numpy: The function of NumPy.
        c: Its text in C99, with {0}, {1}, ... for the operands.
        llvm: Its LLVM instruction, where {V} is the type of a number in all lanes and {M} that of
            a mask, or the name of a function of LLVM; empty for a function of <math.h>.
        pullback: Derivatives of something by the operands, of (its derivative by the value, value,
            *operands); None where they are zero wherever they exist.
        masks: How many of its operands, the first ones, are masks; all others are numbers.
        is_mask: Whether its values are true or false.
    """

    numpy: Any
    c: str
    llvm: str = ""
    pullback: Callable[..., tuple[Any, ...]] | None = None
    masks: int = 0
    is_mask: bool = False


def _chosen(first: Any, slope: Any) -> tuple[Any, Any]:
    """Return the derivatives by two operands, of which the first is chosen by a mask."""
    return np.where(first, slope, 0.0), np.where(first, 0.0, slope)


#: The operations by name; functions of <math.h> by the names that they have there.
OPERATIONS = {
    "add": Operation(np.add, "{0} + {1}", "fadd {V} {0}, {1}", lambda s, *_: (s, s)),
    "sub": Operation(np.subtract, "{0} - {1}", "fsub {V} {0}, {1}", lambda s, *_: (s, -s)),
    "mul": Operation(
        np.multiply, "{0} * {1}", "fmul {V} {0}, {1}", lambda s, _, a, b: (s * b, s * a)
    ),
    "div": Operation(
        np.divide, "{0} / {1}", "fdiv {V} {0}, {1}",
        lambda s, v, _, b: (share := s * np.divide(1.0, b), -(v * share)),
    ),
    "neg": Operation(np.negative, "-{0}", "fneg {V} {0}", lambda s, *_: (-s,)),
    "min": Operation(
        np.minimum, "{0} < {1} || {0} != {0} ? {0} : {1}", "@llvm.minimum",
        lambda s, _, a, b: _chosen(a < b, s),
    ),
    "max": Operation(
        np.maximum, "{0} > {1} || {0} != {0} ? {0} : {1}", "@llvm.maximum",
        lambda s, _, a, b: _chosen(b < a, s),
    ),
    "select": Operation(
        np.where, "{0} ? {1} : {2}", "select {M} {0}, {V} {1}, {V} {2}",
        lambda s, _, mask, *__: (0.0, *_chosen(mask, s)), masks=1,
    ),
    "hold": Operation(np.positive, "{0}", "freeze {V} {0}"),
    "lt": Operation(np.less, "{0} < {1}", "fcmp olt {V} {0}, {1}", is_mask=True),
    "le": Operation(np.less_equal, "{0} <= {1}", "fcmp ole {V} {0}, {1}", is_mask=True),
    "and": Operation(np.logical_and, "{0} && {1}", "and {M} {0}, {1}", masks=2, is_mask=True),
    "or": Operation(np.logical_or, "{0} || {1}", "or {M} {0}, {1}", masks=2, is_mask=True),
    "not": Operation(np.logical_not, "!{0}", "xor {M} {0}, {true}", masks=1, is_mask=True),
    "sqrt": Operation(np.sqrt, "sqrt({0})", "@llvm.sqrt", lambda s, v, _: (s * (0.5 / v),)),
    "abs": Operation(np.abs, "fabs({0})", "@llvm.fabs", lambda s, _, a: (s * np.sign(a),)),
    "rint": Operation(np.rint, "rint({0})", "@llvm.rint"),
    "floor": Operation(np.floor, "floor({0})", "@llvm.floor"),
    "ceil": Operation(np.ceil, "ceil({0})", "@llvm.ceil"),
    "sin": Operation(np.sin, "sin({0})", "", lambda s, _, a: (s * np.cos(a),)),
    "cos": Operation(np.cos, "cos({0})", "", lambda s, _, a: (s * -np.sin(a),)),
    "tan": Operation(np.tan, "tan({0})", "", lambda s, v, _: (s * (1.0 + v * v),)),
    "asin": Operation(np.arcsin, "asin({0})", "", lambda s, _, a: (s / np.sqrt(1.0 - a * a),)),
    "acos": Operation(np.arccos, "acos({0})", "", lambda s, _, a: (-s / np.sqrt(1.0 - a * a),)),
    "atan": Operation(np.arctan, "atan({0})", "", lambda s, _, a: (s / (1.0 + a * a),)),
    "sinh": Operation(np.sinh, "sinh({0})", "", lambda s, _, a: (s * np.cosh(a),)),
    "cosh": Operation(np.cosh, "cosh({0})", "", lambda s, _, a: (s * np.sinh(a),)),
    "tanh": Operation(np.tanh, "tanh({0})", "", lambda s, v, _: (s * (1.0 - v * v),)),
    "exp": Operation(np.exp, "exp({0})", "", lambda s, v, _: (s * v,)),
    "log": Operation(np.log, "log({0})", "", lambda s, _, a: (s / a,)),
    "atan2": Operation(
        np.arctan2, "atan2({0}, {1})", "",
        lambda s, _, a, b: (s * (b / (a * a + b * b)), s * (-a / (a * a + b * b))),
    ),
    "hypot": Operation(
        np.hypot, "hypot({0}, {1})", "", lambda s, v, a, b: (s * (a / v), s * (b / v))
    ),
    "pow": Operation(
        np.power, "pow({0}, {1})", "",
        lambda s, v, a, b: (s * (b * np.power(a, b - 1.0)), s * (v * np.log(a))),
    ),
}  # fmt: skip
MASKS = frozenset(name for name, operation in OPERATIONS.items() if operation.is_mask)


def folded(name: str, *operands: Any) -> Any:
    """Return an operation on numbers, as a number of Python."""
    with np.errstate(all="ignore"):
        return (bool if name in MASKS else float)(OPERATIONS[name].numpy(*operands))


#: Larger angles [rad], infinity and NaN are left to the system's library.
LARGE = 1e5
#: pi/2 in three parts, the first two of 33 bits, so that their products with whole numbers below
#: 2^20 are exact (Cody & Waite, Software Manual for the Elementary Functions, 1980).
HALF_PI = 1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21
#: (sin y - y) / y^3 by y^2 to |y| <= pi/4, highest power first (fdlibm, k_sin.c, Sun 1993).
SINE = (
    1.58969099521155010221e-10, -2.50507602534068634195e-08, 2.75573137070700676789e-06,
    -1.98412698298579493134e-04, 8.33333333332248946124e-03, -1.66666666666666324348e-01,
)  # fmt: skip
#: (cos y - 1 + y^2/2) / y^4 by y^2 (fdlibm, k_cos.c).
COSINE = (
    -1.13596475577881948265e-11, 2.08757232129817482790e-09, -2.75573143513906633035e-07,
    2.48015872894767294178e-05, -1.38888888888741095749e-03, 4.16666666666666019037e-02,
)  # fmt: skip


def sine_cosine(x: Any) -> tuple[Any, Any, Any]:
    """Return sine and cosine of an angle, and whether it is too large for this.

    The angle is y + k pi/2, |y| <= pi/4; each half turn changes both signs.
    """
    k = np.rint(x * (2.0 / np.pi))
    y = x
    for part in HALF_PI:
        y = y - k * part
    z = y * y
    s = y + y * z * np.polyval(SINE, z)
    half = 0.5 * z
    near = 1.0 - half
    lost = (1.0 - near) - half  # by rounding
    c = near + (lost + z * z * np.polyval(COSINE, z))
    half_turns = np.floor(0.5 * k)
    odd = half_turns < 0.5 * k
    sign = np.where(np.floor(0.5 * half_turns) < 0.5 * half_turns, -1.0, 1.0)
    sine, cosine = np.where(odd, c, s) * sign, np.where(odd, -s, c) * sign
    size = np.abs(x)
    return np.where(size <= 0.0, x, sine), cosine, ~(size <= LARGE)
