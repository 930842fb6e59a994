"""Many configurations in blocks: read, checked and done on several threads with little memory."""

from __future__ import annotations

import mmap
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt

from spacearm.arrays import LARGEST, NO_NUMBERS, Array, whole
from spacearm.compiler.machine import processors
from spacearm.errors import ConfigurationError, listed
from spacearm.model.arm import SpaceArm

BLOCK = 16384
"""Configurations per thread and block: their data fit the processor cache."""
LEAST = 1024
"""So many are not divided between threads: to start one takes as long."""

BLOCKS_MAPPED = 32
"""Number of blocks after which pages of memory maps are released."""

Progress = Callable[[int, int], object]


def results_for(array: Array | None, shape: tuple[int, ...], what: str) -> Array:
    """Check an array of floats that results are written to, or make one if None."""
    if array is None:
        return np.empty(shape)
    if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype.kind != "f":
        raise ConfigurationError(
            f"{what} is {getattr(array, 'dtype', type(array).__name__)} of shape "
            f"{np.shape(array)}; give an array of floats of shape {shape}"
        )
    if not array.flags.writeable:
        raise ConfigurationError(f"{what} is read-only; give one that can be written to")
    return array


def joint_rows(arm: SpaceArm, values: npt.ArrayLike, what: str) -> Array:
    """Check values (m, n), a row for each state, and return them, not copied if they are an array.

    Raises:
        ConfigurationError: They are no numbers, or have another shape.
    """
    try:
        array: npt.NDArray[Any] = values if isinstance(values, np.ndarray) else np.asarray(values)
    except NO_NUMBERS as error:
        raise ConfigurationError(f"{what} holds no numbers: {error}") from None
    if array.size == 0 and array.ndim < 2:
        array = array.reshape(0, arm.n)
    if array.dtype.kind not in "fiu" or array.ndim != 2 or array.shape[1] != arm.n:
        raise ConfigurationError(
            f"{what} has shape {array.shape} and type {array.dtype}; {arm.name} needs real numbers "
            f"of shape (m, {arm.n}), one column for each of: {listed(arm.joint_names)}"
        )
    return array


def read_block(Q: Array, block: slice) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp]]:
    """Read one block of Q (m, n), and the numbers of its rows that are no joint positions.

    These rows are zero.
    """
    q = np.ascontiguousarray(Q[block], dtype=np.float64)
    none = np.zeros(0, dtype=np.intp)
    if not q.size or (q.min() >= -LARGEST and q.max() <= LARGEST):
        return q, none
    wrong = np.flatnonzero(~(np.abs(q) <= LARGEST).all(axis=1))
    q = q.copy()
    q[wrong] = 0.0
    return q, wrong


def place_for(results: Array, block: slice) -> Array | None:
    """Return a block of results if compiled code can write to it, else None."""
    place = results[block]
    return place if place.dtype == np.float64 and place.flags.c_contiguous else None


def fill(
    results: Mapping[str, Array],
    rows: Mapping[str, Array],
    compute: Callable[[dict[str, Array], dict[str, Array | None]], Mapping[str, Array]],
    threads: int | None,
    progress: Progress | None,
) -> None:
    """Compute results (m, ...) of rows (m, ...), block by block.

    Args:
        results: What is written to; NaN where a row is not finite.
        rows: What is read.
        compute: Gives results of some rows; also takes the places that it may write them to.
        threads: Number of threads; one per available processor if None.
        progress: Called as progress(done, m) after each block.
    """

    def do(block: slice) -> None:
        read = {name: read_block(values, block) for name, values in rows.items()}
        places = {name: place_for(values, block) for name, values in results.items()}
        found = compute({name: values for name, (values, _) in read.items()}, places)
        for name, values in results.items():
            if found[name] is not places[name]:
                values[block] = found[name]
            for _, wrong in read.values():
                values[block][wrong] = np.nan

    m = len(next(iter(rows.values())))
    run_blocks(do, m, threads, progress, [*rows.values(), *results.values()])


def run_blocks(
    do: Callable[[slice], None],
    m: int,
    threads: int | None,
    progress: Progress | None,
    arrays: Sequence[Array],
    largest: int = BLOCK,
) -> None:
    """Do all blocks of m configurations on several threads, with little memory."""
    threads = processors() if threads is None else whole(threads, "threads", 1)
    size = min(largest, max(-(-m // threads), LEAST))
    blocks = [slice(i, min(i + size, m)) for i in range(0, m, size)]
    maps = [found for array in arrays if (found := _memory_map(array)) is not None]
    with ThreadPoolExecutor(threads) as pool:
        done = pool.map(do, blocks) if len(blocks) > 1 else map(do, blocks)
        try:
            for i, _ in enumerate(done):
                if i % BLOCKS_MAPPED == 0:
                    for memory_map in maps:
                        memory_map.madvise(mmap.MADV_DONTNEED)
                if progress:
                    progress(blocks[i].stop, m)
        except BaseException:  # Ctrl-C too: only what has begun is waited for
            pool.shutdown(cancel_futures=True)
            raise


def _memory_map(array: Array) -> mmap.mmap | None:
    """Return the memory map behind an array, if any: its pages can be released once used."""
    owner: object = array
    while isinstance(owner, np.ndarray):
        if isinstance(owner, np.memmap) and owner.mode == "c":
            return None  # changes to a private copy are in memory only
        owner = owner.base
    return owner if isinstance(owner, mmap.mmap) else None
