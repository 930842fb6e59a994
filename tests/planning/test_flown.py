"""Constraints of plans along what is flown: the splines through their rows."""

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.replay import replay

import spacearm as sa
from spacearm.collisions.separation import collision_geometry
from spacearm.collisions.swept_motion import Curved
from spacearm.mechanics.floating import walk
from spacearm.planning.problem import broken_as_flown
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
