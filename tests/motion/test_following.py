"""Following: the story of figure 7, singularities that stop, closed forms, bad input."""

import warnings

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import chosen, load_text, random_chain, with_wheels
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

import spacearm as sa
from spacearm.mechanics.jacobian import generalized_jacobian_rate
from spacearm.motion import following
from spacearm.motion.following import Segment, TipCurve, state_of

E, A, B, C = (2.0, 0.0), np.radians([-57.936, 60.337]), (1.5, 1.5), np.array([1.0, 0.0])


def at_the_cm(arm, q, attitude):
    """The spacecraft's pose that puts the system CM at the origin."""
    R = pin.exp3(np.array([0.0, 0.0, np.radians(attitude)]))
    return pin.SE3(R, -arm.at(q, base=pin.SE3(R, np.zeros(3))).com)


def attitude(run):
    return np.degrees(pin.log3(run[-1].base.rotation)[2])


@pytest.fixture(scope="module")
def arm():
    return sa.load("planar2")


@pytest.fixture(scope="module")
def to_c(arm):
    return sa.follow(arm.at(A, base=at_the_cm(arm, A, 20.94)), [C])


# --- figure 7 -------------------------------------------------------------------------------


def test_the_direct_line_stops_at_a_singularity(arm):
    run = sa.follow(arm.at(A, base=at_the_cm(arm, A, 21.0)), [B])
    assert run.ended == "singularity"
    assert "singular after 1.193 of 1.581 m" in run.reason
    assert run.sigma_min[-1] < 1e-12
    assert abs(sa.singularity_polynomial(arm)(run.q[-1])) < 1e-9
    line = run.tip[:, :2] - E
    towards = np.subtract(B, E) / np.linalg.norm(np.subtract(B, E))
    assert np.abs(line[:, 0] * towards[1] - line[:, 1] * towards[0]).max() < 1e-4  # E is rounded


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(i, marks=pytest.mark.slow) for i in range(4, 9))]
)
def test_a_goal_just_before_a_singularity_is_arrived_at(seed):
    """One step of the integration may lead past both, and back along the path behind it."""
    rng = chosen(seed)
    arm = load_text(random_chain(rng, 3, ("revolute",)), tip="tip", task="position")
    start = arm.at(rng.uniform(-1.5, 1.5, 3))
    line = rng.normal(size=3)
    tip, line = start.tip.translation, line / np.linalg.norm(line)
    stopped = sa.follow(start, [tip + 5.0 * line], limits=False)
    assert stopped.ended == "singularity"
    for share in (0.998, 0.9999, 1.001):
        length = share * stopped.s[-1]
        run = sa.follow(start, [tip + length * line], limits=False)
        assert run.ended == ("arrived" if share < 1.0 else "singularity")
        assert run.s[-1] == pytest.approx(min(length, stopped.s[-1]), rel=1e-8)


def test_to_c(to_c):
    assert to_c.arrived
    assert attitude(to_c) == pytest.approx(39.6, abs=0.05)
    np.testing.assert_allclose(np.degrees(to_c.q[-1]), (-134.2, 134.4), atol=0.05)
    np.testing.assert_allclose(to_c.tip[-1, :2], C, atol=1e-9)


@pytest.mark.slow
def test_nine_turns_about_c_and_then_to_b(to_c):
    corners = [C + 0.2 * np.array(p) for p in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    start = to_c[-1]
    turns = sa.follow(start, [*(9 * corners), corners[0], C], limits=False)
    assert attitude(turns) == pytest.approx(73.1, abs=0.05)
    end = turns[-1]
    arrived = sa.follow(end, [B], limits=False)
    assert arrived.arrived
    np.testing.assert_allclose(arrived.tip[-1, :2], B, atol=1e-9)


def test_from_the_printed_attitude_to_b(arm):
    """The paper's end, 21.29 and (7.57, 41.90), has its own tip 1.9 mm off B; hence 0.35 deg."""
    q = np.radians([-160.95, 117.3])
    run = sa.follow(arm.at(q, base=at_the_cm(arm, q, 73.6)), [C, B])
    assert run.arrived
    assert attitude(run) == pytest.approx(21.29, abs=0.2)
    np.testing.assert_allclose(np.degrees(run.q[-1]), (7.57, 41.90), atol=0.35)
    printed = arm.at(
        np.radians([7.57, 41.90]), base=at_the_cm(arm, np.radians([7.57, 41.90]), 21.29)
    )
    assert np.linalg.norm(printed.tip.translation[:2] - B) > 1e-3


# --- an independent route -------------------------------------------------------------------


def test_the_same_motion_by_the_barycentric_jacobian(arm):
    base = at_the_cm(arm, A, 20.94)
    run = sa.follow(arm.at(A, base=base), [C])

    def rate(_, y):
        cfg = arm.at(y[:2], base=pin.SE3(pin.exp3(np.array([0, 0, y[2]])), np.zeros(3)))
        dq = np.linalg.solve(sa.barycentric(cfg).generalized_jacobian()[:2], C - tip)
        return np.append(dq, sa.base_velocity(cfg, dq)[5])

    tip = arm.at(A, base=base).tip.translation[:2]
    y = solve_ivp(rate, (0, 1), [*A, np.radians(20.94)], rtol=1e-11, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(run.q[-1], y[:2], atol=1e-8)
    assert attitude(run) == pytest.approx(np.degrees(y[2]), abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["free-floating", "attitude-controlled", "fixed"])
def test_there_and_back_returns_a_square_task_to_its_joints(mode):
    """Along one line and back the path encloses nothing."""
    arm = sa.load("mda6")
    q = np.array([0.0, 1.0, -1.7, -0.9, 0.5, 0.0])
    home = arm.at(q).tip
    away = pin.SE3(pin.exp3(np.array([0.1, 0.2, -0.1])) @ home.rotation, home.translation + 0.1)
    run = sa.follow(arm.at(q), [away, home], mode=mode)
    assert run.arrived
    np.testing.assert_allclose(run.q[-1], q, atol=1e-7)
    half = np.abs(run.s - run.length / 2).argmin()
    np.testing.assert_allclose(run[half].tip.translation, away.translation, atol=0.02)
    if mode != "free-floating":
        np.testing.assert_allclose(
            run.base[:, 3:], run.base[:1, 3:].repeat(len(run.t), 0), atol=1e-12
        )


def test_a_path_that_is_a_function(to_c):
    def circle(s):
        return C + 0.2 * np.array([np.cos(s / 0.2), -np.sin(s / 0.2)])

    start = to_c[-1]
    run = sa.follow(start, circle, length=0.4 * np.pi, speed=0.2)
    assert run.arrived
    assert run.length == pytest.approx(0.2 + 0.4 * np.pi)
    np.testing.assert_allclose(run.t, run.s / 0.2, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(run.tip[run.s > 0.2, :2] - C, axis=1), 0.2, atol=1e-7)
    turned = pin.log3(run[-1].base.rotation @ run[np.sum(run.s < 0.2)].base.rotation.T)
    assert np.degrees(np.linalg.norm(turned)) > 1.0  # a closed path turns the spacecraft


def test_a_redundant_arm_and_the_momentum_of_its_motion():
    arm = sa.load("chaser7", task="position")
    q = np.array([0.3, 0.8, -0.4, 1.1, 0.2, 0.6, 0.1])
    goal = arm.at(q).tip.translation + np.array([0.2, -0.1, 0.1])
    run = sa.follow(arm.at(q), [goal])
    assert run.arrived
    np.testing.assert_allclose(run.tip[-1, :3], goal, atol=1e-9)
    com = np.array([run[i].com for i in range(len(run.t))])
    np.testing.assert_allclose(com, com[:1].repeat(len(com), 0), atol=1e-12)
    moved = run[0]
    for i in range(1, len(run.t)):
        moved = sa.move(moved, run.q[i])
    np.testing.assert_allclose(moved.base.homogeneous, run[-1].base.homogeneous, atol=1e-5)


TILTS = {
    "x": (np.pi / 2, 0.0, 0.0),
    "upside down": (np.pi, 0.0, 0.0),
    "oblique": (0.9, -0.5, 0.0),
    "nearly upside down": (2.2, 2.2, 0.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("tilt", TILTS)
def test_in_a_tilted_plane_all_is_as_in_the_flat_one(arm, tilt):
    """Points are given along the tilted axes: neither joints nor sigma_min tell the difference."""
    tilt = pin.SE3(pin.exp3(np.array(TILTS[tilt])), np.zeros(3))
    flat = at_the_cm(arm, A, 21.0)
    law = sa.TransposedJacobian(target=C, kp=5, kd=15)
    for motion in (
        lambda base: sa.follow(arm.at(A, base=base), [C]),
        lambda base: sa.plan(arm.at(A, base=base), C, search=sa.Search(method="straight")),
        lambda base: sa.plan(arm.at(A, base=base), C, search=sa.Search(method="joint space")),
        lambda base: sa.simulate(arm.at(A, base=base), law, 3.0),
    ):
        one, other = motion(flat), motion(tilt * flat)
        np.testing.assert_allclose(other.q[-1], one.q[-1], atol=1e-6)
        np.testing.assert_allclose(other.sigma_min[-1], one.sigma_min[-1], atol=1e-6)
        np.testing.assert_allclose(other.tip[-1, :3], tilt.act(one.tip[-1, :3]), atol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_rows_that_turn_with_the_spacecraft_are_followed_and_judged_in_inertial_axes(seed):
    rng = np.random.default_rng(seed)
    locked = dict(zip([f"joint_{i}" for i in (2, 4, 5, 6)], rng.uniform(-2, 2, 4), strict=True))
    arm = sa.load("mda6", locked=locked, task="x y")
    q0, base = rng.uniform(-1.5, 1.5, 2), pin.SE3(pin.exp3(rng.normal(size=3)), np.zeros(3))
    goal = arm.at(q0, base=base).tip.translation[:2] + 0.3 * rng.normal(size=2)
    run = sa.follow(arm.at(q0, base=base), [goal], limits=False)
    if run.arrived:
        np.testing.assert_allclose(run.tip[-1, :2], goal, atol=1e-8)
    else:
        assert run.sigma_min[-1] < 1e-6 * run.sigma_min[0]


@pytest.mark.slow
def test_joint_limits_stop(arm, to_c):
    start = to_c[-1]
    corners = [C + 0.2 * np.array(p) for p in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    run = sa.follow(start, 9 * corners)
    assert run.ended == "joint limit"
    assert "'joint_1' reaches its limit" in run.reason
    assert run.q[-1, 0] == pytest.approx(arm.lower[0], abs=1e-9)


def test_a_motion_plays(to_c):
    motion = sa.Motion.of(to_c)
    np.testing.assert_allclose(motion.at(motion.t[-1]).tip.translation[:2], C, atol=1e-9)


# --- bad input ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("q0", "path", "options", "message"),
    [
        (A, [(1.0, 0.0, 0.0)], {}, r"path\[0\] is .* 2 finite numbers"),
        (A, [(1.0, 0.0), (1.0,)], {}, r"path\[1\] is \(1.0,\); give 2 finite numbers"),
        (A, [], {}, "give corners"),
        (A, 3.0, {}, "path is 3.0; give a list"),
        (A, (1.0, 0.0), {}, r"give corners \(one: \[goal\]\)"),
        (A, lambda s: (s, 0.0), {}, "length is None"),
        (A, [(1.0, 0.0)], {"length": 1.0}, "polyline"),
        (A, [(1.0, 0.0)], {"speed": 0.0}, "speed is 0"),
        (A, [(1.0, 0.0)], {"mode": "free"}, "free-floating"),
        ((0.0, 0.0), [(1.0, 0.0)], {}, "the start is singular"),
        ((4.0, 1.0), [(1.0, 0.0)], {}, "limits=False"),
    ],
)
def test_bad_input(arm, q0, path, options, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.follow(arm.at(q0), path, **options)


@pytest.mark.slow
def test_only_who_calls_follow_is_warned_of_a_start_beyond_the_limits(arm):
    q0 = (3.9, 1.0)
    with pytest.warns(sa.ModelWarning, match="of planar2: joint 'joint_1' at 3.9 rad"):
        run = sa.follow(arm.at(q0), [(1.0, 0.0)], limits=False)
    start = run[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = sa.follow(start, [(1.0, 0.0)], limits=False)
    np.testing.assert_array_equal(again.q, run.q)


def test_nothing_to_follow(arm):
    with pytest.raises(sa.ConfigurationError, match="nothing to follow"):
        sa.follow(arm.at(A), [arm.at(A).tip.translation[:2]])


def test_a_task_with_more_rows_than_joints():
    with pytest.raises(sa.UnsupportedError, match="3 rows"):
        sa.follow(sa.load("planar2", task="x y rz").at(A), [pin.SE3.Identity()])


# --- paths in time --------------------------------------------------------------------------


def test_one_corner_with_a_time_is_passed_by_the_cubic_from_rest_to_rest(arm):
    start = arm.at([0.3, 1.2])
    run = sa.follow(start, [(1.3, 1.25)], times=[4.0])
    u = run.t[:, None] / 4.0
    way = np.subtract((1.3, 1.25), start.tip.translation[:2])
    cubic = start.tip.translation[:2] + (3.0 * u**2 - 2.0 * u**3) * way
    np.testing.assert_allclose(run.tip[:, :2], cubic, atol=1e-8)
    assert run.arrived
    assert run.t[-1] == pytest.approx(4.0, abs=1e-9)
    assert run.length == pytest.approx(np.linalg.norm(way), rel=1e-6)
    assert run.s[-1] == pytest.approx(run.length, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("at_rest", [True, False])
def test_corners_are_passed_at_their_times(at_rest):
    arm = sa.load("mda6")
    start = arm.at([0.3, 0.8, 0.6, 0.3, 0.5, 0.1])
    corners = [arm.at(start.q + share).tip for share in (0.05, 0.12, 0.15)]
    times = [1.0, 2.5, 4.0]
    run = sa.follow(start, corners, times=times, at_rest=at_rest, limits=False)
    assert run.arrived
    place = make_interp_spline(run.t, run.tip[:, :3], k=3)
    for t, corner in zip(times, corners, strict=True):
        np.testing.assert_allclose(place(t), corner.translation, atol=1e-5)
    end = run[-1].tip.rotation.T @ corners[-1].rotation
    assert np.linalg.norm(pin.log3(end)) < 1e-7
    ends = np.linalg.norm(place(run.t[[0, -1]], 1), axis=1)
    assert (ends < 1e-3).all() == at_rest


def test_a_path_in_time_of_rounded_numbers_begins_where_the_tip_is(arm):
    start = arm.at([0.3, 1.2])
    here = start.tip.translation[:2]
    run = sa.follow(start, [here.round(7), np.add(here, (0.05, -0.02))], times=[0.0, 5.0])
    assert not run.jumps
    assert np.abs(run.dq[0]).max() < 1e-9


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"times": [1.0]}, "times"),
        ({"times": [2.0, 1.0]}, "increasing"),
        ({"times": [1.0, -1.0]}, "increasing"),
        ({"times": [-1.0, 1.0]}, "increasing"),
        ({"times": [1e-308, 1.0]}, "1e-12 s apart"),
        ({"times": [1.0, 1.0 + 1e-15]}, "1e-12 s apart"),
        ({"times": [0.0, 1.0]}, r"begins at 0 s 0\.\d+ m from where the tip is"),
        ({"times": [1.0, 2.0], "speed": 0.1}, "leave out speed"),
    ],
)
def test_wrong_times_are_refused(arm, options, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.follow(arm.at([0.3, 1.2]), [(1.2, 1.2), (1.3, 1.2)], **options)


def test_a_path_that_begins_elsewhere_is_told_how_far_in_the_unit_of_the_row():
    start = sa.load("mda6").at(np.radians([0, 60, -100, -50, 30, 0]))
    turned = start.tip * sa.pose(rpy=(0.3, 0, 0))
    with pytest.raises(sa.ConfigurationError, match=r"begins at 0 s 0\.\d+ rad from where"):
        sa.follow(start, [turned, start.tip], times=[0.0, 1.0])


@pytest.mark.slow
def test_a_path_in_time_is_stopped_by_the_singularity_that_stops_the_line(arm):
    start = arm.at(A, base=at_the_cm(arm, A, 21.0))
    run = sa.follow(start, [B], times=[10.0])
    line = sa.follow(start, [B])
    assert run.ended == "singularity"
    assert run.s[-1] == pytest.approx(line.s[-1], abs=1e-5)
    np.testing.assert_allclose(run.q[-1], line.q[-1], atol=1e-5)


# --- rates ------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 6, 7])
def test_rates_and_accelerations_are_those_of_the_line(n):
    """Along a straight line at a constant speed J* dq is constant: J* ddq + dJ*/dt dq = 0."""
    kinds = ("revolute", "prismatic")
    arm = sa.load("planar2") if n == 2 else load_text(random_chain(chosen(n), n, kinds))
    start = arm.at(np.linspace(0.3, 1.2, n))
    run = sa.follow(start, [arm.at(start.q + 0.05).tip], speed=0.2, limits=False)
    for cfg, dq, ddq in zip(run, run.dq, run.ddq, strict=True):
        bend = sa.generalized_jacobian(cfg) @ ddq + generalized_jacobian_rate(cfg, dq) @ dq
        np.testing.assert_allclose(bend[arm.task.indices], 0.0, atol=1e-7)
    q = make_interp_spline(run.t, run.q, k=5)
    middle = slice(len(run) // 4, -len(run) // 4)
    for order, values in ((1, run.dq), (2, run.ddq)):
        size = np.abs(values).max()
        np.testing.assert_allclose(q(run.t, order)[middle], values[middle], atol=1e-4 * size)


def test_rates_jump_at_corners_and_ends_by_what_turns_the_tip(arm, tmp_path):
    start, speed = arm.at([0.3, 1.2]), 0.2
    corners = np.array([start.tip.translation[:2], (1.5, 1.2), (1.5, 1.1)])
    run = sa.follow(start, corners[1:], speed=speed, mode="attitude-controlled")
    legs = np.diff(corners, axis=0)
    v = speed * legs / np.linalg.norm(legs, axis=1)[:, None]
    changes = v[0], v[1] - v[0], -v[1]
    assert [jump.t for jump in run.jumps] == pytest.approx(
        [0.0, np.linalg.norm(legs[0]) / speed, run.t[-1]]
    )
    sizes = []
    for jump, change in zip(run.jumps, changes, strict=True):
        cfg = arm.at(jump.q)
        J = sa.generalized_jacobian(cfg, mode=run.mode)[:2]
        np.testing.assert_allclose(J @ jump.change, change, atol=1e-8)
        sizes.append(np.linalg.norm(cfg.A[3:, 6:] @ jump.change))
    found = sa.reaction(run)
    assert found.jump == pytest.approx(max(sizes))
    assert f"{max(sizes):.4g} N m s at once" in " ".join(found.describe().notes)
    run.save(tmp_path / "run.npz")
    again = sa.Motion.load(tmp_path / "run.npz", arm)
    np.testing.assert_array_equal(again.jumps[1].change, run.jumps[1].change)
    np.testing.assert_array_equal(again.ddq, run.ddq)


@pytest.mark.slow
def test_a_path_with_times_starts_from_rest_without_a_jump(arm):
    run = sa.follow(arm.at([0.3, 1.2]), [(1.3, 1.25), (1.2, 1.1)], times=[4.0, 6.0])
    assert not run.jumps
    np.testing.assert_allclose(run.dq[[0, -1]], 0.0, atol=1e-9)
    momentum, torque = sa.reaction(run).momentum[:, 2], sa.reaction(run).torque[:, 2]
    corner = np.searchsorted(run.t, 4.0)
    for part in (slice(0, corner), slice(corner, None)):
        rate = make_interp_spline(run.t[part], momentum[part], k=5).derivative()
        size = np.abs(torque).max()
        np.testing.assert_allclose(rate(run.t[part]), torque[part], atol=1e-3 * size)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "mode"), [(0, "attitude-controlled"), (1, "free-floating")])
def test_with_momentum_the_tip_passes_the_corners_as_simulated(seed, mode):
    """The tip and the momentum of `simulate`, whose equations know nothing of paths."""
    rng = chosen(seed)
    text = with_wheels(random_chain(rng, 6, ("revolute",)), np.eye(3))
    arm = load_text(text, tip="tip", task="pose")
    q = rng.uniform(-1.5, 1.5, 6)
    while sa.singularity(arm.at(q), mode=mode).distance < 0.25:
        q = rng.uniform(-1.5, 1.5, 6)
    still = arm.at(q)
    momentum = np.concatenate((arm.mass * 0.01 * rng.normal(size=3), 0.02 * rng.normal(size=3)))
    wheels = 0.05 * rng.normal(size=3)
    if mode == "attitude-controlled":
        momentum[3:], wheels = 0.0, np.zeros(3)
    start = still.with_momentum(momentum).with_wheels(wheels)
    goal = still.tip * pin.SE3(pin.exp3(0.02 * rng.normal(size=3)), 0.02 * rng.normal(size=3))
    way = sa.follow(start, [goal], times=[2.0], mode=mode, limits=False)
    assert way.arrived, way.reason
    assert np.linalg.norm(pin.log6(goal.actInv(way[-1].tip))) < 1e-8
    law = sa.Tracking(way)
    run = sa.simulate(start, law, 2.0, dq=way.dq[0], mode=mode)
    ends = run[-1].tip
    off = pin.log6(ends.actInv(goal))
    assert np.linalg.norm(off) < 1e-5
    np.testing.assert_allclose(run[-1].com - start.com, 2.0 * momentum[:3] / arm.mass, atol=1e-9)


def test_a_redundant_arm_that_hardly_moves_its_tip_is_stuck():
    """Of a path of which a metre takes a million radians."""
    arm = sa.load("chaser7")
    cfg = arm.at([0.2, 0.6, 0, 1.2, 0, 0.8, 0])
    for size, stuck in ((1.0, False), (1e6, True)):
        far = Segment(1.0, lambda _: cfg.tip, lambda _, v=size: v * np.eye(6)[0], True)
        curve = TipCurve(cfg, far, "free-floating", True)
        y = state_of(cfg, 0.0)
        assert (curve.rooms(y)[0] < 0.0) == stuck
    assert "1e5 times" in curve.event(0.0, y, "singularity").detail


def test_progress_is_that_of_the_whole_path():
    told = []
    corners = [(1.5, 1.2), (1.4, 1.2), (1.4, 1.3)]
    cfg = sa.load("planar2").at([0.3, 1.2])
    found = sa.follow(cfg, corners, progress=lambda *done: told.append(done))
    assert found.arrived
    assert told == sorted(told)
    assert {of for _, of in told} == {told[-1][0]}
    assert told[-1][0] == pytest.approx(found.length)


@pytest.mark.parametrize("name", ["planar2", pytest.param("chaser7", marks=pytest.mark.slow)])
def test_what_a_second_counts_changes_no_motion(name, monkeypatch):
    """A second counts less on a long path, for the integrator alone; with momentum, too."""
    arm = sa.load(name)
    start = arm.at([0.3, 1.2] if name == "planar2" else [0.1, 1.0, 0.1, 1.0, 0.1, 1.0, 0.1])
    start = start.with_momentum(0.01 * np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))
    goal = start.tip * pin.SE3(np.eye(3), np.array([0.02, -0.03, 0.0]))
    runs = []
    for longest in (40.0, 0.25):
        monkeypatch.setattr(following, "LONGEST", longest)
        runs.append(sa.follow(start, [goal], times=[2.0], limits=False))
    many, few = runs
    assert many.arrived
    assert few.arrived
    assert len(few.t) < len(many.t)
    for name in ("q", "dq", "ddq", "s"):
        there = make_interp_spline(many.t, getattr(many, name), k=5)(few.t[:-1])
        size = np.abs(getattr(many, name)).max()
        np.testing.assert_allclose(getattr(few, name)[:-1], there, rtol=0.0, atol=1e-5 * size)


@pytest.mark.slow
def test_a_path_of_hours_has_no_more_rows_than_one_of_a_minute():
    start = sa.load("planar2").at([0.3, 1.2])
    rows = [len(sa.follow(start, [(1.5, 1.2)], times=[t]).t) for t in (60.0, 18262.0, 1e9)]
    assert max(rows) < 1.1 * min(rows)
