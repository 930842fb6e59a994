"""Expressions: what a xacro source computes, of numbers, text and lists alone, with bounds.

An expression is compiled as Python after every operation that could reach beyond its data, or take
time or memory without end, has been replaced by a checked one. Attributes are read from an allow
list by the type of their owner, so that there is no way from a value to the interpreter.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import Any

#: Largest number of steps of all expressions and macros of a file.
MOST_STEPS = 1_000_000
#: Largest number of items, characters or bits that one operation may give, lists in lists too.
LONGEST = 100_000
#: Number of items or characters of a value that count as one more step.
PER_STEP = 10
TEXT = """capitalize count endswith find index isalnum isalpha isdigit isnumeric lower lstrip
    partition removeprefix removesuffix rfind rindex rpartition rsplit rstrip split splitlines
    startswith strip title upper"""
#: Methods that expressions may call, by the type of their owner.
METHODS: Mapping[type, frozenset[str]] = {
    str: frozenset(TEXT.split()),
    list: frozenset(("count", "index", "pop")),
    tuple: frozenset(("count", "index")),
    dict: frozenset(("get", "items", "keys", "values")),
    float: frozenset(("is_integer",)),
}
#: Name of the checked operations; no identifier can have it.
GUARD = "guard "


class ExpressionError(Exception):
    """An expression does what a robot file may not do."""


class Evaluator:
    """Evaluates the expressions of one file, and counts their steps.

    Args:
        most: The steps that they may take.
    """

    def __init__(self, most: int = MOST_STEPS) -> None:
        self._steps, self._most = 0, most

    @property
    def stopped(self) -> bool:
        """Whether they took more."""
        return self._steps > self._most

    def evaluate(self, text: str, names: dict[str, Any]) -> Any:
        """Compute the value of an expression.

        Args:
            text: The expression.
            names: Values by name, its only surroundings.

        Raises:
            ExpressionError: It does what it may not do.
        """
        self.step()
        if len(text) > LONGEST:
            raise ExpressionError("the expression is too long")
        tree = _Guarded().visit(ast.parse(text.strip(), mode="eval"))
        code = compile(ast.fix_missing_locations(tree), "<expression>", "eval")
        dict.update(names, __builtins__={GUARD: self._do})  # xacro's tables set no such item
        return self._bounded(eval(code, names))  # only checked operations are left

    def step(self, count: int = 1) -> None:
        """Count steps.

        Raises:
            ExpressionError: They are too many.
        """
        self._steps += count
        if self.stopped:
            raise ExpressionError(f"the file takes more than {self._most:,} steps to expand")

    def _do(self, operation: str, *values: Any) -> Any:
        """Do a checked operation."""
        self.step()
        return self._bounded(self._done(operation, *values))

    def _bounded(self, value: Any) -> Any:
        """Return a value that is not too large to be written as text; its size counts as steps."""
        size = _size(value)
        self.step(size // PER_STEP)
        _check_length(size)
        return value

    def _done(self, operation: str, *values: Any) -> Any:
        """Return the value of a checked operation, whose size is bounded before it is made."""
        match operation, values:
            case "value", (value,):
                return value
            case "attribute", (owner, name):
                return _attribute(owner, name)
            case "items", (iterable,):
                return self._items(iterable)
            case "+", (a, b):
                _check_length(_size(a) + _size(b))
                return a + b
            case "*", (a, b):
                _check_product(a, b)
                return a * b
            case "**", (a, b):
                if isinstance(a, int) and isinstance(b, int):
                    _check_length(a.bit_length() * abs(b))
                return a**b
            case "<<", (a, b):
                _check_length(a.bit_length() + b)
                return a << b
            case "%", (a, b):
                if isinstance(a, str) and re.search(r"\d{4}|\*", a):
                    raise ExpressionError("widths of a format have up to 3 digits")
                return a % b
        raise ExpressionError(f"operation {operation!r}")

    def _items(self, iterable: Iterable[Any]) -> Iterator[Any]:
        """Yield items, each one a step."""
        for item in iterable:
            self.step()
            yield item


def _round(number: float, digits: int | None = None) -> float:
    """Round a number to at most 300 digits."""
    if digits is not None and abs(digits) > 300:
        raise ExpressionError(f"rounding to {digits} digits")
    return round(number, digits)


def _range(*ends: int) -> list[int]:
    """Return a range of numbers as a list."""
    numbers = range(*ends)
    _check_length(len(numbers))
    return list(numbers)


#: Functions that expressions have in place of Python's own.
BOUNDED = {"round": _round, "range": _range}


def _attribute(owner: Any, name: str) -> Any:
    """Return an item of a mapping by its name, or a method from the allow list."""
    if isinstance(owner, dict) and not name.startswith("_") and name in owner:
        return owner[name]
    if isinstance(owner, str) and name in ("join", "replace"):
        return partial(_joined if name == "join" else _replaced, owner)
    if isinstance(owner, list) and name == "append":
        return partial(_appended, owner)
    for kind, names in METHODS.items():
        if isinstance(owner, kind) and name in names:
            return getattr(owner, name)
    raise ExpressionError(f"a {type(owner).__name__} has no {name!r} that a file may use")


def _appended(items: list[Any], item: Any) -> None:
    _check_length(_size(items) + _size(item))
    items.append(item)


def _joined(separator: str, parts: Iterable[str]) -> str:
    parts = list(parts)
    _check_length(sum(len(part) + len(separator) for part in parts))
    return separator.join(parts)


def _replaced(text: str, old: str, new: str) -> str:
    _check_length(len(text) + text.count(old) * len(new))
    return text.replace(old, new)


def _size(value: Any) -> int:
    """Count the items and characters in a value, again wherever they stand; few above `LONGEST`."""
    size, left = 0, [value]
    while left and size <= LONGEST:
        match left.pop():
            case str() as text:
                size += len(text)
            case dict() as table:
                size += len(table)
                left += [*table.keys(), *table.values()]
            case list() | tuple() | set() | frozenset() as items:
                size += len(items)
                left += items
    return size


def _check_product(a: Any, b: Any) -> None:
    """Check that a product of whole numbers or of a sequence and a number is not too long."""
    if isinstance(a, int) and isinstance(b, int):
        _check_length(a.bit_length() + b.bit_length())
    for sequence, times in ((a, b), (b, a)):
        if isinstance(sequence, (str, list, tuple)) and isinstance(times, int):
            _check_length(_size(sequence) * times)


def _check_length(length: int) -> None:
    if length > LONGEST:
        raise ExpressionError(f"a value is longer than {LONGEST:,}")


class _Guarded(ast.NodeTransformer):
    """Replaces attributes, iterations and growing operations by checked ones."""

    OPERATORS: Mapping[type[ast.operator], str] = {
        ast.Add: "+",
        ast.Mult: "*",
        ast.Pow: "**",
        ast.LShift: "<<",
        ast.Mod: "%",
    }

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        return _call("attribute", self.visit(node.value), ast.Constant(node.attr))

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        operation = self.OPERATORS.get(type(node.op))
        return _call(operation, node.left, node.right) if operation else node

    def _value(self, node: ast.expr) -> ast.AST:
        """Return the code of a value whose size is checked."""
        self.generic_visit(node)
        return _call("value", node)

    visit_Call = visit_Dict = visit_Set = visit_JoinedStr = _value
    visit_ListComp = visit_SetComp = visit_DictComp = _value

    def _display(self, node: ast.List | ast.Tuple) -> ast.AST:
        return self._value(node) if isinstance(node.ctx, ast.Load) else node

    visit_List = visit_Tuple = _display

    def visit_comprehension(self, node: ast.comprehension) -> ast.AST:
        self.generic_visit(node)
        node.iter = _call("items", node.iter)
        return node

    def visit_Lambda(self, node: ast.Lambda) -> ast.AST:
        self.generic_visit(node)
        node.body = ast.Subscript(
            ast.Tuple([node.body, _call("items", ast.Tuple([], ast.Load()))], ast.Load()),
            ast.Constant(0),
            ast.Load(),
        )
        return node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        if node.id.startswith("__"):
            raise ExpressionError(f"the name {node.id!r} may not be used")
        return node

    def visit_FormattedValue(self, node: ast.FormattedValue) -> ast.AST:
        self.generic_visit(node)
        if node.format_spec and re.search(r"\d{4}|Formatted", ast.dump(node.format_spec)):
            raise ExpressionError("widths of a format have up to 3 digits")
        return node


def _call(operation: str, *values: ast.expr) -> ast.Call:
    """Return the call of a checked operation."""
    name = ast.Name(GUARD, ast.Load())
    return ast.Call(name, [ast.Constant(operation), *values], [])
