"""A kernel of every shape; processes that start afresh find it here, whatever else is installed."""

import numpy as np

from spacearm.compiler.kernel import compiled


def function(x, y, u, t):
    """Return arrays of several shapes."""
    from spacearm.compiler import symbols

    return np.sin(x) @ u + y, symbols.row(t, y), np.outer(x, u), y


def kernel(lanes=4):
    return compiled(function, {"x": (3,), "y": ()}, {"u": (3,)}, {"t": 2}, lanes=lanes)


NUMBERS = {"u": np.array([1.0, -2.0, 0.5])}
TABLES = {"t": np.arange(8.0).reshape(4, 2)}


def expected(x, y):
    rows = TABLES["t"][np.clip(y, 0, 3).astype(int)]
    return np.sin(x) @ NUMBERS["u"] + y, rows, x[:, :, None] * NUMBERS["u"], y


def close(found, x, y):
    assert len(found) == 4
    for value, other in zip(found, expected(x, y), strict=True):
        assert value.shape == other.shape
        np.testing.assert_allclose(value, other, rtol=1e-14, atol=1e-14)


def in_process(seed):
    x, y = np.random.default_rng(seed).uniform(0, 3, (9, 3)), np.arange(9.0)
    close(kernel()({"x": x, "y": y}, NUMBERS, TABLES, threads=2), x, y)
    return seed
