"""The bound of the tip's distance: never exceeded, and next to what is reached."""

import numpy as np
import pytest
from helpers.arms import load_text, random_chain, seeds
from hypothesis import given, settings

import spacearm as sa
from spacearm.singularities.polynomials import distances
from spacearm.workspaces.extent import Box, largest_distance
from spacearm.workspaces.shells import ShellSearch


def reached(arm, mode, seed):
    """The largest distance that a search finds [m]."""
    box = Box.of(arm.lower, arm.upper, limits=False)
    Q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (4096, arm.n))
    return ShellSearch(arm, mode, box).about((), Q).radius[1]


@pytest.mark.parametrize("mode", ["free-floating", "fixed"])
def test_a_straight_planar_arm_reaches_its_length(mode):
    """Table I: alpha + beta + gamma afloat; 0.5 + 1 + 1 m from the CM of a fixed spacecraft."""
    wanted = (20 + 42 + 45.5) / 47 if mode == "free-floating" else 2.5
    bound = largest_distance(sa.load("planar2"), mode)
    assert wanted <= bound <= wanted + 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dual_ur5", "chaser7"])
def test_branches_and_redundant_arms(name):
    arm = sa.load(name)
    assert 0.0 <= largest_distance(arm, "free-floating") - reached(arm, "free-floating", 0) < 1e-5


@pytest.mark.slow
@settings(max_examples=3)
@given(seeds)
def test_the_bound_is_next_to_what_random_arms_reach(seed):
    arm = load_text(random_chain(seed, 3 + seed % 5, ("revolute",)), tip="tip")
    for mode in ("free-floating", "fixed"):
        bound = largest_distance(arm, mode)
        Q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (100_000, arm.n))
        assert distances(arm, Q, mode).max() <= bound
        assert reached(arm, mode, seed) <= bound <= reached(arm, mode, seed) * (1.0 + 1e-5)
