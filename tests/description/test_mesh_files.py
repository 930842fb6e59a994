"""STL, OBJ, PLY and COLLADA files: what they place, in how many parts, and what is refused."""

import struct

import numpy as np
import pytest
import trimesh
from helpers.collada import COLLADA, NODE, TRIANGLES

import spacearm as sa
from spacearm.description import mesh_files, shapes
from spacearm.description.shapes import mesh_bounds, read_mesh

BOX = trimesh.creation.box((1.0, 2.0, 3.0))
FACET = (
    "facet normal 0 0 1\nouter loop\nvertex {} 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
)
CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
ONE = TRIANGLES.format(1, "0 1 2")
INSTANCE = '<instance_geometry url="#g"/>'


def written(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def moved(mesh, distance):
    copy = mesh.copy()
    copy.apply_translation((distance, 0.0, 0.0))
    return copy


def ascii_stl(*meshes):
    return "".join(mesh.export(file_type="stl_ascii") for mesh in meshes)


# --- STL ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("trailing", [0, 1, 49, 50, 51, 1000])
def test_bytes_behind_the_triangles_of_a_binary_stl_are_ignored(trailing, tmp_path):
    content = BOX.export(file_type="stl") + bytes(range(1, 256))[:1] * trailing
    path = written(tmp_path / "box.stl", content)
    mesh = read_mesh(path)
    assert mesh.is_volume
    assert mesh.volume == pytest.approx(6.0)
    np.testing.assert_allclose(mesh_bounds(path), BOX.bounds, atol=1e-12)


def test_a_binary_stl_whose_header_begins_as_a_text_is_binary(tmp_path):
    content = b"solid of a tool".ljust(80) + BOX.export(file_type="stl")[80:]
    for more in (b"", b" facet endsolid"):
        assert read_mesh(written(tmp_path / "box.stl", content + more)).is_volume


def test_a_binary_stl_that_ends_early_is_told_with_both_sizes(tmp_path):
    content = BOX.export(file_type="stl")[:-1]
    with pytest.raises(sa.ModelError, match=r"12 triangles.* 684 bytes.* 683 bytes"):
        read_mesh(written(tmp_path / "box.stl", content))


def test_the_solids_of_a_text_are_parts_of_one_mesh(tmp_path):
    """Boxes that touch stay closed: their vertices are merged apart from those of the others."""
    path = written(tmp_path / "boxes.stl", ascii_stl(BOX, moved(BOX, 1.0), moved(BOX, 5.0)))
    mesh = read_mesh(path)
    assert mesh.is_volume
    assert mesh.volume == pytest.approx(18.0)
    assert len(mesh.vertices) == 24
    np.testing.assert_allclose(mesh_bounds(path), mesh.bounds, atol=1e-12)


@pytest.mark.parametrize(
    "change",
    [
        str.upper,
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace("\n", " "),
        lambda text: text.replace("solid", "solid vertex 1 2 3 of"),
    ],
)
def test_texts_of_stl_are_read_as_tools_write_them(change, tmp_path):
    path = written(tmp_path / "box.stl", change(ascii_stl(BOX)))
    assert read_mesh(path).is_volume
    np.testing.assert_allclose(mesh_bounds(path), BOX.bounds, atol=1e-12)


@pytest.mark.parametrize("number", ["one", "1,5", "nan", "inf", "1e400"])
def test_vertices_that_are_no_numbers_are_refused(number, tmp_path):
    path = written(tmp_path / "part.stl", f"solid\n{FACET.format(0)}{FACET.format(number)}endsolid")
    with pytest.raises(sa.ModelError, match=r"part\.stl"):
        read_mesh(path)


def test_a_facet_without_its_third_vertex_is_refused(tmp_path):
    text = f"solid\n{FACET.format(0)}endsolid\nsolid\n{FACET.format(0)}"
    path = written(tmp_path / "part.stl", text.rpartition("vertex")[0])
    with pytest.raises(sa.ModelError, match=r"a solid of 2 vertices"):
        read_mesh(path)


# --- many parts ---------------------------------------------------------------------------------

MANY = 3000
PARTS = {
    "solids.stl": lambda n: "".join(f"solid a\n{FACET.format(0)}endsolid a\n" for _ in range(n)),
    "materials.obj": lambda n: CORNERS + "".join(f"usemtl {i}\nf 1 2 3\n" for i in range(n)),
    "split.obj": lambda n: CORNERS + "".join(f"use\\\nmtl {i}\nf 1 2 3\n" for i in range(n)),
    "late.obj": lambda n: CORNERS + "".join(f"g usemtl {i}\nf 1 2 3\n" for i in range(n)),
    "objects.obj": lambda n: CORNERS + "".join(f"o {i}\nf 1 2 3\n" for i in range(n)),
    "triangles.dae": lambda n: COLLADA.format(parts=ONE * n, nodes=NODE),
    "instances.dae": lambda n: COLLADA.format(parts=ONE, nodes=f"<node>{INSTANCE * n}</node>"),
    "both.dae": lambda n: COLLADA.format(
        parts=ONE * 50, nodes=f"<node>{INSTANCE * (n // 50)}</node>"
    ),
    "nodes.dae": lambda n: COLLADA.format(parts=ONE, nodes=NODE * n),
    "pictures.dae": lambda n: COLLADA.format(parts=ONE * n, nodes=NODE).replace(
        "<library_g", f"<library_images>{'<image/>' * n}</library_images><library_g", 1
    ),
}


@pytest.mark.parametrize("name", PARTS)
def test_files_of_many_parts_take_no_scene_graph(name, tmp_path, monkeypatch):
    """Trimesh's takes time that grows with the square of the number of parts."""
    monkeypatch.setattr(trimesh, "Scene", None)
    path = written(tmp_path / name, PARTS[name](MANY))
    mesh = read_mesh(path)
    assert len(mesh.faces) == MANY
    assert len(mesh.vertices) == (3 if name.endswith("obj") else 3 * MANY)
    np.testing.assert_allclose(mesh_bounds(path), [[0, 0, 0], [1, 1, 0]], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in PARTS if name != "nodes.dae"])
def test_files_of_many_parts_take_seconds(name, tmp_path):
    """Five megabytes of parts took minutes."""
    many = min(5_000_000 // len(PARTS[name](1000)) * 1000, mesh_files.MOST_PARTS)
    path = written(tmp_path / name, PARTS[name](many))
    assert len(read_mesh(path).faces) == many


def test_parts_that_a_collada_file_places_are_counted_beforehand(tmp_path, monkeypatch):
    monkeypatch.setattr("trimesh.exchange.dae.load_collada", None)
    text = PARTS["both.dae"](50 * 1001)
    with pytest.raises(sa.ModelError, match=r"more than 50,000 parts of meshes; join them"):
        read_mesh(written(tmp_path / "part.dae", text))


def test_collada_nodes_that_are_nested_without_end_are_refused(tmp_path):
    loop = f'<node id="a">{place("b")}</node><node id="b">{place("a")}</node>'
    deep = [scene_of("", "<node>" * n + "</node>" * n) for n in (1500, 5000)]
    for text in (scene_of(loop, f"<node>{place('a')}</node>"), *deep):
        path = written(tmp_path / "part.dae", text)
        with pytest.raises(sa.ModelError, match=r"part\.dae.*nested too deeply"):
            read_mesh(path)


def scene_of(library, nodes, parts=ONE):
    """A COLLADA file with nodes of a library."""
    text = COLLADA.format(parts=parts, nodes=nodes)
    nodes_of_library = f"<library_nodes>{library}</library_nodes><library_visual_scenes>"
    return text.replace("<library_visual_scenes>", nodes_of_library)


def doubling(levels):
    """Nodes n1, n2 and so on, of which each places the one before twice, and n0 the mesh."""
    nodes = [f'<node id="n0">{INSTANCE}</node>']
    for i in range(levels):
        nodes.append(f'<node id="n{i + 1}">{place(f"n{i}") * 2}</node>')
    return nodes


def place(node):
    return f'<instance_node url="#{node}"/>'


@pytest.mark.parametrize("kind", ["triangles", "tristrips", "trifans", "polygons"])
def test_parts_of_every_kind_are_counted_beforehand(kind, tmp_path, monkeypatch):
    part = ONE.replace("triangles", kind)
    mesh = read_mesh(written(tmp_path / "one.dae", COLLADA.format(parts=part, nodes=NODE)))
    assert len(mesh.faces) == 1
    monkeypatch.setattr("trimesh.exchange.dae.load_collada", None)
    text = COLLADA.format(parts=part * 50, nodes=f"<node>{INSTANCE * 1001}</node>")
    with pytest.raises(sa.ModelError, match=r"more than 50,000 parts of meshes"):
        read_mesh(written(tmp_path / "many.dae", text))


FOREIGN = '<x:input xmlns:x="urn:x" offset="999"/>'
INPUTS = {
    "negative offsets": '<input semantic="NORMAL" source="#p" offset="-9"/>',
    "inputs of other namespaces": FOREIGN,
    "inputs that are passed over": '<input semantic="NORMAL" source="#v" offset="999"/>',
    "none": "",
}


@pytest.mark.parametrize("case", INPUTS)
@pytest.mark.parametrize("kind", ["triangles", "tristrips", "trifans", "polygons"])
def test_the_memory_of_triangles_is_bounded_beforehand(kind, case):
    part = TRIANGLES.format(1, " ".join(["0 1 2"] * 1000)).replace("triangles", kind)
    text = COLLADA.format(parts=part.replace("<p>", f"{INPUTS[case]}<p>"), nodes=NODE * 100)
    needed = 1000 * 100 * mesh_files.PER_TRIANGLE
    with pytest.raises(mesh_files.UnboundedError):
        mesh_files.triangles_of(".dae", text.encode(), needed)


BROKEN = (
    '<triangles count="1"><input semantic="VERTEX" source="#no" offset="0"/><p>0</p></triangles>'
)
LEVELS = 17


@pytest.mark.parametrize(
    "text",
    [
        scene_of("".join(doubling(LEVELS)), f"<node>{place(f'n{LEVELS}')}</node>"),
        scene_of(
            "".join(doubling(LEVELS)),
            f'<node>{place(f"n{LEVELS}")}</node><node><node id="n{LEVELS}"/></node>',
        ),
        scene_of(
            "".join(doubling(LEVELS)),
            f'<x:node xmlns:x="urn:x" id="n{LEVELS}"/><node>{place(f"n{LEVELS}")}</node>',
        ),
        scene_of("", "".join(doubling(LEVELS))),
        COLLADA.format(parts=ONE * 100, nodes=f"<node>{INSTANCE * 501}</node>").replace(
            "</geometry>", f'</geometry><geometry id="g"><mesh>{BROKEN}</mesh></geometry>'
        ),
    ],
    ids=["library", "id of an inner node", "other namespace", "scene", "broken mesh"],
)
def test_nodes_and_meshes_with_the_same_id_hide_none(text, tmp_path, monkeypatch):
    monkeypatch.setattr("trimesh.exchange.dae.load_collada", None)
    with pytest.raises(sa.ModelError, match=r"places more than 10,000 nodes|50,000 parts"):
        read_mesh(written(tmp_path / "part.dae", text))


FORWARD = [f'<node id="n{i}">{place(f"n{i + 1}")}</node>' for i in range(100)]
FORWARD.append(f'<node id="n100">{INSTANCE}</node>')
MOVED = "<translate>{} 0 0</translate>"
LOADED = {
    "a node of the scene named as one of the library": (
        scene_of(f'<node id="n">{INSTANCE}</node>', f'<node id="n">{place("n")}</node>'),
        [1.0],
    ),
    "forwards": (
        scene_of("".join(FORWARD), f"<node>{place('n0')}</node>"),
        [1.0],
    ),
    "forwards in the scene": (
        scene_of("", f'<node>{MOVED.format(5)}{place("n")}</node><node id="n">{INSTANCE}</node>'),
        [1.0, 6.0],
    ),
    "the first of the scene before the library": (
        scene_of(
            f'<node id="n">{MOVED.format(9)}{INSTANCE}</node>',
            f'<node id="n">{INSTANCE}</node><node id="n">{MOVED.format(5)}{INSTANCE}</node>'
            f"<node>{MOVED.format(20)}{place('n')}</node>",
        ),
        [1.0, 6.0, 21.0],
    ),
    "another file": (
        scene_of("", f'<node><instance_node url="o.dae#n"/></node><node>{INSTANCE}</node>'),
        [1.0],
    ),
    "a faulty node that nothing places": (scene_of(f"<node>{place('no')}</node>", NODE), [1.0]),
    "a scene that is not shown": (
        scene_of("", NODE).replace(
            "<visual_scene ",
            f'<visual_scene id="t"><node>{place("no")}</node></visual_scene><visual_scene ',
        ),
        [1.0],
    ),
    "comments": (
        scene_of("", NODE, f"<!-- c -->{ONE}".replace("0 1 2", "0 <!-- c -->1 2")),
        [1.0],
    ),
}


@pytest.mark.parametrize("case", LOADED)
def test_nodes_are_found_by_their_ids(case, tmp_path):
    text, ends = LOADED[case]
    mesh = read_mesh(written(tmp_path / "part.dae", text))
    np.testing.assert_allclose(np.sort(mesh.triangles[:, :, 0].max(axis=1)), ends, atol=1e-6)


def test_nodes_that_nothing_places_are_not_loaded(tmp_path, monkeypatch):
    """Each of them waits for the next one, and all wait again after one is loaded."""
    collada = pytest.importorskip("collada")
    loaded = []
    load = collada.scene.loadNode
    monkeypatch.setattr(collada.scene, "loadNode", lambda *a: loaded.append(1) or load(*a))
    used = f"<node>{place('n50')}</node>"
    text = scene_of("".join(FORWARD), used)
    assert len(read_mesh(written(tmp_path / "part.dae", text)).faces) == 1
    assert len(loaded) == 52


FAULTS = {
    "no scene": (("<scene>", "<extra>"), ("</scene>", "</extra>"), r"shows no scene; name"),
    "another scene": (('url="#s"', 'url="#no"'), ("", ""), r"scene '#no', which it lacks; name"),
    "decimal comma": (
        ("<asset/>", '<asset><unit meter="0,001"/></asset>'),
        ("", ""),
        r"unit is '0,001' m; give a positive length",
    ),
    "no namespace": (
        (' xmlns="http://www.collada.org/2005/11/COLLADASchema"', ""),
        ("", ""),
        r"no namespace; begin it by <COLLADA xmlns=",
    ),
    "a node that is missing": (
        ("<instance_geometry", '<instance_node url="#no"/><instance_geometry'),
        ("", ""),
        r"the node '#no', which is missing .* export it again",
    ),
    "a missing name": (
        ('<instance_geometry url="#g"/>', "<instance_geometry/>"),
        ("", ""),
        r"export it again",
    ),
    "a missing number": (
        ('<instance_geometry url="#g"/>', "<translate/>"),
        ("", ""),
        r"export it again",
    ),
}


@pytest.mark.parametrize("case", FAULTS)
def test_faults_of_collada_are_told_with_their_remedies(case, tmp_path):
    first, second, message = FAULTS[case]
    text = COLLADA.format(parts=ONE, nodes=NODE).replace(*first).replace(*second)
    with pytest.raises(sa.ModelError, match=message):
        read_mesh(written(tmp_path / "part.dae", text))


def test_the_memory_of_small_solids_is_bounded_beforehand():
    """Each solid becomes arrays of its own."""
    content = b"solid\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n" * 100
    with pytest.raises(mesh_files.UnboundedError):
        mesh_files.triangles_of(".stl", content, 29 * len(content))
    assert len(mesh_files.triangles_of(".stl", content, 31 * len(content))[1]) == 100


@pytest.mark.parametrize("split", ["use\\\\\n\nmtl", "use\\\r\r\nmtl"])
def test_no_material_of_an_obj_reaches_its_reader(split, tmp_path, monkeypatch):
    from trimesh.exchange import obj

    found = []
    preprocess = obj._preprocess_faces
    monkeypatch.setattr(
        obj, "_preprocess_faces", lambda text, *a: found.append(text) or preprocess(text, *a)
    )
    text = CORNERS + "".join(f"{split} m{i}\nf 1 2 3\n" for i in range(3))
    assert len(read_mesh(written(tmp_path / "part.obj", text)).faces) == 3
    assert "usemtl" not in found[0]


# --- what parts are -----------------------------------------------------------------------------


def test_mirrored_and_scaled_nodes_of_collada_keep_the_outside_out(tmp_path):
    text = BOX.export(file_type="dae").decode()
    matrix = "<matrix>-2 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1</matrix>"
    text = text.replace("<instance_geometry", f"{matrix}<instance_geometry", 1)
    mesh = read_mesh(written(tmp_path / "box.dae", text))
    assert mesh.is_volume
    assert mesh.volume == pytest.approx(12.0)
    np.testing.assert_allclose(mesh.bounds[:, 0], [4.0, 6.0], atol=1e-12)


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_quads_and_triangles_together_are_triangles(kind, tmp_path):
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4]]
    faces = [*quads, [1, 5, 7], [1, 7, 3]]
    corners = [f"{x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    if kind == "obj":
        lines = [f"v {corner}" for corner in corners]
        lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces]
    else:
        lines = ["ply", "format ascii 1.0", "element vertex 8"]
        lines += [f"property float {axis}" for axis in "xyz"]
        lines += ["element face 7", "property list uchar int vertex_indices", "end_header"]
        lines += corners + [f"{len(face)} " + " ".join(map(str, face)) for face in faces]
    mesh = read_mesh(written(tmp_path / f"box.{kind}", "\n".join(lines)))
    assert mesh.is_volume
    assert abs(mesh.volume) == pytest.approx(1.0)


PLY = """ply
format {} 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
{}end_header
"""
PLY_TRIANGLE = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


def test_empty_lines_of_a_ply_are_no_elements(tmp_path):
    text = PLY.format("ascii", "") + PLY_TRIANGLE.replace("\n", "\n \n\r\n\f\n")
    mesh = read_mesh(written(tmp_path / "part.ply", text + "\n" * 1000))
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [1, 1, 0]], atol=1e-12)


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian"])
def test_the_properties_of_a_ply_are_bounded(kind, tmp_path):
    """Those of a binary one take time that grows with the square of their number."""
    more = "".join(f"property list uchar uchar p{i}\n" for i in range(1000))
    with pytest.raises(sa.ModelError, match=r"more than 1,000 properties"):
        read_mesh(written(tmp_path / "part.ply", PLY.format(kind, more) + PLY_TRIANGLE))


@pytest.mark.parametrize("face", ["f 1 2 9", "f -1 -2 -9"])
def test_triangles_of_vertices_that_are_not_there_are_refused(face, tmp_path):
    with pytest.raises(sa.ModelError, match=r"part\.obj"):
        read_mesh(written(tmp_path / "part.obj", f"{CORNERS}{face}\n"))


def test_seams_of_pictures_do_not_open_a_mesh(tmp_path):
    """Vertices at one place are one, whatever their texture coordinates and normals."""
    lines = ["v {} {} {}".format(*corner) for corner in BOX.vertices]
    lines += [f"vt 0.{i} 0.{i}" for i in range(1, 9)] + ["vn 0 0 1", "vn 1 0 0"]
    for number, face in enumerate(BOX.faces + 1):
        texture, normal = number % 8 + 1, number % 2 + 1
        lines.append("f " + " ".join(f"{i}/{texture}/{normal}" for i in face))
    mesh = read_mesh(written(tmp_path / "box.obj", "\n".join(lines)))
    assert mesh.is_volume
    assert mesh.volume == pytest.approx(6.0)


def test_bytes_that_are_no_utf_8_do_not_matter(tmp_path):
    for name, content in (("a.obj", CORNERS + "f 1 2 3\n# "), ("a.stl", "solid x\n")):
        text = content.encode() + b"\xe4\xf6\xff\n"
        text += FACET.format(0).encode() if name.endswith("stl") else b""
        assert len(read_mesh(written(tmp_path / name, text)).faces) == 1


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32"])
def test_marked_texts_are_read_as_their_marks_state(encoding, tmp_path):
    texts = {"a.stl": ascii_stl(BOX), "a.obj": BOX.export(file_type="obj"),
             "a.ply": BOX.export(file_type="ply", encoding="ascii").decode()}  # fmt: skip
    for name, text in texts.items():
        path = written(tmp_path / name, text.encode(encoding))
        assert read_mesh(path).is_volume
        np.testing.assert_allclose(mesh_bounds(path), BOX.bounds, atol=1e-12)


def test_a_long_word_among_vertices_takes_no_memory_of_its_size_times_theirs(tmp_path):
    """As an array of texts it takes 30 GB."""
    text = "v 0 0 0\n" * 10_000 + "v " + "1" * 300_000 + " 0 0\n"
    assert mesh_bounds(written(tmp_path / "a.obj", text)) is not None


def test_what_is_read_elsewhere_is_told_with_its_limits(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh_files, "PER_BYTE", 1e9)
    monkeypatch.setattr(shapes, "SECONDS", 0.01)
    path = written(tmp_path / "part.obj", f"{CORNERS}f 1 2 3\n")
    with pytest.raises(sa.ModelError, match=r"not read in 0\.01 s and 1 GB of memory"):
        read_mesh(path)


def test_a_binary_stl_of_more_triangles_than_are_read_is_refused(tmp_path):
    path = tmp_path / "part.stl"
    with path.open("wb") as file:
        file.write(bytes(80) + struct.pack("<I", 1_999_999))
        file.truncate(84 + 50 * 1_999_998)
    with pytest.raises(sa.ModelError, match=r"1,999,999 triangles.*export it again"):
        read_mesh(path)
