"""Arrays and numbers of a caller, checked, and results made of them that nobody can change."""

from __future__ import annotations

import math
from dataclasses import fields
from numbers import Integral, Real
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

from spacearm.errors import ConfigurationError

Array: TypeAlias = npt.NDArray[np.floating[Any]]
"""Shapes stand in the docstrings."""

LARGEST = 1e12
"""No length, mass, inertia or joint position of a spacecraft is larger in SI units; what is, is a
slip, and would overflow."""
LEAST_MASS = 1e-12
"""No body is lighter [kg]; Pinocchio divides by masses and takes those below rounding for that."""


def plain(value: Any) -> Any:
    """Arrays as nested lists, paths as text, results as dictionaries."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    return value.to_dict() if hasattr(value, "to_dict") else value


class Result:
    """Base of frozen dataclasses that hold results: read-only arrays, and `to_dict`."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    def to_dict(self) -> dict[str, Any]:
        """All fields, arrays as nested lists."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}


def whole(value: object, name: str, least: int) -> int:
    """A whole number.

    Args:
        value: What was given.
        name: Of the argument.
        least: Least value that makes sense.

    Raises:
        ConfigurationError: It is something else.
    """
    if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
        raise ConfigurationError(f"{name} is {value!r}; give a whole number from {least} on")
    return int(value)


def positive(value: object, name: str, what: str = "number") -> float:
    """A finite number above zero.

    Args:
        value: What was given.
        name: Of the argument.
        what: What it is, with its unit.

    Raises:
        ConfigurationError: It is something else.
    """
    number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    if not 0.0 < number < math.inf:
        raise ConfigurationError(f"{name} is {value!r}; give a positive {what}")
    return number


def finite(values: object, shape: tuple[int, ...], name: str, meaning: str = "") -> Array:
    """Return a copy of a caller's numbers, checked: one check for all vectors and matrices.

    Args:
        values: What was given.
        shape: The shape that it must have.
        name: Of the argument.
        meaning: What the numbers are, with their unit, as in "[force [N]; torque [N m]]".

    Raises:
        ConfigurationError: Not numbers of this shape, or one is not finite or beyond `LARGEST`.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != shape or not (np.abs(array) <= LARGEST).all():
        size = f"{shape[0]} finite numbers" if shape else "a finite number"
        size = f"a {shape} array of finite numbers" if len(shape) > 1 else size
        given = f"is {values!r}" if np.size(array) <= 36 else f"has shape {np.shape(array)}"
        raise ConfigurationError(f"{name} {given}; give {size}{meaning and ' '}{meaning}")
    return array
