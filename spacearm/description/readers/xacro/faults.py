"""Faults: why a xacro source cannot be expanded."""

from __future__ import annotations

from pathlib import Path


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
