"""Coefficients of trigonometric polynomials from samples, with a bound of their error.

Samples on a tensor grid of N_j = 2 d_j + 1 points give the coefficients by one fast Fourier
transform. If each sample is off by E at most, the interpolant is off by Lambda E at most anywhere,
where Lambda is the product of the Lebesgue constants of the axes,

    (1 / N) sum_i 1 / sin((2 i + 1) pi / (2 N)),   i = 0 ... N - 1,

each reached between two points of the grid. E is measured: at points that are not on the grid, the
interpolant and the samples differ by what the sampler and the degrees leave out.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.errors import UnsupportedError
from spacearm.polynomial.univariate import Complex

Sampler = Callable[[Array], Array]
Integers = npt.NDArray[np.int_]

MOST_SAMPLES = 10_000_000
"""Largest number of samples of a fit, to bound its memory."""
LINES = 4
"""Random lines along each angle, from whose spectra its degree is found."""
CHECKS = 64
"""Random points at which a fit is compared with new samples."""
SAFETY = 8.0
"""How much larger the error of a sample may be than the largest seen at these points."""
ROUNDING = 1e-13
"""Share of the largest coefficient along a line below which one is left out."""
ABOVE_ROUNDING = 32.0
"""How much larger a coefficient is than those that only rounding makes."""
MISFIT = 1e-9
"""Share of the size of a function by which a fit must not miss it."""


def interpolants(sampler: Sampler, degrees: Integers) -> list[Complex]:
    """Compute the coefficients of the components, whose degrees are (n, components).

    Raises:
        UnsupportedError: There are too many.
    """
    most = degrees.max(axis=1)
    shape = [2 * int(d) + 1 for d in most]
    if math.prod(shape) > MOST_SAMPLES:
        raise UnsupportedError(
            f"a trigonometric polynomial of degrees {tuple(map(int, most))} has "
            f"{math.prod(shape):.3g} coefficients, of which {MOST_SAMPLES:.0e} at most are "
            "kept; lock joints"
        )
    axes = np.meshgrid(*(2.0 * np.pi * np.arange(s) / s for s in shape), indexing="ij")
    values = sampler(np.stack([axis.ravel() for axis in axes], axis=1))
    components = np.ascontiguousarray(values.T).reshape(-1, *shape)
    over = tuple(range(1, len(shape) + 1))
    spectra = np.fft.fftshift(np.fft.fftn(components, axes=over, norm="forward"), axes=over)
    return [
        np.ascontiguousarray(
            c[tuple(slice(m - k, m + k + 1) for m, k in zip(most, d, strict=True))]
        )
        for c, d in zip(spectra, degrees.T, strict=True)
    ]


def error_bound(values: Array, wanted: Array, degrees: tuple[int, ...]) -> float:
    """Bound the error of an interpolant everywhere from its values and new samples, (m,) each.

    Raises:
        UnsupportedError: They differ by more than rounding can.
    """
    miss, size = float(np.abs(values - wanted).max()), float(np.abs(wanted).max())
    if not miss <= MISFIT * size:
        raise UnsupportedError(
            f"the function is not band-limited: a trigonometric polynomial of degrees {degrees} "
            f"misses it by {miss:.3g} (its size is {size:.3g})"
        )
    return SAFETY * miss * math.prod(_lebesgue(2 * d + 1) for d in degrees)


def degrees_of(sampler: Sampler, n: int, highest: int, rng: np.random.Generator) -> Integers:
    """Find the degrees (n, components): where the spectra along random lines end.

    Raises:
        UnsupportedError: They do not end up to the highest degree, or are not finite.
    """
    N = 2 * highest + 5
    lines = rng.uniform(-np.pi, np.pi, (n, LINES, 1, n)).repeat(N, axis=2)
    for j in range(n):
        lines[j, :, :, j] = 2.0 * np.pi * np.arange(N) / N
    values = sampler(lines.reshape(-1, n))
    if not np.isfinite(values).all():
        raise UnsupportedError("the function gives values that are not finite")
    spectra = np.fft.rfft(values.reshape(n, LINES, N, -1), axis=2, norm="forward")
    size = np.abs(spectra).max(axis=1)  # (n, orders, components)
    rounding = size[:, highest + 1 :].max(axis=1)
    bound = np.maximum(ROUNDING * size.max(axis=(0, 1)), ABOVE_ROUNDING * rounding)
    for j in range(n):
        if (rounding[j] > MISFIT * size.max(axis=(0, 1))).any():
            raise UnsupportedError(
                f"the function is not band-limited in angle {j}: its degree is above {highest}"
            )
    orders = np.arange(size.shape[1])[None, :, None]
    return np.where(size > bound[:, None], orders, 0).max(axis=1)


def _lebesgue(N: int) -> float:
    """Return the Lebesgue constant of interpolation at N points of the circle, N odd."""
    return float((1.0 / np.sin((2 * np.arange(N) + 1) * np.pi / (2 * N))).mean())
