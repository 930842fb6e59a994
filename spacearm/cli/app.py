"""The application: its commands, and what becomes of their errors."""

from __future__ import annotations

import io
import os
import sys
import warnings
from typing import Annotated

import typer
from typer.exceptions import TyperException

from spacearm import __version__
from spacearm.cli import (
    designs,
    maps,
    models,
    plans,
    queries,
    simulations,
    sweeps,
    views,
    workspaces,
)
from spacearm.cli.options import join_numbers
from spacearm.errors import SpaceArmError

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
app.command()(models.models)
app.command(context_settings={"ignore_unknown_options": True})(models.info)
app.command(context_settings={"ignore_unknown_options": True})(queries.query)
app.command(context_settings={"ignore_unknown_options": True})(views.view)
app.command("map", context_settings={"ignore_unknown_options": True})(maps.map_)
app.command("workspace", context_settings={"ignore_unknown_options": True})(workspaces.workspace_)
app.command(context_settings={"ignore_unknown_options": True})(designs.design)

app.command("plan", context_settings={"ignore_unknown_options": True})(plans.plan_)
app.command("simulate", context_settings={"ignore_unknown_options": True})(simulations.simulate_)
app.command("sweep")(sweeps.sweep_)


@app.callback(invoke_without_command=True)
def options(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Where a free-floating space manipulator cannot move, and why."""
    if version:
        print(f"spacearm {__version__}")
    elif context.invoked_subcommand is None:
        print(context.get_help())


def main() -> None:
    """Runs the command line: bad input ends with one line on stderr and exit code 2."""
    warnings.showwarning = _show_warning
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal without ° is no reason to stop
    try:
        code = app(join_numbers(sys.argv[1:]), standalone_mode=False)
        sys.stdout.flush()
    except (SpaceArmError, TyperException) as error:
        message = error.format_message() if isinstance(error, TyperException) else error
        print(f"spacearm: error: {_one_line(message)}", file=sys.stderr)
        sys.exit(2)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes at exit
        if not isinstance(error, BrokenPipeError):
            print(f"spacearm: error: cannot write the output: {error}", file=sys.stderr)
        sys.exit(1)
    sys.exit(code)


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"spacearm: warning: {_one_line(message)}", file=sys.stderr)


def _one_line(message: object) -> str:
    return " ".join(str(message).split())
