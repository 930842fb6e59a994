"""Time-optimal timing of plans whose attitude wheels hold: faster than stretched, limits held."""

import json

import numpy as np
import pytest
from helpers.arms import load_text, random_chain, with_wheels
from helpers.commands import spacearm
from scipy.interpolate import CubicSpline

import spacearm as sa
from spacearm.mechanics.dynamics import momentum_and_torque

pytest.importorskip("toppra")

SKEW = np.array([[1, 1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, -1]]) / np.sqrt(3)
HELD = {"mode": "attitude-controlled"}
Q0, GOAL = [0.3, 1.2], (0.9, 1.4)


def hold(torque=np.inf, capacity=np.inf):
    return sa.WheelHold(stiffness=0.0, damping=0.0, torque=torque, capacity=capacity)


def planar():
    arm = load_text(with_wheels("planar2", (0, 0, 1)))
    return sa.plan(arm.at(Q0, wheels=[2.0]), GOAL, **HELD), None, np.eye(3)[2:]


def skew():
    text = with_wheels(random_chain(3, 4, ("revolute",)), SKEW)
    arm = load_text(text, tip="tip", task="position")
    goal = sa.Joints(np.full(4, 0.4))
    return sa.plan(arm.at(np.zeros(4), wheels=[1, 2, 0, -1]), goal, **HELD), None, SKEW


def without():
    arm, wheels = sa.load("mda6"), hold(1.0, 10.0)
    q = np.array([0.0, 1.0, -1.7, -0.9, 0.3, 0.0])
    return (
        sa.plan(arm.at(q), sa.Joints(q + 0.2), constraints=sa.Constraints(wheels=wheels), **HELD),
        wheels,
        np.eye(3),
    )


@pytest.mark.parametrize("case", [planar, pytest.param(skew, marks=pytest.mark.slow), without])
def test_it_is_faster_than_an_even_stretch_and_keeps_the_limits(case):
    plan, wheels, axes = case()
    fast = sa.time_optimal(plan, torque=1e4, wheels=wheels)
    assert fast.t[-1] < 0.95 * plan.t[-1]
    np.testing.assert_allclose(fast.q[-1], plan.q[-1], atol=1e-12)
    np.testing.assert_array_equal(fast.momentum[0], plan.momentum[0])
    times = np.random.default_rng(0).uniform(0.0, fast.t[-1], 3000)
    way, share = fast.spline, np.linalg.pinv(axes.T)
    h, tau = momentum_and_torque(plan.arm, way(times), way(times, 1), way(times, 2))
    start = plan.wheels[0] if plan.arm.wheels else 0.0
    most, room = (0.5, 3.0) if wheels is None else (wheels.torque, wheels.capacity)
    used = np.abs(tau @ share.T).max() / most
    full = np.abs(start - h @ share.T).max() / room
    speed = (np.abs(way(times, 1)) / np.where(case is without, np.inf, 0.5)).max()
    assert max(used, full, speed) <= 1.0
    assert used > 0.9
    assert "bounds between" in fast.wheel_load
    assert fast.certificate.free
    assert fast.apart == plan.apart


@pytest.mark.slow
def test_with_room_for_momentum_alone_the_wheel_is_full_all_the_way():
    """The duration times the room is the integral of the momentum along the path."""
    arm = load_text(with_wheels("planar2", (0, 0, 1)))
    plan = sa.plan(arm.at(Q0), GOAL, constraints=sa.Constraints(wheels=hold(capacity=0.2)), **HELD)
    fast = sa.time_optimal(plan, torque=1e6, rate=1e3, wheels=hold(capacity=0.2), rise=0.0)
    way = plan.spline
    h, _ = momentum_and_torque(arm, plan.q, way(plan.t, 1), way(plan.t, 2))
    whole = float(CubicSpline(plan.t, np.abs(h[:, 2])).integrate(0.0, plan.t[-1]))
    assert 1.0 <= fast.t[-1] / (whole / 0.2) < 1.05
    assert np.median(np.abs(fast.wheels)) > 0.18


@pytest.mark.slow
def test_a_simulation_with_wheels_that_hold_keeps_to_the_times():
    plan, _, _ = planar()
    fast = sa.time_optimal(plan, torque=1e3)
    strong = sa.WheelHold(stiffness=2000, damping=1000, torque=0.7, capacity=3.0)
    run = sa.simulate(
        fast[0],
        sa.Tracking(fast),
        fast.t[-1],
        plant=sa.Plant(wheels=strong),
        integration=sa.Integration(rtol=1e-4),
    )
    assert np.linalg.norm(run.tip[-1, :2] - GOAL) < 1e-3
    assert np.abs(run.base[:, 5]).max() < 1e-3
    held = np.interp(fast.t, run.t, run.wheels[:, 0])
    np.testing.assert_allclose(held, fast.wheels[:, 0], atol=0.02)


@pytest.mark.slow
def test_what_makes_no_sense_is_refused():
    arm = sa.load("planar2")
    floating = sa.plan(arm.at(Q0), GOAL)
    with pytest.raises(sa.ConfigurationError, match="none hold the attitude"):
        sa.time_optimal(floating, torque=20.0, wheels=hold(1.0))
    drifting = sa.plan(arm.at(Q0, momentum=[0, 0, 0, 0, 0, 0.2]), GOAL, duration=20.0)
    with pytest.raises(sa.UnsupportedError, match="momentum on board"):
        sa.time_optimal(drifting, torque=20.0)
    moving = sa.plan(
        arm.at(Q0, momentum=[0.1, 0, 0, 0, 0, 0]),
        GOAL,
        constraints=sa.Constraints(wheels=hold(5.0, 5.0)),
        **HELD,
    )
    with pytest.raises(sa.UnsupportedError, match="CM moves on"):
        sa.time_optimal(moving, torque=20.0, wheels=hold(5.0, 5.0))
    with pytest.raises(sa.NoSolutionError, match="unload it first"):
        sa.time_optimal(planar()[0], torque=20.0, wheels=hold(1.0, 1.9))


@pytest.mark.slow
def test_the_command_times_a_plan_with_wheels(tmp_path):
    model = tmp_path / "wheeled.urdf"
    model.write_text(with_wheels("planar2", (0, 0, 1)))
    words = (0.3, 1.2, "--goal", 0.9, 1.4, "--with", "mode=attitude-controlled", "--json")
    limits = 'constraints.wheels={"torque": 0.3, "capacity": 1.0}'
    run = spacearm("plan", model, *words, "--fastest", "--with", limits, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["t"][-1] < 9.0
