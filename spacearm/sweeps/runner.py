"""Sweeps: studies computed chunk by chunk into a store, on this machine or on a Dask cluster."""

from __future__ import annotations

import itertools
import math
import os
import queue
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from spacearm.arrays import whole
from spacearm.compiler.machine import processors
from spacearm.errors import StoreError, SweepError
from spacearm.signatures import checked
from spacearm.sweeps.store import DONE, FAILED, Store, dataset
from spacearm.sweeps.study import Chunk, Study
from spacearm.sweeps.workers import Cluster, Outcome, Processes

if TYPE_CHECKING:
    import xarray as xr
    from distributed import Client


#: Number of times a chunk is tried.
ATTEMPTS = 3
#: Time to wait for a chunk before asking whether the cluster is there [s].
PATIENCE = 5.0
#: Characters of an error that are recorded.
SHOWN = 200


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


@checked
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
        ... bins = [0, 1, 2]
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
    counts: Counter[str] = Counter()
    failed: dict[str, str] = {}
    with closing(_workers(study, target, client, workers)) as pool:
        for chunk, outcome in _outcomes(study.chunks(), pool, target):
            if isinstance(outcome, str):
                counts[outcome] += 1
            else:
                text = f"{type(outcome).__name__}: {outcome}"[:SHOWN]
                failed[f"{chunk.quantity} {chunk.number}"] = text
                target.record_failure(chunk, text)
            yield Tally(counts["kept"], counts["computed"], len(failed), study.total)
    if not failed:
        target.tidy()
        return
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
            size = quantity.nbytes(math.prod(study.shape))
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


def _workers(
    study: Study, store: Store, client: Client | None, workers: int | None
) -> Processes | Cluster:
    path = str(store.path.resolve())
    if client is not None:
        return Cluster(client, study.recipe, path)
    workers = processors() if workers is None else whole(workers, "workers", 1)
    return Processes(workers, study.recipe, path)


def _outcomes(
    chunks: Iterator[Chunk], workers: Processes | Cluster, store: Store
) -> Iterator[tuple[Chunk, Outcome | BaseException]]:
    """Have all chunks done; yield each with its outcome, or the error of its last attempt."""
    finished: queue.SimpleQueue[Future[Outcome]] = queue.SimpleQueue()
    running: dict[Future[Outcome], Chunk] = {}
    attempts: Counter[Chunk] = Counter()

    def start(chunk: Chunk) -> None:
        future = workers.submit(chunk)
        running[future] = chunk
        future.add_done_callback(finished.put)

    for chunk in itertools.islice(chunks, workers.width):
        start(chunk)
    while running:
        future = None
        with suppress(queue.Empty):
            future = finished.get(timeout=PATIENCE)
        if future.cancelled() if future else workers.lost:
            raise StoreError(
                f"the cluster's scheduler is lost; what is in {store.path} is kept: run the same "
                "command again"
            )
        if not future:
            continue
        chunk = running.pop(future)
        error = future.exception()
        attempts[chunk] += 1
        if isinstance(error, StoreError):
            raise error
        if error and attempts[chunk] < ATTEMPTS and not isinstance(error, workers.final):
            start(chunk)
            continue
        del attempts[chunk]
        yield chunk, error or future.result()
        for following in itertools.islice(chunks, 1):
            start(following)
