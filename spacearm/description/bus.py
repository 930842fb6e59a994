"""Bus: a spacecraft without its arm, as a box."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import LARGEST, Array, plain
from spacearm.description.bodies import Inertial
from spacearm.description.boxes import GOLD, body, box_inertia, solid_box
from spacearm.description.plausible import implausible_box
from spacearm.description.tree import Tree
from spacearm.errors import ModelError, warn


@dataclass(frozen=True, eq=False)
class Bus:
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
        ModelWarning: Its size or density is that of no spacecraft.
    """

    mass: float
    _: KW_ONLY
    size: npt.ArrayLike | None = None
    inertia: npt.ArrayLike | None = None
    com: npt.ArrayLike = (0.0, 0.0, 0.0)
    name: str = "bus"

    def __post_init__(self) -> None:
        for doubt in self.tree().notes:
            warn(doubt)

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}

    @property
    def top(self) -> pin.SE3:
        """Pose of the middle of the top face (+z) in the bus frame; the identity without a size."""
        if self.size is None:
            return pin.SE3.Identity()
        x, y, z = np.asarray(self.com, dtype=np.float64)
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
            rigid = Inertial.of(self.mass, box_inertia(1.0, edges), self.com, body="the bus")
            rigid = rigid._replace(inertia=rigid.mass * rigid.inertia)
        else:
            raise ModelError("a bus needs a size [m] or an inertia [kg m^2]; give one or both")
        if rigid.point:
            raise ModelError("inertia of the bus is zero; give that of a body with extension")
        box = solid_box(rigid.mass, rigid.inertia)[1] if edges is None else edges
        notes = tuple(implausible_box(rigid.mass, box))
        return replace(body(self.name, rigid, edges, GOLD), notes=notes)


def _edges(size: npt.ArrayLike) -> Array:
    """Return the edges (3,) [m], checked."""
    try:
        edges = np.array(size, dtype=np.float64)
    except (TypeError, ValueError):
        edges = np.empty(0)
    if edges.shape != (3,) or not ((edges > 0.0) & (edges <= LARGEST)).all():
        raise ModelError(f"size of the bus is {size!r}; give three positive lengths [m]")
    return edges
