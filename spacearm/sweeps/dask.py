"""Chunks computed by the workers of a Dask cluster, which the user starts and ends."""

from __future__ import annotations

import asyncio
from concurrent.futures import Future
from typing import TYPE_CHECKING

from spacearm.errors import StoreError, UnsupportedError
from spacearm.sweeps.study import Chunk, Recipe
from spacearm.sweeps.worker import do

if TYPE_CHECKING:
    from distributed import Client

WIDTH = 2000
"""Chunks that the scheduler holds at a time: enough for a thousand cores."""
PATIENCE = 5
"""Time that a scheduler may take to answer when it is first asked [s]."""
SILENCE = 60
"""Time after which a scheduler that does not answer in the midst of work is lost [s]."""


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
    except Exception as error:  # whatever a transport makes of an address
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


class Cluster:
    """The workers of a Dask cluster.

    Attributes:
        width: Chunks to have under way so that no worker waits.
        final: Errors after which a chunk is not tried again: Dask has tried several workers.
    """

    def __init__(self, client: Client, recipe: Recipe, path: str) -> None:
        from distributed import KilledWorker

        self.width = WIDTH
        self.final: tuple[type[BaseException], ...] = (KilledWorker,)
        self._client = client
        self._executor = client.get_executor(pure=False)
        self._order = (recipe, path)

    @property
    def lost(self) -> bool:
        """Whether the scheduler is lost: gone, or silent for a minute."""
        scheduler = self._client.scheduler
        if self._client.status != "running" or scheduler is None:
            return True
        try:
            self._client.sync(scheduler.identity, callback_timeout=SILENCE)
        except (OSError, asyncio.TimeoutError):  # TimeoutError itself from Python 3.11 on
            return True
        return False

    def submit(self, chunk: Chunk) -> Future[str]:
        """Have a chunk done; Dask moves it to another worker if its own dies."""
        return self._executor.submit(do, *self._order, chunk)

    def close(self) -> None:
        """Cancel the chunks that have not begun."""
        self._executor.shutdown(wait=False)
