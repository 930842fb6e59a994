"""The time of a search, and what it says when it fails."""

import re
import time
from types import SimpleNamespace

import numpy as np
import pytest

import spacearm as sa
from spacearm.planning.account import SearchAccount, TimeUpError
from spacearm.planning.guesses import GuessFinder
from spacearm.planning.methods import METHODS, _loop_places
from spacearm.planning.problem import Problem
from spacearm.planning.request import Constraints, PlanRequest, Search
from spacearm.planning.strategies.at_rest import _in_rounds


def test_the_account_names_the_constraint_that_stops_most_and_what_to_relax():
    search = SearchAccount(1.0)
    search.postures.update(tried=600, reached=40, limits=30, side=6, usable=4)
    search.ways.update(landing=500, limits=20, contact=3)
    search.contacts["'l4' meets 'hull'"] = 3
    assert search.verdict == (
        "40 of 600 searches found joint positions at the goal; of which 30 lie beyond the joint "
        "limits, 6 lie on the other side of the singular set, 4 can be used; of the ways tried 500 "
        "do not arrive, 20 leave the joint limits, 3 are in collision; most often (3x) 'l4' meets "
        "'hull'. To relax: limits=False ignores the joint limits"
    )


@pytest.mark.parametrize(
    ("ways", "first"),
    [({"contact": 9, "limits": 2}, "tree"), ({"contact": 9, "singular": 20}, "roadmap")],
)
def test_a_tree_comes_before_loops_where_contacts_stop_most_ways(ways, first):
    search, tried = SearchAccount(1.0), []
    for name in _in_rounds(METHODS, "auto", search):
        tried.append(name)
        if name == "joint space":
            search.ways.update(ways)
        if search.rounds:
            break
    assert tried[tried.index("joint space") + 1] == first
    assert sorted(tried[: len(METHODS)]) == sorted(METHODS)


def test_loops_are_tried_nowhere_beyond_a_singularity(monkeypatch):
    arm = sa.load("planar2", task="x y")
    request = PlanRequest.of(
        arm.at([0.3, 1.2]), (0.9, 1.4), "spacecraft", Constraints(), Search(), (), None, None
    )
    problem = Problem.of(request)
    places = np.array([[0.3, -1.2], [0.5, 1.0]])
    monkeypatch.setattr(GuessFinder, "loop_places", lambda _: places)
    there = [rows[-1].q.tolist() for rows in _loop_places(problem, problem.target)]
    assert there == [[0.3, 1.2], [0.5, 1.0]]


@pytest.mark.parametrize(
    ("postures", "ways", "remedy"),
    [
        ({"tried": 9}, {}, "a goal nearer"),
        ({"tried": 9, "reached": 3, "side": 3}, {}, "start on the other side"),
        ({"tried": 9, "reached": 3, "near": 3}, {}, "smaller clearance"),
        ({"tried": 9, "reached": 3, "usable": 3}, {"landing": 5}, "longer timeout"),
        ({"tried": 9, "reached": 3, "usable": 3}, {"landing": 5, "contact": 1}, "obstacles"),
    ],
)
def test_what_to_relax(postures, ways, remedy):
    search = SearchAccount(1.0)
    search.postures.update(postures)
    search.ways.update(ways)
    assert remedy in search.verdict.partition("To relax")[2]


def test_time_is_checked_and_told(monkeypatch):
    told, clock = [], iter((0.0, 0.01, 0.06))
    monkeypatch.setattr("spacearm.planning.account.time", SimpleNamespace(monotonic=clock.__next__))
    search = SearchAccount(0.05, lambda t, whole: told.append((t, whole)))
    search.check_time()
    with pytest.raises(TimeUpError, match="time is up"):
        search.check_time()
    assert told == [(0.01, 0.05), (0.05, 0.05)]


def stiff(tmp_path):
    """The paper's arm, its joints between 0.9 and 1.1 rad, and a goal that takes others."""
    text = sa.load("planar2").path.read_text()
    text = re.sub(r'lower="[^"]*" upper="[^"]*"', 'lower="0.9" upper="1.1"', text)
    (tmp_path / "stiff.urdf").write_text(text)
    arm = sa.load(tmp_path / "stiff.urdf")
    goal = arm.at([-0.5, 1.5]).centred(arm.at([1.0, 1.0]).com).tip.translation[:2]
    return arm, goal


@pytest.mark.slow
def test_a_search_uses_its_time_and_not_more(tmp_path):
    """No look at the clock comes later than the time that was given."""
    arm, goal = stiff(tmp_path)
    looks = []
    for _ in range(2):  # the first time compiled code is loaded
        looks.clear()
        with pytest.raises(sa.NoSolutionError) as caught:
            sa.plan(
                arm.at([1.0, 1.0]), goal,
                search=sa.Search(
                    timeout=5.0, progress=lambda t, _: looks.append((t, time.process_time()))
                ),
            )  # fmt: skip
    assert looks[-1][0] == 5.0
    assert np.diff([work for _, work in looks]).max() < 5.0
    assert "beyond the joint limits" in str(caught.value)
    assert "To relax: limits=False" in str(caught.value)


@pytest.mark.slow
def test_ctrl_c_says_what_was_tried(tmp_path):
    arm, goal = stiff(tmp_path)

    def stop(t, _):
        if t > 1.0:
            raise KeyboardInterrupt

    with pytest.raises(sa.StoppedError, match="planar2: no plan found in") as caught:
        sa.plan(arm.at([1.0, 1.0]), goal, search=sa.Search(progress=stop))
    assert "straight: joint 'joint_" in str(caught.value)
    assert "stopped by Ctrl-C" in str(caught.value)


def test_limits_hold_at_every_instant():
    """Positions and rates, of the motion between its rows too."""
    arm = sa.load("planar2")
    plan = sa.plan(arm.at([0.3, 1.2]), sa.Joints([arm.upper[0], 1.0]))
    for t in np.random.default_rng(0).uniform(0.0, plan.t[-1], 300):
        q = plan.at(t).q
        assert ((q >= arm.lower) & (q <= arm.upper)).all()
    limits = [arm.tree.joints[name].velocity for name in arm.joint_names]
    assert (largest_rates(plan) <= np.array(limits) * (1.0 + 1e-9)).all()


def largest_rates(motion):
    """The largest joint rates of the spline that is followed, at 30 times between two samples."""
    intervals = zip(motion.t[:-1], motion.t[1:], strict=True)
    t = np.concatenate([np.linspace(begin, end, 31) for begin, end in intervals])
    return np.abs(motion.spline(t, 1)).max(axis=0)


RATES = np.array([0.2, 0.35])
PLANNED = {
    "at rest": {},
    "momentum": {"momentum": [0, 0, 0, 0, 0, 0.2]},
    "twist": {"final_twist": [0.02, -0.01]},
    "via": {"via": [(1.3, 1.0)]},
    "attitude-controlled": {"mode": "attitude-controlled"},
}


@pytest.mark.parametrize("kind", PLANNED)
def test_rates_that_are_asked_for_hold_along_the_spline(kind):
    given = dict(PLANNED[kind])
    start = sa.load("planar2").at([0.1, 1.3], momentum=given.pop("momentum", np.zeros(6)))
    plan = sa.plan(start, (1.2, 1.25), constraints=sa.Constraints(rates=RATES), **given)
    assert (largest_rates(plan) <= RATES * (1.0 + 1e-9)).all()
    if kind in ("at rest", "attitude-controlled"):
        fast = sa.time_optimal(plan, rate=RATES, acceleration=0.5)
        assert (largest_rates(fast) <= RATES * (1.0 + 1e-9)).all()


def test_a_goal_out_of_reach_is_refused_within_the_time():
    """The motion towards it, which the error carries, ends where the time does."""
    start = sa.load("planar2").at([0.3, 1.2])
    for timeout, moves in ((1e-9, False), (3600.0, True)):
        with pytest.raises(sa.ImpossibleError, match="comes no farther") as refused:
            sa.plan(start, (9.0, 1.4), search=sa.Search(timeout=timeout))
        assert (len(refused.value.best) > 1) == moves


def test_a_plan_that_is_not_found_in_time_names_the_limit():
    start = sa.load("planar2").at([0.3, 1.2])
    with pytest.raises(sa.NoSolutionError, match=r"\(timeout = 1e-09 s\)"):
        sa.plan(start, (0.9, 1.4), search=sa.Search(timeout=1e-9))
