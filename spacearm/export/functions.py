"""An arm as functions of JAX and CasADi, and what all exported functions need to know of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

from spacearm.equations import dynamics, jacobian, measures, posture
from spacearm.equations.structure import Parameters, Structure
from spacearm.errors import ConfigurationError, UnsupportedError, unknown
from spacearm.mechanics.many import parameters_of, structure_of
from spacearm.model.arguments import BaseMode, of_arm
from spacearm.model.arm import SpaceArm
from spacearm.singularities.polynomials import plane_of_motion

Function = Callable[..., Any]

EQUATIONS: dict[str, tuple[Function, tuple[str, ...]]] = {
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
"""Equations, called as equation(xp, structure, parameters, *arguments), with the names of their
arguments, each (n,). `S_gradient` comes with `S`."""


@dataclass(frozen=True, eq=False, repr=False)
class ArmFunctions:
    """The functions of `to_jax` and `to_casadi`: each of q and, last, of parameters.

    CasADi has matrices only: columns (n, 1), and of more axes than two the first joined.

    Attributes:
        name: Name of the arm.
        parameters: The arm's own values of the numbers that the functions take last: masses,
            inertias, joint and tip placements, of CasADi those that were chosen.
        jacobian: (6, n) J* of (35); (6 tips, n) of several tips.
        task_jacobian: (k, n) its rows that the task names, scaled.
        connection: (3, n) -D^-1 D_q of (33c): the spacecraft turns with w_0 = connection dq.
        momentum: (6, n) [linear; angular about the system CM] per unit joint rates.
        base_inertia: (3, 3) D about the system CM [kg m^2].
        centre: (3,) the system CM from the spacecraft frame [m].
        tip_position: (3,) the tip from the system CM [m]; (tips, 3) of several.
        tip_rotation: (3, 3) its attitude; (tips, 3, 3) of several.
        S: What is zero exactly at singular configurations; see `equations.measures`.
        S_gradient: (n,) its gradient by the joints.
        generalized_inertia: (n, n) H*.
        forward_dynamics: (n,) joint accelerations of (q, dq, tau).
    """

    name: str
    parameters: Any
    jacobian: Function
    task_jacobian: Function
    connection: Function
    momentum: Function
    base_inertia: Function
    centre: Function
    tip_position: Function
    tip_rotation: Function
    S: Function
    S_gradient: Function
    generalized_inertia: Function
    forward_dynamics: Function

    def __repr__(self) -> str:
        return f"ArmFunctions({self.name}: {', '.join((*EQUATIONS, 'S_gradient'))})"


@of_arm
def to_jax(arm: SpaceArm, *, mode: BaseMode = "free-floating") -> ArmFunctions:
    """Return the equations of an arm as functions of JAX, for jit, vmap and grad.

    They take joint positions q (n,) and, last, the numbers of the arm, a pytree, so that
    derivatives by masses, inertias and mounts can be taken; without it they have the arm's own.
    All are compiled by `jax.jit`, and all that they return is in spacecraft axes, points from the
    system CM.

    Args:
        arm: The arm.
        mode: What the spacecraft does; see `generalized_jacobian`.

    Returns:
        A record of functions `jacobian`, `task_jacobian`, `connection`, `momentum`, `base_inertia`,
        `centre`, `tip_position`, `tip_rotation`, `S`, `S_gradient`, `generalized_inertia` and
        `forward_dynamics(q, dq, tau)`, and of `parameters`.

    Raises:
        UnsupportedError: JAX is not installed (pip install 'spacearm[jax]'), or computes with 32
            bits.
        ConfigurationError: There is no such mode.

    Example:
        >>> import jax
        >>> import spacearm as sa
        >>> jax.config.update("jax_enable_x64", True)
        >>> fly = sa.to_jax(sa.load("planar2"))
        >>> print(fly.jacobian(jax.numpy.array([0.3, 1.2]))[:2].round(3))
        [[-0.698 -0.865]
         [ 0.339 -0.042]]
    """
    jax = _installed("jax", "JAX")
    if not jax.config.jax_enable_x64:
        raise UnsupportedError(
            "JAX computes with 32 bits, which are too few near singular configurations: call "
            "jax.config.update('jax_enable_x64', True) first"
        )
    tree, own = structure_in(arm, mode), parameters_of(arm)

    def bound(equation: Function, arguments: tuple[str, ...]) -> Function:
        def function(*given: Any) -> Any:
            numbers = given[: len(arguments)]
            p = given[-1] if len(given) > len(arguments) else own
            return equation(jax.numpy, tree, p, *(jax.numpy.asarray(x, float) for x in numbers))

        return function

    functions = {name: bound(*what) for name, what in EQUATIONS.items()}
    functions["S_gradient"] = jax.grad(functions["S"])
    compiled = {name: jax.jit(function) for name, function in functions.items()}
    return ArmFunctions(name=arm.name, parameters=own, **compiled)


@of_arm
def to_casadi(
    arm: SpaceArm, *, mode: BaseMode = "free-floating", parameters: str | Sequence[str] = ()
) -> ArmFunctions:
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
    casadi = _installed("casadi", "CasADi")
    tree, numbers, functions = structure_in(arm, mode), parameters_of(arm), dict[str, Function]()
    own = {name: np.asarray(getattr(numbers, name)) for name in chosen(parameters)}
    varied = {name: _flat(values) for name, values in own.items()}
    taken = {name: casadi.SX.sym(name, *values.shape) for name, values in varied.items()}
    arrays = {name: _array(symbols).reshape(own[name].shape) for name, symbols in taken.items()}
    p = symbolic(numbers)._replace(**arrays)
    for name, (equation, arguments) in EQUATIONS.items():
        symbols = [casadi.SX.sym(argument, arm.n) for argument in arguments]
        value = equation(np, tree, p, *(_array(x)[:, 0] for x in symbols))
        rows = _flat(value) if isinstance(value, np.ndarray) else [[value]]
        made = {name: casadi.vertcat(*(casadi.horzcat(*row) for row in rows))}
        if name == "S":
            made["S_gradient"] = casadi.gradient(made[name], symbols[0])
        given, names = [*symbols, *taken.values()], [*arguments, *taken]
        functions |= {
            name: casadi.Function(name, given, [out], names, [name]) for name, out in made.items()
        }
    return ArmFunctions(name=arm.name, parameters=varied, **functions)


def _installed(library: str, name: str) -> Any:
    """Import a library.

    Raises:
        UnsupportedError: It is not installed.
    """
    try:
        return import_module(library)
    except ImportError:
        message = f"{name} is not installed: pip install 'spacearm[{library}]'"
        raise UnsupportedError(message) from None


def _array(symbols: Any) -> npt.NDArray[Any]:
    """Return a matrix of symbols as an array of single ones."""
    array = np.empty(symbols.shape, dtype=object)
    for index in np.ndindex(array.shape):
        array[index] = symbols[index]
    return array


def _flat(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return an array as CasADi has it: a matrix, of several axes the first joined."""
    return values.reshape(-1, values.shape[-1]) if values.ndim > 1 else values[:, None]


def structure_in(arm: SpaceArm, mode: BaseMode) -> Structure:
    """Return the structure of an arm in a mode, with the normal of its plane if it has one.

    Raises:
        ConfigurationError: There is no such mode.
    """
    return replace(structure_of(arm, mode), normal=plane_of_motion(arm))


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
