"""Bad URDFs: each gets an error that names file, element, value and remedy."""

import cProfile
import pstats
import warnings
from contextlib import suppress

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import frame, joint, link, load_text, random_tree, robot, seeds, two_links
from hypothesis import given
from hypothesis import strategies as st

import spacearm as sa
from spacearm.description.readers.packages import Packages

BUS = link("bus", 50.0)
ARM = link("arm")
ELBOW = joint("elbow", "bus", "arm")
FLAT = np.diag([1.0, 1.0, 3.0])

BAD = {
    "empty": ("", "is not XML"),
    "not XML": ("<robot><link></robot>", "is not XML.*line 1"),
    "no robot file": ("<svg/>", "root element is <svg>; a URDF starts with <robot>, an SDF with"),
    "no links": ("<robot name='r'/>", "has no links"),
    "a link without name": (robot("<link/>"), "<link> on line 3 has no name"),
    "two links of one name": (robot(BUS, BUS), "two links are named 'bus'"),
    "two roots": (robot(BUS, ARM), r"2 root links \(bus, arm\).*fixed joints"),
    "a closed chain": (
        robot(BUS, ARM, link("b"), ELBOW, joint("j", "bus", "b"), joint("k", "b", "arm")),
        "link 'arm' closes a loop: joints 'elbow' and 'k'",
    ),
    "a ring": (
        robot(BUS, ARM, link("b"), joint("j", "arm", "b"), joint("k", "b", "arm")),
        "links arm, b form a loop",
    ),
    "a parent that does not exist": (
        robot(BUS, ARM, joint("elbow", "buss", "arm")),
        "parent of joint 'elbow': unknown link 'buss'; valid, nearest first: bus, arm",
    ),
    "an unknown joint type": (
        robot(*two_links(kind="hinge")),
        "joint 'elbow' .line [0-9]+. has type 'hinge'; use one of revolute",
    ),
    "a floating joint": (robot(*two_links(kind="floating")), "no joint can move"),
    "a planar joint": (robot(*two_links(kind="planar")), "'elbow' is of type 'planar'"),
    "a zero axis": (robot(*two_links(axis=(0, 0, 0))), "joint 'elbow' has a zero axis"),
    "reversed limits": (
        robot(*two_links(inside='<limit lower="2" upper="-1" effort="1" velocity="1"/>')),
        r"<limit> of joint 'elbow' \(line 5\) is reversed \(lower 2, upper -1\); exchange",
    ),
    "a negative velocity limit": (
        robot(*two_links(inside='<limit lower="0" upper="1" effort="1" velocity="-1"/>')),
        "velocity -1",
    ),
    "NaN in an origin": (
        robot(*two_links(xyz=(np.nan, 0, 0))),
        r"<origin> of joint 'elbow' \(line 5\) has xyz='nan 0.0 0.0'; give 3 finite numbers",
    ),
    "infinity in an axis": (robot(*two_links(axis=(np.inf, 0, 0))), "3 finite numbers"),
    "NaN in a mass": (robot(link("bus", np.nan), ARM, ELBOW), "<mass> of link 'bus'.*value='nan'"),
    "two numbers for three": (
        robot(*two_links()).replace('xyz="0.5 0.0 0.0"', 'xyz="0.5 0"'),
        "xyz='0.5 0'; give 3 finite numbers",
    ),
    "words for numbers": (
        robot(*two_links()).replace('value="50.0"', 'value="heavy"'),
        "value='heavy'; give a finite number",
    ),
    "negative mass": (robot(BUS, link("arm", -1.0), ELBOW), "is -1 kg; give a positive mass"),
    "a movable link of zero mass": (
        robot(BUS, link("arm", 0.0, inertia=np.zeros((3, 3))), ELBOW),
        "no movable link has mass: <inertial> is zero or missing in 'arm'; add it, or.*density=",
    ),
    "a movable link without inertial": (
        robot(BUS, frame("arm"), ELBOW),
        "no movable link has mass: <inertial> is zero or missing in 'arm'",
    ),
    "a spacecraft without inertial": (
        robot(frame("bus"), ARM, ELBOW),
        r"spacecraft 'bus', the root link, has no mass.*mount it: sa\.mount\(",
    ),
    "mass without inertia": (
        robot(BUS, '<link name="arm"><inertial><mass value="1"/></inertial></link>', ELBOW),
        "has no <inertia>",
    ),
    "an inertia with five entries": (
        robot(*two_links()).replace('ixy="0.0"', "", 1),
        "has no ixy; add ixy=",
    ),
    "an inertia without mass": (
        robot(BUS, link("arm", 0.0), ELBOW),
        "no movable link has mass",
    ),
    "an inertia without mass beside others": (
        robot(BUS, ARM, ELBOW, link("tool", 0.0), joint("wrist", "arm", "tool")),
        "'tool' has an inertia but a mass of 0 kg",
    ),
    "a spacecraft that is a point": (
        robot(link("bus", 50.0, inertia=np.zeros((3, 3))), ARM, ELBOW),
        "the spacecraft 'bus' has no inertia about some axis.*check=",
    ),
    "a point mass on the axis of its joint": (
        robot(BUS, link("arm", inertia=np.zeros((3, 3))), ELBOW),
        "a motion of 'elbow' moves no mass: .* is given for 'arm'; give them",
    ),
    "a length that would overflow": (
        robot(*two_links(axis=(0, 0, 1e200))),
        r"<axis> of joint 'elbow'.*3 finite numbers up to 1e\+12",
    ),
    "a mass that would overflow": (robot(link("bus", 1e100), ARM, ELBOW), r"value='1e\+100'"),
    "digits that are not plain": (
        robot(*two_links()).replace('value="50.0"', 'value="5_0"'),
        "value='5_0'; give a finite number",
    ),
    "two inertials": (
        robot(BUS.replace("</link>", "<inertial/></link>"), ARM, ELBOW),
        "link 'bus' .line 3. has 2 <inertial>; keep one",
    ),
    "two parents in one joint": (
        robot(BUS, ARM, ELBOW.replace("<child", '<parent link="arm"/><child')),
        "joint 'elbow' .line 5. has 2 <parent>; keep one",
    ),
    "more joints than memory": (
        robot(
            BUS,
            *(link(f"l{i}") for i in range(201)),
            *(joint(f"j{i}", f"l{i - 1}" if i else "bus", f"l{i}") for i in range(201)),
        ),
        "201 movable joints",
    ),
    "an inertia that is not positive definite": (
        robot(BUS, link("arm", inertia=np.diag([1.0, 1.0, -0.1])), ELBOW),
        "'arm' has an inertia that is not positive definite .principal moments -0.1, 1, 1.*check=",
    ),
    "an inertia that breaks the triangle inequality": (
        robot(BUS, link("arm", inertia=FLAT), ELBOW),
        "'arm' has an inertia that breaks the triangle inequality .principal moments 1, 1, 3",
    ),
    "mimic of nothing": (
        robot(BUS, ARM, joint("elbow", "bus", "arm", inside='<mimic joint="elbo"/>')),
        "<mimic> of joint 'elbow': unknown movable joint 'elbo'; valid, nearest first: elbow",
    ),
    "mimic of itself": (
        robot(BUS, ARM, joint("elbow", "bus", "arm", inside='<mimic joint="elbow"/>')),
        "joint 'elbow' mimics itself",
    ),
    "nothing that moves": (
        robot(BUS, frame("arm"), joint("j", "bus", "arm", "fixed")),
        "tip|no joint",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_urdf_is_refused_with_file_element_and_remedy(case, tmp_path):
    text, message = BAD[case]
    path = tmp_path / "bad.urdf"
    path.write_text(text)
    with pytest.raises((sa.ModelError, sa.UnsupportedError), match=message) as error:
        sa.load(path)
    assert str(error.value).startswith(str(path))
    assert "; " in str(error.value)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(sa.ModelError, match=r"nowhere\.urdf: no such file"):
        sa.load(tmp_path / "nowhere.urdf")
    with pytest.raises(sa.ModelError, match="is a folder; give the path"):
        sa.load(tmp_path)


@pytest.mark.parametrize("where", ["text", "attribute"])
def test_entity_expansion_is_refused(where, tmp_path):
    entities = "".join(f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(12))
    body = "<link name='&m;'/>" if where == "attribute" else "<link name='b'>&m;</link>"
    path = tmp_path / "bomb.urdf"
    path.write_text(f'<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">{entities}]><robot>{body}</robot>')
    with pytest.raises(sa.ModelError, match=r"DOCTYPE|not XML"):
        sa.load(path)


def test_external_entities_are_not_read(tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("secret")
    path = tmp_path / "bad.urdf"
    path.write_text(
        f'<!DOCTYPE r [<!ENTITY x SYSTEM "{secret.as_uri()}">]>'
        '<robot><link name="a">&x;</link></robot>'
    )
    with pytest.raises(sa.ModelError, match="declares a DOCTYPE; remove it"):
        sa.load(path)


def test_impossible_inertias_load_with_a_warning_when_asked():
    text = robot(BUS, link("arm", inertia=FLAT), ELBOW)
    with pytest.warns(sa.ModelWarning, match="breaks the triangle inequality"):
        arm = load_text(text, check="warn")
    assert np.allclose(arm.model.inertias[2].inertia, FLAT)
    assert load_text(text, check="accept").n == 1
    with pytest.raises(sa.ConfigurationError, match="unknown check 'off'"):
        load_text(text, check="off")
    negative = robot(BUS, link("arm", inertia=np.diag([1.0, 1.0, -0.1])), ELBOW)
    with pytest.warns(sa.ModelWarning, match="not positive definite"):
        assert np.isfinite(sa.singularity(load_text(negative, check="warn").at([0.3])).sigma).all()
    with pytest.raises(sa.ModelError, match="no movable link has mass"):
        load_text(robot(BUS, frame("arm"), ELBOW), check="warn")


@pytest.mark.parametrize("inside", ["", '<limit effort="1" velocity="2"/>'])
def test_missing_limits_are_unlimited_with_a_warning(inside):
    with pytest.warns(sa.ModelWarning, match="no limits on elbow: taken as unlimited"):
        arm = load_text(robot(*two_links(inside=inside)))
    assert (arm.lower[0], arm.upper[0]) == (-np.inf, np.inf)


def test_continuous_joints_have_one_number_and_no_limits():
    arm = load_text(robot(*two_links(kind="continuous")))
    assert (arm.n, arm.lower[0], arm.upper[0]) == (1, -np.inf, np.inf)
    assert np.allclose(arm.at([0.3]).tip.rotation, pin.utils.rotate("z", 0.3))


@pytest.mark.parametrize(
    "filename",
    [
        "package://nowhere/meshes/a.stl",
        "of_no_robot.stl",
        "file:///no/a.dae",
        "package://",
        "a" * 5000,
    ],
)
def test_missing_meshes_do_not_stop_physics(filename):
    mesh = f'<visual><geometry><mesh filename="{filename}"/></geometry></visual>'
    text = robot(BUS, link("arm", inside=mesh), ELBOW)
    with pytest.warns(sa.ModelWarning, match="meshes not found"):
        arm = load_text(text)
    assert arm.n == 1


def test_meshes_are_found_beside_the_file_and_by_package(tmp_path):
    folder = tmp_path / "my_robot"
    (folder / "urdf").mkdir(parents=True)
    (folder / "meshes").mkdir()
    (folder / "meshes" / "a.stl").write_bytes(b"solid a\nendsolid a\n")
    path = folder / "urdf" / "r.urdf"
    for name in ("../meshes/a.stl", "package://my_robot/meshes/a.stl"):
        assert Packages(path).file(name) is not None


def test_paths_with_spaces_and_other_letters(tmp_path):
    folder = tmp_path / "бак é 空間 arm"
    folder.mkdir()
    path = folder / "mein roboter ü.urdf"
    path.write_text(robot(*two_links()), encoding="utf-8")
    assert sa.load(path).n == 1
    assert sa.load(str(path)).n == 1


def test_latin_1_text_is_read_as_declared(tmp_path):
    path = tmp_path / "latin.urdf"
    text = robot(*two_links()).replace('"1.0"?>', '"1.0" encoding="iso-8859-1"?>')
    path.write_bytes(text.replace("elbow", "coudé").encode("latin-1"))
    assert sa.load(path).joint_names == ("coudé",)


def test_warnings_point_at_the_line_that_loads():
    with pytest.warns(sa.ModelWarning) as caught:
        load_text(robot(*two_links(inside="")))
    assert caught[0].filename.endswith("arms.py")


def test_a_path_that_no_file_can_have():
    for path in ("a" * 5000 + ".urdf", "nul\0.urdf"):
        with pytest.raises(sa.ModelError, match=r"unknown model|cannot be read"):
            sa.load(path)
    with pytest.raises(sa.ConfigurationError, match="source is None; give a text or a path"):
        sa.load(None)
    with pytest.raises(sa.ModelError, match=r"unknown model 'planar2.urdf'.*: planar2"):
        sa.load("planar2.urdf")


def test_a_link_and_a_joint_may_share_a_name():
    arm = load_text(robot(BUS, ARM, joint("arm", "bus", "arm")), locked={})
    assert (arm.tip, arm.joint_names) == ("arm", ("arm",))


@given(seeds, st.integers(1, 8))
def test_the_model_is_the_one_that_pinocchio_reads(seed, n):
    text = random_tree(seed, n).replace('"continuous"', '"revolute"')
    ours = load_text(text, tip="link_1", task="position", joints="all").model
    theirs = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    assert list(ours.names) == list(theirs.names)
    assert list(ours.parents) == list(theirs.parents)
    for i in range(1, ours.njoints):
        a, b = ours.inertias[i], theirs.inertias[i]
        assert np.allclose(a.toDynamicParameters(), b.toDynamicParameters(), atol=1e-12)
        assert ours.jointPlacements[i].isApprox(theirs.jointPlacements[i], 1e-12)
    q = np.concatenate(([0, 0, 0, 0, 0, 0, 1], np.random.default_rng(seed).normal(size=n)))
    data, other = ours.createData(), theirs.createData()
    A, B = pin.computeCentroidalMap(ours, data, q), pin.computeCentroidalMap(theirs, other, q)
    assert np.allclose(A, B, atol=1e-11 * np.abs(B).max())
    assert np.allclose(ours.lowerPositionLimit[7:], theirs.lowerPositionLimit[7:])
    assert np.allclose(ours.velocityLimit[6:], theirs.velocityLimit[6:])


def test_loading_is_quiet_on_a_sound_file(capfd):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_text(robot(*two_links()))
    assert capfd.readouterr() == ("", "")


def chained(count, kind):
    """A robot with many frames in a row or side by side, or with joints that follow one another."""
    parts = [link("bus", 50.0), link("arm"), joint("e0", "bus", "arm")]
    for i in range(1, count):
        if kind == "mimics":
            follows = f'{LIMIT}<mimic joint="e{i - 1}"/>'
            parts += [link(f"m{i}", 1.0), joint(f"e{i}", "bus", f"m{i}", inside=follows)]
        else:
            before = f"f{i - 1}" if i > 1 and kind == "row" else "arm"
            parts += [frame(f"f{i}"), joint(f"j{i}", before, f"f{i}", "fixed")]
    return robot(*parts)


LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["row", "beside", "mimics"])
def test_loading_makes_no_more_than_its_share_of_calls_for_ten_times_the_links(tmp_path, kind):
    """Ten times as many, and a little of it squared; squared throughout it would be a hundred."""
    calls = []
    for count in (300, 3000):
        path = tmp_path / f"{count}.urdf"
        path.write_text(chained(count, kind))
        with cProfile.Profile() as profile, suppress(sa.ModelError):  # so many could be the tip
            sa.load(path)
        calls.append(pstats.Stats(profile).total_calls)
    assert calls[1] < 40 * calls[0]
