"""The servo: what it asks for far from the set, what it keeps near it, and whatever comes in."""

import numpy as np
import pytest
from helpers.arms import joint, link, load_text, planar_pair, robot

import spacearm as sa
from spacearm.compiler import numbers
from spacearm.equations import servo as ticks
from spacearm.equations.rate_limits import LEVELS, levelling
from spacearm.equations.servo import packed
from spacearm.mechanics.arm_kernels import parameters_of, structure_of
from spacearm.mechanics.distance import linearise
from spacearm.singularities.nearest import NearestSearch, distances_found

DT = 0.01
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
STOP = np.radians(5.0)


def away_from_the_set(servo, seed, least=10.0):
    """Start a servo at a random posture at least so far from the set [deg], and return it."""
    arm, rng = servo.arm, np.random.default_rng(seed)
    while True:
        q = rng.uniform(np.maximum(arm.lower, -2.0), np.minimum(arm.upper, 2.0))
        servo.start((q, LEVEL))
        if servo.step((q, LEVEL), np.zeros(6 * len(arm.tips)), DT).distance > np.radians(least):
            return q


def flown(servo, q, twist, count):
    """Fly with twist(i); return positions and rates of all steps."""
    Q, rates = [q], []
    for i in range(count):
        rates.append(servo.step((Q[-1], LEVEL), twist(i), DT).rates)
        Q.append(Q[-1] + DT * rates[-1])
    return np.array(Q), np.array(rates)


def smooth_twists(seed, size, amplitude=0.15):
    rng = np.random.default_rng(seed)
    A, W, P = (
        rng.normal(size=(4, size)) * amplitude,
        rng.uniform(0.05, 0.8, 4),
        rng.uniform(0, 6, 4),
    )
    return lambda i: sum(a * np.sin(w * i * DT + p) for a, w, p in zip(A, W, P, strict=True))


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("name", "mode"),
    [
        ("planar2", "free-floating"),
        ("planar2", "attitude-controlled"),
        pytest.param("mda6", "free-floating", marks=SLOW),
        pytest.param("mda6", "fixed", marks=SLOW),
        pytest.param("chaser7", "free-floating", marks=SLOW),
    ],
)
def test_far_from_the_set_the_rates_are_those_of_the_jacobian(name, mode):
    arm = sa.load(name)
    servo = sa.Servo(arm, rates=100.0, mode=mode, slow=np.radians(8.0))
    q = away_from_the_set(servo, 1)
    base = sa.pose((0.1, 0.2, 0.3), (0.0, 0.0, 0.4) if name == "planar2" else (0.3, -0.2, 0.4))
    twist = np.random.default_rng(2).normal(size=6) * 0.01
    step = servo.step((q, base), twist, 1e-5)  # so short that J* stays as it is
    J = sa.generalized_jacobian(arm.at(q, base=base), mode=mode)
    rows = list(arm.task.indices)
    unit, scale = sa.singularity(arm.at(q)).radian, arm.task.scale
    wanted = unit * (np.linalg.pinv(scale * J[rows] * unit) @ (scale[:, 0] * twist[rows]))
    assert (step.slowed, step.halted) == ({}, "")
    np.testing.assert_allclose(step.rates, wanted, rtol=0, atol=1e-5 * np.abs(wanted).max())
    assert abs(step.done - 1.0) < 1e-9


def test_the_same_motion_in_each_frame():
    arm = sa.load("planar2")
    base = sa.pose(rpy=(0.0, 0.0, 0.9))
    found = []
    q = away_from_the_set(sa.Servo(arm), 3)
    cfg = arm.at(q, base=base)
    twist = np.array([0.02, -0.01, 0.0, 0.0, 0.0, -0.01])
    for frame, R in (
        ("inertial", np.eye(3)),
        ("spacecraft", base.rotation),
        ("tip", cfg.tip.rotation),
    ):
        servo = sa.Servo(arm, frame=frame)
        servo.start(cfg)
        own = np.concatenate((R.T @ twist[:3], R.T @ twist[3:]))
        found.append(servo.step(cfg, own, DT).rates)
    np.testing.assert_allclose(found[1:], [found[0]] * 2, rtol=0, atol=1e-12)


def test_what_momentum_does_to_the_tip_is_made_up_for():
    arm = sa.load("planar2")
    servo = sa.Servo(arm, rates=10.0)
    q = away_from_the_set(servo, 4, least=20.0)
    cfg = arm.at(q, base=sa.pose(rpy=(0.0, 0.0, -0.3)), momentum=[3, -2, 0, 0, 0, -5])
    rates = servo.step(cfg, [0.02, -0.01], 1e-5).rates  # so short that J* stays as it is
    drift = cfg.J[:, :6] @ np.linalg.solve(cfg.A[:, :6], cfg.momentum)
    tip = sa.generalized_jacobian(cfg) @ rates + drift
    np.testing.assert_allclose(tip[:2], [0.02, -0.01], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    "name",
    ["planar2", pytest.param("chaser7", marks=SLOW), pytest.param("dual_ur5", marks=SLOW)],
)
def test_machine_code_gives_what_the_equations_give(name):
    arm = sa.load(name)
    servo = sa.Servo(arm, accelerations=1.0)
    q = away_from_the_set(servo, 5)
    tree, p = structure_of(arm), parameters_of(arm)
    for i in range(3):
        seen = servo.seen((q, LEVEL), np.full(6 * len(arm.tips), 0.05), DT)
        with np.errstate(all="ignore"):
            by_numbers, _ = ticks.step(
                numbers, tree, p, seen, servo.limits, servo.memory, "inertial", False
            )
        tick = servo.tick(seen)
        for one, other in zip(tick, by_numbers, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-7, err_msg=str(i))
        q = q + DT * tick.rates


def slider():
    """Two joints that slide and one that turns on a light bus."""
    limit = '<limit lower="-0.8" upper="0.8" effort="10" velocity="0.4"/>'
    return load_text(
        robot(
            link("bus", 20.0), link("a", 3.0), link("b", 2.0, com=(0.2, 0, 0)), link("c", 1.0),
            joint("j1", "bus", "a", xyz=(0.3, 0, 0.1)),
            joint("j2", "a", "b", kind="prismatic", axis=(1, 0, 0), inside=limit),
            joint("j3", "b", "c", xyz=(0.4, 0, 0)), link("tip", 0.5),
            joint("j4", "c", "tip", kind="prismatic", axis=(0, 1, 0), inside=limit),
        ), task="x y"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("planar2", 1500),
        pytest.param("slider", 600, marks=SLOW),
        pytest.param("mda6", 3000, marks=SLOW),
        pytest.param("chaser7", 3000, marks=SLOW),
        pytest.param("cubesat_xarm", 2000, marks=SLOW),
    ],
)
def test_no_run_comes_nearer_than_stop_or_beyond_a_limit(name, count):
    """The distances are searched anew, by what knows nothing of the servo."""
    arm = slider() if name == "slider" else sa.load(name)
    speed, push = np.array([0.4, 0.3, 0.5, 0.6] * 4)[: arm.n], 1.5
    servo = sa.Servo(arm, rates=speed, accelerations=push)
    q = away_from_the_set(servo, 6)
    Q, rates = flown(servo, q, smooth_twists(7, 6), count)
    near = distances_found(arm, "free-floating", Q[:: max(1, count // 40)])
    assert near.min() >= STOP * (1.0 - 1e-3)
    rounding = 1e-9
    assert (np.abs(rates) <= speed + rounding).all()
    assert (np.abs(np.diff(rates, axis=0, prepend=0.0)) <= push * DT + rounding).all()
    assert (np.minimum(arm.lower, q) - Q <= rounding).all()
    assert (Q - np.maximum(arm.upper, q) <= rounding).all()


@SLOW
def test_what_is_told_at_rest_is_what_a_search_finds():
    """Of an arm whose set has folds and branches; all postures are told of side by side."""
    arm, m, rng = sa.load("chaser7"), 240, np.random.default_rng(15)
    servo, tick = sa.Servo(arm), ticks.size(ticks.Tick, arm.n, 1)
    Q, rest = rng.uniform(-2.0, 2.0, (m, arm.n)), np.zeros((m, 6))
    memory = np.array([packed(ticks.unknowing(arm.n, q)) for q in Q])
    seen = np.concatenate((Q, np.tile(LEVEL, (m, 1)), rest, np.full((m, 1), DT), rest), axis=1)
    for i in range(ticks.SEARCH + 1):
        found = servo._kernel({"given": np.concatenate((seen, memory), axis=1)}, servo._numbers)
        if 2 < i < 12:  # nothing that a scout is about to find is nearer than what is told
            known = [ticks.unpacked(ticks.Memory, one, arm.n, 1) for one in memory]
            points = np.array([one.points for one in known])
            far = linearise(arm, points.reshape(-1, arm.n)).distance.reshape(m, -1)
            used = np.array([one.ages for one in known]) <= ticks.PATIENCE
            sure = np.linalg.norm(points - Q[:, None], axis=2) + ticks.DOUBTED * far
            sure[~used | (far >= ticks.LOST)] = np.inf
            assert (found[:, arm.n] <= sure.min(axis=1) / ticks.NEARER + 1e-6).all()
        memory = found[:, tick:]
    ends = [NearestSearch(arm, "free-floating", q[None]).nearest() for q in Q]
    error = found[:, arm.n] - np.linalg.norm(ends, axis=1)
    assert (error > np.radians(1.0)).mean() < 0.03
    assert (error < -np.radians(1.0)).mean() < 0.02


@SLOW
def test_nothing_nearer_is_lost_while_the_arm_rests():
    """A posture that is followed gives its place only to what is nearer for sure."""
    arm, m, rng = sa.load("ssrms"), 240, np.random.default_rng(15)
    servo, told = sa.Servo(arm), []
    Q, rest, dt = rng.uniform(-2.0, 2.0, (m, arm.n)), np.zeros((m, 6)), np.full((m, 1), DT)
    seen = np.concatenate((Q, np.tile(LEVEL, (m, 1)), rest, dt, rest), axis=1)
    memory = np.array([packed(ticks.unknowing(arm.n, q)) for q in Q])
    for _ in range(ticks.SEARCH):
        found = servo._kernel({"given": np.concatenate((seen, memory), axis=1)}, servo._numbers)
        memory = found[:, ticks.size(ticks.Tick, arm.n, 1) :]
        told.append(np.minimum(found[:, arm.n], np.pi))
    rises = np.diff(told[20:], axis=0) > np.radians(0.1)
    assert rises.any(axis=0).mean() < 0.08


@SLOW
@pytest.mark.parametrize(("name", "longest", "count"), [("ssrms", 0.02, 200), ("mda6", 0.1, 80)])
def test_fast_motions_in_ticks_of_any_length_do_not_fall_below_stop(name, longest, count):
    """What is told neither follows postures on a long way nor loses those that are followed."""
    arm, m, rng = sa.load(name), 200, np.random.default_rng(17)
    servo = sa.Servo(arm, rates=1.0, accelerations=2.0, frame="spacecraft")
    Q, rest, tick = rng.uniform(-2.0, 2.0, (m, arm.n)), np.zeros((m, 6)), np.full((m, 1), DT)
    memory, level = [packed(ticks.unknowing(arm.n, q)) for q in Q], np.tile(LEVEL, (m, 1))
    wished = sa.generalized_jacobians(arm, Q) @ rng.normal(0.0, 0.3, (m, arm.n, 1))
    told, twist = [], rest
    for i in range(ticks.SEARCH + count):
        if i >= ticks.SEARCH:
            twist, tick = wished[..., 0], rng.uniform(1e-3, longest, (m, 1))
        given = np.concatenate((Q, level, twist, tick, rest, memory), axis=1)
        found = servo._kernel({"given": given}, servo._numbers)
        Q, memory = Q + tick * found[:, : arm.n], found[:, ticks.size(ticks.Tick, arm.n, 1) :]
        told.append(found[:, arm.n])
    flown = np.array(told)[ticks.SEARCH :]
    flown = flown[:, flown[0] > servo.limits.slow]
    assert (flown.min(axis=0) < 0.99 * STOP).mean() < 0.01


@SLOW
def test_a_branch_of_the_set_ahead_of_the_arm_is_found_before_it_is_near():
    """Few postures about the arm lead to it. All lanes know the nearest posture at first.

    The way is straight; they differ in where scouts set out.
    """
    arm, m, steps, dt = sa.load("ssrms"), 240, 12, np.full((240, 1), 0.1)
    servo, size = sa.Servo(arm, rates=1.0), ticks.size(ticks.Tick, arm.n, 1)
    way = np.linspace([-0.268, -1.6, -0.094, -1.272, -0.66, 1.699, -0.655],
                      [-0.3, -1.721, 0.04, -1.318, -0.674, 1.598, -0.646], steps + 1)  # fmt: skip
    first = NearestSearch(arm, "free-floating", way[:1]).nearest()
    fresh = ticks.unknowing(arm.n, way[0], [way[0] + first])
    counts = ticks.SEARCH + 97.0 * np.arange(m)
    memory = np.array([packed(fresh._replace(count=count)) for count in counts])
    level, rest = np.tile(LEVEL, (m, 1)), np.zeros((m, 6))
    for q in way:
        given = np.concatenate((np.tile(q, (m, 1)), level, rest, dt, rest, memory), axis=1)
        found = servo._kernel({"given": given}, servo._numbers)
        memory = found[:, size:]
    near = np.linalg.norm(NearestSearch(arm, "free-floating", way[-1:]).nearest())
    late = found[:, arm.n] > near + np.radians(0.3)
    assert near < STOP
    assert late.mean() < 0.2


@pytest.mark.slow
def test_a_posture_beside_the_nearest_in_a_valley_comes_to_rest_there():
    """Whole ways along a set that bends between them leave it for the bottom of the valley."""
    arm, rng = sa.load("chaser7"), np.random.default_rng(21)
    q = np.array([0.481, 3.094, 2.86, -0.036, -0.651, -1.758, -0.183])
    nearest = q + NearestSearch(arm, "free-floating", q[None]).nearest()
    tree, p, limits = structure_of(arm), parameters_of(arm), sa.Servo(arm).limits
    follow = ticks._follower(numbers, tree, p, q, limits.fading, limits.radians)
    rested = []
    for _ in range(20):
        beside = rng.normal(size=arm.n)
        state = nearest + 0.02 * beside / np.linalg.norm(beside), np.zeros(arm.n), ticks.SHARE
        for _ in range(ticks.PATIENCE):
            with np.errstate(all="ignore"):
                one = follow(*state)
            state = one.point, one.slide, one.share
        rested.append(np.linalg.norm(one.point - nearest) < np.radians(1.0))
    assert 4.0 < np.degrees(np.linalg.norm(nearest - q)) < 6.0
    assert np.mean(rested) > 0.8


def test_in_long_ticks_the_tip_goes_where_it_is_sent_while_the_spacecraft_turns():
    """The way of the tip in inertial axes, the rates held through each tick."""
    arm, dt, wished = sa.load("planar2"), 0.1, np.array([0.3, 0.2])
    servo = sa.Servo(arm, rates=1.0, accelerations=2.0)
    q, yaw, cosines, ways = away_from_the_set(servo, 3, least=30.0), 0.4, [], []
    for _ in range(12):
        rates = servo.step((q, sa.pose(rpy=(0.0, 0.0, yaw))), wished, dt).rates
        went = np.zeros(2)
        for _ in range(10):
            q = q + 0.05 * dt * rates
            cfg = arm.at(q, base=sa.pose(rpy=(0.0, 0.0, yaw)))
            went = went + (sa.generalized_jacobian(cfg) @ rates)[:2]
            yaw, q = yaw + 0.1 * dt * sa.base_velocity(cfg, rates)[5], q + 0.05 * dt * rates
        cosines.append(went @ wished / np.linalg.norm(went) / np.linalg.norm(wished))
        ways.append(np.linalg.norm(rates) * dt)
    assert max(ways) > 0.04
    assert min(cosines) >= np.cos(np.radians(0.15))


@SLOW
def test_beyond_slow_the_direction_is_kept_where_turning_joints_meet_their_ends():
    """Many runs side by side, in narrow limits of position, with wishes that turn."""
    arm, m, rng = sa.load("planar3"), 40, np.random.default_rng(3)
    servo = sa.Servo(arm, rates=0.5, accelerations=2.0, frame="spacecraft")
    q = away_from_the_set(servo, 3, least=45.0)
    servo.limits = servo.limits._replace(lower=q - 0.15, upper=q + 0.15)
    numbers_, rows = {"limits": packed(servo.limits)}, list(arm.task.indices)
    Q, memory = np.tile(q, (m, 1)), np.tile(packed(servo.memory), (m, 1))
    A, W, P = (one(size=(4, m, 6)) for one in (rng.normal, rng.random, rng.random))
    level, dt, rest = np.tile(LEVEL, (m, 1)), np.full((m, 1), DT), np.zeros((m, 6))
    for i in range(1000):
        twist = (0.3 * A * np.sin(0.8 * W * i * DT + 6.0 * P)).sum(axis=0)
        given = np.concatenate((Q, level, twist, dt, rest, memory), axis=1)
        found = servo._kernel({"given": given}, numbers_)
        dq, memory = found[:, :3], found[:, ticks.size(ticks.Tick, 3, 1) :]
        J, scale = sa.generalized_jacobians(arm, Q)[:, rows], arm.task.scale
        v, moved = scale[:, 0] * twist[:, rows], (scale * J @ dq[..., None])[..., 0]
        speed = np.linalg.norm(moved, axis=1)
        straight = (moved * v).sum(axis=1) / np.maximum(speed * np.linalg.norm(v, axis=1), 1e-12)
        beyond = (found[:, 3] > servo.limits.slow) & (speed > 1e-6)
        assert (straight[beyond] >= np.cos(np.radians(1.0))).all()
        Q = Q + DT * dq
        assert (np.abs(Q - q) <= 0.15 + 1e-9).all()
    assert (np.abs(Q - q).max(axis=1) > 0.14).any()


@SLOW
@pytest.mark.parametrize(
    ("posture", "linear"),
    [
        ((0.31, -1.22, 0.1, 0.09, -1.64, 1.93, 0.29), (0.007, 0.01, 0.008)),
        ((-1.11, -0.87, 1.71, -0.33, -0.46, 0.44, 0.66), (0.008, 0.002, -0.005)),
    ],
)
def test_beyond_slow_the_direction_is_kept_in_valleys_of_the_least_singular_value(posture, linear):
    """Where it is a ten-thousandth of the largest, 1e-4 rad of the way turn the tip by degrees."""
    arm, twist = sa.load("ssrms"), np.array([*linear, 0, 0, 0])
    servo = sa.Servo(arm, rates=0.5, accelerations=2.0, frame="spacecraft")
    servo.start((np.array(posture), LEVEL))
    Q, rates = flown(servo, np.array(posture), lambda _: twist, 150)
    scale = arm.task.scale
    J = scale * sa.generalized_jacobians(arm, Q[:-1] + 0.5 * DT * rates)
    moved, v = (J @ rates[..., None])[..., 0], scale[:, 0] * twist
    cosines = moved @ v / np.linalg.norm(moved, axis=1) / np.linalg.norm(v)
    singular = np.linalg.svd(J, compute_uv=False)
    assert (singular[:, -1] / singular[:, 0]).min() < 3e-4
    assert distances_found(arm, "free-floating", Q[::50]).min() > servo.limits.slow
    assert cosines.min() >= np.cos(np.radians(1.0))


@pytest.mark.slow
def test_a_posture_that_is_followed_no_more_is_let_go_as_fast_as_slow_is_approached():
    arm = sa.load("planar2")
    servo = sa.Servo(arm, rates=0.5, accelerations=2.0)
    q, limits, told = away_from_the_set(servo, 3, least=30.0), servo.limits, []
    last = q
    servo.memory = servo.memory._replace(held=q + 0.05)
    for _ in range(60):
        step = servo.step((q, LEVEL), [0.05, 0.02], DT)
        told.append(step.distance)
        if len(told) > 1 and told[-1] < limits.slow:
            most = limits.slow / limits.tau * DT + np.linalg.norm(q - last)
            assert told[-1] - told[-2] <= most + 1e-12
        last, q = q, q + DT * step.rates
    assert told[0] < STOP < limits.slow < told[-1]


def test_an_arm_whose_stick_is_let_go_brakes_within_its_accelerations():
    arm, push = sa.load("planar2"), 1.5
    servo = sa.Servo(arm, rates=1.0, accelerations=push)
    q = away_from_the_set(servo, 13)
    wish = smooth_twists(14, 6)
    _, rates = flown(servo, q, lambda i: wish(i) if i < 100 else np.zeros(6), 300)
    assert np.abs(rates[99]).max() > 4.0 * push * DT
    assert (np.abs(np.diff(rates, axis=0)) <= push * DT + 1e-9).all()
    assert not rates[-1].any()


def test_what_is_done_is_a_share():
    arm = sa.load("planar2")
    servo = sa.Servo(arm, rates=1.0, accelerations=1.0)
    cfg, twist = arm.at([0.3, 1.2]), np.array([0.05, 0.02])
    for share, done in ((1.0, 1.0), (-1.0, 0.0), (0.1, 1.0)):  # it brakes before it turns back
        servo.start(cfg)
        Q, _ = flown(servo, cfg.q, lambda _: np.array([*twist, 0, 0, 0, 0]), 60)
        assert servo.step((Q[-1], LEVEL), share * twist, DT).done == pytest.approx(done, abs=1e-9)


def pushed(servo, cfg, count=1500, speed=0.3):
    """Push straight along the direction that is being lost, towards the set; return the steps."""
    q, steps = cfg.q, []
    toward = servo.step((q, LEVEL), np.zeros(6), DT).away
    J = sa.generalized_jacobian(cfg)
    wished = -speed * J @ toward / np.linalg.norm(J @ toward)
    for _ in range(count):
        steps.append(servo.step((q, LEVEL), wished, DT))
        q = q + DT * steps[-1].rates
    return q, wished, steps


def test_the_set_is_approached_to_stop_left_freely_and_slid_along():
    arm = sa.load("planar2")
    servo = sa.Servo(arm, rates=2.0)
    cfg = arm.at(np.radians([30.0, 40.0]))
    servo.start(cfg)
    q, wished, steps = pushed(servo, cfg)
    assert STOP <= steps[-1].distance < 1.1 * STOP
    assert min(step.distance for step in steps) >= STOP
    assert {"lost direction", "approach"} <= set(steps[-1].slowed)
    found = sa.singularity(arm.at(q), exact=True)
    np.testing.assert_allclose(steps[-1].distance, found.distance, rtol=1e-3, atol=0)
    back = servo.step((q, LEVEL), -0.1 * wished, DT)
    assert back.closing < 0.0
    assert "lost direction" not in back.slowed
    along = np.linalg.svd(arm.task.jacobian(sa.generalized_jacobian(arm.at(q)), np.eye(3)))[0][:, 0]
    slid = servo.step((q, LEVEL), 0.02 * along, DT)
    assert slid.done > 0.9


def test_redundant_joints_raise_the_distance_and_leave_the_tip_its_motion():
    arm = sa.load("planar3", task="x y")
    servo = sa.Servo(arm, slow=np.radians(120.0), stop=np.radians(1.0), rates=5.0)
    q = away_from_the_set(servo, 8)
    step = servo.step((q, LEVEL), [0.01, 0.02], DT)
    J = sa.generalized_jacobian(arm.at(q))[:2]
    least = np.linalg.pinv(J) @ (J @ step.rates)
    raised = step.rates - least
    assert step.away @ raised > 1e-4
    np.testing.assert_allclose(J @ raised, 0.0, rtol=0, atol=1e-12)


def test_a_second_arm_keeps_the_attitude():
    one = planar_pair(tip="left", joints="all")
    q = away_from_the_set(sa.Servo(one), 9)
    cfg, turned = one.at(q), []
    for keep in (False, True):
        servo = sa.Servo(one, keep_attitude=keep, rates=5.0)
        servo.start(cfg)
        step = servo.step(cfg, [0.05, 0.02, 0.0, 0.0, 0.0, 0.03], DT)
        assert step.done > 0.999
        turned.append(np.linalg.norm(sa.base_velocity(cfg, step.rates)[3:]))
    assert turned[1] < 0.02 * turned[0]


@pytest.mark.parametrize("m", [1, 2, 5])
def test_a_null_space_that_hardly_turns_the_spacecraft_makes_no_fast_motions(m):
    """It makes up for the motion exactly as far as it can, and changes its sign through rest."""
    rng = np.random.default_rng(18)
    N, y = np.linalg.qr(rng.normal(size=(8, 8)))[0][:, :m].T, rng.normal(size=8)
    beside = np.eye(8) - N.T @ N
    y, others = beside @ y, rng.normal(size=(3, 8)) @ beside
    B = np.eye(3, m) * np.array([[1.0], [1.5], [2.0]])

    def made_up(share):
        return levelling(numbers, list(N), share * B @ N + others, y)

    wanted = -np.linalg.lstsq(B, others @ y, rcond=None)[0] @ N
    np.testing.assert_allclose(made_up(1.0), wanted, rtol=0, atol=1e-3 * np.linalg.norm(wanted))
    most = LEVELS * np.linalg.norm(y) * (1.0 + 1e-9)
    for share in np.geomspace(1.0, 1e-9, 60):
        assert np.linalg.norm(made_up(share)) <= most
        assert np.linalg.norm(made_up(-share) + made_up(share)) <= 1e-9 * most
    assert np.linalg.norm(made_up(1e-9)) < 1e-3 * np.linalg.norm(y)


@pytest.mark.parametrize("dt", [1e-5, 0.1])
def test_wheels_take_up_no_more_than_their_budget(dt):
    arm, mode = sa.load("planar2"), "attitude-controlled"
    free = sa.Servo(arm, mode=mode, rates=1.0)
    q = away_from_the_set(free, 10)

    def most(step):
        way = [arm.at(q + dt * share * step.rates).A[3:, 6:] for share in np.linspace(0.0, 1.0, 9)]
        return np.linalg.norm(way @ step.rates, axis=1).max()

    budget = 0.6 * most(free.step((q, LEVEL), [0.5, 0.4], dt))
    servo = sa.Servo(arm, mode=mode, wheels=budget, rates=1.0)
    servo.start((q, LEVEL))
    step = servo.step((q, LEVEL), [0.5, 0.4], dt)
    assert "wheels" in step.slowed
    assert 0.98 * budget < most(step) <= budget


NAN = np.full(2, np.nan)


@pytest.mark.parametrize(
    ("posture", "twist", "dt", "reason"),
    [
        ((NAN, LEVEL), 0.1, DT, "positions"),
        (([np.inf, 0.1], LEVEL), 0.1, DT, "positions"),
        ((None, np.zeros(4)), 0.1, DT, "quaternion"),
        ((None, [0, 0, np.nan, 1]), 0.1, DT, "quaternion"),
        ((None, 2.0 * np.eye(4)), 0.1, DT, "quaternion"),
        ((None, np.diag([1.0, 1.0, -1.0, 1.0])), 0.1, DT, "quaternion"),
        ((None, LEVEL), np.nan, DT, "twist"),
        ((None, LEVEL), np.inf, DT, "twist"),
        ((None, LEVEL), 0.1, 0.0, "dt"),
        ((None, LEVEL), 0.1, -1.0, "dt"),
        ((None, LEVEL), 0.1, np.nan, "dt"),
        ((None, LEVEL), 0.1, 1e9, "dt"),
        ((None, LEVEL), 0.1, 0.101, "to 0.1 s"),
        ((None, LEVEL), 0.1, 1e-308, "from 1e-09 s"),
        (([3.0, -2.0], LEVEL), 0.1, DT, "faster than twice"),
    ],
)
def test_whatever_comes_in_brings_the_arm_to_rest_within_its_limits(posture, twist, dt, reason):
    arm = sa.load("planar2")
    servo = sa.Servo(arm, rates=1.0, accelerations=2.0)
    q = np.array([0.3, 1.2])
    servo.start((q, LEVEL))
    Q, rates = flown(servo, q, lambda _: np.full(6, 0.2), 30)
    last = rates[-1]
    given = (Q[-1] if posture[0] is None else posture[0], posture[1])
    for _ in range(100):
        step = servo.step(given, np.full(6, twist), dt)
        assert reason in step.halted
        assert (np.abs(step.rates - last) <= 2.0 * DT + 1e-12).all()
        assert (np.abs(step.rates) <= np.abs(last) + 1e-12).all()
        last = step.rates
        if "faster" in step.halted:
            break
    else:
        assert not last.any()
    assert reason in step.verdict


@pytest.mark.parametrize("field", ticks.Memory._fields)
def test_a_number_that_is_not_finite_is_not_remembered(field):
    """Whatever made it, the servo halts, says so and goes on when it has searched anew."""
    arm = sa.load("planar2")
    servo = sa.Servo(arm, rates=1.0, accelerations=2.0)
    q = np.array([0.3, 1.2])
    servo.start((q, LEVEL))
    twist = np.array([0.1, 0.0])
    servo.step((q, LEVEL), twist, DT)
    servo.memory = servo.memory._replace(**{field: np.nan * getattr(servo.memory, field)})
    steps = [servo.step((q, LEVEL), twist, DT) for _ in range(ticks.SEARCH + 5)]
    assert steps[0].halted
    assert all(np.isfinite(packed(servo.memory)))
    assert all(np.isfinite(step.rates).all() for step in steps)
    assert steps[-1].halted == ""
    assert steps[-1].rates.any()


def test_a_step_too_short_to_divide_by_halts_and_leaves_no_trace():
    arm = sa.load("planar2")
    servo, q, twist = sa.Servo(arm, rates=1.0), np.array([0.3, 1.2]), np.array([0.1, 0.0])
    servo.start((q, LEVEL))
    before = servo.step((q, LEVEL), twist, DT)
    for dt in (1e-308, 5e-324, 1e-10):
        assert "dt" in servo.step((q, LEVEL), twist, dt).halted
    after = servo.step((q, LEVEL), twist, DT)
    assert after.halted == ""
    np.testing.assert_allclose(after.rates, before.rates, rtol=1e-3, atol=1e-6)
    assert np.isfinite(servo.step((q, LEVEL), twist, ticks.SHORTEST).rates).all()


def test_one_faulty_message_and_uneven_ticks_are_no_jumps():
    arm = sa.load("planar2")
    rng = np.random.default_rng(0)
    for _ in range(20):
        servo = sa.Servo(arm, rates=1.0, accelerations=2.0)
        q = away_from_the_set(servo, 16)
        for i, dt in enumerate(rng.choice([1e-3, 0.02, 0.1], 60)):
            lost = i % 10 == 5
            step = servo.step((NAN if lost else q, LEVEL), np.full(6, 0.2), dt)
            assert bool(step.halted) == lost
            q = q + dt * step.rates


@pytest.mark.parametrize(
    ("posture", "dt", "name"),
    [
        (([10**400, 1.2], LEVEL), DT, "q"),
        (([0.3, 1.2], "abc"), DT, "base"),
        (([0.3, 1.2], LEVEL), 10**400, "dt"),
    ],
    ids=["q", "base", "dt"],
)
def test_what_is_no_number_is_named(posture, dt, name):
    with pytest.raises(sa.ConfigurationError, match=f"{name} is"):
        sa.Servo(sa.load("planar2")).step(posture, [0.1, 0.0], dt)


def test_without_a_start_it_searches_before_it_moves():
    arm = sa.load("planar2")
    servo, started = sa.Servo(arm), sa.Servo(arm)
    q, twist = away_from_the_set(started, 12), [0.02, 0.01]
    steps = [servo.step((q, LEVEL), twist, DT) for _ in range(ticks.SEARCH + 2)]
    assert "looked for" in steps[0].halted
    assert not steps[0].rates.any()
    assert not steps[-1].halted
    assert steps[-1].rates.any()
    wanted = started.step((q, LEVEL), twist, DT).distance
    assert steps[-1].distance >= wanted * (1.0 - 1e-6)  # found: none of both is nearer than the set


def test_what_is_proven_falls_with_the_way():
    arm = sa.load("planar2")
    servo, cfg = sa.Servo(arm), sa.load("planar2").at([0.3, 1.2])
    told = []
    servo.start((cfg.q, LEVEL), prove=True, progress=lambda done, of: told.append((done, of)))
    assert told
    first = servo.step((cfg.q, LEVEL), np.zeros(6), DT)
    assert 0.98 * first.distance < first.distance_proven <= first.distance
    moved = servo.step((cfg.q + 0.004, LEVEL), np.zeros(6), DT)
    way = 0.004 * np.sqrt(2.0)
    np.testing.assert_allclose(
        moved.distance_proven, first.distance_proven - way, rtol=1e-9, atol=0
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stop": 0.3, "slow": 0.2}, "stop < slow"),
        ({"rates": -1.0}, "rates is -1.0"),
        ({"rates": [1.0, 2.0, 3.0]}, "one for each of"),
        ({"frame": "hand"}, "frame"),
        ({"mode": "tied"}, "mode"),
        ({"tau": 0.0}, "tau"),
        ({"wheels": -1.0}, "wheels"),
    ],
)
def test_arguments_that_make_no_sense_are_named(options, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.Servo(sa.load("planar2"), **options)


def test_arms_that_it_cannot_lead_are_refused():
    arm = sa.load("planar2")
    with pytest.raises(sa.UnsupportedError, match="more joints"):
        sa.Servo(arm, keep_attitude=True)
    with pytest.raises(sa.UnsupportedError, match="task"):
        sa.Servo(sa.load("planar2", task="x y rz"))
