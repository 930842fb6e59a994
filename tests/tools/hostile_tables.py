"""Hostile tables and streams: CSV, JSON lines, recordings and TOML that commands read."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path

import numpy as np
from hostile_commands import PICTURE, checked
from hostile_files import changed_lines
from mutations import altered, changed_text

import spacearm as sa

CORNERS = "t,x,y\n0.5,1.2,1.2\n1,1.25,1.15\n"
PATH = "q1,q2\n0.3,1.2\n0.35,1.1\n"
STATES = "".join(
    json.dumps(state) + "\n"
    for state in (
        {"t": 0.1, "q": [0.3, 1.2]},
        {"t": 0.2, "q": [0.3, 1.1], "dq": [0.0, -1.0]},
        {
            "header": {"stamp": {"sec": 1, "nanosec": 500}, "frame_id": ""},
            "name": ["joint_2", "joint_1", "jaw"],
            "position": [1.0, 0.3, 0.0],
            "velocity": [0.1, 0.0, 0.0],
        },
        {"time": 2.5, "name": ["jaw"], "position": [0.1]},
    )
)
DEBRIS = """
pose = {xyz = [5.0, 0.25, -0.75], rpy = [0.1, 0.2, 0]}
twist = [0, 0.002, 0, 0.02, 0.03, 0.02]
[body]
name = "debris"
mass = 60
size = [0.6, 0.6, 0.8]
[grapples]
side = {xyz = [-0.35, 0, 0], rpy = [0, 1.5707963, 0]}
"""
CAUGHT = "chaser7 0 0.6 0 1.2 0 0.8 0 --target debris.toml"
GIVEN = """
[controller]
law = "JointPD"
target = [0.5, 0.5]
kp = [1, 2]
kd = 1
[integration]
rtol = 1e-6
dt = 0.05
[plant]
limits = true
[plant.passive]
joint_1 = {stiffness = 1.0, rest = 0.1, damping = 0.1}
[start]
momentum = [0, 0, 0, 0, 0, 0.1]
"""
READERS = {
    "corners.csv": "follow planar2 0.3 1.2 --path corners.csv --json",
    "path.csv": "path planar2 path.csv --json",
    "line.csv": "workspace planar2 --effort 20 --path line.csv --output work.svg",
    "states.jsonl": "watch planar2 states.jsonl --json",
    "states.mcap": "watch planar2 states.mcap --json",
    "held.csv": "identify planar2 --motion held.csv --json",
    "run.npz": "reaction planar2 --motion run.npz --json",
    "boxes.npz": "boxes planar2 0.3 1.2 --share 0.3 --most 200 --keep boxes.npz --json",
    "debris.toml": f"hold {CAUGHT} --grasp tip=side --with exact=false --json",
    "given.toml": "simulate planar2 --with given.toml --duration 0.1 --json 0.3 0.9 --target 1 1",
}
"""The command that reads each."""


@lru_cache
def _sound() -> dict[str, bytes]:
    """The sound content of each file."""
    arm = sa.load("planar2")
    held = arm.grasp(3.0, 0.4 * np.eye(3), (0.1, 0.2, 0)).at([0.3, 1.2])
    run = sa.simulate(held, sa.JointPD([1.0, 0.2], 5, 5), 1.0, integration=sa.Integration(dt=0.1))
    sa.write_motion(run, "held.csv")
    sa.write_motion(run, "states.mcap")
    run.save("run.npz")
    sa.free_boxes(arm, most=200).save("boxes.npz")
    texts = {
        "corners.csv": CORNERS, "path.csv": PATH, "line.csv": "0.5,0.5\n1,1\n",
        "states.jsonl": STATES, "debris.toml": DEBRIS, "given.toml": GIVEN,
    }  # fmt: skip
    contents = {name: text.encode() for name, text in texts.items()}
    for name in READERS.keys() - texts.keys():
        contents[name] = Path(name).read_bytes()
        Path(name).unlink()
    return contents


def tables(rng: np.random.Generator, folder: Path, named: set[str]) -> None:
    """A file that a command reads is wrong: an answer, or one line."""
    name = list(READERS)[rng.integers(len(READERS))]
    content = _sound()[name]
    if name.endswith(".toml") and rng.random() < 0.7:
        content = changed_lines(content.decode(), rng).encode("utf-8", "surrogatepass")
    elif name.endswith((".npz", ".mcap")):
        content = altered(content, rng)
    else:
        content = changed_text(content.decode(), rng)
    (folder / name).write_bytes(content)
    named.update((name, "work.svg"))
    checked(READERS[name].split())
    named.update(path.name for path in folder.iterdir() if PICTURE.fullmatch(path.name))
