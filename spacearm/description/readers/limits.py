"""Limits and friction: <limit> and <dynamics> of the joints of a URDF.

Writers of limits mean different things by infinite and by zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from lxml import etree

from spacearm.arrays import LARGEST
from spacearm.description.bodies import Joint
from spacearm.description.readers.arithmetic import evaluate
from spacearm.description.readers.xml import Source, describe
from spacearm.errors import listed

INFINITE = ("", "inf", "infinity", ".inf")
MANY_TURNS = 30.0
"""Angle [rad] beyond which a limit looks like one in degrees."""


class Limits(NamedTuple):
    """Limits of a joint, infinite where there is none.

    Attributes:
        lower: Least angle [rad] or displacement [m].
        upper: Largest angle [rad] or displacement [m].
        velocity: Largest rate [rad/s] or [m/s].
        effort: Largest torque [N m] or force [N].
    """

    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf


def read_limits(source: Source, joint: etree._Element, kind: str) -> Limits:
    """Read the limits of a joint; URDF takes a missing lower or upper one as 0.

    A range from 0 to 0 and a rate or an effort of 0 are what exporters write where they know
    nothing: no limits. See `warn_of_limits`.

    Args:
        source: The file.
        joint: Its <joint>.
        kind: As in `Joint`.

    Raises:
        ModelError: They are not numbers, negative or reversed.
    """
    limit = source.child(joint, "limit")
    if limit is None or kind not in ("revolute", "continuous", "prismatic", "wheel"):
        return Limits()
    velocity, effort = (_bound(source, limit, name) or math.inf for name in ("velocity", "effort"))
    if min(velocity, effort) < 0.0:
        source.fail(
            f"{describe(limit)} has velocity {velocity:g} and effort {effort:g}",
            "give positive numbers",
        )
    unlimited = Limits(velocity=velocity, effort=effort)
    if kind in ("continuous", "wheel") or not (limit.get("lower") or limit.get("upper")):
        return unlimited
    lower, upper = (_bound(source, limit, name, "0", sign) for name, sign in ENDS)
    if lower > upper:
        source.fail(
            f"{describe(limit)} is reversed (lower {lower:g}, upper {upper:g})",
            "exchange the two (a missing one counts as 0)",
        )
    return unlimited if lower == upper == 0.0 else unlimited._replace(lower=lower, upper=upper)


ENDS = (("lower", -1.0), ("upper", 1.0))


def _bound(
    source: Source, limit: etree._Element, name: str, default: str = "inf", sign: float = 1.0
) -> float:
    """Read one number of a <limit>; one too large to be meant is infinite."""
    text = limit.get(name, default).strip().lower()
    if text.lstrip("+-") in INFINITE:
        return -math.inf if text.startswith("-") else sign * math.inf
    try:
        huge = abs(float(text)) > LARGEST
    except ValueError:
        huge = False
    return math.copysign(math.inf, float(text)) if huge else source.number(limit, name, default)


def read_dynamics(source: Source, joint: etree._Element) -> tuple[float, float]:
    """Read the damping and the dry friction of a joint; what is not a number from 0 on is not one.

    Args:
        source: The file, which is warned.
        joint: Its <joint>.
    """
    dynamics, found = joint.find("dynamics"), [0.0, 0.0]
    for i, name in enumerate(("damping", "friction")):
        text = "" if dynamics is None else dynamics.get(name, "").strip()
        if not text:
            continue
        value = evaluate(text)
        if value is not None and 0.0 <= value <= LARGEST:
            found[i] = value
        else:
            source.warn(f"{name}={text[:60]!r} of joint {joint.get('name')!r} is taken as none")
    return found[0], found[1]


def warn_of_limits(source: Source, robot: etree._Element, joints: Mapping[str, Joint]) -> None:
    """Warn of limits that are missing, that are not used or that look like degrees.

    Args:
        source: The file.
        robot: Its root element.
        joints: Its joints, read.
    """
    given = {e.get("name", ""): e.find("limit") for e in robot.findall("joint")}
    kinds = ("revolute", "prismatic")
    free = [j.name for j in joints.values() if j.kind in kinds and _endless(j)]
    if free:
        source.warn(f"no limits on {listed(free)}: taken as unlimited")
    turning = [
        name
        for name, limit in given.items()
        if limit is not None and (limit.get("lower") or limit.get("upper"))
        if name in joints and joints[name].kind == "continuous" and joints[name].mimic is None
    ]
    if turning:
        source.note(f"limits of {listed(turning)} do not count, as for all continuous joints")
    for end, what in (("velocity", "rate"), ("effort", "effort")):
        zero = [
            name
            for name, limit in given.items()
            if limit is not None and name in joints and joints[name].movable
            if limit.get(end) and math.isinf(getattr(joints[name], end))
            if limit.get(end, "").strip().lower().lstrip("+-") not in INFINITE
        ]
        if zero:
            source.note(f"{what} limit of {listed(zero)} is zero or endless: taken as none")
    far = [
        j.name
        for j in joints.values()
        if j.kind == "revolute" and any(MANY_TURNS < abs(x) < math.inf for x in (j.lower, j.upper))
    ]
    if far:
        source.warn(f"limits of {listed(far)} look like degrees, and are taken as radians")


def _endless(joint: Joint) -> bool:
    return math.isinf(joint.lower) and math.isinf(joint.upper)
