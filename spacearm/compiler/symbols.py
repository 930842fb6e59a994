"""Functions traced: the array library of symbols, loops and procedures, derivatives.

Arrays hold expressions and numbers as NumPy's arrays of objects. `xp` of the equations is this
module, `spacearm.compiler.numbers`, or `jax.numpy` with the same loops. `trace` runs a function
once over symbols and returns what it wrote down.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from itertools import count, islice
from typing import Any

import numpy as np
import numpy.typing as npt

from spacearm.compiler import expressions
from spacearm.compiler.expressions import Expression, Operand, Tape, asarray, hold, where
from spacearm.compiler.operations import OPERATIONS

__all__ = ["asarray", "hold", "where"]  # of what is imported: functions of `xp`

_current: ContextVar[Tape] = ContextVar("tape")


def __getattr__(name: str) -> Any:
    """Return a function of NumPy; it works on symbols."""
    return getattr(np, name)


def gradient(function: Callable[[Any], Any], at: Any) -> Any:
    """Return the derivatives (n,) of a function of n variables, which returns a number."""
    return expressions.symbols(derivatives(expressions.symbols(function(at)), at))


@dataclass(eq=False)
class Region:
    """The body of a loop or procedure: a function of its own, with a tape of its own.

    Attributes:
        tape: The tape.
        inputs: Its variables, in order; those captured come after them.
        outputs: What it computes.
        most: How often it runs at most, of a loop; 0 for a procedure.
        goes_on: Of a loop, not zero in lanes that want another turn; None if it runs `most` times.
        turn: The variable that counts the turns of a loop, if it is used.
        kept: What a loop writes to its rows in each turn.
    """

    tape: Tape
    inputs: list[Expression]
    outputs: list[Operand] = field(default_factory=list)
    most: int = 0
    goes_on: Operand | None = None
    turn: Expression | None = None
    kept: list[Operand] | None = None

    @property
    def variables(self) -> list[Expression]:
        """Its inputs, and the variables that stand for what it captures."""
        return [*self.inputs, *(inner for inner, _ in self.tape.captured.values())]

    @property
    def captures(self) -> list[Expression]:
        """The expressions of the tape around that it uses."""
        return [outer for _, outer in self.tape.captured.values()]


@dataclass(frozen=True, eq=False)
class Rows:
    """What a loop kept in each of its turns: an output, which a function cannot look into.

    Attributes:
        loop: The loop.
        shape: (most, numbers a turn).
    """

    loop: Expression
    shape: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Table:
    """Rows of numbers that all lanes can look up; an argument of a kernel.

    Attributes:
        name: Its name.
        columns: Number of columns.
    """

    name: str
    columns: int


@dataclass(frozen=True, eq=False)
class Outside:
    """A function that is called lane by lane as machine code runs; an argument of a kernel.

    Attributes:
        name: Its name.
        count: How many numbers it gives.
    """

    name: str
    count: int

    def __call__(self, values: Any) -> Any:
        """Return its status, which is not 0 if it failed, and its numbers (count,) at values.

        It is called once for each lane, and in a loop also for lanes that have ended; calls with
        the same values in one turn are one.
        """
        tape = _current.get()
        call = tape.keep("outside", tuple(flat(tape, [values])), self)
        return _results(call, [(1 + self.count,)])[0]


def row(table: Table, index: Any) -> Any:
    """Return the row (columns,) of a table at a whole number.

    Of indices that are beyond, the first or last row is taken, of those that are NaN the first.
    """
    tape, index = _current.get(), expressions.symbols(index)
    if isinstance(index, Expression) and index.tape.depth > 0:
        tape = index.tape
    operands = tuple(flat(tape, [index]))
    return asarray([tape.keep("load", operands, (table.name, c)) for c in range(table.columns)])


def procedure(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function of arrays that is traced once and called wherever it is used.

    It returns an array or a tuple of arrays. Where it uses symbols of a loop that it was traced in,
    it is traced anew for the next.
    """
    known: dict[tuple[Any, ...], list[tuple[Region, list[Any], bool]]] = {}

    def call(*arguments: Any) -> Any:
        shapes = [np.shape(a) for a in arguments]
        tape, traced = _current.get(), known.setdefault(tuple(shapes), [])
        seen = next((k for k in traced if all(tape.reaches(o.tape) for o in k[0].captures)), None)
        if seen is None:
            region, arrays = _region(shapes)
            with tracing(region.tape):
                found = function(*arrays)
            single = not isinstance(found, tuple)
            outputs = [found] if single else list(found)
            region.outputs = flat(region.tape, outputs)
            seen = region, [np.shape(o) for o in outputs], single
            traced.append(seen)
        region, out, single = seen
        operands = (*flat(tape, arguments), *(tape.own(o) for o in region.captures))
        results = _results(tape.keep("call", operands, region), out)
        return results[0] if single else tuple(results)

    return call


def while_any(step: Callable[..., Any], *state: Any, most: int, keep: bool = False) -> Any:
    """Repeat a step until no lane wants another, at most so often.

    Args:
        step: Called as step(*state); returns (*state, goes_on), and with `keep` (*state, goes_on,
            row). A lane whose `goes_on` was false keeps its state.
        state: Arrays at the start.
        most: How often at most.
        keep: Whether a row is kept in each turn.

    Returns:
        The state at the end, and with `keep` the `Rows`. Rows after the last turn of a lane have
        no meaning, and those after the last turn of all that run side by side are not written.
    """
    return _loop(step, state, most, keep, counted=False)


def repeat(count: int, step: Callable[..., Any], *state: Any) -> Any:
    """Repeat a step a number of times.

    Args:
        count: How often.
        step: Called as step(turn, *state) with turn = 0, 1, ...; returns state, a tuple.
        state: Arrays at the start.

    Returns:
        The state at the end.
    """
    return _loop(step, state, count, keep=False, counted=True)


def _loop(
    step: Callable[..., Any], state: Sequence[Any], most: int, keep: bool, counted: bool
) -> Any:
    """Write a loop on the current tape, over counted turns or until no lane wants another."""
    if most < 1:
        raise expressions.TracingError(f"a loop of {most} turns")
    region, arrays = _region(there := [np.shape(s) for s in state])
    if counted:
        region.turn = region.tape.variable("turn")
        arrays = [region.turn, *arrays]
    with tracing(region.tape):
        found = list(step(*arrays))
    kept = found.pop() if keep else None
    goes_on = None if counted else found.pop()
    if there != (now := [np.shape(o) for o in found]):
        raise expressions.TracingError(
            f"a step returns arrays of shapes {now} for a state of shapes {there}"
        )
    region.most, region.outputs = most, flat(region.tape, found)
    if goes_on is not None:
        (region.goes_on,) = flat(region.tape, [expressions.as_mask(expressions.symbols(goes_on))])
    region.kept = None if kept is None else flat(region.tape, [kept])
    tape = _current.get()
    operands = (*flat(tape, state), *(tape.own(o) for o in region.captures))
    loop = tape.keep("loop", operands, region)
    results = tuple(_results(loop, there))
    return results if region.kept is None else (*results, Rows(loop, (most, len(region.kept))))


def _region(shapes: Sequence[tuple[int, ...]]) -> tuple[Region, list[Any]]:
    """Return a region inside the current tape, and arrays of its variables."""
    tape = Tape(_current.get())
    arrays = variables(tape, "input", shapes)
    return Region(tape, [o for a in arrays for o in asarray(a).flat]), arrays


def variables(tape: Tape, kind: str, shapes: Sequence[tuple[int, ...]]) -> list[Any]:
    """Return arrays of new variables; they are named (kind, 0), (kind, 1), ... throughout."""
    return _arrays((tape.variable((kind, i)) for i in count()), shapes)


@contextmanager
def tracing(tape: Tape) -> Iterator[None]:
    """Let loops and procedures stand on a tape."""
    token = _current.set(tape)
    try:
        yield
    finally:
        _current.reset(token)


def flat(tape: Tape, arrays: Iterable[Any]) -> list[Operand]:
    """Return the elements of arrays one after the other, as a tape has them; masks as 1 and 0."""
    return [
        tape.own(expressions.as_number(o)) if isinstance(o, Expression) else float(o)
        for a in arrays
        for o in asarray(a).flat
    ]


def _results(call: Expression, shapes: Sequence[tuple[int, ...]]) -> list[Any]:
    """Return the results of a call or loop as arrays."""
    return _arrays((call.tape.keep("result", (call,), i) for i in count()), shapes)


def _arrays(values: Iterator[Expression], shapes: Sequence[tuple[int, ...]]) -> list[Any]:
    """Return expressions, as many as are needed, as arrays of shapes."""
    return [
        expressions.symbols(asarray([*islice(values, int(np.prod(s)))]).reshape(s)) for s in shapes
    ]


#: Operations whose derivatives are zero.
CONSTANT = frozenset(name for name, each in OPERATIONS.items() if each.pullback is None)


def derivatives(of: Operand, by: Any) -> Any:
    """Return the derivatives of an expression by an array of variables, in the shape of these.

    Reverse mode, from the last operation back: Griewank & Walther, Evaluating Derivatives, 2nd ed.,
    SIAM 2008, chapter 3. All of them together take a few times as many operations as the expression
    itself. What stands in `hold`, and all comparisons, have derivatives zero.

    Where `by` has numbers in place of variables, the derivatives are zero. Of a selection only the
    side that is taken counts; but if the derivative of the other is infinite there, 0 times that is
    NaN, and the operand must be selected as well.

    Raises:
        TracingError: The expression depends on the variables through a loop, procedure or table, or
            stands in another loop than they.
    """
    by = asarray(by)
    variables = [o for o in by.flat if isinstance(o, Expression)]
    found = np.full(by.shape, 0.0, dtype=object).view(expressions.Symbols)
    if not isinstance(of, Expression) or all(o.tape.depth > of.tape.depth for o in variables):
        return found
    if any(o.tape is not of.tape for o in variables):
        raise expressions.TracingError(
            "an expression and variables of its derivative stand in other loops"
        )
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
                raise expressions.TracingError(f"no derivative is taken through a {e.operation}")
            pullback: Any = OPERATIONS[e.operation].pullback
            shares = pullback(slopes[e.number], e, *e.operands)
            for o, share in zip(e.operands, shares, strict=True):
                if isinstance(o, Expression) and o.tape is of.tape and o.number in depends:
                    slopes[o.number] = share + slopes.get(o.number, 0.0)
    found.ravel()[:] = [slopes.get(getattr(o, "number", -1), 0.0) for o in by.flat]
    return found


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
        raise expressions.TracingError(
            "rows that are returned are kept by a loop that stands in no other"
        )
    traced = Traced(shared, tape, numbers, dict(inputs), looked, called, outputs, single)
    for output in outputs:
        if not isinstance(output, Rows):
            traced.flat(output)  # raises what is wrong with it here
    return traced


def interpreted(traced: Traced, inputs: Mapping[str, Any]) -> list[npt.NDArray[np.float64]]:
    """Compute the outputs (m, *shape) by NumPy, operation by operation, without compiling.

    Args:
        traced: The function; all lanes share nothing.
        inputs: (m, *shape) of each input.

    Raises:
        TracingError: It has a loop, a procedure or a table.
    """
    m = len(next(iter(inputs.values())))
    given = (column for name in traced.inputs for column in np.reshape(inputs[name], (m, -1)).T)
    values: dict[Expression, Any] = {}

    def value(o: Operand) -> Any:
        return values[o] if isinstance(o, Expression) else o

    with np.errstate(all="ignore"):
        for e in traced.tape.written:
            if e.operation == "var":
                values[e] = next(given)
            elif e.operation in OPERATIONS:
                values[e] = OPERATIONS[e.operation].numpy(*map(value, e.operands))
            else:
                raise expressions.TracingError(f"a {e.operation} is not run by NumPy")
    outputs = []
    for output in traced.outputs:
        columns = [np.broadcast_to(value(o), m) for o in traced.flat(output)]
        outputs.append(np.array(columns, dtype=float).T.reshape(m, *np.shape(output)))
    return outputs
