"""Large grids cut into boxes of limited size, counted in the order of memory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

Shape = tuple[int, ...]
Box = tuple[slice, ...]
"""A part of a grid: one slice along each axis."""


def tile(shape: Sequence[int], most: int) -> Shape:
    """Return the shape of boxes of at most `most` points: whole along the last axes that fit."""
    sizes: list[int] = []
    for length in reversed(shape):
        sizes.append(max(1, min(length, most)))
        most //= sizes[-1]
    return tuple(reversed(sizes))


def counts(shape: Sequence[int], size: Sequence[int]) -> Shape:
    """Return the number of boxes along each axis; the last boxes may be smaller."""
    return tuple(-(-length // step) for length, step in zip(shape, size, strict=True))


def box(shape: Sequence[int], size: Sequence[int], number: int) -> Box:
    """Return box `number` of the grid."""
    at = np.unravel_index(number, counts(shape, size)) if shape else ()
    return tuple(
        slice(int(i) * step, min((int(i) + 1) * step, length))
        for i, step, length in zip(at, size, shape, strict=True)
    )


def boxes(shape: Sequence[int], most: int) -> Iterator[Box]:
    """Iterate over all boxes of at most `most` points."""
    size = tile(shape, most)
    return (box(shape, size, i) for i in range(math.prod(counts(shape, size))))
