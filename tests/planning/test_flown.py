"""Constraints of plans along what is flown: the splines through their rows."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, random_chain
from helpers.replay import replay

import spacearm as sa
from spacearm.collisions.separation import Collisions, collision_geometry
from spacearm.collisions.swept_motion import Curved, Recorded
from spacearm.mechanics.floating import placed, walk
from spacearm.planning.many_curves import FlownRows
from spacearm.planning.problem import broken_as_flown, contact_as_flown
from spacearm.planning.request import PlanRequest
from spacearm.planning.result import landed


def request_of(plan):
    constraints = sa.Constraints(collisions=False, clearance=0.0)
    return PlanRequest.of(
        plan[0], sa.Joints(plan.q[-1]), "spacecraft", constraints, sa.Search(), (), None, None
    )


def test_limits_are_checked_between_the_rows(tmp_path):
    """A spline swings beyond the rows about its turning point; the limit stands in between."""
    arm = sa.load("planar2")
    plan = sa.plan(arm.at([0.3, 1.2]), sa.Joints([0.8, 1.6]))
    t = np.linspace(0.0, 10.0, 9)
    bent = replace(
        plan,
        t=t,
        q=np.column_stack((0.3 + 0.01 * np.sin(0.6 * t), 1.2 + 0.1 * t)),
        base=plan.base[:9],
        momentum=plan.momentum[:9],
        wheels=plan.wheels[:9],
    )
    at = np.linspace(0.0, 10.0, 20001)
    top, rows = bent.spline(at)[:, 0].max(), bent.q[:, 0].max()
    assert rows < top
    for limit, word in ((0.5 * (rows + top), "limits"), (top + 1e-4, None)):
        (tmp_path / "tight.urdf").write_text(
            re.sub(r'upper="[^"]*"', f'upper="{float(limit)!r}"', arm.path.read_text(), count=1)
        )
        tight = sa.load(tmp_path / "tight.urdf")
        broken = broken_as_flown(replace(bent, arm=tight), request_of(replace(bent, arm=tight)))
        assert (broken and broken[0]) == word


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mda6", "chaser7"])
def test_contacts_on_curves_are_those_of_dense_samples(name):
    arm, rng = sa.load(name), np.random.default_rng(5)
    bodies, found = collision_geometry(arm), {True: 0, False: 0}
    low, high = np.maximum(arm.lower, -2.5), np.minimum(arm.upper, 2.5)
    for _ in range(30):
        points = rng.uniform(low, high, (1, 4, arm.n))
        curve = Curved(arm, points)
        met = any(bodies.touch(curve.joints(u)) for u in np.linspace(0.0, 1.0, 150))
        proven = bodies.contact(curve)
        assert not met or proven is not None
        if proven is not None:
            assert bodies.touch(proven.q)
        found[proven is None] += 1
    assert min(found.values()) > 3


def test_a_row_on_the_way_is_passed_with_its_attitude_as_flown():
    """Rows so coarse that splines and straight pieces turn the spacecraft differently."""
    arm = sa.load("mda6")
    s = np.linspace(0.0, 1.0, 21)[:, None]
    q = np.radians([0, 60, -100, -50, 30, 0]) + np.array([0.9, -0.5, 0.4, 0.5, -0.3, 0.6]) * s
    q += 0.1 * np.sin(np.pi * s) * np.array([1.0, 1.0, -1.0, 1.0, 0.0, -1.0])
    rows = walk(arm.at(q[0]).centred(np.zeros(3)), q)
    plan = sa.Plan.of_rows("by hand", rows, np.full(6, 0.2))
    row = 12

    def off(bent):
        there, _ = replay(bent, row)
        return np.abs(there.base.rotation - rows[row].base.rotation).max()

    assert off(landed(plan)) > 1e-6
    bent = landed(plan, on_the_way=[row])
    assert off(bent) < 1e-7
    np.testing.assert_array_equal(bent.q[[0, row, -1]], q[[0, row, -1]])
    end, _ = replay(bent)
    np.testing.assert_allclose(end.base.rotation, rows[-1].base.rotation, atol=1e-7)


@pytest.mark.parametrize("momentum", [0.0, 1e-300])
def test_short_ways_between_corners_turn_the_spacecraft_as_straight_lines_do(momentum):
    """After a long way: the joints start and stop within each, however few steps it would take."""
    rng = np.random.default_rng(11)
    arm = load_text(random_chain(rng, 5), tip="tip", task="pose")
    steps = np.vstack((2.0 * np.eye(arm.n)[-1], 1e-3 * np.vstack([np.eye(arm.n)] * 8)))
    q = rng.uniform(-1.0, 1.0, arm.n) + np.vstack((np.zeros(arm.n), np.cumsum(steps, axis=0)))
    rows = walk(arm.at(q[0]), q)
    plan = sa.Plan.of_rows("by hand", rows, np.full(arm.n, 0.2))
    np.testing.assert_array_equal(plan.dq, 0.0)
    start = plan[0].with_momentum(np.eye(6)[5] * momentum)
    flown = FlownRows(start, plan.t, plan.q, plan.wheels, plan.final_rates).attitudes()
    T = np.array([row.base.rotation for row in rows])
    short, straight = (each[1].T @ each[1:] for each in (flown, T))
    np.testing.assert_allclose(short, straight, atol=1e-9)


@pytest.mark.parametrize("momentum", [0.0, 0.5])
def test_bent_rows_turn_the_spacecraft_as_if_each_was_flown(momentum):
    """With a corner in the middle, which bends leave."""
    rng = np.random.default_rng(3)
    arm = sa.load("planar3")
    q = np.cumsum(np.vstack([rng.normal(size=3), *([rng.normal(0, 0.05, 3)] * 6 for _ in "ab")]), 0)
    start = arm.at(q[0], momentum=np.eye(6)[5] * momentum)
    flown = FlownRows(start, 2.0 * np.arange(13), q, np.zeros((13, 0)), np.zeros(3))
    wave = 1e-3 * (1.0 - np.cos(np.pi * np.arange(13) / 3.0))[:, None]
    bends = np.stack((0.0 * q, wave * [1.0, 0.0, -1.0], wave * [0.0, 1.0, 0.5]), axis=1)
    for i, T in enumerate(flown.attitudes_bent(bends, 0.2)):
        known = replace(flown, q=q + bends[:, i]).attitudes(0.2)
        np.testing.assert_allclose(T, known, atol=1e-9)


def by_hand(arm, q, rate, momentum):
    """A plan through rows, the spacecraft where it is as flown."""
    rows = walk(arm.at(q[0]).centred(np.zeros(3)), q)
    rates, h = np.full(arm.n, rate), np.array(momentum)
    plan = sa.Plan.of_rows("by hand", rows, rates, momentum=h)
    flown = FlownRows(plan[0], plan.t, plan.q, plan.wheels, plan.final_rates).attitudes()
    rows = [placed(plan[0], *row) for row in zip(q, flown, strict=True)]
    return sa.Plan.of_rows("by hand", rows, rates, momentum=h)


@pytest.mark.slow
def test_obstacles_are_met_where_splines_lead_and_not_where_lines_do():
    """Balls at the side of the first link, where the spline turns back between two rows."""
    s = np.linspace(0.0, 1.0, 6)[:, None]
    q = np.array([0.3, 1.2]) + 0.08 * np.sin(2.6 * s + 0.26) * [1.0, 0.0] + s * [0.1, 0.5]
    plan = by_hand(sa.load("planar2"), q, 0.3, np.zeros(6))
    swept, u = plan.swept, np.linspace(0.0, len(plan) - 1.0, 600)

    def side(q, base):
        return base.act(
            np.array([0.5, 0.0, 0.0]) + pin.rpy.rpyToMatrix(0, 0, q[0])[:, :2] @ [0.8, 0.06]
        )

    flown = np.array([side(swept.joints(x), swept.base(x)) for x in u])
    out = np.cross([0.0, 0.0, 1.0], flown[0]) / np.linalg.norm(flown[0])
    i = int((flown @ out).argmax())
    nearby, verdicts = u[max(i - 60, 0) : i + 60 : 4], []
    for height in (-2e-4, *np.linspace(0.0, 3e-4, 7), 5e-3):
        ball = sa.Obstacle.sphere(1e-7, sa.pose(flown[i] + height * out))
        bodies = Collisions(plan.arm, [ball])
        least = min(bodies.margins(swept, x).min() for x in nearby)
        met = contact_as_flown(replace(plan, obstacles=(ball,))) is not None
        assert met or least > -1e-9
        assert sa.collision_check(plan, ball).apart is not met
        verdicts.append((met, bodies.contact(Recorded(plan)) is not None))
    assert {(True, True), (True, False), (False, False)} <= set(verdicts)


@pytest.mark.parametrize("name", ["planar2", "mda6"])
def test_bodies_move_no_farther_than_swept_says(name):
    """Origins of bodies on splines, with momentum, and where the spacecraft is at the rows."""
    arm, rng = sa.load(name), np.random.default_rng(3)
    q = np.cumsum(rng.normal(scale=0.05, size=(8, arm.n)), axis=0) + np.linspace(0.2, 0.6, arm.n)
    plan = by_hand(arm, q, 0.2, [2.0, 1.0, 0.0, 0.0, 0.0, 3.0])
    swept, bodies, data = plan.swept, collision_geometry(arm).bodies, arm.model.createData()
    for i, most in enumerate(swept.swept(bodies).T):
        places = []
        for x in np.linspace(i, i + 1, 20):
            cfg = arm.at(swept.joints(x), base=swept.base(x))
            pin.forwardKinematics(arm.model, data, cfg.full)
            places.append([data.oMi[body.joint].act(body.pose.translation) for body in bodies])
        ways = np.linalg.norm(np.diff(places, axis=0), axis=2).sum(axis=0)
        assert (ways <= most).all()
        there = pin.SE3ToXYZQUAT(swept.base(i + 1 - 1e-12))
        np.testing.assert_allclose(np.abs(there), np.abs(plan.base[i + 1]), atol=1e-8)
