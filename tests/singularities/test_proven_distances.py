"""Distances that are proven: no singular configuration is nearer, however it is looked for."""

import numpy as np
import pytest
from helpers.arms import load_text, random_chain
from hypothesis import given, settings
from hypothesis import strategies as st

import spacearm as sa
from spacearm.mechanics.distance import lose_rank
from spacearm.model.joints import joint_scales

TASKS = {2: "x", 3: "position", 4: "position", 5: "position"}


def contradictions(arm, q, near, mode, rng, starts=40):
    """Search singular configurations within the proven distance, from starts within it."""
    unit, found = joint_scales(arm), []
    for _ in range(starts):
        way = rng.normal(size=arm.n)
        start = q + unit * way / np.linalg.norm(way) * near.distance_proven * rng.uniform()
        other = lose_rank(arm, start, mode)
        if other is not None:
            found.append(np.linalg.norm((other - q) / unit))
    return [d for d in found if d < near.distance_proven * (1 - 1e-9)]


def test_where_nothing_within_the_limits_is_singular_that_is_proven():
    arm = sa.load("planar3").replace(lower={"joint_2": 0.4}, upper={"joint_2": 2.6})
    with pytest.raises(sa.NoSolutionError, match="limits is singular: proven"):
        sa.singular_set(arm).nearest([0.1, 1.0, 0.3], limits=True)
    assert sa.singular_set(arm).nearest([0.1, 1.0, 0.3]).q[1] < 0.4


@pytest.mark.slow
@settings(max_examples=10)
@given(
    st.integers(2, 5),
    st.integers(0, 2**32 - 1),
    st.sampled_from(["free-floating", "attitude-controlled"]),
    st.booleans(),
)
def test_nothing_singular_is_found_within_a_proven_distance(n, seed, mode, sliding):
    kinds = ("revolute", "prismatic") if sliding else ("revolute", "continuous")
    arm = load_text(random_chain(seed % 1000, n, kinds), task=TASKS[n])
    rng = np.random.default_rng(seed)
    q = np.clip(rng.uniform(-2, 2, n), arm.lower, arm.upper)
    try:
        near = sa.singular_set(arm, mode=mode).nearest(q)
    except sa.NoSolutionError:  # sliding joints alone may have no singular configuration
        assert sliding
        return
    assert 0.0 <= near.distance_proven <= near.distance
    assert near.distance == pytest.approx(np.linalg.norm((near.q - q) / joint_scales(arm)))
    assert not contradictions(arm, q, near, mode, rng)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mda6", "ets7", "servicer_ur5"])
def test_of_square_arms_99_percent_are_proven(name):
    arm, rng = sa.load(name), np.random.default_rng(0)
    for q in rng.uniform(-np.pi, np.pi, (5, arm.n)):
        near = sa.singular_set(arm).nearest(q)
        assert near.distance_proven >= 0.98999 * near.distance
        assert not contradictions(arm, q, near, "free-floating", rng, 10)


def shares_proven(arm, seed):
    """Return the shares (5,) that are proven of the distances found of random configurations."""
    rng, shares = np.random.default_rng(seed), []
    for q in rng.uniform(-np.pi, np.pi, (5, arm.n)):
        near = sa.singular_set(arm).nearest(q)
        shares.append(near.distance_proven / near.distance)
        assert not contradictions(arm, q, near, "free-floating", rng, 10)
    return shares


@pytest.mark.slow
def test_of_redundant_arms_most_is_proven():
    assert np.median(shares_proven(sa.load("chaser7"), 1)) > 0.89999


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2])
def test_of_arms_with_eight_joints_more_than_half_is_proven(seed):
    """By a few of 28 minors, which are too large to use all."""
    assert np.median(shares_proven(load_text(random_chain(seed, 8, ("revolute",))), seed)) > 0.5


@pytest.mark.slow
def test_a_minor_that_is_mostly_rounding_is_left_out():
    """Of the last three columns of mda6 a point in the wrist knows next to nothing."""
    arm = sa.load("mda6", task="position")
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, 6)
    near = sa.singular_set(arm).nearest(q)
    assert near.distance_proven > 0.5 * near.distance
    assert not contradictions(arm, q, near, "free-floating", np.random.default_rng(1), 40)


def test_a_distance_to_first_order_says_so_and_proves_nothing():
    report = sa.singularity(sa.load("planar2").at([0.3, 0.7]))
    assert report.distance_proven == 0.0
    assert "to first order" in report.verdict


def test_the_limits_are_kept_and_leave_more_room():
    arm = sa.load("servicer_ur5")
    arm = arm.replace(lower=np.full(6, -0.5), upper=np.full(6, 0.5))
    q = np.full(6, 0.2)
    found = sa.singular_set(arm)
    free, kept = found.nearest(q), found.nearest(q, limits=True)
    assert kept.distance >= free.distance - 1e-6
    assert kept.distance_proven >= 0.9 * kept.distance
    assert ((kept.q >= arm.lower - 1e-9) & (kept.q <= arm.upper + 1e-9)).all()


@pytest.mark.slow
def test_minors_that_are_too_large_leave_a_distance_without_proof():
    arm = load_text(random_chain(1, 6, ("revolute",)), task="position")
    near = sa.singular_set(arm).nearest(np.linspace(-0.5, 1.0, 6))
    assert near.distance > near.distance_proven == 0.0
    assert "a nearer one may exist" in near.describe().verdict
