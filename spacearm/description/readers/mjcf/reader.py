"""MJCF reader: a model of MuJoCo, compiled by MuJoCo itself and read from the compiled model.

Its compiler's defaults, included files and inertias from geoms are therefore MuJoCo's own. What a
free-floating arm does not have (actuators, tendons, contacts, sensors, armature) is left out and
said so.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from spacearm.arrays import LEAST_MASS
from spacearm.description.bodies import Inertial, Joint, Mimic
from spacearm.description.readers.forest import SPLIT_BALL, Forest, freedoms, turns
from spacearm.description.readers.mjcf.geoms import Geoms, pose_of
from spacearm.description.readers.xml import Source
from spacearm.description.tree import Tree
from spacearm.errors import ModelError

if TYPE_CHECKING:
    import mujoco

SAME_INERTIA = 1e-5
"""Share by which rounding may move the compiled inertia from the given one (MuJoCo 3: 1e-6)."""


def read(source: Source) -> Tree:
    """Read an MJCF.

    The root is the body with a free joint. Without one it is the body fixed to the world that
    carries the arm, or the world, without mass, if that body moves.

    Args:
        source: The file, which takes the notes.

    Raises:
        ModelError: mujoco is not installed or refuses the file, or the file holds no robot.
    """
    try:
        import mujoco
    except ImportError:
        source.fail("is an MJCF, which MuJoCo compiles", "pip install 'spacearm[mjcf]'")
    try:
        spec = mujoco.MjSpec.from_file(str(source.path.resolve()))
        if not spec.worldbody.bodies:
            source.fail("has no body", "if it is a part of an MJCF load the file that includes it")
        return _Reader(source, spec).tree()
    except ModelError:
        raise
    except (ValueError, OSError, mujoco.FatalError) as error:
        why = " ".join(str(error).split())
        source.fail(f"is not compiled by MuJoCo ({why})", "correct it there")


class _Reader:
    """One file on its way to a tree."""

    def __init__(self, source: Source, spec: mujoco.MjSpec) -> None:
        self._source = source
        self._spec = spec
        self._couplings = _couplings(source, spec)
        _leave_out(source, spec)
        self._geoms = Geoms(source, spec)
        spec.compiler.discardvisual = False
        spec.compiler.fusestatic = False
        spec.compiler.alignfree = False
        for joint in spec.joints:
            joint.align = 0
        self._model = spec.compile()
        self._given = {body.id: body for body in spec.bodies}
        self._bodies = _names([self._model.body(i).name for i in range(self._model.nbody)], "body")
        self._joints = _names([self._model.joint(i).name for i in range(self._model.njnt)], "joint")
        if self._model.dof_armature.any():
            source.note("armature (the inertia of rotors) is left out: it holds no momentum here")

    def tree(self) -> Tree:
        """Return the tree of the robot."""
        forest, model = Forest(), self._model
        forest.add(self._bodies[0])
        for body in range(1, model.nbody):
            inertial = None if body in self._geoms.unknown else self._inertial(body)
            forest.add(self._bodies[body], inertial, self._geoms.shapes(model, body))
            joints = [i for i in range(model.njnt) if model.jnt_bodyid[i] == body]
            if not joints or self._kind(joints[0]) != "FREE":
                self._join(forest, body, joints)
        sites = [model.site(i).name for i in range(model.nsite)]
        for name, i, body in zip(sites, range(model.nsite), model.site_bodyid, strict=True):
            if body and name and not _draws_axis(name, {*sites, *self._bodies}):
                forest.mark(
                    name, self._bodies[body], pose_of(model.site_pos[i], model.site_quat[i])
                )
        name = self._spec.modelname
        name = self._source.path.stem if name == UNNAMED_MODEL else name
        tree = forest.robot(self._source, name, self._roots(forest))
        return replace(tree, joints={n: self._coupled(j, tree) for n, j in tree.joints.items()})

    def _roots(self, forest: Forest) -> list[str]:
        """Return the free bodies, if one has joints; else the root of what the world carries.

        Of what the world carries that with the most joints counts, or all that have as many.
        """
        world = self._bodies[0]
        free = [root for root in forest.roots() if root != world]
        if any(freedoms(forest.tree("", root)) for root in free):
            return free
        held = [joint for joint in forest.joints.values() if joint.parent == world]
        counts = {j.name: freedoms(forest.tree("", j.child)) + j.movable for j in held}
        most = max(counts.values(), default=0)
        others = [forest.joints.pop(j.name) for j in held if counts[j.name] < most]
        if moving := [joint.child for joint in others if counts[joint.name]]:
            self._source.warn(
                "what has fewer joints than the arm and is not fixed to it is left out: "
                + ", ".join(moving)
            )
        held = [joint for joint in held if joint not in others]
        if len(held) == 1 and not held[0].movable:
            base = held[0].child
            self._source.note(
                f"it has no free joint: its base {base!r} is taken as the spacecraft, which floats "
                "(sa.mount bolts the arm to another)"
            )
            return [base]
        return [world]

    def _inertial(self, body: int) -> Inertial | None:
        model, given = self._model, self._given[body]
        mass = float(model.body_mass[body])
        if mass < LEAST_MASS:
            return None
        pose = pose_of(model.body_ipos[body], model.body_iquat[body])
        inertia = np.diag(model.body_inertia[body])
        xx, yy, zz, xy, xz, yz = given.fullinertia
        full = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        turned = pose.rotation @ inertia @ pose.rotation.T
        if given.explicitinertial and np.allclose(
            full, turned, rtol=0, atol=SAME_INERTIA * inertia.max()
        ):
            pose, inertia = pin.SE3(np.eye(3), pose.translation), full  # without its rounding
        return Inertial(mass, pose, inertia)

    def _join(self, forest: Forest, body: int, joints: list[int]) -> None:
        """Join a body to its parent; MuJoCo's joints turn about points of the body itself."""
        model = self._model
        at = pose_of(model.body_pos[body], model.body_quat[body])
        here = np.zeros(3)
        row: list[Joint] = []
        for i in joints:
            anchor = model.jnt_pos[i] if self._kind(i) != "SLIDE" else here
            step = pin.SE3(np.eye(3), anchor - here)
            row += self._row(i, at * step)
            at, here = pin.SE3.Identity(), anchor
        last = at if not joints else pin.SE3(np.eye(3), -here)
        forest.join(self._bodies[model.body_parentid[body]], self._bodies[body], row, last)

    def _row(self, i: int, origin: pin.SE3) -> list[Joint]:
        """Return a joint, or the hinges that stand for a ball joint."""
        model, name = self._model, self._joints[i]
        if self._kind(i) == "BALL":
            self._source.warn(SPLIT_BALL.format(name=name))
            return turns(name, "xyz", origin)
        slides, limited = self._kind(i) == "SLIDE", bool(model.jnt_limited[i])
        lower, upper = model.jnt_range[i].tolist() if limited else (-math.inf, math.inf)
        effort = np.abs(model.jnt_actfrcrange[i]).min() if model.jnt_actfrclimited[i] else math.inf
        kind = "prismatic" if slides else "revolute" if limited else "continuous"
        resists = (model.dof_damping, model.dof_frictionloss)
        damping, friction = (float(np.ravel(values[model.jnt_dofadr[i]])[0]) for values in resists)
        joint = Joint(
            name, kind, "", "", origin, model.jnt_axis[i].copy(), lower, upper,
            effort=float(effort), damping=damping, friction=friction,
        )  # fmt: skip
        zero = float(model.qpos0[model.jnt_qposadr[i]])
        return [replace(joint, origin=origin * joint.motion(-zero)) if zero else joint]

    def _coupled(self, joint: Joint, tree: Tree) -> Joint:
        """Return a joint, as one that follows another if an equality constraint says so."""
        if joint.name not in self._couplings:
            return joint
        leader, offset, gain = self._couplings[joint.name]
        if leader not in tree.joints:
            return joint
        zero, zero_of_leader = (
            float(self._model.qpos0[self._model.jnt_qposadr[self._joints.index(name)]])
            for name in (joint.name, leader)
        )
        return replace(joint, mimic=Mimic(leader, gain, zero + offset - gain * zero_of_leader))

    def _kind(self, joint: int) -> str:
        """Return "FREE", "BALL", "SLIDE" or "HINGE"."""
        return ("FREE", "BALL", "SLIDE", "HINGE")[self._model.jnt_type[joint]]


def _couplings(source: Source, spec: mujoco.MjSpec) -> dict[str, tuple[str, float, float]]:
    """Return leader, offset and gain of each joint that an active constraint ties to another."""
    import mujoco

    loops = (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
    if ends := [f"{t.name1} to {t.name2 or 'world'}" for t in spec.equalities if t.type in loops]:
        source.warn(f"equalities that close a loop are left out, the loop open: {', '.join(ends)}")
    found: dict[str, tuple[str, float, float]] = {}
    for tie in spec.equalities:
        offset, gain, *rest = tie.data[:5].tolist()
        linear = tie.type == mujoco.mjtEq.mjEQ_JOINT and tie.name2 and not any(rest)
        if linear and tie.active and tie.name1 not in found:
            found[tie.name1] = (tie.name2, offset, gain)
    return found


UNNAMED_MODEL = "MuJoCo Model"
"""What MuJoCo calls a model that has no name."""
AXIS = re.compile(r"(.+)[:_.-][xyz]", re.IGNORECASE)
LEFT_OUT = ("actuators", "tendons", "equalities", "sensors", "skins", "flexes", "plugins")
"""What a free-floating arm does not have; it is named if the file has it."""
UNNAMED = (
    "keys",
    "pairs",
    "excludes",
    "tuples",
    "numerics",
    "texts",
    "textures",
    "hfields",
    "lights",
)
"""What it does not have either, and nobody misses."""


def _leave_out(source: Source, spec: mujoco.MjSpec) -> None:
    """Delete what the arm does not have, and say what of it there was."""
    if found := ", ".join(kind for kind in LEFT_OUT if len(getattr(spec, kind, ()))):
        source.note(
            f"left out, as a free-floating arm has none: {found} (equalities that tie one joint to "
            "another are kept)"
        )
    for geom in spec.geoms:
        if geom.hfieldname:
            spec.delete(geom)
    for kind in (*LEFT_OUT, *UNNAMED):
        for element in list(getattr(spec, kind, ())):
            spec.delete(element)


def _draws_axis(site: str, names: set[str]) -> bool:
    """Whether a site only draws an axis of another one, as "tip:x" and "tip_y" do of "tip"."""
    axis = AXIS.fullmatch(site)
    return axis is not None and axis[1] in names


def _names(given: list[str], kind: str) -> list[str]:
    """Return names, made up where none is given."""
    taken, names = set(given), []
    for i, name in enumerate(given):
        while not name or (name in names):
            name = f"{kind}_{i}"
            i += len(taken)
        names.append(name)
    return names
