"""Arrays and numbers: those of a caller checked, those of a result read-only and as plain data."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import fields, is_dataclass
from functools import singledispatch
from numbers import Integral, Real
from pathlib import Path
from types import FunctionType
from typing import Any, ClassVar, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from spacearm.errors import ConfigurationError
from spacearm.signatures import checked, shown

T = TypeVar("T")
#: Shapes stand in the docstrings.
Array: TypeAlias = npt.NDArray[np.floating[Any]]
ArrayLike: TypeAlias = npt.ArrayLike
Booleans: TypeAlias = npt.NDArray[np.bool_]
Integers: TypeAlias = npt.NDArray[np.signedinteger[Any]]
#: Called as progress(done, total).
Progress: TypeAlias = Callable[[int, int], object]

#: Largest length, mass, inertia or joint position that is accepted, in SI units: larger ones are
#: mistakes and would overflow.
LARGEST = 1e12
#: Least positive length, mass, time, tolerance or rate that is accepted, in SI units: squares of
#: much smaller ones vanish in double precision.
SMALLEST = 1e-12
#: Most samples, points, steps or runs of one call. With a hundred bytes each they take 1 GB.
MOST_COUNT = 10_000_000
#: What conversions to an array raise: RuntimeError is that of tensors that want a gradient,
#: OverflowError that of whole numbers beyond all floats.
NO_NUMBERS = (TypeError, ValueError, RuntimeError, OverflowError)
#: Least length that is not zero [m]: products of a few shorter ones are no normal numbers.
LEAST_LENGTH = 1e-100
#: Least mass of a body [kg]: Pinocchio divides by masses.
LEAST_MASS = 1e-12

#: Most threads or processes that a call may ask for.
MOST_THREADS = 1024
#: Most links of a robot, fixed ones too: more are mistakes, and Pinocchio's frames cost the square
#: of their number.
MOST_LINKS = 10_000


@singledispatch
def plain(value: Any) -> Any:
    """Return a value as plain JSON data: dict, list, str, int, float, bool and None only.

    Whatever has a `to_dict` becomes what it returns, NamedTuples and dataclasses their public
    fields, arrays nested lists, complex numbers [re, im], functions their repr. Numbers that are
    not finite, which JSON lacks, become None. Modules register further types: `SpaceArm` is its
    name, `pin.SE3` is x, y, z and the quaternion xyzw.

    Raises:
        TypeError: The value, or a part of it, has no plain form.
    """
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if isinstance(value, np.longdouble | np.clongdouble):  # their tolist() returns the same again
        return plain(complex(value) if isinstance(value, np.clongdouble) else float(value))
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return named(value)
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value) if f.name[0] != "_"}
    if callable(value):
        return repr(value)
    raise TypeError(f"a {type(value).__name__} cannot be written as plain data")


def named(result: Any) -> dict[str, Any]:
    """Return the fields of a NamedTuple as plain JSON data: its `to_dict`."""
    return {name: plain(value) for name, value in result._asdict().items()}


class ReadOnlyMapping(Mapping[str, T]):
    """A mapping that cannot be changed. Unlike those of `types`, it can be copied and pickled.

    Args:
        entries: Its entries.
    """

    def __init__(self, entries: Mapping[str, T]) -> None:
        self._entries = dict(entries)

    def __getitem__(self, key: str) -> T:
        return self._entries[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __or__(self, other: Mapping[str, T]) -> dict[str, T]:
        return self._entries | dict(other)

    def __ror__(self, other: Mapping[str, T]) -> dict[str, T]:
        return dict(other) | self._entries

    def __repr__(self) -> str:
        return repr(self._entries)


def counted(things: Collection[T], progress: Callable[[int, int], object] | None) -> Iterator[T]:
    """Yield things; tell, when the next one is asked for, how many are done, of how many."""
    for done, thing in enumerate(things, 1):
        yield thing
        if progress:
            progress(done, len(things))


def read_only(array: Array) -> Array:
    """Return the array itself, read-only."""
    array.flags.writeable = False
    return array


def freeze(thing: object) -> None:
    """Make all arrays of an object read-only."""
    for value in vars(thing).values():
        if isinstance(value, np.ndarray):
            read_only(value)


class Frozen:
    """Base of frozen classes: the arrays of their copies are read-only, as their own are."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        freeze(self)


@checked
class Parameters(Frozen):
    """Base of frozen dataclasses that a caller gives."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data; functions as their repr."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}

    def __getstate__(self) -> dict[str, Any]:
        """Return the values for a pickle.

        Raises:
            ConfigurationError: One is a function that cannot be pickled.
        """
        for name, value in vars(self).items():
            parts = {f" of {key!r}": part for key, part in _entries(value)}
            for place, part in ({"": value} | parts).items():
                if isinstance(part, FunctionType) and not _is_found_by_name(part):
                    raise ConfigurationError(
                        f"{name}{place} of a {type(self).__name__} is a function that only the "
                        "program that made it has, and cannot be pickled; give a function that is "
                        "defined in a module, outside other functions"
                    )
        return vars(self)

    def __copy__(self) -> Parameters:
        return self._with(vars(self))

    def __deepcopy__(self, memo: dict[int, Any]) -> Parameters:
        return self._with(deepcopy(vars(self), memo))

    def _with(self, values: dict[str, Any]) -> Parameters:
        """Return an object of the same class with these values; functions may be among them."""
        other = object.__new__(type(self))
        other.__setstate__(values)
        return other


def _entries(value: object) -> Iterable[tuple[object, object]]:
    """Return the entries of a mapping; nothing of other values."""
    return value.items() if isinstance(value, Mapping) else ()


def _is_found_by_name(function: FunctionType) -> bool:
    """Tell whether pickle finds the function in its module, as another process does."""
    try:
        pickle.dumps(function)
    except (pickle.PicklingError, AttributeError):
        return False
    return True


def number_of(value: object) -> float:
    """Return a number as a float: Python's, NumPy's or an array of no dimension.

    What is none is NaN: truth values, and whole numbers beyond all floats.
    """
    value = _python_number(value)
    if not isinstance(value, Real) or isinstance(value, bool):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def _python_number(value: Any) -> Any:
    """Return what an array of no dimension holds; other values as they are."""
    if getattr(value, "ndim", None) != 0 or not hasattr(value, "item"):
        return value
    try:
        return value.item()
    except NO_NUMBERS:  # a tensor that stands for others
        return value


def whole(value: object, name: str, least: int, most: float = MOST_COUNT) -> int:
    """Check a whole number, such as a number of samples, and return it as an int.

    Args:
        value: What was given.
        name: Of the argument.
        least: Least value that is allowed.
        most: Largest value that is allowed; infinite where nothing is kept for each.

    Raises:
        ConfigurationError: It is something else.
    """
    given = _python_number(value)
    number = int(given) if isinstance(given, Integral) and not isinstance(given, bool) else None
    if number is None or not least <= number <= most:
        allowed = f"from {least:,} on" if most == math.inf else f"from {least:,} to {most:,}"
        raise ConfigurationError(f"{name} is {shown(value)}; give a whole number {allowed}")
    return number


def within(
    value: object, name: str, least: float, most: float = LARGEST, what: str = "a number"
) -> float:
    """Check a number in a range, ends included, and return it as a float.

    Args:
        value: What was given.
        name: Of the argument.
        least: Least value that is allowed.
        most: Largest value that is allowed; if infinite, up to `LARGEST` or infinite.
        what: What it is, with its unit.

    Raises:
        ConfigurationError: It is something else.
    """
    number = number_of(value)
    if not least <= number <= most or LARGEST < abs(number) < math.inf:
        allowed = f"from {least:.3g} to {min(most, LARGEST):.6g}" + ", or inf" * (most == math.inf)
        raise ConfigurationError(f"{name} is {shown(value)}; give {what} {allowed}")
    return number


def steps(span: float, step: object, name: str, most: int = MOST_COUNT) -> float:
    """Check a step or a spacing, of which a span takes a number, and return it as a float.

    Args:
        span: What is divided: a time [s], a length [m] or an angle [rad].
        step: What was given.
        name: Of the argument.
        most: Largest number of steps.

    Raises:
        ConfigurationError: It is no positive number, or the span has more such steps.
    """
    number = positive(step, name, least=0.0)
    if span > most * number:
        raise ConfigurationError(
            f"{name} is {shown(step)}; give at least {span / most:.3g}, so that there are at most "
            f"{most:,} steps"
        )
    return number


def generator(seed: int | Sequence[int]) -> np.random.Generator:
    """Return the random numbers of a seed, or of several together.

    Raises:
        ConfigurationError: One is not a whole number from 0 on.
    """
    if isinstance(seed, Sequence):
        return np.random.default_rng([whole(one, "seed", 0, math.inf) for one in seed])
    return np.random.default_rng(whole(seed, "seed", 0, math.inf))


def positive(
    value: object, name: str, what: str = "number", least: float = SMALLEST, most: float = LARGEST
) -> float:
    """Check a finite number above zero and return it as a float.

    Args:
        value: What was given.
        name: Of the argument.
        what: What it is, with its unit.
        least: Least value that is allowed, if it is above zero.
        most: Largest value that is allowed.

    Raises:
        ConfigurationError: It is something else.
    """
    number = number_of(value)
    if not least <= number <= most or not 0.0 < number < math.inf:
        allowed = f" up to {most:.6g}" if least == 0.0 else f" from {least:.6g} to {most:.6g}"
        raise ConfigurationError(f"{name} is {shown(value)}; give a positive {what}{allowed}")
    return number


def floats(values: object) -> Array:
    """Return a copy of what a caller gave as an array of floats, of any shape.

    Raises:
        TypeError: It holds something else, complex numbers too; or one of the other `NO_NUMBERS`.
    """
    given = np.asarray(values)
    if given.dtype.kind == "c":
        raise TypeError("complex numbers are no floats")
    return np.array(given, dtype=np.float64)


def numbers_of(values: object, name: str) -> Array:
    """Return a copy of what a caller gave as numbers, of any shape.

    Raises:
        ConfigurationError: It holds something else.
    """
    try:
        return floats(values)
    except NO_NUMBERS as error:
        if isinstance(error, RuntimeError):  # a tensor says what it wants
            raise ConfigurationError(f"{name} does not hold numbers: {error}") from None
        instead = "its .q" if hasattr(values, "q") else "numbers, in rows of one length"
        raise ConfigurationError(f"{name} is {shown(values)}; give {instead}") from None


def shape_of(values: object) -> tuple[int, ...]:
    """Return the shape of what a caller gave as numbers; () where it has none, as ragged lists."""
    try:
        return np.shape(np.asarray(values))
    except NO_NUMBERS:
        return ()


def finite(values: object, shape: tuple[int, ...], name: str, meaning: str = "") -> Array:
    """Return a copy of a caller's numbers, checked: one check for all vectors and matrices.

    Args:
        values: What was given.
        shape: The shape that it must have.
        name: Of the argument.
        meaning: What the numbers are, with their unit, as in "[force [N]; torque [N m]]".

    Raises:
        ConfigurationError: Not numbers of this shape, or one is not finite or beyond `LARGEST`.
    """
    try:
        array = floats(values)
    except NO_NUMBERS:
        array = np.empty(0)
    if array.shape != shape or not (np.abs(array) <= LARGEST).all():
        size = f"{shape[0]} finite number{'s' * (shape[0] != 1)}" if shape else "a finite number"
        size = f"a {shape} array of finite numbers" if len(shape) > 1 else size
        few = np.size(array) <= 36
        given = f"is {shown(values, 400)}" if few else f"has shape {np.shape(array)}"
        raise ConfigurationError(f"{name} {given}; give {size}{meaning and ' '}{meaning}")
    return array


def uniform_in_ball(rng: np.random.Generator, m: int, n: int, reach: float) -> Array:
    """Return the origin and m - 1 points of a ball about it, uniform in it, (m, n)."""
    ways = rng.normal(size=(m, n))
    ways *= reach * rng.uniform(size=(m, 1)) ** (1.0 / n) / np.linalg.norm(ways, axis=1)[:, None]
    ways[0] = 0.0
    return ways
