"""Attitudes that let a path be followed: figure 5, borders, symmetries, momentum, bad input."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import chosen, load_text, random_chain
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import spacearm as sa
from spacearm.mission.attitude_search import within_limits
from spacearm.mission.rotations import (
    angle_between,
    attitudes,
    cells,
    children,
    nearest_of,
    spacing,
)
from spacearm.motion.following import segments
from spacearm.motion.leading import Settings, lead_all, table_of

A, LINE = np.radians([-57.936, 60.337]), [(2.0, 0.0), (1.5, 1.5)]  # figure 5


def about_z(degrees):
    return pin.SE3(pin.exp3(np.array([0.0, 0.0, np.radians(degrees)])), np.zeros(3))


@pytest.fixture(scope="module")
def arm():
    return sa.load("planar2")


@pytest.fixture(scope="module")
def ring(arm):
    return sa.feasible_attitudes(arm.at(A, base=about_z(21.0)), LINE)


def started_at(arm, ring, angle):
    """The configuration on the ring's branch at any angle, found from the nearest one tried."""
    apart = np.abs((ring.angle - angle + np.pi) % (2 * np.pi) - np.pi)
    q = ring.q[np.argmin(np.where(np.isfinite(ring.q[:, 0]), apart, np.inf))].copy()
    base = about_z(np.degrees(angle))
    for _ in range(60):
        cfg = arm.at(q, base=base).centred(np.zeros(3))
        J = sa.generalized_jacobian(cfg, mode="attitude-controlled")[:2]
        q = q + np.clip(np.linalg.pinv(J) @ (LINE[0] - cfg.tip.translation[:2]), -0.1, 0.1)
    assert np.linalg.norm(cfg.tip.translation[:2] - LINE[0]) < 1e-9
    return cfg


# --- figure 5 -------------------------------------------------------------------------------


def test_the_start_of_figure_5_fails_and_others_succeed(ring):
    near = np.argmin(np.abs(ring.angle - np.radians(21.0)))
    assert not ring.feasible[near]
    assert ring.ended[near] == 1  # by a singularity
    assert ring.s[near] == pytest.approx(1.193, abs=0.02)  # the paper's start ends after 1.193 m
    assert ring.feasible.any()
    assert ring.motion().arrived


@pytest.mark.slow
def test_it_says_of_every_attitude_what_follow_says(ring):
    """The compiled following and the one by scipy's DOP853 are independent.

    The least distance is that of the steps, which are at most 0.05 rad and finer near the margin.
    """
    tried = np.flatnonzero(np.isfinite(ring.q[:, 0]))
    for i in np.random.default_rng(0).choice(tried, 3, replace=False):
        run = ring.motion(i)
        assert run.arrived == (ring.ended[i] == 0)
        assert run.s[-1] == pytest.approx(ring.s[i], abs=2e-3)
        coarse = 2e-3 if ring.distance[i] < 2.0 * ring.margin else 0.025
        assert run.distance.min() == pytest.approx(ring.distance[i], abs=coarse)


@pytest.mark.slow
def test_the_ends_are_where_follow_begins_to_fail(arm, ring):
    """To 1e-6 rad: the margin is kept on one side and not on the other, or there is no start."""
    assert len(ring.intervals) >= 1
    for low, high in ring.intervals:
        for end, inwards in ((low, 1.0), (high, -1.0)):
            try:
                inside = started_at(arm, ring, end + inwards * 1e-6)
                outside = started_at(arm, ring, end - inwards * 1e-6)
            except AssertionError:  # the arm is stretched there
                angle = end + inwards * 2e-6
                assert np.abs(np.sin(started_at(arm, ring, angle).q[1])) < 5e-3
                continue
            kept = [sa.follow(cfg, LINE[1:]).distance.min() for cfg in (inside, outside)]
            assert kept[0] >= ring.margin > kept[1]


def test_simulation_agrees_inside_and_outside(arm, ring):
    """Under law (42) of figure 5 the tip arrives from inside, and from outside it cannot."""
    low, high = ring.intervals[0]
    for angle, succeeds in ((0.5 * (low + high), True), (low - np.radians(4.0), False)):
        cfg = started_at(arm, ring, angle)
        law = sa.TransposedJacobian(target=LINE[1], kp=5.0, kd=15.0)
        run = sa.simulate(
            cfg,
            law,
            60.0,
            stop=("singularity",),
            integration=sa.Integration(events=("singularity",)),
        )
        miss = np.linalg.norm(run[-1].tip.translation[:2] - LINE[1])
        assert (not run.events and miss < 1e-3) == succeeds


def test_all_branches_hold_each_of_them(arm, ring):
    every = sa.feasible_attitudes(arm.at(A), LINE, all_branches=True)
    assert every.share >= ring.share
    for low, high in ring.intervals:
        middle = 0.5 * (low + high)
        assert any(a <= middle <= b for a, b in every.intervals)


def test_without_a_margin_more_attitudes_are_feasible(arm, ring):
    start = arm.at(A, base=about_z(21.0))
    wider = sa.feasible_attitudes(start, LINE, margin=0.0, samples=240)
    narrow = sa.feasible_attitudes(start, LINE, margin=0.1, samples=240)
    assert wider.share >= ring.share >= narrow.share


# --- symmetries -----------------------------------------------------------------------------


def test_turning_the_path_turns_the_attitudes(arm, ring):
    turn = np.radians(40.0)
    R = Rotation.from_euler("z", turn).as_matrix()[:2, :2]
    turned = sa.feasible_attitudes(arm.at(A, base=about_z(61.0)), [R @ p for p in LINE])
    np.testing.assert_allclose(turned.intervals, ring.intervals + turn, atol=2e-6)


def test_mirroring_the_path_mirrors_the_attitudes(arm, ring):
    start = arm.at(-A, base=about_z(-21.0))
    mirrored = sa.feasible_attitudes(start, [(x, -y) for x, y in LINE])
    np.testing.assert_allclose(mirrored.intervals, -ring.intervals[::-1, ::-1], atol=2e-6)


def test_an_arm_at_the_cm_turns_nothing_that_matters():
    """With the arm mounted at the spacecraft's CM the path can be followed from all attitudes."""
    arm = sa.load("planar2").replace(mount=pin.SE3(np.eye(3), np.zeros(3)))
    free = sa.feasible_attitudes(
        arm.at([0.3, 1.2]), [(1.2, 0.0), (1.0, 0.6)], limits=False, margin=0.0, samples=60
    )
    assert free.share == 1.0
    np.testing.assert_allclose(free.intervals, [[-np.pi, np.pi]], atol=1e-12)
    assert free.ball.radius == pytest.approx(np.pi)


# --- the compiled following -----------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_random_arms_are_led_as_follow_leads_them(seed):
    arm = load_text(random_chain(seed, 6), tip="tip")
    rng = np.random.default_rng(seed)
    R = Rotation.random(random_state=seed)
    cfg = arm.at(rng.uniform(-1.0, 1.0, 6), base=pin.SE3(R.as_matrix(), np.zeros(3)))
    cfg = cfg.centred(np.zeros(3))
    home = cfg.tip
    goal = pin.SE3(
        pin.exp3(rng.normal(size=3) * 0.1) @ home.rotation,
        home.translation + rng.normal(size=3) * 0.1,
    )
    run = sa.follow(cfg, [goal, home])
    table = table_of([segments(cfg, [goal, home], None)])
    led = lead_all(arm, cfg.q[None], R.as_quat()[None], table, settings=Settings(tolerance=1e-11))
    assert run.arrived == (led.ended[0] == 0)
    assert led.s[0] == pytest.approx(run.s[-1], abs=1e-3)
    if run.arrived:
        np.testing.assert_allclose(led.q[0], run.q[-1], atol=1e-8)
        assert angle_between(led.attitude[0], run.base[-1, 3:]) < 1e-8


def test_a_path_given_as_a_function_is_followed_as_well(arm):
    def arc(s):
        return np.array([1.6 + 0.3 * np.sin(s / 0.3), 0.3 - 0.3 * np.cos(s / 0.3)])

    q = np.array([-0.6, 1.2])
    cfg = arm.at(q).centred(np.zeros(3))
    run = sa.follow(cfg, arc, length=0.5)
    led = lead_all(
        arm, q[None], np.eye(4)[3:], table_of([segments(cfg, arc, 0.5)]),
        settings=Settings(tolerance=1e-10),
    )  # fmt: skip
    np.testing.assert_allclose(led.q[0], run.q[-1], atol=1e-7)


def test_redundant_arms_take_the_least_rates():
    arm = sa.load("chaser7")
    q = np.array([0.0, 0.6, 0.2, -1.2, 0.1, 0.8, 0.0])
    cfg = arm.at(q).centred(np.zeros(3))
    goal = pin.SE3(cfg.tip.rotation, cfg.tip.translation + np.array([-0.1, 0.1, 0.1]))
    run = sa.follow(cfg, [goal])
    led = lead_all(
        arm, q[None], np.eye(4)[3:], table_of([segments(cfg, [goal], None)]),
        settings=Settings(tolerance=1e-10),
    )  # fmt: skip
    assert run.arrived
    np.testing.assert_allclose(led.q[0], run.q[-1], atol=1e-7)


def test_with_momentum_it_agrees_with_the_momentum_equation(arm):
    """v_b = A_b^-1 (h - A_q dq), integrated by scipy in time, leads to the same joints."""
    h, speed = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.7]), 0.05
    q0 = np.array([-0.6, 1.4])
    cfg = arm.at(q0).centred(np.zeros(3))
    start = cfg.tip.translation[:2]
    goal, length = start + np.array([0.1, 0.2]), np.hypot(0.1, 0.2)

    def rate(_, y):
        base = about_z(np.degrees(y[2]))
        there = arm.at(y[:2], base=base, momentum=h).centred(np.zeros(3))
        split = sa.prescribed_motion(there, {})
        wanted = (goal - start) / length * speed
        dq = np.linalg.solve(split.jacobian[:2], wanted - split.drift[:2])
        return np.append(dq, sa.base_velocity(there, dq)[5])

    end = solve_ivp(rate, (0.0, length / speed), [*q0, 0.0], rtol=1e-11, atol=1e-12).y[:, -1]
    led = lead_all(
        arm, q0[None], np.eye(4)[3:], table_of([segments(cfg, [goal], None)]),
        settings=Settings(h[3:] / speed, tolerance=1e-11),
    )  # fmt: skip
    np.testing.assert_allclose(led.q[0], end[:2], atol=1e-8)
    assert 2 * np.arctan2(*led.attitude[0, 2:]) == pytest.approx(end[2], abs=1e-8)
    turning = arm.at(A, base=about_z(21.0), momentum=h)
    slow, fast = (sa.feasible_attitudes(turning, LINE, speed=v, samples=90) for v in (0.05, 50.0))
    still = sa.feasible_attitudes(arm.at(A, base=about_z(21.0)), LINE, samples=90)
    np.testing.assert_allclose(fast.intervals, still.intervals, atol=1e-2)
    assert abs(slow.share - still.share) > 1e-2
    with pytest.raises(sa.UnsupportedError, match="zero momentum"):
        slow.motion(int(np.flatnonzero(np.isfinite(slow.q[:, 0]))[0]))


def test_angles_are_turned_between_limits_where_a_joint_has_some():
    """Of joints without limits nothing is said, not even a warning of NumPy's."""
    arm = load_text(random_chain(chosen(11), 7, ("continuous", "revolute")), tip="tip")
    limited = np.isfinite(arm.lower)
    assert 0 < limited.sum() < 7
    found = within_limits(arm, np.full((2, 7), 2.0 * np.pi + 1.0))
    np.testing.assert_allclose(
        found, np.tile(np.where(limited, 1.0, 2 * np.pi + 1), (2, 1)), atol=1e-12
    )


def test_joint_limits_end_motions(arm):
    narrow = np.array([0.3, 0.2])
    q = np.array([-0.6, 1.4])
    cfg = arm.at(q).centred(np.zeros(3))
    goal = cfg.tip.translation[:2] + np.array([0.2, 0.3])
    table = table_of([segments(cfg, [goal], None)])
    led = lead_all(arm, q[None], np.eye(4)[3:], table)
    assert led.ended[0] == 0
    whole = np.abs(led.q[0] - q).max()
    assert led.slack[0] <= min((arm.upper - q).min(), (q - arm.lower).min())
    tilted = lead_all(
        arm, q[None], np.eye(4)[3:], table, settings=Settings(most_tilt=led.tilt[0] / 2)
    )
    assert tilted.ended[0] == 3
    assert 0.0 < tilted.s[0] < led.s[0]
    assert whole > narrow.max() / 10


# --- spatial arms ---------------------------------------------------------------------------


@pytest.mark.parametrize("level", [0, 1])
def test_cells_are_spread_evenly(level):
    of = cells(level)
    assert len(of) == 72 * 8**level
    found = attitudes(of, level)
    mean = Rotation.from_quat(found).as_matrix().mean(axis=0)
    np.testing.assert_allclose(mean, np.zeros((3, 3)), atol=1e-12)
    shift = found[:, None] - found[None], found[:, None] + found[None]
    apart = np.minimum(*(np.linalg.norm(x, axis=2) for x in shift)) + np.eye(len(found)) * 9
    assert (
        0.5 * spacing(len(of)) < 4 * np.arcsin(apart.min(axis=1) / 2).max() < 1.5 * spacing(len(of))
    )
    inner = attitudes(children(of), level + 1)
    nearest, _ = nearest_of(found, inner)
    assert (nearest == np.repeat(np.arange(len(of)), 8)).mean() > 0.6


@pytest.fixture(scope="module")
def spatial():
    arm = sa.load("mda6")
    q = np.radians([0.0, 60.0, -100.0, -50.0, 20.0, 0.0])
    home = arm.at(q).centred(np.zeros(3)).tip
    away = pin.SE3(home.rotation, home.translation + np.array([-0.3, 0.4, 0.2]))
    return arm, q, [home, away]


@pytest.mark.slow
def test_of_spatial_arms_share_ball_and_best_attitude(spatial):
    arm, q, path = spatial
    found = sa.feasible_attitudes(arm.at(q), path, samples=576, refine=0)
    assert len(found.ended) == 576
    assert found.weight.sum() == pytest.approx(1.0)
    assert 0.0 < found.share < 1.0
    run = found.motion()
    assert run.arrived
    least = min(np.pi, *(sa.singularity(cfg).distance for cfg in run))  # to first order, up to pi
    assert least == pytest.approx(found.distance[found.best], abs=2e-3)
    within = np.flatnonzero(np.isfinite(found.q[:, 0]) & (found.slack > 0.0))
    for i in np.random.default_rng(1).choice(within, 4):
        assert found.motion(i).arrived == (found.ended[i] == 0)
    rng = np.random.default_rng(2)
    for _ in range(4):  # attitudes in the ball succeed
        axis = rng.normal(size=3)
        turn = Rotation.from_rotvec(0.8 * found.ball.radius * axis / np.linalg.norm(axis))
        to = (turn * Rotation.from_quat(found.ball.centre)).as_quat()
        start = arm.at(q, base=pin.SE3(pin.Quaternion(to), np.zeros(3)))
        finer = sa.feasible_attitudes(start, path, samples=72, refine=0)
        assert np.isfinite(finer.q).any()


def test_progress_of_spatial_arms_counts_the_border_and_the_ball(spatial):
    arm, q, path = spatial
    told = []
    sa.feasible_attitudes(arm.at(q), path, samples=72, refine=1, progress=lambda *x: told.append(x))
    assert told == sorted(told)
    assert (333, 1000) in told
    assert told[-2:] == [(666, 1000), (1000, 1000)]


@pytest.mark.slow
def test_refining_the_border_moves_the_share_little(spatial):
    arm, q, path = spatial
    shares = [sa.feasible_attitudes(arm.at(q), path, refine=k) for k in (0, 1)]
    assert abs(shares[0].share - shares[1].share) < 5 * shares[0].error
    assert shares[1].error < shares[0].error


# --- bad input ------------------------------------------------------------------------------


def test_bad_input(arm):
    with pytest.raises(sa.ConfigurationError, match="give corners"):
        sa.feasible_attitudes(arm.at(A), [])
    with pytest.raises(sa.ConfigurationError, match="margin is -1"):
        sa.feasible_attitudes(arm.at(A), LINE, margin=-1)
    with pytest.raises(sa.ConfigurationError, match="linear part"):
        sa.feasible_attitudes(arm.at(A, momentum=[1, 0, 0, 0, 0, 0]), LINE)
    base = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0, 0), np.zeros(3))
    with pytest.raises(sa.ConfigurationError, match="turns the plane"):
        sa.feasible_attitudes(arm.at(A, base=base), LINE)
    with pytest.raises(sa.UnsupportedError, match="2 of the 3 rows"):
        sa.feasible_attitudes(arm.replace(task="x y rz").at(A), LINE)
    with pytest.raises(sa.UnsupportedError, match="singles out"):
        sa.feasible_attitudes(sa.load("mda6").replace(task="x y").at(np.zeros(6)), LINE)
    with pytest.raises(sa.NoSolutionError, match="no posture was found"):
        sa.feasible_attitudes(arm.at(A), [(9.0, 0.0), (8.0, 0.0)], samples=8)
    nowhere = sa.feasible_attitudes(
        arm.at(A), [(9.0, 0.0), (8.0, 0.0)], all_branches=True, samples=8
    )
    assert "no start: 8" in repr(nowhere)
    assert nowhere.share == 0.0
    with pytest.raises(sa.NoSolutionError, match="none of 8"):
        nowhere.start()
