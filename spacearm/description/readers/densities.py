"""Densities: mass properties of links without inertial data, from the volume of their shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from spacearm.description.bodies import Inertial
from spacearm.description.meshes import read_mesh
from spacearm.description.readers.xml import Source
from spacearm.description.tree import Tree
from spacearm.description.visuals import (
    Box,
    Cylinder,
    Geometry,
    Mesh,
    Shape,
    Sphere,
    Visuals,
    capsule,
)
from spacearm.errors import ModelError


def with_density(source: Source, tree: Tree, density: float) -> Tree:
    """Return the tree with mass properties for the links that have shapes and no mass.

    Shapes are taken as solid; where shapes of a link overlap, both count, but for
    the ends of capsules. Those for collisions are
    used, else those that are drawn. A mesh that is not closed is taken as its convex hull.

    Args:
        source: The file.
        tree: Its links and shapes.
        density: Density [kg/m^3].

    Warns:
        ModelWarning: Links got mass properties, or got none for want of a usable shape.
    """
    found: dict[str, Inertial] = {}
    bare: list[str] = []
    for link, inertial in tree.links.items():
        shapes = tree.visuals.get(link, Visuals())
        if (inertial is None or inertial.mass == 0.0) and any(shapes):
            solid = _solid(shapes.collision or shapes.visual) or _solid(shapes.visual)
            if solid is None:
                bare.append(link)
            else:
                found[link] = _inertial(solid, density)
    if found:
        masses = ", ".join(f"{link!r} {part.mass:.4g} kg" for link, part in found.items())
        source.warn(f"density {density:g} kg/m^3 gives mass and inertia from shapes: {masses}")
    if bare:
        names = ", ".join(map(repr, bare))
        source.warn(f"density gives no mass to {names}: their shapes are missing or unusable")
    return replace(tree, links={**tree.links, **found})


def _inertial(volume: pin.Inertia, density: float) -> Inertial:
    """Return the mass properties of a body of density 1 at another density."""
    pose = pin.SE3(np.eye(3), volume.lever)
    return Inertial(density * volume.mass, pose, density * volume.inertia)


def _solid(shapes: Sequence[Shape]) -> pin.Inertia | None:
    """Return the inertia of solid shapes of density 1; None if no shape can be used."""
    parts: list[pin.Inertia] = []
    rest = list(shapes)
    while rest:
        first = rest.pop(0)
        solid = _solid_of(first.geometry)
        if isinstance(first.geometry, Cylinder) and _round_ended(first, rest[:2]):
            solid = _at_density_1(coal.Capsule(*first.geometry))
            del rest[:2]
        if solid is not None:
            parts.append(first.pose.act(solid))
    return sum(parts[1:], start=parts[0]) if parts else None


def _round_ended(cylinder: Shape, ends: Sequence[Shape]) -> bool:
    """Whether a cylinder and the two shapes behind it are a `capsule`."""
    _, *spheres = capsule(cylinder.pose, *cylinder.geometry)
    return len(ends) == 2 and all(
        end.geometry == sphere.geometry and end.pose.isApprox(sphere.pose)
        for end, sphere in zip(ends, spheres, strict=True)
    )


def _solid_of(geometry: Geometry) -> pin.Inertia | None:
    """Return the inertia of a solid geometry of density 1."""
    match geometry:
        case Box(size):
            shape = coal.Box(*size)
        case Sphere(radius):
            shape = coal.Sphere(radius)
        case Cylinder(radius, length):
            shape = coal.Cylinder(radius, length)
        case Mesh(_, Path() as file, scale):
            return _solid_mesh(file, scale)
        case _:
            return None
    return _at_density_1(shape)


def _at_density_1(shape: coal.ShapeBase) -> pin.Inertia | None:
    """Return the inertia of a shape about its centre; None if it has no volume."""
    volume = float(shape.computeVolume())
    if not volume > 0.0:
        return None
    return pin.Inertia(volume, np.zeros(3), np.array(shape.computeMomentofInertia()))


def _solid_mesh(file: Path, scale: tuple[float, ...]) -> pin.Inertia | None:
    """Return the inertia of a closed mesh, or of the convex hull of an open one, of density 1."""
    try:
        mesh = read_mesh(file)
    except ModelError:
        return None
    mesh.vertices = np.asarray(mesh.vertices) * scale
    solid = mesh if mesh.is_volume else mesh.convex_hull
    if not solid.volume > 0.0:
        return None
    return pin.Inertia(
        float(solid.volume), np.array(solid.center_mass), np.array(solid.moment_inertia)
    )
