"""Collisions of the arm with the spacecraft and itself.

Distances are those of coal, the library behind Pinocchio. A motion is proven free by conservative
advancement: on a piece of it no body comes nearer to another than by the motion of the joints
between the two. coal has that for two bodies on given paths, not for the bodies of a chain.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.model.arm import SpaceArm
from spacearm.planning.bodies import Bodies, Body

POSTURES = 64
"""Random postures; bodies that touch in all of them are taken to be joined."""
CLOSE = 1e-4
"""Distance below which bodies count as touching, as a share of the arm's reach."""


class Contact(NamedTuple):
    """Two bodies that touch.

    Attributes:
        q: (n,) joint positions there.
        links: Their names.
    """

    q: Array
    links: tuple[str, str]

    def __str__(self) -> str:
        values = ", ".join(f"{x:.4g}" for x in self.q)
        return f"{self.links[0]!r} meets {self.links[1]!r} at q = ({values})"


class Collisions:
    """The bodies of an arm, and the pairs of them that must not meet.

    Links that a joint of the description connects may touch, locked and fixed ones included, and
    bodies that touch in every posture.

    Attributes:
        bodies: All bodies.
        account: What is checked and what is not, in one sentence.

    Args:
        arm: The arm.

    Raises:
        ModelError: Collision geometry of a link is faulty.
    """

    def __init__(self, arm: SpaceArm) -> None:
        found = Bodies(arm)
        self.arm, self.bodies, self.account = arm, found.all, found.account
        joined = _connected(arm, {body.link for body in self.bodies})
        self._pairs = [
            (a, b)
            for a, b in combinations(self.bodies, 2)
            if a.joint != b.joint and frozenset((a.link, b.link)) not in joined
        ]
        self._close = CLOSE * max(
            (r for body in self.bodies for r in body.reach.values()), default=0.0
        )
        low = np.where(np.isfinite(arm.lower), arm.lower, -np.pi)
        high = np.where(np.isfinite(arm.upper), arm.upper, np.pi)
        Q = np.random.default_rng(0).uniform(low, high, (POSTURES, arm.n))
        touching = np.all([self.distances(q) < self._close for q in Q], axis=0)
        self._pairs = [
            pair for pair, always in zip(self._pairs, touching, strict=True) if not always
        ]

    def __bool__(self) -> bool:
        """Whether any bodies may meet."""
        return bool(self._pairs)

    def distances(self, q: Array) -> Array:
        """Return distances (pairs,) of bodies that may meet, negative where they overlap [m]."""
        arm = self.arm
        data = arm.borrow()
        full = pin.neutral(arm.model)
        full[7:] = arm.all_joints(q)
        pin.forwardKinematics(arm.model, data, full)
        oMi, pairs = list(data.oMi), self._pairs
        arm.give_back(data)
        return np.array([self._distance(a, oMi[a.joint], b, oMi[b.joint]) for a, b in pairs])

    def contact(self, path: Array) -> Contact | None:
        """Find a contact on straight joint segments; None if there is proven to be none.

        Args:
            path: (m, n) joint positions, at least one row.
        """
        if not self._pairs:
            return None
        gains = self.gains(path)
        travel = np.vstack((np.zeros(self.arm.n), np.abs(np.diff(path, axis=0)).cumsum(axis=0)))
        waiting = [(0.0, len(path) - 1.0)]
        while waiting:
            low, high = waiting.pop()
            u = 0.5 * (low + high)
            q, here = _at(path, u), _at(travel, u)
            half = np.maximum(here - _at(travel, low), _at(travel, high) - here)
            distance = self.distances(q)
            if distance.min() < self._close:
                a, b = self._pairs[int(distance.argmin())]
                return Contact(q, (a.link, b.link))
            if (distance > gains @ half).all():
                continue
            waiting += [(u, high), (low, u)]
        return None

    def _distance(self, a: Body, at: pin.SE3, b: Body, there: pin.SE3) -> float:
        poses = (at * a.pose, there * b.pose)
        A, B = (coal.Transform3s(pose.rotation, pose.translation) for pose in poses)
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        return float(coal.distance(a.shape, A, b.shape, B, request, result))

    def gains(self, path: Array) -> Array:
        """Return how far joints move two bodies against each other at most (pairs, n), [m/rad].

        A joint does so if it carries only one of them. Sliding joints between it and the body make
        its lever longer, by no more than their largest displacement on the path.

        Args:
            path: (m, n) joint positions of straight segments.
        """
        arm = self.arm
        out = np.abs([arm.all_joints(q) for q in path]).max(axis=0)
        gains = np.zeros((len(self._pairs), arm.model.nv - 6))
        for gain, pair in zip(gains, self._pairs, strict=True):
            for body, other in (pair, pair[::-1]):
                for joint in body.reach.keys() - other.reach.keys():
                    gain[joint - 2] = body.reach[joint] + out[body.slides[joint]].sum()
        return gains if arm.coupling is None else gains @ np.abs(arm.coupling)


def _at(rows: Array, u: float) -> Array:
    """Return the value (n,) at row u, interpolated between whole numbers."""
    i = min(int(u), max(len(rows) - 2, 0))
    return rows[i] + (u - i) * (rows[min(i + 1, len(rows) - 1)] - rows[i])


@lru_cache(maxsize=16)
def collision_geometry(arm: SpaceArm) -> Collisions:
    """Return the collision geometry of an arm, read once; errors as for `Collisions`."""
    return Collisions(arm)


def _connected(arm: SpaceArm, links: Collection[str]) -> set[frozenset[str]]:
    """Return the pairs of links that a joint connects, links without geometry being passed over."""
    joints = arm.tree.joints.values()
    above = {joint.child: joint for joint in joints}

    def inner(link: str) -> str:
        while link not in links and link in above and not above[link].movable:
            link = above[link].parent
        return link

    def outer(link: str) -> list[str]:
        if link in links:
            return [link]
        return [x for j in joints if j.parent == link and not j.movable for x in outer(j.child)]

    return {frozenset((inner(j.parent), link)) for j in joints for link in outer(j.child)}
