"""Functions as users write them, traced and compared with themselves."""

import math
from functools import partial

import numpy as np
import pytest

from spacearm.compiler.expressions import TracingError
from spacearm.compiler.symbols import interpreted, trace
from spacearm.motion.user_functions import over_symbols

TIMES, PLACES = np.linspace(0.0, 10.0, 6), np.array([0.0, 1.0, -1.0, 2.0, 0.5, 0.0])
TABLE = np.arange(12.0).reshape(6, 2)


def helper(t):
    return np.array([math.sin(t), 0.0, 1.0])


class Law:
    def __init__(self, gain):
        self.gain = np.diag([gain, 2.0])

    def shape(self, t):
        return math.exp(-t) if isinstance(t, float) else np.exp(-t)

    def __call__(self, t):
        return self.gain @ np.array([np.cos(t), 0.5]) * self.shape(t)


def filled(t):
    tau = np.zeros(3)
    tau[0] = np.sin(t)
    tau[1:] = np.clip(t * np.ones(2), -1.0, 3.0)
    return np.cos(tau)


def closure():
    gain, offset = np.array([1.0, 2.0]), math.pi / 3.0
    return lambda t: gain * math.cos(t + offset)


FUNCTIONS = {
    "sine": lambda t: 0.4 * np.sin(0.3 * t),
    "math": lambda t: math.sin(t) + math.atan2(t, 2.0) + math.sqrt(t) + math.pow(t, 1.5) + math.pi,
    "list": lambda t: [np.sin(t), 0.0, t**2],
    "array": lambda t: np.sin(np.array([t, 0.0, 1.0, 2.0 * t])),
    "nested": lambda t: np.array([[t, 1.0], [np.exp(-t), 0.0]]) @ np.array([1.0, t]),
    "where": lambda t: np.where(t > 3.0, np.sin(t), 0.2 * t),
    "choice": lambda t: np.where(np.array([t, 1.0]) > 2.0, 1.0, np.array([0.0, t])),
    "clip": lambda t: np.clip(np.sin(t), -0.5, 0.5),
    "bounds": lambda t: np.minimum(np.array([t, 1.0]), np.maximum(2.0, t)),
    "largest": lambda t: np.max(np.array([t, 3.0, 1.0])) + np.array([t, 2.0]).min() + abs(t - 3.0),
    "interp": lambda t: np.interp(t, TIMES, PLACES),
    "columns": lambda t: np.array([np.interp(t, TIMES, TABLE[:, j]) for j in range(2)]),
    "polynomial": lambda t: np.polyval([1.0, -2.0, 0.5], t),
    "series": lambda t: np.polynomial.polynomial.polyval(t, [1.0, 2.0, -0.3]),
    "stack": lambda t: np.hstack([np.stack([t, t * t]), np.concatenate([[1.0, t], np.zeros(2)])]),
    "norm": lambda t: np.linalg.norm(np.array([t, 1.0, 2.0])),
    "norms": lambda t: np.linalg.norm([[t, 0.0], [1.0, t]], axis=0),
    "cross": lambda t: np.cross(np.array([t, 1.0, 0.0]), np.array([0.0, t, 2.0])),
    "dot": lambda t: np.dot(np.array([t, 1.0]), [2.0, t]) + np.array([t, t]) @ np.array([1.0, t]),
    "outer": lambda t: np.outer([t, 1.0], [t, 2.0]).T + np.eye(2) * t,
    "mean": lambda t: np.mean(np.array([t, 1.0, 3.0])) + np.sum([t, 1.0]) + np.prod([t, 2.0]),
    "periodic": lambda t: np.sin(t % 2.0) + np.mod(t, 3.0) + np.floor(t / 2.0),
    "degrees": lambda t: np.deg2rad(t) + np.radians(30.0) + math.degrees(t),
    "linspace": lambda t: np.linspace(0.0, 1.0, 5) * t,
    "sampled": lambda t: np.sin(np.linspace(0.0, 1.0, 4) + t).reshape(2, 2).sum(axis=1),
    "comprehension": lambda t: np.array([k * math.sin(k * t) for k in range(4)]),
    "diag": lambda t: np.diag([t, 1.0]) @ np.ones(2),
    "sign": lambda t: np.sign(t - 3.0) * np.tanh(t),
    "helper": lambda t: 2.0 * helper(t),
    "filled": filled,
    "closure": closure(),
    "object": Law(3.0),
    "method": Law(1.0).__call__,
    "partial": partial(lambda gain, t: gain * math.sin(t), 2.0),
    "known": lambda _: np.array([1.0, 2.0]),
}  # fmt: skip


@pytest.mark.parametrize("name", FUNCTIONS)
def test_what_users_write_is_traced_to_its_own_values(name):
    function, t = FUNCTIONS[name], np.random.default_rng(0).uniform(0.0, 9.0, 20)
    seen = over_symbols(function)
    (found,) = interpreted(trace(lambda t: np.asarray(seen(t)), {"t": ()}), {"t": t})
    expected = np.array([function(float(time)) for time in t])
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


def branch(t):
    return 1.0 if t > 3.0 else 0.0


UNTRACED = {
    "branch": branch,
    "comparison": lambda t: max(t, 1.0),
    "equality": lambda t: 1.0 if t == 3.0 else 2.0,
    "loop": lambda t: [0.0] * int(t),
    "index": lambda t: PLACES[int(t)],
    "solve": lambda t: np.linalg.solve(np.array([[t, 1.0], [0.0, 2.0]]), np.ones(2)),
    "rounded": lambda t: math.floor(t) * 1.0 + math.gcd(int(t), 2),
}


@pytest.mark.parametrize("name", UNTRACED)
def test_what_cannot_be_traced_raises(name):
    seen = over_symbols(UNTRACED[name])
    with pytest.raises((TracingError, TypeError)):
        trace(lambda t: np.asarray(seen(t)), {"t": ()})


def test_the_function_itself_is_left_alone():
    before = dict(helper.__globals__)
    seen = over_symbols(FUNCTIONS["helper"])
    assert seen is not FUNCTIONS["helper"]
    assert helper.__globals__ == before
    np.testing.assert_array_equal(seen(1.0), 2.0 * helper(1.0))


def test_functions_of_arrays_are_traced_over_symbols():
    def law(t, q, dq):
        error = np.array([0.1, 0.2, math.sin(t)]) - q
        return 3.0 * error - 0.5 * dq + np.linalg.norm(error) * np.ones(3)

    seen, rng = over_symbols(law), np.random.default_rng(0)
    inputs = {
        "t": rng.uniform(0, 9, 7),
        "q": rng.normal(size=(7, 3)),
        "dq": rng.normal(size=(7, 3)),
    }
    (found,) = interpreted(trace(seen, {"t": (), "q": (3,), "dq": (3,)}), inputs)
    expected = [law(float(t), q, dq) for t, q, dq in zip(*inputs.values(), strict=True)]
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)
