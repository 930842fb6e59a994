"""An arm as C: a header and a source that need nothing but <math.h>."""

from __future__ import annotations

import os
import re
from math import sqrt
from pathlib import Path
from string import Template
from types import SimpleNamespace
from typing import Any

import numpy as np

from spacearm.export import equations
from spacearm.export.expressions import Expression, Operand, Tape
from spacearm.export.functions import structure_in
from spacearm.export.parameters import Structure, parameters_of, symbolic
from spacearm.export.straight_line import body, number
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
    arm: SpaceArm, folder: str | os.PathLike[str], *, mode: BaseMode = "free-floating"
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

    Args:
        arm: The arm.
        folder: Where the files are written, NAME.h and NAME.c.
        mode: What the spacecraft does; see `generalized_jacobian`.

    Returns:
        The paths of header and source.

    Raises:
        ConfigurationError: There is no such mode.

    Example:
        >>> import spacearm as sa
        >>> header, source = sa.to_c(sa.load("planar2"), ".")
        >>> "double planar2_singularity(const double q[2]);" in header.read_text()
        True
    """
    tree = structure_in(arm, mode)
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
        **_bodies(arm, tree),
    }
    parts = [SOURCE, REDUNDANT if tree.n >= len(tree.rows) else NEVER]
    texts = (HEADER.substitute(words), "".join(part.substitute(words) for part in parts))
    paths = (Path(folder) / f"{name}{suffix}" for suffix in (".h", ".c"))
    header, source = (write(path, text.encode()) for path, text in zip(paths, texts, strict=True))
    return header, source


def _bodies(arm: SpaceArm, tree: Structure) -> dict[str, str]:
    """Return the bodies of the functions."""
    tape = Tape()
    variables = [tape.variable(f"q[{j}]") for j in range(tree.n)]
    q = np.array(variables, dtype=object)
    p = symbolic(parameters_of(arm))
    J = equations.jacobian(SYMBOLS, tree, p, q)
    S = equations.singularity(SYMBOLS, tree, p, q)
    gradient = tape.gradient(S, variables)
    slopes = {f"gradient[{j}]": slope for j, slope in enumerate(gradient)}
    return {
        "jacobian": body(tape, {f"J[{i}]": e for i, e in enumerate(J.ravel())}),
        "singularity": body(tape, {"S": S}),
        "gradient": body(tape, {"S": S, **slopes}),
    }


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

HEADER = Template("""\
/* $arm.
 * The spacecraft is $mode. Written by spacearm; SI units, radians, spacecraft axes. */
#ifndef ${NAME}_H
#define ${NAME}_H

#define ${NAME}_JOINTS $N
#define ${NAME}_ROWS $K

#ifdef __cplusplus
extern "C" {
#endif

/* J*, the motion of the tip per joint rate: $R rows [linear; angular] of $N, row by row. */
void ${name}_jacobian(const double q[$N], double J[$R * $N]);

/* S, zero exactly where the task Jacobian is singular. */
double ${name}_singularity(const double q[$N]);

/* S, and its gradient by the joints. */
double ${name}_singularity_gradient(const double q[$N], double gradient[$N]);

/* Bounds of the least singular value of the $K by $N task Jacobian. */
void ${name}_sigma_min(const double q[$N], double *lower, double *upper);

#ifdef __cplusplus
}
#endif
#endif
""")

SOURCE = Template("""\
#include "$name.h"

#include <math.h>

void ${name}_jacobian(const double q[$N], double J[$R * $N])
{
$jacobian
}

double ${name}_singularity(const double q[$N])
{
    double S;
$singularity
    return S;
}

double ${name}_singularity_gradient(const double q[$N], double gradient[$N])
{
    double S;
$gradient
    return S;
}
""")

NEVER = Template("""
void ${name}_sigma_min(const double q[$N], double *lower, double *upper)
{
    (void)q; /* fewer joints than task rows: singular everywhere */
    *lower = 0.0;
    *upper = 0.0;
}
""")

REDUNDANT = Template("""
/* With T the task Jacobian and T^T = Q R (Householder), sigma_min of T is that of R. The largest
 * eigenvalue of B = R^-1 R^-T is b = sigma_min^-2, and b^p <= tr(B^p) <= $K b^p for every p.
 * B is squared $squarings times, scaled to trace 1 each time, so that p = 2^$squarings. */
void ${name}_sigma_min(const double q[$N], double *lower, double *upper)
{
    static const int rows[$K] = {$rows};
    static const double scale[$K] = {$scale};
    double J[$R * $N], A[$N][$K], W[$K][$K], B[$K][$K], C[$K][$K];
    double trace[$squarings + 1], size = 0.0, margin, mean;
    int i, j, k, s;

    ${name}_jacobian(q, J);
    for (i = 0; i < $N; i++) {
        for (j = 0; j < $K; j++) {
            A[i][j] = scale[j] * J[rows[j] * $N + i];
            size += A[i][j] * A[i][j];
        }
    }
    size = sqrt(size);
    margin = $rounding * size;
    for (k = 0; k < $K; k++) { /* R, in the upper triangle of A */
        double norm = 0.0, share;
        for (i = k; i < $N; i++) {
            norm += A[i][k] * A[i][k];
        }
        norm = A[k][k] > 0.0 ? -sqrt(norm) : sqrt(norm);
        if (!(fabs(norm) > margin)) { /* sigma_min is at most what stands on the diagonal */
            *lower = 0.0;
            *upper = fabs(norm) + margin;
            return;
        }
        A[k][k] -= norm;
        for (j = k + 1; j < $K; j++) {
            share = 0.0;
            for (i = k; i < $N; i++) {
                share += A[i][k] * A[i][j];
            }
            share /= norm * A[k][k];
            for (i = k; i < $N; i++) {
                A[i][j] += share * A[i][k];
            }
        }
        A[k][k] = norm;
    }
    for (j = 0; j < $K; j++) { /* W = R^-1 */
        for (i = $K - 1; i >= 0; i--) {
            double rest = i == j ? 1.0 : 0.0;
            for (k = i + 1; k <= j; k++) {
                rest -= A[i][k] * W[k][j];
            }
            W[i][j] = i > j ? 0.0 : rest / A[i][i];
        }
    }
    trace[0] = 0.0;
    for (i = 0; i < $K; i++) {
        for (j = 0; j < $K; j++) {
            B[i][j] = 0.0;
            for (k = 0; k < $K; k++) {
                B[i][j] += W[i][k] * W[j][k];
            }
        }
        trace[0] += B[i][i];
    }
    for (s = 1; s <= $squarings; s++) {
        trace[s] = 0.0;
        for (i = 0; i < $K; i++) {
            for (j = 0; j < $K; j++) {
                C[i][j] = B[i][j] / trace[s - 1];
            }
        }
        for (i = 0; i < $K; i++) {
            for (j = 0; j < $K; j++) {
                B[i][j] = 0.0;
                for (k = 0; k < $K; k++) {
                    B[i][j] += C[i][k] * C[k][j];
                }
            }
            trace[s] += B[i][i];
        }
    }
    mean = trace[$squarings]; /* tr(B^p)^(1/p) */
    for (s = $squarings - 1; s >= 0; s--) {
        mean = trace[s] * sqrt(mean);
    }
    mean = 1.0 / sqrt(mean);
    *lower = mean > margin ? mean - margin : 0.0;
    *upper = mean * $spread + margin;
}
""")
