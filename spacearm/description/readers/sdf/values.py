"""SDF values: checked numbers, vectors and poses out of the text of elements."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from lxml import etree

from spacearm.arrays import LARGEST, LEAST_MASS, Array
from spacearm.description.bodies import Inertial
from spacearm.description.readers.arithmetic import evaluate
from spacearm.description.readers.xml import Source, describe

UNLIMITED = 1e15
"""Limits beyond it are SDFormat's way to say that there is none (±1e16)."""


NO_LIMIT = ("", "inf", "+inf", "-inf", "infinity", "-infinity")


def vector(source: Source, parent: etree._Element, tag: str, default: str) -> Array:
    """Read the finite numbers in a child element, as many as the default has."""
    element = source.child(parent, tag)
    if element is None:
        return np.array([float(word) for word in default.split()])
    return source.values(element, f"<{tag}>", element.text or "", len(default.split()))


def number(source: Source, parent: etree._Element, tag: str, default: float) -> float:
    """Read the finite number in a child element."""
    return float(vector(source, parent, tag, repr(default))[0])


def limit(source: Source, parent: etree._Element | None, tag: str, none: float) -> float:
    """Read a limit, which may be infinite; `none` where there is none."""
    element = None if parent is None else source.child(parent, tag)
    if element is None or (text := (element.text or "").strip().lower()) in NO_LIMIT:
        return none
    value = evaluate(text)
    if value is None:
        source.fail(f"{describe(element)} is {text[:60]!r}", "give a number, or inf for no limit")
    return none if abs(value) > UNLIMITED else value


def pose(source: Source, parent: etree._Element) -> pin.SE3:
    """Read the <pose> of an element: position and roll, pitch, yaw, or a quaternion xyzw."""
    element = source.child(parent, "pose")
    if element is None or not (element.text or "").strip():
        return pin.SE3.Identity()
    turned = element.get("rotation_format", "euler_rpy")
    if turned == "quat_xyzw":
        values = source.values(element, "<pose>", element.text or "", 7)
        size = float(np.linalg.norm(values[3:]))
        if size < 1e-9:
            source.fail(f"{describe(element)} has a zero quaternion", "give one of length 1")
        return pin.SE3(pin.Quaternion(values[3:] / size).matrix(), values[:3])
    values = source.values(element, "<pose>", element.text or "", 6)
    if element.get("degrees") in ("true", "1"):
        values[3:] = np.radians(values[3:])
    return pin.SE3(pin.rpy.rpyToMatrix(values[3:]), values[:3])


def relative_to(parent: etree._Element) -> str:
    """Return the frame that the <pose> of an element names; an empty text for the default."""
    element = parent.find("pose")
    return "" if element is None else element.get("relative_to", "")


def inertial(source: Source, link: etree._Element) -> Inertial | None:
    """Read the <inertial> of a link, with SDFormat's defaults of 1 kg and 1 kg m^2."""
    name = link.get("name")
    element = source.child(link, "inertial")
    if element is None:
        source.warn(f"link {name!r} has no <inertial>: 1 kg and 1 kg m^2, SDFormat's default")
        return Inertial(1.0, pin.SE3.Identity(), np.eye(3))
    if element.get("auto") in ("true", "1"):
        source.warn(
            f"link {name!r} has <inertial auto='true'>, which is not computed here; load with "
            "density= (SDFormat's default is 1000 kg/m^3)"
        )
        return None
    mass = number(source, element, "mass", 1.0)
    if mass < 0.0 or 0.0 < mass < LEAST_MASS:
        source.fail(
            f"the <mass> of link {name!r} is {mass:g} kg", f"give at least {LEAST_MASS:g} kg"
        )
    given = source.child(element, "inertia")
    I = np.eye(3)
    if given is not None:
        for i in range(3):
            for j in range(i, 3):
                entry = number(source, given, f"i{'xyz'[i]}{'xyz'[j]}", float(i == j))
                I[i, j] = I[j, i] = entry
    elif mass:
        source.warn(f"link {name!r} has no <inertia>: 1 kg m^2, SDFormat's default")
    return Inertial(mass, pose(source, element), I if mass or given is not None else 0.0 * I)


def words(element: etree._Element, tag: str) -> str:
    """Return the text of a child element, without blanks around it."""
    return (element.findtext(tag) or "").strip()


def largest(value: float) -> float:
    """Return a limit of effort or velocity: SDFormat writes a negative one where there is none."""
    return math.inf if value < 0.0 or value > LARGEST else value
