"""Scalar expressions on tapes: single operations in an order in which they can be computed.

A function of numbers that is run over expressions writes what it does on a tape: equal operations
are one expression, operations on numbers are folded, and a factor or term that is exactly zero or
one disappears. Arrays of expressions are `Symbols`, on which NumPy's functions work.

Folding goes by algebra, not by IEEE 754: 0 x is 0 and x - x is 0 also where x may turn out to be
infinite or NaN, and x + 0 is x also where x is -0. Equations of arms are full of zeros that are
known while tracing, and most of what they multiply disappears by this. Nothing else is rearranged,
so that without contraction every operation is rounded as NumPy's; only whole powers are products.

Tapes are nested. Tape 0 is the *shared* one: what is the same for all lanes stands there, and is
computed once. Tape 1 is the function itself, and each body of a loop or procedure has a tape of its
own inside. An operation is written on the innermost tape of its operands, so that what does not
change in a loop stands before it; operands from farther out are captured as variables.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from math import frexp
from typing import Any, Union

import numpy as np

from spacearm.compiler.operations import MASKS, OPERATIONS, folded
from spacearm.errors import UnsupportedError

#: An expression, or a number that is known while tracing.
Operand = Union["Expression", float]


class TracingError(TypeError):
    """A function did with symbols what cannot be traced, such as branching on their values."""


class LongTapeError(UnsupportedError):
    """A function takes more operations than are compiled."""


#: Most expressions of a tape. Tracing and compiling so many takes seconds and half a gigabyte.
LONGEST = 100_000


class Tape:
    """Expressions in an order in which they can be computed, each once.

    Args:
        parent: The tape around it; None for the shared one.

    Attributes:
        depth: How deep it is nested; 0 for the shared one.
        captured: Variables that stand for expressions of the parent, with these.
    """

    def __init__(self, parent: Tape | None = None) -> None:
        self.parent = parent
        self.depth: int = 0 if parent is None else parent.depth + 1
        self.written: list[Expression] = []
        self.captured: dict[int, tuple[Expression, Expression]] = {}
        self._known: dict[tuple[object, ...], Expression] = {}

    def variable(self, name: Any) -> Expression:
        """Return a new variable."""
        return Expression(self, "var", (), name)

    def keep(self, operation: str, operands: tuple[Operand, ...], detail: Any = None) -> Expression:
        """Return an operation, the one that stands here already if there is one.

        The operands are numbers of Python, and expressions of this tape or the shared one.

        Raises:
            LongTapeError: The tape has `LONGEST` expressions.
        """
        inputs = [o.key if isinstance(o, Expression) else o.hex() for o in operands]
        key = (operation, detail, *inputs)
        found = self._known.get(key)
        if found is None:
            if len(self.written) >= LONGEST:
                raise LongTapeError(
                    f"a function that takes more than {LONGEST:,} operations is not compiled; "
                    "lock joints"
                )
            found = self._known[key] = Expression(self, operation, operands, detail)
        return found

    def reaches(self, tape: Tape) -> bool:
        """Tell whether a tape is this one, or one around it."""
        return self is tape or (self.parent is not None and self.parent.reaches(tape))

    def own(self, e: Expression) -> Expression:
        """Return an expression of this tape or the shared one that is e, captured if need be.

        Raises:
            TracingError: It stands on a tape inside this one, or beside it.
        """
        if e.tape is self or e.tape.depth == 0:
            return e
        if self.parent is None or not self.reaches(e.tape):
            raise TracingError("a symbol is used outside the loop or function that it belongs to")
        if e.is_mask:  # variables are numbers
            return self.keep("lt", (0.0, self.own(as_number(e))))
        outer = self.parent.own(e)
        if outer.number not in self.captured:
            self.captured[outer.number] = (self.variable(("capture", len(self.captured))), outer)
        return self.captured[outer.number][0]

    def needed(self, outputs: Iterable[Any]) -> list[Expression]:
        """Return what of this tape must be computed for the outputs, in order."""
        marked = bytearray(len(self.written))
        for e in outputs:
            if type(e) is Expression and e.tape is self:
                marked[e.number] = True
        for e in reversed(self.written):
            if marked[e.number]:
                for o in e.operands:
                    if type(o) is Expression and o.tape is self:
                        marked[o.number] = True
        return [e for e in self.written if marked[e.number]]


def written(name: str, *operands: Operand) -> Expression:
    """Write an operation on the innermost tape of its operands, as it is."""
    tape: Any = None
    for o in operands:
        if type(o) is Expression and (tape is None or o.tape.depth > tape.depth):
            tape = o.tape
    masks = OPERATIONS[name].masks
    if masks:
        owned = [_operand(tape, o, i < masks) for i, o in enumerate(operands)]
    else:
        owned = [o if type(o) is Expression and o.tape is tape and not o.is_mask
                 else _operand(tape, o) for o in operands]  # fmt: skip
    return tape.keep(name, tuple(owned))


def _operand(tape: Tape, o: Any, mask: bool = False) -> Operand:
    """Return what an operation on a tape takes for an operand, a mask or a number."""
    if type(o) is Expression:
        if o.is_mask is not mask:
            o = as_mask(o) if mask else as_number(o)
        return o if o.tape is tape else tape.own(o)
    try:
        return float(o)
    except (TypeError, ValueError):
        raise TracingError(f"{type(o).__name__} is not a number that can be traced") from None


def as_number(o: Any) -> Any:
    """Return a mask as 1 where it is true and 0 elsewhere, a number as it is."""
    return o.tape.keep("select", (o, 1.0, 0.0)) if type(o) is Expression and o.is_mask else o


def as_mask(o: Any) -> Any:
    """Return whether a number is not zero, a mask as it is."""
    return o if type(o) is not Expression or o.is_mask else differ(o, 0.0)


def operation(name: str, *operands: Any) -> Any:
    """Return an operation by its name in `operations`, folded where all operands are numbers."""
    if name in SIMPLE:
        return SIMPLE[name](*operands)
    for o in operands:
        if type(o) is Expression:
            return written(name, *operands)
    return folded(name, *operands)


def add(a: Any, b: Any) -> Any:
    """Return a + b."""
    if type(a) is not Expression:
        a, b = b, a
    if type(a) is not Expression:
        return a + b
    if type(b) is not Expression:
        return a if b == 0.0 else written("add", a, b)
    if b.operation == "neg":
        return subtract(a, b.operands[0])
    if a.operation == "neg":
        return subtract(b, a.operands[0])
    return written("add", *_ordered(a, b))


def subtract(a: Any, b: Any) -> Any:
    """Return a - b."""
    if type(b) is not Expression:
        return a - b if type(a) is not Expression else add(a, -b)
    if a is b:
        return 0.0
    if type(a) is not Expression and a == 0.0:
        return negative(b)
    if b.operation == "neg":
        return add(a, b.operands[0])
    if type(a) is Expression and a.operation == "neg":
        return negative(add(a.operands[0], b))
    return written("sub", a, b)


def negative(a: Any) -> Any:
    """Return -a."""
    if type(a) is not Expression:
        return -a
    return a.operands[0] if a.operation == "neg" else written("neg", a)


def multiply(a: Any, b: Any) -> Any:
    """Return a b."""
    if type(a) is not Expression:
        a, b = b, a
    if type(a) is not Expression:
        return a * b
    if type(b) is not Expression:
        if b == 0.0:
            return 0.0
        return a if b == 1.0 else negative(a) if b == -1.0 else written("mul", a, b)
    if a.operation == "neg":
        return negative(multiply(a.operands[0], b))
    if b.operation == "neg":
        return negative(multiply(a, b.operands[0]))
    return written("mul", *_ordered(a, b))


def _ordered(a: Expression, b: Expression) -> tuple[Expression, Expression]:
    """Return the operands of a commutative operation in one order."""
    return (a, b) if a.key <= b.key else (b, a)


def divide(a: Any, b: Any) -> Any:
    """Return a / b; a division by a power of two is a product."""
    if type(b) is not Expression:
        if type(a) is not Expression:
            return folded("div", a, b)
        if abs(frexp(b)[0]) == 0.5 and 1e-300 < abs(b) < 1e300:
            return multiply(a, 1.0 / b)
    return 0.0 if type(a) is not Expression and a == 0.0 else written("div", a, b)


def power(a: Any, b: Any) -> Any:
    """Return a to the power b; whole powers up to 16 are products, 1/2 is a square root."""
    if type(b) is Expression:
        return written("pow", a, b)
    if type(a) is not Expression:
        return folded("pow", a, b)
    if b == 0.5:
        return written("sqrt", a)
    if not float(b).is_integer() or abs(b) > 16:
        return written("pow", a, b)
    found, square, rest = 1.0, a, abs(int(b))
    while rest:
        found = multiply(found, square) if rest % 2 else found
        square, rest = multiply(square, square) if rest > 1 else square, rest // 2
    return found if b >= 0 else divide(1.0, found)


def remainder(a: Any, b: Any) -> Any:
    """Return the remainder of a division, with the sign of the divisor."""
    return subtract(a, multiply(operation("floor", divide(a, b)), b))


def sign(a: Any) -> Any:
    """Return -1, 0 or 1, and NaN of NaN."""
    negative_or_zero = select(operation("lt", a, 0.0), -1.0, a)
    return held(select(operation("lt", 0.0, a), 1.0, negative_or_zero))


def held(a: Any) -> Any:
    """Return a, of which no derivative is taken."""
    return written("hold", a) if type(a) is Expression and not a.is_mask else a


def select(mask: Any, a: Any, b: Any) -> Any:
    """Return a where the mask is true, else b."""
    if type(mask) is not Expression:
        return a if mask else b
    if a is b or (type(a) is not Expression and type(b) is not Expression and a == b):
        return a
    if all(o.is_mask if type(o) is Expression else isinstance(o, (bool, np.bool_)) for o in (a, b)):
        return either(both(mask, a), both(opposite(mask), b))
    return written("select", mask, a, b)


def both(a: Any, b: Any) -> Any:
    """Return whether a and b are true."""
    if type(a) is not Expression:
        a, b = b, a
    if type(b) is not Expression:
        return as_mask(a) if b else False
    return written("and", *_ordered(a, b))


def either(a: Any, b: Any) -> Any:
    """Return whether a or b is true."""
    if type(a) is not Expression:
        a, b = b, a
    if type(b) is not Expression:
        return True if b else as_mask(a)
    return written("or", *_ordered(a, b))


def opposite(a: Any) -> Any:
    """Return whether a is false."""
    if type(a) is not Expression:
        return not a
    return a.operands[0] if a.operation == "not" else written("not", a)


def equal(a: Any, b: Any) -> Any:
    """Return whether a and b are equal."""
    return both(operation("le", a, b), operation("le", b, a))


def differ(a: Any, b: Any) -> Any:
    """Return whether a and b are not equal."""
    return opposite(equal(a, b))


#: The operations that are simplified where an operand is zero or one.
SIMPLE: dict[str, Callable[..., Any]] = {
    "add": add, "sub": subtract, "mul": multiply, "div": divide, "neg": negative, "pow": power,
    "select": select, "and": both, "or": either, "not": opposite,
}  # fmt: skip


def _operators(function: Callable[[Any, Any], Any]) -> tuple[Any, Any]:
    """Return the methods of an operator of Python, for the left and the right operand."""

    def left(self: Expression, other: Any) -> Any:
        return NotImplemented if isinstance(other, np.ndarray) else function(self, other)

    def right(self: Expression, other: Any) -> Any:
        return function(other, self)

    return left, right


class Expression:
    """A variable, or an operation on expressions and numbers.

    Attributes:
        tape: The tape that it stands on.
        number: Its place there; operands come first.
        key: What it alone has of all that stands on its tape and on those around.
        operation: "var", or one of `operations`, or "call", "loop", "result", "load", "outside".
        operands: What it is made of.
        detail: What else it depends on: the name of a variable, the number of a result.
        is_mask: Whether its values are true or false.
    """

    __slots__ = ("detail", "is_mask", "key", "number", "operands", "operation", "tape")

    def __init__(
        self, tape: Tape, operation: str, operands: tuple[Operand, ...], detail: Any = None
    ) -> None:
        self.tape = tape
        self.number = len(tape.written)
        self.key = (tape.depth << 32) + self.number
        self.operation = operation
        self.operands = operands
        self.detail = detail
        self.is_mask = operation in MASKS
        tape.written.append(self)

    def __repr__(self) -> str:
        return f"<{self.operation} {self.number}>"

    __add__, __radd__ = _operators(add)
    __sub__, __rsub__ = _operators(subtract)
    __mul__, __rmul__ = _operators(multiply)
    __truediv__, __rtruediv__ = _operators(divide)
    __pow__, __rpow__ = _operators(power)
    __mod__, __rmod__ = _operators(remainder)
    __and__, __rand__ = _operators(both)
    __or__, __ror__ = _operators(either)
    __lt__, __gt__ = _operators(partial(operation, "lt"))
    __le__, __ge__ = _operators(partial(operation, "le"))
    __eq__ = _operators(equal)[0]
    __ne__ = _operators(differ)[0]
    __hash__ = object.__hash__

    def __neg__(self) -> Any:
        return negative(self)

    def __pos__(self) -> Any:
        return self

    def __abs__(self) -> Any:
        return operation("abs", self)

    def __invert__(self) -> Any:
        return opposite(self)

    def __bool__(self) -> bool:
        raise TracingError(
            "the value of a symbol is not known while a function is traced; use numpy.where in "
            "place of a branch"
        )

    def __float__(self) -> float:
        raise TracingError("a symbol has no value while a function is traced")

    __int__ = __index__ = __float__

    def expressions(self) -> list[Expression]:
        """Return the operands that are not numbers."""
        return [operand for operand in self.operands if type(operand) is Expression]

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        return applied(ufunc, method, *inputs, **options)

    def __array_function__(self, function: Any, _: Any, arguments: Any, options: Any) -> Any:
        return called(function, arguments, options)


class Symbols(np.ndarray[Any, Any]):
    """An array of expressions and numbers."""

    __array_ufunc__: Any = Expression.__array_ufunc__
    __array_function__: Any = Expression.__array_function__


def plain(value: Any) -> Any:
    """Return an expression or an array of them as a plain array of objects."""
    if isinstance(value, Symbols):
        return value.view(np.ndarray)
    return np.array(value, dtype=object) if isinstance(value, Expression) else value


def symbols(value: Any) -> Any:
    """Return a plain array of objects as `Symbols`, an element alone as it is."""
    if isinstance(value, np.ndarray) and value.dtype == object:
        return value.view(Symbols) if value.ndim else value[()]
    return value


def asarray(values: Any) -> Any:
    """Return values as an array of objects."""
    return np.asarray(plain(values), dtype=object).view(Symbols)


def applied(ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
    """Apply a function of NumPy that works element by element."""
    if ufunc not in EACH and ufunc is not np.matmul:
        raise TracingError(f"numpy.{ufunc.__name__} of symbols cannot be traced")
    if options.get("out"):
        raise TracingError("arrays of symbols are not written to in place")
    if ufunc is np.matmul or (method != "__call__" and ufunc in NATIVE):
        return symbols(getattr(ufunc, method)(*map(plain, inputs), **options))
    if method != "__call__":
        return symbols(getattr(OVER[ufunc], method)(*map(plain, inputs), **options))
    return _over(EACH[ufunc], OVER[ufunc], inputs)


def _over(function: Callable[..., Any], arrays: Any, operands: Sequence[Any]) -> Any:
    """Apply a function of expressions, or the one of arrays that does it element by element."""
    if any(isinstance(o, (np.ndarray, list, tuple)) for o in operands):
        return symbols(arrays(*map(plain, operands)))
    return function(*operands)


def called(function: Any, arguments: Any, options: Any) -> Any:
    """Call another function of NumPy."""
    if function in CALLED:
        return CALLED[function](*arguments, **options)
    return symbols(function(*_all_plain(arguments), **options))


def _all_plain(arguments: Any) -> Any:
    """Return arguments, and those in lists of arrays, as plain arrays of objects."""
    return [[plain(asarray(v)) for v in a] if isinstance(a, (list, tuple)) and is_symbolic(a)
            else plain(a) for a in arguments]  # fmt: skip


def is_symbolic(values: Any) -> bool:
    """Tell whether values, or lists of them, have symbols."""
    if isinstance(values, (list, tuple)):
        return any(is_symbolic(v) for v in values)
    return isinstance(values, (Expression, np.ndarray)) and plain(values).dtype == object


def where(mask: Any, a: Any, b: Any) -> Any:
    """Return a where the mask is true, else b, element by element."""
    return _over(select, SELECT, (mask, a, b))


def hold(values: Any) -> Any:
    """Return values whose derivatives are taken as zero."""
    return _over(held, HOLD, (values,))


def interpolated(x: Any, places: Any, values: Any) -> Any:
    """Interpolate between values at places that are known and rise; beyond they stay."""
    places, values = np.asarray(places, dtype=float), asarray(values)
    if len(places) > MOST_PLACES:
        raise TracingError(f"numpy.interp is traced between at most {MOST_PLACES} places")
    found = values[0]
    for a, b, u, v in zip(places, places[1:], values, values[1:], strict=False):
        found = where(asarray(x) >= a, u + (asarray(x) - a) * ((v - u) / (b - a)), found)
    return where(asarray(x) >= places[-1], values[-1], found)


def _clipped(value: Any, low: Any, high: Any) -> Any:
    """Return values held between bounds, None where there is none."""
    value = value if low is None else np.maximum(value, low)
    return value if high is None else np.minimum(value, high)


def _norm(x: Any, *order: Any, axis: int | None = None, keepdims: bool = False) -> Any:
    """Return Euclidean norms."""
    if order not in ((), (None,)):
        raise TracingError("numpy.linalg.norm is traced without ord")
    return np.sqrt((asarray(x) * asarray(x)).sum(axis=axis, keepdims=keepdims))


def _reduced(ufunc: np.ufunc) -> Callable[..., Any]:
    def function(values: Any, axis: int | None = None, keepdims: bool = False) -> Any:
        return applied(ufunc, "reduce", values, axis=axis, keepdims=keepdims)

    return function


#: Functions of NumPy that work element by element, for expressions.
EACH: dict[Any, Callable[..., Any]] = {
    **{each.numpy: SIMPLE.get(name) or partial(operation, name)
       for name, each in OPERATIONS.items() if isinstance(each.numpy, np.ufunc)},
    np.positive: lambda a: a,
    np.conjugate: lambda a: a,
    np.greater: lambda a, b: operation("lt", b, a),
    np.greater_equal: lambda a, b: operation("le", b, a),
    np.equal: equal,
    np.not_equal: differ,
    np.isnan: lambda a: opposite(operation("le", a, a)),
    np.fabs: partial(operation, "abs"),
    np.sign: sign,
    np.bitwise_and: both,
    np.bitwise_or: either,
    np.invert: opposite,
    np.square: lambda a: multiply(a, a),
    np.reciprocal: lambda a: divide(1.0, a),
    np.remainder: remainder,
    **dict.fromkeys((np.deg2rad, np.radians), lambda a: multiply(a, np.pi / 180.0)),
    **dict.fromkeys((np.rad2deg, np.degrees), lambda a: multiply(a, 180.0 / np.pi)),
}  # fmt: skip
#: The same for arrays of objects.
OVER = {ufunc: np.frompyfunc(function, ufunc.nin, 1) for ufunc, function in EACH.items()}
SELECT, HOLD = np.frompyfunc(select, 3, 1), np.frompyfunc(held, 1, 1)
#: Those whose reductions of objects call the operators of expressions.
NATIVE = {np.add, np.subtract, np.multiply}
#: Other functions of NumPy that are replaced; the rest does with objects what it does.
CALLED: dict[Any, Callable[..., Any]] = {
    np.where: where,
    np.clip: _clipped,
    np.interp: interpolated,
    np.linalg.norm: _norm,
    np.max: _reduced(np.maximum),
    np.min: _reduced(np.minimum),
    np.all: _reduced(np.logical_and),
    np.any: _reduced(np.logical_or),
}
#: Between more places `row` looks up numbers of a table.
MOST_PLACES = 64


def _method(ufunc: Any) -> Any:
    return lambda self, *others: EACH[ufunc](self, *others)


for _ufunc in EACH:  # numpy.sin of a plain array of objects calls their .sin()
    if not hasattr(Expression, _ufunc.__name__):
        setattr(Expression, _ufunc.__name__, _method(_ufunc))
