"""Bodies: mass properties of links, and the joints between them, as plain data."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import LARGEST, LEAST_MASS, Array, ArrayLike, numbers_of, plain
from spacearm.errors import ModelError
from spacearm.signatures import shown

#: Length [m] of a link or edge of a bus from which it is implausible: the longest spacecraft so far
#: measures 109 m.
LONGEST = 200.0
#: Share of the largest principal moment by which rounded data may break the triangle inequality.
TRIANGLE_TOLERANCE = 1e-6


class Inertial(NamedTuple):
    """Mass properties of one link.

    Attributes:
        mass: Mass [kg].
        origin: Pose of the inertial frame, whose origin is the CM, in the link frame.
        inertia: (3, 3) inertia about the CM in the axes of the inertial frame [kg m^2].
    """

    mass: float
    origin: pin.SE3
    inertia: Array

    @classmethod
    def of(
        cls,
        mass: float,
        inertia: ArrayLike,
        com: ArrayLike = (0.0, 0.0, 0.0),
        *,
        body: str,
        prefix: str = "",
    ) -> Inertial:
        """Make a rigid body of a caller's numbers, checked.

        Args:
            mass: Mass [kg].
            inertia: (3, 3) inertia about the CM, link axes [kg m^2]; all zero for a point mass.
            com: (3,) CM in the link frame [m].
            body: Name of the body in an error.
            prefix: Prefix of "mass", "inertia" and "com" in an error, as in "base_mass".

        Raises:
            ConfigurationError: They are not numbers.
            ModelError: No rigid body can have them.
        """
        m, I, c = (
            numbers_of(value, f"{prefix}{name} of {body}")
            for name, value in (("mass", mass), ("inertia", inertia), ("com", com))
        )
        if m.shape or not LEAST_MASS <= m <= LARGEST:
            given = shown(mass) if m.shape else f"{m:g}"
            raise ModelError(f"{prefix}mass is {given} kg; give a positive mass to {LARGEST:g} kg")
        if I.shape != (3, 3) or not (np.abs(I) <= LARGEST).all() or not np.allclose(I, I.T):
            raise ModelError(f"{prefix}inertia is {shown(inertia)}; give a symmetric (3, 3) matrix")
        if c.shape != (3,) or not (np.abs(c) <= LARGEST).all():
            raise ModelError(f"{prefix}com is {shown(com)}; give 3 numbers up to {LARGEST:g} m")
        rigid = cls(float(m), pin.SE3(np.eye(3), c), I)
        if I.any() and (fault := rigid.fault()):
            raise ModelError(f"{body} {fault}; give {prefix}mass and {prefix}inertia of a body")
        return rigid

    @classmethod
    def of_spatial(cls, inertia: pin.Inertia) -> Inertial:
        """Return a Pinocchio spatial inertia in the link frame, its axes those of the link."""
        pose = pin.SE3(np.eye(3), inertia.lever)
        return cls(float(inertia.mass), pose, np.array(inertia.inertia))

    @property
    def point(self) -> bool:
        """Whether it is a point mass, without inertia about its CM."""
        return self.mass > 0.0 and not self.inertia.any()

    def with_mass(self, mass: float) -> Inertial:
        """Return a body of the same shape with another mass [kg]: I grows in proportion."""
        return self._replace(mass=mass, inertia=self.inertia * (mass / self.mass))

    def scaled(self, factor: float) -> Inertial:
        """Return a body of the same shape and mass, enlarged by a factor about the link's origin.

        Its CM is `factor` times as far away, its inertia `factor`^2 times as large.
        """
        origin = pin.SE3(self.origin.rotation, factor * self.origin.translation)
        return self._replace(origin=origin, inertia=factor**2 * self.inertia)

    def spatial(self) -> pin.Inertia:
        """Return it as a Pinocchio spatial inertia in the link frame."""
        inertia = pin.Inertia.Zero()
        inertia.mass, inertia.inertia = self.mass, self.inertia
        return self.origin.act(inertia)

    def fault(self) -> str | None:
        """Say why no rigid body can have this inertia; None if one can."""
        if self.mass == 0.0 and not self.inertia.any():
            return None
        if self.mass <= 0.0:
            return f"has an inertia but a mass of {self.mass:g} kg"
        small, middle, large = np.linalg.eigvalsh(self.inertia)
        moments = f"principal moments {small:.6g}, {middle:.6g}, {large:.6g} kg m^2"
        if small <= 0.0:
            return f"has an inertia that is not positive definite ({moments})"
        if large - small - middle > TRIANGLE_TOLERANCE * large:
            return f"has an inertia that breaks the triangle inequality ({moments})"
        return None


class Mimic(NamedTuple):
    """A joint that follows another one: q = multiplier * q_leader + offset."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint between two links; limits are infinite where the description gives none.

    Attributes:
        kind: "revolute", "continuous", "prismatic" or "fixed"; "wheel" for the axle of a momentum
            wheel, which is not a joint of the arm (see `spacearm.model.wheels`).
        origin: Pose of the joint frame in the parent link's frame.
        axis: (3,) unit vector in the joint frame.
        lower: Least angle [rad] or displacement [m].
        upper: Largest angle [rad] or displacement [m].
        velocity: Largest rate [rad/s] or [m/s].
        effort: Largest torque [N m] or force [N].
        locked: Kind of a joint that was locked, and where [rad] or [m]; the origin includes it.
        damping: Viscous friction [N m s/rad] or [N s/m].
        friction: Dry friction [N m] or [N].
        home: Where the joint rests [rad] or [m]; see `rest`.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: pin.SE3
    axis: Array
    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf
    mimic: Mimic | None = None
    locked: tuple[str, float] | None = None
    damping: float = 0.0
    friction: float = 0.0
    home: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return type, links, limits and leader as plain data; limits it does not have are None."""
        limits = {name: getattr(self, name) for name in ("lower", "upper", "velocity", "effort")}
        return {
            "name": self.name,
            "type": self.kind,
            "parent": self.parent,
            "child": self.child,
            **plain(limits),
            "mimic": self.mimic._asdict() if self.mimic else None,
        }

    @property
    def movable(self) -> bool:
        """Whether the joint can move and is a joint of the arm."""
        return self.kind not in ("fixed", "wheel")

    @property
    def rest(self) -> float:
        """Where the joint is held if it does not count [rad] or [m]: at home or a limit."""
        return min(max(self.home, self.lower), self.upper)

    @property
    def effort_unit(self) -> str:
        """Unit of the effort limit."""
        return "N" if self.kind == "prismatic" else "N m"

    def motion(self, value: float) -> pin.SE3:
        """Compute the displacement of the child link at `value` [rad] or [m], joint frame."""
        if self.kind == "prismatic":
            return pin.SE3(np.eye(3), self.axis * value)
        return pin.SE3(pin.AngleAxis(float(value), self.axis).matrix(), np.zeros(3))

    def frozen(self, value: float) -> Joint:
        """Return the joint as a fixed one, at `value` [rad] or [m]."""
        origin = self.origin * self.motion(value)
        return replace(self, kind="fixed", origin=origin, mimic=None, locked=(self.kind, value))

    @property
    def slid(self) -> float:
        """How far a locked joint has slid [m]."""
        return abs(self.locked[1]) if self.locked and self.locked[0] == "prismatic" else 0.0

    def renamed(self, rename: Callable[[str], str]) -> Joint:
        """Return the joint with its name and every name that it refers to changed."""
        mimic = self.mimic and self.mimic._replace(leader=rename(self.mimic.leader))
        name, parent, child = map(rename, (self.name, self.parent, self.child))
        return replace(self, name=name, parent=parent, child=child, mimic=mimic)

    def pinocchio(self) -> pin.JointModel:
        """Return the matching Pinocchio joint, which has one number even if it is unlimited."""
        names = {(1.0, 0.0, 0.0): "X", (0.0, 1.0, 0.0): "Y", (0.0, 0.0, 1.0): "Z"}
        letter = "P" if self.kind == "prismatic" else "R"
        if name := names.get(tuple(self.axis)):
            return getattr(pin, f"JointModel{letter}{name}")()
        kind = "Prismatic" if self.kind == "prismatic" else "Revolute"
        return getattr(pin, f"JointModel{kind}Unaligned")(self.axis)
