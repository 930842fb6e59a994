"""HTML tables: what the last line of a notebook cell shows of an arm or a result."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape

import numpy as np

from spacearm.arrays import Array


def shown(caption: str, *tables: str) -> str:
    """Return a caption with the tables below it, as HTML."""
    return f"<div><strong>{escape(caption)}</strong>{''.join(tables)}</div>"


def table(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as HTML; names and all else are escaped, numbers have five digits.

    Args:
        columns: The heads, with units; none of them if all are empty.
        rows: The cells.
    """
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join(
        f"<tr>{''.join(f'<td>{_cell(value)}</td>' for value in row)}</tr>" for row in rows
    )
    return f"<table>{f'<tr>{head}</tr>' if any(columns) else ''}{body}</table>"


def joint_table(
    names: Sequence[str], slides: Sequence[bool] | np.ndarray, columns: Mapping[str, Array]
) -> str:
    """Return a table of the n joints with columns of positions [rad] or [m], each (n,)."""
    rows = zip(names, slides, *columns.values(), strict=True)
    return table(
        ("joint", *columns),
        ((name, *(joint_value(x, s) for x in values)) for name, s, *values in rows),
    )


def joint_value(value: float, slides: bool) -> str:
    """Return a joint position or limit with its unit: m, or degrees beside rad."""
    if not math.isfinite(value):
        return "none"
    return f"{value:.5g} m" if slides else f"{math.degrees(value):.5g}° ({value:.5g} rad)"


def _cell(value: object) -> str:
    """Return the text of a cell, escaped."""
    if isinstance(value, (float, np.floating)):
        return f"{value:.5g}"
    if isinstance(value, np.ndarray):
        return f"({', '.join(map(_cell, value))})"
    return escape(str(value))
