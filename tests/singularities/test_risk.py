"""Random samples of configurations, from which risks are estimated."""

import numpy as np
import pytest
from scipy.spatial import KDTree

import spacearm as sa
from spacearm.singularities import risk
from spacearm.singularities.nearest import NearestSearch


def test_a_sample_does_not_depend_on_how_many_are_drawn_at_once(monkeypatch):
    arm = sa.load("mda6")
    at_once = risk.uniform(arm, True, 100, np.random.default_rng(3))
    monkeypatch.setattr(risk, "BLOCK", 7)
    np.testing.assert_array_equal(risk.uniform(arm, True, 100, np.random.default_rng(3)), at_once)


def test_shares_are_those_of_searched_distances():
    """Of planar2, against distances along the exact set; first-order estimates count others."""
    arm, bound = sa.load("planar2"), np.radians(20.0)
    Q = np.random.Generator(np.random.PCG64(5)).uniform(-np.pi, np.pi, (3000, 2))
    curves = np.concatenate(sa.singular_set(arm).curves())
    turns = 2.0 * np.pi * np.array(np.meshgrid((-1, 0, 1), (-1, 0, 1))).reshape(2, -1).T
    curves = np.concatenate([np.mod(curves, 2.0 * np.pi) + turn for turn in turns])
    true, _ = KDTree(curves).query(np.mod(Q, 2.0 * np.pi))
    profile = sa.risk_profile(arm, distance=bound, samples=3000, seed=5, bins=1)
    assert profile.share[0] == pytest.approx((true <= bound).mean(), abs=2e-3)
    first = sa.evaluate(arm, Q, ["distance"])["distance"]
    assert abs((first <= bound).mean() - profile.share[0]) > 4e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mda6", "ets7", "chaser7"])
def test_the_search_of_a_risk_misses_few_that_a_full_search_finds(name):
    arm, bound = sa.load(name), np.radians(5.0)
    Q = np.random.default_rng(4).uniform(-np.pi, np.pi, (600, arm.n))
    found = risk.distances_near(arm, "free-floating", Q, bound, len(Q)) <= bound
    full = []
    for q in Q:
        offset = NearestSearch(arm, "free-floating", q[None], expected=10**5).nearest()
        full.append(offset is not None and np.linalg.norm(offset) <= bound)
    missed = np.array(full) & ~found
    assert missed.sum() <= 1 + 0.02 * sum(full)


@pytest.mark.parametrize("name", ["planar3", "mda6"])
def test_few_configurations_are_searched_as_many_are(name):
    """From places beside them too: whether near, and how far, does not depend on their number."""
    arm, bound = sa.load(name), np.radians(8.0)
    Q = np.random.default_rng(3).uniform(-np.pi, np.pi, (60, arm.n))
    few = [risk.distances_near(arm, "free-floating", q[None], bound, 1)[0] for q in Q]
    many = risk.distances_near(arm, "free-floating", Q, bound, 100_000)
    assert 0 < (many <= bound).sum() < len(Q)
    np.testing.assert_allclose(few, many, rtol=1e-9, atol=1e-12)


def test_near_postures_are_kinematic_or_dynamic():
    """On a fixed spacecraft all are kinematic; of a floating planar arm some are dynamic."""
    arm = sa.load("planar2")
    held = sa.risk_profile(arm, mode="fixed", samples=2000, bins=2)
    assert held.mode == "fixed"
    assert held.overall == held.overall_kinematic > 0.0
    np.testing.assert_array_equal(held.share, held.kinematic)
    profile = sa.risk_profile(arm, samples=2000, bins=2)
    assert 0.0 < profile.overall_kinematic < profile.overall
    assert profile.overall_dynamic + profile.overall_kinematic == pytest.approx(profile.overall)
    assert profile.overall_error == pytest.approx(
        np.sqrt(profile.overall * (1.0 - profile.overall) / 2000)
    )
    # q2 of the fixed arm is within the distance of 0 or pi
    assert held.overall == pytest.approx(4.0 * np.radians(5.0) / (2.0 * np.pi), abs=0.015)


def test_a_risk_is_the_same_on_any_number_of_threads():
    arm = sa.load("ets7")
    one, two = (sa.risk_profile(arm, samples=3000, bins=3, threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.share, two.share)
    np.testing.assert_array_equal(one.kinematic, two.kinematic)


@pytest.mark.parametrize("name", ["planar2", "chaser7"])
def test_a_heavier_bus_makes_near_postures_kinematic_not_fewer(name):
    arm = sa.load(name)
    heavy = sa.design.vary(arm, {"base_mass": 1e6})
    profiles = {
        "light": sa.risk_profile(arm, samples=4000, bins=1),
        "heavy": sa.risk_profile(heavy, samples=4000, bins=1),
        "fixed": sa.risk_profile(arm, mode="fixed", samples=4000, bins=1),
    }
    assert profiles["heavy"].overall_dynamic <= 0.05 * profiles["light"].overall_dynamic + 5e-4
    assert profiles["heavy"].overall == pytest.approx(profiles["fixed"].overall, abs=2e-3)
    spread = 5.0 * profiles["fixed"].overall_error
    assert profiles["light"].overall == pytest.approx(profiles["fixed"].overall, abs=spread)
