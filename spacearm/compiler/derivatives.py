"""Derivatives of expressions, from the last operation back (reverse mode).

Griewank & Walther, Evaluating Derivatives, 2nd ed., SIAM 2008, chapter 3. All derivatives of one
expression together take a few times as many operations as the expression itself. What stands in
`hold`, and all comparisons, have derivatives zero; results of loops and procedures have none.
"""

from __future__ import annotations

from typing import Any, TypeGuard

import numpy as np

from spacearm.compiler.expressions import (
    Expression,
    Operand,
    Symbols,
    Tape,
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
            and any(_of(o, of.tape) and o.number in depends for o in e.operands)
        ):
            depends.add(e.number)
    slopes: dict[int, Operand] = {of.number: 1.0}
    for e in reversed(needed):
        if e.number in depends and e.operation != "var" and e.number in slopes:
            for i, o in enumerate(e.operands):
                if _of(o, of.tape) and o.number in depends:
                    share = _share(e, slopes[e.number], i)
                    slopes[o.number] = add(slopes.get(o.number, 0.0), share)
    found.ravel()[:] = [
        slopes.get(o.number, 0.0) if isinstance(o, Expression) else 0.0 for o in by.ravel()
    ]
    return found.view(Symbols)


def _of(o: Operand, tape: Tape) -> TypeGuard[Expression]:
    """Tell whether an operand is an expression of a tape."""
    return type(o) is Expression and o.tape is tape


def _share(e: Expression, slope: Operand, i: int) -> Any:
    """Return a derivative by an operation times that of the operation by its operand i."""
    a, b = (*e.operands, 0.0)[:2]
    match e.operation:
        case "add":
            return slope
        case "sub":
            return negative(slope) if i else slope
        case "mul":
            return multiply(slope, e.operands[1 - i])
        case "neg":
            return negative(slope)
        case "div":
            share = multiply(slope, divide(1.0, b))
            return negative(multiply(e, share)) if i else share
        case "select":
            return select(a, slope, 0.0) if i == 1 else select(a, 0.0, slope)
        case "min" | "max":
            first = operation("lt", a, b) if e.operation == "min" else operation("lt", b, a)
            return select(first, 0.0, slope) if i else select(first, slope, 0.0)
    function = FUNCTIONS.get(e.operation)
    if function is None or function.slopes is None:
        raise TracingError(f"no derivative is taken through a {e.operation}")
    return multiply(slope, function.slopes(operation, e, *e.operands)[i])
