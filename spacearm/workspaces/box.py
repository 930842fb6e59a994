"""Boxes in joint space: joint limits, or the whole torus."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from spacearm.arrays import Array


class Box(NamedTuple):
    """Range of the joints: a box that spans at most one turn in each.

    Attributes:
        low: (n,) lower corner.
        high: (n,) upper corner.
        limited: Whether it is less than the torus.
    """

    low: Array
    high: Array
    limited: bool

    @classmethod
    def of(cls, lower: Array, upper: Array, limits: bool) -> Box:
        """Return the box of the joint limits, or the torus."""
        whole = np.logical_or(upper - lower >= 2.0 * np.pi, not limits)
        low = np.where(whole, -np.pi, lower)
        return cls(low, np.where(whole, np.pi, upper), not whole.all())

    def fold(self, Q: Array) -> Array:
        """Move angles by whole turns to where the box begins."""
        return self.low + (Q - self.low) % (2.0 * np.pi)

    def holds(self, Q: Array) -> Any:
        """Check which folded configurations (..., n) are in the box."""
        return (self.high + 1e-12 >= Q).all(axis=-1)
