"""Coordinates: the n joints that count, and the model's joints, which move with them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.description.tree import Tree
from spacearm.model.task import Task


class Coordinates:
    """What follows from the attributes of a `SpaceArm` about its joints."""

    tree: Tree
    model: pin.Model
    task: Task
    joint_names: tuple[str, ...]
    coupling: Array | None
    offsets: Array

    @property
    def n(self) -> int:
        """Number of movable joints."""
        return len(self.joint_names)

    @property
    def slides(self) -> npt.NDArray[np.bool_]:
        """(n,) which joints are prismatic; the others are revolute."""
        return np.array([self.tree.joints[name].kind == "prismatic" for name in self.joint_names])

    @property
    def mass(self) -> float:
        """Total mass M [kg]."""
        return float(sum(inertia.mass for inertia in self.model.inertias))

    @property
    def sigma_unit(self) -> str:
        """Unit of the singular values of the task Jacobian: of task rows over joint rates."""
        rate = "m" if self.slides.all() else "(rad or m)" if self.slides.any() else "rad"
        row = "1" if self.task.mixed else "rad" if min(self.task.indices) >= 3 else "m"
        return f"{row}/{rate}"

    @property
    def travel_unit(self) -> str:
        """Unit of sums over all joints: of angles, displacements or both."""
        return "m" if self.slides.all() else "rad and m" if self.slides.any() else "rad"

    def in_words(self, q: Array) -> str:
        """Return joint positions (n,) for people: angles in degrees, displacements in metres."""
        words = (
            f"{x:.4g} m" if slides else f"{np.degrees(x):.4g}°"
            for x, slides in zip(q, self.slides, strict=True)
        )
        return f"({', '.join(words)})"

    def all_joints(self, q: Array) -> Array:
        """Return the positions (nv - 6,) of all joints of the model at q (n,)."""
        return q if self.coupling is None else self.coupling @ q + self.offsets

    def all_rates(self, dq: Array) -> Array:
        """Return the rates (nv - 6,) of all joints of the model at joint rates dq (n,)."""
        return dq if self.coupling is None else self.coupling @ dq

    def project(self, matrix: Array) -> Array:
        """Reduce a matrix (m, nv) over the model's joints to the n joints, (m, 6 + n)."""
        if self.coupling is None:
            return matrix
        return np.hstack((matrix[:, :6], matrix[:, 6:] @ self.coupling))
