"""Flights: bodies grasped and released in flight, momentum balanced."""

import numpy as np
import pinocchio as pin
import pytest

import spacearm as sa

ARM = sa.load("planar2")
Q0 = [0.3, 0.9]
LAW = sa.JointPD(target=[0.5, 0.6], kp=4.0, kd=8.0)
BODY = {"mass": 3.0, "inertia": np.diag([0.2, 0.2, 0.3]), "com": (0.1, -0.05, 0.0)}
COAST = sa.JointPD(target=[0.0, 0.0], kp=0.0, kd=0.0)


def about_origin(momentum, com):
    """Momentum [linear; angular about the inertial origin]."""
    return np.concatenate((momentum[:3], momentum[3:] + np.cross(com, momentum[:3])))


def of_body(cfg, twist):
    """The same of a body at the tip, whose CM moves by its twist."""
    R, c = cfg.tip.rotation, cfg.tip.act(np.array(BODY["com"]))
    spin = R @ BODY["inertia"] @ R.T @ twist[3:]
    return about_origin(np.concatenate((BODY["mass"] * twist[:3], spin)), c)


def test_a_grasp_keeps_the_momentum_of_arm_and_body():
    twist = np.array([0.05, -0.08, 0.0, 0.0, 0.0, 0.3])
    flight = sa.simulate_phases(
        ARM.at(Q0), [sa.Phase(LAW, 2.0, sa.Grasp(twist=twist, **BODY)), sa.Phase(LAW, 3.0)]
    )
    before, after = flight.phases
    cfg, total = before[-1], after.momentum[0]
    alone = about_origin(before.momentum[-1], cfg.com)
    known = alone + of_body(cfg, twist)
    np.testing.assert_allclose(about_origin(total, after[0].com), known, atol=1e-13)
    np.testing.assert_allclose(after.momentum, np.tile(total, (len(after), 1)), atol=1e-12)
    assert flight.captures[0].energy_lost > 0.0
    assert [e.t for e in flight.events if e.kind == "grasp"] == [2.0]
    assert flight.begins.tolist() == [0.0, 2.0]
    np.testing.assert_array_equal(flight.at(4.0).q, after.at(2.0).q)
    assert flight.ended == "duration"
    left, turns = float(np.linalg.norm(total[3:])), flight.turning[-1]  # there are no wheels
    said = f"{left:.3g} N m s are left, and the spacecraft turns at {turns:.3g} rad/s"
    assert said in flight.describe().notes


def test_a_release_takes_away_what_the_body_has():
    phases = [
        sa.Phase(COAST, 0.5, sa.Grasp(twist=[0.1, 0.2, 0, 0, 0, 0.4], **BODY)),
        sa.Phase(LAW, 1.0, sa.Release()),
        sa.Phase(COAST, 1.0),
    ]
    held, free = sa.simulate_phases(ARM.at(Q0), phases).phases[1:]
    cfg = held[-1]
    v = np.concatenate((np.linalg.solve(cfg.A[:, :6],
                        held.momentum[-1] - cfg.A[:, 6:] @ held.dq[-1]), held.dq[-1]))  # fmt: skip
    tip = cfg.J @ v
    lever = cfg.tip.rotation @ np.array(BODY["com"])
    twist = np.concatenate((tip[:3] + np.cross(tip[3:], lever), tip[3:]))
    whole = about_origin(held.momentum[-1], cfg.com)
    parts = about_origin(free.momentum[0], free[0].com) + of_body(cfg, twist)
    np.testing.assert_allclose(parts, whole, atol=1e-13)
    R = cfg.tip.rotation
    own = 0.5 * BODY["mass"] * twist[:3] @ twist[:3]
    own += 0.5 * twist[3:] @ R @ BODY["inertia"] @ R.T @ twist[3:]
    assert free.energy[0] + own == pytest.approx(held.energy[-1], rel=1e-12)
    assert free.arm.model.inertias[-1].mass == ARM.model.inertias[-1].mass


def test_a_grasp_without_impact_changes_no_velocity():
    grasp = sa.Grasp(**BODY)
    flight = sa.simulate_phases(ARM.at(Q0), [sa.Phase(LAW, 1.0, grasp), sa.Phase(COAST, 0.1)])
    before, after = flight.phases
    np.testing.assert_allclose(after.dq[0], before.dq[-1], atol=1e-12)
    assert abs(flight.captures[0].energy_lost) < 1e-12
    np.testing.assert_allclose(after.base[0], before.base[-1], atol=1e-14)


def test_phases_without_bodies_are_one_run():
    parts = sa.simulate_phases(ARM.at(Q0), [sa.Phase(LAW, 2.0), sa.Phase(LAW, 3.0)], dq=[0.1, -0.1])
    one = sa.simulate(ARM.at(Q0), LAW, 5.0, dq=[0.1, -0.1])
    np.testing.assert_allclose(parts.phases[1].q[-1], one.q[-1], atol=1e-7)
    turned = parts.phases[1][-1].base.rotation.T @ one[-1].base.rotation
    assert np.linalg.norm(pin.log3(turned)) < 1e-7


def test_a_body_is_grasped_where_the_target_is_reached_only():
    law = sa.TransposedJacobian(target=(9.0, 9.0), kp=5.0, kd=15.0)
    near = sa.JointPD(target=[0.31, 0.9], kp=50.0, kd=5.0)
    grasp = sa.Grasp(**BODY)
    options = {"stop": ["target"], "integration": sa.Integration(reach=5e-3)}
    for controller, reached in ((near, True), (LAW, False)):
        flight = sa.simulate_phases(
            ARM.at(Q0), [sa.Phase(controller, 2.0, grasp, **options), sa.Phase(COAST, 0.1)]
        )
        assert len(flight.captures) == reached
        assert len(flight.phases) == 1 + reached
    with pytest.raises(sa.ConfigurationError, match=r"the goal is 12\.5.* comes no farther"):
        sa.simulate_phases(ARM.at(Q0), [sa.Phase(law, 1.0)])


def test_what_makes_no_sense_is_refused():
    with pytest.raises(sa.ConfigurationError, match="phases is empty"):
        sa.simulate_phases(ARM.at(Q0), [])
    with pytest.raises(sa.ConfigurationError, match="phase 0 releases"):
        sa.simulate_phases(ARM.at(Q0), [sa.Phase(LAW, 1.0, sa.Release())])
    with pytest.raises(sa.ConfigurationError, match=r"argument of sa\.Phase 'dq'"):
        sa.Phase(LAW, 1.0, dq=[0.0, 0.0])


def test_a_body_with_a_cm_of_two_numbers_is_refused():
    law = sa.JointPD(target=[0.3, 0.9], kp=1.0, kd=1.0)
    phase = sa.Phase(law, 0.1, sa.Grasp(mass=1.0, com=[0.1, 0.0]))
    with pytest.raises(sa.ConfigurationError, match="com of the body"):
        sa.simulate_phases(sa.load("planar2").at([0.3, 0.9]), [phase])


def carried():
    """A flight that grasps, moves and releases, pushed on the way, and begins with rates."""
    push = sa.Plant(wrenches={"spacecraft": [0.2, 0.1, 0, 0, 0, 0.3]})
    twist = np.array([0.05, -0.08, 0.0, 0.0, 0.0, 0.3])
    return sa.simulate_phases(
        ARM.at(Q0),
        dq=[0.1, -0.2],
        phases=[
            sa.Phase(LAW, 1.0, sa.Grasp(twist=twist, **BODY), plant=push),
            sa.Phase(LAW, 1.5, sa.Release(), plant=push),
            sa.Phase(LAW, 0.5),
        ],
    )


@pytest.mark.slow
def test_a_flight_as_one_motion():
    flight = carried()
    motion, (first, held, last) = flight, flight.phases
    assert isinstance(motion, sa.Trajectory)
    assert len(motion) == len(first) + len(held) - 1 + len(last) - 1
    assert (np.diff(motion.t) > 0.0).all()
    assert motion.t[-1] == pytest.approx(3.0)
    assert motion.events is flight.events
    assert np.abs(np.diff(motion.q, axis=0)).max() < 0.02
    for i, run, row in ((0, first, 0), (len(first), held, 1), (-1, last, -1)):
        assert motion[i].arm is run.arm
        for name in ("q", "dq", "tip", "com", "torque", "momentum", "energy", "sigma_min"):
            np.testing.assert_array_equal(getattr(motion, name)[i], getattr(run, name)[row])
        np.testing.assert_array_equal(motion[i].com, run[row].com)
    middle = motion.at(1.7)
    assert middle.arm is held.arm
    np.testing.assert_allclose(middle.com, held.at(0.7).com, atol=1e-12)
    np.testing.assert_allclose(motion.impulse[-1], first.impulse[-1] + held.impulse[-1], atol=1e-12)
    np.testing.assert_allclose(
        motion.other_work[-1], sum(r.other_work[-1] for r in flight.phases), atol=1e-12
    )
    assert motion.imbalance == max(run.imbalance for run in flight.phases)
    assert motion.drift < 1e-6
    pushed = motion.wrenches["spacecraft"]
    assert pushed.shape == (len(motion), 6)
    np.testing.assert_array_equal(np.unique(pushed[motion.t <= 2.5, 5]), [0.3])
    assert not pushed[motion.t > 2.5].any()
    assert motion.to_xarray().q.shape == motion.q.shape
    with pytest.raises(IndexError):
        motion[len(motion)]
    with pytest.raises(sa.UnsupportedError, match="save its phases"):
        motion.save("flight.npz")


@pytest.mark.parametrize("stop", [np.array([]), (), [], np.array(["target"])], ids=repr)
def test_events_that_end_a_phase_may_be_an_array(stop):
    flight = sa.simulate_phases(ARM.at(Q0), [sa.Phase(COAST, 0.1, stop=stop), sa.Phase(COAST, 0.1)])
    assert len(flight.phases) == (1 if len(stop) else 2)


def test_the_motors_of_a_flight_are_those_of_its_phases():
    """The largest torque of all, and the share of the whole time at the limit."""
    law, plant = sa.JointPD([0.6, 0.8], kp=200.0, kd=40.0), sa.Plant(limits=True)
    phases = [sa.Phase(law, duration, plant=plant) for duration in (0.2, 0.6)]
    flight = sa.simulate_phases(sa.load("planar2").at([0.3, 1.0]), phases)
    parts = [run.motors for run in flight.phases]
    assert [load.motor for load in flight.motors] == ["joint_1", "joint_2"]
    assert flight.motors[0].share > 0.0
    for load, first, second in zip(flight.motors, *parts, strict=True):
        assert load.largest == max(first.largest, second.largest)
        assert load.share == pytest.approx(0.25 * first.share + 0.75 * second.share)
