"""Files: what a xacro source may read, which is what its packages hold."""

from __future__ import annotations

import os
import re
from pathlib import Path

from spacearm.description.readers.packages import Packages
from spacearm.description.readers.xacro.expressions import Evaluator
from spacearm.description.readers.xacro.faults import (
    MissingFileError,
    MissingPackageError,
    XacroError,
)
from spacearm.files import read

MACRO = 50
"""Steps that a macro or a file counts as."""


class Files:
    """The files of one source.

    Attributes:
        known: The files read so far.
    """

    def __init__(self, packages: Packages, evaluator: Evaluator) -> None:
        self.known: list[Path] = []
        self._packages = packages
        self._evaluator = evaluator

    def read(self, filename: str) -> tuple[Path, bytes]:
        """Read a file of the packages.

        Raises:
            XacroError: There is no such file, or it lies elsewhere.
        """
        if package := re.search(r"package://([^/]*)", filename):
            raise MissingPackageError(
                f"reads {filename[package.start() :]} of the package {package[1]!r}, which was "
                "not found",
                f"name the folder that holds {package[1]!r}: packages=[FOLDER] or --package FOLDER",
            )
        file = Path(os.path.normpath(filename))
        self._evaluator.step(MACRO)
        if not file.exists():
            raise MissingFileError(file)
        if not self._packages.holds(file):
            raise XacroError(
                f"reads {file}, which is in none of its packages",
                "if it is meant to, name its folder by packages=[FOLDER] or --package FOLDER",
            )
        self.known.append(file)
        try:
            return file, read(file)
        except OSError as error:
            raise XacroError(f"{file} cannot be read ({error})", "name a file") from None
