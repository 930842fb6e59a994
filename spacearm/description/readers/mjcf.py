"""MJCF reader: a model of MuJoCo, compiled by MuJoCo itself and read from the compiled model.

Its compiler's defaults, included files and inertias from geoms are therefore MuJoCo's own. What a
free-floating arm does not have (actuators, tendons, contacts, sensors, armature) is left out and
said so.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin
from lxml import etree

from spacearm.arrays import LEAST_MASS, Array
from spacearm.description import shapes
from spacearm.description.bodies import Inertial, Joint, Mimic
from spacearm.description.readers.forest import Forest, turns
from spacearm.description.readers.mjcf_bounds import check_bounds
from spacearm.description.readers.source import Source, apart
from spacearm.description.srdf import HOME
from spacearm.description.tree import Loop, Tree
from spacearm.errors import ModelError
from spacearm.files import is_there

if TYPE_CHECKING:
    import mujoco

#: What MuJoCo says when it gets no memory.
OUT_OF_MEMORY = ("Could not allocate memory", "bad_alloc", "unknown exception")
#: Stands for a size that MuJoCo chooses by itself.
DEFAULT_SIZE = -1
#: How names of custom numbers begin that are limits of joint rates [rad/s] or [m/s]; the name of
#: the joint follows.
VELOCITY_LIMIT = "velocity_limit/"
#: Share by which rounding may move the compiled inertia from the given one (MuJoCo 3: 1e-6).
SAME_INERTIA = 1e-5


def read(source: Source, root: etree._Element) -> Tree:
    """Read an MJCF; one that is not small in a process of its own, with limits.

    The root is the body with a free joint. Without one it is the body fixed to the world that
    carries the arm, or the world, without mass, if that body moves.

    Args:
        source: The file, which takes the notes.
        root: Its root element.

    Raises:
        ModelError: mujoco is not installed or refuses the file, or the file holds no robot.
    """
    if find_spec("mujoco") is None:
        source.fail("is an MJCF, which MuJoCo compiles", "pip install 'spacearm[mjcf]'")
    return _compiled(source) if check_bounds(source, root) else apart(source, _compiled)


def _compiled(source: Source) -> Tree:
    """Have MuJoCo compile a file, and read the model.

    Raises:
        ModelError: MuJoCo refuses the file, or it holds no robot.
        MemoryError: MuJoCo takes more memory than there is.
    """
    import mujoco

    before, said = mujoco.get_mju_user_warning(), list[str]()
    mujoco.set_mju_user_warning(said.append)  # else it writes MUJOCO_LOG.TXT where the user is
    try:
        spec = mujoco.MjSpec.from_file(str(source.path.resolve()))
        if not spec.worldbody.bodies:
            source.fail("has no body", "if it is a part of an MJCF load the file that includes it")
        tree = _Reader(source, spec).tree()
    except ModelError:
        raise
    except (ValueError, OSError, RuntimeError, mujoco.FatalError) as error:
        why = " ".join(str(error).split())
        if any(text in why for text in OUT_OF_MEMORY):
            raise MemoryError(why) from None
        part = ", or load the file that includes this one" * ("unrecognized element" in why)
        source.fail(f"cannot be compiled by MuJoCo ({why})", f"correct it there{part}")
    finally:
        mujoco.set_mju_user_warning(before)
    for text in said:
        source.warn(f"MuJoCo warns: {' '.join(text.split())}")
    return tree


class _Reader:
    """One file on its way to a tree."""

    def __init__(self, source: Source, spec: mujoco.MjSpec) -> None:
        self._source = source
        self._spec = spec
        self._couplings = _couplings(source, spec)
        self._rates = _rate_limits(source, spec)
        homes = [list(key.qpos) for key in spec.keys if key.name.lower() == HOME]
        _leave_out(source, spec)
        self._geoms = Geoms(source, spec)
        spec.compiler.discardvisual = False
        spec.compiler.fusestatic = False
        spec.compiler.alignfree = False
        spec.memory = spec.njmax = spec.nconmax = DEFAULT_SIZE  # of simulations, which are not run
        for joint in spec.joints:
            joint.align = 0
        self._model = spec.compile()
        self._home = next((q for q in homes if len(q) == self._model.nq), None)
        self._given = {body.id: body for body in spec.bodies}
        self._bodies = _names([self._model.body(i).name for i in range(self._model.nbody)], "body")
        self._joints = _names([self._model.joint(i).name for i in range(self._model.njnt)], "joint")
        if self._model.dof_armature.any():
            source.note("armature (the inertia of rotors) is left out: it holds no momentum here")

    def tree(self) -> Tree:
        """Return the tree of the robot."""
        forest, model = Forest(), self._model
        drawn = self._geoms.of_bodies(model)
        forest.add(self._bodies[0])
        for body in range(1, model.nbody):
            inertial = None if body in self._geoms.unknown else self._inertial(body)
            forest.add(self._bodies[body], inertial, drawn[body])
            first = int(model.body_jntadr[body])
            joints = list(range(first, first + int(model.body_jntnum[body])))
            if not joints or self._kind(joints[0]) != "FREE":
                self._join(forest, body, joints)
        sites = [model.site(i).name for i in range(model.nsite)]
        for name, i, body in zip(sites, range(model.nsite), model.site_bodyid, strict=True):
            if body and name and not _draws_axis(name, {*sites, *self._bodies}):
                place = pose_of(model.site_pos[i], model.site_quat[i])
                forest.mark(name, self._bodies[body], place)
        self._close(forest)
        name = self._spec.modelname
        name = self._source.path.stem if name == UNNAMED_MODEL else name
        anchored = forest.anchored(self._bodies[0])
        tree = forest.robot(self._source, name, self._roots(forest))
        tree = forest.closed(self._source, tree, anchored)
        return replace(tree, joints={n: self._coupled(j, tree) for n, j in tree.joints.items()})

    def _roots(self, forest: Forest) -> list[str]:
        """Return the free bodies, if one has joints; else the root of what the world carries.

        Of what the world carries that with the most joints counts, or all that have as many.
        """
        world = self._bodies[0]
        free = [root for root in forest.roots() if root != world]
        held = [joint for joint in forest.joints.values() if joint.parent == world]
        if any(forest.tree("", root).freedoms for root in free) or (free and not held):
            return free
        counts = {j.name: forest.tree("", j.child).freedoms + j.movable for j in held}
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
        off = np.abs(full - turned).max()
        if given.explicitinertial and off <= SAME_INERTIA * inertia.max():
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
            self._source.balls.append(name)
            return turns(name, "xyz", origin)
        slides, limited = self._kind(i) == "SLIDE", bool(model.jnt_limited[i])
        lower, upper = model.jnt_range[i].tolist() if limited else (-math.inf, math.inf)
        effort = np.abs(model.jnt_actfrcrange[i]).min() if model.jnt_actfrclimited[i] else math.inf
        kind = "prismatic" if slides else "revolute" if limited else "continuous"
        resists = (model.dof_damping, model.dof_frictionloss)
        damping, friction = (float(np.ravel(values[model.jnt_dofadr[i]])[0]) for values in resists)
        joint = Joint(
            name, kind, "", "", origin, model.jnt_axis[i].copy(), lower, upper,
            velocity=self._rates.get(name, math.inf), effort=float(effort), damping=damping,
            friction=friction,
            home=self._home[model.jnt_qposadr[i]] if self._home else 0.0,
        )  # fmt: skip
        zero = float(model.qpos0[model.jnt_qposadr[i]])
        return [replace(joint, origin=origin * joint.motion(-zero)) if zero else joint]

    def _close(self, forest: Forest) -> None:
        """Add the loops that equalities close."""
        import mujoco

        model, seen = self._model, set[tuple[int, ...]]()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        for i in range(model.neq):
            points, given = model.eq_type[i] == mujoco.mjtEq.mjEQ_CONNECT, model.eq_data[i]
            ends = (int(model.eq_obj1id[i]), int(model.eq_obj2id[i]))
            if model.eq_objtype[i] == mujoco.mjtObj.mjOBJ_SITE:
                one, two = (pose_of(model.site_pos[site], model.site_quat[site]) for site in ends)
                ends = (int(model.site_bodyid[ends[0]]), int(model.site_bodyid[ends[1]]))
            elif points:
                one, two = (pin.SE3(np.eye(3), given[k : k + 3].copy()) for k in (0, 3))
            else:
                two = pin.SE3(np.eye(3), given[:3].copy())
                one = pose_of(given[3:6], given[6:10]) * two
            points = points or given[10] == 0.0  # a weld without torque holds points
            a, b = (self._bodies[end] for end in ends)
            name = model.equality(i).name or f"{a} to {b}"
            if tuple(sorted(ends)) in seen:
                self._source.fail(
                    f"two equalities hold {a!r} and {b!r}, of which {name!r} is one",
                    "give one <weld>, or a joint and one <weld>",
                )
            seen.add(tuple(sorted(ends)))
            step = one * two.inverse()
            if points:
                A, B = (data.xmat[end].reshape(3, 3) for end in ends)
                step = pin.SE3(A.T @ B, one.translation - A.T @ B @ two.translation)
            point = one.translation if points else None
            forest.loops.append(Loop(name, a, b, step, point))

    def _coupled(self, joint: Joint, tree: Tree) -> Joint:
        """Return a joint, as one that follows another if an equality constraint says so."""
        if joint.name not in self._couplings:
            return joint
        leader, offset, gain = self._couplings[joint.name]
        if not leader:
            return joint.frozen(self._zero(joint.name) + offset)
        if leader not in tree.joints:
            return joint
        return replace(
            joint,
            mimic=Mimic(leader, gain, self._zero(joint.name) + offset - gain * self._zero(leader)),
        )

    def _zero(self, joint: str) -> float:
        """Return where a joint is in the posture that the file describes [rad] or [m]."""
        return float(self._model.qpos0[self._model.jnt_qposadr[self._joints.index(joint)]])

    def _kind(self, joint: int) -> str:
        """Return "FREE", "BALL", "SLIDE" or "HINGE"."""
        return ("FREE", "BALL", "SLIDE", "HINGE")[self._model.jnt_type[joint]]


def _couplings(source: Source, spec: mujoco.MjSpec) -> dict[str, tuple[str, float, float]]:
    """Return leader, offset and gain of each joint that an active constraint ties to another.

    The leader of one that is held at a value is empty.
    """
    import mujoco

    found: dict[str, tuple[str, float, float]] = {}
    curved: list[str] = []
    for tie in spec.equalities:
        if tie.type != mujoco.mjtEq.mjEQ_JOINT or not tie.active or tie.name1 in found:
            continue
        offset, gain, *rest = tie.data[:5].tolist()
        if any(rest) and tie.name2:
            curved.append(f"{tie.name1} to {tie.name2}")
        else:
            found[tie.name1] = (tie.name2, offset, gain)
    if curved:
        source.warn(
            "equalities that tie joints by curves are left out, and these joints are free: "
            + ", ".join(curved)
        )
    return found


def _rate_limits(source: Source, spec: mujoco.MjSpec) -> dict[str, float]:
    """Return the limits of joint rates, which MJCF itself does not have [rad/s] or [m/s].

    They are those of custom numbers (`VELOCITY_LIMIT`), or else the largest rates that a velocity
    actuator of the joint can be commanded, the smaller one of both directions.

    Raises:
        ModelError: A custom number is no limit.
    """
    limits: dict[str, float] = {}
    for actuator in spec.actuators:
        limit = _commanded_rate(actuator, bool(spec.compiler.autolimits))
        if math.isfinite(limit):
            limits[actuator.target] = min(limit, limits.get(actuator.target, math.inf))
    for number in spec.numerics:
        if number.name.startswith(VELOCITY_LIMIT):
            value = float(number.data[0]) if len(number.data) == 1 else math.nan
            if not value > 0.0:
                source.fail(
                    f"<numeric name={number.name!r}> has data {list(map(float, number.data))}",
                    "give one positive number, the largest rate of the joint [rad/s] or [m/s]",
                )
            limits[number.name.removeprefix(VELOCITY_LIMIT)] = value
    return limits


def _commanded_rate(actuator: mujoco.MjsActuator, autolimits: bool) -> float:
    """Return the largest rate that an actuator can be commanded, infinite if that is no rate.

    A <velocity> actuator applies kv (command - rate), an <intvelocity> one integrates the command.
    """
    import mujoco

    ratio, (low, high) = abs(float(actuator.gear[0])), map(float, actuator.ctrlrange)
    gain, (_, bias, damping) = float(actuator.gainprm[0]), map(float, actuator.biasprm[:3])
    integrates = actuator.dyntype == mujoco.mjtDyn.mjDYN_INTEGRATOR
    regulates = gain > 0.0 and actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE
    to_rate = regulates and (bias == -gain if integrates else (bias, damping) == (0.0, -gain))
    given = mujoco.mjtLimited
    automatic = actuator.ctrllimited == given.mjLIMITED_AUTO and autolimits
    limited = automatic or actuator.ctrllimited == given.mjLIMITED_TRUE
    joint = actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT
    if not (joint and to_rate and limited and ratio > 0.0 and low < 0.0 < high):
        return math.inf
    return min(-low, high) / ratio


#: What MuJoCo calls a model that has no name.
UNNAMED_MODEL = "MuJoCo Model"
AXIS = re.compile(r"(.+)[:_.-][xyz]", re.IGNORECASE)
#: What a free-floating arm does not have; it is named if the file has it.
LEFT_OUT = ("actuators", "tendons", "equalities", "sensors", "skins", "flexes", "plugins")
#: What it does not have either, and nobody misses.
UNNAMED = ("keys", "pairs", "excludes", "tuples", "numerics", "texts", "textures", "hfields",
           "lights")  # fmt: skip


def _leave_out(source: Source, spec: mujoco.MjSpec) -> None:
    """Delete what the arm does not have, and say what of it there was."""
    import mujoco

    if found := ", ".join(kind for kind in LEFT_OUT if len(getattr(spec, kind, ()))):
        source.note(
            f"left out, as a free-floating arm has none: {found} (active equalities that tie one "
            "joint to another, or close a loop, and the rates to which velocity actuators are "
            "limited are kept)"
        )
    for geom in spec.geoms:
        if geom.hfieldname:
            spec.delete(geom)
    closing = (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
    for kind in (*LEFT_OUT, *UNNAMED):
        for element in list(getattr(spec, kind, ())):
            if kind != "equalities" or not (element.active and element.type in closing):
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


#: MuJoCo draws the geoms of groups 0, 1 and 2.
DRAWN_GROUPS = 3
#: Colour of a geom that has none, so that its material's counts.
NO_COLOUR = (0.5, 0.5, 0.5, 1.0)


class Drawn(NamedTuple):
    """What a geom looks like before it is compiled.

    Attributes:
        geom: The geom.
        mesh: Its mesh; None for a primitive.
        offset: Pose of the mesh in the frame of the geom.
        rgba: Its colour, or that of its material; None if it has none.
    """

    geom: mujoco.MjsGeom
    mesh: shapes.Mesh | shapes.Unusable | None
    offset: pin.SE3
    rgba: tuple[float, ...] | None


class Geoms:
    """The geoms of a model, which is made fit to be compiled."""

    def __init__(self, source: Source, spec: mujoco.MjSpec) -> None:
        import mujoco

        self._source, self._spec = source, spec
        self._kinds = {int(k): name[7:] for name, k in mujoco.mjtGeom.__members__.items()}
        self._given = {m.name or Path(m.file).stem: m for m in spec.meshes}
        colours = {m.name: tuple(m.rgba.tolist()) for m in spec.materials}
        self._drawn: list[Drawn] = []
        self._lost: list[mujoco.MjsBody] = []
        needed: set[str] = set()
        missing: list[str] = []
        for body, geom in [(owner, geom) for owner in spec.bodies for geom in owner.geoms]:
            rgba = tuple(np.round(geom.rgba, 6).tolist())
            mesh, offset = self._mesh(geom.meshname)
            colour = colours.get(geom.material) if rgba == NO_COLOUR else rgba
            self._drawn.append(Drawn(geom, mesh, offset, colour))
            geom.material = ""
            if mesh is None:
                continue
            weighs = _weighs(body, geom, getattr(body, "compiler", spec.compiler))
            there = isinstance(mesh, shapes.Unusable) or mesh.file is not None
            fitted = self._kinds[int(geom.type)] not in ("MESH", "SDF")  # a primitive to its mesh
            if there and (weighs or fitted):
                needed.add(geom.meshname)
                continue
            if weighs:
                self._stand_in(body, geom.meshname)
            elif isinstance(mesh, shapes.Mesh) and not there:
                missing.append(mesh.name)
            geom.meshname, geom.type, geom.mass = "", mujoco.mjtGeom.mjGEOM_SPHERE, 0.0
            geom.size[:] = 1.0
        if self._lost:
            self._keep_given_inertias(spec)
        for site in spec.sites:
            site.material = ""
        for material in list(spec.materials):
            spec.delete(material)
        for name, mesh in self._given.items():
            if name not in needed:
                spec.delete(mesh)
        source.warn_of_missing_meshes(missing)

    @property
    def unknown(self) -> set[int]:
        """Numbers of the bodies whose inertia is that of a missing mesh, once compiled."""
        return {body.id for body in self._lost}

    def _stand_in(self, body: mujoco.MjsBody, mesh: str) -> None:
        """Give a body whose mesh is missing an inertia to be compiled with, and say so."""
        self._source.warn(
            f"the inertia of body {body.name!r} is that of its meshes, and {mesh!r} is missing: it "
            "is left out; give the body an <inertial>"
        )
        body.explicitinertial, body.mass = True, 1.0
        body.inertia[:] = 1.0
        body.fullinertia[0] = np.nan
        self._lost.append(body)

    def _keep_given_inertias(self, spec: mujoco.MjSpec) -> None:
        """Let bodies have the inertia given to them, the others that of their geoms, as before."""
        import mujoco

        ways = mujoco.mjtInertiaFromGeom
        if spec.compiler.inertiafromgeom == ways.mjINERTIAFROMGEOM_TRUE:
            for body in spec.bodies:
                body.explicitinertial = body in self._lost
            spec.compiler.inertiafromgeom = ways.mjINERTIAFROMGEOM_AUTO

    def _mesh(self, name: str) -> tuple[shapes.Mesh | shapes.Unusable | None, pin.SE3]:
        """Return a mesh, and its pose in the frame of its geom."""
        here = pin.SE3.Identity()
        if not name:
            return None, here
        mesh, path = self._given.get(name), self._source.path
        if mesh is None or not mesh.file:
            problem = f"{path}: mesh {name!r} is not a file; save it as one to see it"
            return shapes.Unusable(problem), here
        R = pin.Quaternion(*mesh.refquat).normalized().matrix().T
        scale = mesh.scale
        if not np.allclose(R, np.eye(3)) and np.ptp(scale) > 1e-12:
            problem = f"{path}: mesh {name!r} is scaled along axes that are not its own"
            return shapes.Unusable(f"{problem}; scale its file"), here
        compiler = getattr(mesh, "compiler", self._spec.compiler)  # its own from MuJoCo 4 on
        folder = path.resolve().parent
        file = folder / (getattr(compiler, "meshdir", "") or self._spec.meshdir) / mesh.file
        found = file.resolve() if is_there(file) and file.is_file() else None
        scaled = shapes.Mesh(os.path.relpath(file, folder), found, tuple(scale.tolist()))
        return scaled, pin.SE3(R, -scale * (R @ mesh.refpos))

    def of_bodies(self, model: mujoco.MjModel) -> list[shapes.Visuals]:
        """Return the shapes of each body of the compiled model."""
        found = [shapes.Visuals()] * model.nbody
        for drawn in self._drawn:
            i = drawn.geom.id
            body, own = model.geom_bodyid[i], self._shapes(model, i, drawn)
            visual = own if model.geom_group[i] < DRAWN_GROUPS else ()
            collision = own if model.geom_contype[i] or model.geom_conaffinity[i] else ()
            before = found[body]
            found[body] = shapes.Visuals(before.visual + visual, before.collision + collision)
        return found

    def _shapes(self, model: mujoco.MjModel, i: int, drawn: Drawn) -> tuple[shapes.Shape, ...]:
        """Return the shapes of a compiled geom; none of a plane."""
        pose = pose_of(model.geom_pos[i], model.geom_quat[i])
        kind, size = self._kinds[int(model.geom_type[i])], model.geom_size[i]
        if kind in ("MESH", "SDF"):  # compiled meshes are moved to their principal axes
            mesh = model.geom_dataid[i]
            pose = pose * pose_of(model.mesh_pos[mesh], model.mesh_quat[mesh]).inverse()
        if drawn.mesh is not None and (kind in ("MESH", "SDF") or not drawn.geom.meshname):
            return (shapes.Shape(pose * drawn.offset, drawn.mesh, drawn.rgba),)
        if kind not in ("BOX", "SPHERE", "CYLINDER", "CAPSULE", "ELLIPSOID"):
            return ()
        numbers = {"size": 2.0 * size, "radii": size, "radius": size[:1], "length": 2.0 * size[1:2]}
        return shapes.primitive(kind.lower(), lambda name, _: numbers[name], pose, drawn.rgba)


def _weighs(body: mujoco.MjsBody, geom: mujoco.MjsGeom, compiler: mujoco.MjsCompiler) -> bool:
    """Whether the inertia of its body comes from this geom."""
    import mujoco

    how, ways = compiler.inertiafromgeom, mujoco.mjtInertiaFromGeom
    if body.name == "world" or how == ways.mjINERTIAFROMGEOM_FALSE or geom.mass == 0.0:
        return False
    if body.explicitinertial and how != ways.mjINERTIAFROMGEOM_TRUE:
        return False
    low, high = compiler.inertiagrouprange
    return bool(low <= geom.group <= high) and not (np.isnan(geom.mass) and geom.density == 0.0)


def pose_of(xyz: Array, wxyz: Array) -> pin.SE3:
    """Return the pose of a position and a quaternion as MuJoCo writes it."""
    turn = pin.Quaternion(*(float(x) for x in wxyz)).normalized()
    return pin.SE3(turn.matrix(), np.array(xyz, dtype=np.float64))
