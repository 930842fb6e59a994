"""Derivatives of polynomials at one point and at many."""

import numpy as np
import pytest
from helpers.arms import chosen

from spacearm.polynomial.jets import Chart, Jets, stacked
from spacearm.polynomial.trig import TrigPolynomial


@pytest.mark.parametrize("degrees", [(2, 1), (2, 0, 1), (2, 2, 1, 1), (0, 0)])
@pytest.mark.parametrize("slides", [False, True])
def test_one_point_has_the_derivatives_that_it_has_among_others(degrees, slides):
    """One point is summed axis by axis to all orders, many points up to a total order."""
    rng, n = chosen(3), len(degrees)
    shape = [2 * d + 1 for d in degrees]
    c = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    f = TrigPolynomial(c + np.conj(np.flip(c)))
    sliding = np.arange(n) % 2 == 0 if slides else np.zeros(n, dtype=bool)
    chart = Chart(sliding, np.where(sliding, 0.3, 0.0), np.where(sliding, 0.7, 1.0))
    both = [Jets.of(f, chart), Jets.of(f, chart)]
    Q = chart.draw(rng, 5)
    many = stacked(both, Q, 3)
    for i, q in enumerate(Q):
        for here, there in zip(stacked(both, q[None], 3), many, strict=True):
            size = max(np.abs(there).max(), 1.0)
            np.testing.assert_allclose(here[0], there[i], rtol=0, atol=1e-12 * size)
