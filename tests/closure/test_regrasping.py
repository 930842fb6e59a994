"""One hand lets go of what several hold and grasps it elsewhere: closure, momentum, what stops."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.arms import planar_pair
from helpers.closed import closed, roomy

import spacearm as sa

FREE = sa.Constraints(limits=False)


def elsewhere(held, tip, far=0.05):
    """Another grasp of a hand, near the one that it has."""
    return held.grasps[tip] * sa.pose((far, -far, 0.5 * far), (2 * far, 4 * far, -2 * far))


def seen_from_target(held, way, cfg):
    """All hands in the frame of the target, the target and the arms, in a row of the freed arm."""
    moved = dict(zip(way.arm.joint_names, cfg.q, strict=True))
    q = [moved.get(name, x) for name, x in zip(held.arm.joint_names, held.q, strict=True)]
    base = cfg.base
    target = base * held.configuration.base.actInv(held.target.pose)
    arms = held.arm.at(q, base=base)
    hands = [target.actInv(tip) for tip in arms.tips]
    return dict(zip(held.arm.tips, hands, strict=True)), target, arms


def is_near(pose, other, atol):
    np.testing.assert_allclose(pose.actInv(other).homogeneous, np.eye(4), rtol=0, atol=atol)


@pytest.mark.slow
def test_a_hand_regrasps_and_the_other_holds_on():
    """Hands by the kinematics of the arms alone, the CM of arms and target by their masses."""
    held, _ = roomy(1, tries=2)
    tip, other = held.arm.tips
    grasp = elsewhere(held, tip)
    way = held.regrasp(tip, grasp, approach=0.05, constraints=FREE)
    centres, m, M = [], held.arm.mass, held.target.mass
    for i, part in enumerate(way.parts):
        for cfg in part:
            hands, target, arms = seen_from_target(held, way, cfg)
            is_near(hands[other], held.grasps[other], 1e-9)
            centres.append((m * arms.com + M * target.act(held.target.com)) / (m + M))
            if i != 1:  # on the axis of the grasp
                line = (held.grasps[tip] if i == 0 else grasp).actInv(hands[tip])
                np.testing.assert_allclose(line.translation[:2], 0.0, atol=1e-9)
                np.testing.assert_allclose(line.rotation, np.eye(3), atol=1e-9)
                assert -0.05 - 1e-9 <= line.translation[2] <= 1e-9
    np.testing.assert_allclose(centres, np.tile(centres[0], (len(centres), 1)), atol=1e-9)
    after = held.after(way)
    assert after.closed
    is_near(after.grasps[tip], grasp, 1e-12)
    is_near(after.target.pose, target, 1e-9)
    flight = way.fly(integration=sa.Integration(dt=0.05))
    assert [round(x, 9) for x in flight.begins] == [
        round(x, 9) for x in (0.0, way.back.t[-1], way.back.t[-1] + way.plan.t[-1])
    ]
    hands, *_ = seen_from_target(held, way, flight[-1])
    is_near(hands[tip], grasp, 1e-6)
    assert np.abs(flight.momentum).max() < 1e-8
    np.testing.assert_allclose(way.t[-1], flight.t[-1], rtol=1e-9, atol=0)
    assert way.describe().not_checked == "collisions; forces at the grasps that hold"
    assert way.describe().verdict.endswith("; NOT checked: collisions")
    assert way.to_dict()["tip"] == tip


@pytest.mark.slow
def test_momentum_on_board_is_carried_over():
    held, _ = roomy(1, tries=2)
    tip, _ = held.arm.tips
    momentum = 1e-3 * (held.arm.mass + held.target.mass) * np.array([1, -1, 2, 0.5, 0.2, -0.3])
    held = replace(held, configuration=held.configuration.with_momentum(momentum))
    way = held.regrasp(tip, elsewhere(held, tip), approach=0.05, constraints=FREE)
    for part in way.parts:
        np.testing.assert_array_equal(part.momentum, np.tile(momentum, (len(part), 1)))
    flight = way.fly(integration=sa.Integration(dt=0.05))
    size = np.abs(momentum).max()
    kept = np.tile(momentum, (len(flight), 1))
    np.testing.assert_allclose(flight.momentum, kept, atol=1e-6 * size)
    drift = flight.t[-1] * momentum[:3] / flight.arm.mass
    np.testing.assert_allclose(flight.com[-1] - flight.com[0], drift, atol=1e-7)
    after = held.after(way)
    assert after.closed
    np.testing.assert_array_equal(after.configuration.momentum, momentum)
    is_near(flight[-1].base, after.configuration.base, 1e-5)


def test_of_three_hands_two_hold_on():
    held = closed(3, (6, 6, 6))
    tip = held.arm.tips[1]
    way = held.regrasp(tip, elsewhere(held, tip, 0.02), approach=0.02, constraints=FREE)
    assert held.after(way).closed
    assert len(way.arm.joint_names) == 6


@pytest.mark.slow
def test_an_arm_walks_along_handrails():
    """The spacecraft stands on the rail that is held: it stays where it is."""
    held = closed(7)
    rails = dict(zip(held.arm.tips, held.configuration.tips, strict=True))
    walker = sa.hold(held.configuration, None, rails, limits=False)
    tip, _ = walker.arm.tips
    step = elsewhere(walker, tip)
    way = walker.regrasp(tip, step, approach=0.05, constraints=FREE)
    after = walker.after(way)
    assert after.closed
    is_near(after.configuration.base, walker.configuration.base, 1e-12)
    is_near(after.grasps[tip], step, 1e-12)
    flight = way.fly(integration=sa.Integration(dt=0.05))
    is_near(flight[-1].base, walker.configuration.base, 1e-7)
    is_near(flight[-1].tip, step, 1e-6)


@pytest.mark.slow
def test_bodies_and_obstacles_are_passed_and_hands_may_touch():
    """A panel between two arms; the hand that closes in is in it, a boom is not met."""
    arm = sa.load("dual_ur5", tip=["left", "right"])
    panel = sa.Target(sa.Bus(90, size=(0.1, 1.0, 0.5), name="panel"), sa.pose((0.7, 0, 0.9)))
    forward = (0, np.pi / 2, 0)
    handles = {
        tip: sa.pose((-0.05, y, 0.1), forward) for tip, y in (("left", 0.35), ("right", -0.35))
    }
    held = sa.hold(arm.at([-0.2, -1.4, 1.4, 0, 1.4, -1.6] * 2), panel, handles, fixed=True)
    grasp = sa.pose((-0.05, 0.35, -0.2), forward)
    way = held.regrasp("left", grasp, approach=0.15)
    assert way.checked
    assert way.distance_proven > 0.0
    boom = sa.Obstacle.sphere(0.02, sa.pose((0.553, 0.328, 0.921)), name="boom")
    assert not sa.collision_check(way.plan, boom).apart
    around = held.regrasp("left", grasp, approach=0.15, constraints=sa.Constraints(obstacles=boom))
    assert sa.collision_check(around.plan, boom).apart
    assert "boom" in around.checked


def test_what_cannot_regrasp_is_told():
    held, _ = roomy(1, tries=1)
    tip, _ = held.arm.tips
    far = held.grasps[tip] * sa.pose((50, 0, 0))
    with pytest.raises(sa.NoSolutionError, match=r"stays \S+ m and \S+ rad off .* Held.plan"):
        held.regrasp(tip, far, constraints=FREE)
    with pytest.raises(sa.ConfigurationError, match=f"unknown tip 'hand'.*{tip}"):
        held.regrasp("hand", far)
    with pytest.raises(sa.ConfigurationError, match="approach"):
        held.regrasp(tip, far, approach=-0.1)
    ball = sa.Obstacle.sphere(0.1, sa.pose((9, 9, 9)), twist=(1, 0, 0, 0, 0, 0))
    with pytest.raises((sa.UnsupportedError, sa.ConfigurationError), match="moves"):
        held.regrasp(tip, far, constraints=sa.Constraints(limits=False, obstacles=ball))
    rod = sa.Target(sa.Bus(5.0, size=(1, 0.1, 0.1)), sa.pose((0, 1.5, 0)))
    ends = {"left": sa.pose((-0.3, 0, 0)), "right": sa.pose((0.3, 0, 0))}
    flat = sa.hold(planar_pair().at([2.0, -1.2, 1.1, 1.2]), rod, ends, limits=False)
    with pytest.raises(sa.ConfigurationError, match=r"out of the plane .* approach=\(0.1, 0, 0\)"):
        flat.regrasp("left", sa.pose())
    alone = sa.load("chaser7").at([0.2, 0.6, 0, 1.2, 0, 0.8, 0])
    rail = sa.hold(alone, None, {alone.arm.tip: alone.tip})
    with pytest.raises(sa.ConfigurationError, match="hold by another tip too"):
        rail.regrasp(alone.arm.tip, sa.pose())


def test_a_hand_without_joints_of_its_own_is_told():
    """Two fingers of one arm: what moves one of them moves the other."""
    arm = sa.load("chaser7")
    links = [link for link in arm.tree.links if arm.tree.movable(link)][-3:]
    both = sa.load("chaser7", tip=[links[0], links[-1]])
    start = both.at(np.full(both.n, 0.3))
    rails = dict(zip(both.tips, start.tips, strict=True))
    held = sa.hold(start, None, rails)
    with pytest.raises(sa.ConfigurationError, match="every joint on the way"):
        held.regrasp(both.tips[0], sa.pose())
