"""The command `spacearm`, and `python -m spacearm`."""

import os
import sys


def main() -> None:
    """Run the command line, from its first import on without a traceback after Ctrl-C."""
    try:
        _open_what_is_closed()
        from spacearm.cli.app import main as run

        run()
    except BaseException as error:  # Python wraps what is raised while it makes a class
        if not isinstance(error.__cause__ or error, KeyboardInterrupt):
            raise
        print("spacearm: stopped", file=sys.stderr)
        sys.exit(130)  # as shells have it


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
