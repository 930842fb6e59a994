"""Account: the time that a search may take, the attempts that it makes, and what stops them.

A search that fails says which constraint stopped most of its attempts and what to relax.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeAlias, TypeVar

from spacearm.errors import NoSolutionError, StoppedError
from spacearm.planning.result import Attempt

T = TypeVar("T")
#: Called now and then as progress(done, total); of a search both are times [s].
Progress: TypeAlias = Callable[[float, float], object]

#: What joint positions at the goal are, by the word of the account.
POSTURES = {
    "reached": "bring the tip there",
    "limits": "lie beyond the joint limits",
    "side": "lie on the other side of the singular set",
    "near": "lie nearer to the singular set than the clearance",
    "contact": "are in collision",
}
#: What stops curves to the goal, likewise.
WAYS = {
    "landing": "do not arrive",
    "limits": "leave the joint limits",
    "singular": "meet a singularity or come too near to one",
    "contact": "are in collision",
    "turn": "turn the spacecraft too far",
}
#: What to relax.
REMEDIES = {
    "reached": "take a goal nearer to the system CM, a task with fewer rows, or leave "
    "final_attitude open",
    "limits": "limits=False ignores the joint limits",
    "side": "start on the other side (another elbow or wrist) or give other joints at the goal",
    "near": "ask for a smaller clearance",
    "singular": "ask for a smaller clearance, or go by way of a posture in between (sa.Joints)",
    "contact": "move the obstacles, lower their margins, or plan without them: collisions=False",
    "turn": "allow a larger turn, or let more joints count (joints='all')",
    "landing": "give a longer timeout, another seed, or a posture in between (sa.Joints)",
}
#: Shortest time that a part of a search is given [s].
SHORTEST = 1e-6


class TimeUpError(Exception):
    """The time for the search is up; the strategy that searches ends with its best attempt."""


class SearchAccount:
    """The time of a search and its account.

    Attributes:
        postures: How many joint positions at the goal were found, by the words of `POSTURES`.
        ways: How many curves were stopped, by the words of `WAYS`.
        contacts: How often which contact stopped one, in words.
        rounds: Number of rounds begun.
        ended: Whether Ctrl-C has ended it.

    Args:
        timeout: The time that it may take [s].
        progress: Called now and then as progress(t, timeout), both in s.
        whole: The search that this one is a part of, which may end it sooner.
    """

    def __init__(
        self, timeout: float, progress: Progress | None = None, whole: SearchAccount | None = None
    ) -> None:
        self.begun, self.timeout, self._progress = time.monotonic(), timeout, progress
        self._whole, self.ended = whole, False
        self.postures: Counter[str] = Counter()
        self.ways: Counter[str] = Counter()
        self.contacts: Counter[str] = Counter()
        self.rounds = 0

    @property
    def elapsed(self) -> float:
        """Time since it began [s]."""
        return time.monotonic() - self.begun

    @property
    def left(self) -> float:
        """Time that it may still take [s]."""
        return self.timeout - self.elapsed

    @property
    def limit(self) -> str:
        """The time limit, in words."""
        return f"timeout = {self.timeout:.3g} s"

    def part(self, timeout: float) -> SearchAccount:
        """Return a search of its own that may take this time [s], if the whole has so much left."""
        return SearchAccount(timeout, whole=self)

    def end(self) -> None:
        """End the search, as after Ctrl-C, and the one that it is a part of."""
        self.ended = True
        if self._whole is not None:
            self._whole.end()

    def failure(self, message: str, best: object) -> NoSolutionError | StoppedError:
        """Return the error of a search that found nothing, or that Ctrl-C has ended."""
        return (StoppedError if self.ended else NoSolutionError)(message, best)

    def check_time(self) -> None:
        """Report progress.

        Raises:
            TimeUpError: The time is up, or the search has been ended.
        """
        if self.ended:
            raise TimeUpError("stopped by Ctrl-C")
        if self._whole is not None:
            self._whole.check_time()
        elapsed = self.elapsed
        if self._progress:
            self._progress(min(elapsed, self.timeout), self.timeout)
        if elapsed > self.timeout:
            raise TimeUpError("the time is up (timeout)")

    def tick(self, _done: float, _total: float) -> None:
        """Check the time, as the `progress` of a computation that is a part of the search.

        Raises:
            TimeUpError: As `check_time` raises.
        """
        self.check_time()

    @property
    def verdict(self) -> str:
        """Which constraint stopped most attempts, and what to relax, in words."""
        parts, cause = [], ""
        if tried := self.postures["tried"]:
            reached, usable = self.postures["reached"], self.postures["usable"]
            parts.append(f"{reached} of {tried} searches found joint positions at the goal")
            lost = {word: self.postures[word] for word in POSTURES if word != "reached"}
            counts = [f"{lost[word]} {POSTURES[word]}" for word in lost if lost[word]]
            if reached:
                parts.append(f"of which {', '.join([*counts, f'{usable} can be used'])}")
            if not usable:
                cause = max(lost, key=lambda word: lost[word]) if reached else "reached"
        if ways := {word: self.ways[word] for word in WAYS if self.ways[word]}:
            counts = [f"{count} {WAYS[word]}" for word, count in ways.items()]
            parts.append(f"of the ways tried {', '.join(counts)}")
            landed = {word: count for word, count in ways.items() if word != "landing"}
            cause = cause or max(landed or ways, key=lambda word: ways[word])
        if self.contacts:
            what, count = self.contacts.most_common(1)[0]
            parts.append(f"most often ({count}x) {what}")
        story = "; ".join(parts)
        return f"{story}. To relax: {REMEDIES[cause]}" if cause else story


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
