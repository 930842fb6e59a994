"""Roadmap: a loop of straight pieces, run through some times, then a way of a few to the goal.

Postures at the goal and others drawn at random are joined by straight joint motions that meet no
singularity, as in the probabilistic roadmaps of Kavraki, Svestka, Latombe & Overmars, IEEE Trans.
Robot. Autom. 12(4), 566-580 (1996), DOI 10.1109/70.508439. By the connection (33c) each motion
turns the spacecraft by a rotation of its own, from whatever attitude it begins. So the turns of all
triangles through the start, and of all ways from it to the goal by one posture, are products of
rotations that are computed once. Where the turn of a triangle, repeated, nearly is the one that a
way lacks, the two together are a guess; the optimiser closes the gap.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array
from spacearm.planning.guesses import Guess, GuessFinder, angles, closed
from spacearm.planning.many_curves import Indices
from spacearm.planning.optimiser import Corners

SEARCHES, WIDTHS = 300, (0.6, 1.5, 3.0)
"""Searches for postures at the goal, for each size of the turns to their attitudes [rad]."""
ENDS, IN_SIGHT, OTHERS = 150, 40, 40
"""Postures at the goal, half of them those of the least turns; others to which the straight way
from the start is free, and others anywhere."""
DRAWN = 400
"""Postures of which the others are taken."""
ALONG = np.linspace(0.0, 1.0, 33)[:, None]
"""Shares of a piece at which it is checked for singularities."""
LOOKED_AT = np.linspace(0.0, 1.0, 9)[1:-1, None]
"""Shares of a piece at which it is looked at for contacts."""
TIMES = (1, 2, 3, 4, 6, 8, 12)
"""Numbers of times that a loop is run through."""
CELL, SIDE = 0.15, 64
"""Turns whose rotation vectors round to the same multiples of this count once [rad]; more than the
number of these on each axis."""
GAP, PAID = 0.4, 30.0
"""Largest turn that may be missing [rad]; joint travel that a radian of it counts for."""
MATCHES = 4
"""Ways to the goal that are matched with each loop."""


class Ways(NamedTuple):
    """Ways through postures of the roadmap.

    Attributes:
        nodes: (m, 2) numbers of two of the postures on them.
        turn: (m,) the turns of the spacecraft.
        travel: (m,) joint travel.
        times: (m,) how many times each is run through.
    """

    nodes: Indices
    turn: Rotation
    travel: Array
    times: Indices

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
        self._apart: dict[tuple[int, int], bool] = {}
        for i in np.flatnonzero(np.isfinite(self._travel[self._start])):
            if self._meet(self._start, int(i)):
                self._travel[self._start, i] = self._travel[i, self._start] = np.inf

    def guesses(self) -> Iterator[Guess]:
        """Yield ways that nearly arrive, shortest first.

        But for those from the start, pieces are looked at for contacts of the arm's own bodies only
        where a way needs them, as in Bohlin & Kavraki's lazy roadmaps, IEEE Int. Conf. Robot.
        Autom. (2000), 521-528.
        """
        if not self._start:
            return
        rests = self._rests()
        if not len(rests.travel):
            return
        loops, rests = self._loops().cheapest(), rests.cheapest()
        target = self.finder.target
        free = target.tip is None and target.attitude is None  # any attitude will do
        turns = rests.turn.as_quat()
        found = cKDTree(np.vstack((turns, -turns))).query(
            loops.turn.as_quat(),
            k=np.arange(1, MATCHES + 1),
            distance_upper_bound=4.0 if free else 2.0 * np.sin(GAP / 4.0),
        )
        gap, which = (np.asarray(x) for x in found)
        loop, rank = np.nonzero(np.isfinite(gap))
        rest = which[loop, rank] % len(turns)
        missing = 0.0 if free else 4.0 * np.arcsin(0.5 * gap[loop, rank])
        cost = loops.travel[loop] + rests.travel[rest] + PAID * missing
        for i in np.argsort(cost, kind="stable"):
            self.finder.account.check_time()
            times = int(loops.times[loop[i]])
            about = loops.nodes[loop[i]].tolist() if times else []
            by, end = rests.nodes[rest[i]].tolist()
            pieces = pairwise((self._start, *about, self._start, by, end))
            if all(self._free_of_contacts(*piece) for piece in pieces):
                yield self._guess(self.q[about], times, self.q[[by, end]])

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
        return np.vstack((self.finder.in_sight(4 * IN_SIGHT)[:IN_SIGHT], apart))

    def _joined(self) -> tuple[Array, Array]:
        """Join the postures by straight pieces.

        Returns:
            (N, N) joint travel from each to each, infinite where a singularity is met, and (N, N,
            4) the turns as quaternions.
        """
        finder, q, N = self.finder, self.q, len(self.q)
        a, b = np.triu_indices(N, 1)
        pieces = q[a][:, None] + ALONG * (q[b] - q[a])[:, None]
        clear = finder.free.least_distance(pieces) > finder.target.clearance
        a, b = a[clear], b[clear]
        line = closed(np.zeros((len(a), finder.waves, q.shape[1])))
        line[:, 0] = q[b] - q[a]
        turn = Rotation.from_matrix(finder.turns(line, q[a][:, None]).reshape(-1, 3, 3))
        travel, turns = np.full((N, N), np.inf), np.tile([0.0, 0.0, 0.0, 1.0], (N, N, 1))
        travel[a, b] = travel[b, a] = np.abs(q[b] - q[a]).sum(axis=1)
        turns[a, b], turns[b, a] = turn.as_quat(), turn.inv().as_quat()
        return travel, turns

    def _loops(self) -> Ways:
        """Return no loop, and the triangles through the start, run through some times."""
        from_start = self._travel[self._start]
        a, b = np.nonzero(np.isfinite(self._travel + from_start + from_start[:, None]))
        turn = self._turns(self._start, a) * self._turns(a, b) * self._turns(b, self._start)
        travel = from_start[a] + self._travel[a, b] + from_start[b]
        k = np.array(TIMES)[:, None]
        wound = (k[:, :, None] * turn.as_rotvec()).reshape(-1, 3)
        triangles = np.tile(np.column_stack((a, b)), (len(k), 1))
        return Ways(
            np.vstack(([[self._start] * 2], triangles)),
            Rotation.from_rotvec(np.vstack((np.zeros((1, 3)), wound))),
            np.append(0.0, k * travel),
            np.append(0, np.repeat(TIMES, len(a))),
        )

    def _rests(self) -> Ways:
        """Return ways from the start to the goal, straight or by one posture.

        Their turns are those that must come before, so that the spacecraft ends with the attitude
        that the posture at the goal takes.
        """
        start, travel = self._start, self._travel.copy()
        travel[start, start] = 0.0  # straight there
        by, end = np.nonzero(np.isfinite(travel[:, :start] + travel[start][:, None]))
        whole = self._turns(start, by) * self._turns(by, end)
        return Ways(
            np.column_stack((by, end)),
            self._needed[end] * whole.inv(),
            travel[start, by] + travel[by, end],
            np.ones(len(by), dtype=np.int64),
        )

    def _turns(self, a: Indices | int, b: Indices | int) -> Rotation:
        """Return the turns of the spacecraft from postures to others."""
        return Rotation.from_quat(self._turn[a, b].reshape(-1, 4))

    def _free_of_contacts(self, a: int, b: int) -> bool:
        """Tell whether bodies of the arm are proven to meet nowhere on a piece."""
        bodies, piece = self._collisions, (min(a, b), max(a, b))
        if bodies is None or a == b:
            return True
        if piece not in self._apart:
            self._apart[piece] = not self._meet(a, b) and bodies.contact(self.q[[a, b]]) is None
        return self._apart[piece]

    def _meet(self, a: int, b: int) -> bool:
        """Tell whether bodies of the arm meet where they are looked at on a piece."""
        points = self.q[a] + LOOKED_AT * (self.q[b] - self.q[a])
        return self._collisions is not None and any(self._collisions.touch(q) for q in points)

    def _guess(self, loop: Array, times: int, rest: Array) -> Guess:
        """Return a loop by corners (2, n), run through some times, and the rest (2, n) as a guess.

        A loop that is run through once is part of the way, so that all its corners can move.
        """
        start = self.finder.start.q
        way = np.vstack((start, *([loop, start] if times == 1 else []), rest))
        kept = np.append(True, np.abs(np.diff(way, axis=0)).max(axis=1) > 0.0)
        way = way[kept] if kept.sum() > 1 else way[[0, -1]]  # a goal where the start is
        while len(way) < 4:  # as many corners as the loop
            longest = int(np.abs(np.diff(way, axis=0)).max(axis=1).argmax())
            way = np.insert(way, longest + 1, way[longest : longest + 2].mean(axis=0), axis=0)
        closed_ways = [np.vstack((start, loop, start))] if times > 1 else []
        x = np.concatenate((way[-1:], *map(aside, (way, *closed_ways)))).ravel()
        pieces = [c[:-1, None] + ALONG * np.diff(c, axis=0)[:, None] for c in (way, *closed_ways)]
        room = self.finder.free.least_distance(np.concatenate(pieces)).min()
        return Guess(x, times if times > 1 else 0, float(room), Corners(len(way) - 2))


def aside(corners: Array) -> Array:
    """Return how far the corners between the ends (m, n) lie off the straight line (m - 2, n)."""
    share = np.linspace(0.0, 1.0, len(corners))[1:-1, None]
    return corners[1:-1] - corners[0] - share * (corners[-1] - corners[0])
