"""Memory that is free for this process, and worker processes that call functions of this package.

A computation whose arrays grow with its arguments asks `check_memory` before it allocates them. A
reader whose memory is not bounded by the size of its file runs in a worker process that may take
`memory_limit()`, see `call_within`.

A worker process gets a function with its arguments, and answers with reports of progress and, at
the end, the result or the error, in pickles between this package's own processes. It is then told
the next one. It ends at once when its input does, as when the main program is killed. Nothing of
the main program runs in it, and nothing in the current folder is imported.

`concurrent.futures.ProcessPoolExecutor` is not used: it cannot end a call that is under way, and
when one of its workers is killed, for lack of memory for example, all calls are lost.
"""

from __future__ import annotations

import math
import os
import pickle
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NoReturn, ParamSpec, TypeVar

from spacearm.errors import ConfigurationError, ResourceError, SpaceArmError

P = ParamSpec("P")
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
#: What is said where the system starts no thread.
NO_THREAD = (
    "a thread cannot be started: the system's limit of processes or of memory is reached; raise it "
    "(ulimit -u, ulimit -v), or end other programs"
)
#: Least time between two reports of progress [s].
PACE = 0.1
#: Memory that reading one file may take if `VARIABLE` is not set [bytes].
LIMIT = 1e9
#: Environment variable that sets this limit [GB].
VARIABLE = "SPACEARM_MEMORY"
#: Fraction of the free memory that one computation may allocate.
USABLE = 0.8
#: Memory that is left to other computations without a check [bytes].
NEGLIGIBLE = 5e7

PROC = Path("/proc")
CGROUPS = Path("/sys/fs/cgroup")
#: Files of a control group that hold its limit and its use [bytes], of versions 2 and 1.
CGROUP_FILES = (
    ("memory.max", "memory.current"),
    ("memory.limit_in_bytes", "memory.usage_in_bytes"),
)


# --- memory --------------------------------------------------------------------------------------


def memory_limit() -> float:
    """Return the memory that reading one file may take [bytes].

    Raises:
        ConfigurationError: The environment variable is not a positive number.
    """
    text = os.environ.get(VARIABLE, "")
    if not text.strip():
        return LIMIT
    with suppress(ValueError):
        gigabytes = float(text)
        if 0.0 < gigabytes < math.inf:
            return gigabytes * 1e9
    raise ConfigurationError(
        f"the environment variable {VARIABLE} is {text[:60]!r}; set it to a positive number of GB, "
        f"such as {VARIABLE}=4"
    )


def free_memory() -> float:
    """Return the memory that this process can still allocate [bytes].

    It is the least of what the machine has available, what the control groups of the process leave
    (containers) and what its limit of address space leaves; infinite where none of them is known.
    """
    return min(_of_machine(), _of_cgroups(), _of_address_space())


def check_memory(need: float, what: str, remedy: str) -> None:
    """Refuse a computation that needs more memory than is free, before it is allocated.

    Args:
        need: Memory that it needs [bytes].
        what: The computation, subject of the message.
        remedy: What to change so that it needs less.

    Raises:
        SpaceArmError: It needs more than `USABLE` of what is free.
    """
    if need <= NEGLIGIBLE:
        return
    usable = USABLE * free_memory()
    if need > usable:
        raise SpaceArmError(
            f"{what} needs {need / 1e9:.3g} GB of memory, and {usable / 1e9:.3g} GB can be used; "
            f"{remedy}"
        )


def _of_machine() -> float:
    """Return the memory that the machine has available [bytes]; infinite if it is not known."""
    with suppress(OSError, ValueError, IndexError):
        return 1024.0 * _field(PROC / "meminfo", "MemAvailable")
    with suppress(OSError, ValueError, AttributeError):  # macOS states only what is installed
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    return math.inf


def _of_cgroups() -> float:
    """Return what the control groups of this process leave [bytes]; infinite without a limit."""
    left = math.inf
    with suppress(OSError):
        for line in (PROC / "self/cgroup").read_text(encoding="utf-8").splitlines():
            _, controllers, path = line.split(":", 2)
            if controllers and "memory" not in controllers.split(","):
                continue
            root = CGROUPS / ("memory" if controllers else "")
            group = root / path.strip("/")
            # in a container the path may be that of the host: then the root is the group
            for folder in (group, *group.parents):
                if folder == root or root in folder.parents:
                    left = min(left, _of_cgroup(folder))
    return left


def _of_cgroup(folder: Path) -> float:
    """Return what one control group leaves [bytes]; infinite without a limit."""
    for largest, used in CGROUP_FILES:
        with suppress(OSError, ValueError):
            bound = float((folder / largest).read_text(encoding="ascii"))
            taken = float((folder / used).read_text(encoding="ascii"))
            cached = 0.0  # files in memory that the system gives up when memory is needed
            with suppress(OSError, ValueError, IndexError):
                cached = _field(folder / "memory.stat", "inactive_file")
            return max(bound - taken + cached, 0.0)
    return math.inf


def address_space() -> float:
    """Return the address space that this process uses [bytes]; 0 if it is not known."""
    with suppress(OSError, ValueError, IndexError):
        return 1024.0 * _field(PROC / "self/status", "VmSize")
    return 0.0


def _of_address_space() -> float:
    """Return what the limit of address space leaves [bytes]; infinite without a limit."""
    with suppress(ImportError):  # Windows has no such limit
        import resource

        largest, _ = resource.getrlimit(resource.RLIMIT_AS)
        if largest != resource.RLIM_INFINITY:
            return max(largest - address_space(), 0.0)
    return math.inf


def _field(file: Path, name: str) -> float:
    """Return the number behind a name at the beginning of a line of a file."""
    lines = file.read_text(encoding="ascii").splitlines()
    words = next((line.replace(":", " ").split() for line in lines if line.startswith(name)), [])
    return float(words[1])


# --- worker processes ----------------------------------------------------------------------------


class Threads(ThreadPoolExecutor):
    """A pool of threads that says so where the system starts none."""

    def submit(self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Call a function in a thread.

        Raises:
            ResourceError: The thread cannot be started.
        """
        try:
            return super().submit(function, *args, **kwargs)
        except RuntimeError as error:
            if "new thread" not in str(error):
                raise
            raise ResourceError(NO_THREAD) from None


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
        memory: The memory that it may take beyond that of the process when the call begins
            [bytes]; where the system sets no such limit, any.
        function: The function with its arguments.

    Raises:
        SpaceArmError: The function raised it.
        WorkerError: It took too much, or failed otherwise; the text says how.
    """
    process = Process()
    clock = threading.Timer(seconds, process.kill)
    try:
        clock.start()
        return process.call(partial(_limited, memory, function))
    except WorkerLostError as error:
        late = "it took longer" if clock.finished.is_set() else str(error)
        raise WorkerError(late) from None
    except RuntimeError as error:
        if "new thread" not in str(error):
            raise
        raise ResourceError(NO_THREAD) from None
    finally:
        clock.cancel()
        process.end()


# --- in the worker process ----------------------------------------------------------------------


def _limited(memory: float, function: Callable[[], T]) -> T:
    """Call a function with a limit of the memory [bytes] that it takes."""
    with suppress(ImportError, ValueError):  # Windows has no such limit, macOS may refuse it
        import resource

        _, most = resource.getrlimit(resource.RLIMIT_AS)
        whole = int(address_space() + memory)
        whole = whole if most == resource.RLIM_INFINITY else min(whole, most)
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
