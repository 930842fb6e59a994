"""`spacearm sweep`: a study computed into a store, on this machine or on a Dask cluster."""

from __future__ import annotations

import logging
import math
import shutil
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import MofNCompleteColumn, ProgressColumn, Task
from rich.text import Text

import spacearm as sa
from spacearm.cli import options as opt
from spacearm.cli.output import err, out, print_description, working
from spacearm.cli.wording import INTERRUPTED
from spacearm.compiler.machine import processors
from spacearm.files import is_there
from spacearm.results import Column, Description, Table
from spacearm.sweeps.estimates import estimate
from spacearm.sweeps.runner import Tally, connect, run_chunks, status

if TYPE_CHECKING:
    from distributed import Client


def run_study(
    study: Annotated[Path, typer.Argument(metavar="STUDY.TOML", help="See help(spacearm.Study).")],
    store: Annotated[
        Path, typer.Option(help="Zarr directory. The chunks that it already contains are kept.")
    ],
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="tcp://HOST:PORT", help="Dask scheduler whose workers compute."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(help="Processes on this machine. Default: one for each processor.", min=1),
    ] = None,
    show_status: Annotated[
        bool, typer.Option("--status", help="Only report which part is done.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only estimate time and disk space.")
    ] = False,
) -> int:
    """Compute a study chunk by chunk."""
    read = sa.Study.read(study)
    if workers is not None and scheduler is not None:
        raise sa.ConfigurationError("--workers is for this machine; leave it out with --scheduler")
    if show_status:
        others = {"--dry-run": dry_run, "--scheduler": scheduler, "--workers": workers}
        opt.refuse_unused(others, "without --status, which computes nothing")
        return _print_status(read, store)
    if dry_run:
        with _client(scheduler) as client:
            cores = sum(client.nthreads().values()) if client else processors()
        _print_estimate(read, store, min(workers or cores, cores))
        return 0
    latest = Tally(0, 0, 0, read.total)
    code = 0
    with (
        _client(scheduler) as client,
        working("chunks", MofNCompleteColumn(), Rate()) as progress,
    ):
        try:
            with closing(run_chunks(read, store, client=client, workers=workers)) as tallies:
                for latest in tallies:
                    progress(latest.done, latest.total)
        except sa.SweepError as error:
            err.print(f"spacearm: {error}")
            code = 1
        except KeyboardInterrupt:
            err.print("stopped; run the same command again to go on")
            code = INTERRUPTED
    out.print(
        f"{store}: {latest.total:,} chunk{'s' * (latest.total != 1)}, {latest.kept:,} kept, "
        f"{latest.computed:,} computed, {latest.failed:,} failed"
    )
    return code


class Rate(ProgressColumn):
    """Chunks per second, lately."""

    def render(self, task: Task) -> Text:
        """Return the rate, once it is known."""
        speed = task.speed or task.finished_speed
        return Text(f"{speed:.1f}/s" if speed else "")


@contextmanager
def _client(scheduler: str | None) -> Iterator[Client | None]:
    """Open a client of the scheduler, if one is named; silence its own error reports."""
    if scheduler is None:
        yield None
        return
    logging.disable()  # of a lost scheduler all of Dask's loggers report, with tracebacks
    client = connect(scheduler)
    try:
        yield client
    finally:
        with suppress(OSError, RuntimeError):  # the scheduler may be gone
            client.close(timeout=2)


def _print_status(study: sa.Study, store: Path) -> int:
    found = status(study, store)
    rows = [
        (name, chunks, done, len(failed), done / chunks) for name, chunks, done, failed in found
    ]
    errors = [(f"{q.quantity} {i}", text) for q in found for i, text in q.failed.items()]
    tables = [Table(("quantity", "chunks", "done", "failed", Column("", "", ".1%")), rows)]
    if errors:
        tables.append(Table(("chunk", "error"), errors[:10], "Failed"))
    ready, total = sum(q.done for q in found), sum(q.chunks for q in found)
    verdict = f"{ready:,} of {total:,} chunk{'s' * (total != 1)} done"
    print_description(Description(title=store.name, verdict=verdict, tables=tables))
    return 1 if errors else 0


def _print_estimate(study: sa.Study, store: Path, workers: int) -> None:
    start = time.process_time()  # a worker imports and reads what this process has by now
    done = {s.quantity: s.done for s in status(study, store)} if is_there(store) else {}
    rows = []
    seconds = workers * start
    is_known = True
    longest, size = 0.0, 0.0
    estimates = list(estimate(study, max(workers, 1)))
    for found in estimates:
        is_known = is_known and (found.is_known or found.chunks == done.get(found.quantity, 0))
    for found in estimates:
        left = found.chunks - done.get(found.quantity, 0)
        part = left / found.chunks
        told = found.seconds if is_known else found.at_least
        seconds += part * told
        longest = max(longest, found.longest if left else 0.0)
        size += found.nbytes
        each, hours = told / found.chunks, part * told / 3600
        rows.append((found.quantity, found.chunks, left, each, hours, found.nbytes / 1e6))
    columns = (
        "quantity", "chunks", "to do", Column("a chunk", "s", ".3g"),
        Column("in all", "core h", ".3g"), Column("disk", "MB", ".3g"),
    )  # fmt: skip
    verdict = "the cluster has no workers yet"
    if workers:
        wall = start + max(seconds / workers, longest + start)  # this process starts first
        cores = f"{workers} free core{'s' * (workers != 1)}"
        verdict = f"{'about' if is_known else 'at least'} {timedelta(seconds=math.ceil(wall))}"
        verdict += f" on {cores}, waits for the disk apart"
    folder = next(p for p in (store.absolute(), *store.absolute().parents) if is_there(p))
    free = shutil.disk_usage(folder).free
    disk = f"disk: at most {size / 1e6:,.3g} MB of {free / 1e6:,.0f} MB free"
    tables = [Table(columns, rows)]
    print_description(Description(title=store.name, verdict=verdict, notes=[disk], tables=tables))
