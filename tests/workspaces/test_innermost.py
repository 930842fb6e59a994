"""The bound of the tip's least distance: never passed, and next to what is reached."""

import numpy as np
import pytest
from helpers.arms import load_text, random_chain

import spacearm as sa
from spacearm.singularities.polynomial import distances
from spacearm.workspaces.box import Box
from spacearm.workspaces.innermost import least_distance
from spacearm.workspaces.shells import shell_about


def check(arm, mode, seed):
    """The bound against a sample and a search; returns what the search reaches [m]."""
    Q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (100_000, arm.n))
    sample = distances(arm, Q, mode)
    box = Box.of(arm.lower, arm.upper, limits=False)
    reached = float(shell_about(arm, mode, (), Q[:4096], box, 0).radius[0])
    bound = least_distance(arm, mode, reached)
    assert bound <= min(reached, sample.min())
    assert bound == 0.0 or bound >= reached - 1e-3 * sample.max()
    return reached, bound


@pytest.mark.parametrize("seed", range(8))
def test_the_bound_is_next_to_what_short_arms_reach(seed):
    arm = load_text(random_chain(seed, 2, ("revolute",)), tip="tip", task="x y")
    for mode in ("free-floating", "fixed"):
        reached, bound = check(arm, mode, seed)
        assert (bound > 0.0) == (reached > 0.1) or reached < 0.2


def test_branches_have_no_bound():
    arm = sa.load("dual_ur5", joints="all")
    assert least_distance(arm, "free-floating", 1.0) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "n"), [(2, 3), (5, 4), (8, 6), (12, 6)])
def test_the_bound_is_next_to_what_spatial_arms_reach(seed, n):
    check(load_text(random_chain(seed, n, ("revolute",)), tip="tip"), "free-floating", seed)


@pytest.mark.slow
def test_an_arm_that_does_not_reach_the_centre_is_certified():
    arm = load_text(random_chain(8, 6, ("revolute",)), tip="tip")
    result = sa.workspace(arm, effort=20_000)
    assert result.pdw[0, 0] > 0.5
    assert result.kind == "certified"
    assert result.gap < 1e-4 * result.reachable[0, 1]
