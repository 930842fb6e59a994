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
from spacearm.planning.account import SearchAccount
from spacearm.planning.problem import Problem, bodies_apart
from spacearm.planning.request import Constraints
from spacearm.planning.result import Joints, best_attempt
from spacearm.planning.targets import make_target


class Wish(NamedTuple):
    """What a plan shall be like, as in the arguments of `plan`.

    `held` is the arm itself if the search is for one on a spacecraft that does not turn.
    """

    goal: Goal | Joints
    final_attitude: npt.ArrayLike | pin.SE3 | float | None
    constraints: Constraints
    method: str
    obstacles: tuple[Obstacle, ...]
    held: SpaceArm | None = None

    def moved(self, cfg: Configuration, by: Array) -> Wish:
        """Return the wish without obstacles, its goal moved back by (3,) [m]."""
        if isinstance(self.goal, Joints):
            return self._replace(obstacles=())
        pose = goal_pose(cfg, self.goal)
        return self._replace(goal=pin.SE3(pose.rotation, pose.translation - by), obstacles=())


def problem_of(cfg: Configuration, wish: Wish, seed: int, search: SearchAccount) -> Problem:
    """Return the problem to be solved.

    Raises:
        NoSolutionError: No motion can solve it.
    """
    try:
        asked = wish.constraints
        target, ample = make_target(
            cfg, wish.goal, asked.clearance, wish.final_attitude, asked.limits
        )
        bodies = bodies_apart(cfg, target, wish.obstacles) if asked.collisions else None
    except NoSolutionError as error:
        raise NoSolutionError(str(error), best_attempt(cfg, error.best, ())) from None
    rates = asked.joint_rates(cfg.arm)
    return Problem(cfg, target, ample, rates, seed, search, bodies, wish.held, asked.keep_attitude)
