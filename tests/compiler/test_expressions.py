"""Random expressions: machine code against NumPy, to the last bit where nothing is contracted."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spacearm.compiler import symbols
from spacearm.compiler.expressions import Expression, TracingError
from spacearm.compiler.kernel import FAST, Kernel, compiled
from spacearm.compiler.machine import fuses
from spacearm.compiler.symbols import interpreted, trace

ARITHMETIC = {"add": 2, "sub": 2, "mul": 2}
EXACT = ARITHMETIC | {
    "div": 2, "neg": 1, "sqrt": 1, "abs": 1, "rint": 1, "floor": 1, "ceil": 1, "min": 2, "max": 2,
    "select": 4, "sign": 1,
}  # fmt: skip
"""Operations that IEEE 754 rounds in one way only, and how many operands they take here."""
SPECIAL = [
    0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 5e-324, -2.2250738585072014e-308, 1e308, 1e-308,
    0.5, 2.5, -3.5, 4503599627370497.5, 1e16, np.pi,
]  # fmt: skip
NAMES = {
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "arcsin": np.arcsin, "arccos": np.arccos,
    "arctan": np.arctan, "sinh": np.sinh, "cosh": np.cosh, "tanh": np.tanh, "exp": np.exp,
    "log": np.log, "arctan2": np.arctan2, "hypot": np.hypot, "power": np.power,
}  # fmt: skip
NUMBER = {"add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide,
          "neg": np.negative, "min": np.minimum, "max": np.maximum, "abs": np.absolute,
          "sqrt": np.sqrt, "rint": np.rint, "floor": np.floor, "ceil": np.ceil,
          "sign": np.sign}  # fmt: skip


@st.composite
def programs(draw, operations):
    """Lists of (operation, numbers of earlier values); the first five are inputs and constants."""
    steps = []
    for i in range(draw(st.integers(1, 25))):
        name = draw(st.sampled_from(sorted(operations)))
        count = operations[name]
        steps.append((name, draw(st.lists(st.integers(0, 4 + i), min_size=count, max_size=count))))
    return steps


def run(steps, a, b, c):
    """Return the last values of a program; over numbers or symbols."""
    values = [a, b, c, 0.3, -7.0]
    with np.errstate(all="ignore"):
        for name, operands in steps:
            x = [values[o] for o in operands]
            if name == "select":
                values.append(np.where(x[0] < x[1], x[2], x[3]))
            else:
                values.append(NUMBER[name](*x))
    return tuple(values[5:])


def columns(seed, m):
    """Return m numbers for each input: special ones, and others of all magnitudes."""
    rng = np.random.default_rng(seed)
    found = rng.standard_normal((3, m)) * 10.0 ** rng.integers(-8, 9, (3, m))
    chosen = rng.random((3, m)) < 0.4
    found[chosen] = rng.choice(SPECIAL, int(chosen.sum()))
    return dict(zip("abc", found, strict=True))


@pytest.mark.parametrize("lanes", [1, 2, 4, 8])
@settings(max_examples=15)
@given(programs(EXACT), st.integers(0, 1000), st.integers(1, 19))
def test_without_contraction_machine_code_rounds_as_numpy(lanes, steps, seed, m):
    traced = trace(lambda a, b, c: run(steps, a, b, c), {"a": (), "b": (), "c": ()})
    inputs = columns(seed, m)
    found = Kernel(traced, lanes, contract=False)(inputs)
    for value, expected in zip(found, interpreted(traced, inputs), strict=True):
        np.testing.assert_array_equal(value, expected)
        sure = ~np.isnan(value) & (value != 0.0)  # signs of zeros and NaN are not promised
        np.testing.assert_array_equal(np.signbit(value)[sure], np.signbit(expected)[sure])


@given(programs(EXACT), st.integers(0, 1000))
def test_folding_keeps_the_values_of_finite_numbers(steps, seed):
    traced = trace(lambda a, b, c: run(steps, a, b, c), {"a": (), "b": (), "c": ()})
    rng = np.random.default_rng(seed)
    inputs = dict(zip("abc", rng.uniform(0.5, 2.0, (3, 9)), strict=True))
    finite = np.ones(9, dtype=bool)
    with np.errstate(all="ignore"):
        expected = run(steps, *inputs.values())
    for value, other in zip(interpreted(traced, inputs), expected, strict=True):
        finite &= np.isfinite(other)
        np.testing.assert_array_equal(value[finite], np.broadcast_to(other, 9)[finite])


@given(programs(ARITHMETIC), st.integers(0, 1000), st.sampled_from([2, 4]))
def test_contraction_stays_within_the_rounding_of_each_operation(steps, seed, lanes):
    traced = trace(lambda a, b, c: run(steps, a, b, c)[-1], {"a": (), "b": (), "c": ()})
    inputs = dict(zip("abc", np.random.default_rng(seed).uniform(-2.0, 2.0, (3, 11)), strict=True))
    found = Kernel(traced, lanes)(inputs)
    u, values = 2.0**-52, [*inputs.values(), np.full(11, 0.3), np.full(11, -7.0)]
    bounds = [np.zeros(11)] * 5
    with np.errstate(all="ignore"):
        for name, (i, j) in steps:
            a, b, da, db = values[i], values[j], bounds[i], bounds[j]
            values.append(NUMBER[name](a, b))
            grown = da + db if name != "mul" else abs(a) * db + abs(b) * da + da * db
            bounds.append(grown * (1.0 + 4.0 * u) + 2.0 * u * abs(values[-1]) + 1e-300)
        sure = np.isfinite(values[-1]) & np.isfinite(bounds[-1])
        assert (abs(found - values[-1]) <= bounds[-1])[sure].all()


@pytest.mark.parametrize(
    "formula",
    [
        lambda a, b, c: a * b + c, lambda a, b, c: a * b - c, lambda a, b, c: c - a * b,
        lambda a, b, c: c + a * b, lambda a, b, c: a * b - 1 + 0 * c,
        lambda a, b, c: -a * b - c,
    ],
)  # fmt: skip
def test_a_product_is_rounded_with_the_sum_it_stands_in(formula):
    rng = np.random.default_rng(0)
    a, c = 1.0 + rng.integers(1, 99, (2, 20)) * 2.0**-30
    inputs = {"a": a, "b": 2.0 - a, "c": c}
    exact = [float(formula(*map(Fraction, row))) for row in zip(*inputs.values(), strict=True)]
    expected = exact if fuses() else formula(*inputs.values())
    for lanes in (1, 2, 4, 8):
        found = compiled(formula, {"a": (), "b": (), "c": ()}, lanes=lanes)(inputs)
        np.testing.assert_array_equal(found, expected)


@settings(max_examples=12)
@given(programs(EXACT), st.integers(0, 1000))
def test_all_widths_and_levels_give_the_same_bits(steps, seed):
    def function(a, b, c):
        values = run(steps, a, b, c)
        return np.sin(values[-1]), *values

    traced, inputs = trace(function, {"a": (), "b": (), "c": ()}), columns(seed, 9)
    kernels = [Kernel(traced, lanes) for lanes in (1, 2, 4, 8)]
    first = kernels[0](inputs)
    for kernel in kernels:
        kernel._compile(kernel._text, FAST)
        for value, other in zip(kernel(inputs), first, strict=True):
            np.testing.assert_array_equal(value, other)


@pytest.mark.parametrize("lanes", [1, 2, 4, 8])
@pytest.mark.parametrize("name", NAMES)
def test_functions_of_the_library_are_numpys_to_a_few_units(name, lanes):
    operands = 2 if name in ("arctan2", "hypot", "power") else 1
    kernel = compiled(
        lambda **x: getattr(symbols, name)(*x.values()), {f"x{i}": () for i in range(operands)},
        lanes=lanes,
    )  # fmt: skip
    rng = np.random.default_rng(1)
    bounded = name in ("arcsin", "arccos")
    x = [np.concatenate((rng.uniform(-1, 1, 40), [] if bounded else rng.uniform(0, 30, 40),
                         SPECIAL)) for _ in range(operands)]  # fmt: skip
    with np.errstate(all="ignore"):
        expected = NAMES[name](*x)
    found = kernel({f"x{i}": v for i, v in enumerate(x)})
    np.testing.assert_array_max_ulp(found, expected, 4)


def test_masks_are_true_where_numpys_are():
    def function(a, b):
        at = symbols.less(a, b), symbols.less_equal(a, b), a > b, a >= b, a == b, a != b
        mixed = (a < b) & ~(b < 1.0) | (a == b), np.where(a < b, b < 1.0, a < 1.0)
        return tuple(np.where(mask, 1.0, 0.0) for mask in (*at, *mixed))

    numbers = np.repeat(SPECIAL, len(SPECIAL)), np.tile(SPECIAL, len(SPECIAL))
    with np.errstate(invalid="ignore"):
        a, b = numbers
        expected = (
            a < b, a <= b, a > b, a >= b, a == b, a != b, (a < b) & ~(b < 1) | (a == b),
            np.where(a < b, b < 1.0, a < 1.0),
        )  # fmt: skip
    for lanes in (1, 2, 4, 8):
        kernel = compiled(function, {"a": (), "b": ()}, lanes=lanes)
        for found, mask in zip(kernel({"a": a, "b": b}), expected, strict=True):
            np.testing.assert_array_equal(found, mask)


def test_masks_are_numbers_where_numbers_are_wanted_and_the_reverse():
    def function(a):
        mask = a > 0.0
        return mask, mask * 2.0 + 1.0, np.where(a, 3.0, 4.0), ~mask, -mask + 0.0

    a = np.array([-1.0, 0.0, 2.0, np.nan, 5.0])
    first, second, third, fourth, fifth = compiled(function, {"a": ()})({"a": a})
    np.testing.assert_array_equal(first, a > 0)
    np.testing.assert_array_equal(second, (a > 0) * 2.0 + 1.0)
    np.testing.assert_array_equal(third, np.where(a, 3.0, 4.0))
    np.testing.assert_array_equal(fourth, ~(a > 0))
    np.testing.assert_array_equal(fifth, -1.0 * (a > 0))


def test_shared_numbers_and_masks_are_those_of_each_lane():
    def function(x, u):
        big = u[0] > u[1]
        return np.where(big, np.sin(u[0]) * x, u[1] / x), np.where(big & (x > 0), 1.0, -1.0)

    kernels = [
        compiled(function, {"x": ()}, {"u": (2,)}, lanes=lanes, contract=False)
        for lanes in (1, 2, 4, 8)
    ]
    x = np.linspace(-2, 2, 10)
    for u in ([1.0, 2.0], [2.0, 1.0]):
        first = np.sin(u[0]) * x if u[0] > u[1] else u[1] / x
        for kernel in kernels:
            found, sign = kernel({"x": x}, {"u": u})
            np.testing.assert_allclose(found, first, rtol=1e-15, atol=1e-15)
            np.testing.assert_array_equal(sign, np.where((u[0] > u[1]) & (x > 0), 1.0, -1.0))


def test_equal_operations_are_one_and_known_ones_disappear():
    traced = trace(
        lambda a, b: (a * b + b * a, a * 0.0 + 1.0 * b, a - a, (a + 0.0) - (-b)), {"a": (), "b": ()}
    )
    outputs = [o for output in traced.outputs for o in traced.flat(output)]
    needed = [e.operation for e in traced.tape.needed(outputs) if e.operation != "var"]
    assert needed == ["mul", "add", "add"]
    assert traced.outputs[2] == 0.0


def test_folding_keeps_signs():
    def formulas(a, b):
        return (
            a * -b, -a * b, -a * -b, a + -b, -a + b, -a + -b, a - -b, -a - b, 0.0 - a, 3.0 - a,
            a - 3.0, a + 3.0, a * 3.0, a * -3.0, 1.0 * a, -1.0 * a, a * 0.0 + b, -(0.0 - a),
            a / 4.0,
            a / -0.3, 0.0 / a, a - 0.0, -a / b, a / -b, abs(-a), 2.0 / a, -2.0 / a, a**2, a**-2,
            a**7, np.where(a > b, -0.0, 1.0), np.where(a > b, 0.0, 1.0), np.where(a < b, a, a),
            (a - b) * (b - a), -(a - b),
        )  # fmt: skip

    a, b = np.array([0.3, -1.7, 5.0]), np.array([1.1, -0.4, -6.0])
    found = interpreted(trace(formulas, {"a": (), "b": ()}), {"a": a, "b": b})
    for i, (value, expected) in enumerate(zip(found, formulas(a, b), strict=True)):
        np.testing.assert_allclose(value, expected, rtol=1e-15, err_msg=str(i), atol=1e-15)
        assert (np.signbit(value) == np.signbit(expected))[value != 0.0].all()
    minus, plus = found[30][2], found[31][2]
    assert np.signbit(minus)
    assert not np.signbit(plus)


def test_whole_powers_are_products_and_others_the_librarys():
    traced = trace(lambda a: (a**2, a**-3, a**0.5, a**0, a**2.5, 2.0**a), {"a": ()})
    x = np.linspace(0.1, 3.0, 7)
    expected = x**2, x**-3.0, x**0.5, x**0, x**2.5, 2.0**x
    for found, value in zip(Kernel(traced)({"a": x}), expected, strict=True):
        np.testing.assert_allclose(found, value, rtol=1e-15, atol=0)
    assert [e.operation for e in traced.tape.written].count("pow") == 2


def test_what_cannot_be_traced_is_said():
    def branches(a):
        return a if a > 0.0 else -a

    for function in (branches, lambda a: float(a), lambda a: range(a), lambda a: a == 1 or a):
        with pytest.raises(TracingError):
            trace(function, {"a": ()})
    with pytest.raises(TracingError, match="dict is not a number"):
        trace(lambda a: a + {}, {"a": ()})
    with pytest.raises(TracingError, match=r"numpy\.spacing"):
        trace(lambda a: np.spacing(a), {"a": (2,)})
    with pytest.raises(TracingError, match="in place"):
        trace(lambda a: np.add(a, a, out=a), {"a": (2,)})


def test_expressions_are_keys_of_dictionaries():
    found = []
    trace(lambda a: found.append(a) or a, {"a": ()})
    assert isinstance(found[0], Expression)
    assert {found[0]: 1}[found[0]] == 1
