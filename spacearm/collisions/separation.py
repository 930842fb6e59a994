"""Separation: the bodies of an arm and of obstacles, and the proof that none meet on a motion.

Distances are those of coal through Pinocchio. A motion is proven free by conservative advancement:
on a piece of it no body comes nearer to another than by what the joints and the spacecraft move
them. coal has that for two bodies on given paths, not for the bodies of a chain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.collisions.courses import Course, InJointSpace, interpolated
from spacearm.collisions.obstacles import Obstacle
from spacearm.collisions.pairs import own_pairs
from spacearm.errors import listed
from spacearm.model.arm import Configuration, SpaceArm


class Contact(NamedTuple):
    """Two bodies that touch, or come nearer than the margin of an obstacle.

    Attributes:
        q: (n,) joint positions there.
        links: Their names.
        t: When, from the beginning of the motion [s]; NaN where no times are known.
        distance: How far they are apart [m], negative where they overlap.
        margin: How far they must be apart [m].
    """

    q: Array
    links: tuple[str, str]
    t: float
    distance: float
    margin: float

    def __str__(self) -> str:
        values = ", ".join(f"{x:.4g}" for x in self.q)
        a, b = map(repr, self.links)
        what = f"{a} meets {b}"
        if self.margin and self.distance > 0.0:
            what = f"{a} comes as near as {self.distance:.3g} m to {b}, within its margin"
            what += f" of {self.margin:g} m,"
        when = "" if np.isnan(self.t) else f" after {self.t:.4g} s"
        return f"{what} at q = ({values}){when}"


class Collisions:
    """The bodies of an arm and obstacles, and the pairs of them that must not meet.

    Links that a joint of the description connects may touch, locked and fixed ones included, and
    bodies that touch in every posture.

    Attributes:
        bodies: All bodies of the arm.
        obstacles: The obstacles.
        account: What is checked and what is not, in one sentence.

    Args:
        arm: The arm.
        obstacles: The obstacles; bodies of the arm meet them, obstacles may meet each other.

    Raises:
        ModelError: Collision geometry of a link is faulty.
    """

    def __init__(self, arm: SpaceArm, obstacles: Sequence[Obstacle] = ()) -> None:
        self.arm, self.obstacles = arm, tuple(obstacles)
        own = own_pairs(arm)
        self.bodies = own.bodies
        self._geometry = pin.GeometryModel()
        for i, body in enumerate(self.bodies):
            self._add(f"{i}", body.joint, body.pose, body.shape)
        self._parts = [(o, part) for o in obstacles for part in o.parts]
        for i, (_, part) in enumerate(self._parts):
            self._add(f"part {i}", 0, pin.SE3.Identity(), part.solid)
        first, against = len(self.bodies), []
        self._moving = {first + j for j, (o, _) in enumerate(self._parts) if o.moves}
        for j, (obstacle, _) in enumerate(self._parts):
            free = set(obstacle.may_touch)
            against += [(i, first + j) for i, b in enumerate(self.bodies) if b.link not in free]
        self._own = len(own.pairs)
        self._pairs = [*own.pairs, *against]
        for pair in self._pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(*pair))
        margins = [self._parts[b - first][0].margin for _, b in against]
        self._margins = np.append(np.zeros(self._own), margins)
        self._near = own.close + self._margins
        self.account = _account(own.account, self.obstacles)

    def __bool__(self) -> bool:
        """Whether any bodies may meet."""
        return bool(self._pairs)

    def _add(self, name: str, joint: int, pose: pin.SE3, solid: object) -> None:
        self._geometry.addGeometryObject(pin.GeometryObject(name, joint, pose, solid))

    def links(self, pair: int) -> tuple[str, str]:
        """Return the names of the bodies of a pair."""
        names = [body.link for body in self.bodies]
        names += [o.name + f" ({part.link})" * bool(part.link) for o, part in self._parts]
        a, b = self._pairs[pair]
        return names[a], names[b]

    def distances(self, q: Array) -> Array:
        """Return distances (own pairs,) of the arm's bodies, negative where they overlap [m]."""
        return self._distances(self.arm.all_joints(q), None, 0.0, np.arange(self._own))

    def touch(self, q: Array) -> bool:
        """Tell whether bodies of the arm meet each other at joint positions (n,)."""
        return bool((self.distances(q) < self._near[: self._own]).any())

    def touching(self, q: Array) -> list[tuple[str, str]]:
        """Return the names of the bodies of the arm that meet each other at positions (n,)."""
        pairs = np.flatnonzero(self.distances(q) < self._near[: self._own])
        return list(dict.fromkeys(self.links(int(pair)) for pair in pairs))

    def clear(self, cfg: Configuration, com: Array) -> bool:
        """Tell whether the bodies of a configuration meet none of the bodies that rest.

        Args:
            cfg: The configuration.
            com: (3,) where its system CM stands [m].
        """
        resting = [
            i for i, p in enumerate(self._pairs) if i < self._own or p[1] not in self._moving
        ]
        base = pin.SE3ToXYZQUAT(cfg.centred(com).base)
        joints, pairs = self.arm.all_joints(cfg.q), np.array(resting, dtype=np.int64)
        return bool((self._distances(joints, base, 0.0, pairs) >= self._near[pairs]).all())

    def margins(self, course: Course, u: float) -> Array:
        """Return distances less margins (pairs,) at a point of a course [m]."""
        here = np.arange(len(self._pairs))
        full = course.full(u)
        return self._distances(full[7:], full[:7], course.time(u), here) - self._margins

    def _distances(
        self, joints: Array, base: Array | None, t: float, pairs: npt.NDArray[np.int64]
    ) -> Array:
        """Return distances of some pairs (pairs,) [m].

        Args:
            joints: (nv - 6,) positions of the model's joints.
            base: (7,) pose of the spacecraft; any if None.
            t: Time [s].
            pairs: Numbers of the pairs.
        """
        arm, geometry = self.arm, pin.GeometryData(self._geometry)
        data = arm.borrow()
        full = pin.neutral(arm.model)
        full[7:] = joints
        if base is not None:
            full[:7] = base
        pin.forwardKinematics(arm.model, data, full)
        pin.updateGeometryPlacements(arm.model, data, self._geometry, geometry)
        arm.give_back(data)
        if base is not None:
            poses = [pose for obstacle in self.obstacles for pose in obstacle.poses(t)]
            for i, pose in enumerate(poses, len(self.bodies)):
                geometry.oMg[i] = pose
        compute = pin.computeDistance
        return np.array(
            [compute(self._geometry, geometry, int(i)).min_distance for i in pairs],
            dtype=np.float64,
        )

    def contact(
        self, way: Array | Course, check_time: Callable[[], None] = lambda: None
    ) -> Contact | None:
        """Find a contact on a motion; None if there is proven to be none.

        Args:
            way: The motion; or (m, n) joint positions on straight segments: then the bodies of the
                arm are checked against each other only.
            check_time: Called now and then; it may raise an error to end the search.
        """
        course = way if isinstance(way, Course) else InJointSpace(self.arm, way)
        pairs = np.arange(len(self._pairs) if course is way else self._own)
        if not len(pairs):
            return None
        travel = self._travel(course)
        waiting = [(0.0, len(course) - 1.0, pairs)]
        while waiting:
            check_time()
            low, high, pairs = waiting.pop()
            u = 0.5 * (low + high)
            full = course.full(u)
            distance = self._distances(full[7:], full[:7], course.time(u), pairs)
            short = distance - self._near[pairs]
            if short.min() < 0.0:
                worst = int(short.argmin())
                pair = int(pairs[worst])
                return Contact(
                    course.joints(u), self.links(pair), course.time(u), float(distance[worst]),
                    float(self._margins[pair]),
                )  # fmt: skip
            way_there = travel[pairs]
            here = interpolated(way_there.T, u)
            half = np.maximum(
                here - interpolated(way_there.T, low), interpolated(way_there.T, high) - here
            )
            half += self._approach(course, pairs, low, high)
            open_ones = pairs[short <= half]
            if len(open_ones):
                waiting += [(u, high, open_ones), (low, u, open_ones)]
        return None

    def _approach(
        self, course: Course, pairs: npt.NDArray[np.int64], low: float, high: float
    ) -> Array:
        """Return how far the obstacles of some pairs move from the middle at most (pairs,) [m]."""
        if not any(obstacle.moves for obstacle in self.obstacles):
            return np.zeros(len(pairs))
        t0, t, t1 = (course.time(x) for x in (low, 0.5 * (low + high), high))
        part_of = {
            i: max(o.moved(part, t0, t), o.moved(part, t, t1))
            for i, (o, part) in enumerate(self._parts, len(self.bodies))
        }
        return np.array([part_of.get(self._pairs[i][1], 0.0) for i in pairs])

    def _travel(self, course: Course) -> Array:
        """Return how far the bodies of all pairs move against each other up to each row at most.

        Those of the arm: (pairs, m) [m]. The obstacles' own motion is not in it.
        """
        path = course.path
        steps = np.abs(np.diff(path, axis=0))
        way = self.gains(path) @ steps.T
        if len(self._pairs) > self._own:
            body = course.swept(self.bodies)
            way = np.vstack((way, [body[a] for a, _ in self._pairs[self._own :]]))
        return np.hstack((np.zeros((len(way), 1)), way.cumsum(axis=1)))

    def gains(self, path: Array) -> Array:
        """Return how far joints move two bodies of the arm against each other at most [m/rad].

        A joint does so if it carries only one of them. Sliding joints between it and the body make
        its lever longer, by no more than their largest displacement on the path.

        Args:
            path: (m, n) joint positions of straight segments.

        Returns:
            (own pairs, n) the bounds.
        """
        arm = self.arm
        out = np.abs([arm.all_joints(q) for q in path]).max(axis=0)
        gains = np.zeros((self._own, arm.model.nv - 6))
        for gain, (i, j) in zip(gains, self._pairs, strict=False):
            a, b = self.bodies[i], self.bodies[j]
            for body, other in ((a, b), (b, a)):
                for joint in body.reach.keys() - other.reach.keys():
                    gain[joint - 2] = body.reach[joint] + out[body.slides[joint]].sum()
        return gains if arm.coupling is None else gains @ np.abs(arm.coupling)


def _account(own: str, obstacles: Sequence[Obstacle]) -> str:
    """Return what a check covers, in one sentence."""
    if not obstacles:
        return own
    names = listed([o.name + f" ({o.margin:g} m off)" * bool(o.margin) for o in obstacles])
    touch = [f"{link} may touch {o.name}" for o in obstacles for link in o.may_touch]
    allowed = f", {listed(touch)}" * bool(touch)
    return f"{own}; obstacles: {names}{allowed}"


@lru_cache(maxsize=16)
def collision_geometry(arm: SpaceArm) -> Collisions:
    """Return the collisions of an arm alone, made once; errors as for `Collisions`."""
    return Collisions(arm)
