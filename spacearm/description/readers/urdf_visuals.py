"""URDF visuals: <visual> and <collision> of the links of a robot as data.

No fault in them stops a robot from loading, since physics needs none of them: a shape with a fault
becomes an `Unusable`, which whoever needs the shape reports.
"""

from __future__ import annotations

from pathlib import Path

import pinocchio as pin
from lxml import etree

from spacearm.description.meshes import find_mesh
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
)
from spacearm.errors import ModelError

SHOWN = 3
"""Missing meshes that the warning about them names."""


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
    reader.warn_of_missing_meshes()
    return {link: found for link, found in shapes.items() if any(found)}


class _Reader:
    """The shapes of one robot, and the mesh files that they name."""

    def __init__(self, source: Source, robot: etree._Element) -> None:
        self._source = source
        self._materials = {m.get("name"): m for m in robot.findall("material")}
        self._files: dict[str, Path | None] = {}

    def visuals(self, link: etree._Element) -> Visuals:
        """Return the shapes of a <link>."""
        visual, collision = (
            tuple(self._shape(element) for element in link.findall(tag))
            for tag in ("visual", "collision")
        )
        return Visuals(visual, collision)

    def warn_of_missing_meshes(self) -> None:
        """Warn of the files that were not found."""
        if missing := sorted(name[:80] for name, file in self._files.items() if file is None):
            rest = len(missing) - SHOWN
            names = ", ".join(missing[:SHOWN]) + (f" and {rest} more" if rest > 0 else "")
            self._source.warn(f"meshes not found (physics is not affected): {names}")

    def _shape(self, element: etree._Element) -> Shape:
        """Read a <visual> or <collision>."""
        try:
            pose = self._source.pose(element)
            return Shape(pose, self._geometry(element), self._rgba(element))
        except ModelError as error:
            return Shape(pin.SE3.Identity(), Unusable(str(error)))

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
            return Mesh(name, self._file(name), tuple(scale.tolist()))
        link = parent.getparent()
        owner = "" if link is None else link.get("name", "")
        source.fail(
            f"link {owner!r} has a {parent.tag!s} without a known geometry",
            "give it a box, sphere, cylinder or mesh",
        )

    def _file(self, name: str) -> Path | None:
        """Find a mesh file, once."""
        if name not in self._files:
            self._files[name] = find_mesh(name, self._source.path)
        return self._files[name]

    def _rgba(self, parent: etree._Element) -> tuple[float, ...] | None:
        """Read the colour of a <visual>: its own, or that of the robot's material it names."""
        material = parent.find("material")
        if material is not None and len(material) == 0:
            material = self._materials.get(material.get("name"))
        color = None if material is None else material.find("color")
        return None if color is None else tuple(self._source.numbers(color, "rgba", 4).tolist())
