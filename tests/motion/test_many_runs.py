"""Many runs at once: each is the one that `simulate` makes."""

import numpy as np
import pytest
from helpers.arms import load_text
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


def test_laws_momenta_and_payloads_may_differ():
    laws = [sa.JointPD(target=[0.1 * i, 0.5], kp=5.0, kd=15.0) for i in range(5)]
    h = np.zeros((5, 6))
    h[:, 5] = np.linspace(-1, 1, 5)
    payload = [0.0, 1.0, 2.0, 0.0, 4.0]
    starts = [ARM.at(q, momentum=one) for q, one in zip(Q0, h, strict=True)]
    many = sa.simulate_many(starts, laws, 5.0, payload=payload)
    for i in (1, 3):
        arm = ARM.replace(payload=payload[i]) if payload[i] else ARM
        one = sa.simulate(
            arm.at(Q0[i], momentum=h[i]),
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
        ({"payload": [-1.0] * 5}, "masses from 0"),
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


def test_loaded_arms_may_start_about_their_own_cm():
    arms = [ARM.replace(payload=mass) for mass in (1.0, 4.0)]
    starts = [arm.at(Q0[0]).centred(np.zeros(3)) for arm in arms]
    many = sa.simulate_many(starts, LAW, 2.0)
    for i, start in enumerate(starts):
        one = sa.simulate(start, LAW, 2.0, integration=COARSE)
        np.testing.assert_allclose(many["q"][i], one.q[-1], atol=1e-12)
        np.testing.assert_allclose(many["base"][i], one.base[-1], atol=1e-12)
