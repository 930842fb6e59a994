"""glTF files: what they place, what they ask for, and how long it takes."""

import json
import struct

import numpy as np
import pytest
import trimesh

import spacearm as sa
from spacearm.description import gltf, mesh_files, shapes
from spacearm.description.shapes import read_mesh

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.5]], dtype="<f4")
BYTES = CORNERS.tobytes()
POINTS = {"componentType": 5126, "type": "VEC3", "count": 3, "bufferView": 0}
ZUP = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
"""From the y axis up, as in glTF, to the z axis up."""


def glb(path, blob=BYTES, mode=4, indices=None, **changed):
    """A GLB of one mesh of one primitive at one node; by default of one triangle."""
    primitive = {"attributes": {"POSITION": 0}, "mode": mode}
    primitive |= {} if indices is None else {"indices": indices}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": [POINTS],
        "bufferViews": [{"buffer": 0, "byteLength": len(blob)}],
        "buffers": [{"byteLength": len(blob)}],
    }
    text = json.dumps(document | changed).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(blob), 0x004E4942) + blob
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


def test_a_scene_is_what_trimesh_reads(tmp_path):
    rng = np.random.default_rng(1)
    scene = trimesh.Scene()
    for name, part in (("box", trimesh.creation.box((1, 2, 3))),
                       ("ball", trimesh.creation.icosphere(1, 0.4))):  # fmt: skip
        for i in range(3):
            pose = trimesh.transformations.random_rotation_matrix(rng.random(3))
            pose[:3, 3] = rng.normal(size=3)
            above = f"{name}{i - 1}" if i else None
            scene.add_geometry(part, f"{name}{i}", name, transform=pose, parent_node_name=above)
    scene.export(tmp_path / "scene.glb")
    found, wanted = read_mesh(tmp_path / "scene.glb"), scene.to_mesh()
    assert len(found.faces) == len(wanted.faces)
    assert found.volume == pytest.approx(wanted.volume)
    np.testing.assert_allclose(found.center_mass, ZUP @ wanted.center_mass, atol=1e-6)


def test_a_mirrored_node_keeps_the_outside_out(tmp_path):
    box = trimesh.creation.box((1, 2, 3))
    scene = trimesh.Scene()
    scene.add_geometry(box, transform=np.diag([-1.0, 2.0, 1.0, 1.0]))
    scene.export(tmp_path / "box.glb")
    assert read_mesh(tmp_path / "box.glb").volume == pytest.approx(12.0)


def test_strips_and_fans_are_their_triangles(tmp_path):
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype="<f4")
    points = [POINTS | {"count": 4}]
    fan = read_mesh(glb(tmp_path / "fan.glb", corners.tobytes(), 6, accessors=points))
    zigzag = corners[[0, 1, 3, 2]].tobytes()
    strip = read_mesh(glb(tmp_path / "strip.glb", zigzag, 5, accessors=points))
    for mesh in (fan, strip):
        assert mesh.area == pytest.approx(1.0)
        np.testing.assert_allclose(mesh.face_normals, [[0, -1, 0]] * 2, atol=1e-12)


def test_sparse_and_normalized_numbers_count(tmp_path):
    blob = CORNERS[:3].tobytes() + struct.pack("<HH3f", 2, 0, 0.0, 5.0, 0.0)
    views = [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 16}]
    indices = {"bufferView": 1, "componentType": 5123}
    changed = {"count": 1, "indices": indices, "values": {"bufferView": 1, "byteOffset": 4}}
    path = glb(
        tmp_path / "a.glb", blob, bufferViews=views, accessors=[POINTS | {"sparse": changed}]
    )
    assert read_mesh(path).area == pytest.approx(2.5)
    small = np.array([[0, 0, 0], [127, 0, 0], [0, -128, 0]], dtype="<i1").tobytes()
    points = POINTS | {"componentType": 5120, "normalized": True}
    assert read_mesh(glb(tmp_path / "b.glb", small, accessors=[points])).area == pytest.approx(0.5)


FAULTY = {
    "a count": ({"accessors": [{k: v for k, v in POINTS.items() if k != "bufferView"}
                               | {"count": 3_000_000}]}, "without bytes"),
    "a huge count": ({"accessors": [POINTS | {"count": 29_999_997}]}, "9,999,999 triangles"),
    "a negative count": ({"accessors": [POINTS | {"count": -3}]}, "-3 elements"),
    "a count of corners": (
        {"accessors": [POINTS, POINTS | {"type": "SCALAR", "componentType": 5125,
                                         "count": 3_000_000}], "indices": 1},
        "asks for 3,000,000 elements",
    ),
    "a stride": (
        {"accessors": [POINTS | {"count": 30}],
         "bufferViews": [{"buffer": 0, "byteLength": 48, "byteStride": 1}]},
        "asks for 30 elements",
    ),
    "a long view": ({"bufferViews": [{"buffer": 0, "byteLength": 10**9}]}, "of a buffer of 48"),
    "before the buffer": (
        {"bufferViews": [{"buffer": 0, "byteOffset": -8, "byteLength": 40}]}, "asks for 3 elements"
    ),
    "copies": (
        {"nodes": [{"mesh": 0}] * 10_000, "scenes": [{"nodes": list(range(10_000))}],
         "accessors": [POINTS | {"count": 3_000}]},
        "10,000,000 triangles",
    ),
    "a ring": ({"nodes": [{"mesh": 0, "children": [0]}]}, "node 0 is placed twice"),
    "no such mesh": ({"nodes": [{"mesh": 7}]}, "faulty glTF"),
    "a missing corner": (
        {"accessors": [POINTS, POINTS | {"type": "SCALAR", "componentType": 5121,
                                         "bufferView": 1}], "indices": 1,
         "bufferViews": [{"buffer": 0, "byteLength": 48},
                         {"buffer": 0, "byteOffset": 12, "byteLength": 8}]},
        "vertices that it lacks",
    ),
    "compressed": ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "is compressed"),
    "another file": ({"buffers": [{"uri": "a.bin", "byteLength": 48}]}, "'a.bin' is not in the"),
}  # fmt: skip


@pytest.mark.parametrize("case", FAULTY)
def test_what_has_too_few_bytes_or_no_sense_is_refused(case, tmp_path):
    changed, message = FAULTY[case]
    with pytest.raises(sa.ModelError, match=r"'a\.glb' cannot be read") as caught:
        read_mesh(glb(tmp_path / "a.glb", **changed))
    assert message in str(caught.value)


def test_what_is_no_gltf_is_refused(tmp_path):
    for content in (b"", b"glTF", b"[1]", b"{}", b'{"asset": {"version": "1.0"}}', b"[" * 10**5):
        (tmp_path / "a.gltf").write_bytes(content)
        with pytest.raises(sa.ModelError, match="it is no glTF"):
            read_mesh(tmp_path / "a.gltf")


def test_the_poses_of_nodes_in_a_row_are_composed_once_each(tmp_path, monkeypatch):
    count, composed = 3_000, []
    pose_of = gltf._pose
    monkeypatch.setattr(gltf, "_pose", lambda *given: composed.append(1) or pose_of(*given))
    step = {"translation": [1.0, 0.0, 0.0]}
    nodes = [step | {"children": [i + 1]} for i in range(count - 1)]
    mesh = read_mesh(glb(tmp_path / "a.glb", nodes=[*nodes, {"mesh": 0} | step]))
    assert mesh.bounds[0, 0] == count
    assert len(composed) == count


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "dae", "glb"])
def test_a_mesh_that_may_take_much_is_read_in_a_process_of_its_own_to_the_same(
    suffix, tmp_path, monkeypatch
):
    path = tmp_path / f"ball.{suffix}"
    trimesh.creation.icosphere(3).export(path)
    here, called = read_mesh(path), []
    call = shapes.call_within
    monkeypatch.setattr(shapes, "call_within", lambda *given: called.append(1) or call(*given))
    monkeypatch.setenv("SPACEARM_MEMORY", "0.0003")
    with pytest.raises(sa.ModelError, match=r"is not read in 60 s and .* GB of memory"):
        read_mesh(path)
    monkeypatch.setattr(shapes, "memory_limit", lambda: 3e8)
    for module, name in (
        (shapes, "PER_BYTE"),
        (shapes, "PER_TRIANGLE"),
        (mesh_files, "PER_BYTE"),
        (mesh_files, "PER_TRIANGLE"),
        (mesh_files, "PER_BYTE_OF_PLY"),
    ):
        monkeypatch.setattr(module, name, 1e9)
    apart = read_mesh(path)
    assert len(called) == 2
    np.testing.assert_array_equal(apart.vertices, here.vertices)
    np.testing.assert_array_equal(apart.faces, here.faces)
