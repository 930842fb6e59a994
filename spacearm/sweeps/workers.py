"""Workers that compute the chunks of a sweep: processes of this machine, or a Dask cluster."""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Literal

from spacearm.errors import SpaceArmError, StoreError, UnsupportedError
from spacearm.processes import Process, WorkerLostError
from spacearm.sweeps.store import Store
from spacearm.sweeps.study import Chunk, Recipe, remade

if TYPE_CHECKING:
    from distributed import Client

Outcome = Literal["kept", "computed"]
#: Chunks that the scheduler holds at a time: enough for a thousand cores.
WIDTH = 2000
#: Time that a scheduler may take to answer when it is first asked [s].
PATIENCE = 5
#: Time after which a scheduler that does not answer in the midst of work is lost [s].
SILENCE = 60
#: What Dask's transports raise for an address, or an answer, that is no scheduler's.
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
        self._do = partial(do, recipe, path)
        self._threads = ThreadPoolExecutor(workers)  # each speaks with a process of its own
        self._mine = threading.local()
        self._lock = threading.Lock()
        self._all: set[Process] = set()
        self._closed = False

    def submit(self, chunk: Chunk) -> Future[Outcome]:
        """Have a chunk done by the next free process."""
        return self._threads.submit(self._call, chunk)

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

    def _call(self, chunk: Chunk) -> Outcome:
        process: Process | None = getattr(self._mine, "process", None)
        if process is None:
            with self._lock:
                if self._closed:
                    raise WorkerLostError("the sweep is over")
                process = self._mine.process = Process()
                self._all.add(process)
        try:
            return process.call(partial(self._do, chunk))
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
        self._do = partial(do, recipe, path)

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

    def submit(self, chunk: Chunk) -> Future[Outcome]:
        """Have a chunk done; Dask moves it to another worker if its own dies."""
        return self._executor.submit(self._do, chunk)

    def close(self) -> None:
        """Cancel the chunks that have not begun."""
        self._executor.shutdown(wait=False)


def connect(address: str) -> Client:
    """Connect to the scheduler at an address such as tcp://127.0.0.1:8786.

    Raises:
        UnsupportedError: Dask is not installed.
        StoreError: No scheduler answers there.
    """
    try:
        from distributed import Client
    except ImportError:
        raise UnsupportedError("Dask is not installed: pip install 'spacearm[cluster]'") from None
    try:
        asyncio.run(_greet(address))  # a Client that fails while it is made cannot be closed
        return Client(address, timeout=PATIENCE, set_as_default=False)
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
    async with rpc(address, timeout=PATIENCE, connection_args=options) as scheduler:
        await asyncio.wait_for(scheduler.identity(), PATIENCE)
