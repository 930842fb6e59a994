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
    "t", "began", "step", "last_step", "last_error", "eigenvalue", "exchanged", "by_radau", "dense",
    "stiff", "calm", "patience", "known", "factored", "steps", "rates", "written", "happened",
)  # fmt: skip
"""What starts at zero."""


class Memory:
    """The arrays of a context, by name, and the context itself.

    Args:
        sizes: The `SIZES` but N and states, which follow from the bodies.
        b: The bodies.
    """

    def __init__(self, b: Bodies, **sizes: int) -> None:
        N, n = len(b) - 1, sizes["n"]
        known = {**sizes, "N": N, "states": state_size(n, sizes["wheels"])}
        self.arrays: dict[str, npt.NDArray[Any]] = {}
        self.memory = np.zeros(1, CONTEXT)
        self.context = self.memory[0]
        self.kept: list[Any] = []
        for name in SIZES:
            self.context[name] = known[name]
        for name, shape in _shapes(tuple(known.items())).items():
            array = np.zeros(shape, KINDS.get(name, np.float64))
            self.arrays[name] = array
            self.context[f"_{name}"] = array.ctypes.data
        self.arrays["b"][:] = b
        self.context["here"] = self.memory.ctypes.data
        self.context["stopped"] = -1

    def restart(self) -> None:
        """Set all that a run counts to zero; what it is about stays."""
        for name in COUNTED:
            self.context[name] = 0
        self.context["stopped"] = -1

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        return self.arrays[name]


@lru_cache(maxsize=64)
def _shapes(known: tuple[tuple[str, int], ...]) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the arrays for some sizes."""
    sizes = dict(known)

    def size(word: str) -> int:  # such as "6*tips"
        terms = (term.split("*") for term in word.split("+"))
        return sum(math.prod(sizes[p] if p in sizes else int(p) for p in term) for term in terms)

    return {name: tuple(size(word) for word in shape) for name, shape in ARRAYS.items()}


def state_size(n: int, wheels: int) -> int:
    """Return the size of the state."""
    return 2 * n + 13 + WORKS + wheels
