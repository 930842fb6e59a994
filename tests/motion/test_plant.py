"""What acts on a simulated arm besides its motors: wheels, wrenches, springs, friction, limits."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import frame, joint, link, load_text, robot
from helpers.arms import with_wheels as text_with_wheels

import spacearm as sa


def nothing(*state):
    return np.zeros_like(state[-1])


def with_wheels():
    """A bus with three orthogonal wheels and a two-joint arm."""
    wheels = [
        part
        for i, axis in enumerate(np.eye(3))
        for part in (
            link(f"w{i}", 1.0, inertia=0.01 * np.eye(3)),
            joint(f"wheel_{i}", "bus", f"w{i}", "continuous", (0, 0, 0), axis=axis),
        )
    ]
    text = robot(
        link("bus", 100.0, inertia=20.0 * np.eye(3)),
        *wheels,
        link("upper", 5.0, (0.5, 0, 0), 0.4 * np.eye(3)),
        joint("shoulder", "bus", "upper", axis=(0, 0.6, 0.8)),
        link("lower", 4.0, (0.4, 0, 0), 0.3 * np.eye(3)),
        joint("elbow", "upper", "lower", xyz=(1, 0, 0)),
        frame("hand"),
        joint("wrist", "lower", "hand", "fixed", (0.8, 0, 0)),
    )
    return load_text(text, tip="hand", task="x y", wheels=["wheel_0", "wheel_1", "wheel_2"])


LAW = sa.JointPD(target=[0.8, -0.6], kp=4.0, kd=6.0)


# --- wheels ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_wheels_hold_the_attitude_and_take_the_momentum():
    arm = with_wheels()
    hold = sa.WheelHold(stiffness=400.0, damping=600.0)
    free = sa.simulate(arm.at([0.1, 0.3]), LAW, 40.0)
    held = sa.simulate(arm.at([0.1, 0.3]), LAW, 40.0, plant=sa.Plant(wheels=hold))
    turned = [np.linalg.norm(pin.log3(run[-1].base.rotation)) for run in (free, held)]
    assert turned[1] < 0.02 * turned[0]
    assert np.abs(held.wheels).max() > 0.1
    assert not free.wheels.any()
    for run in (free, held):
        assert run.imbalance < 1e-7
        assert np.abs(run.momentum).max() < 1e-9
    i = int(np.linalg.norm(held.wheels, axis=1).argmax())
    known = sa.momentum_matrix(held[i]).A_q @ held.dq[i]
    assert np.abs(known[3:] + held[i].stored[3:]).max() < 0.3 * np.abs(known[3:]).max()


def test_wheels_saturate_at_their_momentum():
    arm = with_wheels()
    hold = sa.WheelHold(stiffness=40.0, damping=60.0, capacity=0.2, torque=5.0)
    run = sa.simulate(arm.at([0.1, 0.3]), LAW, 10.0, plant=sa.Plant(wheels=hold))
    full = [event for event in run.events if event.kind == "wheel full"]
    assert full
    assert np.abs(run.wheels).max() <= 0.2 * (1.0 + 1e-6)
    assert run.imbalance < 1e-6
    assert np.abs(run.momentum).max() < 1e-9
    first = sa.simulate(
        arm.at([0.1, 0.3]), LAW, 10.0, stop=["wheel full"], plant=sa.Plant(wheels=hold)
    )
    assert first.ended == "wheel full"
    index = [wheel.name for wheel in arm.wheels].index(first.events[-1].detail)
    assert abs(first.wheels[-1, index]) == pytest.approx(0.2, abs=1e-9)


def test_a_wheel_gives_no_more_than_its_torque():
    arm = with_wheels()
    hold = sa.WheelHold(stiffness=400.0, damping=60.0, torque=0.05)
    # rates are differences of what is known to these
    fine = sa.Integration(rtol=1e-9, atol=1e-12, dt=0.01)
    run = sa.simulate(
        arm.at([0.1, 0.3]),
        LAW,
        10.0,
        plant=sa.Plant(wheels=hold),
        integration=fine,
    )
    rates = np.diff(run.wheels, axis=0) / np.diff(run.t)[:, None]
    assert np.abs(rates).max() <= 0.05 * (1.0 + 1e-9)
    assert np.abs(rates).max() > 0.049


def test_torques_of_wheels_over_time_are_what_they_take_up():
    """Energy and momentum are balanced as in every run; a full turn of the cosine takes nothing."""
    arm, h = with_wheels(), [0.0, 0.0, 0.0, 0.5, 0.0, -0.2]
    steady, swing = np.array([0.1, 0.0, -0.2]), np.array([0.0, 0.3, 0.0])

    def torques(t):
        return steady + swing * np.cos(2.0 * np.pi * t / 5.0)

    run = sa.simulate(
        arm.at([0.1, 0.3], wheels=[0, 1, 0], momentum=h), LAW, 5.0, plant=sa.Plant(wheels=torques)
    )
    np.testing.assert_allclose(run.wheels[-1], [0.5, 1.0, -1.0], atol=1e-9)
    np.testing.assert_allclose(run.momentum, [h] * len(run), atol=1e-9)
    assert run.imbalance < 1e-6
    assert run.drift < 1e-9


def test_torques_of_wheels_that_make_no_sense_are_refused():
    arm, bare = with_wheels(), sa.load("planar2")
    with pytest.raises(sa.ConfigurationError, match="one for each wheel"):
        sa.simulate(arm.at([0.1, 0.3]), LAW, 1.0, plant=sa.Plant(wheels=lambda _: [1.0]))
    with pytest.raises(sa.UnsupportedError, match="no wheels"):
        sa.simulate(bare.at([0.1, 0.3]), LAW, 1.0, plant=sa.Plant(wheels=lambda _: [1.0]))
    with pytest.raises(sa.ConfigurationError, match="wheels turn the spacecraft and mode"):
        sa.simulate(
            arm.at([0.1, 0.3]), LAW, 1.0, mode="fixed", plant=sa.Plant(wheels=lambda _: np.zeros(3))
        )
    with pytest.raises(ValueError, match="no torque left"):
        sa.simulate(arm.at([0.1, 0.3]), LAW, 1.0, plant=sa.Plant(wheels=failing))


def failing(t):
    if t > 0.5:
        raise ValueError("no torque left")
    return np.zeros(3)


def test_a_wheel_with_momentum_makes_the_spacecraft_a_gyroscope():
    """A torque about x turns a bus with momentum along z about y, by Euler's equation."""
    arm = with_wheels()
    h = np.array([0, 0, 0, 0, 0, 50.0])
    push = {"bus": (0, 0, 0, 0.1, 0, 0)}
    run = sa.simulate(
        arm.at([0.0, 0.0], wheels=[0, 0, 50.0], momentum=h),
        sa.JointPD(target=[0, 0], kp=4e3, kd=4e3),
        2.0,
        plant=sa.Plant(wrenches=push),
        integration=sa.Integration(events=()),
    )
    assert run.imbalance < 1e-6
    np.testing.assert_allclose(run.momentum[-1], [*h[:3], 0.2, *h[4:]], atol=1e-8)
    np.testing.assert_allclose(run.impulse[-1], [0, 0, 0, 0.2, 0, 0], atol=1e-8)


# --- wrenches -------------------------------------------------------------------------------


def test_a_force_brings_momentum_and_work():
    arm = sa.load("chaser7")
    force = np.array([2.0, -1.0, 0.5])
    links = list(arm.tree.links)
    push = {links[0]: (*force, 0, 0, 0), arm.tip: lambda t: (*(np.cos(t) * force), 0.1, 0.2, 0)}
    run = sa.simulate(
        arm.at(np.full(7, 0.3)),
        nothing,
        3.0,
        plant=sa.Plant(wrenches=push),
        integration=sa.Integration(rtol=1e-10, events=()),
    )
    linear = force * (3.0 + np.sin(3.0))
    np.testing.assert_allclose(run.momentum[-1, :3], linear, atol=1e-7)
    np.testing.assert_allclose(run.impulse[-1], run.momentum[-1] - run.momentum[0], atol=1e-7)
    assert [*run.wrenches] == [links[0], arm.tip]
    at = {links[0]: run.base[:, :3], arm.tip: run.tip[:, :3]}
    moved = sum(w[:, :3] for w in run.wrenches.values())
    turned = sum(w[:, 3:] + np.cross(at[x] - run.com, w[:, :3]) for x, w in run.wrenches.items())
    brought = np.trapezoid(np.hstack((moved, turned)), run.t, axis=0)
    np.testing.assert_allclose(brought, run.impulse[-1], atol=1e-5)
    assert run.imbalance < 1e-8
    assert run.other_work[-1] > 0.1
    assert not run.work.any()
    shift = np.trapezoid(run.momentum[:, :3], run.t, axis=0) / arm.mass
    np.testing.assert_allclose(run.com[-1] - run.com[0], shift, atol=1e-5)


@pytest.mark.slow
def test_a_thruster_turns_with_its_link():
    """A thruster at the CM of a spinning spacecraft along its own axis: circles, no net push."""
    arm = sa.load("planar2")
    cfg = arm.at([0.2, 0.3])
    spin = np.array([0, 0, 0, 0, 0, 2.0 * np.pi * cfg.A[5, 5] / 10.0])  # a turn in 10 s
    law = sa.JointPD(target=[0.2, 0.3], kp=5e3, kd=5e3)
    root = arm.tree.root
    fixed = sa.simulate(
        arm.at(cfg.q, momentum=spin),
        law,
        10.0,
        plant=sa.Plant(wrenches={root: (0.01, 0, 0, 0, 0, 0)}),
        integration=sa.Integration(events=()),
    )
    turning = sa.simulate(
        arm.at(cfg.q, momentum=spin),
        law,
        10.0,
        plant=sa.Plant(thrusters={root: (0.01, 0, 0, 0, 0, 0)}),
        integration=sa.Integration(events=()),
    )
    assert np.linalg.norm(fixed.impulse[-1, :3]) == pytest.approx(0.1, rel=1e-6)
    assert np.linalg.norm(turning.impulse[-1, :3]) < 2e-3
    for i in (0, 300, 700):
        R = turning[i].base.rotation
        np.testing.assert_allclose(
            turning.wrenches[root][i], [*0.01 * R[:, 0], 0, 0, 0], atol=1e-12
        )
    assert np.ptp(fixed.wrenches[root], axis=0).max() == 0.0
    assert turning.imbalance < 1e-6


# --- joints ---------------------------------------------------------------------------------


def test_a_spring_swings_and_damping_ends_it():
    arm = sa.load("planar2", locked={"joint_2": 0.4})
    H = sa.generalized_inertia(arm.at([0.3]))[0, 0]
    spring = {"joint_1": sa.PassiveJoint(stiffness=8.0, rest=0.1)}
    run = sa.simulate(
        arm.at([0.3]),
        nothing,
        10.0,
        plant=sa.Plant(passive=spring),
        integration=sa.Integration(rtol=1e-10),
    )
    w = np.sqrt(8.0 / H)
    assert np.ptp(run.q) == pytest.approx(0.4, rel=1e-3)
    peaks = run.t[1:-1][(run.q[1:-1, 0] > run.q[:-2, 0]) & (run.q[1:-1, 0] > run.q[2:, 0])]
    assert np.diff(peaks).mean() == pytest.approx(2 * np.pi / w, rel=0.02)  # H depends on q
    assert run.imbalance < 1e-8
    damped = {"q1": sa.PassiveJoint(stiffness=8.0, rest=0.1, damping=10.0)}
    end = sa.simulate(arm.at([0.3]), nothing, 60.0, plant=sa.Plant(passive=damped))
    assert end.q[-1, 0] == pytest.approx(0.1, abs=1e-6)
    assert end.other_work[-1] == pytest.approx(0.0, abs=1e-6)


def test_dry_friction_stops_a_joint():
    arm = sa.load("planar2")
    dry = {"joint_1": sa.PassiveJoint(friction=0.5), "joint_2": sa.PassiveJoint(friction=0.5)}
    run = sa.simulate(
        arm.at([0.1, 0.2]), nothing, 20.0, dq=[0.2, -0.1], plant=sa.Plant(passive=dry)
    )
    assert np.abs(run.dq[-1]).max() < 1e-3
    assert run.imbalance < 1e-6
    assert run.energy[-1] < 1e-3 * run.energy[0]


def test_limits_cut_the_torques():
    arm = load_text(
        robot(
            link("bus", 50.0),
            link("arm", 5.0, (0.3, 0, 0), 0.2 * np.eye(3)),
            joint("elbow", "bus", "arm"),  # effort 10, velocity 1
        ),
        tip="arm",
        task="rz",
    )
    law = sa.JointPD(target=[2.5], kp=200.0, kd=20.0)
    free = sa.simulate(arm.at([0.0]), law, 5.0)
    assert np.abs(free.torque).max() > 100.0
    cut = sa.simulate(arm.at([0.0]), law, 8.0, plant=sa.Plant(limits=True))
    assert np.abs(cut.torque).max() <= 10.0
    assert np.abs(cut.dq).max() <= 1.0
    assert np.abs(cut.dq).max() > 0.9
    assert cut.q[-1, 0] == pytest.approx(2.5, abs=1e-2)
    assert cut.imbalance < 1e-6


# --- controllers ----------------------------------------------------------------------------


def test_a_controller_of_a_user_is_the_one_of_ours():
    arm = sa.load("planar2")
    goal = np.array([0.5, -0.3])

    def law(_, cfg, dq):
        return 4.0 * (goal - cfg.q) - 6.0 * dq

    def branching(t, cfg, dq):
        return law(t, cfg, dq) if t >= 0.0 else dq

    q0 = [0.1, 0.2]
    ours = sa.simulate(arm.at(q0), sa.JointPD(target=goal, kp=4.0, kd=6.0), 10.0)
    for controller in (law, branching):  # traced, and called
        run = sa.simulate(arm.at(q0), controller, 10.0)
        assert (len(run.called) == 0) == (controller is law)
        assert ("called in Python" in repr(run)) == (controller is branching)
        np.testing.assert_allclose(run.q, ours.q, atol=1e-12)


def test_a_controller_of_a_user_sees_tip_and_jacobian():
    arm = sa.load("planar2")
    goal = np.array([1.2, 0.7, 0.0])

    def law(_, cfg, dq):
        J = sa.generalized_jacobian(cfg)[:2]
        return J.T @ (5.0 * (goal[:2] - cfg.tip.translation[:2]) - 15.0 * (J @ dq))

    base = pin.SE3(pin.exp3(np.array([0, 0, 0.4])), np.array([0.1, 0.2, 0]))
    known = sa.TransposedJacobian(target=goal[:2], kp=5.0, kd=15.0)
    ours = sa.simulate(arm.at([0.1, 0.9], base=base), known, 10.0)
    run = sa.simulate(arm.at([0.1, 0.9], base=base), law, 10.0)
    np.testing.assert_allclose(run.q, ours.q, atol=1e-9)


def test_a_traced_controller_sees_the_momentum_as_a_called_one_does():
    """A wrench brings momentum on the way; inverse dynamics minds it."""
    arm, goal = sa.load("planar2"), np.array([0.5, -0.3])

    def law(_, cfg, dq):
        return sa.inverse_dynamics(cfg, dq, 4.0 * (goal - cfg.q) - 4.0 * dq).tau * (
            1.0 + 0.1 * cfg.momentum[5]
        )

    def branching(t, cfg, dq):
        return law(t, cfg, dq) if t >= 0.0 else dq

    start = arm.at([0.1, 0.2], momentum=[0.2, 0.1, 0.0, 0.0, 0.0, 1.5])
    plant = sa.Plant(wrenches={arm.tree.root: [0.3, 0.0, 0.0, 0.0, 0.0, 0.4]})
    runs = [sa.simulate(start, controller, 4.0, plant=plant) for controller in (law, branching)]
    assert [bool(run.called) for run in runs] == [False, True]
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-9)


def test_a_controller_of_fixed_rate_holds_its_torques():
    arm = sa.load("planar2")
    law = sa.JointPD(target=[0.5, -0.3], kp=0.5, kd=1.0)
    always = sa.simulate(arm.at([0.1, 0.2]), law, 10.0)
    errors = []
    for period in (0.1, 0.05):
        run = sa.simulate(
            arm.at([0.1, 0.2]),
            law,
            10.0,
            sampling=sa.Sampling(period=period),
            integration=sa.Integration(dt=0.01),
        )
        errors.append(np.abs(run.q[200] - always.q[200]).max())
        assert len(np.unique(run.torque[:, 0])) <= 10.0 / period + 2
        assert run.imbalance < 1e-7
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.2)  # a hold is a delay of half of it


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"period": 0.1, "delay": -0.2}, "delay is -0.2"),
        ({"period": -1.0}, "period"),
        ({"period": 0.1, "seed": -1}, "seed"),
    ],
)
def test_sampling_that_makes_no_sense_is_refused(given, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.Sampling(**given)


def test_a_delay_is_waited_for():
    arm = sa.load("planar2")
    run = sa.simulate(
        arm.at([0.1, 0.2]),
        sa.JointPD(target=[0.5, -0.3], kp=4.0, kd=6.0),
        1.0,
        sampling=sa.Sampling(period=0.1, delay=0.04),
        integration=sa.Integration(dt=0.02),
    )
    assert not run.torque[run.t < 0.039].any()
    assert run.torque[3].any()
    assert not run.dq[1].any()


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.1, 0.25, 0.3])
def test_a_delay_may_be_longer_than_the_period(delay):
    """Each torque is that of the law in the state so long before, whatever the period."""
    arm, period = sa.load("planar2"), 0.1
    law = sa.JointPD(target=[0.5, -0.3], kp=0.5, kd=1.0)
    how = sa.Integration(dt=0.025, rtol=1e-10)
    run = sa.simulate(
        arm.at([0.1, 0.2]),
        law,
        1.0,
        sampling=sa.Sampling(period=period, delay=delay),
        integration=how,
    )
    for k in range(len(run.t) - 1):
        acts = np.floor((run.t[k] + 0.0125 - delay) / period)  # looked at between two rows
        if acts < 0 or abs((run.t[k] - delay) / period - round((run.t[k] - delay) / period)) < 1e-6:
            continue
        i = round(acts * period / 0.025)
        wanted = law(run.t[i], run[i], run.dq[i])
        np.testing.assert_allclose(run.torque[k], wanted, atol=1e-7)
    assert not run.torque[run.t < delay - 1e-9].any()


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_sampled_tracking_loop_is_stable_up_to_the_inverse_period(share):
    """A double integrator whose acceleration is held: as its exact steps, error for error."""
    arm, T = sa.load("planar2"), 0.2
    rate, stay = share / T, [0.3, 1.2]
    law = sa.Tracking(sa.Motion(arm, [0, 1], [stay] * 2, [[0, 0, 0, 0, 0, 0, 1]] * 2), rate)
    off, dt = np.array([1e-6, -2e-6]), T / 4
    run = sa.simulate(
        arm.at(stay + off), law, 10 * T, sampling=sa.Sampling(period=T),
        integration=sa.Integration(rtol=1e-12, atol=1e-15, dt=dt),
    )  # fmt: skip
    gains = np.array([rate**2, 2.0 * rate])
    step = np.array([[1.0, T], [0.0, 1.0]]) - np.outer([T**2 / 2, T], gains)
    assert (np.abs(np.linalg.eigvals(step)).max() < 1.0) == (share < 1.0)
    errors = [np.linalg.matrix_power(step, k)[0, 0] * off for k in range(11)]
    np.testing.assert_allclose(run.q[::4] - stay, errors, rtol=0, atol=1e-2 * np.abs(off).max())


@pytest.mark.parametrize(("period", "delay"), [(0.2, 0.0), (0.2, 0.1), (0.02, 0.2), (0.1, 0.34)])
def test_the_rate_for_tracking_is_borne_by_period_and_delay(period, delay):
    """Errors vanish about as fast as the rate says, whatever the two are."""
    arm, sampling = sa.load("planar2"), sa.Sampling(period=period, delay=delay)
    stay, rate = [0.3, 1.2], sampling.tracking_rate
    law = sa.Tracking(sa.Motion(arm, [0, 1], [stay] * 2, [[0, 0, 0, 0, 0, 0, 1]] * 2), rate)
    run = sa.simulate(arm.at(np.add(stay, 1e-3)), law, 12.0 / rate, sampling=sampling)
    assert np.abs(run.q[-1] - stay).max() < 1e-3 * 1e-2


def test_two_tips_have_a_law_each():
    arm = sa.load("planar2")
    text = robot(
        link("bus", 60.0, inertia=8 * np.eye(3)),
        *(
            part
            for side, x in (("left", -0.5), ("right", 0.5))
            for part in (
                link(f"{side}_1", 4.0, (0.5, 0, 0), 0.3 * np.eye(3)),
                joint(f"{side}_a", "bus", f"{side}_1", xyz=(x, 0, 0)),
                link(f"{side}_2", 3.0, (0.5, 0, 0), 0.3 * np.eye(3)),
                joint(f"{side}_b", f"{side}_1", f"{side}_2", xyz=(1.0, 0, 0)),
                frame(f"{side}_tip"),
                joint(f"{side}_c", f"{side}_2", f"{side}_tip", "fixed", (1.0, 0, 0)),
            )
        ),
    )
    arm = load_text(text, tip=["left_tip", "right_tip"], task="x y")
    cfg = arm.at([2.0, 0.8, 0.5, 0.9])
    goals = {
        tip: cfg.tips[i].translation[:2] + np.array([0.1, -0.15]) for i, tip in enumerate(arm.tips)
    }
    laws = {tip: sa.TransposedJacobian(target=goal, kp=8.0, kd=20.0) for tip, goal in goals.items()}
    run = sa.simulate(cfg, laws, 60.0)
    for i, tip in enumerate(arm.tips):
        np.testing.assert_allclose(run[-1].tips[i].translation[:2], goals[tip], atol=2e-3)
    assert run.imbalance < 1e-7
    assert len({e.detail for e in run.events if e.kind == "target"}) == 2
    with pytest.raises(sa.ConfigurationError, match="left_tip"):
        sa.simulate(cfg, {"hand": laws["left_tip"]}, 1.0)
    with pytest.raises(sa.UnsupportedError):
        sa.simulate(cfg, laws["left_tip"], 1.0)


# --- bad input ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"plant": lambda _: sa.Plant(wrenches={"wing": np.zeros(6)})}, "'wing'"),
        (
            {"plant": lambda root: sa.Plant(thrusters={root: lambda _: np.zeros(3)})},
            "6 finite numbers",
        ),
        ({"plant": lambda _: sa.Plant(passive={"joint_9": sa.PassiveJoint()})}, "joint_9"),
        (
            {"plant": lambda _: sa.Plant(passive={"joint_1": sa.PassiveJoint(damping=-1.0)})},
            "damping is -1.0; give a number from 0",
        ),
        ({"plant": lambda _: sa.Plant(limits=["effort"])}, "give True or False"),
    ],
)
def test_bad_input(options, message):
    arm = sa.load("planar2")

    def run(plant=lambda _: sa.Plant(), **others):
        sa.simulate(arm.at([0.1, 0.2]), nothing, 1.0, plant=plant(arm.tree.root), **others)

    with pytest.raises(sa.ConfigurationError, match=message):
        run(**options)


def test_wheels_that_are_not_there_hold_nothing():
    with pytest.raises(sa.UnsupportedError, match="wheels="):
        sa.simulate(
            sa.load("planar2").at([0, 1]),
            nothing,
            1.0,
            plant=sa.Plant(wheels=sa.WheelHold(stiffness=1, damping=1)),
        )
    with pytest.raises(sa.ConfigurationError, match="torque of the wheels"):
        sa.WheelHold(stiffness=1, damping=1, torque=-1.0)


# --- friction of the description -------------------------------------------------------------


def with_friction(first, second):
    """The arm of two joints with <dynamics>."""
    arm = sa.load("planar2")
    text = arm.path.read_text()
    names = arm.joint_names
    for name, dynamics in zip(names, (first, second), strict=True):
        start = text.index("</joint>", text.index(f'<joint name="{name}"'))
        text = text[:start] + dynamics + text[start:]
    return load_text(text, task="x y"), names


def test_friction_of_the_description_acts_when_it_is_asked_for():
    arm, (first, second) = with_friction(
        '<dynamics damping="0.3"/>', '<dynamics damping="0.1" friction="0.05"/>'
    )
    assert arm.tree.joints[second].friction == 0.05
    asked = sa.simulate(
        arm.at([0.3, 0.9]), nothing, 2.0, dq=[0.4, -0.6], plant=sa.Plant(passive="described")
    )
    named = {
        first: sa.PassiveJoint(damping=0.3),
        second: sa.PassiveJoint(damping=0.1, friction=0.05),
    }
    known = sa.simulate(
        arm.at([0.3, 0.9]), nothing, 2.0, dq=[0.4, -0.6], plant=sa.Plant(passive=named)
    )
    free = sa.simulate(arm.at([0.3, 0.9]), nothing, 2.0, dq=[0.4, -0.6])
    np.testing.assert_array_equal(asked.q, known.q)
    assert asked.energy[-1] < 0.9 * free.energy[-1]
    assert free.energy[-1] == pytest.approx(free.energy[0], rel=1e-7)


def test_friction_goes_through_a_urdf_and_faults_are_said(tmp_path):
    arm, (first, second) = with_friction('<dynamics damping="0.3" friction="0.2"/>', "")
    again = sa.load(arm.to_urdf(tmp_path / "arm.urdf"))
    assert again.tree.joints[first].damping == 0.3
    assert again.tree.joints[first].friction == 0.2
    assert again.tree.joints[second].damping == 0.0
    with pytest.warns(sa.ModelWarning, match=f"damping='-1' of joint '{first}'"):
        faulty, _ = with_friction('<dynamics damping="-1" friction="0.2"/>', "")
    assert faulty.tree.joints[first].damping == 0.0
    with pytest.raises(sa.ConfigurationError, match="described"):
        sa.simulate(arm.at([0.3, 0.9]), nothing, 1.0, plant=sa.Plant(passive="file"))


def test_friction_of_followers_acts_on_their_leader():
    text = robot(
        link("bus", 100.0, inertia=20.0 * np.eye(3)),
        link("upper", 5.0, (0.5, 0, 0), 0.4 * np.eye(3)),
        joint("shoulder", "bus", "upper"),
        link("lower", 4.0, (0.4, 0, 0), 0.3 * np.eye(3)),
        joint("elbow", "upper", "lower", xyz=(1, 0, 0)).replace(
            "</joint>", '<mimic joint="shoulder" multiplier="-2"/><dynamics damping="0.3" '
            'friction="0.1"/></joint>'
        ),
        frame("hand"),
        joint("wrist", "lower", "hand", "fixed", (0.8, 0, 0)),
    )  # fmt: skip
    arm = load_text(text, tip="hand", task="x")
    from spacearm.motion.plant import described

    assert described(arm)["shoulder"].damping == pytest.approx(1.2)
    assert described(arm)["shoulder"].friction == pytest.approx(0.2)


def test_friction_of_an_mjcf(tmp_path):
    pytest.importorskip("mujoco")
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><worldbody><body name="bus"><freejoint/><geom size="0.5" mass="50"/>'
        '<body name="link" pos="1 0 0"><joint name="hinge" damping="0.4" frictionloss="0.2"/>'
        '<geom size="0.1" mass="2"/></body></body></worldbody></mujoco>'
    )
    hinge = sa.load(path, task="x").tree.joints["hinge"]
    assert (hinge.damping, hinge.friction) == (0.4, 0.2)


def test_wheels_that_are_asked_for_more_than_they_can_are_named():
    """The law's limits are its own; the description's are compared."""
    arm = load_text(text_with_wheels("planar2", [0, 0, 1], torque=1e-3, rate=1e-2))
    start = arm.at([0.3, 1.2])
    law = sa.JointPD(target=[0.9, 1.4], kp=5.0, kd=9.0)
    plant = sa.Plant(wheels=sa.WheelHold(stiffness=50.0, damping=50.0))
    run = sa.simulate(start, law, 3.0, plant=plant)
    rate = np.gradient(run.wheels[:, 0], run.t)
    inner = slice(100, -100)
    np.testing.assert_allclose(run.wheel_torque[inner, 0], rate[inner], atol=1e-3 * abs(rate).max())
    notes = " ".join(run.describe().notes)
    assert "times its limit of 0.0001 N m s" in notes
    assert "times its limit of 0.001 N m" in notes


@pytest.mark.parametrize("enforced", [False, True])
def test_the_time_at_the_torque_limit_is_reported(enforced):
    """A torque of twice the effort for a quarter of the time is at the limit for a quarter."""
    arm = sa.load("planar2")
    efforts = np.array([arm.tree.joints[name].effort for name in arm.joint_names])
    assert np.isfinite(efforts).all()

    def law(t, *_):
        return [2.0 * efforts[0], 0.0] if t < 0.0005 else [0.0, -0.1 * efforts[1]]

    run = sa.simulate(
        arm.at([0.3, 1.2]),
        law,
        0.002,
        plant=sa.Plant(limits=enforced),
        integration=sa.Integration(dt=1e-5, events=()),
    )
    first, second = run.motors
    assert first.share == pytest.approx(0.25, abs=0.01)
    assert first.largest == pytest.approx((1.0 if enforced else 2.0) * efforts[0])
    assert (second.share, second.largest) == (0.0, pytest.approx(0.1 * efforts[1]))
    assert (first.limit, first.enforced) == (efforts[0], enforced)
    notes = [note for note in run.describe().notes if "limit" in note]
    assert len(notes) == 1
    assert arm.joint_names[0] in notes[0]
    assert arm.joint_names[1] not in notes[0]


def test_sampled_torques_are_reported_as_they_act_and_their_accelerations_too():
    arm = sa.load("planar2")
    law = sa.JointPD(target=[0.9, 1.4], kp=5.0, kd=9.0)
    run = sa.simulate(arm.at([0.3, 1.2]), law, 1.0, sampling=sa.Sampling(period=0.2, delay=0.05))
    for i in (100, 333, 777):
        ddq = sa.forward_dynamics(run[i], run.dq[i], run.torque[i]).ddq
        np.testing.assert_allclose(run.ddq[i], ddq, atol=1e-8 * np.abs(ddq).max())
    slope = np.gradient(run.dq, run.t, axis=0)
    between = np.flatnonzero(np.abs(np.diff(run.torque, axis=0)).max(axis=1) == 0.0)[5:-5]
    inner = between[np.isin(between - 1, between) & np.isin(between + 1, between)]
    np.testing.assert_allclose(run.ddq[inner], slope[inner], atol=1e-3 * np.abs(slope).max())
