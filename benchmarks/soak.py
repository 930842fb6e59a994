"""Long runs: whether memory stays flat (Linux).

    python benchmarks/soak.py                # all of it: hours
    python benchmarks/soak.py 0.01           # a hundredth of it: a minute
    python benchmarks/soak.py 1 load slide   # some jobs: evaluate, simulate, load, slide, view

A billion batch evaluations, 24 simulated hours, 10,000 moves of a slider in the browser (with pip
install -e '.[test]' and chromium), 1,000 loads, and an hour with a viewer that is served to
connections without a browser (see MINUTE; chromium draws its pictures). Each job is done in eleven
equal parts. The first one fills caches; after each of the others the resident memory of the process
and what Python itself holds (tracemalloc) are read, and for the slider what the browser's processes
and, its garbage collected, the page hold. Growth is the slope of a straight line through these ten
readings: exit code 1 if one is over what its job and meter are allowed (see ALLOWED).
"""

from __future__ import annotations

import asyncio
import gc
import json
import resource
import sys
import tempfile
import time
import tracemalloc
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from shutil import which
from typing import Any

import numpy as np
import pinocchio as pin
from tornado.websocket import websocket_connect

import spacearm as sa
from spacearm.mechanics.arm_kernels import KEPT_ARMS

PARTS = 11

Job = Callable[[int], object]
"""Does so many operations."""
Meter = Callable[[], float]
"""Reads a memory [MB]."""

ALLOWED = {
    "Python": (32.0, 0.1),
    "resident": (128.0, 0.5),
    "page": (128.0, 1.0),
    "browser": (4096.0, 10.0),
}
"""Growth in each part: so much, and so much for each call [kB].

An array that every call keeps is over 0.1 kB of Python; allocators grow by some kB. The browser's
processes hold caches that come and go by megabytes.
"""
BATCH = 1_000_000
"""Configurations in a call of `evaluate`."""
PIECE = 600
"""Simulated seconds in a call of `simulate`."""


def evaluations() -> Job:
    arm = sa.load("mda6")
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (BATCH, arm.n))

    def run(count: int) -> None:
        while count > 0:
            sa.evaluate(arm, Q[:count])
            count -= len(Q)

    return run


def simulation() -> Job:
    """One motion in pieces, each going on where the last one ended."""
    arm = sa.load("planar2")
    H = np.diag(sa.generalized_inertia(arm.at(np.full(2, 0.3))))
    state = {"t": 0.0, "q": np.full(2, 0.3), "dq": np.zeros(2), "base": pin.SE3.Identity()}

    def run(count: int) -> None:
        while count > 0:
            duration, start = min(count, PIECE), state["t"]
            target = lambda t, start=start: 0.4 * np.sin(0.2 * (start + t) + np.arange(2))  # noqa: E731
            law = sa.JointPD(target=target, kp=0.25 * H, kd=H)
            motion = sa.simulate(
                arm.at(state["q"], base=state["base"]), law, duration, dq=state["dq"]
            )
            state.update(t=start + duration, q=motion.q[-1], dq=motion.dq[-1])
            state["base"] = pin.XYZQUATToSE3(motion.base[-1])
            count -= PIECE

    return run


def loads() -> Job:
    names = cycle(info.name for info in sa.catalogue())

    def run(count: int) -> None:
        for _ in range(count):
            arm = sa.load(next(names))
            sa.singularity(arm.at(np.full(arm.n, 0.3)))

    return run


@contextmanager
def slider() -> Iterator[tuple[Job, dict[str, Meter]]]:
    from playwright.sync_api import sync_playwright

    move = """async (count) => {
      const slider = document.querySelector(".joint input[type=range]");
      const tip = document.getElementById("tip");
      for (let i = 0; i < count; i++) {
        const before = tip.textContent;
        slider.value = Number(slider.value) + (Number(slider.value) < 90 ? 1 : -180);
        slider.dispatchEvent(new Event("input"));
        while (tip.textContent === before) await new Promise((go) => setTimeout(go, 0));
      }
    }"""
    heap = "() => { gc(); return performance.memory.usedJSHeapSize / 2 ** 20; }"
    options = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    options += ["--js-flags=--expose-gc", "--enable-precise-memory-info"]
    viewer = sa.view(sa.load("chaser7"), open=False)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=which("chromium"), args=options)
        page = browser.new_page(viewport={"width": 420, "height": 320})
        page.goto(viewer.serve())
        page.wait_for_selector("body[data-ready=yes]", state="attached")
        meters = {"page": lambda: page.evaluate(heap), "browser": started}
        yield lambda count: page.evaluate(move, count), meters
        browser.close()
    viewer.close()


ROBOTS = ("planar2", "planar3", "mda6")
"""Robots on show, one a minute in turn."""
COMPUTED = (
    {"do": "plan"},
    {"do": "compute", "what": "shells"},
    {"do": "compute", "what": "risk"},
    {"do": "compute", "what": "attitudes", "path": "goal"},
    {"do": "compute", "what": "ranges"},
)
"""What the page has computed, one a minute in turn; in the sixth minute a picture is drawn."""
TURNS = np.linspace(-0.5, 0.5, 8)
MINUTE = (
    {"do": "spacecraft", "mode": "attitude-controlled"},
    {"do": "spacecraft", "mode": "free-floating"},
    {"do": "mode", "mode": "free-floating"},
    *({"do": "joint", "index": 1, "value": 0.3 + turn} for turn in TURNS),
    {"do": "nearest"},
    {"do": "random"},
    {"do": "mode", "mode": "posture"},
    {"do": "home"},
    *({"do": "attitude", "rpy": [0.0, 0.0, turn]} for turn in TURNS),
    {"do": "joint", "index": 1, "value": 0.8},
    {"do": "map"},
    *({"do": "grab", "grip": 1, "shift": [0.1 * turn, 0.1 * turn, 0.0]} for turn in TURNS),
    *({"do": "fly", "twist": [0.01, 0.02, 0, 0, 0, 0], "dt": 0.1, "frame": "tip"} for _ in TURNS),
    {"do": "land"},
    {"do": "motion"},
    {"do": "poses"},
    {"do": "compare", "with": "fixed"},
    *({"do": "time", "t": 1.0 + turn} for turn in TURNS),
    {"do": "compare"},
    *({"do": "layer", "name": "grid", "visible": visible} for visible in (False, True)),
    {"do": "arm", "joints": "all"},
    {"do": "arm", "robot": "no such robot"},
)
"""Requests of a page in a minute: sliders, poses, drags, a flight by hand and its playback."""
VISITS = 5
"""Connections in a minute that get the scene and end, every other one without a farewell."""
ROUND = 6
"""Minutes after which the same comes again."""


def use() -> Job:
    """Minutes with a viewer that is served: each another robot, requests, visits and a job."""
    viewer = sa.view(sa.load(ROBOTS[-1]), open=False)
    folder = tempfile.TemporaryDirectory()
    picture = Path(folder.name, "scene.png")
    minutes = cycle(range(ROUND))

    def minute(number: int) -> None:
        asyncio.run(_asked(viewer.serve(), [{"do": "arm", "robot": ROBOTS[number % len(ROBOTS)]}]))
        asyncio.run(_asked(viewer.serve(), MINUTE))
        for visit in range(VISITS):
            asyncio.run(_asked(viewer.serve(), [], farewell=visit % 2 == 0))
        if number < len(COMPUTED):
            asyncio.run(_asked(viewer.serve(), [{"do": "goal"}, COMPUTED[number]]))
        else:
            viewer.png(picture, (300, 200))
        viewer._repr_html_()

    for number in range(KEPT_ARMS):  # from now on a new arm takes the place of an old one
        viewer.handle({"do": "arm", "robot": ROBOTS[number % len(ROBOTS)]})
        viewer.readout()

    def run(count: int) -> None:
        for _ in range(count):
            minute(next(minutes))

    weakref.finalize(run, folder.cleanup)
    return run


async def _asked(url: str, requests: Sequence[Any], farewell: bool = True) -> None:
    """Send requests by a connection of their own, each when the one before is done."""
    socket = await websocket_connect(url.replace("http", "ws", 1).replace("/?", "/socket?"))
    await _told(socket, "complete")
    for request in requests:
        await socket.write_message(json.dumps(request))
        while (await _told(socket, "readout"))["task"]:
            pass
    if farewell:
        socket.close()
    else:
        socket.protocol.stream.close()


async def _told(socket: Any, name: str) -> Any:
    """Return what the next message of a name says."""
    while (message := await socket.read_message()) is not None:
        if isinstance(message, str) and name in (content := json.loads(message)):
            return content[name]
    raise ConnectionError("the viewer has hung up")


def resident(pid: int | str = "self") -> float:
    """Memory of a process [MB]."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def started(pid: int | str = "self") -> float:
    """Memory of all processes that this one has started, and those that they have [MB]."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    children = [int(n) for task in tasks for n in (task / "children").read_text().split()]
    return sum(resident(child) + started(child) for child in children)


def soak(what: str, part: int, job: Job, meters: dict[str, Meter], call: int = 1) -> bool:
    """Does so many operations, `call` at a time, `PARTS` times; whether memory stayed flat."""
    meters = {
        "resident": resident,
        "Python": lambda: tracemalloc.get_traced_memory()[0] / 2**20,
        **meters,
    }
    readings = []
    start = time.perf_counter()
    for count in range(1, PARTS + 1):
        job(part)
        gc.collect()
        readings.append([read() for read in meters.values()])
        now = (f"{label} {value:.2f} MB" for label, value in zip(meters, readings[-1], strict=True))
        after = time.perf_counter() - start
        print(f"{count * part:,} {what} after {after:.0f} s", *now, sep=", ", file=sys.stderr)
    seconds = time.perf_counter() - start
    print(f"{part * PARTS:,} {what} in {seconds:.0f} s, memory after a {PARTS}th and at the end:")
    flat = True
    for label, values in zip(meters, np.array(readings[1:]).T, strict=True):
        slope = np.polyfit(np.arange(len(values)), values, 1)[0] * 1024.0
        least, each = ALLOWED[label]
        allowed = least + each * part / call
        flat &= bool(slope <= allowed)
        print(
            f"    {label:8} {values[0]:8.2f} {values[-1]:8.2f} MB, {slope:+.1f} kB in each part"
            + ("" if slope <= allowed else f": TOO MUCH, allowed are {allowed:.1f}")
        )
    sys.stdout.flush()
    return flat


def main() -> int:
    """Runs the jobs; 0 if memory stays flat in all of them."""
    scale = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    jobs = sys.argv[2:] or ["evaluate", "simulate", "load", "slide", "view"]
    tracemalloc.start()
    flat = []

    def part(count: int, least: int = 1) -> int:
        return max(least, -(-round(count * scale) // PARTS))

    if "evaluate" in jobs:
        flat.append(soak("batch evaluations", part(1_000_000_000), evaluations(), {}, BATCH))
    if "simulate" in jobs:
        flat.append(soak("simulated seconds", part(24 * 3600), simulation(), {}, PIECE))
    if "load" in jobs:
        flat.append(soak("loads", part(1000, least=len(sa.catalogue())), loads(), {}))
    if "slide" in jobs:
        with slider() as (moves, meters):
            flat.append(soak("slider moves", part(10_000), moves, meters))
    if "view" in jobs:
        flat.append(soak("minutes with the viewer", ROUND * part(60 // ROUND), use(), {}))
    return 0 if all(flat) else 1


if __name__ == "__main__":
    sys.exit(main())
