"""Playable: what an object needs to be taken for a motion."""

from __future__ import annotations

from typing import Any, Protocol

from spacearm.model.arm import SpaceArm


class Playable(Protocol):
    """Any object that `Motion.of` and `sa.view` take."""

    @property
    def arm(self) -> SpaceArm:
        """The arm."""

    @property
    def t(self) -> Any:
        """(m,) times, growing [s]."""

    @property
    def q(self) -> Any:
        """(m, n) joint positions [rad] or [m]."""

    @property
    def base(self) -> Any:
        """(m, 7) or m pin.SE3: spacecraft poses."""
