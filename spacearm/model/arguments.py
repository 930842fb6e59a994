"""Modes: what the spacecraft does while its arm moves."""

from __future__ import annotations

from typing import Literal

from spacearm.errors import ConfigurationError, unknown

BaseMode = Literal["free-floating", "attitude-controlled", "fixed"]

FLOATING: BaseMode = "free-floating"
HELD: BaseMode = "attitude-controlled"

FREE_TWIST = {"free-floating": 6, "attitude-controlled": 3, "fixed": 0}
"""Components of the spacecraft's twist [linear; angular] that momentum conservation decides."""


def free_components(mode: str) -> int:
    """Return how many components of the spacecraft's twist momentum conservation decides.

    Raises:
        ConfigurationError: There is no such mode.
    """
    if mode not in tuple(FREE_TWIST):
        raise ConfigurationError(unknown("mode", mode, FREE_TWIST))
    return FREE_TWIST[mode]
