"""Worker processes of this machine, which call functions of this package.

A process gets a function with its arguments, and answers with reports of progress and, at the
end, the result or the error, in pickles between this package's own processes. It is then told the
next one. It ends at once when its input does, as when the main program is killed. Nothing of the
main program runs in it, and nothing in the current folder is imported.

`concurrent.futures.ProcessPoolExecutor` is not used: it cannot end a call that is under way, and
when one of its workers is killed, for lack of memory for example, all calls are lost.
"""

from __future__ import annotations

import os
import pickle
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, BinaryIO, NoReturn, TypeVar

from spacearm.errors import SpaceArmError

T = TypeVar("T")
Progress = Callable[[float, float], object]

COMMAND = (
    sys.executable,
    "-c",
    "import sys; sys.path[:] = filter(None, sys.path); "  # as -P from Python 3.11 on
    "from spacearm.processes import serve; serve()",
)
#: Each process computes on one core: there may be as many processes as cores.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
#: Least time between two reports of progress [s].
PACE = 0.1


class WorkerError(Exception):
    """A call failed in its process, by no error of spacearm; the text is the error there."""


class WorkerLostError(WorkerError):
    """The process ended before it answered; the text says how."""


class Process:
    """A worker process, seen from the main one.

    Attributes:
        pid: Its number.
    """

    def __init__(self) -> None:
        path = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        self._popen = subprocess.Popen(
            COMMAND,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is for the main process, which ends this one
            env={**os.environ, **ONE_THREAD, **path},
        )
        self.pid = self._popen.pid

    def call(self, function: Callable[..., T], progress: Progress | None = None) -> T:
        """Call a function in the process, and wait for its result.

        Args:
            function: The function with its arguments, such as `partial(risk_profile, arm)`.
            progress: Called as progress(done, total), at most every `PACE`. If it is given, the
                function takes a parameter `progress`.

        Raises:
            SpaceArmError: The function raised it.
            WorkerError: The function raised another error, or cannot be sent.
            WorkerLostError: The process ended. It is of no more use.
        """
        try:
            request = pickle.dumps((function, progress is not None))
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise WorkerError(f"it cannot be sent to another process: {error}") from error
        kind, *content = self._exchanged(request)
        while kind == "progress" and progress:
            progress(*content)
            kind, *content = self._exchanged(None)
        if kind == "failed":
            raise content[0]
        return content[0]

    def kill(self) -> None:
        """Kill the process; a call that is under way raises `WorkerLostError`."""
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

    def _exchanged(self, request: bytes | None) -> Any:
        """Send a request, if there is one, and return the next answer."""
        with suppress(OSError, EOFError, pickle.UnpicklingError):
            if self._popen.stdin and self._popen.stdout:
                if request:
                    pickle.dump(request, self._popen.stdin)
                    self._popen.stdin.flush()
                return pickle.load(self._popen.stdout)
        raise WorkerLostError(f"its worker process was ended by {self.end()}")


def call_within(seconds: float, memory: float, function: Callable[[], T]) -> T:
    """Call a function in a process of its own that ends when it takes too much.

    Args:
        seconds: The time that it may take, that of starting the process included [s].
        memory: The memory that it may take [bytes]; where the system sets no such limit, any.
        function: The function with its arguments.

    Raises:
        SpaceArmError: The function raised it.
        WorkerError: It took too much, or failed otherwise; the text says how.
    """
    process = Process()
    clock = threading.Timer(seconds, process.kill)
    clock.start()
    try:
        return process.call(partial(_limited, memory, function))
    except WorkerLostError as error:
        late = "it took longer" if clock.finished.is_set() else str(error)
        raise WorkerError(late) from None
    finally:
        clock.cancel()
        process.end()


# --- in the worker process ----------------------------------------------------------------------


def _limited(memory: float, function: Callable[[], T]) -> T:
    """Call a function with a limit of memory [bytes]."""
    with suppress(ImportError):  # Windows has no such limits
        import resource

        _, most = resource.getrlimit(resource.RLIMIT_AS)
        whole = int(memory) if most == resource.RLIM_INFINITY else min(int(memory), most)
        resource.setrlimit(resource.RLIMIT_AS, (whole, most))
    return function()


def serve() -> NoReturn:
    """Answer requests until the input ends."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what is printed must not look like answers
    requests: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(requests,), daemon=True).start()
    while True:
        try:
            answer(requests.get(), answers)
        except BrokenPipeError:  # the main process was killed
            os._exit(1)


def _receive(requests: queue.SimpleQueue[bytes]) -> None:
    with suppress(EOFError, pickle.UnpicklingError):
        while True:
            requests.put(pickle.load(sys.stdin.buffer))
    os._exit(1)


def answer(request: bytes, answers: BinaryIO) -> None:
    """Call the function of a request; write progress and the result or the error."""
    last = 0.0

    def tell(message: bytes) -> None:
        answers.write(message)
        answers.flush()

    def progress(done: float, total: float) -> None:
        nonlocal last
        if time.monotonic() - last >= PACE:
            last = time.monotonic()
            tell(pickle.dumps(("progress", float(done), float(total))))

    try:
        function, reports = pickle.loads(request)
        result = function(progress=progress) if reports else function()
        message = pickle.dumps(("done", result))
    except SpaceArmError as error:
        message = pickle.dumps(("failed", error))
    except Exception as error:  # whatever it is, the main process decides
        message = pickle.dumps(("failed", WorkerError(f"{type(error).__name__}: {error}")))
    tell(message)
