"""Defaults: the task of an arm and its length where none is named; how many joints it may have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from spacearm.description.tips.choice import movable
from spacearm.description.tree import Tree
from spacearm.errors import ModelError, UnsupportedError
from spacearm.model.task import Task

MOST_JOINTS = 200
"""Largest number of movable joints of a model."""


def check_movable(tree: Tree, path: Path) -> None:
    """Refuse a tree without movable joints, by a `ModelError`."""
    if not any(joint.movable for joint in tree.joints.values()):
        raise ModelError(f"{path}: no joint can move; an arm needs at least one free joint")


def check_count(tree: Tree, path: Path) -> None:
    """Refuse a tree of which more than `MOST_JOINTS` joints count, by an `UnsupportedError`."""
    count = sum(joint.movable for joint in tree.joints.values())
    if count > MOST_JOINTS:
        raise UnsupportedError(
            f"{path}: {count} movable joints, and Pinocchio's memory grows with their cube; lock "
            f"all but {MOST_JOINTS}"
        )


def complete_task(asked: str | Task | None, tree: Tree, tips: Sequence[str], path: Path) -> Task:
    """Return the task that was asked for, or the default one, for these tips and with a length.

    Raises:
        ConfigurationError: What was asked for is no task.
        ModelError: A mixed task needs a length, and the arm has none.
    """
    if asked is None:
        asked = default_task(tree, tips)
    task = replace(asked if isinstance(asked, Task) else Task(asked), tips=len(tips))
    if task.mixed and task.length is None:
        task = replace(task, length=max(chain_length(tree, tip, path) for tip in tips))
    return task


def default_task(tree: Tree, tips: Sequence[str]) -> Task:
    """Return the rows of the plane of a planar arm, else pose from 6 joints on, else position."""
    n = min(sum(joint.mimic is None for joint in movable(tree, tip)) for tip in tips)
    if (normal := tree.plane_normal()) is not None:
        x, y = (axis for i, axis in enumerate("xyz") if i != normal)
        return Task(f"{x} {y} r{'xyz'[normal]}" if n >= 3 else f"{x} {y}")
    return Task("pose" if n >= 6 else "position")


def chain_length(tree: Tree, tip: str, path: Path) -> float:
    """Sum the distances between successive joints [m], from the first joint to the tip.

    Raises:
        ModelError: It is zero.
    """
    length = way_to_tip(tree, tip)
    if length == 0.0:
        raise ModelError(
            f"{path}: the joints and the tip {tip!r} are in one point, so that the arm has no "
            "length to scale a mixed task with; give one: task=Task('pose', length=...)"
        )
    return length


def way_to_tip(tree: Tree, tip: str) -> float:
    """Sum the distances between successive joints [m], from the first movable one to the tip."""
    chain = tree.chain(tip)
    first = chain.index(movable(tree, tip)[0])
    return sum(float(np.linalg.norm(joint.origin.translation)) for joint in chain[first + 1 :])
