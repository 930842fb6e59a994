"""Floating bases: slides and hinges without mass between stand for a spacecraft that floats."""

import itertools

import numpy as np
import pinocchio as pin
import pytest

import spacearm as sa

AXES = {"tx": "1 0 0", "ty": "0 1 0", "tz": "0 0 1", "rx": "1 0 0", "ry": "0 1 0", "rz": "0 0 1"}
PLANE, SPACE = ("tx", "ty", "rz"), ("tx", "ty", "tz", "rz", "ry", "rx")
Q = (0.3, 0.7, -0.4)


def urdf(base, axes=("0 0 1",) * 3, carriage=0.0):
    """Write a bus of 40 kg with an arm, carried by joints of these names."""
    parts, parent = ['<link name="ground"/>'], "ground"
    for name in base:
        child = f"on_{name}"
        kind = "prismatic" if name[0] == "t" else "continuous"
        limit = '<limit lower="-5" upper="5" effort="1" velocity="1"/>' * (kind == "prismatic")
        parts += [
            f'<link name="{child}">{inertial(carriage) if carriage else ""}</link>',
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<axis xyz="{AXES[name]}"/>{limit}</joint>',
        ]
        parent = child
    parts += [bolt("to_bus", parent, "bus"), f'<link name="bus">{inertial(40)}</link>']
    for i, axis in enumerate(axes):
        before = f"l{i - 1}" if i else "bus"
        parts += [
            f'<link name="l{i}">{inertial(3 - i)}</link>',
            f'<joint name="a{i}" type="continuous"><parent link="{before}"/><child link="l{i}"/>'
            f'<origin xyz="0.8 0 0"/><axis xyz="{axis}"/></joint>',
        ]
    parts += ['<link name="tip"/>', bolt("to_tip", f"l{len(axes) - 1}", "tip", "0.5 0 0")]
    return f'<robot name="r">{"".join(parts)}</robot>'


def bolt(name, parent, child, at="0 0 0"):
    return (
        f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/></joint>'
    )


def inertial(mass):
    return (
        f'<inertial><origin xyz="0.2 0 0"/><mass value="{mass}"/>'
        '<inertia ixx="0.9" iyy="1" izz="1.1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )


def mjcf(base):
    """Write the same robot as an MJCF, its base given by the joints of its body."""
    body = '<inertial pos="0.2 0 0" mass="{}" diaginertia="0.9 1 1.1"/>'
    arm = '<site name="tip" pos="0.5 0 0"/>'
    for i in reversed(range(3)):
        arm = (
            f'<body name="l{i}" pos="0.8 0 0"><joint name="a{i}" type="hinge" axis="0 0 1"/>'
            f"{body.format(3 - i)}{arm}</body>"
        )
    return (
        '<mujoco><compiler angle="radian"/><worldbody>'
        f'<body name="bus">{base}{body.format(40)}{arm}</body></worldbody></mujoco>'
    )


def load(folder, text, suffix=".urdf", **options):
    (path := folder / f"r{suffix}").write_text(text)
    return sa.load(path, **options)


def floating(folder, axes=("0 0 1",) * 3):
    """The same robot, its bus the root."""
    return load(folder, urdf((), axes)).at(Q)


def same(arm, reference):
    cfg = arm.at(Q)
    assert arm.joint_names == reference.arm.joint_names
    np.testing.assert_allclose(
        sa.generalized_jacobian(cfg), sa.generalized_jacobian(reference), atol=1e-13
    )


@pytest.mark.parametrize("base", [*itertools.permutations(PLANE), SPACE, SPACE[::-1]])
def test_slides_and_hinges_of_a_urdf_are_the_floating_base(base, tmp_path):
    with pytest.warns(sa.ModelWarning, match="floats by itself"):
        arm = load(tmp_path, urdf(base))
    same(arm, floating(tmp_path))
    assert any(all(name in note for name in base) for note in arm.notes)


@pytest.mark.parametrize("names", [PLANE, ("tx", "ty", "tz", "ball"), SPACE])
def test_slides_and_hinges_of_an_mjcf_are_the_floating_base(names, tmp_path):
    joints = [
        '<joint name="ball" type="ball"/>'
        if name == "ball"
        else f'<joint name="{name}" type="{"slide" if name[0] == "t" else "hinge"}" '
        f'axis="{AXES[name]}"/>'
        for name in names
    ]
    with pytest.warns(sa.ModelWarning) as told:
        arm = load(tmp_path, mjcf("".join(joints)), ".xml")
    assert [str(one.message).endswith("'bus' floats by itself") for one in told] == [True]
    same(arm, floating(tmp_path))


def composite(*parts):
    whole = pin.JointModelComposite()
    for part in parts:
        whole.addJoint(part)
    return whole


@pytest.mark.parametrize(
    "root",
    [
        pin.JointModelPlanar(),
        composite(pin.JointModelPY(), pin.JointModelPX(), pin.JointModelRZ()),
        composite(pin.JointModelTranslation(), pin.JointModelSpherical()),
        composite(pin.JointModelTranslation(), pin.JointModelSphericalZYX()),
    ],
    ids=["planar", "slides", "ball", "angles"],
)
def test_the_base_of_a_model_of_pinocchio_is_the_floating_base(root, tmp_path):
    text = (
        urdf(()).replace('<link name="ground"/>', "").replace(bolt("to_bus", "ground", "bus"), "")
    )
    (path := tmp_path / "bus.urdf").write_text(text)
    with pytest.warns(sa.ModelWarning) as told:
        arm = sa.load(pin.buildModelFromUrdf(str(path), root))
    assert [str(one.message).endswith("'bus' floats by itself") for one in told] == [True]
    same(arm, floating(tmp_path))


def test_slides_and_hinges_of_a_xacro_are_the_floating_base(tmp_path):
    names = "".join(f'<xacro:carried by="{name}"/>' for name in PLANE)
    macro = '<xacro:macro name="carried" params="by"><link name="beside_${by}"/></xacro:macro>'
    joints = "".join(bolt(f"mark_{name}", "ground", f"beside_{name}") for name in PLANE)
    space = 'name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"'
    text = (
        urdf(PLANE)
        .replace('name="r"', space)
        .replace("</robot>", f"{macro}{names}{joints}</robot>")
    )
    with pytest.warns(sa.ModelWarning, match="'bus' floats by itself"):
        arm = load(tmp_path, text, ".urdf.xacro")
    same(arm, floating(tmp_path))


@pytest.mark.parametrize("name", ["ground", "world", "map", "odom"])
@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_a_massless_root_with_a_free_joint_is_left_out(name, kind, tmp_path):
    free = f'<joint name="v" type="{kind}"><parent link="ground"/><child link="bus"/></joint>'
    text = urdf(()).replace(bolt("to_bus", "ground", "bus"), free).replace("ground", name)
    zero = '<inertial><mass value="0"/><inertia ixx="0" iyy="0" izz="0"/></inertial>'
    with pytest.warns(
        sa.ModelWarning, match=f"and {name!r} are left out: the spacecraft 'bus' floats"
    ):
        same(load(tmp_path, text), floating(tmp_path))
    massless = text.replace(f'<link name="{name}"/>', f'<link name="{name}">{zero}</link>')
    with pytest.warns(
        sa.ModelWarning, match=f"and {name!r} are left out: the spacecraft 'bus' floats"
    ):
        same(load(tmp_path, massless), floating(tmp_path))


@pytest.mark.filterwarnings("ignore:.*links between joints without mass:spacearm.ModelWarning")
@pytest.mark.parametrize(
    ("base", "axes"),
    [
        (("tx",), ("0 0 1",) * 3),
        (("tx", "ty"), ("0 0 1",) * 3),
        (("tx", "ty", "tz"), ("0 0 1",) * 3),
        (PLANE, ("0 0 1", "0 1 0", "0 1 0")),
        (("tx", "ty", "rx"), ("0 0 1",) * 3),
    ],
)
def test_a_base_that_may_be_a_rail_is_a_question_with_both_answers(base, axes, tmp_path):
    with pytest.raises(
        sa.ModelError, match=r"may be a spacecraft that floats, or an arm on a rail"
    ):
        load(tmp_path, urdf(base, axes))
    (path := tmp_path / "rail.urdf").write_text(urdf(base, axes))
    free = sa.load(path, locked=dict.fromkeys(base, 0.0))
    same(free, floating(tmp_path, axes))
    assert sa.mount(path, sa.Bus(mass=100, size=(1, 1, 1))).n == 3 + len(base)


@pytest.mark.parametrize("base", [PLANE, SPACE])
def test_carriages_with_mass_are_a_question(base, tmp_path):
    text, names = urdf(base, carriage=0.01), ", ".join(base)
    with pytest.raises(sa.ModelError, match=f"carries 'bus' by {names}: .*rail.*lock {names} "):
        load(tmp_path, text)
    arm = sa.load(tmp_path / "r.urdf", locked=dict.fromkeys(base, 0.0))
    assert arm.n == 3
    assert arm.mass == pytest.approx(floating(tmp_path).arm.mass + 0.01 * len(base))


@pytest.mark.parametrize("base", [PLANE, SPACE])
def test_a_light_root_stands_for_the_world_and_a_heavy_one_is_the_spacecraft(base, tmp_path):
    def on(mass, carriage=0.0):
        ground = f'<link name="ground">{inertial(mass)}</link>'
        return urdf(base, carriage=carriage).replace('<link name="ground"/>', ground)

    with pytest.warns(sa.ModelWarning, match="left out, with 'ground' of 1 kg: .*floats by itself"):
        same(load(tmp_path, on(1.0)), floating(tmp_path))
    with pytest.warns(sa.ModelWarning, match="has 1 kg and carries 'bus'.*as which it is taken"):
        assert load(tmp_path, on(1.0, 0.01)).n == 3 + len(base)
    with pytest.warns(sa.ModelWarning, match="taken as massless"):
        assert load(tmp_path, on(500.0)).n == 3 + len(base)


@pytest.mark.parametrize("base", [PLANE, SPACE])
def test_light_carriages_are_as_good_as_massless(base, tmp_path):
    text = urdf(base, carriage=1e-4)
    with pytest.raises(sa.ModelError, match=r"rail|alone"):
        load(tmp_path, text)  # their inertia counts
    light = '<mass value="0.0001"/><inertia ixx="{}" iyy="{}" izz="{}"'
    text = text.replace(light.format(0.9, 1, 1.1), light.format(1e-6, 1e-6, 1e-6))
    with pytest.warns(sa.ModelWarning, match="floats by itself"):
        arm = load(tmp_path, text)
    J, wanted = (sa.generalized_jacobian(x) for x in (arm.at(Q), floating(tmp_path)))
    np.testing.assert_allclose(J, wanted, atol=1e-5)  # the last one is fixed to the bus


def test_an_arm_on_a_wall_is_no_floating_base(tmp_path):
    with pytest.raises(sa.ModelError, match="arm alone"):
        load(tmp_path, urdf(("rz",)))


@pytest.mark.filterwarnings("ignore:.*links between joints without mass:spacearm.ModelWarning")
def test_a_floating_base_that_is_mounted_is_told(tmp_path):
    (path := tmp_path / "r.urdf").write_text(urdf(PLANE))
    with pytest.warns(sa.ModelWarning, match="without a bus"):
        arm = sa.mount(path, sa.Bus(mass=100, size=(1, 1, 1)))
    assert arm.n == 6


def test_slides_and_hinges_of_an_sdf_are_the_floating_base(tmp_path):
    body = (
        '<link name="{}"><pose>{} 0 0 0 0 0</pose><inertial><pose>0.2 0 0 0 0 0</pose>'
        "<mass>{}</mass><inertia><ixx>0.9</ixx><iyy>1</iyy><izz>1.1</izz><ixy>0</ixy><ixz>0</ixz>"
        "<iyz>0</iyz></inertia></inertial></link>"
    )
    massless = (
        "<inertial><mass>0</mass><inertia><ixx>0</ixx><iyy>0</iyy><izz>0</izz></inertia></inertial>"
    )
    link = '<link name="{}">' + massless + "</link>"
    joint = (
        '<joint name="{}" type="{}"><parent>{}</parent><child>{}</child><axis><xyz>{}</xyz></axis>'
        "</joint>"
    )
    parts = [link.format("on_tx"), link.format("on_ty"), body.format("bus", 0, 40)]
    parts += [body.format(f"l{i}", 0.8 * (i + 1), 3 - i) for i in range(3)]
    parts += ['<frame name="tip" attached_to="l2"><pose>0.5 0 0 0 0 0</pose></frame>']
    parts += [
        joint.format("tx", "prismatic", "world", "on_tx", AXES["tx"]),
        joint.format("ty", "prismatic", "on_tx", "on_ty", AXES["ty"]),
        joint.format("rz", "revolute", "on_ty", "bus", AXES["rz"]),
        *(
            joint.format(f"a{i}", "revolute", f"l{i - 1}" if i else "bus", f"l{i}", "0 0 1")
            for i in range(3)
        ),
    ]
    text = f'<sdf version="1.9"><model name="r">{"".join(parts)}</model></sdf>'
    with pytest.warns(sa.ModelWarning, match="floats by itself"):
        arm = load(tmp_path, text, ".sdf")
    same(arm, floating(tmp_path))


@pytest.mark.parametrize(
    ("parent", "child", "left_out"),
    [("bus", "target", "target"), ("l2", "target", "target"), ("station", "bus", "station")],
)
def test_bodies_that_float_beside_the_robot_do_not_move_it(parent, child, left_out, tmp_path):
    body = f'<link name="{left_out}">{inertial(500)}</link>'
    free = f'<joint name="free" type="floating"><parent link="{parent}"/><child link="{child}"/>'
    text = (
        urdf(()).replace('<link name="ground"/>', "").replace(bolt("to_bus", "ground", "bus"), "")
    )
    with pytest.warns(sa.ModelWarning, match=f"left out, as not fixed to it: {left_out}"):
        arm = load(tmp_path, text.replace("</robot>", f"{body}{free}</joint></robot>"))
    same(arm, floating(tmp_path))
    assert arm.tree.root == "bus"
    assert arm.mass == load(tmp_path, text).mass


def test_two_arms_that_float_apart_are_a_question(tmp_path):
    text = (
        urdf(()).replace('<link name="ground"/>', "").replace(bolt("to_bus", "ground", "bus"), "")
    )
    other = text.replace('<robot name="r">', "").replace('="', '="other_')
    for word in ("xyz", "type", "value", "ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
        other = other.replace(f'{word}="other_', f'{word}="')
    free = (
        '<joint name="free" type="floating"><parent link="bus"/><child link="other_bus"/></joint>'
    )
    with pytest.raises(
        sa.ModelError, match="2 robots of the most joints, 3, with roots bus, other"
    ):
        load(tmp_path, text.replace("</robot>", free) + other)


def test_a_massless_world_with_marks_is_left_out_and_one_of_two_bodies_is_not_the_robot(tmp_path):
    free = '<joint name="{}" type="floating"><parent link="odom"/><child link="{}"/></joint>'
    marks = '<link name="odom"/><link name="mark"/>' + bolt("to_odom", "ground", "odom")
    marks += bolt("to_mark", "odom", "mark", "1 2 3")
    text = urdf(()).replace(bolt("to_bus", "ground", "bus"), marks + free.format("v", "bus"))
    with pytest.warns(sa.ModelWarning, match="'ground', 'mark', 'odom' are left out"):
        same(load(tmp_path, text), floating(tmp_path))
    target = f'<link name="target">{inertial(500)}</link>' + free.format("w", "target")
    with pytest.warns(sa.ModelWarning, match="left out, as not fixed to it: ground, target"):
        same(load(tmp_path, text.replace("</robot>", f"{target}</robot>")), floating(tmp_path))


def test_fingers_may_leave_the_plane_of_a_planar_base(tmp_path):
    body = '<body name="{0}" pos=".5 {1} 0"><joint name="j{0}" {2}/>{3}</body>'
    part = '<geom type="capsule" fromto="0 0 0 {0} 0 0" size=".01" mass="{1}"/>'
    finger = 'type="slide" axis="0 1 0" range="0 .04"'
    fingers = "".join(
        body.format(f"f{y}", y, finger, part.format(0.05, 0.1)) for y in (-0.05, 0.05)
    )
    turn = 'axis="0 1 0"'
    arm = body.format("b", 0, turn, part.format(0.5, 2) + fingers)
    arm = body.format("a", 0, turn, part.format(0.5, 3) + arm)
    base = "".join(f'<joint name="t{x}" type="slide" axis="{x}"/>' for x in ("1 0 0", "0 0 1"))
    text = f"""<mujoco><worldbody><body name="bus">{base}<joint name="r" {turn}/>
        <geom size=".3" mass="40"/>{arm}</body></worldbody></mujoco>"""
    with pytest.warns(sa.ModelWarning, match="'bus' floats by itself"):
        found = load(tmp_path, text, ".xml")
    assert (found.joint_names, found.tip, found.task.names) == (("ja", "jb"), "b", "x z")
