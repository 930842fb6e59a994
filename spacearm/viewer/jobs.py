"""Jobs: what takes long is computed in a process of its own, while the page goes on."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from typing import Any

import pinocchio as pin

from spacearm.arrays import Array
from spacearm.closure.holding import Held
from spacearm.closure.target_plans import TargetPlan
from spacearm.collisions.obstacles import Obstacle
from spacearm.errors import ConfigurationError, SpaceArmError, require_known
from spacearm.mission.attitudes import feasible_attitudes
from spacearm.model.arm import Configuration
from spacearm.planning.planner import plan
from spacearm.planning.request import Constraints, Search
from spacearm.planning.result import Plan
from spacearm.processes import Process, Progress, WorkerError
from spacearm.singularities.joint_boxes import free_box
from spacearm.singularities.risk import risk_profile
from spacearm.viewer.motions import some
from spacearm.viewer.session import HeldSession
from spacearm.viewer.stage import Stage
from spacearm.workspaces.path_dependent import workspace

#: Time after which the search for a plan is given up [s].
LONGEST = 60.0
#: How far the process stands back: the page comes first.
NICE = 5
#: Jobs that know nothing of spacecraft whose attitude is controlled.
FLOATING = {"risk": "the risk is known", "attitudes": "feasible attitudes are known"}
#: Largest number of corners that stand for the tip path of a motion.
MOST_CORNERS = 60
#: What the page can have computed: layers, and joint ranges in which nothing is singular.
COMPUTED = ("shells", "risk", "attitudes", "ranges")
WORDS = {
    "plan": "planning",
    "shells": "computing workspaces",
    "risk": "computing the risk",
    "attitudes": "trying attitudes",
    "ranges": "proving joint ranges",
}


class BackgroundJob:
    """The computation that a page has under way in a worker process, one at a time.

    Attributes:
        failure: Name of the last one and why it failed; None if it did not.
        process: The process; None while nothing is under way.

    Args:
        lock: The lock of what is on show; the methods are called by those who hold it.
        changed: Called when there is progress, in another thread.
        finished: Called with the name of a job and its result, likewise, with the lock held.
    """

    def __init__(
        self,
        lock: AbstractContextManager[object],
        changed: Callable[[], object],
        finished: Callable[[str, Any], object],
    ) -> None:
        self._lock, self._changed, self._finished = lock, changed, finished
        self.failure: tuple[str, str] | None = None
        self.process: Process | None = None
        self._name, self._owner = "", object()
        self._progress = (0.0, 0.0)

    def start(self, name: str, function: Callable[..., Any], owner: object) -> None:
        """Start a computation.

        Args:
            name: Its name, one of `WORDS`.
            function: What is computed; it takes a parameter `progress`.
            owner: Who asks for it.

        Raises:
            ConfigurationError: Another one is under way.
        """
        if self.process:
            raise ConfigurationError(f"{WORDS[self._name]} is under way; cancel it first")
        self.failure, self._progress = None, (0.0, 0.0)
        self._name, self._owner, self.process = name, owner, Process()
        threading.Thread(target=self._follow, args=(self.process, function), daemon=True).start()

    def cancel(self) -> None:
        """End the computation at once, if there is one."""
        process, self.process = self.process, None
        if process:
            process.kill()

    def left(self, owner: object) -> None:
        """End the computation of one who has gone."""
        if self._owner is owner:
            self.cancel()

    def readout(self) -> dict[str, Any]:
        """Return what the page shows of it, and why the last one failed."""
        task = [self._name, WORDS[self._name], *self._progress] if self.process else None
        return {"task": task, "failure": self.failure}

    def _follow(self, process: Process, function: Callable[..., Any]) -> None:
        def progress(done: float, total: float) -> None:
            if process is self.process:
                self._progress = (done, total)
                self._changed()

        result, failure = None, ""
        try:
            result = process.call(partial(_behind, function), progress)
        except (SpaceArmError, WorkerError) as error:
            failure = str(error)
        process.end()
        with self._lock:
            if process is not self.process:
                return
            self.process = None
            if failure:
                self.failure = (self._name, failure)
            else:
                self._finished(self._name, result)
        self._changed()


def _behind(function: Callable[..., Any], progress: Progress) -> Any:
    """Call a function in a process that stands back behind the page."""
    os.nice(NICE)
    return function(progress=progress)


# --- what the page asks for ---------------------------------------------------------------------


def plan_to(
    start: Configuration, goal: pin.SE3, obstacles: tuple[Obstacle, ...], progress: Progress
) -> Plan:
    """Return a motion from a configuration to a pose of the tip."""
    return plan(
        start,
        goal,
        constraints=Constraints(obstacles=obstacles),
        search=Search(timeout=LONGEST, progress=progress),
    )


def lead_to(
    held: Held, goal: pin.SE3, obstacles: tuple[Obstacle, ...], progress: Progress
) -> TargetPlan:
    """Return a motion of what is held to a pose."""
    within = Constraints(obstacles=obstacles)
    return held.plan(goal, constraints=within, search=Search(timeout=LONGEST, progress=progress))


def planning(stage: Stage) -> tuple[Callable[..., Plan | TargetPlan], str]:
    """Return what plans a motion from the posture on show to the goal, and the same as code.

    Raises:
        ConfigurationError: There is no goal.
    """
    session, goal = stage.session, _goal(stage).copy()
    start = _at_rest(session.cfg)
    pose = ", ".join(repr(float(x)) for x in pin.SE3ToXYZQUAT(goal))
    missing = "  # without the obstacles on show: give them by constraints="
    code = (
        f"{session.as_python(start)}goal = pin.XYZQUATToSE3(np.array([{pose}]))\n"
        f"plan = sa.plan(cfg, goal, search=sa.Search(timeout={LONGEST:g}))"
        f"{missing * bool(stage.obstacles)}\n"
    )
    if isinstance(session, HeldSession):
        code = code.replace("plan = sa.plan(cfg, ", "# plan = sa.hold(cfg, target, grasps).plan(")
        return partial(lead_to, session.held, goal, stage.obstacles), code
    return partial(plan_to, start, goal, stage.obstacles), code


def layer(stage: Stage, what: object, path: object) -> tuple[str, Callable[..., Any]]:
    """Return the name of what the page asks for, and what computes it.

    Args:
        stage: What is on show.
        what: "shells", "risk", "attitudes" or "ranges".
        path: The tip path whose attitudes are asked for: "goal", the straight line to the goal, or
            "motion", that of the motion.

    Raises:
        ConfigurationError: It cannot be computed for what is on show.
    """
    session = stage.session
    what = str(what)[:40]
    require_known("layer to compute", what, COMPUTED)
    if what in FLOATING and session.spacecraft != "free-floating":
        raise ConfigurationError(f"{FLOATING[what]} for floating spacecraft; choose that mode")
    if what == "shells":
        return what, partial(workspace, session.arm, mode=session.spacecraft)
    if what == "risk":
        return what, partial(risk_profile, session.arm)
    if what == "ranges":
        return what, partial(free_box, _at_rest(session.cfg), mode=session.spacecraft)
    return what, partial(feasible_attitudes, *_start_and_path(stage, path))


def _start_and_path(stage: Stage, path: object) -> tuple[Configuration, list[pin.SE3]]:
    """Return a start, and the poses of the tip from there, as seen from the system CM."""
    if path == "motion":
        if stage.motion is None:
            raise ConfigurationError("there is no motion whose tip path could be taken")
        motion = stage.motion
        motion.arm.require_one_tip()
        rows = some(len(motion), MOST_CORNERS)
        poses = [pin.XYZQUATToSE3(row) for row in motion.tip[rows]]
        corners = [_from(com, pose) for com, pose in zip(motion.com[rows], poses, strict=True)]
        return _at_rest(motion[0]), corners
    require_known("path of the tip", str(path)[:40], ("goal", "motion"))
    cfg, goal = stage.session.cfg, _goal(stage)
    return _at_rest(cfg), [_from(cfg.com, cfg.tip), _from(cfg.com, goal)]


def _at_rest(cfg: Configuration) -> Configuration:
    """Return a configuration without momentum: what the page asks for is at rest."""
    return cfg.arm.at(cfg.q, base=cfg.base)


def _goal(stage: Stage) -> pin.SE3:
    if stage.session.goal is None:
        raise ConfigurationError("there is no goal; set one for the tip")
    return stage.session.goal


def _from(com: Array, pose: pin.SE3) -> pin.SE3:
    """Return a pose as seen from the system CM."""
    return pin.SE3(pose.rotation, pose.translation - com)
