"""Visuals: what is drawn of a link and what others may collide with, as plain data."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin


class Box(NamedTuple):
    """A box about the origin.

    Attributes:
        size: Edges along x, y, z [m].
    """

    size: tuple[float, ...]


class Sphere(NamedTuple):
    """A sphere about the origin.

    Attributes:
        radius: Radius [m].
    """

    radius: float


class Cylinder(NamedTuple):
    """A cylinder about the origin, its axis along z.

    Attributes:
        radius: Radius [m].
        length: Length [m].
    """

    radius: float
    length: float


class Mesh(NamedTuple):
    """A mesh file.

    Attributes:
        name: Name that the description gives it.
        file: The file, by its absolute path; None if it was not found.
        scale: Factors along x, y, z.
    """

    name: str
    file: Path | None
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)


class Unusable(NamedTuple):
    """A geometry that cannot be used.

    Attributes:
        problem: File, element, value and remedy, in one sentence.
    """

    problem: str


Geometry: TypeAlias = Box | Sphere | Cylinder | Mesh | Unusable


class Shape(NamedTuple):
    """A geometry fixed to a link.

    Attributes:
        pose: Pose of the geometry in the link frame.
        geometry: The geometry.
        rgba: Red, green, blue and opacity, from 0 to 1; None if no colour is given.
    """

    pose: pin.SE3
    geometry: Geometry
    rgba: tuple[float, ...] | None = None


class Visuals(NamedTuple):
    """The shapes of one link.

    Attributes:
        visual: The shapes that are drawn.
        collision: The shapes that stand for the link in collision checks.
        stands_in: Whether the visuals only stand for a body of unknown shape.
    """

    visual: tuple[Shape, ...] = ()
    collision: tuple[Shape, ...] = ()
    stands_in: bool = False


def capsule(
    pose: pin.SE3, radius: float, length: float, rgba: tuple[float, ...] | None = None
) -> tuple[Shape, ...]:
    """Return a capsule about the origin of a pose, along z, as a cylinder and two spheres.

    Args:
        pose: Its pose in the link frame.
        radius: Radius [m].
        length: Length of the cylinder between the half spheres [m].
        rgba: The colour.
    """
    ends = [pin.SE3(np.eye(3), np.array([0.0, 0.0, z])) for z in (-length / 2.0, length / 2.0)]
    spheres = (Shape(pose * end, Sphere(radius), rgba) for end in ends)
    return (Shape(pose, Cylinder(radius, length), rgba), *spheres)
