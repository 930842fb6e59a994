"""Problem: what a plan must achieve, checked before the search, and the check of its solutions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from spacearm.arrays import Array
from spacearm.collisions.courses import Course, Floating
from spacearm.collisions.obstacles import Obstacle
from spacearm.collisions.separation import Collisions, Contact, collision_geometry
from spacearm.errors import NoSolutionError, UnsupportedError
from spacearm.mechanics.batch import evaluate
from spacearm.mechanics.distance import distance_at
from spacearm.mechanics.floating import walk
from spacearm.mechanics.jacobian import task_jacobian
from spacearm.model.arguments import FLOATING, HELD
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.planning.account import SearchAccount
from spacearm.planning.guesses import GuessFinder
from spacearm.planning.optimiser import Target
from spacearm.planning.reactions.turns import largest_turn
from spacearm.planning.timing import rest_to_rest_times
from spacearm.singularities.report import angle
from spacearm.singularities.sets import prove_regular

Rows: TypeAlias = list[Configuration]
"""The configurations along a motion, which is straight in joint space between them."""

WAVES = 3
"""Number of sines of curves and loops."""
TOGETHER = 100
"""Rows that are walked or proven regular between two looks at the clock."""


@dataclass
class Problem:
    """A planning problem.

    Attributes:
        start: Configuration in which the motion begins.
        target: What the motion must achieve.
        ample: Clearance that is aimed at first.
        rates: (n,) largest joint rates [rad/s] or [m/s].
        seed: Seed of the random first guesses.
        search: The time of the search, and its account.
        collisions: The bodies that must not meet; None if collisions do not count.
        held: The arm itself if the start is one on a spacecraft that does not turn.
        keep: Largest turn of the spacecraft on the way [rad]; None for any.
        best: The last attempt that is no solution.
        note: Remark of a method on its solution.
    """

    start: Configuration
    target: Target
    ample: float
    rates: Array
    seed: int
    search: SearchAccount
    collisions: Collisions | None
    held: SpaceArm | None = None
    keep: float | None = None
    best: Rows | None = None
    note: str = ""

    def check(self, rows: Rows) -> Rows:
        """Return rows that arrive if they keep clearance, joint limits and distance between bodies.

        Raises:
            NoSolutionError: They do not.
        """
        q = np.array([cfg.q for cfg in rows])
        distance = self._distances(q)
        worst = int(np.argmin(distance))
        if distance[worst] < self.target.clearance:
            self.search.ways["singular"] += 1
            raise NoSolutionError(
                f"the distance to the singular set falls to {angle(distance[worst])} at "
                f"q = {self.start.arm.in_words(q[worst])}, below the clearance of "
                f"{angle(self.target.clearance)}"
            )
        over = np.maximum(q - self.target.upper, self.target.lower - q).max(axis=0)
        if over.max() > 0.0:
            name = self.start.arm.joint_names[int(over.argmax())]
            self.search.ways["limits"] += 1
            raise NoSolutionError(f"joint {name!r} goes {over.max():.2g} beyond its limit")
        self._check_turn(rows)
        arm, mode = (self.held, HELD) if self.held else (self.start.arm, FLOATING)
        for i in range(0, max(len(q) - 1, 1), TOGETHER):
            self.search.check_time()
            proof = prove_regular(arm, q[i : i + TOGETHER + 1], mode=mode)
            if proof is None:
                break
            if proof.at is not None:
                self.search.ways["singular"] += 1
                met = "is met" if proof.verdict == "singular" else "is near"
                raise NoSolutionError(
                    f"a singularity {met} at q = {self.start.arm.in_words(proof.at)}"
                )
        if (contact := self._contact(q, lambda: rows, 0.0)) is not None:
            raise NoSolutionError(str(contact))
        return rows

    def _distances(self, q: Array) -> Array:
        """Return the distances to the singular set (m,), negative on the other side [rad]."""
        arm = self.start.arm
        if len(arm.tips) == 1:
            return evaluate(arm, q, ("distance",))["distance"]
        rows = [arm.at(row) for row in q]
        J = np.array([task_jacobian(cfg) for cfg in rows])
        sign = np.sign(np.linalg.det(J)) if arm.n == arm.task.k else np.ones(len(q))
        return sign[0] * sign * np.array([distance_at(cfg, FLOATING) for cfg in rows])

    def _check_turn(self, rows: Rows) -> None:
        """Raise a NoSolutionError if the spacecraft turns too far."""
        if self.keep is None:
            return
        turn = largest_turn(rows)
        self.note = f"the spacecraft turns by at most {turn:.2g} rad, between the rows too"
        if turn > self.keep:
            self.search.ways["turn"] += 1
            raise NoSolutionError(
                f"the spacecraft turns by up to {angle(turn)}, and keep_attitude allows "
                f"{angle(self.keep)}",
                rows,
            )

    def _contact(self, path: Array, rows: Callable[[], Rows], before: float) -> Contact | None:
        """Return a contact on a motion through joint positions (m, n) that begins at a time [s].

        Where the spacecraft is, as `rows` returns it, matters to obstacles only.
        """
        if self.collisions is None:
            return None
        way: Array | Course = path
        if self.collisions.obstacles:
            way = Floating(rows(), before + rest_to_rest_times(path, self.rates))
        contact = self.collisions.contact(way, self.search.check_time)
        if contact is not None:
            self.search.ways["contact"] += 1
            self.search.contacts[" meets ".join(map(repr, contact.links))] += 1
        return contact

    def contact(self, start: Configuration, path: Array, before: float = 0.0) -> Contact | None:
        """Return a contact on straight joint segments; None if none is there or counts.

        Args:
            start: Where the motion begins.
            path: (m, n) the segments, the first row start.q.
            before: When it begins [s].
        """
        self.search.check_time()
        return self._contact(path, lambda: self.walk(start, path), before)

    def stopped(self, q: Array) -> str:
        """Return why a motion cannot go through joint positions (n,), in words, or nothing.

        Joint limits and contacts of the arm's own bodies count.
        """
        self.search.check_time()
        over = np.maximum(q - self.target.upper, self.target.lower - q)
        if over.max() > 0.0:
            self.search.ways["limits"] += 1
            return f"joint {self.start.arm.joint_names[int(over.argmax())]!r} reaches its limit"
        if self.collisions is not None and self.collisions.touch(q):
            self.search.ways["contact"] += 1
            return "bodies meet"
        return ""

    def walk(self, start: Configuration, path: Array) -> Rows:
        """Return the configurations along straight joint segments (m, n), as `floating.walk`."""
        rows = [start]
        for i in range(1, len(path), TOGETHER):
            self.search.check_time()
            rows += walk(rows[-1], np.vstack((rows[-1].q, path[i : i + TOGETHER])))[1:]
        return rows

    def guesses(self, start: Configuration, target: Target) -> GuessFinder:
        """Return the finder of first guesses for motions from a configuration."""
        rounds = self.search.rounds
        rng = np.random.default_rng((self.seed, rounds) if rounds else self.seed)
        return GuessFinder(start, target, WAVES, rng, self.search, self.collisions)


def travel(rows: Rows) -> float:
    """Return the sum of the motions of all joints [rad] or [m]."""
    return float(np.abs(np.diff([cfg.q for cfg in rows], axis=0)).sum())


def bodies_apart(cfg: Configuration, target: Target, obstacles: tuple[Obstacle, ...]) -> Collisions:
    """Return the bodies that must not meet.

    Raises:
        NoSolutionError: Some meet at the start or at the goal.
    """
    bodies = Collisions(cfg.arm, obstacles) if obstacles else collision_geometry(cfg.arm)
    if obstacles and not bodies.bodies:
        raise UnsupportedError(
            f"{cfg.arm.name} has no shapes that could be held off obstacles; give its links "
            "collision geometry or visuals"
        )
    for what, way in (("start", Floating([cfg], np.zeros(1))), ("goal", target.q)):
        if way is None or not bodies:
            continue
        contact = bodies.contact(way if isinstance(way, Floating) else way[None])
        if contact is not None:
            remedy = "collisions=False ignores it"
            if any(contact.links[1].startswith(obstacle.name) for obstacle in obstacles):
                remedy = "move the obstacle, lower its margin, or name the link in its may_touch"
            raise NoSolutionError(f"the {what} is in collision: {contact}; {remedy}")
    return bodies
