"""Errors and warnings of spacearm: each names the thing, its value and the remedy."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Iterable, Mapping
from difflib import SequenceMatcher
from itertools import takewhile
from traceback import walk_stack


class SpaceArmError(Exception):
    """Base of all errors that spacearm raises."""


class ModelError(SpaceArmError, ValueError):
    """A model file or a model parameter is wrong."""


class ConfigurationError(SpaceArmError, ValueError):
    """An argument has the wrong shape, is not finite, or names something that does not exist."""


class UnsupportedError(SpaceArmError, NotImplementedError):
    """What was asked for does not exist for this arm; the message says why."""


class NoSolutionError(SpaceArmError):
    """No solution was found.

    Attributes:
        best: The best attempt, or None.
    """

    def __init__(self, message: str, best: object = None) -> None:
        super().__init__(message)
        self.best = best


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


def unknown(kind: str, name: object, valid: Iterable[str]) -> str:
    """Compose the message for a name that does not exist, with the valid ones, nearest first."""
    nearest = sorted(
        valid, key=lambda v: -SequenceMatcher(None, str(name).lower(), v.lower()).ratio()
    )
    shown = repr(str(name)[:60])
    return f"unknown {kind} {shown}; valid, nearest first: {', '.join(nearest) or 'none'}"


def warn(message: str) -> None:
    """Give a `ModelWarning` at the line of the caller outside this package.

    `warnings.warn` can skip the files of a package from Python 3.12 on only; until then the frames
    of this package are counted.
    """
    names = (f.f_globals.get("__name__", "") for f, _ in walk_stack(inspect.currentframe()))
    ours = takewhile(lambda name: name.partition(".")[0] == "spacearm", names)
    warnings.warn(message, ModelWarning, stacklevel=1 + len(list(ours)))
