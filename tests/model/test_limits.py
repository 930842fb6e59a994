"""Joint limits: those of joints that mimic another count wherever limits do."""

import re
import warnings

import numpy as np
import pytest
from helpers.arms import LIMIT, joint, link, load_text, random_tree, robot, seeds, two_links
from hypothesis import given
from typer.testing import CliRunner

import spacearm as sa
from spacearm.cli.app import application
from spacearm.singularities.risk import uniform

START = [0.3, 0.2]


@pytest.fixture(scope="module")
def geared(tmp_path_factory):
    """planar3 with joint_3 turning twice as far as joint_2, and no farther than 1 rad."""
    text = sa.load("planar3").path.read_text()
    head, tail = text.split('<joint name="joint_3"')
    tail = re.sub(r'<limit lower="[^"]*" upper="[^"]*"', '<limit lower="-1" upper="1"', tail)
    tail = tail.replace("</joint>", '<mimic joint="joint_2" multiplier="2"/></joint>', 1)
    path = tmp_path_factory.mktemp("geared") / "geared.urdf"
    path.write_text(f'{head}<joint name="joint_3"{tail}')
    return sa.load(path, task="x y")


def test_the_query_says_so(geared):
    run = CliRunner().invoke(
        application(), ["query", str(geared.path), "0.3", "0.6", "--task", "x y"]
    )
    assert run.exit_code == 0, run.output
    assert [line for line in run.output.splitlines() if "outside its limits" in line]


@given(seeds)
def test_within_its_limits_is_where_every_joint_is_within_its_own(seed):
    arm = load_text(random_tree(seed, 6), tip="link_6", task="x", joints="all")
    joints = [arm.tree.joints[name] for name in arm.model.names[2:]]
    Q = np.random.default_rng(seed).uniform(-4.0, 4.0, (200, arm.n))
    inside = ((arm.lower <= Q) & (arm.upper >= Q)).all(axis=1)
    for q, within in zip(Q, inside, strict=True):
        full = arm.all_joints(q)
        assert within == all(j.lower <= x <= j.upper for j, x in zip(joints, full, strict=True))


def test_a_follower_ends_a_simulation(geared):
    law = sa.JointPD(target=[0.3, 1.5], kp=5.0, kd=10.0)
    run = sa.simulate(geared.at(START), law, 20.0, stop=("joint limit",))
    assert run.ended == "joint limit"
    assert geared.all_joints(run.q[-1])[2] == pytest.approx(1.0, abs=1e-9)


def test_a_follower_stops_a_path(geared):
    goal = geared.at([0.3, 0.9]).tip.translation[:2]
    assert sa.follow(geared.at(START), [goal], limits=False).q[-1, 1] > 0.6
    run = sa.follow(geared.at(START), [goal])
    assert run.ended == "joint limit"
    assert geared.all_joints(run.q[-1])[2] == pytest.approx(1.0, abs=1e-9)


def test_a_follower_bounds_the_plan(geared):
    with pytest.raises(sa.NoSolutionError, match=r"goal of joint 'joint_2' is 0\.6, beyond"):
        sa.plan(geared.at(START), sa.Joints([0.3, 0.6]))
    assert sa.plan(geared.at(START), sa.Joints([0.3, 0.45])).q[:, 1].max() <= 0.5


def test_a_follower_bounds_what_is_drawn(geared):
    Q = uniform(geared, True, 1000, np.random.default_rng(0))
    assert 0.9 < np.abs([geared.all_joints(q)[2] for q in Q]).max() <= 1.0


def test_turns_are_not_taken_off_a_joint_that_another_follows():
    """A whole turn of the leader is no whole turn of its follower."""
    wide = '<limit lower="1" upper="8" effort="1" velocity="1"/>'
    half = '<mimic joint="elbow" multiplier="0.5"/>'
    text = robot(
        link("bus", 50.0), link("arm"), joint("elbow", "bus", "arm", inside=wide), link("hand"),
        joint("wrist", "arm", "hand", "continuous", inside=half),
    )  # fmt: skip
    Q = uniform(load_text(text), True, 1000, np.random.default_rng(0))
    assert Q.min() >= 1.0
    assert Q.max() > 7.0


def test_limits_that_leave_nothing_are_refused():
    inside = f'{LIMIT}<mimic joint="elbow" offset="7"/>'
    text = robot(
        link("bus", 50.0), link("arm"), joint("elbow", "bus", "arm"), link("hand"),
        joint("wrist", "arm", "hand", inside=inside),
    )  # fmt: skip
    with pytest.raises(sa.ModelError, match=r"'elbow'.*'wrist'.*-10 to -4.*-3 to 3"):
        load_text(text)


def test_limits_are_replaced_for_all_joints_or_for_some():
    arm = sa.load("planar3")
    some = arm.replace(lower={"joint_2": 0.1}, upper={"joint_3": 1})
    np.testing.assert_array_equal(some.lower, [arm.lower[0], 0.1, arm.lower[2]])
    np.testing.assert_array_equal(some.upper, [*arm.upper[:2], 1.0])
    np.testing.assert_array_equal(some.home, [0.0, 0.1, 0.0])
    all_ = some.replace(upper=(0.2, np.inf, 0.3), lower=None)
    np.testing.assert_array_equal(all_.lower, some.lower)
    np.testing.assert_array_equal(all_.upper, [0.2, np.inf, 0.3])
    np.testing.assert_array_equal(arm.replace(lower=arm.lower, upper={}).lower, arm.lower)
    assert (all_.task, all_.tips, all_.joint_names) == (arm.task, arm.tips, arm.joint_names)


def test_replaced_limits_are_those_of_the_joints_of_the_new_arm():
    arm = sa.load("mda6", task="position")
    other = arm.replace(
        lower=[-0.1, -0.2, -0.3, -0.4], upper=np.arange(1, 5), locked={"joint_2": 0.5}, tip="link_5"
    )
    assert other.joint_names == ("joint_1", "joint_3", "joint_4", "joint_5")
    np.testing.assert_array_equal(other.lower, [-0.1, -0.2, -0.3, -0.4])
    np.testing.assert_array_equal(other.upper, [1.0, 2.0, 3.0, 4.0])
    assert (other.task.names, other.whole.joints["joint_2"].locked[1]) == ("position", 0.5)


@given(seeds)
def test_limits_that_are_replaced_by_themselves_stay(seed):
    """Those of joints that mimic another among them, and of joints that turn without end."""
    arm = load_text(random_tree(seed, 6), tip="link_6", task="x", joints="all")
    for kept in (arm.replace(lower=arm.lower, upper=arm.upper), arm.replace(upper=arm.upper)):
        np.testing.assert_array_equal(kept.lower, arm.lower)
        np.testing.assert_array_equal(kept.upper, arm.upper)
        for name in np.array(arm.joint_names)[np.isinf(arm.lower)]:
            assert kept.tree.joints[name].kind == arm.tree.joints[name].kind


def test_joints_that_mimic_another_keep_limits_of_their_own(geared):
    wide = geared.replace(lower=[-3.0, -3.0], upper=[3.0, 3.0])
    np.testing.assert_array_equal(wide.upper, [3.0, 0.5])
    wider = geared.replace(upper={"joint_2": 3.0, "joint_3": 4.0})
    assert wider.upper[1] == 2.0
    with pytest.raises(sa.ModelError, match="'joint_2' has no position within limits"):
        geared.replace(lower={"joint_2": 0.7})


def test_held_joints_take_limits_by_name():
    panel = (link("panel"), joint("wing", "bus", "panel"))
    arm = load_text(robot(*two_links(), *panel), tip="arm")
    assert arm.replace(lower={"wing": 0.4}).held == {"wing": 0.4}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lower": [0.0]}, r"lower has shape \(1,\); planar2 needs \(2,\).*joint_1, joint_2"),
        ({"upper": 1.0}, r"upper has shape \(\); planar2 needs \(2,\)"),
        ({"upper": [0.0, np.nan]}, "upper of joint 'joint_2' is nan; .* or inf for no limit"),
        ({"lower": {"joint_1": np.nan}}, "lower of joint 'joint_1' is nan; give a number"),
        ({"lower": [0.0, np.inf]}, "lower of joint 'joint_2' is inf; .* or -inf for no limit"),
        ({"lower": {"joint_3": 0.0}}, "lower: unknown joint 'joint_3'; valid.*: joint_"),
        ({"lower": [1, 0], "upper": [0, 1]}, "'joint_1' are 1 and 0; give the least position fir"),
        ({"lower": {"joint_1": 9.0}}, "'joint_1' are 9 and 3.14159; give the least position first"),
        ({"lower": {"joint_1": "low"}}, r"replace: lower is .*give numbers or a mapping \{name"),
        ({"lower": "low"}, "lower is 'low'; give numbers"),
        ({"lwoer": [0.0, 0.0]}, "unknown argument of sa.SpaceArm.replace 'lwoer'; .*: lower, "),
    ],
)
def test_limits_that_make_no_sense_are_refused(change, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.load("planar2").replace(**change)


def test_degrees_taken_for_radians_are_warned_of_once_a_line():
    arm = sa.load("mda6")
    degrees = [0, 60, -100, -50, 0, 0]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in range(3):
            arm.at(degrees)
        arm.at(degrees)
    assert len(caught) == 2
    assert all(warning.filename == __file__ for warning in caught)
    message = str(caught[0].message)
    assert "joint 'joint_2' at 60 rad is outside its limits, 0 to 3.142 rad" in message
    assert "np.radians" in message


def test_whole_turns_of_joints_without_limits_look_like_degrees_if_they_are_whole_numbers(tmp_path):
    path = tmp_path / "r.urdf"
    path.write_text(
        robot(link("bus", 50.0), link("arm"), joint("elbow", "bus", "arm", "continuous"))
    )
    arm = sa.load(path)
    q = np.array([90.0])
    with pytest.warns(sa.ModelWarning, match=r"at 90 rad has 14.3 turns; angles are in radians"):
        arm.at(q)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arm.at([20.5])  # as at the end of a simulation
        arm.at(np.radians(q))


def test_a_slight_step_outside_is_no_talk_of_degrees():
    arm = sa.load("mda6")
    q = np.clip(np.zeros(6), arm.lower, arm.upper)
    q[1] = arm.upper[1] + 0.1
    with pytest.warns(sa.ModelWarning, match="joint_2.*outside its limits") as caught:
        arm.at(q)
    assert "radians" not in str(caught[0].message)
    assert arm.at(q).outside_limits == ("joint_2",)
    q[1] = arm.upper[1] + 1e-12
    assert arm.at(q).outside_limits == ()


def test_segments_warn_of_their_ends():
    arm = sa.load("mda6")
    with pytest.warns(sa.ModelWarning, match="q1 of mda6: joint 'joint_2' at 60 rad.*radians"):
        sa.singular_set(arm).is_free(np.zeros(6), [0, 60, -100, -50, 0, 0])


def test_motions_warn_of_their_start():
    arm = sa.load("mda6")
    law = sa.JointPD(np.zeros(6), 1.0, 1.0)
    with pytest.warns(sa.ModelWarning, match="q of mda6: joint 'joint_2' at 60 rad"):
        sa.simulate(arm.at([0, 60, -100, -50, 0, 0]), law, 0.01)
