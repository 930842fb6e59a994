"""Worker processes of this machine, which are told in lines of JSON what to do.

The study and the store go to a process when it starts, then chunks, one a line; it answers each
with a line. It ends when its input does, so that none outlives the main process by more than the
chunk at hand. Nothing of the main program runs in it.

`concurrent.futures.ProcessPoolExecutor` is not used: when one of its workers is killed, for lack of
memory for example, the whole pool is broken and all chunks under way are lost. Here the process is
replaced and its chunk tried again.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from typing import TextIO

from spacearm.errors import StoreError
from spacearm.sweeps.study import Chunk, Recipe
from spacearm.sweeps.worker import do

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Each process computes on one core: there are as many processes as cores."""


def command(module: str) -> list[str]:
    """Return the command that runs a module of this program, whatever the current folder holds."""
    safe = "import sys; sys.path[:] = filter(None, sys.path)"  # as -P from Python 3.11 on
    run = f"import runpy; runpy.run_module({module!r}, run_name='__main__')"
    return [sys.executable, "-c", f"{safe}; {run}"]


class ChunkError(Exception):
    """A chunk failed in its process; the text is the error there."""


class Processes:
    """Worker processes of one sweep on this machine.

    Attributes:
        width: Chunks to have under way so that none of them waits.
        lost: False: a process that dies is replaced.
        final: None: every error is worth another try.
    """

    lost = False
    final: tuple[type[BaseException], ...] = ()

    def __init__(self, workers: int, recipe: Recipe, path: str) -> None:
        self.width = 2 * workers
        self._order = (recipe, path)
        self._threads = ThreadPoolExecutor(workers)  # each speaks with a process of its own
        self._mine = threading.local()
        self._lock = threading.Lock()
        self._all: set[Process] = set()
        self._closed = False

    def submit(self, chunk: Chunk) -> Future[str]:
        """Have a chunk done by the next free process."""
        return self._threads.submit(self._do, chunk)

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

    def _do(self, chunk: Chunk) -> str:
        process: Process | None = getattr(self._mine, "process", None)
        if process is None:
            with self._lock:
                if self._closed:
                    raise ChunkError("the sweep is over")
                process = self._mine.process = Process(*self._order)
                self._all.add(process)
        answer = process.ask(chunk)
        if answer is None:
            self._mine.process = None
            with self._lock:
                self._all.discard(process)
            raise ChunkError(f"its worker process was ended by {process.end()}")
        if "store" in answer:
            raise StoreError(answer["store"])
        if "error" in answer:
            raise ChunkError(answer["error"])
        return answer["done"]


class Process:
    """One worker process, seen from the main one."""

    def __init__(self, recipe: Recipe, path: str) -> None:
        self._popen = subprocess.Popen(
            command("spacearm.sweeps.processes"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            start_new_session=True,  # Ctrl-C is for the main process, which ends this one
            env={**os.environ, **ONE_THREAD, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        self.pid = self._popen.pid
        self._order: tuple[Recipe, str] | None = (recipe, path)

    def ask(self, chunk: Chunk) -> dict[str, str] | None:
        """Send a chunk and return the answer; None if the process has ended."""
        if self._popen.stdin is None or self._popen.stdout is None:
            return None
        messages = [self._order, chunk] if self._order else [chunk]
        self._order = None
        try:
            self._popen.stdin.write("".join(json.dumps(message) + "\n" for message in messages))
            self._popen.stdin.flush()
            line = self._popen.stdout.readline()
        except OSError:
            return None
        return json.loads(line) if line.endswith("\n") else None

    def kill(self) -> None:
        """Kill the process."""
        self._popen.kill()

    def end(self) -> str:
        """Kill the process if it still runs, and return how it ended."""
        self._popen.kill()
        code = self._popen.wait()
        for pipe in (self._popen.stdin, self._popen.stdout):
            if pipe:
                with suppress(OSError):  # what was written to a process that had ended
                    pipe.close()
        return f"signal {-code}" if code < 0 else f"exit code {code}"


def serve(requests: TextIO, answers: TextIO) -> None:
    """Compute chunks in a worker process until its input ends."""
    recipe, path = json.loads(requests.readline())
    answer: dict[str, str]
    for line in requests:
        try:
            answer = {"done": do(Recipe(*recipe), path, Chunk(*json.loads(line)))}
        except StoreError as error:
            answer = {"store": str(error)}
        except Exception as error:  # whatever it is, it is recorded and the rest goes on
            answer = {"error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    to_main = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what is printed must not look like answers
    try:
        serve(sys.stdin, to_main)
    except BrokenPipeError:  # the main process was killed
        os._exit(1)
