"""Where the tip can go while the spacecraft stays level: turned by no more than a given angle.

Straight lines of the tip are followed in all directions until the spacecraft has turned too far.
Broken lines go farther: cells of space are reached one from the next, by whatever way turns the
spacecraft least, since its attitude depends on the path (w_0 dt is no differential of a function).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, Progress, Result, finite, positive, whole
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.mission.attitude_search import turning_axis
from spacearm.mission.rotations import sphere
from spacearm.model.arguments import of_configuration
from spacearm.model.arm import Configuration, SpaceArm, still_wheels
from spacearm.motion.following import Followed, lead
from spacearm.motion.goal import as_goal

RAYS = {2: 360, 3: 1000}
"""Default number of directions, in the plane and in space."""
SHARE = 0.25
"""Default distance of cells, as a share of what straight lines reach on average."""
MOST = {2: 60, 3: 12}
"""Most cells from the tip's start to the border of what is searched."""


@dataclass(frozen=True, eq=False, repr=False)
class LevelReach(Result):
    """Where the tip can go with the spacecraft turned by no more than `tilt` on the way.

    Positions are from the system CM, along inertial axes; the attitude of the tip is kept.

    Attributes:
        arm: The arm.
        q0: (n,) joint positions at the start.
        attitude: (4,) attitude of the spacecraft then, quaternion xyzw.
        tip: (3,) position of the tip then [m].
        tilt: The largest turn of the spacecraft [rad].
        margin: Least distance to the singular set on the way [rad].
        limits: Whether joint limits count.
        axis: The normal of a planar arm's plane (0, 1, 2); None for spatial arms.
        direction: (d, 3) unit vectors of straight lines, evenly spread.
        straight: (d,) how far the tip can go along each [m].
        ended: (d,) what ended each line, an index in `ENDS` of
            `spacearm.mission.attitudes`.
        point: (p, 3) middles of the cells that broken lines reach, the start first [m].
        turn: (p,) turn of the spacecraft there [rad].
        parent: (p,) from which of them each is reached; -1 of the start.
        cell: Distance of neighbouring cells [m].
    """

    arm: SpaceArm
    q0: Array
    attitude: Array
    tip: Array
    tilt: float
    margin: float
    limits: bool
    axis: int | None
    direction: Array
    straight: Array
    ended: npt.NDArray[np.int64]
    point: Array
    turn: Array
    parent: npt.NDArray[np.int64]
    cell: float

    @cached_property
    def volume(self) -> float:
        """Volume that straight lines reach [m^3]; of a planar arm the area [m^2]."""
        if self.axis is not None:
            return float(np.pi * np.mean(self.straight**2))
        return float(4.0 / 3.0 * np.pi * np.mean(self.straight**3))

    @cached_property
    def planned_volume(self) -> float:
        """Volume [m^3] or area [m^2] of the cells that broken lines reach."""
        places = np.unique(np.round((self.point - self.tip) / self.cell).astype(int), axis=0)
        return float(len(places) * self.cell ** (3 if self.axis is None else 2))

    def start(self) -> Configuration:
        """Return the configuration at the start, the system CM at the origin."""
        R = pin.Quaternion(self.attitude).normalized().matrix()
        return self.arm.at(self.q0, base=pin.SE3(R, np.zeros(3))).centred(np.zeros(3))

    def motion(self, point: npt.ArrayLike) -> Followed:
        """Return the motion along broken lines to the cell that a point lies in, by `sa.follow`.

        Args:
            point: (3,) the point, from the system CM [m].

        Raises:
            NoSolutionError: The cell is not reached, or no broken lines were asked for.
        """
        wanted = finite(point, (3,), "point", "from the system CM [m]")
        apart = np.abs(self.point - wanted).max(axis=1)
        inside = np.flatnonzero(apart <= 0.5 * self.cell * (1.0 + 1e-9))
        if not len(inside) or self.parent[i := int(inside[np.argmin(self.turn[inside])])] < 0:
            raise NoSolutionError(
                f"the cell of {wanted.tolist()} is not among the {len(self.point)} that broken "
                f"lines reach with turns up to {np.degrees(self.tilt):.3g}°"
            )
        corners = []
        while self.parent[i] >= 0:
            corners.append(self.point[i])
            i = int(self.parent[i])
        cfg = self.start()
        poses = [pin.SE3(cfg.tip.rotation, corner) for corner in corners[::-1]]
        goals = [as_goal(cfg, pose) for pose in poses]
        return lead(cfg, goals, limits=self.limits)

    def __repr__(self) -> str:
        unit = "m^3" if self.axis is None else "m^2"
        broken = f", broken ones {self.planned_volume:.4g} {unit}" if len(self.point) > 1 else ""
        return (
            f"LevelReach({self.arm.name}, turned by at most {np.degrees(self.tilt):.3g}°: straight "
            f"lines from {self.straight.min():.4g} to {self.straight.max():.4g} m, "
            f"{self.volume:.4g} {unit}{broken})"
        )


@of_configuration
def level_reach(
    start: Configuration,
    tilt: float,
    *,
    margin: float = 0.0,
    limits: bool = True,
    directions: int | None = None,
    planned: bool = False,
    cell: float | None = None,
    progress: Progress | None = None,
) -> LevelReach:
    """Find where the tip can go with the spacecraft turned by no more than `tilt` on the way.

    The tip goes along straight lines in all directions, its attitude kept, led by J* as `follow`
    does, until the spacecraft has turned too far from its start, a singularity or a joint limit is
    met. With `planned` it goes along broken lines, too: from cell to cell of a grid, up to two
    states a cell, those found first; more cells may be reachable by other ways.

    Args:
        start: The posture and the attitude of the spacecraft at the start, at rest. The task must
            have linear rows, all three or those of a planar arm's plane.
        tilt: Largest turn of the spacecraft [rad].
        margin: Least distance to the singular set [rad].
        limits: Whether joint limits count.
        directions: Number of straight lines; 360 in the plane, 1,000 in space if None.
        planned: Whether to look for broken lines.
        cell: Distance of neighbouring cells [m]; a quarter of what straight lines reach on average
            if None. At most 60 of them lie in a row from the start in the plane, 12 in space.
        progress: Called as progress(done, lines) for the straight lines.

    Returns:
        How far the tip goes in each direction, and the cells that broken lines reach.

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The task does not fit, or there is momentum.

    Example:
        >>> import numpy as np
        >>> import spacearm as sa
        >>> reach = sa.level_reach(sa.load("planar2").at([-0.6, 1.4]), np.radians(2))
        >>> bool(reach.straight.min() > 0.03)
        True
    """
    from spacearm.mission.growth import Line, grow, reach_of, shoot

    axis, cfg = level_start(start)
    arm = start.arm
    tilt = positive(tilt, "tilt", "angle [rad]")
    if not (isinstance(margin, float | int) and 0.0 <= margin < np.pi):
        raise ConfigurationError(f"margin is {margin!r}; give an angle from 0 on [rad]")
    dimension = 3 if axis is None else 2
    number = RAYS[dimension] if directions is None else whole(directions, "directions", 4)
    line = Line(cfg, tilt, float(margin), limits)
    rays = _directions(axis, number)
    led = shoot(line, rays, reach_of(arm), progress)
    point: Array = cfg.tip.translation[None]
    turn: Array = np.zeros(1)
    parent, size = np.array([-1]), 1.0
    if planned:
        size = SHARE * float(led.s.mean()) if cell is None else positive(cell, "cell", "size [m]")
        count = min(int(np.ceil(2.0 * reach_of(arm) / size)), MOST[dimension])
        point, turn, parent = grow(line, axis, size, count)
    return LevelReach(
        arm=arm, q0=cfg.q.copy(), attitude=pin.SE3ToXYZQUAT(cfg.base)[3:], tip=cfg.tip.translation,
        tilt=tilt, margin=float(margin), limits=limits, axis=axis, direction=rays,
        straight=led.s, ended=led.ended, point=point, turn=turn, parent=parent, cell=size,
    )  # fmt: skip


def level_start(start: Configuration) -> tuple[int | None, Configuration]:
    """Return the normal of a planar arm and the start, checked, the system CM at the origin."""
    arm = start.arm
    arm.require_one_tip()
    axis = turning_axis(arm)
    rows = {row for row in arm.task.indices if row < 3}
    if rows != ({0, 1, 2} - {axis}):
        raise UnsupportedError(
            f"the task {arm.task.names!r} of {arm.name} has not all linear rows of the space it "
            "moves in; straight lines of the tip need them"
        )
    still_wheels(start, "which turns the spacecraft; leave wheels out")
    if start.momentum.any():
        raise UnsupportedError(
            f"the start has the momentum {start.momentum.tolist()}, which turns the spacecraft "
            "whatever the arm does; leave momentum out"
        )
    return axis, start.centred(np.zeros(3))


def _directions(axis: int | None, number: int) -> Array:
    """Return unit vectors (number, 3), in the plane with this normal or in space."""
    if axis is None:
        return sphere(number)
    angle = 2.0 * np.pi * np.arange(number) / number
    x, y = ((axis + 1) % 3, (axis + 2) % 3)
    rays = np.zeros((number, 3))
    rays[:, x], rays[:, y] = np.cos(angle), np.sin(angle)
    return rays
