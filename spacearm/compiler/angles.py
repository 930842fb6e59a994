"""Sine and cosine as array code, within 1.1 units in the last place."""

from __future__ import annotations

from typing import Any

import numpy as np

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


def sine_cosine(x: Any) -> tuple[Any, Any, Any]:
    """Return sine and cosine of an angle, and whether it is too large for this.

    The angle is y + k pi/2, |y| <= pi/4; each half turn changes both signs.
    """
    k = np.rint(x * (2.0 / np.pi))
    y = x
    for part in HALF_PI:
        y = y - k * part
    z = y * y
    s = y + y * z * np.polyval(SINE, z)
    half = 0.5 * z
    near = 1.0 - half
    lost = (1.0 - near) - half  # by rounding
    c = near + (lost + z * z * np.polyval(COSINE, z))
    half_turns = np.floor(0.5 * k)
    odd = 2.0 * half_turns < k
    sign = 1.0 - 2.0 * (half_turns - 2.0 * np.floor(0.5 * half_turns))
    sine, cosine = np.where(odd, c, s) * sign, np.where(odd, -s, c) * sign
    size = np.abs(x)
    return np.where(size <= 0.0, x, sine), cosine, ~(size <= LARGE)
