"""A straight line of the tip by compiled kernels, as `follow` leads it; imports the compiler.

All lanes go along the same line, each to another point of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.model.configuration import Configuration
from spacearm.motion.events import CLOSE, Event
from spacearm.motion.goal import Goal
from spacearm.motion.runs.leading import ENDS, Settings, attitudes_of, lead_all, table_of
from spacearm.motion.tip_path import Segment, segments

POINTS = 128
"""Points of the line."""


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
    arm, to_cm = start.arm, -start.com
    (whole,) = segments(start, [goal], None)
    paths = [[_part(whole, i / POINTS, to_cm)] for i in range(1, POINTS + 1)]
    q = np.tile(start.q, (POINTS, 1))
    attitude = np.tile(attitudes_of(start.base.rotation), (POINTS, 1))
    table, every = table_of(arm, paths), np.arange(POINTS)
    led = lead_all(arm, q, attitude, table, every, Settings(limits=limits))
    reached = int(np.append(led.ended == 0, False).argmin())
    last = min(reached, POINTS - 1)
    kind, s, there = ENDS[led.ended[last]], float(led.s[last]), led.q[last]
    if kind == "gave up":
        raise NoSolutionError(f"{arm.name}: the line cannot be followed beyond {s:.4g}")
    rows = np.vstack((start.q, led.q[: last + 1]))
    detail = f", {CLOSE}" if kind == "singularity" and arm.n > arm.task.k else ""
    if kind == "joint limit":  # the last step went beyond it
        j, before = int(np.maximum(arm.lower - there, there - arm.upper).argmax()), rows[-2]
        share = (np.clip(there, arm.lower, arm.upper) - before)[j] / (there - before)[j]
        rows[-1] = np.clip(before + share * (there - before), arm.lower, arm.upper)
        detail = arm.joint_names[j]
    return Line(rows, Event(s, kind, rows[-1], detail), whole.length, whole.pose(s).translation)


def _part(whole: Segment, share: float, shift: Array) -> Segment:
    """Return the first part of a segment, shifted."""

    def pose(s: float) -> pin.SE3:
        at = whole.pose(s)
        return pin.SE3(at.rotation, at.translation + shift)

    return whole._replace(length=share * whole.length, pose=pose)
