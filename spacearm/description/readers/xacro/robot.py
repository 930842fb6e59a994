"""xacro source: a robot file that is a xacro source, as URDF, or the reason why it gives none."""

from __future__ import annotations

from typing import NoReturn

from lxml import etree

from spacearm.description.readers.xacro.arguments import ArgumentsOf, callers, instead, names_beside
from spacearm.description.readers.xacro.expansion import Expansion
from spacearm.description.readers.xacro.faults import (
    MissingArgumentError,
    MissingFileError,
    XacroError,
)
from spacearm.description.readers.xml import Source
from spacearm.errors import unknown


def expanded(source: Source, written: etree._Element) -> etree._Element:
    """Return the root element of the URDF that a xacro source expands to.

    Args:
        source: The file.
        written: Its root element.

    Raises:
        ModelError: It cannot be expanded, lacks arguments or is a part of other sources.

    Warns:
        ModelWarning: The source or xacro warns of something.
    """
    expansion = Expansion(source.path, source.packages, source.reading.xacro_args)
    try:
        urdf = expansion.urdf()
    except MissingArgumentError as error:
        _fail_without_arguments(source, expansion, error.name)
    except MissingFileError as error:
        _fail_without_file(source, expansion, error)
    except XacroError as error:
        source.fail(f"is a xacro source: {error.problem}", error.remedy)
    for name in source.reading.xacro_args:
        if name not in expansion.known:
            source.fail(unknown("xacro argument", name, expansion.known), "name one")
    for text in expansion.warnings:
        source.warn(f"xacro: {text}")
    robot = source.parsed(urdf)
    if robot.tag == "robot" and robot.find("link") is None:
        _fail_as_part(source, written)
    return robot


def _fail_without_arguments(source: Source, expansion: Expansion, name: str) -> NoReturn:
    """Name all arguments that have no value, with their choices."""
    arguments = ArgumentsOf(expansion.files, source.packages)
    names = dict.fromkeys((name, *arguments.without_value(expansion.arguments)))
    choices = {name: arguments.choices(name) for name in names}
    listed = [f"{n} ({', '.join(c)})" if c else n for n, c in choices.items()]
    are = "an argument without a value" if len(listed) == 1 else "arguments without values"
    source.fail(
        f"is a xacro source with {are}: {'; '.join(listed)}",
        _remedy({n: c[0] if c else "..." for n, c in choices.items()}),
    )


def _fail_without_file(source: Source, expansion: Expansion, error: MissingFileError) -> NoReturn:
    """Say which argument a missing file is named after, and which values have one."""
    named = instead(error.file, expansion.arguments)
    if named is None:
        blank = ArgumentsOf(expansion.files, source.packages).in_folders(
            name for name, value in expansion.arguments.items() if not value
        )
        beside = " ".join(names_beside(error.file))
        blank = {name: v for name, v in blank.items() if any(value in beside for value in v)}
        source.fail(
            f"is a xacro source: {error.problem}"
            + "".join(f"; {name} has no value ({', '.join(v)})" for name, v in blank.items()),
            _remedy({name: v[0] for name, v in blank.items()}) if blank else "correct the name",
        )
    name, choices = named
    choices = choices or ArgumentsOf(expansion.files, source.packages).choices(name)
    value = expansion.arguments[name]
    given = "" if name in source.reading.xacro_args else ", by default"
    source.fail(
        f"is a xacro source whose argument {name} is {value!r}{given}, and there is no "
        f"{error.file}",
        f"choose another: {', '.join(choices)}; {_remedy({name: choices[0]})}"
        if choices
        else _remedy({name: "..."}),
    )


def _remedy(values: dict[str, str]) -> str:
    """Return how values are given, in Python and on the command line."""
    pairs = ", ".join(f'"{name}": "{value}"' for name, value in values.items())
    words = " ".join(f"--arg {name}:={value}" for name, value in values.items())
    return f"give xacro_args={{{pairs}}}, or on the command line {words}"


def _fail_as_part(source: Source, written: etree._Element) -> NoReturn:
    """Say that a source describes no robot but a part of one, and which sources use it."""
    macros = [e.get("name", "") for e in written.iter("{*}macro")]
    what = f"only defines macros ({', '.join(macros)})" if macros else "describes no links"
    users = callers(source.path, source.packages)
    load = f"load one that includes it: {', '.join(users[:5])}" if users else "load one of those"
    source.fail(f"is a xacro source that {what}, for other files to use", load)
