"""Control laws with a memory: at control instants, against recursions of their own."""

import numpy as np
import pytest
from helpers.arms import planar_pair

import spacearm as sa

PERIOD = 0.1
SAMPLED = sa.Sampling(period=PERIOD)


def one_joint():
    """One joint on a fixed spacecraft, and its inertia."""
    arm = sa.load("planar2", locked={"joint_2": 0.3})
    return arm, float(sa.generalized_inertia(arm.at([0.5]), mode="fixed")[0, 0])


def sampled_pid(q, inertia, disturbance, steps, kp, kd, ki, limit=np.inf):
    """One joint under a sampled PID with conditional integration, and a constant disturbance."""
    rate, integral, found = 0.0, 0.0, [q]
    for k in range(steps):
        error = 0.8 - q
        longer = integral + (PERIOD * error if k else 0.0)
        asked = kp * error - kd * rate + ki * longer
        if abs(asked) <= limit or error * asked <= 0.0:
            integral = longer
        torque = np.clip(kp * error - kd * rate + ki * integral, -limit, limit)
        a = (torque + disturbance) / inertia
        q, rate = q + rate * PERIOD + a * PERIOD**2 / 2.0, rate + a * PERIOD
        found.append(q)
    return np.array(found)


@pytest.mark.parametrize(("ki", "limit"), [(0.0, np.inf), (4.0, np.inf), (4.0, 3.0)])
def test_an_integral_term_removes_the_error_that_a_disturbance_leaves(ki, limit):
    arm, inertia = one_joint()
    kp, kd, disturbance, steps = 1.5 * inertia, 3.0 * inertia, 2.0, 300
    law = sa.JointPD([0.8], kp=kp, kd=kd, ki=ki, limit=limit)
    plant = sa.Plant(wrenches={arm.tree.joints["joint_1"].child: [0, 0, 0, 0, 0, disturbance]})
    run = sa.simulate(
        arm.at([0.5]), law, steps * PERIOD, mode="fixed", plant=plant, sampling=SAMPLED,
        integration=sa.Integration(rtol=1e-11, atol=1e-13, events=(), dt=PERIOD),
    )  # fmt: skip
    expected = sampled_pid(0.5, inertia, disturbance, steps, kp, kd, ki, limit)
    np.testing.assert_allclose(run.q[:, 0], expected, rtol=0, atol=1e-8)
    left = 0.8 - run.q[-1, 0]
    assert left == pytest.approx(0.0 if ki else -disturbance / kp, abs=1e-3)
    assert run.called == ()


class Filtered:
    """A PD law whose rates pass a low-pass filter: what it remembers are the filtered rates."""

    def __init__(self, share):
        self.share = share
        self.target = np.array([0.5, -0.3])

    def memory0(self, cfg):
        return np.zeros(cfg.arm.n)

    def __call__(self, t, cfg, _dq, memory):
        return 4.0 * (self.target - cfg.q) - 6.0 * memory + 0.1 * np.sin(t)

    def update(self, _t, _cfg, dq, memory):
        return memory + self.share * (dq - memory)


class Branching(Filtered):
    """The same, in code that branches on values."""

    def update(self, t, _cfg, dq, memory):
        return memory + self.share * (dq - memory) if t > -1.0 else memory


class Recorded:
    """The same with a memory kept in the object, as laws without `memory0` would."""

    def __init__(self, share):
        self.law, self.memory, self.seen = Filtered(share), np.zeros(2), []

    def __call__(self, t, cfg, dq):
        tau = self.law(t, cfg, dq, self.memory)
        if not self.seen or t > self.seen[-1]:
            self.seen.append(t)
            self.memory = self.law.update(t, cfg, dq, self.memory)
        return tau


NOISY = sa.Sampling(period=PERIOD, delay=0.13, position_noise=1e-3, rate_noise=2e-3, seed=3)


@pytest.mark.parametrize("kind", [Filtered, Branching])
def test_a_filter_remembers_the_measurements(kind):
    arm, law = sa.load("planar2"), kind(0.2)
    runs = [sa.simulate(arm.at([0.1, 0.2]), law, 3.0, sampling=NOISY) for _ in range(2)]
    other = sa.simulate(arm.at([0.1, 0.2]), Filtered(0.9), 3.0, sampling=NOISY)
    np.testing.assert_array_equal(runs[0].q, runs[1].q)  # each begins anew
    assert np.abs(runs[0].q[-1] - other.q[-1]).max() > 1e-4
    assert bool(runs[0].called) == (kind is Branching)
    kept = sa.simulate(arm.at([0.1, 0.2]), Recorded(0.2), 3.0, sampling=NOISY)
    np.testing.assert_allclose(runs[0].q, kept.q, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    "law",
    [
        sa.JointPD([0.5, -0.3], 4.0, 6.0, ki=2.0),
        pytest.param(Filtered(0.2), marks=pytest.mark.slow),
    ],
)
def test_many_runs_have_a_memory_each(law):
    arm = sa.load("planar2")
    starts = [arm.at([0.1 * i, 0.2]) for i in range(4)]
    many = sa.simulate_many(starts, law, 2.0, sampling=NOISY, threads=2)
    for i in (0, 3):
        sampling = sa.Sampling(**{**vars(NOISY), "seed": NOISY.seed + i})
        how = sa.Integration(rtol=1e-6, atol=1e-8)
        one = sa.simulate(starts[i], law, 2.0, sampling=sampling, integration=how)
        np.testing.assert_allclose(many.q.values[i], one.q[-1], rtol=0, atol=1e-12)
    assert many.attrs["called"] == ""


def test_each_phase_begins_with_the_memory_of_the_start():
    arm, law = sa.load("planar2"), Filtered(0.3)
    phase = sa.Phase(law, 1.0, sampling=SAMPLED)
    flight = sa.simulate_phases(arm.at([0.1, 0.2]), [phase, phase])
    first, second = flight.phases
    again = sa.simulate(first[-1], law, 1.0, dq=first.dq[-1], sampling=SAMPLED)
    np.testing.assert_allclose(second.q[-1], again.q[-1], rtol=0, atol=1e-7)


def test_each_tip_has_a_memory_of_its_own():
    arm = planar_pair()
    target = np.full(arm.n, 0.2)
    first, second = (sa.JointPD(target, 3.0, 5.0, ki=ki) for ki in (1.0, 0.3))
    left, right = arm.tips
    run = sa.simulate(arm.at(np.zeros(arm.n)), {left: first, right: second}, 2.0, sampling=SAMPLED)
    swapped = {left: second, right: first}
    other = sa.simulate(arm.at(np.zeros(arm.n)), swapped, 2.0, sampling=SAMPLED)
    assert run.ended == other.ended == "duration"
    assert np.abs(run.q[-1] - other.q[-1]).max() > 1e-3


class Wrong(Filtered):
    memory0 = np.zeros(2)

    def update(self, _t, _cfg, _dq, memory):
        return memory[:1]


class Unbounded(Filtered):
    memory0 = np.ones(2)

    def update(self, _t, _cfg, _dq, memory):
        return memory / (memory - 1.0)


def described(**members):
    return type("Own", (), {"__call__": Filtered.__call__, **members})()


@pytest.mark.parametrize(
    ("law", "given", "message"),
    [
        (Filtered(0.2), {}, "control period.*sampling=sa.Sampling"),
        (sa.JointPD([0, 0], 1, 1, ki=1), {}, "control period"),
        (Wrong(0.2), {"sampling": SAMPLED}, "next memory of the controller"),
        (described(memory0=np.zeros(2)), {"sampling": SAMPLED}, "Own has memory0 and no update"),
        (described(memory0=np.zeros((2, 2)), update=print), {"sampling": SAMPLED}, "memory0 of"),
        (described(memory0=[]), {"sampling": SAMPLED}, "memory0 of Own"),
        (described(memory0=[np.nan], update=print), {"sampling": SAMPLED}, "memory0 of Own is"),
        (described(), {"sampling": SAMPLED}, "Own takes a memory and has no memory0"),
        (sa.JointPD([0, 0], 1, 1, limit=2), {"sampling": SAMPLED}, "limit is 2 and ki is 0"),
        (sa.JointPD([0, 0], 1, 1, 1, limit=0), {"sampling": SAMPLED}, "limit is 0"),
        (sa.JointPD([0, 0], 1, 1, 1, [1] * 3), {"sampling": SAMPLED}, "limit is"),
        (sa.JointPD([0, 0], 1, 1, ki=[1] * 3), {"sampling": SAMPLED}, "ki is"),
    ],
)
def test_a_memory_that_makes_no_sense_is_refused(law, given, message):
    arm = sa.load("planar2")
    with pytest.raises(sa.SpaceArmError, match=message):
        sa.simulate(arm.at([0.1, 0.2]), law, 0.3, **given)
    if not given:
        with pytest.raises(sa.ConfigurationError, match=message):
            sa.simulate_many(arm.at([0.1, 0.2]), law, 0.3)


def test_a_memory_that_is_not_finite_ends_the_run_with_what_there_is():
    with pytest.raises(sa.NoSolutionError, match="memory") as found:
        sa.simulate(sa.load("planar2").at([0.1, 0.2]), Unbounded(0.0), 0.3, sampling=SAMPLED)
    assert found.value.best is None
