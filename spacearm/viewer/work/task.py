"""Task: one job in a worker process, seen from the main one."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from spacearm.sweeps.processes import command


class Task:
    """A job that is under way in a process of its own.

    Attributes:
        name: Name of the job.
        owner: Who asked for it.
        done: How much of it is done.
        total: Of how much; zero as long as that is not known.

    Args:
        name: Name of the job, one of `jobs.JOBS`.
        given: Its arguments.
        owner: Who asks for it.
        told: Called with the task after each report of progress, in another thread.
        ended: Called at its end with the task, "done" or "failed", and the result or why, likewise.
    """

    def __init__(
        self,
        name: str,
        given: tuple[Any, ...],
        owner: object,
        told: Callable[[Task], None],
        ended: Callable[[Task, str, Any], None],
    ) -> None:
        self.name, self.owner = name, owner
        self.done = self.total = 0.0
        self._told, self._ended = told, ended
        self._process = subprocess.Popen(
            command("spacearm.viewer.work.worker"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is for the main process, which ends this one
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        self.pid = self._process.pid
        threading.Thread(target=self._follow, args=((name, given),), daemon=True).start()

    def cancel(self) -> None:
        """End the process at once."""
        self._process.kill()

    def _follow(self, order: tuple[str, tuple[Any, ...]]) -> None:
        kind, answer = "failed", None
        with self._process as process, suppress(EOFError, OSError, pickle.PickleError):
            if process.stdin is None or process.stdout is None:
                return
            pickle.dump(order, process.stdin)
            process.stdin.flush()
            while True:
                kind, *rest = pickle.load(process.stdout)
                if kind != "progress":
                    (answer,) = rest
                    break
                self.done, self.total = rest
                self._told(self)
        if kind == "progress" or answer is None:
            code = self._process.returncode
            kind, answer = "failed", f"the process that computed it ended with code {code}"
        self._ended(self, kind, answer)
