"""Bodies of an arm that may collide, how far its joints can move them, and which must not meet.

A link counts with its collision geometry. Where the description gives none that can be read, its
visuals stand in, each as its convex hull, or as the box around it where it is flat. Links without
either are not checked, and `Bodies.account` names them.

Links that a joint of the description connects may touch, locked and fixed ones included, and bodies
that touch in every posture.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterable, Mapping
from functools import cached_property, lru_cache
from itertools import combinations
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, Integers
from spacearm.collisions.solids import collision_solids, visual_solids
from spacearm.description.shapes import Visuals
from spacearm.errors import UnsupportedError, listed
from spacearm.model.arm import SpaceArm

#: Random postures; bodies that touch in all of them are taken to be joined.
POSTURES = 64
#: Shapes of an arm whose collisions are checked: pairs grow as the square of their number.
MOST_BODIES = 1_000
#: Distance below which bodies count as touching, as a share of the arm's reach.
CLOSE = 1e-4
#: Begins what a check of collisions leaves out.
LEFT_OUT = "NOT checked: "
NOWHERE: Mapping[int, pin.SE3] = {}


class Body(NamedTuple):
    """A shape: its link, the joint that carries it, and its pose there.

    Each joint between the spacecraft and the body moves its points by at most `reach` [m/rad], plus
    the displacement of the sliding joints between, named in `slides`; a sliding joint itself by 1.
    The points are at most `far` [m] from the origin of the spacecraft frame, plus all of these
    displacements.
    """

    link: str
    joint: int
    pose: pin.SE3
    shape: coal.CollisionGeometry
    reach: dict[int, float]
    slides: dict[int, list[int]]
    far: float


class Bodies:
    """The bodies of an arm that may collide.

    Attributes:
        all: The bodies.
        by_collision: Links that count with their collision geometry.
        by_visual: Links that count with their visuals.
        without: Links whose shapes cannot be used, and moving bodies without any: not checked.

    Args:
        arm: The arm.

    Raises:
        ModelError: Collision geometry of a link is faulty.
    """

    def __init__(self, arm: SpaceArm) -> None:
        self.all: list[Body] = []
        self.by_collision: list[str] = []
        self.by_visual: list[str] = []
        self.without: list[str] = []
        for leader, links in arm.tree.lumps.items():
            found = [link for link in links if self._add(arm, link)]
            if not found and any(arm.tree.links[link] for link in links):
                self.without.append(leader)

    def _add(self, arm: SpaceArm, link: str) -> bool:
        """Add the shapes of a link; return whether it has any."""
        shapes = arm.tree.visuals.get(link, Visuals())
        if found := list(collision_solids(arm.path, link, shapes)):
            self.by_collision.append(link)
        elif found := list(visual_solids(shapes)):
            self.by_visual.append(link)
        elif shapes.visual or shapes.collision:
            self.without.append(link)
        frame = arm.model.frames[arm.model.getFrameId(link, pin.BODY)]
        for solid, at in found:
            pose = frame.placement * at
            self.all.append(
                Body(link, frame.parentJoint, pose, solid, *_reach(arm, frame, pose, solid))
            )
        return bool(found) or link in self.without

    @property
    def account(self) -> str:
        """What a check of collisions covers, in one sentence."""
        if not self.all:
            return "collisions NOT checked: the description gives the links no shapes"
        ways = [
            f"by their collision geometry {listed(self.by_collision)}" * bool(self.by_collision),
            f"by their visuals {listed(self.by_visual)}" * bool(self.by_visual),
        ]
        missed = f"; {LEFT_OUT}{without_shapes(self.without)}" * bool(self.without)
        return f"collisions checked: {', '.join(filter(None, ways))}{missed}"


def left_out(account: str) -> str:
    """Return what an account of a check left out, in words; empty if nothing, all if it is."""
    if not account or account.startswith("collisions NOT checked"):
        return "collisions"
    left = [part for part in account.split("; ") if part.startswith(LEFT_OUT)]
    return "".join(left).removeprefix(LEFT_OUT)


def but_for(left: str) -> str:
    """Return the end of a verdict that says what was left out of it; empty if nothing was."""
    return f"; {LEFT_OUT}{left}" * bool(left)


def without_shapes(links: Collection[str]) -> str:
    """Return in words which links have no usable shapes; empty if there are none."""
    return f"links without shapes: {listed(links)}" * bool(links)


def extent(pose: pin.SE3, shape: coal.CollisionGeometry) -> float:
    """Return a length that no point of a shape at a pose is farther than from the origin [m]."""
    shape.computeLocalAABB()
    return float(np.linalg.norm(pose.act(shape.aabb_center)) + shape.aabb_radius)


def slides_along(arm: SpaceArm, joint: int) -> bool:
    """Tell whether a joint of the model slides."""
    return bool(arm.tree.joints[arm.model.names[joint]].kind == "prismatic")


def _reach(
    arm: SpaceArm, frame: pin.Frame, pose: pin.SE3, shape: coal.CollisionGeometry
) -> tuple[dict[int, float], dict[int, list[int]], float]:
    """Return reach and slides of a body, for each joint that carries it, and its far."""
    far = extent(pose, shape)
    reach: dict[int, float] = {}
    slides: dict[int, list[int]] = {}
    between: list[int] = []
    joint = frame.parentJoint
    while joint > 1:
        sliding = slides_along(arm, joint)
        reach[joint], slides[joint] = (1.0, []) if sliding else (far, list(between))
        between += [joint - 2] if sliding else []
        far += float(np.linalg.norm(arm.model.jointPlacements[joint].translation))
        joint = arm.model.parents[joint]
    return reach, slides, far


class Geometry:
    """Solids on the joints of an arm, and pairs of them.

    Args:
        arm: The arm.
        solids: The joint that carries each, its pose there and the solid of coal.
        pairs: Numbers of the solids in each pair.
    """

    def __init__(
        self,
        arm: SpaceArm,
        solids: Iterable[tuple[int, pin.SE3, coal.CollisionGeometry]],
        pairs: Iterable[tuple[int, int]],
    ) -> None:
        self._arm, self._model = arm, pin.GeometryModel()
        self._spare: list[pin.GeometryData] = []  # making one takes longer than a distance
        for i, (joint, pose, solid) in enumerate(solids):
            self._model.addGeometryObject(pin.GeometryObject(f"{i}", joint, pose, solid))
        for pair in pairs:
            self._model.addCollisionPair(pin.CollisionPair(*pair))

    def distances(
        self,
        joints: Array,
        pairs: Integers,
        base: Array | None = None,
        placed: Mapping[int, pin.SE3] = NOWHERE,
    ) -> Array:
        """Return the distances of some pairs (pairs,), negative where they overlap [m].

        Args:
            joints: (nv - 6,) positions of the model's joints.
            pairs: Numbers of the pairs.
            base: (7,) pose of the spacecraft; any if None.
            placed: Inertial poses of solids that the arm does not carry, by their numbers.
        """
        arm = self._arm
        geometry = self._spare.pop() if self._spare else self._data()
        data, full = arm.borrow(), pin.neutral(arm.model)
        full[7:] = joints
        if base is not None:
            full[:7] = base
        pin.forwardKinematics(arm.model, data, full)
        pin.updateGeometryPlacements(arm.model, data, self._model, geometry)
        arm.give_back(data)
        for i, pose in placed.items():
            geometry.oMg[i] = pose
        compute = pin.computeDistance
        found = [compute(self._model, geometry, int(i)).min_distance for i in pairs]
        self._spare.append(geometry)
        return np.array(found, dtype=np.float64)

    def slope(self, joints: Array, pair: int) -> Array:
        """Return how the distance of a pair on the arm grows with the joints (nv - 6,) [m/rad].

        By the velocities of the two nearest points along the normal between the bodies, which both
        are on.

        Args:
            joints: (nv - 6,) positions of the model's joints.
            pair: Number of the pair.
        """
        arm = self._arm
        geometry = self._spare.pop() if self._spare else self._data()
        data, full = arm.borrow(), pin.neutral(arm.model)
        full[7:] = joints
        pin.computeJointJacobians(arm.model, data, full)
        pin.updateGeometryPlacements(arm.model, data, self._model, geometry)
        found = pin.computeDistance(self._model, geometry, pair)
        normal, point = found.normal, found.getNearestPoint1()
        slope = np.append(normal, pin.skew(point) @ normal) @ data.J[:, 6:]
        arm.give_back(data)
        self._spare.append(geometry)
        return np.asarray(self._parted[pair] * slope)

    @cached_property
    def _parted(self) -> Array:
        """(pairs, nv - 6) 1 where a joint carries the second solid alone, -1 the first alone."""
        carried = np.zeros((self._arm.model.njoints, self._arm.model.nv - 6))
        for joint, above in enumerate(self._arm.model.supports):
            carried[joint, [i - 2 for i in above if i > 1]] = 1.0
        at = [solid.parentJoint for solid in self._model.geometryObjects]
        ends = np.array([(at[p.first], at[p.second]) for p in self._model.collisionPairs])
        return carried[ends[:, 1]] - carried[ends[:, 0]]

    def _data(self) -> pin.GeometryData:
        """Make a pin.GeometryData, whose distances do not depend on what was asked before."""
        data = pin.GeometryData(self._model)
        with warnings.catch_warnings():  # coal calls the only switch for this deprecated
            warnings.simplefilter("ignore", DeprecationWarning)
            for request in data.distanceRequests:
                request.enable_cached_gjk_guess = False
        return data


class OwnPairs(NamedTuple):
    """The bodies of an arm, the pairs that must not meet, and what counts as touching [m]."""

    bodies: list[Body]
    pairs: list[tuple[int, int]]
    close: float
    account: str
    without: tuple[str, ...]


@lru_cache(maxsize=16)
def own_pairs(arm: SpaceArm) -> OwnPairs:
    """Return the pairs of an arm's own bodies that must not meet; errors as for `Collisions`."""
    found = Bodies(arm)
    bodies = found.all
    if len(bodies) > MOST_BODIES:
        raise UnsupportedError(
            f"{arm.name} has {len(bodies):,} shapes; collisions are checked of at most "
            f"{MOST_BODIES:,}: give its links fewer <collision> elements, or collisions=False"
        )
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
    geometry = Geometry(arm, [(body.joint, body.pose, body.shape) for body in bodies], pairs)
    always = np.arange(len(pairs))
    for q in Q:
        always = always[geometry.distances(arm.all_joints(q), always) < close]
    kept = [pair for number, pair in enumerate(pairs) if number not in set(always.tolist())]
    return OwnPairs(bodies, kept, close, found.account, tuple(found.without))


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
