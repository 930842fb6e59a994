"""Shapes: what is drawn of a link and what others may collide with; mesh files, read safely."""

from __future__ import annotations

import io
import logging
import re
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache, partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
import scipy

from spacearm.arrays import LARGEST, Array, Integers
from spacearm.description import gltf, mesh_files
from spacearm.description.mesh_files import (
    PER_BYTE,
    PER_TRIANGLE,
    UnboundedError,
    binary_triangles,
    obj_vertices,
    require,
    require_few,
    stl_corners,
    text_of,
)
from spacearm.errors import ModelError, listed, warn
from spacearm.files import lies_in, named_files, read
from spacearm.processes import VARIABLE, WorkerError, call_within, memory_limit

if TYPE_CHECKING:
    import trimesh


class Box(NamedTuple):
    """A box about the origin.

    Attributes:
        size: Edges along x, y, z [m].
    """

    size: tuple[float, ...]


class Sphere(NamedTuple):
    """A sphere about the origin.

    Attributes:
        radius: Radius [m].
    """

    radius: float


class Cylinder(NamedTuple):
    """A cylinder about the origin, its axis along z.

    Attributes:
        radius: Radius [m].
        length: Length [m].
    """

    radius: float
    length: float


class Mesh(NamedTuple):
    """A mesh file.

    Attributes:
        name: Name that the description gives it.
        file: The file, by its absolute path; None if it was not found.
        scale: Factors along x, y, z.
        turned: Whether its pose counts the up axis that the file states; see `Shape.upright`.
    """

    name: str
    file: Path | None
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    turned: bool = False


class Unusable(NamedTuple):
    """A geometry that cannot be used.

    Attributes:
        problem: File, element, value and remedy, in one sentence.
    """

    problem: str


Geometry: TypeAlias = Box | Sphere | Cylinder | Mesh | Unusable


def _scaled(geometry: Geometry, factor: float) -> Geometry:
    """Return a geometry enlarged by a factor."""
    match geometry:
        case Box(size):
            return Box(tuple(factor * x for x in size))
        case Sphere(radius):
            return Sphere(factor * radius)
        case Cylinder(radius, length):
            return Cylinder(factor * radius, factor * length)
        case Mesh():
            return geometry._replace(scale=tuple(factor * x for x in geometry.scale))
        case _:
            return geometry


#: Angles of the points on round shapes [rad].
TURN = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
#: Corners of the cube from 0 to 1.
CORNERS = np.indices((2, 2, 2)).reshape(3, -1).T


class Shape(NamedTuple):
    """A geometry fixed to a link.

    Attributes:
        pose: Pose of the geometry in the link frame.
        geometry: The geometry.
        rgba: Red, green, blue and opacity, from 0 to 1; None if no colour is given.
    """

    pose: pin.SE3
    geometry: Geometry
    rgba: tuple[float, ...] | None = None

    def scaled(self, factor: float) -> Shape:
        """Return the shape enlarged by a factor about the origin of the link."""
        pose = pin.SE3(self.pose.rotation, factor * self.pose.translation)
        return self._replace(pose=pose, geometry=_scaled(self.geometry, factor))

    def upright(self) -> Shape:
        """Return the shape, its mesh turned so that the up axis of its COLLADA file is z.

        The scale of the mesh is along the axes of the turned one. A mesh is turned once.
        """
        match self.geometry:
            case Mesh(name, Path() as file, scale, False) if (axis := up_axis(file)) in UPRIGHT:
                R = UPRIGHT[axis]
                geometry = Mesh(name, file, tuple((np.abs(R.T) @ scale).tolist()), turned=True)
                return self._replace(pose=self.pose * pin.SE3(R, np.zeros(3)), geometry=geometry)
        return self

    def reach(self) -> float:
        """Return how far the shape reaches from the origin of the link [m].

        Zero for meshes that cannot be read.
        """
        with np.errstate(over="ignore", invalid="ignore"):  # of sizes that are checked in use
            match self.geometry:
                case Mesh(_, Path() as file, scale) if (ends := mesh_bounds(file)) is not None:
                    local = ends[CORNERS, range(3)] * scale
                    points = local @ self.pose.rotation.T + self.pose.translation
                case Mesh():
                    return 0.0
                case _:
                    points = self.points()
            return float(np.nan_to_num(np.linalg.norm(points, axis=1)).max(initial=0.0))

    def points(self) -> Array:
        """Return points (m, 3) in the link frame whose convex hull is the shape's [m].

        Round shapes have points on their surface, every `TURN`. A geometry that cannot be used, or
        whose mesh file was not found, has none.

        Raises:
            ModelError: The mesh file cannot be read.
        """
        match self.geometry:
            case Box(size):
                local = (CORNERS - 0.5) * np.asarray(size)
            case Sphere(radius):
                polar, turn = (x.ravel() for x in np.meshgrid(TURN[: len(TURN) // 2 + 1], TURN))
                rim = np.sin(polar) * np.array((np.cos(turn), np.sin(turn)))
                local = radius * np.column_stack((*rim, np.cos(polar)))
            case Cylinder(radius, length):
                rim = radius * np.column_stack((np.cos(TURN), np.sin(TURN), 0.0 * TURN))
                up = np.array([0.0, 0.0, length / 2.0])
                local = np.vstack((rim - up, rim + up))
            case Mesh(_, Path() as file, scale):
                local = np.asarray(read_mesh(file).vertices) * scale
            case _:
                local = np.zeros((0, 3))
        return local @ self.pose.rotation.T + self.pose.translation

    def triangles(self) -> Array:
        """Return the triangles (m, 3, 3) that are drawn of the shape, link frame [m].

        They turn counterclockwise, seen from outside. Meshes of many are without small details.

        Warns:
            ModelWarning: The mesh file cannot be read; there are none.
        """
        try:
            if not isinstance(self.geometry, Mesh) or self.geometry.file is None:
                points = self.points()
                return faces(points) if len(points) else np.zeros((0, 3, 3))
            mesh = scaled_mesh(self.geometry.file, self.geometry.scale)
        except ModelError as error:
            warn(f"{error}: not drawn")
            return np.zeros((0, 3, 3))
        size, coarse = float(np.ptp(mesh.bounds, axis=0).max()), mesh
        for cells in CELLS:
            if len(coarse.faces) > MANY_TRIANGLES:
                coarse = coarsened(mesh, size / cells)
        return np.array(coarse.triangles) @ self.pose.rotation.T + self.pose.translation


class Visuals(NamedTuple):
    """The shapes of one link.

    Attributes:
        visual: The shapes that are drawn.
        collision: The shapes that stand for the link in collision checks.
        stands_in: Whether the visuals only stand for a body of unknown shape.
    """

    visual: tuple[Shape, ...] = ()
    collision: tuple[Shape, ...] = ()
    stands_in: bool = False

    @property
    def drawn(self) -> tuple[Shape, ...]:
        """Its visuals; where there are none, what stands for the link in collision checks."""
        return self.visual or self.collision

    def upright(self) -> Visuals:
        """Return the shapes, each turned by `Shape.upright`."""
        visual, collision = (tuple(map(Shape.upright, own)) for own in self[:2])
        return self._replace(visual=visual, collision=collision)

    def scaled(self, factor: float) -> Visuals:
        """Return the shapes enlarged by a factor about the origin of the link."""
        return self._replace(
            visual=tuple(shape.scaled(factor) for shape in self.visual),
            collision=tuple(shape.scaled(factor) for shape in self.collision),
        )


def capsule(
    pose: pin.SE3, radius: float, length: float, rgba: tuple[float, ...] | None = None
) -> tuple[Shape, ...]:
    """Return a capsule about the origin of a pose, along z, as a cylinder and two spheres.

    Args:
        pose: Its pose in the link frame.
        radius: Radius [m].
        length: Length of the cylinder between the half spheres [m].
        rgba: The colour.
    """
    ends = [pin.SE3(np.eye(3), np.array([0.0, 0.0, z])) for z in (-length / 2.0, length / 2.0)]
    spheres = (Shape(pose * end, Sphere(radius), rgba) for end in ends)
    return (Shape(pose, Cylinder(radius, length), rgba), *spheres)


def primitive(
    kind: str, numbers: Callable[[str, int], Array], pose: pin.SE3, rgba: tuple[float, ...] | None
) -> tuple[Shape, ...]:
    """Return a box, sphere, cylinder or capsule, or an ellipsoid as its box, at a pose.

    Args:
        kind: One of these words.
        numbers: Returns so many numbers of its element by name.
        pose: Its pose in the link frame.
        rgba: The colour.
    """
    geometry: Geometry
    match kind:
        case "box":
            geometry = Box(tuple(numbers("size", 3).tolist()))
        case "ellipsoid":
            geometry = Box(tuple((2.0 * numbers("radii", 3)).tolist()))
        case "sphere":
            geometry = Sphere(numbers("radius", 1).item())
        case _:
            geometry = Cylinder(numbers("radius", 1).item(), numbers("length", 1).item())
            if kind == "capsule":
                return capsule(pose, *geometry, rgba)
    return (Shape(pose, geometry, rgba),)


def faces(points: Array) -> Array:
    """Return the triangles (m, 3, 3) of the convex hull of points, counterclockwise from outside.

    Points (m, 3) in a plane have a hull too.
    """
    hull = scipy.spatial.ConvexHull(points, qhull_options="QJ")
    found: Array = points[hull.simplices]
    normals = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
    inward = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0.0
    found[inward] = found[inward, ::-1]
    return found


#: Triangles of a mesh beyond which it is drawn without its smallest details.
MANY_TRIANGLES = 800
#: How many times as large as these details it is, in turn until it has no more triangles.
CELLS = (64, 45, 32, 23, 16, 11, 8)
#: Number of triangles that a mesh keeps at least, if it has them.
FEWEST = 100
FORMATS = (".stl", ".obj", ".dae", ".ply", ".glb", ".gltf")
#: Largest size of a mesh file [bytes].
LARGEST_MESH = 10**8
#: Time that reading a mesh in a process of its own may take [s].
SECONDS = 60.0
#: Levels of folders above a mesh that may be its package.
LEVELS = 5
#: Turns the up axis of a mesh to z, and right, as COLLADA has it, to x.
UPRIGHT = {
    "X_UP": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "Y_UP": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}


def mesh_bounds(path: Path) -> Array | None:
    """Return the least and the largest coordinates (2, 3) of a mesh file [m]; None if unreadable.

    They are as `read_mesh` reads them; of STL and OBJ files, which are fast to scan, those of all
    vertices.
    """
    try:
        return _bounds(path, path.stat().st_mtime_ns)
    except (OSError, ValueError, ModelError):
        return None


@lru_cache(maxsize=1024)
def _bounds(path: Path, _: int) -> Array | None:
    """Return the bounds of a mesh file, kept until it changes."""
    match path.suffix.lower():
        case ".stl":
            solids = stl_corners(_content(path))
            vertices = np.concatenate([np.zeros((0, 3)), *solids])
        case ".obj":
            vertices = obj_vertices(_content(path))
        case _:
            return np.array(read_mesh(path).bounds)
    return np.stack((vertices.min(axis=0), vertices.max(axis=0))) if len(vertices) else None


#: Marks in written files a mesh that is `turned`; other readers pass over it.
TURNED = "{urn:spacearm}turned"
#: The up axis that a COLLADA file states, in its head.
UP_AXIS = re.compile(rb"<(?:\w+:)?up_axis>\s*([XYZ]_UP)")


def up_axis(path: Path) -> str | None:
    """Return the up axis that a COLLADA file states, as "Y_UP"; None where there is none."""
    if path.suffix.lower() != ".dae":
        return None
    try:
        stated = UP_AXIS.search(read(path, LARGEST_MESH).partition(b"</asset>")[0])
    except (OSError, ValueError):
        return None
    return stated[1].decode() if stated else None


def lying(solids: Iterable[Visuals], *, turned: bool = False) -> list[str]:
    """Return the meshes whose files state an up axis other than z, turned by it or not."""
    all_shapes = (shape.geometry for own in solids for shape in (*own.visual, *own.collision))
    meshes = (mesh for mesh in all_shapes if isinstance(mesh, Mesh) and mesh.turned == turned)
    files = {(mesh.name, mesh.file) for mesh in meshes if mesh.file}
    stated = {f"{name!r} ({axis})": axis for name, file in files if (axis := up_axis(file))}
    return sorted(text for text, axis in stated.items() if axis in UPRIGHT)


def ignored_axes(solids: Iterable[Visuals]) -> str:
    """Say which meshes state an up axis that is ignored, and how it counts; empty for none."""
    if not (names := lying(solids)):
        return ""
    return (
        f"the up axes of meshes are ignored, as in RViz and Gazebo: {listed(names)}; "
        "up_axes=True turns these meshes by them, the pose of a mesh this one alone"
    )


def read_mesh(path: Path) -> trimesh.Trimesh:
    """Read the triangles of a mesh file in metres, without textures.

    The unit that a COLLADA file states is applied. Its up axis is not, unless by `Shape.upright`:
    a robot file places a mesh by the axes of its coordinates, as RViz and Gazebo show it. The y
    axis of glTF (and GLB), which is up in all files of this format, becomes z, as in RViz and
    Drake.

    Nothing that the file names is opened but the buffers of a glTF file; see `_buffers`.

    Raises:
        ModelError: The format is not one of `FORMATS`, or the file is too large, broken, without
            triangles or has coordinates that are not finite.
    """
    try:
        return _mesh(path)
    except Exception as error:  # whatever a reader makes of a broken file
        raise ModelError(f"mesh {path.name!r} cannot be read ({error})") from None


def scaled_mesh(path: Path, scale: tuple[float, ...]) -> trimesh.Trimesh:
    """Read a mesh file, enlarged by factors along x, y, z, as `read_mesh`.

    Its triangles turn counterclockwise, seen from outside, those of a mirrored one too.
    """
    mesh = read_mesh(path)
    mesh.vertices = np.asarray(mesh.vertices) * scale
    if np.prod(scale) < 0.0:
        mesh.invert()
    return mesh


@contextmanager
def _silent(name: str) -> Iterator[None]:
    """Silence the log of a library: faults of a file are reported by this module."""
    logger = logging.getLogger(name)
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)


def _mesh(path: Path) -> trimesh.Trimesh:
    """Read a mesh file here if its memory is bounded, else in a process with a limit."""
    import trimesh  # slow to import

    memory = memory_limit()
    try:
        vertices, faces = _arrays(path, memory)
    except UnboundedError:
        try:
            vertices, faces = call_within(SECONDS, memory, partial(_arrays, path, np.inf))
        except WorkerError as error:
            raise ValueError(
                f"it is not read in {SECONDS:g} s and {memory / 1e9:g} GB of memory: {error}; "
                f"reduce its triangles, or set the environment variable {VARIABLE} to more GB"
            ) from None
    return trimesh.Trimesh(vertices, faces, process=False)


def _arrays(path: Path, memory: float) -> tuple[Array, Integers]:
    """Return the vertices (n, 3) and faces (m, 3) of a mesh file.

    Args:
        path: The file.
        memory: Memory that reading it may take [bytes].

    Raises:
        UnboundedError: It may take more; nothing large has been allocated.
        ValueError: The file is faulty; its reader raises other errors too.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f"give one of {', '.join(FORMATS)}")
    content = _content(path)
    if zipfile.is_zipfile(io.BytesIO(content)):
        raise ValueError("it is an archive: unpack it")
    with _silent("trimesh"), np.errstate(all="ignore"):  # what overflows is found below
        if suffix in (".glb", ".gltf"):
            vertices, faces = _gltf(path, content, memory)
        else:
            vertices, faces = mesh_files.triangles_of(suffix, content, memory)
    if not (np.abs(vertices) <= LARGEST).all():
        raise ValueError(f"it has coordinates that are not finite or beyond {LARGEST:g}")
    return vertices, faces


def _gltf(path: Path, content: bytes, memory: float) -> tuple[Array, Integers]:
    """Return the vertices and faces of a glTF or GLB file, z up."""
    require(PER_BYTE * gltf.text_size(content), memory)
    document, binary = gltf.chunks(content)
    files = _buffers(path, document) if path.suffix.lower() == ".gltf" else {}
    scene = gltf.scene_of(document, binary, files)
    require_few(scene.triangles)
    require(PER_TRIANGLE * (scene.triangles + scene.vertices), memory)
    vertices, faces = gltf.triangles_of(scene)
    return vertices @ UPRIGHT["Y_UP"].T, faces


def _content(path: Path) -> bytes:
    """Return the content of a mesh file, a text in UTF-8 without a byte-order mark."""
    content = read(path, LARGEST_MESH)
    binary = path.suffix.lower() == ".stl" and binary_triangles(content) > 0
    return content if binary else text_of(content)


def _buffers(path: Path, document: dict[str, Any]) -> dict[str, bytes]:
    """Return the files of numbers that a glTF file names, by these names.

    They must lie in the folder of the mesh or in its package, links followed. If the mesh is a
    link, both its own folder and that of its target count. Nothing else that the mesh names, such
    as pictures, can be read by its reader, which gets these files alone.

    Raises:
        ValueError: A buffer is missing, or lies elsewhere.
    """
    found, left = dict[str, bytes](), LARGEST_MESH
    places: list[Path] = []
    for mesh in dict.fromkeys((path, path.resolve())):  # a link to a mesh, and the mesh itself
        above = islice(mesh.parents, LEVELS)
        package = (folder for folder in above if (folder / "package.xml").is_file())
        places += [mesh.parent, *islice(package, 1)]
    for name in {str(buffer.get("uri", "data:")) for buffer in document.get("buffers", [])}:
        if name.startswith("data:"):
            continue
        named = named_files(name, [path.parent], lambda file: lies_in(file, places))
        if named.refused:
            raise ValueError(f"its buffer {name!r} is {named.refused[0]}; move it beside the mesh")
        if not named.found:
            raise ValueError(f"its buffer {name!r} is not found; put it beside the mesh")
        found[name] = read(named.found[0], left)
        left -= len(found[name])
    return found


def coarsened(mesh: trimesh.Trimesh, cell: float) -> trimesh.Trimesh:
    """Return a mesh without detail below the size of a cell, in the unit of its vertices.

    Vertices of one cell become one; so do triangles that then have the same corners. A mesh that
    little would be left of stays as it is.
    """
    coarse: trimesh.Trimesh = mesh.copy()
    coarse.vertices = coarse.vertices / cell
    coarse.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=0)
    coarse.update_faces(coarse.nondegenerate_faces() & coarse.unique_faces())
    coarse.remove_unreferenced_vertices()
    if len(coarse.faces) < FEWEST:
        return mesh
    coarse.vertices = coarse.vertices * cell
    return coarse
