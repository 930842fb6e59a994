"""Derivatives of expressions, from the last operation back (reverse mode).

Griewank & Walther, Evaluating Derivatives, 2nd ed., SIAM 2008, chapter 3. All derivatives of one
expression together take a few times as many operations as the expression itself. What stands in
`hold`, and all comparisons, have derivatives zero; results of loops and procedures have none.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from spacearm.compiler.expressions import (
    Expression,
    Operand,
    Symbols,
    TracingError,
    add,
    asarray,
    divide,
    multiply,
    negative,
    operation,
    select,
)
from spacearm.compiler.operations import FUNCTIONS

CONSTANT = ("hold", "lt", "le", "and", "or", "not", "rint", "floor", "ceil", "sign")
"""Operations whose derivatives are zero."""


def gradient(of: Operand, by: Any) -> Any:
    """Return the derivatives of an expression by an array of variables, in the shape of these.

    Where `by` has numbers in place of variables, the derivatives are zero. Of a selection only the
    side that is taken counts; but if the derivative of the other is infinite there, 0 times that is
    NaN, and the operand must be selected as well.

    Raises:
        TracingError: The expression depends on the variables through a loop, procedure or table, or
            stands in another loop than they.
    """
    by = asarray(by)
    variables = [o for o in by.ravel() if isinstance(o, Expression)]
    found = np.zeros(by.shape, dtype=object)
    found[...] = 0.0
    if not isinstance(of, Expression) or not variables:
        return found.view(Symbols)
    if any(o.tape is not of.tape for o in variables):
        if all(o.tape.depth > of.tape.depth for o in variables):
            return found.view(Symbols)
        raise TracingError("an expression and variables of its derivative stand in other loops")
    numbers = {o.number for o in variables}
    needed = of.tape.needed([of])
    depends: set[int] = set()
    for e in needed:
        if e.number in numbers or (
            e.operation not in CONSTANT
            and any(o.number in depends for o in e.expressions() if o.tape is of.tape)
        ):
            depends.add(e.number)
    slopes: dict[int, Operand] = {of.number: 1.0}
    for e in reversed(needed):
        if e.number in depends and e.operation != "var" and e.number in slopes:
            for o, share in zip(e.operands, _shares(e, slopes[e.number]), strict=True):
                if isinstance(o, Expression) and o.tape is of.tape and o.number in depends:
                    slopes[o.number] = add(slopes.get(o.number, 0.0), share)
    found.ravel()[:] = [
        slopes.get(o.number, 0.0) if isinstance(o, Expression) else 0.0 for o in by.ravel()
    ]
    return found.view(Symbols)


def _shares(e: Expression, slope: Operand) -> tuple[Any, ...]:
    """Return a derivative by an operation times those of the operation by its operands."""
    a, b = (*e.operands, 0.0)[:2]
    match e.operation:
        case "add":
            return slope, slope
        case "sub":
            return slope, negative(slope)
        case "mul":
            return multiply(slope, b), multiply(slope, a)
        case "neg":
            return (negative(slope),)
        case "div":
            share = multiply(slope, divide(1.0, b))
            return share, negative(multiply(e, share))
        case "select":
            return 0.0, select(a, slope, 0.0), select(a, 0.0, slope)
        case "min" | "max":
            first = operation("lt", a, b) if e.operation == "min" else operation("lt", b, a)
            return select(first, slope, 0.0), select(first, 0.0, slope)
    function = FUNCTIONS.get(e.operation)
    if function is None or function.slopes is None:
        raise TracingError(f"no derivative is taken through a {e.operation}")
    return tuple(multiply(slope, factor) for factor in function.slopes(operation, e, *e.operands))
