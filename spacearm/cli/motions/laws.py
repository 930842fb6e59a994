"""Control laws from words: of options, or of a table in a file."""

from __future__ import annotations

from enum import Enum
from typing import Any

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.cli.options import goal_from, joint_values, numbers
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.motion.controllers import (
    Controller,
    DampedLeastSquares,
    JointPD,
    Reactionless,
    ResolvedRate,
    TransposedJacobian,
)
from spacearm.motion.goal import Goal


class Law(str, Enum):
    """Names of the controllers."""

    TRANSPOSED = "transposed"
    RESOLVED = "resolved"
    DAMPED = "damped"
    REACTIONLESS = "reactionless"
    JOINTS = "joints"


KINDS: dict[Law, type[Controller]] = {
    Law.TRANSPOSED: TransposedJacobian,
    Law.RESOLVED: ResolvedRate,
    Law.DAMPED: DampedLeastSquares,
    Law.REACTIONLESS: Reactionless,
    Law.JOINTS: JointPD,
}
MORE: dict[Law, tuple[str, ...]] = {
    Law.TRANSPOSED: ("kp", "kd"),
    Law.RESOLVED: ("gain", "servo", "rest"),
    Law.DAMPED: ("gain", "servo", "damping", "threshold"),
    Law.REACTIONLESS: ("gain", "servo", "damping", "threshold"),
    Law.JOINTS: ("kp", "kd"),
}
"""The parameters of each besides the target."""


def law_of(
    arm: SpaceArm,
    law: Law,
    target: str,
    parameters: dict[str, Any],
    mode: BaseMode,
    deg: bool,
) -> tuple[Controller, Goal | None]:
    """Return the controller, and the goal of the tip if it has one."""
    kind: Any = KINDS[law]
    given = {name: value for name, value in parameters.items() if name in MORE[law]}
    if law is Law.JOINTS:
        return kind(target=joint_values(arm, target.split(), deg), **given), None
    goal: Array | pin.SE3 = goal_from(arm, "--target", target, deg)
    return kind(target=goal, mode=mode, **given), goal


def gain_of(option: str, text: str) -> Array:
    """Return one number, or one per row."""
    return np.squeeze(numbers(option, text))
