"""Tree: the links and joints of a robot as plain data, and the Pinocchio model made of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain, count
from numbers import Real

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import LARGEST, LEAST_MASS, Array
from spacearm.description.bodies import Inertial, Joint
from spacearm.description.visuals import Visuals
from spacearm.errors import ConfigurationError, ModelError, unknown

ROOT_JOINT = "root_joint"
"""Name of the spacecraft's free motion in the Pinocchio model, as Pinocchio itself has it."""


@dataclass(frozen=True, eq=False)
class Tree:
    """A kinematic tree with one root.

    Attributes:
        name: The robot's name.
        root: The root link: the spacecraft, or a frame fixed to it.
        links: Inertial of every link; None for a frame without mass.
        joints: Every joint, by name.
        visuals: Shapes of the links that have any, drawn ones and those of collision checks.
        tips: Tip links that the URDF names itself; none as a rule.
    """

    name: str
    root: str
    links: Mapping[str, Inertial | None]
    joints: Mapping[str, Joint]
    visuals: Mapping[str, Visuals] = field(default_factory=dict)
    tips: tuple[str, ...] = ()

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

    def has(self, name: str) -> bool:
        """Whether a link or joint has this name, or a name that starts with it and "_" or "."."""
        start = (f"{name}_", f"{name}.")
        return any(n == name or n.startswith(start) for n in (*self.links, *self.joints))

    def free_name(self, name: str) -> str:
        """The name, with the first number from 2 on that makes it free if it is not."""
        numbered = chain((name,), (f"{name}_{i}" for i in count(2)))
        return next(free for free in numbered if not self.has(free))

    def renamed(self, prefix: str) -> Tree:
        """The tree with `prefix` before every name of a link and a joint."""
        joints = [joint.renamed(prefix) for joint in self.joints.values()]
        return Tree(
            name=self.name,
            root=prefix + self.root,
            links={prefix + name: part for name, part in self.links.items()},
            joints={joint.name: joint for joint in joints},
            visuals={prefix + name: shapes for name, shapes in self.visuals.items()},
            tips=tuple(prefix + tip for tip in self.tips),
        )

    def joined(self, other: Tree, name: str, parent: str, at: pin.SE3) -> Tree:
        """Both trees as one: `other` with its root fixed to link `parent` at a pose there.

        Raises:
            ModelError: A name would be there twice.
        """
        bolt = Joint(name, "fixed", parent, other.root, at, np.array([1.0, 0.0, 0.0]))
        added = {**other.joints, name: bolt}
        twice = [*(self.links.keys() & other.links), *(self.joints.keys() & added)]
        if twice:
            raise ModelError(f"{self.name} has {', '.join(sorted(twice))} already; rename one")
        return replace(
            self,
            links={**self.links, **other.links},
            joints={**self.joints, **added},
            visuals={**self.visuals, **other.visuals},
        )

    def locked(self, values: Mapping[str, float]) -> Tree:
        """The tree with joints frozen at `values`; joints that mimic one freeze with it.

        Raises:
            ConfigurationError: A joint does not exist, follows another, or the value is no number.
        """
        if not isinstance(values, Mapping):
            raise ConfigurationError(f"locked is {values!r}; give {{joint: value}}")
        leading = [joint.name for joint in self.leading()]
        for name, value in values.items():
            joint = self.joints.get(name)
            if joint and joint.mimic:
                raise ConfigurationError(
                    f"locked: joint {name!r} mimics {joint.mimic.leader!r}; lock that one"
                )
            if name not in leading:
                raise ConfigurationError(f"locked: {unknown('movable joint', name, leading)}")
            if not isinstance(value, Real) or not abs(value) <= LARGEST:
                raise ConfigurationError(f"locked: joint {name!r} at {value}; give a finite value")
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

    def with_wheels(self, names: Collection[str]) -> Tree:
        """The tree with joints taken as wheels, which are not the arm's.

        Raises:
            ConfigurationError: One does not exist, slides, or has to do with mimic joints.
        """
        led = {joint.mimic.leader for joint in self.joints.values() if joint.mimic}
        turning = [j.name for j in self.leading() if j.kind != "prismatic" and j.name not in led]
        for name in names:
            if name not in turning:
                raise ConfigurationError(f"wheels: {unknown('turning joint', name, turning)}")
        joints = {
            name: replace(joint, kind="wheel") if name in names else joint
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

    def limits(self) -> tuple[Array, Array]:
        """(n,) each: the least and the largest q at which no joint is beyond its limits.

        Raises:
            ModelError: A joint that mimics another leaves it nowhere to be.
        """
        leading, movable = self.leading(), [j for j in self.depth_first() if j.movable]
        lower = np.array([joint.lower for joint in leading])
        upper = np.array([joint.upper for joint in leading])
        for joint, gains, offset in zip(movable, *self.coupling(), strict=True):
            j = int(np.abs(gains).argmax())
            if gains[j] == 0.0:  # it stays where it is
                continue
            low, high = sorted((end - offset) / gains[j] for end in (joint.lower, joint.upper))
            if low > upper[j] or high < lower[j]:
                raise ModelError(
                    f"{self.name}: joint {leading[j].name!r} has nowhere to be: {joint.name!r}, "
                    f"which mimics it, asks for {low:g} to {high:g}, the others allow "
                    f"{lower[j]:g} to {upper[j]:g}; correct <limit> or <mimic>"
                )
            lower[j], upper[j] = max(lower[j], low), min(upper[j], high)
        lower.flags.writeable = upper.flags.writeable = False
        return lower, upper

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
        spacecraft = Inertial.of(
            body.mass if mass is None else mass,
            body.inertia if inertia is None else inertia,
            body.lever,
            body="the spacecraft",
            prefix="base_",
        )
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
