"""STL, OBJ, PLY and COLLADA files: the triangles that they place, without textures.

STL files are read here, the others by the loaders of trimesh, which get what gives triangles alone.
What a file asks for is counted before any array is made. Time and memory are linear in the size of
the file and in what it places: the parts of a file become arrays at once and never nodes of a scene
graph, which takes milliseconds for each.
"""

from __future__ import annotations

import io
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from lxml import etree

from spacearm.arrays import LARGEST, Array, Integers
from spacearm.files import marked_encoding

#: Largest number of triangles of a mesh: a file may place one part any number of times.
MOST_TRIANGLES = 2 * 10**6
#: Upper bounds of the memory for reading a mesh: for each byte of a text or of JSON, and for each
#: triangle or vertex of a binary file [bytes].
PER_BYTE, PER_TRIANGLE = 120, 500
#: The first of these for a PLY file, of which each line of a text becomes an array.
PER_BYTE_OF_PLY = 250
#: Largest number of properties that a PLY file states.
MOST_PROPERTIES = 1_000
#: Begins a PLY file that is a text; characters at which its lines end, beside the usual one.
PLY_TEXT, LINE_ENDS = re.compile(rb"ply\s+format\s+ascii\b"), b"\r\v\f\x1c\x1d\x1e"
#: Bytes of a binary STL: before its triangles, and for each of them.
STL_HEAD, STL_TRIANGLE = 84, 50
#: Upper bound of the memory for reading the text of an STL, for each of its bytes: the most is that
#: of solids of one triangle each, of which each becomes arrays of its own [bytes].
STL_PER_BYTE = 30
#: A triangle of a binary STL.
STL_FIELDS = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
#: The begin or the end of a solid with its name, or a vertex, in the text of an STL. A name ends
#: with its line, or before "facet".
STL_WORDS = re.compile(
    rb"(?<!\S)(?:(?:end)?solid\b(?:(?!\bfacet\b)[^\r\n])*|vertex\s+(\S+)\s+(\S+)\s+(\S+))",
    re.IGNORECASE,
)
#: A vertex in the text of an OBJ file.
OBJ_VERTEX = re.compile(rb"^[ \t]*v[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", re.MULTILINE)
#: What names a material in an OBJ file: its triangles are read apart from the others.
OBJ_MATERIAL = re.compile(r"usemtl[^\n]*")
#: Elements of a COLLADA file that give no triangles.
COLLADA_LEFT_OUT = (
    "{*}library_animation_clips",
    "{*}library_animations",
    "{*}library_cameras",
    "{*}library_controllers",
    "{*}library_effects",
    "{*}library_force_fields",
    "{*}library_images",
    "{*}library_lights",
    "{*}library_materials",
    "{*}library_physics_materials",
    "{*}library_physics_models",
    "{*}library_physics_scenes",
    "{*}bind_material",
    "{*}extra",
)
#: Says that a COLLADA file has nodes without end.
TOO_DEEP = "its nodes are nested too deeply, or place one another in a circle; export it again"
#: Largest numbers of nodes of a COLLADA scene, and of parts of meshes that it places.
MOST_NODES, MOST_PARTS = 10_000, 50_000


class UnboundedError(Exception):
    """Reading a mesh file may take more memory than it may take here."""


def require(need: float, memory: float) -> None:
    """Refuse to read a mesh that may take more memory than it may [bytes]."""
    if need > memory:
        raise UnboundedError


def require_few(triangles: int) -> None:
    """Refuse a mesh without triangles, and one of too many."""
    if not 0 < triangles <= MOST_TRIANGLES:
        raise ValueError(f"it has {triangles:,} triangles; give 1 to {MOST_TRIANGLES:,}")


def triangles_of(suffix: str, content: bytes, memory: float) -> tuple[Array, Integers]:
    """Return the vertices (n, 3) and faces (m, 3) of what a file places [m].

    Vertices of a part that are at one place become one.

    Args:
        suffix: The kind of the file: ".stl", ".obj", ".ply" or ".dae".
        content: Its bytes.
        memory: Memory that reading it may take [bytes].

    Raises:
        UnboundedError: It may take more; nothing large has been allocated.
        ValueError: The file is faulty; its reader raises other errors too.
    """
    match suffix:
        case ".stl":
            triangles = binary_triangles(content)
            if triangles:
                require_few(triangles)
            require(PER_TRIANGLE * triangles or STL_PER_BYTE * len(content), memory)
            parts = [(corners, _numbered(len(corners))) for corners in stl_corners(content)]
        case ".dae":
            parts = list(_collada(content, memory))
        case ".ply":
            require(PER_BYTE_OF_PLY * len(content), memory)
            parts = list(_parts(_ply(content)))
        case _:
            require(PER_BYTE * len(content), memory)
            parts = list(_parts(_obj(content)))
    require_few(sum(len(faces) for _, faces in parts))
    return _joined(parts)


def _numbered(corners: int) -> Integers:
    """Return the faces (m, 3) of corners that are three of each triangle in turn."""
    return np.arange(corners).reshape(-1, 3)


def _joined(parts: Sequence[tuple[Array, Integers]]) -> tuple[Array, Integers]:
    """Return the vertices and faces of parts as those of one mesh.

    Vertices of a part that are at one place become one; those of no triangle are left out.
    """
    vertices = np.concatenate([points for points, _ in parts])
    sizes = np.array([len(points) for points, _ in parts])
    firsts = np.cumsum(sizes) - sizes
    faces = np.concatenate([own + n for (_, own), n in zip(parts, firsts, strict=True)])
    part = np.repeat(np.arange(len(parts)), sizes)
    order = np.lexsort((*vertices.T, part))
    places = vertices[order]
    begins = np.ones(len(order), dtype=bool)
    begins[1:] = (places[1:] != places[:-1]).any(axis=1) | (np.diff(part[order]) != 0)
    first_there = np.empty(len(order), dtype=np.int64)
    first_there[order] = order[begins][np.cumsum(begins) - 1]
    kept, corners = np.unique(first_there[faces], return_inverse=True)
    return vertices[kept], corners.reshape(-1, 3)


def text_of(content: bytes) -> bytes:
    """Return the text of a mesh file as UTF-8, without the byte-order mark that states another."""
    encoding = marked_encoding(content)
    return content.decode(encoding).encode() if encoding else content


# --- STL ----------------------------------------------------------------------------------------


def binary_triangles(stl: bytes) -> int:
    """Return the number of triangles of a binary STL; 0 for a text or a damaged file.

    Some tools write further bytes after the triangles. The characters of a text, taken as this
    number, stand for more triangles than any mesh file has bytes for, but for those of UTF-32.
    """
    count = int.from_bytes(stl[80:STL_HEAD], "little")
    size = STL_HEAD + STL_TRIANGLE * count
    is_binary = len(stl) == size or (len(stl) > size and not marked_encoding(stl))
    return count if is_binary else 0


def stl_corners(stl: bytes) -> list[Array]:
    """Return the corners (3 m, 3) of the triangles of an STL, for each of its solids.

    Raises:
        ValueError: It is faulty.
    """
    if count := binary_triangles(stl):
        triangles = np.frombuffer(stl, STL_FIELDS, count, STL_HEAD)
        return [triangles["corners"].reshape(-1, 3).astype(np.float64)]
    if b"\0" in stl:
        stated = int.from_bytes(stl[80:STL_HEAD], "little")
        raise ValueError(
            f"it states {stated:,} triangles, which take {STL_HEAD + STL_TRIANGLE * stated:,} "
            f"bytes, and has {len(stl):,} bytes; export it again"
        )
    numbers = array("d")
    ends = [0]
    for word in STL_WORDS.finditer(stl):
        if word[1] is None:
            ends.append(len(numbers))
        else:
            numbers.extend(map(float, word.groups()))
    corners = np.array(numbers).reshape(-1, 3)
    bounds = np.unique([*ends, len(numbers)]) // 3
    solids = [corners[begin:end] for begin, end in pairwise(bounds)]
    for solid in solids:
        if len(solid) % 3:
            raise ValueError(
                f"it has a solid of {len(solid):,} vertices, which do not make triangles; "
                "export it again"
            )
    return solids


# --- OBJ and PLY --------------------------------------------------------------------------------


def obj_vertices(obj: bytes) -> Array:
    """Return all vertices (n, 3) of an OBJ file, those of no triangle included."""
    words = (word for found in OBJ_VERTEX.finditer(obj) for word in found.groups())
    return np.fromiter(map(float, words), dtype=np.float64).reshape(-1, 3)


def _obj(content: bytes) -> Mapping[str, Any]:
    """Return the parts of an OBJ file as trimesh gives them.

    Lines that a backslash continues are joined. No other backslash is left: trimesh joins lines
    too, and would make names of materials of what is none here.
    """
    from trimesh.exchange.obj import load_obj

    lines = content.decode(errors="replace").replace("\r\n", "\n").replace("\\\n", "")
    lines = lines.replace("\\", " ")
    return load_obj(io.StringIO(OBJ_MATERIAL.sub("", lines)), skip_materials=True)


def _ply(content: bytes) -> Mapping[str, Any]:
    """Return the parts of a PLY file as trimesh gives them.

    Empty lines of a text, which trimesh takes for elements, are left out.

    Raises:
        ValueError: It states more properties than are read.
    """
    from trimesh.exchange.ply import load_ply

    if content.partition(b"end_header")[0].count(b"property") > MOST_PROPERTIES:
        raise ValueError(f"it states more than {MOST_PROPERTIES:,} properties; leave some out")
    if PLY_TEXT.match(content):
        lines = content.translate(bytes.maketrans(LINE_ENDS, b"\n" * len(LINE_ENDS))).split(b"\n")
        content = b"\n".join(line for line in lines if line.strip())
    return load_ply(io.BytesIO(content), skip_materials=True, fix_texture=False)


def _parts(loaded: Mapping[str, Any]) -> Iterator[tuple[Array, Integers]]:
    """Yield the vertices and faces of each part that a loader of trimesh gives, where it is placed.

    Raises:
        ValueError: A part is faulty.
    """
    from trimesh.geometry import triangulate_quads

    solids = loaded.get("geometry", {"": loaded})
    for place in loaded.get("graph", [{"geometry": name} for name in solids]):
        solid = solids[place["geometry"]]
        faces = solid.get("faces")
        if faces is None or not len(faces):
            continue
        if np.ndim(faces) != 2 or np.shape(faces)[1] != 3:
            faces = triangulate_quads(faces)
        corners = np.asarray(faces, dtype=np.int64)
        vertices = np.asarray(solid["vertices"], dtype=np.float64)
        if corners.min(initial=0) < 0 or corners.max(initial=-1) >= len(vertices):
            raise ValueError("it has triangles of vertices that it lacks; export it again")
        pose = place.get("matrix")
        if pose is not None:
            vertices = vertices @ pose[:3, :3].T + pose[:3, 3]
            if np.linalg.det(pose[:3, :3]) < 0.0:
                corners = corners[:, ::-1]
        yield vertices, corners


# --- COLLADA ------------------------------------------------------------------------------------


#: Elements of a COLLADA mesh that trimesh makes triangles of.
COLLADA_PARTS = ("{*}triangles", "{*}tristrips", "{*}trifans", "{*}polylist", "{*}polygons")


class _Placed(NamedTuple):
    """How much a part of a COLLADA scene places.

    Attributes:
        nodes: Number of nodes.
        parts: Number of parts of meshes.
        triangles: Upper bound of the number of triangles.
    """

    nodes: float = 0.0
    parts: float = 0.0
    triangles: float = 0.0

    def plus(self, other: _Placed) -> _Placed:
        """Return the sum."""
        return _Placed(*(own + more for own, more in zip(self, other, strict=True)))

    def at_most(self, other: _Placed) -> _Placed:
        """Return an upper bound of both."""
        return _Placed(*map(max, self, other))


class _MissingNodeError(ValueError):
    """A node of a COLLADA file places a node that the file lacks, or that is not loaded yet."""


def _collada(content: bytes, memory: float) -> Iterator[tuple[Array, Integers]]:
    """Yield the vertices and faces of each part that a COLLADA file places [m].

    The file is checked for what can grow beyond bounds: entities, nested nodes, copies and the
    corners of polygons.

    Raises:
        UnboundedError: It may take more memory [bytes] than it may.
        ValueError: It is faulty.
    """
    from trimesh.exchange.dae import load_collada

    require(PER_BYTE * len(content), memory)
    if b"<!DOCTYPE" in content:
        raise ValueError("it declares a DOCTYPE: remove it")
    root = _elements(content)
    metre = _metre(root)
    _check_polygons(root)
    try:
        placed = _placed(root)
        if placed.nodes > MOST_NODES:
            raise ValueError(f"it places more than {MOST_NODES:,} nodes")
        if placed.parts > MOST_PARTS:
            raise ValueError(f"it places more than {MOST_PARTS:,} parts of meshes; join them")
        require(PER_BYTE * len(content) + PER_TRIANGLE * placed.triangles, memory)
        loaded: Mapping[str, Any] = load_collada(io.BytesIO(etree.tostring(root)))
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    except (AttributeError, TypeError):  # pycollada takes what COLLADA demands for granted
        raise ValueError(
            "an attribute or a text that COLLADA demands is missing; export it again"
        ) from None
    for vertices, faces in _parts(loaded):
        yield metre * vertices, faces


def _elements(content: bytes) -> etree._Element:
    """Return the root element of a COLLADA file with what can give triangles.

    Elements of other namespaces, which COLLADA does not define, are left out, as are comments.

    Raises:
        ValueError: It is faulty.
    """
    parser = etree.XMLParser(
        encoding="utf-8", huge_tree=True, remove_comments=True, remove_pis=True
    )
    try:
        root = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as error:
        raise ValueError(TOO_DEEP if "depth" in str(error) else str(error)) from None
    if not etree.QName(root).namespace:
        raise ValueError(
            "its root element has no namespace; begin it by "
            '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        )
    etree.strip_elements(root, *COLLADA_LEFT_OUT, with_tail=False)
    prefix = f"{{{etree.QName(root).namespace}}}"
    foreign = [element for element in root.iter() if not str(element.tag).startswith(prefix)]
    for element in foreign:
        parent = element.getparent()
        if parent is not None and str(parent.tag).startswith(prefix):
            parent.remove(element)
    return root


def _metre(root: etree._Element) -> float:
    """Return the unit of a COLLADA file [m].

    Raises:
        ValueError: It is no positive length.
    """
    unit = root.find("{*}asset/{*}unit")
    stated = "1" if unit is None else unit.get("meter", "1")
    try:
        metre = float(stated)
    except ValueError:
        metre = 0.0
    if not 0.0 < metre <= LARGEST:
        raise ValueError(f'its unit is {stated!r} m; give a positive length, as <unit meter="1"/>')
    return metre


def _check_polygons(root: etree._Element) -> None:
    """Refuse polygons that state more corners than a COLLADA file can have."""
    corners = sum(int(n) for e in root.iter("{*}vcount") for n in (e.text or "").split())
    size = sum(len(e.text or "") for e in root.iter("{*}vcount", "{*}p"))
    if corners > size:
        raise ValueError(f"its polygons have {corners:,} corners, and it has fewer bytes")


def _placed(root: etree._Element) -> _Placed:
    """Return how much the scene of a COLLADA file places, and leave in the file what it places.

    Scenes that are not shown are removed, as are nodes of libraries that are not placed. The others
    stand after those that they place: pycollada tries all that wait for another one again and
    again.

    Raises:
        ValueError: The scene, or a node that it places, is missing.
    """
    scene = _only_scene(root)
    nodes = _Nodes(root)
    placed = nodes.of_scene(scene)
    libraries = root.findall("{*}library_nodes")
    for library in libraries:
        del library[:]
    if libraries:
        libraries[0].extend(nodes.order)
    return placed


def _only_scene(root: etree._Element) -> etree._Element:
    """Return the scene that a COLLADA file shows, and remove the others.

    Of scenes with the same id the last is shown, as pycollada does.

    Raises:
        ValueError: It shows none.
    """
    shown = root.find("{*}scene/{*}instance_visual_scene")
    if shown is None:
        raise ValueError(
            "it shows no scene; name its <visual_scene> by "
            '<scene><instance_visual_scene url="#ID"/></scene>, or export it again'
        )
    url = shown.get("url", "")
    scenes = root.findall("{*}library_visual_scenes/{*}visual_scene")
    named = [scene for scene in scenes if scene.get("id") and _url(scene) == url]
    if not named:
        raise ValueError(
            f"it shows the scene {url!r}, which it lacks; name one of its <visual_scene>, "
            "or export it again"
        )
    libraries = root.findall("{*}library_visual_scenes")
    for library in libraries:
        del library[:]
    libraries[0].append(named[-1])
    return named[-1]


class _Nodes:
    """The nodes of a COLLADA file: how much they place, with names resolved as pycollada does.

    A node of the scene finds the nodes at the top of the scene first, then those of the libraries;
    a node of a library finds the latter. Of nodes with the same id in libraries the last counts, in
    the scene the first. Of such meshes pycollada takes the last that it can load, so that the
    largest counts.

    Attributes:
        order: The nodes of libraries that are placed, each after those that it places.
    """

    def __init__(self, root: etree._Element) -> None:
        self._library = {_url(node): node for node in root.iterfind("{*}library_nodes/{*}node")}
        self._of_library: dict[str, _Placed] = {}
        self._meshes: dict[str, _Placed] = {}
        self.order: list[etree._Element] = []
        for mesh in root.iterfind("{*}library_geometries/{*}geometry"):
            url = _url(mesh)
            self._meshes[url] = _of_mesh(mesh).at_most(self._meshes.get(url, _Placed()))

    def of_scene(self, scene: etree._Element) -> _Placed:
        """Return how much a scene places.

        Raises:
            ValueError: It places a node that is missing.
        """
        total = _Placed()
        loaded: dict[str, _Placed] = {}
        waiting = []
        for node in scene.iterchildren("{*}node"):
            try:
                placed = self._of(node, loaded)
            except _MissingNodeError:  # it may stand further down
                waiting.append(node)
                continue
            total = total.plus(placed)
            if node.get("id"):
                loaded.setdefault(_url(node), placed)
        for node in waiting:
            total = total.plus(self._of(node, loaded))
        return total

    def _of(self, node: etree._Element, siblings: Mapping[str, _Placed]) -> _Placed:
        """Return how much a node places that may name some nodes of the scene."""
        total = _Placed(nodes=1.0)
        for child in node.iterchildren("{*}node"):
            total = total.plus(self._of(child, siblings))
        for instance in node.iterchildren("{*}instance_node"):
            url = instance.get("url", "")
            if url in siblings:
                total = total.plus(siblings[url])
            elif url.startswith("#"):  # what other files hold is not loaded
                total = total.plus(self._of_library_node(url))
        for instance in node.iterchildren("{*}instance_geometry"):
            total = total.plus(self._meshes.get(instance.get("url", ""), _Placed()))
        return total

    def _of_library_node(self, url: str) -> _Placed:
        """Return how much a node of a library places."""
        if url in self._of_library:
            return self._of_library[url]
        if url not in self._library:
            raise _MissingNodeError(
                f"it places the node {url!r}, which is missing or stands behind it; export it again"
            )
        node = self._library[url]
        try:
            placed = self._of(node, {})
        except _MissingNodeError as error:  # no node of the scene mends this
            raise ValueError(str(error)) from None
        self._of_library[url] = placed
        self.order.append(node)
        return placed


def _url(element: etree._Element) -> str:
    """Return the name by which an element of a COLLADA file is instanced."""
    return f"#{element.get('id', '')}"


def _of_mesh(geometry: etree._Element) -> _Placed:
    """Return how much one instance of a geometry places.

    Each corner has one number for each offset up to the largest one. Inputs that name the vertices
    as something else do not count: pycollada passes over them.
    """
    total = _Placed()
    for mesh in geometry.iterchildren("{*}mesh"):
        vertices = {_url(element) for element in mesh.iterchildren("{*}vertices")}
        for kind in mesh.iterchildren(*COLLADA_PARTS):
            inputs = [
                each
                for each in kind.iterchildren("{*}input")
                if each.get("semantic") == "VERTEX" or each.get("source") not in vertices
            ]
            largest_offset = max([0, *(int(each.get("offset", "0")) for each in inputs)])
            size = sum(len(e.text or "") for e in kind.iterchildren("{*}p"))
            corners = size / 2 / (1 + largest_offset)
            per_corner = 3 if etree.QName(kind).localname == "triangles" else 1
            total = total.plus(_Placed(parts=1.0, triangles=corners / per_corner))
    return total
