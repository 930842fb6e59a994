"""Visuals: read once from URDF as data, written back, and never in the way of physics."""

import re

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import link, load_text, robot, two_links

import spacearm as sa
from spacearm.description.readers import formats
from spacearm.description.shapes import (
    Box,
    Cylinder,
    Mesh,
    Shape,
    Sphere,
    Unusable,
    Visuals,
)
from spacearm.description.urdf_writer import document

ORIGIN = '<origin xyz="0.1 -0.2 0.3" rpy="0.4 -0.5 0.6"/>'
POSE = pin.SE3(pin.rpy.rpyToMatrix(0.4, -0.5, 0.6), np.array([0.1, -0.2, 0.3]))
PAINT = '<material name="paint"><color rgba="0.1 0.2 0.3 0.4"/></material>'
GEOMETRIES = {
    '<box size="1 2 3e-17"/>': Box((1.0, 2.0, 3e-17)),
    '<sphere radius="0.1"/>': Sphere(0.1),
    '<cylinder radius="0.1" length="0.7"/>': Cylinder(0.1, 0.7),
    '<mesh filename="nowhere.stl" scale="1 -2 3"/>': Mesh("nowhere.stl", None, (1.0, -2.0, 3.0)),
}


def tree(visual="", collision="", materials=""):
    """The tree of a robot with one visual and one collision on its arm."""
    inside = (visual and f"<visual>{visual}</visual>") + (
        collision and f"<collision>{collision}</collision>"
    )
    bus, _, elbow = two_links()
    return load_text(robot(materials, bus, link("arm", inside=inside), elbow)).tree


def same(a: Shape, b: Shape) -> None:
    assert a.pose.isApprox(b.pose, 1e-14)
    assert (a.geometry, a.rgba) == (b.geometry, b.rgba)


@pytest.mark.parametrize("text", GEOMETRIES)
@pytest.mark.filterwarnings("ignore:.*meshes not found:spacearm.ModelWarning")
def test_shapes_are_read_as_data_and_written_back(text, tmp_path):
    body = f"{ORIGIN}<geometry>{text}</geometry>"
    read = tree(body + PAINT, body)
    expected = GEOMETRIES[text]
    (tmp_path / "again.urdf").write_bytes(document(read, ()))
    for one in (read, formats.read(tmp_path / "again.urdf"), read.renamed("a_{}".format)):
        (shapes,) = one.visuals.values()
        same(shapes.visual[0], Shape(POSE, expected, (0.1, 0.2, 0.3, 0.4)))
        same(shapes.collision[0], Shape(POSE, expected))
    assert list(read.renamed("a_{}".format).visuals) == ["a_arm"]


def test_links_without_shapes_have_no_entry():
    assert tree().visuals == {}


def test_mesh_files_are_named_by_absolute_paths(tmp_path):
    (tmp_path / "part.stl").write_bytes(b"solid a\nendsolid a\n")
    path = tmp_path / "r.urdf"
    body = '<visual><geometry><mesh filename="part.stl"/></geometry></visual>'
    bus, _, elbow = two_links()
    path.write_text(robot(bus, link("arm", inside=body), elbow))
    read = formats.read(path)
    assert read.visuals["arm"].visual[0].geometry == Mesh("part.stl", tmp_path / "part.stl")
    (tmp_path / "elsewhere").mkdir()
    again = tmp_path / "elsewhere" / "r.urdf"
    again.write_bytes(document(read, ()))
    assert formats.read(again).visuals["arm"].visual[0].geometry.file == tmp_path / "part.stl"


BOX = '<geometry><box size="1 1 1"/></geometry>'


@pytest.mark.parametrize(
    ("material", "rgba"),
    [
        ("", None),
        ('<material name="unknown"/>', None),
        ('<material name="red"/>', (1.0, 0.0, 0.0, 1.0)),
        ('<material name="red"><color rgba="0 1 0 1"/></material>', (0.0, 1.0, 0.0, 1.0)),
        ('<material name="red"><texture filename="a.png"/></material>', None),
    ],
)
def test_colours_are_the_visuals_own_or_of_the_material_named(material, rgba):
    red = '<material name="red"><color rgba="1 0 0 1"/></material>'
    read = tree(BOX + material, BOX, materials=red)
    assert read.visuals["arm"].visual[0].rgba == rgba
    assert read.visuals["arm"].collision[0].rgba is None


FAULTS = {
    "": "link 'arm' has a .* without a known geometry; give it a box, sphere, cylinder, capsule",
    "<geometry/>": "link 'arm' has a .* without a known geometry",
    "<geometry><cone/></geometry>": "link 'arm' has a .* without a known geometry",
    '<geometry><box size="1 1"/></geometry>': r"<box> of link 'arm' .line 5. has size='1 1'; give",
    '<geometry><sphere radius="nan"/></geometry>': "has radius='nan'; give a finite number",
    "<geometry><cylinder/></geometry>": "<cylinder> of link 'arm' .line 5. has no radius; add",
    '<geometry><mesh filename="a" scale="b"/></geometry>': "has scale='b'; give 3 finite numbers",
    f'<origin xyz="a"/>{BOX}': "<origin> of link 'arm' .line 5. has xyz='a'; give 3 finite",
    f"{ORIGIN}{ORIGIN}{BOX}": "has 2 <origin>; keep one",
}


@pytest.mark.parametrize("text", FAULTS)
def test_faults_do_not_stop_physics_and_are_kept(text, tmp_path):
    """They load without a word, and a written file has them still."""
    read = tree(text or " ", text or " ")
    (tmp_path / "again.urdf").write_bytes(document(read, ()))
    again = formats.read(tmp_path / "again.urdf")
    for shape in (*read.visuals["arm"].visual, *read.visuals["arm"].collision):
        assert isinstance(shape.geometry, Unusable)
        assert re.search(f"robot.urdf: .*{FAULTS[text]}", shape.geometry.problem)
    for shape in (*again.visuals["arm"].visual, *again.visuals["arm"].collision):
        assert isinstance(shape.geometry, Unusable)


def test_a_visual_may_be_flat_a_collision_body_may_not():
    read = tree(
        '<geometry><box size="1 1 0"/></geometry>', '<geometry><box size="1 1 0"/></geometry>'
    )
    assert read.visuals["arm"].visual[0].geometry == Box((1.0, 1.0, 0.0))
    assert "give positive lengths" in read.visuals["arm"].collision[0].geometry.problem


def test_a_colour_with_a_fault_is_one_of_the_shape():
    read = tree(f'{BOX}<material><color rgba="red"/></material>')
    assert "has rgba='red'" in read.visuals["arm"].visual[0].geometry.problem


def test_a_bus_is_drawn_as_its_box():
    shape = Shape(pin.SE3(np.eye(3), np.array([0, 0, 0.1])), Box((1.0, 2.0, 3.0)))
    visuals = sa.Bus(mass=9, size=(1, 2, 3), com=(0, 0, 0.1)).tree().visuals["bus"]
    assert visuals.visual == visuals.collision
    assert visuals.visual[0].geometry == shape.geometry
    assert visuals.visual[0].pose == shape.pose
    assert sa.Bus(mass=9, inertia=np.eye(3)).tree().visuals["bus"].collision == ()
    assert Visuals() == ((), (), False)


def test_links_of_one_name_in_two_robots_keep_their_shapes():
    arm = sa.mount("ur5", sa.mount("ur5", sa.Bus(mass=200, size=(1, 1, 1)), name="a"), name="b")
    mesh = {name: arm.tree.visuals[f"{name}_wrist_1_link"].visual[0].geometry for name in "ab"}
    assert mesh["a"] == mesh["b"]
    assert mesh["a"].file.is_absolute()
