"""Defaults: what is taken for the tip, the task and its length where nothing is said."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spacearm.errors import ConfigurationError, ModelError, UnsupportedError, unknown
from spacearm.parts import Joint
from spacearm.task import Task
from spacearm.tree import Tree


def movable(tree: Tree, tip: str) -> list[Joint]:
    """The joints between the spacecraft and a link that can move."""
    return [joint for joint in tree.chain(tip) if joint.movable]


def choose_tips(tree: Tree, path: Path, tip: str | Sequence[str] | None) -> tuple[str, ...]:
    """The links asked for, or those that the URDF names, or the one that `choose_tip` takes."""
    if tip is None or isinstance(tip, str):
        tips: Sequence[str | None] = (tip,) if tip is not None or not tree.tips else tree.tips
    else:
        tips = tip
    chosen = tuple(choose_tip(tree, path, name) for name in tips)
    if not chosen or len(set(chosen)) != len(chosen):
        raise ConfigurationError(f"tip is {tip!r}; name one link or several different ones")
    return chosen


def the_one(tips: Sequence[str], robot: str) -> str:
    """The only tip.

    Raises:
        UnsupportedError: There are several.
    """
    if len(tips) > 1:
        raise UnsupportedError(
            f"{robot} has the tips {', '.join(tips)}, and what was asked for is about one: choose "
            f"it with arm.replace(tip={tips[0]!r})"
        )
    return tips[0]


def choose_tip(tree: Tree, path: Path, tip: str | None) -> str:
    """The link asked for, or the leaf that is farthest along the longest chain."""
    if tip is None:
        depth = {leaf: (len(movable(tree, leaf)), len(tree.chain(leaf))) for leaf in tree.leaves()}
        candidates = [leaf for leaf in depth if depth[leaf] == max(depth.values())]
        if len(candidates) > 1:
            raise ModelError(
                f"{path}: {len(candidates)} links could be the tip: {', '.join(candidates)}; "
                "choose one with tip="
            )
        tip = candidates[0]
    if tip not in tree.links:
        raise ConfigurationError(f"tip: {unknown('link', tip, tree.links)}")
    if not movable(tree, tip):
        raise ConfigurationError(
            f"tip {tip!r} is part of the spacecraft; choose a link behind a movable joint: "
            f"{', '.join(link for link in tree.links if movable(tree, link))}"
        )
    return tip


def default_task(tree: Tree, tips: Sequence[str]) -> Task:
    """The rows of the plane of a planar arm, else pose from 6 joints on, else position."""
    n = min(sum(joint.mimic is None for joint in movable(tree, tip)) for tip in tips)
    if (normal := tree.plane_normal()) is not None:
        x, y = (axis for i, axis in enumerate("xyz") if i != normal)
        return Task(f"{x} {y} r{'xyz'[normal]}" if n >= 3 else f"{x} {y}")
    return Task("pose" if n >= 6 else "position")


def chain_length(tree: Tree, tip: str, path: Path) -> float:
    """Sum of the distances between successive joints [m], from the first joint to the tip."""
    chain = tree.chain(tip)
    first = chain.index(movable(tree, tip)[0])
    length = sum(float(np.linalg.norm(joint.origin.translation)) for joint in chain[first + 1 :])
    if length == 0.0:
        raise ModelError(
            f"{path}: the joints and the tip {tip!r} are in one point, so that the arm has no "
            "length to scale a mixed task with; give one: task=Task('pose', length=...)"
        )
    return length
