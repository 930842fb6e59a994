"""Where the tip can go while the spacecraft stays level: turned by no more than a given angle.

Straight lines of the tip are followed in all directions until the spacecraft has turned too far.
Broken lines go farther: cells of space are reached one from the next, by whatever way turns the
spacecraft least. Its attitude depends on the path, as w_0 dt is not a differential of a function.
An envelope has both over the mass of the bus.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import product

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, ArrayLike, Integers, Progress, finite, positive, whole, within
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.mechanics.arm_kernels import parameters_of, structure_of
from spacearm.mission.attitudes import turning_axis
from spacearm.mission.rotations import angle_between
from spacearm.model.arm import Configuration, SpaceArm, still_wheels
from spacearm.model.frames import evenly_spread
from spacearm.motion.following import Followed, follow
from spacearm.motion.goal import as_goal
from spacearm.motion.leading import Led, PathTable, Settings, lead_all
from spacearm.processes import check_memory
from spacearm.results import Cell, Column, Description, Measure, Result, Table
from spacearm.signatures import checked

#: Default number of directions, in the plane and in space.
RAYS = {2: 360, 3: 1000}
#: Numbers that are kept for each direction: poses, rotations, the run; and joint positions.
RAY_NUMBERS, RAY_NUMBERS_PER_JOINT = 60, 4
#: Default distance of cells, as a share of what straight lines reach on average.
SHARE = 0.25
#: Most cells from the tip's start to the border of what is searched.
MOST = {2: 60, 3: 12}
#: States that are kept of each cell: the spacecraft's attitude there depends on the way.
STATES = 2
#: How accurately lines are followed.
FOLLOWING = Settings(tolerance=1e-8, stride=0.01, least_stride=1e-3)


class LevelReach(Result):
    """Where the tip can go with the spacecraft turned by no more than `tilt` on the way.

    Positions are from the system CM, along inertial axes; the attitude of the tip is kept.

    Attributes:
        arm: The arm.
        q0: (n,) joint positions at the start.
        attitude: (4,) attitude of the spacecraft then, quaternion xyzw.
        tip: (3,) position of the tip at the start [m].
        tilt: The largest turn of the spacecraft [rad].
        margin: Least distance to the singular set on the way, to first order [rad].
        limits: Whether joint limits count.
        axis: The normal of a planar arm's plane (0, 1, 2); None for spatial arms.
        direction: (d, 3) unit vectors of straight lines, evenly spread.
        straight: (d,) how far the tip can go along each [m].
        ended: (d,) what ended each line, an index in `ENDS` of
            `spacearm.mission.attitudes`.
        point: (p, 3) centres of the cells that lines with corners reach, the start first [m].
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
    ended: Integers
    point: Array
    turn: Array
    parent: Integers
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

    def motion(self, point: ArrayLike) -> Followed:
        """Return the motion along lines with corners to the cell of a point, by `sa.follow`.

        Args:
            point: (3,) the point, from the system CM [m].

        Raises:
            NoSolutionError: The cell is not reached, or lines with corners were not asked for
                (`planned`).
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
        return follow(cfg, goals, limits=self.limits)

    not_checked = "collisions"

    def describe(self) -> Description:
        """Describe how far the tip gets along straight lines and along lines with corners."""
        unit, reach = "m³" if self.axis is None else "m²", self.straight
        facts: dict[str, Cell] = {
            "worst direction": Measure(reach.min(), "m"),
            "mean over all directions": Measure(reach.mean(), "m"),
            "best direction": Measure(reach.max(), "m"),
            "straight lines reach": Measure(self.volume, unit),
        }
        if len(self.point) > 1:
            facts["broken lines reach"] = Measure(self.planned_volume, unit)
        return Description(
            title=f"{self.arm.name}, turned by at most {np.degrees(self.tilt):.3g}°",
            verdict=f"straight lines from {reach.min():.4g} to {reach.max():.4g} m",
            tables=[Table.facts(facts)],
        )


class LevelEnvelope(Result):
    """How far the tip can go with a level spacecraft, over bus masses (b,) and turns (t,).

    Attributes:
        arm: The arm; its own bus is replaced.
        base_mass: (b,) masses of the spacecraft [kg].
        tilt: (t,) largest turns of the spacecraft [rad].
        least: (b, t) how far the tip can go in the worst direction [m].
        mean: (b, t) how far it can go on average over all directions [m].
        volume: (b, t) volume that straight lines reach [m^3]; for planar arms the area [m^2].
        travel: Length of the lines for the following [m].
        turn: (b,) median turn of the spacecraft by lines of this length in all directions [rad];
            NaN where none can be followed.
        largest_turn: (b,) the largest of them [rad].
        followed: (b,) share of the directions in which they can be followed.
        same_density: Whether the inertia of the bus grows as mass^(5/3), else as the mass.
    """

    arm: SpaceArm
    base_mass: Array
    tilt: Array
    least: Array
    mean: Array
    volume: Array
    travel: float
    turn: Array
    largest_turn: Array
    followed: Array
    same_density: bool

    not_checked = "collisions"

    def describe(self) -> Description:
        """Describe the turn of the bus and the reach of the tip, by the mass of the bus."""
        pairs = zip(self.turn, self.base_mass, strict=True)
        turns = ", ".join(f"{np.degrees(turn):.3g}° at {mass:g} kg" for turn, mass in pairs)
        columns: dict[Column | str, Array] = {
            Column("bus", "kg"): self.base_mass,
            Column("median turn", "rad"): self.turn,
            Column("largest turn", "rad"): self.largest_turn,
            Column("followed", "", ".1%"): self.followed,
        }
        for j, tilt in enumerate(np.degrees(self.tilt)):
            columns[Column(f"mean reach, up to {tilt:.3g}°", "m")] = self.mean[:, j]
            columns[Column(f"worst, up to {tilt:.3g}°", "m")] = self.least[:, j]
        return Description(
            title=self.arm.name,
            verdict=f"{self.travel:g} m of the tip turn the bus by {turns}",
            tables=[Table.by_columns(columns)],
        )


@checked
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

    The tip goes along straight lines in all directions, led by J* as by `follow`, with its attitude
    kept. A line ends where the spacecraft has turned too far from its start, or at a singularity or
    a joint limit. With `planned` it also goes along lines with corners: from cell to cell of a
    grid. The first two states found in each cell are kept; other paths may reach more cells.

    Args:
        start: The posture and the attitude of the spacecraft at the start, at rest. The task must
            have linear rows, all three or those of a planar arm's plane.
        tilt: Largest turn of the spacecraft [rad].
        margin: Least distance to the singular set, to first order [rad].
        limits: Whether joint limits count.
        directions: Number of straight lines; 360 in the plane, 1,000 in space if None.
        planned: Whether to look for lines with corners.
        cell: Distance of neighbouring cells [m]; a quarter of what straight lines reach on average
            if None. At most 60 of them lie in a row from the start in the plane, 12 in space.
        progress: Called as progress(done, lines) for the straight lines.

    Returns:
        How far the tip goes in each direction, and the cells that lines with corners reach.

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
    axis, cfg = _level_start(start)
    arm = start.arm
    tilt = positive(tilt, "tilt", "angle [rad]")
    margin = within(margin, "margin", 0.0, np.pi, "an angle [rad]")
    dimension = 3 if axis is None else 2
    number = RAYS[dimension] if directions is None else whole(directions, "directions", 4)
    need = 8.0 * number * (RAY_NUMBERS + RAY_NUMBERS_PER_JOINT * arm.n)
    check_memory(need, f"a reach along {number:,} directions", "use fewer directions")
    ends = FOLLOWING._replace(limits=limits, most_tilt=tilt, margin=margin)
    rays, farthest = _directions(axis, number), _longest_reach(arm)
    led = _along_rays(cfg, rays, farthest, ends, progress)
    point: Array = cfg.tip.translation[None]
    turn: Array = np.zeros(1)
    parent, size = np.array([-1]), 1.0
    if planned:
        size = SHARE * float(led.s.mean()) if cell is None else positive(cell, "cell", "size [m]")
        count = min(int(np.ceil(2.0 * farthest / size)), MOST[dimension])
        point, turn, parent = _grown(cfg, ends, axis, size, count)
    return LevelReach(
        arm=arm, q0=cfg.q.copy(), attitude=pin.SE3ToXYZQUAT(cfg.base)[3:], tip=cfg.tip.translation,
        tilt=tilt, margin=margin, limits=limits, axis=axis, direction=rays,
        straight=led.s, ended=led.ended, point=point, turn=turn, parent=parent, cell=size,
    )  # fmt: skip


@checked
def level_envelope(
    start: Configuration,
    tilts: Sequence[float],
    base_masses: Sequence[float],
    *,
    travel: float = 0.1,
    same_density: bool = True,
    directions: int | None = None,
    limits: bool = True,
    progress: Progress | None = None,
) -> LevelEnvelope:
    """Compute how far the tip can go over the mass of the bus and the turn allowed.

    Args:
        start: As in `level_reach`; the mass of its bus is replaced.
        tilts: Largest turns of the spacecraft [rad].
        base_masses: Masses of the spacecraft [kg].
        travel: Length of a straight line of the tip whose turn is computed as well [m].
        same_density: Whether the inertia of the bus grows as mass^(5/3), as that of larger buses
            of one shape and density; else it grows as the mass. The mount stays where it is.
        directions: As in `level_reach`.
        limits: As in `level_reach`.
        progress: Called as progress(done, masses).

    Returns:
        Reach over bus masses and turns, and the turn by lines of the length `travel`.

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The task does not fit, or there is momentum.

    Example:
        >>> import spacearm as sa
        >>> start = sa.load("planar2").at([-0.6, 1.4])
        >>> light, heavy = sa.level_envelope(start, [0.02], [30.0, 300.0]).turn
        >>> bool(heavy < 0.1 * light)
        True
    """
    travel = positive(travel, "travel", "length [m]")
    masses: Array = np.array([positive(m, "base_masses", "mass [kg]") for m in base_masses])
    angles: Array = np.array([positive(t, "tilts", "angle [rad]") for t in tilts])
    if not (len(masses) and len(angles)):
        raise ConfigurationError("tilts or base_masses is empty; give one value or several")
    arm = start.arm
    bus = arm.model.inertias[1]
    shape = (len(masses), len(angles))
    least, mean, volume = np.empty(shape), np.empty(shape), np.empty(shape)
    turn, largest, followed = (np.full(len(masses), np.nan) for _ in range(3))
    for i, mass in enumerate(masses):
        ratio = mass / bus.mass
        inertia = bus.inertia * ratio ** (5.0 / 3.0 if same_density else 1.0)
        heavier = arm.replace(base_mass=float(mass), base_inertia=inertia)
        begin = heavier.at(start.q, base=start.base, wheels=start.wheels, momentum=start.momentum)
        for j, tilt in enumerate(angles):
            found = level_reach(begin, float(tilt), directions=directions, limits=limits)
            least[i, j], mean[i, j] = found.straight.min(), found.straight.mean()
            volume[i, j] = found.volume
        ends = FOLLOWING._replace(limits=limits, most_tilt=np.pi)
        led = _along_rays(begin.centred(np.zeros(3)), found.direction, travel, ends)
        arrived = led.ended == 0
        followed[i] = arrived.mean()
        if arrived.any():
            turn[i], largest[i] = np.median(led.tilt[arrived]), led.tilt[arrived].max()
        if progress:
            progress(i + 1, len(masses))
    return LevelEnvelope(
        arm, masses, angles, least, mean, volume, travel, turn, largest, followed, same_density
    )


def _level_start(start: Configuration) -> tuple[int | None, Configuration]:
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
        return evenly_spread(number)
    angle = 2.0 * np.pi * np.arange(number) / number
    x, y = ((axis + 1) % 3, (axis + 2) % 3)
    rays = np.zeros((number, 3))
    rays[:, x], rays[:, y] = np.cos(angle), np.sin(angle)
    return rays


def _longest_reach(arm: SpaceArm) -> float:
    """Return the length of the arm from the spacecraft to the tip, all joints included [m]."""
    tree, p = structure_of(arm), parameters_of(arm)
    chain = tree.reaches[0] > 0.0
    lengths = np.linalg.norm(p.joint_positions[chain], axis=1)
    slides = chain & np.array(tree.slides[1:])
    spans = np.abs(tree.gains[slides]) @ np.nan_to_num(arm.upper - arm.lower, posinf=0.0)
    return float(lengths.sum() + np.linalg.norm(p.tip_positions[0]) + spans.sum())


def _attitude(cfg: Configuration) -> Array:
    """Return the attitude of the spacecraft (4,), quaternion xyzw."""
    return np.asarray(pin.SE3ToXYZQUAT(cfg.base)[3:])


def _along_rays(
    start: Configuration,
    rays: Array,
    length: float,
    ends: Settings,
    progress: Progress | None = None,
) -> Led:
    """Follow straight lines from a start in directions (d, 3)."""
    m, tip = len(rays), start.tip
    corners = np.tile(tip.translation, (m, 1))
    paths = _straight(corners, corners + length * rays, tip.rotation)
    q, attitude = np.tile(start.q, (m, 1)), np.tile(_attitude(start), (m, 1))
    return lead_all(start.arm, q, attitude, paths, np.arange(m), ends, progress)


def _straight(start: Array, end: Array, attitude: Array) -> PathTable:
    """Return straight paths (m, 3) to (m, 3), the attitude (3, 3) of the tip kept."""
    m, way = len(start), end - start
    length, none = np.linalg.norm(way, axis=1), np.zeros(m)
    turns = np.tile(np.append(attitude.ravel(), np.zeros(9)), (m, 1))
    return PathTable(
        first=np.arange(m + 1),
        pieces=np.column_stack((none, length, np.arange(m), none + 1.0)),
        intervals=np.hstack((start, end, way, way, turns)),
    )


def _grown(
    start: Configuration, ends: Settings, axis: int | None, cell: float, count: int
) -> tuple[Array, Array, Integers]:
    """Reach cells of a grid one from the next by straight lines.

    Args:
        start: Where the first lines begin, the system CM at the origin.
        ends: What ends a line.
        axis: The normal of a planar arm's plane; None in space.
        cell: Distance of neighbouring cells [m].
        count: Cells from the start to the border of the grid.

    Returns:
        The middles (p, 3) of the cells reached, the start's first, once for each state. The turn
        of the spacecraft in each state (p,). The state (p,) from which it is reached, -1 of the
        start.
    """
    arm, tip, home = start.arm, start.tip, _attitude(start)
    steps = np.array([
        step for step in product((-1, 0, 1), repeat=3)
        if any(step) and (axis is None or step[axis] == 0)
        and (axis is not None or np.abs(step).sum() == 1)
    ])  # fmt: skip
    q, attitude = start.q[None], home[None]
    place, parent, turn = np.zeros((1, 3), dtype=np.int64), np.array([-1]), np.zeros(1)
    known = {(0, 0, 0): STATES}
    last = np.array([0])
    while len(last):
        origin = np.repeat(last, len(steps))
        goal = (place[last][:, None] + steps).reshape(-1, 3)
        room = [known.get(tuple(g), 0) < STATES for g in goal.tolist()]
        kept = np.array(room) & (np.linalg.norm(goal, axis=1) <= count)
        origin, goal = origin[kept], goal[kept]
        if not len(goal):
            break
        corners = tip.translation + cell * np.stack((place[origin], goal))
        paths = _straight(corners[0], corners[1], tip.rotation)
        led = lead_all(
            arm, q[origin], attitude[origin], paths, np.arange(len(goal)), ends, home=home
        )  # fmt: skip
        tilt = np.asarray(angle_between(led.attitude, home))
        new: list[int] = []
        for i in np.argsort(tilt, kind="stable"):  # the least turned first
            where = tuple(goal[i].tolist())
            if led.ended[i] == 0 and known.get(where, 0) < STATES:
                known[where] = known.get(where, 0) + 1
                new.append(int(i))
        first = len(place)
        place, parent = np.vstack((place, goal[new])), np.append(parent, origin[new])
        q, attitude = np.vstack((q, led.q[new])), np.vstack((attitude, led.attitude[new]))
        turn = np.append(turn, tilt[new])
        last = np.arange(first, len(place))
    return tip.translation + cell * place, turn, parent.astype(np.int64)
