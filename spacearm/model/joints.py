"""Joints: the check of a vector over the n joints, and of the name of one of them."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from spacearm.arrays import LARGEST, NO_NUMBERS, Array
from spacearm.errors import ConfigurationError, listed, unknown


class Jointed(Protocol):
    """What has n joints with names: an arm."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def n(self) -> int:
        """Number of joints."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of q."""


def joint_vector(arm: Jointed, values: npt.ArrayLike, what: str) -> Array:
    """Return a checked copy of one finite number per joint, (n,).

    Args:
        arm: The arm.
        values: What was given.
        what: Name of the argument.

    Raises:
        ConfigurationError: It has another shape, or a number is not finite; names the joint.
    """
    try:
        vector = np.array(values, dtype=np.float64)
    except NO_NUMBERS as error:
        why = f"give the .q of the {type(values).__name__}" if hasattr(values, "q") else error
        raise ConfigurationError(f"{what} must be {arm.n} numbers: {why}") from None
    if vector.shape != (arm.n,):
        raise ConfigurationError(
            f"{what} has shape {vector.shape}; {arm.name} needs ({arm.n},), one number for each "
            f"of: {listed(arm.joint_names)}"
        )
    sound = np.abs(vector) <= LARGEST
    if not sound.all():
        worst = int(np.flatnonzero(~sound)[0])
        raise ConfigurationError(
            f"{what} of joint {arm.joint_names[worst]!r} is {vector[worst]:g}; give a finite "
            f"number up to {LARGEST:g}"
        )
    return vector


def joint_name(arm: Jointed, text: str) -> str:
    """Return the name of a joint that is given by it, or by its number as q1, q2, ...

    Raises:
        ConfigurationError: There is no such joint.
    """
    numbers = {f"q{i}": name for i, name in enumerate(arm.joint_names, start=1)}
    if text in arm.joint_names:
        return text
    if text not in numbers:
        raise ConfigurationError(unknown("joint", text, [*arm.joint_names, *numbers]))
    return numbers[text]
