"""The search for the attitudes from which the tip can follow a path."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, Progress, positive, whole
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.mission.attitudes import Ball, FeasibleAttitudes
from spacearm.model.arguments import of_configuration
from spacearm.model.arm import Configuration, SpaceArm, still_wheels
from spacearm.motion.tip_path import Path, path_start, segments
from spacearm.planning.many_curves import turning_axes

MARGIN = float(np.radians(1.0))
"""Default least distance to the singular set [rad]."""
RING = 720
"""Default number of attitudes of a planar arm."""
LEVEL = 2
"""Default level of cells of a spatial arm: 4,608 attitudes."""


@of_configuration
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
    corner: at each attitude the arm takes a posture with the tip there, and the tip then follows
    the path by J*, as `sa.follow` does. The attitude is feasible if the tip arrives, no
    configuration on the way is nearer than `margin` to the singular set (to first order, as
    `SingularityReport.distance`), and no joint leaves its limits. All attitudes are followed at
    once. `python benchmarks/attitudes.py` prints how long it takes.

    Args:
        start: A posture and an attitude with the tip near the beginning of the path. The postures
            at other attitudes are those it goes over into while the spacecraft turns and the tip is
            held: the same branch, up to where the arm cannot reach or its Jacobian with the
            attitude held is singular. The attitude of a planar arm must be a turn about the normal
            of its plane. With momentum, which must be angular, the result depends on `speed`.
        path: As for `follow`, from the system CM [m]; its first corner is where the tip begins.
        all_branches: Look for all branches from random postures instead, which may miss some, and
            take the best at each attitude; the posture of `start` does not count.
        length: Length of a path given as a function [m] or [rad].
        margin: Least distance to the singular set [rad]; zero asks only that none is met.
        speed: Speed of the tip along the path [m/s], or [rad/s] in a mere turn.
        limits: Whether joint limits count.
        samples: Number of attitudes tried at first: of planar arms 720 if None; of others at least
            so many cells of equal volume, 72 times a power of 8, 4,608 if None.
        refine: How many times the cells at the border are divided into eight, for spatial arms.
        seed: Seed of the random postures.
        progress: Called as progress(done, attitudes) during the first pass.

    Returns:
        The attitudes tried with what came of each, the intervals of a planar arm, the largest ball.

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
    arm = start.arm
    arm.require_one_tip()
    axis = turning_axis(arm)
    if not (isinstance(margin, float | int) and 0.0 <= margin < np.pi):
        raise ConfigurationError(f"margin is {margin!r}; give an angle from 0 on [rad]")
    speed = positive(speed, "speed", "speed [m/s]")
    h = start.momentum
    if h[:3].any():
        raise ConfigurationError(
            f"momentum has the linear part {h[:3].tolist()}; the path is given from the system CM, "
            "which that moves: leave it zero"
        )
    still_wheels(start, "which turns with the spacecraft; leave wheels out")
    first = _attitude(start, axis)
    cfg = start.centred(np.zeros(3))
    tip = path_start(cfg, path)
    pieces = segments(cfg, path, length, tip)
    posture = None if all_branches else start.q

    from spacearm.mission.ring import survey_ring
    from spacearm.mission.sphere import at_border, largest_ball, survey_sphere, volume
    from spacearm.mission.survey import Survey
    from spacearm.motion.runs.leading import Settings, table_of

    settings = Settings(h[3:] / speed, limits, care=margin)
    survey = Survey(arm, tip, table_of([pieces]), settings, posture, first, seed)
    weight: Array
    intervals: Array | None = None
    if axis is not None:
        number = RING if samples is None else whole(samples, "samples", 8)
        survey = survey.closely()
        found, angle, ends = survey_ring(survey, axis, margin, number, progress)
        ahead, behind = np.roll(angle, -1) - angle, angle - np.roll(angle, 1)
        weight = (ahead % (2.0 * np.pi) + behind % (2.0 * np.pi)) / (4.0 * np.pi)
        inside = found.feasible(margin)
        border = (inside != np.roll(inside, 1)) | (inside != np.roll(inside, -1))
        ball, cell = _longest(axis, ends), np.zeros((len(angle), 3), dtype=np.int64)
        intervals = ends
    else:
        least = 72 * 8**LEVEL if samples is None else whole(samples, "samples", 1)
        level = max(0, int(np.ceil(np.log2(least / 72.0) / 3.0 - 1e-9)))
        found, of, levels = survey_sphere(
            survey, margin, level, whole(refine, "refine", 0), progress
        )
        cell = np.column_stack((levels, of))
        weight, border = volume(levels), at_border(found, levels, margin)
        ball = Ball(*largest_ball(survey, found, margin)) if found.feasible(margin).any() else None
    return FeasibleAttitudes(
        arm=arm, path=path, margin=float(margin), limits=limits, momentum=h, speed=speed,
        length=sum(piece.length for piece in pieces), **found._asdict(), weight=weight, axis=axis,
        intervals=intervals, cell=cell, border=border, ball=ball,
    )  # fmt: skip


def turning_axis(arm: SpaceArm) -> int | None:
    """Return the axis about which a planar arm turns its spacecraft; None for spatial arms.

    Raises:
        UnsupportedError: The path cannot be followed in all rows of the task, or the rows depend on
            the attitude.
    """
    if arm.task.k > arm.n:
        raise UnsupportedError(
            f"{arm.name} has {arm.n} joints and a task of {arm.task.k} rows; no path can be "
            "followed in all of them"
        )
    axes = turning_axes(arm)
    axis = axes[0] if len(axes) == 1 else None
    if not arm.task.singled_out <= {axis}:
        raise UnsupportedError(
            f"the task {arm.task.names!r} of {arm.name} singles out directions that turn with the "
            "spacecraft, so that its rows depend on the attitude; take position, orientation or "
            "pose, or the rows in the plane of a planar arm"
        )
    return axis


def _attitude(start: Configuration, axis: int | None) -> Array:
    """Return the attitude (4,) of a start, checked, as a quaternion xyzw."""
    R = start.base.rotation
    if axis is not None and R[axis, axis] < 1.0 - 1e-9:
        raise ConfigurationError(
            f"base turns the plane of the arm; give a turn about {'xyz'[axis]}, the normal of it"
        )
    return np.asarray(pin.Quaternion(R).coeffs())


def _longest(axis: int, intervals: Array) -> Ball | None:
    """Return the longest interval as a ball."""
    if not len(intervals):
        return None
    low, high = intervals[np.argmax(np.diff(intervals)[:, 0])]
    quaternion = np.zeros(4)
    quaternion[axis], quaternion[3] = np.sin(0.25 * (low + high)), np.cos(0.25 * (low + high))
    return Ball(quaternion, float(0.5 * (high - low)))
