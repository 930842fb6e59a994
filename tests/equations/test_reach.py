"""Bounds of the tip's distance over a box: the expansion they rest on, and points inside."""

import numpy as np
import pytest
from helpers.arms import load_text, random_chain, seeds
from hypothesis import given

from spacearm.compiler import numbers
from spacearm.equations.reach import bound, place
from spacearm.workspaces.extent import chain_of


def random_box(seed, n):
    """A chain, and a box of joint positions."""
    arm = load_text(random_chain(seed, n, ("revolute",)), tip="tip")
    rng = np.random.default_rng(seed)
    return arm, rng.uniform(-np.pi, np.pi, n), rng.uniform(0.0, 0.5, n), rng


def distance(arm, q, mode):
    """The distance of the tip from the system CM, or from that of a fixed spacecraft."""
    cfg = arm.at(q)
    centre = arm.model.inertias[1].lever if mode == "fixed" else cfg.com
    return float(np.linalg.norm(cfg.tip.translation - centre))


@given(seeds)
def test_the_chain_is_the_arm(seed):
    arm, q, half, _ = random_box(seed, 2 + seed % 4)
    for mode in ("free-floating", "fixed"):
        chain = chain_of(arm, mode)
        at = place(numbers, chain.middle, chain.E, chain.b, chain.rho, q, half)
        size = np.linalg.norm(chain.b, axis=1).sum()
        assert np.linalg.norm(at.p) == pytest.approx(distance(arm, q, mode), abs=1e-13 * size)


@given(seeds)
def test_derivatives_are_those_of_the_tip_and_the_rest_bounds_what_they_leave(seed):
    arm, q, half, rng = random_box(seed, 2 + seed % 4)
    chain = chain_of(arm, "free-floating")

    def at(x):
        return place(numbers, chain.middle, chain.E, chain.b, chain.rho, x, half)

    size, h = np.linalg.norm(chain.b, axis=1).sum(), 1e-6
    for j, step in enumerate(h * np.eye(len(q))):
        slope = (at(q + step).p - at(q - step).p) / (2.0 * h)
        np.testing.assert_allclose(at(q).g[j], slope, atol=1e-9 * size)
    here = at(q)
    for d in rng.uniform(-half, half, (20, len(q))):
        missed = np.linalg.norm(at(q + d).p - here.p - d @ here.g)
        assert missed <= here.rest[0] + 1e-13 * size


@given(seeds)
def test_no_point_of_a_box_passes_its_bounds(seed):
    arm, q, half, rng = random_box(seed, 2 + seed % 4)
    for mode in ("free-floating", "fixed"):
        chain = chain_of(arm, mode)
        numbers_of = (chain.E, chain.b, chain.rho, q, half)
        low, centre, _ = bound(numbers, chain.middle, True, *numbers_of)
        high, _, _ = bound(numbers, chain.middle, False, *numbers_of)
        corners = q + half * rng.choice((-1.0, 1.0), (20, len(q)))
        inside = rng.uniform(q - half, q + half, (20, len(q)))
        found = [distance(arm, x, mode) for x in (*corners, *inside)]
        rounding = 1e-13 * np.linalg.norm(chain.b, axis=1).sum()
        assert low - rounding <= min(found)
        assert max(found) <= -high + rounding
        assert low <= centre <= -high
