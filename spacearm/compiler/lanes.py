"""Tapes as LLVM's intermediate language, in which each number is one vector of lanes.

Lanes are configurations computed side by side. Every region is a function of memory: it loads its
variables from `%in` and writes what it computes to `%out`, both vectors of lanes. What all lanes
share is in `%u`: what is given, then what `prepare` computes of it, by the numbers of the
expressions, there as single numbers and for all else as vectors. `%a` has the addresses of the
arguments of the kernel and then the numbers of their last rows; `%at` is the number of the first
lane.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from spacearm.compiler.angles import sine_cosine
from spacearm.compiler.expressions import Expression, Operand, Tape
from spacearm.compiler.instructions import Instructions
from spacearm.compiler.operations import FUNCTIONS, SIGNS
from spacearm.compiler.symbols import Outside, Region, Rows
from spacearm.compiler.trace import Traced

INTRINSICS = {
    "sqrt": "sqrt", "abs": "fabs", "rint": "rint", "floor": "floor", "ceil": "ceil",
    "min": "minimum", "max": "maximum",
}  # fmt: skip
"""Operations that LLVM knows."""


class Lanes:
    """The text of a kernel.

    Args:
        traced: The function.
        width: Number of lanes.
        fused: Whether a b + c is rounded once where a b is used nowhere else. The processor must
            know that operation.
    """

    def __init__(self, traced: Traced, width: int, fused: bool) -> None:
        self.traced, self.width, self.fused = traced, width, fused
        self.declared: set[str] = set()
        self._functions: dict[str, str] = {}
        self._regions: dict[int, str] = {}
        slots = [*traced.inputs, *range(len(traced.outputs)), *traced.tables, *traced.outside]
        self.slot: dict[Any, int] = {name: i for i, name in enumerate(slots)}
        self.rows = {id(o.loop.detail): i
                     for i, o in enumerate(traced.outputs) if isinstance(o, Rows)}  # fmt: skip

    def text(self) -> str:
        """Return the whole module, whose entries are `prepare` and `run`."""
        prepare, run = self._prepare(), self._run()
        return "\n".join((*sorted(self.declared), *self._functions.values(), prepare, run, ""))

    def code(self, width: int) -> Instructions:
        """Return the lines of a new function."""
        return Instructions(width, self.fused, self.declared)

    def angles(self, width: int) -> str:
        """Return the name of the function of sine and cosine."""
        name = f"@sine_cosine{width}"
        if name not in self._functions:
            self._functions[name] = sine_cosine(self.code(width), name)
        return name

    def library(self, function: str, operands: int, width: int) -> str:
        """Return the name of a function of lanes that calls one of the system's library."""
        name = f"@{function}_{width}"
        if name not in self._functions:
            code, given = self.code(width), ["%x", "%y"][:operands]
            code.line(f"ret {code.V} {code.library(function, *given)}")
            types = ", ".join(f"{code.V} {x}" for x in given)
            self._functions[name] = f"define internal {code.V} {name}({types}) {{\n{code}\n}}"
        return name

    def region(self, region: Region) -> str:
        """Return the name of the function of a region, written once."""
        if id(region) not in self._regions:
            name = self._regions[id(region)] = f"@region{len(self._regions)}"
            code = _Body(self, self.code(self.width))
            variables = [*region.inputs, *(inner for inner, _ in region.tape.captured.values())]
            code.place = {e.number: ("%in", i) for i, e in enumerate(variables)}
            if region.turn is not None:
                turn = code.lines.new("sitofp i64 %turn to double")
                code.known[region.turn.number] = code.lines.splat(turn)
            kept = (region.kept or []) if id(region) in self.rows else []
            code.compute(region.tape, [*region.outputs, *kept, region.goes_on])
            for i, o in enumerate(region.outputs):
                code.lines.store(code.value(o), "%out", i)
            if kept:
                code.write(kept, "%rows", region.most)
            if region.goes_on is not None:
                one, zero = code.lines.number(1.0), code.lines.number(0.0)
                goes_on = code.lines.select(code.mask(region.goes_on), one, zero)
                code.lines.store(goes_on, "%out", len(region.outputs))
            code.lines.line("ret void")
            self._functions[name] = (
                f"define internal void {name}(ptr noalias %in, ptr noalias %out, ptr noalias %u, "
                f"ptr %a, i64 %at, i64 %turn, ptr %rows) {{\n{code.lines}\n}}"
            )
        return self._regions[id(region)]

    def _prepare(self) -> str:
        """Return the function that computes what all lanes share."""
        code = _Body(self, self.code(1), shared=True)
        for e in self.traced.shared.written:
            if e.operation == "var":
                code.place[e.number] = ("%u", e.number)
                continue
            value = code.known[e.number] = code.operation(e)
            if e.is_mask:
                value = code.lines.new(f"uitofp i1 {value} to double")
            code.lines.store(value, "%u", e.number)
        code.lines.line("ret void")
        return f"define void @prepare(ptr noalias %u) {{\n{code.lines}\n}}"

    def _run(self) -> str:
        """Return the function that computes blocks of lanes; the last ones at `%most`."""
        traced, code = self.traced, _Body(self, self.code(self.width))
        lines = code.lines
        lines.line("br label %block")
        lines.label("block")
        lines.line("%i = phi i64 [%first, %entry], [%next, %done]")
        self.declared.add("declare i64 @llvm.smin.i64(i64, i64)")
        lines.line(f"%begin = mul i64 %i, {self.width}")
        lines.line("%at = call i64 @llvm.smin.i64(i64 %begin, i64 %most)")
        variables = (e for e in traced.tape.written if e.operation == "var")
        for name, shape in traced.inputs.items():
            size = int(np.prod(shape))
            found = lines.gather(code.rows(code.argument(name), size), size)
            for value, e in zip(found, variables, strict=False):
                code.known[e.number] = value
        flat = [[] if isinstance(o, Rows) else traced.flat(o) for o in traced.outputs]
        loops = [o.loop for o in traced.outputs if isinstance(o, Rows)]
        code.compute(traced.tape, [*(o for values in flat for o in values), *loops])
        for i, values in enumerate(flat):
            if values:
                code.write(values, code.argument(i))
        lines.line("br label %done")
        lines.label("done")
        lines.line("%next = add i64 %i, 1")
        lines.line("%more = icmp slt i64 %next, %last")
        lines.line("br i1 %more, label %block, label %end")
        lines.label("end")
        lines.line("ret void")
        return (
            f"define void @run(ptr noalias %a, ptr noalias %u, i64 %most, i64 %first, i64 %last) "
            f"{{\n{lines}\n}}"
        )


class _Body:
    """The expressions of one tape as instructions.

    Attributes:
        lines: The instructions.
        shared: Whether the tape is the shared one.
        known: Names of the values of expressions of the tape, by number.
        place: Where variables and results lie: memory and index.
    """

    def __init__(self, lanes: Lanes, lines: Instructions, shared: bool = False) -> None:
        self.lanes, self.lines, self.shared = lanes, lines, shared
        self.known: dict[int, str] = {}
        self.place: dict[int, tuple[str, int]] = {}
        self._taken: dict[int, str] = {}
        self._negative: dict[str, str] = {}
        self._angles: dict[str, str] = {}
        self._looked: dict[tuple[str, str], list[str]] = {}
        self._inside: set[int] = set()
        self._products: dict[int, Expression] = {}

    def argument(self, slot: int | str) -> str:
        """Return the address of an argument of the kernel."""
        address = self.lines.at("ptr", "%a", self.lanes.slot[slot])
        return self.lines.new(f"load ptr, ptr {address}")

    def rows(self, address: str, size: int, most: int = 1) -> list[str]:
        """Return the address of the row of each lane, of `size` numbers; `%turn` of `most`."""
        first = self.lines.new(f"mul i64 %at, {size * most}")
        if most > 1:
            first = self.lines.new(f"add i64 {first}, {self.lines.new(f'mul i64 %turn, {size}')}")
        base = self.lines.at("double", address, first)
        return [self.lines.at("double", base, lane * size * most)
                for lane in range(self.lines.width)]  # fmt: skip

    def write(self, values: list[Operand], address: str, most: int = 1) -> None:
        """Write numbers to the rows of the lanes."""
        self.lines.scatter([self.value(o) for o in values], self.rows(address, len(values), most))

    def value(self, o: Operand) -> str:
        """Return the name of a number in all lanes."""
        if not isinstance(o, Expression):
            return self.lines.number(float(o))
        if o.tape.depth == 0 and not self.shared:
            if o.number not in self._taken:
                self._taken[o.number] = self.lines.load("%u", o.number)
            return self._taken[o.number]
        if o.number not in self.known:
            self.known[o.number] = self.lines.load(*self.place[o.number])
        return self.known[o.number]

    def mask(self, o: Operand) -> str:
        """Return the name of a mask."""
        if not isinstance(o, Expression):
            return self.lines.truth(bool(o))
        if o.tape.depth == 0 and not self.shared:  # kept as a number
            return self.lines.compare("une", self.value(o), self.lines.number(0.0))
        return self.known[o.number]

    def compute(self, tape: Tape, outputs: Sequence[Any]) -> None:
        """Write all that outputs on a tape need."""
        needed = tape.needed(outputs)
        if self.lines.fused:
            self._fuse(needed, outputs)
        for e in needed:
            if e.operation != "var" and e.number not in self._inside:
                self.known[e.number] = self.operation(e)

    def _fuse(self, needed: Sequence[Expression], outputs: Sequence[Any]) -> None:
        """Find the products that are computed together with the sum or difference they stand in."""
        uses = Counter(id(o) for o in outputs if isinstance(o, Expression))
        uses.update(id(o) for e in needed for o in e.operands)
        for e in needed:
            if e.operation in ("add", "sub"):
                for o in reversed(e.operands):
                    if not isinstance(o, Expression) or o.operation != "mul":
                        continue
                    if o.tape is e.tape and uses[id(o)] == 1:
                        self._inside.add(o.number)
                        self._products[e.number] = o
                        break

    def operation(self, e: Expression) -> str:
        """Write an operation and return the name of its value; nothing for a loop or call."""
        lines, name, o = self.lines, e.operation, e.operands
        if e.number in self._products:
            return self._product(e, self._products[e.number])
        if name in SIGNS:
            return lines.arithmetic(f"f{name}", self.value(o[0]), self.value(o[1]))
        match name:
            case "and" | "or":
                return lines.new(f"{name} {lines.M} {self.mask(o[0])}, {self.mask(o[1])}")
            case "not":
                return lines.new(f"xor {lines.M} {self.mask(o[0])}, {lines.truth(True)}")
            case "select":
                return lines.select(self.mask(o[0]), self.value(o[1]), self.value(o[2]))
            case "load":
                return self._load(e)
            case "result":
                memory, first = self.place[o[0].number]  # type: ignore[union-attr]
                return lines.load(memory, first + e.detail)
            case "call" | "loop" | "outside":
                getattr(self, f"_{name}")(e, e.detail)
                return ""
        values = [self.value(x) for x in o]
        if name in INTRINSICS:
            return lines.intrinsic(INTRINSICS[name], *values)
        match name:
            case "neg":
                return self._minus(values[0])
            case "hold":
                return values[0]
            case "lt":
                return lines.compare("olt", *values)
            case "le":
                return lines.compare("ole", *values)
            case "sin" | "cos":
                return self._angle(name, values[0])
            case "sign":
                return self._sign(values[0])
        function, types = FUNCTIONS[name].c, ", ".join(f"{lines.V} {x}" for x in values)
        own = self.lanes.library(function, len(values), lines.width)
        return lines.new(f"call {lines.V} {own}({types})")

    def _product(self, e: Expression, product: Expression) -> str:
        """Compute a b + c, a b - c or c - a b, rounded once."""
        a, b = (self.value(o) for o in product.operands)
        first = e.operands[0] is product
        c = self.value(e.operands[1 if first else 0])
        if e.operation == "sub":
            a, c = (a, self._minus(c)) if first else (self._minus(a), c)
        return self.lines.product(a, b, c)

    def _minus(self, value: str) -> str:
        if value not in self._negative:
            self._negative[value] = self.lines.arithmetic("fneg", value)
        return self._negative[value]

    def _angle(self, name: str, x: str) -> str:
        """Return the sine or cosine of an angle, for which the function is called once."""
        V = self.lines.V
        if x not in self._angles:
            function = self.lanes.angles(self.lines.width)
            self._angles[x] = self.lines.new(f"call {{{V}, {V}}} {function}({V} {x})")
        index = 0 if name == "sin" else 1
        return self.lines.new(f"extractvalue {{{V}, {V}}} {self._angles[x]}, {index}")

    def _sign(self, x: str) -> str:
        """Return the sign of a number: -1, 0, 1 or NaN."""
        lines, zero = self.lines, self.lines.number(0.0)
        rest = lines.arithmetic("fadd", x, zero)  # zero without a sign, or NaN
        rest = lines.select(lines.compare("olt", x, zero), lines.number(-1.0), rest)
        return lines.select(lines.compare("ogt", x, zero), lines.number(1.0), rest)

    def _load(self, e: Expression) -> str:
        """Load a number of a table."""
        table, column = e.detail
        index = self.value(e.operands[0])
        if (table, index) not in self._looked:
            self._looked[table, index] = self._rows_of(table, index)
        rows = self._looked[table, index]
        return self.lines.joined([self.lines.load_one(row, column) for row in rows])

    def _rows_of(self, table: str, index: str) -> list[str]:
        """Return the addresses of rows of a table, one a lane."""
        lines, lanes, address, found = self.lines, self.lanes, self.argument(table), []
        last = lines.at("i64", "%a", len(lanes.slot) + lanes.slot[table])
        last = lines.new(f"load i64, ptr {last}")
        lines.declared.add("declare i64 @llvm.fptosi.sat.i64.f64(double)")
        for lane in range(lines.width):
            one = lines.lane(index, lane)
            i = lines.new(f"call i64 @llvm.fptosi.sat.i64.f64(double {one})")  # NaN gives 0
            i = lines.integer("smax", lines.integer("smin", i, last), "0")
            i = lines.new(f"mul i64 {i}, {lanes.traced.tables[table].columns}")
            found.append(lines.at("double", address, i))
        return found

    def _given(self, operands: Iterable[Operand], memory: str) -> None:
        """Store operands side by side."""
        for i, o in enumerate(operands):
            self.lines.store(self.value(o), memory, i)

    def _call(self, e: Expression, region: Region) -> None:
        """Call a procedure."""
        function = self.lanes.region(region)
        given = self.lines.scratch("%given", len(e.operands))
        found = self.lines.memory(len(region.outputs))
        self._given(e.operands, given)
        self.lines.line(
            f"call void {function}(ptr {given}, ptr {found}, ptr %u, ptr %a, i64 %at, i64 0, "
            "ptr null)"
        )
        self.place[e.number] = (found, 0)

    def _loop(self, e: Expression, region: Region) -> None:
        """Run a loop, in which lanes that have ended keep their state."""
        lines, size, mask = self.lines, len(region.outputs), region.goes_on
        function, slot = self.lanes.region(region), self.lanes.rows.get(id(region))
        rows = "null" if slot is None else self.argument(slot)
        state, after = lines.memory(len(e.operands)), lines.scratch("%after", size + 1)
        self._given(e.operands, state)
        before, loop = lines.block, lines.name("loop")
        turn, turns, runs, goes = (lines.name(f"%{x}") for x in ("turn", "turns", "runs", "goes"))
        lines.line(f"br label %{loop}")
        lines.label(loop)
        lines.line(f"{turn} = phi i64 [0, %{before}], [{turns}, %{loop}]")
        if mask is not None:
            lines.line(
                f"{runs} = phi {lines.M} [{lines.truth(True)}, %{before}], [{goes}, %{loop}]"
            )
        lines.line(
            f"call void {function}(ptr {state}, ptr {after}, ptr %u, ptr %a, i64 %at, i64 {turn}, "
            f"ptr {rows})"
        )
        for i in range(size):
            found = lines.load(after, i)
            if mask is not None:
                found = lines.select(runs, found, lines.load(state, i))
            lines.store(found, state, i)
        lines.line(f"{turns} = add i64 {turn}, 1")
        more = lines.new(f"icmp ult i64 {turns}, {region.most}")
        if mask is not None:
            wants = lines.compare("une", lines.load(after, size), lines.number(0.0))
            lines.line(f"{goes} = and {lines.M} {runs}, {wants}")
            more = lines.new(f"and i1 {more}, {lines.any(goes)}")
        lines.line(f"br i1 {more}, label %{loop}, label %{loop}_end")
        lines.label(f"{loop}_end")
        self.place[e.number] = (state, 0)

    def _outside(self, e: Expression, outside: Outside) -> None:
        """Call a function outside, lane by lane."""
        lines, count, W = self.lines, 1 + outside.count, self.lines.width
        found = lines.memory(count)
        given, results = lines.scratch("%given", len(e.operands)), lines.scratch("%after", count)
        function = self.argument(outside.name)
        values = [self.value(o) for o in e.operands]
        for lane in range(W):
            for i, value in enumerate(values):
                lines.store_one(lines.lane(value, lane), given, i)
            number = lines.new(f"add i64 %at, {lane}")
            lines.line(f"call void {function}(i64 {number}, ptr {given}, ptr {results})")
            for i in range(count):
                lines.store_one(lines.load_one(results, i), found, i * W + lane)
        self.place[e.number] = (found, 0)
