"""Derivatives of expressions, from the last operation back (reverse mode).

Griewank & Walther, Evaluating Derivatives, 2nd ed., SIAM 2008, chapter 3. All derivatives of one
expression together take a few times as many operations as the expression itself. What stands in
`hold`, and all comparisons, have derivatives zero; results of loops and procedures have none.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from spacearm.compiler.expressions import Expression, Operand, Symbols, TracingError, asarray
from spacearm.compiler.operations import OPERATIONS

CONSTANT = frozenset(name for name, each in OPERATIONS.items() if each.pullback is None)
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
    variables = [o for o in by.flat if isinstance(o, Expression)]
    found = np.full(by.shape, 0.0, dtype=object).view(Symbols)
    if not isinstance(of, Expression) or all(o.tape.depth > of.tape.depth for o in variables):
        return found
    if any(o.tape is not of.tape for o in variables):
        raise TracingError("an expression and variables of its derivative stand in other loops")
    depends = {o.number for o in variables}
    needed = of.tape.needed([of])
    for e in needed:
        if e.operation not in CONSTANT and any(
            o.tape is of.tape and o.number in depends for o in e.expressions()
        ):
            depends.add(e.number)
    slopes: dict[int, Any] = {of.number: 1.0}
    for e in reversed(needed):
        if e.number in depends and e.operation != "var" and e.number in slopes:
            if e.operation not in OPERATIONS:
                raise TracingError(f"no derivative is taken through a {e.operation}")
            pullback: Any = OPERATIONS[e.operation].pullback
            shares = pullback(slopes[e.number], e, *e.operands)
            for o, share in zip(e.operands, shares, strict=True):
                if isinstance(o, Expression) and o.tape is of.tape and o.number in depends:
                    slopes[o.number] = share + slopes.get(o.number, 0.0)
    found.ravel()[:] = [slopes.get(getattr(o, "number", -1), 0.0) for o in by.flat]
    return found
