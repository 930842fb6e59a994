"""Plans with momentum on board arrive at their time, by an integrator that shares nothing."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import joint, link, load_text, random_chain
from helpers.replay import replay

import spacearm as sa
from spacearm.mechanics.batch import evaluate
from spacearm.planning.many_curves import drifting_attitudes

H = np.array([0.5, 0.2, 0.0, 0.0, 0.0, 0.5])


@pytest.fixture(scope="module")
def arm():
    return sa.load("planar2")


@pytest.fixture(scope="module")
def found(arm):
    return sa.plan(arm.at([0.3, 1.2], momentum=H), (0.9, 1.4), duration=8.0)


@pytest.mark.slow
def test_the_tip_arrives_at_the_stated_time(arm, found):
    end = replay(found)[0]
    assert found.t[-1] == 8.0
    np.testing.assert_allclose(end.tip.translation[:2], (0.9, 1.4), atol=2e-8)
    np.testing.assert_allclose(found.tip[-1, :2], (0.9, 1.4), atol=2e-8)
    np.testing.assert_allclose(found.com[-1], found.com[0] + 8.0 * H[:3] / arm.mass, atol=1e-12)
    assert found.certificate.free
    assert found.apart
    np.testing.assert_array_equal(found.dq[[0, -1]], 0.0)


def test_the_plan_without_momentum_would_miss(arm):
    still = sa.plan(arm.at([0.3, 1.2]), (0.9, 1.4))
    ends = drifting_attitudes(arm, np.eye(3), still.t, still.q[None], H[3:], np.zeros(3))[0, -1]
    assert np.linalg.norm(pin.log3(ends.T @ still[-1].base.rotation)) > 0.05


@pytest.mark.slow
def test_a_simulation_with_the_momentum_keeps_to_the_plan(found):
    run = sa.simulate(
        found[0],
        sa.Tracking(found),
        8.0,
        integration=sa.Integration(rtol=1e-7),
    )
    assert np.linalg.norm(run.tip[-1, :2] - (0.9, 1.4)) < 1e-3


def test_the_plan_is_kept_with_its_momentum(arm, found, tmp_path):
    found.save(tmp_path / "p.npz")
    again = sa.Plan.load(tmp_path / "p.npz", arm)
    np.testing.assert_array_equal(again.momentum, found.momentum)
    assert again.to_dict()["momentum"][0] == H.tolist()


@pytest.mark.slow
@pytest.mark.parametrize("total", [0.0, 0.5])
def test_wheels_that_spin_on_count(total):
    """They hold 0.3 N m s: with nothing else on board the spacecraft turns the other way."""
    inside = '<limit effort="1" velocity="300"/><wheel/>'
    rotor = link("rotor") + joint("wheel", "spacecraft", "rotor", "continuous", inside=inside)
    text = sa.load("planar2").path.read_text().replace("</robot>", rotor + "</robot>")
    arm, h = load_text(text), [0.0, 0.0, 0.0, 0.0, 0.0, total]
    plan = sa.plan(arm.at([0.3, 1.2], wheels=[0.3], momentum=h), (0.9, 1.4), duration=8.0)
    end = replay(plan)[0]
    np.testing.assert_allclose(end.tip.translation[:2], (0.9, 1.4), atol=2e-8)
    np.testing.assert_array_equal(plan.wheels, [[0.3]] * len(plan))
    np.testing.assert_array_equal(plan.momentum, [h] * len(plan))


def test_without_momentum_the_duration_stretches_the_plan(arm):
    plan = sa.plan(arm.at([0.3, 1.2]), (0.9, 1.4))
    longer = sa.plan(arm.at([0.3, 1.2]), (0.9, 1.4), duration=30.0)
    np.testing.assert_array_equal(longer.q, plan.q)
    np.testing.assert_allclose(longer.t, plan.t * (30.0 / plan.t[-1]), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(longer.dq, plan.dq * (plan.t[-1] / 30.0), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("momentum", [None, H])
def test_what_the_velocity_limits_forbid_is_said(arm, momentum):
    start, soon = arm.at([0.3, 1.2], momentum=momentum), sa.Search(timeout=1.0)
    with pytest.raises(sa.NoSolutionError, match=r"more than the duration|reached in time"):
        sa.plan(start, (0.9, 1.4), duration=0.1, search=soon)


@pytest.mark.slow
def test_an_obstacle_is_kept_off_while_the_spacecraft_drifts(arm):
    start = arm.at([0.3, 1.2], momentum=H)
    through = sa.plan(start, (0.9, 1.4), duration=12.0)
    beside = through.at(4.0).tip.translation + np.array([0.12, 0.0, 0.0])
    ball = sa.Obstacle.sphere(0.06, sa.pose(beside))
    assert not sa.collision_check(through, ball).apart
    plan = sa.plan(start, (0.9, 1.4), duration=12.0, constraints=sa.Constraints(obstacles=ball))
    assert sa.collision_check(plan, ball).apart


def test_a_longer_duration_minds_what_moves(arm):
    """A ball that is still far off when the plan ends meets the tip of a slower one."""
    far = sa.pose((0.9, 1.4 + 1.0, 0.0))
    ball = sa.Obstacle.sphere(0.1, far, twist=[0.0, -0.1, 0.0, 0.0, 0.0, 0.0])
    plan = sa.plan(arm.at([0.3, 1.2]), (0.9, 1.4), constraints=sa.Constraints(obstacles=ball))
    with pytest.raises(sa.NoSolutionError, match="meets"):
        sa.plan(
            arm.at([0.3, 1.2]),
            (0.9, 1.4),
            duration=plan.t[-1] + 10.0,
            constraints=sa.Constraints(obstacles=ball),
        )


def end_of_a_way(arm, Q, h, lasts):
    """Where the spacecraft with momentum h is after joint positions Q, passed evenly."""
    t, start = np.linspace(0.0, lasts, len(Q)), arm.at(Q[0])
    T = drifting_attitudes(arm, np.eye(3), t, Q[None], h[3:], np.zeros(3))[0, -1]
    return arm.at(Q[-1], base=pin.SE3(T, np.zeros(3))).centred(start.com + lasts * h[:3] / arm.mass)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_spatial_arms_arrive(seed):
    """The goal is where a known motion with this momentum ends, in twice its time."""
    arm, rng = load_text(random_chain(seed, 7), tip="tip", task="pose"), np.random.default_rng(seed)
    Q = np.linspace(0.0, 0.4, 60)[:, None] * rng.choice([-1.0, 1.0], 7)
    h = np.append(np.zeros(3), 0.01 * arm.at(Q[0]).A[3:, 3:6] @ rng.normal(size=3))
    goal = end_of_a_way(arm, Q, h, 10.0).tip
    plan = sa.plan(arm.at(Q[0], momentum=h), goal, duration=10.0)
    end = replay(plan)[0]
    np.testing.assert_allclose(end.tip.homogeneous, goal.homogeneous, atol=1e-7)


def straight_way(arm, rng):
    """Joint positions along a line on which a square J* stays regular."""
    while True:
        begin = rng.uniform(np.maximum(arm.lower, -1.5), np.minimum(arm.upper, 1.5))
        Q = begin + np.linspace(0.0, 1.0, 60)[:, None] * rng.uniform(0.1, 0.4, arm.n)
        if arm.n > arm.task.k:
            return Q
        S = evaluate(arm, Q, ("determinant",))["determinant"]
        if np.abs(S).min() > 0.3 * np.abs(S).max() and np.ptp(np.sign(S)) == 0.0:
            return Q


MOVING = [("planar2", 4), ("planar3", 5), ("mda6", 6), ("chaser7", 7)]


@pytest.mark.slow
@pytest.mark.parametrize("momentum", [False, True], ids=["at rest", "with momentum"])
@pytest.mark.parametrize(("name", "seed"), MOVING)
def test_plans_arrive_as_they_are_flown(name, seed, momentum):
    """Tracking follows the spline through the rows, which `sa.simulate` integrates on its own."""
    arm, rng = sa.load(name), np.random.default_rng(seed)
    Q, lasts = straight_way(arm, rng), 10.0
    h = rng.normal(scale=0.002 * arm.mass, size=6) * momentum
    if arm.tree.plane_normal() is not None:
        h[2:5] = 0.0
    goal = end_of_a_way(arm, Q, h, lasts).tip
    there = goal if max(arm.task.indices) > 2 else goal.translation[arm.task.indices]
    loose = sa.Constraints(collisions=False, limits=False)
    plan = sa.plan(arm.at(Q[0], momentum=h), there, duration=lasts, constraints=loose)
    exact = sa.Integration(rtol=1e-11, atol=1e-12)
    end = sa.simulate(plan[0], sa.Tracking(plan), plan.t[-1], integration=exact)[-1]
    rows = [i for i in arm.task.indices if i < 3]
    off = np.linalg.norm((end.tip.translation - goal.translation)[rows])
    turned = np.linalg.norm(pin.log3(end.base.rotation.T @ plan[-1].base.rotation))
    assert max(off, turned) < 1e-7
    assert plan.arrival_error.tip < 1e-7
    assert plan.arrival_error.attitude < 1e-7
