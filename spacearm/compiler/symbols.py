"""The array library of symbols: what stands for NumPy where a function is traced.

Arrays hold expressions and numbers as NumPy's arrays of objects. `xp` of the equations is this
module, `spacearm.compiler.numbers`, or `jax.numpy` with the same loops.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from itertools import count, islice
from typing import Any

import numpy as np

from spacearm.compiler import derivatives
from spacearm.compiler.expressions import (
    Expression,
    Operand,
    Tape,
    TracingError,
    as_mask,
    as_number,
    asarray,
    hold,
    symbols,
    where,
)

__all__ = [
    "Outside", "Region", "Rows", "Table", "asarray", "gradient", "hold", "procedure", "repeat",
    "row", "where", "while_any",
]  # fmt: skip

_current: ContextVar[Tape] = ContextVar("tape")


def __getattr__(name: str) -> Any:
    """Return a function of NumPy; it works on symbols."""
    return getattr(np, name)


def gradient(function: Callable[[Any], Any], at: Any) -> Any:
    """Return the derivatives (n,) of a function of n variables, which returns a number."""
    return symbols(derivatives.gradient(symbols(function(at)), at))


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
    tape, index = _current.get(), symbols(index)
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


def repeat(count: int, step: Callable[..., Any], *state: Any, keep: bool = False) -> Any:
    """Repeat a step a number of times.

    Args:
        count: How often.
        step: Called as step(turn, *state) with turn = 0, 1, ...; returns state, a tuple, and with
            `keep` (*state, row).
        state: Arrays at the start.
        keep: Whether a row is kept in each turn.

    Returns:
        The state at the end, and with `keep` the `Rows`.
    """
    return _loop(step, state, count, keep, counted=True)


def _loop(
    step: Callable[..., Any], state: Sequence[Any], most: int, keep: bool, counted: bool
) -> Any:
    """Write a loop on the current tape, over counted turns or until no lane wants another."""
    if most < 1:
        raise TracingError(f"a loop of {most} turns")
    region, arrays = _region(there := [np.shape(s) for s in state])
    if counted:
        region.turn = region.tape.variable("turn")
        arrays = [region.turn, *arrays]
    with tracing(region.tape):
        found = list(step(*arrays))
    kept = found.pop() if keep else None
    goes_on = None if counted else found.pop()
    if there != (now := [np.shape(o) for o in found]):
        raise TracingError(f"a step returns arrays of shapes {now} for a state of shapes {there}")
    region.most, region.outputs = most, flat(region.tape, found)
    if goes_on is not None:
        (region.goes_on,) = flat(region.tape, [as_mask(symbols(goes_on))])
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
        tape.own(as_number(o)) if isinstance(o, Expression) else float(o)
        for a in arrays
        for o in asarray(a).flat
    ]


def _results(call: Expression, shapes: Sequence[tuple[int, ...]]) -> list[Any]:
    """Return the results of a call or loop as arrays."""
    return _arrays((call.tape.keep("result", (call,), i) for i in count()), shapes)


def _arrays(values: Iterator[Expression], shapes: Sequence[tuple[int, ...]]) -> list[Any]:
    """Return expressions, as many as are needed, as arrays of shapes."""
    return [symbols(asarray([*islice(values, int(np.prod(s)))]).reshape(s)) for s in shapes]
