"""MJCF before MuJoCo compiles it: how much it asks for, and which files it names.

MuJoCo builds whatever a file asks for, and opens whatever it names: a height field of any size, any
number of copies, a pipe that stays silent, a file of somebody else.
"""

from __future__ import annotations

import codecs
import math
from collections.abc import Collection
from contextlib import suppress
from functools import partial
from pathlib import Path

from lxml import etree

from spacearm.description.readers.packages import MESHES
from spacearm.description.readers.source import Source
from spacearm.files import marked_encoding, named_files, read

#: Largest number of elements, with those that are copied or generated.
MOST_ELEMENTS = 100_000
#: Largest number of numbers or bytes that one element may ask for.
MOST_NUMBERS = 10_000_000
#: Elements, numbers of all elements, and bytes of the files that are named, of a small MJCF.
FEW_ELEMENTS, FEW_NUMBERS, FEW_BYTES = 2_000, 1_000_000, 5_000_000
#: Largest number of MJCF files that one is made of.
MOST_FILES = 200
#: Elements that stand for as many as their `count`, or the product of its three.
GENERATED = {"composite", "flexcomp"}
#: Attributes whose product is a number of numbers.
ASKED = {"hfield": ("nrow", "ncol"), "texture": ("width", "height"), "numeric": ("size",)}
#: Begins the attributes of <size> that are a number of numbers of each element.
EACH = "nuser_"
#: Meshes that MuJoCo makes whose third parameter is an angle or a ratio.
ANGULAR = ("wedge", "supersphere", "supertorus")
#: Numbers that MuJoCo keeps for each vertex of a mesh that it makes.
NUMBERS_PER_VERTEX = 20
FOLDERS = ("assetdir", "meshdir", "texturedir")
#: Elements that name further MJCF files, and those whose files are deleted before they are opened.
PARTS, DELETED = ("include", "model"), ("texture", "hfield", "skin")
#: Encodings of which MuJoCo, which reads bytes, sees the same elements as a parser of XML, by their
#: names in Python.
ENCODINGS = ("utf-8", "ascii", "iso8859-1", "iso8859-15", "cp1252")


def check_bounds(source: Source, root: etree._Element) -> bool:
    """Refuse an MJCF that asks for too much, or names what it may not.

    It may name MJCF files and meshes of its packages, and meshes anywhere by absolute paths; see
    `Packages.holds` and `Packages.mesh`.

    Args:
        source: The file.
        root: Its root element.

    Returns:
        Whether it is small: compiled in a second or so, whatever it holds.

    Raises:
        ModelError: It does; the message says the bound.
    """
    bounds = _Bounds(source)
    bounds.check_encoding(read(source.path), root)
    total = bounds.elements(root, source.path.resolve())
    size = bounds.size()  # of every file: it refuses some
    numbers = bounds.numbers + bounds.each * total
    return total <= FEW_ELEMENTS and numbers <= FEW_NUMBERS and size <= FEW_BYTES


class _Classes:
    """The classes of defaults of one model.

    Attributes:
        named: The classes that elements name, with the tag of one of these.
        declared: The classes that MuJoCo knows.
    """

    def __init__(self) -> None:
        self.named: dict[str, str] = {}
        self.declared: set[str] = set()

    def add(self, element: etree._Element, *, alone: bool) -> None:
        """Add the class of an element.

        MuJoCo may read other bytes than a parser of XML where a name has spaces or is not ASCII:
        such a class is not known for certain.

        Args:
            element: The element.
            alone: Whether MuJoCo reads it for certain: it stands in no file that is one of several
                that an include may name.
        """
        name = element.get("class")
        if name is None:
            return
        if element.tag != "default":
            self.named[name] = str(element.tag)
        elif alone and name.isascii() and name.split() == [name]:
            self.declared.add(name)


class _Bounds:
    """What a file asks for, with those that it includes.

    Attributes:
        numbers: Numbers that its elements ask for, together.
        each: Numbers that it asks for in each element.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._folders = [source.path.resolve().parent]
        self._subfolders = {""}
        self._meshes: set[str] = set()
        self._parts: set[str] = set()
        self._count = 0
        self.numbers = 0.0
        self.each = 0.0

    def elements(self, root: etree._Element, *paths: Path) -> float:
        """Return the number of elements of a file, copies and attached models among them.

        Args:
            root: Its root element.
            paths: The file.
        """
        included = set(paths)  # MuJoCo includes a file once
        total, attached, largest = 0.0, 0.0, 0.0
        classes = _Classes()
        left = [(root, 1.0, True)]
        while left:
            element, times, alone = left.pop()
            classes.add(element, alone=alone)
            name = element.get("file", "")
            times *= max(1.0, _product(element, "count")) if element.tag == "replicate" else 1.0
            total += times * (_product(element, "count") if element.tag in GENERATED else 1.0)
            if element.tag == "include":
                parts = self._parsed(name, included)
                included.update(parts)
                left += [(part, times, alone and len(parts) == 1) for part in parts.values()]
            elif element.tag == "model" and name:
                counts = [self.elements(part, path) for path, part in self._parsed(name).items()]
                largest = max([largest, *counts])
            attached += times if element.tag == "attach" else 0.0
            if total + attached * largest > MOST_ELEMENTS:
                self._source.fail(
                    f"asks for more than {MOST_ELEMENTS:,} elements, with those that are copied",
                    "copy or generate fewer",
                )
            self._check_numbers(element)
            if element.tag not in DELETED:
                names = self._parts if element.tag in PARTS else self._meshes
                names.update(v for k, v in element.items() if k.startswith("file"))
            self._subfolders.update(element.get(folder, "") for folder in FOLDERS)
            left += [(child, times, alone) for child in element.iterchildren(etree.Element)]
        self._check_classes(classes)
        return total + attached * largest

    def size(self) -> int:
        """Return the size of all files that MuJoCo opens; refuse those that it may not open."""
        for name in self._parts:  # again, since all folders are known only now
            self._files(name)
        files = {path for name in self._meshes for path in self._files(name, MESHES)}
        return sum(path.stat().st_size for path in files)

    def _files(self, name: str, anywhere: Collection[str] = ()) -> list[Path]:
        """Return the files that MuJoCo may take a name for.

        Args:
            name: The name.
            anywhere: Suffixes of files that may lie anywhere if their path is absolute.
        """
        found: list[Path] = []
        for subfolder in self._subfolders:
            for word in dict.fromkeys((name, Path(name.replace("\\", "/")).name)):
                within = Path(subfolder, word)
                suffixes = anywhere if within.is_absolute() else ()
                allowed = partial(self._source.packages.holds, anywhere=suffixes)
                named = named_files(str(within), self._folders, allowed)
                for refused in named.refused:
                    remedy = "if it is meant to, name its folder by packages=[FOLDER]"
                    device = refused.endswith("a device or a pipe")
                    self._source.fail(f"names {refused}", "name a file" if device else remedy)
                found += named.found
        return list(dict.fromkeys(found))

    def _parsed(self, name: str, but: Collection[Path] = ()) -> dict[Path, etree._Element]:
        """Return the root elements of the files that a name may stand for, but for some."""
        self._count += 1
        if self._count > MOST_FILES:
            self._source.fail(
                f"is made of more than {MOST_FILES} files", "join them, or let none include itself"
            )
        roots = {}
        for path in {path.resolve() for path in self._files(name)}.difference(but):
            try:
                content = read(path)
                roots[path] = self._source.parsed(content)
                self.check_encoding(content, roots[path])
            except OSError as error:
                self._source.fail(f"names {path}, which cannot be read ({error})", "correct it")
            if path.parent not in self._folders:
                self._folders.append(path.parent)
        return roots

    def check_encoding(self, content: bytes, root: etree._Element) -> None:
        """Refuse a file in whose bytes MuJoCo may see other elements than a parser of XML."""
        stated = etree.ElementTree(root).docinfo.encoding or "UTF-8"
        encoding = (marked_encoding(content) or stated).removesuffix("-sig")
        known = ""
        with suppress(LookupError):
            known = codecs.lookup(encoding).name  # utf8 is UTF-8, latin1 ISO-8859-1
        if known not in ENCODINGS:
            self._source.fail(f"is encoded as {encoding!r}", "save it as UTF-8")

    def _check_classes(self, classes: _Classes) -> None:
        """Refuse a class that MuJoCo, which does not know it, would take for a format of printf.

        Its message then reads and writes memory that is not its own.
        """
        for name, tag in classes.named.items():
            if "%" in name and name not in classes.declared:
                self._source.fail(
                    f"<{tag}> names the class {name!r}, which MuJoCo may not know",
                    "declare it by a <default>, in ASCII without spaces, or rename it without %",
                )

    def _check_numbers(self, element: etree._Element) -> None:
        """Add the numbers that an element asks for; refuse too many."""
        tag = str(element.tag)
        if tag == "mesh":
            asked = {"params": NUMBERS_PER_VERTEX * _vertices(element)}
        elif tag == "size":
            asked = {name: _product(element, name) for name in element.attrib}
            self.each += sum(count for name, count in asked.items() if name.startswith(EACH))
        elif names := ASKED.get(tag):
            asked = {", ".join(names): math.prod(_product(element, name) for name in names)}
        else:
            asked = {}
        self.numbers += sum(asked.values())
        for attributes, count in asked.items():
            if count > MOST_NUMBERS:
                self._source.fail(
                    f"<{tag}> asks for {count:g} numbers by {attributes}",
                    f"ask for at most {MOST_NUMBERS:,}",
                )


def _vertices(mesh: etree._Element) -> float:
    """Return an upper bound of the number of vertices of a mesh that MuJoCo makes; 0 for a file.

    Its first parameters are numbers of divisions: one for each of two or three directions, or one
    for all.
    """
    shape = mesh.get("builtin", "none")
    if shape == "none":
        return 0.0
    first, second, third = ([*_numbers(mesh, "params"), 1.0, 1.0, 1.0])[:3]
    third = 1.0 if shape in ANGULAR else third
    return first * max(first, second) * third


def _product(element: etree._Element, name: str) -> float:
    """Return the product of the numbers of an attribute; 1 if it has none, for MuJoCo to refuse."""
    return math.prod(_numbers(element, name))


def _numbers(element: etree._Element, name: str) -> list[float]:
    """Return the numbers of an attribute, at least 1 each; none if it is not of numbers."""
    try:
        return [max(1.0, float(word)) for word in element.get(name, "").split()]
    except ValueError:
        return []
