"""An arm as C: a header and a source that need nothing but <math.h>."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from math import sqrt
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from spacearm.arrays import Array
from spacearm.export import equations
from spacearm.export.c_code.expressions import Expression, Operand, Tape
from spacearm.export.c_code.straight_line import body, number
from spacearm.export.c_code.templates import (
    BY_PARAMETERS,
    HEADER,
    MORE,
    NEVER,
    NOMINAL,
    REDUNDANT,
    SOURCE,
    STRUCT,
)
from spacearm.export.functions import structure_in
from spacearm.export.parameters import Parameters, Structure, chosen, parameters_of, symbolic
from spacearm.files import name_part, write
from spacearm.model.arguments import of_arm
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode

SQUARINGS = 10
"""How often the inverse is squared; the bounds of sigma_min differ by K^(2^-11) then."""
ROUNDING = 16.0 * 2.0**-52
"""Rounding of the bounds, as a share of |J|, for each of the K N elements."""


@of_arm
def to_c(
    arm: SpaceArm,
    folder: str | os.PathLike[str],
    *,
    mode: BaseMode = "free-floating",
    parameters: str | Sequence[str] = (),
) -> tuple[Path, Path]:
    """Write an arm as C99: J*, S, its gradient and bounds of sigma_min.

    The code needs nothing but sin, cos, sqrt and fabs, allocates nothing and keeps no state. J*, S
    and the gradient are computed without a branch or a loop. Names in the code begin with the name
    of the arm, NAME here.

    - `NAME_jacobian(q, J)`: J* of (35), row by row, in spacecraft axes.
    - `NAME_singularity(q)`: S, which is zero exactly where the task Jacobian is singular.
    - `NAME_singularity_gradient(q, gradient)`: its gradient; returns S.
    - `NAME_sigma_min(q, &lower, &upper)`: bounds of the least singular value of the task Jacobian,
      0.1 percent apart or less.

    With `parameters`, the numbers of that name are no constants: `NAME_parameters` is a struct of
    them, `NAME_nominal` the arm's own, and all functions take a pointer to one after q.
    `NAME_singularity_by_parameters(q, p, &gradient)` writes the gradient of S by them into another.

    Args:
        arm: The arm.
        folder: Where the files are written, NAME.h and NAME.c.
        mode: What the spacecraft does; see `generalized_jacobian`.
        parameters: Names of what the functions take in a struct: any of "masses", "centres",
            "inertias", "joint_positions", "joint_rotations", "tip_positions", "tip_rotations".

    Returns:
        The paths of header and source.

    Raises:
        ConfigurationError: There is no such mode or parameter.

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
    words = {
        "name": name,
        "NAME": name.upper(),
        "arm": _comment(arm),
        "mode": mode,
        "N": str(tree.n),
        "K": str(len(tree.rows)),
        "R": str(6 * len(tree.tips)),
        "rows": ", ".join(map(str, tree.rows)),
        "scale": ", ".join(number(factor) for factor in tree.scale[:, 0]),
        "squarings": str(SQUARINGS),
        "spread": number(sqrt(len(tree.rows) ** (2.0**-SQUARINGS))),
        "rounding": number(ROUNDING * tree.n * len(tree.rows)),
        **_struct(name, tree.n, varied),
        **_bodies(tree, numbers, varied),
    }
    parts = [
        SOURCE,
        *([BY_PARAMETERS] if varied else []),
        REDUNDANT if tree.n >= len(tree.rows) else NEVER,
    ]
    texts = (HEADER.substitute(words), "".join(part.substitute(words) for part in parts))
    paths = (Path(folder) / f"{name}{suffix}" for suffix in (".h", ".c"))
    header, source = (write(path, text.encode()) for path, text in zip(paths, texts, strict=True))
    return header, source


def _struct(name: str, n: int, varied: Mapping[str, Array]) -> dict[str, str]:
    """Return what the code has besides if it takes numbers of the arm."""
    if not varied:
        return dict.fromkeys(("p", "given", "unused", "declarations", "constants", "more"), "")
    words = {
        "name": name,
        "N": str(n),
        "fields": "\n".join(
            f"    double {which}{''.join(f'[{size}]' for size in values.shape)};"
            for which, values in varied.items()
        ),
        "values": ",\n".join(f"    {_braces(values)}" for values in varied.values()),
    }
    return {
        "p": f", const {name}_parameters *p",
        "given": ", p",
        "unused": "\n    (void)p;",
        "declarations": STRUCT.substitute(words),
        "constants": NOMINAL.substitute(words),
        "more": MORE.substitute(words),
    }


def _braces(values: Array) -> str:
    """Return numbers as C initialises arrays of arrays."""
    inner = (_braces(row) if np.ndim(row) else number(row) for row in values)
    return f"{{{', '.join(inner)}}}"


def _bodies(tree: Structure, numbers: Parameters, varied: Mapping[str, Array]) -> dict[str, str]:
    """Return the bodies of the functions; `varied` are the numbers that they take."""
    tape = Tape()
    variables = [tape.variable(f"q[{j}]") for j in range(tree.n)]
    q = np.array(variables, dtype=object)
    symbols = {which: _variables(tape, which, values.shape) for which, values in varied.items()}
    p = symbolic(numbers)._replace(**symbols)
    by = [symbol for array in symbols.values() for symbol in array.ravel()]
    J = equations.jacobian(SYMBOLS, tree, p, q)
    S = equations.singularity(SYMBOLS, tree, p, q)
    gradient = tape.gradient(S, [*variables, *by])
    slopes = {f"gradient[{j}]": slope for j, slope in enumerate(gradient[: tree.n])}
    names = (symbol.name.replace("p->", "gradient->") for symbol in by)
    others = dict(zip(names, gradient[tree.n :], strict=True))
    arguments = ("q", "p") if varied else ("q",)
    outputs: dict[str, dict[str, Operand]] = {
        "jacobian": {f"J[{i}]": e for i, e in enumerate(J.ravel())},
        "singularity": {"S": S},
        "gradient": {"S": S, **slopes},
    }
    if varied:
        outputs["by_parameters"] = {"S": S, **others}
    return {name: body(tape, arguments, wanted) for name, wanted in outputs.items()}


def _variables(tape: Tape, which: str, shape: tuple[int, ...]) -> Any:
    """Return variables that stand for the elements of an array of the struct."""
    made = np.empty(shape, dtype=object)
    for index in np.ndindex(shape):
        made[index] = tape.variable(f"p->{which}{''.join(f'[{i}]' for i in index)}")
    return made


def _comment(arm: SpaceArm) -> str:
    """Return what the header says of the arm; nothing of it can end the comment."""
    text = f"{arm.name}: joints {', '.join(arm.joint_names)}; tip {', '.join(arm.tips)}; "
    text += f"task {arm.task.names}"
    return re.sub(r"[^ -~]|[*/\\?]", "_", text)


def _function(name: str) -> Any:
    """Return sine or cosine of an array of expressions and numbers."""

    def of(operand: Operand) -> Operand:
        known = isinstance(operand, Expression)
        return getattr(operand, name)() if known else float(getattr(np, name)(operand))

    return np.vectorize(of, otypes=[object])


SYMBOLS = SimpleNamespace(
    sin=_function("sin"), cos=_function("cos"),
    stack=np.stack, concatenate=np.concatenate, cross=np.cross,
)  # fmt: skip
"""The array library for expressions, some of which may have become numbers."""
