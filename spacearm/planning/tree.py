"""Tree: a global search on joint positions and attitude, and the shortening of what it finds.

The branches of the tree are straight joint motions, along which the connection (33c) turns the
spacecraft. From many nodes at once a last piece leads to joint positions at the goal, moved until
the tip arrives with the attitude that the way makes. Motions are shortened at random: their corners
are moved, left out and drawn together, and all variants are landed anew at once.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, Booleans, Integers
from spacearm.collisions.separation import Collisions
from spacearm.equations.turns import GAUSS
from spacearm.errors import ConfigurationError, NoSolutionError
from spacearm.mechanics.jacobian import generalized_jacobian
from spacearm.model.arguments import FLOATING
from spacearm.motion.goal import goal_rows
from spacearm.planning.guesses import CLOSE, GuessFinder, lengths
from spacearm.planning.many_curves import spacecraft_turns
from spacearm.planning.optimiser import ARRIVED, NEWTON_STEPS, SPACING
from spacearm.planning.problem import Problem, Rows
from spacearm.singularities.box_graph import FreeBoxes
from spacearm.singularities.immaterial_masses import digest_of_set

#: Branches that are grown, and landed, at once.
GROWN = 48
#: Joint positions at the goal to which each node is led.
LANDINGS = 3
#: Searches for joint positions at the goal, at attitudes about that of the start.
ENDS = 400
#: Sizes of the turns to these attitudes [rad], one after the other.
WIDTHS = (0.0, 0.3, 1.0)
#: Variants of a motion that are tried at once to shorten it, and how often.
VARIANTS, GENERATIONS = 48, 10
#: Largest joint motion along a branch [rad] or [m].
BRANCH = 1.0
#: Joint motion between postures that are checked for contacts [rad] or [m].
CLEAR = 0.05
#: Newton steps to the end of a last piece.
STEPS = 25
#: Steps of the integration along a piece; points at which a piece is checked.
INTERVALS, POINTS = 6, 13
#: Name of the method that goes through boxes.
BOXES = "boxes"
#: Ways through boxes that are led to the goal at once, and how often, by way of other boxes; sizes
#: of the turns to its attitudes [rad].
WAYS, BY_WAY, TURNED = 24, 20, (0.3, 1.0, 3.0)
#: Nearest boxes to which a straight piece is tried.
ENTRIES = 32
#: Rounds in which a tree grows, twice as many in each round of the search.
TREES = 30
#: Joint motion that counts as none.
STILL = 1e-12


class Tree:
    """The search for motions from one configuration to a place of the tip.

    Args:
        finder: The finder of joint positions at the goal.
        collisions: The bodies that must not meet; None if they do not count.
    """

    def __init__(self, finder: GuessFinder, collisions: Collisions | None) -> None:
        self.finder, self.collisions = finder, collisions
        self.start, self.target, self.rng = finder.start, finder.target, finder.rng
        self.arm, self.free, self.account = finder.arm, finder.free, finder.account
        s = np.add.outer(np.arange(INTERVALS), GAUSS).ravel() / INTERVALS
        self._gauss, self._along = s[:, None], np.linspace(0.0, 1.0, POINTS)[1:, None]
        self._q, self._T = self.start.q[None], self.start.base.rotation[None]
        self._parent: Integers = np.array([-1])
        self._ends: tuple[Array, Array] = (np.empty((0, 3, 3)), np.empty((0, self.arm.n)))
        self._rounds = 0

    def motions(self, rounds: int) -> Iterator[Array]:
        """Yield the corners (m, n) of motions that arrive, free of singularities.

        Args:
            rounds: How often the tree grows.
        """
        nodes = np.array([0])
        for _ in range(rounds):
            self.account.check_time()
            self._find_ends()
            if len(self._ends[1]):
                yield from self._landed(nodes)
            nodes = self._grow()

    def through(self, boxes: FreeBoxes) -> Iterator[Array]:
        """Yield the corners (m, n) of ways through boxes that arrive.

        The shortest ones come first, then those by way of random boxes, which turn the spacecraft
        otherwise. From a start, or to an end, that is in no box a straight piece leads to one. To a
        place of the tip the last piece is led as those of the tree are.

        Raises:
            NoSolutionError: No boxes lead to the goal.
        """
        q, why = self.target.q, "no boxes that are joined lead from the start to the goal"
        ends = [q[None]] if q is not None else [self.finder.ends(w, ENDS)[1] for w in TURNED]
        Q = np.concatenate(ends)
        if (first := self._entry(boxes, self.start.q)) is None:
            raise NoSolutionError(f"{why}: the start is far from all; cover more")
        none: Array = np.empty((0, len(first)))
        for k in range(BY_WAY):
            self.account.check_time()
            before, lead, here = none, self.start.q[None], first
            if k:
                middle = 0.5 * (boxes.lower + boxes.upper)
                by = middle[self.rng.integers(len(middle), size=1)]
                there = next((way for _, way in boxes.ways(first, by)), first[None])
                before, lead, here = self._fewer(np.vstack((lead, there))), none, there[-1]
            pairs = [(self._entry(boxes, end), end) for end in self.rng.permutation(Q)[:WAYS]]
            entries = [(p, end) for p, end in pairs if p is not None]
            ways = []
            for i, way in boxes.ways(here, np.array([p for p, _ in entries])):
                p, end = entries[i]
                end = end + way[-1] - p  # whole turns away
                if q is None or np.allclose(end, q, atol=STILL):
                    way = np.vstack((lead, way, end if q is None else q))
                    ways.append(np.vstack((before, self._fewer(way))))
            for corners in self._led(ways):
                why = "no way through the boxes keeps all constraints"
                yield corners
        raise NoSolutionError(why)

    def _entry(self, boxes: FreeBoxes, q: Array) -> Array | None:
        """Return the nearest point in a box to which the straight way from q (n,) is free."""
        points = boxes.nearest(q, ENTRIES)
        clear = self._room(np.stack((np.broadcast_to(q, points.shape), points), axis=1))
        first = np.flatnonzero(clear > self.target.clearance)[:1]
        return points[first[0]] if first.size else None

    def _led(self, ways: list[Array]) -> Iterator[Array]:
        """Yield ways (m, n) by fewer corners, led to the goal, the shortest first, shortened."""
        if not ways:
            return
        size = max(3, *map(len, ways))
        W = np.array([np.vstack((way[:1].repeat(size - len(way), axis=0), way)) for way in ways])
        T = self.start.base.rotation @ self._turns(W[:, :-1])
        W, arrives = self._arriving(W, T)
        good = np.flatnonzero(arrives)
        for i in good[np.argsort(lengths(W[good]))]:
            for corners in (self._shortened(W[i]), W[i]):
                if self._clear_way(corners):
                    yield corners

    def _fewer(self, way: Array) -> Array:
        """Return the corners of a way (m, n) that straight pieces cannot do without."""
        kept = [0]
        while kept[-1] < len(way) - 1:
            here = kept[-1]
            ahead = np.arange(here + 1, len(way))
            pieces = np.stack((np.broadcast_to(way[here], way[ahead].shape), way[ahead]), axis=1)
            clear = self._room(pieces) > self.target.clearance
            kept.append(int(ahead[clear].max(initial=here + 1)))
        return way[kept]

    def _find_ends(self) -> None:
        """Look for more joint positions at the goal, now and then."""
        if self._rounds & (self._rounds - 1) == 0:  # at powers of two
            width = WIDTHS[min(self._rounds, len(WIDTHS) - 1)]
            (T, Q), (more_T, more_Q) = self._ends, self.finder.ends(width, ENDS)
            self._ends = np.concatenate((T, more_T)), np.concatenate((Q, more_Q))
        self._rounds += 1

    def _grow(self) -> Integers:
        """Add branches to random postures; return the numbers of the new nodes."""
        Q = self.free.draw(GROWN, self.rng)
        apart = np.abs(Q[:, None] - self._q).max(axis=2)
        if len(self._q) > GROWN:  # not always the nearest: attitudes differ
            apart = apart * self.rng.uniform(0.5, 1.5, apart.shape)
        near = apart.argmin(axis=1)
        step = Q - self._q[near]
        step *= np.minimum(1.0, BRANCH / np.maximum(np.abs(step).max(axis=1), STILL))[:, None]
        pieces = np.stack((self._q[near], self._q[near] + step), axis=1)
        clear = self._room(pieces) > self.target.clearance
        pieces, near = pieces[clear], near[clear]
        T = self._T[near] @ self._turns(pieces)
        apart_too = self._apart(pieces[:, 1], T)
        first = len(self._q)
        self._q = np.vstack((self._q, pieces[apart_too, 1]))
        self._T = np.concatenate((self._T, T[apart_too]))
        self._parent = np.append(self._parent, near[apart_too])
        return np.arange(first, len(self._q))

    def _apart(self, Q: Array, T: Array) -> Booleans:
        """Tell in which postures (K, n), with attitudes (K, 3, 3), no bodies meet."""
        if self.collisions is None:
            return np.ones(len(Q), dtype=bool)
        return np.array(
            [
                self.collisions.clear(self.arm.at(q, base=pin.SE3(R, np.zeros(3))), self.start.com)
                for q, R in zip(Q, T, strict=True)
            ],
            dtype=bool,
        )

    def _landed(self, nodes: Integers) -> Iterator[Array]:
        """Yield the motions that lead from some nodes to the goal."""
        if len(nodes) == 0:
            return
        T, Q = self._ends
        turn = np.einsum("kij,eij->ke", self._T[nodes], T)
        angle = np.arccos(np.clip(0.5 * (turn - 1.0), -1.0, 1.0))
        far = np.abs(self._q[nodes][:, None] - Q).max(axis=2) + angle
        far = far * self.rng.uniform(0.7, 1.3, far.shape)
        few = min(LANDINGS, len(Q))
        ends = np.argpartition(far, few - 1, axis=1)[:, :few].ravel()
        nodes = np.repeat(nodes, few)
        W = np.stack((self._q[nodes], Q[ends]), axis=1)
        W, arrives = self._arriving(W, self._T[nodes])
        for i in np.flatnonzero(arrives):
            corners, node = [W[i, 1]], int(nodes[i])
            while node >= 0:
                corners.append(self._q[node])
                node = int(self._parent[node])
            way = np.array(corners[::-1])
            if self._clear_way(way):
                yield self._shortened(way)
                yield way
            else:
                self.account.ways["contact"] += 1

    def _arriving(self, W: Array, T: Array) -> tuple[Array, Booleans]:
        """Move the last corners of motions until the tip arrives.

        Args:
            W: (K, k, n) corners.
            T: (K, 3, 3) attitudes at the last but one.

        Returns:
            The corners; whether the tip arrives (K,), the last piece free of singularities.
        """
        W, target = W.copy(), self.target
        if target.tip is None or len(W) == 0:
            return W, self._room(W[:, -2:]) > target.clearance

        def attitude(Q: Array, rows: Integers) -> Array:
            W[rows, -1] = Q
            return T[rows] @ self._turns(W[rows, -2:])

        limits = target.lower, target.upper
        _, _, miss = self.finder.landed(W[:, -1], attitude, STEPS, limits=limits)
        room = self._room(W[:, -2:])
        self.finder.count_ways(room, miss < CLOSE)
        return W, (miss < CLOSE) & (room > target.clearance)

    def _shortened(self, best: Array) -> Array:
        """Return corners (m, n) of a shorter motion that arrives as one of corners (k, n) does."""
        for _ in range(GENERATIONS):
            W = self._variants(best)
            W = W[self._room(W[:, :-1]) > self.target.clearance]
            if len(W) == 0:
                continue
            T = self.start.base.rotation @ self._turns(W[:, :-1])
            W, arrives = self._arriving(W, T)
            travel = np.where(arrives, lengths(W), np.inf)
            for i in np.argsort(travel)[:3]:
                if travel[i] < lengths(best[None])[0] and self._clear_way(W[i]):
                    moves = np.abs(np.diff(W[i], axis=0)).max(axis=1) > STILL
                    best = W[i][np.append(True, moves)]
                    break
        return best

    def _clear_way(self, W: Array) -> bool:
        """Tell whether no bodies meet at the corners (k, n) of a motion and between them."""
        if self.collisions is None:
            return True
        T, way = self.start.base.rotation, []
        for a, b in itertools.pairwise(W):
            steps = math.ceil(float(np.abs(b - a).max()) / CLEAR) or 1
            points = a + np.linspace(0.0, 1.0, steps + 1)[1:, None] * (b - a)
            turns = T @ self._turns(np.stack((np.broadcast_to(a, points.shape), points), axis=1))
            way += list(zip(points, turns, strict=True))
            T = turns[-1]
        return bool(self._apart(np.array([q for q, _ in way]), np.array([R for _, R in way])).all())

    def _variants(self, W: Array) -> Array:
        """Return motions (VARIANTS, k, n) like one of corners (k, n): fewer, nearer, displaced."""
        k = max(len(W), 3)
        W = np.vstack((W[:1].repeat(k - len(W), axis=0), W))
        many = np.repeat(W[None], VARIANTS, axis=0)
        shrink = self.rng.uniform(0.0, 1.0, (VARIANTS, 1, 1))
        many += shrink * (W[0] + np.linspace(0.0, 1.0, k)[:, None] * (W[-1] - W[0]) - W)
        size = 0.3 * self.rng.uniform(0.0, 1.0, (VARIANTS, 1, 1)) ** 2
        many += size * self.rng.normal(size=many.shape)
        out = self.rng.integers(1, k - 1, VARIANTS)
        some = np.flatnonzero(
            self.rng.uniform(size=VARIANTS) < 0.5
        )  # leave a corner out, by having it stand on the one before
        many[some, out[some]] = many[some, out[some] - 1]
        many[:, 0] = W[0]
        if self.target.q is not None:
            many[:, -1] = W[-1]
        return np.clip(many, self.target.lower, self.target.upper)

    def _room(self, W: Array) -> Array:
        """Return the least distance (K,) to the singular set along corners (K, k, n)."""
        a, b = W[:, :-1, None], W[:, 1:, None]
        points = a + self._along * (b - a)
        return self.free.least_distance(points.reshape(len(W), -1, W.shape[2]))

    def _turns(self, W: Array) -> Array:
        """Return the turns of the spacecraft (K, 3, 3) along corners (K, k, n)."""
        if len(W) == 0:
            return np.empty((0, 3, 3))
        K, k, n = W.shape
        step = np.diff(W, axis=1)
        Q = W[:, :-1, None] + self._gauss * step[:, :, None]
        rates = np.broadcast_to((k - 1) * step[:, :, None], Q.shape)
        return spacecraft_turns(self.arm, Q.reshape(K, -1, n), rates.reshape(K, -1, n))


def by_tree(problem: Problem) -> Rows:
    """Grow a tree of joint motions until one of them leads to the goal, and shorten it."""
    return _first(problem, _tree(problem).motions(TREES << problem.account.rounds))


def by_boxes(problem: Problem) -> Rows:
    """Go through boxes to joint positions or a place of the tip, and shorten the way.

    Raises:
        NoSolutionError: No boxes lead to the goal.
        ConfigurationError: The boxes are those of another arm.
    """
    boxes, arm = problem.request.search.boxes, problem.start.arm
    if boxes is None:
        raise NoSolutionError("there are no boxes; give boxes=sa.free_boxes(arm)")
    if digest_of_set(boxes.arm, boxes.mode) != digest_of_set(arm, FLOATING):
        raise ConfigurationError(
            f"boxes are those of {boxes.arm.name}, {boxes.mode}, not of this floating {arm.name}; "
            "give boxes=sa.free_boxes(arm)"
        )
    return _first(problem, _tree(problem).through(boxes))


def _tree(problem: Problem) -> Tree:
    """Return the search from the start.

    Raises:
        NoSolutionError: The attitude at the end is prescribed.
    """
    if problem.target.attitude is not None:
        raise NoSolutionError("straight pieces are led to no attitude of the spacecraft")
    return Tree(problem.guesses(problem.start, problem.target), problem.collisions)


def _first(problem: Problem, ways: Iterator[Array]) -> Rows:
    """Return the rows of the first way (m, n) that keeps all constraints."""
    why = "none of its motions arrives"
    for corners in ways:
        try:
            return problem.check(_landed(problem, corners))
        except NoSolutionError as error:
            why = str(error)
    raise NoSolutionError(why, problem.best)


def _landed(problem: Problem, corners: Array) -> Rows:
    """Return rows through corners (m, n), the end of the last piece made exact by Newton's method.

    Raises:
        NoSolutionError: It cannot be made exact.
    """
    for _ in range(NEWTON_STEPS):
        pieces = [straight_rows(a, b)[1:] for a, b in itertools.pairwise(corners)]
        rows = problem.walk(problem.start, np.vstack((corners[:1], *pieces)))
        left = problem.target.missed(problem.start, rows[-1])
        if np.linalg.norm(left) <= ARRIVED:
            return rows
        if problem.target.q is not None:
            corners[-1] = problem.target.q
            continue
        J = goal_rows(rows[-1], generalized_jacobian(rows[-1]))
        corners = corners.copy()
        corners[-1] += np.linalg.lstsq(J, left, rcond=None)[0]
    raise NoSolutionError("the end of a motion cannot be made exact", rows)


def straight_rows(start: Array, end: Array) -> Array:
    """Return rows (m, n) of a straight motion; only the start if both ends are the same."""
    steps = math.ceil(float(np.abs(end - start).sum()) / SPACING)
    return start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - start)
