"""C code without loops or branches from expressions: one assignment an operation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from spacearm.export.c_code.expressions import Expression, Operand, Tape

SIGNS = {"add": "+", "sub": "-", "mul": "*", "div": "/"}


def body(tape: Tape, arguments: Iterable[str], outputs: Mapping[str, Operand]) -> str:
    """Return the body of a C function.

    The variables w0, w1, ... hold what is still needed, and are used again.

    Args:
        tape: Where the expressions stand.
        arguments: Names that the variables begin with; those that are not used are said to be so.
        outputs: Expressions by the text of what they are assigned to.
    """
    steps = tape.needed(outputs.values())
    last = {o.number: step for step, e in enumerate(steps) for o in e.expressions()}
    last |= {e.number: len(steps) for e in outputs.values() if isinstance(e, Expression)}
    place: dict[int, str] = {}
    free: list[str] = []
    count = 0
    lines = []
    for step, e in enumerate(steps):
        if e.operation == "var":
            place[e.number] = e.name
            continue
        right = _right_side(e, place)
        done = {o.number for o in e.expressions() if last[o.number] == step}
        free += [place[number] for number in sorted(done) if place[number].startswith("w")]
        if not free:
            free.append(f"w{count}")
            count += 1
        place[e.number] = free.pop()
        lines.append(f"    {place[e.number]} = {right};")
    lines += [f"    {left} = {_text(e, place)};" for left, e in outputs.items()]
    names = [f"w{i}" for i in range(count)]
    declared = [f"    double {', '.join(names[i : i + 12])};" for i in range(0, count, 12)]
    used = {re.split(r"\W", e.name)[0] for e in steps if e.operation == "var"}
    unused = [f"    (void){name};" for name in arguments if name not in used]
    return "\n".join((*declared, *unused, *lines))


def number(value: float) -> str:
    """Return a number as C reads it, with all its digits."""
    text = repr(float(value))
    return f"({text})" if text.startswith("-") else text


def _right_side(e: Expression, place: Mapping[int, str]) -> str:
    """Return an operation as C."""
    operands = [_text(operand, place) for operand in e.operands]
    if e.operation in SIGNS:
        return f" {SIGNS[e.operation]} ".join(operands)
    return f"-{operands[0]}" if e.operation == "neg" else f"{e.operation}({operands[0]})"


def _text(operand: Operand, place: Mapping[int, str]) -> str:
    """Return an operand as C."""
    return place[operand.number] if isinstance(operand, Expression) else number(operand)
