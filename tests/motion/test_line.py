"""Straight lines of the tip in compiled code, beside `follow`."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import frame, joint, link, load_text, robot, seeds
from hypothesis import given, settings

import spacearm as sa
from spacearm.motion.goal import as_goal
from spacearm.motion.leading import POINTS, straight_line


@pytest.mark.parametrize(
    "name",
    ["planar2", *(pytest.param(name, marks=pytest.mark.slow) for name in ("mda6", "chaser7"))],
)
@settings(max_examples=3)
@given(seed=seeds)
def test_it_ends_as_follow_does(name, seed):
    arm, rng = sa.load(name), np.random.default_rng(seed)
    q, quaternion = rng.uniform(-1.0, 1.0, arm.n), np.array([0.0, 0.0, 0.6, 0.8])
    q = np.clip(q, arm.lower + 0.1, arm.upper - 0.1)
    start = arm.at(q, base=pin.SE3(pin.Quaternion(quaternion), np.array([1.0, 2.0, 0.0])))
    goal = as_goal(start, start.arm.at(q + rng.normal(0.0, 0.3, arm.n), base=start.base).tip)
    slow, line = sa.follow(start, [goal]), straight_line(start, goal, True)
    assert line.end.kind == slow.ended
    assert line.length == pytest.approx(slow.length, rel=1e-12)
    exact = 1e-6 if line.end.kind == "arrived" else 0.02  # det J* or the distance is interpolated
    assert line.end.t == pytest.approx(slow.s[-1], abs=exact * line.length)
    if slow.arrived:
        assert len(line.q) == POINTS + 1
        assert line.q[-1] == pytest.approx(slow.q[-1], abs=1e-4)
        assert line.tip == pytest.approx(slow.tip[-1, :3], abs=1e-7)
    elif line.end.kind == "joint limit":
        assert line.end.detail in slow.reason
        assert ((line.q >= arm.lower) & (line.q <= arm.upper)).all()
        assert line.q[-1] == pytest.approx(slow.q[-1], abs=0.01)


@pytest.mark.parametrize("k", [0, 20, 64, 100])
def test_a_limit_right_before_a_point(k):
    """The step that ends at the point, or the start, is beyond the limit."""

    def led(upper):
        limit = f'<limit lower="-3" upper="{float(upper)!r}" effort="10" velocity="1"/>'
        text = robot(
            link("bus", 500.0, inertia=100.0 * np.eye(3)),
            link("upper", 4.0, (0.5, 0, 0)),
            link("fore", 3.0, (0.5, 0, 0)),
            frame("tip"),
            joint("shoulder", "bus", "upper"),
            joint("elbow", "upper", "fore", xyz=(1, 0, 0), inside=limit),
            joint("fixed", "fore", "tip", kind="fixed", xyz=(1, 0, 0), inside=""),
        )
        arm = load_text(text, tip="tip", task="x y")
        start = arm.at([0.3, 0.5])
        return straight_line(start, as_goal(start, arm.at([0.2, 1.2]).tip), True)

    free = led(3.0)
    assert free.end.kind == "arrived"
    limit = free.q[k, 1] - 1e-9
    line = led(limit)
    assert line.end.kind == "joint limit"
    assert line.end.detail == "elbow"
    np.testing.assert_allclose(line.q[-1], free.q[k], rtol=0.0, atol=1e-7)
    assert line.q[-1, 1] == limit


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mda6", "chaser7"])
def test_a_thousand_lines_stay_within_the_limits(name):
    arm, rng, ends = sa.load(name), np.random.default_rng(0), set()
    for _ in range(1000):
        q = rng.uniform(arm.lower, arm.upper).clip(-3.0, 3.0)
        start = arm.at(q)
        goal = as_goal(start, arm.at(q + rng.normal(0.0, 0.5, arm.n)).tip)
        line = straight_line(start, goal, True)
        assert ((line.q >= arm.lower) & (line.q <= arm.upper)).all()
        ends.add(line.end.kind)
    assert {"joint limit", "singularity"} <= ends
