"""xacro: sources of robot descriptions expanded to URDF, by ROS's own program in a sandbox.

The program is the package `xacro`. It evaluates Python and reads any file and the environment. So
every source is expanded by a fresh copy of it, in which what reaches outside is replaced.
Expressions are those of `xacro_expressions`, files are XML and YAML of the packages around the
source, and the environment does not exist.
"""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Callable, Mapping
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.dom import minidom
from xml.parsers.expat import ExpatError

from lxml import etree

from spacearm.description.readers.packages import OutsideError, Packages
from spacearm.description.readers.source import WRITTEN, mended
from spacearm.description.readers.xacro_expressions import (
    BOUNDED,
    LONGEST,
    MOST_STEPS,
    Evaluator,
    ExpressionError,
)
from spacearm.files import LARGEST_TEXT, named_files, read, xml

#: Functions of xacro's namespace python that expressions do without.
CLOSED = ("type", "vars", "hash", "repr")
#: Functions of xacro's namespace math whose values have no bounds.
ENDLESS = ("factorial", "comb", "perm")
#: Names of files and macros for simulators and controllers, which describe no bodies.
EXTRAS = re.compile("gazebo|ros2?_?control|transmission|plugin", re.IGNORECASE)
#: Steps that a macro or a file counts as.
MACRO = 50
#: Largest size of a YAML file [bytes].
LARGEST_YAML = 10**6
#: Warnings of xacro that make no difference to the robot.
HARMLESS = re.compile("is deprecated|redefining global symbol|inconsistent namespace")


class Expansion:
    """The expansion of one source.

    Attributes:
        arguments: Values of the arguments that were declared or given, by name.
        known: Names of the arguments that were declared or used so far.
        files: The files read so far, the source first.
        warnings: What the source or xacro warned of.
        lines: Where the elements of the URDF were written, in order; "" but for links and joints.
    """

    def __init__(
        self, path: Path, packages: Packages, given: Mapping[str, str], most: int = MOST_STEPS
    ) -> None:
        self.arguments = dict(given)
        self.known: set[str] = set()
        self.warnings: list[str] = []
        self.lines: list[str] = []
        self._calls: dict[Any, str] = {}  # where macros are called
        self._left_out = False
        self._path = path
        self._packages = packages
        self._evaluator = Evaluator(most)
        self.files: list[Path] = []
        self._xacro = self._sandboxed_xacro()

    def urdf(self) -> bytes:
        """Return the URDF that the source expands to.

        Raises:
            XacroError: It cannot be expanded.
        """
        xacro = self._xacro
        try:
            xacro.init_stacks(str(self._path))
            xacro.substitution_args_context["arg"] = self.arguments
            document = self._parse(None, str(self._path))
            robot = document.documentElement
            name = robot.getAttribute("name")  # may name arguments that are declared further down
            if name:
                robot.removeAttribute("name")
            symbols = xacro.Table(xacro._global_symbols)
            xacro.eval_all(robot, xacro.Table(), symbols)
            if name:
                robot.setAttribute("name", str(xacro.eval_text(name, symbols)))
        except Exception as error:  # whatever xacro makes of a faulty file
            raise self._explained(error) from None
        for node in document.getElementsByTagName("*"):
            self.lines.append(node.getAttribute(WRITTEN))
            if self.lines[-1]:
                node.removeAttribute(WRITTEN)
        return document.toxml().replace("\n", " ").encode()  # one line: nobody has seen the others

    @property
    def is_small(self) -> bool:
        """Whether the expansion did with the steps that it may take."""
        return not self._evaluator.stopped

    def _explained(self, error: Exception) -> XacroError:
        """Return an error that says where it happened."""
        cause: BaseException | None = error
        while cause is not None and not isinstance(cause, (XacroError, ExpressionError)):
            cause = getattr(cause, "exc", None)
        if isinstance(cause, XacroError):
            return cause
        text = "macros or files call themselves" if isinstance(error, RecursionError) else error
        where = [f"in {Path(file).name}" for file in self._xacro.filestack[1:][-1:]]
        where += [f"in macro {m.body.getAttribute('name')!r}" for m in self._xacro.macrostack[-1:]]
        problem = " ".join([f"cannot be expanded ({' '.join(str(text).split())})", *where])
        part = ", or load the file that includes this one"
        return XacroError(
            problem,
            f"correct it there{part * ('is not defined' in problem)}, or expand it by ROS: xacro "
            "FILE > robot.urdf",
        )

    # --- the sandbox ------------------------------------------------------------------------

    def _sandboxed_xacro(self) -> ModuleType:
        """Return a copy of xacro that has only what is given here."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # its own, on Python 3.10
            import xacro as original

            xacro = module_from_spec(original.__spec__)
            original.__spec__.loader.exec_module(xacro)
        vars(xacro).update(
            {
                "safe_eval": lambda text, names, _=None: self._evaluator.evaluate(text, names),
                "eval_extension": self._substitute,
                "parse": self._parse,
                "load_yaml": self._load_yaml,
                **self._messages(),
                "handle_macro_call": self._call_macro(xacro.handle_macro_call),
                "check_attrs": self._recorded(xacro.check_attrs),
            }
        )
        symbols = xacro.create_global_symbols()
        closed = ((CLOSED, symbols["python"]), (ENDLESS, symbols["math"]), (ENDLESS, symbols))
        for names, table in closed:
            for name in names:
                dict.pop(table, name, None)
        for name, function in BOUNDED.items():
            symbols[name] = function
            dict.__setitem__(symbols["python"], name, function)
        vars(xacro)["_global_symbols"] = symbols
        return xacro

    def _messages(self) -> dict[str, Callable[..., None]]:
        """Return what xacro and the source give messages by; they know each by its name."""

        def message(*_: object, **__: object) -> None: ...

        def warning(*words: object, **_: object) -> None:
            self._warn(" ".join(map(str, words)))

        def error(*words: object, **_: object) -> None:
            self._warn(" ".join(map(str, words)))

        def print_location() -> None: ...

        return {f.__name__: f for f in (message, warning, error, print_location)}

    def _call_macro(self, call: Callable[..., bool]) -> Callable[..., bool]:
        """Return the call of macros: each is a step, those of files left out are left out."""

        def called(node: Any, macros: Any, symbols: Any) -> bool:
            self._evaluator.step(MACRO)
            name = node.tagName.removeprefix("xacro:")
            if self._left_out and name != node.tagName and EXTRAS.search(name):
                try:
                    self._xacro.resolve_macro(name, macros, symbols)
                except KeyError:
                    self._xacro.replace_node(node, by=None)
                    return True
            line, before, end = self._calls.get(node), node.previousSibling, node.nextSibling
            parent = node.parentNode
            replaced = call(node, macros, symbols)
            made = before.nextSibling if before else parent.firstChild
            while line and made is not end:
                if made.nodeType == made.ELEMENT_NODE and made.hasAttribute(WRITTEN):
                    made.setAttribute(WRITTEN, f"{made.getAttribute(WRITTEN)}, called in {line}")
                made = made.nextSibling
            return replaced

        return called

    def _recorded(self, check: Callable[..., list[Any]]) -> Callable[..., list[Any]]:
        """Return the check of attributes, which records the arguments that are declared."""

        def recorded(tag: Any, required: list[str], optional: list[str]) -> list[Any]:
            if tag.tagName == "xacro:arg":
                name = tag.getAttribute("name")
                self.known.add(name)
                if not tag.hasAttribute("default"):
                    if name not in self.arguments:
                        raise MissingArgumentError(name)
                    return [name, ""]
            return check(tag, required, optional)

        return recorded

    def _warn(self, text: str) -> None:
        if not HARMLESS.search(text) and text not in self.warnings:
            self.warnings.append(text)

    # --- files ------------------------------------------------------------------------------

    def _read(self, filename: str, most: int = LARGEST_TEXT) -> tuple[Path, bytes]:
        """Read a file of the packages of up to so many bytes.

        Raises:
            XacroError: There is no such file, or it lies elsewhere.
        """
        if package := re.search(r"package://([^/]*).*", filename):
            try:
                around = self._packages.file(package[0])
            except OutsideError as error:
                raise _outside(error.refused) from None
            if around is None:
                raise MissingPackageError(
                    f"reads {package[0]} of the package {package[1]!r}, which was not found",
                    f"name the folder that holds {package[1]!r}: packages=[FOLDER]",
                )
            filename = str(around)
        self._evaluator.step(MACRO)
        named = named_files(filename, [Path()], self._packages.holds)
        if named.found:
            file = named.found[0]
        elif named.refused:
            raise _outside(named.refused[0])
        else:
            raise MissingFileError(Path(os.path.normpath(filename)))
        self.files.append(file)
        try:
            return file, read(file, most)
        except OSError as error:
            raise XacroError(f"{file} cannot be read ({error})", "name a file") from None

    def _parse(self, _: None, filename: str) -> Any:
        """Parse an XML file, which declares no entities, to xacro's kind of document."""
        try:
            file, content = self._read(filename)
        except MissingPackageError as error:
            if not EXTRAS.search(Path(filename).name):
                raise
            self._left_out = True
            self._warn(f"{error.problem}: left out, for it describes no bodies by its name")
            return minidom.parseString("<robot/>")
        except MissingFileError as error:  # as xacro expects it of files that are optional
            raise self._xacro.XacroException(exc=error) from None
        content = mended(content)
        try:
            root = xml(content)
            if root.getroottree().docinfo.doctype:
                raise XacroError(f"{file.name} declares a DOCTYPE", "remove it: it is not expanded")
            document = minidom.parseString(content)
        except (etree.XMLSyntaxError, ExpatError) as error:
            raise XacroError(f"{file.name} is not XML ({error})", "correct it there") from None
        written = root.iter(etree.Element)
        for node, element in zip(document.getElementsByTagName("*"), written, strict=True):
            line = f"line {element.sourceline} of {file.name}"
            if node.tagName in ("link", "joint"):
                node.setAttribute(WRITTEN, line)
            elif node.tagName.startswith("xacro:"):
                self._calls[node] = line
        return document

    def _load_yaml(self, filename: str) -> Any:
        """Load a YAML file, with xacro's units."""
        import yaml

        xacro = self._xacro

        class Loader(yaml.SafeLoader):
            pass

        for unit in xacro.ConstructUnits:
            Loader.add_constructor(unit.value.tag, unit.constructor)
        file, content = self._read(xacro.abs_filename_spec(filename), LARGEST_YAML)
        try:
            loader = Loader(content)
            node = loader.get_single_node()
            if _expanded(node) > LONGEST:
                raise XacroError(
                    f"{file.name} gives more than {LONGEST:,} items, aliases written out",
                    "shorten it",
                )
            return xacro.YamlListWrapper.wrap(node and loader.construct_document(node))
        except RecursionError:
            raise XacroError(f"{file.name} nests lists or tables too deep", "flatten it") from None
        except yaml.YAMLError as error:
            text = " ".join(str(error).split())
            raise XacroError(f"{file.name} is not YAML ({text})", "correct it there") from None

    # --- substitutions ----------------------------------------------------------------------

    def _substitute(self, text: str) -> str:
        """Return the value of $(find ...), $(arg ...), $(dirname), $(optenv ...) or $(eval ...)."""
        self._evaluator.step()
        command, *words = text[2:-1].split(None, 1) or [""]
        rest = words[0].strip() if words else ""
        match command:
            case "arg" if rest:
                return self._argument(rest)
            case "find" if rest:
                folder = self._packages.find(rest)
                return str(folder) if folder else f"package://{rest}"
            case "dirname":
                return str(Path(self._xacro.filestack[-1]).absolute().parent)
            case "optenv" if rest:
                default = rest.split(None, 1)[1:]
                self._warn(f"{text}: the environment is not read, its default is taken")
                return default[0] if default else ""
            case "eval" if rest:
                return str(self._evaluator.evaluate(rest, self._names()))
        if command in ("env", "cwd"):
            raise XacroError(
                f"asks for {text}, and nothing outside its packages is read",
                "write the value there, or expand it by ROS: xacro FILE > robot.urdf",
            )
        raise XacroError(f"has the unknown substitution {text[:60]!r}", "use $(find) or $(arg)")

    def _argument(self, name: str) -> str:
        """Return the value of an argument."""
        self.known.add(name)
        if name not in self.arguments:
            raise MissingArgumentError(name)
        return self.arguments[name]

    def _names(self) -> dict[str, Any]:
        """Return the names that $(eval ...) knows."""
        literal = self._xacro.Table._eval_literal
        functions = {name: f for name, f in vars(math).items() if not name.startswith("_")}
        plain = {"true": True, "false": False, "int": int, "float": float, "str": str}
        arguments = {name: literal(value) for name, value in self.arguments.items()}
        calls = {
            "arg": lambda name: literal(self._argument(name)),
            "find": lambda name: self._substitute(f"$(find {name})"),
        }
        names = {**functions, **plain, **arguments, **calls}
        return {name: value for name, value in names.items() if name not in ENDLESS}


def _expanded(node: Any) -> float:
    """Count the items of a YAML document, again wherever an alias names them; inf for a loop."""
    sizes: dict[int, float] = {}

    def size(node: Any) -> float:
        if id(node) not in sizes:
            sizes[id(node)] = math.inf  # while it is counted: it holds itself
            pairs = node.value if isinstance(node.value, list) else []
            parts = [x for pair in pairs for x in (pair if isinstance(pair, tuple) else [pair])]
            sizes[id(node)] = 1 + sum(map(size, parts))
        return sizes[id(node)]

    return size(node) if node else 0


def _outside(refused: str) -> XacroError:
    """Return the error for a file that is not read: its path and the reason."""
    return XacroError(f"reads {refused}", "if it is meant to, name its folder by packages=[FOLDER]")


class XacroError(Exception):
    """A source cannot be expanded.

    Attributes:
        problem: What is wrong.
        remedy: What to do.
    """

    def __init__(self, problem: str, remedy: str) -> None:
        super().__init__(f"{problem}; {remedy}")
        self.problem, self.remedy = problem, remedy


class MissingArgumentError(XacroError):
    """An argument has no value.

    Attributes:
        name: Its name.
    """

    def __init__(self, name: str) -> None:
        super().__init__(f"argument {name!r} has no value", "give it one")
        self.name = name


class MissingFileError(XacroError, FileNotFoundError):
    """A file that the source reads is missing.

    Attributes:
        file: The file.
    """

    def __init__(self, file: Path) -> None:
        super().__init__(f"{file}: no such file", "correct the name or the arguments")
        self.file = file


class MissingPackageError(XacroError):
    """A package that the source reads a file of was not found."""
