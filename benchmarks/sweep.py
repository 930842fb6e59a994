"""What sweeps cost: a million configurations, a chunk, a worker; what that makes of 10^12.

    python benchmarks/sweep.py

Prints the cost of a million configurations in chunks of studies on one process, the rates of one
and two workers (processes here; Dask workers on loopback), what a chunk costs beside its numbers,
how many chunks a Dask scheduler hands out a second, what a worker's start costs, and how fast maps
are written; from these the cost of 10^12 configurations on 1,000 cores.

    python benchmarks/sweep.py memory

runs studies of 10^6 to 10^9 configurations on two workers (the map of 10^9 takes 4 GB of disk) and
prints the largest resident memory of a worker and of the main process.
"""

from __future__ import annotations

import itertools
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import spacearm as sa
from spacearm.sweeps.estimates import estimate
from spacearm.sweeps.runner import WIDTH, connect

RISK = """
arms = ["{arm}"]
chunk = {chunk}
[risk]
sigma_min = 0.05
bins = {{from = 0, to = 8, points = 41}}
samples = {samples}
"""
MAP = """
arms = ["planar2"]
chunk = {chunk}
[sigma_min]
joints.q1 = {{from = -3, to = 3, points = {points}}}
joints.q2 = {{from = -3, to = 3, points = {points}}}
single = true
"""
WINDOW = 16
"""Successive chunks of which the fastest lot counts: without the start, and without what else the
machine does."""


def risk(arm: str, samples: int, chunk: int = 2**22) -> sa.Study:
    return sa.Study.parse(RISK.format(arm=arm, samples=samples, chunk=chunk))


def seconds_a_chunk(study: sa.Study, store: Path, **options: object) -> float:
    """Wall time from one chunk to the next."""
    times: list[float] = []
    sa.sweep(study, store, progress=lambda *_: times.append(time.perf_counter()), **options)
    lots = zip(times, times[WINDOW:], strict=False)
    return min(end - start for start, end in lots) / WINDOW


@contextmanager
def dask(folder: Path, workers: int) -> Iterator[object]:
    """A client of a scheduler with workers of one thread each, all on loopback."""
    env = os.environ | {"DASK_LOGGING__DISTRIBUTED": "critical", "OMP_NUM_THREADS": "1"}
    file = Path(tempfile.mkdtemp(dir=folder)) / "scheduler.json"
    where = ["--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0", "--scheduler-file", file]

    def start(*words: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen([sys.executable, "-m", "dask", *words, *map(str, where)], env=env)

    processes = [start("scheduler", "--port", "0")]
    while not file.exists():
        time.sleep(0.1)
    processes += [start("worker", "--nthreads", "1", "--no-nanny") for _ in range(workers)]
    try:
        with connect(json.loads(file.read_text())["address"]) as client:
            client.wait_for_workers(workers)
            yield client
    finally:
        for process in processes:
            process.kill()
            process.wait()


def nothing(number: int) -> int:
    return number


def costs() -> dict[str, float]:
    """Seconds for a million configurations on one core, by what is asked."""
    found = {}
    studies = {f"risk, {arm}": risk(arm, 2**22) for arm in ("planar2", "mda6", "chaser7")}
    studies["map, planar2"] = sa.Study.parse(MAP.format(points=2048, chunk=2**22))
    for name, study in studies.items():
        found[name] = min(estimate(study)[0].seconds for _ in range(3)) / 2**22 * 1e6
        print(f"{name:15} {found[name]:7.4f} s for a million configurations on one core")
    return found


def scaling(folder: Path) -> None:
    """One worker against two, by the wall's clock and by the processors' time."""
    m = 40 * 2**20
    study = risk("chaser7", m, 2**20)
    for where in ("processes", "Dask workers"):
        rates, used = [], []
        for workers in (1, 2):
            store, before = folder / f"{where}{workers}.zarr", processor_time()
            if where == "processes":
                each = seconds_a_chunk(study, store, workers=workers)
            else:
                with dask(folder, workers) as client:
                    each = seconds_a_chunk(study, store, client=client)
            rates.append(2**20 / each / 1e6)
            used.append((processor_time() - before) / m * 1e6)
        print(
            f"{where}: {rates[0]:.2f} million configurations a second by one, {rates[1]:.2f} by "
            f"two: {rates[1] / rates[0] / 2:.1%}; of processor time a million takes {used[0]:.3f} "
            f"s by one, {used[1]:.3f} s by two, starts included: {used[0] / used[1]:.1%}"
        )


def processor_time() -> float:
    """Of all processes that were started and ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def overheads(folder: Path) -> tuple[float, float]:
    """What a chunk costs on a worker beside its numbers, and chunks a second of a scheduler [s]."""
    tiny = risk("planar2", 2000 * 64, 64)
    here = seconds_a_chunk(tiny, folder / "tiny.zarr", workers=1)
    checked = seconds_a_chunk(tiny, folder / "tiny.zarr", workers=1)
    print(f"a chunk beside its numbers: {here * 1e3:.1f} ms, if there: {checked * 1e3:.1f} ms")
    with dask(folder, 2) as client:
        there = seconds_a_chunk(tiny, folder / "tiny_dask.zarr", client=client)
        executor = client.get_executor(pure=False)
        start, futures = time.perf_counter(), [executor.submit(nothing, i) for i in range(WIDTH)]
        for future in futures:
            future.result()
        rate = WIDTH / (time.perf_counter() - start)
    print(f"the same by two Dask workers: {there * 1e3:.1f} ms; empty chunks: {rate:.0f} a second")
    return here, rate


def starts(folder: Path) -> None:
    """What a worker's first chunk costs."""
    code = "import spacearm as sa, numpy as np; sa.evaluate(sa.load('chaser7'), np.zeros((64, 7)))"
    for name in ("compiling", "compiled"):
        env = os.environ | {"SPACEARM_CACHE": str(folder / "code")}
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], env=env, check=True)
        print(
            f"a process's start with its first batch, {name}: {time.perf_counter() - start:.1f} s"
        )


def writing(folder: Path) -> float:
    """Bytes a second that one process writes of a map."""
    study = sa.Study.parse(MAP.format(points=2048, chunk=2**22))
    from spacearm.sweeps.store import Store

    store, chunk = Store.create(folder / "map.zarr", study), next(study.chunks())
    values = study.compute(chunk)
    start = time.perf_counter()
    store.write(chunk, values)
    seconds = time.perf_counter() - start
    size = sum(array.nbytes for array in values.values())
    kept = sum(p.stat().st_size for p in (folder / "map.zarr" / "sigma_min").rglob("*"))
    print(
        f"a map in single precision: {size / seconds / 1e6:.0f} MB a second from one process, "
        f"{kept / 2**22:.2f} bytes a configuration on disk"
    )
    return kept / 2**22


def project(cost: dict[str, float], overhead: float, rate: float, each: float) -> None:
    """10^12 configurations on 1,000 cores."""
    chunk = 2**26
    print(f"10^12 configurations on 1,000 cores, chunks of {chunk:,}:")
    for name, seconds in cost.items():
        work = seconds * chunk / 1e6 + overhead
        wall = 1e12 / chunk * work / 1000
        asked = 1000 / work
        print(
            f"  {name:15} {wall / 60:6.1f} minutes; {asked:.0f} chunks a second of the scheduler, "
            f"which gives {rate:.0f}"
        )
    wall = 1e12 / chunk * (cost["map, planar2"] * chunk / 1e6 + overhead) / 1000
    print(f"  the map is {each:.1f} TB, {each * 1e3 / wall:.1f} GB a second")


def memory(folder: Path, name: str, exponent: int) -> None:
    """One study, and what its processes needed."""
    m = 10**exponent
    text = MAP.format(points=round(m**0.5), chunk=2**22)
    study = risk("planar2", m) if name == "risk" else sa.Study.parse(text)
    start = time.perf_counter()
    sa.sweep(study, folder / "memory.zarr", workers=2)
    wall = time.perf_counter() - start
    who = (resource.RUSAGE_CHILDREN, resource.RUSAGE_SELF)
    worker, own = (resource.getrusage(w).ru_maxrss / 1024 for w in who)
    print(f"{name} of 10^{exponent}: {wall:.0f} s, worker {worker:.0f} MB, main {own:.0f} MB")


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        match sys.argv[1:]:
            case ["memory", what, exponent]:
                memory(folder, what, int(exponent))
            case ["memory"]:
                for what, exponent in itertools.product(("risk", "map"), "6789"):
                    command = [sys.executable, __file__, "memory", what, exponent]
                    subprocess.run(command, check=True)
            case _:
                cost = costs()
                scaling(folder)
                overhead, rate = overheads(folder)
                starts(folder)
                project(cost, overhead, rate, writing(folder))


if __name__ == "__main__":
    main()
