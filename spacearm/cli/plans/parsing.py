"""Goals and obstacles as texts of the command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.cli.options import goal_from, numbers
from spacearm.collisions.obstacles import Obstacle
from spacearm.errors import ConfigurationError, listed, unknown
from spacearm.model.arm import SpaceArm
from spacearm.model.loading import load

KINDS = ("box", "sphere", "cylinder", "mesh", "robot")
"""Kinds of obstacles."""


def goals(
    arm: SpaceArm, texts: list[str], deg: bool
) -> Array | pin.SE3 | dict[str, Array | pin.SE3]:
    """Parse a goal, or one for each tip as NAME=X1,X2,..."""
    if len(texts) == 1 and "=" not in texts[0]:
        return goal_from(arm, "--goal", texts[0], deg)
    pairs = [text.partition("=") for text in texts]
    for name, _, values in pairs:
        if name not in arm.tips or not values:
            raise ConfigurationError(
                f"--goal {name!r}: give one goal, or NAME=X1,X2,... for each of the tips "
                f"{listed(arm.tips)} (--tip NAME,NAME)"
            )
    return {name: goal_from(arm, f"--goal {name}", values, deg) for name, _, values in pairs}


def obstacle_of(text: str, deg: bool) -> Obstacle:
    """Parse an obstacle, such as "box:1.2,0,0.5:0.3,0.3,0.6:0,0,45@0.05"."""
    body, _, kept = text.partition("@")
    kind, *parts = body.split(":")
    if kind not in KINDS:
        raise ConfigurationError(f"--obstacle {text!r}: {unknown('kind', kind, KINDS)}")
    if not 2 <= len(parts) <= 3:
        raise ConfigurationError(f"--obstacle {text!r}: give KIND:X,Y,Z:WHAT[:R,P,Y][@MARGIN]")
    turn = _counted(text, parts[2], 3) if len(parts) == 3 else np.zeros(3)
    rotation = pin.rpy.rpyToMatrix(np.radians(turn) if deg else turn)
    pose, what = pin.SE3(rotation, _counted(text, parts[0], 3)), parts[1]
    margin = float(_counted(text, kept, 1)[0]) if kept else 0.0
    if kind == "mesh":
        return Obstacle.mesh(Path(what), pose, margin=margin)
    if kind == "robot":
        robot = load(what)
        rest = np.clip(0.0, robot.lower, robot.upper)
        return Obstacle.robot(robot.at(rest, base=pose), margin=margin)
    if kind == "sphere":
        return Obstacle.sphere(float(_counted(text, what, 1)[0]), pose, margin=margin)
    if kind == "cylinder":
        radius, length = map(float, _counted(text, what, 2))
        return Obstacle.cylinder(radius, length, pose, margin=margin)
    size = _counted(text, what, 3 if "," in what else 1)
    return Obstacle.box(size if len(size) == 3 else float(size[0]), pose, margin=margin)


def _counted(whole: str, text: str, count: int) -> Array:
    """Parse some numbers with commas between them."""
    values = numbers(f"--obstacle {whole!r}:", text)
    if len(values) != count:
        raise ConfigurationError(f"--obstacle {whole!r}: {text!r} must be {count} finite numbers")
    return values
