"""Assembly: an arm read from its URDF, and arms bolted to a bus, as trees."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pinocchio as pin

from spacearm.description.arms import find_arm
from spacearm.description.readers import urdf
from spacearm.description.tips import choose_tips, the_one
from spacearm.description.tree import Tree
from spacearm.errors import ModelError


def bolted(
    bus: Tree,
    arm: str | os.PathLike[str],
    at: pin.SE3,
    *,
    name: str | None = None,
    tip: str | None = None,
    locked: Mapping[str, float] | None = None,
    check: urdf.Check | None = None,
) -> Tree:
    """A bus with one arm more; arguments as in `loading.mount`.

    All names of the arm start with `name` and "_"; the link `name` is a frame at its tip.
    """
    known = find_arm(arm)
    path = known.path if known else Path(arm)
    tree = urdf.read(path, check or "error", spacecraft=False)
    tree = tree.locked({**(known.locked if known else {}), **(locked or {})})
    tip = the_one(choose_tips(tree, path, tip or (known.tip if known else None)), tree.name)
    name = _name(bus, known.name if known else tree.name, name)
    whole = bus.joined(tree.renamed(f"{name}_"), name, bus.root, at)
    frame = Tree(name, name, {name: None}, {})
    whole = whole.joined(frame, f"{name}.tip", f"{name}_{tip}", pin.SE3.Identity())
    return replace(whole, name=f"{bus.name}_{name}", tips=(name,))


def _name(bus: Tree, robot: str, name: str | None) -> str:
    """The name asked for, if the bus has nothing of that name; else the robot's, numbered."""
    if name is None:
        return bus.free_name(robot)
    if not isinstance(name, str) or not name:
        raise ModelError(f"name of the arm is {name!r}; give it as text")
    if bus.has(name):
        raise ModelError(f"{bus.name} has names that start with {name!r} already; take another")
    return name
