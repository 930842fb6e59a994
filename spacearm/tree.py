"""Tree: the links and joints of a robot as plain data, and the Pinocchio model made of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import LARGEST, LEAST_MASS, Array
from spacearm.errors import ModelError

ROOT_JOINT = "root_joint"
"""Name of the spacecraft's free motion in the Pinocchio model, as Pinocchio itself has it."""

TRIANGLE_TOLERANCE = 1e-6
"""By what share of the largest principal moment rounded data may miss the triangle inequality."""


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

    def spatial(self) -> pin.Inertia:
        """The same as a Pinocchio spatial inertia in the link frame."""
        inertia = pin.Inertia.Zero()
        inertia.mass, inertia.inertia = self.mass, self.inertia
        return self.origin.act(inertia)

    def fault(self) -> str | None:
        """Why no rigid body can have this inertia, or None if one can."""
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
    """The joint follows another: q = multiplier * q_leader + offset."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint between two links; limits are infinite where the URDF gives none.

    Attributes:
        kind: "revolute", "continuous", "prismatic" or "fixed".
        origin: Pose of the joint frame in the parent link's frame.
        axis: (3,) unit vector in the joint frame.
        lower: Least angle [rad] or displacement [m].
        upper: Largest angle [rad] or displacement [m].
        velocity: Largest rate [rad/s] or [m/s].
        effort: Largest torque [N m] or force [N].
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

    @property
    def movable(self) -> bool:
        """Whether the joint can move."""
        return self.kind != "fixed"

    @property
    def effort_unit(self) -> str:
        """Unit of the effort limit."""
        return "N" if self.kind == "prismatic" else "N m"

    def motion(self, value: float) -> pin.SE3:
        """Displacement of the child link at `value` [rad] or [m], in the joint frame."""
        if self.kind == "prismatic":
            return pin.SE3(np.eye(3), self.axis * value)
        return pin.SE3(pin.exp3(self.axis * value), np.zeros(3))

    def frozen(self, value: float) -> Joint:
        """The joint welded at `value` [rad] or [m]."""
        return replace(self, kind="fixed", origin=self.origin * self.motion(value), mimic=None)

    def pinocchio(self) -> pin.JointModel:
        """The matching Pinocchio joint; the unlimited ones too have one number each."""
        names = {(1.0, 0.0, 0.0): "X", (0.0, 1.0, 0.0): "Y", (0.0, 0.0, 1.0): "Z"}
        letter = "P" if self.kind == "prismatic" else "R"
        if name := names.get(tuple(self.axis)):
            return getattr(pin, f"JointModel{letter}{name}")()
        kind = "Prismatic" if self.kind == "prismatic" else "Revolute"
        return getattr(pin, f"JointModel{kind}Unaligned")(self.axis)


@dataclass(frozen=True, eq=False)
class Tree:
    """A kinematic tree with one root.

    Attributes:
        name: The robot's name.
        root: The root link: the spacecraft, or a frame fixed to it.
        links: Inertial of every link; None for a frame without mass.
        joints: Every joint, by name.
    """

    name: str
    root: str
    links: Mapping[str, Inertial | None]
    joints: Mapping[str, Joint]

    def depth_first(self) -> list[Joint]:
        """All joints, parents before children, siblings by name: Pinocchio's own URDF order."""
        children: dict[str, list[Joint]] = {link: [] for link in self.links}
        for joint in sorted(self.joints.values(), key=lambda joint: joint.name, reverse=True):
            children[joint.parent].append(joint)
        order: list[Joint] = []
        waiting = children[self.root]
        while waiting:
            order.append(joint := waiting.pop())
            waiting += children[joint.child]
        return order

    def chain(self, link: str) -> list[Joint]:
        """The joints from the root to a link, in that order."""
        into = {joint.child: joint for joint in self.joints.values()}
        chain: list[Joint] = []
        while link != self.root:
            chain.append(into[link])
            link = into[link].parent
        return chain[::-1]

    def leaves(self) -> list[str]:
        """The links that no joint starts from."""
        parents = {joint.parent for joint in self.joints.values()}
        return [link for link in self.links if link not in parents]

    def lumps(self) -> dict[str, list[str]]:
        """Links that move as one body, under the link that leads them."""
        leader = {self.root: self.root}
        for joint in self.depth_first():
            leader[joint.child] = joint.child if joint.movable else leader[joint.parent]
        lumps: dict[str, list[str]] = {}
        for link, first in leader.items():
            lumps.setdefault(first, []).append(link)
        return lumps

    def locked(self, values: Mapping[str, float]) -> Tree:
        """The tree with joints frozen at `values`; joints that mimic one freeze with it."""
        values = dict(values)
        while followers := {
            joint.name: joint.mimic.multiplier * values[joint.mimic.leader] + joint.mimic.offset
            for joint in self.joints.values()
            if joint.mimic and joint.mimic.leader in values and joint.name not in values
        }:
            values |= followers
        joints = {
            name: joint.frozen(values[name]) if name in values else joint
            for name, joint in self.joints.items()
        }
        return replace(self, joints=joints)

    def leading(self) -> list[Joint]:
        """The movable joints that follow no other, in the order of q."""
        return [joint for joint in self.depth_first() if joint.movable and not joint.mimic]

    def coupling(self) -> tuple[Array, Array]:
        """C and c in (all movable joints) = C q + c, which makes mimic joints follow."""
        movable = [joint for joint in self.depth_first() if joint.movable]
        leading = [joint.name for joint in self.leading()]
        C, c = np.zeros((len(movable), len(leading))), np.zeros(len(movable))
        for i, joint in enumerate(movable):
            scale = 1.0
            while joint.mimic:
                c[i] += scale * joint.mimic.offset
                scale *= joint.mimic.multiplier
                joint = self.joints[joint.mimic.leader]
            C[i, leading.index(joint.name)] = scale
        return C, c

    def plane_normal(self) -> int | None:
        """The spacecraft axis (0, 1, 2) that every joint turns about or slides across, if any."""
        attitude = {self.root: np.eye(3)}
        normals = {0, 1, 2}
        for joint in self.depth_first():
            attitude[joint.child] = R = attitude[joint.parent] @ joint.origin.rotation
            if joint.movable:
                along = np.abs(R @ joint.axis)
                wanted = 0.0 if joint.kind == "prismatic" else 1.0
                normals = {i for i in normals if abs(along[i] - wanted) < 1e-9}
        return normals.pop() if len(normals) == 1 else None

    def with_spacecraft(self, mass: float | None, inertia: npt.ArrayLike | None) -> Tree:
        """The tree with another mass [kg] or inertia about its CM [kg m^2] of the spacecraft."""
        lump = self.lumps()[self.root]
        body = self.pinocchio().inertias[1]
        try:
            m = float(body.mass if mass is None else mass)
            I = np.array(body.inertia if inertia is None else inertia, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ModelError(f"base_mass and base_inertia must be numbers: {error}") from None
        if I.shape != (3, 3) or not (np.abs(I) <= LARGEST).all() or not np.allclose(I, I.T):
            raise ModelError(f"base_inertia must be a symmetric (3, 3) matrix; got {inertia!r}")
        if not 0.0 < m <= LARGEST:
            raise ModelError(f"base_mass is {m:g} kg; give a positive mass up to {LARGEST:g} kg")
        spacecraft = Inertial(m, pin.SE3(np.eye(3), body.lever), I)
        if fault := spacecraft.fault():
            raise ModelError(f"the spacecraft {fault}; give a base_inertia that a body can have")
        links = {name: None if name in lump else part for name, part in self.links.items()}
        return replace(self, links={**links, self.root: spacecraft})

    def with_mass(self, link: str, mass: float) -> Tree:
        """The tree with another mass of a link [kg], its inertia in proportion."""
        part = self.links.get(link)
        if part is None:
            raise ModelError(f"link {link!r} has no mass; name one of: {', '.join(self.bodies())}")
        if not LEAST_MASS <= mass <= LARGEST:
            raise ModelError(f"the mass of {link!r} is {mass:g} kg; give a positive one")
        scaled = Inertial(mass, part.origin, part.inertia * (mass / part.mass))
        return replace(self, links={**self.links, link: scaled})

    def with_payload(self, link: str, mass: float) -> Tree:
        """The tree with a point mass [kg] at the origin of a link."""
        if not 0.0 <= mass <= LARGEST:
            raise ModelError(f"payload is {mass:g} kg; give zero or a positive mass")
        if mass < LEAST_MASS:
            return self
        part, load = self.links[link], pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
        whole = load if part is None else part.spatial() + load
        placed = Inertial(whole.mass, pin.SE3(np.eye(3), whole.lever), whole.inertia)
        return replace(self, links={**self.links, link: placed})

    def bodies(self) -> list[str]:
        """The links that have mass."""
        return [name for name, part in self.links.items() if part is not None]

    def with_mount(self, joint: Joint, mount: pin.SE3) -> Tree:
        """The tree with a joint moved to a pose in the spacecraft frame."""
        moved = replace(joint, parent=self.root, origin=mount)
        return replace(self, joints={**self.joints, joint.name: moved})

    def pinocchio(self) -> pin.Model:
        """The Pinocchio model, with a free-flyer root and one body frame for every link."""
        model = pin.Model()
        model.name = self.name
        model.gravity = pin.Motion.Zero()
        root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), ROOT_JOINT)
        home = {self.root: (root, pin.SE3.Identity())}
        for joint in self.depth_first():
            carrier, placement = home[joint.parent]
            placement = placement * joint.origin
            if joint.movable:
                limits = (joint.effort, joint.velocity, joint.lower, joint.upper)
                carrier = model.addJoint(
                    carrier,
                    joint.pinocchio(),
                    placement,
                    joint.name,
                    *(np.array([limit]) for limit in limits),
                )
                placement = pin.SE3.Identity()
            home[joint.child] = (carrier, placement)
        for link, (carrier, placement) in home.items():
            if inertial := self.links[link]:
                model.appendBodyToJoint(carrier, inertial.spatial(), placement)
            model.addBodyFrame(link, carrier, placement, 0)
        return model
