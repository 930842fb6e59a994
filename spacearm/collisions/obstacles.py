"""Obstacles: bodies that a motion must not meet, in the inertial frame, at rest or moving."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeAlias

import coal
import numpy as np
import pinocchio as pin

from spacearm.arrays import (
    LARGEST,
    Array,
    ArrayLike,
    Frozen,
    finite,
    plain,
    positive,
    read_only,
    shape_of,
    within,
)
from spacearm.collisions.bodies import Bodies, Body, extent
from spacearm.collisions.solids import hull, link_solids, primitive
from spacearm.collisions.swept_motion import Recorded
from spacearm.description.shapes import (
    Box,
    Cylinder,
    Mesh,
    Shape,
    Sphere,
    Visuals,
    ignored_axes,
    read_mesh,
)
from spacearm.errors import ConfigurationError, ModelError, require_known, type_of, warn
from spacearm.mechanics.target import Target
from spacearm.model.arm import Configuration
from spacearm.model.frames import PoseLike, sound_pose
from spacearm.motion.motion import Motion
from spacearm.signatures import checked, shown

ORIGIN = pin.SE3.Identity()
#: What is said of an obstacle besides its shape and pose.
OPTIONS = ("name", "margin", "may_touch", "twist", "along")


class ObstacleMotion(Protocol):
    """What moves the frames of an obstacle, and how far it can move a point at most.

    Its solids are bodies on these frames, numbered as the joints of a robot are.
    """

    def frames(self, t: float, /) -> Sequence[pin.SE3]:
        """Return the poses of the frames at a time [s]."""

    def moved(self, body: Body, t0: float, t1: float, /) -> float:
        """Return how far a point of a body moves between two times at most [m]."""


class Still(NamedTuple):
    """Frames at rest.

    Attributes:
        at: Their poses.
    """

    at: tuple[pin.SE3, ...]

    def frames(self, _t: float, /) -> Sequence[pin.SE3]:
        """Return the poses."""
        return self.at

    def moved(self, _body: Body, _t0: float, _t1: float, /) -> float:
        """Return 0."""
        return 0.0


class Drifting(NamedTuple):
    """A frame with a steady twist.

    Attributes:
        pose: Its pose at time 0.
        twist: (6,) velocity of its origin [m/s] and angular velocity [rad/s], inertial axes.
        begin: Its time when the motion begins [s].
    """

    pose: pin.SE3
    twist: Array
    begin: float

    def frames(self, t: float) -> Sequence[pin.SE3]:
        """Return the pose at a time."""
        v, w, t = self.twist[:3], self.twist[3:], self.begin + t
        return (pin.SE3(pin.exp3(t * w) @ self.pose.rotation, self.pose.translation + t * v),)

    def moved(self, body: Body, t0: float, t1: float) -> float:
        """Return the way of the origin and of the turn about it."""
        v, w = np.linalg.norm(self.twist[:3]), np.linalg.norm(self.twist[3:])
        return float(v + body.far * w) * abs(t1 - t0)


@dataclass(frozen=True)
class Tumbling:
    """The frame of a target.

    Attributes:
        target: The target.
        begin: Its time when the motion begins [s].
    """

    target: Target
    begin: float

    def frames(self, t: float) -> Sequence[pin.SE3]:
        """Return its pose at a time."""
        return (self.target.at(self.begin + t).pose,)

    def moved(self, body: Body, t0: float, t1: float) -> float:
        """Return the way by its drift and its turn."""
        return self.target.moved(body.far, self.begin + t0, self.begin + t1)


@dataclass(frozen=True)
class Moving:
    """The joint frames of a robot on a motion; frame 1 is its spacecraft. At its ends it rests.

    Attributes:
        motion: The motion.
        begin: Its time when that of the arm begins [s].
    """

    motion: Motion
    begin: float

    def frames(self, t: float) -> Sequence[pin.SE3]:
        """Return the poses of the joint frames at a time."""
        return joint_frames(self._recorded.at(self.begin + t))

    def moved(self, body: Body, t0: float, t1: float) -> float:
        """Return the way by the spacecraft's motion and by that of the joints."""
        way = np.append(0.0, self._recorded.way(body).cumsum())
        ends = np.interp((self.begin + t0, self.begin + t1), self.motion.t, way)
        return float(abs(ends[1] - ends[0]))

    @cached_property
    def _recorded(self) -> Recorded:
        return Recorded(self.motion)


def joint_frames(cfg: Configuration) -> list[pin.SE3]:
    """Return the poses of the joints of a robot, the spacecraft's frame at 1."""
    data = cfg.arm.borrow()
    pin.forwardKinematics(cfg.arm.model, data, cfg.full)
    frames = [pose.copy() for pose in data.oMi]
    cfg.arm.give_back(data)
    return frames


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Obstacle(Frozen):
    """A body to keep off: `Obstacle.box`, `.sphere`, `.cylinder`, `.mesh`, `.robot`, `.of_target`.

    Poses are given in the inertial frame, like `base` and goals. Time is that of the motion: when
    the motion begins, an obstacle that moves is at `pose`, or at the start of its own motion.

    Attributes:
        name: What it is called in answers.
        kind: "box", "sphere", "cylinder", "mesh", "robot" or "target".
        shape: The shape about the origin of `pose`; None for a robot or a target.
        pose: Where it is at the start; for one that is carried along, in the frame that carries it.
        twist: (6,) its constant velocity, [linear [m/s]; angular [rad/s]] of the origin of its
            frame, inertial axes.
        along: The motion whose spacecraft carries it, or the motion of the robot itself. Joints and
            poses are interpolated linearly between its samples.
        posture: The configuration of a robot that does not move.
        target: The target that it is.
        begin: Its own time when the motion begins [s].
        margin: Distance that every body must keep from it [m].
        may_touch: Links of the arm that need not keep off, such as the hand that is to grasp it.
    """

    name: str
    kind: str
    shape: Shape | None
    pose: pin.SE3
    twist: Array = field(default_factory=lambda: np.zeros(6))
    along: Motion | None = None
    posture: Configuration | None = None
    target: Target | None = None
    begin: float = 0.0
    margin: float = 0.0
    may_touch: tuple[str, ...] = ()

    @classmethod
    def box(cls, size: ArrayLike, pose: PoseLike = ORIGIN, **options: Any) -> Obstacle:
        """Return a box.

        Args:
            size: (3,) edges along the axes of its frame, or one length for a cube [m].
            pose: Pose of its centre.
            **options: `name`, `margin` [m], `may_touch` (links that need not keep off). An
                obstacle that moves has a `twist` ((6,), see `Obstacle`) or `along`, a `Motion`:
                the pose is then in the frame of the spacecraft of that motion.

        Raises:
            ConfigurationError: An argument does not make sense.
        """
        shape = shape_of(size)
        edges = finite(size, shape if shape == () else (3,), "size", "edges [m]")
        box = Box(tuple(positive(float(x), "size", "edge [m]") for x in np.broadcast_to(edges, 3)))
        return cls._of("box", Shape(ORIGIN, box), pose, options)

    @classmethod
    def sphere(cls, radius: float, pose: PoseLike = ORIGIN, **options: Any) -> Obstacle:
        """Return a sphere of a radius [m] about a pose; options and errors as for `box`."""
        ball = Sphere(positive(radius, "radius", "length [m]"))
        return cls._of("sphere", Shape(ORIGIN, ball), pose, options)

    @classmethod
    def cylinder(
        cls, radius: float, length: float, pose: PoseLike = ORIGIN, **options: Any
    ) -> Obstacle:
        """Return a cylinder about a pose, its axis along z; options and errors as for `box`."""
        cylinder = Cylinder(
            positive(radius, "radius", "length [m]"), positive(length, "length", "length [m]")
        )
        return cls._of("cylinder", Shape(ORIGIN, cylinder), pose, options)

    @classmethod
    def mesh(
        cls,
        path: str | os.PathLike[str],
        pose: PoseLike = ORIGIN,
        *,
        scale: float = 1.0,
        up_axes: bool = False,
        **options: Any,
    ) -> Obstacle:
        """Return the convex hull of a mesh file (STL, OBJ, DAE, PLY, glTF, GLB).

        Args:
            path: The file, in metres after the factor `scale`.
            pose: Pose of its frame.
            scale: The factor.
            up_axes: Whether it is turned by the up axis that a COLLADA file states; see `load`.
            **options: As for `box`.

        Raises:
            ConfigurationError: An argument does not make sense.
            ModelError: The mesh cannot be read or has no hull.

        Warns:
            ModelWarning: The up axis that the file states is ignored.
        """
        factor = positive(scale, "scale", "factor")
        file = Path(path).absolute()
        options = {"name": file.name} | options
        shape = Shape(ORIGIN, Mesh(file.name, file, (factor,) * 3))
        shape = shape.upright() if up_axes else shape
        if ignored := ignored_axes([Visuals((shape,))]):
            warn(f"{file}: {ignored}")
        return cls._of("mesh", shape, pose, options)

    @classmethod
    def robot(cls, thing: Configuration | Motion, **options: Any) -> Obstacle:
        """Return another robot, such as a target satellite, with all its bodies.

        Args:
            thing: Where it stands, `other.at(q, base=pose)`; or its motion, as `sa.simulate`
                returns it. Before and after the motion it stands still.
            **options: `name`, `margin` and `may_touch`, as for `box`.

        Raises:
            ConfigurationError: An argument does not make sense.
            ModelError: None of its links has a shape, or one is faulty.

        Warns:
            ModelWarning: The up axes that files of its meshes state are ignored.
        """
        if not isinstance(thing, Configuration | Motion):
            raise ConfigurationError(
                f"an obstacle cannot be made of {type_of(thing)}; give the configuration "
                "or the motion of a robot"
            )
        if ignored := ignored_axes(thing.arm.tree.visuals.values()):
            warn(f"{thing.arm.path}: {ignored}")
        moving = {"along": thing} if isinstance(thing, Motion) else {"posture": thing}
        return cls._of("robot", None, ORIGIN, {"name": thing.arm.name} | options, **moving)

    @classmethod
    def of_target(cls, target: Target, *, begin: float = 0.0, **options: Any) -> Obstacle:
        """Return a target that drifts and tumbles, with all its shapes.

        Args:
            target: The target.
            begin: Its time when the motion begins [s].
            **options: `name`, `margin` and `may_touch`, as for `box`.

        Raises:
            ConfigurationError: An argument does not make sense.
            ModelError: It has no shape, or one is faulty.
        """
        if not isinstance(target, Target):
            raise ConfigurationError(f"target is {type_of(target)}; give a sa.Target")
        since = float(finite(begin, (), "begin", "of time [s]"))
        options = {"name": target.name} | options
        return cls._of("target", None, ORIGIN, options, target=target, begin=since)

    @classmethod
    def _of(
        cls, kind: str, shape: Shape | None, pose: PoseLike, options: dict[str, Any], **moving: Any
    ) -> Obstacle:
        """Return an obstacle; one that is moved in ways of its own has fewer options."""
        names = ("name", "margin", "may_touch") if moving else OPTIONS
        require_known("option", options, names)
        options = {"name": kind} | options | moving
        return cls(kind=kind, shape=shape, pose=sound_pose(pose, "pose"), **options)

    def __post_init__(self) -> None:
        touch, along = self.may_touch, self.along
        if not isinstance(self.name, str) or not self.name:
            raise ConfigurationError(f"name is {self.name!r}; give a name")
        within(self.margin, "margin", 0.0, LARGEST, "a distance [m]")
        if not isinstance(touch, list | tuple | set | np.ndarray) or not all(
            isinstance(x, str) for x in touch
        ):
            raise ConfigurationError(f"may_touch is {shown(touch)}; give names of links in a list")
        twist = read_only(finite(self.twist, (6,), "twist", "[linear [m/s]; angular [rad/s]]"))
        if along is not None and twist.any():
            raise ConfigurationError("give an obstacle either twist or along, not both")
        if along is not None and self.kind != "robot":
            along = Motion.of(along)
        sound = {"margin": float(self.margin), "may_touch": tuple(touch)}
        for name, value in (sound | {"twist": twist, "along": along}).items():
            object.__setattr__(self, name, value)
        if not self.parts:
            remedy = "give its links visuals or collision geometry, or leave it out"
            if self.target is not None:
                remedy = (
                    "give its body a size, sa.Bus(..., size=(x, y, z)), or a file with shapes; "
                    "constraints=sa.Constraints(collisions=False) plans without collision checks"
                )
            raise ModelError(
                f"{self.name} has no shape, with which collisions could be checked; {remedy}"
            )

    @property
    def moves(self) -> bool:
        """Whether it moves."""
        return bool(self.along or self.target or self.twist.any())

    @cached_property
    def parts(self) -> tuple[Body, ...]:
        """Its solids, on the frames of its motion."""
        robot = self.along or self.posture
        if robot and self.kind == "robot":
            return tuple(Bodies(robot.arm).all)
        if self.target is not None:
            return tuple(
                _carried(link, solid, frame * pose)
                for link, frame in self.target.tree.frames.items()
                for solid, pose in link_solids(
                    self.name, link, self.target.tree.visuals.get(link, Visuals())
                )
            )
        frame = 0 if self.along is None else 1
        return tuple(_carried("", solid, pose, frame) for solid, pose in self._solids())

    @cached_property
    def motion(self) -> ObstacleMotion:
        """What moves its frames."""
        if self.along is not None:
            return Moving(self.along, self.begin)
        if self.target is not None:
            return Tumbling(self.target, self.begin)
        if self.posture is not None:
            return Still(tuple(joint_frames(self.posture)))
        if self.twist.any():
            return Drifting(self.pose, self.twist, self.begin)
        return Still((self.pose,))

    def poses(self, t: float) -> list[pin.SE3]:
        """Return the poses of its parts at a time [s], in the inertial frame."""
        frames = self.motion.frames(t)
        return [frames[body.joint] * body.pose for body in self.parts]

    def _solids(self) -> list[tuple[coal.CollisionGeometry, pin.SE3]]:
        """Return the solid of its shape, in the frame that carries it."""
        if self.shape is None:
            return []
        at = ORIGIN if self.along is None else self.pose
        geometry = self.shape.geometry
        if isinstance(geometry, Mesh) and geometry.file is not None:
            points = read_mesh(geometry.file).vertices * geometry.scale
            return [(hull(geometry.name, points), at * self.shape.pose)]
        return [(solid, at * pose) for solid, pose in primitive(self.shape)]

    def to_dict(self) -> dict[str, Any]:
        """Return the obstacle as plain data; the motion that it follows as its duration [s]."""
        geometry = None if self.shape is None else self.shape.geometry
        return {
            "name": self.name,
            "kind": self.kind,
            "geometry": None if geometry is None else plain(geometry._asdict()),
            "pose": plain(self.pose),
            "twist": plain(self.twist),
            "along": None if self.along is None else plain(self.along.t[-1] - self.along.t[0]),
            "posture": None if self.posture is None else plain(self.posture),
            "target": self.target and self.target.name,
            "margin": self.margin,
            "may_touch": list(self.may_touch),
        }

    def __repr__(self) -> str:
        moving = ", moving" if self.moves else ""
        kept = f", margin {self.margin:g} m" if self.margin else ""
        return f"Obstacle({self.name}: {self.kind}{moving}{kept})"


def _carried(link: str, solid: coal.CollisionGeometry, pose: pin.SE3, frame: int = 0) -> Body:
    """Return a solid at a pose in a frame, which no joint moves."""
    return Body(link, frame, pose, solid, {}, {}, extent(pose, solid))


#: What must not be met: an obstacle, a target, or the posture or motion of another robot.
ObstacleLike: TypeAlias = Obstacle | Target | Configuration | Motion


def obstacles_of(given: object, start: Configuration, t: float = 0.0) -> tuple[Obstacle, ...]:
    """Return the obstacles that a caller gave: one or several, targets, postures and motions too.

    Args:
        given: What was given.
        start: The arm at the first time of its motion; targets in orbit drift relative to its CM.
        t: That time [s].

    Raises:
        ConfigurationError: One is not an obstacle, or names a link that the arm does not have.
    """
    one = isinstance(given, Obstacle | Configuration | Motion | Target)
    arm, found = start.arm, []
    for thing in given if isinstance(given, Sequence) and not one else [given]:
        if isinstance(thing, Configuration | Motion):
            thing = Obstacle.robot(thing)
        if isinstance(thing, Target):
            thing = Obstacle.of_target(thing)
        if not isinstance(thing, Obstacle):
            raise ConfigurationError(
                f"obstacles holds {type_of(thing)}; give sa.Obstacle.box(...), .sphere, "
                ".cylinder, .mesh or .robot, a sa.Target, or a configuration or motion of a robot"
            )
        require_known(f"link of {arm.name}", thing.may_touch, arm.tree.links)
        if thing.target is not None and thing.target.orbit:
            thing = replace(thing, target=thing.target.relative_to(start, thing.begin + t))
        found.append(thing)
    return tuple(found)
