"""Runs against closed forms, against another's integrator, and against themselves."""

import numpy as np
import pytest
from helpers.arms import load_text, random_tree

import spacearm as sa
from spacearm.motion.events import clear_of_singularities
from spacearm.motion.run import Runs
from spacearm.motion.system import System, prepared


def oscillator(kp):
    """One joint on a fixed spacecraft and a spring: q = q0 cos(w t)."""
    arm = sa.load("planar2", locked={"joint_2": 0.3})
    H = sa.generalized_inertia(arm.at([0.5]), mode="fixed")[0, 0]
    return arm, np.sqrt(kp / H)


@pytest.mark.parametrize("method", ["auto", "DOP853", "Rodas5P"])
def test_an_oscillator_keeps_its_closed_form(method):
    arm, w = oscillator(20.0)
    law = sa.JointPD(target=[0.0], kp=20.0, kd=0.0)
    run = sa.simulate(
        arm.at([0.5]),
        law,
        10.0,
        mode="fixed",
        integration=sa.Integration(rtol=1e-9, atol=1e-11, method=method),
    )
    error = np.abs(run.q[:, 0] - 0.5 * np.cos(w * run.t)).max()
    assert error < (1e-7 if method != "Rodas5P" else 1e-5)


def test_an_event_is_found_to_a_nanosecond():
    arm, w = oscillator(20.0)
    law = sa.JointPD(target=[0.0], kp=20.0, kd=0.0)
    run = sa.simulate(
        arm.at([0.5]),
        law,
        5.0,
        mode="fixed",
        stop=["target"],
        integration=sa.Integration(rtol=1e-11, atol=1e-13, events=["target"], reach=0.1),
    )
    assert run.events[0].t == pytest.approx(np.arccos(0.1 / 0.5) / w, abs=1e-9)
    assert run.t[-1] == run.events[0].t


def runs_of(system, duration, how, coupled=None):
    run = Runs([system], [prepared(system)], np.zeros(0), duration, how)
    run.batch.coupled = coupled or run.batch.coupled
    run.advance(duration)
    assert run.ended == ["duration"]
    return run


@pytest.mark.parametrize(("kd", "implicit"), [(3e3, True), (2.0, False)])
def test_a_stiff_run_takes_the_implicit_method_and_a_soft_one_does_not(kd, implicit):
    arm = sa.load("planar2")
    law = sa.JointPD(target=[0.3, 0.1], kp=kd, kd=kd)
    system = System(arm.at([0.1, 0.2]), controllers={-1: law})
    run = runs_of(system, 20.0, sa.Integration(rtol=1e-6, atol=1e-8))
    assert bool(run.batch.implicit[0]) == implicit
    np.testing.assert_allclose(run.batch.y[0, :2], [0.3, 0.1], atol=1e-3)


@pytest.mark.parametrize("kd", [30.0, 1e4])
def test_a_loose_stiff_run_is_no_worse_than_its_tolerance(kd):
    arm = sa.load("planar2")
    law = sa.JointPD(target=lambda t: [0.3 * np.sin(0.2 * t), 0.1], kp=kd, kd=kd)
    loose = sa.simulate(
        arm.at([0.1, 0.2]),
        law,
        40.0,
        integration=sa.Integration(rtol=1e-2, atol=1e-4, dt=0.1, events=()),
    )
    known = sa.simulate(
        arm.at([0.1, 0.2]),
        law,
        40.0,
        integration=sa.Integration(dt=0.1, events=(), method="Rodas5P"),
    )
    np.testing.assert_allclose(loose.q, known.q, atol=3e-3)
    np.testing.assert_allclose(loose.momentum, 0.0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["joints", "moving", "pose", "wrench"])
def test_the_implicit_steps_leave_out_only_columns_that_do_not_count(case):
    """The same end, whether all columns of the Jacobian are computed or those that count."""
    arm = sa.load("planar2")
    point = arm.at([0.5, 1.2]).tip.translation[:2]
    law = (
        sa.TransposedJacobian(target=point, kp=20.0, kd=50.0)
        if case == "pose"
        else sa.JointPD(target=[0.3, 0.1], kp=20.0, kd=50.0)
    )
    wrench = {arm.tree.root: np.array([0.1, 0.2, 0.0, 0.0, 0.0, 0.3])}
    acts = {"wrenches": wrench} if case == "wrench" else {}
    momentum = np.array([0.3, 0.1, 0.0, 0.0, 0.0, 0.5]) if case == "moving" else np.zeros(6)
    start = arm.at([0.3, 1.1], momentum=momentum)
    system = System(start, plant=sa.Plant(**acts), controllers={-1: law})
    how = sa.Integration(method="Rodas5P")
    ends = [runs_of(system, 5.0, how, every).batch.y[0] for every in (None, 17)]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)


def test_a_redundant_arm_meets_the_singular_set_when_its_distance_says_so():
    """Between looks at the distance, which costs many rates, nothing is missed."""
    arm, q0 = sa.load("planar3", task="x y"), np.array([0.2, 0.6, -0.4])
    beyond = q0 + 1.3 * (sa.singular_set(arm).nearest(q0).q - q0)

    def law(_, cfg, dq):
        return sa.inverse_dynamics(cfg, dq, beyond - cfg.q - 2.0 * dq).tau

    run = sa.simulate(
        arm.at(q0), law, 4.0, integration=sa.Integration(rtol=1e-6, dt=0.05, events=["singularity"])
    )
    clear = np.array([clear_of_singularities(arm.at(q), "free-floating") for q in run.q])
    fell = int(np.argmax(clear < 0.0))
    assert [event.kind for event in run.events] == ["singularity"]
    assert run.t[fell - 1] <= run.events[0].t <= run.t[fell]
    there = clear_of_singularities(arm.at(run.events[0].q), "free-floating")
    assert there == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("mode", ["free-floating", "attitude-controlled", "fixed"])
def test_a_random_tree_moves_as_scipy_integrates_it(mode):
    """Our rate, another's integrator: scipy's DOP853."""
    from scipy.integrate import solve_ivp

    arm = load_text(random_tree(5, 5), tip="link_3", task=sa.Task("pose", length=1.0))
    q0, kp = np.linspace(-0.5, 0.5, arm.n), 3.0
    law = sa.JointPD(target=np.zeros(arm.n), kp=kp, kd=1.0)
    run = sa.simulate(
        arm.at(q0),
        law,
        2.0,
        mode=mode,
        integration=sa.Integration(rtol=1e-10, atol=1e-12, events=()),
    )

    def rate(_, y):
        cfg, dq = arm.at(y[: arm.n]), y[arm.n :]
        return np.concatenate((dq, sa.forward_dynamics(cfg, dq, law(0.0, cfg, dq), mode=mode).ddq))

    start = np.concatenate((q0, np.zeros(arm.n)))
    known = solve_ivp(rate, (0.0, 2.0), start, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(run.q[-1], known[: arm.n], atol=1e-8)
    np.testing.assert_allclose(run.dq[-1], known[arm.n :], atol=1e-8)
