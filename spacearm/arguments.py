"""Arguments: single numbers of a caller, Python's or NumPy's, checked."""

from __future__ import annotations

import math
from numbers import Integral, Real

from spacearm.errors import ConfigurationError


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
