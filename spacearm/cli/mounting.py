"""Mounting: the arm that the options shared by the commands describe, on a bus if it needs one."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer

from spacearm.description.bus import Bus
from spacearm.description.model_catalogue import assembled, find_arm, find_model, models_by_name
from spacearm.description.readers import formats
from spacearm.description.readers.source import Reading
from spacearm.description.tips import Counting
from spacearm.description.tree import Tree
from spacearm.errors import ConfigurationError, warn
from spacearm.model.arm import SpaceArm
from spacearm.model.loading import load, mount

BUS_DENSITY = 200.0
"""Density [kg/m^3] of a bus whose size is not given: that of small spacecraft."""

Edges: TypeAlias = tuple[float, float, float]
BusMass = Annotated[
    float | None,
    typer.Option(help="Mount MODEL, an arm alone, on a bus of this mass [kg].", metavar="KG"),
]
BusSize = Annotated[
    Edges | None,
    typer.Option(help="Edges of that bus, a solid box [m].", metavar="X Y Z"),
]
Arguments = Annotated[
    list[str] | None,
    typer.Option(
        "--arg", help="Argument of a xacro source; may be repeated.", metavar="NAME:=VALUE"
    ),
]
PackageFolders = Annotated[
    list[Path] | None,
    typer.Option("--package", help="Folder of ROS packages; may be repeated.", metavar="FOLDER"),
]
Density = Annotated[
    float | None,
    typer.Option(help="Density [kg/m^3] of links without inertial data.", metavar="RHO"),
]


def described_arm(
    model: str,
    bus: Bus | None,
    *,
    tip: str | list[str] | None,
    joints: Counting,
    locked: dict[str, float],
    options: dict[str, Any],
) -> SpaceArm:
    """Load a spacecraft with its arm, or mount an arm on top of a bus.

    Args:
        model: A name of the catalogue or the path of a file.
        bus: The bus; None if the model has a spacecraft.
        tip: As in `loading.load`.
        joints: As in `loading.load`.
        locked: As in `loading.load`, in SI units.
        options: check, packages, xacro_args and density, as in `loading.load`.
    """
    if bus is None:
        return load(model, tip=tip, joints=joints, locked=locked, **options)
    _require_arm(model)
    if isinstance(tip, list):
        raise ConfigurationError("--tip names several links; an arm on a new bus has one tip")
    return mount(model, bus, tip=tip, joints=joints, locked=locked, **options)


def described_bus(mass: float | None, size: Edges | None) -> Bus | None:
    """Return the bus that the options describe; None if they name none.

    Raises:
        ConfigurationError: A size is given without a mass.
        ModelError: No bus can have them.

    Warns:
        ModelWarning: The size was assumed.
    """
    if mass is None:
        if size is not None:
            raise ConfigurationError("--bus-size needs --bus-mass KG")
        return None
    if size is None:
        edge = round(float(np.cbrt(max(mass, 0.0) / BUS_DENSITY)), 3) or 0.001
        size = (edge, edge, edge)
        warn(
            f"the bus of {mass:g} kg is taken as a solid cube of {edge:g} m, at {BUS_DENSITY:g} "
            "kg/m^3, with the arm on its +z face; --bus-size X Y Z gives another"
        )
    return Bus(mass=mass, size=size)


def joints_of(model: str, bus: Bus | None, options: dict[str, Any]) -> Tree:
    """Read the tree of a model, without warnings: they come when it is loaded."""
    reading = {**options, "check": "accept"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if bus is not None:
            known = find_arm(model)
            path = known.path if known else Path(model)
            sound = Reading.of(**reading)
            return formats.read(path, Reading(**{**vars(sound), "spacecraft": False}))
        info = find_model(model)
        return assembled(info) if info else formats.read(model, Reading.of(**reading))


def _require_arm(model: str) -> None:
    if model in models_by_name():
        raise ConfigurationError(
            f"--bus-mass mounts an arm alone, and {model} has a spacecraft; leave it out"
        )
