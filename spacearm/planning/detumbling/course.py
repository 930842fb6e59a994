"""Course: joint positions and what wheels hold as polynomials over time, from rest to rest.

Each is a ramp 10 u^3 - 15 u^4 + 6 u^5 and waves u^3 (1 - u)^3 T_k(2 u - 1), T_k Chebyshev's
polynomials: first and second derivatives vanish at both ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from spacearm.arrays import Array

WAVES = 6
"""Number of waves of each joint and wheel."""


def _shapes() -> tuple[Polynomial, ...]:
    """Return the ramp and the waves over u, from 0 to 1; the first wave is 1 at its top."""
    u = Polynomial([0.0, 1.0])
    ramp, bell = u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 64.0 * u**3 * (1.0 - u) ** 3
    waves = [Chebyshev.basis(k, domain=(0.0, 1.0)).convert(kind=Polynomial) for k in range(WAVES)]
    return (ramp, *(bell * wave for wave in waves))


SHAPES = _shapes()
DERIVED = tuple(shape.deriv() for shape in SHAPES)


def shapes(u: Array, order: int = 0) -> Array:
    """Return ramp and waves (m, 1 + WAVES), or their first derivatives, at shares u (m,)."""
    return np.column_stack([shape(u) for shape in (SHAPES, DERIVED)[order]])


@dataclass(frozen=True)
class Course:
    """A motion of joints and wheels.

    Attributes:
        start: (n + w,) joint positions [rad] or [m], and what each wheel holds [N m s].
        heights: (1 + WAVES, n + w) heights of ramps and waves.
        duration: How long it lasts [s].
    """

    start: Array
    heights: Array
    duration: float

    def at(self, u: Array) -> Array:
        """Return positions and momenta (m, n + w) at shares of the duration (m,)."""
        return np.asarray(self.start + shapes(u) @ self.heights)

    def rates(self, u: Array) -> Array:
        """Return their rates (m, n + w), those of wheels their torques [N m]."""
        return np.asarray(shapes(u, 1) @ self.heights / self.duration)

    def extremes(self) -> tuple[Array, Array, Array]:
        """Return the least and the largest (n + w,) of each, and the largest rates, on the way."""
        found = [self._extremes(i) for i in range(len(self.start))]
        least, largest, rates = np.array(found).T
        return least, largest, rates

    def _extremes(self, i: int) -> tuple[float, float, float]:
        way = sum((h * shape for h, shape in zip(self.heights[:, i], SHAPES, strict=True)),
                  Polynomial([self.start[i]]))  # fmt: skip
        values, rates = _turning_values(way), _turning_values(way.deriv())
        return values.min(), values.max(), np.abs(rates).max() / self.duration


def _turning_values(p: Polynomial) -> Array:
    """Return the values of a polynomial at 0, at 1, and where its derivative vanishes between."""
    roots = p.deriv().roots()
    inside = roots.real[(np.abs(roots.imag) < 1e-6) & (roots.real > 0.0) & (roots.real < 1.0)]
    return np.asarray(p(np.concatenate((inside, [0.0, 1.0]))))
