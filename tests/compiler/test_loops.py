"""Loops, procedures, tables and functions outside, against the same over numbers."""

import numpy as np
import pytest

from spacearm.compiler import numbers, symbols
from spacearm.compiler.expressions import TracingError
from spacearm.compiler.kernel import Kernel, compiled
from spacearm.compiler.symbols import trace

WIDTHS = [1, 2, 4, 8]


def alone(function, inputs, **known):
    """Return what a function of an array library gives for each row alone, over numbers."""
    m = len(next(iter(inputs.values())))
    rows = [function(numbers, **{k: v[i] for k, v in inputs.items()}, **known) for i in range(m)]
    return [np.array(column) for column in zip(*rows, strict=True)]


def agree(function, inputs, lanes, tables=None, **known):
    """Compare machine code with numbers, and return the outputs."""
    kernel = compiled(
        lambda **arguments: function(symbols, **arguments),
        {name: value.shape[1:] for name, value in inputs.items()},
        {name: np.shape(value) for name, value in known.items()},
        {name: value.shape[1] for name, value in (tables or {}).items()},
        lanes=lanes,
        contract=False,
    )
    found = kernel(inputs, known, tables)
    for value, expected in zip(
        found, alone(function, inputs, **known, **(tables or {})), strict=True
    ):
        np.testing.assert_allclose(value, expected, rtol=1e-14, atol=1e-300)
    return found


@pytest.mark.parametrize("lanes", WIDTHS)
def test_lanes_that_end_at_different_times_keep_their_state(lanes):
    def collatz(xp, n):
        def step(n, count):
            half = xp.floor(n / 2.0)
            odd = n - 2.0 * half
            following = xp.where(odd > 0.5, 3.0 * n + 1.0, half)
            return following, count + 1.0, following > 1.0

        return xp.while_any(step, n, 0.0, most=200)

    n = np.arange(2.0, 33.0)
    last, count = agree(collatz, {"n": n}, lanes)
    np.testing.assert_array_equal(last, 1.0)
    assert count[27 - 2] == 111


@pytest.mark.parametrize("lanes", WIDTHS)
def test_a_loop_ends_after_the_most_turns(lanes):
    def function(xp, x):
        return xp.while_any(lambda x, k: (x * 1.5, k + 1.0, x < 1e9), x, 0.0, most=5)

    _, k = agree(function, {"x": np.array([1.0, 2e9, np.nan, -1.0, np.inf])}, lanes)
    np.testing.assert_array_equal(k, [5, 1, 1, 5, 1])


@pytest.mark.parametrize("lanes", WIDTHS)
def test_nested_loops_capture_through_several_depths(lanes):
    def function(xp, x, u):
        positive, squared = x[0] > 0.0, x * x

        def outer(turn, total):
            shift = xp.sin(x[1]) * turn

            def inner(k, sums):
                def innermost(t):
                    found = t + squared[0] + shift + u[0] * k
                    return xp.where(positive, found, -t), found < 3.0

                deep = xp.while_any(innermost, sums[0] * 0.5, most=4)[0]
                return (xp.stack([deep, sums[1] + shift * k * x[2]]),)

            sums = xp.repeat(3, inner, xp.stack([total, u[1] + turn]))[0]
            return (sums[0] + sums[1],)

        return xp.repeat(2, outer, x[0])

    rng = np.random.default_rng(0)
    agree(function, {"x": rng.uniform(-1, 1, (13, 3))}, lanes, u=np.array([0.3, -0.2]))


@pytest.mark.parametrize("lanes", WIDTHS)
def test_rows_are_kept_as_long_as_a_lane_runs(lanes):
    def function(x):
        def step(t, k):
            return t * 2.0, k + 1.0, t < 10.0, symbols.stack([t, x, k])

        _, k, rows = symbols.while_any(step, x, 0.0, most=9, keep=True)
        return k, rows

    x = np.array([1.0, 20.0, 3.0, 0.1, 7.0, 11.0, 0.3])
    k, rows = compiled(function, {"x": ()}, lanes=lanes)({"x": x})
    assert rows.shape == (7, 9, 3)
    for i, turns in enumerate(k.astype(int)):
        expected = [(x[i] * 2.0**turn, x[i], turn) for turn in range(turns)]
        np.testing.assert_array_equal(rows[i, :turns], expected)


@pytest.mark.parametrize("lanes", WIDTHS)
def test_rows_that_nobody_wants_are_not_written(lanes):
    def function(x):
        inner = symbols.procedure(
            lambda y: symbols.while_any(lambda z: (z + 1.0, True, z), y, most=3, keep=True)[0]
        )
        return inner(x) + symbols.while_any(lambda z: (z + 0.5, True, z), x, most=2, keep=True)[0]

    x = np.arange(5.0)
    np.testing.assert_array_equal(compiled(function, {"x": ()}, lanes=lanes)({"x": x}), 2 * x + 4)


@pytest.mark.parametrize("lanes", WIDTHS)
def test_procedures_are_written_once_and_called_anywhere(lanes):
    def function(xp, x, y):
        scale = xp.cos(y)

        def turned(v, w):
            return xp.stack([v[0] - v[1], v[0] + v[1]]) * scale, w + v @ v

        call = xp.procedure(turned)
        first, w = call(x, y)
        second, w = call(first, w)

        def step(turn, v, w):
            return call(v + turn, w)

        third, w = xp.repeat(3, step, second, w)
        return first, second, third, w

    rng = np.random.default_rng(1)
    agree(function, {"x": rng.uniform(-1, 1, (9, 2)), "y": rng.uniform(-1, 1, 9)}, lanes)


def test_a_procedure_that_captures_a_loop_is_traced_for_each():
    def function(xp, x):
        call = xp.procedure(lambda z: z * 0.5 + xp.sin(x))
        first = xp.repeat(2, lambda _, y: (call(y),), x)[0]
        return first, call(x), xp.repeat(3, lambda k, y: (call(y + k),), x)[0], call(x + 1.0)

    agree(function, {"x": np.arange(5.0)}, 4)


def test_code_of_a_procedure_stands_once():
    def function(x, calls):
        square = symbols.procedure(lambda y: np.sin(y) * y)
        for _ in range(calls):
            x = square(x)
        return x

    from spacearm.compiler.lanes import Lanes

    few, many = (
        Lanes(trace(lambda x, c=calls: function(x, c), {"x": ()}), 4, True).text()
        for calls in (1, 20)
    )
    assert few.count("define") == many.count("define")


@pytest.mark.parametrize("lanes", WIDTHS)
def test_tables_give_rows_and_the_nearest_beyond(lanes):
    def function(xp, i, u, t):
        return xp.row(t, i), xp.row(t, u), xp.row(t, 2.0), xp.repeat(
            3, lambda k, s: (s + xp.row(t, k)[1] * xp.row(t, i)[0],), 0.0
        )[0]  # fmt: skip

    table = np.arange(12.0).reshape(4, 3) ** 2
    i = np.array([0.0, 3.0, 1.0, -1.0, 7.0, np.inf, -np.inf, np.nan, 1e300, 2.0])
    found = agree(function, {"i": i}, lanes, {"t": table}, u=np.array(3.0))
    np.testing.assert_array_equal(found[0], table[[0, 3, 1, 0, 3, 3, 0, 0, 3, 2]])


def test_what_a_loop_cannot_do_is_said():
    def over(step, start=1.0, **options):
        trace(lambda x: symbols.while_any(step, x * start, most=3, **options)[0], {"x": ()})

    with pytest.raises(TracingError, match="shapes"):
        over(lambda x: (np.array([x, x]), True))
    with pytest.raises(TracingError, match="a loop of 0 turns"):
        trace(lambda x: symbols.repeat(0, lambda _, x: (x,), x), {"x": ()})
    leaked = []

    def leaking(x):
        over = symbols.repeat(2, lambda _, y: (leaked.append(y * 2.0) or y,), x)[0]
        return over + leaked[-1]

    def nested_rows(x):
        def step(_, y):
            leaked.append(symbols.while_any(lambda z: (z, True, z), y, most=2, keep=True)[1])
            return (y,)

        symbols.repeat(2, step, x)
        return leaked[-1]

    with pytest.raises(TracingError, match="outside the loop"):
        trace(leaking, {"x": ()})
    with pytest.raises(TracingError, match="stands in no other"):
        trace(nested_rows, {"x": ()})


def test_the_same_function_gives_the_same_text():
    from spacearm.compiler.lanes import Lanes

    def function(x):
        call = symbols.procedure(lambda y: y * 2.0)
        return symbols.while_any(lambda y: (call(y), y < 3.0), x, most=5)[0]

    texts = {Lanes(trace(function, {"x": ()}), 4, True).text() for _ in range(3)}
    assert len(texts) == 1


@pytest.mark.parametrize("lanes", WIDTHS)
@pytest.mark.parametrize("m", [1, 3, 5, 8])
def test_functions_outside_are_called_lane_by_lane(lanes, m):
    seen = []

    def outside(lane, values, results):
        seen.append(lane)
        results[0], results[1] = (1.0 if values[0] < 0 else 0.0), values[0] * 10.0 + values[1]

    def function(x, f):
        status, value = f([x, 2.0])
        again = symbols.repeat(2, lambda k, y: (y + f([y, k])[1],), x)[0]
        return status, value, again

    x = np.arange(m) - 1.0
    kernel = compiled(function, {"x": ()}, outside={"f": 1}, lanes=lanes)
    status, value, again = kernel({"x": x}, outside={"f": outside})
    assert set(seen) == set(range(m))
    np.testing.assert_array_equal(status, x < 0)
    np.testing.assert_array_equal(value, 10.0 * x + 2.0)
    np.testing.assert_array_equal(again, 121.0 * x + 1.0)


def test_exceptions_outside_are_raised_after_all():
    def outside(lane, values, results):
        if lane == 2:
            raise KeyError("no gas")
        results[0], results[1] = 0.0, values[0]

    kernel = Kernel(trace(lambda x, f: f([x]), {"x": ()}, outside={"f": 1}), 2)
    with pytest.raises(KeyError, match="no gas"):
        kernel({"x": np.arange(7.0)}, outside={"f": outside}, threads=2)
    found = kernel({"x": np.arange(2.0)}, outside={"f": outside})
    np.testing.assert_array_equal(found[:, 1], [0.0, 1.0])
