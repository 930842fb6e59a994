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
from dataclasses import fields, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import (
    Array,
    Booleans,
    Integers,
    Progress,
    named,
    plain,
    positive,
    whole,
    within,
)
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.mechanics.jacobian import turning_axes
from spacearm.mission.attitude_search import (
    ENDS,
    HeldTip,
    PathTrials,
    at_border,
    largest_ball,
    search_cells,
    search_ring,
    turned_about,
    volume,
)
from spacearm.model.arguments import FLOATING, require_possible
from spacearm.model.arm import Configuration, SpaceArm, still_wheels
from spacearm.motion.following import Followed, Path, follow, path_start, segments
from spacearm.motion.leading import Settings, table_of
from spacearm.results import Cell, Column, Description, Measure, Result, Table, joint_measures
from spacearm.signatures import checked

#: Default least distance to the singular set [rad].
MARGIN = float(np.radians(1.0))
#: Default number of attitudes of a planar arm.
RING = 720
#: Default level of cells of a spatial arm: 4,608 attitudes.
LEVEL = 2


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


class FeasibleAttitudes(Result):
    """The attitudes of the spacecraft from which the tip can follow a path.

    Attributes:
        arm: The arm.
        path: The path, as it was given.
        margin: Least distance to the singular set, to first order, that is kept on the way [rad].
        limits: Whether joint limits count.
        momentum: (6,) momentum on the way; the linear part is zero.
        speed: Speed of the tip along the path [m/s] or [rad/s].
        length: Length of the path [m] or [rad].
        attitude: (m, 4) attitudes tried, quaternions xyzw.
        weight: (m,) share of all attitudes that each represents.
        q: (m, n) posture at the start, NaN where there is none.
        ended: (m,) how each attempt ended, an index in `ENDS`.
        s: (m,) length of path that the tip has covered.
        distance: (m,) least distance to the singular set on the way, to first order [rad]; 0 where
            it was met, pi where it is more.
        slack: (m,) least distance of a joint to its limits [rad] or [m].
        tilt: (m,) largest turn of the spacecraft on the way [rad].
        axis: The axis (0, 1, 2) about which a planar arm turns; None for spatial arms.
        intervals: (k, 2) the feasible angles about this axis, -pi <= first < pi, ends to 1e-6 rad;
            intervals narrower than the spacing of the attitudes tried may be missing. None for
            spatial arms.
        cell: (m, 3) level, direction and roll of the cell of a spatial arm; see `rotations`. Zeros
            for planar arms.
        border: (m,) whether a neighbouring attitude is feasible and this one is not, or the
            reverse.
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
    ended: Integers
    s: Array
    distance: Array
    slack: Array
    tilt: Array
    axis: int | None
    intervals: Array | None
    cell: Integers
    border: Booleans
    ball: Ball | None

    JSON: ClassVar[Mapping[str, str]] = {
        "path": "corners",
        "length": "path_length",
        "ended": "outcome",
    }

    @cached_property
    def feasible(self) -> Booleans:
        """(m,) whether the tip arrives and keeps the margin."""
        ok: Booleans = (self.ended == 0) & (self.distance >= self.margin)
        return ok

    @cached_property
    def angle(self) -> Array:
        """(m,) the attitudes of a planar arm as angles, increasing from -pi to pi [rad].

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
            ConfigurationError: There is no such attitude.
            NoSolutionError: There is no posture with the tip there.
        """
        i = self.best if i is None else whole(i, "i", 0, len(self.q) - 1)
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
            UnsupportedError: There is momentum, with which the spacecraft turns with time.
            NoSolutionError: There is no posture with the tip there.
        """
        if self.momentum.any():
            raise UnsupportedError(
                "motions along the path at constant speed are of zero momentum; "
                "sa.follow(attitudes.start(i), path, times=...) leads the tip with momentum"
            )
        length = self.length if callable(self.path) else None
        return follow(self.start(i), self.path, length=length, speed=self.speed, limits=self.limits)

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data, with share and error; functions as None."""
        data = {f.name: getattr(self, f.name) for f in fields(self)}
        data["path"] = None if callable(self.path) else list(self.path)
        return {self.JSON.get(name, name): plain(value) for name, value in data.items()} | {
            "feasible_share": self.share,
            "standard_error": self.error,
            "not_checked": self.not_checked,
        }

    not_checked = "collisions; whether the arm comes to the start's posture"

    def describe(self) -> Description:
        """Describe the share, how attempts ended, the best attitude and the largest ball."""
        kinds, counts = np.unique(self.ended, return_counts=True)
        ends = [(ENDS[kind], count) for kind, count in zip(kinds, counts, strict=True)]
        unit = "m" if min(self.arm.task.indices) < 3 else "rad"
        momentum = "with momentum" if self.momentum.any() else "at zero momentum"
        said = Description(
            title=f"{self.arm.name}, margin {np.degrees(self.margin):.3g}°",
            verdict=self._verdict(),
            notes=[
                f"the path of {self.length:.4g} {unit} can be followed {momentum} from "
                f"{self.share:.2%} of the attitudes, joint limits "
                f"{'count' if self.limits else 'do not count'}"
            ],
            tables=[Table(("ended", "attitudes tried"), ends)],
        )
        if self.ball is None:
            return said
        best = self.start()
        facts: dict[str, Cell] = {
            "distance kept, to first order": Measure(self.distance[self.best], "rad"),
            "attitude, quaternion xyzw": self.attitude[self.best],
            **dict(zip(best.arm.joint_names, joint_measures(best.q, best.arm.slides), strict=True)),
            "largest ball of attitudes": Measure(self.ball.radius, "rad"),
            "about the attitude xyzw": self.ball.centre,
        }
        tables = [*said.tables, Table.facts(facts, "Best")]
        if self.intervals is not None:
            columns = (Column("from", "rad", ".5f"), Column("to", "rad", ".5f"))
            tables.insert(1, Table(columns, self.intervals.tolist(), "Feasible"))
        return replace(said, tables=tables)

    def _verdict(self) -> str:
        if self.ball is None:
            return self._why()
        if self.intervals is not None:
            parts = ", ".join(f"{a:.3f}° to {b:.3f}°" for a, b in np.degrees(self.intervals))
            return f"{self.share:.1%} of all, {parts}"
        return (
            f"{self.share:.1%} of all attitudes (error {self.error:.1%}), the largest ball found "
            f"has a radius of {np.degrees(self.ball.radius):.3g}°"
        )

    def _why(self) -> str:
        """Say how the attempts ended where none succeeded."""
        kinds, counts = np.unique(self.ended, return_counts=True)
        ends = [f"{ENDS[kind]}: {count}" for kind, count in zip(kinds, counts, strict=True)]
        return f"none of {len(self.ended)} attitudes is feasible ({', '.join(ends)})"


@checked
def feasible_attitudes(
    start: Configuration,
    path: Path,
    *,
    all_branches: bool = False,
    length: float | None = None,
    margin: float = MARGIN,
    speed: float = 0.1,
    limits: bool = True,
    samples: int | None = None,
    refine: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
) -> FeasibleAttitudes:
    """Find the attitudes of the spacecraft from which the tip can follow a path.

    The path is given relative to the system CM, along inertial axes, and begins with its first
    corner. At each attitude the arm takes a posture with the tip there, and the tip then follows
    the path by J*, as `sa.follow` does. The attitude is feasible if the tip arrives, no
    configuration on the way is nearer than `margin` to the singular set (to first order, as by
    `sa.singularity`), and no joint leaves its limits. All attitudes are followed at once. `python
    benchmarks/attitudes.py` prints how long it takes.

    Args:
        start: A posture and an attitude with the tip near the beginning of the path. The postures
            at other attitudes follow from this one while the spacecraft turns and the tip is held.
            So they are on the same branch, up to where the arm cannot reach or its Jacobian with
            the attitude held is singular. The attitude of a planar arm must be a turn about the
            normal of its plane. With momentum, which must be angular, the result depends on
            `speed`.
        path: As for `follow`, from the system CM [m]; its first corner is where the tip begins.
        all_branches: Look for all branches from random postures instead, which may miss some, and
            take the best at each attitude; the posture of `start` does not count.
        length: Length of a path given as a function [m] or [rad].
        margin: Least distance to the singular set, to first order [rad]; zero asks only that none
            is met.
        speed: Speed of the tip along the path [m/s], or [rad/s] in a mere turn.
        limits: Whether joint limits count.
        samples: Number of attitudes tried at first. For planar arms 720 if None; for others at
            least so many cells of equal volume, 72 times a power of 8, 4,608 if None.
        refine: How many times the cells at the border are divided into eight, for spatial arms.
        seed: Seed of the random postures.
        progress: Called as progress(done, total).

    Returns:
        The attitudes tried and how each attempt ended, the intervals of a planar arm, the largest
        ball.

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The arm has several tips or fewer joints than its task rows, or the task
            singles out directions that turn with the spacecraft, or the wheels hold momentum.
        NoSolutionError: From the start no posture was found with the tip at the beginning of the
            path.

    Example:
        >>> import numpy as np
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> start = arm.at(np.radians([-57.936, 60.337]))
        >>> found = sa.feasible_attitudes(start, [(2.0, 0.0), (1.5, 1.5)])
        >>> np.degrees(found.intervals).round(3)
        array([[57.335, 65.156]])
    """
    arm, h = start.arm, start.momentum
    arm.require_one_tip()
    axis = turning_axis(arm)
    margin = within(margin, "margin", 0.0, np.pi, "an angle [rad]")
    speed = positive(speed, "speed", "speed [m/s]")
    if h[:3].any():
        raise ConfigurationError(
            f"momentum has the linear part {h[:3].tolist()}; the path is given from the system CM, "
            "which that moves: leave it zero"
        )
    still_wheels(start, "which turns with the spacecraft; leave wheels out")
    R = start.base.rotation
    if axis is not None and R[axis, axis] < 1.0 - 1e-9:
        raise ConfigurationError(
            f"base turns the plane of the arm; give a turn about {'xyz'[axis]}, the normal of it"
        )
    cfg = start.centred(np.zeros(3))
    tip = path_start(cfg, path)
    pieces = segments(cfg, path, length, tip)
    settings = Settings(h[3:] / speed, limits, care=margin)
    trials = PathTrials(
        HeldTip(arm, tip), table_of([pieces]), settings, None if all_branches else start.q,
        np.asarray(pin.Quaternion(R).coeffs()), seed,
    )  # fmt: skip
    weight: Array
    intervals: Array | None = None
    ball: Ball | None = None
    if axis is not None:
        number = RING if samples is None else whole(samples, "samples", 8)
        trials = trials._replace(settings=settings._replace(tolerance=1e-9, stride=0.05))
        found, angle, intervals = search_ring(trials, axis, number, progress)
        ahead, behind = np.roll(angle, -1) - angle, angle - np.roll(angle, 1)
        weight = (ahead % (2.0 * np.pi) + behind % (2.0 * np.pi)) / (4.0 * np.pi)
        inside = trials.feasible(found)
        border = (inside != np.roll(inside, 1)) | (inside != np.roll(inside, -1))
        cell = np.zeros((len(angle), 3), dtype=np.int64)
        if len(intervals):
            low, high = intervals[np.argmax(np.diff(intervals)[:, 0])]
            ball = Ball(turned_about(axis, 0.5 * (low + high)), float(0.5 * (high - low)))
    else:
        least = 72 * 8**LEVEL if samples is None else whole(samples, "samples", 1)
        level = max(0, int(np.ceil(np.log2(least / 72.0) / 3.0 - 1e-9)))
        found, of, levels = search_cells(trials, level, whole(refine, "refine", 0), progress)
        inside = trials.feasible(found)
        cell = np.column_stack((levels, of))
        weight, border = volume(levels), at_border(found, inside, levels)
        if inside.any():
            ball = Ball(*largest_ball(trials, found))
        if progress:
            progress(1000, 1000)
    return FeasibleAttitudes(
        arm=arm, path=path, margin=margin, limits=limits, momentum=h, speed=speed,
        length=sum(piece.length for piece in pieces), **found._asdict(), weight=weight, axis=axis,
        intervals=intervals, cell=cell, border=border, ball=ball,
    )  # fmt: skip


def turning_axis(arm: SpaceArm) -> int | None:
    """Return the axis about which a planar arm turns its spacecraft; None for spatial arms.

    Raises:
        UnsupportedError: The path cannot be followed in all rows of the task, or the rows depend on
            the attitude.
    """
    require_possible(arm, FLOATING)
    axes = turning_axes(arm)
    axis = axes[0] if len(axes) == 1 else None
    if not arm.task.singled_out <= {axis}:
        raise UnsupportedError(
            f"the task {arm.task.names!r} of {arm.name} singles out directions that turn with the "
            "spacecraft, so that its rows depend on the attitude; take position, orientation or "
            "pose, or the rows in the plane of a planar arm"
        )
    return axis
