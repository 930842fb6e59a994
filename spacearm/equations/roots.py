"""Roots of functions of one variable between two places where they have different signs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

ROUNDS = 400
"""Most evaluations."""


def crossing(xp: Any, value: Callable[[Any], Any], bracket: Any, sharpness: float) -> Any:
    """Compute where a function crosses zero, just beyond it, by Chandrupatla's method.

    Inverse quadratic interpolation where that is safe, else bisection: Chandrupatla, Adv. Eng.
    Softw. 28, 145 (1997), DOI 10.1016/S0965-9978(96)00051-8.

    Args:
        xp: The array library.
        value: The function.
        bracket: (4,) a place, one beyond it, and the values there: of different signs, or one 0.
        sharpness: Tolerance, as a share of the place.
    """
    a, b, at_a, at_b = bracket
    falls = xp.logical_or(at_a > 0.0, xp.logical_and(at_a >= 0.0, at_b < 0.0))
    side = xp.where(falls, 1.0, -1.0)

    def ahead(f: Any) -> Any:
        return xp.where(f * side > 0.0, 1.0, 0.0)

    def step(x1: Any, x2: Any, x3: Any, f1: Any, f2: Any, f3: Any, share: Any) -> Any:
        wide = xp.absolute(x2 - x1)
        tolerance = sharpness * xp.absolute(x1) / xp.maximum(wide, 1e-300)
        open_ = xp.logical_and(tolerance < 1.0, xp.absolute(f1) > 0.0)
        least = xp.minimum(0.5 * tolerance, 0.5)
        t = x1 + xp.minimum(xp.maximum(share, least), 1.0 - least) * (x2 - x1)
        at = value(t)
        same = xp.absolute(ahead(at) - ahead(f1)) < 0.5
        x1, x2, x3 = t, xp.where(same, x2, x1), xp.where(same, x1, x2)
        f1, f2, f3 = at, xp.where(same, f2, f1), xp.where(same, f1, f2)
        xi, phi = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
        curved = f1 / (f2 - f1) * f3 / (f2 - f3)
        curved = curved + (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
        safe = xp.logical_and(phi * phi < xi, (1.0 - phi) ** 2 < 1.0 - xi)
        safe = xp.logical_and(safe, xp.absolute(curved) < np.inf)
        return x1, x2, x3, f1, f2, f3, xp.where(safe, curved, 0.5), open_

    def guarded(*state: Any) -> Any:
        *found, open_ = step(*state)
        return *(xp.where(open_, new, old) for new, old in zip(found, state, strict=True)), open_

    straight = at_b / (at_b - at_a)
    share = xp.where(straight <= np.inf, straight, 0.5)
    x1, x2, _, f1, *_ = xp.while_any(guarded, b, a, a, at_b, at_a, at_a, share, most=ROUNDS)
    return xp.where(xp.absolute(f1) > 0.0, xp.maximum(x1, x2), x1)
