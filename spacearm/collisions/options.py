"""Options of obstacles, checked."""

from __future__ import annotations

from collections.abc import Collection
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from spacearm.arrays import LARGEST, finite, positive, shape_of
from spacearm.errors import ConfigurationError, unknown


def checked_options(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options of an obstacle, checked, with defaults; `name` is empty if not given.

    Raises:
        ConfigurationError: One does not exist or does not make sense.
    """
    known_options(options, ("name", "margin", "may_touch", "twist", "along", "posture"))
    given = {"name": "", "margin": 0.0, "may_touch": (), "twist": np.zeros(6)} | options
    name, margin, touch = given["name"], given["margin"], given["may_touch"]
    if not isinstance(name, str) or ("name" in options and not name):
        raise ConfigurationError(f"name is {name!r}; give a name")
    if not isinstance(margin, Real) or not 0.0 <= float(margin) <= LARGEST:
        raise ConfigurationError(f"margin is {margin!r}; give a distance from 0 on [m]")
    if not isinstance(touch, list | tuple | set) or not all(isinstance(x, str) for x in touch):
        raise ConfigurationError(f"may_touch is {touch!r}; give names of links in a list")
    twist = finite(given["twist"], (6,), "twist", "[linear [m/s]; angular [rad/s]]")
    if given.get("along") is not None and twist.any():
        raise ConfigurationError("give an obstacle either twist or along, not both")
    twist.flags.writeable = False
    return given | {"margin": float(margin), "may_touch": tuple(touch), "twist": twist}


def known_options(options: Collection[str], names: tuple[str, ...]) -> None:
    """Raise a ConfigurationError for options that do not exist."""
    for option in options:
        if option not in names:
            raise ConfigurationError(unknown("option", option, names))


def edges_of(size: npt.ArrayLike) -> tuple[float, ...]:
    """Return the three edges of a box [m], or of a cube given by one.

    Raises:
        ConfigurationError: They are no positive lengths.
    """
    shape = shape_of(size)
    values = finite(size, shape if shape == () else (3,), "size", "edges [m]")
    return tuple(positive(float(x), "size", "edge [m]") for x in np.broadcast_to(values, 3))
