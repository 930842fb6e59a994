"""The Zarr store that a sweep fills chunk by chunk, and that opens as one dataset.

Each chunk of each array is one file, with its CRC-32C in it, written beside its place and renamed.
When all files of a chunk are there, its mark is written: the CRC-32 of its numbers. A chunk
counts as done if its mark is there and what the files hold agrees with it. No file holds pickled
objects: numbers, text and JSON only, in Zarr's third format.
"""

from __future__ import annotations

import os
import shutil
import warnings
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex
from typing import TYPE_CHECKING, Any

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import StoreError
from spacearm.sweeps.layout import MARKS, check_zarr, compare, describe, largest
from spacearm.sweeps.study import Chunk, Study

if TYPE_CHECKING:
    import xarray as xr

DONE, FAILED = "done", "failed"
DAMAGED = (ValueError, MemoryError)
"""Errors of Zarr for a file with a wrong checksum, or with an impossible length of text."""


class Store:
    """The store of one study.

    Attributes:
        path: Its directory.
    """

    def __init__(self, path: str | os.PathLike[str], study: Study) -> None:
        """Open a store that `create` made.

        Raises:
            StoreError: There is no store, or it belongs to another study, model or version.
            UnsupportedError: Zarr is not installed.
        """
        check_zarr()
        import zarr

        from spacearm.sweeps.files import Files  # imports zarr

        self.path, self.study = Path(path), study
        with self._files():
            compare(self.path, study)
            files = Files(self.path, most=largest(study))
            group: Any = zarr.open_group(files, mode="r+", zarr_format=3)
            self._marks = {name: group[f"{MARKS}/{name}"] for name in study.quantities}
            self._arrays = {
                name: group[name]
                for quantity in study.quantities.values()
                for name in quantity.variables
            }

    @classmethod
    def create(cls, path: str | os.PathLike[str], study: Study) -> Store:
        """Open the store of a study; make it first if nothing is there.

        Raises:
            StoreError: Something else is there, or nothing can be written.
        """
        check_zarr()
        path = Path(path)
        if path.exists():
            return cls(path, study)
        beside = path.with_name(f".{token_hex(16)}.partial")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            beside.mkdir()
            describe(beside, study)
            beside.rename(path)
        except OSError as error:
            shutil.rmtree(beside, ignore_errors=True)
            if not (path / "zarr.json").is_file():  # else another sweep was as quick
                raise _trouble(path, error) from None
        return cls(path, study)

    def marks(self, quantity: str) -> list[str]:
        """Return the marks of a quantity: "", "done CRC" or "failed ERROR"; "" if damaged."""
        with self._files():
            marks = self._marks[quantity]
            try:
                return [str(mark) for mark in marks[:]]
            except DAMAGED:
                return [self._mark(Chunk(quantity, i)) for i in range(marks.shape[0])]

    def is_done(self, chunk: Chunk) -> bool:
        """Return whether the chunk is marked as done and its files agree with the mark."""
        with self._files():
            mark = self._mark(chunk)
            if not mark.startswith(DONE):
                return False
            try:
                box = self.study.box(chunk)
                names = self.study.quantities[chunk.quantity].variables
                return mark == _done({name: self._arrays[name][box] for name in names})
            except DAMAGED:
                return False

    def write(self, chunk: Chunk, values: Mapping[str, Array]) -> None:
        """Write a chunk, then its mark.

        Raises:
            StoreError: It cannot be written.
        """
        with self._files():
            try:
                self._write(chunk, values)
            except FileNotFoundError:  # another sweep that ended took it for a leftover
                self._write(chunk, values)

    def _write(self, chunk: Chunk, values: Mapping[str, Array]) -> None:
        box = self.study.box(chunk)
        for name, array in values.items():
            self._arrays[name][box] = array
        self._marks[chunk.quantity][chunk.number] = _done(values)

    def record_failure(self, chunk: Chunk, error: str) -> None:
        """Mark a chunk as failed.

        Raises:
            StoreError: It cannot be written.
        """
        with self._files():
            self._marks[chunk.quantity][chunk.number] = f"{FAILED} {error}"

    def tidy(self) -> None:
        """Remove the unfinished files of killed processes."""
        from spacearm.sweeps.files import PARTIAL

        for partial in self.path.rglob("*.partial"):
            if PARTIAL.fullmatch(partial.name):
                partial.unlink(missing_ok=True)

    def _mark(self, chunk: Chunk) -> str:
        try:
            return str(self._marks[chunk.quantity][chunk.number])
        except DAMAGED:
            return ""

    @contextmanager
    def _files(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise _trouble(self.path, error) from None


def dataset(path: str | os.PathLike[str], study: Study) -> xr.Dataset:
    """Open a study's store as one labelled dataset, read when it is used; NaN where nothing is."""
    import xarray as xr

    from spacearm.sweeps.files import Files

    files = Files(Path(path), read_only=True, most=largest(study))
    with warnings.catch_warnings():  # a file that the user put there is no array, and no fault
        warnings.filterwarnings("ignore", "Object at", UserWarning)
        return xr.open_zarr(files, chunks=None, consolidated=False, zarr_format=3)


def _done(values: Mapping[str, Array]) -> str:
    """Return the mark of a chunk with these numbers."""
    crc = 0
    for array in values.values():
        crc = zlib.crc32(np.ascontiguousarray(array).tobytes(), crc)
    return f"{DONE} {crc:08x}"


def _trouble(path: Path, error: OSError) -> StoreError:
    return StoreError(
        f"store {path}: {error.strerror or error}; what is in it is kept: when the cause is "
        "removed, run the same command again"
    )
