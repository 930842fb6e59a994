"""Tapes as C: compiled without warnings, and equal to NumPy."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

from spacearm.compiler import numbers, symbols
from spacearm.compiler.c_code import Code, number
from spacearm.compiler.expressions import Tape, TracingError, negative
from spacearm.compiler.operations import OPERATIONS
from spacearm.compiler.symbols import derivatives, trace

COMPILER = shutil.which("gcc")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-ffp-contract=off")
NUMBERS = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
compiled_code = pytest.mark.skipif(COMPILER is None, reason="gcc is not installed")


def in_c(function, shape, folder):
    """A function of one array and the library, compiled as C."""
    traced = trace(lambda x: function(symbols, x), {"x": shape})
    size = int(np.prod(shape))
    count = sum(int(np.prod(np.shape(output))) for output in traced.outputs)
    code = Code("part")
    body = code.body(traced, [f"x[{i}]" for i in range(size)], [f"y[{i}]" for i in range(count)])
    text = ["#include <math.h>\nvoid f(const double *x, double *y);", *code.functions]
    text.append(f"void f(const double *x, double *y)\n{{\n{body}\n}}\n")
    source, shared = folder / "f.c", folder / "f.so"
    source.write_text("\n".join(text))
    subprocess.run([COMPILER, *STRICT, "-shared", "-fPIC", source, "-o", shared, "-lm"], check=True)
    library = ctypes.CDLL(str(shared))
    library.f.argtypes = [NUMBERS, NUMBERS]

    def call(x):
        library.f(np.ascontiguousarray(x, dtype=float), y := np.empty(count))
        return y

    return call


def same(function, shape, folder, *points):
    """Compare C with NumPy to the last bit."""
    call = in_c(function, shape, folder)
    for x in points:
        with np.errstate(all="ignore"):
            wanted = function(numbers, np.asarray(x))
        wanted = wanted if isinstance(wanted, tuple) else (wanted,)
        np.testing.assert_array_equal(call(x), np.concatenate([np.ravel(o) for o in wanted]))


@compiled_code
def test_every_operation(tmp_path):
    def f(xp, x):
        a, b = x[0], x[1]
        pairs = xp.stack([a + b, a - b, a * b, a / b, -a, 2.0 - a, xp.minimum(a, b)])
        tests = [xp.where(a < b, a, 1.0), xp.where(xp.logical_and(a <= b, b < 2.0), b, -1.0),
                 xp.where(xp.logical_or(b < a, xp.logical_not(a < 0.5)), 3.0, a)]  # fmt: skip
        rounds = [xp.rint(a), xp.floor(a), xp.ceil(a), xp.sign(a), xp.absolute(a),
                  xp.sqrt(xp.absolute(b)), xp.maximum(a, b), xp.hold(a)]  # fmt: skip
        return pairs, xp.stack(tests), xp.stack(rounds)

    rng = np.random.default_rng(0)
    special = [(0.0, 1.0), (np.inf, -1.0), (np.nan, 1.0), (1.0, np.nan), (-np.inf, 0.0)]
    same(f, (2,), tmp_path, *special, *rng.normal(size=(20, 2)))


@compiled_code
def test_functions(tmp_path):
    def f(xp, x):
        one = [xp.sin, xp.cos, xp.tan, xp.arctan, xp.sinh, xp.cosh, xp.tanh, xp.exp]
        inside = [xp.arcsin(xp.sin(x[0]) / 2.0), xp.arccos(xp.cos(x[0]) / 2.0)]
        two = [xp.arctan2(x[0], x[1]), xp.hypot(x[0], x[1]), xp.power(xp.exp(x[1]), x[0])]
        return xp.stack([*(g(x[0]) for g in one), *inside, *two, xp.log(xp.exp(x[1]))])

    call = in_c(f, (2,), tmp_path)
    for x in np.random.default_rng(0).normal(size=(20, 2)):
        np.testing.assert_allclose(call(x), f(numbers, x), rtol=4e-15, atol=4e-15)


@compiled_code
def test_loops_with_a_bound(tmp_path):
    """Newton's method for a root, sums of turns, a loop inside another, what they capture."""

    def f(xp, x):
        a = x[0] * x[0] + 1.0

        def newton(y, steps):
            new = 0.5 * (y + a / y)
            return new, steps + 1.0, xp.absolute(new - y) > 1e-9 * a

        root, steps = xp.while_any(newton, a, 0.0 * a, most=40)

        def outer(turn, total):
            (inner,) = xp.repeat(3, lambda again, s: (s + turn * again + x[1],), 0.0 * a)
            return (total + inner * root,)

        (total,) = xp.repeat(4, outer, 0.0 * a)
        return xp.stack([root, steps, total])

    same(f, (2,), tmp_path, *np.random.default_rng(1).normal(size=(10, 2)), (1e3, 1.0))


@compiled_code
def test_procedures_are_written_once(tmp_path):
    def f(xp, x):
        def turned(R, v):
            return (R * v).sum(axis=1), (R.T * v).sum(axis=1)

        apply = xp.procedure(turned)
        R = x[:9].reshape(3, 3)
        a, b = apply(R, x[9:])
        c, d = apply(R, a + b)
        return a, b, c, d

    same(f, (12,), tmp_path, *np.random.default_rng(2).normal(size=(5, 12)))
    assert (tmp_path / "f.c").read_text().count("static void") == 1


@compiled_code
def test_what_is_not_used_and_what_is_constant(tmp_path):
    same(lambda xp, x: xp.stack([x[1], x[1] * 0.0 + 2.0]), (3,), tmp_path, (1.0, 2.0, 3.0))


def test_numbers_are_exact():
    assert number(-0.1) == "(-0.1)"
    assert number(1e-300) == "1e-300"
    assert number(-0.0) == "(-0.0)"
    assert number(np.inf) == "INFINITY"
    assert number(-np.inf) == "(-INFINITY)"
    assert number(np.nan) == "NAN"


def test_what_c_has_not_is_refused():
    kept = trace(
        lambda x: symbols.while_any(lambda s: (s + x, True, s), x, most=3, keep=True)[0], {"x": ()}
    )
    with pytest.raises(TracingError, match="keeps no turns"):
        Code("part").body(kept, ["x"], ["y"])
    table = trace(lambda x, t: symbols.row(t, x), {"x": ()}, tables={"t": 2})
    with pytest.raises(TracingError, match="inputs"):
        Code("part").body(table, ["x"], ["y[0]", "y[1]"])


def test_expressions_are_folded_and_kept_once():
    tape = Tape()
    x, y = tape.variable("x"), tape.variable("y")
    assert x * 0.0 == 0.0
    assert x * 1.0 is x
    assert x + 0.0 is x
    assert negative(-x) is x
    assert x * y is y * x
    assert x + -y is x - y
    assert x - x == 0.0
    assert 0.0 - x is -x
    assert x / 2.0 is 0.5 * x


def test_derivatives_of_arithmetic():
    """Against complex steps, which nothing cancels in."""

    def f(xp, x, y):
        return (x * y - 2.0 * xp.sin(x)) / (3.0 + xp.cos(y)) + 1.0 / x - -y

    here = np.array([0.7, 1.3])
    slopes = trace(lambda x: derivatives(f(symbols, x[0], x[1]), x), {"x": (2,)})
    (found,) = slopes.outputs
    values = dict(zip((e.number for e in slopes.tape.written[:2]), here, strict=True))
    for e in slopes.tape.needed(found):
        if e.operation != "var":
            given = [values[o.number] if hasattr(o, "number") else o for o in e.operands]
            values[e.number] = OPERATIONS[e.operation].numpy(*given)
    for i, e in enumerate(found):
        step = here + 1e-20j * np.eye(2)[i]
        assert values[e.number] == pytest.approx(f(np, *step).imag / 1e-20, rel=1e-13)
