"""Plans for two arms: tips arrive together, or one arm keeps the attitude, under replay."""

import re

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import planar_pair, planar_pair_text
from helpers.commands import spacearm
from helpers.replay import replay

import spacearm as sa
from spacearm.planning.reactions import largest_turn

Q0 = np.array([2.2, 0.9, 0.6, -0.9])
HOME = np.array([0.3, -1.2, 1.5, -0.8, -1.3, 0.2])
BOTH = np.concatenate((HOME, HOME * [-1, 1, 1, 1, 1, 1]))
TIPS = ("left", "right")


def pair(tip=TIPS):
    return planar_pair(tip, "all")


@pytest.fixture(scope="module")
def arm():
    return pair()


@pytest.fixture(scope="module")
def dual():
    return sa.load("dual_ur5", tip=TIPS)


@pytest.mark.slow
def test_both_tips_arrive_at_once(arm):
    goal = sa.move(arm.at(Q0), Q0 + np.array([0.5, -0.4, -0.6, 0.5]))
    goals = {name: tip.translation[:2] for name, tip in zip(TIPS, goal.tips, strict=True)}
    plan = sa.plan(arm.at(Q0), goals)
    end, _ = replay(plan)
    for tip, point in zip(end.tips, goals.values(), strict=True):
        np.testing.assert_allclose(tip.translation[:2], point, atol=1e-7)
    assert plan.certificate.free
    assert plan.distance.min() > plan.clearance


@pytest.mark.slow
def test_both_tips_arrive_with_momentum(arm):
    goal = sa.move(arm.at(Q0), Q0 + np.array([0.5, -0.4, -0.6, 0.5]))
    goals = {name: tip.translation[:2] for name, tip in zip(TIPS, goal.tips, strict=True)}
    start = arm.at(Q0, momentum=[0.05, 0, 0, 0, 0, 0.03])
    end, _ = replay(sa.plan(start, goals, duration=10.0))
    for tip, point in zip(end.tips, goals.values(), strict=True):
        np.testing.assert_allclose(tip.translation[:2], point, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("bend", [0.0, 0.5])
def test_curves_in_joint_space_lead_both_tips(arm, bend):
    """Where lines are not asked for; the goal lies beyond a motion that is not straight."""
    middle = sa.move(arm.at(Q0), Q0 + bend)
    goal = sa.move(middle, Q0 + np.array([0.4, 0.3, -0.5, -0.3]))
    goals = {name: tip.translation[:2] for name, tip in zip(TIPS, goal.tips, strict=True)}
    plan = sa.plan(arm.at(Q0), goals, search=sa.Search(method="joint space"))
    end, _ = replay(plan)
    for tip, point in zip(end.tips, goals.values(), strict=True):
        np.testing.assert_allclose(tip.translation[:2], point, atol=1e-7)
    assert (np.abs(plan.q) <= 3.0).all()


def test_both_arms_of_a_real_robot(dual):
    goal = sa.move(dual.at(BOTH), BOTH + np.linspace(-0.25, 0.25, 12))
    plan = sa.plan(dual.at(BOTH), dict(zip(TIPS, goal.tips, strict=True)))
    end, _ = replay(plan)
    for tip, there in zip(end.tips, goal.tips, strict=True):
        np.testing.assert_allclose(tip.homogeneous, there.homogeneous, atol=1e-7)
    assert plan.apart
    assert len(plan.arm.tips) == 2


@pytest.mark.slow
def test_one_arm_works_and_the_other_keeps_the_attitude(arm):
    goal = sa.move(arm.at(Q0), Q0 + np.array([0.5, -0.4, 0.0, 0.0])).tips[0].translation[:2]
    free = sa.plan(arm.at(Q0), {"left": goal}, search=sa.Search(method="straight"))
    plan = sa.plan(arm.at(Q0), {"left": goal}, constraints=sa.Constraints(keep_attitude=1e-3))
    assert replay(free)[1] > 0.03
    end, turn = replay(plan)
    assert plan.method == "reactionless"
    assert plan.arm.tips == ("left",)
    assert turn < 1e-4
    np.testing.assert_allclose(end.tip.translation[:2], goal, atol=1e-7)
    run = sa.simulate(plan[0], sa.Tracking(plan), plan.t[-1], integration=sa.Integration(rtol=1e-6))
    assert np.linalg.norm(run.tip[-1, :2] - goal) < 1e-3
    assert 2.0 * np.abs(run.base[:, 5]).max() < 1e-3


@pytest.mark.parametrize(("far", "kept"), [(0.15, 2e-3), (0.25, 1e-2)])
@pytest.mark.slow
def test_an_arm_of_a_real_robot_keeps_the_attitude(far, kept):
    """As near as nothing, or where that would fold its wrist into it, within what is allowed."""
    arm = sa.load("dual_ur5", tip="left", joints="all")
    goal = sa.move(arm.at(BOTH), BOTH + np.append(far * np.array([1, -1, 1, 1, -1, 1]), 6 * [0]))
    plan = sa.plan(arm.at(BOTH), goal.tip, constraints=sa.Constraints(keep_attitude=kept))
    end, turn = replay(plan)
    assert turn <= largest_turn(list(plan)) <= kept
    np.testing.assert_allclose(end.tip.homogeneous, goal.tip.homogeneous, atol=1e-7)
    assert plan.apart
    assert "turns by at most" in plan.tried[-1].story


def test_the_bound_on_the_turn_holds_and_is_near(arm):
    """On motions that turn the spacecraft, against dense steps; the largest is never missed."""
    rng = np.random.default_rng(0)
    for _ in range(5):
        Q = Q0 + np.cumsum(rng.normal(scale=0.001, size=(100, 4)), axis=0)
        rows = [arm.at(Q[0])]
        for q in Q[1:]:
            rows.append(sa.move(rows[-1], q))
        dense = []
        for here, q in zip(rows[:-1], Q[1:], strict=True):
            dense += [sa.move(here, here.q + s * (q - here.q)) for s in (0.2, 0.5, 0.8)]
        turns = [abs(pin.log3(cfg.base.rotation)[2]) for cfg in (*rows, *dense)]
        bound = largest_turn(rows)
        assert max(turns) <= bound < 3.0 * max(turns)


def test_tips_of_a_held_spacecraft_arrive_within_the_limits_of_wheels(arm):
    base = arm.at(Q0).base
    com, end = arm.at(Q0).com, arm.at(Q0 + np.array([0.4, -0.3, -0.5, 0.3]), base=base)
    goals = {k: t.translation[:2] for k, t in zip(TIPS, end.centred(com).tips, strict=True)}
    hold = sa.WheelHold(stiffness=0, damping=0, torque=0.5)
    plan = sa.plan(
        arm.at(Q0), goals, mode="attitude-controlled", constraints=sa.Constraints(wheels=hold)
    )
    for tip, point in zip(plan[-1].tips, goals.values(), strict=True):
        np.testing.assert_allclose(tip.translation[:2], point, atol=1e-7)
    assert 0.4 < np.abs(sa.reaction(plan).torque).max() <= 0.5


@pytest.mark.slow
@pytest.mark.parametrize("tip", TIPS)
def test_either_arm_with_the_other_held(tip):
    other = dict(zip([f"{t}_{j}" for t in TIPS for j in ("j1", "j2")], Q0, strict=True))
    mine = [name for name in other if name.startswith(tip)]
    one = pair(tip).replace(locked={k: v for k, v in other.items() if k not in mine})
    q = np.array([other[name] for name in mine])
    goal = sa.move(one.at(q), q + np.array([0.3, -0.4])).tip.translation[:2]
    end, _ = replay(sa.plan(one.at(q), goal))
    np.testing.assert_allclose(end.tip.translation[:2], goal, atol=1e-7)


def test_the_command_leads_both_tips_and_draws_them(arm, tmp_path):
    model = tmp_path / "pair.urdf"
    model.write_text(planar_pair_text())
    goal = sa.move(arm.at(Q0), Q0 + np.array([0.5, -0.4, -0.6, 0.5]))
    ends = [",".join(f"{x:.9f}" for x in tip.translation[:2]) for tip in goal.tips]
    words = ("plan", model, "--tip", "left,right", "--joints", "all", *Q0)
    goals = ("--goal", f"left={ends[0]}", "--goal", f"right={ends[1]}")
    run = spacearm(*words, *goals, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    for name, tip in zip(TIPS, goal.tips, strict=True):
        told = re.search(rf"^{name} +\(.*?\) m +\((\S+), (\S+), ", run.stdout, re.M)
        found = [float(word) for word in told.groups()]
        np.testing.assert_allclose(found, tip.translation[:2], atol=1e-4)
    assert list(tmp_path.glob("*_plan.png"))
    wrong = spacearm(*words, "--goal", "middle=1,2", cwd=tmp_path)
    assert wrong.returncode
    assert "for each of the tips left, right" in wrong.stderr


BAD = {
    "unknown tip 'middle'": lambda start, _: sa.plan(start, {"middle": (0, 0)}),
    "goal is empty": lambda start, _: sa.plan(start, {}),
    "unknown method 'cycles'": lambda start, goals: sa.plan(
        start, goals, search=sa.Search(method="cycles")
    ),
    "keep_attitude": lambda start, goals: sa.plan(
        start, goals, constraints=sa.Constraints(keep_attitude=-1.0)
    ),
}


@pytest.mark.parametrize("words", BAD)
def test_what_cannot_be_done_is_said(arm, words):
    with pytest.raises(sa.SpaceArmError, match=words):
        BAD[words](arm.at(Q0), {"left": (-2.0, 1.0), "right": (2.2, 0.3)})


@pytest.mark.slow
def test_an_attitude_that_cannot_be_kept_is_said():
    with pytest.raises(
        sa.NoSolutionError, match=r"turns by up to.*reactionless: 2 joints|2 joints"
    ):
        sa.plan(
            sa.load("planar2").at([0.3, 1.2]),
            (0.9, 1.4),
            constraints=sa.Constraints(keep_attitude=1e-3),
            search=sa.Search(timeout=1.0),
        )
