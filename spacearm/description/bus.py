"""Bus: a spacecraft without its arm, as a box; bodies as trees of one link."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import LARGEST, Array
from spacearm.description.bodies import Inertial, box_inertia, solid_box
from spacearm.description.tree import Tree
from spacearm.description.visuals import box_look
from spacearm.errors import ModelError

GOLD = "0.83 0.66 0.31 1"
STEEL = "0.55 0.60 0.66 1"


@dataclass(frozen=True, eq=False)
class Bus:
    """A spacecraft bus, to bolt arms to with `mount`.

    Attributes:
        mass: Mass [kg].
        size: (3,) edges of its box [m], which plans keep the arm out of. Default: those of the
            solid box that has the inertia, which is drawn only.
        inertia: (3, 3) inertia about its CM, bus axes [kg m^2]. Default: of a solid box of `size`.
        com: (3,) CM in the bus frame [m]; the box is centred there.
        name: Name of its link.

    Raises:
        ModelError: Neither size nor inertia is given, or no rigid body can have these numbers.
    """

    mass: float
    _: KW_ONLY
    size: npt.ArrayLike | None = None
    inertia: npt.ArrayLike | None = None
    com: npt.ArrayLike = (0.0, 0.0, 0.0)
    name: str = "bus"

    def __post_init__(self) -> None:
        self.tree()

    def tree(self) -> Tree:
        """The bus as a tree of one link."""
        edges = None if self.size is None else _edges(self.size)
        if self.inertia is not None:
            rigid = Inertial.of(self.mass, self.inertia, self.com, body="the bus")
        elif edges is not None:
            rigid = Inertial.of(self.mass, box_inertia(1.0, edges), self.com, body="the bus")
            rigid = rigid._replace(inertia=rigid.mass * rigid.inertia)
        else:
            raise ModelError("a bus needs a size [m] or an inertia [kg m^2]; give one or both")
        if rigid.point:
            raise ModelError("inertia of the bus is zero; give that of a body with extension")
        return body(self.name, rigid, edges, GOLD)


def body(name: str, rigid: Inertial, edges: Array | None, rgba: str) -> Tree:
    """A rigid body as a tree of one link, drawn as a box (a point mass is not drawn).

    Args:
        name: Name of the link.
        rigid: Its mass properties.
        edges: (3,) of the box [m], which is solid then; None for those that the inertia tells.
        rgba: The colour.
    """
    looks = {}
    if edges is not None or not rigid.point:
        box = solid_box(rigid.mass, rigid.inertia) if edges is None else (np.eye(3), edges)
        pose = pin.SE3(box[0], rigid.origin.translation)
        looks[name] = box_look(name, pose, box[1], rgba, solid=edges is not None)
    return Tree(name, name, {name: rigid}, {}, looks)


def _edges(size: npt.ArrayLike) -> Array:
    """(3,) positive lengths [m], checked."""
    try:
        edges = np.array(size, dtype=np.float64)
    except (TypeError, ValueError):
        edges = np.empty(0)
    if edges.shape != (3,) or not ((edges > 0.0) & (edges <= LARGEST)).all():
        raise ModelError(f"size of the bus is {size!r}; give three positive lengths [m]")
    return edges
