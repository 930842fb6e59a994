"""Reading: how a robot file is read, the same for every format."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

from spacearm.arrays import positive
from spacearm.errors import ConfigurationError, ModelError, unknown

Check = Literal["error", "warn", "accept"]
CHECKS = ("error", "warn", "accept")
Folders: TypeAlias = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


@dataclass(frozen=True)
class Reading:
    """How a robot file is read.

    Attributes:
        check: What to do with inertias that no rigid body can have: "error", or "warn" or "accept"
            to load published data that has this fault.
        packages: Folders that hold ROS packages, or are packages.
        xacro_args: Values of the arguments of a xacro source, by name.
        density: Density [kg/m^3] that gives bodies without inertial data theirs, from their
            shapes; None if they are to have none.
        spacecraft: Whether the root link is a spacecraft, which has mass; the root of an arm alone
            may be a frame without mass.

    Raises:
        ModelError: check is not one of these words.
        ConfigurationError: Another attribute is not of its kind.
    """

    check: Check = "error"
    packages: tuple[Path, ...] = ()
    xacro_args: Mapping[str, str] = field(default_factory=dict)
    density: float | None = None
    spacecraft: bool = True

    def __post_init__(self) -> None:
        if self.check not in CHECKS:
            raise ModelError(unknown("check", self.check, CHECKS))

    @classmethod
    def of(
        cls,
        check: Check | None = None,
        packages: Folders = (),
        xacro_args: Mapping[str, object] | None = None,
        density: float | None = None,
    ) -> Reading:
        """Make it of a caller's arguments, checked; see `loading.load`."""
        folders = [packages] if isinstance(packages, (str, os.PathLike)) else packages
        try:
            paths = tuple(Path(folder) for folder in folders)
        except TypeError:
            raise ConfigurationError(f"packages is {packages!r}; give folders") from None
        for path in paths:
            if not path.is_dir():
                raise ConfigurationError(f"packages: {path} is no folder; name one that exists")
        given = {} if xacro_args is None else xacro_args
        if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
            raise ConfigurationError(f"xacro_args is {xacro_args!r}; give {{name: value}}")
        return cls(
            check=check or "error",
            packages=paths,
            xacro_args={name: _text(value) for name, value in given.items()},
            density=None if density is None else positive(density, "density", "density [kg/m^3]"),
        )


def _text(value: object) -> str:
    """Return the value of an argument as xacro writes it."""
    return str(value).lower() if isinstance(value, bool) else str(value)
