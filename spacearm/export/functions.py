"""An arm as functions of JAX, of CasADi, and of C.

The C is a header and a source that need nothing but <math.h>.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.compiler import symbols
from spacearm.compiler.c_code import Code, elements, fields, initialiser, number, operations
from spacearm.compiler.symbols import Shape, derivatives, trace
from spacearm.equations import dynamics, kinematics, measures
from spacearm.equations import servo as ticks
from spacearm.equations.kinematics import Parameters, Structure
from spacearm.equations.linear_algebra import bidiagonal
from spacearm.equations.measures import distance, singularity
from spacearm.equations.servo import Limits, Memory, Seen, Tick, packed, shapes, unpacked
from spacearm.errors import ConfigurationError, UnsupportedError, imported, require_known
from spacearm.files import name_part, write_together, writing
from spacearm.mechanics.arm_kernels import parameters_of, structure_of
from spacearm.mechanics.distance import FADING
from spacearm.mechanics.jacobian import plane_of_motion
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_scales
from spacearm.servo.servo import Servo
from spacearm.signatures import checked

Function = Callable[..., Any]

#: Equations, called as equation(xp, structure, parameters, *arguments), with the names of their
#: arguments, each (n,). `S_gradient` comes with `S`.
EQUATIONS: dict[str, tuple[Function, tuple[str, ...]]] = {
    "jacobian": (kinematics.jacobian, ("q",)),
    "task_jacobian": (kinematics.task_jacobian, ("q",)),
    "connection": (kinematics.connection, ("q",)),
    "momentum": (kinematics.momentum, ("q",)),
    "base_inertia": (kinematics.base_inertia, ("q",)),
    "centre": (kinematics.centre, ("q",)),
    "tip_position": (kinematics.tip_position, ("q",)),
    "tip_rotation": (kinematics.tip_rotation, ("q",)),
    "S": (measures.singularity, ("q",)),
    "generalized_inertia": (dynamics.generalized_inertia, ("q",)),
    "forward_dynamics": (dynamics.forward_dynamics, ("q", "dq", "tau")),
}


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


@checked
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
    jax = imported("jax", "JAX", "jax")
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
    numbers = jax.tree_util.tree_map(jax.numpy.asarray, own)
    return ArmFunctions(name=arm.name, parameters=numbers, **compiled)


@checked
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
    casadi = imported("casadi", "CasADi", "casadi")
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
    require_known("parameter", wanted, Parameters._fields)
    return wanted


#: Rounding of the bounds of sigma_min, as a share of |T|, for each element of T.
ROUNDING = 16.0 * 2.0**-52


class Exported(NamedTuple):
    """A function of C.

    Attributes:
        comment: What the header says of it.
        function: Called as function(xp, structure, parameters, *arguments).
        arguments: Names of arrays (n,) that it takes.
        outputs: Names of the arrays and numbers that it writes, in order.
        returned: Name of the number that it returns, which is its first; empty if there is none.
        jacobian: Whether `function` is called with J* (6 tips, n) in place of the arguments.
    """

    comment: str
    function: Callable[..., Any]
    arguments: tuple[str, ...]
    outputs: tuple[str, ...]
    returned: str = ""
    jacobian: bool = False


def singularity_gradient(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute S and its gradient (n,) by the joints."""
    S = singularity(xp, tree, p, q)
    return S, derivatives(S, q)


def sigma_min(xp: Any, tree: Structure, _: Parameters, J: Any) -> Any:
    """Compute bounds of the least singular value of the task Jacobian from J*."""
    if tree.n < len(tree.rows):  # singular everywhere
        return 0.0, 0.0
    T = tree.scale * J[np.array(tree.rows)]
    form = bidiagonal(xp, T)
    sigma = xp.sqrt(form.least(xp))
    margin = ROUNDING * T.size * xp.sqrt((T * T).sum())
    return xp.maximum(sigma - margin, 0.0), sigma + margin


def distance_to_set(xp: Any, tree: Structure, p: Parameters, q: Any, *, unit: Array) -> Any:
    """Compute the distance to the singular set to first order, and the way out (n,)."""
    if tree.n < len(tree.rows):  # singular everywhere
        return 0.0, 0.0 * unit
    far, _, rows = distance(xp, tree, p, q, FADING, unit)
    return far, unit * rows[0]


#: The functions of C, by what their names end with.
EXPORTED = {
    "jacobian": Exported(
        "J*, the motion of the tip per joint rate: rows [linear; angular], row by row.",
        *EQUATIONS["jacobian"], ("J",),
    ),
    "connection": Exported(
        "-D^-1 D_q: the spacecraft turns with w_0 = connection dq at zero momentum, row by row.",
        *EQUATIONS["connection"], ("connection",),
    ),
    "momentum": Exported(
        "A_q, momentum [linear; angular about the system CM] per joint rate, row by row.",
        *EQUATIONS["momentum"], ("A",),
    ),
    "forward_dynamics": Exported(
        "Joint accelerations at zero momentum, without external wrenches.",
        *EQUATIONS["forward_dynamics"], ("ddq",),
    ),
    "singularity": Exported(
        "S, zero exactly where the task Jacobian is singular.", *EQUATIONS["S"], (), "S"
    ),
    "singularity_gradient": Exported(
        "S, and its gradient by the joints.", singularity_gradient, ("q",), ("gradient",), "S"
    ),
    "sigma_min": Exported(
        "Bounds of the least singular value of the task Jacobian.",
        sigma_min, ("q",), ("lower", "upper"), jacobian=True,
    ),
    "distance": Exported(
        "Distance to the singular set to first order [rad], INFINITY where nothing leads there,\n"
        " * and away, the motion of the joints per radian of it.",
        distance_to_set, ("q",), ("away",), "distance",
    ),
}  # fmt: skip


@checked
def to_c(
    arm: SpaceArm,
    folder: str | os.PathLike[str],
    *,
    mode: BaseMode = "free-floating",
    parameters: str | Sequence[str] = (),
    servo: Servo | bool = False,
) -> tuple[Path, Path]:
    """Write an arm as C99: J*, momentum, dynamics, S, sigma_min, the distance to the singular set.

    Header and source are written together: after an error both are what they were before. The code
    needs nothing but <math.h>, allocates nothing and keeps no state; loops have a bound, and
    nothing is recursive.
    Names in the code begin with the name of the arm, NAME here; matrices are written row by row, in
    spacecraft axes.

    - `NAME_jacobian(q, J)`: J* (6 tips, n) of (35).
    - `NAME_connection(q, connection)`: -D^-1 D_q (3, n) of (33c).
    - `NAME_momentum(q, A)`: A_q (6, n), [linear; angular about the system CM] per joint rate.
    - `NAME_forward_dynamics(q, dq, tau, ddq)`: joint accelerations at zero momentum.
    - `NAME_singularity(q)`: S, which is zero exactly where the task Jacobian is singular.
    - `NAME_singularity_gradient(q, gradient)`: its gradient; returns S.
    - `NAME_sigma_min(q, &lower, &upper)`: bounds of the least singular value of the task Jacobian,
      which differ by rounding.
    - `NAME_distance(q, away)`: the distance to the singular set to first order [rad], INFINITY
      where nothing leads there; `away` (n,) is its gradient, joint motion per radian of distance.

    With `parameters`, the numbers of these names are arguments: `NAME_parameters` is a struct of
    them, `NAME_nominal` holds the arm's own, and all functions take a pointer to such a struct
    after q, dq and tau. `NAME_singularity_by_parameters(q, p, &gradient)` writes the gradient of S
    by them into another.

    With `servo`, `NAME_servo_step(&seen, &limits, &memory, &tick)` is the step of `Servo`. Input,
    limits, memory and output are structs of numbers; `NAME_servo_nominal` holds the limits, and
    `NAME_servo_begin(q, &memory)` begins. It uses the arm's own numbers. The header says how many
    operations a step takes at most.

    Args:
        arm: The arm.
        folder: Where the files are written, NAME.h and NAME.c.
        mode: What the spacecraft does; see `generalized_jacobian`.
        parameters: Names of what the functions take in a struct: any of "masses", "centres",
            "inertias", "joint_positions", "joint_rotations", "tip_positions", "tip_rotations".
        servo: Whether to write the servo too: True for one with the defaults of `Servo`, or a servo
            of this arm, with its options and limits.

    Returns:
        The paths of header and source.

    Raises:
        ConfigurationError: There is no such mode or parameter; the servo is of another arm or mode.
        UnsupportedError: The arm can have no servo.
        SpaceArmError: The files cannot be written.

    Example:
        >>> import spacearm as sa
        >>> header, source = sa.to_c(sa.load("planar2"), ".")
        >>> "double planar2_singularity(const double q[2]);" in header.read_text()
        True
    """
    tree, numbers = structure_in(arm, mode), parameters_of(arm)
    varied = {which: np.asarray(getattr(numbers, which)) for which in chosen(parameters)}
    name = re.sub(r"\W", "_", name_part(arm.name), flags=re.ASCII)
    name = name if name[:1].isalpha() else f"arm_{name}"
    writer = _Writer(name, tree, numbers, varied)
    for ending, what in EXPORTED.items():
        if ending == "distance":
            what = what._replace(function=partial(what.function, unit=joint_scales(arm)))
        writer.write(ending, what)
    if servo:
        servo = Servo(arm, mode=mode) if servo is True else servo
        if servo.arm is not arm or servo.mode != mode:
            raise ConfigurationError(
                f"servo is one of {servo.arm.name}, {servo.mode}; give one of this arm, {mode}"
            )
        declared, defined = _servo_code(writer.code, name, tree, writer.numbers, servo)
        writer.declarations.append(declared)
        writer.definitions.append(defined)
    words = {"name": name, "NAME": name.upper(), "arm": _comment(arm), "mode": mode}
    words |= {"N": str(tree.n), "K": str(len(tree.rows))}
    if varied:
        writer.write_by_parameters()
        words["fields"] = fields(writer.shapes)
        words["values"] = ",\n".join(f"    {initialiser(values)}" for values in varied.values())
    struct = template("parameters.h").substitute(words) if varied else ""
    declarations = "\n".join(writer.declarations)
    header = template("arm.h").substitute(words, struct=struct, declarations=declarations)
    source = "\n".join((
        template("arm.c").substitute(words),
        *([template("parameters.c").substitute(words)] if varied else []),
        *writer.code.functions,
        *writer.definitions,
    ))  # fmt: skip
    header_path = Path(folder) / f"{name}.h"
    source_path = Path(folder) / f"{name}.c"
    texts = {header_path: header, source_path: source}
    write_together({path: writing(text.encode()) for path, text in texts.items()})
    return header_path, source_path


class _Writer:
    """The functions of an arm as C.

    Args:
        name: What their names begin with.
        tree: The structure of the arm.
        numbers: Its numbers.
        varied: Those that the functions take.
    """

    def __init__(
        self, name: str, tree: Structure, numbers: Parameters, varied: dict[str, Array]
    ) -> None:
        self.name, self.tree, self.varied = name, tree, varied
        self.shapes: dict[str, Shape] = {which: x.shape for which, x in varied.items()}
        self.numbers = symbolic(numbers)
        self.code = Code(f"{name}_part")
        self.declarations: list[str] = []
        self.definitions: list[str] = []

    def write(self, ending: str, what: Exported) -> None:
        """Write a function."""

        def function(**given: Any) -> Any:
            p = self.numbers._replace(**{which: given.pop(which) for which in self.varied})
            return what.function(symbols, self.tree, p, *given.values())

        shapes: dict[str, Shape] = dict.fromkeys(what.arguments, (self.tree.n,))
        if what.jacobian:
            shapes = {"J": (6 * len(self.tree.tips), self.tree.n)}
        traced = trace(function, shapes | self.shapes)
        wanted, texts = [], [what.returned] if what.returned else []
        for name, output in zip(what.outputs, traced.outputs[len(texts) :], strict=True):
            shape = np.shape(output)
            wanted.append(f"double {name}[{' * '.join(map(str, shape))}]" if shape
                          else f"double *{name}")  # fmt: skip
            texts += ([f"{name}[{i}]" for i in range(int(np.prod(shape)))] if shape
                      else [f"*{name}"])  # fmt: skip
        self._finish(ending, what, traced, wanted, texts)

    def write_by_parameters(self) -> None:
        """Write S with its gradient by the numbers that the functions take."""

        def function(q: Any, **varied: Any) -> Any:
            S = singularity(symbols, self.tree, self.numbers._replace(**varied), q)
            return S, *(derivatives(S, symbol) for symbol in varied.values())

        shapes = {"q": (self.tree.n,)} | self.shapes
        what = Exported("S, and its gradient by the parameters.", singularity, ("q",), (), "S")
        texts = ["S", *elements(self.shapes, "gradient->")]
        wanted = [f"{self.name}_parameters *gradient"]
        self._finish("singularity_by_parameters", what, trace(function, shapes), wanted, texts)

    def _finish(
        self, ending: str, what: Exported, traced: Any, wanted: list[str], texts: list[str]
    ) -> None:
        """Write declaration and definition of a function whose outputs are `wanted`."""
        given = [f"const double {name}[{self.tree.n}]" for name in what.arguments]
        given += [f"const {self.name}_parameters *p"] if self.varied else []
        names = [*what.arguments, *(["p"] if self.varied else [])]
        inputs = [f"{name}[{i}]" for name, shape in traced.inputs.items()
                  if name not in self.varied for i in range(int(np.prod(shape)))]  # fmt: skip
        body = self.code.body(traced, [*inputs, *elements(self.shapes, "p->")], texts)
        if what.jacobian and "J[" in body:
            call = f"{self.name}_jacobian({', '.join(names)}, J);"
            body = f"    double J[{len(inputs)}];\n    {call}\n{body}"
        unused = [f"    (void){name};\n" for name in names if not re.search(rf"\b{name}\b", body)]
        kind = "double" if what.returned else "void"
        head = f"{kind} {self.name}_{ending}({', '.join((*given, *wanted))})"
        first = f"    double {what.returned};\n" if what.returned else ""
        last = f"    return {what.returned};\n" if what.returned else ""
        self.declarations.append(f"/* {what.comment} */\n{head};\n")
        self.definitions.append(f"{head}\n{{\n{first}{''.join(unused)}{body}\n{last}}}\n")


def _comment(arm: SpaceArm) -> str:
    """Return what the header says of the arm; nothing of it can end the comment."""
    text = f"{arm.name}: joints {', '.join(arm.joint_names)}; tip {', '.join(arm.tips)}; "
    text += f"task {arm.task.names}"
    return re.sub(r"[^ -~]|[*/\\?]", "_", text)


# --- the servo as C: structs of input, limits, memory and output, and a step ----------

#: The structs by what their names end with.
STRUCTS = {"seen": Seen, "limits": Limits, "memory": Memory, "tick": Tick}
#: Those that a step reads.
TAKEN = ("seen", "limits", "memory")


def _servo_code(
    code: Code, name: str, tree: Structure, numbers: Parameters, servo: Servo
) -> tuple[str, str]:
    """Return declarations and definitions of a servo as C.

    Args:
        code: Takes the functions of its parts.
        name: What all names begin with.
        tree: The structure of the arm.
        numbers: Its numbers, as arrays of objects.
        servo: The servo, whose options are compiled in and whose limits are a constant.
    """
    n, tips = tree.n, len(tree.tips)

    def step(**given: Any) -> Any:
        seen, limits, memory = (unpacked(STRUCTS[x], given[x], n, tips) for x in TAKEN)
        tick, memory = ticks.step(
            symbols, tree, numbers, seen, limits, memory, servo.frame, servo.keep_attitude
        )
        return packed((*tick, *memory), symbols)

    traced = trace(step, {ending: (ticks.size(STRUCTS[ending], n, tips),) for ending in TAKEN})
    known = {ending: shapes(kind, n, tips) for ending, kind in STRUCTS.items()}
    inputs = [text for ending in TAKEN for text in elements(known[ending], f"{ending}->")]
    outputs = [*elements(known["tick"], "tick->"), *elements(known["memory"], "next.")]
    body = code.body(traced, inputs, outputs)
    values = map(number, packed(ticks.unknowing(n, np.zeros(n))))
    start = dict(zip(elements(known["memory"]), values, strict=True))
    start |= {f"q[{i}]": f"q[{i}]" for i in range(n)}
    structs = (
        f"typedef struct {{\n{fields(of)}\n}} {name}_servo_{ending};\n"
        for ending, of in known.items()
    )
    words = {
        "name": name, "N": str(n), "body": body,
        "start": "\n".join(f"    memory->{place} = {x};" for place, x in start.items()),
        "operations": f"{operations(traced):,}", "structs": "\n".join(structs),
        "values": ",\n".join(f"    {initialiser(value)}" for value in servo.limits),
        "frame": servo.frame, "causes": ", ".join(ticks.CAUSES),
        "halts": ", ".join(f"{i} {halt}" for i, halt in enumerate(ticks.HALTS) if halt),
    }  # fmt: skip
    return template("servo.h").substitute(words), template("servo.c").substitute(words)


def template(name: str) -> Template:
    """Return a text of the folder c, in which words with a dollar sign stand for others."""
    return Template(Path(__file__).with_name("c").joinpath(name).read_text(encoding="utf-8"))
