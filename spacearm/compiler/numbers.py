"""The array library of numbers: NumPy, with the loops of `symbols` for one lane."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

#: Steps of `gradient`.
STEP = 1e-30


def __getattr__(name: str) -> Any:
    """Return a function of NumPy."""
    return getattr(np, name)


def hold(values: Any) -> Any:
    """Return the values."""
    return values


def gradient(function: Callable[[Any], Any], at: Any) -> Any:
    """Return the derivatives (n,) of a function of n variables, by steps along imaginary axes.

    Squire & Trapp, SIAM Rev. 40(1), 110-112 (1998), DOI 10.1137/S003614459631241X: nothing is
    subtracted, so that they are right to rounding. The function must be analytic.
    """
    steps = STEP * 1j * np.eye(len(at))
    return np.array([function(at + step).imag for step in steps]) / STEP


def procedure(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return the function."""
    return function


def row(table: Any, index: Any) -> Any:
    """Return a row of a table; see `symbols.row`."""
    return table[int(np.nan_to_num(np.clip(index, 0, len(table) - 1)))]


def while_any(step: Callable[..., Any], *state: Any, most: int, keep: bool = False) -> Any:
    """Repeat a step while it goes on; see `symbols.while_any`."""
    rows: list[Any] = []
    for _ in range(most):
        found = step(*state)
        state, (goes_on, *row) = found[: len(state)], found[len(state) :]
        rows += row
        if not goes_on:
            break
    return (*state, np.array(rows)) if keep else state


def repeat(count: int, step: Callable[..., Any], *state: Any) -> Any:
    """Repeat a step a number of times; see `symbols.repeat`."""
    for turn in range(count):
        state = step(turn, *state)
    return state
