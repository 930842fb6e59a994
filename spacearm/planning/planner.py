"""Planner: tries the methods of planning from cheap to thorough, and keeps an account of them.

Papadopoulos & Dubowsky (1993) end on an open problem, "the efficient construction of paths to reach
points in the path dependent workspace". A motion counts as a solution only if it arrives when its
rows are replayed, with the clearance asked for.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import TYPE_CHECKING, NamedTuple

import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, positive, whole
from spacearm.collisions.obstacles import Obstacle, obstacles_of
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError, unknown
from spacearm.mechanics.momentum import momentum_vector
from spacearm.model.arguments import of_arm
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration, still_wheels
from spacearm.model.frames import PoseLike
from spacearm.motion.goal import Goal, Origin, goal_pose, started
from spacearm.motion.motion import Motion
from spacearm.planning.result import FAILED, IGNORED, Attempt, Joints, Plan
from spacearm.planning.search import Progress, Search, TimeUpError

if TYPE_CHECKING:
    from spacearm.planning.problem import Problem

AGAIN, SHORT = ("joint space", "tree", "cycles"), 1.0
"""Methods by which a plan with momentum begins, after others, and the least time for each [s]."""


@of_arm
def plan(
    arm: SpaceArm,
    q0: npt.ArrayLike,
    goal: Goal | Joints,
    *,
    base: PoseLike | None = None,
    origin: Origin = "spacecraft",
    clearance: float | None = None,
    final_attitude: npt.ArrayLike | pin.SE3 | float | None = None,
    limits: bool = True,
    collisions: bool = True,
    method: str = "auto",
    obstacles: Obstacle | Sequence[Obstacle | Configuration | Motion] = (),
    momentum: npt.ArrayLike | None = None,
    duration: float | None = None,
    seed: int = 0,
    timeout: float = 60.0,
    progress: Progress | None = None,
) -> Plan:
    """Find a joint motion that leads the tip of a floating arm to a goal, from rest to rest.

    With momentum the spacecraft drifts while the arm moves. Then plans at zero momentum, from an
    attitude turned by about the drift, and straight joint motions are bent until the tip arrives at
    a stated time; it does not stay there. The arm alone cannot detumble: joint torques are
    internal.

    Methods, in the order in which "auto" tries them: "straight", a line of the tip by J*; "tree",
    straight joint motions grown at random until one arrives, then shortened; "joint space", the
    shortest joint curve that arrives; "cycles", a closed loop in joint space that turns
    the spacecraft, run through as often as it takes, then a curve to the goal; "attitude first", a
    joint motion that turns the spacecraft to an attitude from which the line is free (Nanos &
    Papadopoulos, 2015).

    Args:
        arm: The arm.
        q0: (n,) joint positions at the start [rad] or [m].
        goal: A point in the task's linear rows [m], a pose, or `Joints`.
        base: Pose of the spacecraft at the start; the identity if None.
        origin: Where the inertial frame has its origin: "spacecraft", as `base` says, so that
            poses of `SpaceArm.at` are goals as they are; or "cm", the system CM at the start, as
            for points of a `Workspace`, `base` giving the attitude.
        clearance: How far from the singular set the motion stays at least [rad], to first order as
            in `singularity`, from 0 to 1; if None, 0.1 degrees, but no more than half of what the
            start has.
        final_attitude: (3, 3) attitude that the spacecraft shall have at the end, or a pose with
            it, or for planar arms an angle [rad].
        limits: Whether the joint limits hold.
        collisions: Whether the spacecraft and the links must not meet. Links count with their
            collision geometry, or their visuals where they have none; meshes as convex hulls.
            Bodies on both sides of one joint may touch. `Plan.checked` says what was checked.
        method: "auto", or one of the five.
        obstacles: What the spacecraft and the links must not meet besides, in the inertial frame,
            as `base` and poses as goals are: `Obstacle.box`, `.sphere`, `.cylinder`, `.mesh` and
            `.robot`, and configurations or motions of other robots. Those that move begin with the
            plan. That none is met is proven for the motion with the spacecraft turning as it does.
        momentum: (6,) constant momentum [linear [kg m/s]; angular about the system CM [N m s]],
            inertial axes; zero if None.
        duration: When the motion ends [s]; if None as soon as the velocity limits allow, with
            momentum about so.
        seed: Seed of the random first guesses; the same seed gives the same plan, if it is found
            in time.
        timeout: Time after which the search is given up [s]; that to compile the kernels, once,
            does not count. Until then it goes on with other first guesses.
        progress: Called now and then as progress(t, timeout), both in s.

    Returns:
        The motion, with the proof that it meets no singularity in `certificate`.

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The arm has several tips, fewer joints than its task has rows, wheels
            that hold momentum, or no shapes that obstacles could meet.
        NoSolutionError: No motion was found; says which constraint stopped most attempts and what
            to relax, and why every method failed, and carries the best attempt (the start alone,
            where there is no better).

    Example:
        >>> import spacearm as sa
        >>> plan = sa.plan(sa.load("planar2"), [0.3, 1.2], (0.9, 1.4))
        >>> plan.method, plan.certificate.free
        ('straight', True)
    """
    from spacearm.planning.drift.search import Drift, stretched  # slow to import, as all here
    from spacearm.planning.methods import METHODS

    if method not in ("auto", *METHODS):
        raise ConfigurationError(unknown("method", method, ("auto", *METHODS)))
    if not isinstance(timeout, Real) or not timeout > 0.0:
        raise ConfigurationError(f"timeout is {timeout!r}; give a positive time [s]")
    seed = whole(seed, "seed", 0)
    arm.require_one_tip()  # whose path the plan holds
    if arm.n < arm.task.k:
        raise UnsupportedError(
            f"{arm.name} has {arm.n} joints for {arm.task.k} task rows ({arm.task.names}) and can "
            f"never do this task; take one with {arm.n} rows"
        )
    around = obstacles_of(obstacles, arm)
    if around and not collisions:
        raise ConfigurationError("obstacles count as collisions do; leave out collisions=False")
    cfg, search = started(arm.at(q0, base=base), origin), Search(float(timeout), progress)
    still_wheels(cfg, "they would give it to the spacecraft that the planner turns")
    duration = None if duration is None else positive(duration, "duration", "time [s]")
    wish = Wish(goal, clearance, final_attitude, limits, collisions, method, around)
    if (h := momentum_vector(momentum)).any():
        return Drift(_Mission(cfg, wish, seed, search), cfg, h, duration, around).plan()
    found = _at_rest(cfg, wish, seed, search)
    return found if duration is None or len(found) == 1 else stretched(found, duration)


class Wish(NamedTuple):
    """What a plan shall be like, as in the arguments of `plan`."""

    goal: Goal | Joints
    clearance: float | None
    final_attitude: npt.ArrayLike | pin.SE3 | float | None
    limits: bool
    collisions: bool
    method: str
    obstacles: tuple[Obstacle, ...]

    def moved(self, cfg: Configuration, by: Array) -> Wish:
        """Return the wish without obstacles, its goal moved back by (3,) [m]."""
        if isinstance(self.goal, Joints):
            return self._replace(obstacles=())
        pose = goal_pose(cfg, self.goal)
        return self._replace(goal=pin.SE3(pose.rotation, pose.translation - by), obstacles=())


class _Mission(NamedTuple):
    """What a plan with momentum is made of, see `drift.search.Mission`."""

    cfg: Configuration
    wish: Wish
    seed: int
    search: Search

    def problem(self, moved: Array) -> Problem:
        """Return the problem if the system CM moves by (3,) [m] until the tip arrives."""
        return _problem(self.cfg, self.wish.moved(self.cfg, moved), self.seed, self.search)

    def still(self, start: Configuration, moved: Array, number: int) -> Plan:
        """Return a plan without momentum from another start; after two others of other methods."""
        wish = self.wish.moved(self.cfg, moved)
        if number % 2 == 0:  # about where they will be
            wish = wish._replace(obstacles=self.wish.obstacles)
        if wish.method == "auto" and number > 1:
            wish = wish._replace(method=AGAIN[number % len(AGAIN)])
        time = max((self.search.timeout - self.search.elapsed) / 3.0, SHORT)
        search = Search(time, lambda *_: self.check_time())
        return _at_rest(start, wish, self.seed + number, search)

    def check_time(self) -> None:
        """Raise a TimeUpError if the time is up."""
        self.search.check_time()


def _problem(cfg: Configuration, wish: Wish, seed: int, search: Search) -> Problem:
    """Return the problem to be solved.

    Raises:
        NoSolutionError: No motion can solve it.
    """
    from spacearm.planning.problem import Problem, bodies_apart
    from spacearm.planning.targets import make_target

    try:
        target, ample = make_target(
            cfg, wish.goal, wish.clearance, wish.final_attitude, wish.limits
        )
        bodies = bodies_apart(cfg, target, wish.obstacles) if wish.collisions else None
    except NoSolutionError as error:
        raise NoSolutionError(str(error), _best(cfg, error.best, ())) from None
    return Problem(cfg, target, ample, seed, search, bodies)


def _at_rest(cfg: Configuration, wish: Wish, seed: int, search: Search) -> Plan:
    """Return a plan at zero momentum.

    Raises:
        NoSolutionError: None was found; carries the best attempt.
    """
    from spacearm.planning.methods import METHODS

    problem = _problem(cfg, wish, seed, search)
    bodies = problem.collisions
    tried: dict[str, str] = {}
    order = list(METHODS)
    if wish.obstacles:
        order.sort(key=lambda name: name not in ("straight", "tree"))
    for name in _in_rounds(order, wish.method, search):
        try:
            rows = METHODS[name](problem)
        except TimeUpError as error:
            tried.setdefault(name, str(error))
            break
        except NoSolutionError as error:
            tried[name] = str(error)
            problem.best = error.best if isinstance(error.best, list) else problem.best
            continue
        except KeyboardInterrupt:
            tried[name] = "stopped by Ctrl-C"
            break
        checked = IGNORED if bodies is None else bodies.account
        apart = True if bodies is not None and bodies.bodies else None
        failed = [Attempt(name, False, story) for name, story in tried.items()]
        least = problem.target.clearance
        found = Plan.of_rows(name, rows, least, failed, checked, apart, wish.obstacles)
        story = f"{found.travel}, {found.nearest}"
        arrived = Attempt(name, True, "; ".join(filter(None, (story, problem.note))))
        return replace(found, tried=(*found.tried, arrived))
    failed = [Attempt(name, False, story) for name, story in tried.items()]
    raise NoSolutionError(_failure(problem, tried), _best(cfg, problem.best, failed))


def _in_rounds(methods: Collection[str], method: str, search: Search) -> Iterator[str]:
    """Yield the methods in order; again and again those that begin with random guesses."""
    yield from methods if method == "auto" else (method,)
    again = [name for name in methods if name != "straight" and method in ("auto", name)]
    while again:
        search.rounds += 1
        yield from again


def _failure(problem: Problem, tried: Mapping[str, str]) -> str:
    """Return the message of a search without a plan."""
    search = problem.search
    rounds = f"{search.rounds + 1} rounds" if search.rounds else "1 round"
    stories = "; ".join(f"{name}: {story}" for name, story in tried.items())
    parts = (f"no plan found in {search.elapsed:.1f} s, {rounds}", search.verdict, stories)
    return f"{problem.start.arm.name}: {'. '.join(filter(None, parts))}"


def _best(cfg: Configuration, rows: object, tried: Sequence[Attempt]) -> Plan:
    """Return the best attempt: rows that do not solve the problem, or the start alone."""
    best = rows if isinstance(rows, list) else [cfg]
    return Plan.of_rows("best attempt", best, 0.0, tried, FAILED, None)
