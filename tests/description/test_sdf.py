"""SDF: frames, worlds, nested models and includes; what is assumed and what is refused."""

import re

import numpy as np
import pinocchio as pin
import pytest
import trimesh

import spacearm as sa
from spacearm.description.shapes import Box, Cylinder, Mesh, Sphere, Unusable

INERTIAL = (
    "<inertial><mass>{}</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial>"
)
LIMIT = "<limit><lower>-1</lower><upper>2</upper></limit>"


def link(name, mass=1.0, pose="0 0 0 0 0 0", inside="", to=""):
    relative = f" relative_to='{to}'" if to else ""
    inertial = INERTIAL.format(mass) if mass is not None else ""
    return f"<link name='{name}'><pose{relative}>{pose}</pose>{inertial}{inside}</link>"


def joint(name, parent, child, kind="revolute", inside="", xyz="0 0 1", pose=""):
    axis = "" if kind in ("fixed", "ball") else f"<axis><xyz>{xyz}</xyz>{LIMIT}</axis>"
    return (
        f"<joint name='{name}' type='{kind}'>{pose}<parent>{parent}</parent>"
        f"<child>{child}</child>{axis}{inside}</joint>"
    )


def model(*parts, name="m", attributes=""):
    return f"<model name='{name}' {attributes}>{''.join(parts)}</model>"


def sdf(inside, version="1.9"):
    return f"<?xml version='1.0'?>\n<sdf version='{version}'>\n{inside}\n</sdf>"


BUS, ARM = link("bus", 50.0), link("arm", pose="1 0 0 0 0 0")
ELBOW = joint("elbow", "bus", "arm")


def load(text, folder, **options):
    path = folder / "robot.sdf"
    path.write_text(text, encoding="utf-8")
    return sa.load(path, **options)


def tip_at(arm, q):
    return arm.at(np.atleast_1d(q)).tip.translation


def test_a_model(tmp_path):
    arm = load(sdf(model(BUS, ARM, ELBOW)), tmp_path)
    assert (arm.name, arm.n, arm.mass, arm.tip) == ("m", 1, 51.0, "arm")
    assert (arm.lower[0], arm.upper[0]) == (-1.0, 2.0)
    assert np.isinf(arm.tree.joints["elbow"].velocity)


def test_axes_are_in_the_frame_of_the_joint_unless_another_is_named(tmp_path):
    turned = link("arm", pose="1 0 0 1.5707963267948966 0 0")
    axes = {
        ("1.9", ""): [0, 0, 1],
        ("1.9", " expressed_in='bus'"): [0, 1, 0],
        ("1.9", " expressed_in='__model__'"): [0, 1, 0],
        ("1.5", ""): [0, 0, 1],
        ("1.4", ""): [0, 1, 0],
    }
    for (version, given), axis in axes.items():
        text = sdf(model(BUS, turned, ELBOW.replace("<xyz>", f"<xyz{given}>")), version)
        np.testing.assert_allclose(
            load(text, tmp_path).tree.joints["elbow"].axis,
            axis,
            atol=1e-15,
            err_msg=version + given,
        )


def test_degrees_and_quaternions(tmp_path):
    wanted = [1.0, 2.0, 1.0]
    for pose in (
        "<pose degrees='true'>0 0 0 0 0 90</pose>",
        "<pose rotation_format='quat_xyzw'>0 0 0  0 0 0.7071067811865476 0.7071067811865476</pose>",
    ):
        arm = link("arm", inside=f"<visual name='v'>{pose}</visual>").replace(
            "<pose>0 0 0 0 0 0</pose>", pose.replace("0 0 0 ", "1 1 1 ", 1), 1
        )
        end = link("end", 0.0, "1 0 0 0 0 0", to="arm").replace(
            "<mass>0.0</mass><inertia>", "<mass>0</mass><unused>"
        )
        end = end.replace("</inertia>", "</unused>")
        text = sdf(model(BUS, arm, end, ELBOW, joint("bolt", "arm", "end", "fixed")))
        np.testing.assert_allclose(tip_at(load(text, tmp_path), 0.0), wanted, atol=1e-12)


def test_a_link_away_from_its_joint_turns_about_the_joint(tmp_path):
    pose = "<pose relative_to='bus'>0.5 0 0 0 0 0</pose>"
    arm = load(sdf(model(BUS, ARM, joint("elbow", "bus", "arm", pose=pose))), tmp_path)
    np.testing.assert_allclose(tip_at(arm, np.pi / 2), [0.5, 0.5, 0.0], atol=1e-15)


def test_frames_are_attached_and_placed(tmp_path):
    frames = (
        "<frame name='a' attached_to='arm'><pose>1 0 0 0 0 0</pose></frame>"
        "<frame name='b' attached_to='a'><pose relative_to='bus'>5 0 0 0 0 0</pose></frame>"
    )
    text = sdf(model(BUS, ARM, ELBOW, frames))
    for tip, x in (("a", 2.0), ("b", 5.0)):
        arm = load(text, tmp_path, tip=tip)
        np.testing.assert_allclose(tip_at(arm, 0.0), [x, 0, 0], atol=1e-15)
        np.testing.assert_allclose(tip_at(arm, np.pi / 2), [1, x - 1, 0], atol=1e-15)
    assert load(text, tmp_path).tip == "arm"


def test_a_world_is_unwrapped(tmp_path):
    ground = model(link("ground"), name="ground", attributes="static='true'")
    robot = model(BUS, ARM, ELBOW, name="robot")
    with pytest.warns(sa.ModelWarning, match="robot::bus is taken as the root.*ground::ground"):
        arm = load(sdf(f"<world name='w'>{ground}{robot}</world>"), tmp_path)
    assert (arm.name, arm.tree.root, arm.joint_names) == ("robot", "bus", ("elbow",))
    two = model(BUS, ARM, ELBOW, name="other")
    with pytest.raises(sa.ModelError, match=r"2 robots of the most joints.*robot::bus, other::bus"):
        load(sdf(f"<world name='w'>{robot}{two}</world>"), tmp_path)
    for tip in ("other::arm", "arm"):
        with pytest.warns(sa.ModelWarning, match="is taken as the root of the robot; left out"):
            arm = load(sdf(f"<world name='w'>{robot}{two}</world>"), tmp_path, tip=tip)
        assert arm.name == ("other" if "::" in tip else "robot")


def test_nested_models_are_parts(tmp_path):
    """Poses of models, a joint into one, and a frame that places it."""
    tool = model(
        link("base", pose="0 0 1 0 0 0"),
        link("jaw", pose="0 0 2 0 0 0"),
        joint("grip", "base", "jaw"),
        "<pose relative_to='arm'>0 1 0 0 0 0</pose>",
        name="tool",
    )
    bolt = joint("bolt", "arm", "tool::base", "fixed")
    arm = load(sdf(model(BUS, ARM, ELBOW, tool, bolt)), tmp_path, tip="tool::jaw", task="position")
    assert set(arm.joint_names) == {"elbow", "tool::grip"}
    np.testing.assert_allclose(tip_at(arm, [0, 0]), [1, 1, 2], atol=1e-15)
    placed = tool.replace("name='tool' ", "name='tool' placement_frame='base'")
    arm = load(
        sdf(model(BUS, ARM, ELBOW, placed, bolt)), tmp_path, tip="tool::jaw", task="position"
    )
    np.testing.assert_allclose(tip_at(arm, [0, 0]), [1, 1, 1], atol=1e-15)
    to_model = bolt.replace("tool::base", "tool")
    assert load(sdf(model(BUS, ARM, ELBOW, tool, to_model)), tmp_path, tip="tool::jaw").n == 2


def test_includes_are_found(tmp_path, monkeypatch):
    models, here = tmp_path / "else" / "where" / "models", tmp_path / "robot"
    folder = models / "my_arm"
    folder.mkdir(parents=True)
    (here / ".git").mkdir(parents=True)  # what is around a file ends with its repository
    (folder / "model.config").write_text("<model><sdf version='1.9'>arm.sdf</sdf></model>")
    (folder / "arm.sdf").write_text(
        sdf(model(ARM, link("hand", pose="2 0 0 0 0 0"), joint("wrist", "arm", "hand")))
    )
    include = (
        "<include><uri>model://my_arm</uri><name>left</name><pose>0 0 3 0 0 0</pose></include>"
    )
    text = sdf(model(BUS, include, joint("elbow", "bus", "left::arm")))
    with pytest.raises(
        sa.ModelError, match=r"'model://my_arm' .line 3. is not found; name the folder"
    ):
        load(text, here)
    arm = load(text, here, packages=models)
    assert set(arm.joint_names) == {"elbow", "left::wrist"}
    np.testing.assert_allclose(tip_at(arm, [0, 0]), [2, 0, 3], atol=1e-15)
    monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", str(models))
    assert load(text, here).n == 2
    assert load(text.replace("model://", ""), here).n == 2
    merged = text.replace("<include>", "<include merge='true'>").replace("left::", "")
    assert set(load(merged, here).joint_names) == {"elbow", "wrist"}
    ring = sdf(model(BUS, include))
    (folder / "arm.sdf").write_text(ring)
    with pytest.raises(sa.ModelError, match="more than 20 deep"):
        load(text, here)


def test_a_world_leaves_out_what_it_cannot_include(tmp_path):
    robot = model(BUS, ARM, ELBOW)
    include = "<include><uri>https://fuel.gazebosim.org/1.0/o/models/sun</uri></include>"
    with pytest.warns(sa.ModelWarning, match=r"sun.*is not found: left out"):
        assert load(sdf(f"<world name='w'>{include}{robot}</world>"), tmp_path).n == 1


def test_a_joint_to_the_world(tmp_path):
    held = joint("hold", "world", "bus", "fixed")
    arm = load(sdf(model(BUS, ARM, ELBOW, held)), tmp_path)
    assert arm.mass == 51.0
    assert any("fixed to the world" in note and "sa.mount" in note for note in arm.notes)
    moves = sdf(model(BUS, ARM, ELBOW, joint("turn", "world", "bus")))
    with pytest.raises(sa.ModelError, match=r"'world'.*no mass"):
        load(moves, tmp_path)
    on = sa.mount(tmp_path / "robot.sdf", sa.Bus(mass=9.0, size=(1, 1, 1)))
    assert (on.n, on.mass) == (2, 60.0)


def test_universal_and_ball_joints_are_rows_of_hinges(tmp_path):
    second = f"<axis2><xyz>0 1 0</xyz>{LIMIT}</axis2>"
    arm = load(sdf(model(BUS, ARM, joint("u", "bus", "arm", "universal", second))), tmp_path)
    assert set(arm.joint_names) == {"u_axis", "u_axis2"}
    q = {"u_axis": 0.4, "u_axis2": -0.3}
    R = arm.at([q[name] for name in arm.joint_names]).tip.rotation
    np.testing.assert_allclose(
        R, pin.utils.rotate("z", 0.4) @ pin.utils.rotate("y", -0.3), atol=1e-12
    )
    with pytest.warns(sa.ModelWarning, match="ball joint b is taken as three hinges"):
        arm = load(sdf(model(BUS, ARM, joint("b", "bus", "arm", "ball"))), tmp_path)
    assert set(arm.joint_names) == {"b_x", "b_y", "b_z"}


@pytest.mark.parametrize(
    ("pitch", "advance"),
    [
        ("<screw_thread_pitch>0.05</screw_thread_pitch>", 0.05),
        (f"<thread_pitch>{-2 * np.pi / 0.05}</thread_pitch>", 0.05),
        ("", 1.0),
    ],
)
def test_a_screw_advances_as_it_turns(pitch, advance, tmp_path):
    """By its pitch a turn along its axis, as a right-handed thread."""
    arm = load(sdf(model(BUS, ARM, elbow(pitch, "screw"))), tmp_path)
    assert arm.joint_names == ("elbow",)
    assert (arm.lower[0], arm.upper[0]) == (-1.0, 2.0)
    moved = arm.whole.joints["elbow"].motion(0.5)
    here, there = (arm.at([angle]).tip for angle in (0.0, 0.5))
    np.testing.assert_allclose(there.rotation, moved.rotation, atol=1e-15)
    np.testing.assert_allclose(
        there.translation - here.translation, (0, 0, advance * 0.5 / (2 * np.pi)), atol=1e-14
    )


def test_automatic_inertias_are_those_of_the_collision_shapes(tmp_path):
    """At the density of each, else of the link, else 1000 kg/m^3; in proportion to a mass given."""

    def made(size, density="", at="0 0 0"):
        pose, box = f"<pose>{at} 0 0 0</pose>", f"<box><size>{size}</size></box>"
        given = f"<density>{density}</density>" if density else ""
        return f"<collision name='{size}'>{given}{pose}<geometry>{box}</geometry></collision>"

    def body(inside, auto="", **options):
        inertial = f"<inertial auto='true'>{auto}</inertial>"
        part = f"<link name='arm'><pose>1 0 0 0 0 0</pose>{inertial}{inside}</link>"
        text = sdf(model(BUS, part, ELBOW), "1.11")
        return load(text, tmp_path, task="x y", **options).tree.links["arm"]

    one = body(made("0.1 0.2 0.3"))
    assert one.mass == pytest.approx(6.0)
    wanted = 6.0 / 12.0 * np.diag([0.13, 0.10, 0.05])
    np.testing.assert_allclose(one.inertia, wanted, rtol=1e-12, atol=1e-15)
    half = body(made("0.1 0.2 0.3"), "<density>500</density>")
    np.testing.assert_allclose(half.inertia, 0.5 * wanted, rtol=1e-12, atol=1e-15)
    heavy = body(made("0.1 0.2 0.3"), "<density>500</density><mass>12</mass>")
    np.testing.assert_allclose(heavy.inertia, 2.0 * wanted, rtol=1e-12, atol=1e-15)
    two = body(made("1 1 1", "1") + made("1 1 1 ", "3", "1 0 0"), "<density>7</density>")
    assert two.mass == pytest.approx(4.0)
    np.testing.assert_allclose(two.origin.translation, (0.75, 0, 0), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(
        two.inertia, np.diag([1, 1, 1]) * 4 / 6 + np.diag([0, 0.75, 0.75]), rtol=1e-12, atol=1e-15
    )
    text = trimesh.creation.box((0.1, 0.2, 0.3)).export(file_type="dae")
    (tmp_path / "box.dae").write_bytes(re.sub(rb"[XYZ]_UP", b"Y_UP", text))
    mesh = "<collision name='c'><geometry><mesh><uri>box.dae</uri></mesh></geometry></collision>"
    for up_axes, order in ((False, [0, 1, 2]), (True, [0, 2, 1])):
        moments = np.diag(body(mesh, up_axes=up_axes).inertia)
        np.testing.assert_allclose(moments, np.diag(wanted)[order], rtol=1e-6, atol=1e-9)
    said = pytest.warns(sa.ModelWarning, match="'arm' has <inertial auto='true'> and no collision")
    with said, pytest.raises(sa.ModelError, match="no movable link has mass"):
        body("<collision name='c'><geometry><plane/></geometry></collision>")


def test_joints_of_old_files_may_have_the_names_of_links(tmp_path):
    parts = (BUS, ARM, joint("arm", "bus", "arm"), "<frame name='bus'/>")
    arm = load(sdf(model(*parts), "1.6"), tmp_path)
    assert arm.joint_names == ("arm_joint",)
    assert "bus_frame" in arm.tree.links


def test_limits_that_are_none(tmp_path):
    big = "<limit><lower>-1e16</lower><upper>1e+16</upper><effort>-1</effort>"
    big += "<velocity>-1</velocity></limit>"
    for limit, kind in (
        (big, "continuous"),
        ("", "continuous"),
        (big.replace("1e16", "inf").replace("1e+16", "inf"), "continuous"),
    ):
        arm = load(sdf(model(BUS, ARM, ELBOW.replace(LIMIT, limit))), tmp_path)
        one = arm.tree.joints["elbow"]
        assert (one.kind, one.lower, one.upper) == (kind, -np.inf, np.inf)
        assert (one.velocity, one.effort) == (np.inf, np.inf)


def test_zero_rates_and_efforts_are_none_and_noted(tmp_path):
    limit = "<limit><effort>0</effort><velocity>0</velocity></limit>"
    arm = load(sdf(model(BUS, ARM, ELBOW.replace(LIMIT, limit))), tmp_path)
    assert arm.tree.joints["elbow"].velocity == arm.tree.joints["elbow"].effort == np.inf
    assert "effort limit of 'elbow' is zero: taken as none" in arm.notes


def test_defaults_of_inertials_are_those_of_sdformat_and_said(tmp_path):
    with pytest.warns(sa.ModelWarning, match="link 'arm' has no <inertial>: 1 kg and 1 kg m"):
        arm = load(sdf(model(BUS, link("arm", None, "1 0 0 0 0 0"), ELBOW)), tmp_path)
    assert arm.mass == 51.0
    np.testing.assert_array_equal(arm.tree.links["arm"].inertia, np.eye(3))


def test_shapes(tmp_path):
    kinds = {
        "<box><size>1 2 3</size></box>": Box((1.0, 2.0, 3.0)),
        "<sphere><radius>2</radius></sphere>": Sphere(2.0),
        "<cylinder><radius>1</radius><length>2</length></cylinder>": Cylinder(1.0, 2.0),
        "<ellipsoid><radii>1 2 3</radii></ellipsoid>": Box((2.0, 4.0, 6.0)),
        "<mesh><uri>model://no/m.dae</uri></mesh>": Mesh("model://no/m.dae", None),
    }
    inside = "".join(
        f"<visual name='v{i}'><pose>0 0 {i} 0 0 0</pose><geometry>{kind}</geometry>"
        "<material><diffuse>1 0 0 1</diffuse></material></visual>"
        for i, kind in enumerate(kinds)
    )
    odd = "<collision name='c'><geometry><heightmap/></geometry></collision>"
    with pytest.warns(sa.ModelWarning, match=r"meshes not found .*model://no/m\.dae"):
        arm = load(sdf(model(BUS, link("arm", inside=inside + odd), ELBOW)), tmp_path, task="x y")
    shapes = arm.tree.visuals["arm"]
    assert [shape.geometry for shape in shapes.visual] == list(kinds.values())
    assert [shape.pose.translation[2] for shape in shapes.visual] == [0, 1, 2, 3, 4]
    assert {shape.rgba for shape in shapes.visual} == {(1.0, 0.0, 0.0, 1.0)}
    assert isinstance(shapes.collision[0].geometry, Unusable)


def elbow(inside="", kind="revolute", parent="bus", child="arm"):
    return joint("elbow", parent, child, kind, inside)


FRAMES = [f'<frame name="f{i}" attached_to="f{i + 1}"/>' for i in range(1500)]
FRAMES.append('<frame name="f1500" attached_to="arm"/>')
RING = [
    f'<frame name="f{i}" attached_to="arm"><pose relative_to="f{(i - 1) % 90}"/></frame>'
    for i in range(90)
]


URDF = """<robot name="arm"><link name="base"/><link name="part"><inertial><mass value="2"/>
<inertia ixx="1" iyy="1" izz="1"/></inertial></link><joint name="turn" type="continuous">
<origin xyz="0.5 0 0" rpy="0 0 1"/><parent link="base"/><child link="part"/>
<axis xyz="0 1 0"/></joint><link name="hand"/>
<joint name="bolt" type="fixed"><parent link="part"/><child link="hand"/>
<origin xyz="0 0 0.25"/></joint></robot>"""


def test_an_included_urdf_is_a_nested_model(tmp_path):
    """As the same arm mounted where the <include> places it."""
    (tmp_path / "arm.urdf").write_text(URDF)
    include = "<include><uri>arm.urdf</uri><name>left</name><pose>0 0 3 0.3 0 0</pose></include>"
    bolt = joint("bolt", "arm", "left::base", "fixed")
    arm = load(sdf(model(BUS, ARM, ELBOW, include, bolt)), tmp_path)
    assert (arm.joint_names, arm.tip) == (("elbow", "left::turn"), "left::hand")
    at = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0, 0), np.array([0.0, 0.0, 3.0]))
    at *= pin.SE3(pin.rpy.rpyToMatrix(0, 0, 1), np.array([0.5, 0.0, 0.0]))
    at *= pin.SE3(pin.utils.rotate("y", 0.4), np.zeros(3)).act(
        pin.SE3(np.eye(3), np.array([0, 0, 0.25]))
    )
    turned = pin.SE3(pin.utils.rotate("z", 0.2), np.array([1.0, 0, 0])) * pin.SE3(
        np.eye(3), np.array([-1.0, 0, 0])
    )
    np.testing.assert_allclose(arm.at([0.2, 0.4]).tip, turned * at, atol=1e-14)
    assert arm.mass == 53.0
    placed = include.replace("<pose>", "<placement_frame>hand</placement_frame><pose>")
    arm = load(sdf(model(BUS, ARM, ELBOW, placed, bolt)), tmp_path)
    np.testing.assert_allclose(tip_at(arm, [0, 0]), [0, 0, 3], atol=1e-14)


@pytest.mark.parametrize("heaviest", [0, 2, 4])
def test_joints_that_lead_both_ways_hang_on_the_heaviest_root(heaviest, tmp_path):
    """Of a row of five bodies, every other one a root."""
    rng = np.random.default_rng(heaviest)
    bodies = [
        link(f"b{i}", 90.0 if i == heaviest else 1.0 + i, " ".join(map(str, rng.normal(size=6))))
        for i in range(5)
    ]
    ends = [(0, 1), (2, 1), (2, 3), (4, 3)]
    at = [f"<pose relative_to='b{max(ends)}'>0.1 0 0.2 0.3 0 0</pose>" for ends in ends]
    rows = [joint(f"j{i}", f"b{a}", f"b{b}", pose=at[i]) for i, (a, b) in enumerate(ends)]
    ordered = [(a, b) if abs(b - heaviest) > abs(a - heaviest) else (b, a) for a, b in ends]
    wanted = [joint(f"j{i}", f"b{a}", f"b{b}", pose=at[i]) for i, (a, b) in enumerate(ordered)]
    tip = "b0" if heaviest == 4 else "b4"
    arm, same = (
        load(sdf(model(*bodies, *x)), tmp_path, tip=tip, joints="all") for x in (rows, wanted)
    )
    assert arm.tree.root == same.tree.root == f"b{heaviest}"
    sign = {f"j{i}": 1 if ends[i] == ordered[i] else -1 for i in range(4)}
    q = {name: rng.uniform(-0.9, 0.9) for name in arm.joint_names}
    cfg = arm.at(list(q.values()))
    other = same.at([sign[name] * q[name] for name in same.joint_names])
    np.testing.assert_allclose(cfg.tip, other.tip, atol=1e-13)
    np.testing.assert_allclose(
        sa.generalized_jacobian(cfg),
        sa.generalized_jacobian(other)
        @ np.array([[(n == m) * sign[n] for m in arm.joint_names] for n in same.joint_names]),
        atol=1e-12,
    )


def test_what_is_wrong_in_an_included_file_is_said_of_it(tmp_path):
    (folder := tmp_path / "tool").mkdir()
    (folder / "tool.stl").write_bytes(b"solid a\nendsolid a\n")
    mesh = "<mesh><uri>tool.stl</uri></mesh>"
    hand = link("hand", inside=f"<visual name='v'><geometry>{mesh}</geometry></visual>")
    (folder / "tool.sdf").write_text(sdf(f"\n\n{model(hand, name='t')}"))
    include = "<include><uri>tool/tool.sdf</uri></include>"
    text = sdf(model(BUS, ARM, ELBOW, include, joint("bolt", "arm", "t::hand", "fixed")))
    shape = load(text, tmp_path).tree.visuals["t::hand"].visual[0].geometry
    assert shape.file == folder / "tool.stl"
    (folder / "tool.sdf").write_text(sdf(f"\n\n{model(hand, hand, name='t')}"))
    with pytest.raises(
        sa.ModelError, match=r"robot.sdf: two links are named 'hand' .line 5 of tool/tool.sdf"
    ):
        load(text, tmp_path)


def drake(kind, parent="bus", child="arm"):
    return (
        f"<drake:joint name='free' type='{kind}'><drake:parent>{parent}</drake:parent>"
        f"<drake:child>{child}</drake:child></drake:joint>"
    )


@pytest.mark.parametrize("space", ["", " xmlns:drake='http://drake.mit.edu'"])
def test_planar_joints_of_drake_are_two_slides_and_a_hinge(space, tmp_path):
    """In the axes of the parent, and the floating base below the world."""
    turned = link("arm", pose="1 0 0 0.5 0 0")
    text = sdf(model(BUS, turned, drake("planar"), attributes=space))
    arm = load(text, tmp_path)
    assert arm.joint_names == ("free_x", "free_y", "free_z")
    moved = arm.at([0.3, -0.2, 0.7]).tip
    tilted = pin.SE3(pin.rpy.rpyToMatrix(0.5, 0, 0), np.array([1.0, 0, 0]))
    planar = pin.SE3(pin.utils.rotate("z", 0.7), np.array([0.3, -0.2, 0.0]))
    np.testing.assert_allclose(moved, tilted * planar, atol=1e-15)
    with pytest.warns(sa.ModelWarning, match="'free' of type 'planar' is left out: 'bus' floats"):
        base = load(sdf(model(BUS, ARM, ELBOW, drake("planar", "world", "bus"))), tmp_path)
    assert (base.n, base.mass) == (1, 51.0)


@pytest.mark.parametrize("kind", ["quaternion_floating", "rpy_floating", "floating"])
def test_what_floats_is_not_joined(kind, tmp_path):
    with pytest.warns(sa.ModelWarning, match="'free' of type.* is left out: 'bus' floats by"):
        arm = load(sdf(model(BUS, ARM, ELBOW, drake(kind, "world", "bus"))), tmp_path)
    assert (arm.n, arm.mass) == (1, 51.0)


def test_constraints_of_drake_are_left_out_and_said(tmp_path):
    tie = "<drake:ball_constraint><drake:ball_constraint_body_A>bus</drake:ball_constraint_body_A>"
    with pytest.warns(sa.ModelWarning, match=r"<drake:ball_constraint> .line 3. is left out"):
        assert load(sdf(model(BUS, ARM, ELBOW, f"{tie}</drake:ball_constraint>")), tmp_path).n == 1


def test_mimic_joints_of_drake_follow(tmp_path):
    follows = "<drake:mimic joint='elbow' multiplier='-2' offset='0.1'/>"
    hand = link("hand", pose="2 0 0 0 0 0")
    wrist = joint("wrist", "arm", "hand", inside=follows)
    arm = load(sdf(model(BUS, ARM, hand, ELBOW, wrist)), tmp_path)
    mimic = arm.whole.joints["wrist"].mimic
    assert (arm.n, mimic) == (1, ("elbow", -2.0, 0.1))


def gearbox(axes, parent="bus", child="arm", reference="bus", ratio=4.0):
    return (
        f"<joint name='gears' type='gearbox'><parent>{parent}</parent><child>{child}</child>{axes}"
        f"<gearbox_reference_body>{reference}</gearbox_reference_body>"
        f"<gearbox_ratio>{ratio}</gearbox_ratio></joint>"
    )


def geared(axes, spin="", elbow="", ends=("rotor", "arm"), ratio=4.0):
    """A bus with a rotor and an arm on hinges of their own, coupled by a gearbox."""
    hinges = [
        joint(name, "bus", end).replace(LIMIT, LIMIT + more)
        for name, end, more in (("spin", "rotor", spin), ("elbow", "arm", elbow))
    ]
    return model(BUS, ARM, link("rotor", 0.5), *hinges, gearbox(axes, *ends, ratio=ratio))


def test_a_joint_from_a_body_to_the_robot_carries_it(tmp_path):
    """Turned about the same axis, the other way; beside what is fixed between."""
    bodies = (BUS, ARM, link("hand", 2.0, "2 0 0 0.3 0 0"), link("palm", 0.5, "2 0 0.5 0 0.2 0"))
    at = "<pose relative_to='hand'>-0.3 0 0.1 0 0.4 0</pose>"
    there = joint("bolt", "palm", "hand", "fixed")
    back = joint("wrist", "hand", "arm", pose=at)
    arm = load(sdf(model(*bodies, ELBOW, there, back)), tmp_path, tip="palm")
    wanted = [joint("bolt", "hand", "palm", "fixed"), joint("wrist", "arm", "hand", pose=at)]
    same = load(sdf(model(*bodies, ELBOW, *wanted)), tmp_path, tip="palm")
    assert arm.joint_names == same.joint_names == ("elbow", "wrist")
    cfg, other = arm.at([0.4, 0.9]), same.at([0.4, -0.9])
    np.testing.assert_allclose(cfg.tip, other.tip, atol=1e-14)
    np.testing.assert_allclose(
        sa.generalized_jacobian(cfg), sa.generalized_jacobian(other) * [1, -1], atol=1e-13
    )


@pytest.mark.parametrize(("axis", "sign"), [("", -1), ("<xyz>0 0 -1</xyz>", 1)])
@pytest.mark.parametrize("rotor_first", [True, False])
def test_a_gearbox_couples_the_hinges_of_its_links(axis, sign, rotor_first, tmp_path):
    """By theta_2 = -ratio theta_1, whichever of them leads: the one of the arm does."""
    hand, wrist = link("hand", pose="2 0 0 0 0 0"), joint("wrist", "arm", "hand")
    ends = ("rotor", "arm") if rotor_first else ("arm", "rotor")
    text = geared(f"<axis>{axis}</axis><axis2/>", ends=ends)
    arm = load(sdf(text.replace("</model>", f"{hand}{wrist}</model>")), tmp_path)
    assert arm.joint_names == ("elbow", "wrist")
    mimic = arm.whole.joints["spin"].mimic
    assert mimic == ("elbow", sign * (1 / 4.0 if rotor_first else 4.0), 0.0)


BAD = {
    "two models": (sdf(model(BUS) + model(ARM)), "0 <world> and 2 <model> below <sdf>; keep one"),
    "nothing": (sdf(""), "0 <world> and 0 <model> below <sdf>; it needs one"),
    "no links": (sdf(model()), "has no links"),
    "no joints": (sdf(model(BUS)), "no joint can move"),
    "a version that is none": (sdf(model(BUS), "new"), "has version='new'"),
    "an unknown parent": (sdf(model(BUS, ARM, elbow(parent="buss"))), "unknown frame 'buss'.*bus"),
    "an unknown child": (sdf(model(BUS, ARM, elbow(child="am"))), "unknown frame 'am'.*arm"),
    "no parent": (
        sdf(model(BUS, ARM, ELBOW.replace("<parent>bus</parent>", ""))),
        "joint 'elbow' has no <parent>; add",
    ),
    "an unknown type": (
        sdf(model(BUS, ARM, elbow(kind="hinge"))),
        "'elbow' .line 3. has type 'hinge'; use",
    ),
    "a gearbox without hinges": (
        sdf(model(BUS, ARM, ELBOW, gearbox("<axis/><axis2/>"))),
        "joint 'gears' .line 3. couples the turns of 'bus' and 'arm' beside 'bus', which no hinge "
        "joins; join each to it by one revolute joint",
    ),
    "a gearbox across its hinges": (
        sdf(geared("<axis><xyz>1 0 0</xyz></axis><axis2/>")),
        "joint 'gears' .line 3. has an <axis> along which 'spin' does not turn; give it that of",
    ),
    "a gearbox without a reference": (
        sdf(geared("<axis/><axis2/>").replace("gearbox_reference_body", "reference")),
        "joint 'gears' has no <gearbox_reference_body>; add <gearbox_reference_body>LINK<",
    ),
    "a gearbox of two coupled wheels": (
        sdf(geared("<axis/><axis2/>", "<mimic joint='spin'/>", "<mimic joint='elbow'/>")),
        "joint 'gears' .line 3. couples 'elbow' and 'spin', .* mimic others; remove",
    ),
    "a URDF that is a xacro source": (
        sdf(model(BUS, ARM, ELBOW, "<include><uri>arm.urdf.xacro</uri></include>")),
        "'arm.urdf.xacro' .line 3. means .*arm.urdf.xacro, a xacro source; expand it first",
    ),
    "a URDF that is merged": (
        sdf(model(BUS, ARM, ELBOW, "<include merge='1'><uri>arm.urdf</uri></include>")),
        "'arm.urdf' .line 3. merges a URDF; leave out merge=",
    ),
    "a curve of drake's": (
        sdf(model(BUS, ARM, drake("curvilinear"))),
        "joint 'free' .line 3. has type 'curvilinear'; use one of fixed, rev",
    ),
    "a loop of joints": (
        sdf(model(BUS, ARM, ELBOW, joint("again", "bus", "arm"))),
        "again: a loop inside one arm, at link 'arm",
    ),
    "a loop of joints away from their links": (
        sdf(
            model(
                BUS,
                ARM,
                joint("one", "bus", "arm", pose="<pose>1 0 0 0 0 0</pose>"),
                joint("two", "bus", "arm", pose="<pose>0 1 0 0 0 0</pose>"),
            )
        ),
        "two: a loop inside one arm, at link 'arm",
    ),
    "a ring": (
        sdf(model(BUS, ARM, link("c"), joint("j", "arm", "c"), joint("k", "c", "arm"))),
        "arm, c form a loop",
    ),
    "a joint to itself": (
        sdf(model(BUS, ARM, elbow(child="bus"))),
        "line 3. leads from 'bus' to 'bus'",
    ),
    "a joint to its own frame": (
        sdf(model(BUS, ARM, ELBOW, joint("own", "bus", "own", "fixed"))),
        "joint 'own' .line 3. leads from 'bus' to 'own'; exchange or rename them",
    ),
    "poses in a ring": (
        sdf(model(BUS, link("arm", to="c"), link("c", to="arm"), ELBOW)),
        "has a pose relative to itself",
    ),
    "frames without end": (
        sdf(model(BUS, ARM, ELBOW, *FRAMES)),
        "'f0' .line 3. is placed by way of more than 1,000 frames; give the pose relative",
    ),
    "a ring of many frames": (
        sdf(model(BUS, ARM, ELBOW, *RING)),
        "pose relative to itself, by way of f0, f89, .* and 80 more; cut that loop",
    ),
    "an unknown frame": (sdf(model(BUS, link("arm", to="amr"), ELBOW)), "unknown frame 'amr'"),
    "five numbers": (sdf(model(BUS, link("arm", pose="1 2 3 4 5"), ELBOW)), "6 finite numbers"),
    "words": (sdf(model(BUS, link("arm", pose="a 0 0 0 0 0"), ELBOW)), "6 finite numbers"),
    "NaN in a mass": (sdf(model(link("bus", "nan"), ARM, ELBOW)), "<mass>='nan'; give a finite"),
    "a negative mass": (
        sdf(model(BUS, link("arm", -1.0), ELBOW)),
        "'arm' is -1 kg; give a positive",
    ),
    "a zero axis": (
        sdf(model(BUS, ARM, joint("elbow", "bus", "arm", xyz="0 0 0"))),
        "line 3. has a zero",
    ),
    "reversed limits": (
        sdf(model(BUS, ARM, ELBOW.replace(">-1<", ">9<"))),
        "<limit> of joint 'elbow' is reversed .lower 9, upper 2.; exchange",
    ),
    "a limit that is no number": (
        sdf(model(BUS, ARM, ELBOW.replace(">-1<", ">low<"))),
        "<lower> of joint 'elbow'.*'low'; give a number",
    ),
    "two links of a name": (sdf(model(BUS, BUS)), "two links are named 'bus'"),
    "a joint named as a link": (
        sdf(model(BUS, ARM, joint("arm", "bus", "arm"))),
        "two frames, links, joints or models are named 'arm'",
    ),
    "two models of a name": (
        sdf(f"<world name='w'>{model(BUS)}{model(BUS)}</world>"),
        "two frames, links, joints or models are named '[a-z]+' .lines",
    ),
    "a mimic of nothing": (
        sdf(model(BUS, ARM, ELBOW.replace("</axis>", "<mimic joint='no'/></axis>"))),
        "mimic.*unknown movable joint 'no'",
    ),
    "an impossible inertia": (
        sdf(model(BUS, ARM.replace("<ixx>1<", "<ixx>9<"), ELBOW)),
        "'arm' has an inertia that breaks the triangle inequality.*check=",
    ),
    "an include without a file": (
        sdf(model(BUS, "<include><uri>model://nobody</uri></include>")),
        "'model://nobody' .line 3. is not found; name the folder that holds it with packages=",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_sdf_is_refused_with_file_element_and_remedy(case, tmp_path):
    text, message = BAD[case]
    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "arm.urdf.xacro").write_text(URDF.replace("<link", "<xacro:a/><link", 1))
    with pytest.raises(sa.ModelError, match=message) as error:
        load(text, tmp_path)
    assert str(error.value).startswith(str(tmp_path / "robot.sdf"))
    assert "; " in str(error.value)


def test_namespaces_of_simulators_need_no_declaration(tmp_path):
    collision = "<collision name='c'><geometry><sphere><radius>1</radius></sphere></geometry>"
    hint = "<drake:properties gz:a='1'><drake:mu>1</drake:mu></drake:properties>"
    arm = load(
        sdf(model(BUS, link("arm", inside=f"{collision}{hint}</collision>"), elbow())), tmp_path
    )
    assert arm.tree.visuals["arm"].collision[0].geometry == Sphere(1.0)
