"""A small study, and what tests of sweeps do with it: run the command, look at the files."""

import signal
import subprocess
import sys
import time
from pathlib import Path

STUDY = """
arms = ["planar2", {source = "chaser7", name = "chaser", locked = {joint_7 = 0}}]
seed = 3
chunk = 4096

[parameters]
base_inertia = [1, 3]

[risk]
sigma_min = 0.2
bins = {from = 0, to = 6, points = 7}
samples = 80_000

[sigma_min]
joints.q1 = {from = -3, to = 3, points = 50}
joints.joint_2 = {from = -3, to = 3, points = 120}
"""
"""80 chunks of risk, 8 of a map."""

SMALL = """
arms = ["planar2"]
[parameters]
base_inertia = [1, 3]
[sigma_min]
joints.q1 = {from = -3, to = 3, points = 4}
"""
"""Two chunks."""


def files(store):
    """What every file of a store holds, by path."""
    return {p.relative_to(store): p.read_bytes() for p in Path(store).rglob("*") if p.is_file()}


def wait_for_chunks(store, few=3, marks="chunks/risk/c"):
    """Until some chunks are done."""
    deadline = time.monotonic() + 300
    while time.monotonic() < deadline:
        if store.exists() and len([*(store / marks).glob("*")]) >= few:
            return
        time.sleep(0.01)
    raise TimeoutError(f"{store} has no chunks")


def start(study_file, store, *words, **options):
    command = [sys.executable, "-m", "spacearm", "sweep", str(study_file), "--store", str(store)]
    return subprocess.Popen(
        [*command, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # ignored in scripts
        **options,
    )


def run(study_file, store, *words, **options):
    process = start(study_file, store, *words, **options)
    out, err = process.communicate(timeout=600)
    return process.returncode, out, err
