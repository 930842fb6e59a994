"""Sine and cosine within 1.1 units in the last place, for angles of all sizes."""

import mpmath
import numpy as np
import pytest

from spacearm.compiler.kernel import compiled

GRID = np.concatenate((
    np.linspace(-10.0, 10.0, 501),
    np.arange(-300, 301) * np.pi / 4.0,
    np.nextafter(np.arange(1, 200) * np.pi / 2.0, np.inf),
    np.arange(1.0, 63000.0, 977.0) * np.pi / 2.0,
    10.0 ** np.linspace(-300, 4.99, 300),
))  # fmt: skip
FAR = np.concatenate((10.0 ** np.linspace(5.0, 300.0, 100), [2.0**1023, -1e5, 1e5, -1e22]))


def sine_cosine(x, lanes, contract):
    kernel = compiled(lambda x: (np.sin(x), np.cos(x)), {"x": ()}, lanes=lanes, contract=contract)
    return kernel({"x": x})


def units(found, x, function):
    """Return errors in units in the last place of the exact values."""
    with mpmath.workprec(1200):
        exact = [function(mpmath.mpf(float(v))) for v in x]
        near = [float(e) for e in exact]
        return np.array([abs(float((mpmath.mpf(float(f)) - e) / mpmath.mpf(np.spacing(abs(n)))))
                         for f, e, n in zip(found, exact, near, strict=True)])  # fmt: skip


@pytest.mark.parametrize("contract", [False, True])
def test_angles_of_arms_are_within_about_a_unit(contract):
    for found, function in zip(
        sine_cosine(GRID, 4, contract), (mpmath.sin, mpmath.cos), strict=True
    ):
        assert units(found, GRID, function).max() < 1.1


@pytest.mark.parametrize("lanes", [1, 2, 4, 8])
def test_large_angles_are_the_librarys(lanes):
    for found, function in zip(
        sine_cosine(FAR, lanes, True), (mpmath.sin, mpmath.cos), strict=True
    ):
        assert units(found, FAR, function).max() < 1.0


@pytest.mark.parametrize("lanes", [1, 2, 4, 8])
def test_infinity_and_nan_give_nan_and_leave_other_lanes(lanes):
    x = np.array([0.5, np.inf, 1.0, -np.inf, np.nan, 2.0, 1e7, -0.0])
    for found, function in zip(sine_cosine(x, lanes, True), (np.sin, np.cos), strict=True):
        with np.errstate(invalid="ignore"):
            np.testing.assert_array_max_ulp(found, function(x), 1)


@pytest.mark.parametrize("lanes", [1, 2, 4, 8])
@pytest.mark.parametrize("contract", [False, True])
def test_the_sine_of_zero_has_its_sign(lanes, contract):
    x = np.array([0.0, -0.0, 1e-310, -1e-310, 5e-324, -5e-324, 0.0, -0.0, 1.0])
    sine, cosine = sine_cosine(x, lanes, contract)
    np.testing.assert_array_equal(np.signbit(sine), np.signbit(x))
    np.testing.assert_array_equal(sine[:-1], x[:-1])
    np.testing.assert_array_equal(cosine[:-1], 1.0)
