"""Orders: what the page asks to be computed, as a job and its arguments."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, unknown
from spacearm.viewer.stage import Stage

FLOATING = {"risk": "the risk is known", "attitudes": "feasible attitudes are known"}
"""Jobs that know nothing of spacecraft whose attitude is controlled."""
MOST_CORNERS = 60
"""Largest number of corners that stand for the tip path of a motion."""


def order(stage: Stage, what: object, path: object) -> tuple[str, tuple[Any, ...]]:
    """Return the name of a job and its arguments.

    Args:
        stage: What is on show.
        what: What is asked for: "shells", "risk" or "attitudes".
        path: The tip path whose attitudes are asked for: "goal", the straight line to the goal, or
            "motion", that of the motion.

    Raises:
        ConfigurationError: It cannot be computed for what is on show.
    """
    jobs = {"shells": _shells, "risk": _risk, "attitudes": _attitudes}
    if not isinstance(what, str) or what not in jobs:
        raise ConfigurationError(unknown("layer to compute", str(what)[:40], jobs))
    if what in FLOATING and stage.session.spacecraft != "free-floating":
        raise ConfigurationError(f"{FLOATING[what]} for floating spacecraft; choose that mode")
    return what, jobs[what](stage, path)


def _shells(stage: Stage, _: object) -> tuple[Any, ...]:
    return stage.session.arm, stage.session.spacecraft


def _risk(stage: Stage, _: object) -> tuple[Any, ...]:
    return (stage.session.arm,)


def _attitudes(stage: Stage, path: object) -> tuple[Any, ...]:
    """Return arm, start and path; the path is taken from the system CM."""
    if path == "motion":
        if stage.motion is None:
            raise ConfigurationError("there is no motion whose tip path could be taken")
        motion, start = stage.motion, stage.motion[0]
        motion.arm.require_one_tip()
        rows = np.linspace(0, len(motion) - 1, min(len(motion), MOST_CORNERS)).round().astype(int)
        poses = [pin.XYZQUATToSE3(row) for row in motion.tip[rows]]
        corners = [_from(com, pose) for com, pose in zip(motion.com[rows], poses, strict=True)]
        return stage.session.arm, start.q, start.base, corners
    if path != "goal":
        raise ConfigurationError(unknown("path of the tip", str(path)[:40], ("goal", "motion")))
    cfg, goal = stage.session.cfg, stage.session.goal
    if goal is None:
        raise ConfigurationError("there is no goal; set one for the tip")
    return cfg.arm, cfg.q, cfg.base, [_from(cfg.com, cfg.tip), _from(cfg.com, goal)]


def _from(com: Array, pose: pin.SE3) -> pin.SE3:
    """Return a pose as seen from the system CM."""
    return pin.SE3(pose.rotation, pose.translation - com)
