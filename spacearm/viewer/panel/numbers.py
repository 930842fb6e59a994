"""Numbers out of the messages of the page, checked."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from spacearm.arrays import LARGEST, Array
from spacearm.errors import ConfigurationError

ROUNDED = 1e-6
"""How much the length of a quaternion may be off."""


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
    return np.zeros(3) if value is None else numbers(value, 3, what)


def numbers(value: object, count: int, what: str) -> Array:
    """Return so many numbers out of a message.

    Raises:
        ConfigurationError: It is no list of as many finite numbers; names it by `what`.
    """
    if not isinstance(value, list) or len(value) != count:
        raise ConfigurationError(f"{what} is {str(value)[:40]!r}; give {count} numbers")
    return np.array([number(x, what) for x in value])


def placement(value: object, what: str) -> pin.SE3:
    """Return a pose out of a message: position [m] and quaternion xyzw, of length 1.

    Raises:
        ConfigurationError: It is none; names it by `what`.
    """
    pose = numbers(value, 7, what)
    if abs(float(np.linalg.norm(pose[3:])) - 1.0) > ROUNDED:
        raise ConfigurationError(f"{what}: the quaternion {pose[3:].tolist()} has no length 1")
    return pin.XYZQUATToSE3(pose)
