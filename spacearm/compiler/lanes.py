"""Tapes as LLVM's intermediate language, in which each number is one vector of lanes.

Lanes are configurations computed side by side. Every region is a function of memory: it loads its
variables from `%in` and writes what it computes to `%out`, both vectors of lanes. What all lanes
share is in `%u`: what is given, then what `prepare` computes of it, by the numbers of the
expressions, there as single numbers and for all else as vectors. `%a` has the addresses of the
arguments of the kernel and then the numbers of their last rows; `%at` is the number of the first
lane.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from struct import pack
from typing import Any

import numpy as np

from spacearm.compiler.expressions import Expression, Operand, Tape
from spacearm.compiler.operations import OPERATIONS, sine_cosine
from spacearm.compiler.symbols import Outside, Region, Rows, Traced, trace

DECLARE_FMA = "declare {V} @llvm.fma.{S}({V}, {V}, {V})"
IS_NOT_ZERO = "fcmp une {V} {0}, {zero}"


@cache
def template(text: str, operands: int, width: int) -> str:
    """Return an instruction as `operations` has it for so many lanes, with %s for operands."""
    if text.startswith("@"):
        given = ", ".join(f"{{V}} {{{i}}}" for i in range(operands))
        text = f"call {{V}} {text}.{{S}}({given})"
    words = {
        "V": _vector("double", width), "S": "f64" if width == 1 else f"v{width}f64",
        "M": _vector("i1", width), "true": _same("i1 true", width), "zero": _number(0.0, width),
    }  # fmt: skip
    return text.format(*["%s"] * operands, **words)


def _vector(kind: str, width: int) -> str:
    return kind if width == 1 else f"<{width} x {kind}>"


def _same(value: str, width: int) -> str:
    return value.split()[1] if width == 1 else f"splat ({value})"


def _number(value: float, width: int) -> str:
    return _same(f"double 0x{pack('>d', value).hex()}", width)


class Instructions:
    """The lines of a function.

    Args:
        width: Number of lanes.

    Attributes:
        V: The type of a number in all lanes.
        M: The type of a mask.
        block: Name of the block that is being written.
    """

    def __init__(self, width: int) -> None:
        self.width = width
        self.V, self.M = _vector("double", width), _vector("i1", width)
        self.block = "entry"
        self._lines: list[str] = []
        self._memory: list[str] = []
        self._scratch: dict[str, int] = {}
        self._count = 0

    def __str__(self) -> str:
        scratch = [f"{name} = {self._vectors(size)}" for name, size in self._scratch.items()]
        return "\n".join(("entry:", *self._memory, *scratch, *self._lines))

    def line(self, text: str) -> None:
        """Write a line."""
        self._lines.append(text)

    def label(self, name: str) -> None:
        """Begin a block."""
        self._lines.append(f"{name}:")
        self.block = name

    def name(self, kind: str) -> str:
        """Return a name that is not used yet."""
        self._count += 1
        return f"{kind}{self._count}"

    def new(self, text: str) -> str:
        """Write an instruction that gives a value, and return its name."""
        self._count += 1
        name = f"%v{self._count}"
        self._lines.append(f"{name} = {text}")
        return name

    def operate(self, text: str, *operands: str) -> str:
        """Write an operation, as `operations` has it, and return the name of its value."""
        return self.new(template(text, len(operands), self.width) % operands)

    def any(self, mask: str) -> str:
        """Tell whether a mask is true in any lane."""
        if self.width == 1:
            return mask
        return self.new(f"call i1 @llvm.vector.reduce.or.v{self.width}i1({self.M} {mask})")

    def number(self, value: float) -> str:
        """Return a number in all lanes."""
        return _number(value, self.width)

    def splat(self, name: str) -> str:
        """Return a number of one lane in all."""
        if self.width == 1:
            return name
        one = self.new(f"insertelement {self.V} poison, double {name}, i32 0")
        return self._shuffled(one, one, [0] * self.width)

    def lane(self, name: str, lane: int) -> str:
        """Return the number of one lane."""
        return name if self.width == 1 else self.new(f"extractelement {self.V} {name}, i32 {lane}")

    def joined(self, lanes: Sequence[str]) -> str:
        """Return numbers of single lanes as a vector."""
        if self.width == 1:
            return lanes[0]
        found = "poison"
        for i, name in enumerate(lanes):
            found = self.new(f"insertelement {self.V} {found}, double {name}, i32 {i}")
        return found

    def at(self, kind: str, address: str, index: int | str) -> str:
        """Return the address of an element of an array."""
        if index == 0:
            return address
        return self.new(f"getelementptr {kind}, ptr {address}, i64 {index}")

    def memory(self, size: int) -> str:
        """Reserve memory for vectors of lanes, and return its address."""
        name = self.name("%m")
        self._memory.append(f"{name} = {self._vectors(size)}")
        return name

    def scratch(self, name: str, size: int) -> str:
        """Return memory that is used again under the same name, at least so large."""
        self._scratch[name] = max(size, self._scratch.get(name, 1))
        return name

    def _vectors(self, size: int) -> str:
        return f"alloca [{max(size, 1)} x {self.V}], align 64"

    def load(self, memory: str, index: int) -> str:
        """Load a vector of lanes."""
        return self.new(f"load {self.V}, ptr {self.at(self.V, memory, index)}, align 8")

    def store(self, value: str, memory: str, index: int) -> None:
        """Store a vector of lanes."""
        self.line(f"store {self.V} {value}, ptr {self.at(self.V, memory, index)}, align 8")

    def load_one(self, address: str, index: int | str) -> str:
        """Load a number of one lane."""
        return self.new(f"load double, ptr {self.at('double', address, index)}, align 8")

    def store_one(self, value: str, address: str, index: int | str) -> None:
        """Store a number of one lane."""
        self.line(f"store double {value}, ptr {self.at('double', address, index)}, align 8")

    def gather(self, rows: Sequence[str], size: int) -> list[str]:
        """Load rows of `size` numbers, one row a lane, and return the numbers in all lanes."""
        found: list[str] = []
        whole = size - size % self.width
        for k in range(0, whole, self.width):
            at = [self.at("double", row, k) for row in rows]
            found += self._transposed([self.load(address, 0) for address in at])
        for k in range(whole, size):
            found.append(self.joined([self.load_one(row, k) for row in rows]))
        return found

    def scatter(self, values: Sequence[str], rows: Sequence[str]) -> None:
        """Store numbers in all lanes as rows, one row a lane."""
        W = self.width
        whole = len(values) - len(values) % W
        for k in range(0, whole, W):
            for row, numbers in zip(rows, self._transposed(values[k : k + W]), strict=True):
                self.store(numbers, self.at("double", row, k), 0)
        for k in range(whole, len(values)):
            for lane, row in enumerate(rows):
                self.store_one(self.lane(values[k], lane), row, k)

    def _transposed(self, vectors: Sequence[str]) -> list[str]:
        """Return the transpose of a square of vectors, by halves that are exchanged."""
        found, half, lanes = list(vectors), self.width // 2, range(self.width)
        while half:
            low = [j if not j & half else (j ^ half) + self.width for j in lanes]
            high = [j | half if not j & half else j + self.width for j in lanes]
            for i in lanes:
                if not i & half:
                    a, b = found[i], found[i | half]
                    found[i], found[i | half] = (self._shuffled(a, b, c) for c in (low, high))
            half //= 2
        return found

    def _shuffled(self, a: str, b: str, lanes: Sequence[int]) -> str:
        """Return lanes of two vectors, which are numbered one after the other."""
        V, chosen = self.V, ", ".join(f"i32 {lane}" for lane in lanes)
        return self.new(f"shufflevector {V} {a}, {V} {b}, <{len(lanes)} x i32> <{chosen}>")


#: Functions of the system's library.
DECLARED = [f"declare double @{name}({', '.join(['double'] * operation.numpy.nin)})"
            for name, operation in OPERATIONS.items() if not operation.llvm]  # fmt: skip
NEGATIVE, SELECT = OPERATIONS["neg"].llvm, OPERATIONS["select"].llvm


@cache
def _angles() -> Traced:
    """Return the function of sine and cosine."""
    return trace(sine_cosine, {"x": ()})


class Lanes:
    """The text of a kernel.

    Args:
        traced: The function.
        width: Number of lanes.
        fused: Whether a b + c is rounded once where a b is used nowhere else. The processor must
            know that operation.

    Attributes:
        taken: What the lanes take of what they share.
        slot: Numbers of the arguments of the kernel.
        rows: Those of the outputs that are rows of a loop, by its region.
    """

    def __init__(self, traced: Traced, width: int, fused: bool) -> None:
        self.traced, self.width, self.fused = traced, width, fused
        self.taken: set[Expression] = set()
        self._functions: dict[str, str] = {}
        self._regions: dict[int, str] = {}
        slots = [*traced.inputs, *range(len(traced.outputs)), *traced.tables, *traced.outside]
        self.slot: dict[Any, int] = {name: i for i, name in enumerate(slots)}
        self.rows = {id(o.loop.detail): i
                     for i, o in enumerate(traced.outputs) if isinstance(o, Rows)}  # fmt: skip

    def text(self) -> str:
        """Return the whole module, whose entries are `prepare` and `run`."""
        run, prepare = self._run(), self._prepare()
        often = template(DECLARE_FMA, 0, self.width)  # LLVM declares its own functions, but slowly
        return "\n".join((*DECLARED, often, *self._functions.values(), prepare, run, ""))

    def angles(self, width: int) -> str:
        """Return the name of the function of an angle in all lanes, which gives sine and cosine."""
        name, traced = f"@sine_cosine{width}", _angles()
        if name not in self._functions:
            code = _Body(self, width)
            code.known[traced.tape.written[0].number] = "%x"
            code.compute(traced.tape, traced.outputs)
            *near, large = map(code.value, traced.outputs)
            code.line(f"br i1 {code.any(large)}, label %far, label %near")
            code.label("near")
            code.give(near)
            code.label("far")
            code.give([code.operate(SELECT, large, code.library(function, "%x"), value)
                       for function, value in zip(("sin", "cos"), near, strict=True)])  # fmt: skip
            head = f"define internal {code.pair} {name}({code.V} %x)"
            self._functions[name] = f"{head} {{\n{code}\n}}"
        return name

    def region(self, region: Region) -> str:
        """Return the name of the function of a region, written once."""
        if id(region) not in self._regions:
            name = self._regions[id(region)] = f"@region{len(self._regions)}"
            code = _Body(self, self.width)
            code.place = {e.number: ("%in", i) for i, e in enumerate(region.variables)}
            if region.turn is not None:
                turn = code.new("sitofp i64 %turn to double")
                code.known[region.turn.number] = code.splat(turn)
            kept = (region.kept or []) if id(region) in self.rows else []
            outputs = [*region.outputs, *([] if region.goes_on is None else [region.goes_on])]
            code.compute(region.tape, [*outputs, *kept])
            code.store_all(outputs, "%out")
            if kept:
                code.write(kept, "%rows", region.most)
            self._functions[name] = (
                f"define internal void {name}(ptr noalias %in, ptr noalias %out, ptr noalias %u, "
                f"ptr %a, i64 %at, i64 %turn, ptr %rows) {{\n{code}\nret void\n}}"
            )
        return self._regions[id(region)]

    def _prepare(self) -> str:
        """Return the function that computes what all lanes share."""
        tape, code = self.traced.shared, _Body(self, 1, shared=True)
        code.place = {e.number: ("%u", e.number) for e in tape.written if e.operation == "var"}
        for e in tape.needed(self.taken):
            if e.operation == "var":
                continue
            value = code.known[e.number] = code.operation(e)
            if e in self.taken:
                value = code.new(f"uitofp i1 {value} to double") if e.is_mask else value
                code.store(value, "%u", e.number)
        return f"define void @prepare(ptr noalias %u) {{\n{code}\nret void\n}}"

    def _run(self) -> str:
        """Return the function that computes blocks of lanes; the last ones at `%most`."""
        traced, code = self.traced, _Body(self, self.width)
        code.line("br label %block")
        code.label("block")
        code.line("%i = phi i64 [%first, %entry], [%next, %done]")
        code.line(f"%begin = mul i64 %i, {self.width}")
        code.line("%at = call i64 @llvm.smin.i64(i64 %begin, i64 %most)")
        variables = (e for e in traced.tape.written if e.operation == "var")
        for name, shape in traced.inputs.items():
            size = int(np.prod(shape))
            found = code.gather(code.rows(code.argument(name), size), size)
            for value, e in zip(found, variables, strict=False):
                code.known[e.number] = value
        loops = [o.loop for o in traced.outputs if isinstance(o, Rows)]
        flat = {i: traced.flat(o) for i, o in enumerate(traced.outputs) if not isinstance(o, Rows)}
        code.compute(traced.tape, [*loops, *(o for values in flat.values() for o in values)])
        for i, values in flat.items():
            if values:
                code.write(values, code.argument(i))
        code.line("br label %done")
        code.label("done")
        code.line("%next = add i64 %i, 1")
        code.line("%more = icmp slt i64 %next, %last")
        code.line("br i1 %more, label %block, label %end")
        code.label("end")
        return (
            f"define void @run(ptr noalias %a, ptr noalias %u, i64 %most, i64 %first, i64 %last) "
            f"{{\n{code}\nret void\n}}"
        )


class _Body(Instructions):
    """The expressions of one tape as instructions.

    Attributes:
        pair: The type of two numbers in all lanes.
        shared: Whether the tape is the shared one.
        known: Names of the values of expressions of the tape, by number.
        place: Where variables and results lie: memory and index.
    """

    def __init__(self, lanes: Lanes, width: int, shared: bool = False) -> None:
        super().__init__(width)
        self.lanes, self.shared = lanes, shared
        self.pair = f"{{{self.V}, {self.V}}}"
        self.known: dict[int, str] = {}
        self.place: dict[int, tuple[str, int]] = {}
        self._taken: dict[int, str] = {}
        self._negative: dict[str, str] = {}
        self._angles: dict[str, str] = {}
        self._looked: dict[tuple[str, str], list[str]] = {}

    def library(self, name: str, *operands: str) -> str:
        """Call a function of the system's library, lane by lane."""
        found = []
        for lane in range(self.width):
            given = ", ".join(f"double {self.lane(o, lane)}" for o in operands)
            found.append(self.new(f"call double @{name}({given})"))
        return self.joined(found)

    def argument(self, slot: int | str) -> str:
        """Return the address of an argument of the kernel."""
        return self.new(f"load ptr, ptr {self.at('ptr', '%a', self.lanes.slot[slot])}")

    def rows(self, address: str, size: int, most: int = 1) -> list[str]:
        """Return the address of the row of each lane, of `size` numbers; `%turn` of `most`."""
        first = self.new(f"mul i64 %at, {size * most}")
        if most > 1:
            first = self.new(f"add i64 {first}, {self.new(f'mul i64 %turn, {size}')}")
        base = self.at("double", address, first)
        return [self.at("double", base, lane * size * most) for lane in range(self.width)]

    def write(self, values: list[Operand], address: str, most: int = 1) -> None:
        """Write numbers to the rows of the lanes."""
        self.scatter([self.value(o) for o in values], self.rows(address, len(values), most))

    def store_all(self, operands: Iterable[Operand], memory: str) -> None:
        """Store operands side by side."""
        for i, o in enumerate(operands):
            self.store(self.value(o), memory, i)

    def value(self, o: Operand) -> str:
        """Return the name of a number or mask in all lanes."""
        if not isinstance(o, Expression):
            return self.number(o)
        if o.tape.depth == 0 and not self.shared:
            if o.number not in self._taken:
                self.lanes.taken.add(o)
                one = self.load("%u", o.number)
                self._taken[o.number] = self.operate(IS_NOT_ZERO, one) if o.is_mask else one
            return self._taken[o.number]
        if o.number not in self.known:
            self.known[o.number] = self.load(*self.place[o.number])
        return self.known[o.number]

    def compute(self, tape: Tape, outputs: Sequence[Any]) -> None:
        """Write all that outputs on a tape need."""
        needed = tape.needed(outputs)
        products = self._products(tape, needed, outputs) if self.lanes.fused else {}
        inside = {product.number for product in products.values()}
        for e in needed:
            if e.operation == "var" or e.number in inside:
                continue
            if e.number in products:
                self.known[e.number] = self._product(e, products[e.number])
            elif e.operation in OPERATIONS:
                self.known[e.number] = self.operation(e)
            elif e.operation == "load":
                self.known[e.number] = self._load(e)
            elif e.operation == "result":
                memory, first = self.place[e.expressions()[0].number]
                self.place[e.number] = memory, first + e.detail
            else:
                getattr(self, f"_{e.operation}")(e, e.detail)

    def _products(
        self, tape: Tape, needed: Sequence[Expression], outputs: Iterable[Any]
    ) -> dict[int, Expression]:
        """Return the products that are computed with the only sum or difference they stand in."""
        uses = [0] * len(tape.written)
        for operands in (outputs, *(e.operands for e in needed)):
            for o in operands:
                if type(o) is Expression and o.tape is tape:
                    uses[o.number] += 1
        found: dict[int, Expression] = {}
        for e in needed:
            if e.operation in ("add", "sub"):
                for o in reversed(e.expressions()):
                    if o.operation == "mul" and o.tape is tape and uses[o.number] == 1:
                        found[e.number] = o
                        break
        return found

    def _product(self, e: Expression, product: Expression) -> str:
        """Compute a b + c, a b - c or c - a b, rounded once."""
        a, b = (self.value(o) for o in product.operands)
        first = e.operands[0] is product
        c = self.value(e.operands[1 if first else 0])
        if e.operation == "sub":
            minus = self._minus(c if first else a)
            a, c = (a, minus) if first else (minus, c)
        return self.operate("@llvm.fma", a, b, c)

    def _minus(self, value: str) -> str:
        if value not in self._negative:
            self._negative[value] = self.operate(NEGATIVE, value)
        return self._negative[value]

    def operation(self, e: Expression) -> str:
        """Write an operation and return the name of its value."""
        values, operation = [self.value(o) for o in e.operands], OPERATIONS[e.operation]
        if operation.llvm:
            return self.operate(operation.llvm, *values)
        if e.operation in ("sin", "cos"):
            return self._angle(e.operation, values[0])
        return self.library(e.operation, *values)

    def _angle(self, name: str, x: str) -> str:
        """Return the sine or cosine of an angle, for which the function is called once."""
        if x not in self._angles:
            function = self.lanes.angles(self.width)
            self._angles[x] = self.new(f"call {self.pair} {function}({self.V} {x})")
        return self.new(f"extractvalue {self.pair} {self._angles[x]}, {int(name == 'cos')}")

    def give(self, values: Sequence[str]) -> None:
        """Return two numbers from a function."""
        found = "poison"
        for i, value in enumerate(values):
            found = self.new(f"insertvalue {self.pair} {found}, {self.V} {value}, {i}")
        self.line(f"ret {self.pair} {found}")

    def _load(self, e: Expression) -> str:
        """Load a number of a table."""
        table, column = e.detail
        index = self.value(e.operands[0])
        if (table, index) not in self._looked:
            self._looked[table, index] = self._rows_of(table, index)
        return self.joined([self.load_one(row, column) for row in self._looked[table, index]])

    def _rows_of(self, table: str, index: str) -> list[str]:
        """Return the addresses of rows of a table, one a lane."""
        lanes, address, found = self.lanes, self.argument(table), []
        last = self.at("i64", "%a", len(lanes.slot) + lanes.slot[table])
        last = self.new(f"load i64, ptr {last}")
        for lane in range(self.width):
            one = self.lane(index, lane)
            i = self.new(f"call i64 @llvm.fptosi.sat.i64.f64(double {one})")  # NaN gives 0
            i = self.new(f"call i64 @llvm.smin.i64(i64 {i}, i64 {last})")
            i = self.new(f"call i64 @llvm.smax.i64(i64 {i}, i64 0)")
            i = self.new(f"mul i64 {i}, {lanes.traced.tables[table].columns}")
            found.append(self.at("double", address, i))
        return found

    def _call(self, e: Expression, region: Region) -> None:
        """Call a procedure."""
        given = self.scratch("%given", len(e.operands))
        found = self.memory(len(region.outputs))
        self.store_all(e.operands, given)
        self._run_region(region, given, found)
        self.place[e.number] = (found, 0)

    def _run_region(
        self, region: Region, given: str, found: str, turn: str = "0", rows: str = "null"
    ) -> None:
        self.line(
            f"call void {self.lanes.region(region)}(ptr {given}, ptr {found}, ptr %u, ptr %a, "
            f"i64 %at, i64 {turn}, ptr {rows})"
        )

    def _loop(self, e: Expression, region: Region) -> None:
        """Run a loop, in which lanes that have ended keep their state."""
        size, slot, stops = len(region.outputs), self.lanes.rows.get(id(region)), region.goes_on
        rows = "null" if slot is None else self.argument(slot)
        state, after = self.memory(len(e.operands)), self.scratch("%after", size + 1)
        self.store_all(e.operands, state)
        before, loop = self.block, self.name("loop")
        turn, turns, runs, goes = (self.name(f"%{x}") for x in ("turn", "turns", "runs", "goes"))
        self.line(f"br label %{loop}")
        self.label(loop)
        self.line(f"{turn} = phi i64 [0, %{before}], [{turns}, %{loop}]")
        if stops is not None:
            every = "true" if self.width == 1 else "splat (i1 true)"
            self.line(f"{runs} = phi {self.M} [{every}, %{before}], [{goes}, %{loop}]")
        self._run_region(region, state, after, turn, rows)
        for i in range(size):
            found = self.load(after, i)
            if stops is not None:
                found = self.operate(SELECT, runs, found, self.load(state, i))
            self.store(found, state, i)
        self.line(f"{turns} = add i64 {turn}, 1")
        more = self.new(f"icmp ult i64 {turns}, {region.most}")
        if stops is not None:
            wants = self.operate(IS_NOT_ZERO, self.load(after, size))
            self.line(f"{goes} = and {self.M} {runs}, {wants}")
            more = self.new(f"and i1 {more}, {self.any(goes)}")
        self.line(f"br i1 {more}, label %{loop}, label %{loop}_end")
        self.label(f"{loop}_end")
        self.place[e.number] = (state, 0)

    def _outside(self, e: Expression, outside: Outside) -> None:
        """Call a function outside, lane by lane."""
        count, W, function = 1 + outside.count, self.width, self.argument(outside.name)
        found = self.memory(count)
        given, results = self.scratch("%given", len(e.operands)), self.scratch("%after", count)
        values = [self.value(o) for o in e.operands]
        for lane in range(W):
            for i, value in enumerate(values):
                self.store_one(self.lane(value, lane), given, i)
            number = self.new(f"add i64 %at, {lane}")
            self.line(f"call void {function}(i64 {number}, ptr {given}, ptr {results})")
            for i in range(count):
                self.store_one(self.load_one(results, i), found, i * W + lane)
        self.place[e.number] = (found, 0)
