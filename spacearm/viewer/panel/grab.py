"""Grab: the tip follows a pointer, by inverse kinematics of the arm as its spacecraft moves."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import listed
from spacearm.mechanics.jacobian import task_jacobian
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration
from spacearm.viewer.panel.labels import short_names

MOST_STEPS = 40
START = 1e-4
"""Damping of the first step, over the largest singular value squared."""
CLOSE = 2e-3
"""Share of the largest singular value within which the tip counts as there [rad]."""
LONGEST = 0.3
"""Largest joint motion of one step [rad] or [m]."""
HOPELESS = 1e3
"""Damping, likewise, from which on no step helps."""
LESS = 1.0 - 1e-6
"""Share of the error that has to be left at most after a step that counts."""
BENDS = (0.1, -0.1, 0.02, -0.02)
"""Joint motions by which a singular posture is left [rad] or [m]."""


class Grabbed(NamedTuple):
    """Where the arm is after the tip was pulled.

    Attributes:
        cfg: The configuration.
        blocked: Why the tip is not where it was pulled to; empty if it is.
    """

    cfg: Configuration
    blocked: str


def pulled(
    cfg: Configuration,
    goal: pin.SE3,
    mode: BaseMode,
    moved: Callable[[Configuration, Array], Configuration],
    bounds: tuple[Array, Array],
) -> Grabbed:
    """Bring the tip to a pose, or as near as it comes from here, along the rows of the task.

    Levenberg's and Marquardt's method: steps along lost directions are damped away, and the tip
    slides along those that are left. Joints stop at their bounds.

    Args:
        cfg: Where the arm is.
        goal: Pose of the tip in the inertial frame.
        mode: What the spacecraft does.
        moved: Moves a configuration to joint positions (n,), the spacecraft with it.
        bounds: (n,) lower and upper joint positions.
    """
    lower, upper = bounds

    def tried(step: Array) -> tuple[Configuration, Array, float]:
        trial = moved(cfg, np.clip(cfg.q + step, lower, upper))
        left = _error(trial, goal)
        return trial, left, float(np.linalg.norm(left))

    error, damping, stopped = _error(cfg, goal), START, np.zeros(cfg.arm.n, dtype=bool)
    size, largest = float(np.linalg.norm(error)), 0.0
    for _ in range(MOST_STEPS):
        J = task_jacobian(cfg, mode=mode)
        largest = float(np.linalg.norm(J, 2))
        if size <= 0.1 * CLOSE * largest:
            break
        J = np.where(stopped, 0.0, J)
        normal = J.T @ J + damping * largest**2 * np.eye(cfg.arm.n)
        step = np.linalg.solve(normal, J.T @ error)
        step *= min(1.0, LONGEST / max(float(np.abs(step).max()), 1e-12))
        found = tried(step)
        hit = (found[0].q != cfg.q + step) & ~stopped
        if found[2] < size * LESS:
            (cfg, error, size), damping = found, max(0.2 * damping, 1e-9)
        elif hit.any():
            stopped |= hit
        elif damping < HOPELESS:
            damping *= 10.0
        else:  # on the singular set: out of it by the joint motion that leaves the tip at rest
            still = np.linalg.svd(J)[2][-1]
            found = min((tried(bend * still) for bend in BENDS), key=lambda one: one[2])
            if found[2] >= size * LESS:
                break
            (cfg, error, size), damping = found, START
    return Grabbed(cfg, _reason(cfg, error, largest, mode, bounds))


def _error(cfg: Configuration, goal: pin.SE3) -> Array:
    """Return the task's rows (k,) of the twist that leads to a goal in one second, scaled."""
    way = goal.translation - cfg.tip.translation
    turn = pin.log3(goal.rotation @ cfg.tip.rotation.T)
    twist = np.concatenate((way, turn))[:, None]
    task = cfg.arm.task
    return (task.scale * task.components(twist, task.axes(cfg.base.rotation)))[:, 0]


def _reason(
    cfg: Configuration, error: Array, largest: float, mode: BaseMode, bounds: tuple[Array, Array]
) -> str:
    """Return why the tip is not at its goal; empty if it is."""
    if np.linalg.norm(error) <= CLOSE * largest:
        return ""
    arm, (lower, upper) = cfg.arm, bounds
    room = 1e-6 * (upper - lower)
    pull = task_jacobian(cfg, mode=mode).T @ error
    pushed = ((cfg.q >= upper - room) & (pull > 0.0)) | ((cfg.q <= lower + room) & (pull < 0.0))
    if pushed.any():
        names = short_names(arm.joint_names)
        ends = [names[j] for j in np.flatnonzero(pushed)]
        where = (
            "is at the end of its range" if len(ends) == 1 else "are at the ends of their ranges"
        )
        return f"The tip cannot follow: {listed(ends)} {where}"
    return "The tip cannot follow: in this direction it has no motion left"
