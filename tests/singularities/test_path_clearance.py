"""Clearances of paths that are proven: nothing singular is nearer, and not much is given away."""

from itertools import pairwise

import numpy as np
import pytest
from helpers.arms import joint, link, load_text, random_chain, robot
from hypothesis import given, settings
from hypothesis import strategies as st

import spacearm as sa
from spacearm.mechanics.distance import is_singular, lose_rank
from spacearm.model.joints import joint_scales

TASKS = {2: "x y", 3: "position", 4: "position"}


def distance_to(rows, q, unit):
    """The distance of a configuration from a path of straight segments."""
    found = []
    for start, end in zip(rows[:-1] / unit, rows[1:] / unit, strict=True):
        step = end - start
        t = np.clip((q / unit - start) @ step / max(step @ step, 1e-300), 0.0, 1.0)
        found.append(np.linalg.norm(q / unit - start - t * step))
    return min(found)


def nearest_found(arm, rows, radius, rng, starts=60):
    """Search singular configurations near a path; the distance of the best one."""
    unit, best = joint_scales(arm), np.inf
    for _ in range(starts):
        i, t, way = rng.integers(len(rows) - 1), rng.uniform(), rng.normal(size=arm.n)
        start = rows[i] + t * (rows[i + 1] - rows[i])
        start = start + unit * way / np.linalg.norm(way) * radius * rng.uniform()
        other = lose_rank(arm, start, "free-floating")
        if other is not None:
            best = min(best, distance_to(rows, other, unit))
    return best


@pytest.mark.parametrize("name", ["planar2", pytest.param("mda6", marks=pytest.mark.slow)])
def test_a_path_is_clear_up_to_its_distance_and_never_beyond(name):
    arm, rng = sa.load(name), np.random.default_rng(0)
    found = sa.singular_set(arm)
    for _ in range(2):
        start = rng.uniform(-2.0, 2.0, arm.n)
        rows = start + np.cumsum(rng.uniform(-0.1, 0.1, (3, arm.n)), axis=0)
        if not found.clearance(rows):
            continue
        s = np.linspace(0.0, 1.0, 9)
        dense = np.vstack([np.outer(1 - s, a) + np.outer(s, b) for a, b in pairwise(rows)])
        nearest = min(found.nearest(q).distance for q in dense)
        proof = found.clearance(rows, at_least=0.8 * nearest)
        assert proof.free
        assert proof.clearance == 0.8 * nearest
        beyond = found.clearance(rows, at_least=1.1 * nearest)
        assert not beyond.free
        assert beyond.verdict == "near"
        assert 0.8 * nearest <= beyond.clearance <= nearest * (1.0 + 1e-9)
        assert distance_to(rows, beyond.at, 1.0) <= 1.1 * nearest
        assert is_singular(arm, beyond.at, "free-floating")


@settings(max_examples=15)
@given(st.integers(2, 4), st.integers(0, 2**32 - 1), st.booleans())
@pytest.mark.slow
def test_no_search_finds_a_singular_configuration_within_a_proven_clearance(n, seed, sliding):
    kinds = ("revolute", "prismatic") if sliding else ("revolute", "continuous")
    arm = load_text(random_chain(seed % 1000, n, kinds), task=TASKS[n])
    rng = np.random.default_rng(seed)
    start = np.clip(rng.uniform(-2.0, 2.0, n), arm.lower, arm.upper)
    rows = np.clip(start + rng.uniform(-0.2, 0.2, (3, n)), arm.lower, arm.upper)
    proof = sa.singular_set(arm).clearance(rows, at_least=0.1)
    assert proof.free == (proof.clearance == 0.1)
    if proof.clearance:
        assert nearest_found(arm, rows, 0.1, rng) >= proof.clearance * (1.0 - 1e-9)


def test_segments_take_their_clearance_and_bad_ones_are_refused():
    arm = sa.load("planar2")
    found, q = sa.singular_set(arm), np.radians([-65.0, 60.0])
    distance = found.nearest(q).distance
    assert found.is_free(q, q, clearance=0.99 * distance)
    assert not found.is_free(q, q, clearance=1.01 * distance)
    assert found.is_free(q, q).clearance == 0.0
    with pytest.raises(sa.ConfigurationError, match="clearance is -1"):
        found.is_free(q, q, clearance=-1.0)


def test_where_the_jacobian_is_constant_everything_is_clear():
    elements = [link("bus", 10.0)]
    for i, axis in enumerate(np.eye(3)):
        elements += [
            link(f"l{i}"),
            joint(f"j{i}", f"l{i - 1}" if i else "bus", f"l{i}", "prismatic", axis=axis),
        ]
    found = sa.singular_set(load_text(robot(*elements), task="position"), mode="fixed")
    assert found.clearance([[0.1, 0.2, 0.3], [0.2, 0.1, 0.5]], at_least=0.3).clearance == 0.3


def test_only_what_is_within_the_limits_counts():
    arm = sa.load("planar2")
    q = np.radians([-65.0, 60.0])
    radius = 1.2 * sa.singular_set(arm).nearest(q).distance
    narrow = arm.replace(lower=q - 0.05, upper=q + 0.05)
    found = sa.singular_set(narrow)
    assert not found.is_free(q, q, clearance=radius)
    assert found.is_free(q, q, clearance=radius, limits=True)


def test_progress_of_a_clearance_never_falls():
    """The path is proven free first, then clear: each is half of it."""
    told = []
    way = [[0.3, 1.0], [0.4, 1.2], [0.6, 1.1]]
    found = sa.singular_set(sa.load("planar2"))
    assert found.clearance(way, at_least=0.1, progress=lambda *x: told.append(x)).free
    assert told == sorted(told)
    assert any(2 * done >= of for done, of in told)
    assert {of for _, of in told} == {1000}


@pytest.mark.slow
def test_a_few_minors_have_columns_in_common_that_are_seldom_dependent():
    """Joint 7 of chaser7 hardly moves the tip: minors with its column prove little."""
    arm, rng = sa.load("chaser7", task="position"), np.random.default_rng(5)
    for way in rng.uniform(*np.clip((arm.lower, arm.upper), -np.pi, np.pi), (3, 2, arm.n)):
        assert sa.singular_set(arm).is_free(way, clearance=np.radians(0.1))
