"""Commands of spacearm: run in this process as a rule, in one of their own where that matters."""

import io
import json
import os
import re
import subprocess
import sys
import warnings
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

from spacearm.cli.app import main
from spacearm.errors import ModelWarning

TOLD = re.compile("(so far|left)$")
"""Lines of progress."""


class Finished(NamedTuple):
    """What a command left behind, named as `subprocess.run` names it."""

    returncode: int
    stdout: str
    stderr: str


def spacearm(*words, cwd=".") -> Finished:
    """Run a command in this process."""
    out, err = io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True), io.StringIO()
    with (
        _inside(cwd),
        patch.object(sys, "argv", ["spacearm", *map(str, words)]),
        patch.dict(os.environ, COLUMNS="100", NO_COLOR="1"),
        warnings.catch_warnings(),
        redirect_stdout(out),
        redirect_stderr(err),
    ):
        warnings.simplefilter("ignore")
        warnings.simplefilter("default", ModelWarning)
        try:
            main()
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
    return Finished(code, out.buffer.getvalue().decode(), err.getvalue())


def in_a_process(*words, cwd=None, **environment):
    """Run a command in a process of its own, as a shell does."""
    command = [sys.executable, "-m", "spacearm", *map(str, words)]
    env = os.environ | {"COLUMNS": "100", "NO_COLOR": "1"} | environment
    run = subprocess.run(
        command, capture_output=True, text=True, env=env, timeout=300, check=False, cwd=cwd
    )
    return Finished(run.returncode, run.stdout, run.stderr)


def complaints(run):
    """What stands on stderr besides progress."""
    return [line for line in run.stderr.splitlines() if not TOLD.search(line)]


def answer(*words):
    """Return what a command answers with --json."""
    run = spacearm(*words, "--json")
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


@contextmanager
def _inside(folder):
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)
