"""xacro source: a robot file that is a xacro source, as URDF, or the reason why it gives none."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from lxml import etree

from spacearm.description.readers import xacro_expansion
from spacearm.description.readers.packages import Packages
from spacearm.description.readers.source import WRITTEN, Source, apart, mended
from spacearm.description.readers.xacro_expansion import Expansion, XacroError
from spacearm.errors import ModelError, unknown
from spacearm.files import is_folder, is_there, read, xml

#: Steps of an expansion that are taken here; one that takes more has a process of its own.
FEW_STEPS = 100_000


def expanded(source: Source, written: etree._Element) -> etree._Element:
    """Return the root element of the URDF that a xacro source expands to.

    Args:
        source: The file, which takes the notes.
        written: Its root element.

    Raises:
        ModelError: It cannot be expanded, lacks arguments or is a part of other sources.

    Warns:
        ModelWarning: The source or xacro warns of something.
    """
    expansion = Expansion(source.path, source.packages, source.reading.xacro_args, FEW_STEPS)
    try:
        return _expanded(source, written, expansion)
    except ModelError:
        if expansion.is_small:
            raise
    return source.parsed(apart(source, _expanded_apart))


def _expanded_apart(source: Source) -> bytes:
    """Return the URDF of a source that takes many steps, with where its elements were written."""
    expansion = Expansion(source.path, source.packages, source.reading.xacro_args)
    return etree.tostring(_expanded(source, source.root(), expansion))


def _expanded(source: Source, written: etree._Element, expansion: Expansion) -> etree._Element:
    """Return the root element of the URDF, errors and warnings as of `expanded`."""
    try:
        urdf = expansion.urdf()
    except xacro_expansion.MissingArgumentError as error:
        _fail_without_arguments(source, expansion, error.name)
    except xacro_expansion.MissingFileError as error:
        _fail_without_file(source, expansion, error)
    except XacroError as error:
        source.fail(f"is a xacro source: {error.problem}", error.remedy)
    for name in source.reading.xacro_args:
        if name not in expansion.known:
            source.fail(unknown("xacro argument", name, expansion.known), "name one")
    for text in expansion.warnings:
        source.warn(f"xacro: {text}")
    robot = source.parsed(urdf)
    for element, line in zip(robot.iter(etree.Element), expansion.lines, strict=True):
        if line:
            element.set(WRITTEN, line)
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


def _fail_without_file(
    source: Source, expansion: Expansion, error: xacro_expansion.MissingFileError
) -> NoReturn:
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
    """Return how values are given."""
    pairs = ", ".join(f'"{name}": "{value}"' for name, value in values.items())
    return f"give xacro_args={{{pairs}}}"


def _fail_as_part(source: Source, written: etree._Element) -> NoReturn:
    """Say that a source describes no robot but a part of one, and which sources use it."""
    macros = [e.get("name", "") for e in written.iter("{*}macro")]
    what = f"only defines macros ({', '.join(macros)})" if macros else "describes no links"
    users = callers(source.path, source.packages)
    load = f"load one that includes it: {', '.join(users[:5])}" if users else "load one of those"
    source.fail(f"is a xacro source that {what}, for other files to use", load)


VARIABLE = re.compile(r"\$\(arg\s+([\w.-]+)\)|\$\{\s*(\w+)\s*\}")
EXPRESSION = re.compile(r"\$\{([^}]*)\}|\$\(eval\s+([^)]*)\)")
VALUE = re.compile(r"[\w.+-]+")
#: Largest number of values that are shown.
MOST_CHOICES = 40
#: Largest number of sources that are searched for the name of another.
MOST_SOURCES = 2_000


class ArgumentsOf:
    """What the files of a source say about its arguments.

    Args:
        files: The files that have been read, the source first.
        packages: Where its packages are.
    """

    def __init__(self, files: Iterable[Path], packages: Packages) -> None:
        self._packages = packages
        self._roots = {file: root for file in files if (root := _document(file)) is not None}

    def without_value(self, given: Iterable[str]) -> list[str]:
        """Return the names that are declared without a default or never declared, in order."""
        elements = [element for root in self._roots.values() for element in root.iter("{*}arg")]
        declared = {e.get("name", ""): e.get("default") for e in elements}
        used = (name for _, text in self._texts() for name, _ in VARIABLE.findall(text) if name)
        wanted = [name for name, default in declared.items() if default is None]
        wanted += [name for name in used if name not in declared]
        return [name for name in dict.fromkeys(wanted) if name and name not in given]

    def choices(self, name: str) -> list[str]:
        """Return the values that folders show, else those that conditions or comments name."""
        aliases = self._aliases(name)
        ways = (self._in_folders(aliases), self._compared(aliases), self._commented(name))
        found = (list(dict.fromkeys(values)) for values in ways)
        return next(filter(None, found), [])[:MOST_CHOICES]

    def in_folders(self, names: Iterable[str]) -> dict[str, list[str]]:
        """Return the values that folders show, for the names that they show any for."""
        found = {name: self._in_folders(self._aliases(name)) for name in names}
        return {name: values for name in found if (values := list(dict.fromkeys(found[name])))}

    def _texts(self) -> Iterator[tuple[Path, str]]:
        """Yield every attribute that holds a variable or an expression, with its file."""
        for file, root in self._roots.items():
            for element in root.iter(etree.Element):
                yield from ((file, text) for text in element.attrib.values() if "$" in text)

    def _aliases(self, name: str) -> set[str]:
        """Return the name, and those of properties and parameters that are set to it."""
        aliases = {name}
        for root in self._roots.values():
            for element in root.iter(etree.Element):
                for attribute, text in element.attrib.items():
                    match = VARIABLE.fullmatch(text)
                    if match and (match[1] or match[2]) in aliases:
                        is_property = attribute in ("value", "default")
                        aliases.add(element.get("name", "") if is_property else attribute)
        return aliases

    def _in_folders(self, aliases: set[str]) -> Iterator[str]:
        """Yield the values for which a file exists whose path they are part of."""
        for file, text in self._texts():
            names = {a or b for a, b in VARIABLE.findall(text)}
            if names & aliases and "/" in text:
                start = re.match(r"\$\(find\s+(\w+)\)/", text)
                folder = self._packages.find(start[1]) if start else file.parent
                pattern = text[start.end() :] if start else text
                if folder is not None and not EXPRESSION.search(VARIABLE.sub("", pattern)):
                    yield from _matches(folder, pattern, aliases)

    def _compared(self, aliases: set[str]) -> Iterator[str]:
        """Yield the values that conditions compare the argument with."""
        for _, text in self._texts():
            text = re.sub(r"['\"]?\$\(arg\s+(\w+)\)['\"]?", r"\1", text)
            for groups in EXPRESSION.findall(text):
                for comparison in _comparisons(groups[0] or groups[1]):
                    names = {n.id for n in ast.walk(comparison) if isinstance(n, ast.Name)}
                    left = ast.walk(comparison.left)
                    named = {n.value for n in left if isinstance(n, ast.Constant)}
                    if names & aliases or (named & aliases and "arg" in names):
                        constants = (n for c in comparison.comparators for n in ast.walk(c))
                        yield from (str(n.value) for n in constants if isinstance(n, ast.Constant))

    def _commented(self, name: str) -> Iterator[str]:
        """Yield the values that a comment lists after the name and a colon."""
        for root in self._roots.values():
            for comment in root.iter(etree.Comment):
                listed = re.search(rf"\b{re.escape(name)}\b[^:]*:(.+)", comment.text or "")
                words = re.split(r"[,|;\s]+", listed[1].strip().strip(".")) if listed else []
                words = [word.strip("'\"") for word in words if word not in ("or", "and")]
                if len(words) > 1 and all(VALUE.fullmatch(word) for word in words):
                    yield from words


def instead(file: Path, arguments: Mapping[str, str]) -> tuple[str, list[str]] | None:
    """Return the argument that a missing file is named after, and values whose file exists.

    Args:
        file: The file that is missing.
        arguments: Values of all arguments.
    """
    folder = next(parent for parent in file.parents if is_folder(parent))
    first, *rest = file.relative_to(folder).parts
    for name, value in sorted(arguments.items(), key=lambda item: -len(item[1])):
        if value and value in first:
            before, _, after = first.partition(value)
            entries = (entry.name for entry in sorted(folder.iterdir()))
            fitting = (e for e in entries if e.startswith(before) and e.endswith(after))
            values = [e[len(before) : len(e) - len(after)] for e in fitting]
            tails = {v: [part.replace(value, v) for part in rest] for v in values if v}
            places = {v: Path(folder, before + v + after, *tail) for v, tail in tails.items()}
            return name, [v for v, place in places.items() if is_there(place)][:MOST_CHOICES]
    return None


def names_beside(file: Path) -> list[str]:
    """Return the names with which a missing file would exist, of the part that is missing."""
    folder = next(parent for parent in file.parents if is_folder(parent))
    rest = file.relative_to(folder).parts[1:]
    return [e.name for e in sorted(folder.iterdir()) if rest and is_there(e.joinpath(*rest))]


def callers(source: Path, packages: Packages) -> list[str]:
    """Return the names of the sources around one that include it."""
    found: list[str] = []
    name = source.name.encode()
    for count, file in enumerate(_sources(source, packages)):
        if count == MOST_SOURCES:
            break
        try:
            if file != source and re.search(rb"include[^>]*[/\"']" + re.escape(name), read(file)):
                found.append(file.name)
        except OSError:
            continue
    return sorted(set(found))


def _sources(source: Path, packages: Packages) -> Iterator[Path]:
    """Yield the xacro sources of the package of a source, or of its folder if it is in none."""
    package = (f for f in packages.around if (f / "package.xml").is_file())
    yield from next(package, source.parent).rglob("*.xacro")


def _document(file: Path) -> etree._Element | None:
    if file.suffix.lower() in (".yaml", ".yml"):
        return None
    try:
        return xml(mended(read(file)))
    except (OSError, etree.XMLSyntaxError):
        return None


def _matches(folder: Path, pattern: str, aliases: set[str]) -> Iterator[str]:
    """Yield the values of a variable for which a file of this pattern exists in the folder."""
    wild, regular, end, known = "", "", 0, False
    for variable in VARIABLE.finditer(pattern):
        plain = pattern[end : variable.start()]
        end = variable.end()
        wild += f"{plain}*"
        regular += re.escape(plain)
        if (variable[1] or variable[2]) in aliases:
            regular += "(?P=value)" if known else "(?P<value>[^/]+)"
            known = True
        else:
            regular += "[^/]*"
    regular += re.escape(pattern[end:])
    if not known or pattern.startswith("/"):
        return
    with suppress(ValueError):  # "**" within a word is not a pattern; ".." leads out of the folder
        for path in sorted(folder.glob(wild + pattern[end:])):
            if match := re.fullmatch(regular, path.relative_to(folder).as_posix()):
                yield match["value"]


def _comparisons(text: str) -> list[ast.Compare]:
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError):
        return []
    return [node for node in ast.walk(tree) if isinstance(node, ast.Compare)]
