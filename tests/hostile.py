"""Hostile input: one function a target; a random number generator decides what comes."""

from __future__ import annotations

import asyncio
import io
import json
import logging
import re
import sys
import traceback
import warnings
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import tornado.websocket
from mutations import HOSTILE, mutated, urdf_sources
from sweeps import STUDY

import spacearm as sa
from spacearm.study import Chunk

with warnings.catch_warnings():  # meshcat imports what is deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    import spacearm.view.viewer
    from spacearm import cli
    from spacearm.view.server import LARGEST_MESSAGE

PATIENCE = 60.0
"""What a conversation with the page may take, on a busy machine [s]."""


class FaultError(Exception):
    """A case did what it must not do."""


# --- URDF -----------------------------------------------------------------------------------


def urdf(rng: np.random.Generator, folder: Path) -> None:
    """Loads, mounts, asks, writes and reads again."""
    sources = urdf_sources()
    text = sources[rng.integers(len(sources))].read_text(encoding="utf-8")
    path = folder / rng.choice(["robot.urdf", "robot.xacro"], p=[0.95, 0.05])
    path.write_bytes(mutated(text, rng))
    check = str(rng.choice(["error", "warn", "accept", "accept"]))
    links = re.findall(r'<link\s+name="([^"]*)"', text)
    tip = str(rng.choice(links[len(links) // 2 :])) if links and rng.random() < 0.8 else None
    if rng.random() < 0.3:
        arm = sa.load(path, check=check, tip=tip)
    else:
        arm = sa.mount(path, sa.Bus(mass=100, size=(1, 1, 1)), check=check, tip=tip)
    cfg = arm.at(rng.uniform(-1, 1, arm.n))
    report = sa.singularity(cfg)
    if not (np.isfinite(report.sigma).all() and np.isfinite(sa.momentum_matrix(cfg).base).all()):
        raise FaultError("numbers that are not finite")
    again = sa.load(arm.to_urdf(folder / "again.urdf"), check="accept")
    if not np.allclose(again.at(cfg.q).A, cfg.A, rtol=1e-9, atol=1e-9 * np.abs(cfg.A).max()):
        raise FaultError("a written model is another one")


# --- the command line -----------------------------------------------------------------------

COMMANDS = (
    "models", "models --json", "info planar2 --deg", "info robot.urdf --json",
    "query planar2 --deg -65 -11.41", "query mda6 0 1 0 1 0 1 --json --attitude 0 0 0.5",
    "query robot.urdf 0.1 0.2 --tip hand --task x --length 2 --lock joint_1=0.5 --check warn",
    "query planar2 0.1 0.2 --base fixed --tolerance 0.1", "map planar2 --points 9 --output map.svg",
    "map planar3 --joints q1 q2 --fix q3=0.4 --points 9 --npz map.npz",
    "workspace planar2 --base free-floating --output work.svg", "workspace planar2 --path path.txt",
    "design planar2 --base-inertia 1:2:2 --mount-x 0.1 --output design.svg --json",
    "simulate planar2 --deg --start -57 60 --target 1.5 1.5 --duration 0.5 --output sim.svg",
    "simulate planar2 --start 0.3 0.9 --target 0.5 0.5 --controller joints --duration 0.2 --kp 1 2 "
    "--kd 1 --save sim.npz --json",
    "simulate planar2 --start 0.3 0.9 --target 1 1 --controller damped --gain 1 --duration 0.2 "
    "--stop target --rtol 1e-6 --json",
    "plan planar2 --deg --start -57 60 --goal 1.5 1.5 --timeout 2 --json --save plan.npz",
    "view planar2 0.1 0.2 --no-open --port 7470", "view robot.urdf --save page.html",
)  # fmt: skip
WORK = ("--duration", "--points", "--effort", "--timeout", "--base-inertia")
"""How much is asked for by their values is the user's affair."""
TEXTS = re.compile(r"(spacearm: (error|warning): .*|stopped: .*)")


def commands(rng: np.random.Generator, folder: Path) -> None:
    """A command with some words wrong: exit code 0, or 2 and one line."""
    words = str(rng.choice(COMMANDS)).split()
    others = [word for text in COMMANDS for word in text.split() if word not in WORK]
    for _ in range(rng.integers(0, 4)):
        at, kind = int(rng.integers(0, len(words) + 1)), rng.integers(4)
        if any(word in WORK for word in words[max(at - 1, 0) : at + 1]):
            continue
        word = str(rng.choice(HOSTILE if rng.random() < 0.5 else others)).replace("\x00", "")
        if kind == 0:
            words.insert(at, word)
        elif kind == 1:
            words[at : at + 1] = [word]
        elif at < len(words):
            words[at : at + 1] = [] if kind == 2 else [words[at], words[at]]
    sources = urdf_sources()
    source = sources[rng.integers(len(sources))].read_text(encoding="utf-8")
    Path("robot.urdf").write_bytes(mutated(source, rng) if rng.random() < 0.5 else source.encode())
    Path("path.txt").write_bytes(b"0 1\n1 2\n" + rng.bytes(rng.integers(0, 3)))
    before = set(folder.rglob("*"))
    code, said, complaint = spoken(words)
    lines = complaint.splitlines()
    if code not in (0, 2) or not all(TEXTS.fullmatch(line) for line in lines):
        raise FaultError(f"{words}: exit code {code}, {said[-200:]!r}, {complaint[-3000:]}")
    if (code == 2) != (sum("error" in line[:16] for line in lines) == 1):
        raise FaultError(f"{words}: exit code {code} with {complaint!r}")
    new = {path.relative_to(folder).as_posix() for path in set(folder.rglob("*")) - before}
    named = {word.rpartition("=")[2] for word in words}
    for name in new - named - {Path(word).as_posix() for word in named}:
        if code != 0 or not re.fullmatch(r".*_(map|workspace|design|simulation|plan)\.png", name):
            raise FaultError(f"{words}: wrote {name}")


def spoken(words: list[str]) -> tuple[int, str, str]:
    """Exit code, output and complaints of the command line, nothing served."""
    cli.view.serve_until_interrupted = lambda *_: None
    out, err = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.StringIO()
    sys.argv = ["spacearm", *words]
    with redirect_stdout(out), redirect_stderr(err):
        try:
            cli.main()
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
        except Exception:  # what a user would see as a traceback
            code = -1
            traceback.print_exc()
    out.flush()
    return code, out.buffer.getvalue().decode(), err.getvalue()


# --- saved trajectories ---------------------------------------------------------------------


def trajectories(rng: np.random.Generator, folder: Path) -> None:
    """A saved trajectory with bytes or arrays that are wrong."""
    arm, path = sa.load("planar2"), folder / "run.npz"
    pd = sa.JointPD(target=[0.5, 0.5], kp=1, kd=1)
    sa.simulate(arm, [0.3, 0.9], pd, 0.5, dt=0.1).save(path)
    if rng.random() < 0.5:
        data = bytearray(path.read_bytes())
        for _ in range(rng.integers(1, 20)):
            data[rng.integers(len(data))] = rng.integers(256)
        kept = len(data) if rng.random() < 0.7 else int(rng.integers(len(data) + 1))
        path.write_bytes(bytes(data[:kept]))
    else:
        with np.load(path) as file:
            arrays = dict(file)
        for _ in range(rng.integers(1, 3)):
            name = str(rng.choice(list(arrays)))
            arrays[name] = ARRAYS[rng.integers(len(ARRAYS))](arrays[name])
        if rng.random() < 0.2:
            arrays.pop(str(rng.choice(list(arrays))))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            np.savez(path, **arrays)
        if rng.random() < 0.1:
            with path.open("wb") as file:
                np.save(file, rng.normal(size=3))
    run = sa.Trajectory.load(path, arm)
    repr(run), run.to_dict(), run.at(0), run.at(-1), run.drift, run.imbalance, run.to_xarray()
    sa.Motion.of(run).at(0.2)


ARRAYS: tuple[Callable[[np.ndarray], np.ndarray], ...] = (
    lambda a: a[:-1] if a.ndim else a,
    lambda a: np.empty((0, *a.shape[1:])),
    lambda a: a.astype(str),
    lambda a: np.array(["x"] * max(a.size, 1)),
    lambda a: np.full(a.shape, np.nan),
    lambda a: np.full(a.shape, 1e300),
    lambda a: np.zeros(a.shape, complex),
    lambda a: np.zeros((*a.shape, 2)),
    lambda _: np.array([None, {}], dtype=object),
    lambda a: np.zeros(a.shape),
    lambda a: a[..., None],
    lambda _: np.array(3.5),
)

# --- studies ----------------------------------------------------------------------------------


def studies(rng: np.random.Generator, folder: Path) -> None:
    """A study with lines, values or letters that are wrong: read, described, its chunks counted."""
    lines = STUDY.splitlines()
    for _ in range(rng.integers(1, 4)):
        at, kind = int(rng.integers(len(lines))), rng.integers(5)
        key, equals, _ = lines[at].partition("=")
        other = lines[rng.integers(len(lines))].partition("=")[2]
        hostile = str(rng.choice(HOSTILE)).replace("\x00", "")
        lines[at : at + 1] = [
            [key + equals + other],
            [key + equals + hostile],
            [f"{key}{equals}{hostile!r}"],
            [] if rng.random() < 0.5 else [lines[at], lines[at]],
            [re.sub(r"\d+", lambda _: str(10 ** int(rng.integers(0, 12))), lines[at], count=1)],
        ][kind]
    study = sa.Study.parse("\n".join(lines), folder)
    repr(study), study.attributes, study.coords
    for name in study.quantities:
        study.region(Chunk(name, study.count(name) - 1))


# --- what a browser sends -------------------------------------------------------------------

VALUES = (
    None, True, -1, 0, 1, 2, 0.3, 1e300, 10**400, "", "home", "joint", "posture", "free-floating",
    "spacecraft", "\ud800", "x" * 90_000, [], {}, [0, 0, 0], [1e12, 0, 0], ["a"], {"do": "home"},
    float("nan"), float("-inf"), [[[[]]]],
)  # fmt: skip
KEYS = ("do", "index", "value", "rpy", "mode", "name", "visible", "t", "x")
KINDS = ("joint", "attitude", "mode", "home", "nearest", "random", "layer", "time")


def messages(rng: np.random.Generator, _: Path) -> None:
    """Messages that no page sends, a page's between them: the socket stays, nothing is logged."""
    texts = [text for text in (_message(rng) for _ in range(20)) if len(text) < LARGEST_MESSAGE]
    logged: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: logged.append(handler.format(record))
    logging.getLogger("tornado.application").addHandler(handler)
    viewer = sa.view(sa.load("planar2"), [0.1, 0.2], open=False)
    try:
        url = viewer.serve()
        talk = _talk(url.replace("http", "ws") + "socket", texts)
        asyncio.run(asyncio.wait_for(talk, PATIENCE))
    finally:
        viewer.close()
        logging.getLogger("tornado.application").removeHandler(handler)
    if logged:
        raise FaultError(f"{[text[:80] for text in texts]}: logged {logged[0]}")


def _message(rng: np.random.Generator) -> str | bytes:
    keys = ["do", *rng.choice(KEYS, rng.integers(0, 4))]
    content = {str(key): VALUES[rng.integers(len(VALUES))] for key in keys}
    content["do"] = str(rng.choice(KINDS)) if rng.random() < 0.8 else content["do"]
    text = json.dumps(content)
    kind = rng.random()
    if kind < 0.7:
        return text
    if kind < 0.8:
        return text[: rng.integers(len(text) + 1)]
    odd = (
        "[" * 50_000,
        "9" * 5000,
        '{"do": 1e999}',
        "{}",
        '{"do":"joint","index":0,"value":-1e-400}',
    )
    return rng.bytes(rng.integers(0, 50)) if kind < 0.9 else odd[rng.integers(len(odd))]


async def _talk(url: str, texts: list[str | bytes]) -> None:
    socket = await tornado.websocket.websocket_connect(url)
    try:
        await _tell(socket, texts)
    finally:
        socket.close()
    while await socket.read_message() is not None:  # until the server has hung up too
        pass


async def _tell(
    socket: tornado.websocket.WebSocketClientConnection, texts: list[str | bytes]
) -> None:
    """Says it all, and waits for the answer to what a page says last."""
    for text in texts:
        try:
            await socket.write_message(text, binary=isinstance(text, bytes))
        except UnicodeEncodeError:
            continue  # what no socket can send
    await socket.write_message('{"do": "home"}')
    await socket.write_message('{"do": "attitude", "rpy": [0.25, 0, 0]}')
    while True:
        got = await socket.read_message()
        if got is None:  # nothing comes after this
            raise FaultError(f"the socket was closed after {[str(text)[:80] for text in texts]}")
        readout = json.loads(got).get("readout") if isinstance(got, str) else None
        if readout and np.isclose(readout["attitude"][0], 0.25):
            return
