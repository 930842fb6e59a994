"""Comparison: the motion that plays in step with another, given or made from it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, UnsupportedError, unknown
from spacearm.mechanics.floating import move, placed
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration
from spacearm.motion.motion import Motion, samples

WORDS: dict[BaseMode, str] = {
    "free-floating": "spacecraft floating",
    "attitude-controlled": "attitude held",
    "fixed": "spacecraft fixed",
}
"""What the spacecraft may do while its joints move as they did, in words."""
MOST_ROWS = 400
"""Rows of a motion that is made for comparison; joints move straight between them."""


class Comparison(NamedTuple):
    """A motion to be played in step with another.

    Attributes:
        name: What it is called beside the curves.
        motion: The motion.
    """

    name: str
    motion: Motion


def compared(motion: Motion, other: Any) -> Comparison:
    """Return what a motion is compared with.

    Args:
        motion: The motion.
        other: Another one, or a mode: the same joint motion, from the same start and without
            momentum, while the spacecraft does that.

    Raises:
        ConfigurationError: It is neither.
        UnsupportedError: The wheels hold momentum, or the motion is that of a flight.
    """
    if not isinstance(other, str):
        second = Motion.of(other)
        return Comparison(f"{type(second).__name__}, {second.story}", second)
    mode = next((mode for mode in WORDS if mode == other), None)
    if getattr(motion, "flight", None) is not None:
        raise UnsupportedError(
            "the arm of a flight grasps and releases bodies; give the motion to compare it with"
        )
    if mode is None:
        raise ConfigurationError(unknown("comparison", other[:40], tuple(WORDS)))
    return Comparison(WORDS[mode], _reacting(motion, mode))


def moved(cfg: Configuration, q: Array, mode: BaseMode) -> Configuration:
    """Return a configuration after the joints have moved straight to q (n,) in a mode."""
    if mode == "free-floating":
        return move(cfg, q)
    if mode == "attitude-controlled":
        return placed(cfg, q, cfg.base.rotation)
    return cfg.arm.at(q, base=cfg.base)


def _reacting(motion: Motion, mode: BaseMode) -> Motion:
    """Return the same joint motion from the same start with another spacecraft."""
    rows = np.linspace(0, len(motion) - 1, min(len(motion), MOST_ROWS)).round().astype(int)
    cfgs = [motion[0]]
    for q in motion.q[rows[1:]]:
        cfgs.append(moved(cfgs[-1], q, mode))
    return Motion(motion.arm, motion.t[rows], **samples(cfgs), mode=mode)
