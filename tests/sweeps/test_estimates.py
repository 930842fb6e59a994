"""Estimates of what a sweep takes, with a clock that only chunks move: nothing here is timed."""

import itertools
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import spacearm as sa
from spacearm.sweeps import estimates
from spacearm.sweeps.estimates import _spread_chunks, estimate

pytest.importorskip("zarr")  # which needs Python 3.11

STUDY = """
arms = ["planar2", {source = "planar2", name = "other"}]
chunk = 1000

[parameters]
base_inertia = {from = 1, to = 2, points = 10}

[risk]
sigma_min = 0.2
bins = [0, 6]
samples = 4000
"""
EACH_ARM, EACH_DESIGN = 40, 4


@pytest.fixture(scope="module")
def study():
    return sa.Study.parse(STUDY)


@pytest.fixture
def told(study, monkeypatch):
    """What is told where each chunk takes so long, and the first one of a design this longer."""

    def tell(cost, setup=0.0, workers=1, budget=estimates.BUDGET):
        now, seen = [0.0], set()
        clock = SimpleNamespace(process_time=lambda: now[0])

        def compute(_study, _store, chunk):
            design = chunk.number // EACH_DESIGN
            took = cost(chunk.number) + setup * (design not in seen)
            seen.add(design)
            now[0] += took
            return took

        monkeypatch.setattr(estimates, "time", clock)
        monkeypatch.setattr(estimates.Store, "create", lambda *_: None)
        monkeypatch.setattr(estimates, "_computed", compute)
        (found,) = estimate(study, workers, budget)
        true = sum(map(cost, range(study.total))) + setup * 20 * min(workers, EACH_DESIGN)
        return found, true, now[0]

    return tell


@pytest.mark.parametrize("setup", [0.0, 0.2, 1.5])
@pytest.mark.parametrize(
    "cost",
    [
        lambda _: 0.1,
        lambda number: 0.01 if number < EACH_ARM else 1.0,  # the other arm
        lambda number: 0.01 * (1 + number % EACH_ARM),  # along the designs
        lambda number: 0.5 if number in (39, 40, 41) else 0.05,  # those in the middle of the study
        lambda number: 0.02 * (1 + number % EACH_DESIGN) ** 2,  # along the boxes of a design
    ],
)
def test_what_is_told_is_within_a_factor_of_two_or_a_bound(told, cost, setup):
    for workers in (1, 3, 64):
        found, true, _ = told(cost, setup, workers)
        assert found.at_least <= true * (1.0 + 1e-9)
        if found.is_known:
            assert true / 2.0 <= found.seconds <= 2.0 * true


def test_chunks_that_take_the_same_time_are_told_exactly(told):
    found, true, took = told(lambda _: 0.1)
    assert found.seconds == pytest.approx(true)
    assert found.at_least == pytest.approx(true)
    assert found.is_known
    assert found.longest == pytest.approx(0.1)
    assert took < 0.5 * true


def test_where_the_budget_does_not_reach_all_arms_only_a_bound_is_told(told):
    found, true, took = told(lambda number: 8.0 + (number >= EACH_ARM), budget=1.0)
    assert took < 10.0  # one chunk
    assert found.at_least == pytest.approx(took)
    assert not found.is_known
    assert found.at_least <= true * (1.0 + 1e-9)


def test_where_chunks_differ_much_only_a_bound_is_told(told):
    found, true, _ = told(lambda number: 20.0 if number % 7 == 3 else 0.01)
    assert not found.is_known
    assert found.at_least <= true * (1.0 + 1e-9)


def test_a_study_of_one_chunk_is_computed(monkeypatch):
    one = sa.Study.parse(STUDY.replace(', {source = "planar2", name = "other"}', "")
                         .replace("points = 10", "points = 1").replace("4000", "1000"))  # fmt: skip
    times = itertools.chain([3.0])
    monkeypatch.setattr(estimates, "_computed", lambda *_: next(times))
    (found,) = estimate(one)
    assert (found.chunks, found.seconds, found.at_least, found.is_known) == (1, 3.0, 3.0, True)


def test_arms_that_were_not_tried_are_not_taken_for_quick(monkeypatch):
    two = sa.Study.parse(STUDY.replace("points = 10", "points = 1").replace("4000", "1000"))
    monkeypatch.setattr(estimates, "_computed", lambda *_: 3.0)
    (found,) = estimate(two, budget=0.0)
    assert (found.chunks, found.at_least, found.is_known) == (2, 3.0, False)


@given(st.integers(0, 3), st.integers(1, 30), st.integers(1, 30), st.integers(1, 60))
@settings(max_examples=20)
def test_chunks_that_are_tried_are_spread_and_none_comes_twice(arm, designs, each_design, few):
    total = designs * each_design
    chunks = [chunk.number for chunk in _spread_chunks("risk", arm, designs, each_design)]
    assert sorted(chunks) == list(range(arm * total, (arm + 1) * total))
    first = sorted(chunks[:few])
    gaps = [b - a for a, b in itertools.pairwise((arm * total, *first, (arm + 1) * total))]
    assert max(gaps) <= 1 + 3 * total / min(few, total)
