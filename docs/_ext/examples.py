"""What the examples print and draw, for the page that shows them."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

MISSING = "UnsupportedError", "ModuleNotFoundError"
"""Errors of an example whose extra is not installed."""


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
        RuntimeError: The example fails or warns.
    """
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
