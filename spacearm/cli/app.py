"""The application: its commands, and how their errors are reported."""

from __future__ import annotations

import functools
import io
import os
import sys
import warnings
from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.exceptions import TyperException

from spacearm.cli.options import join_numbers
from spacearm.cli.output import INTERRUPTED, in_own_words
from spacearm.errors import SpaceArmError, printable

COMMANDS = {
    "models": "models.list_models",
    "info": "models.describe_model",
    "mount": "models.write_model",
    "convert": "models.convert_model",
    "query": "queries.report_singularity",
    "nearest": "queries.find_nearest",
    "path": "queries.check_path",
    "view": "views.view_configuration",
    "map": "maps.draw_singular_map",
    "workspace": "workspaces.compute_workspace",
    "risk": "workspaces.compute_risk",
    "design": "designs.sweep_designs",
    "plan": "plans.commands.plan_motion",
    "attitudes": "missions.commands.find_attitudes",
    "reaction": "missions.commands.report_reaction",
    "wheels": "missions.commands.size_wheels_of",
    "report": "missions.commands.write_report",
    "simulate": "motions.simulations.simulate_motion",
    "capture": "captures.compute_capture",
    "sweep": "sweeps.run_study",
}
"""Module and function of each command; only the module of the command called is imported."""
HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}
NO_NUMBERS = ("models", "sweep")
"""Commands without numbers: whatever starts with a minus sign is an option."""


def application(names: Iterable[str] = COMMANDS) -> typer.Typer:
    """Make the application with some of its commands, whose modules are imported."""
    app = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None, context_settings=HELP)
    app.callback(invoke_without_command=True)(options)
    for name in names:
        module, _, function = COMMANDS[name].rpartition(".")
        command = getattr(import_module(f"spacearm.cli.{module}"), function)
        settings = HELP if name in NO_NUMBERS else HELP | {"ignore_unknown_options": True}
        app.command(name, context_settings=settings)(_stoppable(command))
    return app


def _stoppable(command: Callable[..., int]) -> Callable[..., int]:
    """Have Ctrl-C abort a command, which is said; by itself Typer exits without a word."""

    @functools.wraps(command)
    def run(*args: Any, **options: Any) -> int:
        try:
            return command(*args, **options)
        except KeyboardInterrupt as stop:
            raise typer.Abort from stop

    return run


def options(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Find where a free-floating space manipulator cannot move, and why."""
    if version:
        from spacearm import __version__

        print(f"spacearm {__version__}")
    elif context.invoked_subcommand is None:
        print(context.get_help())


def main() -> None:
    """Run the command line; bad input ends with one line on stderr and exit code 2."""
    warnings.showwarning = _show_warning
    os.environ["MPLBACKEND"] = "agg"  # pictures go to files, and the name may be none
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal without ° is no reason to stop
    try:
        words = join_numbers(sys.argv[1:])
        called = [word for word in words[:1] if word in COMMANDS]
        code = application(called or COMMANDS)(words, standalone_mode=False, prog_name="spacearm")
        sys.stdout.flush()
    except (SpaceArmError, TyperException) as error:
        message = error.format_message() if isinstance(error, TyperException) else error
        print(f"spacearm: error: {_one_line(message)}", file=sys.stderr)
        sys.exit(2)
    except typer.Abort:  # Ctrl-C
        print("spacearm: stopped", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes at exit
        if not isinstance(error, BrokenPipeError):
            print(f"spacearm: error: cannot write the output: {error}", file=sys.stderr)
        sys.exit(1)
    sys.exit(code)


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"spacearm: warning: {_one_line(message)}", file=sys.stderr)


def _one_line(message: object) -> str:
    return printable(in_own_words(" ".join(str(message).split())))
