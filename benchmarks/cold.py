"""Cold starts: whole processes with empty caches, by the clock, beside their goals.

    python benchmarks/cold.py               # all of them
    python benchmarks/cold.py chaser7       # those with this word in their names
    python benchmarks/cold.py README query  # the README's command of that name, in a new clone

Every process finds empty folders of its own as home and as caches: nothing is compiled yet, no font
is listed; only Python's bytecode is there. "warm" is the second process on the same folders, less
the time of `import pinocchio`. Each figure is the shorter of two. The README's commands, query and
test, find neither an environment nor downloaded packages; they take minutes, and run once.
"""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

import spacearm as sa

READING = """
import asyncio, json
from tornado.websocket import websocket_connect
import spacearm as sa

async def first(url):
    socket = await websocket_connect(url.replace("http", "ws", 1).replace("/?", "/socket?"))
    return json.loads(await socket.read_message())["readout"]

viewer = sa.view(sa.load("mda6"), open=False)
assert asyncio.run(first(viewer.serve()))["q"]
viewer.close()
"""
QUERY = """
import spacearm as sa
sa.singularity(sa.load("planar2").at([-1.1345, -0.1991]), exact=True)
"""


LEFT_OUT = ("MPLCONFIGDIR", "PYTHONDONTWRITEBYTECODE")
"""Variables of the environment by which a process would find, or leave, less than it does."""
POSTURES = "0 60 -100 -50 0 0\n0 50 -90 -40 20 0\n10 40 -80 -30 30 10\n"
"""What `path` proves, in degrees."""


class Start(NamedTuple):
    """What Python is given, and in how many seconds the process should end."""

    goal: float
    words: tuple[str, ...]


def command(goal: float, line: str) -> Start:
    """Return the start of a command."""
    return Start(goal, ("-m", "spacearm", *line.split()))


STARTS = {
    "--help": command(0.3, "--help"),
    "query planar2": command(2.0, "query planar2 --deg -65 -11.41"),
    "query planar2, warm": command(0.4, "query planar2 --deg -65 -11.41"),
    "query chaser7": command(3.0, "query chaser7 --deg 0 40 10 60 0 30 0"),
    "nearest mda6": command(3.0, "nearest mda6 --deg 0 60 -100 -50 30 0"),
    "path": command(3.0, "path mda6 postures.csv --deg"),
    "map planar2": command(4.0, "map planar2"),
    "risk mda6": command(4.0, "risk mda6"),
    "workspace mda6": command(5.0, "workspace mda6"),
    "simulate planar2": command(
        3.0,
        "simulate planar2 --deg -57.936 60.337 --attitude 0 0 21 --target 1.5 1.5 --with origin=cm "
        "--duration 10",
    ),
    "simulate chaser7": command(
        5.0,
        "simulate chaser7 0 1 0 1 0 1 0 --target 0 .9 0 .8 0 .7 0 --controller JointPD "
        "--duration 10",
    ),
    "plan planar2": command(
        4.0,
        "plan planar2 --deg -57.936 60.337 --attitude 0 0 21 --goal 1.5 1.5 --with origin=cm",
    ),
    "plan chaser7 to a pose": command(
        6.0, "plan chaser7 --deg 0 57 0 57 0 57 0 --goal 4.58 0.61 0.65 -145 -18 -11"
    ),
    "capture": command(3.0, "capture mda6 --deg 0 60 -100 -50 30 0 --mass 100 --spin 0 0 1"),
    "reaction": command(3.0, "reaction planar2 --motion motion.npz"),
    "the page's first reading": Start(3.0, ("-c", READING)),
    "import, load, singularity(exact=True)": Start(2.0, ("-c", QUERY)),
}
"""Whole processes by their names."""
WARM = ", warm"
"""How the names of starts end that find what another process has kept."""


class Spent(NamedTuple):
    """What a process took: seconds by the clock, and seconds of all processors."""

    clock: float
    processor: float


def run(words: Sequence[str], home: Path) -> Spent:
    """Run Python with all caches in a folder."""
    names = ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "SPACEARM_CACHE")
    folders = {name: str(home / name.lower()) for name in names}
    for folder in folders.values():
        Path(folder).mkdir(exist_ok=True)
    others = {k: v for k, v in os.environ.items() if k not in LEFT_OUT}
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        [sys.executable, *words], cwd=home, env=others | folders, check=True, capture_output=True
    )
    clock, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Spent(clock, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)


def start(name: str) -> Spent:
    """Make one of the starts, in a new folder."""
    with tempfile.TemporaryDirectory() as folder:
        home, words = Path(folder), STARTS[name].words
        (home / "postures.csv").write_text(POSTURES)
        swing().save(home / "motion.npz")
        if not name.endswith(WARM):
            return run(words, home)
        run(words, home)
        own, pinocchio = run(words, home), run(("-c", "import pinocchio"), home)
        return Spent(*np.subtract(own, pinocchio))


def swing() -> sa.Motion:
    """Return a motion of planar2, 8 s long, for `reaction`."""
    cfg = sa.load("planar2").at([0.3, 1.2])
    cfgs = [cfg, *(cfg := sa.move(cfg, [0.3 + s, 1.2 + s]) for s in np.linspace(0.01, 0.8, 80))]
    t, q = np.linspace(0.0, 8.0, len(cfgs)), np.array([cfg.q for cfg in cfgs])
    return sa.Motion(cfg.arm, t, q, np.array([pin.SE3ToXYZQUAT(cfg.base) for cfg in cfgs]))


def readme(name: str) -> None:
    """Print how long a command of the README takes, installation included."""
    source = Path(__file__).resolve().parents[1]
    text = (source / "README.md").read_text(encoding="utf-8")
    command = re.findall(rf"<!-- ci: {name} -->\n```sh\n(.*?)```", text, re.DOTALL)[0]
    others = {k: v for k, v in os.environ.items() if k not in (*LEFT_OUT, "PYTHONPATH")}
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder, "clone")
        subprocess.run(["git", "clone", "--quiet", source, clone], check=True)
        begun = time.perf_counter()
        subprocess.run(
            ["bash", "-euc", command], cwd=clone, env=others | {"HOME": folder}, check=True
        )
        print(f"README {name}: {time.perf_counter() - begun:.0f} s")


def main(word: str = "", name: str = "query") -> None:
    """Print all starts with a word in their names, or that of a command of the README."""
    if word == "README":
        readme(name)
        return
    print(f"{'':38} {'clock':>8} {'goal':>8} {'ratio':>6} {'processors':>12}")
    for name in (name for name in STARTS if word in name):
        took, goal = min(start(name) for _ in range(2)), STARTS[name].goal
        line = f"{name:38} {took.clock:6.2f} s {goal:6.1f} s {took.clock / goal:6.2f}"
        print(f"{line} {took.processor:10.2f} s", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:3])
