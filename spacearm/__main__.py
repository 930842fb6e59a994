"""The command `spacearm`, and `python -m spacearm`."""

import os
import signal
import stat
import sys
import time
from contextlib import suppress
from types import FrameType

#: Signals after which the command line ends as after Ctrl-C.
ENDING = ("SIGTERM", "SIGHUP", "SIGQUIT")
#: Time within which further signals mean the same: terminals that close send SIGHUP twice [s].
SAME = 1.0


class _Ending:
    """Ends the command line after a signal as Ctrl-C does: files and processes are cleaned up.

    Attributes:
        number: The first signal that came; SIGINT if none did.
    """

    def __init__(self) -> None:
        self.number = signal.SIGINT
        self._last = float("-inf")
        for name in ENDING:
            kind = getattr(signal, name, None)  # Windows lacks some
            if kind is not None and signal.getsignal(kind) is not signal.SIG_IGN:  # as nohup does
                signal.signal(kind, self._interrupt)

    def code(self) -> int:
        """Return the exit code, as shells have it."""
        return 128 + self.number

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        """Do what Ctrl-C does at present."""
        since = time.monotonic() - self._last
        self._last = time.monotonic()
        if since < SAME:
            return
        if number == signal.SIGHUP:
            _leave_what_hung_up()
        if self.number == signal.SIGINT:
            self.number = signal.Signals(number)
        handler = signal.getsignal(signal.SIGINT)
        if callable(handler):
            handler(signal.SIGINT, frame)
        else:  # Ctrl-C is ignored, as in the background jobs of scripts
            raise KeyboardInterrupt


def main() -> None:
    """Run the command line, from its first import on without a traceback after Ctrl-C."""
    ending = _Ending()
    try:
        _open_what_is_closed()
        from spacearm.cli.app import main as run

        run()
    except SystemExit:
        if ending.number != signal.SIGINT:
            sys.exit(ending.code())
        raise
    except BaseException as error:  # Python wraps what is raised while it makes a class
        if not isinstance(error.__cause__ or error, KeyboardInterrupt):
            raise
        print("spacearm: stopped", file=sys.stderr)
        sys.exit(ending.code())


def _leave_what_hung_up() -> None:
    """Have output to a terminal that is closed lead nowhere: writing to it would be an error."""
    for number in (1, 2):
        with suppress(OSError):
            if stat.S_ISCHR(os.fstat(number).st_mode) and not os.isatty(number):
                os.dup2(os.open(os.devnull, os.O_WRONLY), number)


def _open_what_is_closed() -> None:
    """Have a standard stream that is closed lead nowhere, before a file takes its number."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8"))


if __name__ == "__main__":
    main()
