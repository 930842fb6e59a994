"""Users' functions run over symbols, as they were written for NumPy and the module math."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from types import CellType, FunctionType, MethodType
from typing import Any

import numpy as np

from spacearm.compiler.expressions import Expression, asarray, is_symbolic, plain

#: Functions of NumPy that make arrays, which may be filled with symbols.
MADE = ("zeros", "ones", "empty", "full", "zeros_like", "ones_like", "empty_like", "full_like")
#: Modules whose functions keep nothing, and are run as they are.
LIBRARIES = ("numpy", "math", "scipy", "pinocchio", "spacearm")


def over_symbols(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function as it can be run over symbols.

    In it, in the functions that it was made in or calls by name, and in methods, `numpy` and `math`
    are replaced: arrays of numbers and symbols are made, filled and computed with as those of
    numbers are. The function itself is not changed. What branches on values raises `TracingError`.
    """
    return _seen(function, {})


class _Numpy:
    """NumPy, with arrays of symbols."""

    def __getattr__(self, name: str) -> Any:
        found = getattr(np, name)
        if name in MADE:
            return lambda *arguments, **options: _made(found, *arguments, **options)
        return found

    def array(self, values: Any, *arguments: Any, **options: Any) -> Any:
        """Return an array of numbers or symbols; a type is that of numbers only."""
        found = asarray(values) if is_symbolic(values) else np.array(values, *arguments, **options)
        return found.copy()

    def asarray(self, values: Any, *arguments: Any, **options: Any) -> Any:
        """Return values as an array of numbers or symbols."""
        return asarray(values) if is_symbolic(values) else np.asarray(values, *arguments, **options)


class _Math:
    """The module math, of symbols too: NumPy has its functions by the same names."""

    def __getattr__(self, name: str) -> Any:
        found, over = getattr(math, name), getattr(np, name, None)
        if not callable(over):
            return found

        def function(*arguments: Any) -> Any:
            symbolic = any(isinstance(a, (Expression, np.ndarray)) for a in arguments)
            return (over if symbolic else found)(*arguments)

        return function


NUMPY, MATHEMATICS = _Numpy(), _Math()


def _made(function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
    """Return a new array, in which symbols may be put if it is one of numbers."""
    if "_like" in function.__name__ and isinstance(arguments[0], (Expression, np.ndarray)):
        arguments = (np.zeros(np.shape(plain(arguments[0]))), *arguments[1:])
    found = function(*arguments, **options)
    return asarray(found) if found.dtype == np.float64 else found


def _seen(value: Any, seen: dict[int, Any]) -> Any:
    """Return a value that a function refers to as symbols need it."""
    if value is np:
        return NUMPY
    if value is math:
        return MATHEMATICS
    if id(value) in seen:
        return seen[id(value)]
    if isinstance(value, partial):
        return partial(_seen(value.func, seen), *value.args, **value.keywords)
    if isinstance(value, MethodType):
        return MethodType(_seen(value.__func__, seen), value.__self__)
    if isinstance(value, FunctionType):
        return _function(value, seen)
    if not isinstance(value, type) and getattr(value, "__module__", None) == "math":
        return getattr(MATHEMATICS, value.__name__)
    call = None if isinstance(value, type) else vars(type(value)).get("__call__")
    if isinstance(call, FunctionType):
        return MethodType(_seen(call, seen), value)
    return value


def _function(function: FunctionType, seen: dict[int, Any]) -> Any:
    """Return a function with what it refers to replaced."""
    if (function.__module__ or "").partition(".")[0] in LIBRARIES:
        return function
    names = {**function.__globals__}
    cells = tuple(CellType() for _ in function.__closure__ or ())
    found = FunctionType(function.__code__, names, function.__name__, function.__defaults__, cells)
    found.__kwdefaults__ = function.__kwdefaults__
    seen[id(function)] = found
    for name in names_in(function.__code__) & names.keys():
        names[name] = _seen(names[name], seen)
    for cell, own in zip(cells, function.__closure__ or (), strict=True):
        try:
            cell.cell_contents = _seen(own.cell_contents, seen)
        except ValueError:  # nothing in it yet
            continue
    return found


def names_in(code: Any) -> set[str]:
    """Return the names that code refers to, with those of functions inside."""
    inside = (c for c in code.co_consts if hasattr(c, "co_names"))
    return set(code.co_names).union(*(names_in(c) for c in inside))
