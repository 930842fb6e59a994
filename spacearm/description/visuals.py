"""Looks: what is drawn of a link, as the XML of its <link> without physics.

A look stands for itself: materials are written out in it and mesh files have absolute names, so
that it can be taken into another robot.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy

import pinocchio as pin
from lxml import etree
from lxml.builder import E

from spacearm.arrays import Array

DRAWN = ("visual", "collision")


def look_of(
    link: etree._Element,
    materials: Mapping[str | None, etree._Element],
    place: Callable[[str], str],
) -> bytes | None:
    """The look of a link, None if nothing is drawn of it.

    Args:
        link: The <link>.
        materials: The robot's materials by name, for those that the link only names.
        place: Gives the absolute name of a mesh file.
    """
    drawn = [deepcopy(child) for child in link if child.tag in DRAWN]
    if not drawn:
        return None
    look = E.link(*drawn, name=link.get("name", ""))
    for material in look.findall("visual/material"):
        known = materials.get(material.get("name"))
        if known is not None and len(material) == 0:
            material.extend(deepcopy(child) for child in known)
    for mesh in look.iter("mesh"):
        mesh.set("filename", place(mesh.get("filename", "")))
    return etree.tostring(look)


def renamed(look: bytes, prefix: str) -> bytes:
    """The look with `prefix` before the names of the link and its materials."""
    link = etree.fromstring(look)
    for named in (link, *link.findall("visual/material")):
        if name := named.get("name"):
            named.set("name", prefix + name)
    return etree.tostring(link)


def box_look(name: str, pose: pin.SE3, size: Array, rgba: str, *, solid: bool) -> bytes:
    """A box with these edges [m] at a pose in the link frame; if solid nothing may enter it."""

    def geometry() -> etree._Element:
        return E.geometry(E.box(size=text(size)))

    material = E.material(E.color(rgba=rgba), name=name)
    parts = [E.visual(origin(pose), geometry(), material)]
    if solid:
        parts.append(E.collision(origin(pose), geometry()))
    return etree.tostring(E.link(*parts, name=name))


def origin(pose: pin.SE3) -> etree._Element:
    """<origin> of a pose."""
    return E.origin(xyz=text(pose.translation), rpy=text(pin.rpy.matrixToRpy(pose.rotation)))


def text(values: Array) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(value)) for value in values)
