"""Users' functions: plain array code is traced, other code is called while a run goes on.

A function is traced that keeps nothing between calls, as far as its code and what it is made of
tell, and that gives, run over symbols, what it gives over numbers. It is run over them as it was
written for NumPy and the module math.
"""

from __future__ import annotations

import dis
import math
import types
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.compiler.expressions import Expression, asarray, is_symbolic, plain
from spacearm.equations.dynamics import bias, inertia, unloaded
from spacearm.equations.kinematics import Structure, jacobian_at
from spacearm.equations.laws import Pose, State
from spacearm.equations.plant import parts
from spacearm.errors import UnsupportedError, type_of
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm

#: Functions of NumPy that make arrays, which may be filled with symbols.
MADE = ("zeros", "ones", "empty", "full", "zeros_like", "ones_like", "empty_like", "full_like")
#: Modules whose functions keep nothing, and are run as they are.
LIBRARIES = ("numpy", "math", "scipy", "pinocchio", "spacearm")

#: Instructions of functions that keep something.
STORES = frozenset(("STORE_ATTR", "STORE_GLOBAL", "DELETE_ATTR", "DELETE_SUBSCR", "YIELD_VALUE"))
#: Names in functions that keep or change something.
CHANGES = frozenset((
    "append", "extend", "insert", "pop", "popleft", "appendleft", "remove", "clear", "update",
    "add", "discard", "setdefault", "write", "send", "put", "print", "input", "open", "next",
    "setattr",
))  # fmt: skip
#: Names in functions that give another value each time.
UNEVEN = frozenset(("random", "default_rng", "time", "perf_counter", "monotonic"))
#: Values that functions may refer to.
PLAIN = (
    bool, int, float, complex, str, bytes, type(None), np.ndarray, np.generic, np.ufunc, pin.SE3,
    types.ModuleType, types.BuiltinFunctionType, type,
)  # fmt: skip
#: How far values over symbols and over numbers may be apart, as a share of the largest.
CLOSE = 1e-9

#: Arguments (arrays), and the value.
Example = tuple[Sequence[Any], Any]


@dataclass(frozen=True)
class UserFunction:
    """A user's function as it is traced: equal to others that are made of the same.

    Attributes:
        values: What the function is made of, see `values_of`.
        function: The function, which lives as long.
        traced: The same of arrays.
        examples: Gives arguments of that, and what the function itself gives.
        used: The same as equations call it.
    """

    values: tuple[Any, ...]
    function: Callable[..., Any] = field(compare=False)
    traced: Callable[..., Any] = field(compare=False)
    examples: Callable[[], Iterator[Example]] = field(compare=False)
    used: Callable[..., Any] = field(compare=False)

    @classmethod
    def of(
        cls,
        function: Callable[..., Any],
        traced: Callable[..., Any],
        examples: Callable[[], Iterator[Example]],
        used: Callable[..., Any] | None = None,
    ) -> UserFunction:
        """Return a function with what it is made of now."""
        return cls(values_of(function), function, traced, examples, used or traced)

    def __call__(self, *arguments: Any) -> Any:
        """Run it over arrays."""
        return self.used(*arguments)


@lru_cache(maxsize=64)
def not_traced(user: UserFunction, _used_with: tuple[SpaceArm, BaseMode, str]) -> str:
    """Say why a user's function cannot be traced; "" if it can.

    It is asked once for all functions that are made of the same and used with the same.
    """
    from spacearm.compiler.symbols import interpreted, trace

    if why := keeps(user.function):
        return why
    known = []
    try:
        for example in user.examples():
            known.append(example)
            if values_of(user.function) != user.values:
                return "it changes what it is made of"
    except Exception as error:  # again as it runs, where it is reported
        return f"{type(error).__name__}: {error}"
    names = [f"a{i}" for i in range(len(known[0][0]))]
    shapes = {name: np.shape(a) for name, a in zip(names, known[0][0], strict=True)}
    try:
        tape = trace(lambda **arrays: user.traced(*(arrays[name] for name in names)), shapes)
        columns = zip(*(arguments for arguments, _ in known), strict=True)
        inputs = {name: np.array(values) for name, values in zip(names, columns, strict=True)}
        values = interpreted(tape, inputs)[0]
    except Exception as error:  # whatever code does with arrays that are none
        return f"it is not plain array code: {type(error).__name__}: {error}"
    for found, (_, value) in zip(values, known, strict=True):
        wanted = np.asarray(value, dtype=float)
        size = np.nanmax(np.abs(wanted), initial=0.0) + 1e-300
        same = found.shape == wanted.shape and np.allclose(
            found, wanted, rtol=0.0, atol=CLOSE * size, equal_nan=True
        )
        if not same:
            return "it gives other values over symbols than over numbers"
    return ""


def keeps(function: Any) -> str:
    """Say what in a function may keep something between calls; "" if nothing seems to."""
    return next((why for why, _ in _walk(function, set()) if why), "")


def values_of(function: Any) -> tuple[Any, ...]:
    """Return what a function is made of; if that is the same again, so is the function."""
    return tuple(_hashable(value) for _, value in _walk(function, set()))


def _hashable(value: Any) -> Any:
    """Return a value that a function refers to as something to compare."""
    if isinstance(value, pin.SE3):
        return value.homogeneous.tobytes()
    if isinstance(value, (np.ndarray, np.generic)):
        return np.shape(value), value.tobytes()
    if isinstance(value, (bool, int, float, complex, str, bytes, type(None))):
        return value
    if isinstance(value, types.FunctionType):
        return id(value.__code__)
    if isinstance(value, (list, tuple, set, frozenset, dict)):
        return type(value).__name__, len(value)
    ours = type(value).__module__.partition(".")[0] in LIBRARIES
    return id(value if ours or isinstance(value, PLAIN) else type(value))


def _walk(value: Any, seen: set[int]) -> Iterator[tuple[str, Any]]:
    """Yield the values that a value is made of, each with what it may keep between calls, or ""."""
    yield "", value
    if id(value) in seen or isinstance(value, PLAIN):
        return
    seen.add(id(value))
    if isinstance(value, (list, tuple, set, frozenset)):
        for entry in value:
            yield from _walk(entry, seen)
    elif isinstance(value, dict):
        yield from _walk(list(value.values()), seen)
    elif isinstance(value, types.MethodType):
        yield from _walk(value.__func__, seen)
        yield from _walk(value.__self__, seen)
    elif type(value).__module__.partition(".")[0] in LIBRARIES:
        return
    elif isinstance(value, types.FunctionType):
        if value.__module__ is None or value.__module__.partition(".")[0] not in LIBRARIES:
            yield from ((why, None) for why in _kept_by_code(value.__code__))
            yield from _walk(_referred(value), seen)
    elif hasattr(value, "__dict__"):
        for kind in type(value).__mro__[:-1]:
            for name, entry in vars(kind).items():
                made = name in ("__init__", "__post_init__")
                if isinstance(entry, types.FunctionType) and not made:
                    yield from _walk(entry, seen)
        yield from _walk(vars(value), seen)
    else:
        yield f"it uses {type_of(value)}, which may change", None


def _referred(function: types.FunctionType) -> list[Any]:
    """Return the values outside that a function refers to."""
    found = []
    for cell in function.__closure__ or ():
        with suppress(ValueError):  # nothing in it yet
            found.append(cell.cell_contents)
    names = names_in(function.__code__)
    found += [function.__globals__[name] for name in names if name in function.__globals__]
    return [*found, *(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values()]


def _kept_by_code(code: types.CodeType) -> Iterator[str]:
    """Yield what code keeps between calls, or changes."""
    steps = [*dis.get_instructions(code)]
    for i, step in enumerate(steps):
        name, value, before = step.opname, step.argval, steps[max(i - 1, 0)]
        if name in STORES or (name == "STORE_DEREF" and value in code.co_freevars):
            yield f"it sets {value}"
        of_numpy = before.argval in ("np", "numpy") and value not in UNEVEN
        if name.startswith("LOAD_") and value in CHANGES | UNEVEN and not of_numpy:
            yield f"it calls {value}"
    for inside in code.co_consts:
        if isinstance(inside, types.CodeType):
            yield from _kept_by_code(inside)


class TracedConfiguration(NamedTuple):
    """What a user's law sees of a configuration while it is traced.

    `sa.generalized_jacobian`, `sa.generalized_inertia` and `sa.inverse_dynamics` take it too.

    Attributes:
        arm: The arm.
        xp: The array library.
        state: The state.
    """

    arm: SpaceArm
    xp: Any
    state: State

    def __getattr__(self, name: str) -> Any:
        """Return what a configuration has by that name, as far as it is traced."""
        if name == "tip":
            self.arm.require_one_tip()
            return self.tips[0]
        if name == "momentum":
            return self.state.y[self._momentum].copy()
        if name not in ("q", "base", "com", "tips", "wheels"):
            raise AttributeError(f"{name} of a configuration is not traced")
        return copied(getattr(self.state, name))

    @property
    def equations(self) -> dict[str, Callable[..., Any]]:
        """Functions of a configuration by name, as equations."""
        return {
            "generalized_jacobian": self._jacobian,
            "generalized_inertia": self._inertia,
            "inverse_dynamics": self._inverse_dynamics,
        }

    @property
    def _momentum(self) -> slice:
        return parts(self.arm.n, len(self.arm.wheels)).momentum

    def _tree(self, mode: BaseMode) -> Structure:
        return replace(self.state.tree, mode=mode)

    def _jacobian(self, *, mode: BaseMode = "free-floating") -> Any:
        J, R = jacobian_at(self.xp, self._tree(mode), self.state.at), self.state.base.rotation
        blocks = [R @ J[i : i + 3] for i in range(0, len(J), 3)]
        return self.xp.concatenate(blocks, axis=0)

    def _inertia(self, *, mode: BaseMode = "free-floating") -> Any:
        return inertia(self.xp, self._tree(mode), self.state.at)

    def _inverse_dynamics(self, dq: Any, ddq: Any, *, mode: BaseMode = "free-floating") -> Any:
        if self.arm.wheels:
            raise UnsupportedError("wheels turn with the links that carry them")
        xp, tree, at = self.xp, self._tree(mode), self.state.at
        h = self.state.base.rotation.T @ self.state.y[self._momentum][3:]
        c = bias(xp, tree, at, xp.asarray(dq), unloaded(at)._replace(h=h))
        return types.SimpleNamespace(tau=inertia(xp, tree, at) @ xp.asarray(ddq) + c)


def copied(value: Any) -> Any:
    """Return an array, or a tuple of them, that a law may write into."""
    if not isinstance(value, tuple):
        return value.copy()
    parts = [copied(part) for part in value]
    return Pose(*parts) if isinstance(value, Pose) else tuple(parts)


# --- over symbols ------------------------------------------------------------------------------


def over_symbols(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function as it can be run over symbols.

    In it, in the functions that it was made in or calls by name, and in methods, `numpy` and `math`
    are replaced: arrays of numbers and symbols are made, filled and computed with as those of
    numbers are. The function itself is not changed. What branches on values raises `TracingError`.
    """
    return _seen(function, {})


class _Numpy:
    """NumPy, with arrays of symbols."""

    def __getattr__(self, name: str) -> Any:
        found = getattr(np, name)
        if name in MADE:
            return lambda *arguments, **options: _made(found, *arguments, **options)
        return found

    def array(self, values: Any, *arguments: Any, **options: Any) -> Any:
        """Return an array of numbers or symbols; a type is that of numbers only."""
        found = asarray(values) if is_symbolic(values) else np.array(values, *arguments, **options)
        return found.copy()

    def asarray(self, values: Any, *arguments: Any, **options: Any) -> Any:
        """Return values as an array of numbers or symbols."""
        return asarray(values) if is_symbolic(values) else np.asarray(values, *arguments, **options)


class _Math:
    """The module math, of symbols too: NumPy has its functions by the same names."""

    def __getattr__(self, name: str) -> Any:
        found, over = getattr(math, name), getattr(np, name, None)
        if not callable(over):
            return found

        def function(*arguments: Any) -> Any:
            symbolic = any(isinstance(a, (Expression, np.ndarray)) for a in arguments)
            return (over if symbolic else found)(*arguments)

        return function


NUMPY, MATHEMATICS = _Numpy(), _Math()


def _made(function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
    """Return a new array, in which symbols may be put if it is one of numbers."""
    if "_like" in function.__name__ and isinstance(arguments[0], (Expression, np.ndarray)):
        arguments = (np.zeros(np.shape(plain(arguments[0]))), *arguments[1:])
    found = function(*arguments, **options)
    return asarray(found) if found.dtype == np.float64 else found


def _seen(value: Any, seen: dict[int, Any]) -> Any:
    """Return a value that a function refers to as symbols need it."""
    if value is np:
        return NUMPY
    if value is math:
        return MATHEMATICS
    if id(value) in seen:
        return seen[id(value)]
    if isinstance(value, partial):
        return partial(_seen(value.func, seen), *value.args, **value.keywords)
    if isinstance(value, types.MethodType):
        return types.MethodType(_seen(value.__func__, seen), value.__self__)
    if isinstance(value, types.FunctionType):
        return _function(value, seen)
    if not isinstance(value, type) and getattr(value, "__module__", None) == "math":
        return getattr(MATHEMATICS, value.__name__)
    call = None if isinstance(value, type) else vars(type(value)).get("__call__")
    if isinstance(call, types.FunctionType):
        return types.MethodType(_seen(call, seen), value)
    return value


def _function(function: types.FunctionType, seen: dict[int, Any]) -> Any:
    """Return a function with what it refers to replaced."""
    if (function.__module__ or "").partition(".")[0] in LIBRARIES:
        return function
    names = {**function.__globals__}
    cells = tuple(types.CellType() for _ in function.__closure__ or ())
    found = types.FunctionType(
        function.__code__, names, function.__name__, function.__defaults__, cells
    )
    found.__kwdefaults__ = function.__kwdefaults__
    seen[id(function)] = found
    for name in names_in(function.__code__) & names.keys():
        names[name] = _seen(names[name], seen)
    for cell, own in zip(cells, function.__closure__ or (), strict=True):
        try:
            cell.cell_contents = _seen(own.cell_contents, seen)
        except ValueError:  # nothing in it yet
            continue
    return found


def names_in(code: Any) -> set[str]:
    """Return the names that code refers to, with those of functions inside."""
    inside = (c for c in code.co_consts if hasattr(c, "co_names"))
    return set(code.co_names).union(*(names_in(c) for c in inside))
