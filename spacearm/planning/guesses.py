"""First guesses for the optimiser of `joint_space`, the best of thousands tried at once.

A guess is a curve of `curve`, or a closed loop run through some number of times and then a straight
line; it arrives, within the limits and clear of singularities, or nearly so. Where the attitude at
the end is free it follows from the curve, and the joints at its end are found for it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array
from spacearm.mechanics.floating import GAUSS
from spacearm.model.configuration import Configuration
from spacearm.motion.goal import goal_axes
from spacearm.planning.curve import sines
from spacearm.planning.free_space import FreeSpace
from spacearm.planning.many_curves import landed, turning_axes, turns
from spacearm.planning.optimiser import Task

Mask: TypeAlias = npt.NDArray[np.bool_]
Indices: TypeAlias = npt.NDArray[np.int64]

FEW, MANY = 600, 2000
"""Curves, and loops, that are tried at once."""
LOOPS = (1, 2, 3, 4, 6, 8, 12)
"""How many times a loop is run through."""
WORDS = 8
"""For each end that many turns of loops are looked at, those nearest to what is needed."""
BROAD, SPREAD, GENERATIONS = 300, 0.2, 4
"""Of the loops those that turn the spacecraft most are made larger, at random, again and again."""
SAMPLE = 20
"""Loops by which a place for loops is judged."""
NEAR = 0.4
"""How far from the turn that is needed that of some loops may be [rad]."""
CLOSE = 1e-4
"""How near the goal the tip has to come [m], [rad]."""
INTERVALS, POINTS = 16, 65
LANDING, SHOOTING = 25, 12
"""Newton steps with the attitude held, and with the attitude that follows."""


@dataclass(frozen=True, eq=False)
class Guess:
    """A curve to start from.

    Attributes:
        x: The unknowns of `Steering`.
        loops: How many times its loop is run through.
        room: Least sigma_min on it.
    """

    x: Array
    loops: int
    room: float


class Loops(NamedTuple):
    """Loops that may be run through.

    Attributes:
        C: (K, waves, n) their sines.
        room: (K,) least sigma_min on each.
        turn: (K, 3) rotation vectors by which each turns the spacecraft [rad].
    """

    C: Array
    room: Array
    turn: Array

    def broadest(self, m: int) -> Array:
        """(<= m, waves, n) sines of those that turn it most."""
        return self.C[np.argsort(-np.linalg.norm(self.turn, axis=1))[:m]]


class Search:
    """Guesses for motions from one configuration.

    Args:
        start: Where they begin.
        task: What they must achieve.
        waves: Number of sines of curve and loop.
        rng: The source of all that is random.
    """

    def __init__(
        self, start: Configuration, task: Task, waves: int, rng: np.random.Generator
    ) -> None:
        self.start, self.task, self.waves, self.rng = start, task, waves, rng
        self.arm, self.T0, self.com = start.arm, start.base.rotation, start.com
        self.axes = goal_axes(start)
        self.free = FreeSpace(self.arm, start.q, task.lower, task.upper)
        s = np.add.outer(np.arange(INTERVALS), GAUSS).ravel() / INTERVALS
        self._basis, self._slope = sines(np.append(s, 1.0), waves)
        self._along, _ = sines(np.linspace(0.0, 1.0, POINTS), waves)

    def direct(self, width: float) -> Iterator[Guess]:
        """Curves that arrive: the free ones, the shorter the earlier, then others.

        Args:
            width: How far they go about [rad], [m], and how far the spacecraft may turn [rad].
        """
        _, ends = self._ends(width, FEW)
        ends = np.resize(ends, (FEW if len(ends) else 0, self.arm.n))
        P = width * _closed(self._sines(len(ends)))
        P[1::4] = 0.0  # straight lines too
        P[:, 0] = ends - self.start.q
        if self.task.q is None:
            P[:, 0] += self.free.windings(width, len(ends), self.rng)
        P, near = self._arriving(P, np.broadcast_to(np.eye(3), (len(P), 3, 3)))
        room, travel = self.free.room(self._points(P)), _travel(self._points(P))
        clear = room > self.task.clearance
        for i in (*_shortest(travel, near & clear), *np.flatnonzero(near & ~clear)):
            yield Guess(self._unknowns(P[i]), 0, room[i])

    def looped(self) -> Iterator[Guess]:
        """Loops and straight lines that arrive, free, the shorter the earlier."""
        task, loops = self.task, self._loops()
        T, ends = self._ends(np.pi, MANY)
        P: Array = np.zeros((len(ends), self.waves + 1, self.arm.n))
        P[:, 0] = ends - self.start.q
        clear = self.free.room(self._points(P)) > task.clearance
        P, T = P[clear], T[clear]
        if len(loops.C) == 0 or len(P) == 0 or (task.tip is None and task.attitude is None):
            return
        needed = Rotation.from_matrix(self.T0.T @ T @ np.swapaxes(self._turns(P), 1, 2))
        end, loop, times = _matches(loops, needed)
        travel = times * _travel(self._points(_closed(loops.C)))[loop]
        travel += _travel(self._points(P))[end]
        best = np.argsort(travel, kind="stable")[:MANY]
        end, loop, times, travel = end[best], loop[best], times[best], travel[best]
        W = Rotation.from_rotvec(times[:, None] * loops.turn[loop]).as_matrix()
        P, near = self._arriving(P[end], W)
        room = np.minimum(self.free.room(self._points(P)), loops.room[loop])
        for i in _shortest(travel, near & (room > task.clearance)):
            yield Guess(self._unknowns(P[i], loops.C[loop[i]]), int(times[i]), room[i])

    def points(self, guess: Guess) -> Array:
        """(m, n) points along a guess, its loop once."""
        P = guess.x.reshape(-1, self.arm.n)
        curve, C = P[: self.waves + 1].copy(), P[self.waves + 1 :]
        curve[0] -= self.start.q
        loop = self._points(_closed(C[None]))[0] if guess.loops else curve[:0]
        return np.concatenate((loop, self._points(curve[None])[0]))

    def hubs(self, m: int) -> Array:
        """(<= m, n) places where loops turn the spacecraft far, the way there straight."""
        Q = self.free.draw(MANY, self.rng)
        way = self.start.q + np.linspace(0.0, 1.0, POINTS)[:, None] * (Q - self.start.q)[:, None]
        Q = Q[self.free.room(way) > self.task.clearance]
        Q = Q[np.argsort(-self.free.room(Q[:, None]))[: MANY // SAMPLE]]
        if len(Q) == 0:
            return Q
        places, P = np.repeat(Q, SAMPLE, axis=0)[:, None], _closed(self._sines(SAMPLE * len(Q)))
        clear = self.free.room(places + self._along @ P) > self.task.clearance
        turn = np.zeros(len(P))
        turn[clear] = _angles(self._turns(P[clear], places[clear]))
        return Q[np.argsort(-turn.reshape(-1, SAMPLE).max(axis=1))[:m]]

    def _ends(self, width: float, m: int) -> tuple[Array, Array]:
        """Attitudes (<= m, 3, 3) and joint positions (<= m, n) at the goal."""
        task, axes = self.task, np.zeros(3)
        axes[list(turning_axes(self.arm))] = 1.0
        turned = Rotation.from_rotvec(width * self.rng.normal(size=(m, 3)) * axes).as_matrix()
        T = self.T0 @ turned if task.attitude is None else np.resize(task.attitude, (m, 3, 3))
        if task.tip is None:
            return T[:1], np.array([task.q])
        tip = pin.SE3(task.tip.rotation, task.tip.translation - self.com)
        Q, miss = landed(self.arm, self.free.draw(m, self.rng), tip, T, self.axes, LANDING)
        Q = self.free.wrapped(Q)
        good = (miss < CLOSE) & (self.free.room(Q[:, None]) > task.clearance)
        return T[good], Q[good]

    def _arriving(self, P: Array, W: Array) -> tuple[Array, Mask]:
        """Curves after turns W (K, 3, 3), their ends moved to the goal; whether they come near."""
        task = self.task
        if task.attitude is not None:
            return P, _angles(task.attitude.T @ self.T0 @ W @ self._turns(P)) < NEAR
        if task.tip is None or len(P) == 0:
            return P, np.ones(len(P), dtype=bool)

        def attitude(Q: Array) -> Array:
            P[:, 0] = Q - self.start.q
            return self.T0 @ W @ self._turns(P)

        tip = pin.SE3(task.tip.rotation, task.tip.translation - self.com)
        _, miss = landed(self.arm, self.start.q + P[:, 0], tip, attitude, self.axes, SHOOTING)
        return P, miss < CLOSE

    def _loops(self) -> Loops:
        """Free loops, the broad ones made broader again and again."""
        found = self._free_loops(self.rng.uniform(0.2, 2.0, (MANY, 1, 1)) * self._sines(MANY))
        for _ in range(GENERATIONS if len(found.C) else 0):
            C = np.resize(found.broadest(BROAD), (MANY, self.waves, self.arm.n))
            C = C * self.rng.uniform(0.9, 1.3, (MANY, 1, 1))
            more = self._free_loops(C + SPREAD * self.rng.normal(size=C.shape))
            found = Loops(*(np.concatenate(pair) for pair in zip(found, more, strict=True)))
        return found

    def _free_loops(self, C: Array) -> Loops:
        """Those of sines C (K, waves, n) that are free."""
        P = _closed(C)
        room = self.free.room(self._points(P))
        free = room > self.task.clearance
        turn = Rotation.from_matrix(self._turns(P[free])).as_rotvec()
        return Loops(C[free], room[free], turn)

    def _sines(self, m: int) -> Array:
        """(m, waves, n) random sines, the shorter waves the smaller."""
        C: Array = self.rng.normal(size=(m, self.waves, self.arm.n))
        return C / np.arange(1.0, self.waves + 1.0)[:, None]

    def _points(self, P: Array) -> Array:
        """(K, POINTS, n) points on curves, P (K, waves + 1, n) from the start."""
        return self.start.q + self._along @ P

    def _turns(self, P: Array, places: Array | None = None) -> Array:
        """(K, 3, 3) how far they turn the spacecraft; from other places (K, 1, n) if given."""
        places = self.start.q if places is None else places
        return turns(self.arm, places + self._basis[:-1] @ P, self._slope @ P)

    def _unknowns(self, P: Array, C: Array | None = None) -> Array:
        """Those of `Steering`."""
        curve = P.copy()
        curve[0] += self.start.q
        return np.concatenate((curve.ravel(), np.empty(0) if C is None else C.ravel()))


def _matches(loops: Loops, needed: Rotation) -> tuple[Indices, Indices, Indices]:
    """Turns that are needed, loops that make them nearly, and how many times those do so.

    Unit quaternions are as far apart as 2 sin(angle / 4).
    """
    wound = Rotation.concatenate([Rotation.from_rotvec(k * loops.turn) for k in LOOPS])
    tree = cKDTree(np.concatenate((wound.as_quat(), -wound.as_quat())))
    some = np.arange(1, min(WORDS, len(wound)) + 1)
    chord, word = (np.asarray(x) for x in tree.query(needed.as_quat(), k=some))
    which, rank = np.nonzero(chord < 2.0 * np.sin(NEAR / 4.0))
    times, loop = np.divmod(word[which, rank] % len(wound), len(loops.C))
    return which, loop, np.array(LOOPS)[times]


def _angles(R: Array) -> Array:
    """(K,) angles of rotations (K, 3, 3) [rad]."""
    return np.asarray(Rotation.from_matrix(R).magnitude())


def _closed(C: Array) -> Array:
    """(K, waves + 1, n) closed curves of sines C (K, waves, n)."""
    return np.concatenate((np.zeros_like(C[:, :1]), C), axis=1)


def _travel(points: Array) -> Array:
    """(K,) the sum over all joints."""
    return np.abs(np.diff(points, axis=1)).sum(axis=(1, 2))


def _shortest(travel: Array, good: Mask) -> Indices:
    """Those that are good, the shortest first."""
    order: Indices = np.argsort(travel, kind="stable")
    return order[good[order]]
