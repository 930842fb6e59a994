"""Motion: joint positions and spacecraft poses over time, whatever made them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from spacearm.arrays import LARGEST, Array
from spacearm.errors import ConfigurationError
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration


def unit_quaternions(poses: Array) -> bool:
    """Whether poses (m, 7), position and quaternion xyzw, have quaternions of length 1 to 1e-6."""
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(poses[:, 3:], axis=1)
    return bool((np.abs(lengths - 1.0) <= 1e-6).all())


class Playable(Protocol):
    """What can be played: trajectories, followed paths, motions, whatever made them."""

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


@dataclass(frozen=True, eq=False, repr=False)
class Motion:
    """A sampled motion, linear between its samples.

    Attributes:
        arm: The arm.
        t: (m,) times, growing [s].
        q: (m, n) joint positions [rad] or [m].
        base: (m, 7) spacecraft poses: x y z [m], quaternion xyzw.
    """

    arm: SpaceArm
    t: Array
    q: Array
    base: Array

    def __post_init__(self) -> None:
        for name in ("t", "q", "base"):
            try:
                array = np.array(getattr(self, name), dtype=np.float64)
            except (TypeError, ValueError) as error:
                raise ConfigurationError(f"motion: {name} must be numbers: {error}") from None
            object.__setattr__(self, name, array)
        m, n = self.t.size, self.arm.n
        for name, shape in (("t", (m,)), ("q", (m, n)), ("base", (m, 7))):
            array = getattr(self, name)
            if array.shape != shape or not (np.abs(array) <= LARGEST).all():
                raise ConfigurationError(
                    f"motion: {name} has shape {array.shape}; give {shape}, all finite numbers up "
                    f"to {LARGEST:g}"
                )
        if not unit_quaternions(self.base):
            raise ConfigurationError("motion: base must hold quaternions of length 1")
        if m == 0 or (np.diff(self.t) <= 0.0).any():
            raise ConfigurationError("motion: t must hold growing times, at least one")

    @classmethod
    def of(cls, thing: Any) -> Motion:
        """The motion in any object with `arm`, `t`, `q` and `base`.

        `base` may be (m, 7) numbers or a sequence of pin.SE3.
        """
        try:
            base = [pin.SE3ToXYZQUAT(b) if isinstance(b, pin.SE3) else b for b in thing.base]
            return cls(thing.arm, thing.t, thing.q, np.array(base, dtype=np.float64))
        except (AttributeError, TypeError, ValueError) as error:
            if isinstance(error, ConfigurationError):
                raise
            raise ConfigurationError(
                f"a {type(thing).__name__} cannot be played ({error}); give a SpaceArm, or an "
                "object with arm, t (m,), q (m, n) and base (m poses)"
            ) from None

    def at(self, t: float) -> Configuration:
        """The configuration at a time; the first or last one outside the motion."""
        i = int(np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, max(len(self.t) - 2, 0)))
        j = min(i + 1, len(self.t) - 1)
        span = self.t[j] - self.t[i]
        s = float(np.clip((t - self.t[i]) / span, 0.0, 1.0)) if span > 0.0 else 0.0
        pose = pin.SE3.Interpolate(self._pose(i), self._pose(j), s)
        return self.arm.at((1.0 - s) * self.q[i] + s * self.q[j], base=pose)

    def _pose(self, i: int) -> pin.SE3:
        x, y, z, *quaternion = self.base[i]
        return pin.SE3(pin.Quaternion(np.array(quaternion)).normalized(), np.array([x, y, z]))
