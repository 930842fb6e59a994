"""Kernels kept on disk, where that is possible: in the installed package or in the user's cache.

Containers and system users often have neither, disks are full, files damaged: a kernel is then
compiled anew by each process. numba itself looks at the file of a kernel only when it decides
whether what it kept is still true; here every source of a kernel counts.
"""

from __future__ import annotations

import hashlib
import warnings
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

caching: Any = import_module("numba.core.caching")  # not typed


def keep(kernel: Any) -> Any:
    """Have the compiled forms of a kernel kept on disk, as `cache=True` of numba does."""
    if hasattr(kernel, "py_func"):  # not where NUMBA_DISABLE_JIT is set
        try:
            kernel._cache = Kept(kernel.py_func)
        except (RuntimeError, OSError):  # RuntimeError: numba finds no folder
            _warn()
    return kernel


class Kept(caching.FunctionCache):
    """The compiled forms of one kernel, by the types of its arguments."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file = caching.IndexDataCacheFile(
            self.cache_path, self._impl.filename_base, _sources()
        )

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return what was compiled for a signature, or None; damaged files are forgotten."""
        try:
            return super().load_overload(signature, context)
        except Exception:  # whatever pickle and LLVM make of a damaged file
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep what was compiled for a signature."""
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
def _warn() -> None:
    """Warn, once in each process."""
    warnings.warn(
        "compiled kernels cannot be kept: no folder that can be written, or a full disk. Each "
        "process compiles them anew, for some seconds; set NUMBA_CACHE_DIR to another folder",
        RuntimeWarning,
        stacklevel=1,
    )
