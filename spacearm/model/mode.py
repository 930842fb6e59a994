"""Modes: what the spacecraft does while its arm moves."""

from __future__ import annotations

from typing import Literal

from spacearm.errors import ConfigurationError, unknown

BaseMode = Literal["free-floating", "attitude-controlled", "fixed"]

FREE_TWIST = {"free-floating": 6, "attitude-controlled": 3, "fixed": 0}


def free_components(base: str) -> int:
    """How many components of the spacecraft's twist [linear; angular] momentum decides."""
    if base not in tuple(FREE_TWIST):
        raise ConfigurationError(unknown("base", base, FREE_TWIST))
    return FREE_TWIST[base]
