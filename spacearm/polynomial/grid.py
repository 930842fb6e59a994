"""Values of trigonometric polynomials on dense grids, block by block.

The tensor of real waves is contracted with one axis of the grid after the other. The last step,
which makes all the values, is a product with the 2 d + 1 waves of one axis of low degree d: a few
flops for each value. A block of values fits the processor cache, so that what is done with it
there (a sign, a least value, a count) costs no traffic to memory, which is slower than the
arithmetic.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, TypeVar

import numpy as np

from spacearm.arrays import Array
from spacearm.compiler.machine import processors
from spacearm.polynomial.contraction import waves

BLOCK = 1 << 16
"""Values of a block, half a megabyte: they fit the second cache."""
WIDE = 16
"""Points of an axis from which it may be the last one, whose product makes all the values."""

T = TypeVar("T")
Index = tuple[slice, ...]


class Nesting(NamedTuple):
    """Order in which the axes of a grid are contracted.

    Attributes:
        outer: Axes of which a block holds one point.
        split: The axis of which it holds a part.
        inner: Axes of which it holds all points; the last one makes the values.
        part: Points of the split axis in a block.
    """

    outer: tuple[int, ...]
    split: int
    inner: tuple[int, ...]
    part: int

    @classmethod
    def of(cls, sizes: tuple[int, ...], shape: tuple[int, ...]) -> Nesting:
        """Choose it for a tensor of these sizes and a grid of this shape, of two axes at least."""
        wide = [j for j in range(len(shape)) if shape[j] >= WIDE] or list(range(len(shape)))
        last = min(wide, key=lambda j: (sizes[j], -shape[j]))
        others = sorted((j for j in range(len(shape)) if j != last), key=lambda j: -sizes[j])
        inner, values, split = [last], shape[last], others.pop()
        while others and values * shape[split] < BLOCK:
            inner.insert(0, split)
            values *= shape[split]
            split = others.pop()
        part = min(shape[split], max(1, BLOCK // values))
        return cls(tuple(sorted(others, key=lambda j: -shape[j])), split, tuple(inner), part)


def over_blocks(
    tensor: Array, shape: tuple[int, ...], do: Callable[[Array, Index], T], threads: int | None
) -> list[T]:
    """Call `do` with blocks of values on a tensor grid; see `TrigPolynomial.on_grid`.

    Args:
        tensor: (2 d_1 + 1, ..., 2 d_n + 1) in the basis of real waves.
        shape: Points N_j in each angle.
        do: Takes the values of a block and its slices of the grid.
        threads: Number of threads; one per available processor if None.
    """
    n = tensor.ndim
    padding = (1,) * (2 - n)  # a block needs two axes
    tensor, shape = tensor.reshape((*tensor.shape, *padding)), (*shape, *padding)
    B = [
        waves(np, 2.0 * np.pi * np.arange(N) / N, size // 2).T.copy()
        for N, size in zip(shape, tensor.shape, strict=True)
    ]
    nest = Nesting.of(tensor.shape, shape)
    order = (*nest.outer, nest.split, *nest.inner)
    ordered = tensor.transpose(order)
    to_axes = np.argsort(order)
    last = np.ascontiguousarray(B[nest.inner[-1]].T)
    width = math.prod(shape[j] for j in nest.inner)
    local = threading.local()

    def expanded(partial: Array, index: dict[int, slice]) -> Iterator[T]:
        """Expand the split and the inner axes at one point of the outer ones."""
        for axis, j in enumerate(nest.inner[:-1], start=1):
            partial = np.moveaxis(np.tensordot(B[j], partial, (1, axis)), 0, axis)
        sums = np.ascontiguousarray(partial).reshape(partial.shape[0], -1)
        if not hasattr(local, "values"):
            local.values = np.empty(nest.part * width)
        for start in range(0, shape[nest.split], nest.part):
            piece = slice(start, min(start + nest.part, shape[nest.split]))
            rows = (B[nest.split][piece] @ sums).reshape(-1, len(last))
            values = local.values[: len(rows) * last.shape[1]].reshape(len(rows), -1)
            np.matmul(rows, last, out=values)
            there = index | {nest.split: piece}
            slices = tuple(there.get(j, slice(0, N)) for j, N in enumerate(shape))
            block = values.reshape([slices[j].stop - slices[j].start for j in order])
            block = block.transpose(to_axes)
            yield do(block.reshape(block.shape[:n]) if padding else block, slices[:n])

    def nested(partial: Array, depth: int, index: dict[int, slice]) -> Iterator[T]:
        """Contract the outer axes from `depth` on, one point after the other."""
        if depth == len(nest.outer):
            yield from expanded(partial, index)
            return
        j = nest.outer[depth]
        flat = partial.reshape(len(partial), -1)
        for i, sums in enumerate(B[j] @ flat):
            there = index | {j: slice(i, i + 1)}
            yield from nested(sums.reshape(partial.shape[1:]), depth + 1, there)

    if not nest.outer:
        return list(expanded(ordered, {}))
    first = nest.outer[0]
    flat = ordered.reshape(len(ordered), -1)

    def task(i: int) -> list[T]:
        """Do the blocks at point i of the first axis."""
        sums = (B[first][i] @ flat).reshape(ordered.shape[1:])
        return list(nested(sums, 1, {first: slice(i, i + 1)}))

    with ThreadPoolExecutor(processors() if threads is None else threads) as pool:
        return [x for found in pool.map(task, range(shape[first])) for x in found]
