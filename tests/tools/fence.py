"""Fence: notes and refuses what a case of fuzzing must not do, by Python's audit events (Linux).

A case may write into its own folder, and leave there what it names; it may speak with a socket that
this process itself opened on 127.0.0.1. The one program that may start is the package's own
process that reads files with a limit of memory; it is not fenced. Compiled code goes where it
always goes. C code makes no audit events: what it writes into the folder or beside it shows in the
listing afterwards, what it writes elsewhere, or tells others, is not seen.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from weakref import WeakSet

from spacearm.compiler.machine import folder as code_folder
from spacearm.processes import COMMAND

WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGES = {
    "os.chmod": ((0, 2),),
    "os.chown": ((0, 3),),
    "os.link": ((0, 2), (1, 3)),
    "os.mkdir": ((0, 2),),
    "os.remove": ((0, 1),),
    "os.rename": ((0, 2), (1, 3)),
    "os.rmdir": ((0, 1),),
    "os.symlink": ((1, 2),),
    "os.truncate": ((0, None),),
    "os.utime": ((0, 3),),
}
"""Which arguments are paths, and the descriptors of the folders they start from."""
NEVER = frozenset((
    "os.exec", "os.fork", "os.forkpty", "os.kill", "os.killpg", "os.posix_spawn", "os.spawn",
    "os.startfile", "os.system", "pty.spawn", "subprocess.Popen", "urllib.Request",
    "webbrowser.open", "socket.gethostbyaddr", "socket.gethostbyname", "socket.getnameinfo",
    "socket.sendto",
))  # fmt: skip


class Fence:
    """The fence of this process; it stands while a case runs.

    Attributes:
        broken: What cases did that they must not do.
    """

    def __init__(self) -> None:
        self.broken: list[str] = []
        self._folder: Path | None = None
        self._kept = code_folder()
        self._listening: WeakSet[socket.socket] = WeakSet()
        sys.addaudithook(self._watch)

    @contextmanager
    def around(self, folder: Path) -> Iterator[set[str]]:
        """Stands while a case runs in `folder`; it adds what it may leave there to what comes."""
        named: set[str] = set()
        before, self._folder = listing(folder.parent), folder
        try:
            yield named
        finally:
            self._folder = None
            own = {folder / name for name in named}
            for path in sorted(listing(folder.parent) ^ before):
                if not own & {path, *path.parents}:
                    self.broken.append(f"left or took away {os.path.relpath(path, folder)}")

    def _watch(self, event: str, arguments: tuple[object, ...]) -> None:
        if self._folder and (fault := self._fault(event, arguments)):
            self.broken.append(fault)
            raise PermissionError(f"fenced: {fault}")

    def _fault(self, event: str, arguments: tuple[object, ...]) -> str | None:
        if event == "subprocess.Popen" and tuple(arguments[1]) == COMMAND:
            return None
        if event == "os.kill" and arguments[1] == signal.SIGKILL and _is_worker(arguments[0]):
            return None
        if event in NEVER:
            return f"{event} {arguments}"
        if event == "open":
            path, _, flags = arguments
            if isinstance(path, int) or not isinstance(flags, int) or not flags & WRITES:
                return None
            return self._strays(event, Path(os.path.realpath(os.fsdecode(path))))
        for path, start in CHANGES.get(event, ()):
            at = arguments[start] if start is not None else -1
            if fault := self._strays(event, _place(arguments[path], at)):
                return fault
        return self._calls(event, arguments)

    def _strays(self, event: str, path: Path) -> str | None:
        """What is wrong with changing a path."""
        kept = self._kept is not None and path.is_relative_to(self._kept)
        if path == Path(os.devnull) or kept or path.is_relative_to(self._folder):
            return None
        return f"{event} {path}"

    def _calls(self, event: str, arguments: tuple[object, ...]) -> str | None:
        """What is wrong with an event of a socket."""
        if event == "socket.getaddrinfo" and arguments[0] != "127.0.0.1":
            return f"{event} {arguments[0]}"
        if event not in ("socket.bind", "socket.connect", "socket.sendmsg"):
            return None
        own, address = arguments
        if event == "socket.bind" and address[:1] == ("127.0.0.1",):
            self._listening.add(own)
            return None
        known = [s.getsockname() for s in self._listening if s.fileno() >= 0]
        met = address is None if event == "socket.sendmsg" else address in known
        return None if met and event != "socket.bind" else f"{event} {address}"


def _is_worker(pid: int) -> bool:
    """Whether a process is one that this process has started by `COMMAND`."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")[:-1]
        parent = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1]
    except OSError:
        return False
    return int(parent) == os.getpid() and tuple(map(os.fsdecode, words)) == COMMAND


def listing(folder: Path) -> set[Path]:
    """Everything in a folder and in its folders."""
    return set(folder.rglob("*"))


def _place(path: object, start: object) -> Path:
    """Where a path is, the name itself not followed; `start` is -1 or an open folder."""
    if isinstance(path, int):
        return Path(f"/proc/self/fd/{path}").readlink()
    folder = Path.cwd() if start == -1 else Path(f"/proc/self/fd/{start}").readlink()
    whole = folder / os.fsdecode(path)
    return Path(os.path.realpath(whole.parent)) / whole.name
