"""The layout of a store: attributes, labels and the descriptions of its arrays.

They follow from the study alone. What is in a store is compared with them: another study's is
refused, what is damaged or was altered is written again.
"""

from __future__ import annotations

import json
import math
import tempfile
from importlib.util import find_spec
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from spacearm.errors import StoreError, UnsupportedError, shortened
from spacearm.files import read, write
from spacearm.sweeps.study import Study
from spacearm.sweeps.toml import meaning

MARKS = "chunks"
"""Group of the marks, an array for each quantity."""
SHOWN = 200
"""Characters of a line that a message shows."""
LAYOUT = (
    "node_type", "shape", "data_type", "chunk_grid", "chunk_key_encoding", "codecs", "fill_value",
    "dimension_names",
)  # fmt: skip
"""What must agree in the description of an array."""


def check_zarr() -> None:
    """Refuse to go on without Zarr, an extra."""
    if find_spec("zarr") is None:
        raise UnsupportedError("Zarr is not installed: pip install 'spacearm[sweep]'")


def describe(path: Path, study: Study) -> None:
    """Write attributes, labels and the descriptions of all arrays, without their numbers."""
    import zarr
    from zarr.codecs import Crc32cCodec, ZstdCodec

    options: Any = {"compressors": [ZstdCodec(level=1), Crc32cCodec()]}
    group = zarr.open_group(path, mode="w", zarr_format=3, attributes=study.attributes)
    labels = [study.coords, *(quantity.coords for quantity in study.quantities.values())]
    for name, (values, attrs) in (label for part in labels for label in part.items()):
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


def compare(path: Path, study: Study) -> None:
    """Refuse the store of another study.

    Labels that are damaged and descriptions that are lost are written again, as the study gives
    them.
    """
    remedy = "give another --store, or finish that sweep with its own study, arms and version"
    found = _description(path / "zarr.json")
    if not found:
        raise StoreError(f"{path} is no store of a sweep; give another --store")
    attributes = found.get("attributes", {})
    for key, ours in study.attributes.items():
        theirs = attributes.get(key) if isinstance(attributes, dict) else None
        if theirs != ours and not (key == "study" and meaning(theirs) == meaning(ours)):
            was, now = _difference(theirs, ours)
            raise StoreError(
                f"{path} is the store of another sweep: its {key} has {was!r} where this one has "
                f"{now!r}; {remedy}"
            )
    with tempfile.TemporaryDirectory() as folder:
        describe(Path(folder), study)
        own = {member.name for member in Path(folder).iterdir()}
        for member in path.iterdir():
            if member.name not in own and (member / "zarr.json").exists():
                raise StoreError(f"{member} is none of this study's arrays; take it elsewhere")
        for ours in (p for p in Path(folder).rglob("*") if p.is_file()):
            _restore(path, ours.relative_to(folder).as_posix(), ours.read_bytes(), remedy)


def _restore(path: Path, name: str, ours: bytes, remedy: str) -> None:
    """Write a description or labels again where they differ; refuse other numbers."""
    from spacearm.sweeps.files import check

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
        theirs.parent.mkdir(parents=True, exist_ok=True)
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
    asked = study.quantities.values()
    labels = [v for part in (study.coords, *(a.coords for a in asked)) for v, _ in part.values()]
    chunks = [
        math.prod((*quantity.tile, *variable.shape))
        for quantity in asked
        for variable in quantity.variables.values()
    ]
    return 10**6 + 16 * max(*chunks, *map(len, labels))
