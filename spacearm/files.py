"""Files: read up to a size; written under another name, flushed to the disk and renamed."""

from __future__ import annotations

import codecs
import errno
import fcntl
import os
import re
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from secrets import token_hex
from typing import Any, BinaryIO, NamedTuple
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt
from numpy.lib.npyio import NpzFile

from spacearm.errors import SpaceArmError

#: Largest size of a file that people write: a URDF, a study, a list of points [bytes].
LARGEST_TEXT = 10**7
#: Names of files and folders that are not finished.
UNFINISHED = re.compile(r"\.[0-9a-f]{32}\.partial")
#: Name, in the unfinished folder that replaces another, of the one that is replaced.
BEFORE = "before"
#: Time that what still writes to a folder may take to end [s].
ENDING = 10.0
#: Time between two attempts to remove such a folder [s].
PAUSE = 0.02
SILENT = "a device or a pipe; save what it gives as a file"

#: Writes the content of a file to it.
Fill = Callable[[BinaryIO], object]


def opened(path: Path) -> BinaryIO:
    """Open a regular file for reading: a device may have no end, and a pipe may stay silent.

    Raises:
        OSError: It is a device or a pipe, or cannot be opened.
        ValueError: No file can have that name.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        raise FileNotFoundError("no such file; check the path") from None
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise OSError(SILENT)
    return open(path, "rb", opener=lambda name, how: os.open(name, how | os.O_NONBLOCK))


def read(path: Path, most: int = LARGEST_TEXT) -> bytes:
    """Read a regular file.

    Args:
        path: The file.
        most: Largest size [bytes].

    Raises:
        OSError: It is larger, a device or a pipe, or cannot be read.
        ValueError: No file can have that name.
    """
    with opened(path) as file:
        content = file.read(most + 1)
    if content is None:  # of those of the system some have nothing to give as yet
        raise OSError(SILENT)
    if len(content) > most:
        raise OSError(f"larger than {most / 1e6:g} MB")
    return content


def is_there(path: Path) -> bool:
    """Tell whether there is something at a path; no file has a name with NUL or an overlong one."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Tell whether there is a folder at a path, as `is_there`."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


class Named(NamedTuple):
    """The files that a name in a file may mean.

    Attributes:
        found: The files that may be read, by their absolute paths, the most likely one first.
        refused: What exists and is not read: its path and the reason, as part of a message.
    """

    found: list[Path]
    refused: list[str]


def named_files(name: str, folders: Sequence[Path], allowed: Callable[[Path], bool]) -> Named:
    """Find the files that a name in a file may mean, among those that may be read.

    All readers find by this function what a file names: meshes and their buffers, included files
    and YAML files.

    Args:
        name: A relative or absolute path. It is also tried without blanks at its ends, with
            backslashes as separators of folders and with percent-encoded characters, as in URIs.
        folders: Folders that a relative name may start from, the most likely one first.
        allowed: Tells whether a path may be read; see `lies_in`, which follows links.
    """
    found: list[Path] = []
    refused: list[str] = []
    slashed = name.strip().replace("\\", "/")
    spellings = (name, name.strip(), slashed, unquote(slashed))
    candidates = [Path(folder, text) for text in spellings for folder in folders]
    for path in dict.fromkeys(map(normalised, candidates)):
        try:
            mode = path.stat().st_mode
            if stat.S_ISDIR(mode):
                continue
            if not allowed(path):
                target = path.resolve()
                leads = f"{path}, which is" if target == path else f"{path}, a link to {target},"
                refused.append(f"{leads} in none of its packages")
            elif stat.S_ISREG(mode):
                found.append(path)
            else:
                refused.append(f"{path}, a device or a pipe")
        except (OSError, ValueError):  # there is none, or no file can have that name
            continue
    return Named(found, refused)


def normalised(path: Path) -> Path:
    """Return an absolute path without "..", links not followed."""
    return Path(os.path.normpath(path.absolute()))


def lies_in(path: Path, folders: Iterable[Path]) -> bool:
    """Tell whether a path lies in one of the folders, once all links are followed."""
    target = Path(os.path.realpath(path))
    return any(target.is_relative_to(os.path.realpath(folder)) for folder in folders)


#: Byte-order marks and the encodings that they state; the longest marks come first.
MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def marked_encoding(content: bytes) -> str | None:
    """Return the encoding that the byte-order mark of a text states; None if there is no mark."""
    return next((encoding for mark, encoding in MARKS if content.startswith(mark)), None)


def decoded(content: bytes) -> str:
    """Decode a text: as its byte-order mark states, else as UTF-8.

    Raises:
        ValueError: It is encoded otherwise.
    """
    return content.decode(marked_encoding(content) or "utf-8")


def arrays_in(path: Path, most: int | None = None) -> dict[str, npt.NDArray[Any]]:
    """Read the arrays of a NumPy archive.

    Args:
        path: The file.
        most: Largest size of the arrays [bytes]; that of the file if None: nothing is compressed.

    Raises:
        ValueError: It cannot be read, is none of NumPy's archives of plain arrays, or holds more.
    """
    try:
        with opened(path) as file, NpzFile(file, allow_pickle=False) as archive:
            entries = archive.zip.infolist() if archive.zip else []
            held = sum(entry.file_size for entry in entries)
            packed = held > (most or os.fstat(file.fileno()).st_size)
            arrays = {} if packed else dict(archive)
    except OSError as error:
        raise ValueError(str(error)) from None
    except Exception as error:  # whatever zipfile and NumPy make of a damaged file
        raise ValueError(f"{error}; give an .npz file that its save wrote") from None
    if packed and most:
        raise ValueError(f"it holds {held / 1e9:.3g} GB, and {most / 1e9:g} GB at most are read")
    if packed:
        raise ValueError("it holds more data than it has bytes (compressed?); write it by save")
    if odd := [name for name, array in arrays.items() if not isinstance(array, np.ndarray)]:
        raise ValueError(f"{odd[0][:60]!r} is not an array")
    return arrays


def xml(content: bytes, bare: bool = False) -> Any:
    """Return the root of an XML document, without entities, its DTD or access to a network.

    Args:
        content: The document.
        bare: Whether comments and processing instructions are left out.

    Raises:
        lxml.etree.XMLSyntaxError: It is no XML.
    """
    from lxml import etree  # only where there is some

    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=bare,
        remove_pis=bare,
    )  # fmt: skip
    return etree.fromstring(content, parser)


def write(path: Path, content: bytes) -> Path:
    """Write a file, whole or not at all; see `write_together`."""
    return write_by(path, writing(content))


def writing(content: bytes) -> Fill:
    """Return the function that writes this content to a file; see `write_together`."""
    return lambda file: file.write(content)


def write_by(path: Path, fill: Fill) -> Path:
    """Write a file part by part, whole or not at all; see `write_together`."""
    write_together({path: fill})
    return path


def write_together(fills: Mapping[Path, Fill]) -> None:
    """Write the files of one result: all of them whole, or none.

    Each file is written under another name in its folder and flushed to the disk. When all are
    there, they are renamed, and the folders are flushed. After an error or Ctrl-C the folders hold
    what they held before. If the process is killed, the next write to a folder removes the
    unfinished files in it.

    A new file has the permissions that the umask leaves, a replaced one keeps its own. Where a
    path is a link, the file that it leads to is replaced.

    Args:
        fills: For each file, a function that writes its content to an open file. Existing files
            are replaced.

    Raises:
        SpaceArmError: A file cannot be written, or there is a folder, a device or a pipe.
    """
    with ExitStack() as unfinished, ExitStack() as undo:
        written: dict[Path, tuple[Path, Path]] = {}
        for path, fill in fills.items():
            with _naming(path):
                target = _target(path)
                remove_leftovers(target.parent)
                file = unfinished.enter_context(aside(target.parent))
                if target.exists():
                    os.fchmod(file.fileno(), stat.S_IMODE(target.stat().st_mode))
                fill(file)
                flush(file)
            written[path] = (target, Path(file.name))
        for path, (target, finished) in written.items():
            with _naming(path):
                if target.exists():
                    before = unfinished.enter_context(_kept(target))
                    undo.callback(before.replace, target)
                else:
                    undo.callback(_rename_own, target, finished.stat(), finished)
                finished.replace(target)
        folders = {target.parent: path for path, (target, _) in written.items()}
        for folder, path in folders.items():
            with _naming(path):
                flush_names(folder)
        undo.pop_all()


def _rename_own(path: Path, own: os.stat_result, name: Path) -> None:
    """Rename a file or folder if it is there and not one that another program has put there."""
    with suppress(FileNotFoundError):
        if os.path.samestat(path.stat(), own):
            path.rename(name)


def writable(path: Path) -> None:
    """Refuse a file that cannot be written, before the work for it begins.

    Raises:
        SpaceArmError: It cannot be written, or there is a folder, a device or a pipe.
    """
    with _naming(path):
        folder = _target(path).parent
        remove_leftovers(folder)
        with aside(folder):
            pass


def _target(path: Path) -> Path:
    """Return the file that a path leads to.

    Raises:
        SpaceArmError: There is a folder, a device or a pipe.
    """
    if path.exists() and not path.is_file():
        raise SpaceArmError(f"{path} cannot be written: it is not a regular file; name another")
    return Path(os.path.realpath(path))


@contextmanager
def aside(folder: Path) -> Iterator[BinaryIO]:
    """Open an empty file in a folder; what has its name afterwards is removed.

    The file is locked as long as it is open: `remove_leftovers` leaves it alone.
    """
    while True:
        path = folder / f".{token_hex(16)}.partial"
        file = path.open("xb")
        try:
            if _locked(file.fileno()):
                yield file
                return
        finally:
            with suppress(OSError):
                path.unlink()
            with suppress(OSError):  # what could not be written is in its buffer
                file.close()


@contextmanager
def _kept(file: Path) -> Iterator[Path]:
    """Keep what a file holds under another name in its folder, until it is replaced for good."""
    while True:
        kept = file.with_name(f".{token_hex(16)}.partial")
        try:
            try:
                os.link(file, kept)
            except OSError:  # some file systems have no hard links
                shutil.copy2(file, kept)
            try:
                held = kept.open("rb")
            except FileNotFoundError:  # another process took it for a leftover
                continue
            with held:
                _locked(held.fileno())
                if kept.exists():
                    yield kept
                    return
        finally:
            with suppress(OSError):
                kept.unlink()


def _locked(number: int) -> bool:
    """Lock an open file or folder; return whether it is still there and nobody else has locked it.

    The system unlocks it when the process ends, in whatever way.
    """
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # some file systems lock nothing: `remove_leftovers` removes nothing there
        return True
    return os.fstat(number).st_nlink > 0


def remove_leftovers(folder: Path) -> None:
    """Remove the unfinished files and folders that killed processes have left in a folder."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if UNFINISHED.fullmatch(entry.name):
                remove_unlocked(Path(entry.path))


def remove_unlocked(path: Path) -> None:
    """Remove an unfinished file or folder unless a process has locked it."""
    is_folder = path.is_dir()
    access = os.O_RDONLY if is_folder else os.O_RDWR  # NFS locks only files that may be written
    with suppress(OSError):
        number = os.open(path, access | os.O_NOFOLLOW | os.O_NONBLOCK)
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not is_folder:
                path.unlink()
            elif not (path / BEFORE).exists():  # else it holds the only copy of a result
                shutil.rmtree(path)
        finally:
            os.close(number)


def remove_folder(folder: Path) -> None:
    """Remove a folder to which threads or processes that are about to end may still write."""
    end = time.monotonic() + ENDING
    shutil.rmtree(folder, ignore_errors=True)
    while folder.exists() and time.monotonic() < end:
        time.sleep(PAUSE)
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Make a folder for a while; it goes when what still writes to it has ended."""
    folder = Path(tempfile.mkdtemp())
    try:
        yield folder
    finally:
        remove_folder(folder)


def flush(file: BinaryIO) -> None:
    """Write a file to the disk."""
    file.flush()
    _flush(file.fileno())


def _flush(number: int) -> None:
    """Have the system write an open file, or the names in an open folder, to the disk."""
    try:
        os.fsync(number)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # the file system has no such call
            raise


def flush_names(folder: Path) -> None:
    """Have the system write the names in a folder to the disk."""
    try:
        number = os.open(folder, os.O_RDONLY)
    except PermissionError:  # it may be written to and not be read
        return
    try:
        _flush(number)
    finally:
        os.close(number)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Raise errors of the system as one that names the path, with the remedy where there is one."""
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: no file can have that name
        if isinstance(error, SpaceArmError):
            raise
        why = getattr(error, "strerror", None) or error
        where = isinstance(error, FileNotFoundError | NotADirectoryError | PermissionError)
        remedy = "; name a file in a folder that exists and that you may write to" if where else ""
        raise SpaceArmError(f"{path} cannot be written: {why}{remedy}") from None


def write_folder(path: Path, fill: Callable[[Path], object], mark: str | None) -> Path:
    """Write a folder, whole or not at all, and flush it to the disk.

    Args:
        path: The folder; an existing one is replaced if it is of the same kind.
        fill: Called with an empty folder, writes into it.
        mark: Name of a file that all folders of this kind hold; None if no folder is replaced.

    Returns:
        The path.

    Raises:
        SpaceArmError: It cannot be written, or there is something else.
    """
    with _naming(path):
        if path.exists() and not (mark and (path / mark).is_file()):
            raise SpaceArmError(f"{path} cannot be written: there is something else; name another")
        target = Path(os.path.realpath(path))
        with _folder_aside(target.parent) as unfinished, ExitStack() as undo:
            made = unfinished / "made"
            made.mkdir()
            fill(made)
            _flush_all(made)
            before = unfinished / BEFORE
            if mark and target.exists():
                undo.callback(_put_back, before, target)
                target.rename(before)
            undo.callback(_rename_own, target, made.stat(), made)
            made.rename(target)
            flush_names(target.parent)
            undo.pop_all()
            with suppress(OSError):  # it remains if the process is killed now
                if before.exists():
                    before.rename(unfinished / "replaced")
            remove_folder(before)  # if it could not be renamed
    return path


def _put_back(before: Path, target: Path) -> None:
    """Rename the folder that was to be replaced back, if it has been renamed.

    Raises:
        SpaceArmError: Another program has put something in its place.
    """
    if not before.exists():
        return
    try:
        before.rename(target)
    except OSError as error:
        raise SpaceArmError(
            f"{target} cannot be written: {error.strerror}; what it held is kept in {before}: "
            "move it where you want it"
        ) from None


@contextmanager
def _folder_aside(parent: Path) -> Iterator[Path]:
    """Make a locked folder in another one; it is removed afterwards, with what is in it then.

    It stays if it holds a folder that was to be replaced and could not be put back.
    """
    remove_leftovers(parent)
    while True:
        path = parent / f".{token_hex(16)}.partial"
        path.mkdir()
        try:
            number = os.open(path, os.O_RDONLY)
            try:
                if _locked(number):
                    yield path
                    return
            finally:
                os.close(number)
        finally:
            if not (path / BEFORE).exists():
                remove_folder(path)


def _flush_all(folder: Path) -> None:
    """Have the system write all files and names below a folder to the disk."""
    for place, _, names in os.walk(folder):
        for name in names:
            with Path(place, name).open("rb") as file:
                flush(file)
        flush_names(Path(place))


def name_part(name: str) -> str:
    """Return a robot's name as a part of a file's name, which leads to no other folder.

    Letters, digits, ".", "_" and "-" stay, at most 100 bytes of them; a file that starts with "."
    or "-" is hidden or taken for an option.
    """
    safe = re.sub(r"[^\w.-]+", "_", name).lstrip(".-").encode()[:100].decode(errors="ignore")
    return safe or "robot"
