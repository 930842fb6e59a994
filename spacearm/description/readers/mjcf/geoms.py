"""MJCF geoms: what MuJoCo draws and collides, as shapes; and a model that compiles without meshes.

Only meshes that give a body its inertia are opened by MuJoCo; the others are read when they are
drawn, and those that are missing do not stop a model from loading.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.description.readers.xml import Source
from spacearm.description.visuals import (
    Box,
    Cylinder,
    Geometry,
    Mesh,
    Shape,
    Sphere,
    Unusable,
    Visuals,
    capsule,
)

if TYPE_CHECKING:
    import mujoco

DRAWN_GROUPS = 3
"""MuJoCo draws the geoms of groups 0, 1 and 2."""
NO_COLOUR = (0.5, 0.5, 0.5, 1.0)
"""Colour of a geom that has none, so that its material's counts."""


class Drawn(NamedTuple):
    """What a geom looks like before it is compiled.

    Attributes:
        geom: The geom.
        mesh: Its mesh; None for a primitive.
        offset: Pose of the mesh in the frame of the geom.
        rgba: Its colour, or that of its material; None if it has none.
    """

    geom: mujoco.MjsGeom
    mesh: Mesh | Unusable | None
    offset: pin.SE3
    rgba: tuple[float, ...] | None


class Geoms:
    """The geoms of a model, which is made fit to be compiled."""

    def __init__(self, source: Source, spec: mujoco.MjSpec) -> None:
        import mujoco

        self._source, self._spec = source, spec
        self._kinds = {int(k): name[7:] for name, k in mujoco.mjtGeom.__members__.items()}
        self._given = {m.name or Path(m.file).stem: m for m in spec.meshes}
        self._folder = source.path.resolve().parent
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
            there = isinstance(mesh, Unusable) or mesh.file is not None
            if there and (weighs or self._kinds[int(geom.type)] not in ("MESH", "SDF")):
                needed.add(geom.meshname)
                continue
            if weighs:
                self._stand_in(body, geom.meshname)
            elif isinstance(mesh, Mesh) and not there:
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

    def _mesh(self, name: str) -> tuple[Mesh | Unusable | None, pin.SE3]:
        """Return a mesh, and its pose in the frame of its geom."""
        if not name:
            return None, pin.SE3.Identity()
        mesh = self._given.get(name)
        if mesh is None or not mesh.file:
            problem = f"{self._source.path}: mesh {name!r} is no file; save it as one to see it"
            return Unusable(problem), pin.SE3.Identity()
        compiler = getattr(mesh, "compiler", self._spec.compiler)  # its own from MuJoCo 4 on
        folder = getattr(compiler, "meshdir", "") or self._spec.meshdir
        path = self._folder / folder / mesh.file
        R = pin.Quaternion(*mesh.refquat).normalized().matrix().T
        scale = mesh.scale
        if not np.allclose(R, np.eye(3)) and np.ptp(scale) > 1e-12:
            problem = (
                f"{self._source.path}: mesh {name!r} is scaled along axes that are not its own"
            )
            return Unusable(f"{problem}; scale its file"), pin.SE3.Identity()
        offset = pin.SE3(R, -scale * (R @ mesh.refpos))
        file = path.resolve() if path.is_file() else None
        shown = os.path.relpath(path, self._folder)
        return Mesh(shown, file, tuple(scale.tolist())), offset

    def shapes(self, model: mujoco.MjModel, body: int) -> Visuals:
        """Return the shapes of a body of the compiled model."""
        visual: list[Shape] = []
        collision: list[Shape] = []
        for drawn in self._drawn:
            i = drawn.geom.id
            if model.geom_bodyid[i] != body:
                continue
            shapes = list(self._shapes(model, i, drawn))
            if model.geom_group[i] < DRAWN_GROUPS:
                visual += shapes
            if model.geom_contype[i] or model.geom_conaffinity[i]:
                collision += shapes
        return Visuals(tuple(visual), tuple(collision))

    def _shapes(self, model: mujoco.MjModel, i: int, drawn: Drawn) -> Iterator[Shape]:
        """Yield the shapes of a compiled geom."""
        pose = pose_of(model.geom_pos[i], model.geom_quat[i])
        kind, size = self._kinds[int(model.geom_type[i])], model.geom_size[i].tolist()
        placeholder = drawn.mesh is not None and not drawn.geom.meshname
        if drawn.mesh is not None and (placeholder or kind in ("MESH", "SDF")):
            if kind in ("MESH", "SDF"):  # compiled meshes are moved to their principal axes
                mesh = model.geom_dataid[i]
                pose = pose * pose_of(model.mesh_pos[mesh], model.mesh_quat[mesh]).inverse()
            yield Shape(pose * drawn.offset, drawn.mesh, drawn.rgba)
            return
        if kind == "CAPSULE":
            yield from capsule(pose, size[0], 2.0 * size[1], drawn.rgba)
        elif geometry := _primitive(kind, size):
            yield Shape(pose, geometry, drawn.rgba)


def _primitive(kind: str, size: list[float]) -> Geometry | None:
    """Return a primitive, an ellipsoid as its box; None for a plane."""
    if kind == "SPHERE":
        return Sphere(size[0])
    if kind == "CYLINDER":
        return Cylinder(size[0], 2.0 * size[1])
    return Box(tuple(2.0 * x for x in size)) if kind in ("BOX", "ELLIPSOID") else None


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
