"""Arrays of real numbers, and results made of them that nobody can change."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.floating[Any]]
"""Shapes stand in the docstrings."""

LARGEST = 1e12
"""No length, mass, inertia or joint position of a spacecraft is larger in SI units; what is, is a
slip, and would overflow."""
LEAST_MASS = 1e-12
"""No body is lighter [kg]; Pinocchio divides by masses and takes those below rounding for that."""


def plain(value: Any) -> Any:
    """Arrays as nested lists, paths as text, results as dictionaries."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    return value.to_dict() if hasattr(value, "to_dict") else value


class Result:
    """Base of frozen dataclasses that hold results: read-only arrays, and `to_dict`."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    def to_dict(self) -> dict[str, Any]:
        """All fields, arrays as nested lists."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}
