"""Sine and cosine over lanes, in LLVM's language."""

from __future__ import annotations

import numpy as np

from spacearm.compiler.instructions import Instructions

LARGE = 1e5
"""Larger angles [rad], infinity and NaN are left to the system's library."""
HALF_PI = 1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21
"""pi/2 in three parts, the first two of 33 bits, so that their products with whole numbers below
2^20 are exact (Cody & Waite, Software Manual for the Elementary Functions, 1980)."""
SINE = (
    1.58969099521155010221e-10, -2.50507602534068634195e-08, 2.75573137070700676789e-06,
    -1.98412698298579493134e-04, 8.33333333332248946124e-03, -1.66666666666666324348e-01,
)  # fmt: skip
"""(sin y - y) / y^3 by y^2 to |y| <= pi/4, highest power first (fdlibm, k_sin.c, Sun 1993)."""
COSINE = (
    -1.13596475577881948265e-11, 2.08757232129817482790e-09, -2.75573143513906633035e-07,
    2.48015872894767294178e-05, -1.38888888888741095749e-03, 4.16666666666666019037e-02,
)  # fmt: skip
"""(cos y - 1 + y^2/2) / y^4 by y^2 (fdlibm, k_cos.c)."""


def sine_cosine(code: Instructions, name: str) -> str:
    """Return the function `name` of an angle in all lanes, which gives sine and cosine.

    They are within 1.1 units in the last place, and no lane depends on the others.
    """
    V, pair = code.V, f"{{{code.V}, {code.V}}}"
    sine, cosine = _reduced(code)
    large = code.compare("ugt", code.intrinsic("fabs", "%x"), code.number(LARGE))
    code.line(f"br i1 {code.any(large)}, label %far, label %near")
    code.label("near")
    _return(code, sine, cosine)
    code.label("far")
    sine, cosine = (code.select(large, code.library(function, "%x"), near)
                    for function, near in (("sin", sine), ("cos", cosine)))  # fmt: skip
    _return(code, sine, cosine)
    return f"define internal {pair} {name}({V} %x) {{\n{code}\n}}"


def _return(code: Instructions, sine: str, cosine: str) -> None:
    pair = f"{{{code.V}, {code.V}}}"
    one = code.new(f"insertvalue {pair} poison, {code.V} {sine}, 0")
    code.line(f"ret {pair} {code.new(f'insertvalue {pair} {one}, {code.V} {cosine}, 1')}")


def _reduced(code: Instructions) -> tuple[str, str]:
    """Return sine and cosine of x = y + k pi/2, |y| <= pi/4."""
    k = code.intrinsic("rint", code.arithmetic("fmul", "%x", code.number(2.0 / np.pi)))
    y = "%x"
    for part in HALF_PI:
        y = code.product(k, code.number(-part), y)
    z = code.arithmetic("fmul", y, y)
    cubed = code.arithmetic("fmul", y, z)
    s = code.product(cubed, _polynomial(code, z, SINE), y)
    c = _cosine(code, z)
    turns = code.intrinsic("rint", code.arithmetic("fmul", k, code.number(0.25)))
    quarter = code.arithmetic(
        "fsub", k, code.arithmetic("fmul", turns, code.number(4.0))
    )  # -2 to 2
    size = code.intrinsic("fabs", quarter)
    odd = code.compare("oeq", size, code.number(1.0))
    opposite = code.compare("oeq", size, code.number(2.0))
    below = code.compare("oeq", quarter, code.number(-1.0))
    above = code.compare("oeq", quarter, code.number(1.0))
    sine, cosine = code.select(odd, c, s), code.select(odd, s, c)
    return _negated(code, sine, opposite, below), _negated(code, cosine, opposite, above)


def _cosine(code: Instructions, z: str) -> str:
    """Return 1 - z/2 + z^2 p(z), with what the first difference loses (k_cos.c)."""
    one, half = code.number(1.0), code.arithmetic("fmul", z, code.number(0.5))
    near = code.arithmetic("fsub", one, half)
    lost = code.arithmetic("fsub", code.arithmetic("fsub", one, near), half)
    rest = code.product(code.arithmetic("fmul", z, z), _polynomial(code, z, COSINE), lost)
    return code.arithmetic("fadd", near, rest)


def _polynomial(code: Instructions, z: str, coefficients: tuple[float, ...]) -> str:
    """Return a polynomial by Horner's scheme."""
    found = code.number(coefficients[0])
    for c in coefficients[1:]:
        found = code.product(z, found, code.number(c))
    return found


def _negated(code: Instructions, value: str, first: str, second: str) -> str:
    """Return -value where one of two masks is true."""
    either = code.new(f"or {code.M} {first}, {second}")
    return code.select(either, code.arithmetic("fneg", value), value)
