"""Sweeps: studies computed chunk by chunk into a store, on this machine or on a Dask cluster."""

from __future__ import annotations

import itertools
import math
import os
import queue
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Generator
from concurrent.futures import Future
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

from spacearm.arrays import whole
from spacearm.compiler.machine import processors
from spacearm.errors import StoreError, SweepError
from spacearm.sweeps.quantities import nbytes
from spacearm.sweeps.store import DONE, FAILED, Store, dataset
from spacearm.sweeps.study import Chunk, Study

if TYPE_CHECKING:
    import xarray as xr
    from distributed import Client


ATTEMPTS = 3
"""Number of times a chunk is tried."""
PATIENCE = 5.0
"""Time to wait for a chunk before asking whether the cluster is there [s]."""
SHOWN = 200
"""Characters of an error that are recorded."""


class Tally(NamedTuple):
    """Progress of a sweep, in chunks.

    Attributes:
        kept: Chunks that an earlier run had done.
        computed: Chunks done in this run.
        failed: Chunks that failed each time.
        total: All chunks.
    """

    kept: int
    computed: int
    failed: int
    total: int

    @property
    def done(self) -> int:
        """Chunks that are through, failed ones too."""
        return self.kept + self.computed + self.failed


class Estimate(NamedTuple):
    """Time and disk that a quantity of a study will take.

    Attributes:
        quantity: Its name.
        chunks: Number of chunks.
        seconds: Time of a calibration chunk on one core [s], once all is compiled.
        nbytes: Size of its numbers, uncompressed.
    """

    quantity: str
    chunks: int
    seconds: float
    nbytes: int


class Status(NamedTuple):
    """The part of a quantity that is in a store.

    Attributes:
        quantity: Its name.
        chunks: Number of chunks.
        done: Those marked as done.
        failed: Errors by number of those that failed.
    """

    quantity: str
    chunks: int
    done: int
    failed: dict[int, str]


class Pool(Protocol):
    """Workers that compute chunks."""

    width: int
    final: tuple[type[BaseException], ...]

    @property
    def lost(self) -> bool:
        """Whether the workers are gone for good."""

    def submit(self, chunk: Chunk) -> Future[str]:
        """Have a chunk done."""

    def close(self) -> None:
        """Drop what is not done."""


def sweep(
    study: Study | str | os.PathLike[str],
    store: str | os.PathLike[str],
    *,
    client: Client | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> xr.Dataset:
    """Compute a study into a Zarr store, chunk by chunk; keep what is there already.

    It may be stopped or killed at any time, and so may each of its workers: run again, it goes on
    where it was, and the numbers are the same to the bit (on processors of one kind). A chunk that
    fails is tried again, then recorded with its error, and the rest goes on.

    Args:
        study: A study, or the path of its file; see `Study`.
        store: Directory to write; made if it is not there. Workers on other machines must see it,
            and the study's URDF files, under the same path.
        client: A client of a Dask cluster, which then does the work.
        workers: Processes on this machine, if there is no client; as many as there are processors
            if None.
        progress: Called as progress(done, total), in chunks, after each chunk; failed ones count as
            done.

    Returns:
        The store as one labelled dataset, read when it is used; `xarray.open_zarr` gives the same.
        Its attributes tell version, models, study and seed. Numbers not computed are NaN.

    Raises:
        ConfigurationError: The study makes no sense.
        ModelError: An arm or a design of it is unsound.
        StoreError: The store is that of another study, cannot be written, or the cluster is lost.
        UnsupportedError: Zarr is not installed: pip install 'spacearm[sweep]'.
        SweepError: All is through, but some chunks failed.

    Example:
        >>> import spacearm as sa
        >>> from tempfile import TemporaryDirectory
        >>> study = sa.Study.parse('''
        ... arms = ["planar2"]
        ... [risk]
        ... distance = 0.1
        ... radius = [0, 1, 2]
        ... samples = 1000
        ... ''')
        >>> with TemporaryDirectory() as folder:
        ...     ds = sa.sweep(study, f"{folder}/out.zarr", workers=1)
        ...     ds["near"].sum(["arm", "block"]).values
        array([37., 23.])
    """
    study = study if isinstance(study, Study) else Study.read(study)
    with closing(run_chunks(study, store, client=client, workers=workers)) as tallies:
        for tally in tallies:
            if progress:
                progress(tally.done, tally.total)
    return dataset(store, study)


def run_chunks(
    study: Study,
    store: str | os.PathLike[str],
    *,
    client: Client | None = None,
    workers: int | None = None,
) -> Generator[Tally]:
    """Compute a study into a store, as `sweep` does, and yield a tally after each chunk.

    Close the generator if you leave it early: it ends the workers.
    """
    target = Store.create(store, study)
    failed: dict[str, str] = {}
    with closing(_pool(study, target, client, workers)) as pool:
        yield from _run(study, target, pool, failed)
    if not failed:
        target.tidy()
    if failed:
        (name, error), *others = failed.items()
        raise SweepError(
            f"{len(failed)} of {study.total} chunks failed "
            f"{ATTEMPTS} times each, the others are in {store}: {name}: {error}"
            + (f" (and {len(others)} more)" if others else ""),
            failed,
        )


def estimate(study: Study) -> list[Estimate]:
    """Estimate what a study will take.

    Of each quantity a chunk in the middle is computed and thrown away.
    """
    estimates = []
    with tempfile.TemporaryDirectory() as folder:
        store = Store.create(Path(folder) / "estimate.zarr", study)
        for name, quantity in study.quantities.items():
            chunk = Chunk(name, study.count(name) // 2)
            seconds = []
            for _ in range(2):  # the first time may compile
                start = time.perf_counter()
                store.write(chunk, study.compute(chunk))
                seconds.append(time.perf_counter() - start)
            size = nbytes(quantity, math.prod(study.shape))
            estimates.append(Estimate(name, study.count(name), min(seconds), size))
    return estimates


def status(study: Study, store: str | os.PathLike[str]) -> list[Status]:
    """Return how much of a study is in its store, by the marks there."""
    opened = Store(store, study)
    found = []
    for name in study.quantities:
        marks = opened.marks(name)
        failed = {i: m.removeprefix(FAILED) for i, m in enumerate(marks) if m.startswith(FAILED)}
        done = sum(mark.startswith(DONE) for mark in marks)
        found.append(Status(name, len(marks), done, failed))
    return found


def _pool(study: Study, store: Store, client: Client | None, workers: int | None) -> Pool:
    path = str(store.path.resolve())
    if client is not None:
        from spacearm.sweeps.dask import Cluster  # imports distributed

        return Cluster(client, study.recipe, path)
    from spacearm.sweeps.processes import Processes

    workers = processors() if workers is None else whole(workers, "workers", 1)
    return Processes(workers, study.recipe, path)


def _run(study: Study, store: Store, pool: Pool, failed: dict[str, str]) -> Generator[Tally]:
    """Have all chunks done; note the errors of those that fail in `failed`."""
    finished: queue.SimpleQueue[Future[str]] = queue.SimpleQueue()
    running: dict[Future[str], Chunk] = {}
    attempts: Counter[Chunk] = Counter()
    outcomes: Counter[str] = Counter()
    chunks = study.chunks()

    def start(chunk: Chunk) -> None:
        future = pool.submit(chunk)
        running[future] = chunk
        future.add_done_callback(finished.put)

    for chunk in itertools.islice(chunks, pool.width):
        start(chunk)
    while running:
        try:
            future = finished.get(timeout=PATIENCE)
        except queue.Empty:
            future = None
        if (future and future.cancelled()) or (not future and pool.lost):
            raise StoreError(
                f"the cluster's scheduler is lost; what is in {store.path} is kept: run the same "
                "command again"
            )
        if not future:
            continue
        chunk = running.pop(future)
        error = future.exception()
        if isinstance(error, StoreError):
            raise error
        if error is None:
            outcomes[future.result()] += 1
        elif attempts[chunk] + 1 < ATTEMPTS and not isinstance(error, pool.final):
            attempts[chunk] += 1
            start(chunk)
            continue
        else:
            text = f"{type(error).__name__}: {error}"[:SHOWN]
            failed[f"{chunk.quantity} {chunk.number}"] = text
            store.record_failure(chunk, text)
        yield Tally(outcomes["kept"], outcomes["computed"], len(failed), study.total)
        for following in itertools.islice(chunks, 1):
            start(following)
