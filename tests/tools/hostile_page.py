"""Hostile pages: what no page of ours sends."""

from __future__ import annotations

import asyncio
import json
import logging
import warnings
from functools import lru_cache
from pathlib import Path

import numpy as np
import tornado.websocket
from helpers.arms import frame, joint, link, robot
from hostile import FaultError

import spacearm as sa

with warnings.catch_warnings():  # meshcat imports what is deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    from spacearm.viewer.server import LARGEST_MESSAGE

VALUES = (
    1e-308, 1e30, 1e308, 10**30, -0.0,
    None, True, -1, 0, 1, 2, 0.3, 1e300, 10**400, "", "home", "joint", "posture", "free-floating",
    "spacecraft", "\ud800", "x" * 90_000, [], {}, [0, 0, 0], [1e12, 0, 0], ["a"], {"do": "home"},
    float("nan"), float("-inf"), [[[[]]]], -0.7, 3.0, 250.0, 1e6, -1e12,
)  # fmt: skip
PANEL = {
    "joint": {"index": (0, 1, 2), "value": (0.3, -0.7, 3.0, 250.0, 1e6, -1e12)},
    "goal": {"position": ([1, 0, 0], [1e12, 0, 0]), "rpy": ([0, 0, 3], [1e9, 0, 0], "x")},
    "compare": {"with": ("fixed", "given", "")},
    "spacecraft": {"mode": ("fixed", "attitude-controlled", "free-floating")},
    "cancel": {},
    "joints": {"indices": ([0, 1], [1], [0, 0]), "values": ([0.3, -0.7], [3.0], [1e6, -1e12])},
    "attitude": {"rpy": ([0, 0, 1], [1e12, -1e12, 3])},
    "grab": {
        "grip": (1, 2),
        "shift": ([0.1, 0.2, 0], [1e12, -1e12, 3], None),
        "turn": ([0, 0, 0.3], [1e12, 0, 3], None),
    },
    "map": {"joints": ([0, 1], [1, 0], [1, 1], [0, 40], None)},
    "arm": {
        "robot": ("planar2", "nobody", None),
        "file": ({"name": "../a.urdf", "text": "<robot/>"}, {"name": "a.py", "text": ""}, None),
        "tip": ("link_2", "tip", None),
        "task": ("x y", "position", "z z", None),
        "joints": (["joint_1"], [], None),
    },
    "mode": {"mode": ("posture", "free-floating", "free-floating")},
    "time": {"t": (-1, 0.3, 3.0, 1e9)},
    "layer": {"name": ("spacecraft", "labels"), "visible": (True, False)},
    "nearest": {},
    "random": {},
    "home": {},
}
"""What a page does send, or would if its arm had such limits."""
KEYS = (
    "do", "index", "value", "rpy", "mode", "name", "visible", "t", "x", "indices", "values", "grip",
    "shift", "turn", "joints", "robot", "file", "tip", "task",
)  # fmt: skip


ARMS = ("planar2", "mda6", "chaser7", "dual_ur5", "wide", "sliding")


@lru_cache
def _arm(name: str) -> sa.SpaceArm:
    """A catalogue arm, or one with joints that turn or slide as far as they like."""
    if name not in ("wide", "sliding"):
        return sa.load(name)
    far = '<limit lower="-1e12" upper="1e12" effort="1" velocity="1"/>'
    kind = "revolute" if name == "wide" else "prismatic"
    text = robot(
        *(link(part, 10.0) for part in ("bus", "upper", "lower")),
        joint("1", "bus", "upper", kind, inside=far),
        joint("2", "upper", "lower", kind, axis=(1, 0, 0), inside=far),
        frame("tip"),
        joint("hand", "lower", "tip", "fixed"),
    )
    path = Path("robot.urdf")
    path.write_text(text, encoding="utf-8")
    arm = sa.load(path, tip="tip", task="x y")
    path.unlink()
    return arm


def _moving(arm: sa.SpaceArm) -> sa.Motion:
    """A short motion of an arm."""
    base = np.tile(np.eye(7)[6], (3, 1))
    return sa.Motion(
        arm, np.array([-1.0, 0.5, 3.0]), np.outer([0.1, 0.2, 0.1], np.ones(arm.n)), base
    )


def messages(rng: np.random.Generator, _: Path, __: set[str]) -> None:
    """Messages that no page sends, a page's between them: the socket stays, nothing is logged."""
    texts = [text for text in (_message(rng) for _ in range(20)) if len(text) < LARGEST_MESSAGE]
    logged: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: logged.append(handler.format(record))
    logging.getLogger("tornado.application").addHandler(handler)
    arm = _arm(ARMS[rng.integers(len(ARMS))])
    viewer = sa.view(_moving(arm) if rng.random() < 0.5 else arm, open=False)
    try:
        url = viewer.serve()
        asyncio.run(_talk(url.replace("http", "ws", 1).replace("/?", "/socket?"), texts))
    finally:
        viewer.close()
        logging.getLogger("tornado.application").removeHandler(handler)
    if logged:
        raise FaultError(f"{[text[:80] for text in texts]}: logged {logged[0]}")


def _message(rng: np.random.Generator) -> str | bytes:
    said = str(rng.choice(list(PANEL)))
    if rng.random() < 0.4:
        fields = PANEL[said].items()
        return json.dumps({"do": said} | {key: v[rng.integers(len(v))] for key, v in fields})
    keys = ["do", *rng.choice(KEYS, rng.integers(0, 4))]
    content = {str(key): VALUES[rng.integers(len(VALUES))] for key in keys}
    content["do"] = said if rng.random() < 0.8 else content["do"]
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
