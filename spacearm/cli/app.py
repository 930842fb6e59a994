"""The application: its commands, and how their errors are reported."""

from __future__ import annotations

import errno
import io
import os
import re
import sys
import warnings
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from itertools import pairwise
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException
from typer.main import get_command

from spacearm.cli.wording import INTERRUPTED, NUMBER, in_own_words, join_numbers, whole_number
from spacearm.errors import ResourceError, SpaceArmError, printable
from spacearm.processes import NO_THREAD


class Command(NamedTuple):
    """A command.

    Attributes:
        place: Its module in this folder, and its function there.
        help: What --help prints; the first paragraph is the summary in the list of commands.
    """

    place: str
    help: str

    @property
    def summary(self) -> str:
        """The first paragraph of the help."""
        return self.help.partition("\n\n")[0]


#: What --help says of the whole.
ABOUT = "Find where a free-floating space manipulator cannot move, and why."
#: The commands by their names, in the order of the list of commands. The help is data and no
#: docstring: `python -OO` drops docstrings, and the list is printed without importing a command.
COMMANDS = {
    "models": Command(
        "models.list_models", "List the models of the catalogue and the arms to mount on a bus."
    ),
    "info": Command(
        "models.describe_model", "Show bodies, masses, joints, limits, tip and task of a robot."
    ),
    "mount": Command(
        "models.write_urdf",
        """Mount an arm on a bus (--bus) and write both as one URDF.

        Joints and moving links keep the names that they have in the arm's file. If --name is given,
        or if the bus already has one of these names, all of them get the arm's name as a prefix.
        """,
    ),
    "convert": Command(
        "models.write_urdf",
        """Write a robot of any supported format as a URDF.

        The URDF contains the tips, locked joints, wheels and home positions, the masses by
        --density and the meshes as --up-axes rotates them: it loads without these options. It does
        not contain --task and --joints: give them again.
        """,
    ),
    "export": Command(
        "models.export_to_file",
        """Write a robot or a motion for other programs.

        The suffix of --output is the format: URDF, MJCF or SDF of the robot; with --motion CSV,
        MATLAB, JSON, MCAP, NetCDF or Zarr of a saved motion. --c-code writes C99 code of the robot.
        """,
    ),
    "query": Command(
        "queries.report_singularity",
        "Report whether a posture is singular and which motions are lost.",
    ),
    "nearest": Command(
        "queries.find_nearest", "Find the singular posture that is nearest to a posture."
    ),
    "box": Command(
        "boxes.find_box",
        """Find joint ranges that contain no singular posture (certified).

        The ranges contain the given posture, or with --motion a whole motion.
        """,
    ),
    "boxes": Command(
        "boxes.cover_by_boxes",
        """Cover the joint space by singularity-free boxes (certified).

        With --to, the command also finds a path through the boxes from one posture to another.
        Ctrl-C keeps the boxes found so far.
        """,
    ),
    "path": Command("queries.check_path", "Certify that a joint path meets no singular posture."),
    "view": Command(
        "views.view_configuration",
        """Show a posture or play a motion in the viewer.

        The viewer has sliders for the joints. If the robot's file closes a chain, the sliders keep
        it closed. Ctrl-C closes the viewer.
        """,
    ),
    "map": Command(
        "queries.draw_singular_map",
        """Map the distance to the singular set over two joints.

        The exact singular curves are drawn on top. Ctrl-C keeps the results so far.
        """,
    ),
    "workspace": Command(
        "workspaces.compute_workspace",
        """Compute the path dependent and path independent workspaces.

        Ctrl-C keeps the results so far.
        """,
    ),
    "risk": Command(
        "workspaces.compute_risk",
        """Estimate the share of postures that are near a singularity.

        The share is given by the distance of the tip from the system CM. Ctrl-C keeps the results
        so far.
        """,
    ),
    "design": Command(
        "workspaces.sweep_designs",
        """Compare designs: masses, lengths, the mounting point.

        The measures are the path independent fraction of the workspace and, for a free-floating
        spacecraft, the share of postures near a singular one. Ctrl-C keeps the designs computed so
        far.
        """,
    ),
    "plan": Command(
        "plans.plan_motion",
        """Plan a joint motion that brings the tip to a goal.

        Ctrl-C keeps the best attempt. --with gives all arguments of sa.plan: start, goal, via,
        final_attitude, final_twist, duration, mode, origin, constraints, search. With
        search.boxes=FILE the planner also uses the boxes written by spacearm boxes --keep FILE.
        """,
    ),
    "follow": Command(
        "plans.follow_path",
        """Follow a Cartesian path from a CSV file with J*.

        Each line of the file contains the task components of the tip [m], with rotations as roll,
        pitch, yaw [rad], with --deg in degrees. If the file has one column more, the first column
        is the time [s]; else the path is followed at constant speed. A first line of names is
        skipped.

        The exit code is 3 if the arm stops before the end of the path. --with gives the other
        arguments of sa.follow: start, origin, mode, speed, at_rest, limits.
        """,
    ),
    "detumble": Command(
        "plans.detumble_motion",
        """Plan a motion after which wheels keep the spacecraft at rest.

        The start has momentum: the spacecraft tumbles. --with gives all arguments of sa.detumble:
        start with its momentum, goal, final_attitude, duration, origin, constraints with wheels,
        search.
        """,
    ),
    "attitudes": Command(
        "missions.find_attitudes",
        """Find the attitudes from which the tip can follow a path.

        Joint values near the start of the path select one branch of postures; without joint values
        all branches are tried. --with gives the other arguments of sa.feasible_attitudes: start
        with its momentum, speed, refine, seed.
        """,
    ),
    "catch": Command(
        "missions.find_catch",
        """Plan when and how the arm catches a tumbling target.

        At contact the relative velocity of tip and target is zero; then the joints bring the arm
        and the target to rest.

        --with gives the other arguments of sa.catch: start, approach, closing, touching, bears,
        wanted, mode, constraints, search; and, by grapple=[{"left":"a"},{"right":"b"}], tips that
        grasp one after the other.
        """,
    ),
    "hold": Command(
        "missions.hold_target",
        """Close a chain of tips and target, and report its singularities.

        Joints and target move from a rough start until all grasps are closed. The report says
        whether the closed chain is singular, which motions are lost, and which motion leads away
        from the singularity.

        --with gives the other arguments of sa.hold: start, limits, seed. exact=false gives the
        first-order estimate of the distance, without a search for the nearest singular posture.
        regrasp.tip=left and regrasp.grasp=ring, or a table regrasp with the arguments of
        Held.regrasp, plan how that tip regrasps. --save then writes the posture after it.
        """,
    ),
    "identify": Command(
        "missions.identify_held",
        """Identify the payload from measured rates.

        The mass, CM and inertia of the payload follow from the conservation of momentum. MODEL is
        the arm without payload.
        """,
    ),
    "reaction": Command(
        "missions.report_reaction",
        """Report the effect of a motion on the spacecraft and its wheels.

        The wheel loads are those that keep the attitude constant.
        """,
    ),
    "wheels": Command(
        "missions.size_wheels_of",
        """Compute the momentum that wheels need to keep the attitude.

        The arm moves along given motions, or so that the tip has a given speed.
        """,
    ),
    "report": Command(
        "missions.write_report",
        """Write a design report on one page.

        It shows the arm, its singular sets, workspaces and reactions. Joint values give the working
        posture; the default is a posture far from singularities.
        """,
    ),
    "simulate": Command(
        "simulations.simulate_motion",
        """Simulate an arm under a control law.

        The picture shows the path of the tip, the attitude, the joints and sigma_min.

        --with gives all arguments of sa.simulate: start, controller, plant, sampling, integration,
        mode, origin, stop, dq; or [[phases]] of sa.simulate_phases. Ctrl-C keeps the results so
        far.
        """,
    ),
    "watch": Command(
        "simulations.watch_states",
        """Warn when joint states come near a singular posture.

        The command reads a stream of joint states, one in each line. The warning comes --ahead
        seconds early.
        """,
    ),
    "capture": Command(
        "queries.compute_capture",
        """Compute the velocities just after the tip grasps a moving body.

        The tip is at rest before; the body moves and spins.
        """,
    ),
    "sweep": Command(
        "sweeps.run_study",
        """Compute a study chunk by chunk, or resume a stopped one.

        To resume, run the same command again.
        """,
    ),
}
HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}
#: What an error of the system says that lacks processes or memory.
LACKING = (errno.EAGAIN, errno.ENOMEM)
#: Commands without numbers: whatever starts with a minus sign is an option.
NO_NUMBERS = ("models", "sweep")


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
    app.callback(invoke_without_command=True, help=ABOUT)(options)
    for name, known in COMMANDS.items():
        app.command(name, help=known.help, short_help=known.summary)(lambda: None)
    return app


class CountingCommand(TyperCommand):
    """A command whose options for whole numbers take 1e6 too."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words of the command."""
        counts = {option for p in self.params if p.type.name.startswith("int") for option in p.opts}
        words = list[str]()
        for before, word in pairwise(["", *args]):
            option, equals, value = word.partition("=")
            if before in counts:
                words.append(whole_number(word))
            elif option in counts:
                words.append(f"{option}{equals}{whole_number(value)}")
            else:
                words.append(word)
        return super().parse_args(ctx, words)


def command(name: str) -> Any:
    """Import a command."""
    place, text = COMMANDS[name]
    module, _, function = place.rpartition(".")
    run = getattr(import_module(f"spacearm.cli.{module}"), function)
    settings = HELP if name in NO_NUMBERS else HELP | {"ignore_unknown_options": True}
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    typed = alone.command(name, cls=CountingCommand, help=text, context_settings=settings)
    typed(_stoppable(run))
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
    """Print the version or the list of commands; the options without a command."""
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
        sys.exit(1 if isinstance(error, ResourceError) else 2)
    except typer.Abort:  # Ctrl-C; it is a RuntimeError
        print("spacearm: stopped", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except (MemoryError, RuntimeError) as error:
        print(f"spacearm: error: {_one_line(_lacking(error))}", file=sys.stderr)
        sys.exit(1)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes at exit
        if not isinstance(error, BrokenPipeError):
            what = "" if error.errno in LACKING else "cannot write the output: "
            print(f"spacearm: error: {what}{_one_line(error)}", file=sys.stderr)
            sys.exit(1)
        sys.exit(0)
    sys.exit(code)


def _lacking(error: Exception) -> str:
    """Return the message for memory or a thread that the system does not give.

    Raises:
        RuntimeError: It is another one.
    """
    if isinstance(error, MemoryError):
        detail = f" ({error})" if str(error) else ""  # Python's own says nothing
        return f"there is not enough memory{detail}; ask for less, or raise its limit (ulimit -v)"
    if "new thread" not in str(error):
        raise error
    return NO_THREAD


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
