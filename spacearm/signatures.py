"""Calls of public functions, methods and constructors: arguments checked, progress shown.

One check against the annotations for all kinds: what is of another kind, missing or unknown is
named with what to give instead. Of arrays the shape is checked too, as the docstring states it;
shapes and values of all else that NumPy makes numbers of are checked where they are used, by
`arrays` and `model.joints`.

What takes over a second is shown on a terminal, or below the cell of a notebook, until it is done,
with the share that is done where the function reports it. One thread looks now and then at the call
that goes on. Nothing is shown elsewhere, in other threads and processes, and within such a call.
"""

from __future__ import annotations

import ast
import inspect
import math
import multiprocessing
import os
import re
import sys
import threading
import time
import types
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache, partial, wraps
from html import escape
from itertools import islice
from numbers import Integral, Real
from textwrap import dedent
from typing import TYPE_CHECKING, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from spacearm.errors import ConfigurationError, shortened, unknown

if TYPE_CHECKING:
    from typing_extensions import dataclass_transform as dataclass_transform
else:

    def dataclass_transform(**_: object) -> Any:
        """Stand in for the mark by which type checkers know bases of dataclasses."""
        return lambda kind: kind


F = TypeVar("F", bound=Callable[..., Any])
#: An annotation; the types of typing have no common one.
Hint = Any

#: What to give where an object of a class is wanted.
GIVE = {
    "SpaceArm": "an arm: arm = sa.load(...)",
    "Configuration": "a configuration: arm.at(q)",
    "Motion": "a motion, as sa.plan, sa.follow and sa.simulate return",
    "Playable": "a motion, as sa.plan, sa.follow and sa.simulate return",
    "Postures": "a configuration: arm.at(q), or a motion",
    "Way": "a motion, as sa.plan, sa.follow and sa.simulate return",
    "UncertainArm": "an uncertain arm: sa.uncertain(arm, {...})",
    "Study": "a study: sa.Study.read(path)",
    "SE3": "a pose: sa.pose(xyz, rpy)",
    "Obstacle": "an obstacle, such as sa.Obstacle.box(...)",
    "Generator": "a generator: np.random.default_rng(seed)",
    "Any": "...",
    "object": "...",
    "PathLike": "a path",
    "Path": "a pathlib.Path",
    "NoneType": "None",
    "bool": "True or False",
    "int": "a whole number",
    "float": "a number",
    "str": "a text",
}
#: Letters of shapes in docstrings that the object of a method tells, or its arm.
STATED = ("n", "tips")
#: Attributes of an object that may be what is wanted instead of it.
PARTS = ("arm", "configuration", "q")
#: Kinds of parameters that are given without their names.
IN_ORDER = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
#: Kinds that take any number of arguments.
OPEN = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
#: Characters of a value in a message.
MOST_SHOWN = 60
#: Bits of a whole number from which on a message says how long it is.
LONG_NUMBER = 200
#: Characters of a docstring in a message.
MOST_TOLD = 160
#: Entries of a sequence or mapping that are looked at.
MOST_TRIED = 1000
#: Kinds that are written as they are, where they are short.
SHORT = (Real, complex, list, tuple, dict, set, np.ndarray, os.PathLike, types.NoneType)
#: Code of functions whose `**` are arguments of their own by name, which they do not hand on.
NAMED = set[types.CodeType]()
#: What hands on what its users gave.
FRONT_ENDS = ("spacearm.cli", "spacearm.viewer", "spacearm.sweeps")
#: What stands between a call and what makes it: `checked`, and constructors in `replace`.
PASSING = (__name__, "dataclasses")
#: Seconds until a call is shown, and between two looks.
PATIENCE, LOOK = 1.0, 0.25


class _Anything(type):
    """The type of `Unseen`, whose parts and forms are itself."""

    def __getattr__(cls, name: str) -> Any:
        if name[0] == "_":
            raise AttributeError(name)
        return cls

    def __getitem__(cls, _: object) -> Any:
        return cls


class Unseen(metaclass=_Anything):
    """Stands in annotations for what is imported for type checkers only: anything fits."""


class Numbers:
    """Stands in annotations for all that NumPy makes numbers of: the union `npt.ArrayLike`."""


class Call:
    """A call that goes on.

    Attributes:
        name: Name of the function.
        since: When it began, by the monotonic clock [s].
        done: How much of it is done, and of how much; None of it if that is not known.
        over: Set when it has ended.
        gone: Set when its line is gone; None if there is no line.
    """

    def __init__(self, name: str) -> None:
        self.name, self.since = name, time.monotonic()
        self.done: tuple[float, float | None] = (0.0, None)
        self.over = threading.Event()
        self.gone: threading.Event | None = None

    def tell(self, done: float, of: float | None = None, *_: object) -> None:
        """Take how much is done."""
        self.done = (done, of)


class Watch:
    """Looks at the call that goes on in the main thread."""

    def __init__(self) -> None:
        self.call: Call | None = None
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._cell: object = None

    def idle(self) -> bool:
        """Tell whether a call that begins now is to be shown."""
        if self.call is not None or threading.current_thread() is not threading.main_thread():
            return False
        try:
            seen = sys.stderr.isatty() or _cell() is not None
        except (AttributeError, ValueError):  # there is none, or it is closed
            return False
        return seen and multiprocessing.parent_process() is None

    def run(self, name: str, function: Callable[[Call], Any]) -> Any:
        """Call a function with its call."""
        if self._thread is None or self._cell != _cell():  # a thread writes to where it began
            self._cell = _cell()
            self._thread = threading.Thread(target=self._look, daemon=True)
            self._thread.start()
        self.call = call = Call(name)
        try:
            return function(call)
        finally:
            with self._lock:
                self.call = None
            call.over.set()
            if call.gone:
                call.gone.wait(PATIENCE)

    def _look(self) -> None:
        while self._thread is threading.current_thread():
            time.sleep(LOOK)
            with self._lock:
                call = self.call
                if call is None or time.monotonic() - call.since < PATIENCE:
                    continue
                call.gone = gone = threading.Event()
            try:
                _show(call)
            finally:
                gone.set()


def _show(call: Call) -> None:
    """Show a call in a line that is taken away when the call is over."""
    line, write = "", _write if _cell() is None else partial(_display, f"spacearm {call.since}")
    while not call.over.wait(LOOK):
        done, of = call.done
        share = f", {min(int(100.0 * done / of), 99)}%" if of else ""
        write(line, line := f"{call.name}: {time.monotonic() - call.since:.0f} s{share}")
    write(line, "")


def _write(before: str, line: str) -> None:
    """Write a line over the one before, and blanks over what is left of that."""
    blank = " " * max(len(before) - len(line), 0)
    sys.stderr.write(f"\r{line}{blank}" if line else f"\r{blank}\r")
    sys.stderr.flush()


def _cell() -> object:
    """Return what tells the cells of a notebook apart; None where there is no notebook."""
    return getattr(sys.stderr, "parent_header", {}).get("msg_id")


def _display(name: str, before: str, line: str) -> None:
    """Write a line below the cell, over the one of this name before."""
    from IPython.display import publish_display_data

    publish: Any = publish_display_data
    publish({"text/html": escape(line)}, transient={"display_id": name}, update=bool(before))


WATCH = Watch()


def checked(thing: F) -> F:
    """Have a public function or class name the arguments that are of a wrong kind or unknown.

    Of a class: its constructor and its public methods. What this package gives itself is not
    checked, but for what front ends hand on.

    Raises:
        ConfigurationError: There are such arguments, or one is missing.
    """
    if not isinstance(thing, type):
        return _function(thing)
    for name, member in list(vars(thing).items()):
        if isinstance(member, classmethod) and name[0] != "_":
            setattr(thing, name, classmethod(_method(member.__func__, member.__func__)))
        elif inspect.isfunction(member) and (name == "__init__" or name[0] != "_"):
            setattr(thing, name, _method(member, thing if name == "__init__" else member))
    return thing


def _function(function: Callable[..., Any]) -> Any:
    """Return a function that checks what users give it."""
    _name_options(function)

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        if args and function.__name__ in (own := getattr(args[0], "equations", {})):
            return own[function.__name__](*args[1:], **kwargs)  # of a configuration of symbols
        if not (user := _user(sys._getframe(1))):
            return function(*args, **kwargs)
        check(function, args, kwargs)
        return _watched(user, function, function, args, kwargs)

    return call


def _method(method: Callable[..., Any], thing: Callable[..., Any]) -> Callable[..., Any]:
    """Return a method that checks what users give it."""
    _name_options(method)

    @wraps(method)
    def call(self: Any, *args: Any, **kwargs: Any) -> Any:
        if not (user := _user(sys._getframe(1))):
            return method(self, *args, **kwargs)
        check(thing, args if isinstance(thing, type) else (self, *args), kwargs)
        return _watched(user, thing, method, (self, *args), kwargs)

    return call


def _name_options(function: Any) -> None:
    """Make the keys of a TypedDict in `**options: Unpack[...]` arguments like all others.

    They are None unless given. Signature, annotations, checks and help then show them.
    """
    if not function.__code__.co_flags & inspect.CO_VARKEYWORDS:
        return
    signature = inspect.signature(function)
    *parameters, options = signature.parameters.values()
    if not (unpacked := re.fullmatch(r"Unpack\[(\w+)\]", str(options.annotation))):
        return
    kind = function.__globals__[unpacked[1]]
    key = options.replace(kind=options.KEYWORD_ONLY, default=None)
    for name, hint in kind.__annotations__.items():
        parameters.append(key.replace(name=name, annotation=hint.__forward_arg__))
    function.__signature__ = signature.replace(parameters=parameters)
    del function.__annotations__[options.name]
    function.__annotations__ |= get_type_hints(kind)
    NAMED.add(function.__code__)


def _watched(
    user: str,
    thing: Callable[..., Any],
    function: Callable[..., Any],
    args: Sequence[Any],
    kwargs: Mapping[str, Any],
) -> Any:
    """Call a function; a user sees on a terminal what takes long, front ends say it themselves."""
    if user.startswith(FRONT_ENDS) or not WATCH.idle():
        return function(*args, **kwargs)
    name, parameters, _ = _parameters(thing)
    told = parameters.get("progress")
    reports = told and told.kind is told.KEYWORD_ONLY and kwargs.get("progress") is None

    def done(call: Call) -> Any:
        return function(*args, **{**kwargs, "progress": call.tell} if reports else kwargs)

    return WATCH.run(name, done)


def _user(caller: types.FrameType | None) -> str:
    """Return the module outside this package, or the front end, that a call comes from, or ""."""
    while caller is not None:
        name = caller.f_globals.get("__name__") or "?"
        outside = not name.startswith("spacearm.") or name.startswith(FRONT_ENDS)
        options = caller.f_code.co_flags & inspect.CO_VARKEYWORDS  # which it may hand on
        if name not in PASSING and (outside or not options or caller.f_code in NAMED):
            return name if outside else ""
        caller = caller.f_back
    return "?"


def check(thing: Callable[..., object], args: Sequence[object], kwargs: Mapping[str, Any]) -> None:
    """Check what is given to a function or a class.

    Args:
        thing: The function, the method or the class.
        args: Its arguments, of a method the object first.
        kwargs: Its arguments by name.

    Raises:
        ConfigurationError: One is of a wrong kind, missing or unknown; says what to give.
    """
    (name, parameters, hints), (ordered, needed, more) = _parameters(thing), _names(thing)
    sizes: dict[str, int] = {}
    if args and "self" in parameters:
        owner: Any = args[0]
        parts = {"n": getattr(owner, "arm", None)}
        for letter in STATED:
            size = getattr(owner, letter, getattr(parts.get(letter), letter, None))
            sizes |= {letter: size} if isinstance(size, int) else {}
    given = dict(zip(ordered, args, strict=False))
    for key, value in kwargs.items():
        if key in parameters and parameters[key].kind is not inspect.Parameter.VAR_KEYWORD:
            given[key] = value
        elif inspect.Parameter.VAR_KEYWORD not in more:
            raise ConfigurationError(_no_such(name, key, parameters, hints))
    for key, value in given.items():
        _require(thing, name, key, value, hints)
        if isinstance(value, np.ndarray):
            _require_shape(thing, name, key, value, hints, sizes)
    if len(args) > len(ordered) and inspect.Parameter.VAR_POSITIONAL not in more:
        others = [p.name for p in parameters.values() if p.kind is p.KEYWORD_ONLY]
        rest = f"; give by name: {', '.join(others)}" if others else ""
        raise ConfigurationError(
            f"{name} was given {shown(args[len(ordered)])} after all its positional arguments: "
            f"{', '.join(ordered) or 'none'}{rest}"
        )
    for key in needed:
        if key not in given:
            what = _words(hints[key]) if key in hints else "it"
            raise ConfigurationError(f"{name} needs {key}; give {what}{_told(thing, key)}")


def check_options(thing: Callable[..., object], of: str, options: Mapping[str, object]) -> None:
    """Check options that a public function hands on to a function that is not public.

    Args:
        thing: The function that takes them.
        of: What they are options of, for messages.
        options: The options by name.

    Raises:
        ConfigurationError: One is of a wrong kind.
    """
    hints = _hints(thing)
    for name, value in options.items():
        _require(thing, of, name, value, hints)


@cache
def _parameters(
    thing: Callable[..., object],
) -> tuple[str, Mapping[str, inspect.Parameter], Mapping[str, Hint]]:
    """Return the name of a function or a class for messages, its parameters and annotations."""
    made: object = thing
    generated = getattr(thing, "__dataclass_params__", None)
    if isinstance(thing, type) and not (generated and generated.init):
        made = next(vars(kind)["__init__"] for kind in thing.__mro__ if "__init__" in vars(kind))
    hints = _hints(made)
    if isinstance(thing, type):  # for a field that is an array a constructor takes what makes one
        origins: dict[str, Any] = {key: get_origin(hint) for key, hint in hints.items()}
        hints |= {key: Numbers for key, origin in origins.items() if origin is np.ndarray}
    home = thing.__module__.rpartition(".")[2]
    within = f"{home}." if home in sys.modules["spacearm"].__all__ else ""  # as sa.design
    return (
        f"sa.{within}{thing.__qualname__.rpartition('<locals>.')[2]}",
        dict(inspect.signature(thing).parameters),
        hints,
    )


@cache
def _names(thing: Callable[..., object]) -> tuple[tuple[str, ...], tuple[str, ...], frozenset[Any]]:
    """Return the parameters given in order, those without default, and the kinds of open ones."""
    each = _parameters(thing)[1].values()
    ordered = tuple(p.name for p in each if p.kind in IN_ORDER)
    needed = tuple(p.name for p in each if p.default is p.empty and p.kind not in OPEN)
    return ordered, needed, frozenset(p.kind for p in each if p.kind in OPEN)


def _hints(thing: object) -> dict[str, Hint]:
    """Return the annotations.

    Of the names that exist for type checkers only, public ones are imported; the others stand for
    anything.
    """
    public, unseen = sys.modules["spacearm"], dict[str, Any]()
    while True:
        try:
            return get_type_hints(thing, localns=unseen)
        except NameError as error:
            name = str(error.name)
            unseen[name] = getattr(public, name) if name in public.__all__ else Unseen


def _require(
    thing: Callable[..., object], of: str, name: str, value: object, hints: Mapping[str, Hint]
) -> None:
    """Raise the error for a value that does not fit its annotation."""
    if name not in hints or fits(value, hints[name]):
        return
    hint = hints[name]
    members = set(_members(hint)) - {types.NoneType}
    if isinstance(value, str) and all(get_origin(member) is Literal for member in members):
        options = [option for member in members for option in get_args(member)]
        raise ConfigurationError(unknown(name, value, options))
    instead = _words(hint)
    for part in PARTS:
        if hasattr(value, part) and fits(getattr(value, part), hint):
            joints = any(getattr(member, "__name__", "") == "Joints" for member in members)
            instead = f"sa.Joints(its .{part})" if joints else f"its .{part}"
    raise ConfigurationError(f"{of}: {name} is {shown(value)}; give {instead}{_told(thing, name)}")


def _require_shape(
    thing: Callable[..., object],
    of: str,
    name: str,
    value: Any,
    hints: Mapping[str, Hint],
    sizes: dict[str, int],
) -> None:
    """Raise the error for an array whose shape is not what the docstring states.

    Args:
        thing: What it is given to.
        of: Its name for messages.
        name: Name of the argument.
        value: Its value.
        hints: The annotations.
        sizes: What letters stand for, as far as it is known; those of this array are added.
    """
    stated, origin = _stated(thing, name), get_origin(hints.get(name))
    if not stated or origin != np.ndarray:
        return
    many = "..." in stated
    tail = stated[stated.index("...") + 1 :] if many else stated
    wrong = value.ndim < len(tail) if many else value.ndim != len(tail)
    for token, size in zip(reversed(tail), reversed(value.shape), strict=False):
        factors = [int(word) if word.isdigit() else sizes.get(word) for word in token.split()]
        if None not in factors:
            wrong |= math.prod(x for x in factors if x is not None) != size
        elif token.isidentifier():
            sizes[token] = size
    if wrong:
        raise ConfigurationError(
            f"{of}: {name} is an array of shape {value.shape}; give ({', '.join(stated)})"
            f"{_told(thing, name)}"
        )


@cache
def _stated(thing: Callable[..., object], name: str) -> tuple[str, ...]:
    """Return the shape that the docstring states of an argument: numbers, letters, products."""
    entry = rf"^ +{name}: \(([^()]*,[^()]*)\)(?! or)"
    found = re.search(entry, _docstring(thing), re.MULTILINE)
    return tuple(filter(None, map(str.strip, found[1].split(",")))) if found else ()


@cache
def _docstring(thing: Callable[..., object]) -> str:
    """Return the docstring of a function or a class, also where `python -OO` has dropped it.

    Checks and messages are then the same; the docstring is read from the source, if there is one.
    """
    if sys.flags.optimize < 2:
        return inspect.getdoc(thing) or ""
    try:
        source = dedent(inspect.getsource(thing))
    except (OSError, TypeError):
        return ""
    (defined,) = ast.parse(source).body
    if not isinstance(defined, ast.ClassDef | ast.FunctionDef):
        return ""
    return ast.get_docstring(defined) or ""


def fits(value: object, hint: Hint) -> bool:
    """Tell whether a value is of the kind that an annotation says."""
    members, origin, inner = _kind(hint)
    if len(members) > 1:
        return any(fits(value, member) for member in members)
    if origin is Literal:
        return isinstance(value, str) and value in inner
    if origin is Numbers:
        return are_numbers(value)
    if origin is np.ndarray:
        return isinstance(value, np.ndarray) and value.dtype.kind in "biuf"
    if origin in (int, float):
        kind = Integral if origin is int else Real
        if isinstance(value, kind):
            small = not isinstance(value, int) or abs(value) <= sys.float_info.max
            return not isinstance(value, bool) and (origin is int or small)
        scalar = getattr(value, "ndim", 1) == 0 and not isinstance(value, str)
        return origin is float and scalar and are_numbers(value)
    if origin is bool:
        return isinstance(value, bool | np.bool_)
    if origin is Callable:
        return callable(value) and not isinstance(value, type) and _takes(value, inner)
    if getattr(origin, "_is_protocol", False):
        return all(hasattr(value, name) for name in vars(origin) if name[0] != "_")
    if not isinstance(origin, type) or origin in (Any, object, Unseen):
        return True
    if isinstance(value, np.ndarray) and not value.ndim and issubclass(origin, Iterable):
        return False
    if origin is tuple and isinstance(value, list | np.ndarray):
        value = tuple(value)
    if isinstance(value, np.ndarray) and value.ndim and issubclass(list, origin):
        value = list(value)
    many = issubclass(origin, Iterable) and origin is not str
    if not isinstance(value, origin) or (many and isinstance(value, str)):
        return False
    return not many or not inner or _entries_fit(value, origin, inner)


@cache
def _kind(hint: Hint) -> tuple[tuple[Hint, ...], Any, tuple[Hint, ...]]:
    """Return the members of a union, in some order; of other hints the origin and what is in []."""
    members = _members(hint)
    return members, get_origin(members[0]) or members[0], get_args(members[0])


def _takes(function: Callable[..., object], inner: tuple[Hint, ...]) -> bool:
    """Tell whether a function can be called with as many arguments as stand in []."""
    if not inner or not isinstance(inner[0], list):
        return True
    call = type(function).__call__
    if isinstance(call, types.FunctionType):  # that of a class, read once
        return _binds_once(call, 1 + len(inner[0]))
    return _binds(function, len(inner[0]))


def _binds(function: Callable[..., object], count: int) -> bool:
    """Tell whether a function takes so many arguments, as far as its signature is known."""
    try:
        inspect.signature(function).bind(*[None] * count)
    except (TypeError, ValueError) as error:
        return isinstance(error, ValueError)
    return True


_binds_once = cache(_binds)


def _entries_fit(value: Any, origin: type, inner: tuple[Hint, ...]) -> bool:
    """Tell whether the entries of a sequence or a mapping are of the kinds that stand in []."""
    if issubclass(origin, Mapping):
        pairs = islice(value.items(), MOST_TRIED)
        return all(fits(k, inner[0]) and fits(v, inner[1]) for k, v in pairs)
    if origin is tuple and inner[-1] is not ...:
        return len(value) == len(inner) and all(map(fits, value, inner))
    return not isinstance(value, Collection) or all(
        fits(entry, inner[0]) for entry in islice(value, MOST_TRIED)
    )


def are_numbers(value: object) -> bool:
    """Tell whether a value may be numbers; whether it is, and their shape, is checked in use."""
    if isinstance(value, Real | str | Sequence | np.ndarray):
        return not hasattr(value, "arm")
    return any(hasattr(value, name) for name in ("__array__", "__buffer__"))


def _members(hint: Hint) -> tuple[Hint, ...]:
    """Return the members of a union, `npt.ArrayLike` as one; of what is not a union, itself.

    A type variable counts as its bound, or as the union of the types that it is constrained to.
    """
    if isinstance(hint, TypeVar) and hint.__constraints__:
        return hint.__constraints__
    if isinstance(hint, TypeVar):
        hint = hint.__bound__ or object
    origin: Any = get_origin(hint)
    if origin not in (Union, types.UnionType):
        return (types.NoneType if hint is None else hint,)
    members = get_args(hint)
    homes = ((m, str(getattr(get_origin(m) or m, "__module__", ""))) for m in members)
    others = [m for m, home in homes if not home.startswith("numpy._typing")]  # of npt.ArrayLike
    if len(others) == len(members):
        return members
    return Numbers, *(m for m in others if m not in (bool, int, float, complex, str, bytes))


def _words(hint: Hint) -> str:
    """Say what to give for an annotation."""
    members = [m for m in _members(hint) if m is not types.NoneType]
    if len(members) > 1:
        words = list[str]()
        for said in map(_words, members):
            again = said == f"a list, each entry {' or '.join(words)}"
            words.append("a list of such" if again else said)
        return " or ".join(dict.fromkeys(words))
    (hint,) = members or [types.NoneType]
    origin: Any = get_origin(hint) or hint
    inner = get_args(hint)
    name = getattr(origin, "__name__", "object")
    if origin is Literal:
        return " or ".join(map(repr, inner))
    if origin is Numbers:
        return "numbers"
    if origin is np.ndarray:
        return "an array of numbers: np.array([...])"
    if name in GIVE:
        return GIVE[name]
    if name == "Callable":
        count = len(inner[0]) if inner and isinstance(inner[0], list) else 0
        return f"a function of {count} argument{'s' * (count > 1)}" if count else "a function"
    if isinstance(origin, type) and issubclass(origin, Mapping) and inner:
        return f"a mapping {{name: {_words(inner[1])}}}"
    if origin is tuple and inner and inner[-1] is not ...:
        return f"{len(inner)} values: {', '.join(map(_words, inner))}"
    if isinstance(origin, type) and issubclass(origin, Iterable) and inner:
        return f"a list, each entry {_words(inner[0])}"
    library = str(getattr(origin, "__module__", "")).partition(".")[0]
    if library != "spacearm":
        return f"a {library}.{name}"
    return f"sa.{name}(...)" if name in sys.modules["spacearm"].__all__ else f"a {name}"


def _no_such(
    of: str, key: str, parameters: Mapping[str, inspect.Parameter], hints: Mapping[str, Hint]
) -> str:
    """Compose the message for an argument that does not exist, with where there is such a one."""
    for name in parameters:
        for member in _members(hints.get(name, object)):
            if is_dataclass(member) and key in {field.name for field in fields(member)}:
                kind = getattr(member, "__name__", "")
                return f"{of} takes no {key}; give {name}=sa.{kind}({key}=...)"
    return unknown(f"argument of {of}", key, [name for name in parameters if name != "self"])


def _told(thing: Callable[..., object], name: str) -> str:
    """Return what the docstring says of an argument, its first sentence in brackets."""
    entry = rf"^ +{name}: (.+?)(?=\n *\n|\n +\w+: |\Z)"
    found = re.search(entry, _docstring(thing), re.MULTILINE | re.DOTALL)
    if not found:
        return ""
    sentence = re.split(r"(?<=\S)[.;:] ", " ".join(found[1].split()) + " ")[0]
    return f" ({name}: {shortened(sentence.strip(' .'), MOST_TOLD)})"


def shown(value: object, most: int = MOST_SHOWN) -> str:
    """Write a value for a message: as it is in so many characters, else its kind."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, str):
        return shortened(repr(value), most)
    if isinstance(value, int) and value.bit_length() > LONG_NUMBER:
        return f"a whole number of some {round(value.bit_length() * math.log10(2.0))} digits"
    if isinstance(value, SHORT):
        try:
            written = repr(value)
        except ValueError:  # Python writes no whole numbers of thousands of digits
            written = ""
        if 0 < len(written) <= most:
            return written
    if inspect.isroutine(value):
        return "a function"
    kind = type(value).__name__
    return f"{'an' if kind[0].lower() in 'aeiou' else 'a'} {kind}"
