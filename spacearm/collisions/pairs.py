"""Pairs: which bodies of an arm must not meet each other.

Links that a joint of the description connects may touch, locked and fixed ones included, and bodies
that touch in every posture.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.collisions.bodies import Bodies, Body
from spacearm.model.arm import SpaceArm

POSTURES = 64
"""Random postures; bodies that touch in all of them are taken to be joined."""
CLOSE = 1e-4
"""Distance below which bodies count as touching, as a share of the arm's reach."""


class OwnPairs(NamedTuple):
    """The bodies of an arm, the pairs that must not meet, and what counts as touching [m]."""

    bodies: list[Body]
    pairs: list[tuple[int, int]]
    close: float
    account: str


@lru_cache(maxsize=16)
def own_pairs(arm: SpaceArm) -> OwnPairs:
    """Return the pairs of an arm's own bodies that must not meet; errors as for `Collisions`."""
    found = Bodies(arm)
    bodies = found.all
    joined = _connected(arm, {body.link for body in bodies})
    pairs = [
        (i, j)
        for (i, a), (j, b) in combinations(enumerate(bodies), 2)
        if a.joint != b.joint and frozenset((a.link, b.link)) not in joined
    ]
    close = CLOSE * max((r for body in bodies for r in body.reach.values()), default=0.0)
    low = np.where(np.isfinite(arm.lower), arm.lower, -np.pi)
    high = np.where(np.isfinite(arm.upper), arm.upper, np.pi)
    Q = np.random.default_rng(0).uniform(low, high, (POSTURES, arm.n))
    geometry = pin.GeometryModel()
    for i, body in enumerate(bodies):
        solid = pin.GeometryObject(f"{i}", body.joint, body.pose, body.shape)
        geometry.addGeometryObject(solid)
    for pair in pairs:
        geometry.addCollisionPair(pin.CollisionPair(*pair))
    placed, data, full = pin.GeometryData(geometry), arm.borrow(), pin.neutral(arm.model)
    touching = np.ones(len(pairs), dtype=bool)
    for q in Q:
        full[7:] = arm.all_joints(q)
        pin.forwardKinematics(arm.model, data, full)
        pin.updateGeometryPlacements(arm.model, data, geometry, placed)
        for number in np.flatnonzero(touching).tolist():
            near = pin.computeDistance(geometry, placed, number).min_distance
            touching[number] = near < close
    arm.give_back(data)
    kept = [pair for pair, always in zip(pairs, touching, strict=True) if not always]
    return OwnPairs(bodies, kept, close, found.account)


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
