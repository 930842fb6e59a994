"""The application: its commands, and how their errors are reported."""

from __future__ import annotations

import io
import os
import re
import sys
import warnings
from collections.abc import Callable
from functools import cache, wraps
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException
from typer.main import get_command

from spacearm.cli.wording import INTERRUPTED, NUMBER, in_own_words, join_numbers
from spacearm.errors import SpaceArmError, printable

#: Name and place of each command, in the order of the help.
PLACES = """
models:models.list_models info:models.describe_model mount:models.mount_arm
convert:models.convert_robot query:queries.report_singularity nearest:queries.find_nearest
box:boxes.find_box boxes:boxes.cover_by_boxes path:queries.check_path
view:views.view_configuration map:queries.draw_singular_map
workspace:workspaces.compute_workspace risk:workspaces.compute_risk
design:workspaces.sweep_designs plan:plans.plan_motion follow:plans.follow_path
detumble:plans.detumble_motion attitudes:missions.find_attitudes catch:missions.find_catch
hold:missions.hold_target identify:missions.identify_held reaction:missions.report_reaction
wheels:missions.size_wheels_of report:missions.write_report simulate:simulations.simulate_motion
watch:simulations.watch_states capture:queries.compute_capture sweep:sweeps.run_study
"""
HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}
#: Commands without numbers: whatever starts with a minus sign is an option.
NO_NUMBERS = ("models", "sweep")


@cache
def _source(module: str) -> str:
    return Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8")


def _summary(place: str) -> str:
    """Return the first line of the docstring of a command, whose module is not imported."""
    module, _, function = place.partition(".")
    first = rf'^(?:def )?{function}\b.*?"""([^"\n]+)'
    found = re.search(first, _source(module), re.DOTALL | re.MULTILINE)
    return found[1] if found else ""


#: Place and summary of each command; a module is imported when its command is called.
COMMANDS = {
    name: (place, _summary(place))
    for name, _, place in (word.partition(":") for word in PLACES.split())
}


class LazyGroup(TyperGroup):
    """Commands known by name and summary until one is called, completed or asked for its help."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the name of the command called, the command, and the words that are left."""
        name, known, rest = super().resolve_command(ctx, args)
        return name, known and command(str(name)), rest


def application() -> typer.Typer:
    """Make the application; the modules of its commands are not imported."""
    app = typer.Typer(
        cls=LazyGroup, context_settings=HELP, pretty_exceptions_enable=False, rich_markup_mode=None
    )
    app.callback(invoke_without_command=True)(options)
    for name, (_, summary) in COMMANDS.items():
        app.command(name, help=summary)(lambda: None)
    return app


def command(name: str) -> Any:
    """Import a command."""
    module, _, function = COMMANDS[name][0].rpartition(".")
    run = getattr(import_module(f"spacearm.cli.{module}"), function)
    settings = HELP if name in NO_NUMBERS else HELP | {"ignore_unknown_options": True}
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    alone.command(name, context_settings=settings)(_stoppable(run))
    return get_command(alone)


def _stoppable(command: Callable[..., int]) -> Callable[..., int]:
    """Have Ctrl-C abort a command, which is said, and a pipe that is closed end it.

    By itself Typer exits without a word, with an error.
    """

    @wraps(command)
    def run(*args: Any, **options: Any) -> int:
        try:
            return command(*args, **options)
        except KeyboardInterrupt as stop:
            raise typer.Abort from stop
        except BrokenPipeError:  # who reads the output has seen enough, as `head` has
            return 0

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
        code = application()(words, standalone_mode=False, prog_name="spacearm")
        sys.stdout.flush()
    except (SpaceArmError, TyperException) as error:
        message = _refused(error) if isinstance(error, TyperException) else error
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
        sys.exit(0)
    sys.exit(code)


def _refused(error: TyperException) -> str:
    """Return the message of the parser; words that are left over are named, options as such."""
    message = error.format_message().rstrip(".")
    extra = r"(?:Got unexpected extra arguments?(?:\(s\))? \(|No such option: )(\S+)"
    left = re.match(extra, message)
    if left and "Did you mean" not in message:
        word = left[1].rstrip(")")
        option = word.startswith("-") and not NUMBER.fullmatch(word)
        message = f"{word!r} is {'not an option here' if option else 'one word too many'}"
    message = re.sub(r"is not a valid (int|float)[\w ]*$", "is not a valid number", message)
    return message if message.endswith("?") else f"{message}; see --help"


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"spacearm: warning: {_one_line(message)}", file=sys.stderr)


def _one_line(message: object) -> str:
    return printable(in_own_words(" ".join(str(message).split())))
