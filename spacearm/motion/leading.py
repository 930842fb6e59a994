"""Motions along paths of the tip, one or many; their equations stand in `equations.lines`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, Integers
from spacearm.compiler.machine import processors
from spacearm.equations import lines
from spacearm.errors import NoSolutionError
from spacearm.mechanics.arm_kernels import ArmKernel
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.joints import joint_scales
from spacearm.motion.events import CLOSE, NEAR, Event
from spacearm.motion.following import Segment, segments
from spacearm.motion.goal import Goal

#: How a motion ends, in the order of the numbers of `equations.lines`.
ENDS = ("arrived", "singularity", "joint limit", "tilt", "margin", "gave up")
#: Intervals of a path given as a function.
KNOTS = 400
MOST_STEPS = 200_000
#: Most steps of a motion whose steps are kept.
KEPT_STEPS = 5_000
#: About so many configurations are computed for each motion.
STEPS = 500
#: Number of pieces of work between reports of progress.
PIECES = 16

#: Points of a straight line.
POINTS = 128


class PathTable(NamedTuple):
    """Paths in smooth pieces, each in equal intervals that are cubic in position and turn.

    Attributes:
        first: (paths + 1,) number of the first piece of each path, and of all pieces.
        pieces: (pieces, 4) and
        intervals: (intervals, 30), the tables of `equations.lines.at_length`.
    """

    first: Integers
    pieces: Array
    intervals: Array


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

    ended: Integers
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
    paths: PathTable,
    which: Integers | None = None,
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
    path = np.zeros(len(q), np.int64) if which is None else which
    from_ = attitude if home is None else np.tile(home, (len(q), 1))
    given = {"q": q, "attitude": attitude, "home": from_, "path": _of_path(paths, path)}
    how, (m, n) = settings or Settings(), q.shape
    ends = np.empty((m, n)), np.empty((m, 4)), np.empty((m, 7))
    kernel, numbers = _kernel(arm, False, m), _numbers(arm, how, np.inf)
    cuts = np.linspace(0, m, 1 + (PIECES if progress else 1)).astype(int).tolist()
    for begin, end in pairwise(cuts):
        part = slice(begin, end)
        kernel(
            {name: array[part] for name, array in given.items()}, numbers, _tables(paths),
            out=[whole[part] for whole in ends], threads=processors(),
        )  # fmt: skip
        if progress:
            progress(end, m)
    return _led(arm, how, *ends)


def lead_with_stops(
    arm: SpaceArm, q: Array, attitude: Array, paths: PathTable, stops: int, settings: Settings
) -> tuple[Led, Array]:
    """Lead the tip along the first of the paths from one start, and keep where it stops.

    Args:
        arm: The arm.
        q: (n,) joint positions at the start.
        attitude: (4,) attitude of the spacecraft then, quaternion xyzw.
        paths: The path, by `table_of`.
        stops: Number of equal parts of the path at whose ends the postures are wanted.
        settings: What ends the motion.

    Returns:
        What came of the motion; (i, n) postures at the stops that were reached.
    """
    path = _of_path(paths, np.zeros(1, np.int64))
    numbers = _numbers(arm, settings, path[0, 2] / stops)
    given = {"q": q[None], "attitude": attitude[None], "home": attitude[None], "path": path}
    *ends, rows = _kernel(arm, True, 1)(given, numbers, _tables(paths))
    rows = rows[0, : int(ends[2][0, 6])]
    return _led(arm, settings, *ends), rows[rows[:, 0] > 0.0, 1:]


def _of_path(paths: PathTable, which: Integers) -> Array:
    """Return (m, 3) first and last piece of paths, and their lengths."""
    first, last = paths.first[which], paths.first[which + 1] - 1
    return np.column_stack((first, last, paths.pieces[last, 1]))


def _tables(paths: PathTable) -> dict[str, Array]:
    """Return the tables of `equations.lines.lead`."""
    return {"pieces": paths.pieces, "intervals": paths.intervals}


def _kernel(arm: SpaceArm, keep: bool, m: int) -> ArmKernel:
    """Return `equations.lines.lead` of an arm for m motions."""
    options = {"most": KEPT_STEPS if keep else MOST_STEPS, "keep": keep}
    return ArmKernel([arm], "free-floating", lines.lead, options, rows=STEPS * m)


def _numbers(arm: SpaceArm, how: Settings, spacing: float) -> dict[str, Array | float]:
    """Return the numbers of `equations.lines.How`."""
    bounds = (arm.lower, arm.upper) if how.limits else np.full((arm.n, 2), (-np.inf, np.inf)).T
    return lines.How(
        h=np.zeros(3) if how.momentum is None else how.momentum,
        radians=joint_scales(arm),
        lower=bounds[0],
        upper=bounds[1],
        most_tilt=how.most_tilt,
        margin=max(how.margin, _near(arm)),
        tolerance=how.tolerance,
        stride=how.stride,
        least_stride=how.least_stride,
        care=max(how.care, how.margin),
        spacing=spacing,
    )._asdict()


def _near(arm: SpaceArm) -> float:
    """Return how far from the singular set motions meet it, as `follow` has it."""
    return NEAR if arm.n > arm.task.k else 0.0  # where det J* has no sign


def _led(arm: SpaceArm, how: Settings, q: Array, attitude: Array, values: Array) -> Led:
    """Return what came of motions from the results of `equations.lines.lead`."""
    ended, s, distance, where, slack, tilt, steps = values.T
    ended = np.where(ended == lines.RUNNING, ENDS.index("gave up"), ended).astype(np.int64)
    met = (ended == lines.MARGIN) & (how.margin < _near(arm))
    ended[met], distance[met] = lines.SINGULAR, 0.0
    return Led(ended, s, distance, where, slack, tilt, steps, q, attitude)


def table_of(paths: Sequence[Sequence[Segment]], knots: int = KNOTS) -> PathTable:
    """Return paths of the tip as a table.

    Args:
        paths: The pieces of each path; straight ones take one interval.
        knots: Number of intervals of the others.
    """
    first, pieces = [0], []
    intervals: list[Array] = []
    for path in paths:
        s = 0.0
        for piece in path:
            count = 1 if piece.straight else knots
            grid = np.linspace(0.0, piece.length, count + 1)
            pieces.append((s, s + piece.length, len(intervals), count))
            ends = pairwise((piece.pose(x), piece.twist(x)) for x in grid)
            intervals += [_interval(*a, *b, piece.length / count) for a, b in ends]
            s += piece.length
        first.append(len(pieces))
    return PathTable(np.array(first), np.array(pieces), np.array(intervals))


def _interval(a: pin.SE3, da: Array, b: pin.SE3, db: Array, ds: float) -> Array:
    """Return the row (30,) of an interval."""
    turn = pin.log3(b.rotation @ a.rotation.T)
    at_end = np.linalg.solve(pin.Jexp3(-turn), ds * db[3:])
    if np.allclose(turn, ds * da[3:], rtol=0.0, atol=1e-12):  # constant: exact beyond pi, too
        at_end = ds * da[3:]
    place = a.translation, b.translation, ds * da[:3], ds * db[:3]
    return np.concatenate((*place, a.rotation.ravel(), turn, ds * da[3:], at_end))


class Line(NamedTuple):
    """What came of leading the tip along a straight line.

    Attributes:
        q: (m, n) joint positions at the points that were reached, the start first, and at the end.
        end: How it ended: "arrived", "singularity" or "joint limit"; its time is the length of the
            line behind the tip, in the unit of `length`.
        length: Length of the line [m], or [rad] of a mere turn.
        tip: (3,) position of the tip at the end [m].
    """

    q: Array
    end: Event
    length: float
    tip: Array


def straight_line(start: Configuration, goal: Goal, limits: bool) -> Line:
    """Lead the tip of a floating arm straight to a goal, until it arrives or cannot go on.

    Args:
        start: The configuration; its arm's task singles out no direction that turns.
        goal: A pose, or a point in the task's rows [m].
        limits: Whether joint limits end the motion.

    Raises:
        NoSolutionError: The integrator gives up.
    """
    arm, (whole,) = start.arm, segments(start, [goal], None)
    table = table_of([[whole]])
    table.intervals[:, :6] -= np.tile(start.com, 2)
    attitude = pin.SE3ToXYZQUAT(start.base)[3:]
    led, reached = lead_with_stops(arm, start.q, attitude, table, POINTS, Settings(limits=limits))
    kind, s, there = ENDS[led.ended[0]], float(led.s[0]), led.q[0]
    if kind == "gave up":
        raise NoSolutionError(f"{arm.name}: the line cannot be followed beyond {s:.4g}")
    rows = np.vstack((start.q, reached[(reached != there).any(axis=1)], there))
    detail = f", {CLOSE}" if kind == "singularity" and arm.n > arm.task.k else ""
    if kind == "joint limit":  # the last step went beyond it
        j, before = int(np.maximum(arm.lower - there, there - arm.upper).argmax()), rows[-2]
        change = there - before  # zero if the start is beyond it
        share = (np.clip(there, arm.lower, arm.upper) - before)[j] / change[j] if change[j] else 0.0
        rows[-1] = np.clip(before + share * change, arm.lower, arm.upper)
        detail = arm.joint_names[j]
    return Line(rows, Event(s, kind, rows[-1], detail), whole.length, whole.pose(s).translation)
