"""MJCF: what MuJoCo makes of it, what is left out, and what is refused."""

import os
import sys
import warnings

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import spacearm as sa
from spacearm.description.readers import mjcf_bounds
from spacearm.description.readers import source as limits
from spacearm.description.shapes import Box, Cylinder, Mesh, Sphere, Unusable

INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
HINGE = '<joint name="{}" axis="0 0 1" range="-90 90"/>'


def mjcf(worldbody, rest="", compiler=""):
    return (
        f'<mujoco model="m"><compiler {compiler}/>{rest}<worldbody>{worldbody}</worldbody></mujoco>'
    )


def free(arm, name="bus", mass=50):
    box = f'<geom type="box" size=".5 .5 .5" mass="{mass}"/>'
    return f'<body name="{name}"><freejoint/>{box}{arm}</body>'


def link(name, joint=None, inside="", pos=".5 0 0", inertial=INERTIAL):
    hinge = HINGE.format(name if joint is None else joint) if joint != "" else ""
    return f'<body name="{name}" pos="{pos}">{hinge}{inertial}{inside}</body>'


def load(text, folder, **options):
    path = folder / "robot.xml"
    path.write_text(text, encoding="utf-8")
    return sa.load(path, **options)


def positions_of(folder):
    """MuJoCo's own model, whose joint positions may be set by name."""
    model = mujoco.MjModel.from_xml_path(str(folder / "robot.xml"))
    return model, mujoco.MjData(model)


def test_defaults_classes_and_geom_inertias_are_those_of_mujoco(tmp_path):
    text = mjcf(
        free('<body name="a" pos="1 0 0"><joint name="a"/><geom class="thick"/></body>'),
        '<default><joint axis="0 1 0" range="-10 20"/><default class="thick">'
        '<geom type="capsule" size=".1 .4" density="100"/></default></default>',
    )
    arm = load(text, tmp_path)
    model, _ = positions_of(tmp_path)
    assert arm.name == "m"
    body = arm.tree.links["a"]
    assert body.mass == pytest.approx(100 * np.pi * 0.01 * (0.8 + 4 / 3 * 0.1), rel=1e-12)
    np.testing.assert_allclose(
        np.diag(body.inertia), model.body("a").inertia, rtol=1e-12, atol=1e-12
    )
    np.testing.assert_allclose([arm.lower[0], arm.upper[0]], np.radians([-10, 20]), atol=1e-12)
    assert tuple(arm.tree.joints["a"].axis) == (0, 1, 0)


def test_reference_angles_and_anchors_are_those_of_mujoco(tmp_path):
    """Joints that turn about a point away from their body, from a reference position on."""
    turned = '<joint name="j" axis="1 2 2" pos=".1 .2 .3" ref="30" range="-90 90"/>'
    slide = '<joint name="s" type="slide" axis="0 1 1" pos="1 1 1" ref=".2"/>'
    inside = f'<body name="b" euler="10 20 30" pos="0 1 0">{slide}{INERTIAL}<site name="e"/></body>'
    text = mjcf(free(f'<body name="a" pos="1 0 0">{turned}{INERTIAL}{inside}</body>'))
    arm = load(text, tmp_path, tip="e", task="position")
    model, data = positions_of(tmp_path)
    for angle, way in ((0.0, 0.0), (0.7, -0.4)):
        data.joint("j").qpos, data.joint("s").qpos = angle, way
        mujoco.mj_kinematics(model, data)
        q = [{"j": angle, "s": way}[name] for name in arm.joint_names]
        np.testing.assert_allclose(arm.at(q).tip.translation, data.site("e").xpos, atol=1e-14)
        np.testing.assert_allclose(arm.at(q).com, com(model, data), atol=1e-14)


def com(model, data):
    mujoco.mj_comPos(model, data)
    return data.subtree_com[1]


def test_several_joints_of_a_body_move_in_a_row(tmp_path):
    joints = (
        '<joint name="x" axis="1 0 0" pos="0 .1 0" range="-1 1"/>'
        '<joint name="y" axis="0 1 0" range="-1 1"/>'
        '<joint name="z" type="slide" axis="0 0 1" range="-1 1"/>'
    )
    text = mjcf(
        free(f'<body name="a" pos="1 0 0">{joints}{INERTIAL}<site name="e" pos="1 0 0"/></body>')
    )
    arm = load(text, tmp_path, tip="e", task="position")
    model, data = positions_of(tmp_path)
    q = dict(zip("xyz", (0.3, -0.8, 0.2), strict=True))
    for name, value in q.items():
        data.joint(name).qpos = value
    mujoco.mj_kinematics(model, data)
    cfg = arm.at([q[name] for name in arm.joint_names])
    np.testing.assert_allclose(cfg.tip.translation, data.site("e").xpos, atol=1e-14)
    np.testing.assert_allclose(cfg.com, com(model, data), atol=1e-14)


def test_a_ball_joint_is_three_hinges_and_says_so(tmp_path):
    ball = f'<body name="a" pos="1 0 0"><joint name="j" type="ball"/>{INERTIAL}</body>'
    with pytest.warns(sa.ModelWarning, match="ball joint j is taken as three hinges"):
        arm = load(mjcf(free(ball)), tmp_path, task="orientation")
    assert set(arm.joint_names) == {"j_x", "j_y", "j_z"}
    assert any("singular configuration" in note for note in arm.notes)
    q = {"j_x": 0.3, "j_y": -0.4, "j_z": 0.5}
    R = arm.at([q[name] for name in arm.joint_names]).tip.rotation
    np.testing.assert_allclose(
        R, Rotation.from_euler("XYZ", [0.3, -0.4, 0.5]).as_matrix(), atol=1e-12
    )


def test_joints_tied_by_an_equality_follow(tmp_path):
    tie = '<equality><joint joint1="b" joint2="a" polycoef=".1 -2 0 0 0"/></equality>'
    text = mjcf(free(link("a", inside=link("b"))), "", "").replace("</mujoco>", tie + "</mujoco>")
    arm = load(text, tmp_path)
    assert arm.joint_names == ("a",)
    assert tuple(arm.tree.joints["b"].mimic) == ("a", -2.0, 0.1)
    held = text.replace('joint2="a" polycoef=".1 -2 0 0 0"', 'polycoef=".1 0 0 0 0"')
    arm = load(held, tmp_path, tip="b")
    assert arm.joint_names == ("a",)
    both = load(held.replace('<joint joint1="b" polycoef=".1 0 0 0 0"/>', ""), tmp_path, tip="b")
    assert arm.at([0.3]).tip.isApprox(both.at([0.3, 0.1]).tip)
    curved = text.replace("-2 0", "-2 .3")
    with pytest.warns(sa.ModelWarning, match="by curves are left out, .* free: b to a"):
        assert load(curved, tmp_path).n == 2
    loop = '<equality><connect body1="b" body2="bus" anchor="0 0 0"/></equality>'
    text = mjcf(free(link("a", inside=link("b")))).replace("</mujoco>", loop + "</mujoco>")
    with pytest.raises(sa.ModelError, match="b to bus: a loop through the spacecraft, at"):
        load(text, tmp_path)
    with pytest.warns(sa.ModelWarning, match="close a loop are left out, the loop open: b to bus"):
        assert load(text, tmp_path, tip="b").n == 2


def test_what_an_arm_does_not_have_is_noted(tmp_path):
    rest = (
        '<default><joint armature=".1"/></default><sensor><jointpos joint="a"/></sensor>'
        '<actuator><motor joint="a"/></actuator><keyframe><key/></keyframe>'
        '<tendon><fixed name="t"><joint joint="a" coef="1"/></fixed></tendon>'
    )
    arm = load(mjcf(free(link("a")), rest), tmp_path)
    said = " ".join(arm.notes)
    for word in ("actuators", "tendons", "sensors", "armature"):
        assert word in said


def test_the_robot_among_several_bodies_is_the_one_with_joints(tmp_path):
    target = '<body name="target"><freejoint/><geom size=".1"/></body>'
    world = f'<geom type="plane" size="1 1 1"/>{target}{free(link("a"))}'
    with pytest.warns(sa.ModelWarning, match="bus is taken as the root.*left out.*target"):
        arm = load(mjcf(world), tmp_path)
    assert (arm.n, arm.mass) == (1, 51.0)
    twice = free(link("a")) + free(link("b"), "bus2")
    with pytest.raises(sa.ModelError, match=r"2 robots of the most joints, 1, .*bus, bus2; name"):
        load(mjcf(twice), tmp_path)
    for tip, bus, other in (("a", "bus", "bus2"), ("b", "bus2", "bus")):
        with pytest.warns(sa.ModelWarning, match=f"{bus} is taken as the root.*left out.*{other}"):
            assert load(mjcf(twice), tmp_path, tip=tip).tree.root == bus


def test_an_arm_without_a_free_joint(tmp_path):
    base = f'<body name="base">{INERTIAL}{link("a")}</body><body name="table">{INERTIAL}</body>'
    arm = load(mjcf(base), tmp_path)
    assert (arm.tree.root, arm.mass) == ("base", 2.0)
    assert any("no free joint" in note and "sa.mount" in note for note in arm.notes)
    on = sa.mount(tmp_path / "robot.xml", sa.Bus(mass=30.0, size=(1, 1, 1)))
    assert (on.n, on.mass) == (1, 32.0)
    load_arm = mjcf(link("a"))
    with pytest.raises(sa.ModelError, match="mass"):
        load(load_arm, tmp_path)
    assert sa.mount(tmp_path / "robot.xml", sa.Bus(mass=30.0, size=(1, 1, 1))).mass == 31.0


def test_props_of_a_scene_are_left_out(tmp_path):
    arm = f'<body name="base">{INERTIAL}{link("a", inside=link("b"))}</body>'
    with pytest.warns(sa.ModelWarning, match="fewer joints than the arm .* left out: door"):
        assert load(mjcf(arm + link("door")), tmp_path).mass == 3.0
    twin = arm.replace('"base"', '"base2"').replace('"a"', '"a2"').replace('"b"', '"b2"')
    both = load(mjcf(arm + twin), tmp_path, tip="b", task="position")
    assert (both.tree.root, both.mass) == ("world", 6.0)


def test_sites_are_frames_and_no_leaves(tmp_path):
    marks = '<site name="p" pos="0 0 1"/><site name="q" pos="0 1 0"/>'
    text = mjcf(free(link("a", inside=marks)))
    assert load(text, tmp_path).tip == "a"
    axes = "".join(f'<site name="{name}" pos="0 0 1"/>' for name in ("a:x", "p_y", "other_z"))
    assert load(text.replace(marks, marks + axes), tmp_path).tree.marks == ("p", "q", "other_z")
    np.testing.assert_allclose(
        load(text, tmp_path, tip="q").at([0.0]).tip.translation, [0.5, 1, 0], atol=1e-12
    )


def test_names_are_made_where_there_are_none(tmp_path):
    inner = (
        f'<body pos="1 0 0"><joint/>{INERTIAL}<body pos="1 0 0"><joint/>{INERTIAL}</body></body>'
    )
    arm = load(mjcf(f"<body><freejoint/>{INERTIAL}{inner}</body>"), tmp_path)
    assert (arm.n, arm.tree.root) == (2, "body_1")


def test_included_files_are_found_beside_the_file(tmp_path):
    (tmp_path / "parts").mkdir()
    for name in ("arm.xml", "robot.xml"):  # the one has the name of the file itself
        (tmp_path / "parts" / name).write_text(f"<mujoco>{link('a')}</mujoco>")
        assert load(mjcf(free(f'<include file="parts/{name}"/>')), tmp_path).joint_names == ("a",)
    with pytest.raises(sa.ModelError, match=r"by MuJoCo .*already included"):
        load(mjcf('<include file="robot.xml"/>'), tmp_path)
    with pytest.raises(
        sa.ModelError, match="has no body; if it is a part of an MJCF load the file"
    ):
        sa.load(tmp_path / "parts" / "arm.xml")


MESH = '<asset><mesh name="m" file="m.stl" scale="2 2 2"/></asset>'


def test_missing_meshes_do_not_stop_a_model(tmp_path):
    text = mjcf(free(link("a", inside='<geom type="mesh" mesh="m" pos="1 0 0"/>')), MESH)
    with pytest.warns(sa.ModelWarning, match=r"meshes not found .physics is not affected.: m\.stl"):
        arm = load(text, tmp_path)
    assert arm.mass == 51.0
    shape = arm.tree.visuals["a"].visual[0]
    assert shape.geometry == Mesh("m.stl", None, (2.0, 2.0, 2.0))
    np.testing.assert_allclose(shape.pose.translation, [1, 0, 0], atol=1e-12)


def test_an_inertia_of_a_missing_mesh_is_unknown_and_said(tmp_path):
    geom = '<geom type="mesh" mesh="m"/>'
    text = mjcf(free(link("a", inside=link("b", "", geom, inertial=""))), MESH)
    with pytest.warns(
        sa.ModelWarning, match="inertia of body 'b' is that of its meshes, and 'm' is missing"
    ):
        arm = load(text, tmp_path)
    assert arm.tree.links["b"] is None
    assert arm.mass == 51.0


def test_an_inertia_of_a_mesh_is_that_of_mujoco(tmp_path):
    """The mesh is off its frame and turned: MuJoCo moves it to its principal axes."""
    solid = trimesh.creation.box((0.2, 0.4, 0.6))
    solid.apply_translation([0.5, 0.1, 0.0])
    solid.apply_transform(trimesh.transformations.euler_matrix(0.3, 0.4, 0.5))
    (tmp_path / "assets").mkdir()
    solid.export(tmp_path / "assets" / "m.stl")
    geom = '<geom type="mesh" mesh="m" pos="0 0 1" euler="0 90 0" density="500"/>'
    text = mjcf(free(link("a", inside=geom, inertial="")), MESH, 'meshdir="assets"')
    arm = load(text, tmp_path)
    body, shape = arm.tree.links["a"], arm.tree.visuals["a"].visual[0]
    assert body.mass == pytest.approx(500 * 0.048 * 8, rel=1e-6)
    middle = shape.pose.act(2.0 * solid.center_mass)
    np.testing.assert_allclose(body.origin.translation, middle, atol=1e-6)
    assert shape.geometry.file == (tmp_path / "assets" / "m.stl").resolve()
    np.testing.assert_allclose(shape.pose.translation, [0, 0, 1], atol=1e-6)


def test_geoms_are_shapes(tmp_path):
    geoms = (
        '<geom type="box" size="1 2 3" rgba="1 0 0 1"/><geom type="sphere" size="1"/>'
        '<geom type="cylinder" size="1 2" group="3"/><geom type="capsule" size="1 2" group="4"/>'
        '<geom type="ellipsoid" size="1 2 3" contype="0" conaffinity="0" material="blue"/>'
    )
    rest = '<asset><texture name="t" type="2d" file="no.png"/><material name="blue" texture="t" '
    text = mjcf(free(link("a", inside=geoms)), rest + 'rgba="0 0 1 1"/></asset>')
    shapes = load(text, tmp_path).tree.visuals["a"]
    drawn = [shape.geometry for shape in shapes.visual]
    assert drawn == [Box((2.0, 4.0, 6.0)), Sphere(1.0), Box((2.0, 4.0, 6.0))]
    assert [shape.rgba for shape in shapes.visual] == [(1, 0, 0, 1), None, (0, 0, 1, 1)]
    solid = [shape.geometry for shape in shapes.collision]
    capsule = [Cylinder(1.0, 4.0), Sphere(1.0), Sphere(1.0)]
    assert solid == [Box((2.0, 4.0, 6.0)), Sphere(1.0), Cylinder(1.0, 4.0), *capsule]


def test_a_mesh_without_a_file_is_not_drawn(tmp_path):
    inline = '<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>'
    text = mjcf(free(link("a", inside='<geom type="mesh" mesh="m"/>')), inline)
    shape = load(text, tmp_path).tree.visuals["a"].visual[0]
    assert isinstance(shape.geometry, Unusable)


BAD = {
    "not MJCF inside": ("<mujoco><body/><worldbdy/></mujoco>", "compiled by MuJoCo .*worldbdy"),
    "no joint": (mjcf(free("")), "no joint can move"),
    "a massless body that moves": (
        mjcf(free('<body name="a"><joint/></body>')),
        "compiled by MuJoCo .*mass and inertia of moving bodies must be larger",
    ),
    "an inertia that nobody has": (
        mjcf(free(link("a", inertial='<inertial pos="0 0 0" mass="1" diaginertia="1 1 3"/>'))),
        "compiled by MuJoCo .*inertia must satisfy A . B >= C",
    ),
    "a class that is a format of printf": (
        mjcf(free(link("a", "", '<geom class="%s%n" size="1"/>'))),
        "<geom> names the class '%s%n'.* without %",
    ),
    "a missing include": (mjcf('<include file="no.xml"/>'), "compiled .*no.xml"),
    "a part": ("<mujocoinclude/>", "is a part of an MJCF; load the file that includes it"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_mjcf_is_refused(case, tmp_path):
    text, message = BAD[case]
    with pytest.raises(sa.ModelError, match=message) as error:
        load(text, tmp_path)
    assert str(error.value).startswith(str(tmp_path / "robot.xml"))
    assert "; " in str(error.value)


NAMED = '<geom class="50%" size="1"/>'


@pytest.mark.parametrize("included", [False, True])
def test_a_class_with_a_percent_sign_that_is_declared_is_read(included, tmp_path):
    declared = '<default><default class="50%"><geom density="100"/></default></default>'
    if included:
        (tmp_path / "part.xml").write_text(f"<mujocoinclude>{declared}</mujocoinclude>")
        declared = '<include file="part.xml"/>'
    arm = load(mjcf(free(link("a", None, NAMED)), declared), tmp_path)
    assert arm.n == 1


@pytest.mark.parametrize(("declared", "named"), [("5% n", "5%\tn"), ("\xe4%n", "&#228;%n")])
def test_a_class_that_mujoco_reads_otherwise_is_not_known(declared, named, tmp_path):
    """MuJoCo keeps tabs, and reads bytes."""
    defaults = f'<default><default class="{declared}"/></default>'
    text = mjcf(free(link("a", None, f'<geom class="{named}" size="1"/>')), defaults)
    with pytest.raises(sa.ModelError, match=r"names the class .* without %"):
        load(text, tmp_path)


def test_a_class_that_one_of_several_files_declares_is_not_known(tmp_path):
    """MuJoCo includes one of them."""
    declared = '<mujocoinclude><default><default class="50%"/></default></mujocoinclude>'
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "part.xml").write_text(declared)
    (tmp_path / "part.xml").write_text("<mujocoinclude/>")
    more = '<compiler assetdir="inner"/><include file="inner/part.xml"/>'
    with pytest.raises(sa.ModelError, match=r"names the class '50%'"):
        load(mjcf(free(link("a", None, NAMED)), more), tmp_path)


def test_mujoco_is_asked_for_where_it_is_missing(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(sa.ModelError, match=r"pip install 'spacearm\[mjcf\]'"):
        load(mjcf(free(link("a"))), tmp_path)


def test_a_urdf_named_xml_is_a_urdf(tmp_path):
    from helpers.arms import robot, two_links

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert load(robot(*two_links()), tmp_path).joint_names == ("elbow",)


# --- work and memory are bounded before they are spent ------------------------------------------

MANY = {
    "a height field": (
        mjcf(free(link("a")), '<asset><hfield name="h" nrow="1000000" ncol="1000000" '
             'size="1 1 1 1"/></asset>'),
        "<hfield> asks for 1e+12 numbers by nrow, ncol; ask for at most 10,000,000",
    ),
    "keys": (mjcf(free(link("a")), '<size nkey="1000000000"/>'), "<size> asks for 1e+09 numbers"),
    "copies": (
        mjcf(free('<replicate count="1e9">' + link("a") + "</replicate>")),
        "asks for more than 100,000 elements",
    ),
    "copies of copies": (
        mjcf(free('<replicate count="100">' * 3 + link("a") + "</replicate>" * 3)),
        "asks for more than 100,000 elements",
    ),
    "a grid": (
        mjcf(free('<flexcomp name="f" type="grid" count="1000 1000 1000"/>' + link("a"))),
        "asks for more than 100,000 elements",
    ),
    "models of itself": (
        mjcf(free(link("a")), '<asset><model name="m" file="robot.xml"/></asset>'),
        "is made of more than 200 files",
    ),
    "an included pipe": (mjcf('<include file="pipe"/>'), "a device or a pipe; name a file"),
    "a pipe of a folder": (
        mjcf(free(link("a")), '<asset><mesh name="m" file="pipe"/></asset>', 'meshdir="sub"'),
        "a device or a pipe; name a file",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", MANY)
def test_what_asks_for_too_much_is_refused_before_it_is_compiled(case, tmp_path, monkeypatch):
    text, message = MANY[case]
    (tmp_path / "sub").mkdir()
    os.mkfifo(tmp_path / "pipe")
    os.mkfifo(tmp_path / "sub" / "pipe")
    monkeypatch.setattr(mujoco.MjSpec, "from_file", None)
    with pytest.raises(sa.ModelError) as caught:
        load(text, tmp_path)
    assert message in str(caught.value)


def test_copies_and_parts_within_the_bounds_are_read(tmp_path):
    (tmp_path / "part.xml").write_text(f"<mujocoinclude>{link('b')}</mujocoinclude>")
    copies = '<replicate count="3" offset="1 0 0"><geom size=".1" mass="1"/></replicate>'
    arm = load(mjcf(free(link("a", inside='<include file="part.xml"/>') + copies)), tmp_path)
    assert arm.n == 2
    assert arm.mass == pytest.approx(55.0)


def many_bodies(n):
    bodies = "".join(
        f'<body name="b{i}" pos="{0.01 * i} 0 1"><joint name="j{i}"/><geom size=".05"/></body>'
        for i in range(n)
    )
    return mjcf(f'<body name="bus"><freejoint/><geom size=".5"/>{bodies}</body>')


@pytest.mark.slow
def test_a_large_file_is_compiled_in_a_process_of_its_own_to_the_same(tmp_path, monkeypatch):
    path = tmp_path / "many.xml"
    path.write_text(many_bodies(700), encoding="utf-8")
    apart = sa.load(path, tip="b3")
    monkeypatch.setattr(mjcf_bounds, "FEW_ELEMENTS", 10_000)
    here = sa.load(path, tip="b3")
    assert apart.notes == here.notes
    assert apart.tree.links.keys() == here.tree.links.keys()
    np.testing.assert_array_equal(apart.at([0.3]).A, here.at([0.3]).A)


@pytest.mark.parametrize("scarce", ["time", "memory"])
def test_what_takes_more_than_its_limits_is_refused(tmp_path, monkeypatch, scarce):
    path = tmp_path / "many.xml"
    path.write_text(many_bodies(700), encoding="utf-8")
    if scarce == "time":
        monkeypatch.setattr(limits, "SECONDS", 0.05)
    else:
        monkeypatch.setenv("SPACEARM_MEMORY", "0.01")
    with pytest.raises(sa.ModelError, match=r"is large, and is not read in.*SPACEARM_MEMORY"):
        sa.load(path)


def test_warnings_of_a_process_of_its_own_are_given_here(tmp_path):
    mesh = '<asset><mesh name="m" file="no.stl"/></asset>'
    text = many_bodies(700).replace("<worldbody>", f"{mesh}<worldbody>")
    text = text.replace('<geom size=".5"/>', f'{INERTIAL}<geom type="mesh" mesh="m"/>')
    (tmp_path / "many.xml").write_text(text, encoding="utf-8")
    with pytest.warns(sa.ModelWarning, match=r"no\.stl"):
        arm = sa.load(tmp_path / "many.xml", tip="b3")
    assert any("no.stl" in note for note in arm.notes)


def test_joints_rest_where_the_keyframe_home_has_them(tmp_path):
    body = '<body name="{0}" pos="1 0 0"><joint name="j_{0}" {1}/><geom size="0.1"/>{2}</body>'
    arm = body.format("a", 'ref="0.5"', body.format("tcp", "", ""))
    text = """<mujoco>
      <worldbody><body name="bus"><freejoint/><geom size="1"/>%s%s</body></worldbody>
      <keyframe><key name="other" qpos="0 0 0 1 0 0 0 9 9 9"/>
      <key name="Home" qpos="0 0 0 1 0 0 0 0.7 -0.4 0.25"/></keyframe></mujoco>"""
    path = tmp_path / "robot.xml"
    path.write_text(text % (arm, body.format("mast", 'type="slide" axis="0 0 1"', "")))
    found = sa.load(path, tip="tcp")
    assert found.home.tolist() == [0.7, -0.4]
    assert found.held == {"j_mast": 0.25}
    path.write_text(path.read_text().replace('name="Home"', 'name="start"'))
    assert sa.load(path, tip="tcp").held == {"j_mast": 0.0}


VELOCITY = '<velocity joint="a" kv="3" gear="{gear}" ctrlrange="{range}"/>'


@pytest.mark.parametrize(
    ("actuators", "limit"),
    [
        (VELOCITY.format(gear="1", range="-2 2"), 2.0),
        (VELOCITY.format(gear="-4", range="-2 3"), 0.5),  # of the motor's shaft
        (VELOCITY.format(gear="1", range="-2 2") + VELOCITY.format(gear="1", range="-1 1"), 1.0),
        ('<intvelocity joint="a" kp="5" kv="1" actrange="-1 1" ctrlrange="-2 2"/>', 2.0),
        (VELOCITY.format(gear="1", range="0 2"), np.inf),
        ('<velocity joint="a" kv="3"/>', np.inf),
        ('<velocity joint="a" kv="3" ctrllimited="false" ctrlrange="-2 2"/>', np.inf),
        ('<motor joint="a" ctrlrange="-2 2"/>', np.inf),
        ('<position joint="a" kp="3" kv="1" ctrlrange="-2 2"/>', np.inf),
        ('<damper joint="a" kv="3" ctrlrange="0 2"/>', np.inf),
    ],
)
def test_velocity_actuators_limit_the_rates_of_joints(tmp_path, actuators, limit):
    arm = load(mjcf(free(link("a")), f"<actuator>{actuators}</actuator>"), tmp_path)
    assert arm.tree.joints["a"].velocity == limit


def test_custom_numbers_limit_rates_before_actuators(tmp_path):
    custom = '<custom><numeric name="velocity_limit/a" data="0.25"/></custom>'
    actuator = f"<actuator>{VELOCITY.format(gear='1', range='-2 2')}</actuator>"
    arm = load(mjcf(free(link("a")), actuator + custom), tmp_path)
    assert arm.tree.joints["a"].velocity == 0.25


@pytest.mark.parametrize("data", ["-1", "0", "1 2"])
def test_custom_numbers_that_are_no_limits(tmp_path, data):
    custom = f'<custom><numeric name="velocity_limit/a" data="{data}"/></custom>'
    with pytest.raises(sa.ModelError, match=r"velocity_limit/a.*largest rate of the joint"):
        load(mjcf(free(link("a")), custom), tmp_path)


@pytest.mark.filterwarnings("ignore:.*MuJoCo warns")
@pytest.mark.parametrize("pos", ["nan 0 0", "NaN 1 1", "1e300 0 0", "0 inf 0"])
def test_places_that_are_none_are_refused_and_mujoco_leaves_no_log(
    pos, tmp_path, monkeypatch, capfd
):
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    arm = free(link("a", inside=link("b"))).replace('pos=".5 0 0"', f'pos="{pos}"')
    with pytest.raises(sa.ModelError, match=r"robot\.xml: "):
        load(mjcf(arm), tmp_path)
    assert not list(folder.iterdir())
    assert capfd.readouterr() == ("", "")
