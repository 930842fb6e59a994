"""Joint limits: those of joints that mimic another count wherever limits do."""

import re
import warnings

import numpy as np
import pytest
from helpers.arms import LIMIT, joint, link, load_text, random_tree, robot, seeds
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
