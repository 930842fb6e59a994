"""Source: a robot file opened safely, how it is read, and checked numbers out of its elements."""

from __future__ import annotations

import ast
import math
import operator
import os
import re
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal, NoReturn, TypeAlias, TypeVar

import numpy as np
import pinocchio as pin
from lxml import etree

from spacearm.arrays import LARGEST, MOST_LINKS, Array, positive
from spacearm.description.readers.packages import OutsideError, Packages
from spacearm.description.shapes import TURNED, Mesh, Shape, Unusable, Visuals
from spacearm.errors import ConfigurationError, ModelError, ModelWarning, listed, warn
from spacearm.files import decoded, is_folder, marked_encoding, read, xml
from spacearm.processes import VARIABLE, WorkerError, call_within, memory_limit

#: Characters of numbers with pi, + - * / and parentheses, as SPART's files write their numbers.
ARITHMETIC = re.compile(r"[\d.e+*/() pi-]{1,200}", re.ASCII)
OPERATIONS: Mapping[type, Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}


def split(text: str, count: int) -> list[str]:
    """Return the `count` words of a vector, with spaces or commas or both between them."""
    if count == 1:
        return [text]
    words = text.replace(",", " ").split()
    return text.split(",") if len(words) != count and "," in text else words


def evaluate(text: str) -> float | None:
    """Compute the number that a text stands for; None if it stands for none."""
    text = " ".join(text.lower().split())
    if not ARITHMETIC.fullmatch(text):
        return None
    with suppress(ValueError):
        return float(text)
    try:
        return _value(ast.parse(text, mode="eval").body)
    except (SyntaxError, ValueError, ArithmeticError, MemoryError, RecursionError):
        return None


def _value(node: ast.expr) -> float:
    match node:
        case ast.Constant(int() | float() as number):
            return float(number)
        case ast.Name("pi"):
            return math.pi
        case ast.UnaryOp(sign, value) if type(sign) in OPERATIONS:
            return OPERATIONS[type(sign)](_value(value))
        case ast.BinOp(left, operation, right) if type(operation) in OPERATIONS:
            return OPERATIONS[type(operation)](_value(left), _value(right))
    raise ValueError("more than arithmetic")


Check = Literal["error", "warn", "accept"]
Folders: TypeAlias = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


@dataclass(frozen=True)
class Reading:
    """How a robot file is read.

    Attributes:
        check: What to do with inertias that no rigid body can have: "error", or "warn" or "accept"
            to load published data that has this fault.
        packages: Folders that hold ROS packages, or are packages.
        xacro_args: Values of the arguments of a xacro source, by name.
        density: Density [kg/m^3] that gives bodies without inertial data theirs, from their
            shapes; None if they are to have none.
        spacecraft: Whether the root link is a spacecraft, which has mass; the root of an arm alone
            may be a frame without mass.
        locked: Joints that are locked as the file is read, with their values [rad] or [m].
        tips: Links that are asked for as tips: of several robots in a file the one that has them
            is read.
        rigid: Whether the robot may have no joint, as a bus for an arm.
        known: Whether its shapes are known to be right, as those of the catalogue, and their meshes
            need not be read.
        up_axes: Whether the up axes that COLLADA files state turn their meshes.
    """

    check: Check = "error"
    packages: tuple[Path, ...] = ()
    xacro_args: Mapping[str, str] = field(default_factory=dict)
    density: float | None = None
    spacecraft: bool = True
    locked: Mapping[str, float] = field(default_factory=dict)
    rigid: bool = False
    known: bool = False
    tips: tuple[str, ...] = ()
    up_axes: bool = False

    @classmethod
    def of(
        cls,
        check: Check | None = None,
        packages: Folders = (),
        xacro_args: Mapping[str, object] | None = None,
        density: float | None = None,
        up_axes: bool = False,
    ) -> Reading:
        """Make it of a caller's arguments, checked; see `loading.load`.

        Raises:
            ConfigurationError: There is no such folder, or the density is not positive.
        """
        folders = [packages] if isinstance(packages, (str, os.PathLike)) else packages
        paths = tuple(Path(folder) for folder in folders)
        for path in paths:
            if not is_folder(path):
                raise ConfigurationError(f"packages: {path} is not a folder; name one that exists")
        return cls(
            check=check or "error",
            packages=paths,
            xacro_args={  # as xacro writes them
                name: str(value).lower() if isinstance(value, bool) else str(value)
                for name, value in (xacro_args or {}).items()
            },
            density=None if density is None else positive(density, "density", "density [kg/m^3]"),
            up_axes=up_axes,
        )


#: Least length of a vector or a quaternion that a direction can be read from.
SHORTEST = 1e-6
#: Suffixes of robot files.
ROBOTS = (".urdf", ".xacro", ".xml", ".sdf", ".world")
#: Characters of a name that a note shows.
LONGEST = 300
#: Largest number of times that a file is mended and parsed again.
MOST_MENDS = 40
UNDECLARED = re.compile(r"Namespace prefix ([\w.-]+) (on|for) .* is not defined")
#: Faults that the parsers of simulators let pass, where they are and what to write there.
LENIENT = (
    ("hyphen within comment", re.compile(rb"(?<=<!--).*?(?=-->)", re.DOTALL), b" "),
    ("declaration allowed only", re.compile(rb"(?<!\A)<\?xml\s.*?\?>", re.DOTALL), b" "),
    ("Failed to parse QName", re.compile(rb"(?<=:):(?=[\w.-]+[\s/>])"), b"_"),
    ("attributes construct", re.compile(rb"""(?<=["'])(?=[A-Za-z_][\w.-]*\s*=\s*["'])"""), b" "),
)
#: The version of XML that a file states, which some write as 0.0.
VERSION = re.compile(rb"""\A(<\?xml\s+version\s*=\s*["'])[\d.]+""")
#: The encoding that the declaration of XML states.
ENCODING = re.compile(rb"""\A(\s*<\?xml[^>]*?)\s+encoding\s*=\s*["'][\w.:-]*["']""")
ROOT_TAG = re.compile(rb"(\s|<\?((?!\?>).)*\?>|<!--((?!-->).)*-->)*<[\w:.-]+", re.DOTALL)
#: Prefix of elements that only Drake has, and those of them that mean what their names say.
DRAKE, DRAKES = "drake", ("joint", "parent", "child", "mimic", "screw_thread_pitch")
#: Attribute of a link or joint from a xacro source: the line and file where it is written.
WRITTEN = "written-on"


class Source:
    """A robot file, with its elements, numbers and poses, checked.

    Attributes:
        path: The file.
        reading: How it is read.
        packages: The packages that it may name.
        notes: What was assumed or left out so far.
        balls: Ball joints that were taken as three hinges.
    """

    def __init__(self, path: Path, reading: Reading | None = None) -> None:
        self.path = path
        self.reading = reading or Reading()
        self.packages = Packages(path, self.reading.packages)
        self.notes: list[str] = []
        self.balls: list[str] = []
        self._meshes: dict[str, Path | None] = {}
        self._refused: dict[str, str] = {}

    def fail(self, problem: str, remedy: str) -> NoReturn:
        """Raise the `ModelError` that names this file."""
        raise ModelError(f"{self.path}: {problem}; {remedy}")

    def warn(self, message: str) -> None:
        """Give the `ModelWarning` that names this file, and note it."""
        self.notes.append(message)
        warn(f"{self.path}: {message}")

    def note(self, message: str) -> None:
        """Note what was left out, without a warning: it makes no difference to the arm."""
        self.notes.append(message)

    def mesh(self, element: etree._Element, name: str, scale: Array) -> Mesh:
        """Return the mesh of an element; without a file, to be warned of, if there is none."""
        if name not in self._meshes:
            self._meshes[name] = self._mesh_file(name)
        factors, turned = tuple(scale.tolist()), element.get(TURNED) == "true"
        return Mesh(name, self._meshes[name], factors, turned)

    def _mesh_file(self, name: str) -> Path | None:
        """Return the file of a mesh; None, to be warned of, if it is not found or not read."""
        try:
            return self.packages.mesh(name)
        except OutsideError as error:
            self._refused[name] = error.refused
            return None

    def shapes(
        self, link: etree._Element, read: Callable[[etree._Element], Iterable[Shape]]
    ) -> Visuals:
        """Read each <visual> and <collision> of a link, see `safely`."""
        visual, collision = (
            tuple(shape for element in link.findall(tag) for shape in self.safely(read, element))
            for tag in ("visual", "collision")
        )
        return Visuals(visual, collision)

    def safely(
        self, read: Callable[[etree._Element], Iterable[Shape]], element: etree._Element
    ) -> tuple[Shape, ...]:
        """Read a <visual> or <collision>; one with a fault becomes an `Unusable`.

        No fault stops a robot from loading, since physics needs no shape: whoever does reports it.
        """
        try:
            return tuple(read(element))
        except ModelError as error:
            return (Shape(pin.SE3.Identity(), Unusable(str(error))),)

    def fail_without_geometry(self, parent: etree._Element, known: str) -> NoReturn:
        """Say that a <visual> or <collision> has no geometry that is known."""
        link, element = parent.getparent(), parent.find("geometry/*")
        owner = "" if link is None else link.get("name", "")
        kind = "" if element is None else f" (<{element.tag!s}>)"
        problem = f"link {owner!r} has a {parent.tag!s} without a known geometry{kind}"
        self.fail(problem, f"give it a {known}")

    def warn_of_missing_meshes(self, others: Iterable[str] = ()) -> None:
        """Warn of mesh files that were not found or are not read, if any; one warning for all.

        Args:
            others: Names of those that `mesh` was not asked for.
        """
        if self._refused:
            refused = [f"{name[:LONGEST]!r} is {why}" for name, why in self._refused.items()]
            self.warn(
                f"meshes not read (physics is not affected): {listed(refused, longest=LONGEST)}; "
                "relative names may lead to the packages of the robot file and to the folders "
                "around it, not to home or system folders; name others by packages=[FOLDER]"
            )
        lost = [name for name, file in self._meshes.items() if file is None]
        names = (*others, *(name for name in lost if name not in self._refused))
        if missing := sorted({name[:LONGEST] for name in names}):
            self.notes.append(f"meshes not found: {', '.join(missing)}")
            warn(f"{self.path}: meshes not found (physics is not affected): {listed(missing)}")

    def root(self) -> etree._Element:
        """Return the root element of the file.

        Raises:
            ModelError: The file cannot be read, or is no XML.
        """
        try:
            text = read(self.path)
        except FileNotFoundError:
            self.fail("no such file", "check the path")
        except IsADirectoryError:
            inside = sorted(p.name for p in self.path.iterdir() if p.suffix.lower() in ROBOTS)
            there = f"one of those in it: {listed(inside)}" if inside else "a robot file"
            self.fail("is a folder", f"give the path of {there}")
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            self.fail(f"cannot be read ({why})", "give the path of a robot file")
        return self.parsed(text)

    def parsed(self, text: bytes) -> etree._Element:
        """Parse XML without entities, network access or DOCTYPE; its own namespace is dropped.

        Namespaces need no declaration, and joints of Drake's are as others. Lines are those of the
        text, which may begin with blanks.
        """
        try:
            root = xml(mended(text), bare=True)
        except etree.XMLSyntaxError as error:
            self.fail(f"is not XML ({error.msg})", "correct it there")
        if etree.ElementTree(root).docinfo.doctype:
            self.fail("declares a DOCTYPE", "remove it: entities are not expanded")
        if own := etree.QName(root).namespace:
            for element in root.iter(f"{{{own}}}*"):
                element.tag = etree.QName(element).localname
        for element in root.iter(etree.Element):
            if element.prefix == DRAKE and (tag := etree.QName(element).localname) in DRAKES:
                element.tag = tag
            elif element.prefix == DRAKE and tag.endswith("_constraint"):
                self.warn(
                    f"<drake:{tag}> ({line_of(element)}) is left out: what it ties together is "
                    "taken as free"
                )
        return root

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
                lines = " and ".join(dict.fromkeys(map(line_of, (elements[name], element))))
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
        return self.values(element, attribute, text, count)

    def values(self, element: etree._Element, what: str, text: str, count: int) -> Array:
        """Parse `count` finite numbers; `what` of the element holds them."""
        values = np.array([evaluate(word) for word in split(text, count)], dtype=np.float64)
        if len(values) != count or not (np.abs(values) <= LARGEST).all():
            wanted = "a finite number" if count == 1 else f"{count} finite numbers"
            given = f"{describe(element)} has {what}={text[:60]!r}"
            self.fail(given, f"give {wanted} up to {LARGEST:g}")
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

    def largest(self, value: float, what: str, joint: str) -> float:
        """Return a largest rate or effort; exporters that know nothing write zero: no limit."""
        if value == 0.0:
            self.note(f"{what} limit of {joint!r} is zero: taken as none")
        return value or math.inf

    def lengths(self, element: etree._Element, attribute: str, count: int) -> Array:
        """Read `count` positive numbers from an attribute."""
        values = self.numbers(element, attribute, count)
        if values.min() <= 0.0:
            self.fail(
                f"{describe(element)} has {attribute}={element.get(attribute)!r}",
                "give positive lengths",
            )
        return values

    def unit(self, vector: Array, problem: str, remedy: str) -> Array:
        """Return a vector scaled to length 1; one without length is a fault."""
        length = float(np.linalg.norm(vector))
        if length < SHORTEST:
            self.fail(problem, remedy)
        return vector / length

    def pose(self, element: etree._Element) -> pin.SE3:
        """Read the pose in a child <origin>; the identity if there is none."""
        origin = self.child(element, "origin")
        if origin is None:
            return pin.SE3.Identity()
        xyz = self.numbers(origin, "xyz", 3, "0 0 0")
        if origin.get("quat_xyzw"):  # URDF 1.2
            quaternion, zero = self.numbers(origin, "quat_xyzw", 4), "has a zero quat_xyzw"
            unit = self.unit(quaternion, f"{describe(origin)} {zero}", "give a unit quaternion")
            return pin.SE3(pin.Quaternion(unit), xyz)
        return pin.SE3(pin.rpy.rpyToMatrix(self.numbers(origin, "rpy", 3, "0 0 0")), xyz)


def in_xacro(path: Path, root: etree._Element) -> bool:
    """Whether a file is a xacro source, by its name or an element in it."""
    return path.suffix.lower() == ".xacro" or any(
        element.prefix == "xacro" or "/xacro" in (etree.QName(element).namespace or "")
        for element in root.iter(etree.Element)  # the namespace has had several addresses
    )


def describe(element: etree._Element) -> str:
    """Describe an element by its owner and line, as in: <mass> of link 'boom' (line 12)."""
    owner = next((e for e in (element, *element.iterancestors()) if e.get("name")), element)
    where = "" if owner is element else f"<{element.tag!s}> of "
    known = WRITTEN in element.attrib or (element.sourceline or 0) > 1
    line = f" ({line_of(element)})" if known else ""
    return f"{where}{owner.tag!s} {owner.get('name')!r}{line}"


def line_of(element: etree._Element) -> str:
    """Say on which line an element was written, and in which file if that is another one."""
    return element.get(WRITTEN) or f"line {element.sourceline}"


def mended(text: bytes) -> bytes:
    """Return XML 1.0 that a strict parser reads as those of simulators read the text.

    A text with a byte-order mark is decoded by it. Namespace prefixes are declared. Blanks before
    the declaration, none between attributes, hyphens in comments, declarations further down and
    names such as a::b are mended; lines stay where they are.
    """
    if marked_encoding(text):
        with suppress(ValueError):  # else the parser says what is wrong
            text = ENCODING.sub(rb"\1", decoded(text).encode())
    body = VERSION.sub(rb"\g<1>1.0", text.lstrip())
    if body.startswith(b"<?xml"):  # which must come first; the number of lines stays
        blank = text[: len(text) - len(text.lstrip())]
        text = body.replace(b"?>", b"?>" + b"\n" * blank.count(b"\n"), 1)
    for _ in range(MOST_MENDS):
        try:
            xml(text)
        except etree.XMLSyntaxError as error:
            better = _mended(text, error.msg or "")
            if better == text:
                break
            text = better
        else:
            break
    return text


def _mended(text: bytes, fault: str) -> bytes:
    """Return XML without one fault; the same text where that is not known."""
    undeclared, root = UNDECLARED.match(fault), ROOT_TAG.match(text)
    if undeclared and root:
        prefix = undeclared[1].encode()
        return b'%b xmlns:%b="%b"%b' % (root[0], prefix, prefix, text[root.end() :])
    for said, where, instead in LENIENT:
        if said in fault:
            return where.sub(partial(_filled, instead), text)
    return text


def _filled(filler: bytes, found: re.Match[bytes]) -> bytes:
    """Return what was found, each character of its lines replaced by another one; it, if none."""
    return re.sub(rb"[^\n]", filler, found[0]) or filler


T = TypeVar("T")

#: Time that reading a file in a process of its own may take [s].
SECONDS = 60.0


def apart(source: Source, read_it: Callable[[Source], T]) -> T:
    """Read a file that is not small in a process of its own, with limits of time and memory.

    Args:
        source: The file, which takes the notes.
        read_it: Reads it; named in a module, as what it returns can be sent between processes.

    Raises:
        ModelError: It cannot be read, or takes more.
    """
    memory = memory_limit()
    try:
        found, source.notes, warned = call_within(SECONDS, memory, partial(_read, source, read_it))
    except WorkerError as error:
        source.fail(
            f"is large, and is not read in {SECONDS:g} s and {memory / 1e9:g} GB of memory "
            f"({error})",
            f"leave out what is not needed, or set the environment variable {VARIABLE} to more GB",
        )
    for text in warned:
        warn(text)
    return found


def _read(source: Source, read_it: Callable[[Source], T]) -> tuple[T, list[str], list[str]]:
    """Return what is read, the notes and the warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ModelWarning)
        found = read_it(source)
    said = [str(found.message) for found in caught if issubclass(found.category, ModelWarning)]
    return found, source.notes, said
