"""Resolved motion: tips led along straight lines together, while the spacecraft keeps its attitude.

The rows of all tasks are stacked, J* of each tip and -D^-1 D_q of the spacecraft where its attitude
is kept: Yoshida, Kurazume & Umetani, Dual arm coordination in space free-flying robot, Proc. IEEE
Int. Conf. Robot. Autom. (1991), 2516-2521. Each row of the motion is corrected by Newton's method
until it lies on the lines, its attitude integrated as `move` does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.mechanics.floating import move, placed
from spacearm.mechanics.jacobian import base_response, generalized_jacobian, turning_axes
from spacearm.model.arm import Configuration
from spacearm.motion.goal import goal_rows, twist_between
from spacearm.planning.problem import Problem, Rows

#: Residual of a row [m], [rad].
ON_THE_LINE = 1e-10
#: Joint motion from row to row, at most and aimed at, and the shortest share of the line tried.
LARGE, SMALL, SHORTEST = 0.03, 0.015, 1e-6
#: Share of its range that a joint has at least before its limit, for the weights.
LEAST_ROOM = 1e-3
#: Newton steps to a row.
CORRECTIONS = 8


class Aim(NamedTuple):
    """A tip and where it is to go.

    Attributes:
        start: Configuration at the start, of an arm with this tip alone.
        goal: Pose of the tip at the end.
    """

    start: Configuration
    goal: pin.SE3


class Bias(NamedTuple):
    """What makes a motion another one than that of least joint motion.

    Attributes:
        aside: (n,) joint motion that is added along the way where it changes no task.
        ease: (n,) how easily each joint moves.
        firm: How many radians of joint motion one radian of turn of the spacecraft is worth: none,
            or so many, or infinitely many, so that it keeps its attitude.
    """

    aside: Array
    ease: Array
    firm: float


@dataclass(frozen=True)
class Resolved:
    """Tips led to their goals together.

    Attributes:
        aims: The tips; their arms have the same joints.
        limits: (n,) least and largest joint positions.
    """

    aims: Sequence[Aim]
    limits: tuple[Array, Array]

    @property
    def start(self) -> Configuration:
        """Configuration in which the motion begins, of the arm of the first tip."""
        return self.aims[0].start

    def rows(self, q: Array, T: Array, share: float) -> tuple[Array, Array]:
        """Return what is missing at a share of the lines (r,), and the Jacobian of that (r, n).

        Args:
            q: (n,) joint positions.
            T: (3, 3) attitude of the spacecraft.
            share: How far along their lines the tips are to be.
        """
        left, slopes = [], []
        for start, goal in self.aims:
            cfg, way = placed(start, q, T), twist_between(start.tip, goal)
            here = pin.SE3(
                pin.exp3(share * way[3:]) @ start.tip.rotation,
                start.tip.translation + share * way[:3],
            )
            left.append(goal_rows(cfg, twist_between(cfg.tip, here)))
            slopes.append(goal_rows(cfg, generalized_jacobian(cfg)))
        return np.concatenate(left), np.vstack(slopes)

    def turned(self, q: Array, T: Array) -> tuple[Array, Array]:
        """Return the turn back to the attitude of the start (r,), and the Jacobian (r, n) of turns.

        Args:
            q: (n,) joint positions.
            T: (3, 3) attitude of the spacecraft.
        """
        axes = list(turning_axes(self.start.arm))
        back = pin.log3(T.T @ self.start.base.rotation)[axes]
        return back, -base_response(placed(self.start, q, T).A)[3:][axes]

    def led(self, bias: Bias, stopped: Callable[[Array], str]) -> list[Configuration]:
        """Return the rows of a motion, configurations of the arm of the first tip.

        Args:
            bias: What makes the motion another one than that of least joint motion.
            stopped: Called with the joint positions (n,) of every row; says why the motion cannot
                go on from there, or nothing. It may raise an error to end the search.

        Raises:
            NoSolutionError: The tasks are singular together, or the motion is stopped; carries it
                as far as it goes.
        """
        rows, share, step = [self.start], 0.0, 0.02
        while share < 1.0:
            if why := stopped(rows[-1].q):
                raise NoSolutionError(f"{why} after {100.0 * share:.3g} % of the line", rows)
            to = min(share + step, 1.0)
            there = self._next(rows[-1], to, bias._replace(aside=(to - share) * bias.aside))
            if there is None:
                step /= 2.0
                if step < SHORTEST:
                    raise NoSolutionError(
                        f"the tasks of tips and spacecraft are singular together after "
                        f"{100.0 * share:.3g} % of the line, at "
                        f"q = {rows[-1].arm.in_words(rows[-1].q)}",
                        rows,
                    )
                continue
            step *= min(2.0, SMALL / max(np.abs(there.q - rows[-1].q).max(), 1e-12))
            share = to
            rows.append(there)
        return rows

    def _next(self, here: Configuration, share: float, bias: Bias) -> Configuration | None:
        """Return the row at a share of the lines; None where it is too far or cannot be reached."""
        firm, exact = bias.firm, np.isinf(bias.firm)
        ease, aside = bias.ease * self._ease(here.q), bias.aside
        left, J = self._hard(here, share, exact)
        inverse = np.linalg.pinv(J * ease)
        way = inverse @ left + aside - inverse @ (J @ (ease * aside))
        if firm > 0.0 and not exact:
            _, A = self.turned(here.q, here.base.rotation)
            free = (np.eye(len(way)) - inverse @ (J * ease)) @ np.linalg.svd(J)[2][len(J) :].T
            turns = firm * (A * ease)
            both = np.vstack((free, turns @ free))
            way = way - free @ np.linalg.lstsq(both, np.append(0.0 * way, turns @ way))[0]
        q = here.q + ease * way
        for _ in range(CORRECTIONS):
            if np.abs(q - here.q).max() > LARGE:
                return None
            there = move(here, q)
            left, J = self._hard(there, share, exact)
            if np.abs(left).max() <= ON_THE_LINE:
                return there
            q = q + ease * np.linalg.lstsq(J * ease, left)[0]
        return None

    def _hard(self, cfg: Configuration, share: float, exact: bool) -> tuple[Array, Array]:
        """Return what a row must do without, and its Jacobian: the lines, the attitude too."""
        left, J = self.rows(cfg.q, cfg.base.rotation, share)
        if not exact:
            return left, J
        back, A = self.turned(cfg.q, cfg.base.rotation)
        return np.concatenate((left, back)), np.vstack((J, A))

    def _ease(self, q: Array) -> Array:
        """Return how easily each joint moves (n,): joints near their limits are left to others.

        The weighted least norm of Chan & Dubey, IEEE Trans. Robot. Autom. 11(2), 286-292 (1995).
        """
        lower, upper = self.limits
        span = np.where(np.isfinite(upper - lower), upper - lower, 1.0)
        with np.errstate(invalid="ignore"):
            up, down = (np.clip(gap / span, LEAST_ROOM, 1.0) for gap in (upper - q, q - lower))
        slope = np.abs(up - down) / (4.0 * (up * down) ** 2)
        return np.where(np.isfinite(upper - lower), 1.0 / np.sqrt(1.0 + slope), 1.0)


#: How firmly the attitude is kept, in turn; see `Bias`.
FIRM = (np.inf, 1000.0, 500.0, 200.0, 100.0, 50.0, 20.0, 5.0)
#: Ways tried in a round.
TRIES = 24
#: Size of the joint motions aside [rad], and of the logarithm of how easily each joint moves.
ASIDE, EASE = 1.0, 1.0


def reactionless(problem: Problem) -> Rows:
    """Lead the tip straight to its goal by joint motions that do not turn the spacecraft.

    The first is that of least joint motion; others go aside where they can.

    Raises:
        NoSolutionError: None of the ways tried solves the problem.
    """
    arm, tip = problem.start.arm, problem.target.tip
    if tip is None:
        raise NoSolutionError("the goal is not a place of the tip")
    turns = len(turning_axes(arm))
    if arm.n < arm.task.k + turns:
        raise NoSolutionError(
            f"{arm.n} joints cannot do {arm.task.k} task rows and hold {turns} of the attitude; "
            "let the joints of another arm count too (joints='all'), or hold the attitude by "
            "wheels (mode='attitude-controlled')"
        )
    rng = problem.rng
    limits = problem.target.lower, problem.target.upper
    together, why = Resolved((Aim(problem.start, tip),), limits), ""
    turned: float = problem.account.ways["turn"]
    for i in range(TRIES):
        aside, ease = rng.normal(size=(2, arm.n))
        if i < len(FIRM) and problem.account.rounds == 0:
            aside, ease = np.zeros((2, arm.n))
        bias = Bias(ASIDE * aside, np.exp(EASE * ease), FIRM[i % len(FIRM)])
        try:
            return problem.check(together.led(bias, problem.stopped))
        except NoSolutionError as error:
            if isinstance(error.best, Sequence):
                problem.best = error.best
            if problem.account.ways["turn"] > turned or not why:
                why, turned = str(error), np.inf  # the firmest that arrives
    raise NoSolutionError(why, problem.best)
