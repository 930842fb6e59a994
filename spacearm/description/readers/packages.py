"""Packages: the ROS packages that a robot file names, found in the folders around it."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Sequence
from functools import cache, cached_property, partial
from itertools import chain, islice
from pathlib import Path

from lxml import etree

from spacearm.description.shapes import FORMATS
from spacearm.files import is_there, lies_in, named_files, normalised, read, xml

#: Levels of folders below each place that are searched.
DEPTH = 3
#: Levels above a file that are searched.
LEVELS = 5
#: Largest number of folders that are searched in one place.
MOST_FOLDERS = 5_000
#: Folders right below the root of the file system that belong to the system and to all its users.
#: Any other one, such as /workspace, may be that of a project.
SYSTEM = frozenset({
    "bin", "boot", "dev", "etc", "home", "lib", "lib32", "lib64", "media", "mnt", "nix", "opt",
    "proc", "root", "run", "sbin", "snap", "srv", "sys", "tmp", "usr", "var",
    "Applications", "Library", "System", "Users", "Volumes", "cores", "private",
})  # fmt: skip
#: Those of them whose folders belong to the system too, or are disks: on macOS /tmp is a link to
#: /private/tmp.
DIVIDED = frozenset(("dev", "media", "mnt", "private", "run", "usr", "var"))
#: Names of folders whose folders are the homes of users, at most so many levels below the root of
#: the file system: /home/me, /export/home/me, /mnt/c/Users/me.
HOMES, HOME_LEVELS = frozenset(("Users", "home")), 4
#: Suffixes of meshes; MuJoCo has one of its own.
MESHES = (*FORMATS, ".msh")
#: Environment variables that name folders of models of Gazebo.
MODEL_FOLDERS = (
    "GZ_SIM_RESOURCE_PATH",
    "IGN_GAZEBO_RESOURCE_PATH",
    "SDF_PATH",
    "GAZEBO_MODEL_PATH",
)


class OutsideError(Exception):
    """A name leads to a file outside the places where a robot file may name files.

    Attributes:
        refused: The path and the reason, as part of a message.
    """

    def __init__(self, refused: str) -> None:
        super().__init__(refused)
        self.refused = refused


class Packages:
    """The packages that one robot file may name, searched for when the first one is.

    The folders that the caller names come first; then those around the file, the nearest first, up
    to the root of its repository; then ROS_PACKAGE_PATH and AMENT_PREFIX_PATH. A package is a
    folder with a package.xml of that name, else a folder of that name.
    """

    def __init__(self, file: Path, folders: Sequence[Path] = ()) -> None:
        self._file = file
        self._folders = [folder.resolve() for folder in folders]
        self._given = [normalised(folder) for folder in folders]
        self._indices: dict[Path, dict[str, Path]] = {}
        self._found: dict[str, Path | None] = {}

    def find(self, name: str) -> Path | None:
        """Return the folder of a package; None if there is none."""
        if name not in self._found:
            self._found[name] = self._searched(name)
        return self._found[name]

    def _searched(self, name: str) -> Path | None:
        """Search for the folder of a package.

        A link from around the file to elsewhere is a package if a package.xml there says so.
        """
        for place in (*self._folders, *self.around, *_environment()):
            folder = self._index(place).get(name)
            if folder is None:
                continue
            inside = self._is_trusted(folder) or lies_in(folder, [place])
            if inside or _declared_name(folder / "package.xml") == name:
                return folder
        return None

    def file(self, name: str) -> Path | None:
        """Find the file that a description names.

        Args:
            name: A path relative to the description or to a folder above it, or a file://,
                package:// or model:// name. Nothing is fetched from elsewhere.

        Returns:
            Its absolute path, or None if there is no such file.

        Raises:
            OutsideError: The file lies outside the packages, see `holds`.
        """
        return self._file_of(name, ())

    def mesh(self, name: str) -> Path | None:
        """Find the mesh that a description names, as `file` does.

        A mesh may lie anywhere if the description names it by an absolute path, as expanded xacro
        sources and exported robot files do. What the path leads to must be named as a mesh.
        """
        return self._file_of(name, MESHES)

    def _file_of(self, name: str, anywhere: Collection[str]) -> Path | None:
        """Find a file; one with these suffixes may lie anywhere if its path is absolute."""
        scheme, _, rest = name.strip().replace("\\", "/").rpartition("://")
        places: list[tuple[str, Path]] = []
        allowed = self.holds
        if scheme in ("", "file") or scheme.endswith("file"):
            places = [(rest, folder) for folder in (self._file.parent, *self.around)]
            if Path(rest).is_absolute():
                allowed = partial(self.holds, anywhere=anywhere)
        elif scheme.rpartition("://")[2] in ("package", "model"):
            package, _, inner = rest.partition("/")
            if package and (folder := self.find(package)):
                places = [(inner.lstrip("/"), folder)]
            tails = (rest.lstrip("/"), inner.lstrip("/"))
            places += [(tail, folder) for folder in self.around for tail in tails]
        refused: list[str] = []
        for tail, folder in places:
            named = named_files(tail, [folder], allowed)
            if named.found:
                return named.found[0]
            refused += named.refused
        if refused:
            raise OutsideError(refused[0])
        return None

    def holds(self, path: Path, anywhere: Collection[str] = ()) -> bool:
        """Whether a robot file may name a file.

        It may if the file belongs to the packages found so far or lies around the robot file, links
        followed. Around it means not hidden and, where that is a system folder, in it itself;
        below the folder of the robot file is always around it. Links in folders that the caller or
        the environment names may lead anywhere.

        Args:
            path: The file.
            anywhere: Suffixes of files that may lie anywhere.
        """
        file, file_of_robot = path.resolve(), self._file.resolve()
        found = [folder for folder in self._found.values() if folder]
        if self._is_trusted(path) or lies_in(path, found) or file == file_of_robot:
            return True
        if file.suffix.lower() in anywhere:
            return True
        own_folders = (self._file.absolute().parent, file_of_robot.parent)
        for folder in self.around:
            place = folder.resolve()
            if not file.is_relative_to(place):
                continue
            parts = file.relative_to(place).parts
            hidden = any(part.startswith(".") for part in parts)
            own = folder in own_folders and len(folder.parts) > 1
            if not hidden and (own or len(parts) == 1 or not _is_system(folder)):
                return True
        return False

    def _is_trusted(self, path: Path) -> bool:
        """Whether a path, links not followed, is in a folder of the caller or the environment."""
        places = (*self._folders, *self._given, *_environment(), *_model_folders())
        file = normalised(path)
        return any(file.is_relative_to(normalised(place)) for place in places)

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
    """Yield the folder of a file and those above, not as far as home and system folders."""
    for level, folder in enumerate(file.parents):
        if level > LEVELS or (level and (_is_home(folder) or _is_system(folder))):
            return
        yield folder
        if is_there(folder / ".git"):
            return


def _is_home(folder: Path) -> bool:
    """Whether a folder is the home folder of the user, or that of another one."""
    own = Path.home(), Path.home().resolve()
    levels = len(folder.parts) - 1
    named = folder.parent.name in HOMES and levels <= HOME_LEVELS
    return named or folder in own or folder in _homes()


@cache
def _homes() -> frozenset[Path]:
    """Return the home folders of the users of this computer, links followed too.

    Many users of the system have the root of the file system, which is no home.
    """
    try:
        import pwd
    except ImportError:  # Windows
        return frozenset()
    stated = {Path(user.pw_dir) for user in pwd.getpwall() if user.pw_dir}
    homes = stated | {home.resolve() for home in stated if home.is_absolute()}
    return frozenset(home for home in homes if len(home.parts) > 1)


def _is_system(folder: Path) -> bool:
    """Whether a folder is the root of the file system, or holds what belongs to no one project."""
    top, *below = folder.parts[1:] or ("",)
    return not top or (top in SYSTEM and len(below) <= (top in DIVIDED))


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
        name = xml(read(manifest)).findtext("name")
    except (OSError, etree.XMLSyntaxError):
        return None
    return name.strip() if name else None


def _environment() -> Iterator[Path]:
    """Yield the folders that ROS 1 and ROS 2 name in the environment."""
    for variable, inner in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
        for folder in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield Path(folder, inner)


def _model_folders() -> Iterator[Path]:
    """Yield the folders of models that Gazebo names in the environment."""
    named = chain.from_iterable(os.environ.get(v, "").split(os.pathsep) for v in MODEL_FOLDERS)
    yield from map(Path, filter(None, named))
