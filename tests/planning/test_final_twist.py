"""Plans that end with a twist of the tip, by Pinocchio at the end of an independent replay."""

import json

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, planar_pair, random_chain
from helpers.commands import spacearm
from helpers.replay import replay

import spacearm as sa

PLANAR, PAIR = [0.3, 1.2], [2.2, 0.9, 0.6, -0.9]
MDA = np.radians([0, 60, -100, -50, 30, 0])
TWIST = [0.01, 0.02, -0.01, 0.01, 0.02, 0.005]


def tip_twists(plan):
    """The twists (6,) of the tips at the end, by the momentum of Pinocchio's whole model."""
    arm, dq = plan.arm, plan.spline(plan.t[-1], 1)
    cfg, data = replay(plan)[0], plan.arm.model.createData()
    q, v = cfg.full, np.concatenate((np.zeros(6), arm.all_rates(dq)))
    A = np.array(pin.computeCentroidalMap(arm.model, data, q))
    v[:6] = np.linalg.solve(A[:, :6], plan.momentum[-1] - cfg.stored - A @ v)
    pin.forwardKinematics(arm.model, data, q, v)
    frames = [arm.model.getFrameId(name) for name in arm.tips]
    axes = pin.LOCAL_WORLD_ALIGNED
    return cfg, [pin.getFrameVelocity(arm.model, data, i, axes).vector for i in frames]


@pytest.mark.slow
def test_the_tip_arrives_with_its_twist_at_zero_momentum():
    arm = sa.load("mda6")
    goal = sa.move(arm.at(MDA), MDA + 0.3).tip
    plan = sa.plan(arm.at(MDA), goal, final_twist=TWIST)
    end, (twist,) = tip_twists(plan)
    np.testing.assert_allclose(twist, TWIST, atol=1e-7)
    np.testing.assert_allclose(end.tip.homogeneous, goal.homogeneous, atol=1e-7)
    np.testing.assert_array_equal(plan.dq[0], 0.0)
    np.testing.assert_array_equal(plan.dq[-1], plan.final_rates)
    np.testing.assert_allclose(
        sa.Tracking(plan).wanted(plan.t[-1])[1], plan.final_rates, atol=1e-12
    )
    assert plan.certificate.free


@pytest.mark.slow
def test_where_it_starts_and_by_joints():
    arm = sa.load("planar2")
    start = arm.at(PLANAR)
    for goal in (start.tip.translation[:2], sa.Joints([0.6, 1.5])):
        plan = sa.plan(start, goal, final_twist=(0.05, -0.02))
        end, (twist,) = tip_twists(plan)
        np.testing.assert_allclose(twist[:2], (0.05, -0.02), atol=1e-7)
        if isinstance(goal, sa.Joints):
            np.testing.assert_allclose(end.q, goal.q, atol=1e-7)
        else:
            np.testing.assert_allclose(end.tip.translation[:2], goal, atol=1e-7)


@pytest.mark.slow
def test_each_tip_has_its_own_twist_and_others_come_to_rest():
    arm = planar_pair(("left", "right"), "all")
    goal = sa.move(arm.at(PAIR), np.add(PAIR, [0.5, -0.4, -0.6, 0.5]))
    goals = {name: tip.translation[:2] for name, tip in zip(arm.tips, goal.tips, strict=True)}
    plan = sa.plan(arm.at(PAIR), goals, final_twist={"right": (-0.03, 0.01)})
    end, (left, right) = tip_twists(plan)
    np.testing.assert_allclose(left[:2], 0.0, atol=1e-7)
    np.testing.assert_allclose(right[:2], (-0.03, 0.01), atol=1e-7)
    for tip, there in zip(end.tips, goals.values(), strict=True):
        np.testing.assert_allclose(tip.translation[:2], there, atol=1e-7)
    with pytest.raises(sa.ConfigurationError, match="by name: left, right"):
        sa.plan(arm.at(PAIR), goals, final_twist=(0.1, 0.1))
    with pytest.raises(sa.ConfigurationError, match="final_twist: unknown tip 'lift'"):
        sa.plan(arm.at(PAIR), goals, final_twist={"lift": (0.1, 0.1)})


def test_wheels_hold_the_attitude_meanwhile():
    plan = sa.plan(
        sa.load("planar2").at(PLANAR), (0.9, 1.4), final_twist=(0.1, -0.05),
        mode="attitude-controlled",
        constraints=sa.Constraints(wheels=sa.WheelHold(stiffness=1.0, damping=1.0, torque=0.5)),
    )  # fmt: skip
    v = (sa.generalized_jacobian(plan[-1], mode=plan.mode) @ plan.final_rates)[:2]
    np.testing.assert_allclose(v, (0.1, -0.05), atol=1e-7)
    assert np.abs(sa.reaction(plan).torque).max() < 0.5


@pytest.mark.slow
def test_it_is_kept_in_the_file_and_not_timed_anew(tmp_path):
    spacearm(
        "plan", "planar2", *PLANAR, "--goal", 0.9, 1.4, "--with", "final_twist=[0.1, -0.05]",
        "--save", "p.npz", cwd=tmp_path,
    )  # fmt: skip
    plan = sa.Plan.load(tmp_path / "p.npz", sa.load("planar2"))
    np.testing.assert_allclose(tip_twists(plan)[1][0][:2], (0.1, -0.05), atol=1e-7)
    assert json.loads(json.dumps(plan.to_dict()))["final_rates"] == plan.final_rates.tolist()
    with pytest.raises(sa.UnsupportedError, match="ends with a twist"):
        sa.time_optimal(plan, torque=10.0)


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"duration": 40.0, "final_attitude": 0.1}])
def test_it_arrives_by_way_of_other_goals(options):
    start = sa.load("planar2").at(PLANAR)
    via = [(1.2, 1.3), (1.0, 1.4)]
    plan = sa.plan(start, (0.9, 1.4), via=via, final_twist=(0.1, -0.05), **options)
    end, (twist,) = tip_twists(plan)
    np.testing.assert_allclose(twist[:2], (0.1, -0.05), atol=1e-7)
    np.testing.assert_allclose(end.tip.translation[:2], (0.9, 1.4), atol=1e-7)
    for goal in via:
        assert np.linalg.norm(plan.tip[:, :2] - goal, axis=1).min() < 1e-6
    assert plan.certificate.free
    assert plan.t[-1] == pytest.approx(options.get("duration", plan.t[-1]))
    if options:
        with pytest.raises(sa.NoSolutionError, match=r"take .* s; give a longer duration"):
            sa.plan(start, (0.9, 1.4), via=via, final_twist=(0.1, -0.05), duration=0.5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("momentum", "twist"),
    [([0.5, 0.2, 0, 0, 0, 0.5], (0.1, -0.05)), ([0, 0, 0, 0, 0, -0.3], (0, 0))],
)
def test_with_momentum_the_drift_is_part_of_the_twist(momentum, twist):
    start = sa.load("planar2").at(PLANAR, momentum=momentum)
    plan = sa.plan(start, (0.9, 1.4), final_twist=twist, duration=8.0)
    end, (found,) = tip_twists(plan)
    np.testing.assert_allclose(found[:2], twist, atol=1e-7)
    np.testing.assert_allclose(end.tip.translation[:2], (0.9, 1.4), atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_random_redundant_arms(seed):
    arm = load_text(random_chain(seed, 7), tip="tip")
    q = np.random.default_rng(seed).uniform(-1.0, 1.0, 7)
    goal = sa.move(arm.at(q), q + 0.2).tip
    keep = sa.Constraints(limits=False, collisions=False, rates=1.0)
    plan = sa.plan(arm.at(q), goal, final_twist=TWIST, constraints=keep)
    end, (twist,) = tip_twists(plan)
    np.testing.assert_allclose(twist, TWIST, atol=1e-6)
    np.testing.assert_allclose(end.tip.homogeneous, goal.homogeneous, atol=1e-6)
