"""Worker: the process that does one job, `python -m spacearm.viewer.work.worker`.

It is told the job by its input and answers by its output, in pickles between this program's own
processes: ("progress", done, total) now and then, and at the end ("done", result) or
("failed", why). It ends at once when its input does, as when the main program is killed.
"""

from __future__ import annotations

import os
import pickle
import sys
import threading
import time
from typing import Any, BinaryIO

from spacearm.errors import SpaceArmError

PACE = 0.1
"""Least time between two reports of progress [s]."""
NICE = 5


def work(name: str, given: tuple[Any, ...], answers: BinaryIO) -> None:
    """Do a job, and answer."""
    last = 0.0

    def tell(*answer: Any) -> None:
        pickle.dump(answer, answers)
        answers.flush()

    def progress(done: float, total: float) -> None:
        nonlocal last
        if time.monotonic() - last >= PACE:
            last = time.monotonic()
            tell("progress", float(done), float(total))

    from spacearm.viewer.work.jobs import JOBS  # slow to import

    try:
        result = JOBS[name](*given, progress)
    except SpaceArmError as error:
        tell("failed", str(error))
    except Exception as error:  # whatever it is, the page says so and goes on
        tell("failed", f"{type(error).__name__}: {error}")
    else:
        tell("done", result)


def _watch() -> None:
    os.read(sys.stdin.fileno(), 1)  # nothing more comes: this is the end of the input
    os._exit(1)


if __name__ == "__main__":
    os.nice(NICE)  # the page comes first
    to_main = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what is printed must not look like answers
    job, arguments = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_watch, daemon=True).start()
    try:
        work(job, arguments, to_main)
    except BrokenPipeError:
        os._exit(1)
