"""First guesses for the optimiser, the best of thousands that are tried at once.

A guess is a curve of a `CurveFamily`, or a closed loop run through some number of times and then a
straight line. It arrives, within the limits and clear of singularities, or nearly so. Where the
attitude at the end is free, it follows from the curve, and inverse kinematics finds the end. Loops
turn the spacecraft, each run through as often as the turn that is needed takes.

det J* of a square task changes its sign at a singularity, and no motion may cross one: only
configurations with the sign of the start are free.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array, Booleans, Integers
from spacearm.collisions.separation import Collisions
from spacearm.mechanics.batch import evaluate
from spacearm.mechanics.jacobian import turning_axes
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.joints import joint_scales
from spacearm.motion.goal import goal_axes
from spacearm.planning.account import SearchAccount
from spacearm.planning.many_curves import Turns, inverse_kinematics, spacecraft_turns
from spacearm.planning.optimiser import FAR, CurveFamily, Shape, Sines, Target, sides

#: Number of loops that are tried at once.
MANY = 2000
#: Loops that are made larger at random, those that turn the spacecraft most; by how much at most
#: [rad] or [m]; how often.
BROAD, SPREAD, GENERATIONS = 300, 0.2, 4
#: Loops that are tried at a place, to compare places.
SAMPLE = 20
#: Largest distance of the tip from its goal [m], [rad].
CLOSE = 1e-4
#: One in so many of these points is looked at for contacts.
LOOKED_AT = 8
#: Steps of the integration along a curve; shares of it at which the distance is evaluated.
INTERVALS, ALONG = 16, np.linspace(0.0, 1.0, 65)
#: Curves whose turns are computed between two looks at the clock.
TOGETHER = 300
#: Newton steps with the attitude held, and with the attitude that follows from the curve.
HELD_STEPS, TURNING_STEPS = 25, 12


#: Numbers of times that a loop is run through.
LOOPS = (1, 2, 3, 4, 6, 8, 12)
#: Numbers of turns by loops that are considered for each end, nearest to the one needed.
WORDS = 8
#: Largest angle between the turn by loops and the turn that is needed [rad].
NEAR = 0.4
#: In place of the distance, for curves beyond the limits or on the other side of a singularity.
BEYOND, ACROSS = -2.0, -1.0
#: Configurations that are evaluated between two looks at the clock.
BLOCK = 8_000


@dataclass(frozen=True, eq=False)
class Guess:
    """A motion from which the optimiser starts.

    Attributes:
        x: The unknowns of `CurveOptimiser`.
        loops: How many times its loop is run through.
        room: Least distance to the singular set on the way [rad]; negative beyond a limit or a
            singularity, minus infinity if it does not arrive.
        shape: What its curve and its loop are made of.
    """

    x: Array
    loops: int
    room: float
    shape: Shape


class GuessFinder:
    """The search for guesses of motions from one configuration.

    Args:
        start: The configuration.
        target: What the motions must achieve.
        waves: Number of sines of curve and loop.
        rng: Source of random numbers.
        account: Its time, and what stops it.
        collisions: What postures at the goal must be free of.
    """

    def __init__(
        self,
        start: Configuration,
        target: Target,
        waves: int,
        rng: np.random.Generator,
        account: SearchAccount | None = None,
        collisions: Collisions | None = None,
    ) -> None:
        self.start, self.target, self.waves, self.rng = start, target, waves, rng
        self.account, self.collisions = account or SearchAccount(np.inf), collisions
        self.arm, self.T0, self.com = start.arm, start.base.rotation, start.com
        self.axes = goal_axes(start)
        limits = target.lower, target.upper
        self.free = FreeSpace(self.arm, start.q, *limits, self.account.check_time)
        self._shape = Sines(waves)
        self._family = CurveFamily(self.arm, start.q, self._shape, INTERVALS)
        self._along, _ = self._shape.at(ALONG)

    def curves(self, width: float, m: int) -> Iterator[Guess]:
        """Yield curves that arrive, free ones first, and then others, shortest first.

        Args:
            width: Size of the sines [rad], [m], and of the turns of the spacecraft [rad].
            m: Number of curves that are tried.
        """
        _, ends = self.ends(width, m)
        ends = np.resize(ends, (m if len(ends) else 0, self.arm.n))
        P = width * closed(self._sines(len(ends)))
        P[1::4] = 0.0  # straight lines too
        P[:, 0] = ends - self.start.q
        if self.target.q is None:
            P[:, 0] += self.free.windings(width, len(ends), self.rng)
        P, near = self._arriving(P, np.broadcast_to(np.eye(3), (len(P), 3, 3)))
        room, travel = self.free.least_distance(self._points(P)), lengths(self._points(P))
        clear = room > self.target.clearance
        self.count_ways(room, near)
        room[~near] = -np.inf
        for some in (near & clear, near & ~clear, ~near):
            for i in _shortest(travel, some):
                yield Guess(self._unknowns(P[i]), 0, room[i], self._shape)

    def loops_and_lines(self) -> Iterator[Guess]:
        """Yield loops with a straight line after them that arrive, free, shortest first."""
        target, loops = self.target, self._loops()
        T, ends = self.ends(np.pi, MANY)
        P: Array = np.zeros((len(ends), self.waves + 1, self.arm.n))
        P[:, 0] = ends - self.start.q
        clear = self.free.least_distance(self._points(P)) > target.clearance
        P, T = P[clear], T[clear]
        if len(loops.C) == 0 or len(P) == 0 or (target.tip is None and target.attitude is None):
            return
        needed = Rotation.from_matrix(self.T0.T @ T @ np.swapaxes(self.turns(P), 1, 2))
        end, loop, times = matches(loops, needed)
        travel = times * lengths(self._points(closed(loops.C)))[loop]
        travel += lengths(self._points(P))[end]
        best = np.argsort(travel, kind="stable")[:MANY]
        end, loop, times, travel = end[best], loop[best], times[best], travel[best]
        W = Rotation.from_rotvec(times[:, None] * loops.turn[loop]).as_matrix()
        P, near = self._arriving(P[end], W)
        room = np.minimum(self.free.least_distance(self._points(P)), loops.room[loop])
        self.count_ways(room, near)
        for i in _shortest(travel, near & (room > target.clearance)):
            C = loops.C[loop[i]]
            yield Guess(self._unknowns(P[i], C), int(times[i]), room[i], self._shape)

    def points(self, guess: Guess) -> Array:
        """Return points (m, n) along a guess, its loops too, and its corners."""
        shape, P = guess.shape, guess.x.reshape(-1, self.arm.n)
        family = CurveFamily(self.arm, self.start.q, shape, shape.intervals)
        m = 1 if shape.pieces > 1 else len(ALONG) - 1  # straight between corners
        loop = np.vstack((self.start.q, P[shape.count + 1 :]))
        loops = [family.rows(loop, m)] * guess.loops if guess.loops else []
        return np.concatenate((*loops, family.rows(P[: shape.count + 1], m)))

    def in_sight(self, m: int) -> Array:
        """Return random joint positions (<= m, n) to which the straight way is free.

        Contacts of the arm's bodies are looked for at some of the points only.
        """
        reach = self.rng.uniform(0.1, 1.0, (MANY, 1))
        step = reach * (self.free.draw(MANY, self.rng) - self.start.q)
        ways = self.start.q + ALONG[:, None] * step[:, None]
        free = self.free.least_distance(ways) > self.target.clearance
        bodies = self.collisions
        ends = (
            way[-1]
            for way in ways[free]
            if bodies is None or not any(map(bodies.touch, way[::LOOKED_AT]))
        )
        return np.array(list(islice(ends, m))).reshape(-1, self.arm.n)

    def loop_places(self) -> Array:
        """Return joint positions (m, n) `in_sight`, where loops turn the spacecraft most first."""
        Q = self.in_sight(4 * MANY // SAMPLE)
        Q = Q[np.argsort(-self.free.least_distance(Q[:, None]))[: MANY // SAMPLE]]
        if len(Q) == 0:
            return Q
        places, P = np.repeat(Q, SAMPLE, axis=0)[:, None], closed(self._sines(SAMPLE * len(Q)))
        clear = self.free.least_distance(places + self._along @ P) > self.target.clearance
        turn = np.zeros(len(P))
        turn[clear] = angles(self.turns(P[clear], places[clear]))
        return Q[np.argsort(-turn.reshape(-1, SAMPLE).max(axis=1))]

    def ends(self, width: float, m: int) -> tuple[Array, Array]:
        """Return attitudes (<= m, 3, 3) and joint positions (<= m, n) at the goal."""
        target, axes = self.target, np.zeros(3)
        axes[list(turning_axes(self.arm))] = 1.0
        turned = Rotation.from_rotvec(width * self.rng.normal(size=(m, 3)) * axes).as_matrix()
        T = self.T0 @ turned if target.attitude is None else np.resize(target.attitude, (m, 3, 3))
        if target.tip is None:
            return T[:1], np.array([target.q])
        Q, T, miss = self.landed(self.free.draw(m, self.rng), T, HELD_STEPS)
        if target.attitude is None and (far := np.flatnonzero(miss >= CLOSE)).size:
            Q[far], T[far], miss[far] = self.landed(
                self.free.draw(far.size, self.rng), T[far], HELD_STEPS,
                limits=(self.free.lower, self.free.upper), turning=True,
            )  # fmt: skip
        Q, there = self.free.wrapped(Q), miss < CLOSE
        room = self.free.least_distance(Q[:, None])
        good = there & (room > target.clearance)
        if self.collisions:
            good[good] = [not self.collisions.touch(q) for q in Q[good]]
        counts = {
            "tried": m,
            "reached": there.sum(),
            "limits": (there & (room == BEYOND)).sum(),
            "side": (there & (room == ACROSS)).sum(),
            "near": (there & (room >= 0.0) & (room <= target.clearance)).sum(),
            "contact": (there & (room > target.clearance) & ~good).sum(),
            "usable": good.sum(),
        }
        self.account.postures.update({word: int(count) for word, count in counts.items()})
        return T[good], Q[good]

    def landed(
        self, Q: Array, attitude: Array | Turns, steps: int, **options: Any
    ) -> tuple[Array, Array, Array]:
        """Bring the tip to its place from joint positions (K, n); see `inverse_kinematics`."""
        goal: Any = self.target.tip
        tip = pin.SE3(goal.rotation, goal.translation - self.com)
        options |= {"check_time": self.account.check_time}
        return inverse_kinematics(self.arm, Q, tip, attitude, self.axes, steps, **options)

    def count_ways(self, room: Array, near: Booleans) -> None:
        """Account for what stops curves, given their least distances and which arrive."""
        stopped = near & (room <= self.target.clearance)
        self.account.ways.update(
            landing=int((~near).sum()),
            limits=int((stopped & (room == BEYOND)).sum()),
            singular=int((stopped & (room > BEYOND)).sum()),
        )

    def _arriving(self, P: Array, W: Array) -> tuple[Array, Booleans]:
        """Move the ends of curves to the goal; return the curves, and whether each comes near it.

        Args:
            P: (K, waves + 1, n) the curves.
            W: (K, 3, 3) turns of the spacecraft before each curve.
        """
        target = self.target
        if target.attitude is not None:
            return P, angles(target.attitude.T @ self.T0 @ W @ self.turns(P)) < NEAR
        if target.tip is None or len(P) == 0:
            return P, np.ones(len(P), dtype=bool)

        def attitude(Q: Array, rows: Integers) -> Array:
            P[rows, 0] = Q - self.start.q
            return self.T0 @ W[rows] @ self.turns(P[rows])

        _, _, miss = self.landed(self.start.q + P[:, 0], attitude, TURNING_STEPS)
        return P, miss < CLOSE

    def _loops(self) -> Loops:
        """Return free loops, among them large ones made from those that turn it most."""
        found = self._free_loops(self.rng.uniform(0.2, 2.0, (MANY, 1, 1)) * self._sines(MANY))
        for _ in range(GENERATIONS if len(found.C) else 0):
            broadest = found.C[np.argsort(-np.linalg.norm(found.turn, axis=1))[:BROAD]]
            C = np.resize(broadest, (MANY, self.waves, self.arm.n))
            C = C * self.rng.uniform(0.9, 1.3, (MANY, 1, 1))
            more = self._free_loops(C + SPREAD * self.rng.normal(size=C.shape))
            found = Loops(*(np.concatenate(pair) for pair in zip(found, more, strict=True)))
        return found

    def _free_loops(self, C: Array) -> Loops:
        """Return the loops of sines C (K, waves, n) that are free."""
        P = closed(C)
        room = self.free.least_distance(self._points(P))
        free = room > self.target.clearance
        turn = Rotation.from_matrix(self.turns(P[free])).as_rotvec()
        return Loops(C[free], room[free], turn)

    def _sines(self, m: int) -> Array:
        """Return random sines (m, waves, n), smaller for shorter waves."""
        C = self.rng.normal(size=(m, self.waves, self.arm.n))
        return C / np.arange(1.0, self.waves + 1.0)[:, None]

    def _points(self, P: Array) -> Array:
        """Return points (K, points, n) on curves P (K, waves + 1, n) from the start."""
        return self.start.q + self._along @ P

    def turns(self, P: Array, places: Array | None = None) -> Array:
        """Return the turns of the spacecraft (K, 3, 3) along curves from the start or from places.

        Args:
            P: (K, waves + 1, n) the curves.
            places: (K, 1, n) where they begin; the start if None.
        """
        places = np.broadcast_to(
            self.start.q if places is None else places, (len(P), 1, P.shape[2])
        )
        turns: list[Array] = [np.empty((0, 3, 3))]
        for some in (slice(i, i + TOGETHER) for i in range(0, len(P), TOGETHER)):
            self.account.check_time()
            Q = places[some] + self._family.basis[:-1] @ P[some]
            turns.append(spacecraft_turns(self.arm, Q, self._family.slope @ P[some]))
        return np.concatenate(turns)

    def _unknowns(self, P: Array, C: Array | None = None) -> Array:
        """Return the unknowns of `CurveOptimiser` for a curve P and a loop of sines C."""
        curve = P.copy()
        curve[0] += self.start.q
        return np.concatenate((curve.ravel(), np.empty(0) if C is None else C.ravel()))


def _shortest(travel: Array, good: Booleans) -> Integers:
    """Return the numbers of those that are good, shortest first."""
    order = np.argsort(travel, kind="stable")
    return order[good[order]]


class Loops(NamedTuple):
    """Closed loops, free of singularities.

    Attributes:
        C: (K, waves, n) coefficients of their sines.
        room: (K,) least distance to the singular set on each [rad].
        turn: (K, 3) rotation vectors by which each turns the spacecraft [rad].
    """

    C: Array
    room: Array
    turn: Array


def matches(loops: Loops, needed: Rotation) -> tuple[Integers, Integers, Integers]:
    """Match loops with the turns that are needed.

    Returns:
        The numbers of turns that are needed, the numbers of loops that nearly make them, and how
        many times these have to be run through.
    """
    wound = Rotation.concatenate([Rotation.from_rotvec(k * loops.turn) for k in LOOPS])
    which, word, _ = nearest_turns(needed, wound, WORDS, NEAR)
    times, loop = np.divmod(word, len(loops.C))
    return which, loop, np.array(LOOPS)[times]


def nearest_turns(
    wanted: Rotation, turns: Rotation, count: int, most: float
) -> tuple[Integers, Integers, Array]:
    """Match turns with the nearest of others, up to so many each, that differ by less than `most`.

    The distance between the unit quaternions of two attitudes is 2 sin(angle / 4).

    Returns:
        The numbers of those that are wanted, of the others, and the angles between both [rad].
    """
    turned = turns.as_quat()
    chord, found = cKDTree(np.concatenate((turned, -turned))).query(
        wanted.as_quat(), k=np.arange(1, count + 1), distance_upper_bound=2.0 * np.sin(most / 4.0)
    )
    which, rank = np.nonzero(np.isfinite(chord))
    chord, found = np.asarray(chord)[which, rank], np.asarray(found)[which, rank]
    return which, found % len(turned), 4.0 * np.arcsin(0.5 * chord)


def angles(R: Array) -> Array:
    """Return the angles (K,) of rotations (K, 3, 3) [rad]."""
    return np.asarray(Rotation.from_matrix(R).magnitude())


def closed(C: Array) -> Array:
    """Return the closed curves (K, waves + 1, n) of sines C (K, waves, n)."""
    return np.concatenate((np.zeros_like(C[:, :1]), C), axis=1)


def lengths(points: Array) -> Array:
    """Return the joint travel (K,) along points (K, m, n), the sum over all joints."""
    return np.abs(np.diff(points, axis=1)).sum(axis=(1, 2))


class FreeSpace:
    """The joint positions that a motion may pass.

    Args:
        arm: The arm.
        q: (n,) joint positions at the start.
        lower: (n,) least joint positions, -inf for joints without limits.
        upper: (n,) largest.
        check_time: Called now and then; it may raise an error to end the search.
    """

    def __init__(
        self,
        arm: SpaceArm,
        q: Array,
        lower: Array,
        upper: Array,
        check_time: Callable[[], None] = lambda: None,
    ) -> None:
        self.arm, self.q, self.lower, self.upper = arm, q, lower, upper
        self._check_time = check_time
        self._det = evaluate(arm, q[None], ("determinant",))["determinant"][0]
        self._turns = ~arm.slides & (arm.coupling is None)

    def draw(self, m: int, rng: np.random.Generator) -> Array:
        """Draw joint positions (m, n) within the limits, at most half a turn from q without limits.

        Args:
            m: Number of rows.
            rng: Source of random numbers.
        """
        low = np.where(np.isfinite(self.lower), self.lower, self.q - np.pi)
        high = np.where(np.isfinite(self.upper), self.upper, self.q + np.pi)
        return rng.uniform(low, high, (m, self.arm.n))

    def wrapped(self, Q: Array) -> Array:
        """Return the same postures (m, n) by whole turns, near q and within the limits."""
        turned = self.q + np.mod(Q - self.q + np.pi, 2.0 * np.pi) - np.pi
        turned += 2.0 * np.pi * ((turned < self.lower) * 1.0 - (turned > self.upper))
        return np.where(self._turns, turned, Q)

    def windings(self, width: float, m: int, rng: np.random.Generator) -> Array:
        """Draw whole turns (m, n) of the joints without limits, more of them for a larger width."""
        endless = self._turns & np.isinf(self.lower) & np.isinf(self.upper)
        turns = 2.0 * np.pi * np.rint(0.5 * width * rng.normal(size=(m, self.arm.n)))
        return turns * endless

    def least_distance(self, curves: Array) -> Array:
        """Return how near to the singular set curves (K, m, n) come (K,) [rad].

        To first order, no more than `FAR`; `BEYOND` or `ACROSS` if they leave the free space.
        """
        inside = ((curves >= self.lower) & (curves <= self.upper)).all(axis=(1, 2))
        few = curves[inside]
        least, size = np.full(len(curves), BEYOND), max(1, BLOCK // curves.shape[1])
        blocks = [self._least(few[i : i + size]) for i in range(0, len(few), size)]
        least[inside] = np.concatenate(blocks) if blocks else 0.0
        return least

    def _least(self, curves: Array) -> Array:
        """Return the same of a few curves within the limits."""
        self._check_time()
        square = self.arm.n == self.arm.task.k
        names = ("distance", "determinant" if square else "away")
        at = evaluate(self.arm, curves.reshape(-1, self.arm.n), names)
        distance = np.minimum(at["distance"], FAR).reshape(curves.shape[:2])
        if square:
            across = (at["determinant"] * self._det <= 0.0).reshape(distance.shape)
        else:
            away = at["away"].reshape(curves.shape) / joint_scales(self.arm)
            across = sides(away, distance) < 0.0
        return np.asarray(np.where(across.any(axis=1), ACROSS, distance.min(axis=1)))
