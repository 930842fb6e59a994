"""Fuzzing: hostile input, seeded, in a process that may touch nothing outside its own folder.

    python tests/fuzz.py                     # every target, 100 cases each
    python tests/fuzz.py urdf 5000 --seed 7  # one target, many cases
    python tests/fuzz.py urdf 1 --seed 7 --first 312   # one case again

Whatever the input, what comes is a result or a SpaceArmError: no other exception, no crash, no
warning of a library, no case that takes over 5 s of processor time, no file but those named, no
connection but to the page on 127.0.0.1, no program started.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path

import numpy as np
from hostile import commands, messages, spoken, studies, trajectories, urdf

import spacearm as sa

LIMIT = 5.0
"""Processor time that one case may take [s]."""


class Hang(BaseException):
    """A case took too long."""


TARGETS = {
    "urdf": urdf,
    "commands": commands,
    "studies": studies,
    "trajectories": trajectories,
    "messages": messages,
}
OUTSIDE = ("subprocess.Popen", "os.system", "os.exec", "webbrowser.open", "urllib.Request")


def fence(home: Path) -> list[str]:
    """Notes whatever this process does outside `home` from now on."""
    broken: list[str] = []

    def watch(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open":
            path, _, flags = arguments
            writes = isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
            if writes and isinstance(path, (str, bytes)):
                where = os.path.realpath(os.fsdecode(path))
                if not where.startswith((str(home), "/dev/null")) and "__pycache__" not in where:
                    broken.append(f"wrote {where}")
        elif event == "socket.connect" and tuple(arguments[1])[:1] != ("127.0.0.1",):
            broken.append(f"connected to {arguments[1]}")
        elif event in OUTSIDE:
            broken.append(f"{event} {arguments}")

    sys.addaudithook(watch)
    return broken


def main() -> int:
    """Runs the cases; 0 if all behave."""
    parser = argparse.ArgumentParser()
    parser.add_argument("target", nargs="?", choices=TARGETS)
    parser.add_argument("count", nargs="?", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        home = Path(name).resolve()
        tempfile.tempdir = str(home)
        os.chdir(home)
        if asked.target in (None, "commands"):
            spoken(["map", "planar2", "--points", "9"])  # compiles, and looks for fonts
        signal.signal(signal.SIGPROF, _too_long)
        broken = fence(home)
        faults = 0
        for target in [asked.target] if asked.target else TARGETS:
            faults += cases(
                target, range(asked.first, asked.first + asked.count), asked.seed, home, broken
            )
        os.chdir(home.parent)
    return 1 if faults else 0


def _too_long(*_: object) -> None:
    raise Hang(f"over {LIMIT:g} s")


def cases(target: str, numbers: range, seed: int, home: Path, broken: list[str]) -> int:
    """Runs the cases of one target; how many misbehave."""
    accepted = refused = faults = 0
    slowest = 0.0
    for number in numbers:
        rng, begun = np.random.default_rng([seed, number]), time.process_time()
        with tempfile.TemporaryDirectory(dir=home) as folder, warnings.catch_warnings():
            os.chdir(folder)
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", sa.ModelWarning)
            signal.setitimer(signal.ITIMER_PROF, LIMIT)
            try:
                TARGETS[target](rng, Path(folder))
                accepted += 1
            except sa.SpaceArmError:
                refused += 1
            except (Hang, Exception):  # whatever it is, it is a fault
                faults += 1
                print(f"{target} case {number}, seed {seed}:\n{traceback.format_exc()[-6000:]}")
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
                os.chdir(home)
        if broken:
            faults += 1
            print(f"{target} case {number}, seed {seed}: {broken}")
            broken.clear()
        slowest = max(slowest, time.process_time() - begun)
    print(
        f"{target}: {len(numbers)} cases, seed {seed}: {accepted} accepted, {refused} refused, "
        f"{faults} faults; slowest {slowest:.2f} s",
        flush=True,
    )
    return faults


if __name__ == "__main__":
    sys.exit(main())
