"""Many motions along paths of the tip at once, by compiled kernels. Imports the compiler."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array
from spacearm.kernels.lanes import LANES
from spacearm.kernels.paths.lane import COMPONENTS
from spacearm.kernels.paths.leading import lead
from spacearm.kernels.paths.table import Table
from spacearm.kernels.paths.tangent import Problem
from spacearm.kernels.processors import processors
from spacearm.mechanics.compiled import bodies, frame_on_body
from spacearm.model.arm import SpaceArm
from spacearm.model.scale import radians
from spacearm.motion.events import NEAR
from spacearm.motion.tip_path import Segment

ENDS = ("arrived", "singularity", "joint limit", "tilt", "margin", "gave up")
"""How a motion ends, in the order of the kernel's numbers."""
KNOTS = 400
"""Intervals of a path given as a function."""
PIECES = 8
"""Number of pieces of work for each thread."""


class Settings(NamedTuple):
    """What ends motions, and how accurately they are integrated.

    Attributes:
        momentum: (3,) angular momentum about the system CM, inertial axes, over the speed of the
            tip; of a path whose length is a time, the momentum itself.
        limits: Whether joint limits end a motion.
        most_tilt: Turn of the spacecraft that ends it [rad].
        margin: Distance to the singular set that ends it [rad].
        tolerance: Error of a step in each component of the state.
        stride: Longest step along the curve in joint space [rad].
        least_stride: Steps near joint limits, or where the distance is near `care`, need not be
            shorter than this [rad].
        care: Distance to the singular set whose crossing matters [rad].
    """

    momentum: Array | None = None
    limits: bool = True
    most_tilt: float = np.inf
    margin: float = 0.0
    tolerance: float = 1e-6
    stride: float = 0.2
    least_stride: float = 0.01
    care: float = 0.0


class Led(NamedTuple):
    """What came of m motions.

    Attributes:
        ended: (m,) index in `ENDS`.
        s: (m,) length of path behind the tip.
        distance: (m,) least distance to the singular set on the way [rad]; zero where it was met.
        where: (m,) length of path at which it was least.
        slack: (m,) least distance of a joint to its limits [rad] or [m].
        tilt: (m,) largest turn of the spacecraft on the way [rad].
        steps: (m,) number of steps tried.
        q: (m, n) joint positions at the end.
        attitude: (m, 4) attitude of the spacecraft then, quaternion xyzw.
    """

    ended: npt.NDArray[np.int64]
    s: Array
    distance: Array
    where: Array
    slack: Array
    tilt: Array
    steps: Array
    q: Array
    attitude: Array


def lead_all(
    arm: SpaceArm,
    q: Array,
    attitude: Array,
    paths: Table,
    which: npt.NDArray[np.int_] | None = None,
    settings: Settings | None = None,
    progress: Callable[[int, int], object] | None = None,
    home: Array | None = None,
) -> Led:
    """Lead the tip along a path from m starts, the system CM at the origin.

    Arms with more joints than task rows meet singularities half a degree off, as in `follow`.

    Args:
        arm: The arm; its task must not single out directions that turn with the spacecraft.
        q: (m, n) joint positions at the start.
        attitude: (m, 4) attitudes of the spacecraft then, quaternions xyzw.
        paths: The paths, by `table_of`.
        which: (m,) which of them each motion takes; the first if None.
        settings: What ends motions.
        progress: Called as progress(done, m).
        home: (4,) the attitude from which the turn of the spacecraft counts; that at the start of
            each motion if None.
    """
    how = settings or Settings()
    near = NEAR if arm.n > arm.task.k else 0.0  # det J* has no sign there: as `follow` has it
    (m, n), (b, tip, E) = q.shape, bodies(arm)
    path = np.zeros(m, np.int64) if which is None else which.astype(np.int64)
    bounds = (arm.lower, arm.upper) if how.limits else (np.full(n, -np.inf), np.full(n, np.inf))
    momentum = np.zeros(3) if how.momentum is None else how.momentum
    problem = Problem(
        offset=np.concatenate(([0.0], np.broadcast_to(arm.offsets, len(b) - 1))),
        rows=np.array(arm.task.indices),
        scale=np.array(arm.task.scale[:, 0], dtype=np.float64),
        radian=np.asarray(radians(arm), dtype=np.float64),
        h=np.array(momentum, dtype=np.float64),
        lower=np.array(bounds[0], dtype=np.float64),
        upper=np.array(bounds[1], dtype=np.float64),
        most_tilt=how.most_tilt,
        margin=max(how.margin, near),
        tolerance=how.tolerance,
        stride=how.stride,
        least_stride=how.least_stride,
        care=max(how.care, how.margin),
    )
    y0 = np.ascontiguousarray(np.hstack((q, attitude)).T)
    from_ = y0[n:] if home is None else np.tile(home[:, None], (1, m))
    ends, values = np.empty_like(y0), np.empty((COMPONENTS, m))
    threads = processors()
    cuts = np.linspace(0, m, 1 + min(-(-m // LANES), threads * PIECES)).astype(int)

    def do(first: int, last: int) -> int:
        part = slice(first, last)
        y, out = np.ascontiguousarray(y0[:, part]), np.empty((n + 4, last - first))
        numbers = np.empty((COMPONENTS, last - first))
        homes = np.ascontiguousarray(from_[:, part])
        lead(b, tip, E, problem, paths, path[part], y, homes, out, numbers)
        ends[:, part], values[:, part] = out, numbers
        return last - first

    done = 0
    with ThreadPoolExecutor(threads) as pool:
        for count in pool.map(do, cuts[:-1].tolist(), cuts[1:].tolist()):
            done += count
            if progress:
                progress(done, m)
    _, s, distance, where, slack, tilt, steps = values
    met = (values[0] == ENDS.index("margin")) & (how.margin < near)
    values[0, met], distance[met] = ENDS.index("singularity"), 0.0
    q, turned = ends[:n].T.copy(), ends[n:].T.copy()
    return Led(values[0].astype(np.int64), s, distance, where, slack, tilt, steps, q, turned)


def table_of(arm: SpaceArm, paths: Sequence[Sequence[Segment]], knots: int = KNOTS) -> Table:
    """Return paths of the tip as tables for the kernels.

    Args:
        arm: The arm.
        paths: The pieces of each path; straight ones take one interval.
        knots: Number of intervals of the others.
    """
    own = frame_on_body(arm, arm.tip_frame).rotation.T  # from the tip's frame to that of its body
    first, begin, end, interval = [0], [], [], [0]
    places, attitudes, turns = [], [], []
    for path in paths:
        s = 0.0
        for piece in path:
            count = 1 if piece.straight else knots
            grid = np.linspace(0.0, piece.length, count + 1)
            poses, rates = [piece.pose(x) for x in grid], [piece.twist(x) for x in grid]
            for i in range(count):
                p, f = _interval(
                    poses[i], poses[i + 1], rates[i], rates[i + 1], piece.length / count
                )
                places.append(p)
                turns.append(f)
                attitudes.append(poses[i].rotation @ own)
            begin.append(s)
            s += piece.length
            end.append(s)
            interval.append(len(places))
        first.append(len(begin))
    return Table(
        np.array(first), np.array(begin), np.array(end), np.array(interval),
        np.array(places), np.array(attitudes), np.array(turns),
    )  # fmt: skip


def _interval(a: pin.SE3, b: pin.SE3, da: Array, db: Array, ds: float) -> tuple[Array, Array]:
    """Return the rows p and f of an interval of a `Table`."""
    turn = pin.log3(b.rotation @ a.rotation.T)
    at_end = np.linalg.solve(_left_jacobian(turn), ds * db[3:])
    if np.allclose(turn, ds * da[3:], rtol=0.0, atol=1e-12):  # constant: exact beyond pi, too
        at_end = ds * da[3:]
    p = np.array([a.translation, b.translation, ds * da[:3], ds * db[:3]])
    return p, np.array([turn, ds * da[3:], at_end])


def _left_jacobian(turn: Array) -> Array:
    """Return the matrix that takes the rate of a rotation vector to the angular velocity."""
    return pin.Jexp3(-turn)


def attitudes_of(R: Array) -> Array:
    """Return rotation matrices (m, 3, 3) as quaternions xyzw (m, 4)."""
    return Rotation.from_matrix(R).as_quat()
