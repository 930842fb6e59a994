"""Arguments that most functions have: a configuration or an arm first, and a mode."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Literal, ParamSpec, TypeVar

from spacearm.errors import ConfigurationError, unknown
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


P = ParamSpec("P")
T = TypeVar("T")


def of_configuration(function: Callable[P, T]) -> Callable[P, T]:
    """Have a function whose first argument is a `Configuration` say so where it is something else.

    Raises:
        ConfigurationError: It is; names what to write. Or `mode` is none of the modes.
    """

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> T:
        if args and not isinstance(args[0], Configuration):
            if function.__name__ in (equations := getattr(args[0], "equations", {})):
                found: T = equations[function.__name__](*args[1:], **kwargs)
                return found  # of a configuration of symbols
            _refuse_in_place_of_configuration(function.__name__, args)
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
        if args and not isinstance(args[0], SpaceArm):
            raise ConfigurationError(f"sa.{function.__name__} takes an arm; {_arm_for(args[0])}")
        _check_mode(kwargs)
        return function(*args, **kwargs)

    return checked


def _check_mode(named: Mapping[str, object]) -> None:
    """Raise the error for a mode that does not exist."""
    if "mode" in named:
        free_components(str(named["mode"]))


def _refuse_in_place_of_configuration(name: str, args: tuple[object, ...]) -> None:
    """Raise the error for a function of a configuration that got something else."""
    given = args[0]
    if isinstance(given, SpaceArm):
        rest = "q" if len(args) > 1 else "q, one number per joint"
        raise ConfigurationError(
            f"sa.{name} takes a configuration, not an arm: sa.{name}(arm.at({rest}))"
        )
    raise ConfigurationError(
        f"sa.{name} takes a configuration, not a {type(given).__name__}; make one of an arm and "
        f"joint positions: sa.{name}(arm.at(q))"
    )


def _arm_for(given: object) -> str:
    """Return what to write in place of what was given for an arm."""
    if isinstance(given, Configuration):
        return "of a configuration that is cfg.arm"
    if isinstance(given, str):
        return f"load it first: arm = sa.load({given[:60]!r})"
    return f"a {type(given).__name__} is none; load one: arm = sa.load(...)"
