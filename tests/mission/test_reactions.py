"""Reactions and wheels: identities of momentum, symmetric arms, the torque of inverse dynamics."""

import re

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import chains, frame, joint, link, load_text, robot, with_wheels
from hypothesis import given, settings
from scipy.integrate import trapezoid

import spacearm as sa
from spacearm.model.wheels import WheelLoad, held_about_any_axis


def swing(arm, seed=0, m=400, duration=4.0, mode="free-floating", base=None):
    """A smooth joint motion from rest to rest, the spacecraft moved by `sa.move`."""
    rng = np.random.default_rng(seed)
    start, span = rng.uniform(-0.5, 0.5, arm.n), rng.uniform(-1.0, 1.0, arm.n)
    t = np.linspace(0.0, duration, m)
    u = t / duration
    q = start + np.outer(u**3 * (10 - 15 * u + 6 * u * u), span)
    cfg = arm.at(q[0], base=base)
    poses = []
    for row in q:
        cfg = sa.move(cfg, row) if mode == "free-floating" else arm.at(row, base=cfg.base)
        poses.append(pin.SE3ToXYZQUAT(cfg.base))
    return sa.Motion(arm, t, q, np.array(poses), mode=mode)


@given(chains())
@settings(max_examples=15)
def test_the_momentum_is_that_of_the_arm_with_its_attitude_held(cfg):
    """D_q dq is the angular momentum of Pinocchio with a spacecraft that only translates."""
    arm = cfg.arm
    run = swing(arm, m=5, mode="attitude-controlled", base=cfg.base)
    found = sa.reaction(run)
    for i, there in enumerate(run):
        v = sa.base_velocity(there, run.dq[i])
        A_b, A_q = sa.momentum_matrix(there)
        v_b = np.zeros(6)  # linear momentum zero, angular velocity zero
        v_b[:3] = -(A_q[:3] @ run.dq[i]) / arm.mass
        h = (A_b @ v_b + A_q @ run.dq[i])[3:]
        np.testing.assert_allclose(
            found.momentum[i], there.base.rotation.T @ h, atol=1e-9 * (1 + abs(h).max())
        )
        # floating, the spacecraft has the rate that makes up for it: D w_0 = -D_q dq
        D_w = A_b[3:, 3:] @ v[3:]
        np.testing.assert_allclose(D_w, -h, atol=1e-9 * (1 + abs(h).max()))


def test_the_torque_is_the_reaction_of_inverse_dynamics():
    arm = sa.load("mda6")
    run = swing(arm, m=2001, mode="attitude-controlled")
    found = sa.reaction(run)
    h = run.t[1] - run.t[0]
    for i in (400, 900, 1500):
        ddq = (run.q[i + 1] - 2 * run.q[i] + run.q[i - 1]) / h**2
        dq = (run.q[i + 1] - run.q[i - 1]) / (2 * h)
        reaction = sa.inverse_dynamics(run[i], dq, ddq, mode="attitude-controlled").reaction
        np.testing.assert_allclose(reaction[:3], 0.0, atol=1e-9)
        np.testing.assert_allclose(
            found.torque[i], reaction[3:], atol=1e-4 * abs(found.torque).max()
        )


def test_the_integral_of_the_torque_is_the_momentum():
    found = sa.reaction(swing(sa.load("mda6"), m=1000))
    np.testing.assert_allclose(
        trapezoid(found.torque, found.t, axis=0), found.momentum[-1] - found.momentum[0],
        atol=1e-4 * abs(found.momentum).max(),
    )  # fmt: skip
    assert (found.impulse >= np.abs(found.momentum).max(axis=0) - 1e-12).all()
    np.testing.assert_allclose(found.wheels, -found.momentum, atol=1e-12)


def test_a_plan_begins_and_ends_without_momentum_and_torque():
    arm = sa.load("planar2")
    plan = sa.plan(arm.at([0.3, 1.2]), (1.5, 1.5))
    found = sa.reaction(plan)
    for values in (plan.dq, plan.ddq, found.momentum, found.torque, found.rate):
        np.testing.assert_array_equal(values[[0, -1]], 0.0)
    most = np.abs(found.momentum).max()
    assert most > 0.1
    np.testing.assert_allclose(trapezoid(found.torque, found.t, axis=0), 0.0, atol=0.02 * most)
    moved = plan.q[-1] - plan.q[0]
    np.testing.assert_allclose(trapezoid(plan.dq, plan.t, axis=0), moved, atol=0.01)
    rates = np.array([arm.tree.joints[name].velocity for name in arm.joint_names])
    assert np.abs(plan.dq).max() <= np.where(np.isfinite(rates), rates, 0.5).max() * 1.001


def test_the_excursion_is_the_same_whether_the_motion_floated_or_was_held():
    arm = sa.load("chaser7")
    floating, held = (
        sa.reaction(swing(arm, m=60, mode=mode)) for mode in ("free-floating", "fixed")
    )
    np.testing.assert_allclose(floating.excursion, held.excursion, atol=1e-7)
    np.testing.assert_allclose(floating.momentum, held.momentum, atol=1e-9)
    np.testing.assert_allclose(floating.rate, held.rate, atol=1e-7)


def test_the_rate_is_the_derivative_of_the_excursion():
    found = sa.reaction(swing(sa.load("planar2"), m=1000))
    z = found.excursion[:, 2]
    np.testing.assert_allclose(np.gradient(z, found.t), found.rate[:, 2], atol=1e-5)


def test_two_arms_that_mirror_each_other_do_not_turn_the_spacecraft():
    def arm_on(side):
        x = 0.5 * side
        return (
            link(f"arm{side}", 2.0, com=(0.4 * side, 0, 0)),
            joint(f"j{side}", "bus", f"arm{side}", xyz=(x, 0, 0)),
            frame(f"hand{side}"),
            joint(f"t{side}", f"arm{side}", f"hand{side}", "fixed", xyz=(0.8 * side, 0, 0)),
        )

    text = robot(link("bus", 50.0), *arm_on(1), *arm_on(-1))
    arm = load_text(text, tip="hand1", joints="all")
    t = np.linspace(0.0, 1.0, 50)
    both = np.outer(t**2, [1.0, -1.0])
    run = sa.Motion(arm, t, both, np.tile(np.eye(7)[6], (50, 1)), mode="attitude-controlled")
    found = sa.reaction(run)
    np.testing.assert_allclose(found.momentum, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.excursion, 0.0, atol=1e-12)
    alone = sa.reaction(sa.Motion(arm, t, both * [1, 0], run.base, mode="attitude-controlled"))
    assert alone.angle[-1] > 0.01


def test_reactionless_joint_rates_take_no_wheels():
    arm = sa.load("planar3")
    q, t = np.array([0.4, 0.8, -0.5]), np.linspace(0.0, 1.0, 200)
    rows = [q]
    for _ in t[1:]:  # along the null space of D_q, midpoint rule
        step = rows[-1]
        for _ in range(4):
            middle = 0.5 * (rows[-1] + step)
            D_q = sa.momentum_matrix(arm.at(middle)).A_q[5:]
            null = np.linalg.svd(D_q)[2][1]
            null = null * np.sign(null[np.argmax(np.abs(null))])
            step = rows[-1] + (t[1] - t[0]) * null
        rows.append(step)
    run = sa.Motion(arm, t, np.array(rows), np.tile(np.eye(7)[6], (200, 1)), mode="fixed")
    found = sa.reaction(run)
    assert np.abs(run.q[-1] - q).max() > 0.2
    assert found.angle.max() < 1e-4
    inside = np.abs(found.momentum[1:-1])  # the rates at the ends are one-sided differences
    assert inside.max() < 1e-4 * np.abs(sa.reaction(swing(arm)).momentum).max()


def test_the_camera_sees_only_turns_across_its_line_of_sight():
    run = swing(sa.load("planar2"))
    along = sa.reaction(run, camera=(0, 0, 2.0))
    across = sa.reaction(run, camera=(1.0, 1.0, 0.0))
    np.testing.assert_allclose(along.pointing, 0.0, atol=1e-12)
    np.testing.assert_allclose(along.smear, 0.0, atol=1e-12)
    np.testing.assert_allclose(across.pointing, across.angle, atol=1e-12)
    np.testing.assert_allclose(across.smear, np.abs(across.rate[:, 2]), atol=1e-12)
    assert along.to_dict()["largest_angle"] == pytest.approx(float(across.angle.max()))


def test_momentum_on_board_is_taken_up_by_the_wheels():
    arm = sa.load("planar2")
    h = np.array([0, 0, 0, 0, 0, 0.4])
    law = sa.JointPD(target=[0.5, 0.9], kp=5.0, kd=9.0)
    run = sa.simulate(
        arm.at([0.3, 1.2], momentum=h), law, 2.0, integration=sa.Integration(events=())
    )
    found = sa.reaction(run)
    np.testing.assert_allclose(found.on_board, np.tile(h[3:], (len(run), 1)), atol=1e-9)
    np.testing.assert_allclose(
        found.wheels + found.momentum, np.tile(h[3:], (len(run), 1)), atol=1e-9
    )
    z = found.excursion[:, 2]
    np.testing.assert_allclose(np.trapezoid(found.rate[:, 2], found.t), z[-1], atol=2e-3)


def controlled_run():
    """A simulation in which a wheel controls the attitude within its limits."""
    arm = load_text(with_wheels("planar2", [0, 0, 1], torque=20.0, rate=1e4))
    plant = sa.Plant(wheels=sa.WheelHold(stiffness=400.0, damping=200.0, torque=20.0))
    law = sa.JointPD(target=[0.9, 0.4], kp=5.0, kd=9.0)
    return sa.simulate(
        arm.at([0.3, 1.2]), law, 4.0, plant=plant, integration=sa.Integration(dt=0.02, events=())
    )


def test_a_run_that_wheels_controlled_is_told_from_the_free_floating_case():
    """The same joint motion gives the same figures wherever it comes from."""
    run = controlled_run()
    found = sa.reaction(run)
    rows = np.array([pin.SE3ToXYZQUAT(run[0].base)] * len(run))
    alone = sa.reaction(sa.Motion(run.arm, run.t, run.q, rows, mode="attitude-controlled"))
    np.testing.assert_allclose(found.excursion, alone.excursion, atol=1e-4)
    np.testing.assert_allclose(found.momentum[5:-5], alone.momentum[5:-5], atol=0.05)
    moved = run[0]
    for q in run.q[1:]:
        moved = sa.move(moved, q)
    turned = pin.log3(run[0].base.rotation.T @ moved.base.rotation)
    np.testing.assert_allclose(found.excursion[-1], turned, atol=1e-4)
    assert found.angle.max() > 10.0 * found.simulated_angle.max() > 0.0
    for i, cfg in enumerate(run):
        angle = np.linalg.norm(pin.log3(run[0].base.rotation.T @ cfg.base.rotation))
        assert found.simulated_angle[i] == pytest.approx(angle, abs=1e-12)
    np.testing.assert_array_equal(found.wheel_momentum, run.wheels)
    verdict = found.describe().verdict
    for angle in (found.angle, found.simulated_angle):
        assert f"{np.degrees(angle.max()):.4g}°" in verdict
    assert not alone.wheel_torque.size


def test_a_flight_on_which_a_body_is_grasped_has_no_free_floating_motion_to_compare_with():
    """The momentum and the arm of its start do not hold afterwards; those of each phase do."""
    arm = load_text(with_wheels("planar2", np.eye(3)))
    law, how = sa.JointPD([0.4, 1.1], kp=5.0, kd=9.0), sa.Integration(dt=0.02)
    body = sa.Grasp(mass=20.0, inertia=np.eye(3), twist=[0, 0, 0, 0, 0, 0.1])
    hold = sa.Plant(wheels=sa.WheelHold(stiffness=20.0, damping=40.0))
    phases = [sa.Phase(law, 0.1, then, plant=hold, integration=how) for then in (body, None)]
    flight = sa.simulate_phases(arm.at([0.3, 1.0]), phases)
    with pytest.raises(sa.UnsupportedError, match=r"flight\.phases"):
        sa.reaction(flight)
    assert sa.reaction(flight.phases[1]).wheel_torque.any()


def test_the_loads_of_a_run_that_wheels_controlled_are_those_recorded():
    arm = load_text(with_wheels("planar2", [0, 0, 1], torque=20.0, rate=1e4))
    hold = sa.WheelHold(stiffness=400.0, damping=200.0, torque=0.3, capacity=0.2)
    law = sa.JointPD(target=[0.9, 0.4], kp=5.0, kd=9.0)
    run = sa.simulate(arm.at([0.3, 1.2]), law, 3.0, plant=sa.Plant(wheels=hold))
    found = sa.reaction(run)
    (motor,) = found.motors
    assert (motor.largest, motor.limit, motor.enforced) == (pytest.approx(0.3), 0.3, True)
    assert 0.0 < motor.share < 1.0
    assert found.full == (arm.wheels[0].name,)
    assert np.abs(found.wheel_momentum).max() == pytest.approx(0.2, abs=1e-6)
    assert np.abs(found.torque).max() > 1.0  # an ideal control would need more than they gave


# --- wheels ---------------------------------------------------------------------------------


def test_no_direction_of_the_tip_takes_more_than_the_worst():
    arm = sa.load("mda6")
    found = sa.size_wheels(arm, tip_speed=0.2, samples=40)
    assert len(found.momentum) == round(40 * (1.0 - found.left_out))
    rng = np.random.default_rng(0)
    for i in range(0, len(found.q), 7):
        cfg = arm.at(found.q[i])
        J = sa.generalized_jacobian(cfg, mode="attitude-controlled")
        tried = []
        for _ in range(300):
            v = rng.normal(size=3)
            dq = np.linalg.solve(J, np.append(0.2 * v / np.linalg.norm(v), np.zeros(3)))
            tried.append(sa.momentum_matrix(cfg).A_q[3:] @ dq)
        sizes = np.linalg.norm(tried, axis=1)
        assert 0.9 * found.momentum[i] < sizes.max() <= found.momentum[i] * (1 + 1e-12)
        assert (np.abs(tried).max(axis=0) <= found.axes[i] * (1 + 1e-12)).all()


def test_wheels_grow_with_the_speed_and_cover_their_share():
    arm = sa.load("planar2")
    one, two = (sa.size_wheels(arm, tip_speed=v, samples=300) for v in (0.1, 0.2))
    np.testing.assert_allclose(two.momentum, 2.0 * one.momentum, atol=1e-12)
    each, any_axis = one.covering(90)
    assert np.mean(one.momentum <= any_axis) == pytest.approx(0.9, abs=0.01)
    assert each[2] == pytest.approx(any_axis)
    np.testing.assert_allclose(one.axes[:, :2], 0.0, atol=1e-12)
    assert one.momentum[one.worst] == one.momentum.max()
    near = sa.size_wheels(arm, tip_speed=0.1, samples=300, near=np.radians(1.0))
    assert near.left_out < one.left_out
    assert near.momentum.max() > one.momentum.max()


def test_wheels_of_motions_are_the_worst_of_each():
    arm = sa.load("planar2")
    runs = [swing(arm, seed) for seed in (1, 2)]
    found = sa.size_wheels(arm, runs)
    for i, run in enumerate(runs):
        alone = sa.reaction(run)
        assert found.momentum[i] == pytest.approx(np.abs(alone.wheels).max())
        np.testing.assert_allclose(found.torque[i], np.abs(alone.torque).max(axis=0), atol=1e-12)
    assert sa.size_wheels(arm, runs[0]).momentum == found.momentum[:1]


def test_bad_input():
    arm, other = sa.load("planar2"), sa.load("planar3")
    still = sa.Motion(arm, [0.0], [[0.1, 0.2]], np.eye(7)[6:])
    with pytest.raises(sa.ConfigurationError, match="one sample only"):
        sa.reaction(still)
    with pytest.raises(sa.ConfigurationError, match="camera is zero"):
        sa.reaction(swing(arm, m=3), camera=[0, 0, 0])
    with pytest.raises(sa.ConfigurationError, match="one of them"):
        sa.size_wheels(arm)
    with pytest.raises(sa.ConfigurationError, match="tip_speed is -1"):
        sa.size_wheels(arm, tip_speed=-1)
    with pytest.raises(sa.ConfigurationError, match="other joints"):
        sa.size_wheels(other, swing(arm, m=3))
    with pytest.raises(sa.ConfigurationError, match="motions is empty"):
        sa.size_wheels(arm, [])
    for near in (1e308, -1, np.nan, "a"):
        with pytest.raises(sa.ConfigurationError, match="near is "):
            sa.size_wheels(arm, tip_speed=0.1, samples=20, near=near)
    with pytest.raises(sa.NoSolutionError, match="all 20 postures"):
        sa.size_wheels(arm.replace(task="x y rz"), tip_speed=0.1, samples=20)


def test_the_torque_of_a_simulation_does_not_depend_on_its_rows():
    """A spacecraft held still: few rows give the torque that many do, the start's kick too."""
    arm = sa.load("planar2")
    law = sa.JointPD(target=[0.9, 1.4], kp=5.0, kd=9.0)
    start = arm.at([0.3, 1.2])
    few, many = (
        sa.simulate(start, law, 2.0, integration=sa.Integration(dt=dt, rtol=1e-10))
        for dt in (0.5, 0.01)
    )
    coarse, fine = sa.reaction(few), sa.reaction(many)
    np.testing.assert_allclose(
        coarse.torque, fine.torque[::50], atol=1e-6 * np.abs(fine.torque).max()
    )
    kick = sa.forward_dynamics(start, np.zeros(2), law(0.0, start, np.zeros(2))).ddq
    held = sa.inverse_dynamics(start, np.zeros(2), kick, mode="attitude-controlled")
    np.testing.assert_allclose(coarse.torque[0], held.reaction[3:], rtol=1e-9, atol=1e-9)


def wheeled(torque, rate):
    """A planar arm with a wheel about z of 0.01 kg m^2."""
    return load_text(with_wheels("planar2", [0, 0, 1], torque=torque, rate=rate))


def test_wheels_are_compared_with_what_a_motion_takes():
    weak, strong = wheeled(1e-3, 0.1), wheeled(1e3, 1e6)
    for arm, enough in ((weak, False), (strong, True)):
        found = sa.reaction(swing(arm, m=50))
        (wheel,) = arm.wheels
        most = np.abs(found.wheels[:, 2]).max(), np.abs(found.torque[:, 2]).max()
        np.testing.assert_allclose((found.load.momentum[0], found.load.torque[0]), most, atol=1e-12)
        assert found.load.across < 1e-9
        times = f"{most[0] / wheel.capacity:.3g} times its limit of {wheel.capacity:.4g} N m s"
        assert enough == (not found.load.exceeded)
        assert enough == (times not in " ".join(found.describe().notes))
        assert found.to_dict()["exceeded"] == found.load.exceeded
    assert (weak.wheels[0].torque, weak.wheels[0].capacity) == (1e-3, pytest.approx(1e-3))


@pytest.mark.parametrize(("torque", "rate"), [(1e-3, 1e6), (1e3, 0.1)])
def test_the_pace_that_wheels_allow(torque, rate):
    """Momentum falls with the speed, torque with its square: one of both is then at its limit."""
    arm = wheeled(torque, rate)
    found = sa.reaction(swing(arm, m=50))
    slow = sa.reaction(swing(arm, m=50, duration=4.0 * found.load.slower)).load
    share = slow.momentum[0] / arm.wheels[0].capacity, slow.torque[0] / arm.wheels[0].torque
    assert max(share) == pytest.approx(1.0, rel=1e-6)
    (lasts,) = re.findall(r"at least (\d+) s", " ".join(found.describe().notes))
    assert float(lasts) == np.ceil(4.0 * found.load.slower)


def test_wheels_hold_so_much_about_any_axis_that_one_of_them_is_full_about_the_worst():
    axes = np.random.default_rng(5).normal(size=(4, 3))
    arm = load_text(with_wheels("planar2", axes, rate=50.0))
    most = held_about_any_axis(arm.model, arm.wheels)
    worst = np.linalg.pinv((axes / np.linalg.norm(axes, axis=1)[:, None]).T)
    worst = worst / np.linalg.norm(worst, axis=1)[:, None]
    fullest = [WheelLoad.of(arm.model, arm.wheels, most * u[None], 0 * u[None]) for u in worst]
    assert max(load.momentum.max() for load in fullest) == pytest.approx(0.5, rel=1e-9)
    for u in np.random.default_rng(6).normal(size=(50, 3)):
        held = most * u[None] / np.linalg.norm(u)
        assert not WheelLoad.of(arm.model, arm.wheels, held, 0 * held).exceeded
    need = sa.size_wheels(arm, tip_speed=0.1, samples=9)
    share = f"{np.mean(need.momentum <= most):.0%} of the postures"
    assert any(note.endswith(share) for note in need.describe().notes)


def test_a_load_across_all_axes_is_said():
    arm = load_text(with_wheels("planar2", [1, 0, 0]))
    found = sa.reaction(swing(arm, m=20))
    assert found.load.slower == np.inf
    assert found.load.across == pytest.approx(1.0)
    assert "across the axes of all wheels" in " ".join(found.describe().notes)


def test_a_path_that_ends_singular_has_no_bound_on_its_loads():
    arm = sa.load("planar2")
    start = arm.at([0.3, 1.2])
    way = sa.follow(start, [(6.0, 1.0)], limits=False)
    assert way.ended == "singularity"
    found = sa.reaction(way)
    said = found.describe()
    assert "no bound" in said.verdict
    assert found.to_dict()["largest_wheels"] is None
    assert "N m s and" not in said.verdict
    held = sa.follow(start, [(6.0, 1.0)], limits=False, mode="attitude-controlled")
    assert any("no bound" in note for note in held.describe().notes)


def test_a_held_motion_says_what_holding_it_takes():
    """In the plane of the arm the momentum is that of the links about the system CM."""
    arm = wheeled(1e-3, 0.1)
    run = swing(arm, m=400, mode="attitude-controlled")
    notes = " ".join(run.describe().notes)
    found = sa.reaction(run)
    assert f"{np.abs(found.wheels).max():.4g} N m s" in notes
    assert "times its limit of 0.001 N m s" in notes


def test_a_plan_of_a_floating_spacecraft_says_what_holding_it_would_take():
    """In the time that it names the wheels can hold it, and not in a second less."""
    plan = sa.plan(wheeled(0.5, 30.0).at([0.3, 1.2]), (0.9, 1.4))
    (said,) = (note for note in plan.describe().notes if "attitude control" in note)
    found = sa.reaction(plan)
    moved, torque = (np.abs(x).max() for x in (found.wheels, found.torque))
    assert f"{moved:.4g} N m s and {torque:.4g} N m" in said
    lasts = float(re.search(r"at least (\d+) s", said)[1])
    (wheel,) = plan.arm.wheels
    for t, enough in ((lasts, True), (lasts - 1.0, False)):
        slower = plan.t[-1] / t
        within = moved * slower <= wheel.capacity and torque * slower**2 <= wheel.torque
        assert within == enough
