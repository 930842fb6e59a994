"""Sweeps: studies computed chunk by chunk into a store, on this machine or on a Dask cluster.

Workers compute the chunks: processes of this machine, or those of the cluster.
"""

from __future__ import annotations

import asyncio
import itertools
import os
import queue
import threading
from collections import Counter
from collections.abc import Callable, Collection, Generator, Iterator
from concurrent.futures import Future
from contextlib import closing, suppress
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Literal, NamedTuple

from spacearm.arrays import MOST_THREADS, whole
from spacearm.compiler.machine import processors
from spacearm.errors import SpaceArmError, StoreError, SweepError, imported, listed
from spacearm.processes import Process, Threads, WorkerLostError
from spacearm.signatures import checked
from spacearm.sweeps.store import DONE, FAILED, Store, dataset
from spacearm.sweeps.study import Chunk, Recipe, Study, remade

if TYPE_CHECKING:
    import xarray as xr
    from distributed import Client

Outcome = Literal["kept", "computed", "lost"]
#: What is done about a chunk: `do` or `read_back`.
Work = Callable[[Recipe, str, Chunk], Outcome]
#: Chunks that the scheduler holds at a time: enough for a thousand cores.
WIDTH = 2000
#: Time that a scheduler may take to answer when it is first asked [s].
ANSWERED = 5
#: Time after which a scheduler that does not answer in the midst of work is lost [s].
SILENCE = 60
#: What Dask's transports raise for an address, or an answer, that is not a scheduler's.
NO_SCHEDULER = (
    OSError, ValueError, TypeError, RuntimeError, LookupError, EOFError, ImportError, MemoryError
)  # fmt: skip


def do(recipe: Recipe, path: str, chunk: Chunk) -> Outcome:
    """Compute a chunk and write it, unless it is there and sound; in any process.

    Returns:
        "computed", or "kept" if it was there.

    Raises:
        StoreError: The store cannot be read or written, or the study not be made here.
    """
    store = _store(recipe, path)
    if store.is_done(chunk):
        return "kept"
    store.write(chunk, store.study.compute(chunk))
    return "computed"


def read_back(recipe: Recipe, path: str, chunk: Chunk) -> Outcome:
    """Read a chunk from the store; in any process.

    Returns:
        "kept", or "lost" if it is not there, or differs from its checksum.

    Raises:
        StoreError: The store cannot be read.
    """
    return "kept" if _store(recipe, path).is_done(chunk) else "lost"


@lru_cache(maxsize=4)
def _store(recipe: Recipe, path: str) -> Store:
    try:
        study = remade(recipe)
    except SpaceArmError as error:  # it could be made where the sweep began
        raise StoreError(f"a worker cannot make the study: {error}") from None
    return Store(path, study)


class Processes:
    """Worker processes on this machine; one that dies is replaced, and its chunk tried again.

    Attributes:
        width: Chunks to have under way so that no worker waits.
        final: Errors after which a chunk is not tried again.
        lost: Whether the workers are gone for good.
    """

    final: tuple[type[BaseException], ...] = ()
    lost = False

    def __init__(self, workers: int, recipe: Recipe, path: str) -> None:
        self.width = 2 * workers
        self._recipe, self._path = recipe, path
        self._threads = Threads(workers)  # each speaks with a process of its own
        self._mine = threading.local()
        self._lock = threading.Lock()
        self._all: set[Process] = set()
        self._closed = False

    def submit(self, work: Work, chunk: Chunk) -> Future[Outcome]:
        """Have a chunk done, or read back, by the next free process."""
        return self._threads.submit(self._call, work, chunk)

    def close(self) -> None:
        """End all processes at once; their chunks are not marked as done."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        with self._lock:
            self._closed = True
            for process in self._all:
                process.kill()
        self._threads.shutdown()
        for process in self._all:
            process.end()

    def _call(self, work: Work, chunk: Chunk) -> Outcome:
        process: Process | None = getattr(self._mine, "process", None)
        if process is None:
            with self._lock:
                if self._closed:
                    raise WorkerLostError("the sweep is over")
                process = self._mine.process = Process()
                self._all.add(process)
        try:
            return process.call(partial(work, self._recipe, self._path, chunk))
        except WorkerLostError:
            self._mine.process = None
            with self._lock:
                self._all.discard(process)
            raise


class Cluster:
    """The workers of a Dask cluster, which the user starts and ends; attributes as `Processes`."""

    width = WIDTH

    def __init__(self, client: Client, recipe: Recipe, path: str) -> None:
        from distributed import KilledWorker

        self.final: tuple[type[BaseException], ...] = (
            KilledWorker,
        )  # Dask has tried several workers
        self._client = client
        self._executor = client.get_executor(pure=False)
        self._recipe, self._path = recipe, path

    @property
    def lost(self) -> bool:
        """Whether the scheduler is gone, or silent for a minute."""
        scheduler = self._client.scheduler
        if self._client.status != "running" or scheduler is None:
            return True
        try:
            self._client.sync(scheduler.identity, callback_timeout=SILENCE)
        except OSError:
            return True
        return False

    def submit(self, work: Work, chunk: Chunk) -> Future[Outcome]:
        """Have a chunk done, or read back; Dask moves it to another worker if its own dies."""
        return self._executor.submit(work, self._recipe, self._path, chunk)

    def close(self) -> None:
        """Cancel the chunks that have not begun."""
        self._executor.shutdown(wait=False)


def connect(address: str) -> Client:
    """Connect to the scheduler at an address such as tcp://127.0.0.1:8786.

    Raises:
        UnsupportedError: Dask is not installed.
        StoreError: No scheduler answers there.
    """
    library = imported("distributed", "Dask", "cluster")
    try:
        asyncio.run(_greet(address))  # a Client that fails while it is made cannot be closed
        return library.Client(address, timeout=ANSWERED, set_as_default=False)
    except NO_SCHEDULER as error:
        raise StoreError(
            f"no Dask scheduler at {address!r} ({str(error) or 'no answer'}); start one: "
            "dask scheduler --host 127.0.0.1 --dashboard-address 127.0.0.1:8787"
        ) from None


async def _greet(address: str) -> None:
    """Ask a scheduler who it is: something else may listen there, and never answer."""
    from distributed import Security
    from distributed.core import rpc

    options = Security().get_connection_args("client")
    async with rpc(address, timeout=ANSWERED, connection_args=options) as scheduler:
        await asyncio.wait_for(scheduler.identity(), ANSWERED)


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

    It may be stopped or killed at any time, and so may each of its workers. Run again, it continues
    where it was, and the numbers are the same to the bit (on processors of one kind). A chunk that
    fails is tried again, then recorded with its error, and the rest goes on. At the end the whole
    store is read back: if the function returns, all chunks are in it, as their checksums say.

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
        Its attributes hold version, models, study and seed. Numbers not computed are NaN.

    Raises:
        ConfigurationError: The study makes no sense.
        ModelError: An arm or a design of it is unsound.
        StoreError: The store is that of another study, cannot be written, was removed, moved or
            lost files while the sweep ran, or the cluster is lost.
        UnsupportedError: Zarr is not installed: pip install 'spacearm[sweep]'.
        SweepError: All chunks were tried, but some failed.

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
        array([37., 22.])
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
    failed: dict[Chunk, str] = {}
    try:
        with closing(_workers(study, target, client, workers)) as pool:
            for chunk, outcome in _outcomes(do, study.chunks(), pool, target):
                if isinstance(outcome, str):
                    counts[outcome] += 1
                else:
                    failed[chunk] = f"{type(outcome).__name__}: {outcome}"[:SHOWN]
                    target.record_failure(chunk, failed[chunk])
                yield Tally(counts["kept"], counts["computed"], len(failed), study.total)
            check_content(study, target, pool, failed)
    finally:
        target.remove_leftovers()
    if not failed:
        target.tidy()
        return
    errors = {f"{chunk.quantity} {chunk.number}": text for chunk, text in failed.items()}
    (name, error), *others = errors.items()
    raise SweepError(
        f"{len(failed)} of {study.total} chunk{'s' * (study.total != 1)} failed "
        f"{ATTEMPTS} times each, the others are in {store}: {name}: {error}"
        + (f" (and {len(others)} more)" if others else ""),
        errors,
    )


def check_content(
    study: Study, store: Store, pool: Processes | Cluster, failed: Collection[Chunk]
) -> None:
    """Read the whole store back: each chunk must be there, as its checksum says.

    Args:
        study: The study.
        store: Its store, in which all chunks were found or written.
        pool: The workers, which read.
        failed: Chunks that are marked as failed.

    Raises:
        StoreError: The store was removed, moved, or lost files while the sweep ran.
    """
    store.check_there()
    Store(store.path, study)  # labels and descriptions
    lost = [chunk for chunk in failed if not store.has_failed(chunk)]
    done = (chunk for chunk in study.chunks() if chunk not in failed)
    for chunk, outcome in _outcomes(read_back, done, pool, store):
        if outcome != "kept":
            lost.append(chunk)
    if lost:
        names = listed([f"{chunk.quantity} {chunk.number}" for chunk in lost])
        raise StoreError(
            f"store {store.path}: {len(lost)} of {study.total} chunks were done and are missing or "
            f"damaged now ({names}): their files were removed or changed while the sweep ran; run "
            "the same command again to compute them again"
        )


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
    workers = processors() if workers is None else whole(workers, "workers", 1, MOST_THREADS)
    return Processes(workers, study.recipe, path)


def _outcomes(
    work: Work, chunks: Iterator[Chunk], workers: Processes | Cluster, store: Store
) -> Iterator[tuple[Chunk, Outcome | BaseException]]:
    """Have all chunks done or read back; yield each with its outcome or its last error.

    Raises:
        StoreError: The store is gone or cannot be used, or the cluster is lost.
    """
    finished: queue.SimpleQueue[Future[Outcome]] = queue.SimpleQueue()
    running: dict[Future[Outcome], Chunk] = {}
    attempts: Counter[Chunk] = Counter()

    def start(chunk: Chunk) -> None:
        future = workers.submit(work, chunk)
        running[future] = chunk
        future.add_done_callback(finished.put)

    for chunk in itertools.islice(chunks, workers.width):
        start(chunk)
    while running:
        future = None
        with suppress(queue.Empty):
            future = finished.get(timeout=PATIENCE)
        store.check_there()
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
