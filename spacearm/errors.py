"""Errors and warnings of spacearm: each names the thing, its value and the remedy."""

from __future__ import annotations

import inspect
import re
import sys
import warnings
from collections.abc import Collection, Iterable, Mapping
from difflib import SequenceMatcher
from heapq import nsmallest
from importlib import import_module
from itertools import dropwhile, islice, takewhile
from traceback import walk_stack
from types import FrameType
from typing import Any

#: Names that a message lists.
MOST_NAMES = 10
#: Characters of a name in a list, and of a message.
LONGEST_NAME, LONGEST = 60, 4000
#: Characters that move a terminal's cursor, change the direction of text, are not seen or cannot be
#: written; tabs and line ends may be.
UNPRINTABLE = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f"
    r"\ud800-\udfff\ufeff\ufff9-\ufffb\U000e0000-\U000e007f]"
)


class SpaceArmError(Exception):
    """Base of all errors that spacearm raises."""

    def __init__(self, message: object = "") -> None:
        super().__init__(printable(shortened(str(message))))


class ModelError(SpaceArmError, ValueError):
    """A model file or a model parameter is wrong."""


class ConfigurationError(SpaceArmError, ValueError):
    """An argument has the wrong shape, is not finite, or names something that does not exist."""


class UnsupportedError(SpaceArmError, NotImplementedError):
    """What was asked for does not exist for this arm; the message says why.

    Like the other errors it is one of Python's own too, for callers that catch those.
    """


class NoSolutionError(SpaceArmError):
    """No solution was found.

    Attributes:
        best: The best attempt, or None.
    """

    def __init__(self, message: str, best: object = None) -> None:
        super().__init__(message)
        self.best = best


class ImpossibleError(NoSolutionError):
    """It is proven that there is no solution; the message names the argument and what to relax."""


class ResourceError(SpaceArmError):
    """The system does not give what a computation needs: threads, memory or a library."""


class StoppedError(KeyboardInterrupt):
    """Ctrl-C has stopped a computation; what there was by then is kept.

    It is a KeyboardInterrupt, so that `except Exception` does not catch it.

    Attributes:
        best: The result as far as it had come.
    """

    def __init__(self, message: str, best: object) -> None:
        super().__init__(message)
        self.best = best

    def __reduce__(self) -> tuple[type[StoppedError], tuple[str, object]]:
        return type(self), (str(self), self.best)


class StoreError(SpaceArmError):
    """The store of a sweep cannot be used, or the cluster that fills it is lost.

    The content of the store is kept; the message says what to do.
    """


class SweepError(SpaceArmError):
    """A sweep has ended, and some chunks failed in every attempt.

    Attributes:
        failed: The error of each failed chunk, by "quantity number".
    """

    def __init__(self, message: str, failed: Mapping[str, str]) -> None:
        super().__init__(message)
        self.failed = dict(failed)

    def __reduce__(self) -> tuple[type[SweepError], tuple[str, dict[str, str]]]:
        return type(self), (str(self), self.failed)


class ModelWarning(UserWarning):
    """A model loads, but something in it is suspicious."""


def imported(library: str, name: str, extra: str) -> Any:
    """Import a library that an extra of this package brings.

    Raises:
        UnsupportedError: It is not installed; says how to.
    """
    try:
        return import_module(library)
    except ImportError:
        why = f"{name} is not installed: pip install 'spacearm[{extra}]'"
        raise UnsupportedError(why) from None


def unknown(kind: str, name: object, valid: Iterable[str]) -> str:
    """Compose the message for a name that does not exist, with valid ones, nearest first."""
    valid, wanted = list(valid), str(name)[:LONGEST_NAME]

    def distance(other: str) -> float:
        return -SequenceMatcher(None, wanted.lower(), other[:LONGEST_NAME].lower()).ratio()

    nearest = nsmallest(MOST_NAMES, valid, key=distance)
    shown = listed(nearest, of=len(valid)) or "none"
    return f"unknown {kind} {wanted!r}; valid, nearest first: {shown}"


def require_known(
    kind: str, given: Iterable[object], valid: Collection[str], where: str = ""
) -> None:
    """Refuse a name, or names, that do not exist.

    Args:
        kind: What they are names of.
        given: One name, or several.
        valid: Those that exist.
        where: How the message begins.

    Raises:
        ConfigurationError: One does not exist; says which do.
    """
    for name in [given] if isinstance(given, str) else given:
        if name not in valid:
            raise ConfigurationError(f"{where}{unknown(kind, name, valid)}")


def listed(names: Collection[str], of: int | None = None, longest: int = LONGEST_NAME) -> str:
    """Write the first ten names, and how many more there are.

    Args:
        names: The names.
        of: Number of all names, if these are the first of them.
        longest: Largest number of characters of one.
    """
    rest = (len(names) if of is None else of) - MOST_NAMES
    first = ", ".join(shortened(name, longest) for name in islice(names, MOST_NAMES))
    return f"{first} and {rest:,} more" if rest > 0 else first


def type_of(thing: object) -> str:
    """Return what a thing is, with an article, as "an int"."""
    name = type(thing).__name__
    return f"{'an' if name[0] in 'AEIOUaeio' else 'a'} {name}"


def shortened(text: str, most: int = LONGEST) -> str:
    """Return a text, its middle left out where it is too long."""
    half = most // 2
    return text if len(text) <= most else f"{text[:half]}[...]{text[-half:]}"


def printable(text: str) -> str:
    """Return a text with the characters that no terminal should get written as in Python."""
    return UNPRINTABLE.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def warn(message: str) -> None:
    """Give a `ModelWarning` at the line of the caller outside this package.

    `warnings.warn` can skip the files of a package from Python 3.12 on only; until then the frames
    of this package are counted.
    """
    frames = walk_stack(inspect.currentframe())
    ours = sum(1 for _ in takewhile(lambda frame: _is_ours(frame[0]), frames))
    text = printable(shortened(message))
    warnings.warn(text, ModelWarning, stacklevel=1 + ours)


def call_site() -> tuple[str, int]:
    """Return file and line of the caller outside this package."""
    frames = dropwhile(lambda frame: _is_ours(frame[0]), walk_stack(inspect.currentframe()))
    frame, line = next(frames)
    return frame.f_code.co_filename, line


def called_from_outside() -> bool:
    """Tell whether the function that asks was called from outside this package."""
    calls = (frame for frame, _ in walk_stack(sys._getframe(2)))
    return not _is_ours(next(dropwhile(_only_checks, calls)))


def _only_checks(frame: FrameType) -> bool:
    """Tell whether a call stands between a user and what is called, as of `signatures`."""
    return bool(frame.f_globals.get("__name__") == "spacearm.signatures")


def _is_ours(frame: FrameType) -> bool:
    name = frame.f_globals.get("__name__", "")
    return bool(name.partition(".")[0] == "spacearm")
