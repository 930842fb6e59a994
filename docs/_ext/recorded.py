"""Recorded pages of the gallery: scenes to turn and motions to play without an installation."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

import spacearm as sa
from examples import forked
from spacearm.viewer.viewer import Viewer


def turn() -> Viewer:
    """Figure 5 of the paper: the straight line ends singular, the plan turns the spacecraft."""
    floating = sa.load("planar2").at(
        np.radians([-57.936, 60.337]), base=sa.pose(rpy=(0, 0, 0.3665))
    )
    begin, target = floating.arm.at(floating.q, base=floating.centred(np.zeros(3)).base), (1.5, 1.5)
    line = sa.follow(begin, [target], limits=False)
    return sa.view(sa.plan(begin, target), compare=line, open=False)


def servicer() -> Viewer:
    """A UR5 on a small servicer reaches past a box; its ghost shows the arm on a fixed base."""
    begin = sa.load("servicer_ur5").at([0.0, -1.05, 1.4, 0.35, 1.57, 0.0])
    goal = sa.move(begin, [0.9, -0.75, 0.9, 0.55, 1.67, 0.0]).tip
    box = sa.Obstacle.box((0.1, 0.1, 0.5), sa.pose((0.75, 0.35, 0.5)), name="box")
    plan = sa.plan(begin, goal, duration=8.0, constraints=sa.Constraints(obstacles=[box]))
    return sa.view(plan, compare="fixed", open=False)


def catch() -> Viewer:
    """A servicer of 1.6 t catches a box that tumbles, and brakes with it."""
    debris = sa.Target(
        sa.Bus(60, size=(0.6, 0.6, 0.8), name="debris"),
        sa.pose((5.0, 0.25, -0.75), (0.1, 0.2, 0)),
        twist=(0, 0.002, 0, 0.02, 0.03, 0.02),
        grapples={"side": sa.pose((-0.35, 0, 0), (0, np.pi / 2, 0))},
    )
    start = sa.load("chaser7").at([0, 0.6, 0, 1.2, 0, 0.8, 0])
    return sa.view(sa.catch(start, debris, window=(10, 30), wanted=1), open=False)


SCENES = {"turn": turn, "servicer": servicer, "catch": catch}


def jobs(docs: Path) -> list[Callable[[], None]]:
    """Return what records each scene in a process of its own."""
    folder = docs / "generated" / "site" / "recorded"
    folder.mkdir(parents=True, exist_ok=True)
    return [partial(_keep, folder / f"{name}.html") for name in SCENES]


def _keep(page: Path) -> None:
    """Record a scene, unless its page is newer than this module."""
    if not page.exists() or page.stat().st_mtime < Path(__file__).stat().st_mtime:
        forked(_record, page)


def _record(page: Path) -> str:
    SCENES[page.stem]().save(page)
    return page.name
