"""Where points are given from: one convention, one word for the other, echoed in every answer."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.commands import answer, spacearm

import spacearm as sa

START, POINT = np.array([0.3, 1.2]), np.array([0.9, 1.4])


@pytest.fixture(scope="module")
def arm():
    return sa.load("planar2")


def motions(arm, base=None, **options):
    """A plan, a followed path and a simulation that all lead to POINT."""
    law = sa.ResolvedRate(target=POINT, gain=2.0)
    return (
        sa.plan(arm.at(START, base=base), POINT, **options),
        sa.follow(arm.at(START, base=base), [POINT], **options),
        sa.simulate(arm.at(START, base=base), law, 12.0, **options),
    )


def test_the_spacecraft_starts_at_the_origin_unless_it_is_said_otherwise(arm):
    for motion in motions(arm):
        np.testing.assert_allclose(motion.tip[-1, :2], POINT, atol=1e-6)
        size = np.abs(motion.com[0]).max()
        np.testing.assert_allclose(motion.base[0, :3], 0.0, atol=1e-15 * size)
        assert motion.origin == motion.to_dict()["origin"] == "spacecraft at the start"


def test_from_the_system_cm(arm):
    for motion in motions(arm, origin="cm"):
        np.testing.assert_allclose((motion.tip[-1, :3] - motion.com[-1])[:2], POINT, atol=1e-6)
        np.testing.assert_allclose(motion.com[0], 0.0, atol=1e-12)
        assert motion.origin == "system CM at the start"


def test_the_same_motion_in_both_frames(arm):
    """Shifting the goal by the system CM is all the difference there is."""
    com = arm.at(START).com[:2]
    for there, here in zip(motions(arm, origin="cm"), motions(arm), strict=True):
        assert type(there) is type(here)
    shifted = sa.follow(arm.at(START), [POINT + com])
    about = sa.follow(arm.at(START), [POINT], origin="cm")
    np.testing.assert_allclose(shifted.q[-1], about.q[-1], atol=1e-9)


def test_a_pose_of_at_is_a_goal_as_it_is(arm):
    goal = arm.at([0.5, 1.0]).tip.translation[:2]
    np.testing.assert_allclose(sa.plan(arm.at(START), goal).tip[-1, :2], goal, atol=1e-6)


def test_a_point_of_the_workspace_and_a_goal_are_the_same_point(arm):
    found, start = sa.workspace(arm), arm.at(START)
    fixed = found.regions(POINT, start=start)
    np.testing.assert_allclose(fixed.point[:2], POINT - start.com[:2], atol=1e-12)
    plan = sa.plan(arm.at(START), POINT)
    end = plan[-1]
    assert fixed.radius == pytest.approx(np.linalg.norm(end.tip.translation - end.com), abs=1e-6)
    from_cm = sa.plan(arm.at(START), POINT, origin="cm")[-1]
    radius = found.regions(POINT).radius
    assert radius == pytest.approx(np.linalg.norm(from_cm.tip.translation), abs=1e-6)
    turned = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.7])), np.array([3.0, -1.0, 0.0]))
    moved = arm.at(START, base=turned)
    assert found.regions(moved.tip.translation, start=moved).radius == pytest.approx(
        np.linalg.norm(start.tip.translation - start.com)
    )


def test_a_tilted_plane_has_no_points_in_the_inertial_one(arm):
    tilted = arm.at(START, base=pin.SE3(pin.exp3(np.array([0.3, 0.0, 0.0])), np.zeros(3)))
    with pytest.raises(sa.ConfigurationError, match="tilted"):
        sa.workspace(arm).regions(POINT, start=tilted)


def test_a_fixed_spacecraft_counts_from_its_own_cm(arm):
    start = arm.at(START, base=pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.7])), np.array([3.0, -1, 0])))
    own = start.base.act(arm.model.inertias[1].lever)
    beside = sa.workspace(arm, mode="fixed").regions(own + np.array([1.0, 0, 0]), start=start)
    np.testing.assert_allclose(beside.point, [1.0, 0.0, 0.0], atol=1e-12)


def test_what_makes_no_sense_is_refused(arm):
    with pytest.raises(sa.ConfigurationError, match=r"unknown origin 'tip'; valid.*"):
        sa.plan(arm.at(START), POINT, origin="tip")
    with pytest.raises(sa.ConfigurationError, match="a base that only turns"):
        sa.follow(arm.at(START, base=pin.SE3(np.eye(3), np.ones(3))), [POINT], origin="cm")
    elsewhere = sa.follow(
        arm.at(START, base=pin.SE3(np.eye(3), np.array([5.0, 5, 0]))), [POINT + 5.0]
    )
    assert elsewhere.origin == "as base was given"


def test_a_start_whose_cm_is_at_the_origin_already_is_taken_as_it_is(arm):
    turned = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.7])), np.zeros(3))
    start = arm.at(START, base=turned).centred([0.0, 0.0, 0.0])
    assert start.base.translation.any()
    there = sa.follow(start, [POINT], origin="cm")
    only_turned = sa.follow(arm.at(START, base=turned), [POINT], origin="cm")
    np.testing.assert_allclose(there.q, only_turned.q, rtol=0, atol=1e-12)
    assert there.origin == "system CM at the start"


@pytest.mark.slow
def test_the_command_line_has_the_same_word(tmp_path):
    words = ("plan", "planar2", *START, "--goal", *POINT)
    assert answer(*words)["origin"] == "spacecraft at the start"
    got = answer(*words, "--with", "origin=cm")
    assert got["origin"] == "system CM at the start"
    np.testing.assert_allclose(got["tip"][-1][:2], POINT, atol=1e-6)
    shown = spacearm(*words, "--with", "origin=cm", cwd=tmp_path).stdout
    assert "origin: system CM at the start" in shown
