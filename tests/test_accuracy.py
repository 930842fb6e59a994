"""Error bars hold against 50-digit arithmetic, and are not vacuous."""

import numpy as np
import pinocchio as pin
import precise
import pytest
from arms import random_base
from ill_conditioned import CATALOGUE, FAMILIES, measured, samples

import spacearm as sa


@pytest.mark.parametrize("family", FAMILIES)
def test_the_error_is_within_the_bar(family):
    results = [measured(*sample) for sample in samples(family, 24)]
    for result in results:
        assert result.error <= result.bar
        assert result.share <= 1.0
    assert max(result.share for result in results) > 1e-3  # bars a thousand times shorter fail


@pytest.mark.parametrize("name", CATALOGUE)
def test_thirteen_digits_are_left_of_the_catalogue(name):
    arm = sa.load(name)
    for seed in range(10):
        cfg = arm.at(np.random.default_rng(seed).uniform(-3, 3, arm.n))
        sigma = sa.singularity(cfg).sigma
        assert sa.error_bars(cfg).sigma < 1e-12 * sigma[0]


def test_bars_show_the_digits_that_a_payload_takes():
    """sigma_min of 4e-10 with an error of 5e-9: the bar says that it may be zero."""
    arm = sa.load("planar3").replace(payload=1.6990e9)
    found = [measured(arm.at(q)) for q in np.random.default_rng(0).uniform(-3, 3, (8, 3))]
    assert max(result.error / result.sigma_min for result in found) > 0.1
    assert all(result.error <= result.bar for result in found)


def test_an_exact_zero_is_within_the_bar():
    for q in ((0.0, 0.0), (0.7, 0.0)):
        cfg = sa.load("planar2").at(q)
        exact = precise.singular_values(cfg, precise.generalized_jacobian(cfg, "fixed"))
        assert abs(exact[-1]) < 1e-45
        assert sa.singularity(cfg, base="fixed").sigma_min <= sa.error_bars(cfg, "fixed").sigma


@pytest.mark.parametrize("name", CATALOGUE)
def test_bars_hold_at_every_attitude(name):
    """Also 1e-4 rad from the spacecraft upside down, where the task axes of a plane turn over."""
    arm = sa.load(name)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        q, w = rng.uniform(-3, 3, arm.n), np.append(rng.normal(size=2), 0.0)
        here = arm.at(q)
        exact = precise.singular_values(here, precise.generalized_jacobian(here))
        upside_down = pin.SE3(pin.exp3(w * (np.pi - 1e-4) / np.linalg.norm(w)), np.zeros(3))
        for base in (random_base(rng), upside_down):
            cfg = arm.at(q, base)
            errors = np.array([float(s) for s in exact]) - sa.singularity(cfg).sigma
            assert np.abs(errors).max() <= sa.error_bars(cfg).sigma


def test_bars_are_infinite_where_nothing_can_be_trusted():
    """An arm mounted 1e9 m from the spacecraft's frame: its inertia drowns in rounding."""
    far = pin.SE3(np.eye(3), np.array([1e9, 0.0, 0.0]))
    cfg = sa.load("mda6").replace(mount=far).at(np.full(6, 0.3))
    bars = sa.error_bars(cfg)
    assert np.isinf(bars.sigma)
    assert np.isinf(bars.jacobian).all()
    assert bars.jacobian.shape == (6, 6)
    assert np.isfinite(sa.error_bars(cfg, "fixed").sigma)


def test_several_tips_have_the_bars_of_each():
    both = sa.load("dual_ur5", tip=("left", "right"), task="position")
    q = np.linspace(-1, 1, both.n)
    bars = sa.error_bars(both.at(q))
    assert bars.jacobian.shape == (12, both.n)
    for tip, rows in (("left", bars.jacobian[:6]), ("right", bars.jacobian[6:])):
        one = sa.error_bars(both.replace(tip=tip).at(q))
        np.testing.assert_array_equal(rows, one.jacobian)
        assert bars.sigma >= one.sigma


def test_a_wrong_base_is_named():
    with pytest.raises(sa.ConfigurationError, match="free-floating"):
        sa.error_bars(sa.load("planar2").at([0.1, 0.2]), "free")
