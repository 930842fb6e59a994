"""Detumbling: momentum stays, the spacecraft comes to rest, wheels keep their limits."""

import json

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import chosen, load_text, random_chain, with_wheels
from helpers.commands import spacearm
from scipy.interpolate import make_interp_spline

import spacearm as sa
from spacearm.planning.reactions import Wheels
from spacearm.planning.strategies.detumbling import least_time
from spacearm.planning.strategies.rest_motion import WAVES, RestMotion

Q0, GOAL = [0.3, 1.2], (0.9, 1.4)
H = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 1.0])
SKEW = np.array([[1, 1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, -1]]) / np.sqrt(3)


@pytest.fixture(scope="module")
def arm():
    return load_text(with_wheels("planar2", (0, 0, 1)))


@pytest.fixture(scope="module")
def found(arm):
    return sa.detumble(arm.at(Q0, momentum=H), GOAL)


def spatial(axes, mark="<wheel/>", n=4):
    text = with_wheels(random_chain(chosen(3), n, ("revolute",)), axes, mark=mark)
    joints = "tip" if mark else "all"
    return load_text(text, tip="tip", task="position", joints=joints)


@pytest.fixture(scope="module")
def turned():
    """Four skew wheels, and an attitude stated."""
    arm, h = spatial(SKEW), [0.0, 0.0, 0.0, 1.0, -0.5, 0.8]
    goal, end = sa.Joints(np.full(4, 0.4)), pin.exp3(np.array([0.1, 0.2, -0.1]))
    start = arm.at(np.zeros(4), wheels=[0.1, 0.0, -0.2, 0.0], momentum=h)
    return sa.detumble(start, goal, final_attitude=end, duration=15.0)


def flown(plan, rtol=1e-8):
    law = sa.Tracking(plan)
    return sa.simulate(
        plan[0],
        law,
        plan.t[-1],
        plant=sa.Plant(wheels=law.wheel_torques),
        integration=sa.Integration(rtol=rtol),
    )


def rates_at(run, i):
    """Angular velocity of the spacecraft."""
    return sa.base_velocity(run[i], run.dq[i])[3:]


def assert_close(computed, expected, rtol, size=None):
    """Compare by the size of the whole, so that zeros among the numbers are zeros by rounding."""
    size = np.linalg.norm(expected) if size is None else size
    np.testing.assert_allclose(computed, expected, rtol=0.0, atol=rtol * size)


def assert_at_rest(run):
    """Compare with the rates that the momentum of the start gives when nothing moves."""
    before = sa.base_velocity(run[0], np.zeros(run.arm.n))[3:]
    assert np.linalg.norm(before) > 0.01
    assert_close(rates_at(run, -1), 0.0, 1e-6, np.linalg.norm(before))


@pytest.mark.slow
def test_a_simulation_with_the_wheels_torques_ends_at_rest_at_the_goal(found):
    run = flown(found, rtol=1e-7)
    assert_at_rest(run)
    assert_close(run.tip[-1, :2], GOAL, 1e-6)
    assert_close(run.com[-1] - run.com[0], H[:3] / run.arm.mass * found.t[-1], 1e-7)
    assert_close(run.wheels[-1], H[5:], 1e-8)
    assert found.certificate.free
    assert found.apart


@pytest.mark.slow
def test_a_spatial_spacecraft_comes_to_rest_at_the_attitude_stated(turned):
    run = flown(turned, rtol=1e-8)
    assert_at_rest(run)
    expected = pin.exp3(np.array([0.1, 0.2, -0.1]))
    assert_close(run[-1].base.rotation, expected, 1e-6)
    assert_close(turned[-1].base.rotation, expected, 2e-8)
    assert_close(run.q[-1], 0.4, 1e-6)
    assert_close(SKEW.T @ run.wheels[-1], expected.T @ turned.momentum[0, 3:], 1e-7)


@pytest.mark.slow
def test_momentum_stays_by_pinocchio_with_wheels_that_are_joints(turned):
    """The spacecraft's angular velocity is that of its recorded attitudes."""
    full = spatial(SKEW, mark="")
    names = list(full.joint_names)
    mine = [names.index(name) for name in turned.arm.joint_names]
    wheels = [names.index(wheel.name) for wheel in turned.arm.wheels]
    turns = make_interp_spline(turned.t, turned.base[:, 3:], k=5)
    data, step = full.model.createData(), 1e-3
    for i in range(5, len(turned) - 5, 7):
        t = turned.t[i]
        before, after = (pin.Quaternion(turns(t + s)).normalized().matrix() for s in (-step, step))
        attitude = pin.Quaternion(turns(t)).normalized().matrix()
        q, v = np.zeros(full.n), np.zeros(6 + full.n)
        q[mine], v[6:][mine], v[6:][wheels] = turned.q[i], turned.dq[i], turned.wheels[i] / 0.01
        v[3:6] = pin.log3(before.T @ after) / (2.0 * step)
        there = full.at(q, base=pin.SE3(attitude, np.zeros(3)))
        A = pin.computeCentroidalMap(full.model, data, there.full)
        v[:3] = -attitude.T @ (A[:3] @ v) / full.mass  # the CM stays
        h = pin.computeCentroidalMomentum(full.model, data, there.full, v).vector
        assert_close(h, turned.momentum[0], 2e-5)


@pytest.mark.parametrize("which", ["found", pytest.param("turned", marks=pytest.mark.slow)])
def test_wheels_keep_their_limits_at_every_instant(which, request):
    plan = request.getfixturevalue(which)
    spins, law = make_interp_spline(plan.t, plan.wheels, k=5), sa.Tracking(plan)
    times = np.linspace(0.0, plan.t[-1], 5000)
    torques = np.array([law.wheel_torques(t) for t in times])
    assert np.abs(spins(times)).max() <= 3.0
    assert np.abs(torques).max() <= 0.5
    assert_close(torques, spins(times, 1), 2e-3, np.abs(torques).max())
    assert_close(torques[[0, -1]], 0.0, 1e-12, np.abs(torques).max())
    assert "of at most 0.5 N m" in plan.wheel_load
    speeds = [plan.arm.tree.joints[name].velocity for name in plan.arm.joint_names]
    assert (np.abs(plan.dq).max(axis=0) <= np.where(np.isfinite(speeds), speeds, 0.5)).all()


def test_extremes_of_a_course_are_those_of_many_samples():
    rng = np.random.default_rng(0)
    course = RestMotion(rng.normal(size=5), rng.normal(size=(1 + WAVES, 5)), 3.0)
    u = np.linspace(0.0, 1.0, 20001)
    least, largest, rates = course.extremes()
    samples, slopes = course.at(u), course.rates(u)
    size, speed = np.abs(samples).max(), np.abs(slopes).max()
    assert_close(least, samples.min(axis=0), 1e-6, size)
    assert_close(largest, samples.max(axis=0), 1e-6, size)
    assert_close(rates, np.abs(slopes).max(axis=0), 1e-5, speed)
    assert_close(slopes, np.gradient(samples, 3.0 * u, axis=0), 1e-2, speed)
    assert_close(samples[-1], course.start + course.heights[0], 1e-7, size)


def wheels_of(axes, torque=0.5, capacity=3.0, start=0.0):
    w = len(axes)
    each = [np.full(w, x) for x in (torque, capacity, start)]
    return Wheels(tuple(f"w{i}" for i in range(w)), np.array(axes).T, *each)


def test_the_least_time_is_that_of_the_torque():
    """Three wheels about the axes: each takes its part, or all alike at the best attitude."""
    h = np.array([0.3, -1.0, 0.2])
    assert least_time(wheels_of(np.eye(3)), h, np.eye(3)) == pytest.approx(2.0)
    best = np.linalg.norm(h) / (0.5 * np.sqrt(3.0))
    assert least_time(wheels_of(np.eye(3)), h, None) == pytest.approx(best)
    turn = pin.exp3(np.array([0.4, 0.1, -0.9]))
    assert best <= least_time(wheels_of(np.eye(3)), h, turn)
    one = wheels_of([[0.0, 1.0, 0.0]], start=-0.5)
    assert least_time(one, np.array([0.0, -1.0, 0.0]), np.eye(3)) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(5))
def test_no_plan_of_a_wheel_beats_the_least_time(arm, seed):
    h = np.zeros(6)
    h[5] = np.random.default_rng(seed).uniform(0.5, 2.5)
    plan = sa.detumble(arm.at(Q0, momentum=h), sa.Joints(Q0))
    assert h[5] / 0.5 <= plan.t[-1] < 2.5 * h[5] / 0.5


REFUSED = {
    "hold at most 3 N m s together": (3.5, None, None),
    "takes at least 4 s to take up": (2.0, None, 3.9),
    "at the start, of at most 3; unload": (1.0, [3.5], None),
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_wheels_cannot_take_is_said_with_the_reason(arm, words):
    h, wheels, duration = REFUSED[words]
    start = arm.at(Q0, wheels=wheels, momentum=[0, 0, 0, 0, 0, h])
    with pytest.raises(sa.NoSolutionError, match=words):
        sa.detumble(start, sa.Joints(Q0), duration=duration)


def test_an_attitude_that_the_wheels_cannot_hold_is_refused():
    """One wheel: at rest the momentum is along its axis; three with too little room at one."""
    h, goal, end = [0, 0, 0, 1, 0, 0.0], sa.Joints(np.full(4, 0.1)), np.eye(3)
    arm = spatial([[0, 0, 1]])
    with pytest.raises(sa.NoSolutionError, match="across the axes of the wheels 'wheel_0'"):
        sa.detumble(arm.at(np.zeros(4), momentum=h), goal, final_attitude=end)
    arm, small = spatial(np.eye(3)), sa.WheelHold(stiffness=0, damping=0, capacity=0.8)
    with pytest.raises(sa.NoSolutionError, match=r"'wheel_0' 1 of at most 0\.8"):
        sa.detumble(
            arm.at(np.zeros(4), momentum=h), goal, final_attitude=end,
            constraints=sa.Constraints(wheels=small),
        )  # fmt: skip


@pytest.mark.slow
def test_the_arm_turns_one_wheel_to_the_momentum():
    """The only wheel is about z and the momentum is not: the arm must turn the spacecraft."""
    arm, h = spatial([[0, 0, 1]], n=6), np.array([0.0, 0.0, 0.0, 0.2, -0.1, 1.0])
    plan = sa.detumble(arm.at(np.full(6, 0.1), momentum=h), sa.Joints(np.full(6, 0.3)))
    last = plan[-1].base.rotation[:, 2]
    assert abs(last @ h[3:]) == pytest.approx(np.linalg.norm(h[3:]), rel=1e-8)
    assert_at_rest(flown(plan))


BAD = (
    {"constraints": sa.Constraints(keep_attitude=0.1)},
    {"search": sa.Search(method="straight")},
)


@pytest.mark.parametrize("words", BAD)
def test_what_makes_no_sense_is_refused(arm, words):
    with pytest.raises(sa.ConfigurationError, match="leave out"):
        sa.detumble(arm.at(Q0, momentum=H), GOAL, **words)


def test_a_spacecraft_without_wheels_is_refused():
    with pytest.raises(sa.UnsupportedError, match="no wheels to take up momentum"):
        sa.detumble(sa.load("planar2").at(Q0, momentum=H), GOAL)


def test_an_interrupt_ends_the_search_with_what_was_tried(arm):
    def stop(*_):
        raise KeyboardInterrupt

    with pytest.raises(sa.StoppedError, match=r"in 0 attempts \(timeout = .* at least 2 s\. To"):
        sa.detumble(arm.at(Q0, momentum=H), sa.Joints(Q0), search=sa.Search(progress=stop))


@pytest.mark.slow
def test_an_obstacle_is_kept_off(arm, found):
    middle = found.at(found.t[-1] / 2.0).tip.translation
    ball = sa.Obstacle.sphere(0.05, sa.pose(middle))
    assert not sa.collision_check(found, ball).apart
    far = sa.Obstacle.sphere(0.05, sa.pose((-3.0, 0.0, 0.0)))
    plan = sa.detumble(arm.at(Q0, momentum=H), GOAL, constraints=sa.Constraints(obstacles=far))
    assert sa.collision_check(plan, far).apart


@pytest.mark.slow
def test_the_command_detumbles(tmp_path):
    model = tmp_path / "wheeled.urdf"
    model.write_text(with_wheels("planar2", (0, 0, 1)))
    words = (0.3, 1.2, "--goal", 0.9, 1.4, "--with", "start.momentum=[0.5, 0, 0, 0, 0, 1.0]")
    run = spacearm("detumble", model, *words, "--json", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    told = json.loads(run.stdout)
    assert told["wheels"][-1] == pytest.approx([1.0])
    assert "'wheel_0' holds 1 of at most 3 N m s" in told["wheel_load"]
