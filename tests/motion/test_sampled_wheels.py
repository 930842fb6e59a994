"""Wheels with a control period, noise of gyros, steps of torque and friction."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, with_wheels

import spacearm as sa

LAW = sa.JointPD(target=[0.5, 0.8], kp=1.0, kd=2.0)
HOLD = sa.WheelHold(stiffness=20.0, damping=40.0, sampled=True)
PERIOD = 0.1


def arm():
    return load_text(with_wheels("planar2", np.eye(3)))


def simulated(hold=HOLD, sampling=None, duration=2.0, law=LAW, **plant):
    sampling = sampling or sa.Sampling(period=PERIOD)
    plant = sa.Plant(wheels=hold, **plant)
    start = arm().at([0.1, 0.3], wheels=[0.1, -0.2, 0.05])
    fine = sa.Integration(rtol=1e-10, atol=1e-12, dt=PERIOD / 4, events=())
    return sa.simulate(start, law, duration, plant=plant, sampling=sampling, integration=fine)


def test_torques_are_those_of_the_law_at_the_control_instants():
    run = simulated()
    level = run.base[0, 3:]
    for k in range(0, 80, 4):
        R = run[k].base.rotation
        phi = R.T @ pin.log3(R @ pin.Quaternion(level).matrix().T)
        w = R.T @ sa.base_velocity(run[k], run.dq[k])[3:]
        asked = 20.0 * phi + 40.0 * w  # the axes are those of the spacecraft
        np.testing.assert_allclose(run.wheel_torque[k : k + 4], [asked] * 4, rtol=0, atol=1e-8)


def test_noise_of_the_gyros_keeps_the_momentum():
    noisy = sa.Sampling(period=PERIOD, gyro_noise=[1e-2, 0.0, 2e-2], seed=5)
    run, again = simulated(sampling=noisy), simulated(sampling=noisy)
    quiet, other = simulated(), simulated(sampling=replace(noisy, seed=6))
    np.testing.assert_array_equal(run.wheels, again.wheels)
    assert np.abs(run.wheels - other.wheels).max() > 1e-2
    first = run.wheel_torque[0] - quiet.wheel_torque[0]
    assert first[1] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(first[[0, 2]]).min() > 0.0
    assert np.abs(run.momentum - run.momentum[0]).max() < 1e-9
    assert run.imbalance < 1e-7


def test_torques_are_multiples_of_their_step():
    hold = replace(HOLD, torque_quantum=0.03, torque=0.1)
    torque = simulated(hold).wheel_torque / 0.03
    np.testing.assert_allclose(torque, np.round(torque), rtol=0, atol=1e-9)
    assert np.abs(torque).max() == pytest.approx(3.0)
    assert len(np.unique(np.round(torque))) > 3


@pytest.mark.parametrize(("torque", "quantum", "most"), [(0.3, 0.1, 3), (0.7, 0.1, 7)])
def test_a_largest_torque_that_is_a_multiple_of_the_step_is_reached(torque, quantum, most):
    """In floating-point numbers 0.3 / 0.1 is below 3."""
    hold = replace(HOLD, torque_quantum=quantum, torque=torque)
    asked = np.array([10.0, -10.0, 0.26])
    np.testing.assert_allclose(
        hold.quantised(asked), [most * quantum, -most * quantum, 0.3], rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("mode", ["free", "over time"])
def test_friction_slows_a_wheel_exponentially(mode):
    c, h = 0.7, np.array([0.1, -0.2, 0.05])
    hold = None if mode == "free" else (lambda _: [0.3, 0.0, 0.1])
    given = np.array(hold(0.0)) if hold else np.zeros(3)
    run = simulated(hold, wheel_friction=c)
    decay = np.exp(-c * run.t)[:, None]
    np.testing.assert_allclose(run.wheels, h * decay + given / c * (1 - decay), atol=1e-9)
    np.testing.assert_allclose(run.wheel_torque, np.tile(given, (len(run), 1)), atol=1e-12)
    np.testing.assert_allclose(run.wheel_friction, -c * run.wheels, atol=1e-12)
    np.testing.assert_allclose(run.wheel_momentum_rate, given - c * run.wheels, atol=1e-12)
    assert np.abs(run.momentum - run.momentum[0]).max() < 1e-9
    assert run.imbalance < 1e-7


FRICTION = sa.WheelFriction(viscous=0.01, dry=2e-3, slip=5e-4)


def test_dry_friction_stops_a_free_wheel_as_the_closed_form_says():
    """Of dry friction alone sinh(h / slip) falls as exp(-dry t / slip)."""
    h, dry, slip = np.array([0.1, -0.2, 0.05]), 0.05, 0.01
    run = simulated(None, wheel_friction=sa.WheelFriction(dry=dry, slip=slip))
    u = np.abs(h) / slip
    falls = np.log(np.sinh(u)) - (dry / slip) * run.t[:, None]
    expected = np.sign(h) * slip * np.arcsinh(np.exp(falls))
    np.testing.assert_allclose(run.wheels, expected, atol=1e-8)
    assert np.abs(run.wheels[-1]).min() > 0.0
    np.testing.assert_allclose(run.wheel_torque, 0.0, atol=1e-12)


def test_friction_keeps_the_momentum_and_takes_energy():
    """The spin of a wheel has the energy h (a w) + h^2 / (2 I) besides that of the rest."""
    run = simulated(None, wheel_friction=FRICTION)
    still = simulated(None, wheel_friction=FRICTION, law=lambda _t, _cfg, dq: 0.0 * dq)
    assert np.abs(run.momentum - run.momentum[0]).max() < 1e-9
    assert run.imbalance < 1e-7
    inertia, energy = 1e-3, list[float]()  # the moment of inertia of a wheel
    for cfg, dq, h, kinetic in zip(still, still.dq, still.wheels, still.energy, strict=True):
        w = cfg.base.rotation.T @ sa.base_velocity(cfg, dq)[3:]
        energy.append(kinetic + h @ w + 0.5 * h @ h / inertia)
    assert (np.diff(energy) < 0.0).all()
    assert energy[-1] < 0.95 * energy[0]


def test_the_recorded_torque_of_a_wheel_is_that_of_its_motor():
    """It is what its limit bounds and what the summary tells; friction stands beside it."""
    hold = replace(HOLD, stiffness=2000.0, torque=0.01)
    run = simulated(hold, duration=0.4, wheel_friction=sa.WheelFriction(viscous=0.5, dry=2e-3))
    assert np.abs(run.wheel_torque).max() <= 0.01 * (1.0 + 1e-12)
    assert np.abs(run.wheel_momentum_rate).max() > 1.2 * 0.01
    loads = [load for load in run.motors if load.motor.startswith("wheel")]
    assert len(loads) == 3
    for load, torque in zip(loads, np.abs(run.wheel_torque).T, strict=True):
        assert load.largest == pytest.approx(torque.max(), abs=1e-12)
    assert max(load.largest for load in loads) == pytest.approx(0.01)
    assert max(load.share for load in loads) > 0.1


@pytest.mark.slow
def test_many_runs_are_those_of_simulate():
    hold = replace(HOLD, torque_quantum=0.01)
    plant = sa.Plant(wheels=hold, wheel_friction=FRICTION)
    noisy = sa.Sampling(period=PERIOD, delay=0.03, gyro_noise=1e-2, attitude_noise=1e-3, seed=2)
    starts = [arm().at([0.1 * i, 0.3]) for i in range(3)]
    how = sa.Integration(rtol=1e-6, atol=1e-8)
    many = sa.simulate_many(starts, LAW, 1.0, plant=plant, sampling=noisy, threads=1)
    own = replace(noisy, seed=4)
    one = sa.simulate(starts[2], LAW, 1.0, plant=plant, sampling=own, integration=how)
    np.testing.assert_allclose(many.base.values[2], one.base[-1], rtol=0, atol=1e-12)


def test_what_makes_no_sense_is_refused():
    with pytest.raises(sa.ConfigurationError, match="torque_quantum"):
        sa.WheelHold(stiffness=1, damping=1, torque_quantum=0.1)
    with pytest.raises(sa.ConfigurationError, match="wheel_friction is -1"):
        sa.Plant(wheel_friction=-1)
    with pytest.raises(sa.ConfigurationError, match="dry of the wheel friction is -1"):
        sa.WheelFriction(dry=-1.0)
    with pytest.raises(sa.ConfigurationError, match="slip of the wheel friction is 0"):
        sa.WheelFriction(slip=0.0)
    start, plant = arm().at([0.1, 0.3]), sa.Plant(wheels=HOLD)
    with pytest.raises(sa.ConfigurationError, match="control period"):
        sa.simulate(start, LAW, 1.0, plant=plant)
    sampling = sa.Sampling(period=0.1, gyro_noise=[1, 2])
    with pytest.raises(sa.ConfigurationError, match="gyro_noise"):
        sa.simulate(start, LAW, 1.0, plant=plant, sampling=sampling)
    bare = sa.load("planar2").at([0.1, 0.3])
    with pytest.raises(sa.UnsupportedError, match="no wheels"):
        sa.simulate(bare, LAW, 1.0, plant=sa.Plant(wheel_friction=0.1))
