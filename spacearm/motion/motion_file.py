"""The file of a motion: named arrays of numbers and words in NumPy's format, checked when read.

Each field of a motion is one array. A list of records, such as the events of a trajectory, is one
array for each field of the records ("events_t", "events_kind"), NaN where there is none. Wrenches
by link are one array with the names beside it ("wrenches_links"). The file names the joints of the
arm, but does not hold the arm.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterable, Mapping
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, unknown
from spacearm.files import write_together, writing

Kind = TypeVar("Kind")
Arrays: TypeAlias = dict[str, npt.NDArray[Any]]
#: NumPy's letter for what an array holds ("f" numbers, "b" truth values, "U" words); its shape.
Form: TypeAlias = tuple[str, tuple[int, ...]]

LETTERS = {str: "U", float: "f", bool: "b"}
TYPES = {"U": np.str_, "f": np.float64, "b": np.bool_}
MAYBE = {"True": True, "False": False, "None": None}


class Quantity(NamedTuple):
    """A quantity over time.

    Attributes:
        unit: Its unit, such as "rad or m" of joints that turn or slide.
        columns: What its columns stand for: "joint", "pose", "component" (of a momentum), "wheel"
            or "axis"; empty for a quantity with one number at each time.
    """

    unit: str
    columns: str = ""

    def unit_for(self, slides: Iterable[bool]) -> str:
        """Return the unit for joints that turn or slide; one for each joint where they differ."""
        if self.columns != "joint":
            return self.unit
        turning, _, sliding = self.unit.partition(" or ")
        units = [sliding if slide else turning for slide in slides]
        return units[0] if len(set(units)) == 1 else ", ".join(units)

    def shape(self, m: int, n: int, wheels: int) -> tuple[int, ...]:
        """Return the shape of its array for m times, n joints and so many wheels."""
        sizes = {"joint": n, "pose": 7, "component": 6, "axis": 3, "wheel": wheels}
        return (m, sizes[self.columns]) if self.columns else (m,)


class Layout(NamedTuple):
    """The content of the file of one kind of motion.

    Attributes:
        kind: Name of the class.
        quantities: The quantities over time.
        details: The other fields and their types: `str`, `float`, `bool | None`, or `Array` for a
            number for each joint.
        lists: The fields that are tuples of records, and the types of the records.
        by_link: The fields that hold six components at each time for links by name.
        wheels: Number of wheels.
    """

    kind: str
    quantities: Mapping[str, Quantity]
    details: Mapping[str, Any]
    lists: Mapping[str, Any]
    by_link: tuple[str, ...]
    wheels: int

    @classmethod
    def of(cls, kind: type, quantities: Mapping[str, Quantity], wheels: int) -> Layout:
        """Read the layout off the types of the fields of a dataclass."""
        types = get_type_hints(kind)
        names = [
            f.name
            for f in fields(kind)
            if f.name not in ("arm", "mode", *quantities) and f.metadata.get("in_file", True)
        ]
        lists = {n: get_args(types[n])[0] for n in names if get_origin(types[n]) is tuple}
        by_link = tuple(name for name in names if get_origin(types[name]) is Mapping)
        details = {name: types[name] for name in names if name not in (*lists, *by_link)}
        return cls(kind.__name__, quantities, details, lists, by_link, wheels)


def check_suffix(path: str | os.PathLike[str]) -> None:
    """Check the name of a file to write a motion to.

    Raises:
        ConfigurationError: It does not end in .npz.
    """
    if Path(path).suffix.lower() != ".npz":
        raise ConfigurationError(
            f"{path}: a motion is saved whole as .npz; give that suffix, or write its quantities "
            "for other programs by to_xarray().to_netcdf(path)"
        )


def save_together(motions: Mapping[Path, Any]) -> None:
    """Write each motion to its file: all of them, or none.

    Raises:
        ConfigurationError: A path does not end in .npz.
        SpaceArmError: A file cannot be written.
    """
    for path in motions:
        check_suffix(path)
    contents = {path: content(motion) for path, motion in motions.items()}
    write_together({path: writing(packed) for path, packed in contents.items()})


def content(motion: Any) -> bytes:
    """Return the content of the file of a motion."""
    layout: Layout = motion._layout(motion.arm)
    joints = motion.arm.joint_names
    words = {"kind": layout.kind, "mode": motion.mode, "joints": joints}
    arrays: Arrays = {name: np.array(word) for name, word in words.items()}
    arrays |= {name: getattr(motion, name) for name in layout.quantities}
    for name, kind in layout.details.items():
        value = getattr(motion, name)
        arrays[name] = np.array(value if kind in (str, float, Array) else str(value))
    for name, record in layout.lists.items():
        items = getattr(motion, name)
        for i, (column, form) in enumerate(_forms(record, len(items), len(joints)).items()):
            none = np.full(len(joints), np.nan)
            rows = [none if item[i] is None else item[i] for item in items]
            array: npt.NDArray[Any] = np.array(rows, TYPES[form[0]])
            arrays[f"{name}_{column}"] = array.reshape(form[1])
    for name in layout.by_link:
        rows = getattr(motion, name)
        arrays[f"{name}_links"] = np.array([*rows], np.str_)
        arrays[name] = np.array([*rows.values()], np.float64).reshape(len(rows), len(motion.t), 6)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def word(arrays: Arrays, name: str) -> str:
    """Return the word in an array.

    Raises:
        ValueError: The array is missing, or holds something else.
    """
    return str(_array(arrays, name, ("U", ())))


def names(arrays: Arrays, which: str = "joints") -> tuple[str, ...]:
    """Return the names in an array.

    Raises:
        ValueError: They are missing, or no names.
    """
    found = arrays.get(which, np.empty(0))
    if found.dtype.kind != "U" or found.itemsize == 0:  # no letters, no bytes: any number of them
        raise ValueError(f"{which} holds {found.dtype} of shape {found.shape}, not names")
    return tuple(str(name) for name in found.ravel())


def wheels(arrays: Arrays, layout: Layout) -> int:
    """Return how many wheels the arm has whose motion the arrays are; none told: the layout's."""
    told = [
        arrays[name]
        for name, q in layout.quantities.items()
        if q.columns == "wheel" and name in arrays
    ]
    return told[0].shape[1] if told and told[0].ndim == 2 else layout.wheels


def values(arrays: Arrays, layout: Layout, n: int) -> dict[str, Any]:
    """Return the values of all fields of a motion of n joints but the arm.

    Raises:
        ValueError: An array is missing, or its shape or values are none that `save` writes.
    """
    m = arrays["t"].size if "t" in arrays else 0
    found: dict[str, Any] = {"mode": word(arrays, "mode")}
    for name, quantity in layout.quantities.items():
        found[name] = _array(arrays, name, ("f", quantity.shape(m, n, layout.wheels)))
    for name in {"tip", "base"} & found.keys():
        if not unit_quaternions(found[name]):
            raise ValueError(f"{name} holds quaternions that are not of length 1")
    if (found["sigma_min"] < 0.0).any():
        raise ValueError("sigma_min is negative")
    for name, kind in layout.details.items():
        if kind is float:
            found[name] = float(_array(arrays, name, ("f", ())))
        elif kind == Array:
            found[name] = _array(arrays, name, ("f", (n,)))
        elif kind is str:
            found[name] = word(arrays, name)
        elif (text := word(arrays, name)) in MAYBE:
            found[name] = MAYBE[text]
        else:
            raise ValueError(f"{name} is {text[:60]!r}, none of {', '.join(MAYBE)}")
    for name, record in layout.lists.items():
        found[name] = tuple(_records(arrays, name, record, n))
    for name in layout.by_link:
        links = names(arrays, f"{name}_links")
        form: Form = ("f", (len(links), m, 6))
        found[name] = dict(zip(links, _array(arrays, name, form), strict=True))
    return found


def unit_quaternions(poses: npt.NDArray[Any]) -> bool:
    """Tell whether the quaternions of poses (m, 7) have length 1, to 1e-6."""
    with np.errstate(over="ignore"):
        squares = np.einsum("mi,mi->m", poses[:, 3:], poses[:, 3:])
    return bool((np.abs(np.sqrt(squares) - 1.0) <= 1e-6).all())


def _forms(record: Any, k: int, n: int) -> dict[str, Form]:
    """Return the shape of the array of each field of k records; what is not a number has n."""
    types = get_type_hints(record)
    return {
        name: (LETTERS[types[name]], (k,)) if types[name] in LETTERS else ("f", (k, n))
        for name in record._fields
    }


def _records(arrays: Arrays, name: str, record: Any, n: int) -> list[Any]:
    """Return the records of a list."""
    first, hints = arrays.get(f"{name}_{record._fields[0]}", np.empty(0)), get_type_hints(record)
    columns = [
        _array(arrays, f"{name}_{column}", form, type(None) in get_args(hints[column]))
        for column, form in _forms(record, first.size, n).items()
    ]
    rows = zip(*columns, strict=True)
    return [record(*map(_value, row)) for row in rows]


def _value(x: npt.NDArray[Any]) -> Any:
    """Return a value of a record: a number, a word, an array, or None for one of NaN."""
    if x.ndim == 0:
        return x.item()
    return None if np.isnan(x).any() else x


def _array(arrays: Arrays, name: str, form: Form, gaps: bool = False) -> npt.NDArray[Any]:
    """Return an array of this form; if it holds numbers they are finite, or NaN for `gaps`.

    Raises:
        ValueError: It is missing, or has another form.
    """
    if name not in arrays:
        raise ValueError(f"it holds no {name}")
    array, (letter, shape) = arrays[name], form
    if array.shape != shape or array.dtype.kind != letter:
        raise ValueError(f"{name} holds {array.dtype} of shape {array.shape}, not {shape}")
    if letter == "f" and not (np.isfinite(array) | (gaps and np.isnan(array))).all():
        raise ValueError(f"{name} holds numbers that are not finite")
    return array


def kind_of(base: type[Kind], name: str) -> type[Kind]:
    """Return a class or the one derived from it that has a name.

    Raises:
        ConfigurationError: There is none.
    """
    kinds = {kind.__name__: kind for kind in (base, *base.__subclasses__())}
    if name in kinds:
        return kinds[name]
    package = import_module("spacearm")  # imports the home of a name when it is asked for
    found = getattr(package, name) if name in package.__all__ else None
    if isinstance(found, type) and issubclass(found, base):
        return found
    raise ConfigurationError(unknown("kind of motion", name, kinds))
