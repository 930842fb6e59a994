"""Modes: what the spacecraft does while its arm moves."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

from spacearm.errors import UnsupportedError, require_known
from spacearm.model.arm import SpaceArm

BaseMode = Literal["free-floating", "attitude-controlled", "fixed"]

FLOATING: BaseMode = "free-floating"
HELD: BaseMode = "attitude-controlled"

#: Components of the spacecraft's twist [linear; angular] that momentum conservation decides.
FREE_TWIST = {"free-floating": 6, "attitude-controlled": 3, "fixed": 0}


def free_components(mode: str) -> int:
    """Return how many components of the spacecraft's twist momentum conservation decides.

    Raises:
        ConfigurationError: There is no such mode.
    """
    require_known("mode", mode, FREE_TWIST)
    return FREE_TWIST[mode]


@lru_cache(maxsize=64)
def impossible(arm: SpaceArm, mode: BaseMode) -> str:
    """Say why an arm can never do its task, and which it can; empty if it can do it."""
    return arm.fault_of_task(free_components(mode))


def require_possible(arm: SpaceArm, mode: BaseMode) -> None:
    """Refuse an arm that can never do its task.

    Raises:
        UnsupportedError: It cannot; names rows and remedy.
    """
    if fault := impossible(arm, mode):
        raise UnsupportedError(f"{arm.name}: {fault}")
