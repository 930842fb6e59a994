"""Regions free of common roots: as large as closed forms say, and no search finds a root in one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spacearm.polynomial.free_regions import Roots, prove
from spacearm.polynomial.jets import Chart, Jets, derivatives
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.polynomial.tubes import Tubes, about_box, straight

MOST = 20_000


def sines(at):
    """Return sin(q_j - at_j), whose common roots are `at` and half turns away from it."""
    n = len(at)
    return [
        Jets.of(TrigPolynomial.fit(lambda Q, j=j: np.sin(Q[:, j] - at[j]), n)) for j in range(n)
    ]


def tube(step, radius):
    """Return the tube about the segment from zero to `step`; a ball if that is zero."""
    rows = np.array((np.zeros(len(step)), step))
    return Tubes.about(straight(rows), radius)


def about(polynomials, n, low=-2.0, high=2.0, unit=1.0):
    return Roots(polynomials, np.zeros(n), np.full(n, unit), np.full(n, low), np.full(n, high))


places = st.lists(st.floats(0.05, 1.0), min_size=1, max_size=3).map(np.array)


@pytest.mark.slow
@settings(max_examples=15)
@given(places, st.floats(0.9, 0.9999), st.sampled_from([0.5, 1.0, 3.0]))
def test_a_ball_is_free_up_to_the_root_and_never_beyond(at, share, unit):
    roots, distance = about(sines(at), len(at), unit=unit), np.linalg.norm(at) / unit
    inside = prove(roots, tube(np.zeros(len(at)), share * distance), MOST)
    assert inside.radius == share * distance
    assert not len(inside.open)
    beyond = prove(roots, tube(np.zeros(len(at)), 1.01 * distance), 2000)
    assert 0.9 * distance < beyond.radius <= distance * (1 + 1e-9)
    assert np.linalg.norm(beyond.open[0] - at / unit) < 0.2 * distance


@settings(max_examples=15)
@given(places, st.floats(0.1, 1.5), st.integers(0, 2**32 - 1))
def test_a_tube_is_free_up_to_the_root_nearest_to_the_segment(at, length, seed):
    way = np.random.default_rng(seed).normal(size=len(at))
    step = length * way / np.linalg.norm(way)
    share = np.clip(at @ step / length**2, 0.0, 1.0)
    distance = np.linalg.norm(at - share * step)  # others are half a turn away from it
    roots = about(sines(at), len(at), -1.2, 1.2)
    if distance < 0.02:
        assert prove(roots, tube(step, 0.03), 500).radius <= distance * (1 + 1e-9)
        return
    wanted = min(0.95 * distance, 1.0)
    assert prove(roots, tube(step, wanted), MOST).radius == wanted
    assert prove(roots, tube(step, 1.05 * distance), 500).radius <= distance * (1 + 1e-9)


@given(st.integers(1, 4), st.floats(0.01, 1.0), st.integers(0, 2**32 - 1))
def test_what_is_near_a_box_is_where_its_form_is_not_positive(n, radius, seed):
    rng, m = np.random.default_rng(seed), 50
    low, high = np.sort(rng.uniform(-1.0, 1.0, (2, n)), axis=0)
    centre, half = rng.uniform(-1.5, 1.5, (m, n)), rng.uniform(0.0, 0.4, (m, n))
    form = about_box(centre, half, low, high, radius)
    x = half * rng.uniform(-1.0, 1.0, (m, n))
    u = form.value + (form.slope * x).sum(axis=1) + 0.5 * np.einsum("mi,mij,mj->m", x, form.bend, x)
    beyond = np.maximum(np.maximum(low - centre - x, centre + x - high), 0.0)
    exact = (beyond**2).sum(axis=1) - radius**2
    assert (u <= exact + form.noise).all()
    clean = ((centre - half >= high) | (centre + half <= low) | (np.abs(beyond) == 0.0)).all(axis=1)
    sided = clean & ((centre + half <= high) & (centre - half >= low) | (beyond > 0.0)).all(axis=1)
    assert np.abs(u - exact)[sided] == pytest.approx(0.0, abs=form.noise.max())


def test_what_a_segment_moves_and_roots_do_not_depend_on_adds_no_distance():
    at = np.array([0.8, 0.1])
    ours = [
        Jets.of(TrigPolynomial.fit(lambda Q, j=j: np.sin(Q[:, j] - at[j]), 3)) for j in range(2)
    ]
    roots, step = about(ours, 3), np.array([0.6, 0.0, 0.9])
    distance = np.hypot(0.2, 0.1)  # from (0.6, 0)
    assert prove(roots, tube(step, 0.98 * distance), MOST).radius == 0.98 * distance
    assert prove(roots, tube(step, 0.4), 2000).radius <= distance * (1 + 1e-9)


def test_only_what_lies_within_the_limits_counts():
    roots = about(sines(np.array([0.5, 0.5])), 2, -2.0, 0.4)
    assert prove(roots, tube(np.zeros(2), 0.8), MOST).radius == 0.8
    outside = Roots(roots.polynomials, np.zeros(2), np.ones(2), np.full(2, 0.9), np.full(2, 1.0))
    assert prove(outside, tube(np.zeros(2), 0.8), MOST).tried == 0


def test_a_root_in_the_middle_leaves_nothing():
    found = prove(about(sines(np.zeros(2)), 2), tube(np.zeros(2), 1.0), MOST)
    assert found.radius == pytest.approx(0.0, abs=1e-6)


def test_a_box_as_such_is_free_or_holds_a_root():
    at = np.array([0.3, -0.2])
    roots, rng = about(sines(at), 2), np.random.default_rng(0)
    centre, half = rng.uniform(-1, 1, (2000, 2)), rng.uniform(0.001, 0.4, (2000, 2))
    free, taken = roots.free(centre, half)
    holds = (np.abs(centre - at) <= half).all(axis=1)
    assert not (free & holds).any()
    assert free[~holds].mean() > 0.5
    assert (taken >= 0.0).all()


def test_boxes_are_proven_by_some_of_many_polynomials_first():
    n, rng = 2, np.random.default_rng(0)
    at = np.array([0.3, -0.2])
    mixed = [sines(at)[i % n] for i in range(5)]
    roots = about(mixed, n)
    assert len(roots.varied.polynomials) < len(mixed)
    centre, half = rng.uniform(-0.5, 1, (500, n)), rng.uniform(0.001, 0.4, (500, n))
    free = roots.tried(centre, half, np.zeros(500, dtype=int)).free
    holds = (np.abs(centre - at) <= half).all(axis=1)
    assert not (free & holds).any()
    assert free[~holds].mean() > 0.5


def test_points_that_share_coordinates_have_the_derivatives_of_each_alone(monkeypatch):
    rng = np.random.default_rng(0)
    f = TrigPolynomial(rng.normal(size=(5, 3, 1, 5)) + 0j)
    polynomials = [Jets.of(f), Jets.of(TrigPolynomial(f.coefficients[::-1]))]
    Q = rng.permutation(rng.choice([-0.7, 0.1, 2.0], (200, 4)))
    indices = [(), (0,), (3, 1), (2,), (0, 0, 3)]
    alone = np.concatenate([derivatives(polynomials, q[None], indices) for q in Q])
    assert np.allclose(derivatives(polynomials, Q, indices), alone, rtol=0, atol=1e-12)
    monkeypatch.setattr("spacearm.polynomial.jets.BLOCK", 3 * f.coefficients.size)
    assert np.allclose(derivatives(polynomials, Q, indices), alone, rtol=0, atol=1e-12)


def test_a_derivative_that_keeps_its_sign_in_a_box_has_it_at_all_points():
    rng = np.random.default_rng(0)
    f = Jets.of(TrigPolynomial.fit(lambda Q: np.sin(Q @ [1, -2, 1]) + np.cos(Q[:, 1]), 3))
    centre, half = rng.uniform(-1, 1, (300, 3)), rng.uniform(0.001, 0.4, (300, 3))
    half[::3, 0] = 0.0  # faces
    steady = about([f], 3).tried(centre, half, np.zeros(300, dtype=int)).steady
    assert not steady[::3, 0].any()
    assert (steady != 0.0)[half > 0.0].mean() > 0.3
    X = centre + half * rng.uniform(-1, 1, (100, 1, 3)).clip(-0.5, 0.5) * 2.0  # faces and corners
    slope = f(X.reshape(-1, 3), 1).gradient.reshape(X.shape)
    assert (slope * steady >= 0.0).all()


def test_rounding_counts():
    """A polynomial that is as small as its error everywhere proves nothing."""
    f = TrigPolynomial.fit(lambda Q: 2.0 + np.cos(Q[:, 0]), 1)
    assert prove(about([Jets.of(f)], 1), tube(np.zeros(1), 1.0), MOST).radius == 1.0
    blurred = Jets(TrigPolynomial(f.coefficients, 3.1), Chart.turning(1))
    assert prove(about([blurred], 1), tube(np.zeros(1), 1.0), 100).radius == 0.0


def test_what_does_not_matter_takes_no_boxes():
    f = Jets.of(TrigPolynomial.fit(lambda Q: np.sin(Q[:, 1] - 0.5), 3))
    proof = prove(about([f], 3), tube(np.zeros(3), 0.499), MOST)
    assert proof.radius == 0.499
    assert proof.tried < 50
