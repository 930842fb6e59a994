"""Results, each described once: title, verdict, tables of named columns with units.

A result class says what it shows in `describe`; terminal, notebook, page and report render that.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import wraps
from html import escape
from itertools import takewhile
from typing import Any, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np

from spacearm.arrays import Array, Frozen, freeze, plain
from spacearm.errors import LONGEST_NAME, shortened
from spacearm.signatures import checked, dataclass_transform

#: How angles are written; "both" is degrees, and radians too where the cell has the unit.
Angles: TypeAlias = Literal["rad", "deg", "both"]
Number: TypeAlias = float | np.floating[Any] | np.integer[Any]
#: How good an answer is; empty if it is neither.
Tone: TypeAlias = Literal["", "good", "caution", "bad"]
#: Share of the largest number of a vector up to which others are taken for rounding.
NOISE = 1e-12
#: Numbers of a vector up to this are taken for rounding too.
LEAST = 1e-15
#: Characters of a cell of a table, and of a sentence: names in files may have any length.
LONGEST_CELL, LONGEST_NOTE = 240, 2000
#: Events that are shown.
MOST_EVENTS = 10
#: What words end at, as it stands in a set of a regular expression.
ENDS = r"_\-./: "


class Measure(NamedTuple):
    """A number or a vector with its unit.

    Attributes:
        value: The number, or (m,) numbers.
        unit: Its unit; "rad" and "rad/s" may be written in degrees.
        spec: How numbers are written, as in `format`; five digits if empty.
    """

    value: Number | Array
    unit: str = ""
    spec: str = ""


Cell: TypeAlias = str | Number | Array | Measure | None


class Column(NamedTuple):
    """A column of a table.

    Attributes:
        name: Its heading.
        unit: Unit of its numbers, as in `Measure`; empty where cells have their own, or none.
        spec: How its numbers are written, as in `Measure`.
    """

    name: str
    unit: str = ""
    spec: str = ""


Cells: TypeAlias = Sequence[Cell] | Array


@dataclass(frozen=True, eq=False)
class Table:
    """A table.

    Attributes:
        columns: The columns; a name alone is a column without a unit.
        rows: The cells of each row: words, numbers, vectors, measures; None is empty.
        title: What it shows.
    """

    columns: Sequence[Column | str]
    rows: Sequence[Sequence[Cell]]
    title: str = ""

    @classmethod
    def facts(cls, facts: Mapping[str, Cell], title: str = "") -> Table:
        """Return a table of facts by their names."""
        return cls(("", ""), list(facts.items()), title)

    @classmethod
    def by_columns(cls, columns: Mapping[Any, Cells], title: str = "") -> Table:
        """Return a table of columns of one length: their cells by columns or names."""
        return cls(list(columns), list(zip(*columns.values(), strict=True)), title)

    def head(self, angles: Angles) -> list[str]:
        """Return the headings, with units."""
        units = [_converted(Measure(0.0, column.unit), angles).unit for column in self._columns]
        names = [shortened(column.name, LONGEST_CELL) for column in self._columns]
        return [f"{n} [{u}]" if u else n for n, u in zip(names, units, strict=True)]

    def body(self, angles: Angles) -> list[list[str]]:
        """Return the cells as texts."""
        return [
            [_cell(value, column, angles) for value, column in zip(row, self._columns, strict=True)]
            for row in self.rows
        ]

    def to_html(self) -> str:
        """Return the table as HTML, names and all else escaped; angles in both units."""
        head = [_row("th", head)] if any(head := self.head("both")) else []
        rows = [_row("td", cells) for cells in self.body("both")]
        return f"<table>{''.join(head + rows)}</table>"

    @property
    def _columns(self) -> list[Column]:
        return [Column(c) if isinstance(c, str) else c for c in self.columns]


@dataclass(frozen=True, kw_only=True, eq=False)
class Description:
    """What there is to say of a result.

    Attributes:
        title: What it is the result of: the arm and how its spacecraft moves.
        verdict: The answer in a sentence.
        tone: How good the answer is.
        notes: Sentences about it.
        tables: Its numbers.
        events: What happened on the way, in order; None where nothing can.
        not_checked: What the answer does not cover.
    """

    title: str
    verdict: str = ""
    tone: Tone = ""
    notes: Sequence[str] = ()
    tables: Sequence[Table] = ()
    events: Table | None = None
    not_checked: str = ""

    @property
    def parts(self) -> list[Table]:
        """All tables: the numbers, then the first of the events."""
        if self.events is None:
            return list(self.tables)
        rows = self.events.rows
        more = f", the first {MOST_EVENTS} of {len(rows)}" if len(rows) > MOST_EVENTS else ""
        title = f"Events{more}" if rows else "Events: none"
        return [*self.tables, Table(self.events.columns, rows[:MOST_EVENTS], title)]

    @property
    def headline(self) -> str:
        """Title and verdict in one line."""
        return f"{self.title}: {self.verdict}" if self.verdict else self.title

    @property
    def limits(self) -> str:
        """What was not checked, as a sentence; empty if there is nothing to say."""
        return f"Not checked: {self.not_checked}." if self.not_checked else ""

    def __post_init__(self) -> None:
        for name in ("title", "verdict", "not_checked"):
            object.__setattr__(self, name, shortened(getattr(self, name), LONGEST_NOTE))
        object.__setattr__(self, "notes", [shortened(x, LONGEST_NOTE) for x in self.notes])

    def to_html(self) -> str:
        """Return the description as HTML, as notebooks show it."""
        said = [f"<div>{escape(note)}</div>" for note in self.notes]
        for table in self.parts:
            said += [f"<div>{escape(table.title)}</div>"] if table.title else []
            said += [table.to_html()] if table.rows else []
        said += [f"<div>{self.limits}</div>"] if self.limits else []
        return f"<div><strong>{escape(self.headline)}</strong>{''.join(said)}</div>"

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data; tables as columns and rows, SI units."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}


@checked
class Described(ABC):
    """Base of all that has a description: `describe` is all that a class needs."""

    @abstractmethod
    def describe(self) -> Description:
        """Describe it: title, verdict, tables of named columns with units."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.describe().headline})"

    def _repr_html_(self) -> str:
        return self.describe().to_html()


@checked
@dataclass_transform(frozen_default=True, eq_default=False)
class Result(Frozen, Described):
    """Base of results: frozen dataclasses of read-only arrays, with `describe` and `to_dict`.

    Both say what was `not_checked`, which a class need not repeat in its own.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]
    #: Names that fields have in `to_dict` where their own mean something else in other results.
    JSON: ClassVar[Mapping[str, str]] = {}

    def __init_subclass__(cls, **options: bool) -> None:
        for name in {"describe"} & vars(cls).keys():
            setattr(cls, name, _with_limits(vars(cls)[name]))
        checked(dataclass(frozen=True, eq=False, repr=False, **options)(cls))

    def __post_init__(self) -> None:
        freeze(self)

    @property
    def not_checked(self) -> str:
        """What the answer does not cover; empty if there is nothing to say."""
        return ""

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data: arrays as nested lists, an arm as its name.

        Numbers that are not finite, which JSON lacks, are None.
        """
        told = {self.JSON.get(f.name, f.name): plain(getattr(self, f.name)) for f in fields(self)}
        return told | {"not_checked": self.not_checked}


def _with_limits(describe: Callable[[Any], Description]) -> Callable[[Any], Description]:
    """Return a `describe` whose description says what was not checked, too."""

    @wraps(describe)
    def described(self: Any) -> Description:
        return replace(describe(self), not_checked=self.not_checked)

    return described


def short_names(names: Sequence[str]) -> list[str]:
    """Return names without the words that all begin and end with, none over 60 characters.

    A word ends at `_`, `-`, `.`, `/`, `:` or a space. What remains is never a number alone: of
    `vispa_joint_1` and `vispa_joint_2` it is `joint_1` and `joint_2`.

    Args:
        names: The names.
    """
    words = [re.findall(rf"[^{ENDS}]+|[{ENDS}]+", name) for name in names]
    bounded = [shortened(name, LONGEST_NAME) for name in names]
    if len(names) < 2 or any(len(parts) < 2 for parts in words):
        return bounded
    first = _shared(words)
    rest = [parts[first:] for parts in words]
    last = _shared([parts[::-1] for parts in rest])
    rest = [parts[: len(parts) - last] for parts in rest]
    while first and any(not any(c.isalpha() for c in "".join(parts)) for parts in rest):
        first -= 1
        rest = [[whole[first], *parts] for whole, parts in zip(words, rest, strict=True)]
    short = [shortened("".join(parts).strip("_-./: "), LONGEST_NAME) for parts in rest]
    return short if all(short) and len(set(short)) == len(set(names)) else bounded


def _shared(words: list[list[str]]) -> int:
    """Return how many words all lists begin with; one at least is left of each."""
    same = takewhile(lambda column: len(set(column)) == 1, zip(*words, strict=False))
    return min(len(list(same)), *(len(parts) - 1 for parts in words))


def joint_measures(values: Iterable[float], slides: Iterable[bool], per: str = "") -> list[Cell]:
    """Return joint positions, motions or limits [rad] or [m] with units; infinite ones are "none".

    Args:
        values: n of them.
        slides: Whether each of the n joints slides.
        per: What follows the unit, as in "/s" of rates.
    """
    units = (("m" if slide else "rad") + per for slide in slides)
    pairs = zip(values, units, strict=True)
    return [Measure(round(float(x), 12), u) if np.isfinite(x) else "none" for x, u in pairs]


def without_noise(values: Array) -> Array:
    """Return numbers with zeros where there is only rounding beside the largest of them."""
    size = np.abs(values)
    return np.where(size > max(LEAST, NOISE * size.max(initial=0.0)), values, 0.0)


def text(cell: Cell, angles: Angles) -> str:
    """Return a cell as text, with the unit that it has."""
    if cell is None or isinstance(cell, str):
        return shortened(cell or "", LONGEST_CELL)
    given = cell if isinstance(cell, Measure) else Measure(cell)
    shown = _converted(given, angles)
    words = _number(shown) + ("" if shown.unit[:1] in ("", "°") else " ") + shown.unit
    if angles == "both" and shown.unit != given.unit:
        return f"{words} ({_number(given)} {given.unit})"
    return words


def _cell(value: Cell, column: Column, angles: Angles) -> str:
    """Return a cell of a column as text; the unit of a column stands in its heading alone."""
    if value is None or isinstance(value, str | Measure):
        return text(value, angles)
    return _number(_converted(Measure(value, column.unit, column.spec), angles))


def _converted(given: Measure, angles: Angles) -> Measure:
    """Return a measure in the unit in which it is written."""
    value, unit, spec = given
    if angles == "rad" or unit.split("/")[0] != "rad":
        return given
    return Measure(np.degrees(value), "°" + unit[3:], spec)


def _number(given: Measure) -> str:
    """Return the number, or the vector, of a measure as text; NaN is "none" and -0 is 0."""
    value, _, spec = given
    if isinstance(value, np.ndarray) and value.ndim:
        return f"({', '.join(_number(Measure(x, '', spec)) for x in without_noise(value))})"
    if np.isnan(value):
        return "none"
    whole = isinstance(value, int | np.integer)
    return f"{value + 0:{spec or (',' if whole else '.5g')}}"


def _row(kind: str, texts: Sequence[str]) -> str:
    """Return a row of an HTML table."""
    return f"<tr>{''.join(f'<{kind}>{escape(text)}</{kind}>' for text in texts)}</tr>"
