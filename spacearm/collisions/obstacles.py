"""Obstacles: bodies that a motion must not meet, in the inertial frame, at rest or moving."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, plain, positive
from spacearm.collisions.bodies import Bodies, extent
from spacearm.collisions.carriers import Carrier, Drifting, Moving, Still
from spacearm.collisions.options import checked_options, edges_of, known_options
from spacearm.collisions.solids import hull, primitive
from spacearm.description.shapes import Box, Cylinder, Mesh, Shape, Sphere, read_mesh
from spacearm.errors import ConfigurationError, ModelError, unknown
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.frames import PoseLike, sound_pose
from spacearm.motion.motion import Motion

ORIGIN = pin.SE3.Identity()


class Part(NamedTuple):
    """A solid of an obstacle, carried by a frame of its carrier.

    Attributes:
        link: The link of a robot that it belongs to.
        solid: The solid of coal.
        pose: Its pose in the frame.
        frame: Number of the frame.
        reach: Reach of the joints that carry it (see `Body`), by their number in the model.
        far: Length that no point of it is farther than from the origin of frame 0 [m].
    """

    link: str
    solid: coal.CollisionGeometry
    pose: pin.SE3
    frame: int
    reach: dict[int, float]
    far: float


@dataclass(frozen=True, eq=False, repr=False)
class Obstacle:
    """A body not to be met, made by `Obstacle.box`, `.sphere`, `.cylinder`, `.mesh` or `.robot`.

    Poses are given in the inertial frame, the one of `base` and of goals. Time is that of the
    motion: an obstacle that moves is at `pose` when the motion begins, or where its own motion is.

    Attributes:
        name: What it is called in answers.
        kind: "box", "sphere", "cylinder", "mesh" or "robot".
        shape: The shape about the origin of `pose`; None for a robot.
        pose: Where it is at the start; for one that is carried along, in the frame that carries it.
        twist: (6,) its velocity, [linear [m/s]; angular [rad/s]] of the origin of its frame in
            inertial axes, steady.
        along: The motion that carries it with its spacecraft, or the motion of the robot itself.
        posture: The configuration of a robot that does not move.
        margin: Distance that every body must keep from it [m].
        may_touch: Links of the arm that are not held off, such as the hand that is to grasp it.
    """

    name: str
    kind: str
    shape: Shape | None
    pose: pin.SE3
    twist: Array = field(default_factory=lambda: np.zeros(6))
    along: Motion | None = None
    posture: Configuration | None = None
    margin: float = 0.0
    may_touch: tuple[str, ...] = ()

    @classmethod
    def box(cls, size: npt.ArrayLike, pose: PoseLike = ORIGIN, **options: Any) -> Obstacle:
        """Return a box.

        Args:
            size: (3,) edges along the axes of its frame, or one length for a cube [m].
            pose: Pose of its centre.
            **options: `name`, `margin` [m], `may_touch` (links that need not keep off), and, of one
                that moves, `twist` ((6,), see `Obstacle`) or `along` (a `Motion`: the pose is then
                in the frame of the spacecraft of that motion).

        Raises:
            ConfigurationError: An argument does not make sense.
        """
        edges = edges_of(size)
        return cls._of("box", Box(edges), pose, options)

    @classmethod
    def sphere(cls, radius: float, pose: PoseLike = ORIGIN, **options: Any) -> Obstacle:
        """Return a sphere of a radius [m] about a pose; options and errors as for `box`."""
        return cls._of("sphere", Sphere(positive(radius, "radius", "length [m]")), pose, options)

    @classmethod
    def cylinder(
        cls, radius: float, length: float, pose: PoseLike = ORIGIN, **options: Any
    ) -> Obstacle:
        """Return a cylinder about a pose, its axis along z; options and errors as for `box`."""
        shape = Cylinder(
            positive(radius, "radius", "length [m]"), positive(length, "length", "length [m]")
        )
        return cls._of("cylinder", shape, pose, options)

    @classmethod
    def mesh(
        cls,
        path: str | os.PathLike[str],
        pose: PoseLike = ORIGIN,
        *,
        scale: float = 1.0,
        **options: Any,
    ) -> Obstacle:
        """Return the convex hull of a mesh file (STL, OBJ, DAE, PLY, GLB).

        Args:
            path: The file, in metres after the factor `scale`.
            pose: Pose of its frame.
            scale: The factor.
            **options: As for `box`.

        Raises:
            ConfigurationError: An argument does not make sense.
            ModelError: The mesh cannot be read or has no hull.
        """
        factor = positive(scale, "scale", "factor")
        file = Path(path).absolute()
        options = {"name": file.name} | options
        return cls._of("mesh", Mesh(file.name, file, (factor,) * 3), pose, options)

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
        """
        if not isinstance(thing, Configuration | Motion):
            raise ConfigurationError(
                f"an obstacle cannot be made of a {type(thing).__name__}; give the configuration "
                "or the motion of a robot"
            )
        moving = {"along": thing} if isinstance(thing, Motion) else {"posture": thing}
        known_options(options, ("name", "margin", "may_touch"))
        return cls._of("robot", None, ORIGIN, {"name": thing.arm.name} | options | moving)

    @classmethod
    def _of(cls, kind: str, geometry: Any, pose: PoseLike, options: dict[str, Any]) -> Obstacle:
        """Return an obstacle of checked options."""
        given = checked_options(options)
        along = given.get("along")
        if along is not None and kind != "robot":
            along = Motion.of(along)
        obstacle = cls(
            name=given["name"] or kind,
            kind=kind,
            shape=None if geometry is None else Shape(ORIGIN, geometry),
            pose=sound_pose(pose, "pose"),
            twist=given["twist"],
            along=along,
            posture=given.get("posture"),
            margin=given["margin"],
            may_touch=given["may_touch"],
        )
        if not obstacle.parts:
            raise ModelError(f"{obstacle.name}: none of its links has a shape; it blocks nothing")
        return obstacle

    @property
    def moves(self) -> bool:
        """Whether it moves."""
        return self.along is not None or bool(self.twist.any())

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """Its solids."""
        if self.kind == "robot":
            bodies = Bodies(self._robot).all
            slides = {j for body in bodies for one in body.slides.values() for j in one}
            longest = self._longest(slides)
            return tuple(
                Part(
                    body.link,
                    body.shape,
                    body.pose,
                    body.joint,
                    {j: r + longest * bool(body.slides[j]) for j, r in body.reach.items()},
                    body.far + longest,
                )
                for body in bodies
            )
        frame = 0 if self.along is None else 1
        return tuple(
            Part("", solid, pose, frame, {}, extent(pose, solid)) for solid, pose in self._solids()
        )

    @cached_property
    def carrier(self) -> Carrier:
        """What moves its frames."""
        if self.along is not None:
            return Moving(self.along)
        if self.posture is not None:
            return Still.of(self.posture)
        if self.twist.any():
            return Drifting(self.pose, self.twist)
        return Still((self.pose,))

    def poses(self, t: float) -> list[pin.SE3]:
        """Return the poses of its parts at a time [s], in the inertial frame."""
        frames = self.carrier.frames(t)
        return [frames[part.frame] * part.pose for part in self.parts]

    def moved(self, part: Part, t0: float, t1: float) -> float:
        """Return how far points of a part move between two times at most [m]."""
        return self.carrier.moved(part.frame, part.reach, part.far, t0, t1)

    def _solids(self) -> list[tuple[coal.CollisionGeometry, pin.SE3]]:
        """Return the solid of its shape, in the frame that carries it."""
        if self.shape is None:
            return []
        at = ORIGIN if self.along is None else self.pose
        geometry = self.shape.geometry
        if isinstance(geometry, Mesh) and geometry.file is not None:
            points = read_mesh(geometry.file).vertices * geometry.scale
            return [(hull(geometry.name, points), at)]
        return [(solid, at * pose) for solid, pose in primitive(self.shape)]

    @property
    def _robot(self) -> SpaceArm:
        """The robot that it is."""
        return next(thing.arm for thing in (self.along, self.posture) if thing is not None)

    def _longest(self, slides: set[int]) -> float:
        """Return the sum of the largest displacements of sliding joints, by number [m]."""
        if not slides:
            return 0.0
        rows = [self.posture.q] if self.posture is not None else getattr(self.along, "q", ())
        full = np.abs([self._robot.all_joints(q) for q in rows]).max(axis=0)
        return float(sum(full[j] for j in slides))

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
            "margin": self.margin,
            "may_touch": list(self.may_touch),
        }

    def __repr__(self) -> str:
        moving = ", moving" if self.moves else ""
        kept = f", margin {self.margin:g} m" if self.margin else ""
        return f"Obstacle({self.name}: {self.kind}{moving}{kept})"


def obstacles_of(given: object, arm: SpaceArm) -> tuple[Obstacle, ...]:
    """Return the obstacles that a caller gave: one or several, a posture or motion as a robot.

    Raises:
        ConfigurationError: One is none, or names a link that the arm does not have.
    """
    one = isinstance(given, Obstacle | Configuration | Motion)
    found = []
    for thing in given if isinstance(given, Sequence) and not one else [given]:
        if isinstance(thing, Configuration | Motion):
            thing = Obstacle.robot(thing)
        if not isinstance(thing, Obstacle):
            raise ConfigurationError(
                f"obstacles holds a {type(thing).__name__}; give sa.Obstacle.box(...), .sphere, "
                ".cylinder, .mesh or .robot, or a configuration or motion of another robot"
            )
        for link in thing.may_touch:
            if link not in arm.tree.links:
                raise ConfigurationError(unknown(f"link of {arm.name}", link, arm.tree.links))
        found.append(thing)
    return tuple(found)
