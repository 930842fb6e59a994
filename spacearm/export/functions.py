"""The exported functions by name, whatever they are exported to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from spacearm.export import equations
from spacearm.export.parameters import Structure, structure_of
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode, free_components

Equation = Callable[..., Any]
"""Called as equation(xp, tree, p, *arguments)."""

EQUATIONS: dict[str, tuple[Equation, tuple[str, ...]]] = {
    "jacobian": (equations.jacobian, ("q",)),
    "task_jacobian": (equations.task_jacobian, ("q",)),
    "connection": (equations.connection, ("q",)),
    "momentum": (equations.momentum, ("q",)),
    "base_inertia": (equations.base_inertia, ("q",)),
    "centre": (equations.centre, ("q",)),
    "tip_position": (equations.tip_position, ("q",)),
    "tip_rotation": (equations.tip_rotation, ("q",)),
    "S": (equations.singularity, ("q",)),
    "generalized_inertia": (equations.generalized_inertia, ("q",)),
    "forward_dynamics": (equations.forward_dynamics, ("q", "dq", "tau")),
}
"""Equations with the names of their arguments, each (n,). `S_gradient` comes with `S`."""


def structure_in(arm: SpaceArm, mode: BaseMode) -> Structure:
    """Return the structure of an arm in a mode, which is checked.

    Raises:
        ConfigurationError: There is no such mode.
    """
    free_components(mode)
    return structure_of(arm, mode)
