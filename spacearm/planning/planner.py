"""Planner: tries the methods of planning from cheap to thorough, and keeps an account of them.

Papadopoulos & Dubowsky (1993) end on an open problem, "the efficient construction of paths to reach
points in the path dependent workspace". A motion counts as a solution only if it arrives when its
rows are replayed, with the clearance asked for.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import TYPE_CHECKING

import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import whole
from spacearm.collisions.obstacles import Obstacle, obstacles_of
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError, unknown
from spacearm.mechanics.momentum import momentum_vector
from spacearm.model.arguments import of_arm
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.model.frames import PoseLike
from spacearm.motion.goal import Goal, Origin, started
from spacearm.motion.motion import Motion
from spacearm.planning.result import Attempt, Joints, Plan
from spacearm.planning.search import Progress, Search, TimeUpError

if TYPE_CHECKING:
    from spacearm.planning.problem import Problem

IGNORED = "collisions NOT checked (collisions=False)"
FAILED = "collisions NOT checked of this attempt"


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
    momentum: npt.ArrayLike | None = None,
    limits: bool = True,
    collisions: bool = True,
    method: str = "auto",
    obstacles: Obstacle | Sequence[Obstacle | Configuration | Motion] = (),
    seed: int = 0,
    timeout: float = 60.0,
    progress: Progress | None = None,
) -> Plan:
    """Find a joint motion that leads the tip of a floating arm to a goal, from rest to rest.

    The momentum is zero. With another momentum the spacecraft drifts while the arm moves, and the
    tip misses the goal: detumble first, or plan again at the end. The arm alone cannot detumble:
    joint torques are internal.

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
        momentum: (6,) momentum on board [linear; angular about the system CM], zero if None. With
            any other there is no motion that ends at rest, and the error says what there is.
        limits: Whether the joint limits hold.
        collisions: Whether the spacecraft and the links must not meet. Links count with their
            collision geometry, or their visuals where they have none; meshes as convex hulls.
            Bodies on both sides of one joint may touch. `Plan.checked` says what was checked.
        method: "auto", or one of the five.
        obstacles: What the spacecraft and the links must not meet besides, in the inertial frame,
            as `base` and poses as goals are: `Obstacle.box`, `.sphere`, `.cylinder`, `.mesh` and
            `.robot`, and configurations or motions of other robots. Those that move begin with the
            plan. That none is met is proven for the motion with the spacecraft turning as it does.
        seed: Seed of the random first guesses; the same seed gives the same plan, if it is found
            in time.
        timeout: Time after which the search is given up [s]; that to compile the kernels, once,
            does not count. Until then it goes on with other first guesses.
        progress: Called now and then as progress(t, timeout), both in s.

    Returns:
        The motion, with the proof that it meets no singularity in `certificate`.

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The arm has several tips, fewer joints than its task has rows, momentum
            on board, or no shapes that obstacles could meet.
        NoSolutionError: No motion was found; says which constraint stopped most attempts and what
            to relax, and why every method failed, and carries the best attempt (the start alone,
            where there is no better).

    Example:
        >>> import spacearm as sa
        >>> plan = sa.plan(sa.load("planar2"), [0.3, 1.2], (0.9, 1.4))
        >>> plan.method, plan.certificate.free
        ('straight', True)
    """
    from spacearm.planning.methods import METHODS  # slow to import, as is all behind it
    from spacearm.planning.problem import Problem, bodies_apart
    from spacearm.planning.targets import make_target

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
    if (h := momentum_vector(momentum)).any():
        raise UnsupportedError(
            f"momentum is {h.tolist()}: the arm cannot take it away, for joint torques are "
            "internal, and no motion with it ends at rest; wheels can (sa.simulate with "
            "wheels=sa.WheelHold(...)), or thrusters; sa.momentum_budget(cfg, momentum) says how "
            "long the arm can carry it, or hold its tip"
        )
    around = obstacles_of(obstacles, arm)
    if around and not collisions:
        raise ConfigurationError("obstacles count as collisions do; leave out collisions=False")
    cfg, search = started(arm.at(q0, base=base), origin), Search(float(timeout), progress)
    try:
        target, ample = make_target(cfg, goal, clearance, final_attitude, limits)
        bodies = bodies_apart(cfg, target, around) if collisions else None
    except NoSolutionError as error:
        raise NoSolutionError(str(error), _best(cfg, error.best, ())) from None
    problem = Problem(cfg, target, ample, seed, search, bodies)
    tried: dict[str, str] = {}
    order = list(METHODS)
    if around:
        order.sort(key=lambda name: name not in ("straight", "tree"))
    for name in _in_rounds(order, method, search):
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
        found = Plan.of_rows(name, rows, target.clearance, failed, checked, apart, around)
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
