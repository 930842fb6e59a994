"""What the examples print and draw, for the page that shows them."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

MISSING = "UnsupportedError", "ModuleNotFoundError"
"""Errors of an example whose extra is not installed."""


def write(docs: Path) -> None:
    """Run the examples that have changed; their output and pictures go to generated/examples.

    Raises:
        RuntimeError: An example fails or warns.
    """
    folder = docs / "generated" / "examples"
    folder.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # they run in processes of their own
        list(pool.map(partial(_keep, folder), (docs.parent / "examples").glob("*.py")))


def _keep(folder: Path, path: Path) -> None:
    """Write what an example prints, unless that is newer than the example."""
    said = folder / f"{path.stem}.txt"
    if not said.exists() or said.stat().st_mtime < path.stat().st_mtime:
        said.write_text(_output(path.resolve(), folder), encoding="utf-8")


def _output(path: Path, folder: Path) -> str:
    """Run an example and return what it prints."""
    run = subprocess.run(
        [sys.executable, path],
        cwd=folder, env=os.environ | {"MPLBACKEND": "Agg"}, capture_output=True, text=True,
    )  # fmt: skip
    last = run.stderr.strip().rpartition("\n")[2]
    if run.returncode and any(name in last for name in MISSING):
        return f"(not run here: {last.partition(': ')[2]})\n"
    if run.returncode or "Warning: " in run.stderr:
        raise RuntimeError(f"{path} fails or warns: {run.stderr}")
    return run.stdout
