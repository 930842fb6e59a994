"""Roadmap: a loop of straight pieces, repeated some times, then a few pieces to the goal.

Postures at the goal and others drawn at random are joined by straight joint motions that meet no
singularity, as in the probabilistic roadmaps of Kavraki, Svestka, Latombe & Overmars, IEEE Trans.
Robot. Autom. 12(4), 566-580 (1996), DOI 10.1109/70.508439. By the connection (33c) each motion
turns the spacecraft by a rotation of its own, from whatever attitude it begins. So turns of the
spacecraft are products of rotations that are computed once: along the shortest ways from the start
to all postures, round all loops of two of these and a piece between them, and along all ways to
the goal. Where the turn of a loop, repeated, nearly is the one that a way lacks, the two together
are a guess; the optimiser closes the gap.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array, Booleans, Integers
from spacearm.planning.guesses import LOOPS, Guess, GuessFinder, angles, closed, nearest_turns
from spacearm.planning.optimiser import Corners

#: Searches for postures at the goal, for each size of the turns to their attitudes [rad].
SEARCHES, WIDTHS = 300, (0.6, 1.5, 3.0)
#: Postures at the goal, half of them those of the least turns; others to which the straight way
#: from the start is free, and others anywhere.
ENDS, IN_SIGHT, OTHERS = 150, 40, 40
#: Postures of which the others are taken.
DRAWN = 400
#: Shares of a piece at which it is checked for singularities; of these the first look takes one in
#: so many; and those of the last look.
ALONG, FIRST_LOOK = np.linspace(0.0, 1.0, 33)[:, None], 4
CLOSELY = np.linspace(0.0, 1.0, 129)[:, None]
#: Shares of a piece at which it is looked at for contacts.
LOOKED_AT = np.linspace(0.0, 1.0, 9)[1:-1, None]
#: How often ways are sought anew where bodies meet on some of their pieces.
GROWN = 10
#: How often guesses are, where pieces are not free.
ANEW = 4
#: Corners of a guess, at least, both ends included.
FEWEST = 4
#: Turns whose rotation vectors round to the same multiples of this count once [rad]; more than the
#: number of these on each axis.
CELL, SIDE = 0.15, 64
#: Largest turn that may be missing [rad]; joint travel that a radian of it counts for.
GAP, PAID = 0.4, 30.0
#: Ways to the goal that are matched with each loop.
MATCHES = 4


class Ways(NamedTuple):
    """Ways through postures of the roadmap.

    Attributes:
        nodes: (m, 2) numbers of the postures at the ends of the piece that they have besides
            shortest ways from the start.
        turn: (m,) the turns of the spacecraft.
        travel: (m,) joint travel.
        times: (m,) how many times each is run through.
    """

    nodes: Integers
    turn: Rotation
    travel: Array
    times: Integers

    def cheapest(self) -> Ways:
        """Return the shortest way for each turn."""
        order = np.argsort(self.travel, kind="stable")
        cell = np.rint(self.turn[order].as_rotvec() / CELL).astype(np.int64) + SIDE // 2
        _, first = np.unique(cell @ SIDE ** np.arange(3), return_index=True)
        some = order[first]
        return Ways(self.nodes[some], self.turn[some], self.travel[some], self.times[some])


class Roadmap:
    """The search for ways of straight pieces from one configuration to a target.

    Args:
        finder: The finder of joint positions at the goal.
    """

    def __init__(self, finder: GuessFinder) -> None:
        self.finder, self._collisions = finder, finder.collisions
        self._needed, ends = self._ends()
        self._start, self.q = len(ends), np.vstack((ends, finder.start.q, self._others()))
        self._travel, self._turn = self._joined()
        self._found_free: dict[tuple[int, int], bool] = {}
        self._far, self._before, self._turned = self._tree()

    def guesses(self) -> Iterator[Guess]:
        """Yield ways that nearly arrive, shortest first.

        Pieces are looked at closely, and proven free of contacts between bodies of the arm, only
        where a way needs them, as in Bohlin & Kavraki's lazy roadmaps, IEEE Int. Conf. Robot.
        Autom. (2000), 521-528. Then ways are sought anew without those that are not free.
        """
        known: set[tuple[int, ...]] = set()
        for _ in range(ANEW):
            yield from self._ways_found(known)
            met = [piece for piece, free in self._found_free.items() if not free]
            a, b = np.array(met, dtype=np.int64).reshape(-1, 2).T
            if not np.isfinite(self._travel[a, b]).any():
                return
            self._travel[a, b] = self._travel[b, a] = np.inf
            self._far, self._before, self._turned = self._tree()

    def _ways_found(self, known: set[tuple[int, ...]]) -> Iterator[Guess]:
        """Yield ways on pieces not known to be blocked, other than those known, which grow."""
        if not self._start:
            return
        rests = self._rests()
        if not len(rests.travel):
            return
        loops, rests = self._loops().cheapest(), rests.cheapest()
        target = self.finder.target
        free = target.tip is None and target.attitude is None  # any attitude will do
        most = 2.0 * np.pi if free else GAP
        loop, rest, missing = nearest_turns(loops.turn, rests.turn, MATCHES, most)
        cost = loops.travel[loop] + rests.travel[rest] + (0.0 if free else PAID) * missing
        for i in np.argsort(cost, kind="stable"):
            self.finder.account.check_time()
            times = int(loops.times[loop[i]])
            a, b = loops.nodes[loop[i]].tolist()
            by, end = rests.nodes[rest[i]].tolist()
            about = [*self._way(a), *self._way(b)[::-1]] if times else []
            there = [*self._way(by), end]
            way = (self._start, *about, self._start, *there)
            if (times, *way) not in known and all(self._free(*piece) for piece in pairwise(way)):
                known.add((times, *way))
                yield self._guess(self.q[about], times, self.q[there])

    def _ends(self) -> tuple[Rotation, Array]:
        """Return the turns to postures (<= ENDS, n) at the goal, and these."""
        found = [self.finder.ends(width, SEARCHES) for width in WIDTHS]
        T, Q = (np.concatenate(parts) for parts in zip(*found, strict=True))
        turn = (self.finder.T0.T @ T).reshape(-1, 3, 3)
        least = np.argsort(angles(turn)) if len(turn) else np.arange(0)
        half = ENDS // 2
        some = np.append(least[:half], self.finder.rng.permutation(least[half:])[:half])
        return Rotation.from_matrix(turn[some]), Q[some]

    def _others(self) -> Array:
        """Return regular postures (m, n) in which no bodies of the arm meet."""
        free, least, bodies = self.finder.free, self.finder.target.clearance, self._collisions
        Q = free.draw(DRAWN, self.finder.rng)
        Q = Q[free.least_distance(Q[:, None]) > least][: 2 * OTHERS]
        apart = Q[[not (bodies and bodies.touch(q)) for q in Q]][:OTHERS]
        return np.vstack((self.finder.in_sight(IN_SIGHT), apart))

    def _joined(self) -> tuple[Array, Array]:
        """Join the postures by straight pieces on which no singularity is met at first look.

        Returns:
            (N, N) joint travel from each to each, infinite where a singularity is met, and (N, N,
            4) the turns as quaternions.
        """
        finder, q, N = self.finder, self.q, len(self.q)
        a, b = np.triu_indices(N, 1)
        clear = self._regular(a, b, ALONG[::FIRST_LOOK])
        a, b = a[clear], b[clear]
        line = closed(np.zeros((len(a), finder.waves, q.shape[1])))
        line[:, 0] = q[b] - q[a]
        turn = Rotation.from_matrix(finder.turns(line, q[a][:, None]).reshape(-1, 3, 3))
        travel, turns = np.full((N, N), np.inf), np.tile([0.0, 0.0, 0.0, 1.0], (N, N, 1))
        travel[a, b] = travel[b, a] = np.abs(q[b] - q[a]).sum(axis=1)
        turns[a, b], turns[b, a] = turn.as_quat(), turn.inv().as_quat()
        return travel, turns

    def _tree(self) -> tuple[Array, Integers, Rotation]:
        """Find the shortest ways from the start on which no singularities nor contacts are seen.

        Returns:
            (N,) joint travel to each posture, infinite where there is no way; (N,) the posture
            before it on the way; (N,) the turns of the spacecraft until there.
        """
        start, seen = self._start, set[tuple[int, int]]()
        shortest: Any = dijkstra  # its stubs know no two results
        for _ in range(GROWN):
            lengths = np.where(np.isfinite(self._travel), self._travel, 0.0)  # zero for no piece
            far, before = shortest(lengths, indices=start, return_predecessors=True)
            pieces = {(int(before[i]), int(i)) for i in np.flatnonzero(before >= 0)} - seen
            a, b = np.array(sorted(pieces), dtype=np.int64).reshape(-1, 2).T
            regular = self._regular(a, b)
            met = ~regular
            met[regular] = [
                self._meet(*piece) for piece in zip(a[regular], b[regular], strict=True)
            ]
            self._travel[a[met], b[met]] = self._travel[b[met], a[met]] = np.inf
            seen |= pieces
            if not met.any():
                break
        turned = np.tile([0.0, 0.0, 0.0, 1.0], (len(far), 1))
        for i in np.argsort(far)[1 : np.isfinite(far).sum()]:
            turn = Rotation.from_quat(turned[before[i]]) * Rotation.from_quat(
                self._turn[before[i], i]
            )
            turned[i] = turn.as_quat()
        return far, before, Rotation.from_quat(turned)

    def _way(self, i: int) -> list[int]:
        """Return the postures on the way from the start to one, the start left out."""
        way: list[int] = []
        while i != self._start:
            way.insert(0, i)
            i = int(self._before[i])
        return way

    def _loops(self) -> Ways:
        """Return no loop, and those by two joined postures, run through some times."""
        far = self._far
        a, b = np.nonzero(np.isfinite(self._travel + far + far[:, None]))
        turn = self._turned[a] * self._turns(a, b) * self._turned[b].inv()
        travel = far[a] + self._travel[a, b] + far[b]
        k = np.array(LOOPS)[:, None]
        wound = (k[:, :, None] * turn.as_rotvec()).reshape(-1, 3)
        loops = np.tile(np.column_stack((a, b)), (len(k), 1))
        return Ways(
            np.vstack(([[self._start] * 2], loops)),
            Rotation.from_rotvec(np.vstack((np.zeros((1, 3)), wound))),
            np.append(0.0, k * travel),
            np.append(0, np.repeat(LOOPS, len(a))),
        )

    def _rests(self) -> Ways:
        """Return ways from the start to the goal: straight from the last posture, or the start.

        Their turns are those that must come before, so that the spacecraft ends with the attitude
        that the posture at the goal takes.
        """
        by, end = np.nonzero(np.isfinite(self._travel[:, : self._start] + self._far[:, None]))
        whole = self._turned[by] * self._turns(by, end)
        return Ways(
            np.column_stack((by, end)),
            self._needed[end] * whole.inv(),
            self._far[by] + self._travel[by, end],
            np.ones(len(by), dtype=np.int64),
        )

    def _turns(self, a: Integers | int, b: Integers | int) -> Rotation:
        """Return the turns of the spacecraft from postures to others."""
        return Rotation.from_quat(self._turn[a, b].reshape(-1, 4))

    def _regular(self, a: Integers, b: Integers, along: Array = ALONG) -> Booleans:
        """Tell on which pieces from postures to others no singularity is met (m,)."""
        pieces = self.q[a][:, None] + along * (self.q[b] - self.q[a])[:, None]
        return self.finder.free.least_distance(pieces) > self.finder.target.clearance

    def _free(self, a: int, b: int) -> bool:
        """Tell whether no singularity is met on a piece, and bodies of the arm proven nowhere."""
        bodies, piece = self._collisions, (min(a, b), max(a, b))
        if a != b and piece not in self._found_free:
            free = bool(self._regular(np.array([a]), np.array([b]), CLOSELY)[0])
            if free and bodies is not None:
                free = not self._meet(a, b) and bodies.contact(self.q[[a, b]]) is None
            self._found_free[piece] = free
        return a == b or self._found_free[piece]

    def _meet(self, a: int, b: int) -> bool:
        """Tell whether bodies of the arm meet where they are looked at on a piece."""
        points = self.q[a] + LOOKED_AT * (self.q[b] - self.q[a])
        return self._collisions is not None and any(self._collisions.touch(q) for q in points)

    def _guess(self, loop: Array, times: int, rest: Array) -> Guess:
        """Return a loop by corners (k, n), run through some times, and the rest (m, n) as a guess.

        A loop that is run through once is part of the way, so that all its corners can move.
        """
        start = self.finder.start.q
        way = np.vstack((start, *([loop, start] if times == 1 else []), rest))
        kept = np.append(True, np.abs(np.diff(way, axis=0)).max(axis=1) > 0.0)
        way = way[kept] if kept.sum() > 1 else way[[0, -1]]  # a goal where the start is
        ways = [way, *([np.vstack((start, loop, start))] if times > 1 else [])]
        size = max(FEWEST, *map(len, ways))
        ways = [divided(way, size) for way in ways]
        x = np.concatenate((rest[-1:], *map(aside, ways))).ravel()
        pieces = [c[:-1, None] + ALONG * np.diff(c, axis=0)[:, None] for c in ways]
        room = min(self.finder.free.least_distance(piece).min() for piece in pieces)
        return Guess(x, times if times > 1 else 0, float(room), Corners(size - 2))


def divided(way: Array, size: int) -> Array:
    """Return a way by corners (m, n) with some more, (size, n), in the middle of long pieces."""
    while len(way) < size:
        longest = int(np.abs(np.diff(way, axis=0)).max(axis=1).argmax())
        way = np.insert(way, longest + 1, way[longest : longest + 2].mean(axis=0), axis=0)
    return way


def aside(corners: Array) -> Array:
    """Return how far the corners between the ends (m, n) lie off the straight line (m - 2, n)."""
    share = np.linspace(0.0, 1.0, len(corners))[1:-1, None]
    return corners[1:-1] - corners[0] - share * (corners[-1] - corners[0])
