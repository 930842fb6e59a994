"""Output of the commands: tables for people, JSON for scripts, pictures, the page."""

from __future__ import annotations

import json
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from spacearm.arrays import plain
from spacearm.cli.wording import INTERRUPTED, in_own_words
from spacearm.errors import UNPRINTABLE, StoppedError, printable
from spacearm.files import name_part, write
from spacearm.results import Angles, Description, Tone

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spacearm.model.arm import SpaceArm
    from spacearm.motion.flights import Flight
    from spacearm.viewer.viewer import Viewer

T = TypeVar("T")
#: Width of a file or a pipe, in columns, so that no line is folded.
WIDE = 1000


class Terminal(Console):
    """A console without markup, which passes no character of a text on that commands a terminal."""

    def on_broken_pipe(self) -> None:
        """Leave it to the application that nobody reads on; Rich would exit with an error."""
        raise BrokenPipeError

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Render what is to be printed; names from files may hold anything."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else printable(text), style, control)


out = Terminal(width=None if sys.stdout and sys.stdout.isatty() else WIDE)

err = Terminal(stderr=True, width=None if sys.stderr and sys.stderr.isatty() else WIDE)

#: Seconds after which a command tells what it does where stderr is not a terminal, and how often.
FIRST, EVERY = 2.0, 10.0
STYLES: Mapping[Tone, str] = {
    "": "", "good": "bold green", "caution": "bold yellow", "bad": "bold red"
}  # fmt: skip


#: What is said of how much is done, of `done` and `total`, or of `percent`.
SHARE = "{percent} %"
#: The same of a search, whose `total` is a time [s], and of work that a number of steps limits:
#: both may end earlier.
TIME_LIMIT = "time limit {total:.0f} s"
STEP_LIMIT = "{done:,.0f} of at most {total:,.0f} steps"


class Done(ProgressColumn):
    """How much is done. Nothing is said of the time it still takes: steps differ in duration.

    Args:
        form: `SHARE`, `TIME_LIMIT` or `STEP_LIMIT`.
    """

    max_refresh = 0.5

    def __init__(self, form: str) -> None:
        super().__init__()
        self.form = form

    def text(self, task: Task) -> str:
        """Return it; nothing before it is reported. 100 % is never said of work that goes on."""
        if not task.total:
            return ""
        percent = min(int(100.0 * task.completed / task.total), 99)
        return self.form.format(done=task.completed, total=task.total, percent=percent)

    def render(self, task: Task) -> Text:
        """Return it for a bar."""
        return Text(self.text(task))

    def line(self, task: Task) -> str:
        """Return it as a line, with the time that the work has taken."""
        took = f"{task.elapsed or 0.0:.0f} s so far"
        text = self.text(task)
        return f"{text}, {took}" if text else took


@contextmanager
def working(
    what: str, *more: ProgressColumn, form: str = SHARE
) -> Iterator[Callable[[float, float], None]]:
    """Show on stderr what goes on, for how long and, where it is reported, how much is done.

    A terminal gets a bar, anything else a line after two seconds and every ten.

    Args:
        what: What goes on, as in "planning".
        *more: More columns of the bar.
        form: What is said of how much is done: `SHARE`, or `TIME_LIMIT` or `STEP_LIMIT` of what may
            end before all is done.

    Yields:
        Takes what is done and how much there is.
    """
    done = Done(form)
    columns = (TextColumn("{task.description}"), BarColumn(), *more, done, TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        task, over = bar.add_task(what, total=None), threading.Event()

        def told(completed: float, total: float) -> None:
            bar.update(task, completed=completed, total=total)

        def tell() -> None:
            wait = FIRST
            while not over.wait(wait):
                err.print(f"spacearm: {what}: {done.line(bar.tasks[0])}")
                wait = EVERY

        thread = threading.Thread(target=tell, daemon=True)
        if not err.is_terminal:
            with suppress(RuntimeError):  # no thread can be started: nothing is said on the way
                thread.start()
        try:
            yield told
        finally:
            over.set()


def kept(
    what: str, compute: Callable[[Callable[[float, float], None]], T], form: str = SHARE
) -> tuple[T, int]:
    """Compute something, its progress shown; after Ctrl-C there is what it had come to.

    Args:
        what: What goes on; see `working`.
        compute: Takes a function of progress to call, and raises `StoppedError` after Ctrl-C.
        form: As in `working`.

    Returns:
        The result, and the exit code.
    """
    try:
        with working(what, form=form) as progress:
            return compute(progress), 0
    except StoppedError as stop:
        say_stopped(str(stop))
        return cast("T", stop.best), INTERRUPTED


def say_stopped(what: str) -> None:
    """Say on stderr that Ctrl-C has stopped a command that keeps its results so far."""
    err.print(f"spacearm: stopped: {what}; the results so far are kept")


@dataclass(frozen=True)
class Answer:
    """What a command answers.

    Attributes:
        result: The result, which has a description.
        code: Exit code.
        drawn: Returns the options of `plot`; called if a picture is drawn.
        told: Fields that JSON has besides.
        thing: What is drawn and shown; the result if None.
        drawing: Whether there is a picture where no option names one.
        written: Files that the command has written.
        more: What else is printed.
    """

    result: Any
    code: int = 0
    drawn: Callable[[], Mapping[str, Any]] = dict
    told: Mapping[str, Any] = field(default_factory=dict)
    thing: Any = None
    drawing: bool = True
    written: Sequence[Path] = ()
    more: Sequence[Description] = ()


def answer(
    arm: SpaceArm,
    found: Answer,
    kind: str,
    *,
    deg: bool = False,
    as_json: bool = False,
    save: Path | None = None,
    output: Path | None = None,
    view: bool = False,
) -> None:
    """Give the answer of a command: print it, save it, draw it and show it in the browser.

    Args:
        arm: The arm that it is about, whose name the picture has.
        found: The answer.
        kind: What it is, for the name of the picture; empty if it has none.
        deg: Whether angles are printed in degrees.
        as_json: Whether to print JSON; then a picture is drawn only if `output` names it.
        save: Where the motion goes, unless the command has written it.
        output: Where the picture goes; else by the arm's name in this folder.
        view: Whether to show it in the browser; then a picture is drawn only if `output` names it.
    """
    result, thing = found.result, found.result if found.thing is None else found.thing
    written = [*found.written]
    if save and not written:
        result.save(save)
        written.append(save)
    if as_json:
        print_json(result.to_dict() | dict(found.told))
    else:
        for said in (result.describe(), *found.more):
            print_description(said, deg)
    if kind and (output or (found.drawing and not (as_json or view))):
        from spacearm.plots.show import plot  # imports matplotlib

        where = output or Path(f"{name_part(arm.name)}_{kind}.png")
        write_picture(where, plot(thing, **found.drawn()))
        written.append(where)
    for path in () if as_json else written:
        out.print(f"wrote {path}")
    if view:
        serve(thing)


def serve(thing: Any) -> None:
    """Show a thing in the browser until Ctrl-C."""
    from spacearm.viewer.show import view as show

    serve_until_interrupted(show(thing, open=False))


def serve_until_interrupted(viewer: Viewer, port: int | None = None, no_open: bool = False) -> None:
    """Serve the page, open it in the browser unless told not to, and wait for Ctrl-C."""
    try:  # an interrupt may come at any moment
        if no_open:
            viewer.serve(port)
        else:
            viewer.open(port)
        out.print(f"{viewer.session.cfg.arm.name}: {viewer.url}  (Ctrl-C ends)")
        threading.Event().wait()
    except KeyboardInterrupt:
        out.print()
    finally:
        viewer.close()


@contextmanager
def undisturbed() -> Iterator[None]:
    """Have Ctrl-C wait while packages are imported: some of them swallow it."""
    came: list[int] = []
    main = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGINT, lambda number, _: came.append(number)) if main else None
    try:
        yield
    finally:
        if main:
            signal.signal(signal.SIGINT, before)
    if came:
        raise KeyboardInterrupt


def write_picture(path: Path, figure: Figure) -> None:
    """Write a figure, whole or not at all."""
    buffer = BytesIO()
    figure.savefig(buffer, format=path.suffix[1:].lower(), metadata={})
    write(path, buffer.getvalue())


def print_description(said: Description, deg: bool = False) -> None:
    """Print title and verdict, notes, tables and what was not checked."""
    angles: Angles = "deg" if deg else "rad"
    verdict = f": {in_own_words(said.verdict)}" if said.verdict else ""
    out.print(Text.assemble((said.title, "bold"), (verdict, STYLES[said.tone])))
    for note in said.notes:
        out.print(in_own_words(note))
    for part in said.parts:
        if part.title:
            out.print(f"\n{in_own_words(part.title)}", style="bold underline")
        if part.rows:
            heads = [Column(name, overflow="fold") for name in part.head(angles)]
            shown = Table(*heads, box=None, pad_edge=False, show_header=any(part.head(angles)))
            for row in part.body(angles):
                shown.add_row(*map(in_own_words, row))
            out.print(shown)
    if said.limits:
        out.print(said.limits)


def print_json(value: Any, indent: int | None = 2) -> None:
    """Print strict JSON; numbers that are not finite, which JSON lacks, become null."""
    text = json.dumps(plain(value), indent=indent, ensure_ascii=False, allow_nan=False)
    print(UNPRINTABLE.sub(lambda found: json.dumps(found[0])[1:-1], text))


def save_phases(flight: Flight, path: Path | None) -> list[Path]:
    """Write each phase of a flight to a file with its number, if a path is given; return these."""
    if path is None:
        return []
    from spacearm.motion.motion_file import save_together  # loaded by what made the flight

    numbered = {path.with_stem(f"{path.stem}_{i}"): run for i, run in enumerate(flight.phases)}
    save_together(numbered)
    return [*numbered]
