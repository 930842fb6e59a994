"""Fuzzing: hostile input, seeded, in a process that may touch nothing but its folder (Linux).

    python tests/tools/fuzz.py                     # every target, 100 cases each
    python tests/tools/fuzz.py urdf 5000 --seed 7  # one target, many cases
    python tests/tools/fuzz.py urdf 1 --seed 7 --first 312   # one case again
    python tests/tools/fuzz.py --seconds 20   # no case begins later than this, in each target
    python tests/tools/fuzz.py --limit 5      # on a quiet machine: what is slow is a fault too

Whatever the input, what comes is a result or a SpaceArmError: no other exception, no crash, no
warning of a library, no case that takes over a minute or 8 GiB, nothing
written but the files named, no connection but to the page on 127.0.0.1, no program started
(`fence.py`).
"""

from __future__ import annotations

import argparse
import faulthandler
import logging
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from fence import Fence

sys.path.append(str(Path(__file__).resolve().parents[1]))  # helpers
from hostile import motions, urdf
from hostile_calls import calls
from hostile_commands import commands, spoken
from hostile_files import meshes, stores, studies, trajectories
from hostile_page import messages
from hostile_robots import formats, names
from hostile_tables import tables

import spacearm as sa

LIMIT = 60.0
"""Time that one case may take [s], unless --limit says otherwise: enough on a processor that ten
share. Cases take a few seconds at most on a quiet machine; the slowest is printed."""
MEMORY = 8 << 30
"""Address space that the process may take [bytes]."""


class Hang(BaseException):
    """A case took too long."""


class Log(logging.Handler):
    """Keeps what libraries log as warnings and errors, which users would see."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keeps a message."""
        self.messages.append(record.getMessage())


TARGETS = {
    "urdf": urdf,
    "formats": formats,
    "names": names,
    "motions": motions,
    "calls": calls,
    "commands": commands,
    "tables": tables,
    "studies": studies,
    "stores": stores,
    "trajectories": trajectories,
    "meshes": meshes,
    "messages": messages,
}


def main() -> int:
    """Runs the cases; 0 if all behave."""
    parser = argparse.ArgumentParser()
    parser.add_argument("target", nargs="?", choices=TARGETS)
    parser.add_argument("count", nargs="?", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--limit", type=float, default=LIMIT)
    parser.add_argument("--seconds", type=float, default=np.inf)
    asked = parser.parse_args()
    sys.dont_write_bytecode = True
    faulthandler.enable()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    with tempfile.TemporaryDirectory() as name:
        home = Path(name).resolve()
        tempfile.tempdir = str(home)
        os.chdir(home)
        spoken(["map", "planar2", "--points", "9"])  # compiles, and looks for fonts
        signal.signal(signal.SIGALRM, _too_long)
        fence, log = Fence(), Log(logging.WARNING)
        logging.getLogger().addHandler(log)
        faults = 0
        for target in [asked.target] if asked.target else TARGETS:
            faults += cases(
                target, range(asked.first, asked.first + asked.count), asked, home, fence, log
            )
        os.chdir(home.parent)
    return 1 if faults else 0


def _too_long(*_: object) -> None:
    raise Hang("the case took too long")


def cases(
    target: str, numbers: range, asked: argparse.Namespace, home: Path, fence: Fence, log: Log
) -> int:
    """Runs the cases of one target; how many misbehave."""
    outcomes: Counter[str] = Counter()
    slowest, seed, started = 0.0, asked.seed, time.monotonic()
    for number in numbers:
        if time.monotonic() - started > asked.seconds:
            break
        rng, begun = np.random.default_rng([seed, number]), time.monotonic()
        print(f"{target} {number}", end="\r", file=sys.stderr, flush=True)  # stands after a crash
        with (
            tempfile.TemporaryDirectory(dir=home) as folder,
            fence.around(Path(folder)) as named,
            warnings.catch_warnings(record=True) as warned,
        ):
            os.chdir(folder)
            tempfile.tempdir = folder
            warnings.simplefilter("always")
            warnings.simplefilter("ignore", sa.ModelWarning)
            # Matplotlib draws a box and says which character its font lacks: an emoji in a name
            warnings.filterwarnings("ignore", "Glyph .* missing from font")
            signal.setitimer(signal.ITIMER_REAL, asked.limit)
            try:
                TARGETS[target](rng, Path(folder), named)
                outcome = "accepted"
            except sa.SpaceArmError:
                outcome = "refused"
            except (Hang, Exception):  # whatever it is, it is a fault
                outcome = "faults"
                print(f"{target} case {number}, seed {seed}:\n{traceback.format_exc()[-6000:]}")
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
                tempfile.tempdir = str(home)
                os.chdir(home)
        noted = [*fence.broken, *(f"{w.category.__name__}: {w.message}" for w in warned)]
        noted += [f"logged: {message}" for message in log.messages]
        log.messages.clear()
        if noted:
            outcome = "faults"
            print(f"{target} case {number}, seed {seed}: {noted}")
        fence.broken.clear()
        outcomes[outcome] += 1
        slowest = max(slowest, time.monotonic() - begun)
    counts = ", ".join(f"{outcomes[name]} {name}" for name in ("accepted", "refused", "faults"))
    print(
        f"{target}: {outcomes.total()} cases, seed {seed}: {counts}; slowest {slowest:.2f} s",
        flush=True,
    )
    return outcomes["faults"]


if __name__ == "__main__":
    sys.exit(main())
