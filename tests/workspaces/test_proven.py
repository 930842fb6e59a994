"""Proven shells of spatial arms, from both directions."""

import re

import numpy as np
import pytest
from helpers.arms import frame, joint, link, load_text, random_chain, robot, seeds
from hypothesis import given, settings

import spacearm as sa
from spacearm.mechanics.distance import lose_rank
from spacearm.singularities.polynomials import distances


def check(result, rng, searches=12):
    """Singular configurations found otherwise lie in the shells; those of the proof are singular.

    A search starts from the Jacobian alone and knows nothing of polynomials.
    """
    arm, mode = result.arm, result.mode
    for _ in range(searches):
        q = lose_rank(arm, rng.uniform(-np.pi, np.pi, arm.n), mode)
        if q is not None:
            (R,) = distances(arm, q[None], mode)
            assert ((result.pdw[:, 0] - 1e-6 <= R) & (result.pdw[:, 1] + 1e-6 >= R)).any()
    covered = [distances(arm, curve, mode) for curve in result.proof]
    for low, high in result.covered:
        for R in rng.uniform(low, high, 3):
            i = next(i for i, at in enumerate(covered) if at.min() <= R <= at.max())
            curve, over = result.proof[i], covered[i] >= R
            k = int(np.flatnonzero(np.diff(over))[0])
            share = (R - covered[i][k]) / (covered[i][k + 1] - covered[i][k])
            near = curve[k] + share * (curve[k + 1] - curve[k])
            q = lose_rank(arm, near, mode)
            assert q is not None
            assert np.abs(q - near).max() < 2.0 * np.abs(curve[k + 1] - curve[k]).max() + 1e-6


@pytest.mark.parametrize("name", [pytest.param("ets7", marks=pytest.mark.slow), "vispa_cubesat"])
def test_shells_of_spatial_arms_are_certified(name):
    arm = sa.load(name)
    result = sa.workspace(arm, effort=5000)
    assert result.kind == "certified"
    assert result.gap < 1e-5 * result.reachable[0, 1]
    np.testing.assert_allclose(result.pdw, result.reachable, atol=1e-9)
    missing = result.covered[1:, 0] - result.covered[:-1, 1]
    assert missing.max(initial=0.0) <= result.gap
    assert result.covered[0, 0] <= result.gap
    assert result.covered[-1, 1] >= result.pdw[-1, 1] - result.gap
    check(result, np.random.default_rng(0), searches=5)
    (axes,) = sa.plot(result).axes
    assert "tip on singular curves" in axes.get_legend_handles_labels()[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "mode"),
    [
        ("mda6", "free-floating"),
        ("mda6", "attitude-controlled"),
        ("tecsas", "free-floating"),
        ("ets7", "fixed"),
    ],
)
def test_both_directions(name, mode):
    result = sa.workspace(sa.load(name), mode=mode)
    assert result.kind == "certified"
    check(result, np.random.default_rng(1))


@pytest.mark.slow
@settings(max_examples=4)
@given(seeds)
def test_random_spatial_arms(seed):
    arm = load_text(random_chain(seed, 6 + seed % 2, ("revolute",)), tip="tip")
    result = sa.workspace(arm, effort=20_000)
    assert np.isfinite(result.gap)
    assert (result.kind == "certified") == (result.gap <= 1e-4 * result.reachable[0, 1])
    check(result, np.random.default_rng(seed))


def within(text, lower, upper, **options):
    """An arm with other joint limits."""
    limits = (f'lower="{low}" upper="{high}"' for low, high in zip(lower, upper, strict=True))
    text = re.sub(r'lower="[^"]*" upper="[^"]*"', lambda old: next(limits, old[0]), text)
    return load_text(text, tip="tip", **options)


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 6))]
)
def test_limits_of_joints_that_do_not_matter_are_kept_by_the_curves(seed):
    rng = np.random.default_rng(seed)
    lower = rng.uniform(-2.5, 0.0, 3)
    text = sa.load("planar3").path.read_text(encoding="utf-8")
    arm = within(text, lower, lower + rng.uniform(0.3, 2.5, 3), task="x y rz")
    result = sa.workspace(arm, limits=True)
    for curve in result.proof:
        assert (curve >= arm.lower).all()
        assert (curve <= arm.upper).all()
    for low, high in result.covered:
        assert any(a - 1e-9 <= low and high <= b + 1e-9 for a, b in result.pdw)


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 3))]
)
def test_what_is_singular_within_narrow_limits_is_found(seed):
    """A millionth of the torus about a singular configuration of an arm of six joints."""
    text = random_chain(seed, 6, ("revolute",))
    whole = load_text(text, tip="tip")
    q = sa.singular_set(whole).sample(1, np.random.default_rng(seed))[0]
    arm = within(text, q - 0.3, q + 0.3)
    result = sa.workspace(arm, limits=True, effort=5_000)
    cfg = arm.at(q)
    R = np.linalg.norm(cfg.tip.translation - cfg.com)
    assert ((result.pdw[:, 0] <= R) & (result.pdw[:, 1] >= R)).any()


@pytest.mark.slow
def test_limits_are_kept_by_the_curves():
    arm = sa.load("servicer_panda")
    result = sa.workspace(arm, limits=True)
    assert result.kind == "found"  # where limits end the reach, nothing need be singular
    assert result.gap < 1.001 * (result.pdw - result.reachable).max()
    for curve in result.proof:
        assert (curve >= arm.lower - 1e-9).all()
        assert (curve <= arm.upper + 1e-9).all()


@pytest.mark.slow
def test_a_point_of_a_redundant_arm():
    arm = load_text(random_chain(3, 7, ("revolute",)), tip="tip")
    result = sa.workspace(arm, effort=2000)
    R = float(result.covered.mean())
    region = result.regions((0.0, R, 0.0))
    assert region.kind == "path dependent"
    cfg = region.singular[0]
    np.testing.assert_allclose(cfg.tip.translation - cfg.com, (0.0, R, 0.0), atol=1e-7)
    assert sa.singularity(cfg).sigma_min < 1e-7


def test_an_arm_without_singularities_is_path_independent():
    tip = (frame("tip"), joint("jt", "arm", "tip", "fixed", (0.5, 0, 0)))
    text = robot(link("bus", 10.0), link("arm"), joint("turn", "bus", "arm", xyz=(0.2, 0, 0)), *tip)
    result = sa.workspace(load_text(text, tip="tip", task="rz"))
    assert result.kind == "certified"
    assert result.pdw.shape == (0, 2)
    assert result.fraction == 1.0
