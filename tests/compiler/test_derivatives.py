"""Derivatives against closed forms and central differences."""

import numpy as np
import pytest

from spacearm.compiler import symbols
from spacearm.compiler.expressions import TracingError
from spacearm.compiler.kernel import compiled
from spacearm.compiler.symbols import derivatives, trace

FUNCTIONS = {
    "sin": (np.sin, np.cos), "cos": (np.cos, lambda x: -np.sin(x)),
    "tan": (np.tan, lambda x: 1.0 / np.cos(x) ** 2),
    "arcsin": (np.arcsin, lambda x: (1.0 - x * x) ** -0.5),
    "arccos": (np.arccos, lambda x: -((1.0 - x * x) ** -0.5)),
    "arctan": (np.arctan, lambda x: 1.0 / (1.0 + x * x)),
    "sinh": (np.sinh, np.cosh), "cosh": (np.cosh, np.sinh),
    "tanh": (np.tanh, lambda x: np.cosh(x) ** -2.0), "exp": (np.exp, np.exp),
    "log": (np.log, lambda x: 1.0 / x), "sqrt": (np.sqrt, lambda x: 0.5 * x**-0.5),
    "absolute": (lambda x: np.abs(x - 0.5), lambda x: np.sign(x - 0.5)),
    "cube": (lambda x: x**3, lambda x: 3.0 * x * x),
    "inverse": (lambda x: 2.0 / x, lambda x: -2.0 / x**2),
    "power": (lambda x: x**2.5, lambda x: 2.5 * x**1.5),
    "exponent": (lambda x: 3.0**x, lambda x: np.log(3.0) * 3.0**x),
    "where": (lambda x: np.where(x < 0.5, x * x, 3.0 * x), lambda x: np.where(x < 0.5, 2 * x, 3.0)),
    "minimum": (lambda x: np.minimum(x * x, 0.3), lambda x: np.where(x * x < 0.3, 2.0 * x, 0.0)),
    "maximum": (lambda x: np.maximum(0.3, x), lambda x: np.where(x > 0.3, 1.0, 0.0)),
    "difference": (lambda x: 1.0 - x - (-x) * x, lambda x: -1.0 + 2.0 * x),
    "steps": (lambda x: np.floor(4.0 * x) + np.rint(x) + np.ceil(x) + np.sign(x), np.zeros_like),
}  # fmt: skip


@pytest.mark.parametrize("name", FUNCTIONS)
def test_each_operation_has_its_derivative(name):
    function, slope = FUNCTIONS[name]
    x = np.linspace(0.05, 0.95, 9)
    found = compiled(lambda x: (function(x), derivatives(function(x), x)), {"x": ()})({"x": x})
    np.testing.assert_allclose(found[0], function(x), rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(found[1], slope(x), rtol=1e-13, atol=1e-14)


def formula(xp, x):
    """A function of four numbers in which each is used several times."""
    a = xp.sin(x[0] * x[1]) + xp.exp(x[2]) / (2.0 + xp.cos(x[3]))
    b = xp.arctan2(a, x[0]) * xp.hypot(x[1], a) - xp.sqrt(1.0 + x @ x)
    return xp.where(b > x[2], a * b, a / (3.0 + b)) + xp.tanh(b) ** 3


def test_a_gradient_is_that_of_central_differences():
    x, h = np.random.default_rng(0).uniform(-1, 1, (50, 4)), 1e-6
    found = compiled(lambda x: derivatives(formula(symbols, x), x), {"x": (4,)})({"x": x})
    for i in range(4):
        e = h * np.eye(4)[i]
        slopes = [(formula(np, row + e) - formula(np, row - e)) / (2.0 * h) for row in x]
        np.testing.assert_allclose(found[:, i], slopes, rtol=1e-7, atol=1e-8)


def test_second_derivatives_are_symmetric_and_those_of_differences():
    def hessian(x):
        slopes = derivatives(formula(symbols, x), x)
        return slopes, symbols.stack([derivatives(slope, x) for slope in slopes])

    kernel, h = compiled(hessian, {"x": (4,)}), 1e-6
    x = np.random.default_rng(1).uniform(-0.5, 0.5, (20, 4))
    _, second = kernel({"x": x})
    np.testing.assert_allclose(second, np.swapaxes(second, 1, 2), rtol=1e-11, atol=1e-12)
    for i in range(4):
        e = h * np.eye(4)[i]
        slopes = (kernel({"x": x + e})[0] - kernel({"x": x - e})[0]) / (2.0 * h)
        np.testing.assert_allclose(second[:, i], slopes, rtol=1e-6, atol=1e-7)


def test_what_is_held_counts_as_constant():
    def function(x):
        return derivatives(x * symbols.hold(x * x) + symbols.hold(x > 0.0) * x, x)

    found = compiled(function, {"x": ()})({"x": np.array([-2.0, 3.0])})
    np.testing.assert_array_equal(found, [4.0, 10.0])


def test_numbers_in_place_of_variables_have_derivative_zero():
    def function(x, u):
        shared = u[0] ** 2
        by_both = derivatives(x[0] * u[0], x), derivatives(shared, u)
        return (
            *by_both,
            derivatives(shared, x),
            derivatives(x[0] * x[1], symbols.array([x[0], 3.0, x[1]])),
        )

    first, second, third, fourth = compiled(function, {"x": (2,)}, {"u": (2,)})(
        {"x": np.array([[2.0, 5.0]])}, {"u": [3.0, 4.0]}
    )
    np.testing.assert_array_equal(first, [[3.0, 0.0]])
    np.testing.assert_array_equal(second, [[6.0, 0.0]])
    np.testing.assert_array_equal(third, [[0.0, 0.0]])
    np.testing.assert_array_equal(fourth, [[5.0, 0.0, 2.0]])


def test_derivatives_inside_loops_are_of_their_own_variables():
    def newton(x):
        def step(y):
            error = y**3 - x
            following = y - error / derivatives(error, y)
            return following, abs(error) > 1e-13

        return symbols.while_any(step, 1.0 + 0.0 * x, most=50)[0]

    x = np.array([0.5, 2.0, 27.0])
    np.testing.assert_allclose(
        compiled(newton, {"x": ()})({"x": x}), np.cbrt(x), rtol=1e-13, atol=0
    )


def test_what_has_no_derivative_is_said():
    def through_a_loop(x):
        return derivatives(symbols.repeat(2, lambda _, y: (y * y,), x)[0], x)

    def through_a_capture(x):
        return symbols.repeat(2, lambda _, y: (derivatives(y * x, x),), x)[0]

    def through_a_procedure(x):
        return derivatives(symbols.procedure(lambda y: y * y)(x), x)

    for function in (through_a_loop, through_a_capture, through_a_procedure):
        with pytest.raises(TracingError):
            trace(function, {"x": ()})
    assert derivatives(3.0, symbols.array([])).shape == (0,)
