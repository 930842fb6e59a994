"""Attempts: made one after the other until one gives a plan, with an account of those that fail."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from spacearm.errors import NoSolutionError
from spacearm.planning.account import SearchAccount, TimeUpError
from spacearm.planning.result import Attempt

T = TypeVar("T")


class Attempts:
    """Attempts at a plan.

    Attributes:
        account: The time that they may take, and what stops it.
        method: The method of the one under way.
        failed: Those that have failed, in order.
        best: What the last of them had to show; None if nothing.

    Args:
        account: The time that they may take.
    """

    def __init__(self, account: SearchAccount) -> None:
        self.account, self.method = account, ""
        self.best: object = None
        self.failed: list[Attempt] = []
        self._last = ""

    def each(self, ways: Iterable[T]) -> Iterator[T]:
        """Yield ways to a plan until the time is up, or Ctrl-C is pressed."""
        for way in ways:
            yield way
            if self._last:
                return

    @contextmanager
    def at(self, method: str) -> Iterator[None]:
        """Make an attempt; its failure, the end of the time and Ctrl-C are kept."""
        self.method = method
        try:
            yield
        except TimeUpError as error:
            self._last = str(error)
        except KeyboardInterrupt as stop:
            self.account.end()
            self.best = getattr(stop, "best", None) or self.best
            self._last = "stopped by Ctrl-C"
        except NoSolutionError as error:
            self.best = error.best or self.best
            self.failed.append(Attempt(self.method, False, str(error)))

    @property
    def stories(self) -> tuple[Attempt, ...]:
        """The last failure of each method, and what ended the last attempt."""
        told = {attempt.method: attempt for attempt in self.failed}
        if self._last and (self.account.ended or self.method not in told):
            told[self.method] = Attempt(self.method, False, self._last)
        return tuple(told.values())

    @property
    def told(self) -> str:
        """The same in words."""
        return "; ".join(f"{method}: {why}" for method, _, why in self.stories)
