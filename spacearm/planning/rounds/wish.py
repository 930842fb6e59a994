"""Wish: what a plan shall be like, and the problem that it poses."""

from __future__ import annotations

from typing import NamedTuple

import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.collisions.obstacles import Obstacle
from spacearm.errors import NoSolutionError
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.goal import Goal, goal_pose
from spacearm.planning.problem import Problem, bodies_apart
from spacearm.planning.result import Joints, best_attempt
from spacearm.planning.search import Search
from spacearm.planning.targets import make_target


class Wish(NamedTuple):
    """What a plan shall be like, as in the arguments of `plan`.

    `held` is the arm itself if the search is for one on a spacecraft that does not turn; `keep` the
    largest turn on the way [rad].
    """

    goal: Goal | Joints
    clearance: float | None
    final_attitude: npt.ArrayLike | pin.SE3 | float | None
    limits: bool
    collisions: bool
    method: str
    obstacles: tuple[Obstacle, ...]
    held: SpaceArm | None = None
    keep: float | None = None

    def moved(self, cfg: Configuration, by: Array) -> Wish:
        """Return the wish without obstacles, its goal moved back by (3,) [m]."""
        if isinstance(self.goal, Joints):
            return self._replace(obstacles=())
        pose = goal_pose(cfg, self.goal)
        return self._replace(goal=pin.SE3(pose.rotation, pose.translation - by), obstacles=())


def problem_of(cfg: Configuration, wish: Wish, seed: int, search: Search) -> Problem:
    """Return the problem to be solved.

    Raises:
        NoSolutionError: No motion can solve it.
    """
    try:
        target, ample = make_target(
            cfg, wish.goal, wish.clearance, wish.final_attitude, wish.limits
        )
        bodies = bodies_apart(cfg, target, wish.obstacles) if wish.collisions else None
    except NoSolutionError as error:
        raise NoSolutionError(str(error), best_attempt(cfg, error.best, ())) from None
    return Problem(cfg, target, ample, seed, search, bodies, wish.held, wish.keep)
