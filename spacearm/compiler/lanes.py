"""Tapes as LLVM's intermediate language, in which each number is one vector of lanes.

Lanes are configurations computed side by side. Every region is a function of memory: it loads its
variables from `%in` and writes what it computes to `%out`, both vectors of lanes. What all lanes
share is in `%u`: what is given, then what `prepare` computes of it, by the numbers of the
expressions, there as single numbers and for all else as vectors. `%a` has the addresses of the
arguments of the kernel and then the numbers of their last rows; `%at` is the number of the first
lane.

The values of a long tape need more stack than a thread has. So a function is cut into sections,
each of them a function of its own. They are so short that a call of the kernel needs no more than
`STACK` bytes of the stack. Numbers that a later section needs are kept in the memory at `%m`, which
whoever calls the kernel provides; arrays lie there too. Text that LLVM optimises is cut only where
the values that are alive at once need too much, since numbers in memory cost time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from itertools import accumulate, islice
from math import inf
from typing import Any, NamedTuple

import numpy as np

from spacearm.compiler.expressions import Expression, Operand, Tape
from spacearm.compiler.instructions import FIXED, SCALAR, SPARE, Instructions, template
from spacearm.compiler.operations import OPERATIONS, sine_cosine
from spacearm.compiler.symbols import Outside, Region, Rows, Traced, trace

DECLARE_FMA = "declare {V} @llvm.fma.{S}({V}, {V}, {V})"
IS_NOT_ZERO = "fcmp une {V} {0}, {zero}"
AS_NUMBER = "select {M} {0}, {V} {1}, {V} {2}"
#: Most stack that a call of a kernel needs, functions of the system's library and functions outside
#: left out [bytes]. A thread has 128 KB or more, of which Python takes some.
STACK = 96 * 1024
#: A section ends where its values need more of the stack than this [bytes], or less if a kernel
#: does not keep to `STACK`.
SECTION = 64 * 1024
#: By how much a section is shorter at least if a kernel did not keep to `STACK`.
SHORTER = 0.9
#: The state of a loop is kept by a function of its own where it has more numbers than this.
UNROLLED = 16

#: Functions of the system's library.
DECLARED = [f"declare double @{name}({', '.join(['double'] * operation.numpy.nin)})"
            for name, operation in OPERATIONS.items() if not operation.llvm]  # fmt: skip
NEGATIVE, SELECT = OPERATIONS["neg"].llvm, OPERATIONS["select"].llvm


class Function(NamedTuple):
    """A function of the module.

    Attributes:
        name: Its name.
        stack: Bound of the stack that a call needs, functions that it calls included [bytes].
        memory: Size of the memory that it needs, in vectors of lanes.
    """

    name: str
    stack: int
    memory: int


@cache
def _angles() -> Traced:
    """Return the function of sine and cosine."""
    return trace(sine_cosine, {"x": ()})


#: Keeps the numbers of a loop where lanes go on: the state, the numbers after a turn, how many.
KEEP = """define internal void @keep(ptr %state, ptr %after, {M} %runs, i64 %size) noinline {{
entry:
br label %each
each:
%i = phi i64 [0, %entry], [%next, %each]
%here = getelementptr {V}, ptr %state, i64 %i
%there = getelementptr {V}, ptr %after, i64 %i
%old = load {V}, ptr %here, align 8
%new = load {V}, ptr %there, align 8
%kept = select {M} %runs, {V} %new, {V} %old
store {V} %kept, ptr %here, align 8
%next = add i64 %i, 1
%more = icmp ult i64 %next, %size
br i1 %more, label %each, label %end
end:
ret void
}}"""


class Lanes:
    """The text of a kernel.

    Args:
        traced: The function.
        width: Number of lanes.
        fused: Whether a b + c is rounded once where a b is used nowhere else. The processor must
            know that operation.
        optimised: Whether the text is for LLVM to optimise, so that values share places on the
            stack.

    Attributes:
        section: A section ends where its values need more of the stack than this [bytes].
        taken: What the lanes take of what they share.
        stack: Bound of the stack that machine code needs, without functions of the system's library
            and functions outside [bytes].
        unshared: The same if no values share places on the stack, all functions together.
        memory: Size of the memory that `run` needs, in vectors of lanes.
        slot: Numbers of the arguments of the kernel.
        rows: Those of the outputs that are rows of a loop, by its region.
    """

    def __init__(self, traced: Traced, width: int, fused: bool, optimised: bool = False) -> None:
        self.traced, self.width, self.fused, self.optimised = traced, width, fused, optimised
        self.section = SECTION
        slots = [*traced.inputs, *range(len(traced.outputs)), *traced.tables, *traced.outside]
        self.slot: dict[Any, int] = {name: i for i, name in enumerate(slots)}
        self.rows = {id(o.loop.detail): i
                     for i, o in enumerate(traced.outputs) if isinstance(o, Rows)}  # fmt: skip

    def text(self) -> str:
        """Return the whole module, whose entries are `prepare` and `run`."""
        run, prepare = self._written()
        while self.stack > STACK and self.section > 1:
            self.section = int(SHORTER * self.section * STACK / self.stack)
            run, prepare = self._written()
        often = template(DECLARE_FMA, 0, self.width)  # LLVM declares its own functions, but slowly
        return "\n".join((*DECLARED, often, *self._functions.values(), prepare, run, ""))

    def _written(self) -> tuple[str, str]:
        """Write the functions; return `run` and `prepare`."""
        self.taken: set[Expression] = set()
        self.stack = self.memory = self.unshared = 0
        self._functions: dict[str, str] = {}
        self._angles: dict[int, Function] = {}
        self._regions: dict[int, Function] = {}
        return self._run(), self._prepare()

    def angles(self, width: int) -> Function:
        """Return the function of an angle in all lanes, which gives sine and cosine."""
        if width not in self._angles:
            name, traced = f"@sine_cosine{width}", _angles()
            code = _Body(self, width, whole=True)
            code.plan(traced.tape, traced.outputs)
            code.known[traced.tape.written[0].number] = "%x"
            code.compute()
            *near, large = map(code.value, traced.outputs)
            code.line(f"br i1 {code.any(large)}, label %far, label %near")
            code.label("near")
            code.give(near)
            code.label("far")
            code.give([code.operate(SELECT, large, code.library(function, "%x"), value)
                       for function, value in zip(("sin", "cos"), near, strict=True)])  # fmt: skip
            (section,) = code.sections
            self._functions[name] = (
                f"define internal {code.pair} {name}({code.V} %x) {code.aligned}"
                f"{{\nentry:\n{code.text(section)}\n}}"
            )
            self._angles[width] = Function(name, section.stack, 0)
            self.unshared += FIXED + section.values
        return self._angles[width]

    def region(self, region: Region) -> Function:
        """Return the function of a region, written once."""
        if id(region) not in self._regions:
            name = f"@region{len(self._regions)}"
            self._regions[id(region)] = Function(name, 0, 0)  # numbers go to those around first
            code = _Body(self, self.width)
            kept = (region.kept or []) if id(region) in self.rows else []
            outputs = [*region.outputs, *([] if region.goes_on is None else [region.goes_on])]
            code.plan(region.tape, [*outputs, *kept])
            code.place = {e.number: ("%in", i) for i, e in enumerate(region.variables)}
            if region.turn is not None:
                turn = code.new("sitofp i64 %turn to double", scalars=1)
                code.known[region.turn.number] = code.splat(turn)
            code.compute()
            code.store_all(outputs, "%out")
            if kept:
                code.write(kept, None, region.most)
            parameters = {
                "%in": "ptr noalias", "%out": "ptr noalias", "%u": "ptr noalias", "%a": "ptr",
                "%at": "i64", "%turn": "i64", "%rows": "ptr", "%m": "ptr noalias",
            }  # fmt: skip
            stack = self._sections(name, code, parameters)
            self._regions[id(region)] = Function(name, stack, code.memory + code.below)
        return self._regions[id(region)]

    def keep(self) -> Function:
        """Return the function that keeps the state of a loop where lanes go on."""
        types = Instructions(self.width)
        self._functions["@keep"] = KEEP.format(V=types.V, M=types.M)
        stack = FIXED + 4 * SCALAR * (self.width + 1)
        self.unshared += stack
        return Function("@keep", stack, 0)

    def _sections(self, name: str, code: _Body, parameters: dict[str, str]) -> int:
        """Write a function as one, or as sections that it calls; return the stack that it needs."""
        stack = max(section.stack for section in code.sections)
        self.unshared += 2 * FIXED + max(section.values for section in code.sections)
        given = ", ".join(f"{kind} {name}" for name, kind in parameters.items())
        if len(code.sections) == 1:
            self._functions[name] = (
                f"define internal void {name}({given}) {code.aligned}"
                f"{{\n{code.entry()}\n{code.text(code.sections[0])}\nret void\n}}"
            )
            return stack
        calls = []
        for i, section in enumerate(code.sections):
            part = f"{name}_{i}"
            self._functions[part] = (
                f"define internal void {part}({given}) noinline {code.aligned}"
                f"{{\n{code.entry()}\n{code.text(section)}\nret void\n}}"
            )
            passed = ", ".join(f"{kind.split()[0]} {name}" for name, kind in parameters.items())
            calls.append(f"call void {part}({passed})")
        body = "\n".join(calls)
        self._functions[name] = f"define internal void {name}({given}) {{\n{body}\nret void\n}}"
        return FIXED + stack

    def _prepare(self) -> str:
        """Return the function that computes what all lanes share."""
        tape, code = self.traced.shared, _Body(self, 1, shared=True)
        code.plan(tape, [*self.taken])
        code.place = {e.number: ("%u", e.number) for e in tape.written if e.operation == "var"}
        for e in code.steps():
            if e.number not in code.known:
                code.known[e.number] = code.operation(e)
            if e in self.taken:
                code.keep(e)
        stack = self._sections("@prepare_all", code, {"%u": "ptr noalias", "%m": "ptr"})
        self.stack = max(self.stack, FIXED + stack)
        return (
            "define void @prepare(ptr noalias %u) {\n"
            "call void @prepare_all(ptr %u, ptr null)\nret void\n}"
        )

    def _run(self) -> str:
        """Return the function that computes blocks of lanes; the last ones at `%most`."""
        traced, code = self.traced, _Body(self, self.width)
        loops = [o.loop for o in traced.outputs if isinstance(o, Rows)]
        flat = {i: traced.flat(o) for i, o in enumerate(traced.outputs) if not isinstance(o, Rows)}
        code.plan(traced.tape, [*loops, *(o for values in flat.values() for o in values)])
        variables = (e for e in traced.tape.written if e.operation == "var")
        for name, shape in traced.inputs.items():
            code.read(name, [*islice(variables, int(np.prod(shape)))])
        code.compute()
        for i, values in flat.items():
            if values:
                code.write(values, i)
        head = (
            "br label %block\n"
            "block:\n"
            "%i = phi i64 [%first, %entry], [%next, %done]\n"
            f"%begin = mul i64 %i, {self.width}\n"
            "%at = call i64 @llvm.smin.i64(i64 %begin, i64 %most)"
        )
        tail = (
            "br label %done\n"
            "done:\n"
            "%next = add i64 %i, 1\n"
            "%more = icmp slt i64 %next, %last\n"
            "br i1 %more, label %block, label %end\n"
            "end:\n"
            "ret void"
        )
        self.memory = code.memory + code.below
        if len(code.sections) == 1:
            (section,) = code.sections
            entry, body, stack = code.entry(), code.text(section), section.stack
            self.unshared += FIXED + section.values
        else:
            parameters = {"%a": "ptr noalias", "%u": "ptr noalias", "%at": "i64"}
            stack = FIXED + self._sections("@lanes", code, parameters | {"%m": "ptr noalias"})
            self.unshared += FIXED
            entry, body = "entry:", "call void @lanes(ptr %a, ptr %u, i64 %at, ptr %m)"
        self.stack = max(self.stack, stack)
        return (
            "define void @run(ptr noalias %a, ptr noalias %u, ptr noalias %m, i64 %most, "
            f"i64 %first, i64 %last) {code.aligned}{{\n{entry}\n{head}\n{body}\n{tail}\n}}"
        )


class _Body(Instructions):
    """The expressions of one tape as instructions.

    Attributes:
        pair: The type of two numbers in all lanes.
        shared: Whether the tape is the shared one.
        whole: Whether it is one section, however much stack that needs.
        known: Names of the values of expressions of the tape in this section, by number.
        place: Where variables, results and values of other sections lie: memory and index.
    """

    def __init__(self, lanes: Lanes, width: int, shared: bool = False, whole: bool = False) -> None:
        super().__init__(width)
        self.lanes, self.shared = lanes, shared
        self.pair = f"{{{self.V}, {self.V}}}"
        self.known: dict[int, str] = {}
        self.place: dict[int, tuple[str, int]] = {}
        self._whole, self._limit = whole, inf if whole else lanes.section
        self._step = 0
        self._free: list[int] = []
        self._slots: dict[int, int] = {}
        self._taken: dict[int, str] = {}
        self._negative: dict[str, str] = {}
        self._looked: dict[tuple[str, str], list[str]] = {}

    def plan(self, tape: Tape, outputs: Sequence[Any]) -> None:
        """Find out what outputs on a tape need, and for how long."""
        self._tape, self._needed = tape, tape.needed(outputs)
        fused = self.lanes.fused and not self.shared
        self._products = self._fused(outputs) if fused else {}
        self._inside = {product.number for product in self._products.values()}
        self._last: dict[int, int] = {}
        self._shares: dict[int, tuple[int, int]] = {}
        self._angles: dict[int, list[Expression]] = {}
        for step, e in enumerate(self._needed):
            if e.number in self._inside:
                continue
            operands = e.operands
            if e.number in self._products:
                operands = (*operands, *self._products[e.number].operands)
            for o in operands:
                if type(o) is Expression:
                    if o.tape is tape:
                        self._last[o.number] = step
                    else:
                        first, _ = self._shares.get(o.number, (step, step))
                        self._shares[o.number] = first, step
            if e.operation in ("sin", "cos"):
                self._angles.setdefault(e.expressions()[0].key, []).append(e)
        for o in outputs:
            if type(o) is Expression and o.tape is tape:
                self._last[o.number] = len(self._needed)
            elif type(o) is Expression:
                first, _ = self._shares.get(o.number, (len(self._needed),) * 2)
                self._shares[o.number] = first, len(self._needed)
        if self.lanes.optimised:
            alive = SPARE * SCALAR * self.width * (self._alive() + 2 * self.width)
            if self._whole or alive <= self.lanes.section:
                self._limit, self.sections[-1].alive = inf, alive

    def _alive(self) -> int:
        """Return how many values are alive at once; of what lanes share, those that are taken."""
        end = len(self._needed)
        changes = [0] * (end + 2)
        for step, e in enumerate(self._needed):
            changes[step] += 1
            changes[self._last.get(e.number, step) + 1] -= 1
        for first, last in self._shares.values():
            changes[first] += 1
            changes[last + 1] -= 1
        return max(accumulate(changes))

    def rest(self) -> None:
        """Begin another section if the values of this one need much of the stack."""
        if self.sections[-1].values <= self._limit:
            return
        over = [number for number in self._slots if self._last[number] < self._step]
        self._free += [self._slots.pop(number) for number in over]
        for number, name in self.known.items():
            if number not in self.place and self._last.get(number, -1) >= self._step:
                self._keep(self._tape.written[number], name)
        for names in (self.known, self._taken, self._negative, self._looked):
            names.clear()
        self.begin_section()

    def keep(self, e: Expression) -> None:
        """Keep the value of an expression in memory, for other sections and other functions."""
        self._keep(e, self.known[e.number])

    def _keep(self, e: Expression, name: str) -> None:
        if e.is_mask:
            name = self.operate(AS_NUMBER, name, self.number(1.0), self.number(0.0))
        if self.shared:
            self.place[e.number] = "%u", e.number
        else:
            slot = self._free.pop() if self._free else self.reserve(1)
            self._slots[e.number] = slot
            self.place[e.number] = "%m", slot
        self.store(name, *self.place[e.number])

    def library(self, name: str, *operands: str) -> str:
        """Call a function of the system's library, lane by lane."""
        found = []
        for lane in range(self.width):
            given = ", ".join(f"double {self.lane(o, lane)}" for o in operands)
            found.append(self.new(f"call double @{name}({given})", scalars=1))
        return self.joined(found)

    def argument(self, slot: int | str) -> str:
        """Return the address of an argument of the kernel."""
        return self.new(f"load ptr, ptr {self.at('ptr', '%a', self.lanes.slot[slot])}", scalars=1)

    def rows(self, address: str, size: int, most: int = 1) -> list[str]:
        """Return the address of the row of each lane, of `size` numbers; `%turn` of `most`."""
        first = self.new(f"mul i64 %at, {size * most}", scalars=1)
        if most > 1:
            turn = self.new(f"mul i64 %turn, {size}", scalars=1)
            first = self.new(f"add i64 {first}, {turn}", scalars=1)
        base = self.at("double", address, first)
        return [self.at("double", base, lane * size * most) for lane in range(self.width)]

    def read(self, name: str, variables: Sequence[Expression]) -> None:
        """Read the rows of an input, one row a lane, as variables."""
        size, W = len(variables), self.width
        whole = size - size % W
        section, rows = None, list[str]()
        for k in (*range(0, whole, W), *range(whole, size)):
            self.rest()
            if section is not self.sections[-1]:
                section, rows = self.sections[-1], self.rows(self.argument(name), size)
            at = [self.at("double", row, k) for row in rows]
            if k < whole:
                values = self.transposed([self.load(address, 0) for address in at])
            else:
                values = [self.joined([self.load_one(address, 0) for address in at])]
            for e, value in zip(variables[k:], values, strict=False):
                self.known[e.number] = value

    def write(self, values: Sequence[Operand], slot: int | None, most: int = 1) -> None:
        """Write numbers to the rows of the lanes: of an argument, or of a loop if None."""
        size, W = len(values), self.width
        whole = size - size % W
        section, rows = None, list[str]()
        for k in (*range(0, whole, W), *range(whole, size)):
            self.rest()
            if section is not self.sections[-1]:
                section = self.sections[-1]
                rows = self.rows("%rows" if slot is None else self.argument(slot), size, most)
            if k < whole:
                square = self.transposed([self.value(o) for o in values[k : k + W]])
                for row, numbers in zip(rows, square, strict=True):
                    self.store(numbers, self.at("double", row, k), 0)
            else:
                value = self.value(values[k])
                for lane, row in enumerate(rows):
                    self.store_one(self.lane(value, lane), row, k)

    def store_all(self, operands: Iterable[Operand], memory: str, first: int = 0) -> None:
        """Store operands side by side."""
        for i, o in enumerate(operands):
            self.rest()
            self.store(self.value(o), memory, first + i)

    def value(self, o: Operand) -> str:
        """Return the name of a number or mask in all lanes."""
        if not isinstance(o, Expression):
            return self.number(o)
        outer = o.tape.depth == 0 and not self.shared
        known = self._taken if outer else self.known
        if o.number not in known:
            if outer:
                self.lanes.taken.add(o)
            memory, index = ("%u", o.number) if outer else self.place[o.number]
            one = self.load(memory, index)
            known[o.number] = self.operate(IS_NOT_ZERO, one) if o.is_mask else one
        return known[o.number]

    def steps(self) -> Iterator[Expression]:
        """Give the expressions that must be computed one after the other, in sections."""
        for step, e in enumerate(self._needed):
            self._step = step
            self.rest()
            if e.operation != "var" and e.number not in self._inside:
                yield e
        self._step = len(self._needed)

    def compute(self) -> None:
        """Write all that is needed."""
        for e in self.steps():
            if e.number in self.known or e.number in self.place:
                continue
            if e.number in self._products:
                self.known[e.number] = self._product(e, self._products[e.number])
            elif e.operation in OPERATIONS:
                self.known[e.number] = self.operation(e)
            elif e.operation == "load":
                self.known[e.number] = self._load(e)
            elif e.operation == "result":
                memory, first = self.place[e.expressions()[0].number]
                self.place[e.number] = memory, first + e.detail
            else:
                getattr(self, f"_{e.operation}")(e, e.detail)

    def _fused(self, outputs: Iterable[Any]) -> dict[int, Expression]:
        """Return the products that are computed with the only sum or difference they stand in."""
        tape, needed = self._tape, self._needed
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
            return self._angle(e, values[0])
        return self.library(e.operation, *values)

    def _angle(self, e: Expression, x: str) -> str:
        """Return the sine or cosine of an angle; the function is called once for both."""
        function = self.lanes.angles(self.width)
        self._calls(function)
        call = f"call {self.pair} {function.name}({self.V} {x})"
        both = self.new(call, vectors=4)
        for each in self._angles[e.expressions()[0].key]:
            taken = f"extractvalue {self.pair} {both}, {int(each.operation == 'cos')}"
            self.known[each.number] = self.new(taken, vectors=1)
        return self.known[e.number]

    def _calls(self, function: Function) -> None:
        """Note the stack and memory of a function that is called."""
        section = self.sections[-1]
        section.called = max(section.called, function.stack)
        self.below = max(self.below, function.memory)

    def give(self, values: Sequence[str]) -> None:
        """Return two numbers from a function."""
        found = "poison"
        for i, value in enumerate(values):
            found = self.new(f"insertvalue {self.pair} {found}, {self.V} {value}, {i}", vectors=2)
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
        last = self.new(f"load i64, ptr {last}", scalars=1)
        for lane in range(self.width):
            one = self.lane(index, lane)
            i = self.new(f"call i64 @llvm.fptosi.sat.i64.f64(double {one})", scalars=8)  # 0 of NaN
            i = self.new(f"call i64 @llvm.smin.i64(i64 {i}, i64 {last})", scalars=2)
            i = self.new(f"call i64 @llvm.smax.i64(i64 {i}, i64 0)", scalars=3)
            i = self.new(f"mul i64 {i}, {lanes.traced.tables[table].columns}", scalars=2)
            found.append(self.at("double", address, i))
        return found

    def _call(self, e: Expression, region: Region) -> None:
        """Call a procedure."""
        given = self.scratch("given", len(e.operands))
        found = self.reserve(len(region.outputs))
        self.store_all(e.operands, "%m", given)
        self._run_region(region, given, found)
        self.place[e.number] = ("%m", found)

    def _run_region(
        self, region: Region, given: int, found: int, turn: str = "0", rows: str = "null"
    ) -> None:
        function = self.lanes.region(region)
        self._calls(function)
        at, to = self.at(self.V, "%m", given), self.at(self.V, "%m", found)
        self.line(
            f"call void {function.name}(ptr {at}, ptr {to}, ptr %u, ptr %a, "
            f"i64 %at, i64 {turn}, ptr {rows}, ptr %below)"
        )

    def _loop(self, e: Expression, region: Region) -> None:
        """Run a loop, in which lanes that have ended keep their state."""
        size, slot, stops = len(region.outputs), self.lanes.rows.get(id(region)), region.goes_on
        state, after = self.reserve(len(e.operands)), self.scratch("after", size + 1)
        self.store_all(e.operands, "%m", state)
        rows = "null" if slot is None else self.argument(slot)
        before, loop = self.block, self.name("loop")
        turn, turns, runs, goes = (self.name(f"%{x}") for x in ("turn", "turns", "runs", "goes"))
        every = "true" if self.width == 1 else "splat (i1 true)"
        self.line(f"br label %{loop}")
        self.label(loop)
        self.line(f"{turn} = phi i64 [0, %{before}], [{turns}, %{loop}]")
        if stops is not None:
            self.line(f"{runs} = phi {self.M} [{every}, %{before}], [{goes}, %{loop}]")
        self._run_region(region, state, after, turn, rows)
        self._keep_state(state, after, size, every if stops is None else runs)
        self.line(f"{turns} = add i64 {turn}, 1")
        more = self.new(f"icmp ult i64 {turns}, {region.most}", scalars=2)
        if stops is not None:
            wants = self.operate(IS_NOT_ZERO, self.load("%m", after + size))
            self.line(f"{goes} = and {self.M} {runs}, {wants}")
            more = self.new(f"and i1 {more}, {self.any(goes)}", vectors=3, scalars=2)
        self.line(f"br i1 {more}, label %{loop}, label %{loop}_end")
        self.label(f"{loop}_end")
        self.place[e.number] = ("%m", state)

    def _keep_state(self, state: int, after: int, size: int, runs: str) -> None:
        """Keep the numbers after a turn of a loop in the lanes that run."""
        if size > UNROLLED:
            function = self.lanes.keep()
            self._calls(function)
            at, to = self.at(self.V, "%m", state), self.at(self.V, "%m", after)
            self.line(f"call void {function.name}(ptr {at}, ptr {to}, {self.M} {runs}, i64 {size})")
            return
        for i in range(size):
            found = self.load("%m", after + i)
            if runs.startswith("%"):
                found = self.operate(SELECT, runs, found, self.load("%m", state + i))
            self.store(found, "%m", state + i)

    def _outside(self, e: Expression, outside: Outside) -> None:
        """Call a function outside, lane by lane."""
        count, size, W = 1 + outside.count, len(e.operands), self.width
        found, values = self.reserve(count), self.scratch("given", size)
        given, results = self.scratch("one", size), self.scratch("after", count)
        self.store_all(e.operands, "%m", values)
        for lane in range(W):
            for i in range(size):
                self.rest()
                one = self.load_one("%m", (values + i) * W + lane)
                self.store_one(one, "%m", given * W + i)
            self.rest()
            function, number = self.argument(outside.name), self.new(f"add i64 %at, {lane}", 0, 1)
            at, to = self.at(self.V, "%m", given), self.at(self.V, "%m", results)
            self.line(f"call void {function}(i64 {number}, ptr {at}, ptr {to})")
            for i in range(count):
                self.rest()
                one = self.load_one("%m", results * W + i)
                self.store_one(one, "%m", (found + i) * W + lane)
        self.place[e.number] = ("%m", found)
