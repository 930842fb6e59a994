"""A straight line of the tip, as `follow` leads it, by `equations.lines`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.model.configuration import Configuration
from spacearm.motion.events import CLOSE, Event
from spacearm.motion.goal import Goal
from spacearm.motion.runs.leading import (
    ENDS,
    Settings,
    lead_with_stops,
    table_of,
)
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
    table = table_of([[_shifted(whole, to_cm)]])
    attitude = pin.SE3ToXYZQUAT(start.base)[3:]
    led, reached = lead_with_stops(arm, start.q, attitude, table, POINTS, Settings(limits=limits))
    kind, s, there = ENDS[led.ended[0]], float(led.s[0]), led.q[0]
    if kind == "gave up":
        raise NoSolutionError(f"{arm.name}: the line cannot be followed beyond {s:.4g}")
    rows = np.vstack((start.q, reached if kind == "arrived" else [*reached, there]))
    detail = f", {CLOSE}" if kind == "singularity" and arm.n > arm.task.k else ""
    if kind == "joint limit":  # the last step went beyond it
        j, before = int(np.maximum(arm.lower - there, there - arm.upper).argmax()), rows[-2]
        share = (np.clip(there, arm.lower, arm.upper) - before)[j] / (there - before)[j]
        rows[-1] = np.clip(before + share * (there - before), arm.lower, arm.upper)
        detail = arm.joint_names[j]
    return Line(rows, Event(s, kind, rows[-1], detail), whole.length, whole.pose(s).translation)


def _shifted(whole: Segment, shift: Array) -> Segment:
    """Return a segment shifted."""

    def pose(s: float) -> pin.SE3:
        at = whole.pose(s)
        return pin.SE3(at.rotation, at.translation + shift)

    return whole._replace(pose=pose)
