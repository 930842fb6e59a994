"""Roots by Aberth's iteration, against eigenvalues and roots that are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spacearm.compiler import numbers
from spacearm.polynomial.univariate import _by_eigenvalues, circle_roots, compiled_roots, wrap


def with_roots(angles, others=()):
    """Real waves (2 d + 1,) of a polynomial with these real roots, and pairs z, 1 / conj(z)."""
    z = np.concatenate((np.exp(1j * np.asarray(angles)), *([w, 1 / np.conj(w)] for w in others)))
    c, d = np.poly(z)[::-1], len(z) // 2
    c = c * np.sqrt(np.conj(c[-1] / c[0]) / abs(c[-1] / c[0]))  # c_-k = conj(c_k)
    c = c * np.exp(-0.5j * np.angle(c[0] * c[-1]))
    c = c / np.abs(c).max()
    assert c == pytest.approx(np.conj(c[::-1]), abs=1e-12)
    return np.concatenate((c[d:][:1].real, 2 * c[d + 1 :].real, -2 * c[d + 1 :].imag))


@pytest.mark.parametrize("d", [2, 3, 4, 6])
def test_random_polynomials_have_the_roots_that_eigenvalues_give(d):
    rows = np.random.default_rng(d).normal(size=(2000, 2 * d + 1))
    found, sure = compiled_roots(d)({"line": rows})
    wanted = _by_eigenvalues(rows.T).T
    assert sure.mean() > 0.99
    same = (np.isnan(found).sum(axis=1) == np.isnan(wanted).sum(axis=1)) & (sure == 1.0)
    assert same.sum() >= sure.sum() - 2  # roots that touch are a matter of rounding
    found, wanted = np.sort(wrap(found[same])), np.sort(wanted[same])
    np.testing.assert_allclose(found, wanted, atol=1e-7)


@given(
    st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=6, unique_by=lambda q: round(q, 1)),
    st.lists(st.tuples(st.floats(0.2, 0.9), st.floats(-3.0, 3.0)), max_size=1),
)
def test_roots_that_are_known(angles, pairs):
    angles = angles[: len(angles) // 2 * 2]
    line = with_roots(angles, [r * np.exp(1j * q) for r, q in pairs])
    d = len(line) // 2
    if d < 2:
        return
    found, sure = circle_roots(numbers, d, line)
    if sure:
        assert np.sort(found[~np.isnan(found)]) == pytest.approx(np.sort(angles), abs=1e-6)


def test_a_double_root_is_found_twice_or_not_sure():
    line = with_roots([0.4, 0.4, -1.0, 2.0])
    found, sure = circle_roots(numbers, 2, line)
    wanted = [-1.0, 0.4, 0.4, 2.0]
    assert not sure or np.sort(found[~np.isnan(found)]) == pytest.approx(wanted, abs=1e-6)


def test_numbers_and_machine_code_agree():
    rows = np.random.default_rng(7).normal(size=(30, 7))
    found, sure = compiled_roots(3)({"line": rows})
    for row, roots, settled in zip(rows, found, sure, strict=True):
        wanted, also = circle_roots(numbers, 3, row)
        assert settled == also
        np.testing.assert_allclose(wrap(roots), wrap(wanted), atol=1e-9)
