"""Bodies: motions with momentum beside obstacles, which are met at their own times."""

from __future__ import annotations

from dataclasses import replace

from spacearm.collisions.courses import Recorded
from spacearm.collisions.obstacles import Obstacle
from spacearm.collisions.separation import Collisions
from spacearm.errors import NoSolutionError
from spacearm.planning.problem import Problem
from spacearm.planning.result import IGNORED, Plan


def kept_apart(found: Plan, problem: Problem, obstacles: tuple[Obstacle, ...]) -> Plan:
    """Return a plan that `problem` has checked, which says what of its bodies was checked.

    Args:
        found: The plan, with its times.
        problem: The problem, which knows the bodies of the arm.
        obstacles: What must not be met.

    Raises:
        NoSolutionError: It meets an obstacle.
    """
    bodies = problem.collisions
    if obstacles:
        bodies = Collisions(found.arm, obstacles)
        if (contact := bodies.contact(Recorded(found), problem.search.check_time)) is not None:
            raise NoSolutionError(str(contact))
    return replace(
        found,
        checked=IGNORED if bodies is None else bodies.account,
        apart=True if bodies is not None and bodies.bodies else None,
    )
