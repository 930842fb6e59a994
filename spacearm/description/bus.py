"""Bus: a spacecraft without its arm, as a box; rigid bodies as solid boxes."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace

import numpy as np
import pinocchio as pin

from spacearm.arrays import LARGEST, NO_NUMBERS, Array, ArrayLike, Parameters, finite, floats
from spacearm.description.bodies import LONGEST, Inertial
from spacearm.description.shapes import Box, Shape, Visuals
from spacearm.description.tree import Tree
from spacearm.errors import ModelError, warn
from spacearm.signatures import checked, shown

GOLD = (0.83, 0.66, 0.31, 1.0)
STEEL = (0.55, 0.60, 0.66, 1.0)
#: Densities of a bus [kg/m^3] that are plausible: from a tent to more than osmium.
DENSITIES = (0.1, 25_000.0)


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


def stand_in(inertia: pin.Inertia) -> Shape:
    """Return the solid box that has an inertia, in its frame."""
    axes, edges = solid_box(inertia.mass, inertia.inertia)
    return Shape(pin.SE3(axes, inertia.lever), Box(tuple(edges.tolist())))


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
        box = stand_in(rigid.spatial())._replace(rgba=rgba)
        visuals[name] = Visuals((box,), stands_in=True)
    return Tree(name, name, {name: rigid}, {}, visuals)


@checked
@dataclass(frozen=True, eq=False)
class Bus(Parameters):
    """A spacecraft bus, to which `mount` bolts arms.

    Attributes:
        mass: Mass [kg].
        size: (3,) edges of its box [m], which plans keep the arm out of. Default: the solid box
            that has the inertia, which is drawn but never collides.
        inertia: (3, 3) inertia about its CM, bus axes [kg m^2]. Default: of a solid box of `size`.
        com: (3,) CM in the bus frame [m], the centre of the box.
        name: Name of its link.

    Raises:
        ModelError: Neither size nor inertia is given, or no rigid body can have these values.

    Warns:
        ModelWarning: No spacecraft has such a size or density.
    """

    mass: float
    _: KW_ONLY
    size: ArrayLike | None = None
    inertia: ArrayLike | None = None
    com: ArrayLike = (0.0, 0.0, 0.0)
    name: str = "bus"

    def __post_init__(self) -> None:
        for doubt in self.tree().notes:
            warn(doubt)

    @property
    def top(self) -> pin.SE3:
        """Pose of the middle of the top face (+z) in the bus frame; the identity without a size."""
        if self.size is None:
            return pin.SE3.Identity()
        x, y, z = finite(self.com, (3,), "com of the bus", "[m]")
        return pin.SE3(np.eye(3), np.array([x, y, z + 0.5 * _edges(self.size)[2]]))

    def tree(self) -> Tree:
        """Return the bus as a tree of one link.

        Raises:
            ModelError: Size or inertia are missing or are those of no rigid body.
        """
        edges = None if self.size is None else _edges(self.size)
        if self.inertia is not None:
            rigid = Inertial.of(self.mass, self.inertia, self.com, body="the bus")
        elif edges is not None:
            squares = np.square(edges)
            per_mass = np.diag(squares.sum() - squares) / 12.0
            rigid = Inertial.of(self.mass, per_mass, self.com, body="the bus")
            rigid = rigid._replace(inertia=rigid.mass * rigid.inertia)
        else:
            raise ModelError("a bus needs a size [m] or an inertia [kg m^2]; give one or both")
        if rigid.point:
            raise ModelError("inertia of the bus is zero; give that of an extended body")
        box = solid_box(rigid.mass, rigid.inertia)[1] if edges is None else edges
        return replace(body(self.name, rigid, edges, GOLD), notes=_doubts(rigid.mass, box))


def _edges(size: ArrayLike) -> Array:
    """Return the edges (3,) [m], checked."""
    try:
        edges = floats(size)
    except NO_NUMBERS:
        edges = np.empty(0)
    if edges.shape != (3,) or not ((edges > 0.0) & (edges <= LARGEST)).all():
        raise ModelError(f"size of the bus is {shown(size)}; give three positive lengths [m]")
    return edges


def _doubts(mass: float, edges: Array) -> tuple[str, ...]:
    """Say what is implausible about a bus of a mass [kg] that is a box with edges (3,) [m]."""
    density, (least, most) = mass / float(np.prod(edges)), DENSITIES
    if edges.max() > LONGEST:
        return (f"the bus is {edges.max():.4g} m long, as if in millimetres",)
    if least <= density <= most:
        return ()
    return (f"the bus of {mass:.4g} kg has a density of {density:.3g} kg/m^3",)
