"""Many runs at once: each is the one that `simulate` makes."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import joint, link, load_text, robot, two_links
from helpers.wheels import WHEELS, with_wheels

import spacearm as sa
from spacearm.motion.simulation import COARSE

ARM = sa.load("planar2")
RNG = np.random.default_rng(0)
Q0 = np.array([0.3, 0.9]) + 0.1 * RNG.normal(size=(5, 2))
STARTS = [ARM.at(q) for q in Q0]
LAW = sa.TransposedJacobian(target=(1.4, 0.9), kp=5.0, kd=15.0)


def test_each_run_is_that_of_simulate():
    seen = []
    many = sa.simulate_many(STARTS, LAW, 20.0, threads=2, progress=lambda *x: seen.append(x))
    assert seen[-1] == (5, 5)
    for i in (0, 4):
        one = sa.simulate(
            ARM.at(Q0[i]), LAW, 20.0, integration=sa.Integration(rtol=1e-6, atol=1e-8, dt=0.1)
        )
        run = many.isel(run=i)
        np.testing.assert_array_equal(run["q"], one.q[-1])
        np.testing.assert_array_equal(run["dq"], one.dq[-1])
        np.testing.assert_allclose(run["base"], one.base[-1], atol=1e-14)
        assert run["sigma_min"] == pytest.approx(one.sigma_min.min(), abs=1e-12)
        turned = [np.arccos(min(abs(b[3:] @ one.base[0, 3:]), 1.0)) * 2 for b in one.base]
        assert run["turn"] == pytest.approx(max(turned), abs=1e-7)
        assert run["imbalance"] < 1e-6
        times = [event.t for event in one.events if event.kind == "target"]
        assert bool(run["success"]) == bool(times)
        if times:
            assert run["time_to_target"] == times[0]


@pytest.mark.parametrize(
    ("kind", "position", "rate"),
    [("revolute", "rad", "rad/s"), ("prismatic", "rad, m", "rad/s, m/s")],
)
def test_all_numbers_have_units(kind, position, rate):
    bus, first, elbow = two_links()
    arm = load_text(robot(bus, first, elbow, link("end"), joint("last", "arm", "end", kind)))
    many = sa.simulate_many(arm.at([0.1, 0.2]), sa.JointPD(target=[0, 0], kp=1, kd=1), 0.1)
    units = {name: x.attrs.get("units") for name, x in many.data_vars.items()}
    assert [name for name, unit in units.items() if unit is None] == ["ended"], "it is text"
    assert (units["q"], units["q0"], units["dq"]) == (position, position, rate)
    assert units["sigma_min"] == arm.sigma_unit


def test_laws_momenta_and_payloads_may_differ():
    laws = [sa.JointPD(target=[0.1 * i, 0.5], kp=5.0, kd=15.0) for i in range(5)]
    h = np.zeros((5, 6))
    h[:, 5] = np.linspace(-1, 1, 5)
    payload = [0.0, 1.0, 2.0, 0.0, 4.0]
    arms = [ARM.replace(payload=mass) if mass else ARM for mass in payload]
    starts = [arm.at(q, momentum=one) for arm, q, one in zip(arms, Q0, h, strict=True)]
    many = sa.simulate_many(starts, laws, 5.0)
    for i in (1, 3):
        one = sa.simulate(
            starts[i],
            laws[i],
            5.0,
            integration=sa.Integration(rtol=1e-6, atol=1e-8),
        )
        np.testing.assert_allclose(many["q"][i], one.q[-1], atol=1e-12)
        np.testing.assert_allclose(many["base"][i], one.base[-1], atol=1e-12)


def test_a_run_that_fails_does_not_end_the_others():
    laws = [sa.JointPD(target=[0.1, 0.5], kp=5.0, kd=15.0), sa.JointPD([0.1, 0.5], 1e11, 1e3)]
    many = sa.simulate_many(STARTS[0], laws, 5.0)
    assert many["ended"].values.tolist() == ["duration", "step collapsed"]
    assert many["t"][1] < 5.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dq": np.zeros((3, 2))}, "are of"),
        ({"sampling": sa.Sampling(period=0.1, rate_noise=[0.1] * 3)}, "rate_noise"),
        ({"sampling": sa.Sampling(period=0.1, attitude_noise=-1.0)}, "from 0 on"),
        ({"duration": -1.0}, "duration"),
        ({"threads": 0}, "threads"),
        ({"integration": sa.Integration(dt=0.1)}, "dt is given"),
    ],
)
def test_bad_input(options, message):
    options = {"duration": 1.0} | options
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.simulate_many(STARTS, LAW, **options)


def test_loose_stiff_runs_do_not_depend_on_those_before_them():
    arm, law = sa.load("planar2"), sa.JointPD(target=[0.3, 0.1], kp=30.0, kd=30.0)
    Q0 = np.array([[0.1, 0.2], [1.0, -0.5], [-0.4, 0.7]])
    how = sa.Integration(rtol=1e-2, atol=1e-4, events=())
    starts = [arm.at(q) for q in Q0]
    forth = sa.simulate_many(starts, law, 20.0, integration=how, threads=1)
    back = sa.simulate_many(starts[::-1], law, 20.0, integration=how, threads=1)
    np.testing.assert_array_equal(forth.q.values, back.q.values[::-1])


def test_what_is_no_list_of_starts_of_one_arm_is_refused():
    with pytest.raises(sa.ConfigurationError, match=r"starts is .*\(q\) or a list of such"):
        sa.simulate_many(Q0, LAW, 1.0)
    with pytest.raises(sa.ConfigurationError, match="several arms"):
        sa.simulate_many([STARTS[0], sa.load("planar3", task="x y").at(np.zeros(3))], LAW, 1.0)


def test_wheels_and_wrenches_act_as_in_one_run():
    arm = load_text(with_wheels(0), tip="tip", task="x", wheels=WHEELS)
    plant = sa.Plant(
        wheels=sa.WheelHold(stiffness=400.0, damping=600.0),
        wrenches={arm.tree.root: lambda t: [0.0, 0.1 * t, 0.0, 0.0, 0.0, 0.2]},
    )
    law = sa.JointPD(target=np.zeros(arm.n), kp=5.0, kd=15.0)
    turned = [sa.pose(rpy=(0.0, 0.0, angle)) for angle in (0.0, 0.7)]
    starts = [
        arm.at(np.full(arm.n, 0.3), base=base, wheels=np.ones(len(arm.wheels))) for base in turned
    ]
    many = sa.simulate_many(starts, law, 3.0, plant=plant)
    for i, start in enumerate(starts):
        one = sa.simulate(start, law, 3.0, plant=plant, integration=COARSE)
        np.testing.assert_allclose(many["q"][i], one.q[-1], atol=1e-9)
        np.testing.assert_allclose(many["base"][i], one.base[-1], atol=1e-9)


@pytest.mark.slow
def test_each_of_several_tips_has_its_law_and_laws_may_be_of_several_kinds():
    arm = sa.load("dual_ur5", tip=("left", "right"))
    start, still = arm.at(np.full(arm.n, 0.3)), np.full(arm.n, 0.4)
    bent = sa.JointPD(target=still, kp=20.0, kd=40.0)
    laws = [{"left": bent, "right": bent}, {"left": bent}]
    many = sa.simulate_many(start, laws, 1.0)
    for i, law in enumerate(laws):
        one = sa.simulate(start, law, 1.0, integration=COARSE)
        np.testing.assert_allclose(many["q"][i], one.q[-1], atol=1e-9)
        assert many["sigma_min"][i] == pytest.approx(one.sigma_min.min(), rel=1e-3)
    kinds = [LAW, sa.JointPD(target=[0.1, 0.5], kp=5.0, kd=15.0)]
    many = sa.simulate_many(STARTS[0], kinds, 1.0)
    for i, law in enumerate(kinds):
        one = sa.simulate(STARTS[0], law, 1.0, integration=COARSE)
        np.testing.assert_allclose(many["q"][i], one.q[-1], atol=1e-9)
    with pytest.raises(sa.UnsupportedError, match="tips"):
        sa.simulate_many(start, bent, 1.0)


def test_loaded_arms_may_start_about_their_own_cm():
    arms = [ARM.replace(payload=mass) for mass in (1.0, 4.0)]
    starts = [arm.at(Q0[0]).centred(np.zeros(3)) for arm in arms]
    many = sa.simulate_many(starts, LAW, 2.0)
    for i, start in enumerate(starts):
        one = sa.simulate(start, LAW, 2.0, integration=COARSE)
        np.testing.assert_allclose(many["q"][i], one.q[-1], atol=1e-12)
        np.testing.assert_allclose(many["base"][i], one.base[-1], atol=1e-12)


def pushing(t, cfg, dq):
    """A law that is called in Python, as it keeps what it was given."""
    pushing.seen = t
    return 5.0 * (np.array([0.5, 1.0]) - cfg.q) - 9.0 * dq


@pytest.mark.slow
@pytest.mark.parametrize("law", [LAW, pushing])
def test_sampled_runs_with_noise_are_those_of_simulate(law):
    plant = sa.Plant(limits=True, passive={"joint_2": sa.PassiveJoint(damping=0.1)})
    noisy = sa.Sampling(
        period=0.05, delay=0.12, position_noise=1e-3, rate_noise=[2e-3, 1e-3],
        attitude_noise=1e-3, seed=7,
    )  # fmt: skip
    many = sa.simulate_many(STARTS, law, 2.0, sampling=noisy, plant=plant, threads=2)
    for i in (0, 3):
        own = replace(noisy, seed=7 + i)
        one = sa.simulate(
            STARTS[i], law, 2.0, sampling=own, plant=plant, integration=replace(COARSE, dt=0.01)
        )
        np.testing.assert_allclose(many["q"][i], one.q[-1], atol=1e-9)
        np.testing.assert_allclose(many["base"][i], one.base[-1], atol=1e-9)
    other = sa.simulate(STARTS[0], law, 2.0, sampling=own, plant=plant, integration=COARSE)
    assert np.abs(other.q[-1] - many["q"][0].values).max() > 1e-6


def test_noise_has_the_deviations_that_were_asked_for():
    seen = []

    def look(_t, cfg, dq):
        seen.append(np.concatenate((cfg.q, dq, pin.log3(cfg.base.rotation))))
        return np.zeros(2)

    start = ARM.at([0.3, 0.9])
    noisy = sa.Sampling(period=1e-3, position_noise=0.01, rate_noise=[0.2, 0.1],
                        attitude_noise=[0.0, 0.0, 0.03])  # fmt: skip
    sa.simulate(start, look, 1.0, sampling=noisy, integration=sa.Integration(events=()))
    off = np.array(seen[-1000:]) - np.concatenate((start.q, np.zeros(5)))
    wanted = np.array([0.01, 0.01, 0.2, 0.1, 0.0, 0.0, 0.03])
    np.testing.assert_allclose(off.std(axis=0), wanted, rtol=0.1, atol=1e-9)
    np.testing.assert_allclose(off.mean(axis=0), 0.0, atol=4.0 * wanted.max() / np.sqrt(1000))


def test_a_law_that_fails_ends_its_sampled_run_alone():
    def law(_t, cfg, dq):
        if cfg.q[0] > 0.5:
            raise sa.UnsupportedError("too far out")
        return 0.0 * dq

    starts = [ARM.at([q, 0.5]) for q in (0.0, 0.6, 0.49)]
    noisy = sa.Sampling(period=0.1)
    many = sa.simulate_many(starts, law, 0.5, dq=[0.4, 0.0], sampling=noisy)
    assert many["ended"].values.tolist() == ["duration", *2 * ["controller failed"]]
    assert many["t"][1] == 0.0
    assert 0.0 < many["t"][2] < 0.5


def test_runs_of_a_law_in_python_are_reported_one_by_one():
    told = []
    sa.simulate_many(STARTS, pushing, 0.5, threads=1, progress=lambda done, _: told.append(done))
    assert told[-1] == 5
    assert min(told) < 5  # before all are done


def test_a_stop_while_reporting_ends_all_runs():
    told = []

    def stop(done, _total):
        told.append(done)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sa.simulate_many([STARTS[0]] * 400, pushing, 20.0, threads=1, progress=stop)
    assert len(told) == 1
    assert told[0] < 400
