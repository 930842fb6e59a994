"""Together: several tips led to their goals at once.

The tips follow straight lines if the stacked J* allows. Else the joints move along curves
q_0 + s (q_1 - q_0) + sin(pi s) c with a random c, whose end is moved by Newton's method until all
tips arrive with the attitude that the whole curve makes.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.mechanics.floating import attitudes, walk
from spacearm.model.arm import Configuration
from spacearm.motion.goal import Goal, goal_pose, out_of_reach
from spacearm.planning.account import SearchAccount, TimeUpError
from spacearm.planning.optimiser import ARRIVED, SPACING, Target
from spacearm.planning.problem import Problem, Rows, bodies_apart, travel
from spacearm.planning.result import IGNORED, Attempt, Plan, best_attempt
from spacearm.planning.rounds.wish import Wish
from spacearm.planning.targets import bounds_of, clearance_of
from spacearm.planning.tips.resolved import Aim, Bias, Resolved

WIDTHS = (0.5, 1.0, 2.0, 3.0)
"""Sizes of the first guesses of joint motions [rad], [m], one after the other."""
BENT = 0.5
"""Size of the curves' sines over that of the motions; every second one is straight."""
STEPS, LONGEST = 30, 0.5
"""Newton steps to the end of a curve, at most, and the longest of them [rad], [m]."""
COARSE = 40
"""Rows of a curve while its end is sought."""
FIRST, NEXT = 20, 60
"""Curves tried in the first round, and in each after it."""


def together(
    cfg: Configuration, goals: Mapping[str, Goal], wish: Wish, seed: int, search: SearchAccount
) -> Plan:
    """Return a plan at zero momentum that leads several tips to their goals.

    Args:
        cfg: Where it begins.
        goals: A goal for each tip, by name.
        wish: What else the plan shall be like.
        seed: Of the first guesses.
        search: The time it may take, and its account.

    Raises:
        NoSolutionError: None was found; carries the best attempt.
        StoppedError: Ctrl-C; carries the best attempt.
    """
    arm, aims = cfg.arm, []
    lower, upper = bounds_of(cfg, wish.constraints.limits)
    for name, goal in goals.items():
        one = arm.replace(tip=name, joints=arm.joint_names)
        start = one.at(cfg.q, base=cfg.base).centred(cfg.com)
        pose = goal_pose(start, goal)
        if far := out_of_reach(start, pose):
            raise NoSolutionError(f"{name}: {far}", best_attempt(cfg, None, ()))
        aims.append(Aim(start, pose))
    least, ample = clearance_of(cfg, wish.constraints.clearance)
    target = Target(None, None, None, least, lower, upper)
    bodies = bodies_apart(cfg, target, wish.obstacles) if wish.constraints.collisions else None
    rates, keep = wish.constraints.joint_rates(arm), wish.constraints.keep_attitude
    problem = Problem(cfg, target, ample, rates, seed, search, bodies, wish.held, keep)
    resolved = Resolved(aims, (lower, upper))
    methods: dict[str, Callable[[Problem, Resolved], Rows]] = {
        "straight": _straight, "joint space": _joint_space
    }  # fmt: skip
    tried: list[Attempt] = []
    checked = IGNORED if bodies is None else bodies.account
    apart = True if bodies is not None and bodies.bodies else None
    rounds = (name for name in itertools.chain(methods, itertools.repeat("joint space")))
    for name in rounds:
        if wish.method not in ("auto", name):
            continue
        try:
            rows = methods[name](problem, resolved)
        except TimeUpError:
            break
        except KeyboardInterrupt:
            search.end()
            break
        except NoSolutionError as error:
            problem.best = error.best if isinstance(error.best, list) else problem.best
            tried = [one for one in tried if one.method != name]
            tried.append(Attempt(name, False, str(error)))
            if wish.method == "straight":
                break
            search.rounds += name == "joint space"
            continue
        found = Plan.of_rows(name, rows, least, rates, tried, checked, apart, wish.obstacles)
        story = "; ".join(filter(None, (found.travel, problem.note)))
        return replace(found, tried=(*tried, Attempt(name, True, story)))
    stories = "; ".join(f"{one.method}: {one.story}" for one in tried)
    parts = (f"no plan found in {search.elapsed:.1f} s", search.verdict, stories)
    raise search.failure(
        f"{arm.name}: {'. '.join(filter(None, parts))}", best_attempt(cfg, problem.best, tried)
    )


def _straight(problem: Problem, resolved: Resolved) -> Rows:
    """Lead the tips along straight lines."""
    n = problem.start.arm.n
    firm = np.inf if problem.keep is not None else 0.0
    led = resolved.led(Bias(np.zeros(n), np.ones(n), firm), problem.stopped)
    return problem.check(walk(problem.start, np.array([cfg.q for cfg in led])))


def _joint_space(problem: Problem, resolved: Resolved) -> Rows:
    """Move the joints along a curve, the shortest of those that a round finds."""
    rng = np.random.default_rng((problem.seed, problem.search.rounds))
    found: list[Rows] = []
    why = "no curve was found that leads all tips to their goals"
    for i in range(NEXT if problem.search.rounds else FIRST):
        width = WIDTHS[i % len(WIDTHS)]
        guess, bend = rng.normal(scale=width, size=(2, problem.start.arm.n))
        curve = _landed(problem, resolved, guess, BENT * bend * (i // len(WIDTHS) % 2))
        problem.search.postures["tried"] += 1
        if curve is None:
            continue
        problem.search.postures["reached"] += 1
        if ((curve > problem.target.upper) | (curve < problem.target.lower)).any():
            problem.search.postures["limits"] += 1
            continue
        if problem.collisions is not None and problem.collisions.touch(curve[-1]):
            problem.search.postures["contact"] += 1
            continue
        problem.search.postures["usable"] += 1
        try:
            found.append(problem.check(walk(problem.start, curve)))
        except TimeUpError:
            raise
        except NoSolutionError as error:
            why = str(error)
    if not found:
        raise NoSolutionError(why, problem.best)
    return min(found, key=travel)


def _landed(problem: Problem, resolved: Resolved, way: Array, bend: Array) -> Array | None:
    """Return the rows (m, n) of a curve that arrives; None if there is none nearby.

    Args:
        problem: The problem.
        resolved: The tips and their goals.
        way: (n,) the first guess of the joint motion.
        bend: (n,) coefficients of the sine.
    """
    start = problem.start
    end = np.clip(start.q + way, problem.target.lower, problem.target.upper)
    length = np.abs(np.diff(_curve(start.q, end, bend, COARSE), axis=0)).sum()
    for _ in range(STEPS):
        problem.search.check_time()
        curve = _curve(start.q, end, bend, max(COARSE, math.ceil(length / SPACING)))
        left, J = resolved.rows(end, attitudes(resolved.start, curve)[-1], 1.0)
        if np.abs(left).max() <= ARRIVED:
            return curve
        step = np.linalg.lstsq(J, left)[0]
        end = end + step * min(1.0, LONGEST / np.abs(step).max())
    return None


def _curve(start: Array, end: Array, bend: Array, m: int) -> Array:
    """Return the rows (m + 1, n) of a curve."""
    s = np.linspace(0.0, 1.0, m + 1)[:, None]
    return start + s * (end - start) + np.sin(np.pi * s) * bend
