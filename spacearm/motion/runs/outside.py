"""Functions of users that machine code calls, and the errors that they raise."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array

Function = Callable[[float, Array], Any]
"""Called as function(t, y), returns numbers; y is empty for functions of time."""


class Outside:
    """The functions outside that runs call, and the error that the last call of each run raised.

    After an error the integrator tries shorter steps, so that the run gets as near to it as it can;
    an interrupt ends all runs at once.

    Args:
        functions: Of each run its functions by name.
    """

    def __init__(self, functions: Sequence[Mapping[str, Function]]) -> None:
        self.functions = functions
        self.errors: list[BaseException | None] = [None] * len(functions)
        self.interrupted = False
        self._views: dict[tuple[int, int], Array] = {}

    def __bool__(self) -> bool:
        return bool(self.functions and self.functions[0])

    def called(
        self, runs: npt.NDArray[np.int64], counts: Mapping[str, int], given: Mapping[str, int]
    ) -> dict[str, Callable[..., None]]:
        """Return the functions as a kernel calls them whose lanes are of these runs.

        Args:
            runs: (lanes,) numbers of the runs.
            counts: How many numbers each gives.
            given: How many numbers each is given.
        """
        return {name: self._of(name, runs, count, given[name]) for name, count in counts.items()}

    def _of(
        self, name: str, runs: npt.NDArray[np.int64], count: int, size: int
    ) -> Callable[..., None]:

        def call(lane: int, values: Any, results: Any) -> None:
            given, out = self._view(values, size), self._view(results, 1 + count)
            run = int(runs[lane])
            out[0] = 1.0
            if self.interrupted:
                return
            try:
                out[1:] = np.ravel(self.functions[run][name](float(given[0]), given[1:]))
            except BaseException as error:
                self.errors[run] = error
                self.interrupted = not isinstance(error, Exception)
                return
            self.errors[run] = None
            out[0] = 0.0

        return call

    def _view(self, pointer: Any, size: int) -> Array:
        """Return numbers at an address as an array."""
        key = ctypes.addressof(pointer.contents), size
        if key not in self._views:
            self._views[key] = np.ctypeslib.as_array(pointer, (size,))
        return self._views[key]
