"""The Zarr store that a sweep fills chunk by chunk, and that opens as one dataset.

Its layout follows from the study alone: attributes, labels and the descriptions of its arrays. What
is in a store is compared with them: another study's is refused, what is damaged or was altered is
written again. Each chunk of each array is one file, with its CRC-32C in it, written in the store's
directory, flushed to the disk and renamed. When all files of a chunk are there, its mark is
written: the CRC-32 of its numbers. A chunk counts as done if its mark is there and what the files
hold agrees with it. No file holds pickled objects: numbers, text and JSON only, in Zarr's third
format.
"""

from __future__ import annotations

import json
import math
import os
import warnings
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import SpaceArmError, StoreError, imported, shortened
from spacearm.files import (
    read,
    remove_leftovers,
    remove_unlocked,
    temporary_folder,
    write,
    write_folder,
)
from spacearm.sweeps.study import Chunk, Study
from spacearm.sweeps.toml import meaning

if TYPE_CHECKING:
    import xarray as xr

DONE, FAILED = "done", "failed"
#: Errors of Zarr for a file with a wrong checksum, or with an impossible length of text.
DAMAGED = (ValueError, MemoryError)
#: Group of the marks, an array for each quantity.
MARKS = "chunks"
#: Characters of a line that a message shows.
SHOWN = 200
#: What must agree in the description of an array.
LAYOUT = (
    "node_type", "shape", "data_type", "chunk_grid", "chunk_key_encoding", "codecs", "fill_value",
    "dimension_names",
)  # fmt: skip


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
        zarr = imported("zarr", "Zarr", "sweep")
        from spacearm.sweeps.store_files import Files

        self.path, self.study = Path(path), study
        self._there: os.stat_result | None = None
        with self._files():
            compare(self.path, study)
            self._there = self.path.stat()
            files = Files(self.path, most=largest(study))
            group: Any = zarr.open_group(files, mode="r+", zarr_format=3, use_consolidated=False)
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
        imported("zarr", "Zarr", "sweep")
        path = Path(path)
        if path.exists():
            return cls(path, study)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _trouble(path, error) from None
        try:
            write_folder(path, lambda folder: lay_out(folder, study), None)
        except SpaceArmError as error:
            if not (path / "zarr.json").is_file():  # else another sweep was as quick
                raise StoreError(f"store {error}") from None
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

    def has_failed(self, chunk: Chunk) -> bool:
        """Return whether the chunk is marked as failed."""
        with self._files():
            return self._mark(chunk).startswith(FAILED)

    def check_there(self) -> None:
        """Check that the store is still where it was when it was opened.

        Raises:
            StoreError: It was removed, moved or replaced.
        """
        remedy = "move it back, or run the same command again to begin a new one"
        try:
            found = self.path.stat()
            (self.path / "zarr.json").lstat()
        except OSError as error:
            missing = error.filename or self.path
            raise StoreError(
                f"store {self.path} is gone: {missing} was removed or moved while the sweep ran; "
                f"{remedy}"
            ) from None
        if self._there and not os.path.samestat(found, self._there):
            raise StoreError(
                f"store {self.path} is gone: another directory was put in its place while the "
                f"sweep ran; {remedy}"
            )

    def remove_leftovers(self) -> None:
        """Remove the unfinished files that killed workers have left."""
        remove_leftovers(self.path)

    def tidy(self) -> None:
        """Remove unfinished files everywhere in the store, also those that Zarr itself writes."""
        from spacearm.sweeps.store_files import PARTIAL

        for partial in self.path.rglob("*.partial"):
            if PARTIAL.fullmatch(partial.name):
                remove_unlocked(partial)

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
            if self._there:
                self.check_there()
            raise _trouble(self.path, error) from None


def dataset(path: str | os.PathLike[str], study: Study) -> xr.Dataset:
    """Open a study's store as one labelled dataset, read when it is used; NaN where nothing is."""
    import xarray as xr

    from spacearm.sweeps.store_files import Files

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
    missing = isinstance(error, FileNotFoundError) and error.filename
    where = f" ({error.filename})" if missing else ""
    return StoreError(
        f"store {path}: {error.strerror or error}{where}; what is in it is kept: when the cause is "
        "removed, run the same command again"
    )


# --- layout ---------------------------------------------------------------------------------


def lay_out(path: Path, study: Study) -> None:
    """Write attributes, labels and the descriptions of all arrays, without their numbers.

    The group's description repeats those of its arrays (consolidated metadata), as xarray expects.
    """
    import zarr
    from zarr.codecs import Crc32cCodec, ZstdCodec

    options: Any = {"compressors": [ZstdCodec(level=1), Crc32cCodec()]}
    group = zarr.open_group(path, mode="w", zarr_format=3, attributes=study.attributes)
    for name, (values, attrs) in study.labels.items():
        kind: Any = str if values.dtype == object else values.dtype
        axis = group.create_array(
            name,
            shape=values.shape,
            dtype=kind,
            dimension_names=(name,),
            attributes=dict(attrs),
            **options,
        )
        axis[:] = values
    marks = group.create_group(MARKS)
    for name, quantity in study.quantities.items():
        marks.create_array(
            name, shape=(study.count(name),), chunks=(1,), dtype=str, fill_value="", **options
        )
        for array, variable in quantity.variables.items():
            group.create_array(
                array,
                shape=(*study.shape, *quantity.shape, *variable.shape),
                chunks=(*(1 for _ in study.shape), *quantity.tile, *variable.shape),
                dtype=variable.dtype,
                fill_value=np.nan,
                dimension_names=("arm", *study.axes, *quantity.dims, *variable.dims),
                attributes=dict(variable.attrs),
                config={"write_empty_chunks": True},
                **options,
            )
    with warnings.catch_warnings():  # Zarr's third format does not yet prescribe how it is stored
        warnings.filterwarnings("ignore", "Consolidated metadata", UserWarning)
        zarr.consolidate_metadata(path, zarr_format=3)


def compare(path: Path, study: Study) -> None:
    """Refuse the store of another study.

    Labels that are damaged and descriptions that are lost are written again, as the study gives
    them.
    """
    remedy = "give another store, or finish that sweep with its own study, arms and version"
    found = _description(path / "zarr.json")
    if not found:
        raise StoreError(f"{path} is not the store of a sweep; give another store")
    attributes = found.get("attributes", {})
    for key, ours in study.attributes.items():
        theirs = attributes.get(key) if isinstance(attributes, dict) else None
        if theirs != ours and not (key == "study" and meaning(theirs) == meaning(ours)):
            was, now = _difference(theirs, ours)
            raise StoreError(
                f"{path} is the store of another sweep: its {key} has {was!r} where this one has "
                f"{now!r}; {remedy}"
            )
    with temporary_folder() as folder:
        lay_out(folder, study)
        own = {member.name for member in folder.iterdir()}
        for member in path.iterdir():
            if member.name not in own and (member / "zarr.json").exists():
                raise StoreError(f"{member} is none of this study's arrays; take it elsewhere")
        for ours in (p for p in folder.rglob("*") if p.is_file()):
            _restore(path, ours.relative_to(folder).as_posix(), ours.read_bytes(), remedy)


def _restore(path: Path, name: str, ours: bytes, remedy: str) -> None:
    """Write a description or labels again where they differ; refuse other numbers."""
    from spacearm.sweeps.store_files import check

    check(path, name)
    theirs = path / name
    if name.endswith("zarr.json"):
        expected, there = json.loads(ours), _description(theirs)
        if there and any(expected.get(key) != there.get(key) for key in LAYOUT):
            raise StoreError(f"{theirs} does not describe this study's numbers; {remedy}")
        sound = expected == there
    else:
        sound = theirs.is_file() and theirs.stat().st_size == len(ours)
        sound = sound and theirs.read_bytes() == ours
    if not sound:
        for folder in reversed(theirs.relative_to(path).parents[:-1]):
            (path / folder).mkdir(exist_ok=True)  # not the store itself, if it is gone by now
        write(theirs, ours)


def _description(path: Path) -> dict[str, Any]:
    """Read a zarr.json; return an empty dictionary if there is none or it is damaged."""
    try:
        found = json.loads(read(path))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _difference(theirs: object, ours: object) -> tuple[str, str]:
    """Return the first lines in which two values differ, comments apart."""
    lines = zip_longest(_lines(theirs), _lines(ours), fillvalue="")
    first = next(((a, b) for a, b in lines if a != b), (str(theirs), str(ours)))
    return shortened(first[0], SHOWN), shortened(first[1], SHOWN)


def _lines(value: object) -> list[str]:
    return [line for line in str(value).splitlines() if line and not line.startswith("#")]


def largest(study: Study) -> int:
    """Return the largest size of a file of a store [bytes]: its numbers as they are, and more."""
    chunks = [
        math.prod((*quantity.tile, *variable.shape))
        for quantity in study.quantities.values()
        for variable in quantity.variables.values()
    ]
    return 10**6 + 16 * max(*chunks, *(len(values) for values, _ in study.labels.values()))
