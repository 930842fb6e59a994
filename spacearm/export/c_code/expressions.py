"""Scalar expressions: the equations as a list of single operations, with derivatives, for C.

Equal expressions are one object, constants are folded, so that what comes out has each operation
once. NumPy arrays hold expressions as they hold any objects.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Union

Operand = Union["Expression", float]


class Expression:
    """A variable, or an operation on expressions and numbers of a `Tape`.

    Attributes:
        tape: The tape that it stands on.
        number: Its place there; operands come first.
        operation: "var", "sin", "cos", "neg", "add", "sub", "mul" or "div".
        operands: What it is made of.
        name: Text that stands for a variable in C.
    """

    __slots__ = ("name", "number", "operands", "operation", "tape")

    def __init__(
        self, tape: Tape, operation: str, operands: tuple[Operand, ...], name: str = ""
    ) -> None:
        self.tape = tape
        self.number = len(tape.written)
        self.operation = operation
        self.operands = operands
        self.name = name
        tape.written.append(self)

    def __add__(self, other: Operand) -> Operand:
        return self.tape.add(self, other)

    __radd__ = __add__

    def __neg__(self) -> Operand:
        return self.tape.negative(self)

    def __sub__(self, other: Operand) -> Operand:
        return self.tape.subtract(self, other)

    def __rsub__(self, other: float) -> Operand:
        return self.tape.subtract(other, self)

    def __mul__(self, other: Operand) -> Operand:
        return self.tape.multiply(self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Operand) -> Operand:
        return self.tape.divide(self, other)

    def __rtruediv__(self, other: float) -> Operand:
        return self.tape.divide(other, self)

    def sin(self) -> Expression:
        """Return the sine; what `numpy.sin` calls."""
        return self.tape.keep("sin", self)

    def cos(self) -> Expression:
        """Return the cosine; what `numpy.cos` calls."""
        return self.tape.keep("cos", self)

    def expressions(self) -> Iterable[Expression]:
        """Return the operands that are no numbers."""
        return (operand for operand in self.operands if isinstance(operand, Expression))


class Tape:
    """Expressions in an order in which they can be computed, each once."""

    def __init__(self) -> None:
        self.written: list[Expression] = []
        self._known: dict[tuple[object, ...], Expression] = {}

    def variable(self, name: str) -> Expression:
        """Return a variable, by the text that stands for it in C."""
        return Expression(self, "var", (), name)

    def keep(self, operation: str, *operands: Operand) -> Expression:
        """Return an operation, the one that stands here already if there is one."""
        key = (operation, *(o.number if isinstance(o, Expression) else (o,) for o in operands))
        if key not in self._known:
            self._known[key] = Expression(self, operation, operands)
        return self._known[key]

    def add(self, a: Operand, b: Operand) -> Operand:
        """Return a + b."""
        if not isinstance(a, Expression):
            a, b = b, a
        if not isinstance(a, Expression):
            return a + b
        if b == 0.0:
            return a
        if isinstance(b, Expression):
            if b.operation == "neg":
                return self.subtract(a, _first(b))
            if a.operation == "neg":
                return self.subtract(b, _first(a))
            a, b = (a, b) if a.number <= b.number else (b, a)
        return self.keep("add", a, b)

    def subtract(self, a: Operand, b: Operand) -> Operand:
        """Return a - b."""
        if not isinstance(b, Expression):
            return self.add(a, -b)
        if a is b:
            return 0.0
        if a == 0.0:
            return self.negative(b)
        return self.add(a, _first(b)) if b.operation == "neg" else self.keep("sub", a, b)

    def negative(self, a: Operand) -> Operand:
        """Return -a."""
        if not isinstance(a, Expression):
            return -a
        return _first(a) if a.operation == "neg" else self.keep("neg", a)

    def multiply(self, a: Operand, b: Operand) -> Operand:
        """Return a b."""
        if not isinstance(a, Expression):
            a, b = b, a
        if not isinstance(a, Expression):
            return a * b
        if not isinstance(b, Expression):
            if b == 0.0:
                return 0.0
            return a if b == 1.0 else self.negative(a) if b == -1.0 else self.keep("mul", a, b)
        if a.operation == "neg":
            return self.negative(self.multiply(_first(a), b))
        if b.operation == "neg":
            return self.negative(self.multiply(a, _first(b)))
        a, b = (a, b) if a.number <= b.number else (b, a)
        return self.keep("mul", a, b)

    def divide(self, a: Operand, b: Operand) -> Operand:
        """Return a / b."""
        if not isinstance(b, Expression):
            return self.multiply(a, 1.0 / b)
        return 0.0 if a == 0.0 else self.keep("div", a, b)

    def gradient(self, of: Operand, by: Sequence[Expression]) -> list[Operand]:
        """Return the derivatives of an expression by variables, from the last operation back."""
        slopes: dict[int, Operand] = {}
        needed = self.needed([of])
        if isinstance(of, Expression):
            slopes[of.number] = 1.0
        for expression in reversed(needed):
            slope = slopes.get(expression.number, 0.0)
            for operand, factor in zip(
                expression.expressions(), self._factors(expression), strict=True
            ):
                more = self.multiply(slope, factor)
                slopes[operand.number] = self.add(slopes.get(operand.number, 0.0), more)
        return [slopes.get(variable.number, 0.0) for variable in by]

    def _factors(self, e: Expression) -> list[Operand]:
        """Return the derivatives of an operation by those of its operands that are no numbers."""
        a, b = (*e.operands, 0.0, 0.0)[:2]
        match e.operation:
            case "sin":
                return [self.keep("cos", a)]
            case "cos":
                return [self.negative(self.keep("sin", a))]
            case "neg":
                return [-1.0]
            case "add":
                factors: list[Operand] = [1.0, 1.0]
            case "sub":
                factors = [1.0, -1.0]
            case "mul":
                factors = [b, a]
            case "div":
                inverse = self.divide(1.0, b)
                factors = [inverse, self.negative(self.multiply(e, inverse))]
            case _:
                return []
        pairs = zip(e.operands, factors, strict=True)
        return [factor for operand, factor in pairs if isinstance(operand, Expression)]

    def needed(self, outputs: Iterable[Operand]) -> list[Expression]:
        """Return what must be computed for the outputs, in order."""
        waiting = [e for e in outputs if isinstance(e, Expression)]
        found = {e.number for e in waiting}
        while waiting:
            for operand in waiting.pop().expressions():
                if operand.number not in found:
                    found.add(operand.number)
                    waiting.append(operand)
        return [self.written[number] for number in sorted(found)]


def _first(e: Expression) -> Operand:
    """Return the first operand."""
    return e.operands[0]
