"""Bodies for collision checks: the shapes of an arm's links as coal, the library behind Pinocchio.

A link counts with its collision geometry. Where the description gives none that can be read, its
visuals stand in, each as its convex hull, or as the box around it where it is flat. Links without
either are not checked, and `Bodies.account` names them.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from spacearm.arrays import LARGEST, Array
from spacearm.description.meshes import read_mesh
from spacearm.description.visuals import Box, Cylinder, Mesh, Shape, Sphere, Unusable, Visuals
from spacearm.errors import ModelError, listed
from spacearm.model.arm import SpaceArm

FLAT = 1e-9
"""Thickness below which a mesh counts as flat, as a share of its length."""
THIN = 1e-3
"""Thickness given to the box around a flat visual, as a share of its length."""
WITHOUT = "correct that, or plan with collisions=False to do without"


class Body(NamedTuple):
    """A shape: its link, the joint that carries it, and its pose there.

    Each joint between the spacecraft and the body moves its points by at most `reach` [m/rad], plus
    the displacement of the sliding joints between, named in `slides`; a sliding joint itself by 1.
    """

    link: str
    joint: int
    pose: pin.SE3
    shape: coal.CollisionGeometry
    reach: dict[int, float]
    slides: dict[int, list[int]]


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
        for leader, links in arm.tree.lumps().items():
            found = [link for link in links if self._add(arm, link)]
            if not found and any(arm.tree.links[link] for link in links):
                self.without.append(leader)

    def _add(self, arm: SpaceArm, link: str) -> bool:
        """Add the shapes of a link; return whether it has any."""
        shapes = arm.tree.visuals.get(link, Visuals())
        if found := list(_collision_solids(arm, link, shapes)):
            self.by_collision.append(link)
        elif found := list(_visual_solids(shapes)):
            self.by_visual.append(link)
        elif shapes.visual or shapes.collision:
            self.without.append(link)
        frame = arm.model.frames[arm.model.getFrameId(link, pin.BODY)]
        for solid, at in found:
            pose = frame.placement * at
            reach = _reach(arm, frame, pose, solid)
            self.all.append(Body(link, frame.parentJoint, pose, solid, *reach))
        return bool(found) or link in self.without

    @property
    def account(self) -> str:
        """What a check of collisions covers, in one sentence."""
        if not self.all:
            return "collisions NOT checked: the description gives the links no shapes"
        ways = [
            f"{len(self.by_collision)} links by their collision geometry" * bool(self.by_collision),
            f"by their visuals {listed(self.by_visual)}" * bool(self.by_visual),
        ]
        missed = f"; NOT checked, without shapes: {listed(self.without)}" * bool(self.without)
        return f"collisions checked: {', '.join(filter(None, ways))}{missed}"


def _collision_solids(
    arm: SpaceArm, link: str, shapes: Visuals
) -> Iterator[tuple[coal.CollisionGeometry, pin.SE3]]:
    """Yield the collision geometry of a link; missing meshes are passed over.

    Raises:
        ModelError: A geometry is faulty.
    """
    for shape in shapes.collision:
        match shape.geometry:
            case Unusable(problem):
                raise ModelError(f"{problem}, or plan with collisions=False to do without")
            case Mesh(_, Path() as file, scale):
                try:
                    yield _hull(file.name, read_mesh(file).vertices * scale), shape.pose
                except ModelError as error:
                    where = f"{arm.path}: {error}, in a collision of link {link!r}"
                    raise ModelError(f"{where}; {WITHOUT}") from None
            case _ if min(_lengths(shape), default=1.0) <= 0.0:
                lengths = f"link {link!r} has a collision of lengths {_lengths(shape)}"
                raise ModelError(f"{arm.path}: {lengths}; give positive lengths: {WITHOUT}")
            case _:
                yield from _primitive(shape)


def _visual_solids(shapes: Visuals) -> Iterator[tuple[coal.CollisionGeometry, pin.SE3]]:
    """Yield hulls or boxes of the visuals of a link; those that cannot be used are passed over."""
    for shape in () if shapes.stands_in else shapes.visual:
        match shape.geometry:
            case Mesh(_, Path() as file, scale):
                try:
                    points = read_mesh(file).vertices * scale
                except ModelError:
                    continue
                try:
                    yield _hull(file.name, points), shape.pose
                except ModelError:
                    yield from _box_around(points, shape.pose)
            case _ if min(_lengths(shape), default=1.0) > 0.0:
                yield from _primitive(shape)


def _lengths(shape: Shape) -> tuple[float, ...]:
    """Return the lengths of a box, sphere or cylinder."""
    match shape.geometry:
        case Box(size):
            return size
        case Sphere(radius):
            return (radius,)
        case Cylinder(radius, length):
            return radius, length
    return ()


def _primitive(shape: Shape) -> Iterator[tuple[coal.CollisionGeometry, pin.SE3]]:
    """Yield a box, sphere or cylinder as one of coal; nothing for any other geometry."""
    match shape.geometry:
        case Box(size):
            yield coal.Box(*size), shape.pose
        case Sphere(radius):
            yield coal.Sphere(radius), shape.pose
        case Cylinder(radius, length):
            yield coal.Cylinder(radius, length), shape.pose


def _box_around(points: Array, pose: pin.SE3) -> Iterator[tuple[coal.CollisionGeometry, pin.SE3]]:
    """Yield the box along the axes around points (m, 3); nothing if they span none."""
    if not len(points) or not (np.abs(points) <= LARGEST).all():
        return
    low, high = points.min(axis=0), points.max(axis=0)
    edges = high - low
    if edges.max() > 0.0:
        centre = pin.SE3(np.eye(3), 0.5 * (low + high))
        yield coal.Box(*np.maximum(edges, THIN * edges.max())), pose * centre


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
