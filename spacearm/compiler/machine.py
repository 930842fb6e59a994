"""Machine code from LLVM's intermediate language, kept in the user's cache.

What is kept is found by a hash of the text and of the processor. A file that is foreign, damaged,
or that others can write to is not run; where nothing can be written, code is compiled anew.
"""

from __future__ import annotations

import hashlib
import os
import platform
import stat
import sys
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from spacearm.errors import ResourceError

#: Changes where what is kept can no longer be run.
VERSION = 1
#: Variable of the environment that names another folder; empty, nothing is kept.
FOLDER = "SPACEARM_CACHE"
#: Number of files that are kept; the oldest ones go.
MOST = 2000


@cache
def _llvm() -> Any:
    """Return LLVM's binding, ready to compile for this processor.

    Raises:
        ResourceError: It cannot be loaded.
    """
    try:
        import llvmlite.binding as llvm
    except (ImportError, OSError) as error:
        raise ResourceError(
            f"llvmlite, which compiles the equations of the arm, cannot be loaded: {error}; raise "
            "the limit of memory (ulimit -v), or install llvmlite again"
        ) from None

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    llvm.set_option("", "-fast-isel=0")  # it gives up at most operations, which then cost twice
    return llvm


@cache
def processor() -> tuple[str, str]:
    """Return name and features of the processor, as LLVM has them; `SPACEARM_CPU` names others."""
    if other := os.environ.get("SPACEARM_CPU"):
        name, _, features = other.partition(",")
        return name, features
    llvm = _llvm()
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


@cache
def width() -> int:
    """Return how many lanes suit this processor: four doubles, or two where registers hold no more.

    Eight fill those of AVX-512, but run no faster there and take twice as long to compile.
    """
    return 4 if "+avx" in processor()[1].split(",") else 2


@cache
def fuses() -> bool:
    """Tell whether this processor computes a b + c at once."""
    features = processor()[1]
    return "+fma" in features.split(",") or platform.machine() in ("arm64", "aarch64")


def _target(level: int) -> Any:
    llvm = _llvm()
    cpu, features = processor()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=cpu, features=features, opt=level, codemodel="jitdefault", jit=True
    )


class Code:
    """Machine code in memory, as long as this lives.

    Args:
        text: A module in LLVM's intermediate language.
        level: How much LLVM optimises, 0 to 3. Values are the same to the bit.
    """

    def __init__(self, text: str, level: int = 1) -> None:
        llvm, name = _llvm(), _name(text, level)
        self._engine = llvm.create_mcjit_compiler(  # which then owns the target
            llvm.parse_assembly(""), _target(level)
        )
        code = kept(name)
        if code is None:
            code = _target(level).emit_object(llvm.parse_assembly(text))
            keep(name, code)
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Return the address of a function."""
        return int(self._engine.get_function_address(name))


def _name(text: str, level: int) -> str:
    """Return the name under which machine code is kept."""
    versions = (str(VERSION), str(_llvm().llvm_version_info), str(level))
    return hashlib.sha256("\n".join((*versions, *processor(), text)).encode()).hexdigest()


def is_kept(text: str, level: int) -> bool:
    """Tell whether machine code for a text seems to be kept."""
    place = folder()
    return place is not None and (place / _name(text, level)).is_file()


def folder() -> Path | None:
    """Return the folder of the user's cache, made if need be; None if there is none to be had.

    It belongs to the user, and nobody else may write to it.
    """
    if (given := os.environ.get(FOLDER)) is not None:
        path = Path(given).absolute() if given else None
    elif sys.platform == "darwin":
        path = Path("~/Library/Caches/spacearm")
    else:
        base = os.environ.get("XDG_CACHE_HOME", "")
        path = Path(base if Path(base).is_absolute() else "~/.cache", "spacearm")
    if path is None:
        return None
    try:
        path = path.expanduser() / "code"
        if not path.is_absolute():  # HOME is empty
            return None
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = path.lstat()
    except (OSError, RuntimeError, ValueError):  # the last two: there is no home, a null byte
        return None
    return path if stat.S_ISDIR(found.st_mode) and _own(found) else None


def _own(found: os.stat_result) -> bool:
    """Tell whether a file belongs to the user, and nobody else may write to it."""
    return found.st_uid == os.getuid() and not found.st_mode & 0o022


def kept(name: str) -> bytes | None:
    """Return the machine code kept under a name, if there is any that is sound."""
    if (place := folder()) is None:
        return None
    try:
        number = os.open(place / name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        with os.fdopen(number, "rb") as file:
            found = os.fstat(number)
            if not stat.S_ISREG(found.st_mode) or not _own(found):
                return None
            checksum, code = file.read(32), file.read()
    except OSError:
        return None
    return code if hashlib.sha256(code).digest() == checksum else None


def keep(name: str, code: bytes) -> None:
    """Keep machine code under a name, where that is possible."""
    if (place := folder()) is None:
        return
    with suppress(OSError):
        number, path = tempfile.mkstemp(dir=place)  # 0600
        try:
            with os.fdopen(number, "wb") as file:
                file.write(hashlib.sha256(code).digest() + code)
            Path(path).replace(place / name)
        except OSError:
            Path(path).unlink(missing_ok=True)
        if len(files := [*place.iterdir()]) > MOST:  # some at once: to look at all takes a while
            files.sort(key=lambda each: each.lstat().st_mtime)
            for old in files[: len(files) - MOST + MOST // 8]:
                old.unlink()


def processors() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
