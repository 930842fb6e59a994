"""Held targets simulated: closure, balances, forces at the grasps, and what squeezes."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.closed import debris, roomy, rough, several
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline

import spacearm as sa

COARSE = sa.Integration(dt=0.5, rtol=1e-9)


def law(held, size=1.0):
    """Smooth torques, different for every joint, that hardly move the heavy."""
    j, scale = np.arange(held.arm.n), size * sa.generalized_inertia(held.configuration).diagonal()
    return lambda t, _, dq: 0.02 * scale * np.sin((0.5 + 0.1 * j) * t) - 0.05 * scale * dq


def wrench_sum(run, held, i):
    """What all hands give the target about its CM (6,) in a row."""
    frame, com = pin.XYZQUATToSE3(run.target[i]), held.target.com
    total = np.zeros(6)
    for tip, w in run.grasps.items():
        lever = (frame * held.grasps[tip]).translation - frame.act(com)
        total += np.concatenate((w[i, :3], w[i, 3:] + np.cross(lever, w[i, :3])))
    return total


def test_forces_move_the_target_as_newton_says_and_all_balances_close():
    """The impulse of all hands is the change of the target's momentum, by quadrature of rows."""
    held, _ = roomy(1, tries=1)
    run = held.simulate(law(held), 2.0, integration=sa.Integration(dt=0.02))
    assert max(run.gap.max(), run.gap_angle.max()) < 1e-9
    assert run.drift < 1e-7
    assert run.imbalance < 1e-7

    frames = [pin.XYZQUATToSE3(row) for row in run.target]
    place = CubicSpline(run.t, [frame.act(held.target.com) for frame in frames])
    sums = np.array([wrench_sum(run, held, i) for i in range(len(run))])
    impulse = simpson(sums[:, :3], x=run.t, axis=0)
    gained = held.target.mass * (place(run.t[-1], 1) - place(0.0, 1))
    np.testing.assert_allclose(impulse, gained, atol=1e-4 * np.abs(sums).max())
    middle = len(run) // 2
    turns = [
        pin.log3(frames[middle].rotation.T @ f.rotation) for f in frames[middle - 2 : middle + 3]
    ]
    h = run.t[1] - run.t[0]
    w = (turns[0] - 8 * turns[1] + 8 * turns[3] - turns[4]) / (12 * h)
    dw = (-turns[0] + 16 * turns[1] - 30 * turns[2] + 16 * turns[3] - turns[4]) / (12 * h**2)
    I = held.target.inertia
    moment = frames[middle].rotation @ (I @ dw + np.cross(w, I @ w))
    np.testing.assert_allclose(sums[middle, 3:], moment, atol=1e-3 * np.abs(sums[:, 3:]).max())


@pytest.mark.slow
def test_what_squeezes_moves_nothing():
    """Other torques, the same motion, and the wrenches asked for between the hands."""
    held, _ = roomy(2)
    run, firm = (
        held.simulate(law(held), 2.0, squeeze=squeeze, integration=COARSE)
        for squeeze in (None, _squeeze(held, 30.0))
    )
    np.testing.assert_allclose(firm.q[-1], run.q[-1], atol=1e-8)
    assert np.abs(firm.torque - run.torque).max() > 0.1
    for i in range(len(run)):
        a, b = wrench_sum(run, held, i), wrench_sum(firm, held, i)
        size = np.abs(np.concatenate(list(firm.grasps.values()))).max()
        np.testing.assert_allclose(b, a, atol=1e-7 * size)
    slack = held.simulate(law(held), 2.0, squeeze=_squeeze(held, 0.0), integration=COARSE)
    least = sum(float((w**2).sum()) for w in slack.grasps.values())
    assert least <= sum(float((w**2).sum()) for w in firm.grasps.values())
    pushed = [firm.grasps[tip] - slack.grasps[tip] for tip in held.arm.tips]
    for i in range(len(firm)):
        R = pin.XYZQUATToSE3(firm.target[i]).rotation
        for tip, w in zip(held.arm.tips, pushed, strict=True):
            there = (w[i].reshape(2, 3) @ R).ravel()
            np.testing.assert_allclose(there, _squeeze(held, 30.0)[tip], atol=1e-6)


def _squeeze(held, force):
    """A force along the line between two grasps, axes of the target."""
    a, b = (held.grasps[tip].translation for tip in held.arm.tips)
    along = force * (b - a) / np.linalg.norm(b - a)
    left, right = held.arm.tips
    return {left: np.append(along, np.zeros(3)), right: np.append(-along, np.zeros(3))}


@pytest.mark.slow
def test_closure_stays_over_ten_minutes():
    held, _ = roomy(3)
    how = sa.Integration(dt=2.0, rtol=1e-6, atol=1e-8)  # closure is no matter of these
    run = held.simulate(law(held, 0.1), 600.0, integration=how)
    assert run.ended == "duration"
    assert max(run.gap.max(), run.gap_angle.max()) < 1e-9
    assert max(run.drift, run.imbalance) < 1e-5


@pytest.mark.slow
def test_a_path_that_is_followed_is_flown(tmp_path):
    """Computed torque leads the chain along its path, though that law knows no closure."""
    held, far = roomy(4)
    goal = held.target.pose * sa.pose((far, 0, 0))
    way = held.follow([goal], times=[2.0], limits=False)
    run = held.simulate(sa.Tracking(way), 2.5, integration=COARSE)
    end = held.after(run).target.pose
    np.testing.assert_allclose(end.actInv(goal).homogeneous, np.eye(4), atol=1e-6)
    begun = held.simulate(sa.Tracking(way), 0.5, dq=way.dq[0], integration=COARSE)
    np.testing.assert_allclose(begun.q[-1], run.q[1], atol=1e-8)
    run.save(tmp_path / "run.npz")
    again = sa.Motion.load(tmp_path / "run.npz", run.arm)
    for tip in held.arm.tips:
        np.testing.assert_array_equal(again.grasps[tip], run.grasps[tip])


@pytest.mark.slow
def test_a_path_with_momentum_on_board_is_flown():
    """What turns the spacecraft on the way is the same by rates as by forces, and stays."""
    held, far = roomy(4)
    total = held.arm.mass + held.target.mass
    momentum = np.concatenate((total * np.array([0.02, -0.01, 0.01]), [0.4, -0.3, 0.2]))
    held = replace(held, configuration=held.configuration.with_momentum(momentum))
    goal = held.target.pose * sa.pose((0.5 * far, 0, 0))
    way = held.follow([goal], times=[1.0], limits=False)
    assert way.arrived
    np.testing.assert_array_equal(way.momentum, np.tile(momentum, (len(way), 1)))
    frames = [pin.XYZQUATToSE3(row) for row in way.target]
    hands = [held.arm.at(cfg.q, base=cfg.base).com for cfg in way]
    both = np.array([
        (held.arm.mass * com + held.target.mass * frame.act(held.target.com)) / total
        for com, frame in zip(hands, frames, strict=True)
    ])  # fmt: skip
    drift = both[0] + np.outer(way.t, momentum[:3] / total)
    np.testing.assert_allclose(both, drift, atol=1e-8)
    run = held.simulate(sa.Tracking(way), 1.0, dq=way.dq[0], integration=COARSE)
    np.testing.assert_allclose(run.momentum[-1], momentum, atol=1e-6 * np.abs(momentum).max())
    end = held.after(run).target.pose
    np.testing.assert_allclose(end.actInv(goal).homogeneous, np.eye(4), atol=1e-5)


def test_a_grasp_that_bears_too_little_ends_it():
    held, _ = roomy(1, tries=1)
    how = sa.Integration(dt=0.1)
    free = held.simulate(law(held), 1.0, integration=how)
    forces = {tip: np.linalg.norm(w[:, :3], axis=1) for tip, w in free.grasps.items()}
    most = 0.5 * max(f.max() for f in forces.values())
    run = held.simulate(law(held), 1.0, bears=(most, np.inf), integration=how)
    assert run.ended == "grasp"
    event = run.events[-1]
    assert event.kind == "grasp"
    assert run.t[-1] == event.t
    tip = event.detail.split(":")[0]
    np.testing.assert_allclose(np.linalg.norm(run.grasps[tip][-1, :3]), most, rtol=1e-4, atol=0)
    first = held.simulate(law(held), 1.0, bears={tip: (most, np.inf)}, integration=how)
    np.testing.assert_allclose(first.t[-1], run.t[-1], atol=1e-9)
    (other,) = set(held.arm.tips) - {tip}
    free = held.simulate(law(held), run.t[-1], bears={other: (most, np.inf)}, integration=how)
    assert free.ended == "duration"
    with pytest.raises(sa.ConfigurationError, match="bears: unknown tip 'hand'"):
        held.simulate(law(held), 1.0, bears={"hand": (1.0, 1.0)})
    table = run.describe().tables[-1]
    assert table.title == "What the grasps bear"
    assert len(table.rows) == 2


def flown_in_drake(held, law, duration, step, path):
    """Joints and pose of the target in the end, and the gap of the weld that closes the loop."""
    module = pytest.importorskip("pydrake.multibody.plant")
    from pydrake.math import RigidTransform
    from pydrake.multibody.parsing import Parser
    from pydrake.systems.analysis import Simulator

    carrying = held.carrying
    arm, grasp = carrying.arm, held.grasps[held.arm.tips[1]].homogeneous
    plant = module.MultibodyPlant(time_step=step)
    Parser(plant).AddModels(str(arm.to_urdf(path)))
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    plant.set_discrete_contact_approximation(module.DiscreteContactApproximation.kSap)
    target, hand = (plant.GetBodyByName(name) for name in (carrying.link, arm.tips[1]))
    plant.AddWeldConstraint(target, RigidTransform(grasp), hand, RigidTransform())
    plant.Finalize()
    joints = [plant.GetJointByName(name) for name in arm.joint_names]
    q, v = [j.position_start() for j in joints], [j.velocity_start() for j in joints]
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    positions = plant.GetPositions(context)
    positions[q] = held.q
    plant.SetPositions(context, positions)
    (bus,) = (plant.get_body(i) for i in plant.GetFloatingBaseBodies())
    plant.SetFreeBodyPose(context, bus, RigidTransform(held.configuration.base.homogeneous))
    for k in range(round(duration / step)):
        forces = np.zeros(plant.num_velocities())
        forces[v] = law(k * step, None, plant.GetVelocities(context)[v])
        plant.get_applied_generalized_force_input_port().FixValue(context, forces)
        simulator.AdvanceTo((k + 1) * step)
    frame, tip = (body.EvalPoseInWorld(context).GetAsMatrix4() for body in (target, hand))
    gap = np.linalg.norm((frame @ grasp)[:3, 3] - tip[:3, 3])
    return plant.GetPositions(context)[q].copy(), frame, gap


def test_drake_moves_the_loop_alike(tmp_path):
    """Its steps are of first order: the difference halves with them, and what is left vanishes."""
    held, _ = roomy(1, tries=1)
    strong = law(held, 10.0)
    steps, path = (2e-3, 1e-3), tmp_path / "held.urdf"
    ends = [flown_in_drake(held, strong, 1.0, step, path) for step in steps]
    run = held.simulate(strong, 1.0, integration=sa.Integration(dt=0.25))
    moved = np.abs(run.q[-1] - held.q).max()
    coarse, fine = (q - run.q[-1] for q, *_ in ends)
    assert np.abs(fine).max() < 0.6 * np.abs(coarse).max() < 1e-2 * moved
    np.testing.assert_allclose(2.0 * fine - coarse, 0.0, atol=1e-4 * moved)
    place = pin.XYZQUATToSE3(run.target[-1]).homogeneous
    np.testing.assert_allclose(2.0 * ends[1][1] - ends[0][1], place, atol=1e-4 * moved)
    assert run.gap.max() < 1e-3 * ends[1][-1]


@pytest.mark.slow
def test_motors_give_no_more_than_they_can_and_joints_are_damped():
    """As by a law that gives the same torques by itself; what is reached is said."""
    held, _ = roomy(1, tries=1)
    arm, how = held.arm, sa.Integration(dt=0.05)
    wanted = law(held, 40.0)
    efforts = 0.2 * np.abs(wanted(0.5, held.configuration, np.zeros(arm.n))).max() * np.ones(arm.n)
    joints = {
        name: replace(arm.whole.joints[name], effort=float(most), velocity=1e3)
        for name, most in zip(arm.joint_names, efforts, strict=True)
    }
    weak = arm.on(replace(arm.whole, joints={**arm.whole.joints, **joints}))
    there = weak.at(held.q, base=held.configuration.base)
    held = sa.hold(there, held.target, held.grasps, limits=False)
    damping = 1e-3 * np.abs(efforts)
    plant = sa.Plant(
        limits=True,
        passive={
            n: sa.PassiveJoint(damping=d) for n, d in zip(arm.joint_names, damping, strict=True)
        },
    )
    run = held.simulate(wanted, 0.5, plant=plant, integration=how)
    assert (np.abs(run.torque) <= efforts).all()
    assert run.overloaded
    assert any("is reached by" in note for note in run.describe().notes)
    assert run.other_work[-1] < 0.0

    def by_itself(t, cfg, dq):
        return np.clip(wanted(t, cfg, dq), -efforts, efforts) - damping * dq

    same = held.simulate(by_itself, 0.5, integration=how)
    np.testing.assert_allclose(run.q, same.q, atol=1e-8)
    np.testing.assert_allclose(run.work + run.other_work, same.work, atol=1e-6 * same.turnover)
    tips = held.arm.tips
    none = {tip: np.zeros(6) for tip in tips}
    cut = held.simulate(wanted, 0.1, squeeze=none, plant=plant, integration=how)
    assert (np.abs(cut.torque) <= efforts).all()
    with pytest.raises(sa.UnsupportedError, match="wrenches on bus are not simulated"):
        held.simulate(wanted, 0.1, plant=sa.Plant(wrenches={"bus": np.ones(6)}))


def test_what_needs_a_control_period_is_refused():
    held, _ = roomy(2)
    integral = sa.JointPD(np.zeros(held.arm.n), kp=1.0, kd=1.0, ki=1.0)
    sampled = sa.WheelHold(stiffness=1.0, damping=1.0, sampled=True)
    with pytest.raises(sa.UnsupportedError, match="JointPD has a memory"):
        held.simulate(integral, 0.1)
    for plant in (sa.Plant(wheels=sampled), sa.Plant(wheel_friction=0.1)):
        with pytest.raises(sa.UnsupportedError, match="leave sampled and wheel_friction out"):
            held.simulate(law(held), 0.1, plant=plant)


@pytest.mark.slow
def test_wheels_hold_the_attitude_while_arms_hold_a_target():
    """The wheels take up what the arms and the target would give the spacecraft."""
    rng = np.random.default_rng(11)
    start, _, grasps = rough(several(rng, (6, 6), wheels=True), rng, off=0.05)
    target = debris(rng, 5.0, start.tips[0] * grasps["t0"].inverse())
    held = sa.hold(start, target, grasps, limits=False)
    D = float(np.linalg.norm(sa.momentum_matrix(held.configuration).A_b[3:, 3:], 2))
    plant = sa.Plant(wheels=sa.WheelHold(stiffness=9.0 * D, damping=6.0 * D))
    how = sa.Integration(dt=0.1)
    run, free = (
        held.simulate(law(held), 2.0, plant=one, integration=how) for one in (plant, sa.Plant())
    )
    turned = [
        np.linalg.norm(pin.log3((pin.XYZQUATToSE3(r.base[0]).inverse() * cfg.base).rotation))
        for r in (run, free) for cfg in (r[-1],)
    ]  # fmt: skip
    assert turned[0] < 0.3 * turned[1]
    assert np.abs(run.wheels[-1]).max() > 0.0
    taken_up = CubicSpline(run.t, run.wheel_torque).antiderivative()(run.t)
    np.testing.assert_allclose(run.wheels, taken_up, atol=1e-3 * np.abs(run.wheels).max())
    assert max(run.drift, run.imbalance, run.gap.max()) < 1e-7
    np.testing.assert_allclose(run.momentum, 0.0, atol=1e-6 * np.abs(run.wheels).max())
    least = 0.5 * np.abs(run.wheels).max()
    small = replace(plant, wheels=replace(plant.wheels, capacity=least))
    full = held.simulate(law(held), 2.0, plant=small, integration=how)
    assert [event.kind for event in full.events] == ["wheel full"]
    assert full.ended == "duration"
    assert np.abs(full.wheels).max() < 1.01 * least


def test_what_makes_no_sense_is_told():
    held, _ = roomy(1, tries=1)
    left, right = held.arm.tips
    with pytest.raises(sa.ConfigurationError, match="opens the grasps"):
        held.simulate(law(held), 1.0, dq=np.ones(held.arm.n))
    with pytest.raises(sa.ConfigurationError, match="does not balance"):
        held.simulate(law(held), 1.0, squeeze={left: [1, 0, 0, 0, 0, 0], right: np.zeros(6)})
    with pytest.raises(sa.ConfigurationError, match=f"for each tip: {left}, {right}"):
        held.simulate(law(held), 1.0, squeeze={left: np.zeros(6)})
    with pytest.raises(sa.ConfigurationError, match="bears is"):
        held.simulate(law(held), 1.0, bears=(1.0, 0.0))
    squeeze = _squeeze(held, 9.0)
    with pytest.raises(sa.ConfigurationError, match="more than that is borne at the start"):
        held.simulate(law(held), 1.0, squeeze=squeeze, bears=(1.0, 1.0))
    with pytest.raises(sa.ConfigurationError, match="dt is"):
        held.simulate(law(held), 1.0, integration=sa.Integration(dt=2.0))
