"""Models of Pinocchio: a pin.Model or a RobotWrapper, fixed base or free-flyer, as a tree."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TypeAlias

import coal
import numpy as np
import pinocchio as pin
from pinocchio.robot_wrapper import RobotWrapper

from spacearm.arrays import Array
from spacearm.description import shapes
from spacearm.description.bodies import Inertial, Joint, Mimic
from spacearm.description.readers.forest import SAME_FRAME, Forest
from spacearm.description.readers.source import Source
from spacearm.description.tree import Tree, free_name

PinocchioModel: TypeAlias = pin.Model | RobotWrapper
PINOCCHIO_MODELS = (pin.Model, RobotWrapper)
FREE = "JointModelFreeFlyer"
#: Joints in a row that stand for a joint of several freedoms.
ROWS = {
    "Spherical": (("x", "revolute"), ("y", "revolute"), ("z", "revolute")),
    "SphericalZYX": (("z", "revolute"), ("y", "revolute"), ("x", "revolute")),
    "Planar": (("x", "prismatic"), ("y", "prismatic"), ("z", "revolute")),
    "Translation": (("x", "prismatic"), ("y", "prismatic"), ("z", "prismatic")),
}
#: Share of the mass of a body that rounding leaves of zero.
LEAST_SHARE = 1e-12
#: Names of half lengths in coal.
HALVES = {"size": "halfSide", "length": "halfLength"}
#: Pinocchio writes the largest number there is where there is no limit.
NO_LIMIT = 1e300


def read(source: Source, robot: PinocchioModel) -> Tree:
    """Read a model of Pinocchio; a `RobotWrapper` has shapes too.

    The root is the body of the free-flyer; of a model with a fixed base, what is fixed to the
    universe.

    Args:
        source: Takes the notes; its path is the name of the model.
        robot: The model.

    Raises:
        ModelError: It has a joint of a type that cannot be described, or no joint.
    """
    return _Reader(source, robot).tree()


def name_of(robot: PinocchioModel) -> Path:
    """Return the name of a model, for messages."""
    return Path((robot if isinstance(robot, pin.Model) else robot.model).name or "pinocchio")


class _Reader:
    """One model on its way to a tree."""

    def __init__(self, source: Source, robot: PinocchioModel) -> None:
        self._source = source
        self._model: pin.Model = robot if isinstance(robot, pin.Model) else robot.model
        wrapped = not isinstance(robot, pin.Model)
        self._visual = robot.visual_model if wrapped else None
        self._collision = robot.collision_model if wrapped else None
        self._joints: dict[int, list[str]] = {}

    def tree(self) -> Tree:
        """Return the tree of the robot."""
        forest, model = Forest(), self._model
        leaders = [self._bodies(forest, i) for i in range(model.njoints)]
        for i in range(1, model.njoints):
            joint, parent = model.joints[i], model.parents[i]
            if joint.shortname() == FREE and parent == 0:
                continue
            at = model.jointPlacements[i].copy()
            row = self._row(model.names[i], joint, at)
            self._joints[i] = [one.name for one in row]
            self._mimic(i, row)
            forest.join(leaders[parent], leaders[i], row)
        for name in ("armature", "friction", "damping"):
            if np.any(getattr(model, name, 0.0)):
                self._source.note(f"{name} of joints is left out")
        roots = forest.roots()
        if model.inertias[0].mass == 0.0 and len(forest.tree("", leaders[0]).joints) == 0:
            roots.remove(leaders[0])
        return forest.robot(self._source, model.name or "robot", roots)

    def _bodies(self, forest: Forest, i: int) -> str:
        """Add the links that move with joint i; return the one in the frame of the joint."""
        frames = {f: x for f, x in enumerate(self._model.frames) if x.parentJoint == i}
        bodies = {f: frame for f, frame in frames.items() if frame.type == pin.BODY}
        first = next((f for f, b in bodies.items() if b.placement.isIdentity(SAME_FRAME)), None)
        leader = self._model.names[i] if first is None else bodies.pop(first).name
        leader = free_name(leader, forest.links.__contains__)
        whole, parts = self._shared_out(i, frames, bodies)
        forest.add(leader, _inertial(whole), self._shapes(i))
        names = {f: free_name(frame.name, forest.links.__contains__) for f, frame in bodies.items()}
        for f, frame in bodies.items():
            forest.add(names[f], parts.get(f))
            above = frame.parentFrame
            while above in frames and above not in bodies and above:
                above = frames[above].parentFrame
            carrier = bodies[above].placement if above in bodies else pin.SE3.Identity()
            forest.fix(names.get(above, leader), names[f], carrier.actInv(frame.placement))
        for frame in frames.values():
            if frame.type in (pin.OP_FRAME, pin.SENSOR):
                forest.mark(frame.name, leader, frame.placement.copy())
        return leader

    def _shared_out(
        self, i: int, frames: Mapping[int, pin.Frame], bodies: Mapping[int, pin.Frame]
    ) -> tuple[pin.Inertia, dict[int, Inertial]]:
        """Return the inertia of the first link that moves with joint i, and those of the others.

        Pinocchio keeps the inertia of a body fixed to another in the frame of the fixed joint; the
        sum of all counts.
        """
        whole = rest = self._model.inertias[i]
        parts: dict[int, Inertial] = {}
        for f, frame in bodies.items():
            above = frames.get(frame.parentFrame, frame)
            own = frame.inertia + above.inertia if above.type == pin.FIXED_JOINT else frame.inertia
            if own.mass > 0.0 and (part := _inertial(own)):
                parts[f] = part
                rest = rest - frame.placement.act(own)
        left = _inertial(rest)
        if abs(rest.mass) <= LEAST_SHARE * whole.mass:
            return pin.Inertia.Zero(), parts
        return (rest, parts) if left and left.fault() is None else (whole, {})

    def _row(self, name: str, joint: pin.JointModel, at: pin.SE3) -> list[Joint]:
        """Return the joints in a row that a joint of Pinocchio is, the first one at a pose."""
        kind = joint.shortname().removeprefix("JointModel")
        if kind == "Composite":
            whole = joint.extract()
            parts: list[Joint] = []
            for j, (part, pose) in enumerate(zip(whole.joints, whole.jointPlacements, strict=True)):
                here = at * pose if j == 0 else pose.copy()
                parts += self._row(f"{name}_{j + 1}", part, here)
            return parts
        if kind == "Spherical":
            self._source.balls.append(name)
        if kind in ROWS or kind == "Universal":
            axes = dict(zip("xyz", np.eye(3), strict=True))
            row = [(letter, one, axes[letter]) for letter, one in ROWS.get(kind, ())]
            if kind == "Universal":
                both = joint.extract()
                row = [("1", "revolute", both.axis1), ("2", "revolute", both.axis2)]
            poses = [at, *(pin.SE3.Identity() for _ in row[1:])]
            return [
                self._joint(f"{name}_{suffix}", one, axis, pose, joint, j)
                for j, ((suffix, one, axis), pose) in enumerate(zip(row, poses, strict=True))
            ]
        if joint.nv > 1 or "Helical" in kind or kind in ("HX", "HY", "HZ", "FreeFlyer"):
            self._source.fail(
                f"joint {name!r} is of the type {joint.shortname()}",
                "replace it by revolute and prismatic joints",
            )
        data = joint.createData()
        joint.calc(data, pin.neutral(self._model))
        S = np.array(data.S).reshape(-1)
        if kind == "Mimic":
            S = S / joint.extract().scaling
        slides = not S[3:].any()
        axis = S[:3] if slides else S[3:]
        return [self._joint(name, "prismatic" if slides else "revolute", axis, at, joint, 0)]

    def _joint(
        self, name: str, kind: str, axis: np.ndarray, at: pin.SE3, joint: pin.JointModel, j: int
    ) -> Joint:
        """Return a joint about or along an axis, with the limits of freedom j of its joint."""
        model = self._model
        lower, upper = -math.inf, math.inf
        if joint.nq == joint.nv:
            ends = model.lowerPositionLimit, model.upperPositionLimit
            lower, upper = (_limit(limits[joint.idx_q + j]) for limits in ends)
        velocity, effort = (
            self._source.largest(_limit(limits[joint.idx_v + j]), what, name)
            for limits, what in ((model.velocityLimit, "rate"), (model.effortLimit, "effort"))
        )
        if kind == "revolute" and math.isinf(lower) and math.isinf(upper):
            kind = "continuous"
        direction = np.array(axis, dtype=np.float64).reshape(3)
        return Joint(name, kind, "", "", at, direction, lower, upper, velocity, effort)

    def _mimic(self, i: int, row: list[Joint]) -> None:
        """Make joint i follow the one that it mimics."""
        model = self._model
        if i not in list(model.mimicking_joints):
            return
        follower = model.joints[i].extract()
        leader = list(model.mimicked_joints)[list(model.mimicking_joints).index(i)]
        mimic = Mimic(self._joints[leader][0], float(follower.scaling), float(follower.offset))
        row[0] = replace(row[0], mimic=mimic)

    def _shapes(self, i: int) -> shapes.Visuals:
        """Return the shapes that move with joint i."""
        both = (g.geometryObjects if g else () for g in (self._visual, self._collision))
        own = ([thing for thing in things if thing.parentJoint == i] for things in both)
        visual, collision = (tuple(chain(*map(_shape, things))) for things in own)
        return shapes.Visuals(visual, collision)


def _inertial(inertia: pin.Inertia) -> Inertial | None:
    if inertia.mass == 0.0 and not inertia.inertia.any():
        return None
    return Inertial.of_spatial(inertia)


def _limit(value: float) -> float:
    return math.copysign(math.inf, value) if abs(value) >= NO_LIMIT else float(value)


def _shape(thing: pin.GeometryObject) -> tuple[shapes.Shape, ...]:
    """Return a geometry object as shapes; an ellipsoid counts as its box."""
    pose, rgba, given = thing.placement.copy(), tuple(map(float, thing.meshColor)), thing.geometry

    def numbers(name: str, _: int) -> Array:
        half = HALVES.get(name)
        return np.atleast_1d(2.0 * getattr(given, half) if half else getattr(given, name))

    if isinstance(given, (coal.Box, coal.Sphere, coal.Cylinder, coal.Capsule, coal.Ellipsoid)):
        return shapes.primitive(type(given).__name__.lower(), numbers, pose, rgba)
    path = Path(thing.meshPath)
    if path.suffix and path.is_file():
        scale = tuple(np.ravel(thing.meshScale).tolist())
        return (shapes.Shape(pose, shapes.Mesh(thing.meshPath, path.resolve(), scale), rgba),)
    problem = f"geometry {thing.name!r} is not a file; give the model the path of its mesh"
    return (shapes.Shape(pose, shapes.Unusable(problem), rgba),)
