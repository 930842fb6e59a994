"""The lines of one function in LLVM's intermediate language, and a bound of the stack they need.

A compiler gives each value of a function at most one place on the stack. The sum of the sizes of
all values bounds these places, whatever the compiler does with them. Values that one line needs on
its way, such as masks and constants, count with the line (`TEMPORARIES`). Arrays do not lie on the
stack but in memory that the caller provides.

A compiler that optimises puts values in one place that are not alive at once. The places it needs
are `SPARE` times as many as values are alive at once in the order of the lines, or less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from struct import pack


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


#: Size on the stack of a number of one lane, an address or a whole number [bytes].
SCALAR = 8
#: Alignment of the stack where a function is called [bytes].
ALIGNMENT = 16
#: Stack that a function needs beside its values: return address, saved registers, arguments,
#: alignment of vectors [bytes].
FIXED = 256
#: How many values an operation needs at most beside its own, where the processor has no such
#: instruction.
TEMPORARIES = {
    "@llvm.minimum": 10, "@llvm.maximum": 10, "@llvm.rint": 3, "@llvm.floor": 3, "@llvm.ceil": 3,
}  # fmt: skip
#: By how much more stack is provided than values that are alive at once need: LLVM computes some of
#: them earlier than they stand. For the arms of the catalogue it takes 1.3 times as much at most.
SPARE = 2


@dataclass
class Section:
    """A part of a function that is a function of its own in machine code.

    Attributes:
        lines: Its lines.
        values: Size of its values [bytes].
        alive: Stack that values need if those share places that are not alive at once [bytes]; None
            if they do not share.
        called: Stack of the functions that it calls, at most [bytes].
    """

    lines: list[str] = field(default_factory=list)
    values: int = 0
    alive: int | None = None
    called: int = 0

    @property
    def stack(self) -> int:
        """Return a bound of the stack that a call of it needs [bytes]."""
        values = self.values if self.alive is None else min(self.values, self.alive)
        return FIXED + values + self.called


class Instructions:
    """The lines of a function, in sections.

    The function has memory at `%m`, and those that it calls have theirs at `%below`.

    Args:
        width: Number of lanes.

    Attributes:
        V: The type of a number in all lanes.
        M: The type of a mask.
        aligned: Attribute of a function whose values lie aligned on the stack. LLVM aligns them of
            itself only where it knows before it allocates registers that it will need the stack;
            a vector that lies across two lines of the cache takes twice as long.
        block: Name of the block that is being written.
        sections: The sections; the last one is being written.
        memory: Size of its memory, in vectors of lanes.
        below: Size of the memory of the functions that it calls, at most.
    """

    def __init__(self, width: int) -> None:
        self.width = width
        self.V, self.M = _vector("double", width), _vector("i1", width)
        self.aligned = '"stackrealign" ' if SCALAR * width > ALIGNMENT else ""
        self.block = "start"
        self.sections = [Section()]
        self.memory = self.below = 0
        self._scratch: dict[str, tuple[int, int]] = {}
        self._count = 0

    def begin_section(self) -> None:
        """Begin another section, in which no name of the ones before is known."""
        self.sections.append(Section())
        self.block = "start"

    def text(self, section: Section) -> str:
        """Return the lines of a section; the first block is called `start`."""
        return "\n".join(("br label %start", "start:", *section.lines))

    def entry(self) -> str:
        """Return the line that every function begins with."""
        return f"entry:\n%below = getelementptr {self.V}, ptr %m, i64 {self.memory}"

    def line(self, text: str) -> None:
        """Write a line."""
        self.sections[-1].lines.append(text)

    def label(self, name: str) -> None:
        """Begin a block."""
        self.line(f"{name}:")
        self.block = name

    def name(self, kind: str) -> str:
        """Return a name that is not used yet."""
        self._count += 1
        return f"{kind}{self._count}"

    def new(self, text: str, vectors: int = 0, scalars: int = 0) -> str:
        """Write an instruction that gives a value, and return its name.

        Args:
            text: The instruction.
            vectors: How many vectors of lanes it may put on the stack.
            scalars: How many numbers of one lane, addresses or whole numbers.
        """
        self._count += 1
        name = f"%v{self._count}"
        section = self.sections[-1]
        section.lines.append(f"{name} = {text}")
        section.values += SCALAR * (vectors * self.width + scalars)
        return name

    def operate(self, text: str, *operands: str) -> str:
        """Write an operation, as `operations` has it, and return the name of its value."""
        constants = sum(not operand.startswith("%") for operand in operands)
        vectors = 1 + constants + TEMPORARIES.get(text, 0)
        if "{M}" in text or "{zero}" in text or text.startswith("fcmp"):
            vectors += 1  # a mask as wide as numbers, beside the one that fits them
        return self.new(template(text, len(operands), self.width) % operands, vectors)

    def any(self, mask: str) -> str:
        """Tell whether a mask is true in any lane."""
        if self.width == 1:
            return mask
        reduced = f"call i1 @llvm.vector.reduce.or.v{self.width}i1({self.M} {mask})"
        return self.new(reduced, vectors=3)

    def number(self, value: float) -> str:
        """Return a number in all lanes."""
        return _number(value, self.width)

    def splat(self, name: str) -> str:
        """Return a number of one lane in all."""
        if self.width == 1:
            return name
        one = self.new(f"insertelement {self.V} poison, double {name}, i32 0", vectors=1)
        return self._shuffled(one, one, [0] * self.width)

    def lane(self, name: str, lane: int) -> str:
        """Return the number of one lane."""
        if self.width == 1:
            return name
        return self.new(f"extractelement {self.V} {name}, i32 {lane}", scalars=3)

    def joined(self, lanes: Sequence[str]) -> str:
        """Return numbers of single lanes as a vector."""
        if self.width == 1:
            return lanes[0]
        found = "poison"
        for i, name in enumerate(lanes):
            found = self.new(
                f"insertelement {self.V} {found}, double {name}, i32 {i}", vectors=1, scalars=4
            )
        return found

    def at(self, kind: str, address: str, index: int | str) -> str:
        """Return the address of an element of an array."""
        if index == 0:
            return address
        return self.new(f"getelementptr {kind}, ptr {address}, i64 {index}", scalars=1)

    def reserve(self, size: int) -> int:
        """Reserve memory for vectors of lanes, and return their place from `%m` on."""
        place, self.memory = self.memory, self.memory + size
        return place

    def scratch(self, name: str, size: int) -> int:
        """Return the place of memory that is used again under the same name, at least so large."""
        place, reserved = self._scratch.get(name, (0, -1))
        if reserved < size:
            place = self.reserve(size)
            self._scratch[name] = place, size
        return place

    def load(self, memory: str, index: int) -> str:
        """Load a vector of lanes."""
        address = self.at(self.V, memory, index)
        return self.new(f"load {self.V}, ptr {address}, align 8", vectors=1)

    def store(self, value: str, memory: str, index: int) -> None:
        """Store a vector of lanes."""
        self.line(f"store {self.V} {value}, ptr {self.at(self.V, memory, index)}, align 8")

    def load_one(self, address: str, index: int | str) -> str:
        """Load a number of one lane."""
        return self.new(f"load double, ptr {self.at('double', address, index)}, align 8", scalars=1)

    def store_one(self, value: str, address: str, index: int | str) -> None:
        """Store a number of one lane."""
        self.line(f"store double {value}, ptr {self.at('double', address, index)}, align 8")

    def transposed(self, vectors: Sequence[str]) -> list[str]:
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
        shuffled = f"shufflevector {V} {a}, {V} {b}, <{len(lanes)} x i32> <{chosen}>"
        return self.new(shuffled, vectors=2)
