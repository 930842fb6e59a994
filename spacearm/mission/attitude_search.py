"""The search for attitudes: a path followed from many of them, each from its best posture.

Of planar arms on a ring of angles, where the ends of the feasible intervals are found; of spatial
arms in cells of equal volume of all rotations, which are divided at the border.

Each starts from postures with which the tip is at the beginning of the path. With the attitude
held, the tip is at a pose for isolated postures of an arm without redundancy; each is the posture
of a branch, which goes on as the attitude changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array, Booleans, Integers, Progress
from spacearm.errors import NoSolutionError
from spacearm.mechanics.floating import reactions
from spacearm.mission import rotations
from spacearm.model.arm import SpaceArm
from spacearm.model.frames import evenly_spread
from spacearm.motion import leading
from spacearm.motion.leading import PathTable, Settings, lead_all
from spacearm.planning.many_curves import held_jacobian, inverse_kinematics
from spacearm.processes import check_memory
from spacearm.singularities.risk import uniform

#: Steps of Newton's method: usually, and near the border of what can be reached.
STEPS, MORE_STEPS = 14, 60
#: What the tip may miss [m], [rad].
REACHED = 1e-9
#: Largest change of a joint from one attitude to the next on a branch [rad] or [m].
FARTHEST = 1.5
#: Postures are the same up to this difference [rad] or [m].
SAME = 1e-6


class HeldTip(NamedTuple):
    """An arm whose tip is held at a pose while the spacecraft turns.

    Attributes:
        arm: The arm.
        tip: The pose, from the system CM.
    """

    arm: SpaceArm
    tip: pin.SE3

    def postures(self, attitude: Array, seed: Array, steps: int = STEPS) -> Array:
        """Return postures (m, n), NaN where there is none near the seed.

        Args:
            attitude: (m, 4) attitudes of the spacecraft, quaternions xyzw.
            seed: (m, n) postures to start from.
            steps: Number of steps of Newton's method.
        """
        found = np.full(seed.shape, np.nan)
        known = np.flatnonzero(np.isfinite(seed).all(axis=1))
        if len(known):
            R = Rotation.from_quat(attitude[known]).as_matrix()
            q, _, miss = inverse_kinematics(self.arm, seed[known], self.tip, R, np.eye(3), steps)
            q = within_limits(self.arm, q)
            found[known] = np.where((miss <= REACHED)[:, None], q, np.nan)
        return found

    def onward(self, attitude: Array, seed: Array, steps: int = STEPS) -> Array:
        """Return postures (m, n) on the branches of others at attitudes nearby, NaN where none is.

        Arguments as in `postures`.
        """
        found = self.postures(attitude, seed, steps)
        near = np.abs(unturned(self.arm, found - seed)) <= FARTHEST  # NaN is not
        same = np.asarray(near.all(axis=1))
        same[same] = self._side(found[same]) == self._side(seed[same])
        return np.where(same[:, None], found, np.nan)

    def branch(self, attitude: Array, q0: Array, first: Array, reach: float) -> Array:
        """Follow one posture over the attitudes of the spacecraft.

        Args:
            attitude: (m, 4) attitudes, quaternions xyzw.
            q0: (n,) a posture near the one at the first attitude.
            first: (4,) the attitude from which to go.
            reach: Angle up to which an attitude is the neighbour of another [rad].

        Returns:
            (m, n) postures, NaN where the branch does not reach.

        Raises:
            NoSolutionError: No attitude has a posture near q0.
        """
        known, q = self._first(attitude, q0, first)
        found = np.full((len(attitude), self.arm.n), np.nan)
        tried = np.full(len(attitude), -1)
        while True:
            waiting = np.flatnonzero(np.isnan(found[:, 0]))
            if not len(waiting):
                return found
            nearest, apart = rotations.nearest_of(known, attitude[waiting])
            new = (nearest != tried[waiting]) & (apart <= max(reach, 1.01 * float(apart.min())))
            if not new.any():
                return found
            now, seed = waiting[new], q[nearest[new]]
            tried[now] = nearest[new]
            found[now] = self.onward(attitude[now], seed)
            new = now[np.isfinite(found[now, 0])]
            known, q = np.vstack((known, attitude[new])), np.vstack((q, found[new]))

    def all_branches(self, attitude: Array, tries: int, rng: np.random.Generator) -> Array:
        """Return postures (m, tries, n) from random ones, NaN where a try found no new one.

        Args:
            attitude: (m, 4) attitudes, quaternions xyzw.
            tries: Number of random postures to start from.
            rng: Random numbers.
        """
        seeds = uniform(self.arm, True, tries, rng)
        each = [self.postures(attitude, np.tile(seed, (len(attitude), 1))) for seed in seeds]
        found = np.stack(each, axis=1)
        for i in range(1, tries):
            apart = np.abs(unturned(self.arm, found[:, i, None] - found[:, :i])).max(axis=2)
            found[(apart < SAME).any(axis=1), i] = np.nan
        return found

    def _first(self, attitude: Array, q0: Array, first: Array) -> tuple[Array, Array]:
        """Return the attitude (1, 4) at which a branch begins, and its posture (1, n).

        It is the given one, or of those where a posture near q0 is found the nearest to it.
        """
        q = self.postures(first[None], q0[None], MORE_STEPS)
        if np.isfinite(q).all():
            return first[None], q
        q = self.postures(attitude, np.tile(q0, (len(attitude), 1)), MORE_STEPS)
        solved = np.flatnonzero(np.isfinite(q).all(axis=1))
        if not len(solved):
            raise NoSolutionError(
                f"{self.arm.name}: from the start's q no posture was found with the tip at the "
                "beginning of the path, at any attitude; give another, or all_branches=True to try "
                "many"
            )
        nearest = solved[np.argmin(rotations.angle_between(attitude[solved], first))]
        return attitude[None, nearest], q[None, nearest]

    def _side(self, q: Array) -> Array:
        """Return the sign (m,) of the determinant of J with the attitude held; 1 if not square.

        A branch ends where it vanishes.
        """
        if self.arm.task.k != self.arm.n or not len(q):
            return np.ones(len(q))
        J = held_jacobian(reactions(self.arm, q))[:, self.arm.task.indices]
        return np.sign(np.linalg.det(J))


def within_limits(arm: SpaceArm, q: Array) -> Array:
    """Move angles by whole turns between their limits, where one can be there."""
    turn = 2.0 * np.pi
    free = ~arm.slides if arm.coupling is None else np.zeros(arm.n, dtype=bool)
    bounded = free & np.isfinite(arm.lower) & np.isfinite(arm.upper)
    middle = np.zeros(arm.n)
    middle[bounded] = 0.5 * (arm.lower[bounded] + arm.upper[bounded])
    folded = q - turn * np.round((q - middle) / turn)
    outside = (q < arm.lower) | (q > arm.upper)
    return np.where(bounded & outside, folded, q)


def unturned(arm: SpaceArm, dq: Array) -> Array:
    """Return differences (..., n) of joint positions without the whole turns in them."""
    turns = np.zeros(arm.n) if arm.coupling is not None else np.where(arm.slides, 0.0, 2.0 * np.pi)
    return dq - turns * np.round(dq / (2.0 * np.pi))


#: How following the path ended; without a start no posture has the tip at its beginning.
ENDS = (*leading.ENDS, "no start")
NO_START = ENDS.index("no start")
#: Random postures tried at each attitude where all branches are looked for.
TRIES = 12

#: Each round looks at so many parts of the gap between an angle inside and one outside.
PARTS = 33
#: Width of that gap at which its middle is an end [rad].
SHARP = 5e-7
#: Angle over which postures are followed from one attitude to the next [rad].
WAVE = 0.2
#: Angles that are added about a least or largest distance that seems to cross the margin.
EACH = 32

#: Cells are neighbours up to so many spacings apart.
REACH = 1.5
#: Axes about which the largest ball is probed, at so many angles at a time, in so many rounds.
AXES, SHELLS, ROUNDS = 400, 8, 4
#: Numbers that are kept for each attitude: outcomes and cells; and joint positions.
CELL_NUMBERS, CELL_NUMBERS_PER_JOINT = 60, 4


class Outcome(NamedTuple):
    """What came of following a path from m attitudes.

    Attributes:
        attitude: (m, 4) attitudes of the spacecraft at the start, quaternions xyzw.
        q: (m, n) postures at the start, NaN where there is none.
        ended: (m,) how it ended, an index in `ENDS`.
        s: (m,) length of path behind the tip.
        distance: (m,) least distance to the singular set [rad]; pi where it is more, to first
            order.
        slack: (m,) least distance of a joint to its limits [rad] or [m].
        tilt: (m,) largest turn of the spacecraft on the way [rad].
    """

    attitude: Array
    q: Array
    ended: Integers
    s: Array
    distance: Array
    slack: Array
    tilt: Array

    def take(self, which: Integers | Booleans) -> Outcome:
        """Return some of them."""
        return Outcome._make(column[which] for column in self)

    def posture_near(self, attitude: Array) -> Array:
        """Return the postures (k, n) of the attitudes that are nearest to others (k, 4)."""
        known = np.flatnonzero(np.isfinite(self.q[:, 0]))
        nearest, _ = rotations.nearest_of(self.attitude[known], attitude)
        return self.q[known[nearest]]


def joined(outcomes: Sequence[Outcome]) -> Outcome:
    """Return all outcomes as one."""
    return Outcome._make(np.concatenate(column) for column in zip(*outcomes, strict=True))


class PathTrials(NamedTuple):
    """A path, and how it is followed from many attitudes.

    Attributes:
        start: The arm, its tip at the beginning of the path.
        paths: The path.
        settings: What ends the motion; `care` is the least distance to the singular set [rad].
        q0: (n,) the posture whose branch is followed; None for all that are found.
        first: (4,) the attitude at which it is near the start.
        seed: Of the random postures.
    """

    start: HeldTip
    paths: PathTable
    settings: Settings
    q0: Array | None
    first: Array
    seed: int

    def feasible(self, found: Outcome) -> Booleans:
        """Return (m,) whether the tip arrived and kept the least distance."""
        return np.asarray((found.ended == 0) & (found.distance >= self.settings.care))

    def at(self, attitude: Array, reach: float, progress: Progress | None = None) -> Outcome:
        """Follow the path from all attitudes (m, 4), neighbours up to `reach` [rad] apart."""
        if self.q0 is None:
            q = self._all_branches(attitude)
        else:
            q = self.start.branch(attitude, self.q0, self.first, reach)[:, None]
        return self._follow(attitude, q, progress)

    def near(self, attitude: Array, seed: Array, border: bool = False) -> Outcome:
        """Follow the path from attitudes (m, 4), postures on the branches of others (m, n) nearby.

        Args:
            attitude: (m, 4) attitudes.
            seed: (m, n) postures.
            border: Whether they may be near the border of what can be reached.
        """
        steps = MORE_STEPS if border else STEPS
        q = self.start.onward(attitude, seed, steps)[:, None]
        if self.q0 is None and not border:
            q = np.concatenate((q, self._all_branches(attitude)), axis=1)
        return self._follow(attitude, q)

    def _all_branches(self, attitude: Array) -> Array:
        """Return postures (m, tries, n) on all branches that random ones lead to."""
        return self.start.all_branches(attitude, TRIES, np.random.default_rng(self.seed))

    def _follow(self, attitude: Array, q: Array, progress: Progress | None = None) -> Outcome:
        """Follow the path from attitudes (m, 4) and postures (m, c, n); return the best of each."""
        m, c, n = q.shape
        there = np.isfinite(q).all(axis=2).ravel()
        each, flat = np.repeat(attitude, c, axis=0), q.reshape(-1, n)
        columns = [np.full(m * c, x) for x in (NO_START, 0.0, 0.0, -np.inf, 0.0)]
        if there.any():
            led = lead_all(
                self.start.arm, flat[there], each[there], self.paths, None, self.settings, progress
            )
            found = (led.ended, led.s, np.minimum(led.distance, np.pi), led.slack, led.tilt)
            for column, values in zip(columns, found, strict=True):
                column[there] = values
        ended, s, distance, *_ = columns
        rank = np.where(ended == 0, 1e9 + distance, s) - np.where(ended == NO_START, 1.0, 0.0)
        best = np.arange(m) * c + rank.reshape(m, c).argmax(axis=1)
        return Outcome(attitude, flat[best], *(column[best] for column in columns))


# --- planar arms: a ring of angles ----------------------------------------------------------


def turned_about(axis: int, angle: Array) -> Array:
    """Return the attitudes (..., 4) turned about an axis by angles (...), quaternions xyzw."""
    quaternion = np.zeros((*angle.shape, 4))
    quaternion[..., axis], quaternion[..., 3] = np.sin(0.5 * angle), np.cos(0.5 * angle)
    return quaternion


def search_ring(
    trials: PathTrials, axis: int, samples: int, progress: Progress | None
) -> tuple[Outcome, Array, Array]:
    """Follow the path from attitudes all around, and find the ends of the feasible intervals.

    Args:
        trials: The path.
        axis: The normal of the arm's plane.
        samples: Number of attitudes, evenly spread.
        progress: Called as progress(done, samples).

    Returns:
        The outcomes by increasing angle; the angles (m,) from -pi to pi; the intervals (k, 2).
    """
    _check_cells(trials, samples)
    gap = 2.0 * np.pi / samples
    angle = -np.pi + gap * (np.arange(samples) + 0.5)
    found = trials.at(turned_about(axis, angle), max(1.5 * gap, WAVE), progress)
    more = _suspects(found, trials.settings.care, angle, gap)
    if len(more):
        nearest = np.round((more + np.pi) / gap - 0.5).astype(int) % samples
        found = joined((found, trials.near(turned_about(axis, more), found.q[nearest])))
        angle = np.concatenate((angle, more))
        order = np.argsort(angle)
        angle, found = angle[order], found.take(order)
    inside = trials.feasible(found)
    if inside.all() or not inside.any():
        whole = np.array([[-np.pi, np.pi]]) if inside.all() else np.zeros((0, 2))
        return found, angle, whole
    last = np.flatnonzero(inside & ~np.roll(inside, -1))  # intervals end behind these,
    first = np.flatnonzero(inside & ~np.roll(inside, 1))  # and begin before those
    within = np.append(last, first)
    into = np.append(np.roll(angle, -1)[last], np.roll(angle, 1)[first])
    sense = np.repeat((1.0, -1.0), (len(last), len(first)))
    start = angle[within]
    width = sense * (into - start) % (2.0 * np.pi)
    ends = _ends(trials, axis, start, sense * width, found.q[within])
    low, high = np.sort(_wrapped(ends[len(last) :])), ends[: len(last)]
    intervals = [(a, a + ((high - a) % (2.0 * np.pi)).min()) for a in low]
    return found, angle, np.array(intervals)


def _ends(trials: PathTrials, axis: int, start: Array, width: Array, q: Array) -> Array:
    """Return the angles (e,) at which feasible attitudes end, between `start` and start + width."""
    finer = trials.settings._replace(tolerance=1e-10, least_stride=0.002)
    trials = trials._replace(settings=finer)
    shares = np.arange(-1, PARTS + 2) / PARTS  # one more at each side: the search was coarser
    while len(width) and np.abs(width).max() > SHARP:
        at = start[:, None] + width[:, None] * shares
        seed = np.repeat(q, len(shares), axis=0)
        found = trials.near(turned_about(axis, at.ravel()), seed, border=True)
        ok = trials.feasible(found).reshape(at.shape)
        falls = ok[:, :-1] & ~ok[:, 1:]
        k = np.where(
            falls.any(axis=1), falls.argmax(axis=1), np.where(ok.all(axis=1), PARTS + 1, 0)
        )
        each = np.arange(len(start))
        start, width = at[each, k], width / PARTS
        q_new = found.q.reshape(*at.shape, -1)[each, k]
        q = np.where(np.isfinite(q_new), q_new, q)
    return start + 0.5 * width


def _suspects(found: Outcome, margin: float, angle: Array, gap: float) -> Array:
    """Return angles to be added where a parabola through three distances crosses the margin."""
    d = np.where(found.ended == 0, found.distance, np.nan)
    before, after = np.roll(d, 1), np.roll(d, -1)
    same = (before >= margin) == (d >= margin)
    same &= (after >= margin) == (d >= margin)
    curve, slope = before + after - 2.0 * d, 0.5 * (after - before)
    with np.errstate(invalid="ignore", divide="ignore"):
        vertex = d - 0.5 * slope * slope / curve
        crosses = same & (np.abs(slope) <= np.abs(curve)) & ((vertex >= margin) != (d >= margin))
    shares = (np.arange(EACH) + 0.5) / EACH * 2.0 - 1.0
    return _wrapped((angle[crosses][:, None] + gap * shares).ravel())


def _wrapped(angle: Array) -> Array:
    """Return angles between -pi and pi."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


# --- spatial arms: cells of all rotations ---------------------------------------------------


def search_cells(
    trials: PathTrials, level: int, refine: int, progress: Progress | None
) -> tuple[Outcome, rotations.Cells, rotations.Cells]:
    """Follow the path from attitudes all over the rotations, more of them at the border.

    Args:
        trials: The path.
        level: Of the cells, 12 4^level directions times 6 2^level rolls.
        refine: How many times cells at the border are divided into eight.
        progress: Called as progress(done, 1000); the largest ball is the last part.

    Returns:
        The outcomes in the middles of all cells; the cells (m, 2); their levels (m,).
    """
    _check_cells(trials, 72 * 8**level)
    of, parts = rotations.cells(level), 2 + refine

    def tell(done: int, total: int, part: int = 0) -> None:
        if progress:
            progress(1000 * (part * total + done) // (parts * total), 1000)

    found = trials.at(rotations.attitudes(of, level), REACH * rotations.spacing(len(of)), tell)
    levels = np.full(len(of), level)
    for finer in range(level + 1, level + refine + 1):
        border = (levels == finer - 1) & at_border(found, trials.feasible(found), levels)
        if not border.any():
            break
        _check_cells(trials, len(of) + 7 * int(border.sum()))
        inner = rotations.children(of[border])
        middles = rotations.attitudes(inner, finer)
        more = trials.near(middles, found.posture_near(middles))
        found = joined((found.take(~border), more))
        of = np.concatenate((of[~border], inner))
        levels = np.concatenate((levels[~border], np.full(len(inner), finer)))
        tell(1, 1, finer - level)
    return found, of, levels


def _check_cells(trials: PathTrials, cells: int) -> None:
    """Refuse to search more cells than the free memory has room for.

    Raises:
        SpaceArmError: They need more.
    """
    need = 8.0 * cells * (CELL_NUMBERS + CELL_NUMBERS_PER_JOINT * trials.start.arm.n)
    check_memory(need, f"a search of {cells:,} attitudes", "use fewer samples, or refine less")


def volume(levels: rotations.Cells) -> Array:
    """Return the share (m,) of all rotations in each cell."""
    return 1.0 / (72.0 * 8.0**levels)


def at_border(found: Outcome, inside: Booleans, levels: rotations.Cells) -> Booleans:
    """Return (m,) which cells have a neighbour that is feasible where they are not, or is not."""
    border = np.zeros(len(inside), dtype=bool)
    if inside.all() or not inside.any():
        return border
    reach = REACH * rotations.spacing(int(72 * 8 ** levels.max()))
    wide = REACH * rotations.spacing(int(72 * 8 ** levels.min()))
    for of, to in ((inside, ~inside), (~inside, inside)):
        _, apart = rotations.nearest_of(found.attitude[to], found.attitude[of])
        border[of] = apart <= np.where(levels[of] == levels.max(), reach, wide)
    return border


def largest_ball(trials: PathTrials, found: Outcome) -> tuple[Array, float]:
    """Return the feasible attitude (4,) farthest from those that are not, and how far [rad].

    From the middle found in the sample the attitudes on turns about `AXES` axes are followed, to
    find how far each turn may go.
    """
    inside = trials.feasible(found)
    if inside.all():
        return found.attitude[np.argmax(found.distance)], np.pi
    _, room = rotations.nearest_of(found.attitude[~inside], found.attitude[inside])
    i = np.flatnonzero(inside)[np.argmax(room)]
    low, high, centre = 0.0, min(1.3 * float(room.max()), np.pi), found.attitude[i]
    axes = evenly_spread(AXES)
    for _ in range(ROUNDS):
        shells = low + (high - low) * (np.arange(SHELLS) + 1.0) / SHELLS
        turns = (shells[:, None, None] * axes).reshape(-1, 3)
        around = (Rotation.from_rotvec(turns) * Rotation.from_quat(centre)).as_quat()
        ok = trials.feasible(trials.near(around, found.posture_near(around)))
        whole = ok.reshape(SHELLS, AXES).all(axis=1)
        if whole.all():
            return centre, high
        first = int(whole.argmin())
        low, high = (shells[first - 1] if first else low), float(shells[first])
    return centre, float(low)
