"""Numbers out of the messages of the page, checked."""

from __future__ import annotations

import numpy as np

from spacearm.arrays import LARGEST, Array
from spacearm.errors import ConfigurationError


def number(value: object, what: str) -> float:
    """Return a number out of a message.

    Raises:
        ConfigurationError: It is no finite number; names it by `what`.
    """
    if isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= LARGEST:
        return float(value)
    raise ConfigurationError(f"{what} is {str(value)[:40]!r}; give a finite number")


def vector(value: object, what: str) -> Array:
    """Return a vector (3,) out of a message, zero if it is left out.

    Raises:
        ConfigurationError: It is no list of three finite numbers; names it by `what`.
    """
    if value is None:
        return np.zeros(3)
    if not isinstance(value, list) or len(value) != 3:
        raise ConfigurationError(f"{what} is {str(value)[:40]!r}; give three numbers")
    return np.array([number(x, what) for x in value])
