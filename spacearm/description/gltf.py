"""glTF: the triangles of a glTF or GLB file, in the frame of its scene.

Only what gives triangles is read: no materials, pictures, cameras or animations. How many numbers a
file asks for is compared with the bytes that are there, and the triangles that it places are
counted, before any array is made. The time is linear in the size of the file.

Source: Khronos Group, glTF 2.0 Specification, sections 3.5 to 3.7 and 4.4.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, Integers

#: Begins a GLB; the kinds of its two chunks.
MAGIC, JSON_CHUNK, BINARY_CHUNK = b"glTF", 0x4E4F534A, 0x004E4942
#: Types of numbers, and how many of them an element has.
COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
#: How triangles are made of vertices: each three, a strip, a fan. Other modes have none.
TRIANGLES, STRIP, FAN = 4, 5, 6
#: Extensions that compress the numbers of a file.
COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")

Document = dict[str, Any]


class GltfScene(NamedTuple):
    """What a file places.

    Attributes:
        document: The JSON document.
        buffers: The bytes of its buffers.
        places: The number of a mesh and its pose (4, 4) in the scene, for each place of one.
        vertices: Number of vertices that are placed, those of copies included.
        triangles: Number of triangles that are placed, those of copies included.
    """

    document: Document
    buffers: list[bytes]
    places: list[tuple[int, Array]]
    vertices: int
    triangles: int


def chunks(content: bytes) -> tuple[Document, bytes]:
    """Return the JSON document of a glTF or GLB file, and the binary chunk; empty if none.

    Raises:
        ValueError: It is no glTF 2.
    """
    text, binary = content, b""
    if content.startswith(MAGIC):
        text, at = b"", 12
        while at + 8 <= len(content):
            length, kind = struct.unpack_from("<II", content, at)
            part = content[at + 8 : at + 8 + length]
            if kind == JSON_CHUNK and at == 12:
                text = part
            elif kind == BINARY_CHUNK and not binary:
                binary = part
            at += 8 + length
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        raise ValueError("it is no glTF: its JSON cannot be read; export it again") from None
    asset = document.get("asset") if isinstance(document, dict) else None
    if not isinstance(asset, dict) or not str(asset.get("version", "")).startswith("2"):
        raise ValueError("it is no glTF of version 2; export it again")
    return document, binary


def text_size(content: bytes) -> int:
    """Return an upper bound of the size of the JSON of a glTF or GLB file [bytes]."""
    if content.startswith(MAGIC):
        return min(int.from_bytes(content[12:16], "little"), len(content))
    return len(content)


def scene_of(document: Document, binary: bytes, files: Mapping[str, bytes]) -> GltfScene:
    """Return what a glTF or GLB file places, counted, without its triangles.

    Args:
        document: Its JSON document.
        binary: Its binary chunk; empty if none.
        files: The bytes of the buffers that are files, by their URIs.

    Raises:
        ValueError: It is faulty.
    """
    used = document.get("extensionsRequired") or []
    if packed := [name for name in COMPRESSED if name in used]:
        raise ValueError(f"it is compressed ({packed[0]}); export it without compression")
    try:
        buffers = [_buffer(entry, binary, files) for entry in document.get("buffers", [])]
        places = _places(document)
        sizes = [_size(document, mesh) for mesh in document.get("meshes", [])]
        vertices = sum(sizes[mesh][0] for mesh, _ in places)
        triangles = sum(sizes[mesh][1] for mesh, _ in places)
    except (KeyError, IndexError, TypeError, AttributeError) as error:
        raise ValueError(f"it is faulty glTF ({error!r}); export it again") from None
    return GltfScene(document, buffers, places, vertices, triangles)


def triangles_of(scene: GltfScene) -> tuple[Array, Integers]:
    """Return the vertices (n, 3) and faces (m, 3) of all that is placed [m].

    Vertices of a part that are at one place become one.

    Raises:
        ValueError: The file is faulty, or asks for more numbers than it has bytes.
    """
    meshes = scene.document.get("meshes", [])
    read: dict[int, tuple[Array, Integers]] = {}
    vertices: list[Array] = [np.zeros((0, 3))]
    faces: list[Integers] = [np.zeros((0, 3), dtype=np.int64)]
    count = 0
    try:
        for number, pose in scene.places:
            if number not in read:
                read[number] = _mesh(scene, meshes[number])
            points, corners = read[number]
            mirrored = np.linalg.det(pose[:3, :3]) < 0.0
            vertices.append(points @ pose[:3, :3].T + pose[:3, 3])
            faces.append((corners[:, ::-1] if mirrored else corners) + count)
            count += len(points)
    except (KeyError, IndexError, TypeError, AttributeError) as error:
        raise ValueError(f"it is faulty glTF ({error!r}); export it again") from None
    return np.concatenate(vertices), np.concatenate(faces)


def _mesh(scene: GltfScene, mesh: Document) -> tuple[Array, Integers]:
    """Return vertices (n, 3) and faces (m, 3) of a mesh, in its own frame."""
    vertices: list[Array] = [np.zeros((0, 3))]
    faces: list[Integers] = [np.zeros((0, 3), dtype=np.int64)]
    count = 0
    for primitive in filter(_has, mesh["primitives"]):
        points, corners = _primitive(scene, primitive)
        same, first = np.unique(points, axis=0, return_inverse=True)
        vertices.append(same)
        faces.append(first.ravel()[corners] + count)
        count += len(same)
    return np.concatenate(vertices), np.concatenate(faces)


def _buffer(entry: Document, binary: bytes, files: Mapping[str, bytes]) -> bytes:
    """Return the bytes of a buffer."""
    uri = entry.get("uri")
    if uri is None:
        return binary
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2])
    if uri not in files:
        raise ValueError(f"its buffer {uri!r} is not in the file; export it as one GLB")
    return files[uri]


def _places(document: Document) -> list[tuple[int, Array]]:
    """Return the meshes of the scene with their poses, each node once."""
    nodes = document.get("nodes", [])
    scenes = document.get("scenes")
    if scenes:
        roots = scenes[document.get("scene", 0)].get("nodes", [])
    else:
        children = {child for node in nodes for child in node.get("children", [])}
        roots = [number for number in range(len(nodes)) if number not in children]
    places: list[tuple[int, Array]] = []
    waiting: list[tuple[int, Array]] = [(number, np.eye(4)) for number in roots]
    reached: set[int] = set()
    while waiting:
        number, above = waiting.pop()
        if number in reached:
            raise ValueError(f"its node {number} is placed twice; export it again")
        reached.add(number)
        node = nodes[number]
        pose = _pose(node, above)
        if "mesh" in node:
            places.append((node["mesh"], pose))
        waiting += [(child, pose) for child in node.get("children", [])]
    return places


def _pose(node: Document, above: Array) -> Array:
    """Return the pose (4, 4) of a node in the scene, from that of the node above it."""
    if "matrix" in node:
        return above @ np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    if not {"translation", "rotation", "scale"} & node.keys():
        return above
    own = np.eye(4)
    own[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    if "rotation" in node:
        x, y, z, w = (float(part) for part in node["rotation"])
        own[:3, :3] = pin.Quaternion(w, x, y, z).normalized().matrix()
    own[:3, :3] *= np.array(node.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)
    return above @ own


def _has(primitive: Document) -> bool:
    """Whether a primitive has triangles."""
    if any(name in primitive.get("extensions", ()) for name in COMPRESSED):
        raise ValueError("it is compressed; export it without compression")
    return "POSITION" in primitive["attributes"] and _mode(primitive) in (TRIANGLES, STRIP, FAN)


def _mode(primitive: Document) -> int:
    return int(primitive.get("mode", TRIANGLES))


def _size(document: Document, mesh: Document) -> tuple[int, int]:
    """Return an upper bound of the numbers of vertices and triangles of a mesh."""
    vertices = triangles = 0
    for primitive in mesh["primitives"]:
        if _has(primitive):
            points = _count(document["accessors"][primitive["attributes"]["POSITION"]])
            indices = primitive.get("indices")
            corners = points if indices is None else _count(document["accessors"][indices])
            vertices += points
            triangles += corners // 3 if _mode(primitive) == TRIANGLES else corners
    return vertices, triangles


def _count(accessor: Document) -> int:
    """Return the number of elements of an accessor."""
    count = accessor["count"]
    if not isinstance(count, int) or count < 0:
        raise ValueError(f"it has an accessor of {count!r} elements; export it again")
    return count


def _primitive(scene: GltfScene, primitive: Document) -> tuple[Array, Integers]:
    """Return vertices (n, 3) and faces (m, 3) of a primitive."""
    accessors = scene.document["accessors"]
    vertices = _numbers(scene, accessors[primitive["attributes"]["POSITION"]])
    if vertices.shape[1] != 3:
        raise ValueError("it has positions that are not of three numbers; export it again")
    if "indices" in primitive:
        corners = _numbers(scene, accessors[primitive["indices"]]).ravel().astype(np.int64)
    else:
        corners = np.arange(len(vertices))
    if len(corners) and not (corners.min() >= 0 and corners.max() < len(vertices)):
        raise ValueError("it has triangles of vertices that it lacks; export it again")
    mode = _mode(primitive)
    if mode == TRIANGLES:
        return vertices, corners[: len(corners) // 3 * 3].reshape(-1, 3)
    last = max(len(corners) - 2, 0)
    first = corners[:last] if mode == STRIP else np.repeat(corners[:1], last)
    faces = np.column_stack((first, corners[1 : last + 1], corners[2 : last + 2]))
    if mode == STRIP:  # each second triangle turns the other way
        faces[1::2] = faces[1::2, ::-1]
    return vertices, faces


def _numbers(scene: GltfScene, accessor: Document) -> Array:
    """Return the numbers (count, width) of an accessor, sparse ones included."""
    count, width = _count(accessor), WIDTHS[accessor["type"]]
    kind = np.dtype(COMPONENTS[accessor["componentType"]])
    if "bufferView" in accessor:
        found = _viewed(scene, accessor, count, width, kind)
    elif "sparse" in accessor:
        found = np.zeros((count, width))
    else:
        raise ValueError(f"it has {count:,} elements without bytes; export it again")
    if sparse := accessor.get("sparse"):
        some, indices, values = _count(sparse), sparse["indices"], sparse["values"]
        numbered = np.dtype(COMPONENTS[indices["componentType"]])
        at = _viewed(scene, indices, some, 1, numbered).ravel().astype(np.int64)
        if len(at) and not (at.min() >= 0 and at.max() < count):
            raise ValueError("it changes elements that it lacks; export it again")
        found[at] = _viewed(scene, values, some, width, kind)
    if accessor.get("normalized") and kind.kind in "iu":
        found = np.maximum(found / float(np.iinfo(kind).max), -1.0)
    return found


def _viewed(
    scene: GltfScene, part: Mapping[str, Any], count: int, width: int, kind: np.dtype[Any]
) -> npt.NDArray[np.float64]:
    """Return the numbers (count, width) in a view of a buffer."""
    view = scene.document["bufferViews"][part["bufferView"]]
    buffer, begin = scene.buffers[view["buffer"]], int(view.get("byteOffset", 0))
    length, offset = int(view["byteLength"]), int(part.get("byteOffset", 0))
    row = width * kind.itemsize
    stride = int(view.get("byteStride", row))
    end = offset + (count - 1) * stride + row if count else offset
    sound = begin >= 0 and offset >= 0 and end <= length and begin + length <= len(buffer)
    if not sound or stride < row:
        raise ValueError(
            f"it asks for {count:,} elements of {row} bytes in {length:,} bytes of a buffer of "
            f"{len(buffer):,}; export it again"
        )
    strides = (stride, kind.itemsize)
    numbers = np.ndarray((count, width), kind, buffer, begin + offset, strides)
    return numbers.astype(np.float64)
