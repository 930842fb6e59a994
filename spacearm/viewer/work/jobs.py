"""Jobs: what can be asked of a worker process, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import pinocchio as pin

from spacearm.arrays import Array
from spacearm.collisions.obstacles import Obstacle
from spacearm.mission.attitude_search import feasible_attitudes
from spacearm.mission.attitudes import FeasibleAttitudes
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.planning.planner import plan
from spacearm.planning.result import Plan
from spacearm.singularities.risk import RiskProfile, risk_profile
from spacearm.workspaces.path_dependent import Workspace, workspace

Progress = Callable[[float, float], object]
LONGEST = 60.0
"""Time after which the search for a plan is given up [s]."""


def plan_to(
    arm: SpaceArm,
    q0: Array,
    base: pin.SE3,
    goal: pin.SE3,
    obstacles: tuple[Obstacle, ...],
    progress: Progress,
) -> Plan:
    """Return a motion to a pose of the tip."""
    options = {"base": base, "obstacles": obstacles, "timeout": LONGEST, "progress": progress}
    return plan(arm, q0, goal, **options)


def shells_of(arm: SpaceArm, mode: BaseMode, progress: Progress) -> Workspace:
    """Return the workspaces of an arm."""
    return workspace(arm, mode=mode, progress=progress)


def risk_of(arm: SpaceArm, progress: Progress) -> RiskProfile:
    """Return the share of singular postures over the distance of the tip from the system CM."""
    return risk_profile(arm, progress=progress)


def attitudes_of(
    arm: SpaceArm, q0: Array, base: pin.SE3, path: list[pin.SE3], progress: Progress
) -> FeasibleAttitudes:
    """Return the attitudes of the spacecraft from which the tip can follow a path."""
    return feasible_attitudes(arm.at(q0, base=base), path, progress=progress)


JOBS: Mapping[str, Callable[..., Any]] = {
    "plan": plan_to,
    "shells": shells_of,
    "risk": risk_of,
    "attitudes": attitudes_of,
}
