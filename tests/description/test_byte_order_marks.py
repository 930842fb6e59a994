"""Byte-order marks are read as such in every text that is read."""

import json

import numpy as np
import pytest
import trimesh
from helpers.arms import joint, link, robot, two_links

import spacearm as sa
from spacearm.cli.options import table_of
from spacearm.description.shapes import mesh_bounds, read_mesh
from spacearm.export.motion_files import read_measured
from spacearm.files import decoded
from spacearm.servo.watching import joint_states, recorded

MARKED = ["utf-8-sig", "utf-16", "utf-32"]
URDF = robot(*two_links()).removeprefix('<?xml version="1.0"?>\n')
INERTIA = "<inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>"
LINK = f"<link name='{{}}'><inertial><mass>{{}}</mass>{INERTIA}</inertial></link>"
SDF = (
    f"<sdf version='1.9'><model name='m'>{LINK.format('bus', 50)}{LINK.format('arm', 1)}"
    "<joint name='j' type='revolute'><parent>bus</parent><child>arm</child>"
    "<axis><xyz>0 0 1</xyz></axis></joint></model></sdf>"
)
XACRO = URDF.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"').replace(
    "</robot>", '<xacro:property name="a" value="${xacro.load_yaml(\'values.yaml\')}"/></robot>'
)
PREFIXED = URDF.replace("</robot>", "<gz:plugin/></robot>")


@pytest.mark.parametrize("declaration", ["", '<?xml version="1.0" encoding="{}"?>\n'])
@pytest.mark.parametrize("encoding", MARKED)
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("robot.urdf", URDF),
        ("robot.urdf", PREFIXED),
        ("robot.sdf", SDF),
        ("robot.xacro", XACRO),
    ],
)
def test_robot_files(name, text, encoding, declaration, tmp_path):
    stated = encoding.removesuffix("-sig")
    (tmp_path / "values.yaml").write_bytes("mass: 1".encode("utf-8-sig"))
    (tmp_path / name).write_bytes((declaration.format(stated) + text).encode(encoding))
    assert sa.load(tmp_path / name).n == 1


def test_an_mjcf(tmp_path):
    body = "<freejoint/><geom size='1'/><body><joint axis='0 0 1'/><geom size='1'/></body>"
    text = f"<mujoco><worldbody><body>{body}</body></worldbody></mujoco>"
    (tmp_path / "robot.xml").write_bytes(text.encode("utf-8-sig"))
    assert sa.load(tmp_path / "robot.xml").n == 1
    (tmp_path / "robot.xml").write_bytes(text.encode("utf-16"))
    with pytest.raises(sa.ModelError, match=r"utf-16.*save it as UTF-8"):
        sa.load(tmp_path / "robot.xml")


@pytest.mark.parametrize("encoding", MARKED)
def test_an_srdf(encoding, tmp_path):
    joints = joint("elbow", "bus", "arm"), joint("wrist", "arm", "hand")
    path = tmp_path / "r.urdf"
    path.write_text(robot(link("bus", 50.0), link("arm"), link("hand"), *joints))
    chain = '<group name="g"><chain base_link="bus" tip_link="arm"/></group>'
    (tmp_path / "r.srdf").write_bytes(f'<robot name="r">{chain}</robot>'.encode(encoding))
    assert sa.load(path).tip == "arm"


@pytest.mark.parametrize("encoding", MARKED)
def test_tables(encoding, tmp_path):
    path = tmp_path / "points.csv"
    path.write_bytes("1.5, 1.2\n1.6, 1.3\n".encode(encoding))
    assert np.array_equal(table_of(path, "points")[1], [[1.5, 1.2], [1.6, 1.3]])
    path.write_bytes("x, y\n1.5, 1.2\n".encode(encoding))
    assert table_of(path, "points")[0] == ["x", "y"]


@pytest.mark.parametrize("encoding", MARKED)
def test_measured_motions(encoding, tmp_path):
    arm = sa.load("planar2")
    way = sa.follow(arm.at([0.3, 1.2]), [(1.5, 1.2)])
    path = sa.write_motion(way, tmp_path / "way.csv")
    path.write_bytes(path.read_text(encoding="utf-8").encode(encoding))
    assert np.array_equal(read_measured(path, arm)[0].q, way.q)


def test_recorded_joint_states(tmp_path):
    arm, path = sa.load("planar2"), tmp_path / "states.jsonl"
    line = json.dumps({"t": 0.5, "q": [0.3, 1.2]})
    path.write_bytes(f"{line}\n{line}\n".encode("utf-8-sig"))
    for messages in (recorded(path, ""), [f"\ufeff{line}", line]):
        assert [state.t for state in joint_states(arm, messages)] == [0.5, 0.5]


@pytest.mark.parametrize(
    "message",
    [
        '{"t": 0, "q": [0.3, 1.2], "name": 5}',
        '{"t": 0, "q": [0.3, 1.2], "name": [[1]]}',
        '{"t": {"sec": "a"}, "q": [0.3, 1.2]}',
        "[" * 100_000,
        "\ud800",
    ],
)
def test_joint_states_that_cannot_be_read_are_nan(message):
    (state,) = joint_states(sa.load("planar2"), [message])
    assert np.isnan(state.q).all()


@pytest.mark.parametrize("kind", ["obj", "stl_ascii", "ply", "dae", "gltf"])
def test_meshes(kind, tmp_path):
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    if kind == "gltf":
        files = box.export(file_type="gltf")
        for name, content in files.items():
            (tmp_path / name).write_bytes(content)
        path, text = tmp_path / "mesh.gltf", files["model.gltf"]
    else:
        options = {"encoding": "ascii"} if kind == "ply" else {}
        text = box.export(file_type=kind, **options)
        text = text if isinstance(text, bytes) else text.encode()
        path = tmp_path / f"mesh.{kind[:3]}"
    path.write_bytes(b"\xef\xbb\xbf" + text)
    assert sorted(np.ptp(read_mesh(path).bounds, axis=0)) == pytest.approx([1.0, 2.0, 3.0])
    assert sorted(np.ptp(mesh_bounds(path), axis=0)) == pytest.approx([1.0, 2.0, 3.0])


def test_a_binary_stl_may_begin_as_a_marked_text_does(tmp_path):
    content = trimesh.creation.box((1.0, 2.0, 3.0)).export(file_type="stl")
    path = tmp_path / "mesh.stl"
    path.write_bytes(b"\xef\xbb\xbf" + content[3:])
    assert len(read_mesh(path).faces) == 12


def test_texts_without_a_mark_are_utf_8():
    assert decoded("é".encode()) == "é"
    with pytest.raises(ValueError, match="utf-8"):
        decoded(b"\xe9")
