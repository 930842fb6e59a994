"""Options that describe the arm: a bus for an arm alone, xacro arguments, packages, densities."""

import json
import re

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from helpers.arms import frame, joint, link, robot
from helpers.commands import answer, spacearm

import spacearm as sa
from spacearm.viewer.session import opening_posture

XACRO = """<robot name="arm" xmlns:xacro="http://ros.org/wiki/xacro">
  <xacro:arg name="mass"/>
  <xacro:include filename="$(find parts)/parts.xacro"/>
  <link name="base"/><xacro:body name="arm" mass="$(arg mass)"/>
  <joint name="elbow" type="continuous"><parent link="base"/><child link="arm"/>
    <origin xyz="0.5 0 0"/></joint>
</robot>
"""
PARTS = """<robot xmlns:xacro="http://ros.org/wiki/xacro">
  <xacro:macro name="body" params="name mass"><link name="${name}"><inertial>
    <mass value="${mass}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
  </inertial></link></xacro:macro>
</robot>
"""
BOX = '<collision><geometry><box size="0.1 0.1 1"/></geometry></collision>'


@pytest.fixture
def arm_alone(tmp_path):
    """A URDF of an arm whose base has no mass."""
    path = tmp_path / "arm.urdf"
    hand = joint("wrist", "arm", "hand", axis=(0, 1, 0))
    parts = (
        frame("base"),
        link("arm", 3.0),
        link("hand", 2.0),
        joint("elbow", "base", "arm"),
        hand,
    )
    path.write_text(robot(*parts))
    return path


def test_a_bus_for_an_arm_alone(arm_alone):
    refused = spacearm("query", arm_alone, "0.1", "0.2")
    assert refused.returncode == 2
    assert "this were an arm alone" in refused.stderr
    assert "--bus KG" in refused.stderr
    options = ("--bus", "90:1,2,3")
    got = answer("query", arm_alone, "0.1", "0.2", *options)
    at = np.array([0.0, 0.0, 1.5])
    arm = sa.mount(arm_alone, sa.Bus(mass=90, size=(1, 2, 3)), pin.SE3(np.eye(3), at))
    assert got["sigma"] == sa.singularity(arm.at([0.1, 0.2])).sigma.tolist()
    assumed = spacearm("query", arm_alone, "0.1", "0.2", "--bus-mass", "200", "--json")
    assert "taken as a solid cube of 1 m, at 200 kg/m^3" in assumed.stderr
    box = sa.mount(arm_alone, sa.Bus(mass=200, size=(1, 1, 1)), pin.SE3(np.eye(3), at / 3))
    assert json.loads(assumed.stdout)["sigma"] == sa.singularity(box.at([0.1, 0.2])).sigma.tolist()


def test_names_are_those_of_the_arm_and_degrees_hold(arm_alone):
    options = ("--bus-mass", "90:1,1,1")
    turned = answer("query", arm_alone, "10", "--deg", "--lock", "wrist=90", *options)
    same = answer("query", arm_alone, np.radians(10), "--lock", f"wrist={np.pi / 2}", *options)
    assert np.allclose(turned["sigma"], same["sigma"], atol=1e-14)
    assert answer("query", arm_alone, "0.1", "--tip", "arm", *options)["sigma"]
    names = answer("info", "ur5", *options)["joint_data"]
    assert names[0]["name"] == "shoulder_pan_joint"


HULL = robot(
    frame("frame"),
    link("hull", 80.0, inertia=9.0 * np.eye(3)),
    joint("hold", "frame", "hull", "fixed", (0, 0, 0.1)),
    link("rotor", 2.0, inertia=np.diag([0.02, 0.02, 0.03])),
    joint("rw", "hull", "rotor", "continuous", (0.1, 0, 0), inside='<limit effort="1"/>'),
    link("panel", 4.0, (0, 1, 0)),
    joint("sada", "hull", "panel", "revolute", (0, 0.5, 0), axis=(0, 1, 0)),
)


def test_a_bus_from_a_file_with_wheels_and_home(arm_alone, tmp_path):
    hull, whole = tmp_path / "hull.urdf", tmp_path / "whole.urdf"
    hull.write_text(HULL)
    words = ("--bus", f"{hull}@0.1,0,0.5,0,0,90", "--wheel", "rw=0.2,6", "--tip", "arm", "--deg")
    run = spacearm("mount", arm_alone, *words, "--home", "sada=30", "-o", whole)
    assert run.returncode == 0, run.stderr
    arm = sa.load(whole, task="x")
    at = sa.pose((0.1, 0, 0.5), (0, 0, np.pi / 2))
    same = sa.mount(arm_alone, hull, at, tip="arm", task="x").replace(wheels=["rw"])
    same = same.with_home({"sada": np.pi / 6})
    assert arm.tip == same.tip == "arm"  # the name that it had
    assert arm.held["sada"] == same.held["sada"] == pytest.approx(np.pi / 6)
    assert [(wheel.name, wheel.torque) for wheel in arm.wheels] == [("rw", 0.2)]
    assert arm.wheels[0].capacity == pytest.approx(6.0)
    J = [sa.generalized_jacobian(one.at([0.4])) for one in (arm, same)]
    np.testing.assert_allclose(*J, atol=1e-14)
    told = " ".join(spacearm("info", whole, "--deg").stdout.split())
    assert "rw hull (0, 0, 1) 0.2 6" in told
    assert "sada revolute panel 30°" in told


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--bus", "HULL@1,2"), "--bus ...@X,Y,Z,R,P,Y is '1,2"),
        (("--bus", "nowhere.urdf"), "nowhere.urdf: no such file"),
        (("--bus", "HULL", "--wheel", "rw=1"), "--wheel rw is '1'; give 2 finite numbers"),
        (("--bus", "HULL", "--wheel", "rw=-1,2"), "'rw' has the limits -1 N m and 2 N m s"),
        (("--bus", "HULL", "--wheel", "spin"), "unknown turning joint 'spin'"),
        (("--bus", "HULL", "--home", "sada=7"), "home of joint 'sada' is 7.0, its limits are -3"),
        (("--bus", "HULL", "--home", "no=7"), "home: unknown movable joint 'no'"),
    ],
)
def test_what_mount_cannot_do_is_told_and_nothing_written(words, message, arm_alone, tmp_path):
    (tmp_path / "hull.urdf").write_text(HULL)
    given = [word.replace("HULL", "hull.urdf") for word in words]
    run = spacearm("mount", arm_alone, *given, "-o", "whole.urdf", cwd=tmp_path)
    assert run.returncode == 2
    assert message in " ".join(run.stderr.split())
    assert not (tmp_path / "whole.urdf").exists()


def test_a_spacecraft_of_the_catalogue_carries_a_second_arm():
    got = answer("info", "vispa", "--bus", "planar2")
    assert got["n"] == 6
    assert {"joint_1", "joint_2"} <= got["held"].keys()


def test_mount_writes_one_urdf(arm_alone, tmp_path):
    path = tmp_path / "whole.urdf"
    run = spacearm("mount", "ur5", "--bus-mass", "200", "-o", path)
    assert run.returncode == 0
    told = " ".join(run.stdout.split())
    assert f"{path}: bus_ur5, 220.994 kg, tip tool0, 6 joints: shoulder_pan_joint, " in told
    whole = sa.load(path)
    assert whole.mass == pytest.approx(sa.mount("ur5", sa.Bus(mass=200, size=(1, 1, 1))).mass)
    assert (whole.n, whole.tip) == (6, "tool0")
    second = spacearm("mount", "ur5", "--bus", f"{path}@0.5,0,0", "-o", path)
    assert "note: all names of ur5_2 start with 'ur5_2_': bus_ur5 has a '" in second.stdout
    third = spacearm("mount", "ur5", "--bus", f"{path}@0,0.5,0", "--name", "side", "-o", path)
    assert "tip side_tool0, 6 joints: side_shoulder_pan_joint" in " ".join(third.stdout.split())
    assert sa.load(path, tip=("ur5", "ur5_2", "side")).n == 18
    hopeless = spacearm("mount", arm_alone, "--bus", "90:1,1,1", "--task", "x y z", "-o", path)
    assert "--task 'x y' or" in " ".join(hopeless.stdout.split())
    assert "task=" not in hopeless.stdout
    unbolted = spacearm("mount", path, "--name", "left", "-o", path)
    assert "--name left: give the bus that the arm is mounted on: --bus KG" in unbolted.stderr
    missing = spacearm("mount", arm_alone, "-o", path)
    assert "--bus KG" in missing.stderr
    assert missing.returncode == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--bus", "90:1,1"), "--bus KG:X,Y,Z is '1,1'; give 3 finite numbers"),
        (("--bus-mass", "-3"), "mass is -3 kg"),
        (("--bus-mass", "90"), "planar2 has a spacecraft; leave it out"),
        (("--arg", "mass=3"), "--arg 'mass=3': give NAME:=VALUE"),
        (("--density", "0"), "density is 0.0; give a positive density"),
    ],
)
def test_bad_options(words, message):
    run = spacearm("info", "planar2", *words)
    assert run.returncode == 2
    assert message in run.stderr.splitlines()[-1]


def test_remedies_for_arms_alone_are_options(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(robot(frame("base"), link("arm", 2.0), joint("elbow", "base", "arm")))
    rail = tmp_path / "rail.urdf"
    slide = joint("slide", "base", "arm", "prismatic")
    rail.write_text(robot(frame("base"), link("arm", 2.0), link("tool", 1.0), slide,
                          joint("elbow", "arm", "tool")))  # fmt: skip
    for words in (("info", path), ("info", rail), ("info", "ur5")):
        told = spacearm(*words).stderr
        assert "--bus KG" in told
        assert "sa." not in told
        assert "=" not in told.replace("--lock slide=0.0", "")


def test_xacro_arguments_and_packages(tmp_path, monkeypatch):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "parts.xacro").write_text(PARTS)
    path = tmp_path / "robot" / "arm.xacro"
    (path.parent / ".git").mkdir(parents=True)
    path.write_text(XACRO)
    bus = ("--bus-mass", "90:1,1,1")
    lacking = spacearm("info", path, *bus, "--arg", "mass:=7")
    assert "name the folder that holds 'parts': the variable ROS_PACKAGE_PATH" in lacking.stderr
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    lacking = spacearm("info", path, *bus)
    assert "give --arg mass:=..." in lacking.stderr
    assert answer("info", path, *bus, "--arg", "mass:=7")["mass"] == 97.0


def test_density_and_notes(tmp_path):
    path = tmp_path / "robot.urdf"
    arm = f'<link name="arm">{BOX}</link>'
    path.write_text(robot(link("bus", 50.0), arm, joint("elbow", "bus", "arm")))
    refused = spacearm("info", path)
    assert "from their shapes: --density 2700" in refused.stderr
    told = spacearm("info", path, "--density", "1000")
    assert (
        "note: density 1000 kg/m^3 gives mass and inertia from shapes: 'arm' 10 kg" in told.stdout
    )
    assert answer("info", path, "--density", "1000")["mass"] == pytest.approx(60.0)


def test_meshes_are_turned_by_their_up_axes_in_what_convert_writes(tmp_path):
    text = trimesh.creation.box((0.1, 0.2, 0.3)).export(file_type="dae")
    (tmp_path / "box.dae").write_bytes(re.sub(rb"[XYZ]_UP", b"Y_UP", text))
    part = (
        '<link name="arm"><visual><geometry><mesh filename="box.dae"/></geometry></visual></link>'
    )
    path, upright = tmp_path / "robot.urdf", tmp_path / "upright.urdf"
    path.write_text(robot(link("bus", 50.0), part, joint("elbow", "bus", "arm")))
    told = spacearm("info", path, "--density", 1000).stdout
    assert "'box.dae' (Y_UP); spacearm convert --up-axes, or up_axes" in " ".join(told.split())
    run = spacearm("convert", path, "--density", 1000, "--up-axes", "-o", upright)
    assert "meshes are turned by their up axes: 'box.dae' (Y_UP)" in " ".join(run.stdout.split())
    moments = np.diag(sa.load(upright).bodies["arm"].inertia)
    np.testing.assert_allclose(moments, np.array([0.13, 0.05, 0.10]) / 2, rtol=1e-6, atol=1e-9)


def test_an_arm_with_two_tips_is_described_asked_and_written(tmp_path):
    """As the question which of two links is the tip offers it."""
    path, sides = tmp_path / "two.urdf", ("left", "right")
    parts = [link("bus", 50.0)]
    for k, side in enumerate(sides):
        parts += [link(f"{side}_1"), link(side)]
        parts += [joint(f"{side}_a", "bus", f"{side}_1", xyz=(0.1, k - 0.5, 0))]
        parts += [joint(f"{side}_b", f"{side}_1", side, axis=(0, 1, 0))]
    path.write_text(robot(*parts))
    both = ("--tip", "left,right")
    asked = "choose one with --tip left, or several with --tip left,right"
    assert asked in spacearm("info", path).stderr
    said = spacearm("info", path, *both).stdout
    for k, side in enumerate(sides):
        assert f"first joint to {side}, spacecraft frame" in said
        mount = sa.load(path, tip=side).mount.translation
        np.testing.assert_allclose(mount, (0.1, k - 0.5, 0), rtol=0.0, atol=1e-15)
    said = spacearm("query", path, *both, "--deg", "10", "20", "30", "40").stdout
    assert "left: x" in said
    assert "right: z" in said
    run = spacearm("mount", path, *both, "-o", tmp_path / "out.urdf")
    assert "tip left, right" in run.stdout, run.stderr
    assert sa.load(tmp_path / "out.urdf").tips == sides


def test_there_is_one_home_for_the_command_line_and_the_viewer(tmp_path):
    """What convert --home writes is what home means, with --deg too; there the viewer begins."""
    path = tmp_path / "at_home.urdf"
    homes = ("--home", "joint_1=20", "--home", "joint_2=-50")
    assert spacearm("convert", "planar2", *homes, "--deg", "-o", path).returncode == 0
    home = pytest.approx(np.radians([20.0, -50.0]), abs=1e-12)
    for words in (["--first-order"], ["--deg", "--first-order"]):
        assert answer("query", path, "home", *words)["configuration"]["q"] == home
    assert answer("nearest", path, "home")["q"] == home
    assert opening_posture(sa.load(path)) == home
    assert sa.load(path).home == home
    zeros = answer("query", "planar2", "home", "--first-order")
    assert zeros["configuration"]["q"] == [0.0, 0.0]
    assert "1 joint value given" in spacearm("query", path, "1").stderr
