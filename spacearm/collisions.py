"""Collisions of the arm with the spacecraft and itself, from the URDF's collision geometry.

Distances are those of coal, the library behind Pinocchio; meshes count as their convex hulls. A
motion is proven free by conservative advancement: over a piece of it no point of a body comes
nearer to another body than the joints between the two can carry it.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
from lxml import etree

from spacearm.arm import SpaceArm
from spacearm.arrays import Array
from spacearm.source import Source
from spacearm.urdf import find_mesh

POSTURES = 64
"""Random postures: bodies that touch in all of them are taken to be joined."""
CLOSE = 1e-3
"""Bodies that are nearer than this share of the arm's reach are taken to touch."""


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


class _Body(NamedTuple):
    """A geometry: its link, the joint that carries it, where it stands there, and its reach."""

    link: str
    joint: int
    pose: pin.SE3
    shape: coal.CollisionGeometry
    reach: dict[int, float]


class Collisions:
    """The collision geometry of an arm, and the pairs of bodies that must not meet.

    Bodies on both sides of one joint may touch, and bodies that touch in every posture.

    Args:
        arm: The arm.

    Raises:
        ModelError: The URDF's collision geometry cannot be read.
    """

    def __init__(self, arm: SpaceArm) -> None:
        self.arm, parents = arm, arm.model.parents
        self._pairs = [
            (a, b)
            for a, b in combinations(_bodies(arm), 2)
            if a.joint != b.joint and a.joint != parents[b.joint] and b.joint != parents[a.joint]
        ]
        Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (POSTURES, arm.n))
        joined = np.all([self.distances(q) <= 0.0 for q in Q], axis=0)
        self._pairs = [pair for pair, always in zip(self._pairs, joined, strict=True) if not always]
        self._gains = np.array([self._gain(a, b) for a, b in self._pairs])
        self._close = CLOSE * self._gains.max(initial=0.0)

    def __bool__(self) -> bool:
        """Whether any bodies may meet."""
        return bool(self._pairs)

    def distances(self, q: Array) -> Array:
        """(pairs,) distances between the bodies that may meet, negative where they overlap [m]."""
        arm = self.arm
        data = arm.borrow()
        full = pin.neutral(arm.model)
        full[7:] = arm.all_joints(q)
        pin.forwardKinematics(arm.model, data, full)
        oMi, pairs = list(data.oMi), self._pairs
        arm.give_back(data)
        return np.array([self._distance(a, oMi[a.joint], b, oMi[b.joint]) for a, b in pairs])

    def contact(self, path: Array) -> Contact | None:
        """A contact on straight joint segments, or None if there is none: that is proven.

        Args:
            path: (m, n) joint positions, at least one row.
        """
        if not self._pairs:
            return None
        travel = np.vstack((np.zeros(self.arm.n), np.abs(np.diff(path, axis=0)).cumsum(axis=0)))
        waiting = [(0.0, len(path) - 1.0)]
        while waiting:
            low, high = waiting.pop()
            u = 0.5 * (low + high)
            q, here = _at(path, u), _at(travel, u)
            half = np.maximum(here - _at(travel, low), _at(travel, high) - here)
            distance = self.distances(q)
            if (distance > self._gains @ half).all():
                continue
            if distance.min() < self._close:
                a, b = self._pairs[int(distance.argmin())]
                return Contact(q, (a.link, b.link))
            waiting += [(u, high), (low, u)]
        return None

    def _distance(self, a: _Body, at: pin.SE3, b: _Body, there: pin.SE3) -> float:
        poses = (at * a.pose, there * b.pose)
        A, B = (coal.Transform3s(pose.rotation, pose.translation) for pose in poses)
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        return float(coal.distance(a.shape, A, b.shape, B, request, result))

    def _gain(self, a: _Body, b: _Body) -> Array:
        """(n,) how far a joint moves the two against each other: if it carries only one of them."""
        gain = np.zeros(self.arm.model.nv - 6)
        for body, other in ((a, b), (b, a)):
            for joint in body.reach.keys() - other.reach.keys():
                gain[joint - 2] = body.reach[joint]
        return gain if self.arm.coupling is None else gain @ np.abs(self.arm.coupling)


def _at(rows: Array, u: float) -> Array:
    """(n,) the value at row u, between whole numbers straight."""
    i = min(int(u), max(len(rows) - 2, 0))
    value: Array = rows[i] + (u - i) * (rows[min(i + 1, len(rows) - 1)] - rows[i])
    return value


@lru_cache(maxsize=16)
def collision_geometry(arm: SpaceArm) -> Collisions:
    """The collision geometry of an arm, read once; errors as for `Collisions`."""
    return Collisions(arm)


def _bodies(arm: SpaceArm) -> Iterator[_Body]:
    """The collision geometries of the URDF."""
    source = Source(arm.path)
    for link, look in arm.tree.looks.items():
        frame = arm.model.frames[arm.model.getFrameId(link, pin.BODY)]
        for collision in etree.fromstring(look).findall("collision"):
            if (shape := _shape(source, link, collision)) is not None:
                pose = frame.placement * source.pose(collision)
                yield _Body(link, frame.parentJoint, pose, shape, _reach(arm, frame, pose, shape))


def _shape(source: Source, link: str, collision: etree._Element) -> coal.CollisionGeometry | None:
    """A shape, None for a mesh that is not there."""
    element = collision.find("geometry/*")
    if element is None or element.tag not in ("box", "sphere", "cylinder", "mesh"):
        source.fail(
            f"link {link!r} has a collision without a known geometry",
            "give it a box, sphere, cylinder or mesh, or plan with collisions=False",
        )
    if element.tag == "box":
        return coal.Box(*source.numbers(element, "size", 3))
    if element.tag == "sphere":
        return coal.Sphere(source.number(element, "radius"))
    if element.tag == "cylinder":
        return coal.Cylinder(source.number(element, "radius"), source.number(element, "length"))
    path = find_mesh(element.get("filename", ""), source.path)
    if path is None:
        return None  # `load` has warned
    points = coal.StdVec_Vec3s()
    for vertex in _vertices(source, path) * source.numbers(element, "scale", 3, "1 1 1"):
        points.append(vertex)
    return coal.Convex.convexHull(points, True, "Qt")


def _vertices(source: Source, path: Path) -> Array:
    """(m, 3) corners of the convex hull of a mesh file."""
    import trimesh  # only where meshes are

    try:
        corners: Array = np.asarray(trimesh.load_mesh(path).convex_hull.vertices)
    except Exception as error:  # whatever a reader makes of a broken file
        source.fail(
            f"mesh {path.name!r} cannot be read ({error})",
            "plan with collisions=False to do without",
        )
    return corners


def _reach(
    arm: SpaceArm, frame: pin.Frame, pose: pin.SE3, shape: coal.CollisionGeometry
) -> dict[int, float]:
    """How far each joint that carries a geometry moves its points, at most [m/rad] or [1]."""
    shape.computeLocalAABB()
    far = float(np.linalg.norm(pose.act(shape.aabb_center)) + shape.aabb_radius)
    gains, joint = {}, frame.parentJoint
    while joint > 1:
        own = arm.tree.joints[arm.model.names[joint]]
        slides = own.kind == "prismatic"
        gains[joint] = 1.0 if slides else far
        far += float(np.linalg.norm(arm.model.jointPlacements[joint].translation))
        far += max(abs(own.lower), abs(own.upper)) if slides else 0.0
        joint = arm.model.parents[joint]
    return gains
