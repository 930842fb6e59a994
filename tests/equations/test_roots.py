"""Roots between two places, by NumPy and compiled, against closed forms."""

import numpy as np
import pytest

from spacearm.compiler import numbers, symbols
from spacearm.compiler.kernel import compiled
from spacearm.equations.plant import crossing

SHARP = 1e-14


def cubic(t):
    return t * t * t - 2.0


def root(function, a, b, at_a=None, at_b=None):
    """The root by NumPy, and the same compiled."""
    ends = function(a) if at_a is None else at_a, function(b) if at_b is None else at_b
    bracket = np.array([a, b, *ends], dtype=float)
    with np.errstate(all="ignore"):
        found = float(crossing(numbers, function, bracket, SHARP))
    kernel = compiled(
        lambda bracket: crossing(symbols, function, bracket, SHARP), {"bracket": (4,)}, lanes=4
    )
    both = np.array([bracket, [0.0, 4.0, -1.0, 1.0]])  # lanes need different numbers of rounds
    assert kernel({"bracket": both})[0] == pytest.approx(found, rel=4.0 * SHARP)
    return found


@pytest.mark.parametrize(("a", "b"), [(1.0, 2.0), (0.0, 50.0), (1.2599, 1.26)])
def test_a_root_is_found_to_its_last_digits_and_lies_just_beyond(a, b):
    found = root(cubic, a, b)
    assert found == pytest.approx(2.0 ** (1.0 / 3.0), rel=2e-14)
    assert found >= 2.0 ** (1.0 / 3.0) * (1.0 - 1e-15)


def test_functions_that_fall_and_flat_ones():
    assert root(lambda t: 0.5 - t, 0.0, 3.0) == pytest.approx(0.5, rel=2e-14)
    flat = root(lambda t: (t - 1.0) * (t - 1.0) * (t - 1.0), 0.0, 3.0)
    assert flat == pytest.approx(1.0, rel=2e-14)


def test_a_root_at_the_end_is_the_end():
    assert root(lambda t: t - 2.0, 1.0, 2.0) == 2.0


def test_a_function_that_begins_at_zero_crosses_beyond():
    """From 0 it rises before it falls: the crossing is that of the fall."""
    found = root(lambda t: t * (1.0 - t), 0.0, 3.0, at_a=0.0)
    assert found == pytest.approx(1.0, rel=2e-14)
