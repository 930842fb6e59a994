"""The files of a store, as Zarr reads and writes them: regular ones, inside it, up to a size.

A store may come from elsewhere. A pipe among its files would hang whoever reads it, a link would
lead out of it, a file of any length, or one that unpacks to any length, would fill the memory.
"""

from __future__ import annotations

import asyncio
import errno
import os
import re
import stat
from pathlib import Path, PurePosixPath
from typing import Any

from zarr.storage import LocalStore

from spacearm.files import aside, flush, flush_names

#: Name of the folder in which Zarr keeps the chunks of an array.
CHUNKS = "c"
#: Names of the files that Zarr and `spacearm.files` write before they rename them.
PARTIAL = re.compile(r"(.*\.)?[0-9a-f]{32}\.partial")
#: The first bytes of what Zstandard has packed: RFC 8878, section 3.1.1.
ZSTD = b"\x28\xb5\x2f\xfd"


class Files(LocalStore):
    """A directory that Zarr reads and writes.

    Attributes:
        most: Largest size of a file, packed and unpacked [bytes].
    """

    def __init__(self, root: Path | str, *, read_only: bool = False, most: int) -> None:
        super().__init__(root, read_only=read_only)
        self.most = most

    def with_read_only(self, read_only: bool = False) -> Files:
        """Return the same store, open for writing or not."""
        return Files(self.root, read_only=read_only, most=self.most)

    async def get(self, key: str, *others: Any, **options: Any) -> Any:
        """Read a file."""
        check(self.root, key, self.most)
        return self._sound(key, await super().get(key, *others, **options))

    def get_sync(self, key: str, **options: Any) -> Any:
        """Read a file."""
        check(self.root, key, self.most)
        return self._sound(key, super().get_sync(key, **options))

    def _sound(self, key: str, found: Any) -> Any:
        """Return what a file holds unless it unpacks to more than `most`."""
        if found is not None:
            size = unpacked(found.to_bytes())
            if size is None or size > self.most:
                much = "an unknown number of" if size is None else f"{size:,}"
                raise OSError(
                    f"{self.root / key} unpacks to {much} bytes, and its numbers need at most "
                    f"{self.most:,}; remove it"
                )
        return found

    async def set(self, key: str, value: Any) -> None:
        """Write a file."""
        await asyncio.to_thread(self.set_sync, key, value)

    def set_sync(self, key: str, value: Any) -> None:
        """Write a file, whole or not at all, and flush it to the disk.

        It is written in the directory of the store and then renamed: what killed processes leave is
        found there.

        Raises:
            FileNotFoundError: The store, or the directory of the array, is gone.
        """
        self._check_writable()
        check(self.root, key)
        path = self.root / key
        make_folders(self.root, path.parent)
        with aside(self.root) as file:
            file.write(value.to_bytes())
            flush(file)
            Path(file.name).replace(path)
        flush_names(path.parent)

    async def _open(self, **_: Any) -> None:
        self._ensure_open_sync()

    def _ensure_open_sync(self) -> None:
        """Open the store; `LocalStore` would make a directory where there is none."""
        if not self.root.is_dir():
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(self.root))
        self._is_open = True


def make_folders(root: Path, folder: Path) -> None:
    """Make the folders of an array's chunks, but not that of the array itself.

    A store that is removed while a sweep runs must not come back as an empty one.

    Args:
        root: The directory of the store.
        folder: The folder to make: for chunks ROOT/ARRAY/c/..., for other files ROOT/ARRAY.

    Raises:
        FileNotFoundError: The store, or the directory of the array, is gone.
    """
    if folder.is_dir():
        return
    parts = folder.relative_to(root).parts
    known = parts.index(CHUNKS) if CHUNKS in parts else len(parts)
    place = root.joinpath(*parts[:known])
    if not place.is_dir():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(place))
    for part in parts[known:]:
        if not (place / part).is_dir():
            (place / part).mkdir(exist_ok=True)
            flush_names(place)
        place /= part


def unpacked(content: bytes) -> int | None:
    """Return the size that a file claims to unpack to [bytes], its own if nothing is packed.

    Zstandard unpacks no more than that. None where it does not say: what Zarr writes always does.
    """
    if content[:4] != ZSTD:
        return len(content)
    kind = content[4] if len(content) > 4 else 0
    single, width = kind >> 5 & 1, (0, 2, 4, 8)[kind >> 6]
    width = width or single
    if not width:
        return None
    start = 5 + (not single) + (0, 1, 2, 4)[kind & 3]  # the window, the number of a dictionary
    size = int.from_bytes(content[start : start + width], "little")
    return size + 256 * (width == 2)


def check(root: Path, key: str, most: int = 2**63) -> None:
    """Check that a name leads to a regular file of a store, or to none yet.

    Raises:
        OSError: There is a link, a device or a pipe on the way, or the file is larger than `most`.
    """
    place = root
    for part in PurePosixPath(key).parts:
        place /= part
        try:
            found = place.lstat()
        except (FileNotFoundError, NotADirectoryError):
            return
        if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
            raise OSError(f"{place} is a link, a device or a pipe; put the file itself there")
    if stat.S_ISREG(found.st_mode) and found.st_size > most:
        raise OSError(f"{place} has {found.st_size:,} bytes, more than its numbers need; remove it")
