"""Packages: the ROS packages that a robot file names, found in the folders around it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import islice
from pathlib import Path

from lxml import etree

from spacearm.files import xml

#: Levels of folders below each place that are searched.
DEPTH = 3
#: Levels above a file that are searched.
LEVELS = 5
#: Largest number of folders that are searched in one place.
MOST_FOLDERS = 5_000


class Packages:
    """The packages that one robot file may name, searched for when the first one is.

    The folders that the caller names come first; then those around the file, the nearest first, up
    to the root of its repository; then ROS_PACKAGE_PATH and AMENT_PREFIX_PATH. A package is a
    folder with a package.xml of that name, else a folder of that name.
    """

    def __init__(self, file: Path, folders: Sequence[Path] = ()) -> None:
        self._file = file
        self._folders = [folder.resolve() for folder in folders]
        self._indices: dict[Path, dict[str, Path]] = {}
        self._found: dict[str, Path | None] = {}

    def find(self, name: str) -> Path | None:
        """Return the folder of a package; None if there is none."""
        if name not in self._found:
            places = (*self._folders, *self.around, *_environment())
            indices = (self._index(place) for place in places)
            self._found[name] = next((index[name] for index in indices if name in index), None)
        return self._found[name]

    def resolve(self, name: str) -> Path | None:
        """Return the path that package://NAME/REST means; None if there is no such package."""
        package, _, rest = name.removeprefix("package://").partition("/")
        folder = self.find(package) if package else None
        return folder / rest if folder else None

    def file(self, name: str) -> Path | None:
        """Find the file that a description names.

        Args:
            name: A path relative to the description or to a folder above it, or a file://,
                package:// or model:// name. Nothing is fetched from elsewhere.

        Returns:
            Its absolute path, or None if there is no such file.
        """
        scheme, _, rest = name.strip().replace("\\", "/").rpartition("://")
        candidates: list[Path] = []
        if scheme in ("", "file") or scheme.endswith("file"):
            candidates = [self._file.parent / rest, *(folder / rest for folder in self.around)]
        elif scheme.rpartition("://")[2] in ("package", "model"):
            within = self.resolve(f"package://{rest}")
            candidates = [within] if within else []
            tails = (rest, rest.partition("/")[2])
            candidates += [folder / tail for folder in self.around for tail in tails]
        try:
            found = next((path for path in candidates if path.is_file()), None)
            return Path(os.path.normpath(found.absolute())) if found else None
        except (OSError, ValueError):
            return None  # no file can have that name

    def holds(self, path: Path) -> bool:
        """Whether a file belongs to the packages found so far or lies around the robot file.

        Around it means not hidden and, where that is a top folder, in this folder itself.
        """
        file = path.resolve()
        found = [folder.resolve() for folder in self._found.values() if folder]
        if any(file.is_relative_to(folder) for folder in (*self._folders, *found)):
            return True
        for folder in filter(file.is_relative_to, self.around):
            parts = file.relative_to(folder).parts
            hidden = any(part.startswith(".") for part in parts)
            if not hidden and (len(parts) == 1 or not _is_top(folder)):
                return True
        return False

    @cached_property
    def around(self) -> list[Path]:
        """The folder of the file and those above it, up to the root of its repository."""
        files = self._file.absolute(), self._file.resolve()
        return list(dict.fromkeys(folder for file in files for folder in _above(file)))

    def _index(self, place: Path) -> dict[str, Path]:
        """Return the packages below a folder by name, the nearest of each name."""
        if place not in self._indices:
            declared: dict[str, Path] = {}
            named: dict[str, Path] = {}
            for folder in _below(place):
                named.setdefault(folder.name, folder)
                if name := _declared_name(folder / "package.xml"):
                    declared.setdefault(name, folder)
            self._indices[place] = named | declared
        return self._indices[place]


def _above(file: Path) -> Iterator[Path]:
    """Yield the folder of a file and those above, not as far as the home or the top folders."""
    home = Path.home()
    for level, folder in enumerate(file.parents):
        if level > LEVELS or (level and (folder == home or _is_top(folder))):
            return
        yield folder
        if (folder / ".git").exists():
            return


def _is_top(folder: Path) -> bool:
    """Whether a folder is the root of the file system or right below it."""
    return len(folder.parts) <= 2


def _below(place: Path) -> Iterator[Path]:
    """Yield a folder and those below it, breadth first."""
    waiting = [(place, DEPTH)]
    for folder, deeper in islice(waiting, MOST_FOLDERS):
        yield folder
        if deeper:
            waiting += [(inner, deeper - 1) for inner in _folders_in(folder)]


def _folders_in(folder: Path) -> list[Path]:
    """Return the folders in a folder, hidden ones left out, in the order of their names."""
    try:
        with os.scandir(folder) as entries:
            names = [e.name for e in entries if e.is_dir() and not e.name.startswith(".")]
    except OSError:
        return []
    return [folder / name for name in sorted(names)]


def _declared_name(manifest: Path) -> str | None:
    """Return the name that a package.xml declares."""
    try:
        name = xml(manifest.read_bytes()).findtext("name")
    except (OSError, etree.XMLSyntaxError):
        return None
    return name.strip() if name else None


def _environment() -> Iterator[Path]:
    """Yield the folders that ROS 1 and ROS 2 name in the environment."""
    for variable, inner in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
        for folder in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield Path(folder, inner)
