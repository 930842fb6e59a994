"""Singular values and vectors of small matrices: against numpy's svd and exact arithmetic."""

import math
from fractions import Fraction
from functools import lru_cache

import numpy as np
import pytest
from helpers.arms import seeds
from hypothesis import assume, given
from hypothesis import strategies as st

from spacearm.compiler import numbers, symbols
from spacearm.compiler.kernel import compiled
from spacearm.equations import linear_algebra as equations

WIDTH = 16


@lru_cache
def kernel(k, n):
    """A compiled driver of everything about J (k, n), k <= n."""

    def everything(J):
        form = equations.bidiagonal(symbols, J)
        squares = form.q * form.q, form.e * form.e
        largest = symbols.sqrt(equations.largest_eigenvalue(symbols, *squares))
        det = form.sign
        for entry in form.q:
            det = det * entry
        least = equations.least_with_vectors(symbols, J)
        null = symbols.stack(least.null) if n > k else np.zeros((0, n))
        return least.sigma, largest, det, least.u, least.v, null

    return compiled(everything, {"J": (k, n)})


def spectra(seed, k, n, decades):
    """Matrices (WIDTH, k, n) with clusters of singular values, zeros and gaps."""
    rng = np.random.default_rng(seed)
    sigma = 10.0 ** -rng.uniform(0, decades, (WIDTH, k))
    sigma[: WIDTH // 2] = rng.choice([0.0, 1e-9, 0.3, 1.0], (WIDTH // 2, k))
    sigma[0] = 1.0
    left = np.linalg.qr(rng.normal(size=(WIDTH, k, k)))[0]
    right = np.linalg.qr(rng.normal(size=(WIDTH, n, k)))[0]
    return left * sigma[:, None] @ np.swapaxes(right, 1, 2)


sizes = st.integers(1, 6), st.integers(0, 3), st.floats(0, 14)


@given(seeds, *sizes)
def test_singular_values_are_those_of_numpy(seed, k, more, decades):
    """To 2e-14 of the largest; of nearly equal ones too, which are told apart by no more."""
    J = spectra(seed, k, k + more, decades)
    sigma, largest, det, *_ = kernel(k, k + more)({"J": J})
    expected = np.linalg.svd(J, compute_uv=False)
    assert (abs(sigma - expected[:, -1]) <= 2e-14 * expected[:, 0]).all()
    there = expected[:, 0] > 0.0
    assert (abs(largest - expected[:, 0]) <= 2e-14 * expected[:, 0])[there].all()
    assert np.allclose(abs(det), expected.prod(axis=1), rtol=1e-10, atol=1e-14)
    if more == 0:
        assert np.allclose(det, np.linalg.det(J), rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("apart", [0.0, 1e-15, 1e-8, 1e-7, 1e-4])
def test_nearly_equal_singular_values(apart):
    rng = np.random.default_rng(0)
    for k in (2, 6):
        turn = np.linalg.qr(rng.normal(size=(2, 200, k, k)))[0]
        J = turn[0] * (1.0 + apart * np.arange(k)) @ turn[1]
        sigma = kernel(k, k)({"J": J})[0]
        assert abs(sigma - 1.0).max() <= 1e-14


@given(seeds, *sizes)
def test_vectors_belong_to_the_least_singular_value(seed, k, more, decades):
    J = spectra(seed, k, k + more, decades)
    J = J[np.abs(J).max(axis=(1, 2)) > 0.0]
    sigma, largest, _, u, v, null = kernel(k, k + more)({"J": J})
    bar = 1e-14 * largest[:, None]
    assert (abs((J @ v[:, :, None])[..., 0] - sigma[:, None] * u) <= bar).all()
    assert (abs((u[:, None] @ J)[:, 0] - sigma[:, None] * v) <= bar).all()
    assert (abs(J @ null.swapaxes(1, 2)).reshape(len(J), -1) <= bar).all()
    basis = np.concatenate((v[:, None], null), axis=1)
    assert basis @ basis.swapaxes(1, 2) == pytest.approx(
        np.tile(np.eye(more + 1), (len(J), 1, 1)), abs=1e-13
    )


def test_numbers_give_what_compiled_code_gives():
    J = np.random.default_rng(0).normal(size=(5, 4, 6))
    sigma, _, _, u, v, null = kernel(4, 6)({"J": J})
    for i in range(len(J)):
        with np.errstate(divide="ignore", invalid="ignore"):
            one = equations.least_with_vectors(numbers, J[i])
        assert one.sigma == pytest.approx(sigma[i], abs=1e-14)
        turned = np.sign(one.u @ u[i])  # both vectors may be turned round
        assert one.u == pytest.approx(turned * u[i], abs=1e-12)
        assert one.v == pytest.approx(turned * v[i], abs=1e-12)
        assert np.array(one.null) == pytest.approx(null[i], abs=1e-13)


def test_nothing_that_is_not_a_number_hides():
    J = np.random.default_rng(0).normal(size=(20, 3, 4))
    clean = kernel(3, 4)({"J": J})[0]
    J[7, 1, 2] = np.nan
    sigma = kernel(3, 4)({"J": J})[0]
    assert np.isnan(sigma).nonzero()[0].tolist() == [7]
    assert np.delete(sigma, 7).tolist() == np.delete(clean, 7).tolist()


@given(seeds)
def test_graded_bidiagonal_matrices_keep_relative_accuracy(seed):
    """B is bidiagonal already: its least singular value has all digits, over 60 decades."""
    rng = np.random.default_rng(seed)
    entries = rng.integers(1, 16, 5) * 2.0 ** -rng.integers(0, 66, 5)
    B = np.diag(entries[:3]) + np.diag(entries[3:], 1)
    exact = least_singular_value(B)
    sigma = kernel(3, 3)({"J": np.tile(B.T, (3, 1, 1))})[0]
    np.testing.assert_allclose(sigma, exact, rtol=1e-12, atol=0)


def least_singular_value(B):
    """From tr (B^T B)^-p for large p, in exact rational arithmetic."""
    B = [[Fraction(float(x)) for x in row] for row in B]
    inverse = [[Fraction(0)] * 3 for _ in range(3)]  # upper triangular, by back substitution
    for i in (2, 1, 0):
        inverse[i][i] = 1 / B[i][i]
        for j in range(i + 1, 3):
            inverse[i][j] = -B[i][i + 1] * inverse[i + 1][j] / B[i][i]
    T = [[sum(a * b for a, b in zip(x, y, strict=True)) for y in inverse] for x in inverse]
    bounds = []
    for p in (1, 2, 4, 8, 16, 32, 64, 128):
        T = [[sum(x[m] * T[m][j] for m in range(3)) for j in range(3)] for x in T]
        bounds.append(math.exp(-log_of(T[0][0] + T[1][1] + T[2][2]) / (4 * p)))
    assume(math.isclose(*bounds[-2:], rel_tol=1e-14))  # else it is too near the next one
    return bounds[-1]


def log_of(x):
    return math.log(x.numerator) - math.log(x.denominator)
