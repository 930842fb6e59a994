"""URDF visuals: <visual> and <collision> of the links of a robot as data.

No fault in them stops a robot from loading, since physics needs none of them: a shape with a fault
becomes an `Unusable`, which whoever needs the shape reports.
"""

from __future__ import annotations

import pinocchio as pin
from lxml import etree

from spacearm.description.readers.xml import Source
from spacearm.description.visuals import (
    Box,
    Cylinder,
    Geometry,
    Mesh,
    Shape,
    Sphere,
    Unusable,
    Visuals,
    capsule,
)
from spacearm.errors import ModelError


def read_visuals(source: Source, robot: etree._Element) -> dict[str, Visuals]:
    """Return the shapes of every link that has any.

    Args:
        source: The file.
        robot: Its root element.

    Warns:
        ModelWarning: Mesh files are missing; one warning for all.
    """
    reader = _Reader(source, robot)
    shapes = {link.get("name", ""): reader.visuals(link) for link in robot.findall("link")}
    source.warn_of_missing_meshes()
    return {link: found for link, found in shapes.items() if any(found)}


class _Reader:
    """The shapes of one robot, and the mesh files that they name."""

    def __init__(self, source: Source, robot: etree._Element) -> None:
        self._source = source
        self._materials = {m.get("name"): m for m in robot.findall("material")}

    def visuals(self, link: etree._Element) -> Visuals:
        """Return the shapes of a <link>."""
        visual, collision = (
            tuple(shape for element in link.findall(tag) for shape in self._shapes(element))
            for tag in ("visual", "collision")
        )
        return Visuals(visual, collision)

    def _shapes(self, element: etree._Element) -> tuple[Shape, ...]:
        """Read a <visual> or <collision>."""
        try:
            pose, rgba = self._source.pose(element), self._rgba(element)
            if (round_ended := element.find("geometry/capsule")) is not None:
                lengths = (self._source.lengths(round_ended, n, 1) for n in ("radius", "length"))
                radius, length = (value.item() for value in lengths)
                return capsule(pose, radius, length, rgba)
            return (Shape(pose, self._geometry(element), rgba),)
        except ModelError as error:
            return (Shape(pin.SE3.Identity(), Unusable(str(error))),)

    def _geometry(self, parent: etree._Element) -> Geometry:
        source, element = self._source, parent.find("geometry/*")
        # a collision body without extension would be far from everything
        lengths = source.lengths if parent.tag == "collision" else source.numbers
        kind = "" if element is None else element.tag
        if element is not None and kind == "box":
            return Box(tuple(lengths(element, "size", 3).tolist()))
        if element is not None and kind == "sphere":
            return Sphere(lengths(element, "radius", 1).item())
        if element is not None and kind == "cylinder":
            radius, length = (lengths(element, name, 1).item() for name in ("radius", "length"))
            return Cylinder(radius, length)
        if element is not None and kind == "mesh":
            name = element.get("filename", "")
            scale = source.numbers(element, "scale", 3, "1 1 1")
            return Mesh(name, source.mesh(name), tuple(scale.tolist()))
        link = parent.getparent()
        owner = "" if link is None else link.get("name", "")
        source.fail(
            f"link {owner!r} has a {parent.tag!s} without a known geometry",
            "give it a box, sphere, cylinder, capsule or mesh",
        )

    def _rgba(self, parent: etree._Element) -> tuple[float, ...] | None:
        """Read the colour of a <visual>: its own, or that of the robot's material it names."""
        material = parent.find("material")
        if material is not None and len(material) == 0:
            material = self._materials.get(material.get("name"))
        color = None if material is None else material.find("color")
        return None if color is None else tuple(self._source.numbers(color, "rgba", 4).tolist())
