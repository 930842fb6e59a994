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
from math import copysign, frexp
from typing import Any, Union

import numpy as np

from spacearm.compiler.operations import FUNCTIONS, LOGIC, MASKS, NUMBERS, OPERATIONS, folded

Operand = Union["Expression", float]
"""An expression, or a number that is known while tracing."""


class TracingError(TypeError):
    """A function did with symbols what cannot be traced, such as branching on their values."""


class Expression:
    """A variable, or an operation on expressions and numbers.

    Attributes:
        tape: The tape that it stands on.
        number: Its place there; operands come first.
        operation: "var", or one of `operations`, or "call", "loop", "result", "load", "outside".
        operands: What it is made of.
        detail: What else it depends on: the name of a variable, the number of a result.
    """

    __slots__ = ("detail", "number", "operands", "operation", "tape")

    def __init__(
        self, tape: Tape, operation: str, operands: tuple[Operand, ...], detail: Any = None
    ) -> None:
        self.tape = tape
        self.number = len(tape.written)
        self.operation = operation
        self.operands = operands
        self.detail = detail
        tape.written.append(self)

    def __repr__(self) -> str:
        return f"<{self.operation} {self.number}>"

    def __add__(self, other: Any) -> Any:
        return _binary("add", self, other)

    def __radd__(self, other: Any) -> Any:
        return _binary("add", other, self)

    def __sub__(self, other: Any) -> Any:
        return _binary("sub", self, other)

    def __rsub__(self, other: Any) -> Any:
        return _binary("sub", other, self)

    def __mul__(self, other: Any) -> Any:
        return _binary("mul", self, other)

    def __rmul__(self, other: Any) -> Any:
        return _binary("mul", other, self)

    def __truediv__(self, other: Any) -> Any:
        return _binary("div", self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return _binary("div", other, self)

    def __pow__(self, other: Any) -> Any:
        return _binary("pow", self, other)

    def __rpow__(self, other: Any) -> Any:
        return _binary("pow", other, self)

    def __mod__(self, other: Any) -> Any:
        return _remainder(self, other)

    def __rmod__(self, other: Any) -> Any:
        return _remainder(other, self)

    def __neg__(self) -> Any:
        return negative(self)

    def __pos__(self) -> Any:
        return self

    def __abs__(self) -> Any:
        return operation("abs", self)

    def __lt__(self, other: Any) -> Any:
        return _binary("lt", self, other)

    def __gt__(self, other: Any) -> Any:
        return _binary("lt", other, self)

    def __le__(self, other: Any) -> Any:
        return _binary("le", self, other)

    def __ge__(self, other: Any) -> Any:
        return _binary("le", other, self)

    def __eq__(self, other: object) -> Any:
        return _applied(np.equal, self, other)

    def __ne__(self, other: object) -> Any:
        return _applied(np.not_equal, self, other)

    __hash__ = object.__hash__

    def __and__(self, other: Any) -> Any:
        return _binary("and", self, other)

    __rand__ = __and__

    def __or__(self, other: Any) -> Any:
        return _binary("or", self, other)

    __ror__ = __or__

    def __invert__(self) -> Any:
        return operation("not", self)

    def __bool__(self) -> bool:
        raise TracingError(
            "the value of a symbol is not known while a function is traced; use numpy.where in "
            "place of a branch"
        )

    def __float__(self) -> float:
        raise TracingError("a symbol is no number while a function is traced")

    __int__ = __index__ = __float__

    def conjugate(self) -> Expression:
        """Return itself; for `numpy.linalg.norm` and `numpy.vdot`."""
        return self

    @property
    def is_mask(self) -> bool:
        """Whether its values are true or false."""
        return self.operation in MASKS

    def expressions(self) -> list[Expression]:
        """Return the operands that are no numbers."""
        return [operand for operand in self.operands if isinstance(operand, Expression)]

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        return applied(ufunc, method, *inputs, **options)

    def __array_function__(self, function: Any, _: Any, arguments: Any, options: Any) -> Any:
        return called(function, arguments, options)


def _applied(function: Any, *operands: Any) -> Any:
    """Return a function of NumPy of operands one of which is an expression."""
    return applied(function, "__call__", *operands)


def _remainder(a: Any, b: Any) -> Any:
    """Return the remainder of a division, with the sign of the divisor."""
    return a - _applied(np.floor, a / b) * b


def _method(name: str) -> Any:
    def method(self: Expression, *others: Operand) -> Operand:
        return operation(name, self, *others)

    method.__doc__ = f"Return {name} of it; what the function of NumPy calls."
    return method


for _name, _function in FUNCTIONS.items():  # numpy.sin of an array of objects calls their .sin()
    setattr(Expression, _function.ufunc or _name, _method(_name))


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
        """Return an operation, the one that stands here already if there is one."""
        key = (
            operation,
            detail,
            *[id(o) if type(o) is Expression else (o, copysign(1.0, o)) for o in operands],
        )
        found = self._known.get(key)
        if found is None:
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
        waiting = [e for e in outputs if isinstance(e, Expression) and e.tape is self]
        found = {e.number for e in waiting}
        while waiting:
            for o in waiting.pop().operands:
                if type(o) is Expression and o.tape is self and o.number not in found:
                    found.add(o.number)
                    waiting.append(o)
        return [self.written[number] for number in sorted(found)]


def tape_of(operands: Iterable[Any]) -> Tape | None:
    """Return the innermost tape of the operands that are expressions; None if none is."""
    found: Tape | None = None
    for o in operands:
        if type(o) is Expression and o.tape is not found:
            found = o.tape if found is None or o.tape.depth > found.depth else found
    return found


def written(name: str, operands: Sequence[Operand], detail: Any = None) -> Expression:
    """Write an operation on the innermost tape of its operands, as it is."""
    tape = tape_of(operands)
    if tape is None:
        raise TracingError(f"{name} of numbers alone is no expression")
    masks = LOGIC.get(name, 0)
    owned = [
        o
        if type(o) is Expression and o.tape is tape and (o.operation in MASKS) is (i < masks)
        else _operand(tape, o, i < masks)
        for i, o in enumerate(operands)
    ]
    return tape.keep(name, tuple(owned), detail)


def _operand(tape: Tape, o: Any, mask: bool) -> Operand:
    """Return what an operation on a tape takes for an operand, a mask or a number."""
    if type(o) is Expression:
        if (o.operation in MASKS) is not mask:
            o = as_mask(o) if mask else as_number(o)
        return o if o.tape is tape else tape.own(o)
    try:
        return bool(o) if mask else float(o)
    except (TypeError, ValueError):
        raise TracingError(f"{type(o).__name__} is no number that can be traced") from None


def as_number(o: Any) -> Any:
    """Return a mask as 1 where it is true and 0 elsewhere, a number as it is."""
    is_mask = isinstance(o, Expression) and o.is_mask
    return o.tape.keep("select", (o, 1.0, 0.0)) if is_mask else o


def as_mask(o: Any) -> Any:
    """Return whether a number is not zero, a mask as it is."""
    if _known(o) or o.is_mask:
        return o
    zero = (o.tape.keep("le", (o, 0.0)), o.tape.keep("le", (0.0, o)))
    return o.tape.keep("not", (o.tape.keep("and", zero),))


def _known(o: Any) -> bool:
    return type(o) is not Expression


def _binary(name: str, a: Any, b: Any) -> Any:
    """Return an operation of an expression with another, a number or an array."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return _applied(OPERATIONS[name], a, b)
    return SIMPLE[name](a, b) if name in SIMPLE else operation(name, a, b)


def operation(name: str, *operands: Any) -> Any:
    """Return an operation by its name in `operations`, folded where all operands are numbers."""
    if name in SIMPLE:
        return SIMPLE[name](*operands)
    for o in operands:
        if type(o) is Expression:
            return written(name, operands)
    return folded(name, *operands)


def add(a: Any, b: Any) -> Any:
    """Return a + b."""
    if type(a) is not Expression:
        a, b = b, a
    if type(a) is not Expression:
        return a + b
    if type(b) is not Expression:
        return a if b == 0.0 else written("add", (a, b))
    if b.operation == "neg":
        return subtract(a, b.operands[0])
    if a.operation == "neg":
        return subtract(b, a.operands[0])
    return written("add", _ordered(a, b))


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
    return written("sub", (a, b))


def negative(a: Any) -> Any:
    """Return -a."""
    if type(a) is not Expression:
        return -a
    return a.operands[0] if a.operation == "neg" else written("neg", (a,))


def multiply(a: Any, b: Any) -> Any:
    """Return a b."""
    if type(a) is not Expression:
        a, b = b, a
    if type(a) is not Expression:
        return a * b
    if type(b) is not Expression:
        if b == 0.0:
            return 0.0
        return a if b == 1.0 else negative(a) if b == -1.0 else written("mul", (a, b))
    if a.operation == "neg":
        return negative(multiply(a.operands[0], b))
    if b.operation == "neg":
        return negative(multiply(a, b.operands[0]))
    return written("mul", _ordered(a, b))


def _ordered(a: Expression, b: Expression) -> tuple[Expression, Expression]:
    """Return the operands of a commutative operation in one order."""
    return (a, b) if (a.tape.depth, a.number) <= (b.tape.depth, b.number) else (b, a)


def divide(a: Any, b: Any) -> Any:
    """Return a / b; a division by a power of two is a product."""
    if type(a) is not Expression and type(b) is not Expression:
        return folded("div", a, b)
    if type(b) is not Expression and abs(frexp(b)[0]) == 0.5 and 1e-300 < abs(b) < 1e300:
        return multiply(a, 1.0 / b)
    return 0.0 if type(a) is not Expression and a == 0.0 else written("div", (a, b))


def power(a: Any, b: Any) -> Any:
    """Return a to the power b; whole powers up to 16 are products, 1/2 is a square root."""
    if type(b) is not Expression and type(a) is Expression:
        if b == 0.5:
            return operation("sqrt", a)
        if float(b).is_integer() and abs(b) <= 16:
            found, square, rest = 1.0, a, abs(int(b))
            while rest:
                found = multiply(found, square) if rest % 2 else found
                square, rest = multiply(square, square) if rest > 1 else square, rest // 2
            return found if b >= 0 else divide(1.0, found)
    return (
        folded("pow", a, b)
        if type(a) is not Expression and type(b) is not Expression
        else written("pow", (a, b))
    )


def select(mask: Any, a: Any, b: Any) -> Any:
    """Return a where the mask is true, else b."""
    if _known(mask):
        return a if mask else b
    if a is b or (type(a) is not Expression and type(b) is not Expression and a == b):
        return a
    if all(o.is_mask if type(o) is Expression else isinstance(o, (bool, np.bool_)) for o in (a, b)):
        return either(both(mask, a), both(opposite(mask), b))
    return written("select", (mask, a, b))


def both(a: Any, b: Any) -> Any:
    """Return whether a and b are true."""
    if _known(a):
        a, b = b, a
    if _known(b):
        return as_mask(a) if b else False
    return written("and", _ordered(a, b))


def either(a: Any, b: Any) -> Any:
    """Return whether a or b is true."""
    if _known(a):
        a, b = b, a
    if _known(b):
        return True if b else as_mask(a)
    return written("or", _ordered(a, b))


def opposite(a: Any) -> Any:
    """Return whether a is false."""
    if _known(a):
        return not a
    return a.operands[0] if a.operation == "not" else written("not", (a,))


SIMPLE: dict[str, Callable[..., Any]] = {
    "add": add,
    "sub": subtract,
    "mul": multiply,
    "div": divide,
    "neg": negative,
    "pow": power,
    "select": select,
    "and": both,
    "or": either,
    "not": opposite,
}
"""The operations that are simplified where an operand is zero or one."""


class Symbols(np.ndarray[Any, Any]):
    """An array of expressions and numbers."""

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        return applied(ufunc, method, *inputs, **options)

    def __array_function__(self, function: Any, _: Any, arguments: Any, options: Any) -> Any:
        return called(function, arguments, options)


def plain(value: Any) -> Any:
    """Return an expression or an array of them as a plain array of objects."""
    if isinstance(value, Expression):
        array = np.empty((), dtype=object)
        array[()] = value
        return array
    return value.view(np.ndarray) if isinstance(value, Symbols) else value


def symbols(value: Any) -> Any:
    """Return a plain array of objects as `Symbols`, an element alone as it is."""
    if isinstance(value, np.ndarray) and value.dtype == object:
        return value.view(Symbols) if value.ndim else value[()]
    return value


def asarray(values: Any) -> Any:
    """Return values as an array of objects."""
    if isinstance(values, Expression):
        return plain(values).view(Symbols)
    return np.asarray(values, dtype=object).view(Symbols)


def applied(ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
    """Apply a function of NumPy that works element by element."""
    function = EACH.get(ufunc)
    if function is None or (method != "__call__" and ufunc in NATIVE):
        function = ufunc
    if function is ufunc and ufunc not in NATIVE:
        raise TracingError(f"numpy.{ufunc.__name__} of symbols cannot be traced")
    if options.get("out"):
        raise TracingError("arrays of symbols are not written to in place")
    return symbols(getattr(function, method)(*(plain(i) for i in inputs), **options))


def called(function: Any, arguments: Any, options: Any) -> Any:
    """Call another function of NumPy."""
    if function in CALLED:
        return CALLED[function](*arguments, **options)
    return symbols(function(*_all_plain(arguments), **options))


def _all_plain(arguments: Any) -> Any:
    """Return arguments, and those in lists of arrays, as plain arrays of objects."""
    return [[plain(asarray(v)) for v in a] if isinstance(a, (list, tuple)) and _symbolic(a)
            else plain(a) for a in arguments]  # fmt: skip


def _symbolic(values: Any) -> bool:
    """Tell whether there is a symbol in lists."""
    if isinstance(values, (list, tuple)):
        return any(_symbolic(v) for v in values)
    return isinstance(values, (Expression, Symbols))


def where(mask: Any, a: Any, b: Any) -> Any:
    """Return a where the mask is true, else b, element by element."""
    return symbols(SELECT(plain(mask), plain(a), plain(b)))


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


EACH_BY_NAME = {
    name: np.frompyfunc(SIMPLE.get(name) or partial(operation, name), function.nin, 1)
    for name, function in {**NUMBERS, **MASKS}.items()
    if isinstance(function, np.ufunc)
}
"""Operations on arrays of objects, element by element."""
SELECT = np.frompyfunc(select, 3, 1)


def _both_ways(a: Any, b: Any) -> Any:
    return operation("and", operation("le", a, b), operation("le", b, a))


EACH: dict[Any, Any] = {
    **{function: EACH_BY_NAME[name]
       for name, function in {**NUMBERS, **MASKS}.items() if isinstance(function, np.ufunc)},
    np.greater: np.frompyfunc(lambda a, b: operation("lt", b, a), 2, 1),
    np.greater_equal: np.frompyfunc(lambda a, b: operation("le", b, a), 2, 1),
    np.equal: np.frompyfunc(_both_ways, 2, 1),
    np.not_equal: np.frompyfunc(lambda a, b: operation("not", _both_ways(a, b)), 2, 1),
    np.isnan: np.frompyfunc(lambda a: operation("not", operation("le", a, a)), 1, 1),
    np.fabs: EACH_BY_NAME["abs"],
    np.bitwise_and: EACH_BY_NAME["and"],
    np.bitwise_or: EACH_BY_NAME["or"],
    np.invert: EACH_BY_NAME["not"],
    np.square: np.frompyfunc(lambda a: operation("mul", a, a), 1, 1),
    np.reciprocal: np.frompyfunc(lambda a: operation("div", 1.0, a), 1, 1),
    np.remainder: np.frompyfunc(lambda a, b: a % b, 2, 1),
    np.deg2rad: np.frompyfunc(lambda a: operation("mul", a, np.pi / 180.0), 1, 1),
    np.radians: np.frompyfunc(lambda a: operation("mul", a, np.pi / 180.0), 1, 1),
    np.rad2deg: np.frompyfunc(lambda a: operation("mul", a, 180.0 / np.pi), 1, 1),
    np.degrees: np.frompyfunc(lambda a: operation("mul", a, 180.0 / np.pi), 1, 1),
}  # fmt: skip
"""Functions of NumPy that work element by element."""
NATIVE = {np.add, np.subtract, np.multiply, np.matmul, np.positive, np.conjugate}
"""Those whose loops over objects call the operators of expressions, as reductions do."""
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
"""Other functions of NumPy that are replaced; the rest does with objects what it does."""
MOST_PLACES = 64
"""Between more places `row` looks up numbers of a table."""
