"""Tiles: large grids cut into boxes of limited size, counted in the order of memory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

Shape = tuple[int, ...]
Region = tuple[slice, ...]


def tile(shape: Sequence[int], most: int) -> Shape:
    """The shape of boxes with at most so many points: whole along the last axes that fit."""
    sizes: list[int] = []
    for length in reversed(shape):
        sizes.append(max(1, min(length, most)))
        most //= sizes[-1]
    return tuple(reversed(sizes))


def counts(shape: Sequence[int], size: Sequence[int]) -> Shape:
    """How many boxes stand along each axis; the last ones may be smaller."""
    return tuple(-(-length // step) for length, step in zip(shape, size, strict=True))


def region(shape: Sequence[int], size: Sequence[int], number: int) -> Region:
    """Box `number` of the grid."""
    at = np.unravel_index(number, counts(shape, size)) if shape else ()
    return tuple(
        slice(int(i) * step, min((int(i) + 1) * step, length))
        for i, step, length in zip(at, size, shape, strict=True)
    )


def regions(shape: Sequence[int], most: int) -> Iterator[Region]:
    """All boxes of at most so many points."""
    size = tile(shape, most)
    return (region(shape, size, i) for i in range(math.prod(counts(shape, size))))
