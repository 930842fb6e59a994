"""Held joints: what counts among the n joints, and what stays where it is."""

import json
import pickle

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import LIMIT, joint, link, load_text, random_tree, robot, seeds, two_links
from hypothesis import given

import spacearm as sa


def limits(lower, upper, more="") -> str:
    return f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>{more}'


TWO_ARMS = robot(
    link("bus", 60.0, (0.1, 0, 0)),
    *(
        part
        for side, x in (("left", -0.5), ("right", 0.5))
        for part in (
            link(f"{side}_1", 4.0, (0.4, 0, 0)), link(side, 3.0, (0.3, 0.1, 0)),
            joint(f"{side}_j1", "bus", f"{side}_1", xyz=(x, 0, 0), inside=limits(0.5, 2)),
            joint(f"{side}_j2", f"{side}_1", side, xyz=(1, 0, 0), inside=limits(-2, -0.25)),
        )
    ),
    link("wing", 5.0, (0, 1, 0)),
    joint("panel", "bus", "wing", "continuous", axis=(0, 1, 0), inside=""),
)  # fmt: skip
LEFT, RIGHT = ("left_j1", "left_j2"), ("right_j1", "right_j2")


def test_joints_beside_the_way_to_the_tip_are_held_within_their_limits():
    arm = load_text(TWO_ARMS, tip="left")
    assert arm.joint_names == LEFT
    assert dict(arm.held) == {"panel": 0.0, "right_j1": 0.5, "right_j2": -0.25}
    locked = load_text(TWO_ARMS, tip="left", locked=dict(arm.held))
    assert dict(locked.held) == {}
    q = [0.7, -1.1]
    np.testing.assert_array_equal(arm.at(q).A, locked.at(q).A)
    assert "held panel, right_j1, right_j2" in repr(arm)
    assert "held" not in repr(locked)
    with pytest.raises(TypeError):
        arm.held["panel"] = 1.0


def test_another_tip_sets_its_own_joints_free():
    left = load_text(TWO_ARMS, tip="left")
    right = left.replace(tip="right")
    assert (right.joint_names, list(right.held)) == (RIGHT, ["left_j1", "left_j2", "panel"])
    both = right.replace(tip=("right", "left"))
    assert (both.joint_names, dict(both.held)) == (LEFT + RIGHT, {"panel": 0.0})
    back = both.replace(tip="left")
    np.testing.assert_array_equal(back.at([0.6, -1]).A, left.at([0.6, -1]).A)


def test_joints_are_counted_by_name_or_all():
    arm = load_text(TWO_ARMS, tip="left", joints=["panel"])
    assert (arm.joint_names, list(arm.held)) == ((*LEFT, "panel"), [*RIGHT])
    assert arm.replace(tip="right").joint_names == ("panel", *RIGHT)
    assert arm.replace(joints="all").joint_names == (*LEFT, "panel", *RIGHT)
    assert arm.replace(joints="tip").joint_names == LEFT
    assert load_text(TWO_ARMS, tip="left", joints=LEFT).joint_names == LEFT
    fixed = arm.replace(locked={"panel": 0.3})
    assert (fixed.joint_names, fixed.joints) == (LEFT, ())


def test_a_held_joint_can_be_locked_elsewhere():
    arm = load_text(TWO_ARMS, tip="left").replace(locked={"panel": 0.8, "right_j1": 1.5})
    assert (arm.joint_names, dict(arm.held)) == (LEFT, {"right_j2": -0.25})
    full = load_text(TWO_ARMS, tip="left", joints="all").at([0.7, -1, 0.8, 1.5, -0.25])
    np.testing.assert_allclose(arm.at([0.7, -1]).com, full.com, atol=1e-15)


def test_it_stays_held_whatever_is_replaced(tmp_path):
    arm = load_text(TWO_ARMS, tip="left", joints=["panel"])
    held = {"right_j1": 0.5, "right_j2": -0.25}
    pose = pin.SE3(np.eye(3), np.array([0, 0.3, 0.0]))
    same = {
        "mass": arm.replace(base_mass=90.0),
        "mount": arm.replace(mount=pose),
        "payload": arm.replace(payload=2.0),
        "link": arm.replace(link_mass={"right": 1.0}),
        "task": arm.replace(task="x"),
        "grasp": arm.grasp(4.0),
        "pickle": pickle.loads(pickle.dumps(arm)),
        "urdf": sa.load(arm.to_urdf(tmp_path / "arm.urdf"), joints=["panel"]),
    }
    for what, other in same.items():
        assert dict(other.held) == held, what
        assert (other.tips, other.joints, other.n) == (("left",), ("panel",), 3), what
        assert other.replace(tip="right").n == 3, what
    assert same["mass"].replace(joints="all").mass == pytest.approx(arm.mass + 30.0)
    np.testing.assert_allclose(same["urdf"].at([1, -1, 0.2]).A, arm.at([1, -1, 0.2]).A, atol=1e-13)
    assert json.loads(json.dumps(arm.to_dict()))["held"] == held
    assert arm.to_dict()["tip_reason"] == "it was asked for"


def test_an_arm_mounted_on_one_that_holds_joints_keeps_them_movable():
    bus = sa.mount("z1", sa.Bus(mass=200, size=(1, 1, 1)), name="a")
    both = sa.mount("vispa", bus, pin.SE3(np.eye(3), np.array([0, 0, 0.5])), name="b")
    assert (both.tip, both.n) == ("b_tip", 6)
    assert both.held.keys() == {"a_jointGripper", *bus.joint_names}
    assert both.replace(tip="a").joint_names == bus.joint_names
    assert sa.mount("z1", bus, name="c").replace(joints="all").n == 14


MIMIC = '<mimic joint="{}" multiplier="-2" offset="0.1"/>'


def test_a_joint_that_a_joint_on_the_way_mimics_counts():
    """A parallel linkage drives the elbow from beside the arm."""
    text = robot(
        *two_links(), link("rod"), joint("drive", "bus", "rod"),
        link("hand"), joint("wrist", "arm", "hand", inside=LIMIT + MIMIC.format("drive")),
        link("cam"), joint("follower", "bus", "cam", inside=LIMIT + MIMIC.format("elbow")),
    )  # fmt: skip
    arm = load_text(text, tip="hand")
    assert (arm.joint_names, dict(arm.held)) == (("drive", "elbow"), {})
    turned = arm.at([0.4, 0.2]).tip.rotation
    assert np.allclose(turned, pin.utils.rotate("z", 0.2 + 0.1 - 0.8))


def test_what_mimics_a_held_joint_is_held_with_it():
    finger = limits(0.2, 1), limits(-3, 3, MIMIC.format("a"))
    text = robot(
        *two_links(), link("left"), joint("a", "arm", "left", inside=finger[0]),
        link("right"), joint("b", "arm", "right", inside=finger[1]),
    )  # fmt: skip
    arm = load_text(text, tip="arm")
    assert (arm.joint_names, dict(arm.held)) == (("elbow",), {"a": 0.2})
    turn = pin.rpy.matrixToRpy(arm.tree.joints["b"].origin.rotation)[2]
    assert turn == pytest.approx(0.1 - 2 * 0.2)


@given(seeds)
def test_holding_is_locking(seed):
    n = 1 + seed % 7
    text, tip = random_tree(seed, n), f"link_{n}"
    arm, free = (load_text(text, tip=tip, task="x", joints=which) for which in ("tip", "all"))
    assert set(arm.joint_names).isdisjoint(arm.held)
    assert {*arm.joint_names, *arm.held} == set(free.joint_names)
    locked = free.replace(locked=dict(arm.held))
    assert locked.joint_names == arm.joint_names
    q = np.random.default_rng(seed).uniform(-1, 1, arm.n)
    np.testing.assert_array_equal(locked.at(q).A, arm.at(q).A)
    J = arm.at(q).J[:, 6:]
    if arm.coupling is None:  # each of them moves the tip, or turns it
        assert np.abs(J).max(axis=0).min() > 0.0


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        ("some", "joints is 'some'; give 'tip' or 'all' or a list"),
        (3, "joints is 3"),
        (["panle"], "joints: unknown movable joint 'panle'; valid, nearest first: panel"),
        ([1], r"joints is \[1\]; give 'tip' or 'all' or a list, each entry a text"),
        (["wing"], "joints: unknown movable joint 'wing'"),
    ],
)
def test_joints_are_checked(joints, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        load_text(TWO_ARMS, tip="left", joints=joints)
    with pytest.raises(sa.ConfigurationError, match=message):
        load_text(TWO_ARMS, tip="left").replace(joints=joints)


def test_a_follower_does_not_count_by_name():
    text = robot(*two_links(), link("w"), joint("f", "arm", "w", inside=MIMIC.format("elbow")))
    with pytest.warns(sa.ModelWarning), pytest.raises(sa.ConfigurationError, match="that one"):
        load_text(text, tip="arm", joints=["f"])
