"""Boxes: rigid bodies as solid boxes, for their inertias and for drawing them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.description.bodies import Inertial
from spacearm.description.tree import Tree
from spacearm.description.visuals import Box, Shape, Visuals

GOLD = (0.83, 0.66, 0.31, 1.0)
STEEL = (0.55, 0.60, 0.66, 1.0)


def solid_box(mass: float, inertia: Array) -> tuple[Array, Array]:
    """Compute the solid box that has a mass and an inertia.

    Args:
        mass: Mass [kg].
        inertia: (3, 3) inertia about the CM [kg m^2]. For one that no box can have, edges are
            taken as a thousandth of the longest.

    Returns:
        Principal axes (3, 3), in columns, and edges (3,) [m].
    """
    moments, axes = np.linalg.eigh(inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    squares = 6.0 * (moments.sum() - 2.0 * moments) / mass
    return axes, np.sqrt(np.maximum(squares, 1e-6 * squares.max()))


def box_inertia(mass: float, size: Array) -> Array:
    """Compute the (3, 3) inertia of a solid box about its centre [kg m^2].

    Args:
        mass: Mass [kg].
        size: (3,) edges [m].
    """
    squares = np.square(size)
    return np.diag(mass / 12.0 * (squares.sum() - squares))


def body(name: str, rigid: Inertial, edges: Array | None, rgba: tuple[float, ...]) -> Tree:
    """Make a rigid body a tree of one link, drawn as a box; a point mass is not drawn.

    Args:
        name: Name of the link.
        rigid: Its mass properties.
        edges: (3,) edges of the box [m], which collision checks see too; None for the box that
            has the inertia, which is drawn only.
        rgba: The colour.
    """
    visuals = {}
    if edges is not None:
        box = Shape(pin.SE3(np.eye(3), rigid.origin.translation), Box(tuple(edges.tolist())), rgba)
        visuals[name] = Visuals((box,), (box,))
    elif not rigid.point:
        axes, lengths = solid_box(rigid.mass, rigid.inertia)
        pose = pin.SE3(axes, rigid.origin.translation)
        box = Shape(pose, Box(tuple(lengths.tolist())), rgba)
        visuals[name] = Visuals((box,), stands_in=True)
    return Tree(name, name, {name: rigid}, {}, visuals)
