"""Tapes as C99: straight code, loops with a bound, and nothing but <math.h>.

A procedure, or the body of a loop, is a function `static void NAME_i(const double *in, double
*out)`; a loop is a `for` around its call. Nothing is allocated and no state is kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import copysign, isinf, isnan
from typing import Any

import numpy as np

from spacearm.compiler.expressions import Expression, Operand, Tape, TracingError
from spacearm.compiler.operations import OPERATIONS
from spacearm.compiler.symbols import Region, Traced

LOOP = """\
    for (k = 0; k < {most}; k++) {{
        {state}[{turn}] = k;
        {function}({state}, {after});
        for (i = 0; i < {size}; i++) {{
            {state}[i] = {after}[i];
        }}{leave}
    }}"""
LEAVE = """
        if (!({after}[{size}] > 0.0)) {{
            break;
        }}"""
#: Variables declared in one line.
DECLARED = 12


class Code:
    """Bodies of C functions, which share those of procedures and loops.

    Args:
        name: What the names of the latter begin with.

    Attributes:
        functions: The latter, each before it is called.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.functions: list[str] = []
        self._regions: dict[int, tuple[Region, str]] = {}

    def body(self, traced: Traced, inputs: Iterable[str], outputs: Iterable[str]) -> str:
        """Return the body of a function.

        Args:
            traced: The function.
            inputs: Text that stands for each number that it takes, in order.
            outputs: What each number that it returns is assigned to, in order.

        Raises:
            TracingError: It takes something else than inputs, or keeps the turns of a loop.
        """
        if traced.numbers or traced.tables or traced.outside:
            raise TracingError("C code takes numbers that are inputs of a lane, and nothing else")
        variables = [e for e in traced.tape.written if e.operation == "var"]
        place = {e.number: text for e, text in zip(variables, inputs, strict=True)}
        values = (o for output in traced.outputs for o in traced.flat(output))
        return self._straight(traced.tape, place, list(zip(outputs, values, strict=True)))

    def _region(self, region: Region) -> str:
        """Return the name of the function of a procedure or of the body of a loop, written once."""
        if id(region) not in self._regions:
            if region.kept is not None:
                raise TracingError("C code keeps no turns of a loop")
            inner = [*region.variables, *([] if region.turn is None else [region.turn])]
            outputs = [*region.outputs, *([] if region.goes_on is None else [region.goes_on])]
            body = self._straight(
                region.tape,
                {e.number: f"in[{i}]" for i, e in enumerate(inner)},
                [(f"out[{i}]", o) for i, o in enumerate(outputs)],
            )
            name = f"{self.name}_{len(self._regions)}"
            self._regions[id(region)] = region, name
            unused = "" if "in[" in body else "    (void)in;\n"
            self.functions.append(
                f"static void {name}(const double *in, double *out)\n{{\n{unused}{body}\n}}\n"
            )
        return self._regions[id(region)][1]

    def _straight(
        self, tape: Tape, place: dict[int, str], outputs: Sequence[tuple[str, Operand]]
    ) -> str:
        """Return the lines that compute outputs, by what they are assigned to.

        The variables w0, w1, ... and, of masks, m0, m1, ... hold what is still needed, and are used
        again. `place` has the text of each expression.
        """
        wanted = [o for _, o in outputs]
        steps = _in_depth(tape.needed(wanted), wanted)
        last = {o.number: step for step, e in enumerate(steps) for o in e.expressions()}
        last |= {o.number: len(steps) for _, o in outputs if isinstance(o, Expression)}
        free: dict[str, list[str]] = {"w": [], "m": []}
        count = {"w": 0, "m": 0}
        held: dict[int, str] = {}
        lines: list[str] = []
        arrays: list[str] = []
        for step, e in enumerate(steps):
            if e.operation == "var":
                continue
            given = [_text(o, place) for o in e.operands]
            if e.operation in ("call", "loop"):
                place[e.number] = self._called(e, given, arrays, lines)
            elif e.operation == "result":
                place[e.number] = f"{given[0]}[{e.detail}]"
            elif e.operation not in OPERATIONS:
                raise TracingError(f"C code has no {e.operation}")
            for number in sorted({o.number for o in e.expressions() if last[o.number] == step}):
                if number in held:
                    free[held[number][0]].append(held[number])
            if e.operation in OPERATIONS:
                kind = "m" if e.is_mask else "w"
                if not free[kind]:
                    free[kind].append(f"{kind}{count[kind]}")
                    count[kind] += 1
                place[e.number] = held[e.number] = free[kind].pop()
                lines.append(f"    {held[e.number]} = {OPERATIONS[e.operation].c.format(*given)};")
        lines += [f"    {left} = {_text(o, place)};" for left, o in outputs]
        declared = [f"    {kind} {', '.join(names[i : i + DECLARED])};"
                    for kind, names in (("double", [f"w{i}" for i in range(count["w"])]),
                                        ("int", [f"m{i}" for i in range(count["m"])]))
                    for i in range(0, len(names), DECLARED)]  # fmt: skip
        return "\n".join((*declared, *arrays, *lines))

    def _called(
        self, e: Expression, given: Sequence[str], arrays: list[str], lines: list[str]
    ) -> str:
        """Write the call of a procedure, or a loop; return the array that has what comes out."""
        region: Region = e.detail
        function, size, number = self._region(region), len(region.outputs), len(arrays)
        state, after = f"x{number}", f"y{number}"
        lines += [f"    {state}[{i}] = {text};" for i, text in enumerate(given)]
        arrays.append(f"    double {state}[{len(given) + 1}], {after}[{size + 1}];")
        if e.operation == "call":
            lines.append(f"    {function}({state}, {after});")
            return after
        if "    int i, k;" not in arrays:
            arrays.append("    int i, k;")
        words = {"state": state, "after": after, "size": size}
        leave = "" if region.goes_on is None else LEAVE.format(**words)
        lines.append(
            LOOP.format(**words, most=region.most, turn=len(given), function=function, leave=leave)
        )
        return state


def operations(traced: Traced) -> int:
    """Return how many operations a function takes at most, loops with all of their turns."""

    def count(tape: Tape, outputs: Iterable[Operand]) -> int:
        found = 0
        for e in tape.needed(outputs):
            if e.operation in OPERATIONS:
                found += 1
            elif e.operation in ("call", "loop"):
                region: Region = e.detail
                goes_on = [] if region.goes_on is None else [region.goes_on]
                found += max(region.most, 1) * count(region.tape, [*region.outputs, *goes_on])
        return found

    return count(traced.tape, [o for output in traced.outputs for o in traced.flat(output)])


def number(value: float) -> str:
    """Return a number as C reads it, with all its digits."""
    if isnan(value):
        return "NAN"
    size = "INFINITY" if isinf(value) else repr(abs(float(value)))
    return f"(-{size})" if copysign(1.0, value) < 0.0 else size


def initialiser(values: Any) -> str:
    """Return a number, or arrays of numbers in braces, as C initialises them."""
    if not np.ndim(values):
        return number(float(values))
    return f"{{{', '.join(map(initialiser, values))}}}"


def fields(shapes: Mapping[str, tuple[int, ...]]) -> str:
    """Return the declarations of the fields of a struct, by their names and shapes."""
    sizes = {name: "".join(f"[{size}]" for size in shape) for name, shape in shapes.items()}
    return "\n".join(f"    double {name}{size};" for name, size in sizes.items())


def elements(shapes: Mapping[str, tuple[int, ...]], before: str = "") -> list[str]:
    """Return the numbers of a struct one by one, as in p->places[0][1] where `before` is p->."""
    return [
        f"{before}{name}{''.join(f'[{i}]' for i in index)}"
        for name, shape in shapes.items() for index in np.ndindex(shape)
    ]  # fmt: skip


def _in_depth(steps: Sequence[Expression], outputs: Sequence[Operand]) -> list[Expression]:
    """Return steps output by output, of two operands the one that holds more numbers first.

    So few numbers are held at a time, and more of them in the registers of a processor: Sethi &
    Ullman, J. ACM 17(4), 715-728 (1970), DOI 10.1145/321607.321620.
    """
    holds: dict[int, int] = {}
    for e in steps:
        most = sorted({o.number: holds[o.number] for o in e.expressions()}.values(), reverse=True)
        holds[e.number] = max((i + one for i, one in enumerate(most)), default=1)
    found: dict[int, Expression] = {}
    waiting = [(o, False) for o in reversed(outputs) if isinstance(o, Expression)]
    while waiting:
        e, ready = waiting.pop()
        if ready:
            found[e.number] = e
        elif e.number not in found:
            operands = sorted(e.expressions(), key=lambda o: holds[o.number])
            waiting += [(e, True), *((o, False) for o in operands)]
    return list(found.values())


def _text(operand: Operand, place: Mapping[int, str]) -> str:
    """Return an operand as C."""
    return place[operand.number] if isinstance(operand, Expression) else number(operand)
