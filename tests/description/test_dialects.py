"""Dialects of URDF: what files in the world write, read as it is meant."""

import warnings

import numpy as np
import pytest
from helpers.arms import joint, link, load_text, robot, two_links
from hypothesis import given
from hypothesis import strategies as st

import spacearm as sa
from spacearm.description.readers.source import evaluate

BUS, ARM = link("bus", 50.0), link("arm")
ELBOW = joint("elbow", "bus", "arm")

# --- numbers --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("pi/2", np.pi / 2),
        ("35.2644*pi/180", np.radians(35.2644)),
        ("-PI", -np.pi),
        ("0.15/2", 0.075),
        ("(1+2)*-3", -9.0),
        ("2-3-4", -5.0),
        ("8/4/2", 1.0),
        ("+1.5e-3", 0.0015),
        (".5", 0.5),
        ("1.", 1.0),
        ("1E+2", 100.0),
        ("1e2-1", 99.0),
        (" 1 / 4 ", 0.25),
        ("--1", 1.0),
    ],
)
def test_arithmetic(text, value):
    assert evaluate(text) == pytest.approx(value, rel=1e-15)


WORDS = ["", " ", "1/0", "pie", "2**3", "1,2", "(1", "1)", "1 2", "nan", "inf", "0x10", "1_0", "e"]
WORDS += ["1e", "__import__('os')", "pi()", "1.2.3", "(" * 2000, "-" * 2000 + "1", "١"]


@pytest.mark.parametrize("text", WORDS)
def test_what_is_no_number(text):
    assert evaluate(text) is None


@given(st.recursive(
    st.floats(0, 1e6, allow_nan=False).map(repr) | st.just("pi"),
    lambda inner: st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda t: f"({''.join(t)})"),
    max_leaves=6,
))  # fmt: skip
def test_arithmetic_is_that_of_python(text):
    try:
        value = eval(text, {"pi": np.pi})
    except ZeroDivisionError:
        assert evaluate(text) is None
    else:
        assert evaluate(text) == value


def test_numbers_of_a_file():
    text = robot(*two_links(inside='<limit lower="-pi" upper="pi/2" effort="3*2" velocity="1"/>'))
    plain, ours = 'xyz="0.5 0.0 0.0" rpy="0.0 0.0 0.0"', 'xyz="1/2,0,0" rpy="pi/2 0 0"'
    arm = load_text(text.replace(plain, ours))
    assert (arm.lower[0], arm.upper[0]) == (-np.pi, np.pi / 2)
    placement = arm.model.jointPlacements[2]
    assert np.allclose(placement.rotation[:, 2], (0, -1, 0))
    assert np.allclose(placement.translation, (0.5, 0, 0))


@pytest.mark.parametrize("vector", ["1, 2, 3", "1,2,3", " 1  2\n3 ", "1 ,2 ,3", "2/2, 1 + 1, 3"])
def test_vectors_with_commas(vector):
    text = robot(*two_links()).replace('xyz="0.5 0.0 0.0"', f'xyz="{vector}"')
    assert np.allclose(load_text(text).model.jointPlacements[2].translation, (1, 2, 3))


# --- limits ---------------------------------------------------------------------------------


def with_limit(limit, kind="revolute"):
    return robot(*two_links(inside=f"<limit {limit}/>", kind=kind))


@pytest.mark.parametrize(
    "limit",
    [
        'lower="-inf" upper="inf"',
        'lower="-INF" upper="+Infinity"',
        'lower="-1e+16" upper="1e+16"',
        'lower="-1.79769e+308" upper="1.79769e+308"',
        'lower="0" upper="0" effort="0" velocity="0"',
        'lower="" upper=""',
        "",
    ],
)
def test_limits_that_are_none(limit):
    with pytest.warns(sa.ModelWarning, match="no limits on elbow: taken as unlimited"):
        arm = load_text(with_limit(limit))
    assert (arm.lower[0], arm.upper[0]) == (-np.inf, np.inf)
    joint = arm.tree.joints["elbow"]
    assert joint.velocity == joint.effort == np.inf


def test_one_limit_of_two():
    arm = load_text(with_limit('lower="-inf" upper="2" effort="1" velocity="1"'))
    assert (arm.lower[0], arm.upper[0]) == (-np.inf, 2.0)


def test_zero_rates_and_efforts_are_none_and_noted():
    arm = load_text(with_limit('lower="-1" upper="1" effort="0" velocity="0.0"'))
    joint = arm.tree.joints["elbow"]
    assert joint.velocity == joint.effort == np.inf
    assert [note.partition(" of ")[0] for note in arm.notes] == ["rate limit", "effort limit"]


def test_limits_of_continuous_joints_do_not_count():
    arm = load_text(with_limit('lower="-3" upper="3" effort="1" velocity="1"', "continuous"))
    assert (arm.lower[0], arm.upper[0]) == (-np.inf, np.inf)
    assert arm.notes == ("limits of elbow are ignored, as for all continuous joints",)


def test_limits_that_look_like_degrees_are_said():
    with pytest.warns(sa.ModelWarning, match="limits of elbow look like degrees"):
        load_text(with_limit('lower="-170" upper="170" effort="1" velocity="1"'))


@pytest.mark.parametrize("limit", ['lower="nan" upper="1"', 'lower="-1" upper="1" velocity="NaN"'])
def test_limits_that_are_not_numbers(limit):
    with pytest.raises(sa.ModelError, match=r"<limit> of joint 'elbow' \(line 5\) has .*finite"):
        load_text(with_limit(limit))


# --- elements -------------------------------------------------------------------------------


def test_a_fixed_joint_needs_no_axis():
    bolt = joint("bolt", "arm", "tool", "fixed", axis=(0, 0, 0))
    assert load_text(robot(BUS, ARM, link("tool"), ELBOW, bolt)).tip == "tool"


def test_joint_types_in_capitals():
    assert load_text(robot(*two_links()).replace("revolute", " Revolute")).n == 1
    with pytest.raises(sa.ModelError, match="has type 'revolut'; use one of revolute"):
        load_text(robot(*two_links()).replace("revolute", "revolut"))


def test_products_of_inertia_may_be_left_out_together():
    text = robot(*two_links())
    for name in ("ixy", "ixz", "iyz"):
        text = text.replace(f'{name}="0.0"', "")
    assert np.allclose(load_text(text).model.inertias[2].inertia, np.eye(3))


def test_mimics_of_fixed_joints_are_fixed():
    follower = joint(
        "wrist", "arm", "tool", inside='<mimic joint="bolt" multiplier="2" offset="0.5"/>'
    )
    text = robot(
        BUS, ARM, link("tool"), link("cap"), ELBOW, joint("bolt", "arm", "cap", "fixed"), follower
    )
    with pytest.warns(sa.ModelWarning, match="'wrist' mimics 'bolt', which is fixed"):
        arm = load_text(text, tip="tool")
    assert arm.joint_names == ("elbow",)
    assert arm.tree.joints["wrist"].origin.rotation[1, 0] == pytest.approx(np.sin(0.5))


END = "</robot>"
WELD = '<joint name="w" type="fixed"><parent link="world"/><child link="bus"/></joint></robot>'
CHANGES = {
    "a namespace": ("<robot ", '<robot xmlns="http://www.ros.org" '),
    "another namespace": ("<robot ", '<robot xmlns:sensor="http://a.org/b#sensor" '),
    "namespaces that are not declared": (
        END,
        '<drake:linear_bushing_rpy name="elbow" ignition:frame="arm"/></robot>',
    ),
    "names with two colons": (END, "<a::b c='1'><d::e/></a::b></robot>"),
    "attributes without a blank between": (' name="r"', " version='1'name=\"r\""),
    "hyphens in a comment": (END, "<!-- xacro --inorder\n a.xacro ---></robot>"),
    "a comment before the declaration": ("<?xml", "<!-- made by x --y -->\n<?xml"),
    "a blank line before the declaration": ("<?xml", "\n  <?xml"),
    "a world that is not declared": (END, WELD),
    "a version of XML that there is not": ('version="1.0"', 'version="0.0"'),
    "a joint with the name of the free joint": ('"elbow"', '"root_joint"'),
    "no name": (' name="r"', ""),
    "gazebo": (END, "<gazebo><plugin name='a'/></gazebo></robot>"),
    "transmissions": (END, "<transmission><joint name='j'/></transmission></robot>"),
    "a material twice": (END, "<material name='a'/><material name='a'/></robot>"),
    "unknown elements": ("<inertial>", "<!-- kg --><inertial><units/>"),
    "no angles": ('rpy="0.0 0.0 0.0"', ""),
}


@pytest.mark.parametrize("case", CHANGES)
def test_what_makes_no_difference(case):
    text = robot(*two_links())
    arm, same = load_text(text), load_text(text.replace(*CHANGES[case]))
    q = [0.3]
    J = sa.generalized_jacobian(arm.at(q))
    assert np.array_equal(J, sa.generalized_jacobian(same.at(q)))
    assert same.name in ("r", "robot")


@pytest.mark.parametrize("blanks", ["", "\n", "\n \n\n"])
def test_lines_are_those_of_the_file(blanks):
    text = f"{blanks}{robot(*two_links())}".replace(END, f"\n{link('arm')}<a:b/></robot>")
    first, second = (n + blanks.count("\n") for n in (4, 7))
    with pytest.raises(sa.ModelError, match=rf"'arm' \(line {first} and line {second}\)"):
        load_text(text)


@pytest.mark.parametrize(("encoding", "declared"), [("utf-8-sig", "utf-8"), ("utf-16", "utf-16")])
def test_byte_order_marks(encoding, declared, tmp_path):
    path = tmp_path / "robot.urdf"
    text = robot(*two_links()).replace('"1.0"?>', f'"1.0" encoding="{declared}"?>')
    path.write_bytes(text.encode(encoding))
    assert sa.load(path).n == 1


def test_quaternions_of_urdf_1_2():
    text = robot(*two_links())
    angles, quaternion = 'rpy="0.0 0.0 0.0"', 'quat_xyzw="0 0 0.5 0.5"'
    placement = load_text(text.replace(angles, quaternion)).model.jointPlacements[2]
    assert np.allclose(placement.rotation @ (1, 0, 0), (0, 1, 0), atol=1e-15)
    with pytest.raises(sa.ModelError, match="zero quat_xyzw; give a unit quaternion"):
        load_text(text.replace(angles, 'quat_xyzw="0 0 0 0"'))


def test_capsules_are_read():
    capsule = '<collision><geometry><capsule radius="0.1" length="1"/></geometry></collision>'
    shapes = load_text(robot(BUS, link("arm", inside=capsule), ELBOW)).tree.visuals["arm"].collision
    ends = [shape.pose.translation[2] for shape in shapes]
    assert (len(shapes), ends) == (3, [0.0, -0.5, 0.5])


def test_windows_paths_of_meshes(tmp_path):
    mesh = '<visual><geometry><mesh filename="meshes\\arm.stl"/></geometry></visual>'
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "arm.stl").write_bytes(b"")
    path = tmp_path / "robot.urdf"
    path.write_text(robot(BUS, link("arm", inside=mesh), ELBOW))
    shape = sa.load(path).tree.visuals["arm"].visual[0]
    assert shape.geometry.file == tmp_path / "meshes" / "arm.stl"


def as_of_drake(joint):
    """Spell an element as Drake's own."""
    return joint.replace("<joint", "<drake:joint").replace("</joint", "</drake:joint")


@pytest.mark.parametrize(
    "spell", [str, lambda ball: as_of_drake(ball.replace("spherical", "ball"))]
)
def test_a_spherical_joint_is_a_row_of_hinges(spell):
    place = {"xyz": (0.4, -0.1, 0.2), "rpy": (0.3, -0.5, 0.7)}
    arm, hand = link("arm", 3.0, (0.3, 0.1, 0)), link("hand", 1.0, (0.2, 0, 0.1))
    row = [
        '<link name="x"/>', '<link name="y"/>',
        joint("ball_x", "arm", "x", axis=(1, 0, 0), inside="", **place),
        joint("ball_y", "x", "y", axis=(0, 1, 0), inside="", xyz=(0, 0, 0)),
        joint("ball_z", "y", "hand", axis=(0, 0, 1), inside="", xyz=(0, 0, 0)),
    ]  # fmt: skip
    ball = joint("ball", "arm", "hand", "spherical", inside="", **place)
    with pytest.warns(sa.ModelWarning, match="ball joint ball is taken as three hinges"):
        found = load_text(robot(BUS, arm, hand, ELBOW, spell(ball)), task="pose")
    with pytest.warns(sa.ModelWarning):
        same = load_text(robot(BUS, arm, hand, ELBOW, *row), task="pose")
    assert found.joint_names == same.joint_names == ("elbow", "ball_x", "ball_y", "ball_z")
    assert list(same.bodies) == ["bus", "arm", "x", "y", "hand"]  # massless ones too
    q = [0.3, -0.8, 0.5, 1.1]
    np.testing.assert_allclose(
        sa.generalized_jacobian(found.at(q)), sa.generalized_jacobian(same.at(q)), atol=1e-14
    )


def test_slides_and_a_spherical_joint_are_a_floating_base():
    slides = [
        joint(f"t{a}", b, c, "prismatic", (0, 0, 0), axis=axis, inside="")
        for a, b, c, axis in zip("xyz", ("world", "a", "b"), "abc", np.eye(3), strict=True)
    ]
    frames = [f'<link name="{name}"/>' for name in ("world", *"abc")]
    ball = joint("ball", "c", "bus", "spherical", (0, 0, 0), inside="")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sa.ModelWarning)
        arm = load_text(robot(*frames, BUS, ARM, *slides, ball, ELBOW))
    assert (arm.joint_names, arm.tree.root) == (("elbow",), "bus")
    assert any("'bus' floats by itself" in note for note in arm.notes)
