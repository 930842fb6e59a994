"""Controllers: each does what it is for, and each floating law beats its earth-bound version."""

import numpy as np
import pinocchio as pin
import pytest

import spacearm as sa

Q7 = np.array([0.3, 0.8, -0.4, 1.1, 0.2, 0.6, 0.1])


def chaser():
    return sa.load("chaser7", task="position")


def error(run, target):
    return np.linalg.norm(run.tip[:, :3] - [target(t) for t in run.t], axis=1)


# --- joints ---------------------------------------------------------------------------------


def test_joints_are_pulled_to_their_target_and_damped():
    cfg, dq = chaser().at(Q7), np.linspace(-0.3, 0.4, 7)
    law = sa.JointPD(target=Q7 + 0.1, kp=3.0, kd=np.arange(1.0, 8.0))
    wanted = 0.3 - np.arange(1.0, 8.0) * dq
    np.testing.assert_allclose(law(0.0, cfg, dq), wanted, rtol=0.0, atol=1e-14)


# --- resolved rates -------------------------------------------------------------------------


@pytest.mark.slow
def test_resolved_rate_keeps_the_tip_on_a_moving_target():
    arm = chaser()
    p, v = arm.at(Q7).tip.translation, np.array([0.01, -0.02, 0.015])
    law = sa.ResolvedRate(target=lambda t: p + v * t, gain=2.0, servo=50.0)
    run = sa.simulate(arm.at(Q7), law, 10.0, integration=sa.Integration(events=()))
    assert error(run, law.target)[-1] < 1e-5


@pytest.mark.slow
def test_the_earth_bound_law_lags_behind():
    arm = chaser()
    p, v = arm.at(Q7).tip.translation, np.array([0.01, -0.02, 0.015])
    misses = []
    for base in ("free-floating", "fixed"):
        law = sa.ResolvedRate(target=lambda t: p + v * t, gain=2.0, servo=50.0, mode=base)
        run = sa.simulate(arm.at(Q7), law, 10.0, integration=sa.Integration(events=()))
        misses.append(error(run, law.target)[-1])
    assert misses[1] > 100 * misses[0]


@pytest.mark.slow
def test_on_a_fixed_spacecraft_the_earth_bound_law_is_right():
    arm = chaser()
    goal = arm.at(Q7).tip.translation + np.array([0.05, 0.02, -0.03])
    law = sa.ResolvedRate(target=goal, gain=1.0, mode="fixed")
    run = sa.simulate(arm.at(Q7), law, 15.0, mode="fixed", integration=sa.Integration(events=()))
    assert error(run, lambda _: goal)[-1] < 1e-5


@pytest.mark.slow
def test_a_pose_is_reached():
    arm = sa.load("mda6")
    q = np.array([0.0, 1.0, -1.7, -0.9, 0.5, 0.0])
    cfg = arm.at(q)
    goal = pin.SE3(pin.exp3(np.array([0.1, -0.05, 0.08])), np.zeros(3)) * cfg.tip
    goal.translation = cfg.tip.translation + np.array([0.02, -0.03, 0.01])
    run = sa.simulate(
        arm.at(q), sa.ResolvedRate(target=goal), 15.0, integration=sa.Integration(events=())
    )
    np.testing.assert_allclose(run[-1].tip.homogeneous, goal.homogeneous, atol=1e-5)


@pytest.mark.slow
def test_the_null_space_tends_to_the_posture_of_rest():
    arm = chaser()
    goal = arm.at(Q7).tip.translation
    fine = sa.Integration(rtol=1e-10, atol=1e-12, events=())
    still = sa.simulate(arm.at(Q7), sa.ResolvedRate(target=goal), 5.0, integration=fine)
    moved = sa.simulate(
        arm.at(Q7),
        sa.ResolvedRate(target=goal, rest=Q7 * 0.5),
        5.0,
        integration=sa.Integration(events=()),
    )
    assert np.abs(still.q - Q7).max() < 1e-9
    away = []
    for i in (0, -1):
        J = sa.generalized_jacobian(moved[i])[:3]
        away.append(np.linalg.norm((np.eye(7) - np.linalg.pinv(J) @ J) @ (moved.q[i] - 0.5 * Q7)))
    assert away[1] < 0.02 * away[0]
    assert error(moved, lambda _: goal).max() < 5e-3


@pytest.mark.slow
def test_resolved_rate_ends_at_a_singularity_and_damping_goes_on():
    arm = sa.load("planar2")
    q = np.radians([-65.0, -11.41])
    q[1] = sa.singular_set(arm).roots(q, 1).angles[0]
    goal = arm.at(q).tip.translation[:2] + np.array([0.3, 0.4])
    with pytest.raises(sa.NoSolutionError, match=r"t = 0 s.*singular.*DampedLeastSquares"):
        sa.simulate(arm.at(q), sa.ResolvedRate(target=goal), 5.0)
    run = sa.simulate(arm.at(q), sa.DampedLeastSquares(target=goal), 20.0)
    assert run.events[0].kind == "singularity"
    assert run.events[0].t == 0.0
    assert np.abs(run.dq).max() < 10.0


def test_damping_begins_at_the_threshold():
    arm = sa.load("planar2")
    cfg = arm.at([0.4, 0.9])
    assert sa.singularity(cfg).sigma_min > 0.05
    goal = cfg.tip.translation[:2] + np.array([0.1, 0.1])
    exact = sa.ResolvedRate(target=goal).rates(0.0, cfg)
    free = sa.DampedLeastSquares(target=goal, threshold=0.05).rates(0.0, cfg)
    damped = sa.DampedLeastSquares(target=goal, threshold=10.0).rates(0.0, cfg)
    np.testing.assert_allclose(free, exact, atol=1e-12)
    assert np.linalg.norm(damped) < np.linalg.norm(exact)


# --- reactionless ---------------------------------------------------------------------------


@pytest.mark.slow
def test_reactionless_motion_does_not_turn_the_spacecraft():
    arm = chaser()
    goal = arm.at(Q7).tip.translation + np.array([0.05, 0.0, 0.03])
    run = sa.simulate(
        arm.at(Q7), sa.Reactionless(target=goal), 10.0, integration=sa.Integration(events=())
    )
    usual = sa.simulate(
        arm.at(Q7), sa.ResolvedRate(target=goal), 10.0, integration=sa.Integration(events=())
    )
    turned = [abs(np.linalg.norm(pin.log3(r[-1].base.rotation))) for r in (run, usual)]
    assert turned[0] < 1e-4
    assert turned[1] > 10 * turned[0]
    miss = error(run, lambda _: goal)
    assert miss[-1] < 0.5 * miss[0]


def test_reactionless_rates_are_in_the_null_space():
    arm = sa.load("planar3", task="x y")
    cfg = arm.at([0.3, 0.7, -0.5])
    dq = sa.Reactionless(target=(1.0, 1.0)).rates(0.0, cfg)
    assert np.linalg.norm(dq) > 0.01
    assert np.abs(sa.base_velocity(cfg, dq)[3:]).max() < 1e-12


def test_an_arm_that_always_turns_its_spacecraft_has_no_reactionless_motion():
    arm = sa.load("ets7", locked=dict.fromkeys(("joint_4", "joint_5", "joint_6"), 0.0))
    law = sa.Reactionless(target=(1.0, 0.0, 1.0))
    with pytest.raises(sa.UnsupportedError, match="rank 3"):
        law.rates(0.0, arm.at([0.3, 0.9, 0.4]))


# --- targets --------------------------------------------------------------------------------


def test_a_target_out_of_reach_is_refused():
    arm = sa.load("planar2")
    law = sa.TransposedJacobian(target=(3.0, 0.0), kp=5, kd=15)
    with pytest.raises(sa.ConfigurationError, match=r"2\.28723 m"):
        sa.simulate(arm.at([0.1, 0.2], base=pin.SE3(np.eye(3), np.array([-1.0, 0, 0]))), law, 1.0)
    sa.simulate(arm.at([0.1, 0.2], momentum=[9, 0, 0, 0, 0, 0]), law, 0.1)  # the CM goes there


@pytest.mark.slow
def test_what_the_task_leaves_open_is_never_out_of_reach():
    arm = sa.load("planar2")
    target = pin.SE3(np.eye(3), np.array([1.2, 0.5, 5.0]))
    run = sa.simulate(arm.at([0.3, 1.2]), sa.ResolvedRate(target=target), 10.0)
    np.testing.assert_allclose(run.tip[-1, :3], (1.2, 0.5, 0.0), atol=1e-3)


@pytest.mark.parametrize("target", [(1.0,), "there", (np.nan, 0.0)])
def test_bad_targets(target):
    law = sa.ResolvedRate(target=target)
    with pytest.raises(sa.ConfigurationError, match="2 finite numbers"):
        law.rates(0.0, sa.load("planar2").at([0.1, 0.2]))


def test_a_motion_that_ends_at_a_rate_is_tracked_to_its_end_but_for_rounding():
    """Else the last torque would stop the joints, at the rate of the law."""
    arm, q = sa.load("planar2"), np.array([[0.3, 1.2], [0.5, 1.0], [0.8, 0.9]])
    end = np.nextafter(2.0, 0.0)
    motion = sa.Motion(arm, [0.0, 1.0, end], q, np.tile(np.eye(7)[6], (3, 1)))
    law, rates = sa.Tracking(motion), motion.spline(end, 1)
    assert np.abs(rates).min() > 0.05
    np.testing.assert_allclose(law.wanted(2.0), law.wanted(end), atol=1e-12)
    np.testing.assert_array_equal(law.wanted(2.001)[1], np.zeros(2))
