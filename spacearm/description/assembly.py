"""Assembly: models put together from a recipe, arms bolted to a bus, bodies held, as trees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from spacearm.description.bodies import Inertial
from spacearm.description.bus import STEEL, Bus, body
from spacearm.description.model_catalogue import ModelInfo, find_arm
from spacearm.description.readers import formats
from spacearm.description.readers.formats import RobotSource
from spacearm.description.readers.source import Reading
from spacearm.description.tips import choose_tips, only_tip
from spacearm.description.tree import Tree, free_name
from spacearm.errors import ModelError


def assembled(info: ModelInfo, reading: Reading | None = None) -> Tree:
    """Return the tree of a catalogue model, read from its URDF or put together from its recipe.

    Args:
        info: The model.
        reading: How its files are read; as the catalogue says if None.
    """
    reading = reading or Reading(check=info.check)
    if info.recipe is None:
        return formats.read(info.path, reading)
    tree = Bus(**info.recipe["bus"]).tree()
    for arm in info.recipe["arms"]:
        at = pin.SE3(np.eye(3), np.array(arm["xyz"]))
        tree = bolted(tree, arm["arm"], at, name=arm["name"], reading=reading)
    return replace(tree, name=info.name, tips=(info.tip,))


def bolted(
    bus: Tree,
    arm: RobotSource,
    at: pin.SE3,
    *,
    name: str | None = None,
    tip: str | None = None,
    locked: Mapping[str, float] | None = None,
    reading: Reading | None = None,
) -> Tree:
    """Return a bus with one arm more; arguments as in `loading.mount`.

    All names of the arm start with `name` and "_"; the link `name` is a frame at its tip.
    """
    known = find_arm(arm)
    path = known.path if known else formats.path_of(arm)
    tree = formats.read(
        known.path if known else arm, replace(reading or Reading(), spacecraft=False)
    )
    tree = tree.locked(locked or {})
    asked = tip or (known.tip if known else None)
    chosen = choose_tips(tree, path, asked)
    tip = only_tip(chosen.links, tree.name)
    name = _name(bus, known.name if known else tree.name, name)
    whole = bus.joined(tree.renamed(lambda part: f"{name}_{part}"), name, bus.root, at)
    frame = Tree(name, name, {name: None}, {})
    whole = whole.joined(frame, f"{name}.tip", f"{name}_{tip}", pin.SE3.Identity())
    found = () if asked else (f"the tip of {name} is {tip!r}: {chosen.reason}",)
    notes = (*whole.notes, *found)
    return replace(whole, name=f"{bus.name}_{name}", tips=(name,), notes=notes)


def holding(tree: Tree, link: str, rigid: Inertial) -> Tree:
    """Return the tree with a body fixed to a link, as a link "payload" of its own."""
    name = free_name("payload", tree.has)
    return tree.joined(body(name, rigid, None, STEEL), name, link, pin.SE3.Identity())


def _name(bus: Tree, robot: str, name: str | None) -> str:
    """Return the name asked for, if the bus has nothing of that name; else the robot's, numbered.

    Raises:
        ModelError: The name is no text, or taken.
    """
    if name is None:
        return free_name(robot, bus.has)
    if not isinstance(name, str) or not name:
        raise ModelError(f"name of the arm is {name!r}; give it as text")
    if bus.has(name):
        raise ModelError(f"{bus.name} has names that start with {name!r} already; take another")
    return name
