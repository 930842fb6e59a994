"""Functions of arrays traced: run once over symbols, and written down as tapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from spacearm.compiler.expressions import Expression, Operand, Tape, TracingError, as_number
from spacearm.compiler.operations import OPERATIONS
from spacearm.compiler.symbols import Outside, Rows, Table, asarray, tracing, variables

Shape = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Traced:
    """A function as tapes.

    Attributes:
        shared: Tape of what is the same for all lanes.
        tape: Tape of the rest.
        numbers: Names and shapes of the arguments that all lanes share.
        inputs: Names and shapes of those of each lane.
        tables: The tables.
        outside: The functions called as it runs.
        outputs: What it returns: arrays of expressions, or `Rows`.
        single: Whether it returns an array, not a tuple of arrays.
    """

    shared: Tape
    tape: Tape
    numbers: dict[str, Shape]
    inputs: dict[str, Shape]
    tables: dict[str, Table]
    outside: dict[str, Outside]
    outputs: list[Any]
    single: bool

    def flat(self, output: Any) -> list[Operand]:
        """Return the elements of an output that is no `Rows`; masks as 1 and 0."""
        return [self.tape.own(as_number(o)) if isinstance(o, Expression) else float(o)
                for o in asarray(output).ravel()]  # fmt: skip


def trace(
    function: Callable[..., Any],
    inputs: Mapping[str, Shape],
    numbers: Mapping[str, Shape] | None = None,
    tables: Mapping[str, int] | None = None,
    outside: Mapping[str, int] | None = None,
) -> Traced:
    """Trace a function.

    Args:
        function: Called with arrays of symbols, tables and functions by name; returns an array or
            a tuple of arrays. Masks that it returns are 1 and 0.
        inputs: Shapes of the arguments that each lane has its own of.
        numbers: Shapes of those that all lanes share.
        tables: Numbers of columns of tables.
        outside: Numbers of results of functions that are called as it runs.

    Raises:
        TracingError: The function branches on a symbol, or does what else cannot be traced.
    """
    shared = Tape()
    tape = Tape(shared)
    numbers, looked = dict(numbers or {}), {n: Table(n, c) for n, c in (tables or {}).items()}
    called = {name: Outside(name, count) for name, count in (outside or {}).items()}
    arguments = dict(zip(inputs, variables(tape, "input", list(inputs.values())), strict=True))
    arguments |= zip(numbers, variables(shared, "number", list(numbers.values())), strict=True)
    with tracing(tape), np.errstate(all="ignore"):
        found = function(**arguments, **looked, **called)
    single = not isinstance(found, tuple)
    outputs = [found] if single else list(found)
    if any(isinstance(o, Rows) and o.loop.tape is not tape for o in outputs):
        raise TracingError("rows that are returned are kept by a loop that stands in no other")
    traced = Traced(shared, tape, numbers, dict(inputs), looked, called, outputs, single)
    for output in outputs:
        if not isinstance(output, Rows):
            traced.flat(output)  # raises what is wrong with it here
    return traced


def interpreted(
    traced: Traced, inputs: Mapping[str, Any], numbers: Mapping[str, Any] | None = None
) -> list[npt.NDArray[np.float64]]:
    """Compute the outputs (m, *shape) by NumPy, operation by operation, without compiling.

    Args:
        traced: The function.
        inputs: (m, *shape) of each input.
        numbers: What all lanes share.

    Raises:
        TracingError: It has a loop, a procedure or a table.
    """
    m = len(next(iter(inputs.values())))
    given = [np.reshape(inputs[name], (m, -1)).T for name in traced.inputs]
    shared = [np.ravel((numbers or {})[name]) for name in traced.numbers]
    values: dict[tuple[int, int], Any] = {}
    with np.errstate(all="ignore"):
        for tape, arguments in ((traced.shared, shared), (traced.tape, given)):
            known = iter([value for argument in arguments for value in argument])
            for e in tape.written:
                if e.operation == "var":
                    found = next(known)
                elif e.operation == "hold" or e.operation in OPERATIONS:
                    operands = (_value(values, o) for o in e.operands)
                    found = OPERATIONS.get(e.operation, np.positive)(*operands)
                else:
                    raise TracingError(f"a {e.operation} is not run by NumPy")
                values[tape.depth, e.number] = found
    outputs = []
    for output in traced.outputs:
        flat = [np.broadcast_to(_value(values, o), m) for o in traced.flat(output)]
        outputs.append(np.array(flat, dtype=float).reshape(len(flat), m).T)
    return [a.reshape(m, *np.shape(o)) for a, o in zip(outputs, traced.outputs, strict=True)]


def _value(values: Mapping[tuple[int, int], Any], o: Any) -> Any:
    """Return the value of an operand."""
    return values[o.tape.depth, o.number] if isinstance(o, Expression) else o
