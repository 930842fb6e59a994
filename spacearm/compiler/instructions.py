"""Instructions of one function in LLVM's language, in which each number is a vector of lanes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from struct import pack

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
