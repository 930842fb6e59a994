"""Time-optimal timing: closed forms, limits held, and a simulation that keeps to the times."""

import dataclasses
import pathlib

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, random_chain
from scipy.interpolate import CubicSpline

import spacearm as sa

pytest.importorskip("toppra")


def straight(arm, q0, q1, mode="free-floating"):
    """A straight joint motion, at no particular pace."""
    start = arm.at(q0)
    end = sa.move(start, q1) if mode == "free-floating" else arm.at(q1)
    base = np.array([pin.SE3ToXYZQUAT(cfg.base) for cfg in (start, end)])
    return sa.Motion(arm, np.array([0.0, 9.0]), np.array([q0, q1]), base, mode=mode)


def torques(motion):
    """Torques by inverse dynamics of differences of the rows, which knows no spline."""
    dq = np.gradient(motion.q, motion.t, axis=0)
    ddq = np.gradient(dq, motion.t, axis=0)
    rows = zip(motion.q, dq, ddq, strict=True)
    return np.array([
        sa.inverse_dynamics(motion.arm.at(q), v, a, mode=motion.mode).tau for q, v, a in rows
    ])[2:-2]  # fmt: skip


@pytest.mark.parametrize(("rate", "seconds"), [(1e3, 2.0 * np.sqrt(1.5)), (0.5, 1.5 / 0.5 + 0.5)])
def test_bang_bang_along_a_line(rate, seconds):
    """The joint that moves farthest sets the pace: 2 sqrt(L / a), or L / v + v / a."""
    line = straight(sa.load("planar2"), [0.3, 1.2], [1.8, 0.7])
    fast = sa.time_optimal(line, torque=1e6, rate=rate, acceleration=1.0, rise=0.0)
    assert fast.t[-1] == pytest.approx(seconds, rel=5e-3)
    np.testing.assert_allclose(fast.q[-1], [1.8, 0.7], atol=1e-12)


@pytest.mark.parametrize("rise", [0.0, 0.1])
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 4))]
)
def test_torques_of_random_arms_reach_their_limits_and_stay_within(seed, rise):
    rng = np.random.default_rng(seed)
    arm = load_text(random_chain(seed, 3 + seed), tip="tip")
    q0, q1 = rng.uniform(-1.0, 1.0, (2, arm.n))
    line = straight(arm, q0, q1)
    limit = np.abs(torques(sa.time_optimal(line, torque=1e9, acceleration=1.0, rate=1e3))).max()
    fast = sa.time_optimal(line, torque=0.3 * limit, rate=1e3, rise=rise)
    tau = np.abs(torques(fast)) / (0.3 * limit)
    assert tau.max() < 1.02  # of differences
    assert tau.max() > 0.95
    if rise:
        assert tau[[0, -1]].max() < 0.1
        assert fast.t[-1] > sa.time_optimal(line, torque=0.3 * limit, rate=1e3, rise=0.0).t[-1]


def test_twice_the_torque_takes_the_root_of_half_the_time():
    """Without gravity and at zero momentum torques fall with the square of the duration."""
    line = straight(sa.load("planar2"), [0.3, 1.2], [1.8, 0.7])
    one, two = (sa.time_optimal(line, torque=tau, rate=1e6).t[-1] for tau in (3.0, 6.0))
    assert one / two == pytest.approx(np.sqrt(2.0), rel=1e-3)


@pytest.mark.parametrize("mode", ["free-floating", "attitude-controlled", "fixed"])
def test_the_motion_ends_where_it_ended(mode):
    arm = sa.load("mda6")
    line = straight(arm, np.full(6, 0.3), np.array([0.9, 1.0, -0.8, 0.2, 0.7, 0.1]), mode)
    fast = sa.time_optimal(line)
    end = np.array([pin.SE3ToXYZQUAT(fast[-1].base)])
    if mode == "free-floating":
        np.testing.assert_allclose(end[0], line.base[-1], atol=1e-7)
    elif mode == "fixed":
        np.testing.assert_array_equal(fast.base, np.tile(line.base[0], (len(fast), 1)))
    else:
        np.testing.assert_array_equal(fast.base[:, 3:], np.tile(line.base[0, 3:], (len(fast), 1)))
        np.testing.assert_allclose(fast.com, np.tile(fast.com[0], (len(fast), 1)), atol=1e-12)
    np.testing.assert_allclose(fast.q[-1], line.q[-1], atol=1e-12)


def test_a_path_that_was_followed_becomes_a_motion_with_its_own_times():
    """What `follow` found beside the rows, such as rates, is that of the times before."""
    path = sa.follow(sa.load("planar2").at([0.3, 1.2]), [(1.5, 1.2)])
    fast = sa.time_optimal(path, torque=20.0, rate=2.0)
    assert type(fast) is sa.Motion
    assert fast.t[-1] < path.t[-1]
    assert fast.dq.shape == fast.q.shape
    np.testing.assert_allclose(fast.base[-1], path.base[-1], atol=1e-7)


def test_a_path_that_was_followed_with_momentum_on_board_is_refused():
    start = sa.load("planar2").at([0.3, 1.2], momentum=[0, 0, 0, 0, 0, 2.0])
    path = sa.follow(start, [(1.5, 1.2)], times=[3.0])
    with pytest.raises(sa.UnsupportedError, match="momentum on board"):
        sa.time_optimal(path, torque=20.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar2", "mda6", "chaser7"])
def test_plans_are_tracked_to_their_times(name):
    arm, rng = sa.load(name), np.random.default_rng(5)
    q0 = np.clip(rng.uniform(0.2, 0.8, arm.n), arm.lower, arm.upper)
    goal = arm.at(q0 + 0.4).tip if arm.n > 2 else arm.at(q0 + 0.4).tip.translation[:2]
    plan = sa.plan(arm.at(q0), goal)
    fast = sa.time_optimal(plan, torque=20.0 if arm.n == 2 else None)
    assert isinstance(fast, sa.Plan)
    assert fast.t[-1] < plan.t[-1]
    assert fast.certificate.free == plan.certificate.free
    assert fast.apart == plan.apart
    for motion in (plan, fast):
        how = sa.Integration(rtol=1e-6)
        run = sa.simulate(motion[0], sa.Tracking(motion), motion.t[-1], integration=how)
        off = CubicSpline(run.t, run.tip[:, :3])(motion.t) - motion.tip[:, :3]
        assert np.linalg.norm(off, axis=1).max() < 1e-3
        assert np.abs(run.tip[-1, :3] - motion.tip[-1, :3]).max() < 1e-5


def test_corners_are_run_through_at_rest():
    arm = sa.load("planar2")
    rows = [arm.at([0.3, 1.2])]
    for q in ([0.9, 1.2], [0.9, 1.9]):
        rows.append(sa.move(rows[-1], q))
    base = np.array([pin.SE3ToXYZQUAT(cfg.base) for cfg in rows])
    bent = sa.Motion(arm, [0.0, 1.0, 2.0], [cfg.q for cfg in rows], base)
    fast = sa.time_optimal(bent, acceleration=1.0, torque=1e6, rate=1e3, rise=0.0)
    assert fast.t[-1] == pytest.approx(2.0 * (np.sqrt(0.6) + np.sqrt(0.7)), rel=5e-3)
    corner = np.abs(fast.q - [0.9, 1.2]).sum(axis=1).argmin()
    assert np.abs(fast.dq[corner]).max() < 0.02


@pytest.mark.slow
def test_a_plan_that_the_smooth_path_breaks_is_refused():
    plan = sa.plan(sa.load("planar2").at([0.3, 1.2]), (0.9, 1.4))
    in_the_way = sa.Obstacle.sphere(0.5, sa.pose(plan.tip[-1, :3]))
    strict = dataclasses.replace(plan, obstacles=(in_the_way,))
    with pytest.raises(sa.NoSolutionError, match="meet"):
        sa.time_optimal(strict, torque=20.0)


def test_what_makes_no_sense_is_refused():
    line = straight(sa.load("planar2"), [0.3, 1.2], [1.8, 0.7])
    for words, name in (
        ({"torque": -1.0}, "torque"),
        ({"rate": [1.0, np.nan]}, "rate"),
        ({"acceleration": [1.0, 1.0, 1.0]}, "acceleration"),
        ({"rise": 2.0}, "rise"),
    ):
        with pytest.raises(sa.ConfigurationError, match=name):
            sa.time_optimal(line, **{"torque": 1.0} | words)
    still = straight(line.arm, [0.3, 1.2], [0.3, 1.2])
    with pytest.raises(sa.ConfigurationError, match="nothing to time"):
        sa.time_optimal(still, torque=1.0)


@pytest.mark.parametrize("motion", [1.0, "q1", [], [0.1, 0.2], np.zeros((2, 2)), {}])
def test_what_is_no_motion_is_named(motion):
    """Its type is a variable that stands for `Motion` or `Plan`."""
    with pytest.raises(
        sa.ConfigurationError, match=r"time_optimal: motion is [\s\S]*give a motion"
    ):
        sa.time_optimal(motion)


def test_an_arm_without_efforts_needs_a_limit():
    text = pathlib.Path("models/planar2.urdf").read_text().replace('effort="50"', 'effort="0"')
    arm = load_text(text)
    with pytest.raises(sa.UnsupportedError, match="give torque or acceleration"):
        sa.time_optimal(straight(arm, [0.3, 1.2], [1.8, 0.7]))


@pytest.mark.slow
def test_tracking_brings_an_arm_back_to_its_motion():
    arm = sa.load("planar2")
    fast = sa.time_optimal(straight(arm, [0.3, 1.2], [0.9, 0.7]), torque=20.0)
    law = sa.Tracking(fast, rate=4.0)
    run = sa.simulate(arm.at([0.35, 1.15]), law, fast.t[-1] + 4.0)
    np.testing.assert_allclose(run.q[-1], fast.q[-1], atol=1e-4)
    assert np.abs(law.error(fast.t[-1] + 1.0, arm.at(fast.q[-1]))).max() < 1e-12
    assert law.to_dict()["rate"] == 4.0


def test_torques_between_the_rows_keep_their_limits():
    """By inverse dynamics along the spline that is flown, at many more instants than rows."""
    plan = sa.plan(sa.load("planar2").at([0.3, 1.2]), sa.Joints([0.9, 0.5]))
    fast = sa.time_optimal(plan, torque=5.0, rate=10.0, acceleration=3.0)
    way, found = fast.spline, []
    for t in np.linspace(0.0, fast.t[-1], 1501):
        tau = sa.inverse_dynamics(fast.arm.at(way(t)), way(t, 1), way(t, 2)).tau
        found.append(np.append(np.abs(tau) / 5.0, np.abs(way(t, 2)) / 3.0))
    assert 0.97 < np.max(found) <= 1.0
