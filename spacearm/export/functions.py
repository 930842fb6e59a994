"""The exported functions by name, and what they need to know of an arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from spacearm.equations import dynamics, jacobian, measures, posture
from spacearm.equations.structure import Parameters, Structure
from spacearm.errors import ConfigurationError, unknown
from spacearm.mechanics.many import structure_of
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.singularities.polynomial import plane_of_motion, probes

Equation = Callable[..., Any]
"""Called as equation(xp, structure, parameters, *arguments)."""

EQUATIONS: dict[str, tuple[Equation, tuple[str, ...]]] = {
    "jacobian": (jacobian.jacobian, ("q",)),
    "task_jacobian": (jacobian.task_jacobian, ("q",)),
    "connection": (jacobian.connection, ("q",)),
    "momentum": (posture.momentum, ("q",)),
    "base_inertia": (posture.base_inertia, ("q",)),
    "centre": (posture.centre, ("q",)),
    "tip_position": (posture.tip_position, ("q",)),
    "tip_rotation": (posture.tip_rotation, ("q",)),
    "S": (measures.singularity, ("q",)),
    "generalized_inertia": (dynamics.generalized_inertia, ("q",)),
    "forward_dynamics": (dynamics.forward_dynamics, ("q", "dq", "tau")),
}
"""Equations with the names of their arguments, each (n,). `S_gradient` comes with `S`."""


def structure_in(arm: SpaceArm, mode: BaseMode) -> Structure:
    """Return the structure of an arm in a mode, with the normal of its plane if it has one.

    Raises:
        ConfigurationError: There is no such mode.
    """
    return replace(structure_of(arm, mode), normal=plane_of_motion(arm, probes(arm)))


def symbolic(p: Parameters) -> Parameters:
    """Return numbers as arrays of objects, which symbols can stand beside."""
    return Parameters(*(np.asarray(values).astype(object) for values in p))


def chosen(names: str | Sequence[str]) -> tuple[str, ...]:
    """Return names of parameters as they are given, each once.

    Raises:
        ConfigurationError: There is no such parameter.
    """
    wanted = tuple(dict.fromkeys((names,) if isinstance(names, str) else names))
    for name in wanted:
        if name not in Parameters._fields:
            raise ConfigurationError(unknown("parameter", name, Parameters._fields))
    return wanted
