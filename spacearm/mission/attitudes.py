"""Attitudes of the spacecraft from which the tip can follow a path.

Given a path of the tip relative to the system CM, the start attitude is free. From each start the
motion is determined, and its least distance to the singular set is a continuous function of the
attitude; feasible are the attitudes where it stays above a margin. For planar arms they are
intervals of one angle, compare Nanos & Papadopoulos, Avoiding dynamic singularities in Cartesian
motions of free-floating manipulators, IEEE Trans. Aerosp. Electron. Syst. 51(3), 2305-2318 (2015);
for spatial arms a set of rotations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, Result, named, plain
from spacearm.errors import NoSolutionError, UnsupportedError
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.following import Followed, lead

ENDS = ("arrived", "singularity", "joint limit", "tilt", "margin", "gave up", "no start")
"""How following the path ended, in the order of `FeasibleAttitudes.ended`."""


class Ball(NamedTuple):
    """A ball of feasible attitudes: how far the attitude may be off, about any axis.

    Attributes:
        centre: (4,) the attitude in its middle, quaternion xyzw.
        radius: Angle up to which all attitudes tried are feasible [rad]; pi if all are.
    """

    centre: Array
    radius: float

    def to_dict(self) -> dict[str, Any]:
        """Return both fields as plain JSON data."""
        return named(self)


@dataclass(frozen=True, eq=False, repr=False)
class FeasibleAttitudes(Result):
    """The attitudes of the spacecraft from which the tip can follow a path.

    Attributes:
        arm: The arm.
        path: The path, as it was given.
        margin: Least distance to the singular set that is kept on the way [rad].
        limits: Whether joint limits count.
        momentum: (6,) momentum on the way; the linear part is zero.
        speed: Speed of the tip along the path [m/s] or [rad/s].
        length: Length of the path [m] or [rad].
        attitude: (m, 4) attitudes tried, quaternions xyzw.
        weight: (m,) share of all attitudes that each stands for.
        q: (m, n) posture at the start, NaN where there is none.
        ended: (m,) how it ended, an index in `ENDS`.
        s: (m,) length of path behind the tip.
        distance: (m,) least distance to the singular set on the way [rad]; 0 where it was met, pi
            where to first order it is more.
        slack: (m,) least distance of a joint to its limits [rad] or [m].
        tilt: (m,) largest turn of the spacecraft on the way [rad].
        axis: The axis (0, 1, 2) about which a planar arm turns; None for spatial arms.
        intervals: (k, 2) the feasible angles about this axis, -pi <= first < pi, ends to 1e-6 rad;
            intervals narrower than the spacing of the attitudes tried may be missing. None for
            spatial arms.
        cell: (m, 3) level, direction and roll of the cell of a spatial arm; see `rotations`. Zeros
            for planar arms.
        border: (m,) whether an attitude nearby is feasible where this one is not, or is not.
        ball: The largest ball of feasible attitudes found; None if none is feasible.
    """

    arm: SpaceArm
    path: Any
    margin: float
    limits: bool
    momentum: Array
    speed: float
    length: float
    attitude: Array
    weight: Array
    q: Array
    ended: npt.NDArray[np.signedinteger[Any]]
    s: Array
    distance: Array
    slack: Array
    tilt: Array
    axis: int | None
    intervals: Array | None
    cell: npt.NDArray[np.int64]
    border: npt.NDArray[np.bool_]
    ball: Ball | None

    JSON: ClassVar[Mapping[str, str]] = {
        "path": "corners",
        "length": "path_length",
        "ended": "outcome",
    }

    @cached_property
    def feasible(self) -> npt.NDArray[np.bool_]:
        """(m,) whether the tip arrives and keeps the margin."""
        ok: npt.NDArray[np.bool_] = (self.ended == 0) & (self.distance >= self.margin)
        return ok

    @cached_property
    def angle(self) -> Array:
        """(m,) the attitudes of a planar arm as angles, growing from -pi to pi [rad].

        Raises:
            UnsupportedError: The arm is spatial.
        """
        if self.axis is None:
            raise UnsupportedError(f"{self.arm.name} turns its spacecraft about every axis")
        return 2.0 * np.arctan2(self.attitude[:, self.axis], self.attitude[:, 3])

    @cached_property
    def share(self) -> float:
        """Share of all attitudes that is feasible."""
        if self.intervals is not None:
            return float(np.diff(self.intervals).sum() / (2.0 * np.pi))
        return float(self.weight[self.feasible].sum())

    @cached_property
    def error(self) -> float:
        """Standard error of the share, if the border cuts the cells it passes at random."""
        if self.intervals is not None:
            return 0.0
        return 0.5 * float(np.sqrt((self.weight[self.border] ** 2).sum()))

    @cached_property
    def by_direction(self) -> tuple[Array, Array]:
        """Directions (k, 3) of the spacecraft's z axis, and the share of feasible rolls about each.

        Of spatial arms; the directions are those tried, along inertial axes.

        Raises:
            UnsupportedError: The arm is planar.
        """
        if self.axis is not None:
            raise UnsupportedError(f"{self.arm.name} turns its spacecraft about one axis only")
        x, y, z, w = self.attitude.T
        axis = np.stack((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)), 1)
        least = self.cell[:, 0].min()
        parent = self.cell[:, 1] // 4 ** (self.cell[:, 0] - least)
        inside, whole = (np.bincount(parent, self.weight * f) for f in (self.feasible, 1.0))
        middle = np.stack([np.bincount(parent, axis[:, i]) for i in range(3)], axis=1)
        return middle / np.linalg.norm(middle, axis=1, keepdims=True), inside / whole

    @cached_property
    def best(self) -> int:
        """Number of the feasible attitude that keeps farthest from the singular set.

        Of several that keep as far, the one that keeps farthest from the joint limits.

        Raises:
            NoSolutionError: No attitude tried is feasible.
        """
        if not self.feasible.any():
            raise NoSolutionError(f"{self.arm.name}: {self._why()}")
        inside = np.flatnonzero(self.feasible)
        return int(inside[np.lexsort((self.slack[inside], self.distance[inside]))[-1]])

    def start(self, i: int | None = None) -> Configuration:
        """Return the configuration at the beginning of the path, the system CM at the origin.

        Args:
            i: Number of the attitude; the best if None.

        Raises:
            NoSolutionError: There is no posture with the tip there.
        """
        i = self.best if i is None else i
        if not np.isfinite(self.q[i]).all():
            raise NoSolutionError(f"attitude {i} has no posture with the tip at the path's start")
        R = pin.Quaternion(self.attitude[i]).normalized().matrix()
        cfg = self.arm.at(self.q[i], base=pin.SE3(R, np.zeros(3)), momentum=self.momentum)
        return cfg.centred(np.zeros(3))

    def motion(self, i: int | None = None) -> Followed:
        """Return the motion along the path from an attitude, by `sa.follow`.

        Args:
            i: Number of the attitude; the best if None.

        Raises:
            UnsupportedError: There is momentum, with which `sa.follow` cannot deal.
            NoSolutionError: There is no posture with the tip there.
        """
        if self.momentum.any():
            raise UnsupportedError("sa.follow leads the tip at zero momentum only")
        cfg = self.start(i)
        length = self.length if callable(self.path) else None
        return lead(cfg, self.path, length=length, speed=self.speed, limits=self.limits)

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data, with share and error; functions as None."""
        data = {f.name: getattr(self, f.name) for f in fields(self)}
        data["path"] = None if callable(self.path) else list(self.path)
        return {self.JSON.get(name, name): plain(value) for name, value in data.items()} | {
            "feasible_share": self.share,
            "standard_error": self.error,
        }

    def __repr__(self) -> str:
        about = f"{self.arm.name}, margin {np.degrees(self.margin):.3g}°"
        if self.ball is None:
            return f"FeasibleAttitudes({about}: {self._why()})"
        if self.intervals is not None:
            parts = ", ".join(f"{a:.3f}° to {b:.3f}°" for a, b in np.degrees(self.intervals))
            return f"FeasibleAttitudes({about}: {self.share:.1%} of all, {parts})"
        return (
            f"FeasibleAttitudes({about}: {self.share:.1%} of all attitudes (error "
            f"{self.error:.1%}), the largest ball found has a radius of "
            f"{np.degrees(self.ball.radius):.3g}°)"
        )

    def _why(self) -> str:
        """Say how the attempts ended where none succeeded."""
        kinds, counts = np.unique(self.ended, return_counts=True)
        ends = [f"{ENDS[kind]}: {count}" for kind, count in zip(kinds, counts, strict=True)]
        return f"none of {len(self.ended)} attitudes is feasible ({', '.join(ends)})"
