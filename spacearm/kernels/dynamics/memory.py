"""The arrays of a context, which compiled functions know by their addresses."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from spacearm.kernels.dynamics.context import ARRAYS, CONTEXT, KINDS, SIZES, WORKS
from spacearm.kernels.floating import Bodies

COUNTED = (
    "t", "began", "step", "last_step", "last_error", "eigenvalue", "exchanged", "cubic", "dense",
    "stiff", "calm", "patience", "known", "factored", "steps", "rates", "written", "happened",
    "looked",
)  # fmt: skip
"""What starts at zero."""

ALIGNED = 16
"""The arrays begin at multiples of so many bytes."""
PLAIN = np.dtype((np.void, CONTEXT))
"""Its fields are read by name only, which is quicker."""
LINE = np.dtype((np.void, ALIGNED))


class Memory:
    """The arrays of a context, by name, in one piece of memory, and the context itself.

    Args:
        sizes: The `SIZES` but N and states, which follow from the bodies.
        b: The bodies.
    """

    def __init__(self, b: Bodies, **sizes: int) -> None:
        N, n = len(b) - 1, sizes["n"]
        known = {**sizes, "N": N, "states": state_size(n, sizes["wheels"])}
        self._places, offsets, length = _layout(tuple(known[name] for name in SIZES))
        self._buffer = np.zeros(length // ALIGNED, LINE)
        self._arrays: dict[str, npt.NDArray[Any]] = {}
        self.memory = np.zeros(1, PLAIN)
        self.context = self.memory[0]
        self.here = int(self.memory.ctypes.data)
        self.kept: list[Any] = []
        numbers, first = self.memory.view(np.int64), len(SIZES)
        numbers[:first] = [known[name] for name in SIZES]
        numbers[first : first + len(offsets)] = self._buffer.ctypes.data + offsets
        self["b"][:] = b
        self.context["here"] = self.here
        self.context["stopped"] = -1

    def restart(self) -> None:
        """Set all that a run counts to zero; what it is about stays."""
        for name in COUNTED:
            self.context[name] = 0
        self["G"][:] = 0.0  # where RKC begins to look for the largest eigenvalue
        self.context["stopped"] = -1

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        if name not in self._arrays:
            offset, kind, shape = self._places[name]
            self._arrays[name] = np.ndarray(shape, kind, self._buffer, offset)
        return self._arrays[name]


@lru_cache(maxsize=64)
def _layout(known: tuple[int, ...]) -> tuple[dict[str, tuple[int, Any, tuple[int, ...]]], Any, int]:
    """Return offset, type and shape of each array for some sizes, the offsets, and the length."""
    sizes = dict(zip(SIZES, known, strict=True))

    def size(word: str) -> int:  # such as "6*tips"
        terms = (term.split("*") for term in word.split("+"))
        return sum(math.prod(sizes[p] if p in sizes else int(p) for p in term) for term in terms)

    places: dict[str, tuple[int, Any, tuple[int, ...]]] = {}
    length = 0
    for name, words in ARRAYS.items():
        shape, kind = tuple(size(word) for word in words), np.dtype(KINDS.get(name, np.float64))
        places[name] = length, kind, shape
        length += -(-math.prod(shape) * kind.itemsize // ALIGNED) * ALIGNED
    return places, np.array([offset for offset, _, _ in places.values()]), length


def state_size(n: int, wheels: int) -> int:
    """Return the size of the state."""
    return 2 * n + 13 + WORKS + wheels
