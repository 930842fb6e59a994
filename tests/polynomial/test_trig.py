"""Trigonometric polynomials: values, derivatives, roots, bounds."""

import numpy as np
import pytest
from helpers.arms import seeds
from hypothesis import given
from hypothesis import strategies as st

import spacearm as sa
from spacearm.compiler import numbers
from spacearm.polynomial.contraction import waves
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.polynomial.univariate import distinct, line_roots

degrees = st.lists(st.integers(0, 3), min_size=1, max_size=3)


def random_polynomial(seed, degrees) -> TrigPolynomial:
    rng = np.random.default_rng(seed)
    shape = [2 * d + 1 for d in degrees]
    c = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    return TrigPolynomial((c + np.conj(np.flip(c))) / 2)


def by_definition(f, q):
    total = 0.0
    for index, c in np.ndenumerate(f.coefficients):
        k = np.array(index) - np.array(f.degrees)
        total += (c * np.exp(1j * k @ q)).real
    return total


@given(st.integers(0, 5), st.floats(1.0, 1e7), seeds)
def test_waves_are_those_of_the_angles_of_any_size(d, size, seed):
    q = np.random.default_rng(seed).uniform(-size, size, 37)
    q[3] = np.nan
    rows = waves(numbers, q, d)
    k = np.arange(d + 1)[:, None]
    wanted = np.vstack((np.cos(k * q), np.sin(k[1:] * q)))
    np.testing.assert_allclose(rows, wanted, rtol=0, atol=2.3e-16 * (4 + d * size))


@given(seeds, degrees)
def test_values_grid_and_fixing_follow_the_definition(seed, degrees):
    f = random_polynomial(seed, degrees)
    Q = np.random.default_rng(seed + 1).uniform(-4, 4, (5, f.n))
    wanted = [by_definition(f, q) for q in Q]
    assert f(Q) == pytest.approx(wanted, abs=1e-12 * f.scale)
    assert f(Q[0]) == pytest.approx(wanted[0], abs=1e-12 * f.scale)
    shape = tuple(2 * d + 2 for d in f.degrees)
    grid = f.grid(shape)
    last = tuple(N - 1 for N in shape)
    q = 2 * np.pi * np.array(last) / np.array(shape)
    assert grid[last] == pytest.approx(by_definition(f, q), abs=1e-12 * f.scale)
    assert f.fix({0: Q[0, 0]})(Q[0, 1:]) == pytest.approx(wanted[0], abs=1e-12 * f.scale)
    assert f.shifted(Q[1])(Q[0] - Q[1]) == pytest.approx(wanted[0], abs=1e-12 * f.scale)


@given(seeds, degrees)
def test_fit_finds_the_polynomial(seed, degrees):
    f = random_polynomial(seed, degrees)
    fitted = TrigPolynomial.fit(f, f.n)
    assert fitted.degrees == f.degrees
    assert np.allclose(fitted.coefficients, f.coefficients, atol=1e-12 * f.scale)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda Q: np.abs(np.sin(Q[:, 0])), "degree 8 or less in angle 0"),
        (lambda Q: np.cos(12 * Q[:, 0]), "no trigonometric polynomial"),
        (lambda Q: Q[:, 0], "no trigonometric polynomial"),
        (lambda Q: np.full(len(Q), np.nan), "not finite"),
        (
            lambda Q: 1e-3 * np.cos(np.cos(Q[:, 0]) * np.cos(Q[:, 1])) + Q[:, 1] * 0,
            "misses them by",
        ),
    ],
)
def test_what_is_not_band_limited_is_refused(function, message):
    with pytest.raises(sa.UnsupportedError, match=message):
        TrigPolynomial.fit(function, 2)


@given(seeds, degrees)
def test_derivatives_agree_with_differences(seed, degrees):
    f = random_polynomial(seed, degrees)
    q, h = np.random.default_rng(seed).uniform(-3, 3, f.n), 1e-5
    steps = np.eye(f.n) * h
    gradient = [(f(q + s) - f(q - s)) / (2 * h) for s in steps]
    hessian = [(f.gradient(q + s) - f.gradient(q - s)) / (2 * h) for s in steps]
    assert np.allclose(f.gradient(q), gradient, atol=1e-7 * f.scale)
    assert np.allclose(f.hessian(q), hessian, atol=1e-6 * f.scale)


@given(seeds, degrees)
def test_roots_along_a_joint_are_all_the_sign_changes(seed, degrees):
    f = random_polynomial(seed, degrees)
    q = np.random.default_rng(seed).uniform(-3, 3, f.n)
    t = np.linspace(-np.pi, np.pi, 2001)
    for j in range(f.n):
        line = np.tile(q, (len(t), 1))
        line[:, j] = t
        values = f(line)
        changes = np.flatnonzero(values[1:] * values[:-1] < 0)
        roots = f.roots(q, j)
        for i in changes:
            assert ((roots.angles > t[i] - 1e-9) & (roots.angles < t[i + 1] + 1e-9)).any()
        line = np.tile(q, (len(roots.angles), 1))
        line[:, j] = roots.angles
        assert (np.abs(f(line)) < 1e-11 * f.scale).all() if len(line) else True
        assert (np.diff(roots.angles) > 0).all()


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("angle", [0.0, 1.0, np.pi, -3.0])
def test_double_roots_are_found_with_their_multiplicity(degree, angle):
    """(1 - cos(q - a)) times a factor without roots."""
    touch = np.array([-0.5 * np.exp(1j * angle), 1.0, -0.5 * np.exp(-1j * angle)])
    factor = np.zeros(2 * degree - 1, complex)
    factor[degree - 1] = 3.0
    if degree > 1:
        factor[[0, -1]] = 0.7
    f = TrigPolynomial(np.convolve(touch, factor))
    roots = f.roots([0.0], 0)
    assert len(roots.angles) == 1
    assert abs(np.angle(np.exp(1j * (roots.angles[0] - angle)))) < 1e-6
    assert roots.multiplicity.tolist() == [2]


def test_a_line_of_roots_is_named_and_a_lower_degree_is_no_obstacle():
    c = np.zeros((3, 3), complex)
    c[0, 2] = c[2, 0] = 0.5  # cos(q1 - q2)
    c[0, 0] = c[2, 2] = -0.5  # - cos(q1 + q2): together 2 sin q1 sin q2
    f = TrigPolynomial(c)
    assert f.roots([0.0, 0.5], 1).everywhere
    assert f.roots([0.7, 0.5], 1).angles == pytest.approx([0, np.pi], abs=1e-15)
    line = np.array([[0, 0.5, 0.0, 0.5, 0]], complex)  # cos q, as if of degree 2
    found = line_roots(line)
    assert np.sort(found[~np.isnan(found)]) == pytest.approx([-np.pi / 2, np.pi / 2])
    assert np.isnan(line_roots(np.zeros((1, 5), complex))).all()


def test_distinct_angles_across_the_cut_are_one():
    angles, multiplicity = distinct(np.array([np.pi, -np.pi + 1e-9, 1.0, np.nan]))
    assert len(angles) == 2
    assert sorted(multiplicity) == [1, 2]


@given(seeds, degrees, st.floats(1e-4, 1.0))
def test_bounds_and_signs_hold(seed, degrees, width):
    f = random_polynomial(seed, degrees)
    rng = np.random.default_rng(seed)
    Q = rng.uniform(-np.pi, np.pi, (200, f.n))
    assert (np.abs(f.gradient(Q)) <= f.lipschitz * (1 + 1e-12) + 1e-12).all()
    assert (np.abs(f.hessian(Q)) <= f.curvature * (1 + 1e-12) + 1e-12).all()
    centres, half = Q[:20], np.full((20, f.n), width)
    signs = f.sign(centres, half)
    for centre, sign in zip(centres, signs, strict=True):
        inside = centre + rng.uniform(-width, width, (50, f.n))
        if sign:
            assert (np.sign(f(inside)) == sign).all()


@given(seeds, st.lists(st.integers(0, 3), min_size=1, max_size=4), st.data())
def test_blocks_of_a_grid_are_its_values(seed, degrees, data):
    """Whatever the shape and the threads; also where a block holds part of an axis."""
    f = random_polynomial(seed, degrees)
    shape = tuple(data.draw(st.integers(1, 9 if f.n > 2 else 40)) for _ in degrees)
    axes = np.meshgrid(*(2 * np.pi * np.arange(N) / N for N in shape), indexing="ij")
    wanted = f(np.stack([axis.ravel() for axis in axes], axis=1)).reshape(shape)
    assert f.grid(shape, threads=1) == pytest.approx(wanted, abs=1e-12 * f.scale)
    with pytest.MonkeyPatch.context() as small:
        small.setattr("spacearm.polynomial.contraction.BLOCK", 16)
        covered = np.zeros(shape, dtype=int)

        def count(values, index):
            assert values == pytest.approx(wanted[index], abs=1e-12 * f.scale)
            covered[index] += 1
            return values.size

        assert sum(f.on_grid(shape, count, threads=2)) == covered.size
        assert (covered == 1).all()
    single = f.grid(shape, out=np.empty(shape, dtype=np.float32))
    assert single.dtype == np.float32
    assert single == pytest.approx(wanted, abs=1e-6 * f.scale)


@pytest.mark.parametrize("degree", [1, 2])
def test_roots_along_many_lines_are_those_along_each(degree):
    """More lines than a block holds."""
    f = random_polynomial(3, [2, degree])
    Q = np.random.default_rng(0).uniform(-4, 4, (20_000 if degree == 1 else 9000, 2))
    many = f.roots_along(Q, 1)
    assert many.shape == (len(Q), 2 * degree)
    for i in range(0, len(Q), 997):
        assert np.sort(many[i]) == pytest.approx(
            np.sort(f.roots_along(Q[i : i + 1], 1)[0]), nan_ok=True
        )
    there = ~np.isnan(many)
    points = np.stack((Q[:, 0].repeat(2 * degree)[there.ravel()], many[there]), axis=1)
    assert np.abs(f(points)).max() < 1e-12 * f.scale
    assert f(np.empty((0, 2))).shape == (0,)
    assert f.roots_along(np.empty((0, 2)), 1).shape == (0, 2 * degree)


def test_bad_shapes_are_named():
    f = random_polynomial(0, [1, 2])
    with pytest.raises(sa.ConfigurationError, match=r"give \(n,\) or \(m, n\) angles"):
        f(np.zeros((4, 3)))
    with pytest.raises(sa.ConfigurationError, match="give 2 numbers of points"):
        f.grid((4,))
    with pytest.raises(sa.ConfigurationError, match=r"give \(4, 5\)"):
        f.grid((4, 5), out=np.empty((5, 4)))
