"""The operations of tapes: what they are in NumPy, in C, in machine code, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np


class Function(NamedTuple):
    """A function of one or two numbers.

    Attributes:
        numpy: The same in NumPy.
        c: Its name in <math.h>; empty if it has none.
        slopes: Its derivatives by its operands, of (operation, value, *operands); None where they
            are zero wherever they exist.
        ufunc: The name of the method that NumPy calls for arrays of objects, if it is another.
    """

    numpy: Callable[..., Any]
    c: str
    slopes: Callable[..., tuple[Any, ...]] | None
    ufunc: str | None = None


FUNCTIONS: dict[str, Function] = {
    "sin": Function(np.sin, "sin", lambda o, _v, a: (o("cos", a),)),
    "cos": Function(np.cos, "cos", lambda o, _v, a: (-o("sin", a),)),
    "tan": Function(np.tan, "tan", lambda _o, v, _a: (1.0 + v * v,)),
    "asin": Function(np.arcsin, "asin", lambda o, _v, a: (1.0 / o("sqrt", 1.0 - a * a),), "arcsin"),
    "acos": Function(
        np.arccos, "acos", lambda o, _v, a: (-1.0 / o("sqrt", 1.0 - a * a),), "arccos"
    ),
    "atan": Function(np.arctan, "atan", lambda _o, _v, a: (1.0 / (1.0 + a * a),), "arctan"),
    "sinh": Function(np.sinh, "sinh", lambda o, _v, a: (o("cosh", a),)),
    "cosh": Function(np.cosh, "cosh", lambda o, _v, a: (o("sinh", a),)),
    "tanh": Function(np.tanh, "tanh", lambda _o, v, _a: (1.0 - v * v,)),
    "exp": Function(np.exp, "exp", lambda _o, v, _a: (v,)),
    "log": Function(np.log, "log", lambda _o, _v, a: (1.0 / a,)),
    "sqrt": Function(np.sqrt, "sqrt", lambda _o, v, _a: (0.5 / v,)),
    "abs": Function(np.abs, "fabs", lambda o, _v, a: (o("sign", a),), "__abs__"),
    "sign": Function(np.sign, "", None),
    "rint": Function(np.rint, "rint", None),
    "floor": Function(np.floor, "floor", None),
    "ceil": Function(np.ceil, "ceil", None),
    "atan2": Function(
        np.arctan2,
        "atan2",
        lambda _o, _v, a, b: (b / (a * a + b * b), -a / (a * a + b * b)),
        "arctan2",
    ),
    "hypot": Function(np.hypot, "hypot", lambda _o, v, a, b: (a / v, b / v)),
    "pow": Function(
        np.power, "pow", lambda o, v, a, b: (b * o("pow", a, b - 1.0), v * o("log", a)), "__pow__"
    ),
}
"""Functions of numbers, in the order and by the names of <math.h>."""

SIGNS = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
"""The operations of arithmetic, and their signs in C."""

NUMBERS: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "min": np.minimum,
    "max": np.maximum,
    "select": np.where,
    **{name: function.numpy for name, function in FUNCTIONS.items()},
}
"""Operations whose values are numbers, in NumPy."""

MASKS: dict[str, Callable[..., Any]] = {
    "lt": np.less,
    "le": np.less_equal,
    "and": np.logical_and,
    "or": np.logical_or,
    "not": np.logical_not,
}
"""Operations whose values are true or false, in NumPy."""

OPERATIONS = {**NUMBERS, **MASKS}
"""All operations, in NumPy."""

LOGIC = {"and": 2, "or": 2, "not": 1, "select": 1}
"""How many of their operands, the first ones, are masks; all others are numbers."""


def folded(name: str, *operands: Any) -> Any:
    """Return an operation on numbers, as a number of Python."""
    with np.errstate(all="ignore"):
        return (bool if name in MASKS else float)(OPERATIONS[name](*operands))
