"""The files of a store, as Zarr reads and writes them: regular ones, inside it, up to a size.

A store may come from elsewhere. A pipe among its files would hang whoever reads it, a link would
lead out of it, a file of any length would fill the memory.
"""

from __future__ import annotations

import re
import stat
from pathlib import Path, PurePosixPath
from typing import Any

from zarr.storage import LocalStore

PARTIAL = re.compile(r"(.*\.)?[0-9a-f]{32}\.partial")
"""Names of the files that Zarr and `spacearm.files` write before they rename them."""


class Files(LocalStore):
    """A directory that Zarr reads and writes.

    Attributes:
        most: Largest size of a file [bytes].
    """

    def __init__(self, root: Path | str, *, read_only: bool = False, most: int = 2**63) -> None:
        super().__init__(root, read_only=read_only)
        self.most = most

    def with_read_only(self, read_only: bool = False) -> Files:
        """Return the same store, open for writing or not."""
        return Files(self.root, read_only=read_only, most=self.most)

    async def get(self, key: str, *others: Any, **options: Any) -> Any:
        """Read a file."""
        check(self.root, key, self.most)
        return await super().get(key, *others, **options)

    def get_sync(self, key: str, **options: Any) -> Any:
        """Read a file."""
        check(self.root, key, self.most)
        return super().get_sync(key, **options)

    async def set(self, key: str, value: Any) -> None:
        """Write a file."""
        check(self.root, key)
        await super().set(key, value)

    def set_sync(self, key: str, value: Any) -> None:
        """Write a file."""
        check(self.root, key)
        super().set_sync(key, value)


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
