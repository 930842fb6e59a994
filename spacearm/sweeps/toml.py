"""TOML tables with checks: known keys, and values of the right kind, or an error that says why."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from spacearm.arrays import LARGEST, MOST_COUNT, Array, number_of, positive, whole
from spacearm.errors import (
    LONGEST_NAME,
    ConfigurationError,
    UnsupportedError,
    require_known,
    shortened,
    unknown,
)
from spacearm.files import decoded, read

T = TypeVar("T")
#: Largest number of parts of a key, as in a.b.c.
MOST_PARTS = 16
LONG_KEY = re.compile(
    r"""(?<![\w"'-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){""" + f"{MOST_PARTS}}}"
)
#: Most lists and tables around one another.
MOST_NESTED = 100
#: Largest size of a file [bytes]: its tables may take hundreds of times as much memory.
MOST_BYTES = 1_000_000
AXIS = ("from", "to", "points")
#: Largest number of samples or runs of a study, which are stored chunk by chunk.
MOST = 10**15


class Table:
    """One table of a file, which gives checked values; `like` says what it looks like."""

    def __init__(self, where: str, values: object, like: str = "") -> None:
        if not isinstance(values, Mapping):
            raise ConfigurationError(f"{where} is {values!r}; make it a table{like and ', '}{like}")
        self.where = where
        self.values = dict(values)

    def knows(self, *names: str) -> None:
        """Refuse keys that are not among these names."""
        require_known("key", self.values, names, f"{self.where}: ")

    def some(self, *names: str) -> dict[str, Any]:
        """Return those of these keys that there are, with their values."""
        return {name: self.values[name] for name in names if name in self.values}

    def fail(self, key: str, remedy: str) -> ConfigurationError:
        """Return the error for the value of a key, with a remedy."""
        value = self.values.get(key, "missing")
        return ConfigurationError(f"{self.where}: {key} is {shown(value)}; {remedy}")

    def take(self, key: str, kind: type[T], default: T | None = None) -> T:
        """Return the value of a key, of this type."""
        value = self.values.get(key, default)
        if kind is float and type(value) is int:
            value = number_of(value)
        if type(value) is not kind or (isinstance(value, float) and not math.isfinite(value)):
            name = {str: "text", bool: "true or false", int: "a whole number", float: "a number"}
            raise self.fail(key, f"give {name.get(kind, kind.__name__)}")
        return value

    def choice(self, key: str, valid: Sequence[T], default: T | None = None) -> T:
        """Return the value of a key, one of some texts."""
        value = self.values.get(key, default)
        for each in valid:
            if value == each:
                return each
        named = [str(each) for each in valid]
        remedy = unknown(key, value, named) if key in self.values else f"give {', '.join(named)}"
        raise self.fail(key, remedy)

    def inner(self, key: str) -> Table:
        """Return the table that a key has, an empty one if the key is missing."""
        return Table(f"{self.where}: {key}", self.values.get(key, {}))

    def texts(self, key: str) -> list[str]:
        """Return the value of a key, a list of texts, an empty one if the key is missing."""
        listed = self.take(key, list, [])
        if not all(isinstance(text, str) for text in listed):
            raise self.fail(key, "give a list of texts")
        return listed

    def numbers(self, key: str, default: list[float] | None = None) -> Array:
        """Return the value of a key, a number or a list of them, as an array (m,)."""
        value = self.values.get(key, default)
        listed = value if isinstance(value, list) else [value]
        if not listed or any(type(number) not in (int, float) for number in listed):
            raise self.fail(key, "give a number, or a list of numbers")
        numbers = np.array([number_of(number) for number in listed])
        if not (np.abs(numbers) <= LARGEST).all():
            raise self.fail(key, f"give numbers up to {LARGEST:g}")
        return numbers

    def positive(
        self, key: str, kind: type[T], default: T | None = None, most: int = MOST_COUNT
    ) -> T:
        """Return the value of a key, a number above zero; `most` is for whole numbers."""
        value: Any = self.take(key, kind, default)
        name = f"{self.where}: {key}"
        checked: Any = whole(value, name, 1, most) if kind is int else positive(value, name)
        return checked

    def axis(self, key: str) -> Array:
        """Return (m,) different finite numbers, given as a list or as {from, to, points}."""
        value = self.values.get(key)
        if isinstance(value, Mapping):
            ends = self.inner(key)
            ends.knows(*AXIS)
            points = ends.positive("points", int)
            values = np.linspace(ends.take("from", float), ends.take("to", float), points)
        else:
            listed = value if isinstance(value, list) else [value]
            if not all(type(number) in (int, float) for number in listed):
                raise self.fail(key, "give a list of numbers, or {from = 0, to = 1, points = 5}")
            values = np.array([number_of(number) for number in listed])
        sound = values.size and (np.abs(values) <= LARGEST).all()
        if not sound or len(np.unique(values)) < len(values):
            raise self.fail(key, f"give one or more different numbers up to {LARGEST:g}")
        return values


def text_of(path: str | os.PathLike[str], what: str) -> str:
    """Return the text of a file.

    Raises:
        ConfigurationError: It cannot be read; says what it is.
    """
    try:
        return decoded(read(Path(path), MOST_BYTES))
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{what} {path} cannot be read: {error}") from None


def shown(value: object) -> str:
    """Return a value as an error shows it; Python writes no number of thousands of digits."""
    try:
        return shortened(repr(value), LONGEST_NAME)
    except ValueError:
        return "a number of thousands of digits"


def meaning(text: object) -> object:
    """Return what a TOML text says, without its comments; the text itself if it says nothing."""
    try:
        return parse(str(text)).values
    except ConfigurationError:
        return text


def parse(text: str, what: str = "the study") -> Table:
    """Parse a TOML text.

    Args:
        text: The text.
        what: What it is called in errors.

    Raises:
        ConfigurationError: The text is not TOML.
        UnsupportedError: Python is older than 3.11.
    """
    try:
        import tomllib
    except ImportError:
        raise UnsupportedError(
            f"{what} needs Python 3.11 or newer, which reads TOML and runs Zarr 3"
        ) from None
    if LONG_KEY.search(text):  # tomllib takes time and memory as its square
        raise ConfigurationError(f"{what} has a key of more than {MOST_PARTS} parts; shorten it")
    depths = accumulate((c in "[{") - (c in "]}") for c in text)
    if max(depths, default=0) > MOST_NESTED:
        raise ConfigurationError(
            f"{what} has lists or tables within more than {MOST_NESTED} others; nest fewer"
        )
    try:
        return Table(what.removeprefix("the "), tomllib.loads(text))
    except ValueError as error:  # numbers of thousands of digits too
        raise ConfigurationError(f"{what} is not TOML: {error}") from None
