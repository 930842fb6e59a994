"""Held targets led along paths: closure, momentum, the path, what stops them."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import planar_pair, random_base
from helpers.closed import closed, rates_for, roomy
from scipy.integrate import solve_ivp

import spacearm as sa

CLOSED = 1e-9
"""What grasps may be off [m], [rad]."""


def near(pose, rng, far):
    """A pose at a distance from another, turned by as much."""
    move, turn = (far * x / np.linalg.norm(x) for x in rng.normal(size=(2, 3)))
    return pin.SE3(pin.exp3(turn) @ pose.rotation, pose.translation + move)


def pose(row):
    return pin.XYZQUATToSE3(row)


def integrated(held, twist, duration):
    """The end of a motion of the target at a constant twist, by the equations of the chain."""
    arm, n = held.arm, held.arm.n

    def at(y):
        attitude = pin.Quaternion(y[n + 3 : n + 7]).normalized()
        cfg = arm.at(y[:n], base=pin.SE3(attitude.matrix(), y[n : n + 3]))
        turned = pin.Quaternion(y[n + 10 :]).normalized()
        return cfg, held.target.replace(pose=pin.SE3(turned.matrix(), y[n + 7 : n + 10]))

    def rates(_, y):
        cfg, target = at(y)
        v_b, dq = rates_for(cfg, target, twist)
        turns = [
            0.5 * (pin.Quaternion(0.0, *w) * pin.Quaternion(y[i : i + 4])).coeffs()
            for w, i in ((v_b[3:], n + 3), (twist[3:], n + 10))
        ]
        return np.concatenate((dq, v_b[:3], turns[0], twist[:3], turns[1]))

    poses = held.configuration.base, held.target.pose
    start = np.concatenate((held.q, *map(pin.SE3ToXYZQUAT, poses)))
    way = solve_ivp(rates, (0.0, duration), start, "DOP853", rtol=1e-10, atol=1e-12)
    return at(way.y[:, -1])


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "counts"), [(0, (6, 6)), (1, (6, 6)), (2, (7, 6))])
def test_a_target_follows_its_path_as_the_equations_of_the_chain_say(seed, counts):
    """Against an integration of momentum and grasps as they stand, without the package's way."""
    (held, far), rng = roomy(seed, counts), np.random.default_rng(seed)
    goal = near(held.target.pose, rng, far)
    motion = held.follow([goal], limits=False, speed=far)
    assert motion.gap.max() < CLOSED
    assert motion.gap_angle.max() < CLOSED
    s = motion.s / motion.length
    turn = pin.log3(goal.rotation @ held.target.pose.rotation.T)
    for share, row in zip(s, motion.target, strict=True):
        there = pin.SE3(
            pin.exp3(share * turn) @ held.target.pose.rotation,
            (1 - share) * held.target.pose.translation + share * goal.translation,
        )
        np.testing.assert_allclose(there.actInv(pose(row)).homogeneous, np.eye(4), atol=1e-8)
    twist = np.concatenate((goal.translation - held.target.pose.translation, turn))
    twist *= far / motion.length
    cfg, _ = integrated(held, twist, motion.t[-1])
    np.testing.assert_allclose(motion.q[-1], cfg.q, atol=1e-6)
    end = motion[-1].base.actInv(cfg.base)
    np.testing.assert_allclose(end.homogeneous, np.eye(4), atol=1e-6)
    both = [
        (held.arm.mass * hands.com + held.target.mass * pose(row).act(held.target.com))
        / (held.arm.mass + held.target.mass)
        for hands, row in zip(
            (held.arm.at(q, base=pose(b)) for q, b in zip(motion.q, motion.base, strict=True)),
            motion.target, strict=True,
        )
    ]  # fmt: skip
    np.testing.assert_allclose(both, np.tile(both[0], (len(both), 1)), atol=1e-9)


@pytest.mark.slow
def test_seen_from_the_spacecraft_the_path_is_straight():
    held, far = roomy(4)
    begin = held.configuration.base.actInv(held.target.pose)
    goal = near(begin, np.random.default_rng(4), far)
    motion = held.follow([goal], frame="spacecraft", limits=False)
    assert motion.gap.max() < CLOSED
    seen = [pose(b).actInv(pose(row)) for b, row in zip(motion.base, motion.target, strict=True)]
    for share, there in zip(motion.s / motion.length, seen, strict=True):
        line = (1 - share) * begin.translation + share * goal.translation
        np.testing.assert_allclose(there.translation, line, atol=1e-8)
    assert np.abs(pin.log3(pose(motion.base[0]).rotation.T @ pose(motion.base[-1]).rotation)).max()
    fixed = held.follow(
        [held.configuration.base * goal], mode="fixed", limits=False, speed=far
    )  # the same path of the joints
    np.testing.assert_allclose(fixed.q[-1], motion.q[-1], atol=1e-7)


@pytest.mark.slow
def test_redundant_joints_come_nearer_to_where_they_rest():
    held, far = roomy(5, (7, 7))
    rng = np.random.default_rng(5)
    inner = held.report().internal
    rest = held.q + 0.3 * inner @ np.linalg.lstsq(inner, rng.normal(size=held.arm.n))[0]
    path = [near(held.target.pose, rng, far), held.target.pose]
    least, led = (held.follow(path, limits=False, speed=far, rest=where) for where in (None, rest))
    assert led.arrived
    assert led.gap.max() < CLOSED
    np.testing.assert_allclose(led.target[-1], least.target[-1], atol=1e-8)
    off = [np.linalg.norm(rest - motion.q[-1]) for motion in (least, led)]
    assert off[1] < off[0]


@pytest.mark.slow
def test_it_stops_at_a_singular_posture_along_closure():
    """Far along a line every chain ends: at rows on the way, the distance falls to zero."""
    for seed in range(6, 30):
        held = closed(seed)
        away = near(held.target.pose, np.random.default_rng(seed), 5.0)
        motion = held.follow([away], limits=False)
        if motion.ended == "singularity":
            break
    assert motion.ended == "singularity"
    assert "J* cannot lead the target on" in motion.reason
    assert motion.closure_distance[-1] < 1e-3 < motion.closure_distance[0]


@pytest.mark.slow
def test_a_path_in_time_ends_at_rest_and_is_held_afterwards(tmp_path):
    held, far = roomy(3, tries=4)
    rng = np.random.default_rng(3)
    path = [near(held.target.pose, rng, far) for _ in range(2)]
    motion = held.follow(path, times=[5.0, 9.0], limits=False)
    assert motion.t[-1] == pytest.approx(9.0, abs=1e-12)
    np.testing.assert_allclose(motion.dq[[0, -1]], 0.0, atol=1e-7)
    after = held.after(motion)
    assert max(after.gap, after.turn) < CLOSED
    np.testing.assert_allclose(after.target.pose.actInv(path[-1]).homogeneous, np.eye(4), atol=1e-8)
    motion.save(tmp_path / "motion.npz")
    again = sa.Motion.load(tmp_path / "motion.npz", motion.arm)
    assert type(again) is type(motion)
    np.testing.assert_array_equal(again.target, motion.target)
    assert "At the rows" in [table.title for table in motion.describe().tables]
    assert "between the rows" in motion.not_checked


def test_what_cannot_be_followed_is_told():
    held, _ = roomy(0, tries=1)
    goal = [held.target.pose * sa.pose((0.1, 0, 0))]
    with pytest.raises(sa.ConfigurationError, match="frame 'bus'"):
        held.follow(goal, frame="bus")
    with pytest.raises(sa.ConfigurationError, match="rest"):
        held.follow(goal, rest=[0.0], limits=False)
    moving = replace(held, configuration=held.configuration.with_momentum([1, 0, 0, 0, 0, 0]))
    with pytest.raises(sa.UnsupportedError, match="give times="):
        moving.follow(goal)
    with pytest.raises(sa.UnsupportedError, match="hold the fixed world"):
        replace(held, target=None).follow(goal)
    with pytest.raises(sa.ConfigurationError, match="other joints"):
        held.after(sa.follow(sa.load("planar2").at([0.3, 1.2]), [(1.5, 1.2)]))
    rod = sa.Target(sa.Bus(5.0, size=(1, 0.1, 0.1)), sa.pose((0, 1.5, 0)))
    ends = {"left": sa.pose((-0.3, 0, 0)), "right": sa.pose((0.3, 0, 0))}
    five_bars = sa.hold(planar_pair().at([2.0, -1.2, 1.1, 1.2]), rod, ends, limits=False)
    with pytest.raises(sa.UnsupportedError, match="4 joints for the 6 rows of 2 tips"):
        five_bars.follow(goal)


@pytest.mark.slow
def test_where_the_spacecraft_is_does_not_count():
    held, far = roomy(0)
    by = random_base(np.random.default_rng(1))
    moved = sa.hold(
        held.arm.at(held.q, base=by * held.configuration.base),
        held.target.replace(pose=by * held.target.pose), held.grasps, limits=False,
    )  # fmt: skip
    goal = near(held.target.pose, np.random.default_rng(2), far)
    ends = [one.follow([there], limits=False).q[-1] for one, there in
            ((held, goal), (moved, by * goal))]  # fmt: skip
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-6)


@pytest.mark.slow
def test_bodies_that_meet_on_the_way_are_named():
    """A panel goes up by 0.1 m towards a ball, from which it ends a little apart, or not."""
    arm = sa.load("dual_ur5", tip=["left", "right"])
    panel = sa.Target(sa.Bus(90, size=(0.1, 1.0, 0.5), name="panel"), sa.pose((0.7, 0, 0.9)))
    sides, forward = (("left", 0.35), ("right", -0.35)), (0, np.pi / 2, 0)
    handles = {tip: sa.pose((-0.15, y, 0), forward) for tip, y in sides}
    start = arm.at([-0.2, -1.4, 1.4, 0, 1.4, -1.6] * 2)
    held = sa.hold(start, panel, handles, fixed=True)
    way = held.follow([panel.pose * sa.pose((0, 0, 0.1))], speed=0.05)
    assert way.ended == "arrived"
    assert held.collision_check(way).apart
    for gap in (0.02, -0.02):
        above = 0.25 + 0.1 + 0.05 + gap  # half the panel, its way, and the ball
        ball = sa.Obstacle.sphere(0.05, panel.pose * sa.pose((0, 0, above)))
        report = held.collision_check(way, ball)
        assert report.apart == (gap > 0)
        assert held.collision_check(None, ball).apart
    assert any("panel" in link for link in report.contact.links)
    assert report.contact.t > 0
    with pytest.raises(sa.ConfigurationError, match="with this target"):
        held.collision_check(sa.Motion(held.arm, [0.0], [held.q], [[0, 0, 0, 0, 0, 0, 1]]))


def test_what_a_hand_does_not_hold_must_not_meet_the_target():
    """The same panel, so thick that it reaches into the forearms; hands may be in it."""
    arm = sa.load("dual_ur5", tip=["left", "right"])
    start = arm.at([-0.2, -1.4, 1.4, 0, 1.4, -1.6] * 2)
    for thick, apart in ((0.3, True), (1.3, False)):
        panel = sa.Target(sa.Bus(90, size=(thick, 1.0, 0.5)), sa.pose((0.7, 0, 0.9)))
        sides, forward = (("left", 0.35), ("right", -0.35)), (0, np.pi / 2, 0)
        handles = {tip: sa.pose((-0.15, y, 0), forward) for tip, y in sides}
        assert sa.hold(start, panel, handles, fixed=True).collision_check().apart == apart
