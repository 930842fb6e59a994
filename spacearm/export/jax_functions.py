"""An arm as functions of JAX."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from spacearm.equations.structure import Parameters
from spacearm.errors import UnsupportedError
from spacearm.export.functions import EQUATIONS, Equation, structure_in
from spacearm.mechanics.many import parameters_of
from spacearm.model.arguments import of_arm
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode

Function = Callable[..., Any]


@dataclass(frozen=True, eq=False, repr=False)
class JaxArm:
    """The functions of `to_jax`: each is f(q) or f(q, parameters).

    Attributes:
        name: Name of the arm.
        parameters: Its masses, inertias, joint and tip placements.
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
        forward_dynamics: f(q, dq, tau) or f(q, dq, tau, parameters): (n,) joint accelerations.
    """

    name: str
    parameters: Parameters
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
        return f"JaxArm({self.name}: {', '.join((*EQUATIONS, 'S_gradient'))})"


@of_arm
def to_jax(arm: SpaceArm, *, mode: BaseMode = "free-floating") -> JaxArm:
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
    try:
        jax = import_module("jax")
    except ImportError:
        raise UnsupportedError("JAX is not installed: pip install 'spacearm[jax]'") from None
    if not jax.config.jax_enable_x64:
        raise UnsupportedError(
            "JAX computes with 32 bits, which are too few near singular configurations: call "
            "jax.config.update('jax_enable_x64', True) first"
        )
    tree, own = structure_in(arm, mode), parameters_of(arm)

    def bound(equation: Equation, arguments: tuple[str, ...]) -> Function:
        def function(*given: Any) -> Any:
            numbers = given[: len(arguments)]
            p = given[-1] if len(given) > len(arguments) else own
            return equation(jax.numpy, tree, p, *(jax.numpy.asarray(x, float) for x in numbers))

        return function

    functions = {name: bound(*what) for name, what in EQUATIONS.items()}
    functions["S_gradient"] = jax.grad(functions["S"])
    compiled = {name: jax.jit(function) for name, function in functions.items()}
    return JaxArm(name=arm.name, parameters=own, **compiled)
