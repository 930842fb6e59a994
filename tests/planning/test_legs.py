"""Plans by way of other goals, and searches that end with Ctrl-C wherever they are."""

import numpy as np
import pytest
from helpers.arms import planar_pair
from helpers.commands import spacearm
from helpers.replay import replay

import spacearm as sa
from spacearm.planning.account import SearchAccount, TimeUpError
from spacearm.planning.reactions import largest_turn

Q0, VIA, GOAL = [0.3, 1.2], (0.7, 1.7), (0.9, 1.4)


@pytest.fixture(scope="module")
def arm():
    return sa.load("planar2")


def nearest(plan, point):
    return np.linalg.norm(plan.tip[:, :2] - point, axis=1).min()


@pytest.mark.slow
def test_the_tip_passes_the_goals_on_the_way(arm):
    plan = sa.plan(arm.at(Q0), GOAL, via=[VIA, sa.Joints(Q0)])
    assert nearest(plan, VIA) < 1e-7
    assert np.abs(plan.q[1:-1] - Q0).max(axis=1).min() < 1e-7
    np.testing.assert_allclose(plan.tip[-1, :2], GOAL, atol=1e-7)
    np.testing.assert_allclose(replay(plan)[0].tip.translation, plan.tip[-1, :3], atol=1e-7)
    assert plan.certificate.free
    assert plan.apart
    assert [a.story[:5] for a in plan.tried if a.arrived] == ["leg 1", "leg 2", "leg 3"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar3", "mda6"])
def test_the_tip_passes_the_goals_on_the_way_as_flown(name):
    arm = sa.load(name)
    q = np.radians([20.0, 60.0, -100.0, -50.0, 30.0, 10.0])[: arm.n]
    goals = [arm.at(q + 0.1 * i).tip for i in (1, 2, 3)]  # the joints do not rest on the way
    plan = sa.plan(arm.at(q), goals[-1], via=goals[:-1])
    for goal in goals:
        off = [np.linalg.norm(cfg.tip.translation - goal.translation) for cfg in plan]
        there, _ = replay(plan, int(np.argmin(off)))
        np.testing.assert_allclose(there.tip.homogeneous, goal.homogeneous, atol=1e-7)


def test_the_attitude_is_kept_by_way_of_other_goals():
    pair = planar_pair("left", "all")
    q0 = np.array([2.2, 0.9, 0.6, -0.9])
    start = pair.at(q0).tip.translation[:2]
    goal, via = start + np.array([0.15, -0.1]), start + 0.1
    plan = sa.plan(
        pair.at(q0), goal, via=[via], constraints=sa.Constraints(keep_attitude=np.radians(0.2))
    )
    assert nearest(plan, via) < 1e-7
    np.testing.assert_allclose(plan.tip[-1, :2], goal, atol=1e-7)
    assert largest_turn(list(plan)) <= np.radians(0.2)


@pytest.mark.slow
def test_a_goal_on_the_way_that_cannot_be_reached_is_named(arm):
    with pytest.raises(sa.NoSolutionError, match=r"leg 2 of 3: .*out of reach|leg 2 of 3"):
        sa.plan(arm.at(Q0), GOAL, via=[VIA, (9.0, 0.0)], search=sa.Search(timeout=2.0))


@pytest.mark.slow
def test_the_tip_passes_the_goals_on_the_way_with_momentum(arm):
    """The joints rest between legs, and the spacecraft goes on turning and drifting."""
    start = arm.at(Q0, momentum=[0.5, -0.2, 0, 0, 0, 0.4])
    end = arm.at([0.5, 1.1])
    plan = sa.plan(start, GOAL, via=[VIA, sa.Joints(end.q)], duration=30.0)
    assert plan.momentum[0].tolist() == start.momentum.tolist()
    assert nearest(plan, VIA) < 1e-6
    assert np.abs(plan.q - end.q).max(axis=1).min() < 1e-12
    np.testing.assert_allclose(plan.tip[-1, :2], GOAL, atol=1e-6)
    drifted = start.com + plan.t[-1] * start.momentum[:3] / arm.mass
    np.testing.assert_allclose(plan.com[-1], drifted, atol=1e-9)
    for row in (int(np.linalg.norm(plan.tip[:, :2] - VIA, axis=1).argmin()), -1):
        flown = replay(plan, row)[0].tip.translation
        np.testing.assert_allclose(flown, plan.tip[row, :3], atol=1e-6)
    assert plan.certificate.free
    assert plan.t[-1] == pytest.approx(30.0)


@pytest.mark.slow
def test_several_tips_pass_the_goals_on_the_way():
    pair = planar_pair()
    q = np.array([0.3, 0.7, -0.3, 0.9])
    way = [pair.at(q + np.array([0.1, -0.2, 0.1, 0.2]) * i) for i in range(3)]
    goals = [
        {tip: at.translation[:2] for tip, at in zip(pair.tips, cfg.tips, strict=True)}
        for cfg in way
    ]
    for momentum in (np.zeros(6), [0, 0, 0, 0, 0, 0.3]):
        plan = sa.plan(pair.at(q, momentum=momentum), goals[2], via=[goals[1]])
        tips = [np.array([cfg.tips[i].translation[:2] for cfg in plan]) for i in (0, 1)]
        off = sum(
            np.linalg.norm(tip - goals[1][name], axis=1)
            for tip, name in zip(tips, pair.tips, strict=True)
        )
        assert off.min() < 1e-6
        for tip, name in zip(tips, pair.tips, strict=True):
            np.testing.assert_allclose(tip[-1], goals[2][name], atol=1e-6)
    one = sa.plan(pair.at(q), {"left": goals[2]["left"]}, via=[{"left": goals[1]["left"]}])
    assert nearest(one, goals[1]["left"]) < 1e-6


def test_goals_on_the_way_name_the_tips_that_the_goal_names(arm):
    pair, goals = planar_pair(), {"left": (0.5, 1.0), "right": (0.5, -1.0)}
    at = pair.at([0.3, 0.7, -0.3, 0.9])
    for via in ({"left": VIA}, VIA):
        with pytest.raises(sa.ConfigurationError, match=r"via has .*name the tips .*: left, right"):
            sa.plan(at, goals, via=[via])
    with pytest.raises(sa.ConfigurationError, match="name the tips that goal names: none"):
        sa.plan(arm.at(Q0), GOAL, via=[{"left": VIA}])
    for wrong in ((1.0,), sa.Joints([1.0])):
        with pytest.raises(sa.ConfigurationError, match=r"via\[1\] "):
            sa.plan(arm.at(Q0), GOAL, via=[VIA, wrong])


@pytest.mark.parametrize("asked", ["at rest", "momentum", "via"])
def test_one_interrupt_ends_the_whole_search(arm, asked):
    """Ctrl-C comes once, in whatever part of the search; nothing is begun after it."""
    calls = []

    def progress(*_):
        calls.append(None)
        if len(calls) == 5:
            raise KeyboardInterrupt

    wall = sa.Obstacle.sphere(0.05, sa.pose((*GOAL, 0.0)))  # about the goal: there is no plan
    beside = {"constraints": sa.Constraints(obstacles=wall)}
    start, words = {
        "at rest": (arm.at(Q0), beside),
        "momentum": (arm.at(Q0, momentum=[0, 0, 0, 0, 0, 1.0]), {"duration": 0.01}),
        "via": (arm.at(Q0), {"via": [VIA]} | beside),
    }[asked]
    with pytest.raises(sa.StoppedError) as stopped:
        sa.plan(start, GOAL, search=sa.Search(progress=progress), **words)
    assert isinstance(stopped.value.best, sa.Plan)
    assert 5 <= len(calls) <= 6


def test_a_part_ends_with_the_whole():
    whole = SearchAccount(1e3)
    part = whole.part(1e3)
    part.check_time()
    part.end()
    for search in (part, whole):
        with pytest.raises(TimeUpError, match="Ctrl-C"):
            search.check_time()
    soon = SearchAccount(1e-9).part(1e3)
    with pytest.raises(TimeUpError, match="time is up"):
        soon.check_time()


@pytest.mark.slow
def test_command(tmp_path):
    words = ("plan", "planar2", *Q0, "--goal", *GOAL, "--with", "via=[[0.7, 1.7], [0.8, 1.6]]")
    run = spacearm(*words, "--save", "plan.npz", "--json", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    plan = sa.Motion.load(tmp_path / "plan.npz", sa.load("planar2"))
    places = [np.linalg.norm(plan.tip[:, :2] - point, axis=1) for point in (VIA, (0.8, 1.6))]
    assert max(distance.min() for distance in places) < 1e-5  # rows are bent to arrive as flown
    assert places[0].argmin() < places[1].argmin()
    np.testing.assert_allclose(plan.tip[-1, :2], GOAL, atol=1e-7)
