"""Target: a free rigid body that drifts and tumbles, and the frames by which it can be grasped."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import (
    Array,
    ArrayLike,
    Frozen,
    ReadOnlyMapping,
    finite,
    named,
    plain,
    positive,
    read_only,
    within,
)
from spacearm.description.bodies import Inertial
from spacearm.description.bus import Bus, stand_in
from spacearm.description.readers import formats
from spacearm.description.readers.formats import RobotSource
from spacearm.description.readers.source import Reading
from spacearm.description.shapes import ignored_axes
from spacearm.description.tree import Tree
from spacearm.errors import ModelError, listed, require_known, warn
from spacearm.mechanics.free_rotation import FreeRotation
from spacearm.model.arm import Configuration
from spacearm.model.frames import PoseLike, sound_pose
from spacearm.results import Cell, Column, Described, Description, Measure, Table
from spacearm.signatures import checked

HERE = pin.SE3.Identity()
NONE: Mapping[str, PoseLike] = {}
#: Largest rate of an orbit [rad/s]: about the densest planets none is faster.
FASTEST_ORBIT = 0.01


class Frame(NamedTuple):
    """Pose and twist of a frame at a time.

    Attributes:
        pose: Its pose in the inertial frame.
        twist: (6,) velocity of its origin [m/s] and angular velocity [rad/s], inertial axes.
    """

    pose: pin.SE3
    twist: Array

    def to_dict(self) -> dict[str, Any]:
        """Return its fields as plain JSON data."""
        return named(self)


@checked
@dataclass(frozen=True, eq=False, repr=False, init=False)
class Target(Frozen, Described):
    """A free rigid body, such as debris to be caught: it drifts and tumbles without torque.

    Its rotation is computed in closed form, at any time. With `orbit` its CM moves relative to the
    system CM of the chaser by the equations of Clohessy and Wiltshire (J. Aerosp. Sci. 27, 653-658
    (1960), DOI 10.2514/8.8704). `sa.catch`, `sa.plan` and `sa.collision_check` take the position
    and the velocity of that CM from their start; before a call of `at`, give it by `relative_to`.

    `sa.plan` and `sa.collision_check` take a target as an obstacle. `up_axes=True` turns the meshes
    of its file by the up axes that they state, as `load` does.

    Attributes:
        body: What it is: a `Bus`, or a URDF, SDF or MJCF whose links are all fixed to each other;
            or the `tree` of another target.
        pose: Pose of its frame, that of the root link, in the inertial frame at time 0.
        twist: (6,) its motion at time 0: velocity of the origin of its frame [m/s] and angular
            velocity [rad/s], inertial axes.
        grapples: Frames by which it can be grasped: poses in its own frame, by name. The tip of
            the hand is where such a frame is when it grasps; z points into the target, as the z
            axis of the hand does. Links without mass of a file count too.
        orbit: Orbital rate of the chaser [rad/s]; 0 far from any orbit. The inertial axes are then
            those of the orbit at time 0: x radial, outwards, y along the track and z normal to the
            orbit. The equations assume that the chaser is on a circular orbit, and that the target
            is near it: the error grows with the square of their distance. The inertial frame moves
            with the orbit such that the system CM of the chaser moves uniformly in it, with the
            velocity p / M, p the linear momentum on board and M the mass. Without `relative_to`
            that CM is at rest at the origin.
        name: What it is called. Default: the name of the body.
        tree: Its links, all fixed to each other.

    Raises:
        ConfigurationError: A value is not valid.
        ModelError: The file cannot be read, or the body has joints that move.

    Example:
        >>> import spacearm as sa
        >>> debris = sa.Target(
        ...     sa.Bus(90, size=(1, 1, 2), name="debris"),
        ...     sa.pose((2.5, 0.4, 0)),
        ...     twist=(0, 0.01, 0, 0, 0.02, 0.05),
        ...     grapples={"ring": sa.pose((0, 0, -1))},
        ... )
        >>> debris.at(60, "ring").pose.translation.round(3)
        array([ 1.799,  0.437, -0.437])
    """

    body: Bus | RobotSource | Tree
    pose: pin.SE3
    twist: Array
    grapples: Mapping[str, pin.SE3]
    orbit: float
    name: str
    tree: Tree = field(init=False)
    _chaser: tuple[Array, Array] = field(init=False)

    def __init__(
        self,
        body: Bus | RobotSource | Tree,
        pose: PoseLike = HERE,
        *,
        twist: ArrayLike = (0.0,) * 6,
        grapples: Mapping[str, PoseLike] = NONE,
        orbit: float = 0.0,
        name: str = "",
        up_axes: bool = False,
    ) -> None:
        in_orbit = "the orbital rate [rad/s] (0.0011 in low orbits of the Earth)"
        rate = within(orbit, "orbit", 0.0, FASTEST_ORBIT, in_orbit)
        tree = _rigid(body, up_axes)
        marks = {
            link: frame
            for link, frame in tree.frames.items()
            if link != tree.root and not tree.links[link]
        }
        own = {name: sound_pose(frame, f"grapple {name!r}") for name, frame in grapples.items()}
        self.__dict__.update(
            body=body,
            tree=tree,
            pose=sound_pose(pose, "pose"),
            twist=read_only(finite(twist, (6,), "twist", "[linear [m/s]; angular [rad/s]]")),
            grapples=ReadOnlyMapping(marks | own),
            orbit=rate,
            name=name or tree.name,
            _chaser=(np.zeros(3), np.zeros(3)),
        )

    @cached_property
    def drawn(self) -> tuple[Array, ...]:
        """Triangles (m, 3, 3) of its visuals, else of what collides, else of a box, target axes."""
        tree = self.tree
        found = [
            shape.triangles() @ frame.rotation.T + frame.translation
            for link, shapes in tree.visuals.items()
            for frame in (tree.frames[link],)
            for shape in shapes.drawn
        ]
        some = tuple(part for part in found if len(part))
        return some or (stand_in(tree.bodies[tree.root].spatial()).triangles(),)

    @property
    def inertial(self) -> Inertial:
        """Mass [kg], CM [m] and inertia about it [kg m^2], in the axes of its frame."""
        return self.tree.bodies[self.tree.root]

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return self.inertial.mass

    @property
    def com(self) -> Array:
        """CM (3,) in its frame [m]."""
        return np.array(self.inertial.origin.translation)

    @property
    def inertia(self) -> Array:
        """Inertia (3, 3) about its CM, in the axes of its frame [kg m^2]."""
        return self.inertial.inertia

    @cached_property
    def rotation(self) -> FreeRotation:
        """How it turns."""
        return FreeRotation(self.inertia, self.pose.rotation, self.twist[3:])

    @cached_property
    def cm(self) -> tuple[Array, Array]:
        """Place (3,) [m] and velocity (3,) [m/s] of its CM at time 0, inertial frame."""
        lever = self.pose.rotation @ self.com
        return self.pose.translation + lever, self.twist[:3] + np.cross(self.twist[3:], lever)

    def at(self, t: float, grapple: str | None = None) -> Frame:
        """Return pose and twist at a time [s], of its own frame or of a grapple frame.

        Args:
            t: The time [s].
            grapple: Name of a grapple frame.

        Raises:
            ConfigurationError: t is not finite, or there is no such frame.
        """
        time = float(finite(t, (), "t", "of time [s]"))
        R, w = self.rotation.at(time)
        place, v = self._cm_at(time)
        local = self.frame(grapple) if grapple is not None else HERE
        lever = R @ (local.translation - self.com)
        pose = pin.SE3(R @ local.rotation, place + lever)
        return Frame(pose, np.concatenate((v + np.cross(w, lever), w)))

    def relative_to(self, chaser: Configuration, t: float = 0.0) -> Target:
        """Return the target with the chaser relative to which it drifts in its orbit.

        The state of the target at time 0 stays the same. Without `orbit` nothing changes.

        Args:
            chaser: The chaser at time t. Its system CM moves at its linear momentum over its mass.
            t: A time of the target [s].

        Raises:
            ConfigurationError: t is not finite.
        """
        time = float(finite(t, (), "t", "of time [s]"))
        v = chaser.momentum[:3] / chaser.arm.mass
        return self._seen_from(chaser.com - time * v, v)

    def _seen_from(self, com: Array, v: Array) -> Target:
        """Return the target with place [m] and velocity [m/s] of the chaser's CM at time 0."""
        seen = copy(self)
        seen.__dict__["_chaser"] = read_only(com), read_only(v)
        return seen

    def _cm_at(self, t: float) -> tuple[Array, Array]:
        """Return place [m] and velocity [m/s] of its CM at a time [s], inertial frame."""
        place, v = self.cm
        if not self.orbit:
            return drift(place, v, t, 0.0)
        com, speed = self._chaser
        r, dr = drift(place - com, v - speed, t, self.orbit)
        return com + t * speed + r, speed + dr

    def frame(self, grapple: str) -> pin.SE3:
        """Return the pose of a grapple frame in its own frame.

        Raises:
            ConfigurationError: There is no such frame.
        """
        require_known(f"grapple of {self.name}", grapple, self.grapples)
        return self.grapples[grapple].copy()

    def moved(self, far: float, t0: float, t1: float) -> float:
        """Return how far a point moves between two times at most [m].

        Args:
            far: A distance that the point is not farther than from the origin of its frame [m].
            t0: A time [s].
            t1: The other.
        """
        cm, v = self._cm_at(t0)
        span, tide = abs(t1 - t0), math.sqrt(2.0) * self.orbit
        way = float(np.linalg.norm(v)) * span
        if tide:  # it accelerates by at most 2 n^2 |r|, r from the CM of the chaser
            com, speed = self._chaser
            r, dr = np.linalg.norm([cm - com - t0 * speed, v - speed], axis=1)
            way = r * (math.cosh(tide * span) - 1.0) + dr * math.sinh(tide * span) / tide
            way += float(np.linalg.norm(speed)) * span
        turn = min(self.rotation.fastest * span, 2.0)
        return float(way + (far + np.linalg.norm(self.com)) * turn)

    def replace(self, **changes: Any) -> Target:
        """Return the target with other values: another pose or twist, for example."""
        return replace(self, **{"body": self.tree} | changes)._seen_from(*self._chaser)

    def scaled(self, mass: float, inertia: float) -> Target:
        """Return the target with its mass and its inertia about the CM times factors.

        Only the shapes of the root link are kept; the result is meant for simulations.

        Args:
            mass: Factor of the mass.
            inertia: Factor of the inertia.

        Raises:
            ConfigurationError: One is not positive.
        """
        own = self.inertial
        other = Inertial(
            own.mass * positive(mass, "mass", "factor"), own.origin,
            own.inertia * positive(inertia, "inertia", "factor"),
        )  # fmt: skip
        tree, root = self.tree, self.tree.root
        visuals = {link: shapes for link, shapes in tree.visuals.items() if link == root}
        alone = replace(tree, links={root: other}, joints={}, visuals=visuals, tips=(), marks=())
        return self.replace(body=alone)

    def describe(self) -> Description:
        """Describe it: mass, inertia, motion and grapple frames."""
        moments = np.linalg.eigvalsh(self.inertia)
        w = float(np.linalg.norm(self.twist[3:]))
        facts: dict[str, Cell] = {
            "mass": Measure(self.mass, "kg"),
            "CM in its frame": Measure(self.com, "m"),
            "principal moments": Measure(moments, "kg m^2"),
            "CM at time 0": Measure(self.cm[0], "m"),
            "velocity of the CM at time 0": Measure(self.cm[1], "m/s"),
            "angular velocity at time 0": Measure(self.twist[3:], "rad/s"),
        }
        if self.orbit:
            facts["orbital rate"] = Measure(self.orbit, "rad/s")
        frames = [
            (name, pose.translation, pin.rpy.matrixToRpy(pose.rotation))
            for name, pose in self.grapples.items()
        ]
        columns = ("grapple frame", Column("place", "m"), Column("roll, pitch, yaw", "rad"))
        return Description(
            title=f"{self.name}, {self.mass:.5g} kg",
            verdict=f"it turns at {np.degrees(w):.3g}°/s" if w else "it does not turn",
            notes=self.tree.notes,
            tables=[Table.facts(facts), *([Table(columns, frames)] if frames else [])],
        )

    def to_dict(self) -> dict[str, Any]:
        """Return its values at time 0 as plain JSON data."""
        names = ("name", "mass", "com", "inertia", "pose", "twist", "grapples", "orbit")
        return {name: plain(getattr(self, name)) for name in names}


def _rigid(body: Bus | RobotSource | Tree, up_axes: bool) -> Tree:
    """Return the links of a target, all fixed to each other."""
    if isinstance(body, Tree):
        return body.upright() if up_axes else body
    rigid = Reading(rigid=True, up_axes=up_axes)
    tree = body.tree() if isinstance(body, Bus) else formats.read(body, rigid)
    if moving := [joint.name for joint in tree.movable()]:
        raise ModelError(
            f"{tree.name} has joints that move, {listed(moving)}, and a target is one rigid "
            "body; make them fixed in the file, or give the posture or motion of a robot, "
            "sa.Obstacle.robot, as an obstacle"
        )
    if ignored := ignored_axes(tree.visuals.values()):
        warn(f"{tree.name}: {ignored}")
    return tree


def drift(place: Array, v: Array, t: float, orbit: float) -> tuple[Array, Array]:
    """Compute where a free CM is, and its velocity, relative to a point that is in orbit.

    Args:
        place: (3,) its place at time 0 [m], axes as `Target.orbit` has them.
        v: (3,) its velocity then [m/s], inertial axes.
        t: Time [s].
        orbit: Orbital rate n [rad/s]; 0 for none.

    Returns:
        Place and velocity (3,) at t, along the inertial axes, which do not turn with the orbit.
    """
    if orbit == 0.0:
        return place + t * v, v
    n, s, c = orbit, math.sin(orbit * t), math.cos(orbit * t)
    flow = np.array([
        [4 - 3 * c, 0, 0, s / n, 2 * (1 - c) / n, 0],
        [6 * (s - n * t), 1, 0, -2 * (1 - c) / n, (4 * s - 3 * n * t) / n, 0],
        [0, 0, c, 0, 0, s / n],
        [3 * n * s, 0, 0, c, 2 * s, 0],
        [6 * n * (c - 1), 0, 0, -2 * s, 4 * c - 3, 0],
        [0, 0, -n * s, 0, 0, c],
    ])  # fmt: skip
    turning = np.array([[0, -n, 0], [n, 0, 0], [0, 0, 0]])  # of the axes of the orbit
    x, dx = (flow @ np.concatenate((place, v - turning @ place))).reshape(2, 3)
    back = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return back @ x, back @ (dx + turning @ x)
