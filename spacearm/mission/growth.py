"""Lines of the tip on which the spacecraft stays level, many at once."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, Progress
from spacearm.mechanics.arm_kernels import parameters_of, structure_of
from spacearm.mission.rotations import angle_between
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.runs.leading import Led, Settings, Table, lead_all

STATES = 2
"""States that are kept of each cell: the spacecraft's attitude there depends on the way."""

Integers = npt.NDArray[np.int64]


class Line(NamedTuple):
    """How lines of the tip are followed.

    Attributes:
        start: Where the first of them begin, the system CM at the origin.
        tilt: Turn of the spacecraft from its attitude there that ends them [rad].
        margin: Distance to the singular set that ends them [rad].
        limits: Whether joint limits end them.
    """

    start: Configuration
    tilt: float
    margin: float
    limits: bool

    @property
    def attitude(self) -> Array:
        """(4,) attitude of the spacecraft at the start, quaternion xyzw."""
        return np.asarray(pin.SE3ToXYZQUAT(self.start.base)[3:])

    def settings(self) -> Settings:
        """Return the settings of the motions."""
        return Settings(
            limits=self.limits, most_tilt=self.tilt, margin=self.margin, tolerance=1e-8, stride=0.01
        )


def reach_of(arm: SpaceArm) -> float:
    """Return the length of the arm from the spacecraft to the tip, all joints included [m]."""
    tree, p = structure_of(arm), parameters_of(arm)
    chain = tree.reaches[0] > 0.0
    lengths = np.linalg.norm(p.joint_positions[chain], axis=1)
    slides = chain & np.array(tree.slides[1:])
    spans = np.abs(tree.gains[slides]) @ np.nan_to_num(arm.upper - arm.lower, posinf=0.0)
    return float(lengths.sum() + np.linalg.norm(p.tip_positions[0]) + spans.sum())


def shoot(line: Line, rays: Array, length: float, progress: Progress | None) -> Led:
    """Follow straight lines from the start in directions (d, 3)."""
    arm, m = line.start.arm, len(rays)
    tip = line.start.tip
    start = np.tile(tip.translation, (m, 1))
    paths = straight(start, start + length * rays, tip.rotation)
    q, attitude = np.tile(line.start.q, (m, 1)), np.tile(line.attitude, (m, 1))
    return lead_all(arm, q, attitude, paths, np.arange(m), line.settings(), progress)


def straight(start: Array, end: Array, attitude: Array) -> Table:
    """Return straight paths (m, 3) to (m, 3), the attitude (3, 3) of the tip kept."""
    m, way = len(start), end - start
    length, none = np.linalg.norm(way, axis=1), np.zeros(m)
    turns = np.tile(np.append(attitude.ravel(), np.zeros(9)), (m, 1))
    return Table(
        first=np.arange(m + 1),
        pieces=np.column_stack((none, length, np.arange(m), none + 1.0)),
        intervals=np.hstack((start, end, way, way, turns)),
    )


def waiting(tip: pin.SE3, length: Array) -> Table:
    """Return paths of lengths (m,) on which the tip stays at a pose."""
    m, place = len(length), tip.translation
    paths = straight(np.tile(place, (m, 1)), np.tile(place, (m, 1)), tip.rotation)
    paths.pieces[:, 1] = length
    return paths


def grow(line: Line, axis: int | None, cell: float, count: int) -> tuple[Array, Array, Integers]:
    """Reach cells of a grid one from the next by straight lines.

    Args:
        line: How lines are followed.
        axis: The normal of a planar arm's plane; None in space.
        cell: Distance of neighbouring cells [m].
        count: Cells from the start to the border of the grid.

    Returns:
        The middles (p, 3) of the cells reached, the start's first, once for each state; the turn of
        the spacecraft in each state (p,); the state (p,) from which it is reached, -1 of the start.
    """
    arm, tip = line.start.arm, line.start.tip
    steps = np.array([
        step for step in product((-1, 0, 1), repeat=3)
        if any(step) and (axis is None or step[axis] == 0)
        and (axis is not None or np.abs(step).sum() == 1)
    ])  # fmt: skip
    q, attitude = line.start.q[None], line.attitude[None]
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
        ends = tip.translation + cell * goal
        starts = tip.translation + cell * place[origin]
        paths = straight(starts, ends, tip.rotation)
        led = lead_all(
            arm, q[origin], attitude[origin], paths, np.arange(len(goal)), line.settings(),
            home=line.attitude,
        )  # fmt: skip
        tilt = np.asarray(angle_between(led.attitude, line.attitude))
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
