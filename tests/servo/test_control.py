"""The servo in the loop of a simulation."""

import numpy as np
import pytest

import spacearm as sa

PERIOD, NOTHING = sa.Sampling(period=0.01), sa.Integration(events=())


@pytest.mark.slow
def test_a_simulated_arm_follows_the_servo_and_stays_off_the_set():
    arm = sa.load("planar2")
    control = sa.ServoControl(servo=sa.Servo(arm, rates=0.5, accelerations=1.0), twist=[0.1, 0.0])
    start = arm.at(np.radians([20.0, 40.0]))
    steps = sa.Integration(dt=0.01)
    run = sa.simulate(start, control, 6.0, sampling=PERIOD, integration=steps)
    assert len(control.steps) == 600
    asked = np.array([step.rates for step in control.steps])
    at = np.searchsorted(run.t, 0.01 * np.arange(600))
    lag = 1.0 / control.gain  # by the acceleration of 1 rad/s^2
    assert np.abs(run.dq[at] - asked).max() < 1.2 * lag
    least = min(sa.singularity(arm.at(q), exact=True).distance for q in run.q[::100])
    assert np.radians(4.9) < least < np.radians(6.0)
    again = sa.simulate(start, control, 0.5, sampling=PERIOD, integration=steps)
    np.testing.assert_allclose(again.q[-1], run.q[50], rtol=0, atol=1e-6)


def test_the_wish_may_depend_on_time_and_posture():
    arm, seen = sa.load("planar2"), []

    def wished(t, cfg):
        seen.append((t, cfg.q.copy()))
        return [0.05 * np.sin(t), 0.0]

    control = sa.ServoControl(servo=sa.Servo(arm), twist=wished)
    sa.simulate(arm.at([0.3, 1.2]), control, 0.2, sampling=PERIOD, integration=NOTHING)
    np.testing.assert_allclose([t for t, _ in seen], 0.01 * np.arange(20), rtol=0, atol=1e-9)


def test_it_is_not_called_at_other_times_than_its_own():
    arm = sa.load("planar2")
    control = sa.ServoControl(servo=sa.Servo(arm), twist=[0.1, 0.0])
    with pytest.raises(sa.NoSolutionError, match=r"sampling=sa.Sampling\(period=0.01\)"):
        sa.simulate(arm.at([0.3, 1.2]), control, 0.5, integration=NOTHING)
    with pytest.raises(sa.ConfigurationError, match="period"):
        sa.ServoControl(servo=control.servo, twist=[0.1, 0.0], period=0.0)
    with pytest.raises(sa.ConfigurationError, match=r"period is 0.2; .* to 0.1"):
        sa.ServoControl(servo=control.servo, twist=[0.1, 0.0], period=0.2, gain=1.0)
    with pytest.raises(sa.ConfigurationError, match="give at most 10"):
        sa.ServoControl(servo=control.servo, twist=[0.1, 0.0], period=0.1)


@pytest.mark.parametrize("twist", [10**400, [np.nan, 0.0], [1e300, 0.0], "ab", [0.1], None])
def test_a_constant_twist_that_is_none_is_refused(twist):
    with pytest.raises(sa.ConfigurationError, match="twist"):
        sa.ServoControl(servo=sa.Servo(sa.load("planar2"), rates=0.5), twist=twist)
