"""What the examples print and draw, for the page that shows them."""

from __future__ import annotations

import io
import multiprocessing
import os
import runpy
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from pathlib import Path

import spacearm as sa

FORKS = multiprocessing.get_context("forkserver")
"""Processes that have imported already what most examples and scenes use."""
FORKS.set_forkserver_preload(["recorded", "spacearm.plots.drawings", "sphinx.cmd.build"])


def jobs(docs: Path) -> list[Callable[[], None]]:
    """Return what runs each example; its output and pictures go to generated/examples."""
    folder = docs / "generated" / "examples"
    folder.mkdir(parents=True, exist_ok=True)
    return [
        partial(_keep, folder, path) for path in sorted((docs.parent / "examples").glob("*.py"))
    ]


def _keep(folder: Path, path: Path) -> None:
    """Write what an example prints, unless that is newer than the example.

    Raises:
        RuntimeError: The example warns; any other, that of the example.
    """
    said = folder / f"{path.stem}.txt"
    if not said.exists() or said.stat().st_mtime < path.stat().st_mtime:
        said.write_text(forked(_output, path.resolve(), folder), encoding="utf-8")


def forked(function: Callable[..., str], *args: object) -> str:
    """Return what a function returns in a process of its own."""
    with ProcessPoolExecutor(1, FORKS) as pool:
        return pool.submit(function, *args).result()


def _output(path: Path, folder: Path) -> str:
    """Run an example as the program of this process and return what it prints."""
    os.chdir(folder)
    os.environ["MPLBACKEND"] = "Agg"
    sys.argv = [str(path)]
    said, told = io.StringIO(), io.StringIO()
    try:
        with redirect_stdout(said), redirect_stderr(told):
            runpy.run_path(str(path), run_name="__main__")
    except (sa.UnsupportedError, ModuleNotFoundError) as error:  # an extra is not installed
        return f"(not run here: {error})\n"
    if "Warning: " in told.getvalue():
        raise RuntimeError(f"{path} warns: {told.getvalue()}")
    return said.getvalue()
