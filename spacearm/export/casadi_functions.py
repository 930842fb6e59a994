"""An arm as functions of CasADi."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import UnsupportedError
from spacearm.export.functions import EQUATIONS, chosen, structure_in, symbolic
from spacearm.mechanics.many import parameters_of
from spacearm.model.arguments import of_arm
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode


@dataclass(frozen=True, eq=False, repr=False)
class CasadiArm:
    """The functions of `to_casadi`, each a `casadi.Function` of q (n) that expands to SX.

    Attributes:
        name: Name of the arm.
        parameters: The arm's own values of the numbers that the functions take after q, dq and tau,
            as matrices in that order; of more than two axes the first are joined.
        jacobian: (6, n) J* of (35); (6 tips, n) of several tips.
        task_jacobian: (k, n) its rows that the task names, scaled.
        connection: (3, n) -D^-1 D_q of (33c): the spacecraft turns with w_0 = connection dq.
        momentum: (6, n) [linear; angular about the system CM] per unit joint rates.
        base_inertia: (3, 3) D about the system CM [kg m^2].
        centre: (3, 1) the system CM from the spacecraft frame [m].
        tip_position: (3, 1) the tip from the system CM [m]; (tips, 3) of several.
        tip_rotation: (3, 3) its attitude; (3 tips, 3) of several.
        S: What is zero exactly at singular configurations; see `equations.measures`.
        S_gradient: (n, 1) its gradient by the joints.
        generalized_inertia: (n, n) H*.
        forward_dynamics: (n, 1) joint accelerations of (q, dq, tau).
    """

    name: str
    parameters: dict[str, Array]
    jacobian: Any
    task_jacobian: Any
    connection: Any
    momentum: Any
    base_inertia: Any
    centre: Any
    tip_position: Any
    tip_rotation: Any
    S: Any
    S_gradient: Any
    generalized_inertia: Any
    forward_dynamics: Any

    def __repr__(self) -> str:
        return f"CasadiArm({self.name}: {', '.join((*EQUATIONS, 'S_gradient'))})"


@of_arm
def to_casadi(
    arm: SpaceArm, *, mode: BaseMode = "free-floating", parameters: str | Sequence[str] = ()
) -> CasadiArm:
    """Return the equations of an arm as functions of CasADi, made of SX symbols.

    They take numbers and symbols, can be differentiated, and write C by their `generate`. All that
    they return is in spacecraft axes, points from the system CM. With `parameters`, masses, mounts
    and other numbers of the arm are arguments too: `fly.S(q, *fly.parameters.values())`.

    Args:
        arm: The arm.
        mode: What the spacecraft does; see `generalized_jacobian`.
        parameters: Names of what the functions take besides: any of "masses", "centres",
            "inertias", "joint_positions", "joint_rotations", "tip_positions", "tip_rotations".

    Returns:
        A record of `casadi.Function`s: `jacobian`, `task_jacobian`, `connection`, `momentum`,
        `base_inertia`, `centre`, `tip_position`, `tip_rotation`, `S`, `S_gradient`,
        `generalized_inertia` and `forward_dynamics` of (q, dq, tau), and of `parameters`.

    Raises:
        UnsupportedError: CasADi is not installed (pip install 'spacearm[casadi]').
        ConfigurationError: There is no such mode or parameter.

    Example:
        >>> import spacearm as sa
        >>> fly = sa.to_casadi(sa.load("planar2"))
        >>> fly.jacobian([0.3, 1.2]).full()[:2].round(3)
        array([[-0.698, -0.865],
               [ 0.339, -0.042]])
    """
    try:
        casadi = import_module("casadi")
    except ImportError:
        raise UnsupportedError("CasADi is not installed: pip install 'spacearm[casadi]'") from None
    tree, numbers, functions = structure_in(arm, mode), parameters_of(arm), {}
    own = {name: np.asarray(getattr(numbers, name)) for name in chosen(parameters)}
    varied = {name: _flat(values) for name, values in own.items()}
    taken = {name: casadi.SX.sym(name, *values.shape) for name, values in varied.items()}
    arrays = {name: _array(symbols).reshape(own[name].shape) for name, symbols in taken.items()}
    p = symbolic(numbers)._replace(**arrays)
    for name, (equation, arguments) in EQUATIONS.items():
        symbols = [casadi.SX.sym(argument, arm.n) for argument in arguments]
        value = equation(np, tree, p, *(_array(x)[:, 0] for x in symbols))
        out = _matrix(casadi, value)
        given, names = [*symbols, *taken.values()], [*arguments, *taken]
        functions[name] = casadi.Function(name, given, [out], names, [name])
        if name == "S":
            gradient = casadi.gradient(out, symbols[0])
            function = casadi.Function("S_gradient", given, [gradient], names, ["S_gradient"])
            functions["S_gradient"] = function
    return CasadiArm(name=arm.name, parameters=varied, **functions)


def _array(symbols: Any) -> np.ndarray[Any, Any]:
    """Return a matrix of symbols as an array of single ones."""
    array = np.empty(symbols.shape, dtype=object)
    for index in np.ndindex(array.shape):
        array[index] = symbols[index]
    return array


def _flat(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return an array as CasADi has it: a matrix, of several axes the first joined."""
    return values.reshape(-1, values.shape[-1]) if values.ndim > 1 else values[:, None]


def _matrix(casadi: Any, value: Any) -> Any:
    """Return an array of symbols as a matrix of CasADi."""
    if not isinstance(value, np.ndarray):
        return casadi.SX(value)
    return casadi.vertcat(*(casadi.horzcat(*row) for row in _flat(value)))
