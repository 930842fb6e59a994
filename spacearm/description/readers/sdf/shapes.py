"""SDF shapes: <visual> and <collision> of links as data; no fault in them stops a model."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import pinocchio as pin
from lxml import etree

from spacearm.description.readers.sdf.values import number, pose, vector, words
from spacearm.description.readers.xml import Source
from spacearm.description.visuals import (
    Box,
    Cylinder,
    Mesh,
    Shape,
    Sphere,
    Unusable,
    Visuals,
    capsule,
)
from spacearm.errors import ModelError


class Shapes:
    """The shapes of the links of a file."""

    def __init__(self, source: Source) -> None:
        self._source = source

    def of(
        self, link: etree._Element, placed: Callable[[etree._Element], pin.SE3 | None]
    ) -> Visuals:
        """Return the shapes of a <link>.

        Args:
            link: The link.
            placed: Returns the pose of the frame that the <pose> of an element names, in the
                frame of the link; None if it names none.
        """
        visual, collision = (
            tuple(s for e in link.findall(tag) for s in self._shapes(e, placed))
            for tag in ("visual", "collision")
        )
        return Visuals(visual, collision)

    def _shapes(
        self, element: etree._Element, placed: Callable[[etree._Element], pin.SE3 | None]
    ) -> Iterable[Shape]:
        """Read a <visual> or <collision>; an ellipsoid counts as its box."""
        try:
            at = (placed(element) or pin.SE3.Identity()) * pose(self._source, element)
            return self._geometry(element, at, self._rgba(element))
        except ModelError as error:
            return (Shape(pin.SE3.Identity(), Unusable(str(error))),)

    def _geometry(
        self, parent: etree._Element, at: pin.SE3, rgba: tuple[float, ...] | None
    ) -> Iterable[Shape]:
        source, element = self._source, parent.find("geometry/*")
        kind = "" if element is None else str(element.tag)
        if element is None or kind in ("empty", "plane"):
            return ()
        if kind == "box":
            return (Shape(at, Box(tuple(vector(source, element, "size", "1 1 1"))), rgba),)
        if kind == "sphere":
            return (Shape(at, Sphere(number(source, element, "radius", 1.0)), rgba),)
        if kind in ("cylinder", "capsule"):
            radius = number(source, element, "radius", 1.0 if kind == "cylinder" else 0.5)
            length = number(source, element, "length", 1.0)
            if kind == "capsule":
                return capsule(at, radius, length, rgba)
            return (Shape(at, Cylinder(radius, length), rgba),)
        if kind == "ellipsoid":
            radii = vector(source, element, "radii", "1 1 1")
            return (Shape(at, Box(tuple(2.0 * radii)), rgba),)
        if kind == "mesh":
            name = words(element, "uri")
            scale = vector(source, element, "scale", "1 1 1")
            return (Shape(at, Mesh(name, source.mesh(name), tuple(scale.tolist())), rgba),)
        link = parent.getparent()
        owner = "" if link is None else link.get("name", "")
        source.fail(
            f"link {owner!r} has a {parent.tag!s} of the geometry <{kind}>",
            "give it a box, sphere, cylinder, capsule, ellipsoid or mesh",
        )

    def _rgba(self, parent: etree._Element) -> tuple[float, ...] | None:
        """Read the colour of a <visual>."""
        material = parent.find("material")
        if material is None or material.find("diffuse") is None:
            return None
        return tuple(np.clip(vector(self._source, material, "diffuse", "1 1 1 1"), 0, 1).tolist())
