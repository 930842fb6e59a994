"""Dispersed catches: errors distributed as said, shares as in closed form, laws know no more."""

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from helpers.catching import caught
from scipy.stats import binom, chi

import spacearm as sa
from spacearm.mission.kept_limits import with_checks
from spacearm.motion.simulation import trajectories_of

NONE = sa.TargetErrors(mass=0, inertia=0, place=0, turn=0, velocity=0, rate=0)


@cache
def tumbling() -> sa.Target:
    """A target that drifts and tumbles, its CM off the origin of its frame."""
    bus = sa.Bus(60.0, size=(0.6, 0.6, 0.8), com=(0.02, 0.0, 0.05), name="debris")
    twist = (0.01, 0.002, 0.0, 0.02, 0.03, 0.02)
    return sa.Target(bus, sa.pose((5.0, 0.2, -0.7), (0.1, 0.2, 0)), twist=twist)


def test_errors_have_the_sizes_that_are_given():
    """Root mean squares of the errors of CM, attitude and rates over 500 targets, to 10 %."""
    errors = sa.TargetErrors(
        mass=0.3, inertia=0.1, place=0.02, turn=0.03, velocity=0.004, rate=0.05
    )
    rng, target = np.random.default_rng(5), tumbling()
    place, v = target.cm
    found, shares = [], []
    for _ in range(500):
        one = errors.sample(target, rng)
        turn = pin.log3(one.pose.rotation @ target.pose.rotation.T)
        moved = one.cm[0] - place, turn, one.cm[1] - v, one.twist[3:] - target.twist[3:]
        found.append([x @ x for x in moved])
        shares.append((one.mass / target.mass, one.inertia[0, 0] / target.inertia[0, 0]))
        np.testing.assert_allclose(one.com, target.com, rtol=0, atol=1e-12)
    sizes = np.sqrt(np.mean(found, axis=0))
    np.testing.assert_allclose(sizes, [0.02, 0.03, 0.004, 0.05], rtol=0.1, atol=0)
    shares = np.array(shares)
    np.testing.assert_allclose(shares.min(axis=0), [0.7, 0.9], rtol=0, atol=0.01)
    np.testing.assert_allclose(shares.max(axis=0), [1.3, 1.1], rtol=0, atol=0.01)


def test_an_old_estimate_is_where_the_target_is_later():
    """Two seconds old, nothing else wrong: the target is ahead by two seconds."""
    target = tumbling()
    late = sa.TargetErrors(**(NONE.to_dict() | {"delay": 2.0})).sample(
        target, np.random.default_rng(0)
    )
    for t in (0.0, 7.0, 100.0):
        one, other = late.at(t), target.at(t + 2.0)
        assert np.linalg.norm(pin.log6(one.pose.actInv(other.pose)).vector) < 1e-8
        np.testing.assert_allclose(one.twist, other.twist, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_without_errors_all_are_caught_and_nothing_strikes():
    """The run is that of the catch itself."""
    with pytest.raises(sa.ConfigurationError, match="runs"):
        sa.fly_many(caught(), runs=0)
    found = sa.fly_many(caught(), NONE, runs=1)
    assert found.share == 1.0
    assert found.place.max() < 1e-4
    assert found.energy_lost.max() < 1e-6
    assert found.dq.max() < 1e-4
    assert found.ended == ("duration",)


@pytest.mark.slow
def test_the_share_is_that_of_a_chi_distribution():
    """A box at rest with errors of place alone: three normal components within a ball."""
    errors = sa.TargetErrors(**(NONE.to_dict() | {"place": 0.02}))
    envelope = sa.CaptureEnvelope(place=0.015)
    m = 80
    found = sa.fly_many(caught(), errors, envelope, runs=m)
    wanted = chi(3).cdf(0.015 / (0.02 / np.sqrt(3.0)))
    low, high = binom(m, wanted).ppf([1e-4, 1.0 - 1e-4])
    assert low <= found.caught.sum() <= high
    low, high = found.interval
    assert low < found.share < high
    assert np.isnan(found.energy_lost[~found.caught]).all()
    assert set(np.array(found.ended)[~found.caught]) == {"missed"}
    np.testing.assert_array_equal(found.caught, found.place <= 0.015)


@pytest.mark.slow
def test_slow_computers_lead_more_gently():
    """Five samples in a second: as exact as the contact asks; a rate beyond stability fails."""
    slow = sa.Sampling(period=0.2, delay=0.1)
    found = sa.fly_many(caught(), NONE, runs=1, sampling=slow)
    assert found.share == 1.0
    assert found.ended == ("duration",)
    with pytest.raises(sa.NoSolutionError, match="rate of 8 1/s"):
        sa.fly_many(caught(), NONE, runs=1, sampling=slow, rate=8.0)


def test_the_law_knows_the_planned_masses_only():
    """Torques are those of the arm that was planned with, whatever the arm that is led."""
    arm = sa.load("planar2")
    planned, heavy = arm.grasp(2.0, 0.1 * np.eye(3)), arm.grasp(4.0, 0.3 * np.eye(3))
    rows = [[0.3, 1.2], [0.5, 1.0], [0.8, 0.6]]
    law = sa.Tracking(sa.Motion(planned, [0, 1, 2], rows, np.tile(np.eye(7)[6], (3, 1))))
    q, dq = np.array([0.4, 1.1]), np.array([0.1, -0.2])
    wanted, rates, ddq = law.wanted(1.0)
    ddq = ddq + 2.0 * law.rate * (rates - dq) + law.rate**2 * (wanted - q)
    tau = sa.inverse_dynamics(planned.at(q), dq, ddq).tau
    np.testing.assert_allclose(law(1.0, heavy.at(q), dq), tau, rtol=0, atol=1e-9)
    np.testing.assert_allclose(law(1.0, planned.at(q), dq), tau, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: sa.TargetErrors(place=-1.0), "place"),
        (lambda: sa.TargetErrors(mass=1.0), "share below 1"),
        (lambda: sa.CaptureEnvelope(turn=0.0), "turn"),
    ],
)
def test_mistakes_are_named(make, words):
    """Each error names the value."""
    with pytest.raises(sa.ConfigurationError, match=words):
        make()


@pytest.mark.slow
def test_limits_are_checked_along_each_run_as_in_flight():
    """Runs without errors are that of `fly`; weaker joints exceed their torques in both."""
    catch = caught()
    flight = catch.fly()
    loads = np.max([np.abs(run.torque).max(axis=0) for run in flight.phases], axis=0)
    weak = replace(catch.limits, torques=0.5 * loads, loads=np.array([1e3, 1e3]))
    weaker = replace(catch, limits=weak)
    flown = with_checks(replace(flight, limits=()), weak)
    found = sa.fly_many(weaker, NONE, runs=2)
    for limits, events in zip(found.limits, found.events, strict=True):
        assert [check.limit for check in limits] == [check.limit for check in flown.limits]
        for one, other in zip(limits, flown.limits, strict=True):
            assert one.value == pytest.approx(other.value, rel=2e-2, abs=1e-4)
            assert (one.exceeded is None) == (other.exceeded is None)
        assert {event.kind for event in events} == {"limit exceeded"}
        assert len(events) == len(loads)
    assert not found.kept.any()
    assert set(found.exceeded.values()) == {2}
    told = found.describe()
    assert "limits EXCEEDED in 2 of 2 runs" in told.verdict
    assert told.tone == "caution"
    kept = sa.fly_many(catch, NONE, runs=1)
    assert kept.kept.all()
    assert "all limits kept" in kept.describe().verdict


def test_trajectories_of_many_runs_are_those_of_simulate():
    """Many runs give the trajectories of `simulate`, also with a control period and noise."""
    start = sa.load("planar2").at([0.3, 1.0])
    law = sa.JointPD(target=[0.6, 0.8], kp=8.0, kd=4.0)
    how = sa.Integration(rtol=1e-6, atol=1e-8, dt=0.05, events=())
    noisy = sa.Sampling(period=0.1, position_noise=1e-3, seed=3)
    many = trajectories_of(
        [start, start.arm.at([0.2, 1.1])],
        law,
        0.5,
        dq=np.zeros((2, 2)),
        mode="free-floating",
        plant=sa.Plant(),
        sampling=noisy,
        integration=how,
    )
    own = replace(noisy, seed=4)
    one = sa.simulate(many[1][0], law, 0.5, sampling=own, integration=how)
    for name in ("t", "q", "dq", "torque"):
        np.testing.assert_allclose(getattr(many[1], name), getattr(one, name), rtol=0, atol=1e-12)


@pytest.mark.slow
def test_an_approach_that_fails_is_no_catch():
    """A wrench that is no number ends the first phase; the second one began where that ended."""
    broken = sa.Plant(
        wrenches={"spacecraft": lambda t: np.full(6, np.nan if 0.5 < t < 0.8 else 0.0)}
    )
    with pytest.raises(sa.NoSolutionError, match="the approach of chaser7 fails"):
        sa.fly_many(caught(), NONE, runs=1, plant=broken)


@pytest.mark.slow
def test_a_target_without_the_planned_frame_is_grasped_where_the_tip_is():
    bare = caught().target.replace(grapples={})
    assert [event.kind for event in caught().fly(bare).events].count("grasp") == 1
