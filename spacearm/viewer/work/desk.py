"""Desk: the one task of a page that is under way, and what came of the last one."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from spacearm.errors import ConfigurationError
from spacearm.viewer.work.task import Task

WORDS = {
    "plan": "planning",
    "shells": "computing workspaces",
    "risk": "computing the risk",
    "attitudes": "trying attitudes",
}


class Desk:
    """Gives jobs to worker processes, one at a time.

    Attributes:
        failure: Name of the last job and why it failed; None if it did not.

    Args:
        lock: The lock of what is on show; the methods are called by those who hold it.
        changed: Called when there is progress, in another thread.
        finished: Called with the name of a job and its result, likewise, with the lock held.
    """

    def __init__(
        self,
        lock: AbstractContextManager[object],
        changed: Callable[[], object],
        finished: Callable[[str, Any], object],
    ) -> None:
        self._lock, self._changed, self._finished = lock, changed, finished
        self._task: Task | None = None
        self.failure: tuple[str, str] | None = None

    def start(self, name: str, given: tuple[Any, ...], owner: object) -> None:
        """Start a job.

        Args:
            name: Its name.
            given: Its arguments.
            owner: Who asks for it.

        Raises:
            ConfigurationError: Another one is under way.
        """
        if self._task:
            raise ConfigurationError(f"{WORDS[self._task.name]} is under way; cancel it first")
        self.failure = None
        self._task = Task(name, given, owner, self._told, self._ended)

    def cancel(self) -> None:
        """End the job that is under way, if there is one."""
        task, self._task = self._task, None
        if task:
            task.cancel()

    def left(self, owner: object) -> None:
        """End the job of one who has gone."""
        if self._task and self._task.owner is owner:
            self.cancel()

    def readout(self) -> dict[str, Any]:
        """Return what the page shows of the job that is under way, and why the last one failed."""
        task = self._task
        told = None if task is None else [task.name, WORDS[task.name], task.done, task.total]
        return {"task": told, "failure": self.failure}

    def _told(self, task: Task) -> None:
        if task is self._task:
            self._changed()

    def _ended(self, task: Task, kind: str, answer: Any) -> None:
        with self._lock:
            if task is not self._task:
                return
            self._task = None
            if kind == "done":
                self._finished(task.name, answer)
            else:
                self.failure = (task.name, str(answer))
        self._changed()
