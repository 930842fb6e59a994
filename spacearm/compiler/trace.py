"""Functions of arrays traced: run once over symbols, and written down as tapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from spacearm.compiler.expressions import Expression, Operand, Tape, TracingError
from spacearm.compiler.operations import OPERATIONS
from spacearm.compiler.symbols import Outside, Rows, Table, flat, tracing, variables

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
        return flat(self.tape, [output])


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
    given = [column for name in traced.inputs for column in np.reshape(inputs[name], (m, -1)).T]
    shared = [number for name in traced.numbers for number in np.ravel((numbers or {})[name])]
    values: dict[Expression, Any] = {}

    def value(o: Operand) -> Any:
        return values[o] if isinstance(o, Expression) else o

    with np.errstate(all="ignore"):
        for tape, arguments in ((traced.shared, iter(shared)), (traced.tape, iter(given))):
            for e in tape.written:
                if e.operation == "var":
                    values[e] = next(arguments)
                elif e.operation in OPERATIONS:
                    values[e] = OPERATIONS[e.operation].numpy(*map(value, e.operands))
                else:
                    raise TracingError(f"a {e.operation} is not run by NumPy")
    outputs = []
    for output in traced.outputs:
        columns = [np.broadcast_to(value(o), m) for o in traced.flat(output)]
        outputs.append(np.array(columns, dtype=float).T.reshape(m, *np.shape(output)))
    return outputs
