"""Hostile models: loaded and written, and set in motion.

In this and the modules beside it there is one function a target: it is given a random number
generator, which decides what comes, its folder, and a set for the names of what it may leave there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from mutations import mutated, other_numbers, urdf_sources

import spacearm as sa
from spacearm.collisions.separation import Collisions
from spacearm.description.model_catalogue import models_folder

JOINTS = 4
"""Joints that move in `motions`, the others locked: what many of them take is the user's affair."""
OURS = sorted(models_folder().glob("*.urdf"))
TASKS = (None, None, "x", "x y", "position", "pose")


class FaultError(Exception):
    """A case did what it must not do."""


def _robot(rng: np.random.Generator, sources: Sequence[Path]) -> tuple[str, str | None]:
    """A robot's URDF, and one of its later links."""
    text = sources[rng.integers(len(sources))].read_text(encoding="utf-8")
    links = re.findall(r'<link\s+name="([^"]*)"', text)
    tip = str(rng.choice(links[len(links) // 2 :])) if links and rng.random() < 0.8 else None
    return text, tip


def urdf(rng: np.random.Generator, folder: Path, named: set[str]) -> None:
    """Loads, mounts, asks, writes and reads again."""
    text, tip = _robot(rng, urdf_sources())
    path = folder / rng.choice(["robot.urdf", "robot.xacro"], p=[0.95, 0.05])
    path.write_bytes(mutated(text, rng))
    named.update((path.name, "again.urdf"))
    check = str(rng.choice(["error", "warn", "accept", "accept"]))
    if rng.random() < 0.3:
        arm = sa.load(path, check=check, tip=tip)
    else:
        arm = sa.mount(path, sa.Bus(mass=100, size=(1, 1, 1)), check=check, tip=tip)
    cfg = arm.at(rng.uniform(-1, 1, arm.n))
    report = sa.singularity(cfg)
    if not (np.isfinite(report.sigma).all() and np.isfinite(sa.momentum_matrix(cfg).A_b).all()):
        raise FaultError("numbers that are not finite")
    again = sa.load(arm.to_urdf(folder / "again.urdf"), check="accept")
    if not np.allclose(again.at(cfg.q).A, cfg.A, rtol=1e-9, atol=1e-9 * np.abs(cfg.A).max()):
        raise FaultError("a written model is another one")


def motions(rng: np.random.Generator, folder: Path, named: set[str]) -> None:
    """Loads, and does one of the larger things with a few joints of it."""
    text, tip = _robot(rng, OURS if rng.random() < 0.5 else urdf_sources())
    path = folder / "robot.urdf"
    path.write_bytes(
        mutated(text, rng) if rng.random() < 0.2 else other_numbers(text, rng).encode()
    )
    named.add(path.name)
    arm = sa.load(path, check="accept", tip=tip, task=TASKS[rng.integers(len(TASKS))])
    arm = arm.replace(locked=dict.fromkeys(arm.joint_names[JOINTS:], 0.0))
    numbers = MOTIONS[rng.integers(len(MOTIONS))](arm, rng)
    if not np.isfinite(numbers).all():
        raise FaultError("numbers that are not finite")


def _mapped(arm: sa.SpaceArm, _: np.random.Generator) -> np.ndarray:
    return sa.singular_map(arm, points=9).sigma_min


def _workspace(arm: sa.SpaceArm, rng: np.random.Generator) -> np.ndarray:
    found = sa.workspace(arm, effort=20, limits=bool(rng.integers(2)))
    repr(found)
    return np.concatenate((found.reachable, found.pdw))


def _simulated(arm: sa.SpaceArm, rng: np.random.Generator) -> np.ndarray:
    pd = sa.JointPD(target=rng.uniform(-1, 1, arm.n), kp=1, kd=1)
    run = sa.simulate(
        arm.at(rng.uniform(-1, 1, arm.n)), pd, 0.1, integration=sa.Integration(rtol=1e-4)
    )
    return np.append(run.q.ravel(), (run.drift, run.imbalance))


def _planned(arm: sa.SpaceArm, rng: np.random.Generator) -> np.ndarray:
    start = rng.uniform(-1, 1, arm.n)
    goal = sa.Joints(start + rng.uniform(-0.3, 0.3, arm.n))
    return sa.plan(arm.at(start), goal, search=sa.Search(timeout=1)).q


def _apart(arm: sa.SpaceArm, rng: np.random.Generator) -> np.ndarray:
    bodies, path = Collisions(arm), rng.uniform(-0.1, 0.1, (2, arm.n))
    repr(bodies.contact(path))
    return bodies.distances(path[0])


def _varied(arm: sa.SpaceArm, _: np.random.Generator) -> np.ndarray:
    designs = sa.design.workspaces(arm, {"base_inertia": [1.0, 2.0]}, effort=20)
    return designs["reachable"].values


MOTIONS: tuple[Callable[[sa.SpaceArm, np.random.Generator], np.ndarray], ...] = (
    _mapped, _workspace, _simulated, _planned, _apart, _varied,
)  # fmt: skip
