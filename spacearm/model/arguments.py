"""Arguments that most functions have: a configuration or an arm first, and a mode."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, wraps
from typing import Literal, ParamSpec, TypeVar

from spacearm.errors import ConfigurationError, UnsupportedError, unknown
from spacearm.model.arm import Configuration, SpaceArm

BaseMode = Literal["free-floating", "attitude-controlled", "fixed"]

FLOATING: BaseMode = "free-floating"
HELD: BaseMode = "attitude-controlled"

FREE_TWIST = {"free-floating": 6, "attitude-controlled": 3, "fixed": 0}
"""Components of the spacecraft's twist [linear; angular] that momentum conservation decides."""


def free_components(mode: str) -> int:
    """Return how many components of the spacecraft's twist momentum conservation decides.

    Raises:
        ConfigurationError: There is no such mode.
    """
    if mode not in tuple(FREE_TWIST):
        raise ConfigurationError(unknown("mode", mode, FREE_TWIST))
    return FREE_TWIST[mode]


@lru_cache(maxsize=256)
def impossible(arm: SpaceArm, mode: BaseMode) -> str:
    """Say why an arm can never do its task, and which it can; empty if it can do it."""
    return arm.fault_of_task(free_components(mode))


def require_possible(arm: SpaceArm, mode: BaseMode) -> None:
    """Refuse an arm that can never do its task.

    Raises:
        UnsupportedError: It cannot; names rows and remedy.
    """
    if fault := impossible(arm, mode):
        raise UnsupportedError(f"{arm.name}: {fault}")


P = ParamSpec("P")
T = TypeVar("T")


def of_configuration(function: Callable[P, T]) -> Callable[P, T]:
    """Have a function whose first argument is a `Configuration` say so where it is something else.

    Raises:
        ConfigurationError: It is; names what to write. Or `mode` is none of the modes.
    """

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> T:
        name = function.__name__
        if args and not isinstance(args[0], Configuration):
            if name in (equations := getattr(args[0], "equations", {})):
                found: T = equations[name](*args[1:], **kwargs)
                return found  # of a configuration of symbols
            given, rest = args[0], "q" if len(args) > 1 else "q, one number per joint"
            raise ConfigurationError(
                f"sa.{name} takes a configuration, not an arm: sa.{name}(arm.at({rest}))"
                if isinstance(given, SpaceArm)
                else f"sa.{name} takes a configuration, not a {type(given).__name__}; make one of "
                f"an arm and joint positions: sa.{name}(arm.at(q))"
            )
        _check_mode(kwargs)
        return function(*args, **kwargs)

    return checked


def of_arm(function: Callable[P, T]) -> Callable[P, T]:
    """Have a function whose first argument is a `SpaceArm` say so where it is something else.

    Raises:
        ConfigurationError: It is; names what to write. Or `mode` is none of the modes.
    """

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> T:
        if args and not isinstance(given := args[0], SpaceArm):
            instead = f"a {type(given).__name__} is none; load one: arm = sa.load(...)"
            if isinstance(given, Configuration):
                instead = "of a configuration that is cfg.arm"
            elif isinstance(given, str):
                instead = f"load it first: arm = sa.load({given[:60]!r})"
            raise ConfigurationError(f"sa.{function.__name__} takes an arm; {instead}")
        _check_mode(kwargs)
        return function(*args, **kwargs)

    return checked


def _check_mode(named: Mapping[str, object]) -> None:
    """Raise the error for a mode that does not exist."""
    if "mode" in named:
        free_components(str(named["mode"]))
