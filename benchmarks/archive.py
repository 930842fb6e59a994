"""The archive: quick benchmarks with the machine they ran on, one JSON file a run, and their plot.

    python benchmarks/archive.py           # measure, write results/VERSION-DATE.json, draw
    python benchmarks/archive.py plot      # draw results/versions.png anew
    python benchmarks/archive.py beside ../other    # this checkout and another in turn: ratios

Run it on a quiet machine: the load before the run is in the file. Each figure is the shortest of
several runs on one thread.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import matplotlib.pyplot as plt
import numpy as np

import spacearm as sa
from spacearm.files import write

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results"
PEERS = ("pin", "numpy", "scipy", "llvmlite")
ROUNDS = 5
COMPILING = 1.0
"""Runs go first for so long [s]: code that runs for long is compiled once more, for speed."""
TURNS = 3
"""How often each of two checkouts is measured."""


def shortest(do: Callable[[], object], per: int = 1, unit: float = 1e6) -> float:
    """Return the shortest time of several runs over `per`, after those that may compile."""
    begun = time.perf_counter()
    while time.perf_counter() - begun < COMPILING:
        do()
    seconds = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        do()
        seconds.append(time.perf_counter() - start)
    return unit * min(seconds) / per


def figures() -> dict[str, float]:
    """Measure; the keys tell what, and the unit."""
    arm, planar, mda6 = sa.load("chaser7"), sa.load("planar2"), sa.load("mda6")
    rng = np.random.default_rng(0)
    Q = rng.uniform(-np.pi, np.pi, (20_000, arm.n))
    few, q, rates = Q[:200], Q[0], np.zeros(arm.n)
    singular, whole = sa.singular_set(arm), sa.singular_set(mda6)
    law = sa.JointPD(target=0.1 + q, kp=5.0, kd=9.0)

    def each(ask: Callable[[sa.Configuration], object]) -> float:
        return shortest(lambda: [ask(arm.at(row)) for row in few], len(few))

    def batch(quantity: str, arm: sa.SpaceArm = arm) -> float:
        return shortest(lambda: sa.evaluate(arm, Q[:, : arm.n], quantity, threads=1), len(Q))

    def simulated(events: Sequence[str]) -> float:
        how = sa.Integration(events=events)
        return shortest(lambda: sa.simulate(arm.at(q), law, 10.0, integration=how), 1, 1e3)

    return {
        "generalized Jacobian, chaser7 [us]": each(sa.generalized_jacobian),
        "singularity report, chaser7 [us]": each(sa.singularity),
        "forward dynamics, chaser7 [us]": each(lambda cfg: sa.forward_dynamics(cfg, rates, rates)),
        "sigma_min in a batch, chaser7 [us]": batch("sigma_min"),
        "sigma_min in a batch, mda6 [us]": batch("sigma_min", mda6),
        "distance in a batch, chaser7 [us]": batch("distance"),
        "generalized Jacobians in a batch, chaser7 [us]": shortest(
            lambda: sa.generalized_jacobians(arm, Q, threads=1), len(Q)
        ),
        "accelerations in a batch, chaser7 [us]": shortest(
            lambda: sa.joint_accelerations(arm, Q, 0.0 * Q, Q, threads=1), len(Q)
        ),
        "exact set, chaser7 [ms]": shortest(lambda: sa.singular_set(sa.load("chaser7")), 1, 1e3),
        "a segment proven free, chaser7 [ms]": shortest(
            lambda: singular.is_free(q, q + 0.05), 1, 1e3
        ),
        "shells, planar2 [ms]": shortest(lambda: sa.workspace(sa.load("planar2")), 1, 1e3),
        "2,000 members sampled, mda6 [ms]": shortest(
            lambda: whole.sample(2000, np.random.default_rng(0)), 1, 1e3
        ),
        "10 s simulated, chaser7 [ms]": simulated(()),
        "10 s with the default events, chaser7 [ms]": simulated(sa.Integration.events),
        "a plan, planar2 [ms]": shortest(
            lambda: sa.plan(planar.at([0.3, 1.2]), sa.Joints([0.4, 1.3])), 1, 1e3
        ),
    }


def machine() -> dict[str, Any]:
    """Return what the figures depend on besides the code."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    models = {line.partition(":")[2].strip() for line in lines if line.startswith("model name")}
    return {
        "processor": ", ".join(sorted(models)) or platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "packages": {name: version(name) for name in PEERS},
    }


def commit() -> str | None:
    """Return the commit of the code, with a plus sign where files were changed after it."""
    ask = ["git", "describe", "--always", "--abbrev=12", "--dirty=+", "--exclude=*"]
    try:
        return subprocess.run(ask, cwd=HERE, capture_output=True, text=True, check=True).stdout[:-1]
    except (OSError, subprocess.CalledProcessError):
        return None


def archive(folder: Path, measure: Callable[[], dict[str, float]] = figures) -> Path:
    """Measure and write one file into a folder."""
    now, where = datetime.now(timezone.utc), machine()
    run = {
        "version": sa.__version__,
        "commit": commit(),
        "date": now.isoformat(timespec="seconds"),
        "machine": where,
        "figures": measure(),
    }
    folder.mkdir(exist_ok=True)
    name = f"{sa.__version__}-{now:%Y%m%d-%H%M%S}.json"
    return write(folder / name, (json.dumps(run, indent=2) + "\n").encode())


def beside(other: Path) -> None:
    """Measure this checkout and another in turn, and print both figures and their ratios."""
    found: dict[Path, list[dict[str, float]]] = {HERE.parent: [], other.resolve(): []}
    for _ in range(TURNS):
        for folder, runs in found.items():
            command = [sys.executable, __file__, "figures"]
            environment = {**os.environ, "PYTHONPATH": str(folder)}
            printed = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True)
            runs.append(json.loads(printed.stdout))
    own, theirs = ({name: min(run[name] for run in runs) for name in runs[0]}
                   for runs in found.values())  # fmt: skip
    print(f"{'':54}{'other':>10}{'this':>10}{'ratio':>8}")
    for name, value in own.items():
        print(f"{name:54}{theirs[name]:10.3g}{value:10.3g}{theirs[name] / value:8.2f}")


def draw(folder: Path) -> Path:
    """Draw all figures of the archived runs in their order, a line for each processor."""
    runs = [json.loads(path.read_text()) for path in folder.glob("*.json")]
    runs.sort(key=lambda run: run["date"])
    names = list(dict.fromkeys(name for run in runs for name in run["figures"]))
    figure, panels = plt.subplots(
        len(names), sharex=True, squeeze=False, figsize=(8, 1 + 1.4 * len(names))
    )
    for name, panel in zip(names, panels[:, 0], strict=True):
        for processor in dict.fromkeys(run["machine"]["processor"] for run in runs):
            points = [
                (i, run["figures"][name])
                for i, run in enumerate(runs)
                if run["machine"]["processor"] == processor and name in run["figures"]
            ]
            if points:
                panel.plot(*zip(*points, strict=True), "o-", label=processor)
        panel.set_ylim(bottom=0.0)
        panel.set_title(name, loc="left", fontsize="medium")
    panels[0, 0].legend(fontsize="small")
    panels[-1, 0].set_xticks(
        range(len(runs)), [f"{run['version']}\n{run['date'][:10]}" for run in runs]
    )
    figure.tight_layout()
    path = folder / "versions.png"
    figure.savefig(path, dpi=120, metadata={"Software": None})
    plt.close(figure)
    return path


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["figures"]:
            print(json.dumps(figures()))
        case ["beside", folder]:
            beside(Path(folder))
        case ["plot"]:
            print(draw(RESULTS))
        case _:
            print(archive(RESULTS))
            print(draw(RESULTS))
