"""Tree: links and joints of a robot as plain data, and the Pinocchio model made of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import count
from typing import NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from spacearm.arrays import (
    LARGEST,
    LEAST_MASS,
    Array,
    ArrayLike,
    finite,
    number_of,
    read_only,
    shape_of,
)
from spacearm.description.bodies import Inertial, Joint
from spacearm.description.shapes import Visuals
from spacearm.errors import ConfigurationError, ModelError, listed, require_known, unknown
from spacearm.signatures import shown

#: Joints of wheels, or their largest torque [N m] and momentum [N m s] by name.
Wheels: TypeAlias = Collection[str] | Mapping[str, Sequence[float]]
#: Name of the spacecraft's free-flyer joint, as in Pinocchio's URDF reader; numbered if taken.
ROOT_JOINT = "root_joint"
#: Length of a link up to which it has none [m].
LEAST_LENGTH = 1e-6


class Loop(NamedTuple):
    """Two links that hold each other, by which a chain is closed.

    Attributes:
        name: What it is called.
        link: A link of the tree.
        other: Another link of the tree, the root of its cargo, or "" for the fixed world.
        pose: Pose of `other` in the frame of `link` while they hold each other.
        point: The point (3,) of `link` at which they do, as by a ball joint, which `pose` has at
            rest; None if they are fixed to each other.
    """

    name: str
    link: str
    other: str
    pose: pin.SE3
    point: Array | None = None

    def turned(self) -> Loop:
        """Return the same loop with its links exchanged."""
        there = self.pose.inverse()
        point = None if self.point is None else there.act(self.point)
        return Loop(self.name, self.other, self.link, there, point)


@dataclass(frozen=True, eq=False)
class Tree:
    """A kinematic tree with one root.

    Attributes:
        name: The robot's name.
        root: The root link: the spacecraft, or a frame fixed to it.
        links: Mass properties of every link, by name; None for a frame without mass.
        joints: Every joint, by name.
        visuals: Shapes of the links that have any, by name.
        tips: Tip links that the file names itself; usually none.
        marks: Links without mass that only mark a place, such as a site, or are between the joints
            in a row of one body. They can be tips, and are not leaves.
        notes: What was assumed, repaired or left out as it was read, a sentence each.
        loops: Where closed chains are cut.
        cargo: A body that floats by itself, which loops hold; usually none.
    """

    name: str
    root: str
    links: Mapping[str, Inertial | None]
    joints: Mapping[str, Joint]
    visuals: Mapping[str, Visuals] = field(default_factory=dict)
    tips: tuple[str, ...] = ()
    marks: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    loops: tuple[Loop, ...] = ()
    cargo: Tree | None = None

    def depth_first(self) -> list[Joint]:
        """Return all joints, parents before children, siblings by name: Pinocchio's URDF order."""
        children: dict[str, list[Joint]] = {link: [] for link in self.links}
        for joint in sorted(self.joints.values(), key=lambda joint: joint.name, reverse=True):
            children[joint.parent].append(joint)
        order, waiting = list[Joint](), children[self.root]
        while waiting:
            order.append(joint := waiting.pop())
            waiting += children[joint.child]
        return order

    def chain(self, link: str) -> list[Joint]:
        """Return the joints from the root to a link, in that order."""
        chain: list[Joint] = []
        while link != self.root:
            chain.append(self._into[link])
            link = chain[-1].parent
        return chain[::-1]

    @cached_property
    def _into(self) -> dict[str, Joint]:
        return {joint.child: joint for joint in self.joints.values()}

    def way_to(self, link: str) -> float:
        """Sum the distances between the joints up to a link [m], from the first movable one on."""
        return self._ways[link]

    @cached_property
    def _ways(self) -> dict[str, float]:
        """The sum of `way_to` for each link that a joint moves."""
        ways: dict[str, float] = {}
        for joint in self.depth_first():
            if joint.parent in ways:
                step = float(np.linalg.norm(joint.origin.translation))
                ways[joint.child] = ways[joint.parent] + step
            elif joint.movable:
                ways[joint.child] = 0.0
        return ways

    def leaves(self) -> list[str]:
        """Return the links without children, other than those that only mark a place."""
        carriers = {joint.parent for joint in self.joints.values()}
        idle = {mark for mark in self.marks if mark not in carriers}
        parents = {joint.parent for joint in self.joints.values() if joint.child not in idle}
        return [link for link in self.links if link not in parents | idle]

    @cached_property
    def frames(self) -> dict[str, pin.SE3]:
        """Poses of all links in the root frame, joints at zero."""
        frames = {self.root: pin.SE3.Identity()}
        for joint in self.depth_first():
            frames[joint.child] = frames[joint.parent] * joint.origin
        return frames

    @cached_property
    def bodies(self) -> dict[str, Inertial]:
        """The rigid bodies, in link axes at their CM, by the link nearest to the root."""
        inertias = list(self.pinocchio().inertias)[1:]
        return dict(zip(self.lumps, map(Inertial.of_spatial, inertias), strict=True))

    @cached_property
    def body_of(self) -> dict[str, str]:
        """The link nearest to the root of those that move as one body with each link."""
        leader = {self.root: self.root}
        for joint in self.depth_first():
            leader[joint.child] = joint.child if joint.movable else leader[joint.parent]
        return leader

    @cached_property
    def lumps(self) -> dict[str, list[str]]:
        """The links that move as one body, by the one of them nearest to the root."""
        lumps: dict[str, list[str]] = {}
        for link, first in self.body_of.items():
            lumps.setdefault(first, []).append(link)
        return lumps

    def has(self, name: str) -> bool:
        """Whether a link or joint has this name, or a name that starts with it and "_" or "."."""
        start = (f"{name}_", f"{name}.")
        return any(n == name or n.startswith(start) for n in (*self.links, *self.joints))

    def renamed(self, rename: Callable[[str], str]) -> Tree:
        """Return the tree with every name of a link or a joint changed."""
        joints = [joint.renamed(rename) for joint in self.joints.values()]
        return replace(
            self,
            root=rename(self.root),
            links={rename(name): part for name, part in self.links.items()},
            joints={joint.name: joint for joint in joints},
            visuals={rename(name): shapes for name, shapes in self.visuals.items()},
            tips=tuple(map(rename, self.tips)),
            marks=tuple(map(rename, self.marks)),
            loops=tuple(
                loop._replace(
                    link=rename(loop.link),
                    other=rename(loop.other) if loop.other in self.links else loop.other,
                )
                for loop in self.loops
            ),
        )

    def within(self, links: Collection[str]) -> Tree:
        """Return the part of the tree that consists of these links, from its root on."""
        return replace(
            self,
            links={name: part for name, part in self.links.items() if name in links},
            joints={name: joint for name, joint in self.joints.items() if joint.parent in links},
            visuals={name: shapes for name, shapes in self.visuals.items() if name in links},
            tips=tuple(tip for tip in self.tips if tip in links),
            marks=tuple(mark for mark in self.marks if mark in links),
            loops=tuple(
                loop
                for loop in self.loops
                if loop.link in links and (loop.other in links or loop.other not in self.links)
            ),
        )

    def with_joints(self, *joints: Joint) -> Tree:
        """Return the tree with these joints in place of those of the same names."""
        return replace(self, joints={**self.joints, **{joint.name: joint for joint in joints}})

    def joined(self, other: Tree, name: str, parent: str, at: pin.SE3) -> Tree:
        """Return both trees as one, the root of `other` fixed to a link of this one.

        Args:
            other: The tree to add.
            name: Name of the fixed joint.
            parent: The link that it is fixed to.
            at: Pose of the root of `other` in the frame of that link.

        Raises:
            ModelError: Both have a link or a joint of the same name.
        """
        bolt = Joint(name, "fixed", parent, other.root, at, np.array([1.0, 0.0, 0.0]))
        added = {**other.joints, name: bolt}
        if twice := [*(self.links.keys() & other.links), *(self.joints.keys() & added)]:
            raise ModelError(f"{self.name} has {listed(sorted(twice))} already; rename one")
        return replace(
            self,
            links={**self.links, **other.links},
            joints={**self.joints, **added},
            visuals={**self.visuals, **other.visuals},
            marks=(*self.marks, *other.marks),
            loops=(*self.loops, *other.loops),
            cargo=self.cargo or other.cargo,
            notes=(*self.notes, *other.notes),
        )

    def locked(self, values: Mapping[str, float]) -> Tree:
        """Return the tree with joints locked at `values` [rad] or [m], by name, and their mimics.

        Raises:
            ConfigurationError: A joint does not exist or mimics another, or its value is not a
                finite number.
        """
        self.require_leading(values, "locked", "lock")
        for name, value in values.items():
            if not abs(number_of(value)) <= LARGEST:
                raise ConfigurationError(
                    f"locked: joint {name!r} at {shown(value)}; give a finite value"
                )
        values = {name: float(value) for name, value in values.items()}
        while followers := {
            joint.name: joint.mimic.multiplier * values[joint.mimic.leader] + joint.mimic.offset
            for joint in self.joints.values()
            if joint.mimic and joint.mimic.leader in values and joint.name not in values
        }:
            values |= followers
        return self.with_joints(*(self.joints[name].frozen(at) for name, at in values.items()))

    def with_wheels(self, wheels: Wheels) -> Tree:
        """Return the tree with joints taken as the axles of momentum wheels.

        Args:
            wheels: Their names; or the largest torque [N m] and momentum [N m s] of each by name,
                () where those of the joint count.

        Raises:
            ConfigurationError: A joint does not exist, slides, mimics another or is mimicked; or a
                limit is not positive, or needs an inertia that the wheel does not have.
        """
        led = {joint.mimic.leader for joint in self.joints.values() if joint.mimic}
        turning = [j.name for j in self.leading() if j.kind != "prismatic" and j.name not in led]
        turning += [joint.name for joint in self.joints.values() if joint.kind == "wheel"]
        require_known("turning joint", wheels, turning, "wheels: ")
        tree = self.with_joints(*(replace(self.joints[name], kind="wheel") for name in wheels))
        limits = wheels.items() if isinstance(wheels, Mapping) else ()
        return tree.with_joints(
            *(tree._limited_wheel(*both) for both in limits if shape_of(both[1]) != (0,))
        )

    def _limited_wheel(self, name: str, limits: Sequence[float]) -> Joint:
        """Return a wheel with a largest torque [N m] and momentum [N m s]."""
        torque, capacity = finite(limits, (2,), f"wheels: {name}", "torque [N m], momentum [N m s]")
        moment = self.spin_inertia(self.joints[name])
        if min(torque, capacity) <= 0.0:
            raise ConfigurationError(
                f"wheels: {name!r} has the limits {torque:g} N m and {capacity:g} N m s; give "
                "positive ones"
            )
        if not moment:
            raise ConfigurationError(f"wheels: {name!r} has no inertia to hold {capacity:g} N m s")
        return replace(self.joints[name], effort=float(torque), velocity=float(capacity / moment))

    def spin_inertia(self, wheel: Joint) -> float:
        """Return the moment of inertia of all that a joint carries about its axis [kg m^2]."""
        whole, _ = self.carried(wheel)
        return float(wheel.axis @ whole.inertia @ wheel.axis)

    def carried(self, joint: Joint) -> tuple[pin.Inertia, list[Joint]]:
        """Return the inertia of all that a joint carries, in its frame, and the joints there."""
        behind, inner = [joint.child], []
        for other in self.depth_first():
            if other.parent in behind:
                behind.append(other.child)
                inner += [] if other.kind == "fixed" else [other]
        hub, whole = self.frames[joint.child], pin.Inertia.Zero()
        for link in behind:
            if part := self.links[link]:
                whole += hub.actInv(self.frames[link]).act(part.spatial())
        return whole, inner

    def movable(self, link: str | None = None) -> list[Joint]:
        """Return the joints that can move, those on the way to a link only if one is given."""
        joints = self.depth_first() if link is None else self.chain(link)
        return [joint for joint in joints if joint.movable]

    @property
    def freedoms(self) -> int:
        """Number of movable joints."""
        return sum(joint.movable for joint in self.joints.values())

    def leading(self) -> list[Joint]:
        """Return the movable joints that mimic no other, in the order of q."""
        return [joint for joint in self.movable() if not joint.mimic]

    def require_leading(self, names: Iterable[object], argument: str, verb: str) -> None:
        """Refuse what is not a name of a movable joint, or of one that mimics another.

        Args:
            names: What was given.
            argument: Name of the argument.
            verb: What it does to joints, for the message.

        Raises:
            ConfigurationError: There is such a name.
        """
        leading = [joint.name for joint in self.leading()]
        for name in names:
            joint = self.joints.get(name) if isinstance(name, str) else None
            if joint and joint.movable and joint.mimic:
                raise ConfigurationError(
                    f"{argument}: joint {name!r} mimics {joint.mimic.leader!r}; {verb} that one"
                )
            require_known("movable joint", [name], leading, f"{argument}: ")

    def leader(self, joint: Joint) -> Joint:
        """Return the joint that a joint mimics in the end; the joint itself if it mimics none."""
        while joint.mimic:
            joint = self.joints[joint.mimic.leader]
        return joint

    def plane_normal(self) -> int | None:
        """Return the axis (0, 1, 2) that all joints turn about or slide normal to, if any."""
        normals = {0, 1, 2}
        for joint in self.movable():
            along = np.abs(self.frames[joint.child].rotation @ joint.axis)
            wanted = 0.0 if joint.kind == "prismatic" else 1.0
            normals = {i for i in normals if abs(along[i] - wanted) < 1e-9}
        return normals.pop() if len(normals) == 1 else None

    def with_spacecraft(self, mass: float | None, inertia: ArrayLike | None) -> Tree:
        """Return the tree with another mass or inertia of the spacecraft.

        Args:
            mass: Mass of the spacecraft with all that is fixed to it [kg]; as it is if None.
            inertia: (3, 3) its inertia about its CM [kg m^2]; that of a body of the same shape if
                None, in proportion to the mass.

        Raises:
            ModelError: No rigid body can have this mass and inertia.
        """
        lump, body = self.lumps[self.root], self.bodies[self.root]
        spacecraft = Inertial.of(
            body.mass if mass is None else mass,
            body.inertia if inertia is None else inertia,
            body.origin.translation,
            body="the spacecraft",
            prefix="base_",
        )
        if inertia is None:
            spacecraft = body.with_mass(spacecraft.mass)
        links = {name: None if name in lump else part for name, part in self.links.items()}
        return replace(self, links={**links, self.root: spacecraft})

    def with_limits(
        self, lower: Mapping[str, float] | None = None, upper: Mapping[str, float] | None = None
    ) -> Tree:
        """Return the tree with other limits of joints [rad] or [m]; infinite ones are none.

        Raises:
            ConfigurationError: A joint does not exist or cannot move, a limit is not a number, or
                the upper one is below the lower one.
        """
        lower, upper = lower or {}, upper or {}
        movable = {joint.name: joint for joint in self.movable()}
        for side, given, none in (("lower", lower, -math.inf), ("upper", upper, math.inf)):
            for name, end in given.items():
                require_known("joint", name, movable, f"{side}: ")
                if not (abs(end) <= LARGEST or end == none):
                    raise ConfigurationError(
                        f"{side} of joint {name!r} is {end:g}; give a number up to {LARGEST:g}, or "
                        f"{none} for no limit"
                    )
        changed = []
        for name in {**lower, **upper}:
            joint = movable[name]
            least, most = lower.get(name, joint.lower), upper.get(name, joint.upper)
            if least > most:
                raise ConfigurationError(
                    f"lower and upper of joint {name!r} are {least:g} and {most:g}; give the "
                    "least position first"
                )
            limited = joint.kind == "continuous" and min(-least, most) < math.inf
            kind = "revolute" if limited else joint.kind
            changed.append(replace(joint, kind=kind, lower=float(least), upper=float(most)))
        return self.with_joints(*changed)

    def with_a_mass(self, link: str) -> Inertial:
        """Return the mass properties of a link that has some.

        Raises:
            ModelError: There is no such link, or it has no mass; says which have.
        """
        part = self.links.get(link)
        if part is None or not part.mass:
            if several := [name for name in self.massive() if name in link.split(" + ")]:
                raise ModelError(f"{link!r} is one body of links; name one of: {listed(several)}")
            if link not in self.links:
                raise ModelError(unknown("link", link, self.massive()))
            raise ModelError(f"link {link!r} has no mass; name one of: {listed(self.massive())}")
        return part

    def with_home(self, positions: Mapping[str, float]) -> Tree:
        """Return the tree with other home positions of joints [rad] or [m].

        Raises:
            ConfigurationError: A joint does not exist or mimics another, or a position is beyond
                its limits.
        """
        self.require_leading(positions, "home", "name")
        moved = []
        for name, value in positions.items():
            joint = self.joints[name]
            if not joint.lower <= value <= joint.upper:
                raise ConfigurationError(
                    f"home of joint {name!r} is {value}, its limits are {joint.lower:g} and "
                    f"{joint.upper:g}; give a position between them"
                )
            moved.append(replace(joint, home=float(value)))
        return self.with_joints(*moved)

    def with_mass(self, link: str, mass: float) -> Tree:
        """Return the tree with another mass of a link [kg], its inertia scaled in proportion.

        Raises:
            ModelError: The link does not exist or has no mass, or the new mass is not positive.
        """
        part, number = self.with_a_mass(link), number_of(mass)
        if not LEAST_MASS <= number <= LARGEST:
            raise ModelError(f"the mass of {link!r} is {shown(mass)} kg; give a positive one")
        return replace(self, links={**self.links, link: part.with_mass(number)})

    def length(self, link: str, tips: Iterable[str]) -> float:
        """Compute the length of a link [m]: from the joint that moves it to the next one.

        The next joint is the one on the way to a tip, or the only one; of the last link it is the
        tip. The length is zero where both are in one place.

        Args:
            link: Name of a link, or of one that is fixed to it.
            tips: Names of the tip links.

        Raises:
            ModelError: The link does not exist, is the spacecraft, or nothing is next.
        """
        if link not in self.links:
            raise ModelError(unknown("link", link, self.links))
        first = self.body_of[link]
        if first == self.root:
            raise ModelError(
                f"link {link!r} is part of the spacecraft, which has no length; name a link of the "
                f"arm: {listed([name for name in self.lumps if name != self.root])}"
            )
        lump = self.lumps[first]
        after = [joint for joint in self.movable() if joint.parent in lump]
        ways = [joint for tip in tips for joint in self.movable(tip) if joint.parent in lump]
        ends = [tip for tip in tips if tip in lump]
        if joint := next(iter(ways or after[: len(after) == 1]), None):
            end = self.frames[joint.parent] * joint.origin
        elif ends:
            end = self.frames[ends[0]]
        else:
            raise ModelError(
                f"link {link!r} has {len(after)} joints after it, none on the way to the tip; "
                "name a link on the way"
            )
        return float(np.linalg.norm(end.translation - self.frames[first].translation))

    def with_length(self, link: str, length: float, tips: Iterable[str]) -> Tree:
        """Return the tree with another length of a link, see `length`; masses stay.

        The link, with all that is fixed to it, is enlarged to a body of the same shape: lengths by
        the factor k, inertias by k^2, shapes for drawings and collisions by k.

        Args:
            link: Name of the link.
            length: Its length [m].
            tips: Names of the tip links.

        Raises:
            ModelError: As `length`; or it has no length, or the new one is not positive.
        """
        before = self.length(link, tips)
        if before < LEAST_LENGTH:
            raise ModelError(
                f"link {link!r} has no length: the next joint is where its own is; name another"
            )
        if not LEAST_LENGTH <= number_of(length) <= LARGEST:
            raise ModelError(f"the length of {link!r} is {shown(length)} m; give a positive one")
        k, lump = length / before, self.lumps[self.body_of[link]]
        moved = [
            replace(joint, origin=pin.SE3(joint.origin.rotation, k * joint.origin.translation))
            for joint in self.joints.values()
            if joint.parent in lump
        ]
        parts = {name: part.scaled(k) for name in lump if (part := self.links[name])}
        shapes = {name: self.visuals[name].scaled(k) for name in lump if name in self.visuals}
        return replace(
            self.with_joints(*moved),
            links={**self.links, **parts},
            visuals={**self.visuals, **shapes},
        )

    def upright(self) -> Tree:
        """Return the tree with its meshes turned by `Shape.upright`."""
        turned = {link: shapes.upright() for link, shapes in self.visuals.items()}
        return replace(self, visuals=turned)

    def massive(self) -> list[str]:
        """Return the names of the links that have mass."""
        return [name for name, part in self.links.items() if part is not None and part.mass]

    def with_mount(self, joint: Joint, mount: pin.SE3) -> Tree:
        """Return the tree with a joint moved to a pose in the spacecraft frame."""
        return self.with_joints(replace(joint, parent=self.root, origin=mount))

    def pinocchio(self) -> pin.Model:
        """Make the Pinocchio model, with a free-flyer root and a body frame for every link."""
        model = pin.Model()
        model.name = self.name
        model.gravity = pin.Motion.Zero()
        name = free_name(ROOT_JOINT, self.joints.__contains__)
        root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), name)
        home = {self.root: (root, pin.SE3.Identity())}
        for joint in self.depth_first():
            carrier, placement = home[joint.parent]
            placement = placement * joint.origin
            if joint.movable:
                limits = (joint.effort, joint.velocity, joint.lower, joint.upper)
                ends = (np.array([limit]) for limit in limits)
                carrier = model.addJoint(carrier, joint.pinocchio(), placement, joint.name, *ends)
                placement = pin.SE3.Identity()
            home[joint.child] = (carrier, placement)
        for link, (carrier, placement) in home.items():
            if inertial := self.links[link]:
                model.appendBodyToJoint(carrier, inertial.spatial(), placement)
            model.addBodyFrame(link, carrier, placement, 0)
        return model


def free_name(name: str, taken: Callable[[str], bool]) -> str:
    """Return the name, with a number from 2 on if it is taken."""
    numbered = (name if i == 1 else f"{name}_{i}" for i in count(1))
    return next(free for free in numbered if not taken(free))


def coupling(tree: Tree) -> tuple[Array, Array]:
    """Return C and c of (positions of all movable joints) = C q + c, mimic joints included."""
    movable = tree.movable()
    column = {joint.name: j for j, joint in enumerate(tree.leading())}
    C, c = np.zeros((len(movable), len(column))), np.zeros(len(movable))
    for i, joint in enumerate(movable):
        scale = 1.0
        while joint.mimic:
            c[i] += scale * joint.mimic.offset
            scale *= joint.mimic.multiplier
            joint = tree.joints[joint.mimic.leader]
        C[i, column[joint.name]] = scale
    return C, c


def joint_limits(tree: Tree) -> tuple[Array, Array]:
    """Return the lower and upper limits of q, (n,) each, those of mimic joints included.

    Raises:
        ModelError: The limits of a joint and of one that mimics it exclude each other.
    """
    leading = tree.leading()
    lower = np.array([joint.lower for joint in leading])
    upper = np.array([joint.upper for joint in leading])
    for joint, gains, offset in zip(tree.movable(), *coupling(tree), strict=True):
        j = int(np.abs(gains).argmax())
        if gains[j] == 0.0:  # it stays where it is
            continue
        low, high = sorted((end - offset) / gains[j] for end in (joint.lower, joint.upper))
        if low > upper[j] or high < lower[j]:
            raise ModelError(
                f"{tree.name}: joint {leading[j].name!r} has no position within limits: "
                f"{joint.name!r}, which mimics it, needs {low:g} to {high:g}, the others allow "
                f"{lower[j]:g} to {upper[j]:g}; correct <limit> or <mimic>"
            )
        lower[j], upper[j] = max(lower[j], low), min(upper[j], high)
    return read_only(lower), read_only(upper)
