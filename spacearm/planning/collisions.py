"""Collisions of the arm with the spacecraft and itself, from the URDF's collision geometry.

Distances are those of coal, the library behind Pinocchio; meshes count as their convex hulls. A
motion is proven free by conservative advancement: on a piece of it no body comes nearer to another
than by the motion of the joints between the two. coal has that for two bodies on given paths, not
for the bodies of a chain.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
from lxml import etree
from scipy.spatial import ConvexHull, QhullError

from spacearm.arrays import LARGEST, Array
from spacearm.description.meshes import find_mesh, read_mesh
from spacearm.description.readers.xml import Source
from spacearm.errors import ModelError
from spacearm.model.arm import SpaceArm

POSTURES = 64
"""Random postures; bodies that touch in all of them are taken to be joined."""
CLOSE = 1e-4
"""Distance below which bodies count as touching, as a share of the arm's reach."""
FLAT = 1e-9
"""Thickness below which a mesh counts as flat, as a share of its length."""
WITHOUT = "correct that, or plan with collisions=False to do without"


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
    """A geometry: its link, the joint that carries it, and its pose there.

    Each joint between the spacecraft and the body moves its points by at most `reach` [m/rad], plus
    the displacement of the sliding joints between, named in `slides`; a sliding joint itself by 1.
    """

    link: str
    joint: int
    pose: pin.SE3
    shape: coal.CollisionGeometry
    reach: dict[int, float]
    slides: dict[int, list[int]]


class Collisions:
    """The collision geometry of an arm, and the pairs of bodies that must not meet.

    Links that a joint of the URDF connects may touch, locked and fixed ones included, and bodies
    that touch in every posture.

    Args:
        arm: The arm.

    Raises:
        ModelError: The URDF's collision geometry cannot be read.
    """

    def __init__(self, arm: SpaceArm) -> None:
        self.arm, bodies = arm, list(_bodies(arm))
        joined = _connected(arm, {body.link for body in bodies})
        self._pairs = [
            (a, b)
            for a, b in combinations(bodies, 2)
            if a.joint != b.joint and frozenset((a.link, b.link)) not in joined
        ]
        self._close = CLOSE * max((r for body in bodies for r in body.reach.values()), default=0.0)
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
        """Return the distances (pairs,) of bodies that may meet, negative if they overlap [m]."""
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

    def _distance(self, a: _Body, at: pin.SE3, b: _Body, there: pin.SE3) -> float:
        poses = (at * a.pose, there * b.pose)
        A, B = (coal.Transform3s(pose.rotation, pose.translation) for pose in poses)
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        return float(coal.distance(a.shape, A, b.shape, B, request, result))

    def gains(self, path: Array) -> Array:
        """Return the most that joints move bodies against each other (pairs, n), [m/rad] or [1].

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


def _bodies(arm: SpaceArm) -> Iterator[_Body]:
    """The collision geometries of the URDF."""
    source = Source(arm.path)
    for link, look in arm.tree.looks.items():
        frame = arm.model.frames[arm.model.getFrameId(link, pin.BODY)]
        for collision in etree.fromstring(look).findall("collision"):
            shape, pose = _shape(source, link, collision), frame.placement * source.pose(collision)
            yield _Body(link, frame.parentJoint, pose, shape, *_reach(arm, frame, pose, shape))


def _shape(source: Source, link: str, collision: etree._Element) -> coal.CollisionGeometry:
    element = collision.find("geometry/*")
    if element is None or element.tag not in ("box", "sphere", "cylinder", "mesh"):
        source.fail(
            f"link {link!r} has a collision without a known geometry",
            "give it a box, sphere, cylinder or mesh, or plan with collisions=False",
        )
    if element.tag == "box":
        return coal.Box(*source.lengths(element, "size", 3))
    if element.tag == "sphere":
        return coal.Sphere(*source.lengths(element, "radius", 1))
    if element.tag == "cylinder":
        radius, length = (source.lengths(element, name, 1)[0] for name in ("radius", "length"))
        return coal.Cylinder(radius, length)
    path = find_mesh(element.get("filename", ""), source.path)
    if path is None:
        source.fail(f"mesh {element.get('filename')!r} of link {link!r} is not there", WITHOUT)
    scale = source.numbers(element, "scale", 3, "1 1 1")
    try:
        return _hull(path.name, read_mesh(path).vertices * scale)
    except ModelError as error:
        source.fail(f"{error}, in a collision of link {link!r}", WITHOUT)


def _hull(name: str, points: Array) -> coal.Convex:
    """Return the convex hull of the points (m, 3) of a mesh."""
    if not (np.abs(points) <= LARGEST).all():
        raise ModelError(f"mesh {name!r} is larger than {LARGEST:g} m")
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(extents) < 3 or extents[2] <= FLAT * extents[0]:
        raise ModelError(f"mesh {name!r} is flat")
    try:
        hull = ConvexHull(points)
        corners, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for corner in points[hull.vertices]:
            corners.append(corner)
        for triangle in np.searchsorted(hull.vertices, hull.simplices):
            triangles.append(coal.Triangle(*triangle.tolist()))
        return coal.Convex(corners, triangles)
    except QhullError as error:
        raise ModelError(f"mesh {name!r} has no hull ({str(error).split(chr(10))[0]})") from None
    except RuntimeError:
        raise ModelError(f"the hull of mesh {name!r} is too fine for coal") from None


def _reach(
    arm: SpaceArm, frame: pin.Frame, pose: pin.SE3, shape: coal.CollisionGeometry
) -> tuple[dict[int, float], dict[int, list[int]]]:
    """Return reach and slides of a body, for each joint that carries it."""
    shape.computeLocalAABB()
    far = float(np.linalg.norm(pose.act(shape.aabb_center)) + shape.aabb_radius)
    reach: dict[int, float] = {}
    slides: dict[int, list[int]] = {}
    between: list[int] = []
    joint = frame.parentJoint
    while joint > 1:
        sliding = arm.tree.joints[arm.model.names[joint]].kind == "prismatic"
        reach[joint], slides[joint] = (1.0, []) if sliding else (far, list(between))
        between += [joint - 2] if sliding else []
        far += float(np.linalg.norm(arm.model.jointPlacements[joint].translation))
        joint = arm.model.parents[joint]
    return reach, slides


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
