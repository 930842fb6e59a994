"""Files: read up to a size; written to a temporary file and renamed, never half."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt
from numpy.lib.npyio import NpzFile

from spacearm.errors import SpaceArmError

#: Largest size of a file that people write: a URDF, a study, a list of points [bytes].
LARGEST_TEXT = 10**7
SILENT = "a device or a pipe; save what it gives as a file"


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
    """Write a file, whole or not at all; see `write_by`."""
    return write_by(path, lambda file: file.write(content))


def write_by(path: Path, fill: Callable[[BinaryIO], object]) -> Path:
    """Write a file part by part, and have it there once it is whole, or not at all.

    A new file has the permissions that the umask leaves, a replaced one keeps its own. Where the
    path is a link, what it leads to is replaced.

    Args:
        path: The file; an existing one is replaced.
        fill: Writes its content to an open file.

    Returns:
        The path.

    Raises:
        SpaceArmError: It cannot be written, or there is a folder, a device or a pipe.
    """
    with _beside(path) as (target, beside):
        with beside.open("wb") as file:
            if target.exists():
                beside.chmod(stat.S_IMODE(target.stat().st_mode))
            fill(file)
        beside.replace(target)
    return path


def writable(path: Path) -> None:
    """Refuse a file that cannot be written, before the work for it begins.

    Raises:
        SpaceArmError: It cannot be written, or there is a folder, a device or a pipe.
    """
    with _beside(path):
        pass


@contextmanager
def _beside(path: Path) -> Iterator[tuple[Path, Path]]:
    """Make an empty file beside the one that is written; it is gone afterwards.

    Yields:
        What the path leads to, and the file beside it.
    """
    beside: Path | None = None
    try:
        if path.exists() and not path.is_file():
            raise SpaceArmError(f"{path} cannot be written: it is not a regular file; name another")
        target = Path(os.path.realpath(path))
        beside = target.with_name(f".{token_hex(16)}.partial")
        beside.open("xb").close()
        yield target, beside
    except (OSError, ValueError) as error:  # ValueError: no file can have that name
        raise _unwritten(path, error) from None
    finally:
        if beside:
            with suppress(OSError):
                beside.unlink()


def _unwritten(path: Path, error: OSError | ValueError) -> SpaceArmError:
    """Return the error for what cannot be written, with the remedy where it is another folder."""
    why = getattr(error, "strerror", None) or error
    where = isinstance(error, FileNotFoundError | NotADirectoryError | PermissionError)
    remedy = "; name a file in a folder that there is and that you may write to" if where else ""
    return SpaceArmError(f"{path} cannot be written: {why}{remedy}")


def write_folder(path: Path, fill: Callable[[Path], object], mark: str) -> Path:
    """Write a folder, whole or not at all.

    Args:
        path: The folder; an existing one is replaced if it is of the same kind.
        fill: Called with an empty folder, writes into it.
        mark: Name of a file that all folders of this kind hold.

    Returns:
        The path.

    Raises:
        SpaceArmError: It cannot be written, or there is something else.
    """
    try:
        if path.exists() and not (path / mark).is_file():
            raise SpaceArmError(f"{path} cannot be written: there is something else; name another")
        target = Path(os.path.realpath(path))
        with TemporaryDirectory(prefix=".", suffix=".partial", dir=target.parent) as beside:
            made = Path(beside, "made")
            made.mkdir()
            fill(made)
            if target.exists():
                target.rename(Path(beside, "before"))
            made.rename(target)
    except (OSError, ValueError) as error:
        raise _unwritten(path, error) from None
    return path


def name_part(name: str) -> str:
    """Return a robot's name as a part of a file's name, which leads to no other folder.

    Letters, digits, ".", "_" and "-" stay, at most 100 bytes of them; a file that starts with "."
    or "-" is hidden or taken for an option.
    """
    safe = re.sub(r"[^\w.-]+", "_", name).lstrip(".-").encode()[:100].decode(errors="ignore")
    return safe or "robot"
