"""Files: read up to a size; written to a temporary file and renamed, never half."""

from __future__ import annotations

import stat
import tempfile
from pathlib import Path
from typing import BinaryIO

from spacearm.errors import SpaceArmError

LARGEST_TEXT = 10**7
"""Largest size of a file that people write: a URDF, a study, a list of points [bytes]."""


def opened(path: Path) -> BinaryIO:
    """Open a regular file for reading: a device may have no end, and a pipe may stay silent.

    Raises:
        OSError: It is a device or a pipe, or cannot be opened.
        ValueError: No file can have that name.
    """
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise OSError("a device or a pipe; save what it gives as a file")
    return path.open("rb")


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
    if len(content) > most:
        raise OSError(f"larger than {most / 1e6:g} MB")
    return content


def write(path: Path, content: bytes) -> Path:
    """Write a file, whole or not at all.

    Args:
        path: The file; an existing one is replaced.
        content: Its content.

    Returns:
        The path.

    Raises:
        SpaceArmError: It cannot be written, or there is a folder, a device or a pipe.
    """
    beside: Path | None = None
    try:
        if path.exists() and not path.is_file():
            raise SpaceArmError(f"{path} cannot be written: it is no regular file; name another")
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=".", delete=False) as file:
            beside = Path(file.name)
            file.write(content)
        beside.chmod(0o644)
        beside.replace(path)
    except OSError as error:
        if beside:
            beside.unlink(missing_ok=True)
        raise SpaceArmError(f"{path} cannot be written: {error.strerror}") from None
    return path
