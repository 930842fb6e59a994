"""Hostile files: studies, stores of sweeps, trajectories, meshes."""

from __future__ import annotations

import os
import re
import warnings
import zipfile
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh
from helpers.arms import frame, joint, link, robot
from helpers.sweeps import STUDY
from hostile import FaultError
from mutations import HOSTILE, altered, changed_text

import spacearm as sa
import spacearm.sweeps.runner
from spacearm.collisions.separation import Collisions
from spacearm.sweeps.runner import Work, status
from spacearm.sweeps.study import Chunk, Recipe

# --- studies and their stores ---------------------------------------------------------------

TINY = """
arms = ["planar2"]
chunk = 8

[parameters]
base_inertia = [1, 3]

[risk]
sigma_min = 0.2
bins = [0, 1, 6]
samples = 16

[sigma_min]
joints.q1 = {from = -3, to = 3, points = 4}
held.q2 = 0.3
"""
"""Six chunks."""
MOST = 50
"""Chunks of a study that are computed."""


class Here:
    """Chunks done in this process, which must start no other; stands for `Processes`."""

    width, lost = 1, False
    final: tuple[type[BaseException], ...] = ()

    def __init__(self, _: int, recipe: Recipe, path: str) -> None:
        self._order = (recipe, path)

    def submit(self, work: Work, chunk: Chunk) -> Future[str]:
        done: Future[str] = Future()
        try:
            done.set_result(work(*self._order, chunk))
        except Exception as error:  # as in a process
            done.set_exception(error)
        return done

    def close(self) -> None:
        """Nothing waits."""


def studies(rng: np.random.Generator, folder: Path, _: set[str]) -> None:
    """A study with lines, values or letters that are wrong: read, described, its chunks counted."""
    study = sa.Study.parse(changed_lines(STUDY, rng), folder)
    repr(study), study.attributes, study.labels
    for name in study.quantities:
        study.box(Chunk(name, study.count(name) - 1))


def stores(rng: np.random.Generator, folder: Path, named: set[str]) -> None:
    """A study computed, its store damaged, the same study and another one computed into it."""
    spacearm.sweeps.runner.Processes = Here
    named.add("run.zarr")
    text = changed_lines(TINY, rng) if rng.random() < 0.4 else TINY
    study = sa.Study.parse(text, folder)
    if sum(map(study.count, study.quantities)) > MOST:
        return
    whole = sa.sweep(study, "run.zarr", workers=1).load()
    for _ in range(rng.integers(0, 4)):
        files = sorted(path for path in Path("run.zarr").rglob("*") if path.is_file())
        _damage(files[rng.integers(len(files))], files[rng.integers(len(files))], rng)
    other = sa.Study.parse(TINY, folder) if rng.random() < 0.2 else study
    status(other, "run.zarr")
    again = sa.sweep(other, "run.zarr", workers=1).load()
    if not again.identical(whole):
        raise FaultError("a damaged store gives other numbers")


def _damage(path: Path, other: Path, rng: np.random.Generator) -> None:
    """One file of a store with other bytes, another value, that of a neighbour, or gone."""
    kind = rng.integers(6)
    if kind == 0:
        path.unlink()
    elif kind == 4:
        path.unlink()
        os.mkfifo(path)
    elif kind == 5:
        aside = path.parent.rename(f"{path.parent}.aside")
        path.parent.symlink_to(aside.name)
    elif kind == 1:
        path.write_bytes(other.read_bytes())
    elif kind == 2 and path.suffix == ".json":
        path.write_bytes(changed_text(path.read_text(encoding="utf-8"), rng))
    else:
        path.write_bytes(altered(path.read_bytes(), rng))


def changed_lines(text: str, rng: np.random.Generator) -> str:
    """A study with a few lines, values or letters that are wrong."""
    lines = text.splitlines()
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
            [re.sub(r"\d+", lambda _: str(10 ** int(rng.integers(0, 30))), lines[at], count=1)],
        ][kind]
    return "\n".join(lines)


# --- saved trajectories and plans -----------------------------------------------------------


def trajectories(rng: np.random.Generator, folder: Path, named: set[str]) -> None:
    """A saved trajectory with bytes or arrays that are wrong."""
    arm = _load(ARMS[rng.integers(len(ARMS))])
    path = folder / "run.npz"
    named.add(path.name)
    path.write_bytes(_saved(arm, bool(rng.random() < 0.1)))
    if rng.random() < 0.5:
        path.write_bytes(altered(path.read_bytes(), rng))
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
    if rng.random() < 0.1:
        name = str(rng.choice(["t", "kind", "joints", "x.npy"]))
        damaged = zipfile.BadZipFile, NotImplementedError  # enough as it is
        with suppress(*damaged), zipfile.ZipFile(path, "a") as archive:
            archive.writestr(name, b"no array")
    run = sa.Trajectory.load(path, arm)
    repr(run), run.to_dict(), run[0], run[-1], run.drift, run.imbalance, run.to_xarray()
    sa.Motion.of(run).at(0.2)
    if rng.random() < 0.3:
        named.add("page.html")
        sa.plot(run)
        sa.view(run, open=False).save("page.html")


ARMS = ("planar2", "planar3", "mda6", "servicer_ur5", "dual_ur5")
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
    *(lambda a, factor=f: a * factor if a.dtype.kind == "f" else a for f in (-1, 0, 1e9, 1e299)),
)


_load = lru_cache(sa.load)


@lru_cache
def _saved(arm: sa.SpaceArm, planned: bool) -> bytes:
    """A file that a trajectory of an arm was saved in, or a plan."""
    path = Path("saved.npz")
    if planned:
        sa.plan(
            arm.at(np.full(arm.n, 0.3)),
            sa.Joints(np.full(arm.n, 0.31)),
            search=sa.Search(timeout=4),
        ).save(path)
    else:
        pd = sa.JointPD(target=np.full(arm.n, 0.5), kp=1, kd=1)
        sa.simulate(arm.at(np.full(arm.n, 0.3)), pd, 0.2, integration=sa.Integration(dt=0.05)).save(
            path
        )
    content = path.read_bytes()
    path.unlink()
    return content


# --- meshes -----------------------------------------------------------------------------------

SOLIDS = (
    trimesh.creation.box((1, 0.2, 0.3)),
    trimesh.creation.icosphere(1, 0.4),
    trimesh.creation.cylinder(0.1, 2, sections=6),
)
KINDS = ("stl", "stl_ascii", "obj", "ply", "dae", "glb", "gltf")


def _gltf(solid: trimesh.Trimesh) -> bytes:
    """A glTF whose buffers stand in it as data URIs."""
    return trimesh.Scene(solid).export(file_type="gltf", embed_buffers=True)["model.gltf"]


def meshes(rng: np.random.Generator, folder: Path, named: set[str]) -> None:
    """A robot whose links look like and collide as a mesh file that is wrong: drawn, kept apart."""
    kind = KINDS[rng.integers(len(KINDS))]
    solid = SOLIDS[rng.integers(len(SOLIDS))].copy()
    odd = bool(rng.random() < 0.4)  # a sound file of a strange body, or the other way round
    if odd:
        flat = rng.choice([0.0, 1.0], 3, p=[0.1, 0.9])
        solid.vertices = solid.vertices * flat * 10.0 ** rng.uniform(-9, 9, 3)
    content = solid.export(file_type=kind) if kind != "gltf" else _gltf(solid)
    file = f"body.{kind.removesuffix('_ascii') if rng.random() < 0.95 else rng.choice(KINDS)}"
    if odd:
        Path(file).write_bytes(content.encode() if isinstance(content, str) else content)
    elif isinstance(content, str) or (kind in ("dae", "gltf") and rng.random() < 0.7):
        text = content if isinstance(content, str) else content.decode()
        Path(file).write_bytes(changed_text(text, rng))
    else:
        Path(file).write_bytes(altered(content, rng))
    scale = str(rng.choice(HOSTILE)) if rng.random() < 0.1 else "1 1 1"
    scale = re.sub(r"[^\w .,+-]", "", scale)
    looks = f'<geometry><mesh filename="{file}" scale="{scale}"/></geometry>'
    looks = f"<visual>{looks}</visual><collision>{looks}</collision>"
    names = ("bus", "upper", "lower")
    text = robot(
        *(link(name, 5.0, inside=looks) for name in names),
        joint("1", "bus", "upper", xyz=(3, 0, 0)),
        joint("2", "upper", "lower", xyz=(3, 0, 0)),
        frame("tip"),
        joint("hand", "lower", "tip", "fixed"),
    )
    (folder / "robot.urdf").write_text(text, encoding="utf-8")
    named.update(("robot.urdf", file, "page.html"))
    arm = sa.load("robot.urdf", tip="tip", task="x y")
    sa.view(arm, open=False).save("page.html")
    bodies = Collisions(arm)
    path = rng.uniform(-1, 1, (2, arm.n))
    repr(bodies.contact(path))
    if not np.isfinite(bodies.distances(path[0])).all():
        raise FaultError("distances that are not finite")
