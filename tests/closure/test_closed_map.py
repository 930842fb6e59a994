"""Maps of closed chains over two directions of what is held."""

import numpy as np
import pytest
from helpers.arms import chosen
from helpers.closed import rough, several

import spacearm as sa


@pytest.fixture(scope="module")
def held():
    rng = chosen(41)
    return sa.hold(*rough(several(rng, (7, 7)), rng), limits=False)


def test_each_posture_of_a_map_is_closed_and_its_numbers_are_those_of_a_report(held):
    chart = held.map(("x", "rz"), (0.01, 0.01), 3, limits=False)
    assert chart.describe().verdict.endswith("of the grid closes")
    assert np.isfinite(chart.sigma_min[1, 1])
    np.testing.assert_allclose(chart.q[1, 1], held.q, atol=1e-9)
    for i, j in np.argwhere(np.isfinite(chart.sigma_min)):
        by = sa.pose((chart.moves[0, i], 0, 0), (0, 0, chart.moves[1, j]))
        place = held.target.pose.copy()
        place.rotation = by.rotation @ place.rotation
        place.translation = place.translation + by.translation
        there = sa.hold(
            held.arm.at(chart.q[i, j], base=held.configuration.base),
            held.target.replace(pose=place), held.grasps, fixed=True, limits=False,
        )  # fmt: skip
        np.testing.assert_allclose(there.q, chart.q[i, j], atol=1e-7)
        report = there.report()
        np.testing.assert_allclose(chart.distance[i, j], report.distance, rtol=1e-4, atol=1e-9)
        np.testing.assert_allclose(chart.sigma_min[i, j], report.sigma[-1], rtol=1e-4, atol=1e-9)


def test_what_is_out_of_reach_does_not_close_and_is_drawn_white(held):
    chart = held.map(span=(100.0, 100.0), points=3)
    assert np.isnan(chart.distance[[0, 2]]).all()
    assert sa.plot(chart).axes


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"axes": ("x", "up")}, "unknown row 'up'"),
        ({"axes": ("x", "x")}, "give two rows"),
        ({"span": (0.1, 0.0)}, "how far to move along each"),
        ({"points": 4}, "points is 4; give an odd number"),
    ],
)
def test_maps_that_make_no_sense_are_named(held, options, why):
    with pytest.raises(sa.ConfigurationError, match=why):
        held.map(**options)
