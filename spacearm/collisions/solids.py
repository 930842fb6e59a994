"""Solids: shapes of a description as those of coal, Pinocchio's collision library.

Meshes become their convex hulls.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import scipy

from spacearm.arrays import LARGEST, Array
from spacearm.description import shapes
from spacearm.errors import ModelError

#: Thickness below which a mesh counts as flat, as a share of its length.
FLAT = 1e-9
#: Thickness given to the box around a flat visual, as a share of its length.
THIN = 1e-3
PRIMITIVES = {shapes.Box: coal.Box, shapes.Sphere: coal.Sphere, shapes.Cylinder: coal.Cylinder}
WITHOUT = "correct that, or plan with collisions=False to do without"


def link_solids(
    where: object, link: str, visuals: shapes.Visuals
) -> list[tuple[coal.CollisionGeometry, pin.SE3]]:
    """Return the collision geometry of a link, or its visuals where it has none that can be read.

    Args:
        where: The file or robot that it is part of, for errors.
        link: Its name.
        visuals: Its shapes.

    Raises:
        ModelError: A collision geometry is faulty.
    """
    return list(collision_solids(where, link, visuals)) or list(visual_solids(visuals))


def collision_solids(
    where: object, link: str, visuals: shapes.Visuals
) -> Iterator[tuple[coal.CollisionGeometry, pin.SE3]]:
    """Yield the collision geometry of a link; missing meshes are passed over.

    Raises:
        ModelError: A geometry is faulty.
    """
    for shape in visuals.collision:
        match shape.geometry:
            case shapes.Unusable(problem):
                raise ModelError(f"{problem}, or plan with collisions=False to do without")
            case shapes.Mesh(_, Path() as file, scale):
                try:
                    yield hull(file.name, shapes.read_mesh(file).vertices * scale), shape.pose
                except ModelError as error:
                    message = f"{where}: {error}, in a collision of link {link!r}"
                    raise ModelError(f"{message}; {WITHOUT}") from None
            case _ if min(_lengths(shape), default=1.0) <= 0.0:
                lengths = f"link {link!r} has a collision of lengths {_lengths(shape)}"
                raise ModelError(f"{where}: {lengths}; give positive lengths: {WITHOUT}")
            case _:
                yield from primitive(shape)


def visual_solids(visuals: shapes.Visuals) -> Iterator[tuple[coal.CollisionGeometry, pin.SE3]]:
    """Yield hulls or boxes of the visuals of a link; those that cannot be used are passed over."""
    for shape in () if visuals.stands_in else visuals.visual:
        match shape.geometry:
            case shapes.Mesh(_, Path() as file, scale):
                try:
                    points = shapes.read_mesh(file).vertices * scale
                except ModelError:
                    continue
                try:
                    yield hull(file.name, points), shape.pose
                except ModelError:
                    yield from _box_around(points, shape.pose)
            case _ if min(_lengths(shape), default=1.0) > 0.0:
                yield from primitive(shape)


def _lengths(shape: shapes.Shape) -> tuple[float, ...]:
    """Return the lengths of a box, sphere or cylinder."""
    geometry = shape.geometry
    if isinstance(geometry, shapes.Box):
        return geometry.size
    return tuple(geometry) if isinstance(geometry, shapes.Sphere | shapes.Cylinder) else ()


def primitive(shape: shapes.Shape) -> Iterator[tuple[coal.CollisionGeometry, pin.SE3]]:
    """Yield a box, sphere or cylinder as one of coal; nothing for any other geometry."""
    if make := PRIMITIVES.get(type(shape.geometry)):
        yield make(*_lengths(shape)), shape.pose


def _box_around(points: Array, pose: pin.SE3) -> Iterator[tuple[coal.CollisionGeometry, pin.SE3]]:
    """Yield the box along the axes around points (m, 3); nothing if they span none."""
    if not len(points) or not (np.abs(points) <= LARGEST).all():
        return
    low, high = points.min(axis=0), points.max(axis=0)
    edges = high - low
    if edges.max() > 0.0:
        centre = pin.SE3(np.eye(3), 0.5 * (low + high))
        yield coal.Box(*np.maximum(edges, THIN * edges.max())), pose * centre


def hull(name: str, points: Array) -> coal.Convex:
    """Return the convex hull of the points (m, 3) of a mesh."""
    if not (np.abs(points) <= LARGEST).all():
        raise ModelError(f"mesh {name!r} is larger than {LARGEST:g} m")
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(extents) < 3 or extents[2] <= FLAT * extents[0]:
        raise ModelError(f"mesh {name!r} is flat")
    try:
        hull = scipy.spatial.ConvexHull(points)
        corners, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for corner in points[hull.vertices]:
            corners.append(corner)
        for triangle in np.searchsorted(hull.vertices, hull.simplices):
            triangles.append(coal.Triangle(*triangle.tolist()))
        return coal.Convex(corners, triangles)
    except scipy.spatial.QhullError as error:
        raise ModelError(f"mesh {name!r} has no hull ({str(error).split(chr(10))[0]})") from None
    except RuntimeError:
        raise ModelError(f"the hull of mesh {name!r} has too many corners for coal") from None


def corners(solid: coal.CollisionGeometry) -> Array:
    """Return points (k, 3) whose convex hull is a solid, of round ones a polyhedron within it."""
    geometry: shapes.Geometry
    match solid:
        case coal.Box():
            geometry = shapes.Box(tuple(2.0 * np.asarray(solid.halfSide)))
        case coal.Sphere():
            geometry = shapes.Sphere(float(solid.radius))
        case coal.Cylinder():
            geometry = shapes.Cylinder(float(solid.radius), 2.0 * float(solid.halfLength))
        case _:
            return np.array([solid.point(i) for i in range(solid.num_points)])
    return shapes.Shape(pin.SE3.Identity(), geometry).points()
