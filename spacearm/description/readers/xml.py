"""XML source: a URDF file opened safely, and checked numbers out of its elements."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NoReturn

import numpy as np
import pinocchio as pin
from lxml import etree

from spacearm.arrays import LARGEST, MOST_LINKS, Array
from spacearm.errors import ModelError, warn
from spacearm.files import read

NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
XACRO = "{http://www.ros.org/wiki/xacro}"


class Source:
    """A URDF file, with its elements, numbers and poses, checked.

    Attributes:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def fail(self, problem: str, remedy: str) -> NoReturn:
        """Raise the `ModelError` that names this file."""
        raise ModelError(f"{self.path}: {problem}; {remedy}")

    def warn(self, message: str) -> None:
        """Give the `ModelWarning` that names this file."""
        warn(f"{self.path}: {message}")

    def robot(self) -> etree._Element:
        """Return the root element of the URDF; a .xacro source is expanded.

        Raises:
            ModelError: The file cannot be read, or is no URDF.
        """
        try:
            text = read(self.path)
        except FileNotFoundError:
            self.fail("no such file", "check the path")
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            self.fail(f"cannot be read ({why})", "give the path of a URDF file")
        robot = self._parsed(text)
        if self.path.suffix == ".xacro":
            robot = self._parsed(self._expanded(robot.get("name") or self.path.stem))
        elif any(str(element.tag).startswith(XACRO) for element in robot.iter()):
            self.fail(
                "is a xacro source, which is a program, and not named so",
                "if you trust it name it .xacro, or expand it: xacro FILE",
            )
        if robot.tag != "robot":
            self.fail(
                f"is not a URDF: its root element is <{robot.tag!s}>",
                "a URDF starts with <robot name='...'>",
            )
        return robot

    def _parsed(self, text: bytes) -> etree._Element:
        """Parse XML without entities, network access or DOCTYPE."""
        parser = etree.XMLParser(
            resolve_entities=False,
            no_network=True,
            load_dtd=False,
            remove_comments=True,
            remove_pis=True,
        )
        try:
            root = etree.fromstring(text, parser)
        except etree.XMLSyntaxError as error:
            self.fail(f"is not XML ({error.msg})", "correct it there")
        if etree.ElementTree(root).docinfo.doctype:
            self.fail("declares a DOCTYPE", "remove it: entities are not expanded")
        return root

    def _expanded(self, name: str) -> bytes:
        """Expand the xacro source of a robot of this name to URDF."""
        try:
            from xacrodoc import XacroDoc, packages
        except ImportError:
            self.fail(
                "is a xacro source", "pip install 'spacearm[xacro]', or expand it: xacro FILE"
            )
        try:
            packages.walk_up_from(self.path)
            file = [str(self.path.resolve())]  # as an include: its own includes are beside it
            urdf: str = XacroDoc.from_includes(file, name, resolve_packages=False).to_urdf_string()
        except Exception as error:  # whatever xacro makes of a faulty file
            self.fail(f"is a xacro source that cannot be expanded ({error})", "correct it there")
        return urdf.encode()

    def named(self, robot: etree._Element, tag: str) -> dict[str, etree._Element]:
        """Return the children with this tag by their names, which must exist and be unique."""
        elements: dict[str, etree._Element] = {}
        if (found := len(robot.findall(tag))) > MOST_LINKS:
            self.fail(f"has {found:,} {tag}s", f"give at most {MOST_LINKS:,}")
        for element in robot.findall(tag):
            name = element.get("name")
            if not name:
                self.fail(f"the <{tag}> on line {element.sourceline} has no name", "name it")
            if name in elements:
                lines = f"lines {elements[name].sourceline} and {element.sourceline}"
                self.fail(f"two {tag}s are named {name!r} ({lines})", "rename one")
            elements[name] = element
        return elements

    def numbers(
        self, element: etree._Element, attribute: str, count: int, default: str | None = None
    ) -> Array:
        """Read `count` finite numbers from an attribute."""
        text = element.get(attribute, default)
        if text is None:
            self.fail(f"{describe(element)} has no {attribute}", f"add {attribute}='...'")
        words = text.split()
        values = np.array([float(word) for word in words if NUMBER.fullmatch(word)])
        if len(values) != count or len(words) != count or not (np.abs(values) <= LARGEST).all():
            wanted = "a finite number" if count == 1 else f"{count} finite numbers"
            self.fail(
                f"{describe(element)} has {attribute}={text[:60]!r}",
                f"give {wanted} up to {LARGEST:g}",
            )
        return values

    def child(self, element: etree._Element, tag: str) -> etree._Element | None:
        """Return the child with this tag, or None; more than one are a fault."""
        children = element.findall(tag)
        if len(children) > 1:
            self.fail(f"{describe(element)} has {len(children)} <{tag}>", "keep one")
        return children[0] if children else None

    def number(self, element: etree._Element, attribute: str, default: str | None = None) -> float:
        """Read one finite number from an attribute."""
        return float(self.numbers(element, attribute, 1, default)[0])

    def lengths(self, element: etree._Element, attribute: str, count: int) -> Array:
        """Read `count` positive numbers from an attribute."""
        values = self.numbers(element, attribute, count)
        if values.min() <= 0.0:
            self.fail(
                f"{describe(element)} has {attribute}={element.get(attribute)!r}",
                "give positive lengths",
            )
        return values

    def pose(self, element: etree._Element) -> pin.SE3:
        """Read the pose in a child <origin xyz rpy>; the identity if there is none."""
        origin = self.child(element, "origin")
        if origin is None:
            return pin.SE3.Identity()
        rpy = self.numbers(origin, "rpy", 3, "0 0 0")
        return pin.SE3(pin.rpy.rpyToMatrix(rpy), self.numbers(origin, "xyz", 3, "0 0 0"))


def describe(element: etree._Element) -> str:
    """Describe an element by its owner and line, as in: <mass> of link 'boom' (line 12)."""
    owner = next((e for e in (element, *element.iterancestors()) if e.get("name")), element)
    where = "" if owner is element else f"<{element.tag!s}> of "
    return f"{where}{owner.tag!s} {owner.get('name')!r} (line {element.sourceline})"
