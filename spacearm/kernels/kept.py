"""Kernels kept on disk, where that is possible: in the installed package or in the user's cache.

Containers and system users often can write to neither, disks are full, files damaged. What somebody
else has compiled in the package is then used; any other kernel is compiled anew by each process.
numba itself looks at the file of a kernel only when it decides whether what it kept is still true;
here every source of a kernel counts.

Who waits for a compilation is told so on stderr, and time limits do not count it.
"""

from __future__ import annotations

import hashlib
import logging
import time
import warnings
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

caching: Any = import_module("numba.core.caching")  # not typed

InTree: Any = getattr(caching, "InTreeCacheLocator", None) or caching._InTreeCacheLocator

SECONDS = "about 10 s for each kernel"
"""How long that takes."""


def keep(kernel: Any, said: str = SECONDS) -> Any:
    """Have the compiled forms of a kernel kept on disk, as `cache=True` of numba does.

    The logger "spacearm" says, once in each process that compiles, how long that takes.
    """
    source = getattr(kernel, "py_func", getattr(kernel, "_pyfunc", None))
    if source is not None:  # not where NUMBA_DISABLE_JIT is set
        try:
            kernel._cache = Kept(source, said)
        except (RuntimeError, OSError):  # RuntimeError: numba finds no folder
            _warn()
    return kernel


class Compilation:
    """How long the compilations of this process took.

    Attributes:
        spent: Seconds so far.
    """

    def __init__(self) -> None:
        self.spent = 0.0
        self._began: list[float] = []

    def begin(self) -> None:
        """Note the time; one kernel may be compiled in the course of another."""
        self._began.append(time.monotonic())

    def end(self) -> None:
        """Count the time since the kernel begun last, unless another goes on."""
        if self._began:
            took = time.monotonic() - self._began.pop()
            self.spent += 0.0 if self._began else took


compilation = Compilation()
"""The compilations of this process."""


class ReadOnly(InTree):
    """The place of kernels in an installed package that only somebody else can write to."""

    @classmethod
    def from_function(cls, function: Any, file: str) -> ReadOnly | None:
        """Return the place of a function's kernels, if there are any."""
        place = cls(function, file)
        return place if any(Path(place.get_cache_path()).glob("*.nbi")) else None


class Places(caching.CompileResultCacheImpl):
    """The places in which kernels are kept, the first that can be written to; else that one."""

    _locator_classes = (*caching.CompileResultCacheImpl._locator_classes, ReadOnly)


class Kept(caching.FunctionCache):
    """The compiled forms of one kernel, by the types of its arguments."""

    _impl_class = Places

    def __init__(self, function: Any, said: str) -> None:
        super().__init__(function)
        self._said = said
        self._cache_file = caching.IndexDataCacheFile(
            self.cache_path, self._impl.filename_base, _sources()
        )

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return what was compiled for a signature, or None; damaged files are forgotten."""
        found = None
        try:
            found = super().load_overload(signature, context)
        except Exception:  # whatever pickle and LLVM make of a damaged file
            with suppress(OSError):
                self.flush()
        if found is None:
            _say(self._said)
            compilation.begin()
        return found

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep what was compiled for a signature."""
        compilation.end()
        try:
            super().save_overload(signature, compiled)
        except OSError:
            _warn()


@cache
def _sources() -> str:
    """Return a hash of the sources of all kernels: a step is compiled into those that call it."""
    files = sorted(Path(__file__).parent.rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


@cache
def _say(said: str) -> None:
    """Say that kernels are compiled, once in each process."""
    logging.getLogger("spacearm").warning("spacearm: compiling once (%s)", said)


@cache
def _warn() -> None:
    """Warn, once in each process."""
    warnings.warn(
        "compiled kernels cannot be kept: no folder that can be written, or a full disk. Each "
        "process compiles them anew, for some seconds; set NUMBA_CACHE_DIR to another folder",
        RuntimeWarning,
        stacklevel=1,
    )
